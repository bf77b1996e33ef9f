"""Compiled geometry of a solid's projected edges (numba). Import only where it runs.

A *line* is a segment of an edge as a camera sees it (see `Outlines`). On the plane of normalized
coordinates it is straight; in the image the lens bends it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.camera.lens import (
    NO_DISTORTION,
    Eye,
    Lens,
    View,
    in_view,
    pixel,
    pixel_jacobian,
    turned_back,
)
from mffdrake.recognition.fitness.structs import Solid, aspect_shown, new_placed, place
from mffdrake.recognition.poses.rotations import cross_product, rotated, rotation

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Lines = NDArray[np.void]
Line: TypeAlias = Any
"""One of `Lines`, a record with the fields of `LINE`."""

LINE = np.dtype(
    [
        ("camera", np.int64),  # the camera
        ("segment", np.int64),
        ("seen", np.bool_),  # whether both ends are before the camera
        ("l0", np.float64),  # l0 x + l1 y + l2 = 0 in normalized coordinates
        ("l1", np.float64),
        ("l2", np.float64),
        ("x0", np.float64),  # the ends
        ("y0", np.float64),
        ("x1", np.float64),
        ("y1", np.float64),
        ("first_depth", np.float64),  # their depths [m]
        ("last_depth", np.float64),
        ("rows", np.bool_),  # whether it is nearer to the vertical: then rows cross it, ...
        ("first", np.float64),  # ... from this row to that one [px]; else columns do
        ("last", np.float64),
        ("slope", np.float64),  # how far it moves from a row (column) to the next, at most 1 aside
    ]
)
"""A segment of an edge, seen by a camera."""


@njit(cache=True, error_model="numpy")
def edge_lines(pose: Array, solid: Solid, views: tuple[View, ...]) -> Lines:
    """The lines of all segments that a camera may see, camera by camera."""
    R_CM, outlines = rotation(pose[3:]), solid.outlines
    aspects, count = np.empty(len(views), dtype=np.int64), 0
    placed, k = new_placed(), -1
    for view in views:
        k += 1
        place(R_CM, pose[:3], view.eye, placed)
        aspects[k] = aspect_shown(placed, solid.middle, outlines.grid)
        count += outlines.start[aspects[k] + 1] - outlines.start[aspects[k]]
    lines = np.zeros(count, dtype=LINE)
    n, k = 0, -1
    for view in views:
        k += 1
        for entry in range(outlines.start[aspects[k]], outlines.start[aspects[k] + 1]):
            line = lines[n]
            n += 1
            line.camera, line.segment = k, outlines.segments[entry]
            ends = outlines.ends[line.segment]
            _place_line(line, R_CM, pose, view.eye, ends[0], ends[1])
            if line.seen:
                u0, v0 = pixel(view.eye.lens, line.x0, line.y0)
                u1, v1 = pixel(view.eye.lens, line.x1, line.y1)
                line.rows = abs(v1 - v0) >= abs(u1 - u0)
                _measure_line(view.eye, line, True)
    return lines


@njit(cache=True, error_model="numpy")
def move_lines(
    lines: Lines,
    pose: Array,
    solid: Solid,
    views: tuple[View, ...],
    with_slopes: bool,
) -> bool:
    """Brings lines to another pose; each is crossed by rows or by columns as it was.

    Returns whether all that were seen still are.
    """
    R_CM = rotation(pose[3:])
    n, whole, k = 0, True, -1
    for view in views:
        k += 1
        while n < len(lines) and lines[n].camera == k:
            line = lines[n]
            n += 1
            if not line.seen:
                continue
            ends = solid.outlines.ends[line.segment]
            _place_line(line, R_CM, pose, view.eye, ends[0], ends[1])
            if line.seen:
                _measure_line(view.eye, line, with_slopes)
            if not line.seen:
                whole = False
    return whole


@njit(cache=True, error_model="numpy")
def _place_line(line: Line, R_CM: Array, pose: Array, eye: Eye, first: Array, last: Array) -> None:
    """Fills in a line's ends and whether they are seen."""
    ax, ay, az = _in_view(R_CM, pose, eye, first)
    bx, by, bz = _in_view(R_CM, pose, eye, last)
    x0, y0, x1, y1 = ax / az, ay / az, bx / bz, by / bz
    farthest = max(x0 * x0 + y0 * y0, x1 * x1 + y1 * y1)
    line.seen = min(az, bz) > 0.0 and farthest <= eye.lens.max_radius_squared
    line.l0, line.l1, line.l2 = y0 - y1, x1 - x0, x0 * y1 - y0 * x1
    line.x0, line.y0, line.x1, line.y1 = x0, y0, x1, y1
    line.first_depth, line.last_depth = az, bz


@njit(cache=True, error_model="numpy")
def _measure_line(eye: Eye, line: Line, with_slope: bool) -> None:
    """Fills in which rows (columns) a line crosses; none, where it is too far off for numbers."""
    u0, v0 = pixel(eye.lens, line.x0, line.y0)
    u1, v1 = pixel(eye.lens, line.x1, line.y1)
    line.first, line.last = (v0, v1) if line.rows else (u0, u1)
    line.seen = math.isfinite(line.first) and math.isfinite(line.last)
    if with_slope:
        x, y = 0.5 * (line.x0 + line.x1), 0.5 * (line.y0 + line.y1)
        ux, uy, vx, vy = pixel_jacobian(eye.lens, x, y)
        du, dv = uy * line.l0 - ux * line.l1, vy * line.l0 - vx * line.l1
        line.slope = du / dv if line.rows else dv / du


@njit(cache=True, error_model="numpy")
def _in_view(R_CM: Array, pose: Array, eye: Eye, p_M: Array) -> tuple[float, float, float]:
    """A point of the target in a camera's frame, Eq. (13), (16)."""
    x, y, z = rotated(R_CM, p_M[0], p_M[1], p_M[2])
    p_K: tuple[float, float, float] = in_view(eye, x + pose[0], y + pose[1], z + pose[2])
    return p_K


@njit(cache=True, error_model="numpy", inline="always")
def cross(eye: Eye, line: Line, along: Array, across: Array, x: Array, y: Array) -> None:
    """Where rows (or columns) at pixel coordinates ``along`` cross a line, shape (n,).

    Fills in the other pixel coordinates, and the normalized coordinates of the places.
    """
    lens = eye.lens
    l0, l1, l2 = line.l0, line.l1, line.l2
    if lens.model != NO_DISTORTION:
        slower = 1.0 / (line.last - line.first)
        share = 0.0
        for k in range(len(along)):
            # The lens bends the line little: where the last row crossed it, the next one is near.
            guess = (along[k] - line.first) * slower
            if k > 0:
                guess = share + (along[k] - along[k - 1]) * slower
            share, across[k], x[k], y[k] = _cross_bent(lens, line, along[k], guess)
    elif line.rows:
        pitch, each = 1.0 / lens.fy, -1.0 / l0
        for k in range(len(along)):
            y[k] = (along[k] - lens.cy) * pitch
            x[k] = (l1 * y[k] + l2) * each
            across[k] = lens.fx * x[k] + lens.cx
    else:
        pitch, each = 1.0 / lens.fx, -1.0 / l1
        for k in range(len(along)):
            x[k] = (along[k] - lens.cx) * pitch
            y[k] = (l0 * x[k] + l2) * each
            across[k] = lens.fy * y[k] + lens.cy


class Crossing(NamedTuple):
    """Where a row (or column) crosses a line.

    Attributes:
        share: Of the line that comes before the place.
        across: The place's other pixel coordinate.
        x: Its normalized coordinates.
        y: The same.
    """

    share: float
    across: float
    x: float
    y: float


@njit(cache=True, error_model="numpy")
def _cross_bent(lens: Lens, line: Line, at: float, share: float) -> Crossing:
    """`cross` with a line that the lens bends, by Newton's steps along it."""
    dx, dy = line.x1 - line.x0, line.y1 - line.y0
    u, v, x, y = 0.0, 0.0, 0.0, 0.0
    for _ in range(8):
        x, y = line.x0 + share * dx, line.y0 + share * dy
        u, v = pixel(lens, x, y)
        missing = at - (v if line.rows else u)
        if abs(missing) < 1e-8:
            break
        ux, uy, vx, vy = pixel_jacobian(lens, x, y)
        share += missing / (vx * dx + vy * dy if line.rows else ux * dx + uy * dy)
    across: float = u
    if not line.rows:
        across = v
    return Crossing(share, across, x, y)


@njit(cache=True, error_model="numpy")
def _magnified(lens: Lens, line: Line, x: float, y: float) -> float:
    """What ``g`` is multiplied with in `cross_jacobians` [px], at normalized coordinates."""
    ux, uy, vx, vy = pixel_jacobian(lens, x, y)
    across = line.l0 * vy - line.l1 * vx if line.rows else line.l1 * ux - line.l0 * uy
    moved: float = (ux * vy - uy * vx) / across
    return moved


@njit(cache=True, error_model="numpy", inline="always")
def cross_jacobians(eye: Eye, line: Line, x: Array, y: Array, pose: Array, J: Array) -> None:
    """Derivatives of what `cross` finds with respect to a `move` of the pose, to ``J``, (n, 6).

    A point X of the target moves by dX = dt + dtheta x (X - t), in the rig's frame. Let n be the
    normal (l0, l1, l2) of the plane through the edge and the camera's center. The line moves across
    itself by ``g = n . dX / depth`` in normalized coordinates; with D the derivative of the lens,
    its crossing with a row moves by ``g det D / (l0 D_vy - l1 D_vx)``, that with a column by
    ``g det D / (l1 D_ux - l0 D_uy)``.
    """
    lens, p, x0, y0 = eye.lens, eye.p_KC, line.x0, line.y0
    dx, dy = line.x1 - x0, line.y1 - y0
    steep = abs(dy) > abs(dx)
    each = 1.0 / dy if steep else 1.0 / dx
    # Along a straight edge the inverse depth is linear in normalized coordinates.
    closeness, more = 1.0 / line.first_depth, 1.0 / line.last_depth - 1.0 / line.first_depth
    n0, n1, n2 = turned_back(eye, line.l0, line.l1, line.l2)
    t0, t1, t2 = pose[0], pose[1], pose[2]
    magnified = _magnified(lens, line, x0, y0)  # the same all over where the lens bends nothing
    for k in range(len(x)):
        if lens.model != NO_DISTORTION:
            magnified = _magnified(lens, line, x[k], y[k])
        near = closeness + more * (each * (y[k] - y0 if steep else x[k] - x0))
        depth, scale = 1.0 / near, magnified * near
        q0, q1, q2 = turned_back(eye, x[k] * depth - p[0], y[k] * depth - p[1], depth - p[2])
        q0, q1, q2 = q0 - t0, q1 - t1, q2 - t2
        J[k, 0], J[k, 1], J[k, 2] = n0 * scale, n1 * scale, n2 * scale
        m0, m1, m2 = cross_product(q0, q1, q2, n0, n1, n2)
        J[k, 3], J[k, 4], J[k, 5] = m0 * scale, m1 * scale, m2 * scale
