"""Poses as scenarios have them, with the keys and tags of Drake's schema::Transform."""

from __future__ import annotations

import dataclasses as dc
from typing import Annotated

from pydrake.math import RigidTransform, RotationMatrix

from mffdrake.recognition.parameters import OneOf, Position, parameters
from mffdrake.recognition.parameters.rotations import AngleAxisDeg, Identity, RpyDeg

__all__ = ["Pose"]


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

    translation: Position = (0.0, 0.0, 0.0)
    rotation: Annotated[Identity | RpyDeg | AngleAxisDeg, OneOf()] = dc.field(
        default_factory=Identity
    )

    def GetDeterministicValue(self) -> RigidTransform:
        """The pose (translation in m)."""
        return RigidTransform(RotationMatrix(self.rotation.CalcMatrix()), self.translation)
