"""Compiled search for color borders along a solid's projected edges (numba; import it late).

`BorderRefiner` says what a border is; here is how it is found. Slots and image coordinates are
those of `_edge_lines`; hues and their tolerance are in sixths of the color circle.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition._edge_lines import FIRST, L0, L1, L2, LAST, ROWS, crossing, rotation
from mffdrake.recognition._kernels import _shows_hue

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Image = NDArray[np.uint8]
Color: TypeAlias = tuple[float, float, float]


@njit(cache=True, error_model="numpy")
def _mean_color(pixels: Image, first: int, second: int) -> Color:
    """Mean of two pixels."""
    p, q = pixels[first], pixels[second]
    return (
        0.5 * (float(p[0]) + float(q[0])),
        0.5 * (float(p[1]) + float(q[1])),
        0.5 * (float(p[2]) + float(q[2])),
    )


@njit(cache=True, error_model="numpy")
def _find_border(
    pixels: Image,
    origin: int,
    stride: int,
    length: int,
    expected: float,
    outward: int,
    window: int,
    blend: int,
    hue: Array,
    other_hue: Array,
    min_contrast: float,
    max_mismatch: float,
    hue_tolerance: float,
    min_saturation: float,
    min_value: float,
) -> tuple[float, float]:
    """Sub-pixel position of a border on a row or column, and how blended it is; NaN for none.

    The row or column is ``pixels[origin + stride * k]`` for k from 0 to length - 1, the border is
    expected at ``expected`` and its inside lies against the direction ``outward`` (1 or -1).
    """
    nothing = (np.nan, 0.0)
    k = math.floor(expected + 0.5)
    # All that can be read must be in the image.
    reach = window + blend + 3
    if k < reach or k + reach >= length:
        return nothing
    # From the expected place to the nearest pixel that shows the hue before one that does not
    steps = 0
    p = pixels[origin + stride * k]
    direction = -outward
    if _shows_hue(p[0], p[1], p[2], hue, hue_tolerance, min_saturation, min_value):
        direction = outward
    while True:
        steps += 1
        if steps > window:
            return nothing
        k += direction
        p = pixels[origin + stride * k]
        shown = _shows_hue(p[0], p[1], p[2], hue, hue_tolerance, min_saturation, min_value)
        if shown and direction != outward:
            break
        if not shown and direction == outward:
            k -= outward
            break
    # The two sides' colors, from beyond where they blend
    step = stride * outward
    last = origin + stride * k
    r0, g0, b0 = _mean_color(pixels, last - blend * step, last - (blend + 1) * step)
    r1, g1, b1 = _mean_color(pixels, last + (blend + 1) * step, last + (blend + 2) * step)
    dr, dg, db = r0 - r1, g0 - g1, b0 - b1
    contrast = dr * dr + dg * dg + db * db
    if contrast < min_contrast * min_contrast:
        return nothing
    if not _shows_hue(r0, g0, b0, hue, hue_tolerance, min_saturation, min_value):
        return nothing
    if len(other_hue) > 0:
        if not _shows_hue(r1, g1, b1, other_hue, hue_tolerance, min_saturation, min_value):
            return nothing
    elif _shows_hue(r1, g1, b1, hue, hue_tolerance, min_saturation, min_value):
        return nothing
    total, blended = 0.0, 0.0
    for i in range(-blend - 1, blend + 3):
        p = pixels[last + i * step]
        r, g, b = float(p[0]) - r1, float(p[1]) - g1, float(p[2]) - b1
        share = (r * dr + g * dg + b * db) / contrast
        # A third color is no blend of the two.
        away = r * r + g * g + b * b - share * share * contrast
        if away > max_mismatch * max_mismatch * contrast:
            return nothing
        if i <= -blend + 1 and abs(share - 1.0) > max_mismatch:
            return nothing
        if i >= blend and abs(share) > max_mismatch:
            return nothing
        if -blend < i <= blend:
            total += share
            blended += min(max(share * (1.0 - share), 0.0), 0.25)
    return k + outward * (total - blend + 0.5), blended


@njit(cache=True, error_model="numpy")
def find_borders(
    pose: Array,
    lines: Array,
    pixels_right: Image,
    pixels_left: Image,
    width: int,
    height: int,
    focal_length: float,
    baseline: float,
    edge_faces: IntArray,
    normals: Array,
    centers: Array,
    hues: Array,
    window: int,
    spacing: int,
    blend: int,
    end_margin: float,
    min_cosine: float,
    min_contrast: float,
    max_mismatch: float,
    hue_tolerance: float,
    min_saturation: float,
    min_value: float,
) -> tuple[IntArray, Array]:
    """Borders near the projected edges of a solid at a pose.

    Images are lists of pixels, shape (height * width, 3 or 4).

    Returns:
        The slot of each border, shape (n,), and for each, shape (n, 3): the row's or column's
        coordinate, the border's position on it [px], and how blended it is.
    """
    num_edges = len(edge_faces)
    cu, cv = 0.5 * (width - 1), 0.5 * (height - 1)
    R = rotation(pose[3:])
    capacity = 2 * num_edges * (max(width, height) // spacing + 1)
    slots = np.empty(capacity, dtype=np.int64)
    borders = np.empty((capacity, 3))
    count = 0
    cosines = np.empty(len(normals))
    for camera in range(2):
        pixels = pixels_right if camera == 0 else pixels_left
        x, y, z = pose[0] + camera * baseline, pose[1], pose[2]
        # The camera's center in the target's frame tells which faces look at it.
        ox = -(R[0, 0] * x + R[1, 0] * y + R[2, 0] * z)
        oy = -(R[0, 1] * x + R[1, 1] * y + R[2, 1] * z)
        oz = -(R[0, 2] * x + R[1, 2] * y + R[2, 2] * z)
        for k in range(len(normals)):
            dx, dy, dz = ox - centers[k, 0], oy - centers[k, 1], oz - centers[k, 2]
            cosine = normals[k, 0] * dx + normals[k, 1] * dy + normals[k, 2] * dz
            cosines[k] = cosine / math.sqrt(dx * dx + dy * dy + dz * dz)
        for e in range(num_edges):
            slot = camera * num_edges + e
            inside, other = edge_faces[e, 0], edge_faces[e, 1]
            if cosines[inside] < cosines[other]:  # the face that is seen better
                inside, other = other, inside
            if not cosines[inside] > min_cosine or math.isnan(lines[slot, L0]):
                continue
            if 0.0 < cosines[other] <= min_cosine:
                continue  # The neighbor is a sliver, too narrow for its color to be told.
            around = abs(hues[inside] - hues[other])
            alike = min(around, 6.0 - around) <= 2.0 * hue_tolerance
            if alike and cosines[other] > -min_cosine:
                continue  # The neighbor shows the same hue, or might.
            outer_hue = hues[other : other + 1] if cosines[other] > 0.0 else hues[:0]
            rows = lines[slot, ROWS] > 0.0
            # The side of the line on which the face's center appears
            p, q, r = centers[inside]
            side = (
                lines[slot, L0] * (R[0, 0] * p + R[0, 1] * q + R[0, 2] * r + x)
                + lines[slot, L1] * (R[1, 0] * p + R[1, 1] * q + R[1, 2] * r + y)
                + lines[slot, L2] * (R[2, 0] * p + R[2, 1] * q + R[2, 2] * r + z) / focal_length
            ) * (lines[slot, L0] if rows else lines[slot, L1])
            outward = -1 if side > 0.0 else 1
            along, across = (cv, cu) if rows else (cu, cv)
            low = min(lines[slot, FIRST], lines[slot, LAST]) + along + end_margin
            high = max(lines[slot, FIRST], lines[slot, LAST]) + along - end_margin
            length, most = (width, height) if rows else (height, width)
            first, last = math.ceil(max(low, 0.0)), math.floor(min(high, most - 1.0))
            for n in range(int(first), int(last) + 1, spacing):
                expected = crossing(lines, slot, n - along) + across
                position, blended = _find_border(
                    pixels, n * width if rows else n, 1 if rows else width, length,
                    expected, outward, window, blend, hues[inside : inside + 1], outer_hue,
                    min_contrast, max_mismatch, hue_tolerance, min_saturation, min_value,
                )  # fmt: skip
                if abs(position - expected) <= window:
                    slots[count] = slot
                    borders[count] = n - along, position - across, blended
                    count += 1
    return slots[:count], borders[:count]


@njit(cache=True, error_model="numpy")
def find_jumps(
    slots: IntArray, borders: Array, lines: Array, width: int, height: int
) -> tuple[IntArray, Array]:
    """Where a border, rounded to whole pixels, jumps to the next pixel.

    Between the last row before the jump and the first after it the edge passes through the center
    of the pixel that changes sides: to within the slope times half a row, which for an edge
    along the pixels' rows or columns is far better than any of its borders.

    A jump counts only between two stretches of at least three rows each that stay at their pixel;
    rows in between may waver, as noise makes them. (Anti-aliasing as a filter after the drawing,
    VTK's FXAA, bends a border's last one or two pixels at the corners; those are no jumps.)

    Returns:
        The slot of each jump, shape (n,), and for each, shape (n, 3): its coordinates along and
        across [px] and within how many rows it lies, 1 where no row wavers.
    """
    n = len(slots)
    rounded = np.empty(n)
    for k in range(n):
        to_pixel = 0.5 * (width - 1) if lines[slots[k], ROWS] > 0.0 else 0.5 * (height - 1)
        rounded[k] = math.floor(borders[k, 1] + to_pixel) + 0.5 - to_pixel
    jump_slots = np.empty(n, dtype=np.int64)
    jumps = np.empty((n, 3))
    count, last = 0, -1  # ``last``: the last row in the middle of three at one pixel
    for k in range(1, n - 1):
        if slots[k - 1] != slots[k + 1] or borders[k + 1, 0] - borders[k - 1, 0] != 2.0:
            continue
        if rounded[k - 1] != rounded[k] or rounded[k + 1] != rounded[k]:
            continue
        whole = last >= 0 and slots[last] == slots[k]
        whole = whole and borders[k, 0] - borders[last, 0] == k - last  # no row is missing
        if whole and abs(rounded[k] - rounded[last]) == 1.0:
            before = 0
            for i in range(last + 1, k):
                if rounded[i] == rounded[last]:
                    before += 1
                elif rounded[i] != rounded[k]:
                    whole = False
            if whole:
                jump_slots[count] = slots[k]
                jumps[count, 0] = borders[last, 0] + before + 0.5
                jumps[count, 1] = 0.5 * (rounded[k] + rounded[last])
                jumps[count, 2] = k - last - 2.0
                count += 1
        last = k
    return jump_slots[:count], jumps[:count]
