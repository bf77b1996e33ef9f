"""A Kalman filter on poses: where a target is, and how it moves by itself.

The error is that of the filter's own pose, seen from the target: the true pose is
``p + R dp, R exp(S(dtheta))``. So the filter is the same in a frame that moves as in one that is at
rest, as long as its pose is carried along.
"""

from __future__ import annotations

import dataclasses as dc
import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.parameters import Positive, parameters
from mffdrake.recognition.pose import (
    pose_from_transform,
    quaternion_scalar,
    quaternion_vector,
    rotation_matrix,
    skew,
    transform_from_pose,
)

__all__ = ["NUM_NUMBERS", "PoseFilter", "PoseFilterParameters", "body_covariance"]

NUM_NUMBERS = 6 + 12 * 12 + 1
"""How many numbers a filter is, besides its pose."""

Array = NDArray[np.float64]

_HALF_TURN = 1e-6  # A quaternion's scalar part up to which rounding hides the angle's covariance


@parameters
class PoseFilterParameters:
    """How the target may move, by itself.

    Attributes:
        acceleration: Root of the spectral density of its linear acceleration [m/s^2 / sqrt(Hz)].
        angular_acceleration: The same of its angular acceleration [rad/s^2 / sqrt(Hz)].
        speed: Standard deviation of its velocity before anything is known of it [m/s].
        angular_speed: The same of its angular velocity [rad/s].

    Raises:
        ValueError: When a parameter is not positive.
    """

    acceleration: Positive = 0.5
    angular_acceleration: Positive = 2.0
    speed: Positive = 0.3
    angular_speed: Positive = 1.0


@dataclass(frozen=True, eq=False)
class PoseFilter:
    """A target's pose and velocity, with their covariance. Every step makes a new one.

    It moves with a constant linear and angular velocity, but for white accelerations.

    Attributes:
        pose: Pose vector ``(r [m], eps)``, shape (6,).
        twist: Linear [m/s] and angular velocity [rad/s] as seen from the target, shape (6,).
        covariance: Of the errors of position, orientation, linear and angular velocity, all seen
            from the target, shape (12, 12).
        surprise: How far the last measurement was from where it was expected: the squared distance
            in units of its covariance, a sixth of it, so that 1 is usual.

    Example:
        >>> rules = PoseFilterParameters()
        >>> known = PoseFilter.of(np.array([0.0, 0.1, 0.8, 0.0, 0.0, 0.0]), 1e-8 * np.eye(6), rules)
        >>> for k in range(1, 30):    # 10 mm/s along x
        ...     seen = np.array([0.01 * 0.033 * k, 0.1, 0.8, 0.0, 0.0, 0.0])
        ...     known = known.predict(0.033, rules).update(seen, 1e-8 * np.eye(6))
        >>> known.twist[:3].round(4)
        array([0.01, 0.  , 0.  ])
    """

    pose: Array
    twist: Array
    covariance: Array = field(repr=False)
    surprise: float = 0.0

    @classmethod
    def of(cls, pose: ArrayLike, covariance: ArrayLike, rules: PoseFilterParameters) -> PoseFilter:
        """What is known after a first measurement.

        Args:
            pose: Pose vector, shape (6,).
            covariance: Covariance of its error, as a `Generation`'s, shape (6, 6).
            rules: How the target may move.
        """
        pose = np.array(pose, dtype=float)
        P = np.zeros((12, 12))
        P[:6, :6] = body_covariance(pose, covariance)
        speeds = np.repeat([rules.speed, rules.angular_speed], 3)
        P[6:, 6:] = np.diag(speeds**2)
        return cls(pose, np.zeros(6), P)

    @property
    def velocity(self) -> Array:
        """Linear [m/s] and angular velocity [rad/s] in the pose's frame, shape (6,)."""
        R = transform_from_pose(self.pose)[0]
        return np.concatenate([R @ self.twist[:3], R @ self.twist[3:]])

    def predict(self, dt: float, rules: PoseFilterParameters, *, unrest: float = 1.0) -> PoseFilter:
        """A time later, with no measurement.

        Args:
            dt: The time [s].
            rules: How the target may move.
            unrest: So many times stronger are its accelerations.
        """
        R, p = transform_from_pose(self.pose)
        v, w = self.twist[:3], self.twist[3:]
        turn = exp_rotation(w * dt)
        back = turn.T
        later = back @ v  # The same velocity, seen from the target as it has turned
        rate_turns = dt * right_jacobian(w * dt)  # how an error of w turns it
        F = np.zeros((12, 12))
        F[:3, :3] = F[3:6, 3:6] = F[6:9, 6:9] = back
        F[:3, 3:6] = -dt * back @ skew(v)
        F[:3, 6:9] = dt * back
        F[3:6, 9:] = rate_turns
        F[6:9, 9:] = skew(later) @ rate_turns
        F[9:, 9:] = np.eye(3)
        density = (unrest * np.repeat([rules.acceleration, rules.angular_acceleration], 3)) ** 2
        Q = np.zeros((12, 12))
        place, speed = np.arange(6), np.arange(6, 12)
        Q[place, place] = density * dt**3 / 3.0
        Q[place, speed] = Q[speed, place] = density * dt**2 / 2.0
        Q[speed, speed] = density * dt
        # Where it has turned otherwise, the same velocity is seen from it otherwise.
        turned = skew(later) @ Q[3:6]
        Q[6:9] += turned
        Q[:, 6:9] += turned.T
        Q[6:9, 6:9] += turned[:, 3:6] @ skew(later).T
        return PoseFilter(
            pose_from_transform(R @ turn, p + R @ v * dt),
            np.concatenate([later, w]),
            F @ self.covariance @ F.T + Q,
            self.surprise,
        )

    def update(self, pose: ArrayLike, covariance: ArrayLike) -> PoseFilter:
        """With a measurement.

        Args:
            pose: Pose vector that was measured, shape (6,).
            covariance: Covariance of its error, as a `Generation`'s, shape (6, 6).
        """
        R, p = transform_from_pose(self.pose)
        R_seen, p_seen = transform_from_pose(np.asarray(pose, dtype=float))
        between = R.T @ R_seen
        away = np.concatenate([R.T @ (p_seen - p), log_rotation(between)])
        # The measurement's error, from where it was seen to where it was expected
        D = np.zeros((6, 6))
        D[:3, :3], D[3:, 3:] = between, np.linalg.inv(right_jacobian(away[3:]))
        P = self.covariance
        N = D @ body_covariance(pose, covariance) @ D.T
        S = P[:6, :6] + N
        K = np.linalg.solve(S, P[:6]).T  # P H^T S^-1
        change = K @ away
        turn = exp_rotation(change[3:6])
        # What is left of the error, seen from the target as it has been turned
        G = np.eye(12)
        G[:3, :3], G[3:6, 3:6] = turn.T, right_jacobian(change[3:6])
        L, A = G @ K, G.copy()
        A[:, :6] -= L
        P = A @ P @ A.T + L @ N @ L.T  # Joseph's form: positive whatever is rounded
        return PoseFilter(
            pose_from_transform(R @ turn, p + R @ change[:3]),
            self.twist + change[6:],
            0.5 * (P + P.T),
            float(away @ np.linalg.solve(S, away)) / 6.0,
        )

    @property
    def numbers(self) -> Array:
        """All but the pose, for who keeps it, shape (`NUM_NUMBERS`,)."""
        return np.concatenate([self.twist, self.covariance.reshape(-1), [self.surprise]])

    @classmethod
    def of_numbers(cls, pose: ArrayLike, numbers: ArrayLike) -> PoseFilter:
        """The filter with a pose and with the `numbers` that were kept."""
        n = np.array(numbers, dtype=float)
        return cls(np.array(pose, dtype=float), n[:6], n[6:-1].reshape(12, 12), float(n[-1]))

    def carried(self, pose: ArrayLike) -> PoseFilter:
        """The same, seen from elsewhere: at another pose vector of shape (6,)."""
        return dc.replace(self, pose=np.array(pose, dtype=float))


def body_covariance(pose: ArrayLike, covariance: ArrayLike) -> Array:
    """A pose vector's covariance as that of position and rotation vector, seen from the target.

    Args:
        pose: Pose vector, shape (6,).
        covariance: Of a pose vector's error, shape (6, 6).

    Returns:
        Shape (6, 6) [m, rad]. At a half turn, where a pose vector's covariance says nothing of the
        angle, that is as uncertain as turns about the other axes.
    """
    pose = np.asarray(pose, dtype=float)
    eps, eta = pose[3:], float(quaternion_scalar(pose[3:]))
    A = np.zeros((6, 6))
    A[:3, :3] = rotation_matrix(eps).T
    # deps = 1/2 (eta I + S(eps)) dtheta, Eq. (6) as seen from the target, solved for dtheta
    A[3:, 3:] = 2.0 * (eta * np.eye(3) - skew(eps))
    along = np.outer(eps, eps)
    if eta > _HALF_TURN:
        A[3:, 3:] += 2.0 / eta * along
    P = np.asarray(A @ np.asarray(covariance, dtype=float) @ A.T)
    if eta <= _HALF_TURN:
        P[3:, 3:] += 0.5 * np.trace(P[3:, 3:]) * along
    return P


def exp_rotation(vector: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector [rad], shape (3, 3)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float))[0])


def log_rotation(R: ArrayLike) -> Array:
    """Rotation vector [rad] of a rotation matrix, shape (3,)."""
    eps = quaternion_vector(R)  # Unlike OpenCV's, it is right to turns below 1e-5, too.
    sine = math.sqrt(eps @ eps)
    if sine == 0.0:
        return eps
    return np.asarray(2.0 * math.atan2(sine, float(quaternion_scalar(eps))) / sine * eps)


def right_jacobian(vector: ArrayLike) -> Array:
    """The J with ``exp(v + d) = exp(v) exp(J d)`` for small d, shape (3, 3).

    Args:
        vector: Rotation vector v [rad], shape (3,).
    """
    v = np.asarray(vector, dtype=float)
    S, square = skew(v), float(v @ v)
    if square < 1e-6:
        return np.asarray(np.eye(3) - 0.5 * S + S @ S / 6.0)
    angle = math.sqrt(square)
    first = (1.0 - math.cos(angle)) / square
    second = (1.0 - math.sin(angle) / angle) / square
    return np.asarray(np.eye(3) - first * S + second * S @ S)
