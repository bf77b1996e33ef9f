"""Compiled Gauss-Newton steps on color borders (numba). Import only where it runs.

`BorderRefiner` says what is estimated; here is how it is computed. Slots and image coordinates are
those of `_edge_lines`.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition._borders import find_borders, find_jumps
from mffdrake.recognition._edge_lines import (
    FIRST,
    LAST,
    SLOPE,
    crossing,
    crossing_jacobian,
    edge_lines,
    move,
    move_lines,
)

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Image = NDArray[np.uint8]
Result: TypeAlias = tuple[int, Array, Array, Array]

SETTLED, TOO_FEW, SINGULAR, UNSETTLED = range(4)

_TUKEY = 4.685  # where an error's weight becomes zero, for 95 % efficiency if errors are normal
_STEEPEST = 0.3  # Edges of a greater slope jump every third row or more often.
_LEAST_HARDNESS = 0.1
_SMOOTHEST = 1.0 / 36.0  # the square of the rounding of six samples a pixel
_SETTLED = 1e-3  # A step this short, squared and in units of its covariance, is the last.
_JUMP_FLOOR = 0.002  # [px] of a jump's error, as the slope is not exactly known


@njit(cache=True, error_model="numpy")
def factor(N: Array, L: Array) -> bool:
    """Cholesky factor L of a symmetric matrix, from its lower half; false if it is singular."""
    for i in range(6):
        for j in range(i + 1):
            total = N[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = total / L[j, j]
            elif total > 1e-9 * N[i, i]:
                L[i, i] = math.sqrt(total)
            else:
                return False
    return True


@njit(cache=True, error_model="numpy")
def solve(L: Array, b: Array) -> Array:
    """Solution x of L L^T x = b."""
    x = b.copy()
    for i in range(6):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
    return x


@njit(cache=True, error_model="numpy")
def _add(J: Array, r: float, w: float, N: Array, b: Array, shared: Array) -> None:
    """Adds one border to the normal equations and to its slot's sums."""
    for i in range(6):
        for j in range(i + 1):
            N[i, j] += w * J[i] * J[j]
        b[i] += w * J[i] * r
        shared[i] += w * J[i]
    shared[6] += w * r
    shared[7] += w


@njit(cache=True, error_model="numpy")
def _robust(squared: float) -> float:
    """Tukey's weight of a squared error in units of its variance."""
    rest = 1.0 - squared / (_TUKEY * _TUKEY)
    return rest * rest if rest > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def normal_equations(
    pose: Array,
    lines: Array,
    slots: IntArray,
    borders: Array,
    jump_slots: IntArray,
    jumps: Array,
    focal_length: float,
    baseline: float,
    spacing: int,
    hardness: float,
    border_error: float,
    edge_error: float,
    jump_tolerance: float,
    N: Array,
    b: Array,
) -> tuple[float, float]:
    """Fills the weighted normal equations N x = b of a step (`move`) and of all errors.

    Returns the borders' scale [px] and the sum of their robust weights.
    """
    num_edges = len(lines) // 2
    residuals = np.empty(len(slots))
    for k in range(len(slots)):
        residuals[k] = borders[k, 1] - crossing(lines, slots[k], borders[k, 0])
    scale = max(border_error, 1.4826 * float(np.median(np.abs(residuals))))
    # The cut is robust; what remains within it tells the variance.
    total, trusted = 0.0, 0.0
    for k in range(len(slots)):
        weight = _robust(residuals[k] ** 2 / (scale * scale))
        total += weight * residuals[k] ** 2
        trusted += weight
    spread = max(border_error**2, total / trusted)
    J = np.empty(6)
    shared = np.zeros((len(lines), 8))
    N[:], b[:] = 0.0, 0.0
    for k in range(len(slots)):
        slot = slots[k]
        variance = spread
        if lines[slot, SLOPE] < _STEEPEST:
            # Borders that round to the same pixel share the error of it: together they count as
            # one. In a steeper edge those errors follow each other too fast to matter.
            length = abs(lines[slot, LAST] - lines[slot, FIRST])
            same = min(length, 1.0 / max(lines[slot, SLOPE], 1e-9)) / spacing
            variance += hardness / 12.0 * same
        weight = _robust(residuals[k] ** 2 / (scale * scale))
        shift = baseline if slot >= num_edges else 0.0
        crossing_jacobian(lines, slot, borders[k, 0], pose, focal_length, shift, J)
        _add(J, residuals[k], weight / variance, N, b, shared[slot])
    for k in range(len(jump_slots)):
        slot = jump_slots[k]
        if lines[slot, SLOPE] >= _STEEPEST:
            continue
        # It lies evenly spread over some rows, times how far the line moves in one.
        variance = (lines[slot, SLOPE] * jumps[k, 2]) ** 2 / 12.0 + _JUMP_FLOOR**2
        r = jumps[k, 1] - crossing(lines, slot, jumps[k, 0])
        weight = _robust(r * r / (4.0 * (variance + edge_error**2) + jump_tolerance**2))
        shift = baseline if slot >= num_edges else 0.0
        crossing_jacobian(lines, slot, jumps[k, 0], pose, focal_length, shift, J)
        _add(J, r, weight / variance, N, b, shared[slot])
    # An error that all borders of a slot share has the covariance D + edge_error^2 1 1^T, whose
    # inverse is (Sherman and Morrison) that of D less a matrix of rank one.
    for slot in range(len(lines)):
        c = edge_error**2 / (1.0 + edge_error**2 * shared[slot, 7])
        for i in range(6):
            for j in range(i + 1):
                N[i, j] -= c * shared[slot, i] * shared[slot, j]
            b[i] -= c * shared[slot, i] * shared[slot, 6]
    return math.sqrt(spread), trusted


@njit(cache=True, error_model="numpy")
def refine(
    start: Array,
    pixels_right: Image,
    pixels_left: Image,
    width: int,
    height: int,
    focal_length: float,
    baseline: float,
    vertices: Array,
    edges: IntArray,
    edge_faces: IntArray,
    normals: Array,
    centers: Array,
    hues: Array,
    windows: IntArray,
    spacings: IntArray,
    steps: IntArray,
    blend: int,
    end_margin: float,
    min_cosine: float,
    min_contrast: float,
    max_mismatch: float,
    min_borders: int,
    border_error: float,
    edge_error: float,
    hue_tolerance: float,
    min_saturation: float,
    min_value: float,
) -> Result:
    """Refines a pose, see `BorderRefiner.refine`.

    Returns:
        How it ended; the pose vector; the covariance of translation and rotation vector, both in
        the camera's frame, shape (6, 6); and the number of borders, that of jumps, the share of
        trusted borders, their scale [px] and the hardness of the image, shape (5,).
    """
    pose = start.copy()
    covariance, L, N = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    b, statistics = np.zeros(6), np.zeros(5)
    advance = np.inf
    for stage in range(len(windows)):
        final = stage == len(windows) - 1
        lines = edge_lines(pose, vertices, edges, focal_length, baseline)
        slots, borders = find_borders(
            pose, lines, pixels_right, pixels_left, width, height, focal_length, baseline,
            edge_faces, normals, centers, hues, windows[stage], spacings[stage], blend,
            end_margin, min_cosine, min_contrast, max_mismatch,
            hue_tolerance, min_saturation, min_value,
        )  # fmt: skip
        statistics[:] = 0.0
        statistics[0] = len(slots)
        if len(slots) * spacings[stage] < min_borders:
            return TOO_FEW, pose, covariance, statistics
        # With b the covered share of the pixels that a border crosses, b (1 - b) is zero in a hard
        # image and 1/6 on average where every share occurs; rounding to steps of q makes it
        # (1 - q^2) / 6, so this is q^2.
        hardness = min(1.0, max(_SMOOTHEST, 1.0 - 6.0 * borders[:, 2].mean()))
        jump_slots, jumps = slots[:0], borders[:0]
        if final and spacings[stage] == 1 and hardness > _LEAST_HARDNESS:
            jump_slots, jumps = find_jumps(slots, borders, lines, width, height)
        for k in range(steps[stage]):
            scale, trusted = normal_equations(
                pose, lines, slots, borders, jump_slots, jumps, focal_length, baseline,
                spacings[stage], hardness, border_error, edge_error, 0.1 * 0.25**k, N, b,
            )  # fmt: skip
            statistics[1], statistics[2] = len(jumps), trusted / len(slots)
            statistics[3], statistics[4] = scale, hardness
            if not factor(N, L):
                return SINGULAR, pose, covariance, statistics
            step = solve(L, b)
            advance = 0.0  # squared, in units of the covariance: x^T N x
            for i in range(6):
                advance += step[i] * b[i]
            pose = move(pose, step)
            # Slopes set the weights, which must not change for ever.
            move_lines(lines, pose, vertices, edges, focal_length, baseline, k < 3)
            if not math.isfinite(lines.sum()):
                return UNSETTLED, pose, covariance, statistics
            if advance < _SETTLED and k >= 2:
                break
    for i in range(6):
        b[:] = 0.0
        b[i] = 1.0
        covariance[:, i] = solve(L, b)
    return (SETTLED if advance < 0.25 else UNSETTLED), pose, covariance, statistics
