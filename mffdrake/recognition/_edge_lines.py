"""Compiled geometry of a solid's projected edges (numba). Import only where it runs.

A *slot* is an edge seen by a camera: slot e is edge e in the right image, slot E + e the same edge
in the left image. Image coordinates (u, v) are relative to the principal point [px].
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

L0, L1, L2, ROWS, FIRST, LAST, FIRST_DEPTH, LAST_DEPTH, SLOPE = range(9)
"""Columns of the array of lines, see `edge_lines`."""


@njit(cache=True, error_model="numpy")
def rotation(eps: Array) -> Array:
    """Rotation matrix of a quaternion's vector part, shape (3, 3)."""
    e1, e2, e3 = eps
    eta = math.sqrt(max(0.0, 1.0 - e1 * e1 - e2 * e2 - e3 * e3))
    R = np.empty((3, 3))
    R[0, 0], R[1, 1], R[2, 2] = (
        1 - 2 * (e2 * e2 + e3 * e3),
        1 - 2 * (e1 * e1 + e3 * e3),
        1 - 2 * (e1 * e1 + e2 * e2),
    )
    R[0, 1], R[1, 0] = 2 * (e1 * e2 - eta * e3), 2 * (e1 * e2 + eta * e3)
    R[0, 2], R[2, 0] = 2 * (e1 * e3 + eta * e2), 2 * (e1 * e3 - eta * e2)
    R[1, 2], R[2, 1] = 2 * (e2 * e3 - eta * e1), 2 * (e2 * e3 + eta * e1)
    return R


@njit(cache=True, error_model="numpy")
def move(pose: Array, step: Array) -> Array:
    """A pose moved by a translation and a rotation vector, both in the camera's frame, shape (6,).

    The target turns about its own origin: R becomes exp(S(step[3:])) R.
    """
    moved = pose.copy()
    for i in range(3):
        moved[i] += step[i]
    a1, a2, a3 = step[3:]
    angle = math.sqrt(a1 * a1 + a2 * a2 + a3 * a3)
    half = 0.5 * math.sin(0.5 * angle) / (0.5 * angle) if angle > 1e-9 else 0.5
    d0, d1, d2, d3 = math.cos(0.5 * angle), half * a1, half * a2, half * a3
    e1, e2, e3 = pose[3:]
    e0 = math.sqrt(max(0.0, 1.0 - e1 * e1 - e2 * e2 - e3 * e3))
    q0 = d0 * e0 - d1 * e1 - d2 * e2 - d3 * e3
    q1 = d0 * e1 + e0 * d1 + d2 * e3 - d3 * e2
    q2 = d0 * e2 + e0 * d2 + d3 * e1 - d1 * e3
    q3 = d0 * e3 + e0 * d3 + d1 * e2 - d2 * e1
    norm = math.copysign(math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3), q0)
    moved[3], moved[4], moved[5] = q1 / norm, q2 / norm, q3 / norm
    return moved


@njit(cache=True, error_model="numpy")
def edge_lines(
    pose: Array, vertices: Array, edges: IntArray, focal_length: float, baseline: float
) -> Array:
    """The image lines of all slots, shape (2 E, 9); a line is NaN where it is behind the camera.

    Columns: ``L0 u + L1 v + L2 = 0`` is the line. Where ``ROWS`` is 1 it is nearer to the vertical,
    and rows cross it, from v = ``FIRST`` to ``LAST``; else columns do. The depths [m] are those of
    the ends. ``SLOPE`` is how far the line moves from a row (column) to the next, at most 1.
    """
    lines = np.full((2 * len(edges), 9), np.nan)
    move_lines(lines, pose, vertices, edges, focal_length, baseline, True)
    return lines


@njit(cache=True, error_model="numpy")
def move_lines(
    lines: Array,
    pose: Array,
    vertices: Array,
    edges: IntArray,
    focal_length: float,
    baseline: float,
    with_slopes: bool,
) -> None:
    """Brings lines to another pose; each is crossed by rows or by columns as it was."""
    R, f = rotation(pose[3:]), focal_length
    num_edges = len(edges)
    ends = np.empty((2, 3))
    for slot in range(2 * num_edges):
        for k in range(2):
            a, b, c = vertices[edges[slot % num_edges, k]]
            for i in range(3):
                ends[k, i] = R[i, 0] * a + R[i, 1] * b + R[i, 2] * c + pose[i]
            if slot >= num_edges:
                ends[k, 0] += baseline  # Eq. (16)
        az, bz = ends[0, 2] / f, ends[1, 2] / f
        if min(az, bz) <= 0.0:
            lines[slot] = np.nan
            continue
        l0 = ends[0, 1] * bz - az * ends[1, 1]
        l1 = az * ends[1, 0] - ends[0, 0] * bz
        if math.isnan(lines[slot, ROWS]):
            lines[slot, ROWS] = 1.0 if abs(l0) >= abs(l1) else 0.0
        rows = lines[slot, ROWS] > 0.0
        i = 1 if rows else 0
        lines[slot, L0], lines[slot, L1] = l0, l1
        lines[slot, L2] = ends[0, 0] * ends[1, 1] - ends[0, 1] * ends[1, 0]
        lines[slot, FIRST], lines[slot, LAST] = ends[0, i] / az, ends[1, i] / bz
        lines[slot, FIRST_DEPTH], lines[slot, LAST_DEPTH] = ends[0, 2], ends[1, 2]
        if with_slopes:
            lines[slot, SLOPE] = abs(l1 / l0) if rows else abs(l0 / l1)


@njit(cache=True, error_model="numpy")
def crossing(lines: Array, slot: int, at: float) -> float:
    """Where the row (or column) at a coordinate crosses a line: the other coordinate [px]."""
    l0, l1, l2 = lines[slot, L0], lines[slot, L1], lines[slot, L2]
    other: float = -(l1 * at + l2) / l0 if lines[slot, ROWS] > 0.0 else -(l0 * at + l2) / l1
    return other


@njit(cache=True, error_model="numpy")
def crossing_jacobian(
    lines: Array, slot: int, at: float, pose: Array, focal_length: float, shift: float, J: Array
) -> None:
    """Derivative of `crossing` with respect to a `move` of the pose, written to ``J``, shape (6,).

    A point X of the target moves by dX = dt + dtheta x (X - t). Let n be the normal of the plane
    through the edge and the camera's center. The border moves across itself by n . dX, so that the
    crossing with a row moves by ``f n . dX / (depth * L0)``, that with a column likewise with L1.
    ``shift`` is the camera's distance [m] to the left of the right camera.
    """
    f, l0, l1 = focal_length, lines[slot, L0], lines[slot, L1]
    other = crossing(lines, slot, at)
    u, v = (other, at) if lines[slot, ROWS] > 0.0 else (at, other)
    # Along a straight edge the inverse depth is linear in the image.
    share = (at - lines[slot, FIRST]) / (lines[slot, LAST] - lines[slot, FIRST])
    depth = 1.0 / ((1.0 - share) / lines[slot, FIRST_DEPTH] + share / lines[slot, LAST_DEPTH])
    n0, n1, n2 = l0, l1, lines[slot, L2] / f
    q0, q1, q2 = u * depth / f - pose[0] - shift, v * depth / f - pose[1], depth - pose[2]
    scale = f / (depth * (l0 if lines[slot, ROWS] > 0.0 else l1))
    J[0], J[1], J[2] = n0 * scale, n1 * scale, n2 * scale
    J[3] = (q1 * n2 - q2 * n1) * scale
    J[4] = (q2 * n0 - q0 * n2) * scale
    J[5] = (q0 * n1 - q1 * n0) * scale
