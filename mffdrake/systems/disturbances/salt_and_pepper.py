"""Pixels that fail."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import Share, parameters
from mffdrake.systems.disturbances.image_disturbance import Image, PixelDisturbance

__all__ = ["SaltAndPepper"]


@parameters
class SaltAndPepper(PixelDisturbance):
    """Makes some pixels white or black, other ones in every image.

    Attributes:
        share: Probability of each pixel to be one of them; one half of them are white.

    Example:
        >>> SaltAndPepper().share
        0.02
    """

    share: Share = 0.02

    def Disturb(self, colors: Image, *, time: float, rng: np.random.Generator) -> Image:
        """Paints the pixels, see `PixelDisturbance.Disturb`."""
        fate = rng.random(colors.shape[:2], dtype=np.float32)
        disturbed = colors.copy()
        disturbed[fate < self.share] = 255
        disturbed[fate < 0.5 * self.share] = 0
        return disturbed
