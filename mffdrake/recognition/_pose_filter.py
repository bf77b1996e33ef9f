"""The compiled steps of the filter on poses (numba). Import only where it runs: it loads slowly.

`PoseFilter` says what is estimated; here is how it is computed. Errors are those of position,
orientation, linear and angular velocity, seen from the target.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition._edge_lines import rotation
from mffdrake.recognition._linear import factor, solve
from mffdrake.recognition._looks import multiply

Array = NDArray[np.float64]

_HALF_TURN = 1e-6  # A quaternion's scalar part up to which rounding hides the angle's covariance


@njit(cache=True, error_model="numpy")
def _product(A: Array, B: Array) -> Array:
    """A B (numba's own needs SciPy)."""
    rows, inner, columns = A.shape[0], A.shape[1], B.shape[1]
    C = np.zeros((rows, columns))
    for i in range(rows):
        for k in range(inner):
            a = A[i, k]
            if a != 0.0:
                for j in range(columns):
                    C[i, j] += a * B[k, j]
    return C


@njit(cache=True, error_model="numpy")
def _skew(v: Array) -> Array:
    """S(v), with S(v) x = v x x."""
    S = np.zeros((3, 3))
    S[0, 1], S[0, 2], S[1, 2] = -v[2], v[1], -v[0]
    S[1, 0], S[2, 0], S[2, 1] = v[2], -v[1], v[0]
    return S


@njit(cache=True, error_model="numpy")
def scalar_part(eps: Array) -> float:
    """A quaternion's scalar part, not negative."""
    return math.sqrt(max(0.0, 1.0 - eps[0] ** 2 - eps[1] ** 2 - eps[2] ** 2))


@njit(cache=True, error_model="numpy")
def quaternion_exp(v: Array) -> Array:
    """Quaternion of a rotation vector [rad], the scalar part first, shape (4,)."""
    angle = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    share = 0.5 * math.sin(0.5 * angle) / (0.5 * angle) if angle > 1e-9 else 0.5
    q = np.empty(4)
    q[0], q[1], q[2], q[3] = math.cos(0.5 * angle), share * v[0], share * v[1], share * v[2]
    return q


@njit(cache=True, error_model="numpy")
def _matrix(q: Array) -> Array:
    """Rotation matrix of a quaternion, shape (3, 3)."""
    return rotation(-q[1:] if q[0] < 0.0 else q[1:].copy())  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def rotation_log(q: Array) -> Array:
    """Rotation vector [rad] of a quaternion, the short way, shape (3,)."""
    sine = math.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    share = 2.0 * math.atan2(sine, abs(q[0])) / sine if sine > 0.0 else 2.0
    if q[0] < 0.0:
        share = -share
    return share * q[1:]


@njit(cache=True, error_model="numpy")
def _quaternion(eps: Array, sign: float) -> Array:
    """Quaternion of an orientation (sign 1) or of its inverse (-1), the scalar part first."""
    q = np.empty(4)
    q[0] = scalar_part(eps)
    q[1:] = sign * eps
    return q


@njit(cache=True, error_model="numpy")
def right_jacobian(v: Array, sign: float) -> Array:
    """The J with ``exp(v + d) = exp(v) exp(J d)`` for small d (sign 1), or its inverse (-1)."""
    S, J = _skew(v), np.eye(3)
    square = v[0] ** 2 + v[1] ** 2 + v[2] ** 2
    angle = math.sqrt(square)
    if sign > 0.0:
        first, second = -0.5, 1.0 / 6.0
        if square >= 1e-6:
            first = -(1.0 - math.cos(angle)) / square
            second = (1.0 - math.sin(angle) / angle) / square
    else:
        first, second = 0.5, 1.0 / 12.0
        if square >= 1e-6:
            half = 0.5 * angle
            second = (1.0 - half * math.cos(half) / math.sin(half)) / square
    T = _product(S, S)
    for i in range(3):
        for j in range(3):
            J[i, j] += first * S[i, j] + second * T[i, j]
    return J


@njit(cache=True, error_model="numpy")
def body_covariance(pose: Array, covariance: Array) -> Array:
    """See `pose_filter.body_covariance`."""
    eps = pose[3:]
    eta, R, S = scalar_part(eps), rotation(eps), _skew(eps)
    A = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            A[i, j] = R[j, i]
            # deps = 1/2 (eta I + S(eps)) dtheta, Eq. (6) as seen from the target, for dtheta
            A[3 + i, 3 + j] = -2.0 * S[i, j]
            if eta > _HALF_TURN:
                A[3 + i, 3 + j] += 2.0 / eta * eps[i] * eps[j]
        A[3 + i, 3 + i] += 2.0 * eta
    P = _product(_product(A, covariance), A.T)
    if eta <= _HALF_TURN:
        mean = 0.5 * (P[3, 3] + P[4, 4] + P[5, 5])
        for i in range(3):
            for j in range(3):
                P[3 + i, 3 + j] += mean * eps[i] * eps[j]
    return P  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def predict(
    pose: Array, twist: Array, P: Array, dt: float, densities: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """Pose, twist and covariance a time later; ``densities`` are those of the accelerations."""
    v, w = twist[:3], twist[3:]
    turn = quaternion_exp(w * dt)
    E = _matrix(turn)
    later_twist, later_pose = twist.copy(), pose.copy()
    R = rotation(pose[3:])
    for i in range(3):
        later_twist[i] = E[0, i] * v[0] + E[1, i] * v[1] + E[2, i] * v[2]
        later_pose[i] += dt * (R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2])
    later_pose[3:] = multiply(_quaternion(pose[3:], 1.0), turn)[1:]
    seen_turned = _product(E.T.copy(), _skew(v))
    rate_turns = dt * right_jacobian(w * dt, 1.0)  # how an error of w turns it
    S = _skew(later_twist[:3])
    F, Q = np.zeros((12, 12)), np.zeros((12, 12))
    swept = _product(S, rate_turns)
    for i in range(3):
        for j in range(3):
            F[i, j] = F[3 + i, 3 + j] = F[6 + i, 6 + j] = E[j, i]
            F[i, 3 + j] = -dt * seen_turned[i, j]
            F[i, 6 + j] = dt * E[j, i]
            F[3 + i, 9 + j] = rate_turns[i, j]
            F[6 + i, 9 + j] = swept[i, j]
        F[9 + i, 9 + i] = 1.0
    for i in range(6):
        q = densities[0 if i < 3 else 1] ** 2
        Q[i, i] = q * dt**3 / 3.0
        Q[i, 6 + i] = Q[6 + i, i] = q * dt**2 / 2.0
        Q[6 + i, 6 + i] = q * dt
    # Where it has turned otherwise, the same velocity is seen from it otherwise.
    turned = _product(S, Q[3:6])
    for i in range(3):
        for j in range(12):
            Q[6 + i, j] += turned[i, j]
            Q[j, 6 + i] += turned[i, j]
    both = _product(turned[:, 3:6].copy(), S.T.copy())
    Q[6:9, 6:9] += both
    return later_pose, later_twist, _product(_product(F, P), F.T.copy()) + Q


@njit(cache=True, error_model="numpy")
def update(
    pose: Array, twist: Array, P: Array, seen: Array, covariance: Array
) -> tuple[Array, Array, Array, float]:
    """Pose, twist and covariance with a measurement, and a sixth of the surprise's square."""
    R = rotation(pose[3:])
    away = np.empty(6)
    # The turn from where it was expected to where it was seen, seen from the former
    between = multiply(_quaternion(pose[3:], -1.0), _quaternion(seen[3:], 1.0))
    for i in range(3):
        away[i] = 0.0
        for j in range(3):
            away[i] += R[j, i] * (seen[j] - pose[j])
    away[3:] = rotation_log(between)
    # The measurement's error, from where it was seen to where it was expected
    D = np.zeros((6, 6))
    D[:3, :3] = _matrix(between)
    D[3:, 3:] = right_jacobian(away[3:], -1.0)
    N = _product(_product(D, body_covariance(seen, covariance)), D.T.copy())
    S, L = P[:6, :6] + N, np.zeros((6, 6))
    if not factor(S, L):
        return pose, twist, P, np.inf
    K = np.empty((12, 6))  # P H^T S^-1
    for i in range(12):
        K[i] = solve(L, P[i, :6].copy())
    change = np.zeros(12)
    for i in range(12):
        for j in range(6):
            change[i] += K[i, j] * away[j]
    turn = quaternion_exp(change[3:6])
    # What is left of the error, seen from the target as it has been turned
    G = np.eye(12)
    G[:3, :3] = _matrix(turn).T
    G[3:6, 3:6] = right_jacobian(change[3:6], 1.0)
    M = _product(G, K)
    A = G.copy()
    A[:, :6] -= M
    # Joseph's form: positive whatever is rounded
    left = _product(_product(A, P), A.T.copy()) + _product(_product(M, N), M.T.copy())
    new_pose, new_twist = pose.copy(), twist + change[6:]
    for i in range(3):
        for j in range(3):
            new_pose[i] += R[i, j] * change[j]
    new_pose[3:] = multiply(_quaternion(pose[3:], 1.0), turn)[1:]
    rest, squared = solve(L, away), 0.0
    for i in range(6):
        squared += away[i] * rest[i]
    return new_pose, new_twist, 0.5 * (left + left.T), squared / 6.0
