"""Compiled search for blobs of the solid's colors in images (numba). Import only where it runs.

A blob is a connected patch of pixels, of any of the solid's colors or of one of them, on every
few pixels of an image. It is measured as seen along its own direction: on the plane at distance 1
that the line of sight through its center meets at a right angle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.acquisition.appearance import (
    Colors,
    Moments,
    add_patch,
    new_appearances,
    normalize,
)
from mffdrake.recognition.camera.lens import NO_DISTORTION, Lens, View, pixel, pixel_jacobian
from mffdrake.recognition.fitness.structs import ColorGate, look_up
from mffdrake.recognition.poses.rotations import rotated

Array = NDArray[np.float64]
Labels = NDArray[np.int8]
Blobs = NDArray[np.void]
Places = NDArray[np.int32]
IntArray = NDArray[np.int64]

BLOB = np.dtype(
    [
        ("camera", np.int64),
        ("color", np.int64),  # which of the solid's, or -1 for any
        ("area", np.float64),  # at distance 1
        ("x", np.float64),  # its center's direction, in normalized coordinates
        ("y", np.float64),
        ("clipped", np.bool_),  # whether it meets the image's border, or the lens's
    ]
)
"""A blob; how it looks stands beside it, see `find_blobs`."""


class Grid(NamedTuple):
    """The pixels of an image that are looked at: every ``step``-th one of every ``step``-th row.

    Attributes:
        step: How far apart they are [px].
        x: Their normalized coordinates, shape (height, width) of the grid; NaN beyond the lens.
        y: The same.
        area: What each stands for, on the plane of normalized coordinates.
    """

    step: int
    x: Array
    y: Array
    area: Array


@njit(cache=True, error_model="numpy")
def make_grid(lens: Lens, width: int, height: int, step: int) -> tuple[int, Array, Array, Array]:
    """The fields of a camera's `Grid`."""
    h, w = height // step, width // step
    x, y, area = np.empty((h, w)), np.empty((h, w)), np.empty((h, w))
    for j in range(h):
        for i in range(w):
            u, v = i * step + step // 2, j * step + step // 2
            a, b = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
            if lens.model != NO_DISTORTION:
                for _ in range(30):  # Newton's steps
                    pu, pv = pixel(lens, a, b)
                    ux, uy, vx, vy = pixel_jacobian(lens, a, b)
                    det = ux * vy - uy * vx
                    a += (vy * (u - pu) - uy * (v - pv)) / det
                    b += (ux * (v - pv) - vx * (u - pu)) / det
                pu, pv = pixel(lens, a, b)
                if not (
                    abs(u - pu) + abs(v - pv) < 0.1 and a * a + b * b <= lens.max_radius_squared
                ):
                    a, b = np.nan, np.nan
            ux, uy, vx, vy = pixel_jacobian(lens, a, b)
            x[j, i], y[j, i], area[j, i] = a, b, step * step / abs(ux * vy - uy * vx)
    return step, x, y, area


@njit(cache=True, error_model="numpy")
def label_pixels(view: View, grid: Grid, gate: ColorGate, classes: NDArray[np.int8]) -> Labels:
    """Which of the solid's colors the pixels of a grid show, -1 for none.

    ``classes`` has the number of the color of each bit, -1 where it is none of the solid's.
    """
    h, w = grid.x.shape
    labels = np.empty((h, w), dtype=np.int8)
    pixels, places, table = view.pixels, gate.places, gate.table
    first = grid.step // 2
    for j in range(h):
        row = (j * grid.step + first) * view.eye.width + first
        for i in range(w):
            k = row + i * grid.step
            shown = look_up(places, table, pixels[k, 0], pixels[k, 1], pixels[k, 2])
            label = np.int8(-1)
            if shown != 0 and grid.x[j, i] == grid.x[j, i]:
                for bit in range(len(classes)):
                    if (shown >> np.uint32(bit)) & np.uint32(1) and classes[bit] >= 0:
                        label = classes[bit]
                        break
            labels[j, i] = label
    return labels


@njit(cache=True, error_model="numpy")
def _flood(labels: Labels, of_one_color: bool, least: int) -> tuple[Places, IntArray]:
    """The connected patches (8 neighbors) of at least so many pixels.

    Returns the pixels, one patch after the other, shape (n, 2), and where each patch ends.
    """
    h, w = labels.shape
    reached = np.zeros((h, w), dtype=np.bool_)
    places = np.empty((h * w, 2), dtype=np.int32)
    ends = np.empty(h * w // max(1, least), dtype=np.int64)
    count, first = 0, 0
    for j in range(h):
        for i in range(w):
            if labels[j, i] < 0 or reached[j, i]:
                continue
            reached[j, i] = True
            places[first, 0], places[first, 1] = j, i
            taken, last = first, first + 1
            while taken < last:
                y, x = places[taken, 0], places[taken, 1]
                taken += 1
                for v in range(max(0, y - 1), min(h, y + 2)):
                    for u in range(max(0, x - 1), min(w, x + 2)):
                        if labels[v, u] < 0 or reached[v, u]:
                            continue
                        if of_one_color and labels[v, u] != labels[y, x]:
                            continue
                        reached[v, u] = True
                        places[last, 0], places[last, 1] = v, u
                        last += 1
            if last - first >= least:
                ends[count] = last
                first, count = last, count + 1
    return places[:first], ends[:count]


@njit(cache=True, error_model="numpy")
def turn_along(x: float, y: float, axes: Array) -> None:
    """Fills in a frame whose z is the direction (x, y, 1), turned to it from z the short way."""
    norm = math.sqrt(x * x + y * y + 1.0)
    a, b, c = x / norm, y / norm, 1.0 / norm
    k = 1.0 / (1.0 + c)
    axes[0, 0], axes[0, 1], axes[0, 2] = 1.0 - k * a * a, -k * a * b, -a
    axes[1, 0], axes[1, 1], axes[1, 2] = -k * a * b, 1.0 - k * b * b, -b
    axes[2, 0], axes[2, 1], axes[2, 2] = a, b, c


@njit(cache=True, error_model="numpy")
def find_blobs(
    labels: Labels, grid: Grid, camera: int, num_colors: int, of_one_color: bool, least: int
) -> tuple[Blobs, Colors, Moments]:
    """The blobs in the labels of one view, of at least so many pixels of its grid.

    Returns the blobs, shape (B,), and the fields of their `Appearances` along their directions.
    """
    h, w = labels.shape
    places, ends = _flood(labels, of_one_color, least)
    count, first = len(ends), 0
    blobs, appearances = np.zeros(count, dtype=BLOB), new_appearances(count, num_colors)
    axes = np.empty((3, 3))
    for n in range(count):
        blob = blobs[n]
        color = labels[places[first, 0], places[first, 1]]
        blob.camera, blob.color = camera, color if of_one_color else -1
        total = 0.0
        for k in range(first, ends[n]):
            j, i = places[k]
            total += grid.area[j, i]
            blob.x += grid.area[j, i] * grid.x[j, i]
            blob.y += grid.area[j, i] * grid.y[j, i]
            if j == 0 or i == 0 or j == h - 1 or i == w - 1:
                blob.clipped = True
            else:  # beyond the lens there are NaN
                around = grid.x[j - 1, i] + grid.x[j + 1, i] + grid.x[j, i - 1] + grid.x[j, i + 1]
                blob.clipped = blob.clipped or around != around
        blob.x /= total
        blob.y /= total
        turn_along(blob.x, blob.y, axes)
        for k in range(first, ends[n]):
            j, i = places[k]
            x, y = grid.x[j, i], grid.y[j, i]
            p, q, depth = rotated(axes, x, y, 1.0)
            p, q = p / depth, q / depth
            area = grid.area[j, i] / (depth * depth * depth)
            blob.area += area
            add_patch(appearances, n, labels[j, i], area, p, q, 0.0, 0.0, 0.0)
        normalize(appearances, n)
        first = ends[n]
    return blobs, appearances.colors, appearances.moments
