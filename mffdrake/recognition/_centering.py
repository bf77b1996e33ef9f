"""Compiled centering of a pose among all that round to the same borders (numba; import it late).

In a hard image each row's border tells no more than between which two pixel centers the edge
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

from mffdrake.recognition._borders import BORDER, Borders
from mffdrake.recognition._edge_lines import Lines
from mffdrake.recognition._linear import compare, factor, invert, solve
from mffdrake.recognition._structs import Scene

Array = NDArray[np.float64]

_LEAST_WALLS = 12  # twice the unknowns
_HALF = 0.502  # [px] Half the distance of two walls, with a little room for curvature and noise
_POWER = 10  # of the distances, whose sum is least where the greatest one nearly is
_POWER_STEPS = 25
_CLOSELY = 1.002  # After those, walls too far apart close in on the row that is farthest off.
_SETTLED = 0.02  # A step this short, in units of the barrier's own measure, is the last.
_STEPS = 70


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
                before.slot == here.slot
                and here.along - before.along == 1.0
                and math.floor(before.across) == pixel
            )
        if k < n - 1:
            after = borders[k + 1]
            last = not (
                after.slot == here.slot
                and after.along - here.along == 1.0
                and math.floor(after.across) == pixel
            )
        if first or last:
            wall = walls[count]
            wall.slot, wall.along, wall.across = here.slot, here.along, pixel + 0.5
            wall.blended, wall.within, wall.weight = 0.0, 0.0, here.weight
            count += 1
    return walls[:count]


@njit(cache=True, error_model="numpy")
def center(pose: Array, lines: Lines, borders: Borders, scene: Scene) -> tuple[bool, Array, Array]:
    """The `move` from a pose to the analytic center of all that round to the same borders.

    Newton steps on the sum of a high power of the distances c of the borders from the lines bring
    (nearly) all within the walls; then damped ones on ``-sum(log(w - c) + log(w + c))`` lead to
    their middle, where w is 1/2 as soon as all are within.

    Returns:
        Whether there is such a center, the move, and its covariance, both shapes as in `refine`.
    """
    walls = find_walls(borders)
    n = len(walls)
    x, L, H = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6))
    if n < _LEAST_WALLS:
        return False, x, H
    residuals, J = np.empty(n), np.empty((n, 6))
    compare(pose, lines, walls, scene, residuals, J)
    gradient = np.empty(6)
    settled = False
    for count in range(_STEPS):
        widest = 0.0
        for k in range(n):
            widest = max(widest, abs(residuals[k]))
        width = max(_HALF, _CLOSELY * widest)
        power = width > _HALF and count < _POWER_STEPS
        H[:], gradient[:] = 0.0, 0.0
        for k in range(n):
            if power:
                curvature = (residuals[k] / widest) ** (_POWER - 2)
                slope = curvature * residuals[k] / (_POWER - 1)
            else:
                above, below = 1.0 / (width - residuals[k]), 1.0 / (width + residuals[k])
                slope, curvature = above - below, above * above + below * below
            for i in range(6):
                gradient[i] -= J[k, i] * slope
                for j in range(i + 1):
                    H[i, j] += J[k, i] * J[k, j] * curvature
        if not factor(H, L):
            return False, x, H
        step = solve(L, gradient)
        share = 1.0
        if not power:
            decrement = 0.0
            for i in range(6):
                decrement += step[i] * gradient[i]
            decrement = math.sqrt(max(0.0, decrement))
            settled = decrement < _SETTLED and width == _HALF
            share = 1.0 / (1.0 + decrement)  # never beyond a wall
        for i in range(6):
            x[i] -= share * step[i]
            for k in range(n):
                residuals[k] += share * step[i] * J[k, i]
        if settled:
            break
    return settled, x, invert(L)
