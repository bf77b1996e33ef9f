"""The frames of the cameras on an arm's hand.

Frames, in Drake's monogram notation: E the hand, P any frame of the arm, C the right camera and L
the left camera. Camera frames have x right, y down and z along the line of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import FixedOffsetFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import Frame, ModelInstanceIndex

__all__ = ["DEFAULT_BASELINE", "DEFAULT_P_EC", "AddCameraFrame", "AddCameraFrames"]

DEFAULT_P_EC: tuple[float, float, float] = (0.0, -0.155, 0.0)
"""Position of the right camera C in the hand frame E [m]: 155 mm above the hand's axis."""

DEFAULT_BASELINE: float = 0.150
"""Distance from the right to the left camera [m]."""

_DEFAULT_MODEL = "pa10"


def AddCameraFrame(
    plant: MultibodyPlant, *, name: str, parent: Frame, X_PC: RigidTransform
) -> Frame:
    """Adds the frame of one camera, fixed to any frame of a plant.

    Args:
        plant: A plant that is not finalized yet.
        name: The frame's name, new in the parent's model.
        parent: The frame P that carries the camera, such as an arm's hand.
        X_PC: Pose of the camera in P (translation in m).

    Returns:
        The camera's frame C. It belongs to the parent's model instance.

    Raises:
        RuntimeError: If the plant is finalized already, or the model has a frame of that name.

    Example:
        >>> from pydrake.multibody.plant import MultibodyPlant
        >>> from mffdrake.systems.arms.pa10 import AddPa10
        >>> plant = MultibodyPlant(time_step=0.0)
        >>> hand = plant.GetFrameByName("hand", AddPa10(plant))
        >>> AddCameraFrame(plant, name="third", parent=hand, X_PC=RigidTransform()).name()
        'third'
    """
    if plant.is_finalized():
        raise RuntimeError(
            "AddCameraFrame: the plant is finalized already. "
            "Add the camera frames before plant.Finalize()."
        )
    if plant.HasFrameNamed(name, parent.model_instance()):
        model = plant.GetModelInstanceName(parent.model_instance())
        raise RuntimeError(f"AddCameraFrame: the model '{model}' has a frame '{name}' already.")
    return plant.AddFrame(FixedOffsetFrame(name=name, P=parent, X_PF=X_PC))


def AddCameraFrames(
    plant: MultibodyPlant,
    *,
    p_EC: Sequence[float] | NDArray[np.float64] = DEFAULT_P_EC,
    R_EC: RotationMatrix | None = None,
    baseline: float = DEFAULT_BASELINE,
    model_instance: ModelInstanceIndex | None = None,
    hand_frame: str = "hand",
) -> tuple[Frame, Frame]:
    """Adds the frames of the stereo camera to the arm's hand.

    Both cameras look along the hand's z axis, with their axes parallel to the hand's, unless they
    are mounted askew. The right camera C is the reference frame of the recognition; the left camera
    L is to its left, at ``p_CL = (-baseline, 0, 0)``.

    Args:
        plant: A plant that holds the arm (see `ArmModel`) and is not finalized yet.
        p_EC: Position of the right camera in the hand frame [m], shape (3,).
        R_EC: Orientation of both cameras in the hand frame; the identity by default.
        baseline: Distance from the right to the left camera [m], positive.
        model_instance: The arm; the model named ``pa10`` by default.
        hand_frame: Name of the arm's hand frame E.

    Returns:
        The frames ``camera_right`` (C) and ``camera_left`` (L), both fixed to the hand's body.

    Raises:
        RuntimeError: If the plant is finalized already, holds no arm, or has the frames already.
        ValueError: If ``p_EC`` is not three finite numbers, or ``baseline`` is not positive and
            finite.

    Example:
        >>> from pydrake.multibody.plant import MultibodyPlant
        >>> from mffdrake.systems.arms.pa10 import AddPa10
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
    if model_instance is None:
        if not plant.HasModelInstanceNamed(_DEFAULT_MODEL):
            raise RuntimeError(
                f"AddCameraFrames: the plant holds no model named '{_DEFAULT_MODEL}'. Call AddPa10 "
                "first, or give the arm's model_instance."
            )
        model_instance = plant.GetModelInstanceByName(_DEFAULT_MODEL)
    hand = plant.GetFrameByName(hand_frame, model_instance)
    instance = hand.model_instance()
    if plant.HasFrameNamed("camera_right", instance) or plant.HasFrameNamed(
        "camera_left", instance
    ):
        raise RuntimeError("AddCameraFrames: the arm has its camera frames already.")
    X_EC = RigidTransform(RotationMatrix() if R_EC is None else R_EC, p_EC)
    frame_C = AddCameraFrame(plant, name="camera_right", parent=hand, X_PC=X_EC)
    X_CL = RigidTransform([-baseline, 0.0, 0.0])
    return frame_C, AddCameraFrame(plant, name="camera_left", parent=frame_C, X_PC=X_CL)
