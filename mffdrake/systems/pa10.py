"""The hand-eye arm: a Mitsubishi PA-10 with a stereo camera's frames on its hand.

Frames, in Drake's monogram notation: W world (z up, x forward), B the arm's base, E the hand, C the
right camera and L the left camera. Hand and camera frames have x right, y down and z along the line
of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame

from mffdrake.systems.models import ConfigureParser

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pydrake.multibody.tree import Frame, ModelInstanceIndex

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

NOMINAL_POSITIONS: NDArray[np.float64] = np.radians([0.0, 30.0, 0.0, 90.0, 0.0, -30.0, 0.0])
"""Joint angles [rad], elbow up, that put the hand at the paper's first hand pose, Eq. (29): a
read-only array of shape (7,)."""
NOMINAL_POSITIONS.flags.writeable = False

DEFAULT_P_EC: tuple[float, float, float] = (0.0, -0.155, 0.0)
"""Position of the right camera C in the hand frame E [m]: 155 mm above the hand's axis."""

DEFAULT_BASELINE: float = 0.150
"""Distance from the right to the left camera [m]."""

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
        >>> from mffdrake.systems.pa10 import AddPa10
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


def AddCameraFrames(
    plant: MultibodyPlant,
    *,
    p_EC: Sequence[float] | NDArray[np.float64] = DEFAULT_P_EC,
    R_EC: RotationMatrix | None = None,
    baseline: float = DEFAULT_BASELINE,
) -> tuple[Frame, Frame]:
    """Adds the frames of the stereo camera to the arm's hand.

    Both cameras look along the hand's z axis, with their axes parallel to the hand's, unless they
    are mounted askew. The right camera C is the reference frame of the recognition; the left camera
    L is to its left, at ``p_CL = (-baseline, 0, 0)``.

    Args:
        plant: A plant that holds the arm (see :func:`AddPa10`) and is not finalized yet.
        p_EC: Position of the right camera in the hand frame [m], shape (3,).
        R_EC: Orientation of both cameras in the hand frame; the identity by default.
        baseline: Distance from the right to the left camera [m], positive.

    Returns:
        The frames ``camera_right`` (C) and ``camera_left`` (L), both fixed to the body ``hand``.

    Raises:
        RuntimeError: If the plant is finalized already, holds no arm, or has the frames already.
        ValueError: If ``p_EC`` is not three finite numbers, or ``baseline`` is not positive and
            finite.

    Example:
        >>> from pydrake.multibody.plant import MultibodyPlant
        >>> from mffdrake.systems.pa10 import AddCameraFrames, AddPa10
        >>> plant = MultibodyPlant(time_step=0.0)
        >>> _ = AddPa10(plant)
        >>> frame_C, frame_L = AddCameraFrames(plant, baseline=0.120)
        >>> frame_C.name(), frame_L.name()
        ('camera_right', 'camera_left')
    """
    p_EC = np.asarray(p_EC, dtype=float)
    if p_EC.shape != (3,) or not np.all(np.isfinite(p_EC)):
        raise ValueError(f"AddCameraFrames: p_EC must be three finite numbers [m], not {p_EC}.")
    if not (np.isfinite(baseline) and baseline > 0.0):
        raise ValueError(
            f"AddCameraFrames: baseline must be a positive distance [m], not {baseline}: "
            "the left camera is to the left of the right one."
        )
    if plant.is_finalized():
        raise RuntimeError(
            "AddCameraFrames: the plant is finalized already. "
            "Add the camera frames before plant.Finalize()."
        )
    if not plant.HasModelInstanceNamed(ARM_NAME):
        raise RuntimeError(
            f"AddCameraFrames: the plant holds no model named '{ARM_NAME}'. Call AddPa10 first."
        )
    arm = plant.GetModelInstanceByName(ARM_NAME)
    if plant.HasFrameNamed("camera_right", arm) or plant.HasFrameNamed("camera_left", arm):
        raise RuntimeError("AddCameraFrames: the arm has its camera frames already.")
    frame_C = plant.AddFrame(
        FixedOffsetFrame(
            name="camera_right",
            P=plant.GetFrameByName("hand", arm),
            X_PF=RigidTransform(RotationMatrix() if R_EC is None else R_EC, p_EC),
        )
    )
    frame_L = plant.AddFrame(
        FixedOffsetFrame(
            name="camera_left",
            P=frame_C,
            X_PF=RigidTransform([-baseline, 0.0, 0.0]),
        )
    )
    return frame_C, frame_L


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
        >>> from mffdrake.systems.pa10 import NOMINAL_POSITIONS, MakePa10Plant
        >>> plant = MakePa10Plant()
        >>> context = plant.CreateDefaultContext()
        >>> plant.SetPositions(context, NOMINAL_POSITIONS)
        >>> X_WE = plant.GetFrameByName("hand").CalcPoseInWorld(context)
        >>> print((1000 * X_WE.translation()).round(2) + 0.0)
        [918.01   0.   454.71]
    """
    if not (np.isfinite(time_step) and time_step >= 0.0):  # Drake would abort the process.
        raise ValueError(
            f"MakePa10Plant: time_step must be 0 (continuous) or positive [s], not {time_step}."
        )
    plant = MultibodyPlant(time_step=time_step)
    AddPa10(plant)
    AddCameraFrames(plant, p_EC=p_EC, R_EC=R_EC, baseline=baseline)
    plant.Finalize()
    return plant
