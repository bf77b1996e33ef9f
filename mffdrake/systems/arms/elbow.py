"""The elbow of an arm: the joint whose bend alone sets the distance from shoulder to wrist.

Frames, in Drake's monogram notation: K the elbow's parent frame, S that of the shoulder, the second
moving joint, and H that of the wrist, the third joint from the tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydrake.multibody.tree import RevoluteJoint

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pydrake.multibody.tree import Frame, Joint
    from pydrake.systems.framework import Context

__all__ = ["Elbow"]

_LEAST_AREA = 1e-3  # [m^2] of shoulder, elbow and wrist; with less of it the arm is straight.


@dataclass(frozen=True, kw_only=True)
class Elbow:
    """The elbow, with the side to which it was bent when it was found."""

    joint: RevoluteJoint
    shoulder: Frame
    wrist: Frame
    side: float = 0.0

    @classmethod
    def Find(cls, joints: Sequence[Joint], context: Context) -> Elbow | None:
        """The joint of a chain that changes most the distance from shoulder to wrist.

        Args:
            joints: The moving joints, six or more, base to tip.
            context: The plant's context in a posture with the elbow bent.

        Returns:
            The elbow; None for an arm that is straight or has no joint there that turns.
        """
        shoulder, wrist = joints[1].frame_on_child(), joints[-3].frame_on_child()
        found = [
            cls(joint=joint, shoulder=shoulder, wrist=wrist)
            for joint in joints[2:-3]
            if isinstance(joint, RevoluteJoint)
        ]
        areas = [elbow._CalcAreas(context)[0] for elbow in found]
        i = int(np.argmax(np.abs(areas))) if areas else 0
        if not areas or abs(areas[i]) < _LEAST_AREA:
            return None
        side = math.copysign(1.0, areas[i])
        return cls(joint=found[i].joint, shoulder=shoulder, wrist=wrist, side=side)

    @property
    def name(self) -> str:
        """The joint's name."""
        return self.joint.name()

    def CalcBend(self, context: Context) -> float:
        """Angle [rad] about the joint's axis from upper arm to forearm: 0 where it is stretched."""
        return math.atan2(*self._CalcAreas(context))

    def IsBentAsFound(self, context: Context) -> bool:
        """Whether the elbow is bent to the side to which it was when it was found."""
        return self.side * self.CalcBend(context) > 0.0

    def _CalcAreas(self, context: Context) -> tuple[float, float]:
        """Sine and cosine of the bend, times the lengths of upper arm and forearm [m^2].

        The sine's is also the derivative of half the squared distance by the joint's angle.
        """
        frame_K = self.joint.frame_on_parent()
        axis = self.joint.revolute_axis()
        upper_arm = -self.shoulder.CalcPose(context, frame_K).translation()
        forearm = self.wrist.CalcPose(context, frame_K).translation()
        across = upper_arm @ forearm - (upper_arm @ axis) * (forearm @ axis)
        return float(axis @ np.cross(upper_arm, forearm)), float(across)
