"""What all motions of a target have in common."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from mffdrake.recognition.parameters import parameters

__all__ = ["Array", "Offset", "OffsetMotion", "TargetMotion"]

Array = NDArray[np.float64]
Offset = tuple[Array, Array]
"""A translation [m] and a rotation vector [rad], each of shape (3,), along the world's axes."""

_STEP = 1e-4  # [s] Half the time over which velocities are measured


@parameters
class TargetMotion:
    """How a target moves."""

    @abstractmethod
    def CalcPose(self, X_WM0: RigidTransform, time: float) -> RigidTransform:
        """The target's pose X_WM.

        Args:
            X_WM0: The pose that the motion is told from.
            time: Time [s].
        """

    def CalcVelocity(self, X_WM0: RigidTransform, time: float) -> Array:
        """The target's velocity (v_WM, w_WM) [m/s, rad/s], shape (6,), by differences.

        Args:
            X_WM0: The pose that the motion is told from.
            time: Time [s]. At a step or a corner, it is the mean of before and after.
        """
        before, after = (self.CalcPose(X_WM0, time + d) for d in (-_STEP, _STEP))
        turn = (after.rotation() @ before.rotation().inverse()).ToAngleAxis()
        moved = np.concatenate(
            [after.translation() - before.translation(), turn.angle() * turn.axis()]
        )
        return np.asarray(moved / (2.0 * _STEP))


@parameters
class OffsetMotion(TargetMotion):
    """A motion that is told as how far the target is from its pose X_WM0.

    Its origin is shifted, and it turns about its origin, both along the world's axes.
    """

    @abstractmethod
    def CalcOffset(self, time: float) -> Offset:
        """How far the target has moved and turned from X_WM0.

        Args:
            time: Time [s].
        """

    def CalcPose(self, X_WM0: RigidTransform, time: float) -> RigidTransform:
        """The target's pose, see `TargetMotion.CalcPose`.

        Example:
            >>> from mffdrake.systems.target_motion import Step
            >>> Step(translation=(0.1, 0, 0)).CalcPose(RigidTransform(), 2.0).translation()
            array([0.1, 0. , 0. ])
        """
        shift, turn = self.CalcOffset(time)
        angle = float(np.linalg.norm(turn))
        R = X_WM0.rotation()
        if angle > 0.0:
            R = RotationMatrix(AngleAxis(angle=angle, axis=turn / angle)) @ R
        return RigidTransform(R, X_WM0.translation() + shift)
