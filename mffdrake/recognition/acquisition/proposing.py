"""Compiled proposals of poses from blobs of color (numba). Import only where it runs.

`Proposer` says what is proposed; here is how it is computed. A blob's frame F has its origin in
the camera and its z axis along the blob's direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.acquisition.appearance import Appearances, AppearanceTable, find_similar
from mffdrake.recognition.acquisition.blobs import Blobs, turn_along
from mffdrake.recognition.camera.lens import Eye, in_view, turned_back
from mffdrake.recognition.genetic.random_numbers import generator_at
from mffdrake.recognition.poses.rotations import multiply, rotation

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Sources = NDArray[np.void]

SOURCE = np.dtype(
    [
        ("blob", np.int64),
        ("depth", np.float64),  # of its center in F [m]; NaN: as its area tells
        ("weight", np.float64),
    ]
)
"""A blob that may be the target, or a part of it, and how far away."""


class Bounds(NamedTuple):
    """Which poses are proposed: pose vectors between these, with so much about them.

    Attributes:
        lower: Least pose vector, shape (6,).
        upper: Greatest one, shape (6,).
        nearest: Least distance from a camera [m].
        farthest: Greatest one [m].
        size: Of the solid [m].
    """

    lower: Array
    upper: Array
    nearest: float
    farthest: float
    size: float


class Frames(NamedTuple):
    """Where the blobs' frames F are in the rig's C.

    Attributes:
        turns: Their orientations R_CF as quaternions, the scalar part first, shape (B, 4).
        R_CF: The same as matrices, shape (B, 3, 3).
        p_CF: Their origins [m], shape (B, 3).
    """

    turns: Array
    R_CF: Array
    p_CF: Array


@njit(cache=True, error_model="numpy")
def rig_frames(blobs: Blobs, eyes: tuple[Eye, ...], turns_CK: Array) -> tuple[Array, Array, Array]:
    """The fields of the blobs' `Frames`; ``turns_CK``: the cameras' quaternions."""
    count = len(blobs)
    turns, R_CF, p_CF = np.empty((count, 4)), np.empty((count, 3, 3)), np.empty((count, 3))
    axes, half = np.empty((3, 3)), np.empty(4)
    for n in range(count):
        blob = blobs[n]
        for index, eye in enumerate(eyes):
            if index == blob.camera:
                turn_along(blob.x, blob.y, axes)
                # From the z axis to the direction, the short way
                c = axes[2, 2]
                half[0] = math.sqrt(0.5 * (1.0 + c))
                half[1], half[2], half[3] = (
                    -axes[2, 1] * 0.5 / half[0],
                    axes[2, 0] * 0.5 / half[0],
                    0.0,
                )
                turns[n] = multiply(turns_CK[index], half)
                for j in range(3):  # the axes of F are rows
                    R_CF[n, 0, j], R_CF[n, 1, j], R_CF[n, 2, j] = turned_back(
                        eye, axes[j, 0], axes[j, 1], axes[j, 2]
                    )
                x, y, z = in_view(eye, 0.0, 0.0, 0.0)
                p_CF[n, 0], p_CF[n, 1], p_CF[n, 2] = turned_back(eye, -x, -y, -z)
    return turns, R_CF, p_CF


@njit(cache=True, error_model="numpy")
def pair_blobs(
    blobs: Blobs,
    appearances: Appearances,
    frames: Frames,
    table: AppearanceTable,
    bounds: Bounds,
) -> Sources:
    """Blobs of two cameras that may be one thing, and single ones, as far as size and place allow.

    The weights of the pairs of any color, of those of one color, and of the single blobs each add
    up to one, where there are any.
    """
    count = len(blobs)
    sources = np.empty(4 * count + 16, dtype=SOURCE)  # more when there are more
    colors, R_CF, p_CF = appearances.colors, frames.R_CF, frames.p_CF
    num_colors = colors.shape[1]
    most, least = np.zeros(num_colors + 1), np.full(num_colors + 1, np.inf)  # areas seen [m^2]
    for n in range(len(table.area)):
        most[0], least[0] = max(most[0], table.area[n]), min(least[0], table.area[n])
        for k in range(num_colors):
            most[k + 1] = max(most[k + 1], table.area[n] * table.appearances.colors[n, k].share)
    least[1:] = 0.25 * most[1:]
    found = 0
    sums = np.zeros(3)
    for a in range(count):
        for b in range(count):
            if blobs[a].camera >= blobs[b].camera or blobs[a].color != blobs[b].color:
                continue
            # The points of the two lines of sight that are nearest to each other
            da, db, w = R_CF[a, :, 2], R_CF[b, :, 2], p_CF[b] - p_CF[a]
            cosine, wa, wb = 0.0, 0.0, 0.0
            for i in range(3):
                cosine, wa, wb = cosine + da[i] * db[i], wa + w[i] * da[i], wb + w[i] * db[i]
            sine = 1.0 - cosine * cosine
            s, t = (wa - cosine * wb) / sine, (cosine * wa - wb) / sine
            if not (bounds.nearest <= min(s, t) and max(s, t) <= bounds.farthest):
                continue
            gap = 0.0
            for i in range(3):
                gap += (p_CF[a, i] + s * da[i] - p_CF[b, i] - t * db[i]) ** 2
            seen_a, seen_b = blobs[a].area * s * s, blobs[b].area * t * t  # [m^2]
            ratio = min(seen_a, seen_b) / max(seen_a, seen_b)
            size = math.sqrt(max(seen_a, seen_b))
            if gap > (0.35 * size) ** 2 or ratio < 0.25:
                continue
            color, area = blobs[a].color, 0.5 * (seen_a + seen_b)
            if area < 0.15 * least[color + 1] or area > 3.0 * most[color + 1]:
                continue
            weight = ratio * math.exp(-0.5 * gap / (0.1 * size) ** 2)
            weight *= min(1.0, area / least[color + 1], most[color + 1] / area)
            if color < 0:
                common, shown = 0.0, 0
                for k in range(num_colors):
                    common += min(colors[a, k].share, colors[b, k].share)
                    shown += colors[a, k].share + colors[b, k].share > 0.1
                weight *= common * min(shown, 3) ** 2
            if weight <= 0.0:
                continue  # They have no color in common.
            if found + count >= len(sources):  # Room for the single ones is left, too.
                more = np.empty(2 * len(sources), dtype=SOURCE)
                more[:found] = sources[:found]
                sources = more
            sources[found].blob, sources[found].depth, sources[found].weight = a, s, weight
            sums[0 if color < 0 else 1] += weight
            found += 1
    for a in range(count):
        color = blobs[a].color
        near = blobs[a].area * bounds.nearest**2  # [m^2], if it was so near
        far = blobs[a].area * bounds.farthest**2
        if near > 1.5 * most[color + 1] or far < 0.15 * least[color + 1]:
            continue
        shown = 1
        if color < 0:
            shown = 0
            for k in range(num_colors):
                shown += colors[a, k].share > 0.05
        sources[found].blob, sources[found].depth = a, np.nan
        sources[found].weight = min(shown, 3) ** 2
        sums[2] += sources[found].weight
        found += 1
    for n in range(found):
        source = sources[n]
        kind = 2 if math.isnan(source.depth) else 0 if blobs[source.blob].color < 0 else 1
        source.weight /= sums[kind]
    return sources[:found]


@njit(cache=True, error_model="numpy")
def propose(
    blobs: Blobs,
    appearances: Appearances,
    frames: Frames,
    sources: Sources,
    table: AppearanceTable,
    middle: Array,
    bounds: Bounds,
    count: int,
    first: int,
    address: int,
) -> tuple[Array, IntArray]:
    """Poses at blobs, of which each is one source's; fewer where few are within the bounds.

    ``first`` numbers the first of them among those of all frames; ``address``: see `address_of`.
    """
    rng = generator_at(address)
    turns, R_CF, p_CF = frames
    poses, origins = np.empty((count, 6)), np.empty(count, dtype=np.int64)
    made, size = 0, len(table.area)
    num_similar = min(16, size)
    similar = np.full((len(blobs), num_similar), -1, dtype=np.int64)
    total = 0.0
    for source in sources:
        total += source.weight
    stride = 1 + int(0.6180339887498949 * size)
    while math.gcd(stride, size) != 1:
        stride += 1
    jitter = np.empty(4)
    for attempt in range(8 * count if total > 0.0 and size > 0 else 0):
        if made == count:
            break
        left, n = rng.random() * total, 0
        while n < len(sources) - 1 and left > sources[n].weight:
            left -= sources[n].weight
            n += 1
        source = sources[n]
        b = source.blob
        blob = blobs[b]
        if blob.color < 0 and rng.random() < 0.6:  # an orientation in which it looks like that
            if similar[b, 0] < 0:
                find_similar(appearances, b, table, num_similar, similar[b])
            side = similar[b, int(num_similar * rng.random() ** 2)]
        else:
            side = ((first + attempt) * stride) % size
        area, x, y = table.area[side], table.center[side, 0], table.center[side, 1]
        if blob.color >= 0:
            color = table.appearances.colors[side, blob.color]
            if color.share < 0.03:
                continue  # From there, that color is not to be seen.
            x -= color.x / color.share * math.sqrt(area)
            y -= color.y / color.share * math.sqrt(area)
            area *= color.share
        depth = source.depth
        if math.isnan(depth):
            depth = math.sqrt(area / blob.area)
            if blob.clipped:
                depth *= 1.0 - 0.5 * rng.random()
        spread = bounds.size * 0.012 * 10.0 ** rng.random()
        angle = 0.15 * rng.random()
        jitter[0] = 1.0
        for i in range(3):
            jitter[i + 1] = angle * rng.standard_normal()
        jitter /= math.sqrt((jitter * jitter).sum())
        q = multiply(turns[b], multiply(table.turns[side], jitter))
        R = rotation(q[1:])
        inside = True
        x += spread * rng.standard_normal()
        y += spread * rng.standard_normal()
        depth += 1.5 * spread * rng.standard_normal()
        for i in range(3):
            value = p_CF[b, i] + R_CF[b, i, 0] * x + R_CF[b, i, 1] * y + R_CF[b, i, 2] * depth
            for j in range(3):
                value -= R[i, j] * middle[j]
            poses[made, i], poses[made, 3 + i] = value, q[i + 1]
            inside = inside and bounds.lower[i] <= value <= bounds.upper[i]
            inside = inside and bounds.lower[3 + i] <= q[i + 1] <= bounds.upper[3 + i]
        if inside:
            origins[made] = n
            made += 1
    return poses[:made], origins[:made]
