"""Color matching and the fitness of many poses on a rig's images: equations (21), (22)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, TypeAlias

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.camera.cameras import CameraRig, Image
from mffdrake.recognition.fitness.colors import ChannelOrder, ColorModel
from mffdrake.recognition.parameters import Finite, NonNegative, Share, check, parameters
from mffdrake.recognition.solid.symmetry import find_symmetries
from mffdrake.recognition.visibility.aspects import find_outlines, find_visibility
from mffdrake.recognition.visibility.search_model import SearchModel

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import ColorGate, Rules, Samples, Scene, Solid

Array = NDArray[np.float64]
Images: TypeAlias = Sequence[Image] | Mapping[str, Image]
"""One image a camera, in the rig's order or by the cameras' names."""

Gains: TypeAlias = tuple[float, float, float]
"""White balance: what red, green and blue are multiplied with before colors are told."""

NO_GAINS: Gains = (1.0, 1.0, 1.0)


@parameters
class MatchingParameters:
    """When a pixel counts as having a face's color, and a face as visible.

    Attributes:
        hue_tolerance_deg: Largest difference of hue, around the color circle [deg].
        min_saturation: Least saturation (0 to 1) of a pixel that has a hue; grey has none. At 0.62
            a pixel on the border between a bright color and medium grey has a hue when about half
            of it is covered, so that borders lie where they are.
        min_value: Least value, i.e. brightness (0 to 1), of a pixel that has a hue.
        min_chroma: Least chroma (0 to 1), saturation times value, of a pixel that has a hue.
        min_cosine: A face is visible above this cosine between its normal and the line from its
            center to the camera. Keep it below 0.05: a larger one makes it pay for the search to
            turn a face out of sight.
        min_border_distance: Points nearer than this to a border in the image [px] are moved away
            from it, inside points into their face (where the face is too narrow for that, they do
            not count) and the strip's outward. Nearer, a pixel may show the neighbor or a blend, so
            that the true pose of an obliquely seen face would not be the best one.

    Raises:
        ValueError: When a parameter is outside its range.

    Example:
        >>> dim = MatchingParameters(min_value=0.1, hue_tolerance_deg=25)  # for a dark room
        >>> dim.min_value, dim.min_saturation
        (0.1, 0.62)
    """

    hue_tolerance_deg: Annotated[Finite, Ge(0), Le(180)] = 20.0
    min_saturation: Share = 0.62
    min_value: Share = 0.2
    min_chroma: Share = 0.0
    min_cosine: Share = 0.0
    min_border_distance: NonNegative = 0.8


class Matcher:
    """Scores pose hypotheses by how well the projected solid's colors match all images.

    A pose's fitness is at most 1, the mean over the cameras. The share of inside points that show
    their face's color counts for it; points of the strip outside the silhouette that show *any*
    color of the model, each counted once, count against it (where two faces share a color, the sum
    in Eq. (21) as printed would subtract the strip twice). The cost is linear in the poses, in the
    points and in the cameras.

    Args:
        search_model: The sampled solid.
        rig: The cameras. Poses are the target's in its frame C.
        parameters: Tolerances.
        colors: How the solid's materials look; by default of the mesh's hues, with the parameters'
            tolerance and gates (which count for nothing where colors are given).
        channel_order: Of the images: "rgb" or "bgr".

    Raises:
        ValueError: When ``colors`` lacks one of the solid's materials.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, SolidModel
        >>> model = SearchModel(SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE)))
        >>> matcher = Matcher(model, CameraRig.stereo())
        >>> black = np.zeros((480, 640, 3), dtype=np.uint8)
        >>> matcher.fitness([[0.0, 0.155, 0.8, 0.0, 0.0, 0.0]], (black, black))
        array([0.])
    """

    def __init__(
        self,
        search_model: SearchModel,
        rig: CameraRig,
        parameters: MatchingParameters | None = None,
        colors: ColorModel | None = None,
        channel_order: ChannelOrder = "rgb",
    ) -> None:
        self.search_model = search_model
        self.rig = rig
        self.parameters = p = MatchingParameters() if parameters is None else parameters
        self.solid = solid = search_model.solid
        if colors is None:
            colors = ColorModel.of_hues(
                dict(zip(solid.materials, solid.hues, strict=True)),
                tolerance=math.radians(p.hue_tolerance_deg), min_saturation=p.min_saturation,
                min_value=p.min_value, min_chroma=p.min_chroma,
            )  # fmt: skip
        self.colors = colors
        self.channel_order: ChannelOrder = check(ChannelOrder, channel_order, "channel_order")
        self._bits = colors.bits_of(solid.materials)

    def fitness(self, poses: ArrayLike, images: Images, *, gains: Gains = NO_GAINS) -> Array:
        """Fitness F of every pose, Eq. (22).

        Args:
            poses: Pose vectors ``(r [m], eps)``, shape (N, 6).
            images: One a camera, uint8, shape (height, width, 3 or 4).
            gains: White balance.

        Returns:
            Values from 0 to 1, shape (N,).

        Raises:
            ValueError: When an image is missing, or has another type or size than its camera's; or
                the gains are not positive.
        """
        return self.score(poses, self.scene(images, gains))

    def score(self, poses: ArrayLike, scene: Scene) -> Array:
        """`fitness` on images that were made ready before.

        Args:
            poses: Pose vectors ``(r [m], eps)``, shape (N, 6).
            scene: What `scene` made of the images.

        Returns:
            Values from 0 to 1, shape (N,).
        """
        from mffdrake.recognition.fitness import kernels  # numba: slow to import

        poses = np.ascontiguousarray(poses, dtype=float).reshape(-1, 6)
        samples, rules = self.structs[1:]
        result: Array = kernels.fitness_of_poses(poses, scene, samples, rules)
        return result

    def middle_shown(self, poses: ArrayLike, scene: Scene) -> NDArray[np.int64]:
        """In how many images the middle of the solid falls on a pixel of one of its colors.

        Args:
            poses: Pose vectors ``(r [m], eps)``, shape (N, 6).
            scene: What `scene` made of the images.

        Returns:
            Numbers from 0 to that of the cameras, shape (N,).
        """
        from mffdrake.recognition.fitness import kernels  # numba: slow to import

        poses = np.ascontiguousarray(poses, dtype=float).reshape(-1, 6)
        shown: NDArray[np.int64] = kernels.middle_shown(poses, scene)
        return shown

    def scene(self, images: Images, gains: Gains = NO_GAINS) -> Scene:
        """What the compiled functions take for images, the solid and its colors.

        Args:
            images: One a camera, uint8, shape (height, width, 3 or 4).
            gains: White balance.

        Raises:
            ValueError: When an image is missing, or has another type or size than its camera's; or
                the gains are not positive.
        """
        from mffdrake.recognition.fitness.structs import Scene  # numba: slow to import

        views = self.rig.views(images)
        return Scene(views, self.structs[0], self._gate(gains), np.full(1, math.nan))

    def balanced(self, scene: Scene, gains: Gains) -> Scene:
        """The same images with another white balance.

        Args:
            scene: What `scene` made of them.
            gains: White balance.
        """
        return scene._replace(gate=self._gate(gains))

    @property
    def struct(self) -> Solid:
        """What the compiled functions take for the solid."""
        return self.structs[0]

    def _gate(self, gains: Gains) -> ColorGate:
        if gains == NO_GAINS:
            return self._plain_gate
        return self.colors.gate(channel_order=self.channel_order, gains=gains)

    @cached_property
    def _plain_gate(self) -> ColorGate:
        """The gate of nearly all frames."""
        return self.colors.gate(channel_order=self.channel_order, gains=NO_GAINS)

    @cached_property
    def structs(self) -> tuple[Solid, Samples, Rules]:
        """What the compiled functions take, images aside."""
        from mffdrake.recognition.fitness.structs import (  # numba: slow to import
            Rules,
            Samples,
            Solid,
        )

        m, solid, p = self.search_model, self.solid, self.parameters
        none = np.full((len(m.inside_points), 1), math.inf)
        nearest, second = np.hstack([m.inside_distances, none])[:, :2].T.copy()
        bits, alike = self._bits, self.colors.alike(solid.material_names)
        return (
            Solid(
                find_outlines(solid, alike), solid.normals, solid.centers,
                solid.vertices.mean(axis=0), bits, np.bitwise_or.reduce(bits),
                solid.material_numbers, alike, find_symmetries(solid).axes,
            ),
            Samples(
                find_visibility(m, alike),
                np.ascontiguousarray(m.inside_points.T), m.inside_start, m.inside_sides,
                m.inside_distances, nearest, second, m.inside_sides[:, 0].astype(np.uint64),
                m.face_sides, m.face_sides_start, int(np.diff(m.face_sides_start).max()),
                m.sides.centers, m.sides.directions, m.sides.inward,
                np.ascontiguousarray(m.edge_points.T), solid.edge_directions,
                solid.edge_faces, solid.edge_inward, m.strip_offsets,
            ),
            Rules(float(p.min_cosine), float(p.min_border_distance)),
        )  # fmt: skip
