"""Compiled rotations, moves and transport of pose vectors (numba). Import only where it runs."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triple: TypeAlias = tuple[float, float, float]


@njit(cache=True, error_model="numpy")
def scalar_part(e1: float, e2: float, e3: float) -> float:
    """A unit quaternion's scalar part by its vector part; not negative."""
    return math.sqrt(max(0.0, 1.0 - e1 * e1 - e2 * e2 - e3 * e3))


@njit(cache=True, error_model="numpy")
def rotated(R: Array, x: float, y: float, z: float) -> Triple:
    """A vector, rotated: R (x, y, z)."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@njit(cache=True, error_model="numpy")
def cross_product(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Triple:
    """A x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, error_model="numpy")
def _product(
    a0: float, a1: float, a2: float, a3: float, b0: float, b1: float, b2: float, b3: float
) -> tuple[float, float, float, float]:
    """Product of two quaternions, scalar parts first, of numbers."""
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + b0 * a1 + a2 * b3 - a3 * b2,
        a0 * b2 + b0 * a2 + a3 * b1 - a1 * b3,
        a0 * b3 + b0 * a3 + a1 * b2 - a2 * b1,
    )


@njit(cache=True, error_model="numpy")
def transport(poses: Array, R_DC: Array, p_DC: Array, q_DC: Array) -> Array:
    """Pose vectors (N, 6) in C as seen from D, see `transport_pose`.

    ``q_DC`` is the vector part of R_DC's quaternion.
    """
    a1, a2, a3 = q_DC
    a0 = scalar_part(a1, a2, a3)
    moved = np.empty(poses.shape)
    for n in range(len(poses)):
        x, y, z, b1, b2, b3 = poses[n]
        x, y, z = rotated(R_DC, x, y, z)
        moved[n, 0], moved[n, 1], moved[n, 2] = x + p_DC[0], y + p_DC[1], z + p_DC[2]
        q0, q1, q2, q3 = _product(a0, a1, a2, a3, scalar_part(b1, b2, b3), b1, b2, b3)
        sign = -1.0 if q0 < 0.0 else 1.0  # makes the scalar part positive
        moved[n, 3], moved[n, 4], moved[n, 5] = sign * q1, sign * q2, sign * q3
    return moved


@njit(cache=True, error_model="numpy")
def transport_by(poses: Array, R_DC: Array, p_DC: Array) -> Array:
    """The same, of a rotation matrix alone."""
    return transport(poses, R_DC, p_DC, quaternion_of(R_DC)[1:])  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def composed(pose: Array, other: Array) -> Array:
    """X_AC of the pose vectors of X_AB and X_BC, shape (6,)."""
    R = rotation(pose[3:])
    return transport(other.reshape(1, 6), R, pose[:3], pose[3:])[0]  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def seen_from(pose: Array, other: Array) -> Array:
    """X_BC of the pose vectors of X_AB and X_AC, shape (6,)."""
    apart, back = other.copy().reshape(1, 6), rotation(-pose[3:])
    apart[0, :3] -= pose[:3]
    return transport(apart, back, np.zeros(3), -pose[3:])[0]  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def quaternion_of(R: Array) -> Array:
    """The quaternion with a positive scalar part of a rotation matrix, as `quaternion_vector`."""
    xx, yy, zz = R[0, 0], R[1, 1], R[2, 2]
    a, b, c = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    d, e, f = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    q = np.array([xx + yy + zz + 1.0, xx - yy - zz + 1.0, -xx + yy - zz + 1.0, -xx - yy + zz + 1.0])
    best = np.argmax(q)
    if best == 0:
        q[1], q[2], q[3] = a, b, c
    elif best == 1:
        q[0], q[2], q[3] = a, d, e
    elif best == 2:
        q[0], q[1], q[3] = b, d, f
    else:
        q[0], q[1], q[2] = c, e, f
    norm = math.sqrt((q[0] * q[0] + q[2] * q[2]) + (q[1] * q[1] + q[3] * q[3]))
    return q / math.copysign(norm, q[0])


@njit(cache=True, error_model="numpy")
def transport_along(poses: Array, now: Array, later: Array) -> Array:
    """Pose vectors (N, 6), moved as a body is whose pose ``now`` becomes ``later``."""
    before, after = np.empty(4), np.empty(4)
    before[1:], after[1:] = -now[3:], later[3:]
    for q in (before, after):
        q[0] = scalar_part(q[1], q[2], q[3])
    turn = multiply(after, before)
    R = rotation(turn[1:])
    p = later[:3].copy()
    x, y, z = rotated(R, now[0], now[1], now[2])
    p[0], p[1], p[2] = p[0] - x, p[1] - y, p[2] - z
    return transport(poses, R, p, turn[1:])  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def rotation(eps: Array) -> Array:
    """Rotation matrix of a quaternion's vector part, shape (3, 3)."""
    e1, e2, e3 = eps[0], eps[1], eps[2]
    eta = scalar_part(e1, e2, e3)
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
def angle_between(eps: Array, other: Array) -> float:
    """Angle [rad] between two quaternions' vector parts, in [0, pi], as `rotation_angle`."""
    a1, a2, a3 = eps
    b1, b2, b3 = other
    a0, b0 = scalar_part(a1, a2, a3), scalar_part(b1, b2, b3)
    less = (a0 - b0) ** 2 + (a1 - b1) ** 2 + (a2 - b2) ** 2 + (a3 - b3) ** 2
    more = (a0 + b0) ** 2 + (a1 + b1) ** 2 + (a2 + b2) ** 2 + (a3 + b3) ** 2
    return 4.0 * math.atan2(math.sqrt(min(less, more)), math.sqrt(max(less, more)))


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
    q0, q1, q2, q3 = _product(d0, d1, d2, d3, scalar_part(e1, e2, e3), e1, e2, e3)
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
