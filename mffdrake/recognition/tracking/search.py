"""Finds a pose in one set of images, from nothing: the GA, started again and again."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.fitness.matching import NO_GAINS, Gains, Images
from mffdrake.recognition.genetic.generation import Generation
from mffdrake.recognition.genetic.starts import ColoredStart
from mffdrake.recognition.genetic.tracker import OneStepGaTracker
from mffdrake.recognition.parameters import Count, NonNegative, Number, check, parameters
from mffdrake.recognition.poses.pose import rotation_angle
from mffdrake.recognition.refinement.refinement import NoRefinement
from mffdrake.recognition.solid.symmetry import find_turns, turn_about_middle

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene

Array = NDArray[np.float64]

_POLISHING = 0.9  # share of the children that are small motions of the best


@parameters
class SearchParameters:
    """When a search gives up a round, and when it is over.

    A round is a start over the whole search range and what becomes of it. Rounds end in different
    optima; the fittest counts, once it was found more than once.

    Attributes:
        patience: A round ends after so many generations without ...
        progress: ... an increase of the fitness by this.
        turn_every: In every n-th generation the best pose is also tried turned, see
            `find_turns`.
        polish: In the end the fittest pose's population is bred for so many generations without
            newcomers; at most a fifth of all generations.
        agreement: The search has converged when so many rounds ended at the fittest pose.
        same_position: Two rounds ended at the same pose if it is no farther apart than this share
            of the solid's size ...
        same_rotation_deg: ... and turned by no more than this [deg].

    Raises:
        ValueError: When a parameter is outside its range.

    Example:
        >>> SearchParameters(agreement=2).patience
        20
    """

    patience: Count = 20
    progress: NonNegative = 0.005
    turn_every: Count = 4
    polish: Number = 40
    agreement: Count = 3
    same_position: NonNegative = 0.1
    same_rotation_deg: NonNegative = 10.0


@dataclass(frozen=True)
class Found:
    """What a search found.

    Attributes:
        generation: The fittest pose's population, that pose first, refined where there is a refiner
            and it converged.
        num_generations: How many generations it took.
        num_rounds: How many rounds.
        converged: Whether enough rounds agreed.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, PoseTracker, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> tracker = PoseTracker.of(CameraRig.stereo(), box, channel_order="rgb")
        >>> _, found = tracker.search(2 * [np.zeros((480, 640, 3), dtype=np.uint8)], generations=5)
        >>> found.num_rounds, found.converged
        (1, False)
    """

    generation: Generation
    num_generations: int
    num_rounds: int
    converged: bool


class PoseSearch:
    """Searches one set of images over the tracker's whole search range.

    Args:
        tracker: The algorithm, with all of its parameters; its start counts for nothing.
        parameters: When rounds and the search end.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, SearchModel, SolidModel
        >>> from mffdrake.recognition import Matcher
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> tracker = OneStepGaTracker(matcher=Matcher(SearchModel(box), CameraRig.stereo()))
        >>> images = 2 * [np.zeros((480, 640, 3), dtype=np.uint8)]
        >>> PoseSearch(tracker).search(images, 5).num_generations
        5
    """

    def __init__(
        self, tracker: OneStepGaTracker, parameters: SearchParameters | None = None
    ) -> None:
        self.tracker = tracker
        self.parameters = SearchParameters() if parameters is None else parameters
        self._breeder = dc.replace(tracker, refiner=NoRefinement(), start=ColoredStart())
        local = dc.replace(tracker.parameters, newcomer_share=0.0, local_share=_POLISHING)
        self._polisher = dc.replace(self._breeder, parameters=local)

    def search(
        self,
        images: Images,
        generations: int,
        *,
        frame: int = 0,
        gains: Gains = NO_GAINS,
        on_generation: Callable[[int, float], None] | None = None,
    ) -> Found:
        """Searches until rounds agree, or for a number of generations.

        Args:
            images: One a camera, uint8, shape (height, width, 3 or 4).
            generations: Greatest number of generations, at least 1.
            frame: Number of the frame, which the random numbers depend on.
            gains: White balance.
            on_generation: Called after every generation with their number and the best fitness.

        Returns:
            What was found.

        Raises:
            ValueError: When ``generations`` is below 1, or an image does not fit its camera.
        """
        check(Count, generations, "generations")
        scene = self.tracker.matcher.scene(images, gains)
        p, count = self.parameters, 0
        polish = min(p.polish, generations // 5)
        ends: list[Generation] = []

        def step(breed: Callable[[int], Generation]) -> Generation:
            nonlocal count
            # The random numbers of a generation are its own, whatever the frame before took.
            population = breed(frame + (count << 32))
            count += 1
            if on_generation is not None:
                top = max(float(end.fitness[0]) for end in [*ends, population])
                on_generation(count, top)
            return population

        while count < generations - polish:
            population = step(lambda number: self._breeder.start_on(scene, gains, number))
            best, still = float(population.fitness[0]), 0
            while count < generations - polish and still < p.patience:
                population = step(
                    lambda number, last=population: self._breed(last, scene, number)  # type: ignore[misc]
                )
                fitness = float(population.fitness[0])
                still = 0 if fitness > best + p.progress else still + 1
                best = fitness if still == 0 else best
            ends.append(population)
            if len(self._agreeing(ends)) >= p.agreement:
                break
        agreeing = self._agreeing(ends)
        converged = len(agreeing) >= p.agreement
        for _ in range(polish):
            agreeing[0] = step(
                lambda number: self._polisher.track_on(
                    agreeing[0], self._balanced(scene, agreeing[0]), number
                )
            )
        # Where the fittest cannot be refined, one that agrees with it may be.
        refined = [self.tracker.refine(end, self._balanced(scene, end)) for end in agreeing]
        first = next((end for end in refined if end.refined), refined[0])
        return Found(first, count, len(ends), converged)

    def _balanced(self, scene: Scene, population: Generation) -> Scene:
        """The images with a population's white balance."""
        return self.tracker.matcher.balanced(scene, population.gains)

    def _breed(self, population: Generation, scene: Scene, number: int) -> Generation:
        """The next generation; now and then the best pose is tried turned, too."""
        proposals = None
        if (number >> 32) % self.parameters.turn_every == 0:
            solid = self.tracker.matcher.solid
            proposals = turn_about_middle(population.best, solid, self.turns)
        return self._breeder.track_on(
            population, self._balanced(scene, population), number, proposals
        )

    @cached_property
    def turns(self) -> Array:
        """Those under which the solid looks much the same, and which each round tries."""
        return find_turns(self.tracker.matcher.solid)

    def _agreeing(self, ends: list[Generation]) -> list[Generation]:
        """The rounds that ended at the fittest pose, the fittest first."""
        p, size = self.parameters, self.tracker.matcher.solid.size
        ends = sorted(ends, key=lambda end: -float(end.fitness[0]))
        poses = np.array([end.best for end in ends])
        near = np.linalg.norm(poses[:, :3] - poses[0, :3], axis=1) <= p.same_position * size
        turned = np.degrees(rotation_angle(poses[:, 3:], poses[0, 3:]))
        same = near & (turned <= p.same_rotation_deg)
        return [end for end, agrees in zip(ends, same, strict=True) if agrees]
