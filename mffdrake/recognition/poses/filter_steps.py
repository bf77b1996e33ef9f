"""The compiled steps of the filter on poses (numba). Import only where it runs: it loads slowly.

`PoseFilter` says what is estimated; here is how it is computed. Errors are those of position,
orientation, linear and angular velocity, and perhaps their rates, seen from the target.

An error has *orders* of six numbers each, three linear and three angular ones: order 0 is the pose,
1 the velocity, 2 the acceleration; behind them stand the linear and the angular stiffness. A motion
has the same without the pose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.poses.matrices import factor, product, solve
from mffdrake.recognition.poses.rotations import multiply, rotation, scalar_part

Array = NDArray[np.float64]

_HALF_TURN = 1e-6  # A quaternion's scalar part up to which rounding hides the angle's covariance


ORDER = 6  # numbers of an order
STIFFNESS = 18  # the first of the two, in an error
MOTION_STIFFNESS = STIFFNESS - ORDER  # and in a motion


@njit(cache=True, error_model="numpy")
def _linear(order: int) -> slice:
    """Where the linear numbers of an order are."""
    return slice(ORDER * order, ORDER * order + 3)


@njit(cache=True, error_model="numpy")
def _angular(order: int) -> slice:
    """Where the angular numbers of an order are."""
    return slice(ORDER * order + 3, ORDER * order + 6)


@njit(cache=True, error_model="numpy")
def _applied(A: Array, x: Array) -> Array:
    """A x."""
    y = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            y[i] += A[i, j] * x[j]
    return y


@njit(cache=True, error_model="numpy")
def _skew(v: Array) -> Array:
    """S(v), with S(v) x = v x x."""
    S = np.zeros((3, 3))
    S[0, 1], S[0, 2], S[1, 2] = -v[2], v[1], -v[0]
    S[1, 0], S[2, 0], S[2, 1] = v[2], -v[1], v[0]
    return S


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
    q[0] = scalar_part(eps[0], eps[1], eps[2])
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
    T = product(S, S)
    for i in range(3):
        for j in range(3):
            J[i, j] += first * S[i, j] + second * T[i, j]
    return J


@njit(cache=True, error_model="numpy")
def body_covariance(pose: Array, covariance: Array) -> Array:
    """See `pose_filter.body_covariance`."""
    eps = pose[3:]
    eta, R, S = scalar_part(eps[0], eps[1], eps[2]), rotation(eps), _skew(eps)
    A = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            A[i, j] = R[j, i]
            # deps = 1/2 (eta I + S(eps)) dtheta, Eq. (6) as seen from the target, for dtheta
            A[3 + i, 3 + j] = -2.0 * S[i, j]
            if eta > _HALF_TURN:
                A[3 + i, 3 + j] += 2.0 / eta * eps[i] * eps[j]
        A[3 + i, 3 + i] += 2.0 * eta
    P = product(product(A, covariance), A.T)
    if eta <= _HALF_TURN:
        mean = 0.5 * (P[3, 3] + P[4, 4] + P[5, 5])
        for i in range(3):
            for j in range(3):
                P[3 + i, 3 + j] += mean * eps[i] * eps[j]
    return P  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def _exponential(A: Array) -> Array:
    """The matrix exponential of a small matrix, by its power series of A / 2^k, squared k times."""
    size, halvings = np.abs(A).max(), 0
    while size > 0.25:
        size, halvings = 0.5 * size, halvings + 1
    term, k = np.eye(len(A)), 0
    power, total = 0.5**halvings * A, term.copy()
    while np.abs(term).max() > 1e-18:
        k += 1
        term = product(term, power) / k
        total += term
    for _ in range(halvings):
        total = product(total, total)
    return total


@njit(cache=True, error_model="numpy")
def transition(dt: float, lasting: float, stiffness: float) -> tuple[Array, Array, Array]:
    """How place p, velocity v and acceleration a go on, each of shape (3, 3).

    ``p' = v, v' = a, a' = -stiffness v - a / lasting`` and white noise of density 1; or, where
    accelerations do not last, that noise is the acceleration.

    Returns:
        The transition, its derivative by the stiffness, and the noise's covariance.
    """
    A, white = np.zeros((3, 3)), 1
    A[0, 1] = 1.0
    if lasting > 0.0:
        A[1, 2], A[2, 1], A[2, 2], white = 1.0, -stiffness, -1.0 / lasting, 2
    # Van Loan (1978): exp [[A, B], [0, D]] has the integral of exp(A s) B exp(D (t - s)).
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = A, A
    both[2, 4] = -1.0
    moved = _exponential(dt * both)
    M = moved[:3, :3].copy()
    both[:3, 3:], both[3:, 3:] = 0.0, -A.T
    both[white, 3 + white] = 1.0
    Q = product(_exponential(dt * both)[:3, 3:].copy(), M.T.copy())
    return M, moved[:3, 3:].copy(), 0.5 * (Q + Q.T)


@njit(cache=True, error_model="numpy")
def predict(
    pose: Array,
    motion: Array,
    P: Array,
    dt: float,
    lasting: float,
    densities: tuple[float, float],
    learned: tuple[float, float],
) -> tuple[Array, Array, Array]:
    """Pose, motion and covariance a time later.

    The motion is the twist and, where accelerations last, their six numbers and the two stiffnesses
    of the linear and of the angular motion. ``densities`` are those of the white noise, ``learned``
    the share of the stiffnesses that is left after that time, and their variance for good.
    """
    n, orders = len(P), 2 if lasting > 0.0 else 1
    M, dM, noise = np.zeros((2, 3, 3)), np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    # Ways, velocities and accelerations later, and their derivatives by the stiffness
    gone, stiffer = np.zeros((3, 6)), np.zeros((3, 6))
    for part in range(2):  # the linear motion, and the angular one
        stiffness = motion[MOTION_STIFFNESS + part] if orders == 2 else 0.0
        M[part], dM[part], noise[part] = transition(dt, lasting, stiffness)
        for r in range(3):
            for q in range(orders):
                for i in range(3 * part, 3 * part + 3):
                    gone[r, i] += M[part, r, 1 + q] * motion[ORDER * q + i]
                    stiffer[r, i] += dM[part, r, 1 + q] * motion[ORDER * q + i]
    way, turn = gone[0, :3], quaternion_exp(gone[0, 3:])
    E = _matrix(turn)
    back, straight = E.T.copy(), np.eye(3)
    turns = right_jacobian(gone[0, 3:], 1.0)  # how an error of the turn's vector turns it
    later_pose, later = pose.copy(), np.zeros(len(motion))
    later_pose[:3] += _applied(rotation(pose[3:]), way)
    later_pose[3:] = multiply(_quaternion(pose[3:], 1.0), turn)[1:]
    for q in range(orders):
        later[_linear(q)] = _applied(back, gone[1 + q, :3])
        later[_angular(q)] = gone[1 + q, 3:]

    F, Q = np.zeros((n, n)), np.zeros((n, n))
    F[_linear(0), _linear(0)], F[_angular(0), _angular(0)] = back, back
    F[_linear(0), _angular(0)] = -product(back, _skew(way))
    for r in range(1 + orders):
        along = turns if r == 0 else straight
        for q in range(orders):
            F[_linear(r), _linear(1 + q)] = M[0, r, 1 + q] * back
            F[_angular(r), _angular(1 + q)] = M[1, r, 1 + q] * along
        if orders == 2:
            F[_linear(r), STIFFNESS] = _applied(back, stiffer[r, :3])
            F[_angular(r), STIFFNESS + 1] = _applied(along, stiffer[r, 3:])
    for r in range(1 + orders):
        for q in range(1 + orders):
            for i in range(6):
                part = i // 3
                Q[ORDER * r + i, ORDER * q + i] = densities[part] ** 2 * noise[part, r, q]
    if orders == 2:
        for k in range(2):
            m, e = MOTION_STIFFNESS + k, STIFFNESS + k
            later[m] = learned[0] * motion[m]
            F[e, e] = learned[0]
            Q[e, e] = (1.0 - learned[0] ** 2) * learned[1]
    # Where it has turned otherwise, the same vectors are seen from it otherwise.
    seen = np.zeros((n, 3))
    for q in range(orders):
        seen[_linear(1 + q)] = _skew(later[_linear(q)])
    F[:, ORDER:] += product(seen, F[_angular(0), ORDER:].copy())
    Q += product(seen, Q[_angular(0)].copy())
    Q += product(Q[:, _angular(0)].copy(), seen.T.copy())
    return later_pose, later, product(product(F, P), F.T.copy()) + Q


class Updated(NamedTuple):
    """A filter after a measurement.

    Attributes:
        pose: As of a `PoseFilter`.
        motion: As of a `PoseFilter`.
        covariance: As of a `PoseFilter`.
        innovation: As of a `PoseFilter`.
        nis: As of a `PoseFilter`.
        correlation: The innovation's product with the last one in units of its covariance S, by
            its six degrees of freedom.
    """

    pose: Array
    motion: Array
    covariance: Array
    innovation: Array
    nis: float
    correlation: float


@njit(cache=True, error_model="numpy")
def update(
    pose: Array, motion: Array, P: Array, measured: Array, covariance: Array, last: Array
) -> tuple[Array, Array, Array, Array, float, float]:
    """The filter with a measurement; ``last`` is the innovation of the one before.

    Returns the fields of `Updated`.
    """
    n = len(P)
    R = rotation(pose[3:])
    innovation = np.empty(6)
    # The turn from where it was expected to where it was measured, seen from the former
    between = multiply(_quaternion(pose[3:], -1.0), _quaternion(measured[3:], 1.0))
    for i in range(3):
        innovation[i] = 0.0
        for j in range(3):
            innovation[i] += R[j, i] * (measured[j] - pose[j])
    innovation[3:] = rotation_log(between)
    # The measurement's error, seen from where it was expected
    D = np.zeros((6, 6))
    D[_linear(0), _linear(0)] = _matrix(between)
    D[_angular(0), _angular(0)] = right_jacobian(innovation[3:], -1.0)
    N = product(product(D, body_covariance(measured, covariance)), D.T.copy())
    S, L = P[:ORDER, :ORDER] + N, np.zeros((6, 6))
    if not factor(S, L):
        return pose, motion, P, innovation, np.inf, 0.0
    K = np.empty((n, 6))  # P H^T S^-1
    for i in range(n):
        K[i] = solve(L, P[i, :ORDER].copy())
    correction = np.zeros(n)
    for i in range(n):
        for j in range(6):
            correction[i] += K[i, j] * innovation[j]
    turn = quaternion_exp(correction[_angular(0)])
    # What is left of the error, seen from the target as it has been turned
    G = np.eye(n)
    G[_linear(0), _linear(0)] = _matrix(turn).T
    G[_angular(0), _angular(0)] = right_jacobian(correction[_angular(0)], 1.0)
    M = product(G, K)
    A = G.copy()
    A[:, :ORDER] -= M
    # Joseph's form: positive whatever is rounded
    left = product(product(A, P), A.T.copy()) + product(product(M, N), M.T.copy())
    new_pose, new_motion = pose.copy(), motion + correction[ORDER:]
    for i in range(3):
        for j in range(3):
            new_pose[i] += R[i, j] * correction[j]
    new_pose[3:] = multiply(_quaternion(pose[3:], 1.0), turn)[1:]
    for i in range(MOTION_STIFFNESS, n - ORDER):  # stiffnesses, where there are any
        new_motion[i] = max(0.0, new_motion[i])
    normalized, nis, correlation = solve(L, innovation), 0.0, 0.0
    for i in range(6):
        nis += innovation[i] * normalized[i] / 6.0
        correlation += last[i] * normalized[i] / 6.0
    return new_pose, new_motion, 0.5 * (left + left.T), innovation, nis, correlation
