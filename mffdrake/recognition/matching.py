"""Hue matching and the fitness of many poses on one image pair: equations (21), (22)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.solid_model import SearchModel
from mffdrake.recognition.stereo import StereoCamera

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True)
class MatchingParameters:
    """When a pixel counts as having a face's color, and a face as visible.

    Attributes:
        hue_tolerance_deg: Largest difference of hue, around the color circle [deg].
        min_saturation: Least saturation (0 to 1) of a pixel that has a hue; grey has none. At 0.62
            a pixel on the border between a bright color and medium grey has a hue when about half
            of it is covered, so that borders lie where they are.
        min_value: Least value, i.e. brightness (0 to 1), of a pixel that has a hue.
        min_cosine: A face is visible above this cosine between its normal and the line from its
            center to the camera. Keep it below 0.05: a larger one makes it pay for the search to
            turn a face out of sight.
        min_border_distance: Points nearer than this to a border in the image [px] are moved away
            from it, inside points into their face (where the face is too narrow for that, they do
            not count) and the strip's outward. Nearer, a pixel may show the neighbor or a blend, so
            that the true pose of an obliquely seen face would not be the best one.

    Raises:
        ValueError: When a parameter is outside its range.
    """

    hue_tolerance_deg: float = 20.0
    min_saturation: float = 0.62
    min_value: float = 0.2
    min_cosine: float = 0.0
    min_border_distance: float = 0.8

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for name, low, high in (
            ("hue_tolerance_deg", 0.0, 180.0),
            ("min_saturation", 0.0, 1.0),
            ("min_value", 0.0, 1.0),
            ("min_cosine", 0.0, 1.0),
            ("min_border_distance", 0.0, math.inf),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name} must be between {low:g} and {high:g}, not {value}")


class Matcher:
    """Scores pose hypotheses by how well the projected solid's colors match both images.

    A pose's fitness is at most 1. The share of inside points that show their face's hue counts
    for it; points of the strip outside the silhouette that show *any* hue of the model, each
    counted once, count against it (where two faces share a hue, the sum in Eq. (21) as printed
    would subtract the strip twice). The cost is linear in the poses and in the points.

    Args:
        search_model: The sampled solid.
        camera: The stereo geometry.
        parameters: Tolerances.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, SolidModel
        >>> model = SearchModel(SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE)))
        >>> matcher = Matcher(model, StereoCamera())
        >>> black = np.zeros((480, 640, 3), dtype=np.uint8)
        >>> matcher.fitness([[0.0, 0.155, 0.8, 0.0, 0.0, 0.0]], black, black)
        array([0.])
    """

    def __init__(
        self,
        search_model: SearchModel,
        camera: StereoCamera,
        parameters: MatchingParameters | None = None,
    ) -> None:
        self.search_model = search_model
        self.camera = camera
        self.parameters = p = MatchingParameters() if parameters is None else parameters
        solid = search_model.solid
        sixth = math.pi / 3.0  # of the color circle
        self._arguments = (
            camera.width, camera.height, camera.focal_length, camera.baseline,
            np.ascontiguousarray(search_model.inside_points.T), search_model.inside_start,
            search_model.inside_distances, search_model.inside_distances.min(axis=1),
            search_model.side_centers, search_model.side_directions,
            solid.normals, solid.centers, solid.hues / sixth,
            np.ascontiguousarray(search_model.edge_points.T), search_model.edge_start,
            search_model.edge_directions, solid.edge_faces, search_model.strip_offsets,
            solid.vertices.mean(axis=0), np.unique(solid.hues) / sixth,
            math.radians(p.hue_tolerance_deg) / sixth, p.min_saturation, p.min_value,
            p.min_cosine, p.min_border_distance,
        )  # fmt: skip

    def fitness(self, poses: ArrayLike, image_right: Image, image_left: Image) -> Array:
        """Fitness F of every pose, Eq. (22).

        Args:
            poses: Pose vectors ``(r [m], eps)``, shape (N, 6).
            image_right: Right camera's image, RGB or RGBA, uint8, shape (height, width, 3 or 4).
            image_left: Left camera's image, likewise.

        Returns:
            Values from 0 to 1, shape (N,).

        Raises:
            ValueError: When an image has another type or another size than the camera's.
        """
        from mffdrake.recognition import _kernels  # numba: slow to import

        self.check_images(image_right, image_left)
        poses = np.ascontiguousarray(poses, dtype=float).reshape(-1, 6)
        right, left = (im.reshape(-1, im.shape[2]) for im in (image_right, image_left))
        result: Array = _kernels.fitness_of_poses(poses, right, left, *self._arguments)
        return result

    def check_images(self, image_right: Image, image_left: Image) -> None:
        """Checks that images are of the camera's size.

        Args:
            image_right: Right camera's image, RGB or RGBA, uint8, shape (height, width, 3 or 4).
            image_left: Left camera's image, likewise.

        Raises:
            ValueError: When an image has another type or another size than the camera's.
        """
        for image in (image_right, image_left):
            h, w = self.camera.height, self.camera.width
            if image.shape not in ((h, w, 3), (h, w, 4)) or image.dtype != np.uint8:
                raise ValueError(
                    f"an image must be of type uint8 and shape ({h}, {w}, 3 or 4), not of type "
                    f"{image.dtype} and shape {image.shape}"
                )
