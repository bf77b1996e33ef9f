"""No motion, a step, and a straight line."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mffdrake.recognition.parameters import Duration, NonNegative, Position, Vector3, parameters
from mffdrake.systems.target_motion.target_motion import Offset, OffsetMotion

__all__ = ["AtRest", "Step", "Straight"]


@parameters
class AtRest(OffsetMotion):
    """The target stays where it is.

    Example:
        >>> AtRest().CalcOffset(3.0)[0]
        array([0., 0., 0.])
    """

    def CalcOffset(self, time: float) -> Offset:
        """Nothing, see `OffsetMotion.CalcOffset`."""
        return np.zeros(3), np.zeros(3)


@parameters
class Step(OffsetMotion):
    """The target is somewhere else from one moment to the next.

    Attributes:
        translation: How far it moves along the world's axes [m].
        rotation_deg: The rotation vector by which it turns, along them [deg].
        time: When [s].

    Example:
        >>> [Step(time=2.0).CalcOffset(t)[0].tolist() for t in (1.9, 2.0)]
        [[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]
    """

    translation: Position = (0.0, 0.1, 0.0)
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    time: NonNegative = 1.0

    def CalcOffset(self, time: float) -> Offset:
        """See `OffsetMotion.CalcOffset`."""
        # A clock's rounding must not delay it by a frame.
        share = 1.0 if time >= self.time - 1e-9 else 0.0
        return share * np.array(self.translation), share * np.radians(self.rotation_deg)


@parameters
class Straight(OffsetMotion):
    """The target moves and turns at constant velocity, then stops or comes back.

    Attributes:
        velocity: Along the world's axes [m/s].
        angular_velocity_deg: About them [deg/s].
        start: When it begins [s].
        duration: For how long it goes on [s]; null for ever.
        then: What follows: "stop", or "reverse": back at the same speed, for as long, and so on.

    Example:
        >>> there = Straight(velocity=(0.1, 0, 0), start=1.0, duration=2.0)
        >>> [round(float(there.CalcOffset(t)[0][0]), 3) for t in (0.5, 2.0, 3.0, 9.0)]
        [0.0, 0.1, 0.2, 0.2]
    """

    velocity: Position = (0.0, 0.05, 0.0)
    angular_velocity_deg: Vector3 = (0.0, 0.0, 0.0)
    start: NonNegative = 0.0
    duration: Duration | None = None
    then: Literal["stop", "reverse"] = "stop"

    def CalcOffset(self, time: float) -> Offset:
        """See `OffsetMotion.CalcOffset`."""
        gone = max(0.0, time - self.start)
        if self.duration is not None:
            if self.then == "stop":
                gone = min(gone, self.duration)
            else:
                gone %= 2.0 * self.duration
                gone = min(gone, 2.0 * self.duration - gone)
        return gone * np.array(self.velocity), gone * np.radians(self.angular_velocity_deg)
