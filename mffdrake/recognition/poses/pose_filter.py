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

from mffdrake.recognition.parameters import NonNegative, Positive, parameters
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.poses.pose_motion import quaternion_rate_matrix, transport_pose

__all__ = [
    "NUM_NUMBERS",
    "PoseFilter",
    "PoseFilterParameters",
    "body_covariance",
    "pose_covariance",
]

NUM_NUMBERS = 20 + 20 * 20 + 8
"""How many numbers a filter is, some of them NaN where accelerations do not last."""

_STIFFNESS_TIME = 300.0  # constant, with which what was learned of the stiffness decays [s]
_LEAST_NOISE_SCALE = 0.125  # for a target that moves as expected
_LEARNING_RATE = 0.1  # of the noise scale's logarithm, a measurement
_COLORED = 0.2  # Errors of poses that look alike are correlated a little by themselves.
_LOW_NIS = 0.5  # A lower one makes the noise scale smaller, too.
_JOLT_NIS = 16.0  # A higher one makes it larger at once, ...
_MOST_GROWTH = 4.0  # by so much at most.

Array = NDArray[np.float64]


@parameters
class PoseFilterParameters:
    """How the target may move, by itself.

    Attributes:
        acceleration: Root of the spectral density of its linear acceleration, at low frequencies
            [m/s^2 / sqrt(Hz)].
        angular_acceleration: The same of its angular acceleration [rad/s^2 / sqrt(Hz)].
        lasting: For how long it keeps an acceleration: the time constant with which that decays,
            and over which it varies [s]. At 0, accelerations are white, and none is estimated.
        swing: How fast it may swing where accelerations last [rad/s]: its frequencies, that of the
            linear and that of the angular motion, are learned, and are about as much at most.
        speed: Standard deviation of its velocity before anything is known of it [m/s].
        angular_speed: The same of its angular velocity [rad/s].
        adaptive: Whether accelerations count as stronger where innovations in a row are
            positively correlated, and as weaker where negatively (Mehra 1970: those of a filter
            that is right are independent); and as stronger at once where one is very large.

    Raises:
        ValueError: When a parameter is not positive, or ``lasting`` or ``swing`` is negative.

    Example:
        >>> swinging = PoseFilterParameters(acceleration=2.0, lasting=0.3, swing=3.0)
        >>> swinging.start.size  # Accelerations and stiffness are estimated, too.
        14
    """

    acceleration: Positive = 0.5
    angular_acceleration: Positive = 2.0
    lasting: NonNegative = 0.0
    swing: NonNegative = 0.0
    speed: Positive = 0.3
    angular_speed: Positive = 1.0
    adaptive: bool = False

    @property
    def start(self) -> Array:
        """Standard deviations of the motion before anything is known of it, shape (6,) or (14,)."""
        std = np.repeat([self.speed, self.angular_speed], 3)
        if not self.lasting:
            return std
        steady = np.array([self.acceleration, self.angular_acceleration])
        lasting = np.repeat(steady / math.sqrt(2.0 * self.lasting), 3)
        return np.concatenate([std, lasting, 2 * [self.swing**2]])


@dataclass(frozen=True, eq=False)
class PoseFilter:
    """A target's pose and velocity, with their covariance. Every step makes a new one.

    It moves with a constant linear and angular velocity, but for accelerations that are white or,
    where the rules let them last, decay (Singer's model) and, where it swings, go against its
    velocity, as those of a spring: ``a' = -stiffness v - a / lasting``.

    Attributes:
        pose: Pose vector ``(r [m], eps)``, shape (6,).
        motion: Linear [m/s] and angular velocity [rad/s] as seen from the target and, where they
            last, the accelerations and the linear and the angular motion's stiffness [rad^2/s^2],
            shape (6,) or (14,).
        covariance: Of the errors of position, orientation, linear and angular velocity and, where
            they last, of the rest of the motion, all seen from the target, shape (12, 12) or
            (20, 20).
        nis: The last measurement's normalized innovation squared, by its six degrees of freedom:
            how far it was from where it was expected, squared, in units of its covariance; 1 on
            average.
        noise_scale: Factor on the accelerations' densities, where those are adaptive.
        innovation: From where the last measurement was expected to where it was, position [m] and
            rotation vector [rad], seen from the target, shape (6,).

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
    motion: Array
    covariance: Array = field(repr=False)
    nis: float = 0.0
    noise_scale: float = 1.0
    innovation: Array = field(default_factory=lambda: np.zeros(6), repr=False)

    @classmethod
    def of(cls, pose: ArrayLike, covariance: ArrayLike, rules: PoseFilterParameters) -> PoseFilter:
        """What is known after a first measurement.

        Args:
            pose: Pose vector, shape (6,).
            covariance: Covariance of its error, as a `Generation`'s, shape (6, 6).
            rules: How the target may move.
        """
        pose = np.array(pose, dtype=float)
        P = np.diag(np.append(np.zeros(6), rules.start**2))
        P[:6, :6] = body_covariance(pose, covariance)
        return cls(pose, np.zeros(rules.start.size), P)

    @property
    def twist(self) -> Array:
        """Linear [m/s] and angular velocity [rad/s] as seen from the target, shape (6,)."""
        return self.motion[:6]

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
        from mffdrake.recognition.poses import filter_steps  # numba: slow to import

        noise_scale = self.noise_scale if rules.adaptive else 1.0
        # Where accelerations last, it is the jerk that is white.
        white = noise_scale / rules.lasting if rules.lasting else noise_scale
        densities = (white * rules.acceleration, white * rules.angular_acceleration)
        known, learned = self._as(rules), (math.exp(-dt / _STIFFNESS_TIME), rules.swing**4)
        pose, motion, covariance = filter_steps.predict(
            known.pose,
            known.motion,
            known.covariance,
            float(dt),
            float(rules.lasting),
            densities,
            learned,
        )
        return PoseFilter(pose, motion, covariance, self.nis, noise_scale, self.innovation)

    def _as(self, rules: PoseFilterParameters) -> PoseFilter:
        """With accelerations where the rules let them last, without where not."""
        size, wanted = self.motion.size, rules.start.size
        if size == wanted:
            return self
        motion, P = np.zeros(wanted), np.diag(np.append(np.zeros(6), rules.start**2))
        both = min(size, wanted)
        motion[:both] = self.motion[:both]
        P[: 6 + both, : 6 + both] = self.covariance[: 6 + both, : 6 + both]
        return dc.replace(self, motion=motion, covariance=P)

    def update(self, pose: ArrayLike, covariance: ArrayLike) -> PoseFilter:
        """With a measurement.

        Args:
            pose: Pose vector that was measured, shape (6,).
            covariance: Covariance of its error, as a `Generation`'s, shape (6, 6).
        """
        from mffdrake.recognition.poses import filter_steps  # numba: slow to import

        updated = filter_steps.Updated(
            *filter_steps.update(
                self.pose, self.motion, self.covariance,
                np.array(pose, dtype=float), np.array(covariance, dtype=float), self.innovation,
            )
        )  # fmt: skip
        return PoseFilter(
            updated.pose,
            updated.motion,
            updated.covariance,
            updated.nis,
            self._adapted(updated.nis, updated.correlation),
            updated.innovation,
        )

    def reject(self, pose: ArrayLike, covariance: ArrayLike) -> PoseFilter:
        """Without a measurement that is an outlier, but with the noise scale that it leads to.

        Args:
            pose: Pose vector that was measured, shape (6,).
            covariance: Covariance of its error, as a `Generation`'s, shape (6, 6).
        """
        updated = self.update(pose, covariance)
        return dc.replace(self, nis=updated.nis, noise_scale=updated.noise_scale)

    def _adapted(self, nis: float, correlation: float) -> float:
        """The noise scale after a measurement, whose innovation may be correlated with the last."""
        if nis > _JOLT_NIS:
            return max(1.0, self.noise_scale) * min(math.sqrt(math.sqrt(nis)), _MOST_GROWTH)
        growth = min(max(correlation - _COLORED, -1.0), 10.0) - max(0.0, 1.0 - nis / _LOW_NIS)
        return max(_LEAST_NOISE_SCALE, self.noise_scale * math.exp(_LEARNING_RATE * growth))

    def numbers(self, pose: ArrayLike) -> Array:
        """The filter for who keeps it beside a pose vector, shape (`NUM_NUMBERS`,).

        Its own pose is told as seen from that pose: so it goes along where that is carried.
        """
        from mffdrake.recognition.poses import rotations  # numba: slow to import

        own = rotations.seen_from(np.array(pose, dtype=float), self.pose)
        P, numbers = self.covariance, np.full(NUM_NUMBERS, math.nan)
        rest = [self.nis, self.noise_scale, *self.innovation]
        known = np.concatenate([own, self.motion, P.reshape(-1), rest])
        numbers[: known.size] = known
        return numbers

    @classmethod
    def of_numbers(cls, pose: ArrayLike, numbers: ArrayLike) -> PoseFilter:
        """The filter whose `numbers` were kept beside a pose vector."""
        from mffdrake.recognition.poses import rotations  # numba: slow to import

        n = np.array(numbers, dtype=float)
        n = n[: n.size - int(np.argmin(np.isnan(n[::-1])))]
        size = math.isqrt(n.size - 8)  # of an error: it, its covariance and 2 + 6 numbers
        own = rotations.composed(np.array(pose, dtype=float), n[:6])
        motion, P, (nis, noise_scale), innovation = n[6:size], n[size:-8], n[-8:-6], n[-6:]
        return cls(own, motion, P.reshape(size, size), float(nis), float(noise_scale), innovation)

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
    from mffdrake.recognition.poses import filter_steps  # numba: slow to import

    P: Array = filter_steps.body_covariance(
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
