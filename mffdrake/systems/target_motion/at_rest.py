"""No motion."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import parameters
from mffdrake.systems.target_motion.target_motion import Offset, OffsetMotion

__all__ = ["AtRest"]


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
