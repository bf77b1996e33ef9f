"""Gains that swing over time, and what they make of grey levels."""

from __future__ import annotations

import math

import numpy as np

from mffdrake.systems.disturbances.image_disturbance import Image

__all__ = ["Amplify", "CalcSwing"]


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
