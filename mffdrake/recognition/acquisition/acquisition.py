"""Finds a solid in images from nothing: proposals, and wide steps from the best of them."""

from __future__ import annotations

import dataclasses as dc
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Le, MinLen
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.acquisition.proposals import Proposals, Proposer
from mffdrake.recognition.fitness.matching import Matcher
from mffdrake.recognition.genetic.genetic import SearchRange
from mffdrake.recognition.parameters import Count, Finite, Number, Pixels, Share, parameters
from mffdrake.recognition.refinement.refinement import BorderRefiner
from mffdrake.recognition.visibility.search_model import SamplingParameters, SearchModel

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene
    from mffdrake.recognition.refinement.borders import Stage

Array = NDArray[np.float64]

_COARSE = SamplingParameters(spacing=0.15, margin=0.015, strip_offsets=(0.015, 0.055), min_cells=2)
"""Of a solid of size 1: the proposals' scores need not tell millimeters."""
_APART = 0.075  # of the solid's size, and
_TURNED = math.radians(15.0)  # poses nearer than both are the same, before the steps;
_LEAST_IN_ONE = 10  # places where a camera should show borders, for its share to tell something
_CLOSE = 0.5  # after the first steps, so much less is enough to be another.


_Tries = Annotated[int, Ge(1), Le(10_000)]


@parameters
class AcquisitionParameters:
    """How a target is searched for, and when it is believed to be found.

    Attributes:
        proposals: So many poses a frame are proposed where the images show the solid's colors.
        tried: From so many of them, distinct ones, steps toward the borders are taken ...
        drawn: ... of which so many are the best of a blob drawn at random each, the others the
            best of all.
        glance: With so large a part (0 to 1) of all of these it begins. Where that finds a pose
            that is `sure`, the rest is spared.
        windows: How far borders are sought in the steps, one step each and two at last [px].
        early: After so many steps ...
        kept: ... so many go on, those that match best by then.
        found: Least share of explained borders (0 to 1) of a pose that is found.
        lost: Below this share of explained borders, a pose that was tracked is not seen any more.
        sure: Below this share, the search goes on, also beside the tracking.
        margin: Another pose at which the images show more borders, by this share of them (0 to 1),
            takes the place of the tracked one; one at which they show nearly as many makes it
            ambiguous.
        believe: From this confidence on, a pose is relied on (``is_tracking``), ...
        keep: ... until it falls below this one.
        patience: For so many frames the pose is predicted before it counts as lost.
        least_rows: A pose explains at most what it would if so many borders were sought.
        tolerance: How far from an edge a border lies at most that the edge explains [px].

    Raises:
        ValueError: When a parameter is outside its range.

    Example:
        >>> AcquisitionParameters(tried=8, drawn=4).found
        0.4
    """

    kind: ClassVar[str] = "blobs"

    proposals: _Tries = 150
    tried: _Tries = 24
    drawn: Annotated[int, Ge(0), Le(10_000)] = 12
    glance: Share = 0.25
    windows: Annotated[tuple[Pixels, ...], MinLen(1)] = (32, 24, 16, 12, 8, 4)
    early: Number = 2
    kept: Count = 6
    found: Share = 0.40
    lost: Share = 0.35
    sure: Share = 0.70
    margin: Share = 0.05
    believe: Share = 0.98
    keep: Share = 0.97
    patience: Count = 30
    least_rows: Count = 30
    tolerance: Annotated[Finite, Ge(0.1), Le(1e9)] = 1.0


@parameters
class NoAcquisition:
    """Leaves the search to the GA, and the judgement to whoever reads the fitness.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, SolidModel
        >>> from mffdrake.recognition import TrackerParameters
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> alone = TrackerParameters(acquisition=NoAcquisition())
        >>> type(alone.make_tracker(solid=box, rig=CameraRig.stereo())).__name__
        'OneStepGaTracker'
    """

    kind: ClassVar[str] = "none"


class Explained(NamedTuple):
    """The borders that the images should show at a pose.

    Attributes:
        shown: At so many places they do.
        share: Of the places along its visible edges, those (0 to 1).
        uneven: How much larger that share is in one camera's image than in another's (0 to 1).
    """

    shown: int
    share: float
    uneven: float = 0.0


class Candidate(NamedTuple):
    """A pose that may be the target's.

    Attributes:
        pose: Pose vector, shape (6,).
        explained: Its borders that the images show.
    """

    pose: Array
    explained: Explained


def _by_shown(candidate: Candidate) -> int:
    return -candidate.explained.shown


class _Effort(NamedTuple):
    """How many there are in a part of a search, see `AcquisitionParameters`."""

    proposals: int
    tried: int
    drawn: int
    kept: int


@dataclass(frozen=True, eq=False)
class Acquisition:
    """Searches images for a solid.

    *Steps.* A step of the `BorderRefiner` moves a pose until its edges lie where the images show
    borders. With wide windows (32 px) it comes from some centimeters and tens of degrees.

    *Explained.* The pose that is right is the one whose edges the images show: the share of the
    places along its visible edges where a border of the right colors lies within a pixel. A pose
    that only covers the right pixels has few. What is out of view does not count; what is hidden
    cannot be told from what is wrong. Of two poses that share a face, the right one may be hidden
    more, but the images show more of its borders: all that there are.

    Args:
        refiner: Its rules tell what a border is; its matcher has the solid, its colors and the
            cameras.
        search_range: Where proposals lie.
        parameters: How it searches.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> search = Acquisition(BorderRefiner(matcher), SearchRange(), AcquisitionParameters())
        >>> dark = matcher.scene(2 * [np.zeros((480, 640, 3), dtype=np.uint8)])
        >>> search.search(dark, known=[], frame=0, rng=np.random.default_rng(0))
        []
    """

    refiner: BorderRefiner
    search_range: SearchRange
    parameters: AcquisitionParameters

    @property
    def matcher(self) -> Matcher:
        """The solid, its colors and the cameras."""
        return self.refiner.matcher

    def search(
        self, scene: Scene, known: ArrayLike, frame: int, rng: np.random.Generator
    ) -> list[Candidate]:
        """The best distinct poses after steps.

        Args:
            scene: The images, see `Matcher.scene`.
            known: Pose vectors that are tried, too, shape (K, 6).
            frame: Number of the frame.
            rng: Source of randomness.

        Returns:
            Them, the one that explains most first; none where nothing is to be seen.
        """
        clues = self._proposer.find(scene)
        first = frame * sum(effort.proposals for effort in self._efforts)
        known = np.asarray(known, dtype=float).reshape(-1, 6)
        found: list[Candidate] = []
        for effort in self._efforts:
            proposed = self._proposer.propose(clues, effort.proposals, first, rng)
            found += self._step(proposed.with_known(known), scene, effort, rng)
            found.sort(key=_by_shown)
            if found and found[0].explained.share >= self.parameters.sure:
                break
            first += effort.proposals
        return found

    def _step(
        self, proposed: Proposals, scene: Scene, effort: _Effort, rng: np.random.Generator
    ) -> list[Candidate]:
        """The best distinct ones after steps."""
        early = self.parameters.early
        tried = self._pick(proposed, scene, effort.tried, effort.drawn, 1.0, rng)
        near = self._approach(tried, scene, self._stages[:early])
        of_nothing = Proposals.of_nothing(near, proposed.sources)
        near = self._pick(of_nothing, scene, effort.kept, 0, _CLOSE, rng)
        return self._judged(self._approach(near, scene, self._stages[early:]), scene)

    def approach(self, starts: ArrayLike, scene: Scene) -> list[Candidate]:
        """Poses after all steps.

        Args:
            starts: Pose vectors, shape (K, 6).
            scene: The images.

        Returns:
            Those that found borders, the one that explains most first.
        """
        starts = np.array(starts, dtype=float).reshape(-1, 6)
        return self._judged(self._approach(starts, scene, self._stages), scene)

    def explained(self, pose: ArrayLike, scene: Scene) -> Explained:
        """A pose's borders that the images show.

        Args:
            pose: Pose vector, shape (6,).
            scene: The images.
        """
        from mffdrake.recognition.refinement.borders import (  # numba: slow to import
            Stage,
            count_explained,
        )

        p = self.parameters
        look = Stage(math.ceil(p.tolerance) + 2, 4, 0)
        counts = count_explained(
            np.array(pose, dtype=float), scene, self.refiner.rules, look, float(p.tolerance)
        )
        each = counts.tolist()
        shown, sought = map(sum, zip(*each, strict=True))
        shares = [one / of for one, of in each if of >= _LEAST_IN_ONE]
        uneven = max(shares) - min(shares) if shares else 0.0
        return Explained(shown, shown / max(sought, p.least_rows), uneven)

    def _judged(self, poses: Array, scene: Scene) -> list[Candidate]:
        return sorted(
            (Candidate(pose, self.explained(pose, scene)) for pose in poses), key=_by_shown
        )

    def _pick(
        self,
        proposed: Proposals,
        scene: Scene,
        count: int,
        num_drawn: int,
        apart: float,
        rng: np.random.Generator,
    ) -> Array:
        """The distinct ones that account for the largest parts of the images, coarsely matched."""
        from mffdrake.recognition.acquisition import picking  # numba: slow to import
        from mffdrake.recognition.genetic.random_numbers import address_of

        # Not the share: of a target that is hidden in part, it is small where the pose is right.
        areas = picking.silhouette_areas(proposed.poses, scene, self.matcher.solid.facets)
        picked = picking.pick_distinct(
            proposed.poses,
            areas * self._coarse.score(proposed.poses, scene),
            proposed.origins,
            proposed.sources,
            (count, num_drawn),
            (apart * _APART * self.matcher.solid.size, math.cos(0.5 * apart * _TURNED)),
            address_of(rng),
        )
        return np.asarray(proposed.poses[picked])

    def _approach(self, starts: Array, scene: Scene, stages: tuple[Stage, ...]) -> Array:
        """Poses after some of the steps, those that found borders."""
        from mffdrake.recognition.refinement import refining  # numba: slow to import

        if not stages:
            return starts
        rules = self.refiner.rules
        # A step from afar needs more borders than one that is nearly there.
        rules = rules._replace(min_borders=round(1.5 * rules.min_borders))
        poses, arrived = refining.approach(starts, scene, rules, stages)
        return np.asarray(poses[arrived])

    @cached_property
    def _efforts(self) -> tuple[_Effort, ...]:
        p = self.parameters
        whole = _Effort(p.proposals, p.tried, min(p.drawn, p.tried), p.kept)
        first = _Effort(*(math.ceil(p.glance * number) for number in whole))
        return (first, whole) if 0.0 < p.glance < 1.0 else (whole,)

    @cached_property
    def _stages(self) -> tuple[Stage, ...]:
        from mffdrake.recognition.refinement.borders import Stage  # numba: slow to import

        windows = self.parameters.windows
        return tuple(
            Stage(window, 12 if window > 8 else 8, 2 if k == len(windows) - 1 else 1)
            for k, window in enumerate(windows)
        )

    @cached_property
    def _proposer(self) -> Proposer:
        return Proposer(self.matcher, self.search_range)

    @cached_property
    def _coarse(self) -> Matcher:
        """A matcher with few points and a wide strip."""
        m, size = self.matcher, self.matcher.solid.size
        sampling = dc.replace(
            _COARSE,
            spacing=_COARSE.spacing * size,
            margin=(_COARSE.margin or 0.0) * size,
            strip_offsets=tuple(size * offset for offset in _COARSE.strip_offsets),
        )
        rules = dc.replace(m.parameters, min_border_distance=0.0)
        return Matcher(SearchModel(m.solid, sampling), m.rig, rules, m.colors, m.channel_order)
