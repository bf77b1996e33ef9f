"""Finds a pose in one set of images, from nothing: the GA, started again and again."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.matching import NO_GAINS, Gains, Images
from mffdrake.recognition.pose import rotation_angle
from mffdrake.recognition.refinement import NoRefinement
from mffdrake.recognition.symmetry import find_turns, turn_about_middle
from mffdrake.recognition.tracker import ColoredStart, Generation, OneStepGaTracker

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SearchParameters:
    """When a search gives up a round, and when it is over.

    A round is a start over the whole search range and what becomes of it. Rounds end in different
    optima; the fittest counts, once it was found more than once.

    Attributes:
        patience: A round ends after so many generations without ...
        progress: ... an increase of the fitness by this.
        turn_every: In every so-manieth generation the best pose is also tried turned, see
            `find_turns`.
        agreement: The search has converged when so many rounds ended at the fittest pose.
        same_position: Two rounds ended at the same pose if it is no farther apart than this share
            of the solid's size ...
        same_rotation_deg: ... and turned by no more than this [deg].

    Raises:
        ValueError: When a parameter is outside its range.
    """

    patience: int = 20
    progress: float = 0.005
    turn_every: int = 4
    agreement: int = 3
    same_position: float = 0.1
    same_rotation_deg: float = 10.0

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for name, low in (
            ("patience", 1), ("progress", 0), ("turn_every", 1), ("agreement", 1),
            ("same_position", 0), ("same_rotation_deg", 0),
        ):  # fmt: skip
            value = getattr(self, name)
            if not value >= low:
                raise ValueError(f"search: {name} must be at least {low}, not {value}")


@dataclass(frozen=True)
class Found:
    """What a search found.

    Attributes:
        generation: The fittest pose's population, that pose first, refined where there is a refiner
            and it converged.
        num_generations: How many generations it took.
        num_rounds: How many rounds.
        converged: Whether enough rounds agreed.
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
        if generations < 1:
            raise ValueError(f"generations must be at least 1, not {generations}")
        p, count = self.parameters, 0
        ends: list[Generation] = []
        while count < generations:
            population, best, still = None, 0.0, 0
            while count < generations and still < p.patience:
                # The random numbers of a generation are its own, whatever the frame before took.
                number = frame + (count << 32)
                if population is None:
                    population = self._breeder.start_population(
                        images, frame=number, gains=gains
                    )
                else:
                    proposals = None
                    if count % p.turn_every == 0:
                        proposals = turn_about_middle(
                            population.best, self.tracker.matcher.solid, self._turns
                        )
                    population = self._breeder.track(
                        population, images, frame=number, proposals=proposals
                    )
                count += 1
                fitness = float(population.fitness[0])
                still = 0 if fitness > best + p.progress else still + 1
                best = fitness if still == 0 else best
                if on_generation is not None:
                    top = max(float(end.fitness[0]) for end in [*ends, population])
                    on_generation(count, top)
            assert population is not None
            ends.append(population)
            if len(self._agreeing(ends)) >= p.agreement:
                break
        agreeing = self._agreeing(ends)
        # Where the fittest cannot be refined, one that agrees with it may be.
        refined = [self.tracker.refine(end, images) for end in agreeing]
        sure = [end for end in refined if end.covariance is not None]
        return Found(
            (sure or refined)[0], count, len(ends), len(agreeing) >= p.agreement
        )

    @cached_property
    def _turns(self) -> Array:
        return find_turns(self.tracker.matcher.solid)

    def _agreeing(self, ends: list[Generation]) -> list[Generation]:
        """The rounds that ended at the fittest pose, the fittest first."""
        p, vertices = self.parameters, self.tracker.matcher.solid.vertices
        size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        ends = sorted(ends, key=lambda end: -float(end.fitness[0]))
        poses = np.array([end.best for end in ends])
        near = np.linalg.norm(poses[:, :3] - poses[0, :3], axis=1) <= p.same_position * size
        turned = np.degrees(rotation_angle(poses[:, 3:], poses[0, 3:]))
        same = near & (turned <= p.same_rotation_deg)
        return [end for end, agrees in zip(ends, same, strict=True) if agrees]
