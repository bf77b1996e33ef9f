"""Rotations as YAML files have them, with the keys and tags of Drake's schema::Rotation.

The matrices are Drake's to the last bit, so that a rig's file and a scenario tell the same pose.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.parameters import Finite, Vector3, parameters

__all__ = ["AngleAxisDeg", "Identity", "RpyDeg"]

Array = NDArray[np.float64]

_DEG = math.pi / 180.0
_SHORTEST = 1e-9  # of an axis


@parameters
class Identity:
    """No rotation."""

    def CalcMatrix(self) -> Array:
        """The rotation matrix, shape (3, 3)."""
        return np.eye(3)


@parameters
class RpyDeg:
    """Roll, pitch and yaw.

    Attributes:
        deg: The three angles [deg]: about the fixed axes x, y and z, one after the other.

    Example:
        >>> RpyDeg(deg=(0.0, 0.0, 90.0)).CalcMatrix().round(6)[0]
        array([ 0., -1.,  0.])
    """

    kind: ClassVar[str] = "rpy"

    deg: Vector3

    def CalcMatrix(self) -> Array:
        """The rotation matrix, shape (3, 3)."""
        roll, pitch, yaw = (angle * _DEG for angle in self.deg)
        s0, c0 = math.sin(roll), math.cos(roll)
        s1, c1 = math.sin(pitch), math.cos(pitch)
        s2, c2 = math.sin(yaw), math.cos(yaw)
        c2_s1, s2_s1 = c2 * s1, s2 * s1
        return np.array(
            [
                [c2 * c1, c2_s1 * s0 - s2 * c0, c2_s1 * c0 + s2 * s0],
                [s2 * c1, s2_s1 * s0 + c2 * c0, s2_s1 * c0 - c2 * s0],
                [-s1, c1 * s0, c1 * c0],
            ]
        )


@parameters
class AngleAxisDeg:
    """A rotation about an axis.

    Attributes:
        angle_deg: The angle [deg].
        axis: The axis, of any length but zero.

    Example:
        >>> AngleAxisDeg(angle_deg=90.0, axis=(0.0, 0.0, 2.0)).CalcMatrix().round(6)[0]
        array([ 0., -1.,  0.])
    """

    kind: ClassVar[str] = "angle_axis"

    angle_deg: Finite
    axis: Vector3

    def __post_init__(self) -> None:
        """Checks the axis."""
        if math.hypot(*self.axis) < _SHORTEST:
            raise ValueError(f"axis must not be zero, nor shorter than {_SHORTEST:g}")

    def CalcMatrix(self) -> Array:
        """The rotation matrix, shape (3, 3)."""
        x, y, z = self.axis
        # Drake divides by the norm twice, and adds its squares in another order each time.
        norm = math.sqrt((x * x + y * y) + z * z)
        x, y, z = x / norm, y / norm, z / norm
        norm = math.sqrt(x * x + (y * y + z * z))
        x, y, z = x / norm, y / norm, z / norm
        s, c = math.sin(self.angle_deg * _DEG), math.cos(self.angle_deg * _DEG)
        vx, vy = (1.0 - c) * x, (1.0 - c) * y
        return np.array(
            [
                [vx * x + c, vx * y - s * z, vx * z + s * y],
                [vx * y + s * z, vy * y + c, vy * z - s * x],
                [vx * z - s * y, vy * z + s * x, (1.0 - c) * z * z + c],
            ]
        )
