"""Compiled resampling of images (numba). Import only where it runs: numba loads slowly."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["FINENESS", "resample"]

FINENESS = 4
"""Lines of sight a pixel, along u as along v."""

_SHARE = 1.0 / FINENESS
_NUM_SIGHTS = FINENESS * FINENESS


@njit(cache=True, error_model="numpy")
def resample(
    pixels: NDArray[np.uint8], places: NDArray[np.float32], image: NDArray[np.uint8]
) -> None:
    """Draws each pixel as the mean of what the lines of sight through its parts meet.

    Args:
        pixels: The image that is given, shape (H, W, 4).
        places: Where in it the corners of the drawn pixels lie (u, v), shape (h + 1, w + 1, 2);
            NaN where nothing is seen. In between they count as linear.
        image: Receives the drawn image, shape (h, w, 4); black where a corner or a line of sight
            sees nothing.
    """
    height, width = pixels.shape[:2]
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            red, green, blue, alpha, count = 0, 0, 0, 0, 0
            for j in range(FINENESS):
                down = _SHARE * (j + 0.5)
                left_u = places[v, u, 0] + down * (places[v + 1, u, 0] - places[v, u, 0])
                left_v = places[v, u, 1] + down * (places[v + 1, u, 1] - places[v, u, 1])
                right_u = places[v, u + 1, 0] + down * (
                    places[v + 1, u + 1, 0] - places[v, u + 1, 0]
                )
                right_v = places[v, u + 1, 1] + down * (
                    places[v + 1, u + 1, 1] - places[v, u + 1, 1]
                )
                for i in range(FINENESS):
                    across = _SHARE * (i + 0.5)
                    x = left_u + across * (right_u - left_u) + 0.5
                    y = left_v + across * (right_v - left_v) + 0.5
                    if not (0.0 <= x < width and 0.0 <= y < height):  # false for NaN
                        continue
                    color = pixels[int(y), int(x)]
                    red += color[0]
                    green += color[1]
                    blue += color[2]
                    alpha += color[3]
                    count += 1
            if count < _NUM_SIGHTS:
                image[v, u, :3], image[v, u, 3] = 0, 255
                continue
            half = _NUM_SIGHTS // 2  # rounds the means
            image[v, u, 0] = (red + half) // _NUM_SIGHTS
            image[v, u, 1] = (green + half) // _NUM_SIGHTS
            image[v, u, 2] = (blue + half) // _NUM_SIGHTS
            image[v, u, 3] = (alpha + half) // _NUM_SIGHTS
