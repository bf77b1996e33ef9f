"""Poses as scenarios have them, with the keys and tags of Drake's schema::Transform."""

from __future__ import annotations

import dataclasses as dc
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydrake.common.schema import Rotation
from pydrake.math import RigidTransform, RotationMatrix

from mffdrake.recognition.parameters import Finite, OneOf, Vector3, parameters

__all__ = ["AngleAxisDeg", "Identity", "Pose", "RpyDeg"]


@parameters
class Identity:
    """No rotation."""

    def CalcMatrix(self) -> NDArray[np.float64]:
        """The rotation matrix, shape (3, 3)."""
        return np.eye(3)


@parameters
class RpyDeg:
    """Roll, pitch and yaw.

    Attributes:
        deg: The three angles [deg].
    """

    kind: ClassVar[str] = "rpy"

    deg: Vector3

    def CalcMatrix(self) -> NDArray[np.float64]:
        """The rotation matrix, shape (3, 3)."""
        rotation = Rotation(value=Rotation.Rpy(deg=self.deg))
        return rotation.GetDeterministicValue().matrix()


@parameters
class AngleAxisDeg:
    """A rotation about an axis.

    Attributes:
        angle_deg: The angle [deg].
        axis: The axis, of any length but zero.
    """

    kind: ClassVar[str] = "angle_axis"

    angle_deg: Finite
    axis: Vector3

    def __post_init__(self) -> None:
        """Checks the axis."""
        if not any(self.axis):
            raise ValueError("axis must not be zero")

    def CalcMatrix(self) -> NDArray[np.float64]:
        """The rotation matrix, shape (3, 3)."""
        value = Rotation.AngleAxis(angle_deg=self.angle_deg, axis=self.axis)
        return Rotation(value=value).GetDeterministicValue().matrix()


@parameters
class Pose:
    """A pose in a frame that the context tells.

    Attributes:
        translation: Its position [m].
        rotation: ``!Rpy {deg: [roll, pitch, yaw]}``, ``!AngleAxis {angle_deg: a, axis: [x, y, z]}``
            or ``identity``.

    Example:
        >>> Pose(translation=[0, 0, 0.1]).GetDeterministicValue().translation()
        array([0. , 0. , 0.1])
    """

    translation: Vector3 = (0.0, 0.0, 0.0)
    rotation: Annotated[Identity | RpyDeg | AngleAxisDeg, OneOf()] = dc.field(
        default_factory=Identity
    )

    def GetDeterministicValue(self) -> RigidTransform:
        """The pose (translation in m)."""
        return RigidTransform(RotationMatrix(self.rotation.CalcMatrix()), self.translation)
