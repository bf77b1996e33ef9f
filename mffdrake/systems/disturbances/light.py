"""Light whose strength or color swings."""

from __future__ import annotations

import math

import numpy as np

from mffdrake.recognition.parameters import Duration, Finite, NonNegative, parameters
from mffdrake.systems.disturbances.image_disturbance import Image, PixelDisturbance

__all__ = ["Amplify", "Brightness", "CalcSwing", "ColorTemperature"]


def CalcSwing(time: float, *, offset: float, amplitude: float, period: float) -> float:
    """A sine about an offset.

    Example:
        >>> CalcSwing(0.25, offset=0.1, amplitude=0.5, period=1.0)
        0.6
    """
    return offset + amplitude * math.sin(2.0 * math.pi * time / period)


def Amplify(levels: Image, gain: float) -> Image:
    """Grey levels times a gain, rounded, and no more than white.

    Example:
        >>> Amplify(np.array([100, 200], dtype=np.uint8), 1.5).tolist()
        [150, 255]
    """
    table = np.minimum(np.rint(gain * np.arange(256)), 255.0).astype(np.uint8)
    return table[levels]


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
    period: Duration = 5.0

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


@parameters
class ColorTemperature(PixelDisturbance):
    """Multiplies red by ``1 + s`` and blue by ``1 - s``, where s swings over time.

    It is ``s = offset + amplitude sin(2 pi t / period)``: above 0 the light is warm, below it is
    cold. Green is unchanged; levels above 255 become 255.

    Attributes:
        offset: The mean of s.
        amplitude: How far it swings from the mean.
        period: Of the swing [s].

    Raises:
        ValueError: When a gain would fall below 0.

    Example:
        >>> ColorTemperature(offset=0.2, amplitude=0.0)     # always warm
        ColorTemperature(cameras=None, offset=0.2, amplitude=0.0, period=5.0)
    """

    offset: Finite = 0.0
    amplitude: NonNegative = 0.3
    period: Duration = 5.0

    def __post_init__(self) -> None:
        """Checks the least gains."""
        if abs(self.offset) + self.amplitude > 1.0:
            raise ValueError(
                f"amplitude must be at most 1 - |offset|, which is {1.0 - abs(self.offset):g}, so "
                f"that both gains stay at or above 0, not {self.amplitude:g}"
            )

    def Disturb(self, colors: Image, *, time: float, rng: np.random.Generator) -> Image:
        """Applies the gains, see `PixelDisturbance.Disturb`."""
        swing = CalcSwing(time, offset=self.offset, amplitude=self.amplitude, period=self.period)
        disturbed = colors.copy()
        disturbed[..., 0] = Amplify(colors[..., 0], 1.0 + swing)
        disturbed[..., 2] = Amplify(colors[..., 2], 1.0 - swing)
        return disturbed
