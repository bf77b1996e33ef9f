"""Compiled transport of pose vectors (numba). Import only where it runs: numba loads slowly."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition._edge_lines import rotation
from mffdrake.recognition._looks import multiply

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


@njit(cache=True, error_model="numpy")
def transport_along(poses: Array, now: Array, later: Array) -> Array:
    """Pose vectors (N, 6), moved as a body is whose pose ``now`` becomes ``later``."""
    before, after = np.empty(4), np.empty(4)
    before[1:], after[1:] = -now[3:], later[3:]
    for q in (before, after):
        q[0] = math.sqrt(max(0.0, 1.0 - q[1] ** 2 - q[2] ** 2 - q[3] ** 2))
    turn = multiply(after, before)
    R = rotation(turn[1:])
    p = later[:3].copy()
    for i in range(3):
        p[i] -= R[i, 0] * now[0] + R[i, 1] * now[1] + R[i, 2] * now[2]
    return transport(poses, R, p, turn[1:])  # type: ignore[no-any-return]
