"""Noise of the sensor, and pixels that fail."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import NonNegative, Share, parameters
from mffdrake.systems.disturbances.image_disturbance import Image, PixelDisturbance

__all__ = ["GaussianNoise", "SaltAndPepper"]


@parameters
class GaussianNoise(PixelDisturbance):
    """Adds independent normal errors to red, green and blue of every pixel.

    Grey levels are rounded, and those below 0 or above 255 become 0 or 255.

    Attributes:
        deviation: Standard deviation of an error in grey levels (0-255).

    Example:
        >>> GaussianNoise(deviation=5.0)
        GaussianNoise(cameras=None, deviation=5.0)
    """

    deviation: NonNegative = 10.0

    def Disturb(self, colors: Image, *, time: float, rng: np.random.Generator) -> Image:
        """Adds the noise, see `PixelDisturbance.Disturb`."""
        errors = np.float32(self.deviation) * rng.standard_normal(colors.shape, dtype=np.float32)
        return np.clip(np.rint(colors + errors), 0.0, 255.0).astype(np.uint8)


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
