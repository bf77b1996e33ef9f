"""Normal noise of a sensor."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import NonNegative, parameters
from mffdrake.systems.disturbances.image_disturbance import Image, PixelDisturbance

__all__ = ["GaussianNoise"]


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
