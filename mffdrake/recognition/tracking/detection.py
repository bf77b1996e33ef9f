"""What one frame's images show of the target: near where it should be, or anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.acquisition.acquisition import (
    Acquisition,
    AcquisitionParameters,
    Candidate,
    Explained,
)
from mffdrake.recognition.genetic.genetic import SearchRange
from mffdrake.recognition.poses.pose import rotation_angle
from mffdrake.recognition.poses.pose_filter import PoseFilter
from mffdrake.recognition.refinement.refinement import BorderRefiner, Refinement
from mffdrake.recognition.solid.symmetry import Symmetries, Turns, find_look_alikes, find_symmetries

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene

Array = NDArray[np.float64]

_ONE = (0.1, np.radians(10.0))  # of the solid's size, and an angle [rad]: one pose, not two
_LIKE = 0.5  # A look that is less fit by this factor is none.
_AS_FIT = 0.05  # Of two looks, one less fit by this is worse.

_NEAR = 20  # proposals where the target was last seen
_LEAST_SPREAD = np.repeat([0.010, 0.03], 3)  # of them: position [m], quaternion
_MOST_SPREAD = np.repeat([0.100, 0.30], 3)


def draw_near(motion: PoseFilter, rng: np.random.Generator) -> Array:
    """Poses where the target may be by now, shape (K, 6)."""
    std = np.sqrt(np.diag(motion.covariance)[:6]) * np.repeat([1.0, 0.5], 3)
    spread = np.clip(std, _LEAST_SPREAD, _MOST_SPREAD)
    near = motion.pose + spread * rng.standard_normal((_NEAR, 6))
    near[:, 3:] /= np.maximum(1.0, np.linalg.norm(near[:, 3:], axis=1, keepdims=True))
    return np.asarray(near)


class Detection(NamedTuple):
    """A pose that the images show.

    Attributes:
        refined: Its refinement, which converged.
        explained: Its borders that they show.
        ambiguous: Whether they show another pose as well.
    """

    refined: Refinement
    explained: Explained
    ambiguous: bool = False

    @property
    def pose(self) -> Array:
        """Pose vector, shape (6,)."""
        return self.refined.pose


@dataclass(frozen=True, eq=False)
class Detector:
    """Looks for poses that can be refined and explain their borders.

    Attributes:
        refiner: It refines them; its matcher has the solid, its colors and the cameras.
        search_range: Where they are looked for.
        parameters: How, and when they are believed.
    """

    refiner: BorderRefiner
    search_range: SearchRange
    parameters: AcquisitionParameters

    def near(self, bred: Array, predicted: Array, scene: Scene) -> Detection | None:
        """What the images show near two poses, with wide steps only where narrow ones fail.

        Args:
            bred: Pose vector of the GA's best individual, shape (6,).
            predicted: Pose vector where the target should be, shape (6,).
            scene: The images, see `Matcher.scene`.
        """
        for start in (bred, predicted):
            seen = self._refine(start, scene, self.parameters.lost)
            if seen is not None:
                return seen
        steps = self._acquisition.approach(np.stack([predicted, bred]), scene)
        for candidate in steps[:1]:
            return self._refine(candidate.pose, scene, self.parameters.lost)
        return None

    def anywhere(
        self, scene: Scene, known: Array, frame: int, rng: np.random.Generator
    ) -> tuple[Detection | None, list[Candidate]]:
        """The pose that explains most, if it is one; and all that were looked at.

        Args:
            scene: The images.
            known: Pose vectors that are tried besides the proposals, shape (K, 6).
            frame: Number of the frame.
            rng: Source of randomness.
        """
        candidates = self._acquisition.search(scene, known, frame, rng)
        for candidate in candidates[:1]:
            if candidate.explained.share >= 0.5 * self.parameters.found:
                seen = self._refine(candidate.pose, scene, self.parameters.found)
                if seen is not None:
                    return self.resolve(seen, scene), candidates
        return None, candidates

    def resolve(self, seen: Detection, scene: Scene) -> Detection:
        """Of the poses in which the solid may look the same, the one that explains most.

        Args:
            seen: One of them.
            scene: The images.

        Returns:
            It, ambiguous where another explains nearly as much, and its colors fit as well.
        """
        turned = self._look_alikes.of(seen.pose)
        if len(turned) == 0:
            return seen
        fitness = self.refiner.matcher.score(np.concatenate([seen.pose[None], turned]), scene)
        like = fitness[1:] >= _LIKE * fitness[0]
        turned, fitness = turned[like], fitness[np.concatenate([[True], like])]
        explained = [seen.explained, *(self._acquisition.explained(q, scene) for q in turned)]
        shown = np.array([one.shown for one in explained])
        best = int(np.argmax(shown))
        if best > 0:
            better = self._refine(turned[best - 1], scene, self.parameters.found)
            if better is None:
                best = 0
            else:
                seen = better
        rivals = np.delete(shown, best) > (1.0 - self.parameters.margin) * shown[best]
        rivals &= np.delete(fitness, best) > fitness[best] - _AS_FIT
        return seen._replace(ambiguous=bool(rivals.any()))

    def is_same(self, pose: Array, other: Array) -> bool:
        """Whether two pose vectors, each of shape (6,), are one pose within what counts.

        Poses between which the solid's symmetries leave no difference are one, too.
        """
        other = self.symmetries.nearest(other, pose)
        apart, turned = _ONE
        distance = float(np.linalg.norm(pose[:3] - other[:3]))
        angle = float(rotation_angle(pose[3:], other[3:]))
        return distance <= apart * self.refiner.matcher.solid.size and angle <= turned

    def _refine(self, pose: ArrayLike, scene: Scene, least: float) -> Detection | None:
        """A pose refined, if the images show it."""
        refined = self.refiner.refine_scene(pose, scene)
        if not refined.converged:
            return None
        explained = self._acquisition.explained(refined.pose, scene)
        return Detection(refined, explained) if explained.share >= least else None

    @cached_property
    def _acquisition(self) -> Acquisition:
        return Acquisition(self.refiner, self.search_range, self.parameters)

    @cached_property
    def symmetries(self) -> Symmetries:
        """The solid's."""
        return find_symmetries(self.refiner.matcher.solid)

    @cached_property
    def _look_alikes(self) -> Turns:
        return find_look_alikes(self.refiner.matcher.solid)
