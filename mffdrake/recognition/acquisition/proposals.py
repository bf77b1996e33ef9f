"""Where the target may be: poses proposed from what the images show of its colors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.fitness.matching import Matcher
from mffdrake.recognition.genetic.genetic import SearchRange
from mffdrake.recognition.poses.pose import quaternion_scalar, quaternion_vector
from mffdrake.recognition.visibility.aspects import as_drawn

if TYPE_CHECKING:
    from mffdrake.recognition.acquisition.appearance import Appearances, AppearanceTable
    from mffdrake.recognition.acquisition.blobs import Blobs, Grid
    from mffdrake.recognition.acquisition.proposing import Bounds, Frames, Sources
    from mffdrake.recognition.fitness.structs import Scene

Array = NDArray[np.float64]

_PIXELS_APART = 160  # The grid that is searched for blobs has about so many pixels in a row.
_LEAST_PIXELS = 6  # of a blob, in that grid
_NUM_SIDES = 6000  # from which the solid's appearance is known, over all orientations
_MARGIN = 0.25  # of a quaternion: a camera may look past the middle of its image


@dataclass(frozen=True, eq=False)
class Proposals:
    """Poses, each with the source that it comes from.

    Attributes:
        poses: Pose vectors, shape (N, 6).
        origins: Number of each one's source, shape (N,).
        sources: The sources: blobs, or pairs of them.
    """

    poses: Array
    origins: NDArray[np.int64]
    sources: Sources

    @classmethod
    def of_nothing(cls, poses: Array, sources: Sources) -> Proposals:
        """Poses that come from none of the sources."""
        return cls(poses, np.full(len(poses), -1), sources)

    def with_known(self, poses: Array) -> Proposals:
        """The same and poses that come from none of the sources, shape (K, 6)."""
        return Proposals(
            np.concatenate([self.poses, poses]),
            np.concatenate([self.origins, np.full(len(poses), -1)]),
            self.sources,
        )


class Clues(NamedTuple):
    """What images show of a solid's colors.

    Attributes:
        blobs: The patches of its colors.
        appearances: How each looks.
        frames: Each one's frame F.
        sources: Blobs, or pairs of them, where the solid may be.
    """

    blobs: Blobs
    appearances: Appearances
    frames: Frames
    sources: Sources


class Proposer:
    """Proposes poses at the blobs of the solid's colors that the images show.

    *Blobs* are connected patches of pixels of any of the colors, and of one of them each. *Places*:
    two blobs of two cameras that may be one thing, by their sizes and as their lines of sight
    meet, are at a place; of a single blob, its size tells how far away it is. *Orientations*: most
    of those for a blob of any color are those in which the solid looks most like it, by the shares
    of the colors and where they lie, from a table of appearances; the others are spread evenly.

    It works for every rig, of one camera or of several.

    Args:
        matcher: The solid, its colors and the cameras.
        search_range: Poses are proposed within it.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> black = 2 * [np.zeros((480, 640, 3), dtype=np.uint8)]
        >>> rng = np.random.default_rng(0)
        >>> proposer = Proposer(matcher, SearchRange())
        >>> clues = proposer.find(matcher.scene(black))
        >>> proposer.propose(clues, 10, 0, rng).poses.shape         # nothing to be seen
        (0, 6)
    """

    def __init__(self, matcher: Matcher, search_range: SearchRange) -> None:
        self.matcher = matcher
        self.search_range = search_range

    def find(self, scene: Scene) -> Clues:
        """What the images show of the solid's colors.

        Args:
            scene: The images, see `Matcher.scene`.
        """
        from mffdrake.recognition.acquisition import proposing  # numba: slow to import
        from mffdrake.recognition.acquisition.appearance import Appearances
        from mffdrake.recognition.acquisition.blobs import find_blobs, label_pixels

        found: list[tuple[Array, ...]] = []
        for index, (view, grid) in enumerate(zip(scene.views, self.grids, strict=True)):
            labels = label_pixels(view, grid, scene.gate, self.classes)
            for of_one_color in (False, True):
                found.append(
                    find_blobs(labels, grid, index, self.num_colors, of_one_color, _LEAST_PIXELS)
                )
        blobs, colors, moments = (np.concatenate(parts) for parts in zip(*found, strict=True))
        appearances = Appearances(colors, moments)
        eyes = tuple(view.eye for view in scene.views)
        frames = proposing.Frames(*proposing.rig_frames(blobs, eyes, self.turns))
        sources = proposing.pair_blobs(blobs, appearances, frames, self.table, self.bounds)
        return Clues(blobs, appearances, frames, sources)

    def propose(self, clues: Clues, count: int, first: int, rng: np.random.Generator) -> Proposals:
        """Poses within the search range.

        Args:
            clues: What the images show.
            count: How many.
            first: How many were proposed before, on this frame and those before it.
            rng: Source of randomness.

        Returns:
            The proposals; fewer where few of those drawn lie in the search range, none where the
            images show nothing of the solid's colors.
        """
        from mffdrake.recognition.acquisition import proposing  # numba: slow to import
        from mffdrake.recognition.genetic.random_numbers import address_of

        poses, origins = proposing.propose(
            *clues, self.table, self.matcher.struct.middle, self.bounds, count, first,
            address_of(rng),
        )  # fmt: skip
        return Proposals(poses, origins, clues.sources)

    @cached_property
    def turns(self) -> Array:
        """The cameras' orientations R_CK as quaternions, scalar part first."""
        turns = []
        for camera in self.matcher.rig.cameras:
            eps = quaternion_vector(camera.R_CK)
            turns.append([float(quaternion_scalar(eps)), *eps])
        return np.array(turns)

    @cached_property
    def grids(self) -> tuple[Grid, ...]:
        """Which pixels of each camera's images are looked at."""
        from mffdrake.recognition.acquisition.blobs import Grid, make_grid  # numba: slow to import

        grids = []
        for camera in self.matcher.rig.cameras:
            step = max(1, round(camera.width / _PIXELS_APART))
            grids.append(Grid(*make_grid(camera.eye.lens, camera.width, camera.height, step)))
        return tuple(grids)

    @cached_property
    def face_classes(self) -> NDArray[np.int8]:
        """Numbers of the faces' colors; materials that cannot be told apart are of one."""
        m = self.matcher
        first = m.colors.first_alike(m.solid.materials)
        return np.unique(first, return_inverse=True)[1].astype(np.int8)

    @cached_property
    def classes(self) -> NDArray[np.int8]:
        """Numbers of the colors by their bits, -1 for those of other things."""
        m = self.matcher
        classes = np.full(32, -1, dtype=np.int8)
        bits = np.rint(np.log2(m.colors.bits_of(m.solid.materials))).astype(int)
        classes[bits] = self.face_classes
        return classes

    @property
    def num_colors(self) -> int:
        """How many colors can be told apart."""
        return int(self.face_classes.max()) + 1

    @cached_property
    def bounds(self) -> Bounds:
        """Where the solid may be, and how far from the cameras."""
        from mffdrake.recognition.acquisition.proposing import Bounds  # numba: slow to import

        span, solid = self.search_range, self.matcher.solid
        size = solid.size
        ends = np.array([span.lower[:3], span.upper[:3]])
        corners = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3)
        near, far = np.inf, 0.0
        for camera in self.matcher.rig.cameras:
            inside = np.clip(camera.p_CK, ends[0], ends[1])
            near = min(near, float(np.linalg.norm(inside - camera.p_CK)))
            far = max(far, float(np.linalg.norm(corners - camera.p_CK, axis=1).max()))
        # What is seen lies about the solid's middle, which may be beside its frame's origin.
        reach = 0.5 * size + float(np.linalg.norm(solid.vertices.mean(axis=0)))
        return Bounds(span.lower, span.upper, max(0.0, near - reach), far + reach, size)

    @cached_property
    def table(self) -> AppearanceTable:
        """How the solid looks from all sides that the search range allows."""
        from mffdrake.recognition.acquisition.appearance import (  # numba: slow to import
            Appearances,
            AppearanceTable,
            Corners,
            draw_appearances,
            multiply_all,
            project_appearances,
            spread_turns,
        )

        span = self.search_range
        turns = spread_turns(_NUM_SIDES)
        allowed = np.zeros(len(turns), dtype=bool)
        for turn in self.turns:
            eps = multiply_all(turn, turns)[:, 1:]
            lower, upper = span.lower[3:] - _MARGIN, span.upper[3:] + _MARGIN
            allowed |= ((eps >= lower) & (eps <= upper)).all(axis=1)
        distance = 0.5 * (self.bounds.nearest + self.bounds.farthest)
        solid, turns = self.matcher.solid, turns[allowed]
        classes, count = self.face_classes, self.num_colors
        if solid.is_plain:
            corners = Corners(solid.vertices, solid.edges, solid.edge_faces)
            struct = self.matcher.struct
            seen = project_appearances(struct, corners, classes, count, distance, turns)
        else:
            drawn = as_drawn(solid)
            seen = draw_appearances(drawn, classes, count, distance, turns)
        area, center, colors, moments = seen
        return AppearanceTable(turns, area, center, Appearances(colors, moments))
