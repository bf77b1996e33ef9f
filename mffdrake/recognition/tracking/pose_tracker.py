"""Tracks a solid from frame to frame with its state inside: the whole thing without Drake."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.fitness.colors import ChannelOrder, ColorModel
from mffdrake.recognition.fitness.matching import Images, Matcher
from mffdrake.recognition.genetic.generation import Generation
from mffdrake.recognition.genetic.genetic import GeneCoding, SearchRange
from mffdrake.recognition.genetic.starts import NearStart
from mffdrake.recognition.genetic.tracker import OneStepGaTracker
from mffdrake.recognition.poses.pose import quaternion_scalar, rotation_matrix
from mffdrake.recognition.poses.pose_motion import quaternion_rate_matrix
from mffdrake.recognition.poses.tracking_state import TrackingState
from mffdrake.recognition.refinement.refinement import BorderRefiner
from mffdrake.recognition.solid.solid_model import SolidModel
from mffdrake.recognition.tracking.robust_tracker import RobustTracker
from mffdrake.recognition.tracking.search import Found, PoseSearch
from mffdrake.recognition.visibility.search_model import SearchModel

Array = NDArray[np.float64]

_OTHER_ORDER: dict[ChannelOrder, ChannelOrder] = {"rgb": "bgr", "bgr": "rgb"}
_CLEARLY_BETTER = 0.3  # of fitness


@dataclass(frozen=True)
class Estimate:
    """What a frame says of the target's pose.

    Attributes:
        pose: Pose vector ``(r [m], eps)`` in the rig's frame C, shape (6,).
        covariance: Covariance of its error, shape (6, 6); NaN where that is not known.
        fitness: Its fitness, 0 to 1.
        frame: Number of the frame, from 0.
        state: Whether the pose may be relied on.
        confidence: Probability that it is right to 5 mm and 1 deg (0 to 1); NaN where not known.
        is_tracking: Whether it is right with enough confidence.
        refined: Whether it is refined on this frame's images, see `Generation.refined`.

    Example:
        >>> estimate = Estimate(np.array([0.0, 0.1, 0.8, 0.6, 0.0, 0.0]), 0.9, 0)
        >>> estimate.refined, estimate.quaternion_xyzw
        (False, array([0.6, 0. , 0. , 0.8]))
    """

    pose: Array
    fitness: float
    frame: int
    covariance: Array = field(default_factory=lambda: np.full((6, 6), math.nan))
    state: TrackingState = TrackingState.SEARCHING
    confidence: float = math.nan
    is_tracking: bool = False
    refined: bool = False

    @property
    def R_CM(self) -> Array:
        """The target's orientation in the rig's frame, shape (3, 3)."""
        return rotation_matrix(self.pose[3:])

    @property
    def p_CM(self) -> Array:
        """Its position [m], shape (3,)."""
        return self.pose[:3]

    @property
    def quaternion_xyzw(self) -> Array:
        """Its orientation as a unit quaternion, the scalar part last, shape (4,)."""
        return np.append(self.pose[3:], quaternion_scalar(self.pose[3:]))

    @property
    def std_position(self) -> float:
        """Standard deviation of the position [m], all axes together; NaN if not known."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def std_rotation(self) -> float:
        """Standard deviation of the orientation [rad], all axes together; NaN if not known."""
        # deps = 1/2 (eta I - S(eps)) dtheta, Eq. (6)
        back = np.linalg.pinv(quaternion_rate_matrix(self.pose[3:]))
        return float(np.sqrt(np.trace(back @ self.covariance[3:, 3:] @ back.T)))


class PoseTracker:
    """Recognizes a solid's pose in frame after frame of a rig's images.

    It wraps a `RobustTracker` or a `OneStepGaTracker`, which has all of the parameters, and keeps
    what that carries from frame to frame. The same images in the same order always give the same
    results.

    Args:
        algorithm: The algorithm.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> tracker = PoseTracker.of(CameraRig.stereo(), box, channel_order="rgb")
        >>> images = 2 * [np.zeros((480, 640, 3), dtype=np.uint8)]
        >>> tracker.start(images).frame, tracker.track(images).frame
        (0, 1)
    """

    def __init__(self, algorithm: OneStepGaTracker | RobustTracker) -> None:
        self.algorithm = algorithm
        self._generation: Generation | None = None
        self._next_frame = 0

    @classmethod
    def of(
        cls,
        rig: CameraRig,
        solid: SolidModel,
        *,
        channel_order: ChannelOrder,
        colors: ColorModel | None = None,
        search_range: SearchRange | None = None,
        refine: bool = True,
        seed: int = 0,
    ) -> PoseTracker:
        """A tracker with the usual parameters.

        Args:
            rig: The cameras.
            solid: The target.
            channel_order: How the images' channels are ordered, "rgb" or (as OpenCV reads them)
                "bgr". There is no default: in the wrong order red faces are taken for blue ones.
            colors: How the solid's materials look; by default as in its mesh file.
            search_range: Where the target may be; by default anywhere in view, see
                `SearchRange.in_view`.
            refine: Whether poses are refined from the color borders, and the target is searched for
                and judged by them; or the GA is alone.
            seed: Of the random numbers, at least 0.

        Raises:
            ValueError: When the colors lack one of the solid's materials, or the order is another.
        """
        matcher = Matcher(SearchModel(solid), rig, colors=colors, channel_order=channel_order)
        coding = GeneCoding(search_range=search_range or SearchRange.in_view(rig, solid.size))
        ga = OneStepGaTracker(matcher=matcher, coding=coding, seed=seed)
        if not refine:
            return cls(ga)
        return cls(RobustTracker(ga=dc.replace(ga, refiner=BorderRefiner(matcher))))

    @property
    def ga(self) -> OneStepGaTracker:
        """The 1-step GA, alone or inside the robust tracker."""
        algorithm = self.algorithm
        return algorithm.ga if isinstance(algorithm, RobustTracker) else algorithm

    @property
    def generation(self) -> Generation | None:
        """All hypotheses after the last frame; None before the first."""
        return self._generation

    def start(
        self,
        images: Images,
        pose: ArrayLike | None = None,
        *,
        spread: tuple[float, float] = NearStart.spread,
    ) -> Estimate:
        """Takes the first frame, or starts anew.

        Args:
            images: One a camera, in the rig's order or by names, uint8, shape
                (height, width, 3 or 4).
            pose: The pose vector that the first population is drawn around, shape (6,); None for
                what the algorithm's own start draws.
            spread: Its standard deviations of the position [m] and of the quaternion.

        Returns:
            The first frame's estimate.

        Raises:
            ValueError: When an image does not fit its camera, or a given pose fits the images far
                better with their channels in the other order.
        """
        algorithm = self.algorithm
        if pose is not None:
            self._check_channel_order(images, pose)
            algorithm = algorithm.with_start(NearStart(pose, spread))
        self._next_frame = 0
        return self._advance(algorithm.start_population(images, frame=0))

    def search(
        self,
        images: Images,
        generations: int,
        on_generation: Callable[[int, float], None] | None = None,
    ) -> tuple[Estimate, Found]:
        """Takes a frame as if nothing was known, with as many generations as it takes.

        Args:
            images: One a camera, in the rig's order or by names, uint8, shape
                (height, width, 3 or 4).
            generations: Greatest number of generations.
            on_generation: Called after every generation with their number and the best fitness.

        Returns:
            The frame's estimate, and how it was found.

        Raises:
            ValueError: When an image does not fit its camera, or ``generations`` is below 1.
        """
        found = PoseSearch(self.ga).search(
            images, generations, frame=self._next_frame, on_generation=on_generation
        )
        generation = self.algorithm.start_from(found.generation, images, frame=self._next_frame)
        return self._advance(generation), found

    def track(self, images: Images, X_DC: ArrayLike | None = None) -> Estimate:
        """Takes the next frame; the first one as `start` does.

        Args:
            images: One a camera, in the rig's order or by names, uint8, shape
                (height, width, 3 or 4).
            X_DC: Motion feedforward: the rig's last pose C in its present one D, a homogeneous
                transform of shape (3, 4) or (4, 4); None when it stands still or its motion is not
                known.

        Returns:
            The frame's estimate.

        Raises:
            ValueError: When an image does not fit its camera, or X_DC is no transform.
        """
        if self._generation is None:
            return self.start(images)
        generation = self._generation
        if X_DC is not None:
            X = np.asarray(X_DC, dtype=float)
            if X.shape not in ((3, 4), (4, 4)) or not np.isfinite(X).all():
                raise ValueError(
                    "X_DC must be a finite transform of shape (3, 4) or (4, 4), not of shape "
                    f"{X.shape}"
                )
            generation = generation.carried(X[:3, :3], X[:3, 3])
        return self._advance(self.algorithm.track(generation, images, frame=self._next_frame))

    def _advance(self, generation: Generation) -> Estimate:
        self._generation = generation
        frame, self._next_frame = self._next_frame, self._next_frame + 1
        estimate = Estimate(
            generation.best,
            float(generation.fitness[0]),
            frame,
            state=generation.state,
            confidence=generation.confidence,
            is_tracking=generation.is_tracking,
            refined=generation.refined,
        )
        if generation.covariance is not None:
            estimate = dc.replace(estimate, covariance=generation.covariance)
        return estimate

    def _check_channel_order(self, images: Images, pose: ArrayLike) -> None:
        m = self.algorithm.matcher
        other = Matcher(
            m.search_model, m.rig, m.parameters, m.colors, _OTHER_ORDER[m.channel_order]
        )
        here, there = (float(matcher.fitness(pose, images)[0]) for matcher in (m, other))
        if there > here + _CLEARLY_BETTER:
            raise ValueError(
                f"at the given pose the images fit far better with their channels in the order "
                f"{other.channel_order} (fitness {there:.2f}) than in the order "
                f"{m.channel_order} that was stated ({here:.2f}); state channel_order="
                f"'{other.channel_order}'"
            )
