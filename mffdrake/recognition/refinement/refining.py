"""Compiled Gauss-Newton steps on color borders (numba). Import only where it runs.

`BorderRefiner` says what is estimated; here is how it is computed. Lines are those of `edge_lines`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.fitness.kernels import fitness_of_poses
from mffdrake.recognition.fitness.structs import Rules, Samples, Scene
from mffdrake.recognition.poses.matrices import factor, invert, product, solve
from mffdrake.recognition.poses.rotations import angle_between, move, scalar_part
from mffdrake.recognition.refinement.borders import (
    BorderRules,
    Borders,
    Stage,
    find_borders,
    find_jumps,
)
from mffdrake.recognition.refinement.centering import center
from mffdrake.recognition.refinement.edge_lines import Lines, edge_lines
from mffdrake.recognition.refinement.gauss_newton import (
    Equations,
    Measurements,
    Stopping,
    fix_gauge,
    linearize,
    minimize,
)
from mffdrake.recognition.refinement.outcome import Outcome

Array = NDArray[np.float64]


_LEAST_ALIASING = 0.1
_SMOOTHEST = 1.0 / 36.0  # the square of the rounding of six samples a pixel
_NEAR = 0.3  # of a window, and
_AGREED = 0.9  # of the weights: then borders are where they should be, and none is far off.
_ALIASED = 0.7  # From this aliasing on, the borders of an image are rounded to pixels.
_SPREAD = 2.0  # Covariance between the walls, in units of the inverse curvature: by experiment


class Result(NamedTuple):
    """How a refinement ended.

    Attributes:
        outcome: Whether it converged, or why not.
        pose: The pose vector, shape (6,).
        covariance: Of translation and rotation vector, both in the rig's frame, shape (6, 6).
        num_borders: Number of borders.
        num_jumps: Number of jumps.
        sought: Number of places where a border was sought.
        inlier_ratio: Mean robust weight of the borders, 0 to 1.
        residual: Root of the mean squared distance of the inliers [px].
        aliasing: Of the images, see `Refinement`.
        disagreement: See `_disagreement` [m].
    """

    outcome: Outcome
    pose: Array
    covariance: Array
    num_borders: int
    num_jumps: int
    sought: int
    inlier_ratio: float
    residual: float
    aliasing: float
    disagreement: float


class Change(NamedTuple):
    """What a refinement that converged has changed.

    Attributes:
        covariance: Of the pose vector's error, shape (6, 6).
        shift: How far it is from the pose that it started at [m].
        turn: How far it is turned against that [rad].
        fitness: Its fitness.
        before: That of the pose that it started at.
    """

    covariance: Array
    shift: float
    turn: float
    fitness: float
    before: float


class CalibrationSums(NamedTuple):
    """Of each line the sums of w J, w a (by u and by v) and w, see `_calibration_covariance`."""

    wJ: Array
    wa: Array
    w: Array


@njit(cache=True, error_model="numpy")
def _has_calibration_error(scene: Scene) -> bool:
    """Whether a camera's calibration is known to leave an error."""
    largest = 0.0
    for view in scene.views:
        largest = max(largest, view.eye.calibration_error)
    return largest > 0.0


@njit(cache=True, error_model="numpy")
def _calibration_covariance(
    pose: Array, lines: Lines, found: Measurements, scene: Scene, L: Array, edge_error: float
) -> Array:
    """What errors of the cameras' calibration add to the covariance, shape (6, 6).

    If all that a camera shows is off by (du, dv), the borders of a line with the slope m are off by
    ``a = du - m dv`` on rows; the least-squares pose then moves by ``N^-1 sum(w J a)``, less what
    the borders of an edge are weighted less for the error that they share.
    """
    added = np.zeros((6, 6))
    count = len(lines)
    sums = CalibrationSums(np.zeros((count, 6)), np.zeros((count, 2)), np.zeros(count))
    moved = np.zeros((len(scene.views), 2, 6))
    for marks in (found.borders, found.jumps):
        residuals, J = np.empty(len(marks)), np.empty((len(marks), 6))
        linearize(pose, lines, marks, scene, residuals, J)
        for k in range(len(marks)):
            mark = marks[k]
            line = lines[mark.line]
            v = line.camera
            by = (1.0, -line.slope) if line.rows else (-line.slope, 1.0)
            for i in range(6):
                sums.wJ[mark.line, i] += mark.weight * J[k, i]
            for axis in range(2):
                for i in range(6):
                    moved[v, axis, i] += mark.weight * J[k, i] * by[axis]
                sums.wa[mark.line, axis] += mark.weight * by[axis]
            sums.w[mark.line] += mark.weight
    for n in range(count):  # as in `normal_equations`
        c = edge_error**2 / (1.0 + edge_error**2 * sums.w[n])
        for axis in range(2):
            for i in range(6):
                moved[lines[n].camera, axis, i] -= c * sums.wJ[n, i] * sums.wa[n, axis]
    for v in range(len(scene.views)):
        for axis in range(2):
            step = scene.views[v].eye.calibration_error * solve(L, moved[v, axis])
            for i in range(6):
                for j in range(6):
                    added[i, j] += step[i] * step[j]
    return added


@njit(cache=True, error_model="numpy")
def _disagreement(pose: Array, lines: Lines, borders: Borders, scene: Scene) -> float:
    """How far one camera's borders alone would move the pose [m], beyond what chance explains.

    It is the greatest of all cameras; zero for a single one, and for one that sees too little.
    """
    largest, num_views = 0.0, len(scene.views)
    if num_views == 1:
        return largest
    residuals, J = np.empty(len(borders)), np.empty((len(borders), 6))
    linearize(pose, lines, borders, scene, residuals, J)
    L = np.zeros((6, 6))
    for view in range(num_views):
        N, b = np.zeros((6, 6)), np.zeros(6)
        for k in range(len(borders)):
            if lines[borders[k].line].camera == view:
                for i in range(6):
                    for j in range(i + 1):
                        N[i, j] += borders[k].weight * J[k, i] * J[k, j]
                    b[i] += borders[k].weight * J[k, i] * residuals[k]
        fix_gauge(N, pose, scene.solid)
        if not factor(N, L):
            continue
        step, C = solve(L, b), invert(L)
        moved = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        largest = max(largest, moved - 3.0 * math.sqrt(C[0, 0] + C[1, 1] + C[2, 2]))
    return largest


@njit(cache=True, error_model="numpy")
def _pose_covariance(pose: Array, C: Array) -> Array:
    """Covariance of a pose vector's error by that of translation and rotation vector."""
    e1, e2, e3 = pose[3:]
    eta = scalar_part(e1, e2, e3)
    A = np.eye(6)
    # deps = 1/2 (eta I - S(eps)) dtheta, Eq. (6)
    A[3, 3], A[3, 4], A[3, 5] = 0.5 * eta, 0.5 * e3, -0.5 * e2
    A[4, 3], A[4, 4], A[4, 5] = -0.5 * e3, 0.5 * eta, 0.5 * e1
    A[5, 3], A[5, 4], A[5, 5] = 0.5 * e2, -0.5 * e1, 0.5 * eta
    return product(product(A, C), A.T)  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def _compare(start: Array, result: Result, scene: Scene, samples: Samples, rules: Rules) -> Change:
    """What has changed since the start; nothing where the refinement did not converge."""
    if result.outcome != Outcome.CONVERGED:
        return Change(np.full((6, 6), np.nan), 0.0, 0.0, np.nan, np.nan)
    pose, both = result.pose, np.empty((2, 6))
    both[0], both[1] = pose, start
    fitness, before = fitness_of_poses(both, scene, samples, rules)
    return Change(
        _pose_covariance(pose, result.covariance),
        math.sqrt(((pose[:3] - start[:3]) ** 2).sum()),
        angle_between(pose[3:], start[3:]),
        fitness,
        before,
    )


@njit(cache=True, error_model="numpy")
def refine(
    start: Array,
    scene: Scene,
    samples: Samples,
    matching: Rules,
    rules: BorderRules,
    stages: tuple[Stage, ...],
) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Refines a pose, see `BorderRefiner.refine`.

    Returns the fields of a `Result` and those of a `Change`.
    """
    result = _without_fit(Outcome.NOT_CONVERGED, start, 0, 0)
    for index in range(len(stages)):
        stage, final = stages[index], index == len(stages) - 1
        # A narrower window would find the same borders again.
        near = result.residual < _NEAR * stage.window and result.inlier_ratio > _AGREED
        if near and not final:
            continue
        result = _refine_once(result.pose, scene, rules, stage, final)
        if result.outcome != Outcome.CONVERGED:
            break
    change = _compare(start, result, scene, samples, matching)
    return (
        (
            result.outcome.value, result.pose, result.covariance, result.num_borders,
            result.num_jumps, result.sought, result.inlier_ratio, result.residual,
            result.aliasing, result.disagreement,
        ),
        (change.covariance, change.shift, change.turn, change.fitness, change.before),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def approach(
    starts: Array, scene: Scene, rules: BorderRules, stages: tuple[Stage, ...]
) -> tuple[Array, NDArray[np.bool_]]:
    """Poses stepped toward the borders that are seen from further and further near.

    Returns the poses, shape (N, 6), and which of them found borders in every stage.
    """
    poses, arrived = starts.copy(), np.zeros(len(starts), dtype=np.bool_)
    for n in range(len(starts)):
        arrived[n] = True
        for stage in stages:
            result = _refine_once(poses[n], scene, rules, stage, False)
            if result.outcome != Outcome.CONVERGED:
                arrived[n] = False
                break
            poses[n] = result.pose
    return poses, arrived


@njit(cache=True, error_model="numpy")
def _without_fit(outcome: Outcome, pose: Array, num_borders: int, sought: int) -> Result:
    """What is known of a pose before any step."""
    return Result(outcome, pose, np.zeros((6, 6)), num_borders, 0, sought, 0.0, np.nan, np.nan, 0.0)


@njit(cache=True, error_model="numpy")
def _refine_once(
    start: Array, scene: Scene, rules: BorderRules, stage: Stage, final: bool
) -> Result:
    """Finds borders and steps; before the final stage it need not have converged."""
    pose, solid = start.copy(), scene.solid
    covariance, L = np.zeros((6, 6)), np.zeros((6, 6))
    equations = Equations(np.zeros((6, 6)), np.zeros(6))
    lines = edge_lines(pose, solid, scene.views)
    borders, sought_by_view = find_borders(pose, lines, scene, rules, stage)
    sought = sought_by_view.sum()
    count = len(borders)
    if count * stage.spacing < rules.min_borders:
        none = _without_fit(Outcome.TOO_FEW_BORDERS, pose, count, sought)
        return none  # type: ignore[no-any-return]
    # With b the covered share of the pixels that a border crosses, b (1 - b) is zero in an aliased
    # image and 1/6 on average where every share occurs; rounding to steps of q makes it
    # (1 - q^2) / 6, so this is q^2.
    blended = 0.0
    for k in range(count):
        blended += borders[k].blended
    aliasing = min(1.0, max(_SMOOTHEST, 1.0 - 6.0 * blended / count))
    jumps = borders[:0]
    if final and stage.spacing == 1 and aliasing > _LEAST_ALIASING:
        jumps = find_jumps(borders, lines)
    found = Measurements(borders, jumps, stage.spacing, aliasing)
    aliased = final and stage.spacing == 1 and aliasing > _ALIASED  # Then `center` does the rest.
    stopping = Stopping(stage.steps, final, aliased)
    fit = minimize(pose, lines, found, scene, rules, equations, L, stopping)
    if fit.outcome == Outcome.NOT_CONVERGED and len(jumps) > 0:
        # In an image that blends them in part, not all that looks like jumps is one.
        found = Measurements(borders, jumps[:0], stage.spacing, aliasing)
        fit = minimize(pose, lines, found, scene, rules, equations, L, stopping)
    pose, disagreement = fit.pose, 0.0
    if fit.outcome == Outcome.CONVERGED and final:
        disagreement = _disagreement(pose, lines, borders, scene)
        covariance = invert(L)
        if aliased:
            centered, step, spread = center(pose, lines, borders, scene)
            if centered:
                pose = move(pose, step)
                covariance[:] = _SPREAD * spread
        if _has_calibration_error(scene):
            covariance += _calibration_covariance(pose, lines, found, scene, L, rules.edge_error)
    return Result(
        fit.outcome, pose, covariance, count, len(found.jumps), sought,
        fit.inlier_ratio, fit.residual, aliasing, disagreement,
    )  # fmt: skip
