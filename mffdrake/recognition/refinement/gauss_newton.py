"""Compiled robust Gauss-Newton iterations toward borders and jumps (numba; import it late)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.fitness.structs import Scene, Solid
from mffdrake.recognition.poses.matrices import factor, solve
from mffdrake.recognition.poses.rotations import move, rotated, rotation
from mffdrake.recognition.refinement.borders import BorderRules, Borders
from mffdrake.recognition.refinement.edge_lines import Lines, cross, cross_jacobians, move_lines
from mffdrake.recognition.refinement.outcome import Outcome

Array = NDArray[np.float64]

_TUKEY = 4.685  # where an error's weight becomes zero, for 95 % efficiency if errors are normal
_STEEPEST = 0.3  # Edges of a greater slope jump every third row or more often.
_CONVERGED = 1e-3  # A step this short, squared and in units of its covariance, is the last.
_NEARLY = 0.1  # the same, where `center` follows
_DAMPED_FROM = 4  # steps
_JUMP_FLOOR = 0.002  # [px] of a jump's error, as the slope is not exactly known


_GAUGE_STD = 1e-3  # [rad] A turn that changes nothing is known as well as that.


class Measurements(NamedTuple):
    """What the images show: borders and jumps, and how aliased the images are."""

    borders: Borders
    jumps: Borders
    spacing: int
    aliasing: float


class Equations(NamedTuple):
    """The normal equations N x = b of a step (`move`)."""

    N: Array
    b: Array


class LineSums(NamedTuple):
    """Of each line the sums of w J, of w r and of w over its borders, shapes (L, 6), (L,), (L,).

    J is a border's row of the Jacobian, r its residual and w its weight.
    """

    wJ: Array
    wr: Array
    w: Array


class Stopping(NamedTuple):
    """When iterations end: after so many; in a final stage; in one that `center` follows on."""

    steps: int
    final: bool
    aliased: bool


class Fit(NamedTuple):
    """Where iterations ended: attributes of the same names of a `Result`."""

    outcome: Outcome
    pose: Array
    inlier_ratio: float
    residual: float


@njit(cache=True, error_model="numpy", inline="always")
def _add(J: Array, r: float, w: float, equations: Equations, sums: LineSums, line: int) -> None:
    """Adds one border to the normal equations and to its line's sums."""
    for i in range(6):
        for j in range(i + 1):
            equations.N[i, j] += w * J[i] * J[j]
        equations.b[i] += w * J[i] * r
        sums.wJ[line, i] += w * J[i]
    sums.wr[line] += w * r
    sums.w[line] += w


@njit(cache=True, error_model="numpy")
def _tukey_weight(squared: float) -> float:
    """Tukey's weight of a squared error in units of its variance."""
    rest = 1.0 - squared / (_TUKEY * _TUKEY)
    return rest * rest if rest > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def normal_equations(
    pose: Array,
    lines: Lines,
    found: Measurements,
    scene: Scene,
    rules: BorderRules,
    equations: Equations,
    jump_tolerance: float,
) -> tuple[float, float]:
    """Fills in the weighted normal equations of all errors, and the borders' weights.

    Returns the inliers' root mean squared residual [px] and the sum of their robust weights.
    """
    borders, jumps = found.borders, found.jumps
    least, edge_error = rules.border_error, rules.edge_error
    N, b = equations
    residuals, J = np.empty(len(borders)), np.empty((len(borders), 6))
    linearize(pose, lines, borders, scene, residuals, J)
    scale = max(least, 1.4826 * float(np.median(np.abs(residuals))))
    # The cut is robust; what remains within it tells the variance.
    total, weights, unit = 0.0, 0.0, 1.0 / (scale * scale)
    for k in range(len(borders)):
        weight = _tukey_weight(residuals[k] ** 2 * unit)
        borders[k].weight = weight
        total += weight * residuals[k] ** 2
        weights += weight
    spread = max(least**2, total / weights)
    sums = LineSums(np.zeros((len(lines), 6)), np.zeros(len(lines)), np.zeros(len(lines)))
    N[:], b[:] = 0.0, 0.0
    number, variance = -1, spread
    for k in range(len(borders)):  # line after line
        border = borders[k]
        if border.line != number:
            number, variance = border.line, spread
            line = lines[number]
            if abs(line.slope) < _STEEPEST:
                # Borders that round to the same pixel share the error of it: together they count
                # as one. In a steeper edge those errors follow each other too fast to matter.
                length = abs(line.last - line.first)
                same = min(length, 1.0 / max(abs(line.slope), 1e-9)) / found.spacing
                variance += found.aliasing / 12.0 * same
        border.weight /= variance
        _add(J[k], residuals[k], border.weight, equations, sums, number)
    residuals, J = np.empty(len(jumps)), np.empty((len(jumps), 6))
    linearize(pose, lines, jumps, scene, residuals, J)
    for k in range(len(jumps)):
        jump = jumps[k]
        line = lines[jump.line]
        jump.weight = 0.0
        if abs(line.slope) >= _STEEPEST:
            continue
        # It lies evenly spread over some rows, times how far the line moves in one.
        variance = (line.slope * jump.within) ** 2 / 12.0 + _JUMP_FLOOR**2
        squared = residuals[k] ** 2
        jump.weight = _tukey_weight(
            squared / (4.0 * (variance + edge_error**2) + jump_tolerance**2)
        )
        jump.weight /= variance
        _add(J[k], residuals[k], jump.weight, equations, sums, jump.line)
    # An error that all borders of a line share has the covariance D + edge_error^2 1 1^T, whose
    # inverse is (Sherman and Morrison) that of D less a matrix of rank one.
    for n in range(len(lines)):
        c = edge_error**2 / (1.0 + edge_error**2 * sums.w[n])
        for i in range(6):
            for j in range(i + 1):
                N[i, j] -= c * sums.wJ[n, i] * sums.wJ[n, j]
            b[i] -= c * sums.wJ[n, i] * sums.wr[n]
    fix_gauge(N, pose, scene.solid)
    return math.sqrt(spread), weights


@njit(cache=True, error_model="numpy")
def minimize(
    pose: Array,
    lines: Lines,
    found: Measurements,
    scene: Scene,
    rules: BorderRules,
    equations: Equations,
    L: Array,
    stopping: Stopping,
) -> Fit:
    """Steps until the pose hardly moves; before the final stage it need not converge."""
    solid, count = scene.solid, len(found.borders)
    outcome, inlier_ratio, residual = Outcome.CONVERGED, 0.0, np.nan
    for k in range(stopping.steps):
        residual, weights = normal_equations(
            pose, lines, found, scene, rules, equations, 0.1 * 0.25**k
        )
        inlier_ratio = weights / count
        if not factor(equations.N, L):
            outcome = Outcome.SINGULAR
            break
        step = solve(L, equations.b)
        advance = 0.0  # squared, in units of the covariance: x^T N x
        for i in range(6):
            advance += step[i] * equations.b[i]
        if k >= _DAMPED_FROM:  # Weights may swing between two poses; their middle is as good.
            step *= 0.5
            advance *= 0.25
        pose = move(pose, step)
        # Slopes set the weights, which must not change for ever.
        whole = move_lines(lines, pose, solid, scene.views, k < 3)
        if not (whole and math.isfinite(pose.sum())):
            outcome = Outcome.NOT_CONVERGED
            break
        outcome = Outcome.CONVERGED
        if stopping.final and not advance < 0.25:
            outcome = Outcome.NOT_CONVERGED
        near = stopping.aliased and advance < _NEARLY and k >= 1
        if (advance < _CONVERGED and k >= 2) or near:
            break
    return Fit(outcome, pose, inlier_ratio, residual)


@njit(cache=True, error_model="numpy")
def fix_gauge(N: Array, pose: Array, solid: Solid) -> None:
    """Adds to a normal matrix what fixes the turns about a solid's axes of symmetry."""
    if len(solid.symmetry_axes) == 0:
        return
    R_CM, turn = rotation(pose[3:]), np.empty(3)
    for axis in solid.symmetry_axes:
        turn[0], turn[1], turn[2] = rotated(R_CM, axis[0], axis[1], axis[2])
        for i in range(3):
            for j in range(i + 1):
                N[3 + i, 3 + j] += turn[i] * turn[j] / _GAUGE_STD**2


@njit(cache=True, error_model="numpy")
def linearize(
    pose: Array, lines: Lines, borders: Borders, scene: Scene, residuals: Array, J: Array
) -> None:
    """Fills in how far borders (or jumps) are from the lines, and how a `move` changes that."""
    n = len(borders)
    along, across, x, y = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    start = 0
    while start < n:
        number, stop = borders[start].line, start
        while stop < n and borders[stop].line == number:
            along[stop] = borders[stop].along
            stop += 1
        line, part = lines[number], slice(start, stop)
        eye = scene.views[line.camera].eye
        cross(eye, line, along[part], across[part], x[part], y[part])
        cross_jacobians(eye, line, x[part], y[part], pose, J[part])
        for k in range(start, stop):
            residuals[k] = borders[k].across - across[k]
        start = stop
