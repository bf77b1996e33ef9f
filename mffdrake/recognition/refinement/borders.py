"""Compiled search for color borders along a solid's projected edges (numba; import it late).

`BorderRefiner` says what a border is; here is how it is found. Lines are those of `edge_lines`.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.camera.lens import Eye, pixel
from mffdrake.recognition.fitness.structs import (
    ColorGate,
    Placed,
    Scene,
    Solid,
    in_camera,
    look_up,
    new_placed,
    noise_of,
    place,
)
from mffdrake.recognition.poses.rotations import rotation
from mffdrake.recognition.refinement.edge_lines import Line, Lines, cross, edge_lines
from mffdrake.recognition.visibility.drawing import facing

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Borders = NDArray[np.void]
Color: TypeAlias = tuple[float, float, float]

BORDER = np.dtype(
    [
        ("line", np.int64),  # its place in the `Lines`
        ("along", np.float64),  # the row (or column) [px]
        ("across", np.float64),  # where on it [px]
        ("off", np.float64),  # how far from where it was expected [px]
        ("blended", np.float64),  # how blended the pixels are that it crosses
        ("within", np.float64),  # a jump's: within how many rows it lies
        ("weight", np.float64),  # in the least-squares system
    ]
)
"""A border on a row or column; or a jump of it to the next pixel, see `find_jumps`."""


_NOISE_SPAN = 3.5  # standard deviations of the noise that colors may be off


class BorderRules(NamedTuple):
    """Which borders count: attributes of the same names of `RefinementParameters`."""

    blend: int
    end_margin: float
    min_cosine: float
    min_contrast: float
    max_mismatch: float
    min_borders: int
    border_error: float
    edge_error: float


class Stage(NamedTuple):
    """How borders are sought: how far from the edges [px], on every n-th row; and then."""

    window: int
    spacing: int
    steps: int


class Scan(NamedTuple):
    """A row or column of an image: ``pixels[origin + stride * k]``, k from 0 to length - 1.

    A border is expected at ``expected``, its inside against the direction ``outward`` (1 or -1).
    """

    origin: int
    stride: int
    length: int
    expected: float
    outward: int
    window: int


class Sides(NamedTuple):
    """Colors of the two sides of an edge; ``outside`` is 0 where anything else may lie there."""

    inside: np.uint32
    outside: np.uint32


@njit(cache=True, error_model="numpy")
def _mean_color(pixels: Image, first: int, second: int) -> Color:
    """Mean of two pixels."""
    return (
        0.5 * (float(pixels[first, 0]) + float(pixels[second, 0])),
        0.5 * (float(pixels[first, 1]) + float(pixels[second, 1])),
        0.5 * (float(pixels[first, 2]) + float(pixels[second, 2])),
    )


@njit(cache=True, error_model="numpy")
def _shows(pixels: Image, k: int, gate: ColorGate, color: int) -> bool:
    """Whether a pixel shows a color."""
    shown = look_up(gate.places, gate.table, pixels[k, 0], pixels[k, 1], pixels[k, 2])
    return (shown & color) != 0  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy", inline="always")
def _find_border(
    pixels: Image, scan: Scan, sides: Sides, gate: ColorGate, noise: float, rules: BorderRules
) -> tuple[float, float]:
    """Sub-pixel position of a border on a row or column, and how blended it is; NaN for none."""
    nothing = (np.nan, 0.0)
    origin, stride, outward, blend = scan.origin, scan.stride, scan.outward, rules.blend
    k = math.floor(scan.expected + 0.5)
    # From the expected place to the nearest pixel that shows the color before one that does not
    steps = 0
    direction = -outward
    if _shows(pixels, origin + stride * k, gate, sides.inside):
        direction = outward
    while True:
        steps += 1
        if steps > scan.window:
            return nothing
        k += direction
        shown = _shows(pixels, origin + stride * k, gate, sides.inside)
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
    if contrast < rules.min_contrast * rules.min_contrast:
        return nothing
    within = look_up(gate.places, gate.table, int(r0), int(g0), int(b0))
    beyond = look_up(gate.places, gate.table, int(r1), int(g1), int(b1))
    if (within & sides.inside) == 0:
        return nothing
    if sides.outside != 0:
        if (beyond & sides.outside) == 0:
            return nothing
    elif (beyond & sides.inside) != 0:
        return nothing
    total, blended = 0.0, 0.0
    # How far off colors may be along the line between the two sides, and squared, off it
    along = rules.max_mismatch + _NOISE_SPAN * noise / math.sqrt(contrast)
    each = 1.0 / contrast
    dr_each, dg_each, db_each = dr * each, dg * each, db * each
    aside = rules.max_mismatch**2 * contrast + (_NOISE_SPAN * noise) ** 2
    for i in range(-blend - 1, blend + 3):
        p = last + i * step
        r, g, b = float(pixels[p, 0]) - r1, float(pixels[p, 1]) - g1, float(pixels[p, 2]) - b1
        share = r * dr_each + g * dg_each + b * db_each
        # A third color is no blend of the two.
        away = r * r + g * g + b * b - share * share * contrast
        if away > aside:
            return nothing
        if i <= -blend + 1 and abs(share - 1.0) > along:
            return nothing
        if i >= blend and abs(share) > along:
            return nothing
        if -blend < i <= blend:
            total += share
            blended += share * (1.0 - share)  # negative, too, lest noise counts as blending
    return k + outward * (total - blend + 0.5), blended


@njit(cache=True, error_model="numpy")
def find_borders(
    pose: Array, lines: Lines, scene: Scene, rules: BorderRules, stage: Stage
) -> tuple[Borders, NDArray[np.int64]]:
    """Borders near the projected edges of a solid at a pose, and how many were sought in each view.

    None is sought where the image ends too soon to show one.
    """
    solid, outlines = scene.solid, scene.solid.outlines
    most = 0
    for view in scene.views:
        most = max(most, max(view.eye.width, view.eye.height) // stage.spacing + 1)
    needed = 0.0
    for line in lines:
        if line.seen:
            needed += abs(line.last - line.first) / stage.spacing + 2.0
    # No more memory than may be needed, and untouched: fresh pages cost more than the search.
    borders = np.empty(int(min(needed, float(len(lines) * most))), dtype=BORDER)
    along, across, x, y = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    sought = np.zeros(len(scene.views), dtype=np.int64)
    room = stage.window + rules.blend + 3  # what `_find_border` may read on either side
    count, seen, n, noise = 0, -1, 0, noise_of(scene)
    R_CM, placed, none = rotation(pose[3:]), new_placed(), np.uint32(0)
    for view in scene.views:
        pixels, eye = view.pixels, view.eye
        seen += 1
        place(R_CM, pose[:3], eye, placed)
        while n < len(lines) and lines[n].camera == seen:
            line, here = lines[n], n
            n += 1
            if not line.seen:
                continue
            e = line.segment
            first, second = outlines.faces[e, 0], outlines.faces[e, 1]
            cosine_in, cosine_out = _cosine(solid, first, placed), _cosine(solid, second, placed)
            side = 0
            if cosine_in < cosine_out:  # the face that is seen better
                cosine_in, cosine_out, side = cosine_out, cosine_in, 1
            inside, other = outlines.faces[e, side], outlines.faces[e, 1 - side]
            if outlines.smooth[e]:
                if not cosine_in > 0.0 >= cosine_out:
                    continue  # It is no silhouette of the curved surface.
            else:
                if not cosine_in > rules.min_cosine:
                    continue
                if 0.0 < cosine_out <= rules.min_cosine:
                    continue  # The neighbor is a sliver, too narrow for its color to be told.
                same = solid.alike[solid.kinds[inside], solid.kinds[other]]
                if same and cosine_out > -rules.min_cosine:
                    continue  # The neighbor shows the same color, or might.
            sides = Sides(solid.colors[inside], solid.colors[other] if cosine_out > 0.0 else none)
            outward = _outward(eye, line, placed, outlines.ends[e], outlines.inward[e, side])
            from_first = rules.end_margin * outlines.stops[e, 0]
            from_last = rules.end_margin * outlines.stops[e, 1]
            low, high = line.first + from_first, line.last - from_last
            if line.first > line.last:
                low, high = line.last + from_last, line.first - from_first
            length, num_rows = eye.width, eye.height
            if not line.rows:
                length, num_rows = num_rows, length
            start, stop = math.ceil(max(low, 0.0)), math.floor(min(high, num_rows - 1.0))
            rows = 0
            for row in range(int(start), int(stop) + 1, stage.spacing):
                along[rows] = row
                rows += 1
            cross(eye, line, along[:rows], across[:rows], x[:rows], y[:rows])
            stride = 1 if line.rows else eye.width
            for r in range(rows):
                expected, row = across[r], int(along[r])
                if not room <= math.floor(expected + 0.5) < length - room:
                    continue
                sought[seen] += 1
                origin = row * eye.width if line.rows else row
                scan = Scan(origin, stride, length, expected, outward, stage.window)
                position, blended = _find_border(pixels, scan, sides, scene.gate, noise, rules)
                if abs(position - expected) <= stage.window:
                    border = borders[count]
                    border.line, border.along, border.across = here, along[r], position
                    border.off = position - expected
                    border.blended, border.within, border.weight = blended, 0.0, 0.0
                    count += 1
    return borders[:count], sought


@njit(cache=True, error_model="numpy")
def count_explained(
    pose: Array, scene: Scene, rules: BorderRules, stage: Stage, tolerance: float
) -> NDArray[np.int64]:
    """Of each view, how many borders lie where a pose has them, and how many there should be.

    Shape (number of views, 2).
    """
    counts = np.zeros((len(scene.views), 2), dtype=np.int64)
    lines = edge_lines(pose, scene.solid, scene.views)
    borders, sought = find_borders(pose, lines, scene, rules, stage)
    counts[:, 1] = sought
    for border in borders:
        if abs(border.off) <= tolerance:
            counts[lines[border.line].camera, 0] += 1
    return counts


@njit(cache=True, error_model="numpy")
def _cosine(solid: Solid, face: int, placed: Placed) -> float:
    """Cosine between a face's normal and the line from its center to the camera."""
    toward, squared = facing(solid.normals, solid.centers, face, placed.p_MK)
    return toward / math.sqrt(squared)  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def _outward(eye: Eye, line: Line, placed: Placed, ends: Array, inward: Array) -> int:
    """The direction (1 or -1) on a row or column that leads out of a face across its edge."""
    length = math.sqrt(((ends[1] - ends[0]) ** 2).sum())
    point = 0.5 * (ends[0] + ends[1]) + 0.1 * length * inward
    x, y, z = in_camera(placed, point[0], point[1], point[2])
    # From the edge's middle a little way into the face, as the image shows it
    mx, my = 0.5 * (line.x0 + line.x1), 0.5 * (line.y0 + line.y1)
    u0, v0 = pixel(eye.lens, mx, my)
    u1, v1 = pixel(eye.lens, mx + 1e-3 * (x / z - mx), my + 1e-3 * (y / z - my))
    # Seen from the line, not from one point of it: along it the row changes, too.
    u2, v2 = pixel(eye.lens, mx + 1e-3 * (line.x1 - mx), my + 1e-3 * (line.y1 - my))
    area = (u2 - u0) * (v1 - v0) - (v2 - v0) * (u1 - u0)
    toward = -area * (v2 - v0) if line.rows else area * (u2 - u0)
    return -1 if toward > 0.0 else 1


@njit(cache=True, error_model="numpy")
def find_jumps(borders: Borders, lines: Lines) -> Borders:
    """Where a border, rounded to whole pixels, jumps to the next pixel.

    Between the last row before the jump and the first after it the edge passes through the center
    of the pixel that changes sides: to within the slope times half a row, which for an edge
    along the pixels' rows or columns is far better than any of its borders.

    A jump counts only between two stretches of at least three rows each that stay at their pixel;
    rows in between may waver, as noise makes them. (Anti-aliasing as a filter after the drawing,
    VTK's FXAA, bends a border's last one or two pixels at the corners; those are no jumps.)
    """
    n = len(borders)
    jumps = np.empty(n, dtype=BORDER)
    rounded = np.empty(n)
    for k in range(n):
        rounded[k] = math.floor(borders[k].across) + 0.5
    count, last = 0, -1  # ``last``: the last row in the middle of three at one pixel
    for k in range(1, n - 1):
        before, here, after = borders[k - 1], borders[k], borders[k + 1]
        if before.line != after.line or after.along - before.along != 2.0:
            continue
        if rounded[k - 1] != rounded[k] or rounded[k + 1] != rounded[k]:
            continue
        whole = last >= 0 and borders[last].line == here.line
        whole = whole and here.along - borders[last].along == k - last  # no row is missing
        if whole and abs(rounded[k] - rounded[last]) == 1.0:
            stayed = 0
            for i in range(last + 1, k):
                if rounded[i] == rounded[last]:
                    stayed += 1
                elif rounded[i] != rounded[k]:
                    whole = False
            if whole:
                jump = jumps[count]
                jump.line = here.line
                jump.along = borders[last].along + stayed + 0.5
                jump.across = 0.5 * (rounded[k] + rounded[last])
                jump.off = 0.0
                jump.blended, jump.within, jump.weight = 0.0, k - last - 2.0, 0.0
                count += 1
        last = k
    return jumps[:count]
