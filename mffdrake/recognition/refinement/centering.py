"""Compiled centering of a pose among all that round to the same borders (numba; import it late).

In an aliased image each row's border tells no more than between which two pixel centers the edge
passes: ``|border - crossing| <= 1/2`` px. Linear in a small `move`, all rows together leave a
polytope of poses that draw the very same image. Least squares need not end in its middle, above
all where edges run along the pixels' rows or columns and few rows differ. The analytic center does:
the move x that maximizes the product of the distances to all of the polytope's walls.

Only the first and the last row of a run at one pixel bind; the rows in between would merely weigh
on the center.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.fitness.structs import Scene
from mffdrake.recognition.poses.matrices import factor, invert, solve
from mffdrake.recognition.refinement.borders import BORDER, Borders
from mffdrake.recognition.refinement.edge_lines import Lines
from mffdrake.recognition.refinement.gauss_newton import fix_gauge, linearize

Array = NDArray[np.float64]

_LEAST_WALLS = 12  # twice the unknowns
HALF = 0.502  # [px] Half the distance of two walls, with a little room for curvature and noise
_LEAST_SLACK = 0.02  # of it, to begin with
_TO_WALL = 0.95  # So far toward the nearest wall leads a step at most.
_SHORTEST = 0.01  # A step of a smaller share means that there is no such pose.
_SETTLED = 0.02  # A step this short, in units of the barrier's own measure, is the last.
_STEPS = 25  # Where there is a center, it takes 3 to 10.


@njit(cache=True, error_model="numpy")
def find_walls(borders: Borders) -> Borders:
    """The first and the last row of every run at one pixel, with the border rounded to it."""
    n = len(borders)
    walls = np.empty(n, dtype=BORDER)
    count = 0
    for k in range(n):
        here = borders[k]
        if here.weight <= 0.0:
            continue
        pixel = math.floor(here.across)
        first, last = True, True
        if k > 0:
            before = borders[k - 1]
            first = not (
                before.line == here.line
                and here.along - before.along == 1.0
                and math.floor(before.across) == pixel
            )
        if k < n - 1:
            after = borders[k + 1]
            last = not (
                after.line == here.line
                and after.along - here.along == 1.0
                and math.floor(after.across) == pixel
            )
        if first or last:
            wall = walls[count]
            wall.line, wall.along, wall.across = here.line, here.along, pixel + 0.5
            wall.blended, wall.within, wall.weight = 0.0, 0.0, here.weight
            count += 1
    return walls[:count]


@njit(cache=True, error_model="numpy")
def center(pose: Array, lines: Lines, borders: Borders, scene: Scene) -> tuple[bool, Array, Array]:
    """The `move` from a pose to the analytic center of all that round to the same borders.

    With c a border's distance from its line, its slacks ``y = w - c`` and ``z = w + c`` are to have
    the greatest product. Newton's method from an infeasible start (Boyd and Vandenberghe, Convex
    Optimization, section 10.3): the slacks begin positive, whether or not a pose has them; each
    step leads toward the center and, as far as it is taken, makes them those of the pose.

    Returns:
        Whether there is such a center, the move, and its covariance, both shapes as in `refine`.
    """
    walls = find_walls(borders)
    n = len(walls)
    x, L, H = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6))
    if n < _LEAST_WALLS:
        return False, x, H
    residuals, J = np.empty(n), np.empty((n, 6))
    linearize(pose, lines, walls, scene, residuals, J)
    y, z = np.empty(n), np.empty(n)
    for k in range(n):
        y[k] = max(HALF - residuals[k], _LEAST_SLACK * HALF)
        z[k] = max(HALF + residuals[k], _LEAST_SLACK * HALF)
    gradient, along = np.empty(6), np.empty(n)
    missing = 1.0  # of what the slacks were off the pose's own at the start
    for _ in range(_STEPS):
        H[:], gradient[:] = 0.0, 0.0
        for k in range(n):
            one_y, one_z = 1.0 / y[k], 1.0 / z[k]
            off_y, off_z = HALF - residuals[k] - y[k], HALF + residuals[k] - z[k]
            curvature = one_y * one_y + one_z * one_z
            slope = one_y - off_y * one_y * one_y - one_z + off_z * one_z * one_z
            for i in range(6):
                gradient[i] += J[k, i] * slope
                for j in range(i + 1):
                    H[i, j] += J[k, i] * J[k, j] * curvature
        fix_gauge(H, pose, scene.solid)
        if not factor(H, L):
            break
        step = solve(L, gradient)
        decrement = 0.0
        for i in range(6):
            decrement += step[i] * gradient[i]
        share = 1.0
        for k in range(n):
            along[k] = 0.0
            for i in range(6):
                along[k] += J[k, i] * step[i]
            dy = HALF - residuals[k] + along[k] - y[k]
            dz = HALF + residuals[k] - along[k] - z[k]
            if share * dy < -_TO_WALL * y[k]:
                share = -_TO_WALL * y[k] / dy
            if share * dz < -_TO_WALL * z[k]:
                share = -_TO_WALL * z[k] / dz
        for k in range(n):
            y[k] += share * (HALF - residuals[k] + along[k] - y[k])
            z[k] += share * (HALF + residuals[k] - along[k] - z[k])
            residuals[k] -= share * along[k]
        x += share * step
        if share < _SHORTEST:
            break
        if missing == 0.0 and decrement < _SETTLED**2:
            return True, x, invert(L)
        missing *= 1.0 - share
    return False, x, H
