"""The arm that carries the cameras: any of six or more joints, told by Drake's model directives.

Frames, in Drake's monogram notation: W world, E the hand.
"""

from __future__ import annotations

import difflib
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.common.yaml import yaml_dump
from pydrake.multibody.parsing import (
    LoadModelDirectivesFromString,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PrismaticJoint, RevoluteJoint

from mffdrake.recognition.parameters import Finite, Text, parameters
from mffdrake.recognition.parameters.yaml_text import check_tags
from mffdrake.systems.arms.arm_joints import (
    POSE_SIZE,
    ArmError,
    CheckPosture,
    JointNames,
    MovingJoints,
)
from mffdrake.systems.arms.models import ConfigureParser, DescribeMissing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray
    from pydrake.multibody.tree import Joint

__all__ = ["ArmError", "ArmModel"]

_PA10_DIRECTIVES: tuple[dict[str, Any], ...] = (
    {"add_model": {"name": "pa10", "file": "package://mffdrake/pa10.urdf"}},
    {"add_weld": {"parent": "world", "child": "pa10::base_link"}},
)


@parameters
class ArmModel:
    """The arm as a scenario describes it, the PA-10 by default.

    The directives are Drake's own. In YAML::

        directives:
        - add_model: {name: ur5e, file: scenarios/arms/ur5e.urdf}
        - add_weld:
            parent: world
            child: ur5e::base_link
            X_PC: {translation: [0.3, 0, 0], rotation: !Rpy {deg: [0, 0, 180]}}

    In Python a tag stands under the key ``_tag``: ``{"_tag": "!Rpy", "deg": [0, 0, 180]}``. Other
    models, such as a table, may stand there too, if they are welded. The world's origin and axes
    are those of the hand's path.

    Attributes:
        directives: Drake's model directives (``add_model``, ``add_weld``, ``add_frame``, ...) that
            add the arm and weld its base. A file without ``package://`` or ``file://`` is looked
            for beside the scenario file that names it, then from the current folder.
        model: Name of the model, among those of the directives, that is the arm.
        hand_frame: Name of the arm's frame E that follows the path and carries the cameras: x
            right, y down, z along the line of sight.
        nominal_deg: Posture at which the search for joint angles begins, one number a joint from
            base to tip: degrees, or meters where a joint slides.
        held_joints: Joints that stay at their nominal angle while the hand follows a path. Where
            more than six others are left, they stay near their nominal angles.

    Example:
        >>> arm = ArmModel()
        >>> plant = arm.MakePlant()
        >>> plant.Finalize()
        >>> instance = plant.GetModelInstanceByName(arm.model)
        >>> JointNames(MovingJoints(plant, instance))
        'S1, S2, S3, E1, E2, W1, W2'
    """

    directives: tuple[dict[str, Any], ...] = _PA10_DIRECTIVES
    model: Text = "pa10"
    hand_frame: Text = "hand"
    nominal_deg: tuple[Finite, ...] = (0.0, 30.0, 0.0, 90.0, 0.0, -30.0, 0.0)
    held_joints: tuple[Text, ...] = ("S3",)

    def __post_init__(self) -> None:
        """Checks the directives' tags; what they say is for Drake to check."""
        check_tags(self.directives, "directives: ")

    @cached_property
    def nominal_positions(self) -> NDArray[np.float64]:
        """The nominal posture [rad, or m where a joint slides], shape (n,), not to be changed.

        Raises:
            ArmError: As :meth:`AddToPlant` does.
        """
        plant = self._MakeCheckedPlant()
        joints = MovingJoints(plant, plant.GetModelInstanceByName(self.model))
        positions = _Positions(joints, self.nominal_deg)
        positions.flags.writeable = False
        return positions

    def AddToPlant(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Adds the directives' models to a plant.

        Where the plant belongs to a SceneGraph, the shapes and collision filters come along.

        Args:
            plant: The plant, not finalized yet.

        Returns:
            The index of the arm's model instance.

        Raises:
            RuntimeError: If the plant is finalized already.
            ArmError: If Drake refuses the directives, or they do not make an arm that can be led:
                one chain of at least six revolute or prismatic joints, each with an actuator. The
                plant is then as it was, unless it holds a model of the same name.
        """
        if plant.is_finalized():
            raise RuntimeError(
                "ArmModel: the plant is finalized already. Add the arm before plant.Finalize()."
            )
        # Only a finalized plant knows its joints' order: the checks have one of their own.
        _ = self.nominal_positions
        self._ProcessDirectives(plant)
        return plant.GetModelInstanceByName(self.model)

    def MakePlant(self, time_step: float = 0.0) -> MultibodyPlant:
        """Makes a plant with nothing but the directives' models, without geometry.

        Args:
            time_step: The plant's time step [s]; 0 makes a continuous plant.

        Returns:
            The plant, not finalized, so that frames can be added: the model inside a controller or
            a predictor. Gravity is Drake's default (9.81 m/s², down).

        Raises:
            ValueError: If ``time_step`` is negative.
            ArmError: As :meth:`AddToPlant` does.
        """
        if not (np.isfinite(time_step) and time_step >= 0.0):  # Drake would abort the process.
            raise ValueError(
                f"ArmModel: time_step must be 0 (continuous) or positive [s], not {time_step}."
            )
        plant = MultibodyPlant(time_step=time_step)
        self.AddToPlant(plant)
        return plant

    def _ProcessDirectives(self, plant: MultibodyPlant) -> None:
        directives = [_WithUri(directive) for directive in self.directives]
        parser = Parser(plant)
        ConfigureParser(parser)
        try:
            text = yaml_dump({"directives": directives})
            ProcessModelDirectives(LoadModelDirectivesFromString(text), parser)
        except (RuntimeError, SystemExit) as error:  # pydrake exits where an assertion fails.
            # Where the reading went wrong is said from the inside out; the innermost is enough.
            reason = " ".join(str(error).split()).split(" while accepting ")[0]
            if isinstance(error, SystemExit):  # Its text names Drake's source, not the directive.
                reason = "one lacks a name, a frame or a file that it must have"
            raise ArmError(
                f"arm: Drake refuses the directives: {reason.removesuffix('.')}. "
                "Write them as Drake's model directives, with all names and files."
            ) from error

    def _MakeCheckedPlant(self) -> MultibodyPlant:
        """A finalized plant, once all is well with the arm."""
        plant = MultibodyPlant(time_step=0.0)
        self._ProcessDirectives(plant)
        plant.Finalize()
        models = {
            plant.GetModelInstanceName(ModelInstanceIndex(i)): ModelInstanceIndex(i)
            for i in range(2, plant.num_model_instances())  # 0, 1: the world's and the default one.
        }
        if self.model not in models:
            raise ArmError(
                f"arm: the directives add no model named '{self.model}'; they add: "
                f"{', '.join(models) or 'none'}. Set model to one of these."
            )
        for body in plant.GetFloatingBaseBodies():
            name = plant.get_body(body).scoped_name().get_full()
            raise ArmError(
                f"arm: '{name}' hangs in the air. "
                f"Weld it: add_weld {{parent: world, child: {name}}}."
            )
        for name, instance in models.items():
            if name != self.model and plant.num_velocities(instance) > 0:
                raise ArmError(
                    f"arm: the model '{name}' has moving joints "
                    f"({JointNames(MovingJoints(plant, instance))}), but only the arm "
                    f"'{self.model}' may have some. Make them fixed."
                )
        self._CheckJoints(plant, models[self.model])
        self._CheckPosture(plant, models[self.model])
        return plant

    def _CheckJoints(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        joints = MovingJoints(plant, instance)
        for joint in joints:
            if not isinstance(joint, RevoluteJoint | PrismaticJoint):
                raise ArmError(
                    f"arm: joint {joint.name()} is of type '{joint.type_name()}', but must be "
                    "revolute or prismatic. Split it, or make it fixed."
                )
        if len(joints) < POSE_SIZE:
            raise ArmError(
                f"arm: the model '{self.model}' has {len(joints)} moving joints "
                f"({JointNames(joints) or 'none'}), but a hand pose takes at least {POSE_SIZE}. "
                "Use an arm with more."
            )
        actuated = [
            plant.get_joint_actuator(i).joint().name()
            for i in plant.GetJointActuatorIndices(instance)
        ]
        missing = [joint.name() for joint in joints if joint.name() not in actuated]
        if missing:
            raise ArmError(
                f"arm: no actuator at {', '.join(missing)}. Give every moving joint a "
                "<transmission> with an <actuator> in the model's file."
            )
        if actuated != [joint.name() for joint in joints]:
            raise ArmError(
                f"arm: the actuators' order is {', '.join(actuated)}, the joints' "
                f"{JointNames(joints)}. List the model's transmissions in the joints' order."
            )

    def _CheckPosture(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        joints = MovingJoints(plant, instance)
        if not plant.HasFrameNamed(self.hand_frame, instance):
            frames = [plant.get_frame(i).name() for i in plant.GetFrameIndices(instance)]
            close = difflib.get_close_matches(self.hand_frame, frames, n=3, cutoff=0.4) or frames
            raise ArmError(
                f"arm: the model '{self.model}' has no frame '{self.hand_frame}'; it has "
                f"{', '.join(close)}. Set hand_frame, or add one by add_frame."
            )
        CheckPosture(joints, _Positions(joints, self.nominal_deg), self.held_joints)


def _Positions(joints: Sequence[Joint], nominal_deg: Sequence[float]) -> NDArray[np.float64]:
    """Degrees as radians, but not where a joint slides; as many as are given."""
    positions = np.radians(nominal_deg)
    for i, joint in enumerate(joints[: len(positions)]):
        if isinstance(joint, PrismaticJoint):
            positions[i] = nominal_deg[i]
    return positions


def _WithUri(directive: Mapping[str, Any]) -> dict[str, Any]:
    """A directive with the path of its file, if it has one, as Drake's parser takes it."""
    changed = dict(directive)
    for kind in ("add_model", "add_directives"):
        options: Any = changed.get(kind)
        if not isinstance(options, dict):
            continue
        file = options.get("file")
        if isinstance(file, str) and file and "://" not in file:
            path = Path(file).expanduser().absolute()
            if not path.exists():
                raise ArmError(f"arm: {DescribeMissing(file)}")
            changed[kind] = {**options, "file": f"file://{path}"}
    return changed
