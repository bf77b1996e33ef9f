"""Compiled residuals of borders and their derivatives (numba; import it late).

Moves have six components: translation and rotation vector, both in the rig's frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.fitness.structs import Scene, Solid
from mffdrake.recognition.poses.rotations import rotated, rotation
from mffdrake.recognition.refinement.borders import Borders
from mffdrake.recognition.refinement.edge_lines import Lines, cross, cross_jacobians

Array = NDArray[np.float64]

_GAUGE_STD = 1e-3  # [rad] A turn that changes nothing is known as well as that.


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
