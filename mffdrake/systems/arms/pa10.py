"""The hand-eye arm: a Mitsubishi PA-10 with a stereo camera's frames on its hand.

Frames, in Drake's monogram notation: W world (z up, x forward), B the arm's base, E the hand, C the
right camera and L the left camera. Hand and camera frames have x right, y down and z along the line
of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser

from mffdrake.systems.arms.arm import ArmModel
from mffdrake.systems.arms.models import ConfigureParser
from mffdrake.systems.cameras.camera_frames import DEFAULT_BASELINE, DEFAULT_P_EC, AddCameraFrames

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pydrake.math import RotationMatrix
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

__all__ = [
    "ARM_NAME",
    "DEFAULT_BASELINE",
    "DEFAULT_P_EC",
    "JOINT_NAMES",
    "NOMINAL_POSITIONS",
    "NUM_JOINTS",
    "AddCameraFrames",
    "AddPa10",
    "MakePa10Plant",
]

JOINT_NAMES: tuple[str, ...] = ("S1", "S2", "S3", "E1", "E2", "W1", "W2")
"""The arm's joints, base to tip: the order of its positions, velocities and actuators."""

NUM_JOINTS: int = 7
"""The number of joints."""

NOMINAL_POSITIONS: NDArray[np.float64] = np.radians(ArmModel().nominal_deg)
"""Joint angles [rad], elbow up, that put the hand at the paper's first hand pose, Eq. (29): a
read-only array of shape (7,)."""
NOMINAL_POSITIONS.flags.writeable = False

ARM_NAME = "pa10"
"""Name of the arm's model instance."""


def AddPa10(plant: MultibodyPlant, *, X_WB: RigidTransform | None = None) -> ModelInstanceIndex:
    """Adds the PA-10 arm to a plant and welds its base to the world.

    Where the plant belongs to a SceneGraph, the arm's shapes and collision filters come along.

    Args:
        plant: The plant to add the arm to, not finalized yet.
        X_WB: Pose of the arm's base link in the world (translation in m); the identity by default.

    Returns:
        The index of the arm's model instance, named ``pa10``. It has seven joints named as in
        ``JOINT_NAMES``, an actuator of the same name for each, and the massless body ``hand``,
        whose frame is E.

    Raises:
        RuntimeError: If the plant is finalized already, or already holds a model named ``pa10``.
        FileNotFoundError: If the package's models cannot be found.

    Example:
        >>> from pydrake.multibody.plant import MultibodyPlant
        >>> from mffdrake.systems.arms.pa10 import AddPa10
        >>> plant = MultibodyPlant(time_step=0.0)
        >>> arm = AddPa10(plant)
        >>> plant.Finalize()
        >>> plant.num_positions(arm)
        7
    """
    if plant.is_finalized():
        raise RuntimeError(
            "AddPa10: the plant is finalized already. Add the arm before plant.Finalize()."
        )
    if plant.HasModelInstanceNamed(ARM_NAME):
        raise RuntimeError(
            f"AddPa10: the plant already holds a model named '{ARM_NAME}'. "
            "Use one plant for each arm."
        )
    parser = Parser(plant)
    ConfigureParser(parser)
    arm: ModelInstanceIndex = parser.AddModelsFromUrl("package://mffdrake/pa10.urdf")[0]
    plant.WeldFrames(
        frame_on_parent_F=plant.world_frame(),
        frame_on_child_M=plant.GetFrameByName("base_link", arm),
        X_FM=RigidTransform() if X_WB is None else X_WB,
    )
    return arm


def MakePa10Plant(
    time_step: float = 0.0,
    *,
    p_EC: Sequence[float] | NDArray[np.float64] = DEFAULT_P_EC,
    R_EC: RotationMatrix | None = None,
    baseline: float = DEFAULT_BASELINE,
) -> MultibodyPlant:
    """Makes a finalized plant with nothing but the arm: the model inside a controller or predictor.

    The base is at the world's origin, gravity is Drake's default (9.81 m/s², down), and there is no
    geometry.

    Args:
        time_step: The plant's time step [s]; 0 makes a continuous plant. Kinematics and dynamics
            terms do not depend on it.
        p_EC: Position of the right camera in the hand frame [m], shape (3,).
        R_EC: Orientation of both cameras in the hand frame; the identity by default.
        baseline: Distance from the right to the left camera [m], positive.

    Returns:
        The plant: 7 positions, 7 velocities, 7 actuators in the order of ``JOINT_NAMES``, and the
        frames ``hand``, ``camera_right`` and ``camera_left``.

    Raises:
        ValueError: If ``time_step`` is negative, or if ``p_EC`` or ``baseline`` is invalid; see
            :func:`AddCameraFrames`.
        FileNotFoundError: If the package's models cannot be found.

    Example:
        >>> from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
        >>> plant = MakePa10Plant()
        >>> context = plant.CreateDefaultContext()
        >>> plant.SetPositions(context, NOMINAL_POSITIONS)
        >>> X_WE = plant.GetFrameByName("hand").CalcPoseInWorld(context)
        >>> print((1000 * X_WE.translation()).round(2) + 0.0)
        [918.01   0.   454.71]
    """
    plant = ArmModel().MakePlant(time_step)
    AddCameraFrames(plant, p_EC=p_EC, R_EC=R_EC, baseline=baseline)
    plant.Finalize()
    return plant
