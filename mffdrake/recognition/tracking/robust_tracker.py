"""The 1-step GA that finds its target at once, knows when it has lost it, and comes back."""

from __future__ import annotations

import dataclasses as dc
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.acquisition.acquisition import AcquisitionParameters
from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.fitness.matching import NO_GAINS, Gains, Images, Matcher
from mffdrake.recognition.genetic.generation import Generation
from mffdrake.recognition.genetic.starts import Start
from mffdrake.recognition.genetic.tracker import OneStepGaTracker
from mffdrake.recognition.poses.pose import rotation_angle, transform_from_pose
from mffdrake.recognition.poses.pose_filter import (
    PoseFilter,
    PoseFilterParameters,
    body_covariance,
    pose_covariance,
)
from mffdrake.recognition.poses.tracking_state import TrackingState
from mffdrake.recognition.refinement.refinement import BorderRefiner
from mffdrake.recognition.tracking.confidence import Evidence, confidence, probability_within
from mffdrake.recognition.tracking.detection import Detection, Detector, draw_near

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene

Array = NDArray[np.float64]

_SELDOM = 4  # Every so many frames it searches beside what it relies on.
_INSIST = 4.0  # So many margins better must another pose be than one that is being tracked.
# What an image seen before may be off where the target should be by now: so much, ...
_STALE_SHIFT, _STALE_TURN = 0.0003, np.radians(0.05)  # [m], [rad]
# ... and more by the motion's covariance, but no more than this.
_MOST_STALE_SHIFT, _MOST_STALE_TURN = 0.003, np.radians(0.6)
_TURNING = 7.0  # standard deviations, of three axes together, of a change of velocity in a frame
_GATE = 25.0  # the normalized innovation squared of an outlier, see `PoseFilter.nis`
_OUTLIER_FACTOR = 0.5  # on the confidence in a pose that is an outlier of the motion

PER_FRAME = PoseFilterParameters(
    acceleration=0.0001, angular_acceleration=0.0004, speed=0.010, angular_speed=0.10,
    adaptive=True,
)  # fmt: skip
"""How a target may move on top of what feedforward tells, with the frame as the unit of time."""


@dataclass(frozen=True, kw_only=True)
class RobustTracker:
    """The 1-step GA with an acquisition before it and a judgement behind it.

    *Searching*, it takes one generation of the GA a frame, as ever, and beside it the
    `Acquisition`'s proposals and steps. A pose that can be refined and explains enough of its
    borders is found. Where the solid, turned so that its shape comes to lie on itself, matches as
    well, its pose is ambiguous.

    *Tracking*, it takes one generation around the predicted pose and refines the best individual.
    Where that fails, the prediction was poor, and wide steps from it are taken. Where it explains
    little, it searches beside, now and then. A `PoseFilter` follows the motion that the target has
    of its own, on top of the hand's where that is fed forward, and carries all hypotheses along.

    *Not seen*, the pose is predicted for some frames, and counts as lost from then on. Meanwhile it
    searches where the target may be by now, and everywhere.

    All that it carries from frame to frame is in the `Generation`; see `Tracker`.

    Attributes:
        ga: The 1-step GA with all of its parameters. Its refiner is a `BorderRefiner`.
        parameters: How it searches and when it believes.
        motion: How the target may move by itself, with the frame as the unit of time.

    Raises:
        TypeError: When the GA's refiner is another one.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> ga = OneStepGaTracker(matcher=matcher, refiner=BorderRefiner(matcher))
        >>> tracker = RobustTracker(ga=ga)
        >>> black = 2 * [np.zeros((480, 640, 3), dtype=np.uint8)]
        >>> tracker.start_population(black).state.name
        'SEARCHING'
    """

    ga: OneStepGaTracker
    parameters: AcquisitionParameters = field(default_factory=AcquisitionParameters)
    motion: PoseFilterParameters = PER_FRAME

    def __post_init__(self) -> None:
        """Checks the refiner."""
        if not isinstance(self.ga.refiner, BorderRefiner):
            raise TypeError(
                f"RobustTracker: ga.refiner must be a BorderRefiner, not a "
                f"{type(self.ga.refiner).__name__}; without refinement, use the OneStepGaTracker"
            )

    @property
    def matcher(self) -> Matcher:
        """The solid, its colors and the cameras."""
        return self.ga.matcher

    @property
    def rig(self) -> CameraRig:
        """The cameras."""
        return self.ga.rig

    @property
    def num_hypotheses(self) -> int:
        """Number of hypotheses: the population's size."""
        return self.ga.num_hypotheses

    @property
    def initial_pose(self) -> Array:
        """The center of the search range, shape (6,)."""
        return self.ga.initial_pose

    def with_start(self, start: Start) -> RobustTracker:
        """The same with another first population."""
        return dc.replace(self, ga=self.ga.with_start(start))

    def start_population(
        self, images: Images, *, frame: int = 0, gains: Gains = NO_GAINS
    ) -> Generation:
        """Takes the first frame.

        Args:
            images: One a camera, uint8, shape (height, width, 3 or 4).
            frame: Number of the frame, which the random numbers depend on.
            gains: White balance.

        Returns:
            The population, with the target's pose first where it is found.
        """
        scene, rng = self.matcher.scene(images, gains), self.ga.rng(frame)
        first, _ = self._with_hashes(self._plain.draw(scene, gains, rng), scene)
        return self._search(first, scene, frame, rng)

    def start_from(self, generation: Generation, images: Images, *, frame: int) -> Generation:
        """Takes the first frame where a search on its images has found a pose.

        Args:
            generation: The population that was found.
            images: One a camera, uint8, shape (height, width, 3 or 4).
            frame: Number of the frame, which the random numbers depend on.

        Returns:
            The population, with the pose first that explains the images best: the one that was
            found, or another; and what is to be thought of it. Where none explains enough, what
            was found, without confidence.
        """
        scene, rng = self.matcher.scene(images, generation.gains), self.ga.rng(frame)
        first, _ = self._with_hashes(generation, scene)
        judged = self._search(first, scene, frame, rng)
        if judged.refined:
            return judged
        found = {key: getattr(generation, key) for key in ("poses", "fitness", "covariance")}
        return dc.replace(judged, **found)

    def track(self, generation: Generation, images: Images, *, frame: int) -> Generation:
        """Advances by one frame.

        Args:
            generation: The last frame's result, its poses carried to this frame (Eq. (23)) or,
                without motion feedforward, as they were.
            images: One a camera, uint8, shape (height, width, 3 or 4).
            frame: Number of the frame, which the random numbers depend on.

        Returns:
            The population, the recognized pose first, and what is to be thought of it.

        Raises:
            ValueError: When the population's size is not the parameters'.
        """
        self.ga.check_size(generation)
        scene, rng = self.matcher.scene(images, generation.gains), self.ga.rng(frame)
        generation, is_stale = self._with_hashes(self._predict(generation), scene)
        if generation.motion is None or generation.state == TrackingState.LOST:
            generation = self.ga.breed(generation, scene, rng)
            return self._search(generation, scene, frame, rng)
        seen, bred = self._detect(generation, scene, frame, rng)
        if seen is not None and not (is_stale and self._is_elsewhere(seen, generation)):
            return self._accept(bred, seen, scene)
        if is_stale:
            return self._coast(generation)
        return self._search(generation, scene, frame, rng)

    def _with_hashes(self, generation: Generation, scene: Scene) -> tuple[Generation, bool]:
        """With the images' hashes, and whether one of them was there at the last frame."""
        from mffdrake.recognition.camera.lens import image_hash  # numba: slow to import

        hashes = tuple(image_hash(view) for view in scene.views)
        both = zip(hashes, generation.image_hashes, strict=False)
        is_stale = any(new == old for new, old in both)
        return dc.replace(generation, image_hashes=hashes), is_stale

    def _is_elsewhere(self, seen: Detection, generation: Generation) -> bool:
        """Whether a pose in an image seen before is not where the target should be by now.

        It should be where its motion has it; or where it was last seen, believed or not. A target
        that turns back may look the same at two frames, and where it was not expected.
        """
        assert generation.motion is not None
        motion, C = generation.motion, body_covariance(seen.pose, seen.refined.covariance)
        apart = max(_STALE_SHIFT, 4.0 * float(np.sqrt(np.trace(C[:3, :3]))))
        turned = max(_STALE_TURN, 4.0 * float(np.sqrt(np.trace(C[3:, 3:]))))
        apart += _TURNING * motion.noise_scale * self.motion.acceleration
        turned += _TURNING * motion.noise_scale * self.motion.angular_acceleration
        apart, turned = min(apart, _MOST_STALE_SHIFT), min(turned, _MOST_STALE_TURN)
        return all(
            np.linalg.norm(seen.pose[:3] - pose[:3]) > apart
            or rotation_angle(seen.pose[3:], pose[3:]) > turned
            for pose in (motion.pose, generation.best)
        )

    def _predict(self, generation: Generation) -> Generation:
        """All hypotheses, carried along with the target's own motion."""
        if generation.motion is None:
            return generation
        return generation.moved_with_target(generation.motion.predict(1.0, self.motion))

    def _detect(
        self, generation: Generation, scene: Scene, frame: int, rng: np.random.Generator
    ) -> tuple[Detection | None, Generation]:
        """What the images show near the predicted pose, and the population bred there."""
        p = self.parameters
        assert generation.motion is not None
        predicted = generation.motion.pose
        bred = self.ga.breed(generation, scene, rng, center=predicted)
        seen = self.detector.near(bred.best, predicted, scene)
        if seen is None:
            return None, bred
        tracked = generation.is_tracking
        doubtful = seen.explained.share < p.sure and not (tracked and frame % _SELDOM)
        if doubtful or generation.state == TrackingState.AMBIGUOUS:
            other, _ = self.detector.anywhere(scene, bred.poses[:1], frame, rng)
            if other is not None and not self.detector.is_same(other.pose, seen.pose):
                better = other.explained.shown / max(1, seen.explained.shown) - 1.0
                if better > p.margin * (_INSIST if tracked else 1.0):
                    seen = other
                elif better > -p.margin and not tracked:  # which it was where others had less
                    seen = seen._replace(ambiguous=True)
            elif not tracked:
                seen = self.detector.resolve(seen, scene)
        return seen, bred

    def _search(
        self, generation: Generation, scene: Scene, frame: int, rng: np.random.Generator
    ) -> Generation:
        """Takes a frame on which the pose is not known, or only by prediction."""
        known = generation.poses[:1]
        if generation.motion is not None:
            known = np.concatenate([known, draw_near(generation.motion, rng)])
        seen, candidates = self.detector.anywhere(scene, known, frame, rng)
        if seen is not None:
            return self._accept(dc.replace(generation, motion=None), seen, scene)
        unseen = self._coast(generation)
        if unseen.state == TrackingState.PREDICTED or not candidates:
            return unseen
        return self.ga.join(unseen, np.stack([one.pose for one in candidates]), scene)

    def _coast(self, generation: Generation) -> Generation:
        """A frame whose images say nothing: for a while, the pose is where it should be by now."""
        motion, lost_for = generation.motion, generation.unseen - self.parameters.patience
        if motion is None or lost_for >= 0:
            never = motion is None
            return dc.replace(
                generation,
                covariance=None,
                state=TrackingState.SEARCHING if never else TrackingState.LOST,
                confidence=0.0,
                is_tracking=False,
                unseen=0 if never else generation.unseen + 1,
            )
        certain = min(generation.confidence, probability_within(motion.covariance[:6, :6]))
        return dc.replace(
            generation,
            poses=np.concatenate([motion.pose[None], generation.poses[:-1]]),
            covariance=pose_covariance(motion.pose, motion.covariance[:6, :6]),
            state=TrackingState.PREDICTED,
            confidence=certain,
            is_tracking=generation.is_tracking and certain >= self.parameters.keep,
            unseen=generation.unseen + 1,
        )

    def _accept(self, generation: Generation, seen: Detection, scene: Scene) -> Generation:
        """A frame whose images show the pose."""
        p, pose, C = self.parameters, seen.pose, seen.refined.covariance
        motion, unseen = generation.motion, 0
        if motion is None:
            motion = PoseFilter.of(pose, C, self.motion)
        else:
            pose, C = self._nearest(pose, C, motion.pose)
            updated = motion.update(pose, C)
            if updated.nis <= _GATE:
                motion = updated
            elif generation.unseen == 0:  # It may be an image of another time.
                motion, unseen = motion.reject(pose, C), 1
            else:
                motion = dc.replace(
                    PoseFilter.of(pose, C, self.motion), noise_scale=motion.noise_scale
                )
        certain = 0.0
        if not seen.ambiguous:
            covariance = body_covariance(pose, C)
            evidence = Evidence.of(seen.refined, covariance, seen.explained, motion.nis)
            certain = confidence(evidence) * (_OUTLIER_FACTOR if unseen else 1.0)
        is_tracking = certain >= (p.keep if generation.is_tracking else p.believe)
        gains = generation.gains
        if is_tracking:
            gains = self.ga.white_balance.adapt(gains, pose, scene, self.matcher)
        return dc.replace(
            generation,
            poses=np.concatenate([pose[None], generation.poses[:-1]]),
            fitness=np.concatenate([[seen.refined.fitness], generation.fitness[:-1]]),
            covariance=None if seen.ambiguous else C,
            gains=gains,
            state=TrackingState.AMBIGUOUS if seen.ambiguous else TrackingState.TRACKING,
            confidence=certain,
            is_tracking=is_tracking,
            unseen=unseen,
            motion=motion,
        )

    def _nearest(self, pose: Array, C: Array, expected: Array) -> tuple[Array, Array]:
        """Of all poses that look like one, the one nearest to an expected one; its covariance."""
        nearest = self.detector.symmetries.nearest(pose, expected)
        if np.array_equal(nearest, pose):
            return pose, C
        turn = transform_from_pose(nearest)[0].T @ transform_from_pose(pose)[0]
        both = np.kron(np.eye(2), turn)
        return nearest, pose_covariance(nearest, both @ body_covariance(pose, C) @ both.T)

    @cached_property
    def _plain(self) -> OneStepGaTracker:
        """The GA with no more first candidates than individuals: to find it is not its task."""
        return dc.replace(self.ga, parameters=dc.replace(self.ga.parameters, first_candidates=1))

    @cached_property
    def detector(self) -> Detector:
        """What it looks for the target with, in one frame's images."""
        assert isinstance(self.ga.refiner, BorderRefiner)  # as was checked
        return Detector(self.ga.refiner, self.ga.coding.search_range, self.parameters)
