"""Images that are black for a while."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import NonNegative, Positive, parameters
from mffdrake.systems.disturbances.image_disturbance import Image, PixelDisturbance

__all__ = ["Black"]


@parameters
class Black(PixelDisturbance):
    """Makes images black, as with a covered lens.

    Attributes:
        starts: When the images become black [s].
        duration: For how long each time [s]; an image just at the end is no longer black.

    Example:
        >>> Black(starts=[1.0, 2.5], duration=0.2)
        Black(cameras=None, starts=(1.0, 2.5), duration=0.2)
    """

    starts: tuple[NonNegative, ...] = (1.0,)
    duration: Positive = 0.2

    def Disturb(self, colors: Image, *, time: float, rng: np.random.Generator) -> Image:
        """Blackens, see `PixelDisturbance.Disturb`."""
        # A rounding error must not move an image into or out of the interval.
        since = [time - start + 1e-9 for start in self.starts]
        is_black = any(0.0 <= s < self.duration for s in since)
        return np.zeros_like(colors) if is_black else colors
