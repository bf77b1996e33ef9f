"""Light or exposure that changes."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import Finite, NonNegative, Positive, parameters
from mffdrake.systems.disturbances.gains import Amplify, CalcSwing
from mffdrake.systems.disturbances.image_disturbance import Image, PixelDisturbance

__all__ = ["Brightness"]


@parameters
class Brightness(PixelDisturbance):
    """Multiplies grey levels by a gain, ``1 + offset + amplitude sin(2 pi t / period)``.

    Levels above 255 become 255: there colors lose their hue, as in an overexposed image.

    Attributes:
        offset: The gain's mean, less 1.
        amplitude: How far it swings from the mean.
        period: Of the swing [s].

    Raises:
        ValueError: When the gain would fall below 0.

    Example:
        >>> Brightness(offset=-0.3, amplitude=0.0)     # always at 70 %
        Brightness(cameras=None, offset=-0.3, amplitude=0.0, period=5.0)
    """

    offset: Finite = 0.0
    amplitude: NonNegative = 0.5
    period: Positive = 5.0

    def __post_init__(self) -> None:
        """Checks the least gain."""
        if 1.0 + self.offset - self.amplitude < 0.0:
            raise ValueError(
                f"amplitude must be at most 1 + offset, which is {1.0 + self.offset:g}, so that "
                f"the gain stays at or above 0, not {self.amplitude:g}"
            )

    def Disturb(self, colors: Image, *, time: float, rng: np.random.Generator) -> Image:
        """Applies the gain, see `PixelDisturbance.Disturb`."""
        swing = CalcSwing(time, offset=self.offset, amplitude=self.amplitude, period=self.period)
        return Amplify(colors, 1.0 + swing)
