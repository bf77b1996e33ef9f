"""Compiled rotations, moves and transport of pose vectors (numba). Import only where it runs."""

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


@njit(cache=True, error_model="numpy")
def rotation(eps: Array) -> Array:
    """Rotation matrix of a quaternion's vector part, shape (3, 3)."""
    e1, e2, e3 = eps[0], eps[1], eps[2]
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
    """A pose moved by a translation and a rotation vector, both in the rig's frame, shape (6,).

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
def multiply(a: Array, b: Array) -> Array:
    """Product of quaternions with the scalar part first; its scalar part is made positive."""
    q = np.empty(4)
    q[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    q[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    q[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    q[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    return -q if q[0] < 0.0 else q
