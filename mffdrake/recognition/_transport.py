"""Compiled transport of pose vectors (numba). Import only where it runs: numba loads slowly."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def transport(poses: Array, R_DC: Array, p_DC: Array, q_DC: Array) -> Array:
    """Pose vectors (N, 6) in C as seen from D, see `transport_pose`.

    ``q_DC`` is the vector part of R_DC's quaternion.
    """
    a0 = math.sqrt(max(0.0, 1.0 - q_DC[0] ** 2 - q_DC[1] ** 2 - q_DC[2] ** 2))
    a1, a2, a3 = q_DC
    moved = np.empty(poses.shape)
    for n in range(len(poses)):
        x, y, z, b1, b2, b3 = poses[n]
        b0 = math.sqrt(max(0.0, 1.0 - b1 * b1 - b2 * b2 - b3 * b3))
        for i in range(3):
            moved[n, i] = R_DC[i, 0] * x + R_DC[i, 1] * y + R_DC[i, 2] * z + p_DC[i]
        # Product of the quaternions, with the sign that makes the scalar part positive
        sign = -1.0 if a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3 < 0.0 else 1.0
        moved[n, 3] = sign * (a0 * b1 + b0 * a1 + a2 * b3 - a3 * b2)
        moved[n, 4] = sign * (a0 * b2 + b0 * a2 + a3 * b1 - a1 * b3)
        moved[n, 5] = sign * (a0 * b3 + b0 * a3 + a1 * b2 - a2 * b1)
    return moved
