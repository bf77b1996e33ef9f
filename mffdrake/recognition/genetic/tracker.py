"""One frame of the 1-step GA: images and a predicted population in, the best pose out."""

from __future__ import annotations

import dataclasses as dc
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.fitness.matching import NO_GAINS, Gains, Images, Matcher
from mffdrake.recognition.fitness.white_balance import FixedWhiteBalance, WhiteBalance
from mffdrake.recognition.genetic.generation import Generation
from mffdrake.recognition.genetic.genetic import GeneCoding, GeneticAlgorithm, GeneticParameters
from mffdrake.recognition.genetic.local_moves import LocalMoveParameters, LocalMoves
from mffdrake.recognition.genetic.starts import RandomStart, Start
from mffdrake.recognition.parameters import check_fields
from mffdrake.recognition.poses.tracking_state import TrackingState
from mffdrake.recognition.refinement.refinement import NoRefinement, Refiner

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class OneStepGaTracker:
    """The 1-step GA, Eq. (27): a fixed number of generations (one) on every frame's images.

    It holds parameters only. What it carries from frame to frame is the `Generation`, which the
    caller keeps; random numbers depend on the seed and the frame's number alone. So the same
    arguments always give the same result.

    Attributes:
        matcher: Scores poses on images.
        coding: The genes.
        parameters: How a generation is bred.
        local_moves: How far the small motions go.
        generations_per_frame: Generations on one frame's images; the paper's 1.
        start: Draws the first population.
        refiner: Refines the best pose of every frame. A refined pose is what the frame recognizes.
            It takes the place of the population's last individual and becomes the first one, and
            the next frame's children are drawn around it. It is never rounded to genes, so nothing
            of its accuracy is lost on the way to the next frame.
        white_balance: Follows the light's color on frames whose pose is sure: refined or, without
            a refiner, of a fitness above ``sure_fitness``.
        sure_fitness: From there on the white balance trusts an unrefined pose (0 to 1).
        seed: Of the random numbers, at least 0.

    Raises:
        ValueError: When ``generations_per_frame`` or ``seed`` is out of range.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> tracker = OneStepGaTracker(matcher=Matcher(SearchModel(box), CameraRig.stereo()))
        >>> images = 2 * [np.zeros((480, 640, 3), dtype=np.uint8)]
        >>> first = tracker.start_population(images)
        >>> second = tracker.track(first, images, frame=1)
        >>> second.best.shape
        (6,)
    """

    matcher: Matcher
    coding: GeneCoding = field(default_factory=GeneCoding)
    parameters: GeneticParameters = field(default_factory=GeneticParameters)
    local_moves: LocalMoveParameters = field(default_factory=LocalMoveParameters)
    generations_per_frame: Annotated[int, Ge(1), Le(10_000)] = 1
    start: Start = field(default_factory=RandomStart)
    refiner: Refiner = field(default_factory=NoRefinement)
    white_balance: WhiteBalance = field(default_factory=FixedWhiteBalance)
    sure_fitness: float = 0.6
    seed: Annotated[int, Ge(0)] = 0
    algorithm: GeneticAlgorithm = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Checks the parameters and puts the algorithm together."""
        check_fields(self)
        solid = self.matcher.search_model.solid
        center = solid.vertices.mean(axis=0, keepdims=True)
        moves = LocalMoves(
            np.concatenate([center, solid.centers]),
            self.matcher.rig.middle,
            self.local_moves,
        )
        algorithm = GeneticAlgorithm(self.coding, self.parameters, moves)
        object.__setattr__(self, "algorithm", algorithm)

    @property
    def rig(self) -> CameraRig:
        """The cameras: the matcher's."""
        return self.matcher.rig

    @property
    def num_hypotheses(self) -> int:
        """Number of hypotheses: the population's size."""
        return self.parameters.population_size

    @property
    def initial_pose(self) -> Array:
        """The center of the search range: all that is known before the first frame, shape (6,)."""
        search_range = self.coding.search_range
        return np.asarray(0.5 * (search_range.lower + search_range.upper))

    def start_population(
        self, images: Images, *, frame: int = 0, gains: Gains = NO_GAINS
    ) -> Generation:
        """Draws and scores the first population.

        Args:
            images: One a camera, uint8, shape (height, width, 3 or 4).
            frame: Number of the frame, which the random numbers depend on.
            gains: White balance.

        Returns:
            The best of the drawn candidates, as many as the population has.
        """
        scene = self.matcher.scene(images, gains)
        return self.start_on(scene, gains, frame)

    def start_on(self, scene: Scene, gains: Gains, frame: int) -> Generation:
        """`start_population` on images that were made ready before.

        Args:
            scene: The images, see `Matcher.scene`.
            gains: Their white balance.
            frame: Number of the frame.
        """
        return self._finish(self.draw(scene, gains, self.rng(frame)), scene)

    def draw(self, scene: Scene, gains: Gains, rng: np.random.Generator) -> Generation:
        """The first population, scored, and nothing else.

        Args:
            scene: The images, see `Matcher.scene`.
            gains: Their white balance.
            rng: Source of randomness.
        """
        candidates = self.start.draw(self.algorithm, rng, self.matcher, scene)
        return self._select(candidates, scene, Generation(candidates, np.empty(0), gains=gains))

    def start_from(self, generation: Generation, images: Images, *, frame: int) -> Generation:
        """The population that a search on the first frame's images has found, as it is."""
        return generation

    def track(
        self,
        generation: Generation,
        images: Images,
        *,
        frame: int,
        proposals: ArrayLike | None = None,
    ) -> Generation:
        """Advances by one frame.

        Args:
            generation: The last frame's population, its poses carried to this frame (Eq. (23)) or,
                without motion feedforward, as they were. With its covariance, as it was, it keeps
                the first pose as it is.
            images: One a camera, uint8, shape (height, width, 3 or 4).
            frame: Number of the frame, which the random numbers depend on.
            proposals: Further pose vectors that the first generation tries, shape (K, 6).

        Returns:
            The next population, scored on these images.

        Raises:
            ValueError: When the population's size is not the parameters'.
        """
        self.check_size(generation)
        scene = self.matcher.scene(images, generation.gains)
        return self.track_on(generation, scene, frame, proposals)

    def track_on(
        self, generation: Generation, scene: Scene, frame: int, proposals: ArrayLike | None = None
    ) -> Generation:
        """`track` on images that were made ready before.

        Args:
            generation: The last population.
            scene: The images, see `Matcher.scene`, with that population's white balance.
            frame: Number of the frame.
            proposals: See `track`.
        """
        rng = self.rng(frame)
        center = generation.best if generation.refined else None
        generation = self.breed(generation, scene, rng, center, proposals)
        return self._finish(generation, scene)

    def breed(
        self,
        generation: Generation,
        scene: Scene,
        rng: np.random.Generator,
        center: ArrayLike | None = None,
        proposals: ArrayLike | None = None,
    ) -> Generation:
        """A frame's generations, scored, and nothing else.

        Args:
            generation: A population.
            scene: The images, see `Matcher.scene`.
            rng: Source of randomness.
            center: Pose vector that the children of the first are drawn around, shape (6,).
            proposals: Further pose vectors that the first generation tries, shape (K, 6).
        """
        for _ in range(self.generations_per_frame):
            poses = self.algorithm.breed(generation.poses, generation.fitness, rng, center)
            if proposals is not None:
                poses = np.concatenate([poses, proposals])
            generation = self._select(poses, scene, generation)
            center, proposals = None, None
        return generation

    def join(self, generation: Generation, poses: Array, scene: Scene) -> Generation:
        """A population in which further poses have the places of the last individuals.

        Args:
            generation: The population.
            poses: Pose vectors, fewer than it has, shape (K, 6).
            scene: The images, see `Matcher.scene`.
        """
        stay = len(generation.poses) - len(poses)
        fitness = np.concatenate([generation.fitness[:stay], self.matcher.score(poses, scene)])
        order = np.argsort(-fitness, kind="stable")
        poses = np.concatenate([generation.poses[:stay], poses])
        return dc.replace(generation, poses=poses[order], fitness=fitness[order])

    def check_size(self, generation: Generation) -> None:
        """Checks that a population has the parameters' size.

        Raises:
            ValueError: When it has another.
        """
        expected = (self.parameters.population_size, 6)
        if np.shape(generation.poses) != expected:
            raise ValueError(f"poses must have shape {expected}, not {np.shape(generation.poses)}")

    def with_start(self, start: Start) -> OneStepGaTracker:
        """The same with another first population."""
        return dc.replace(self, start=start)

    def refine(self, generation: Generation, scene: Scene) -> Generation:
        """Puts the refined best pose first, where there is one.

        Args:
            generation: A population scored on these images.
            scene: The images, see `Matcher.scene`, with the population's white balance.
        """
        refined = self.refiner.refine_scene(generation.best, scene)
        if not refined.converged:
            return generation
        return dc.replace(
            generation,
            poses=np.concatenate([refined.pose[None], generation.poses[:-1]]),
            fitness=np.concatenate([[refined.fitness], generation.fitness[:-1]]),
            covariance=refined.covariance,
            state=TrackingState.TRACKING,
        )

    def _finish(self, generation: Generation, scene: Scene) -> Generation:
        """Refines the best pose, and adapts the white balance where it is sure."""
        generation, gains = self.refine(generation, scene), generation.gains
        if generation.refined or generation.fitness[0] > self.sure_fitness:
            gains = self.white_balance.adapt(gains, generation.best, scene, self.matcher)
            return dc.replace(
                generation, gains=gains, state=TrackingState.TRACKING, is_tracking=True
            )
        return dc.replace(generation, state=TrackingState.SEARCHING, is_tracking=False)

    def _select(self, candidates: Array, scene: Scene, last: Generation) -> Generation:
        """Scores candidates and keeps the best, as many as the population has."""
        fitness = self.matcher.score(candidates, scene)
        # A stable order makes equals keep their places: the center first, survivors last.
        order = np.argsort(-fitness, kind="stable")[: self.parameters.population_size]
        return dc.replace(last, poses=candidates[order], fitness=fitness[order], covariance=None)

    def rng(self, frame: int) -> np.random.Generator:
        """A counter-based generator: its only state is the seed and the frame's number."""
        key = _Key((self.seed, frame))
        return np.random.Generator(np.random.Philox(key))  # type: ignore[arg-type]


class _Key(ISeedSequence):
    """Two numbers that are a generator's key. Given as ``key=``, NumPy seeds it first all the same.

    For that it asks the operating system for random numbers, which takes much longer.
    """

    def __init__(self, words: tuple[int, int]) -> None:
        self._words = words

    def generate_state(self, n_words: int, dtype: DTypeLike = np.uint64) -> NDArray[np.uint64]:
        """The key."""
        return np.array(self._words, dtype=np.uint64)
