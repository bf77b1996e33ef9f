"""A Kalman filter on poses: where a target is, and how it moves by itself.

The error is that of the filter's own pose, seen from the target: the true pose is
``p + R dp, R exp(S(dtheta))``. So the filter is the same in a frame that moves as in one that is at
rest, as long as its pose is carried along.
"""

from __future__ import annotations

import dataclasses as dc
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.parameters import Positive, parameters
from mffdrake.recognition.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.pose_motion import quaternion_rate_matrix, transport_pose

__all__ = [
    "NUM_NUMBERS",
    "PoseFilter",
    "PoseFilterParameters",
    "body_covariance",
    "pose_covariance",
]

NUM_NUMBERS = 6 + 6 + 12 * 12 + 2
"""How many numbers a filter is."""

_CALMEST = 0.125  # of the accelerations, for a target that has long moved as expected;
_JOLT = 2.0  # a surprise of the fourth power of this ends that at once

Array = NDArray[np.float64]


@parameters
class PoseFilterParameters:
    """How the target may move, by itself.

    Attributes:
        acceleration: Root of the spectral density of its linear acceleration [m/s^2 / sqrt(Hz)].
        angular_acceleration: The same of its angular acceleration [rad/s^2 / sqrt(Hz)].
        speed: Standard deviation of its velocity before anything is known of it [m/s].
        angular_speed: The same of its angular velocity [rad/s].
        adaptive: Whether accelerations count as stronger for a while where measurements are far
            from where they were expected, and as weaker where they long are not.

    Raises:
        ValueError: When a parameter is not positive.
    """

    acceleration: Positive = 0.5
    angular_acceleration: Positive = 2.0
    speed: Positive = 0.3
    angular_speed: Positive = 1.0
    adaptive: bool = False


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
    unrest: float = 1.0

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

    def predict(self, dt: float, rules: PoseFilterParameters) -> PoseFilter:
        """A time later, with no measurement.

        Args:
            dt: The time [s].
            rules: How the target may move.
        """
        from mffdrake.recognition import _pose_filter  # numba: slow to import

        unrest = self.unrest if rules.adaptive else 1.0
        densities = (unrest * rules.acceleration, unrest * rules.angular_acceleration)
        pose, twist, covariance = _pose_filter.predict(
            self.pose, self.twist, self.covariance, float(dt), densities
        )
        return PoseFilter(pose, twist, covariance, self.surprise, unrest)

    def update(self, pose: ArrayLike, covariance: ArrayLike) -> PoseFilter:
        """With a measurement.

        Args:
            pose: Pose vector that was measured, shape (6,).
            covariance: Covariance of its error, as a `Generation`'s, shape (6, 6).
        """
        from mffdrake.recognition import _pose_filter  # numba: slow to import

        new_pose, twist, P, surprise = _pose_filter.update(
            self.pose,
            self.twist,
            self.covariance,
            np.array(pose, dtype=float),
            np.array(covariance, dtype=float),
        )
        return PoseFilter(new_pose, twist, P, surprise, self._adapted(surprise))

    def surprised(self, pose: ArrayLike, covariance: ArrayLike) -> PoseFilter:
        """Without a measurement that is not to be believed, but as restless as it makes.

        Args:
            pose: Pose vector that was measured, shape (6,).
            covariance: Covariance of its error, as a `Generation`'s, shape (6, 6).
        """
        surprise = self.update(pose, covariance).surprise
        return dc.replace(self, surprise=surprise, unrest=self._adapted(surprise))

    def _adapted(self, surprise: float) -> float:
        """Up fast, down slowly; still where measurements are as far off as expected."""
        factor = min(max(math.sqrt(math.sqrt(surprise)), 0.9), 4.0)
        known = max(1.0, self.unrest) if factor > _JOLT else self.unrest
        return max(_CALMEST, known * factor)

    def numbers(self, pose: ArrayLike) -> Array:
        """The filter for who keeps it beside a pose vector, shape (`NUM_NUMBERS`,).

        Its own pose is told as seen from that pose: so it goes along where that is carried.
        """
        (R, p), (R_own, p_own) = transform_from_pose(pose), transform_from_pose(self.pose)
        own = pose_from_transform(R.T @ R_own, R.T @ (p_own - p))
        rest = [self.surprise, self.unrest]
        return np.concatenate([own, self.twist, self.covariance.reshape(-1), rest])

    @classmethod
    def of_numbers(cls, pose: ArrayLike, numbers: ArrayLike) -> PoseFilter:
        """The filter whose `numbers` were kept beside a pose vector."""
        n = np.array(numbers, dtype=float)
        (R, p), (R_own, p_own) = transform_from_pose(pose), transform_from_pose(n[:6])
        own = pose_from_transform(R @ R_own, p + R @ p_own)
        return cls(own, n[6:12], n[12:-2].reshape(12, 12), float(n[-2]), float(n[-1]))

    def carried(self, R: ArrayLike, p: ArrayLike) -> PoseFilter:
        """The same, seen from another frame D.

        Args:
            R: Orientation of the pose's frame C in D, shape (3, 3).
            p: Its position [m], shape (3,).
        """
        return dc.replace(self, pose=transport_pose(self.pose[None], R, p)[0])


def body_covariance(pose: ArrayLike, covariance: ArrayLike) -> Array:
    """A pose vector's covariance as that of position and rotation vector, seen from the target.

    Args:
        pose: Pose vector, shape (6,).
        covariance: Of a pose vector's error, shape (6, 6).

    Returns:
        Shape (6, 6) [m, rad]. At a half turn, where a pose vector's covariance says nothing of the
        angle, that is as uncertain as turns about the other axes.
    """
    from mffdrake.recognition import _pose_filter  # numba: slow to import

    P: Array = _pose_filter.body_covariance(
        np.array(pose, dtype=float), np.array(covariance, dtype=float)
    )
    return P


def pose_covariance(pose: ArrayLike, covariance: ArrayLike) -> Array:
    """The inverse of `body_covariance`.

    Args:
        pose: Pose vector, shape (6,).
        covariance: Of position and rotation vector, seen from the target, shape (6, 6) [m, rad].

    Returns:
        Covariance of the pose vector's error, shape (6, 6).
    """
    pose = np.asarray(pose, dtype=float)
    R = transform_from_pose(pose)[0]
    A = np.zeros((6, 6))
    A[:3, :3] = R
    A[3:, 3:] = quaternion_rate_matrix(pose[3:]) @ R
    return np.asarray(A @ np.asarray(covariance, dtype=float) @ A.T)
