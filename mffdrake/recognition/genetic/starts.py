"""First populations: from nothing, where the colors are, or near a known pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.fitness.matching import Matcher
from mffdrake.recognition.genetic.genetic import GeneticAlgorithm

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene

Array = NDArray[np.float64]


class Start(Protocol):
    """Draws the candidates for the first population.

    Example:
        >>> class Ahead:
        ...     def draw(self, algorithm, rng, matcher, scene):
        ...         return algorithm.draw_near([0.0, 0.0, 0.8, 0.0, 0.0, 0.0], (0.1, 0.3), 500, rng)
        >>> start: Start = Ahead()  # A `OneStepGaTracker` takes it.
    """

    def draw(
        self, algorithm: GeneticAlgorithm, rng: np.random.Generator, matcher: Matcher, scene: Scene
    ) -> Array:
        """Pose vectors, shape (at least the population's size, 6).

        Args:
            algorithm: Its search range and its parameters count.
            rng: Source of randomness.
            matcher: The solid and the cameras.
            scene: The images, see `Matcher.scene`.
        """
        ...


@dataclass(frozen=True)
class RandomStart:
    """A first population over the whole search range: nothing is known of the pose.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, OneStepGaTracker
        >>> from mffdrake.recognition import SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> OneStepGaTracker(matcher=Matcher(SearchModel(box), CameraRig.stereo())).start
        RandomStart()
    """

    def draw(
        self, algorithm: GeneticAlgorithm, rng: np.random.Generator, matcher: Matcher, scene: Scene
    ) -> Array:
        """Pose vectors drawn evenly over the search range."""
        p = algorithm.parameters
        return algorithm.draw(p.population_size * p.first_candidates, rng)


@dataclass(frozen=True)
class ColoredStart:
    """A first population over the whole search range, where the images show the solid's colors.

    Attributes:
        draws: So many times more poses are drawn than candidates are wanted; those count whose
            middle shows a color of the solid in the most images.

    Example:
        >>> ColoredStart().draws
        20
    """

    draws: int = 20

    def draw(
        self, algorithm: GeneticAlgorithm, rng: np.random.Generator, matcher: Matcher, scene: Scene
    ) -> Array:
        """Pose vectors drawn over the search range, the best placed of many."""
        count = algorithm.parameters.population_size * algorithm.parameters.first_candidates
        poses = algorithm.draw(count * self.draws, rng)
        shown = matcher.middle_shown(poses, scene)
        return poses[np.argsort(-shown, kind="stable")[:count]]


@dataclass(frozen=True)
class NearStart:
    """A first population around a pose that is roughly known.

    Attributes:
        pose: The pose vector, shape (6,).
        spread: Standard deviations of the position [m] and of the quaternion.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, OneStepGaTracker
        >>> from mffdrake.recognition import SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> near = NearStart([0.0, 0.1, 0.8, 0.0, 0.0, 0.0], spread=(0.001, 0.001))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> black = 2 * [np.zeros((480, 640, 3), dtype=np.uint8)]
        >>> OneStepGaTracker(matcher=matcher, start=near).start_population(black).best[:3].round(1)
        array([0. , 0.1, 0.8])
    """

    pose: ArrayLike
    spread: tuple[float, float] = (0.010, 0.020)

    def draw(
        self, algorithm: GeneticAlgorithm, rng: np.random.Generator, matcher: Matcher, scene: Scene
    ) -> Array:
        """Pose vectors drawn around the known one."""
        count = algorithm.parameters.population_size
        return algorithm.draw_near(self.pose, self.spread, count, rng)
