"""From one pose to another at once."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import NonNegative, Vector3, parameters
from mffdrake.systems.target_motion.target_motion import Offset, OffsetMotion

__all__ = ["Step"]


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

    translation: Vector3 = (0.0, 0.1, 0.0)
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    time: NonNegative = 1.0

    def CalcOffset(self, time: float) -> Offset:
        """See `OffsetMotion.CalcOffset`."""
        # A clock's rounding must not delay it by a frame.
        share = 1.0 if time >= self.time - 1e-9 else 0.0
        return share * np.array(self.translation), share * np.radians(self.rotation_deg)
