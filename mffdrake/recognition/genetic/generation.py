"""What a tracker carries from frame to frame."""

from __future__ import annotations

import dataclasses as dc
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.fitness.matching import NO_GAINS, Gains
from mffdrake.recognition.poses.pose_filter import PoseFilter
from mffdrake.recognition.poses.pose_motion import transport_pose
from mffdrake.recognition.poses.tracking_state import TrackingState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Generation:
    """A scored population, best first.

    Attributes:
        poses: Pose vectors ``(r [m], eps)``, shape (N, 6).
        fitness: Their fitness, shape (N,), in descending order; but a refined pose stands first,
            whatever its fitness.
        covariance: Covariance of the error of the first pose where that is refined, or predicted
            from one that was, shape (6, 6); else None.
        gains: White balance for the next frame: what red, green and blue are multiplied with.
        state: Whether the first pose may be relied on.
        confidence: Probability that it is right to 5 mm and 1 deg (0 to 1); NaN where it is not
            known.
        is_tracking: Whether it is right with enough confidence.
        unseen: For how many frames it has not been seen, or not where it was expected.
        motion: What is known of the target's own motion; None for nothing.
        image_hashes: A number a camera that tells its image from others.

    Example:
        >>> seen = Generation(np.array([[0.0, 0.1, 0.8, 0.0, 0.0, 0.0]]), np.array([0.9]))
        >>> nearer = seen.carried(np.eye(3), [0.0, 0.0, -0.2])  # The cameras went 0.2 m ahead.
        >>> nearer.best.round(3) + 0.0
        array([0. , 0.1, 0.6, 0. , 0. , 0. ])
    """

    poses: Array
    fitness: Array
    covariance: Array | None = None
    gains: Gains = NO_GAINS
    state: TrackingState = TrackingState.SEARCHING
    confidence: float = math.nan
    is_tracking: bool = False
    unseen: int = 0
    motion: PoseFilter | None = None
    image_hashes: tuple[float, ...] = ()

    @property
    def best(self) -> Array:
        """The recognized pose, shape (6,): refined, or the fittest individual, Eq. (25)."""
        best: Array = self.poses[0]
        return best

    @property
    def refined(self) -> bool:
        """Whether the first pose is refined on this frame's images."""
        return self.covariance is not None and self.state != TrackingState.PREDICTED

    def carried(self, R_DC: ArrayLike, p_DC: ArrayLike) -> Generation:
        """The same, seen from where the cameras are by now, Eq. (23).

        Args:
            R_DC: The last frame's rig C in the present one's D: its orientation, shape (3, 3).
            p_DC: Its position [m], shape (3,).
        """
        motion = None if self.motion is None else self.motion.carried(R_DC, p_DC)
        return dc.replace(self, poses=transport_pose(self.poses, R_DC, p_DC), motion=motion)

    def moved_with_target(self, motion: PoseFilter) -> Generation:
        """The same, carried along with what is known of the target's own motion.

        Args:
            motion: Of the target by now; the generation's is that before.
        """
        from mffdrake.recognition.poses import rotations  # numba: slow to import

        assert self.motion is not None
        poses = np.ascontiguousarray(self.poses)
        poses = rotations.transport_along(poses, self.motion.pose, motion.pose)
        return dc.replace(self, poses=poses, motion=motion)
