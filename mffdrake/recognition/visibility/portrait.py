"""A solid seen from one side: which face is seen where, and which points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.visibility.aspects import as_drawn
from mffdrake.recognition.visibility.search_model import SearchModel

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_DISTANCE = 3.0  # of the camera, in sizes of the solid


@dataclass(frozen=True, eq=False)
class Portrait:
    """What a camera sees that looks at the middle of a solid; pixel centers are whole numbers.

    Attributes:
        faces: The face that is seen in each pixel, -1 for none, shape (n, n).
        points: Pixel coordinates of the inside points that are seen, shape (K, 2).
        axes: The camera's axes in the solid's frame as rows, the last one the line of sight.
        place: Its place there [m], shape (3,).
        focal_length: Its focal length [px].
        distance: Its distance from the solid's middle [m].
    """

    faces: IntArray
    points: Array
    axes: Array
    place: Array
    focal_length: float
    distance: float

    @classmethod
    def of(cls, model: SearchModel, direction: Array, pixels: int = 480) -> Portrait:
        """Draws a sampled solid.

        Args:
            model: The sampled solid.
            direction: From its middle to the camera, a unit vector in its frame, whose z is up.
            pixels: Width and height of the image.

        Example:
            >>> from mffdrake.recognition import BLUE, GREEN, RED, SolidModel
            >>> box = SearchModel(SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE)))
            >>> seen = Portrait.of(box, np.array([0.0, 0.6, 0.8]))
            >>> np.unique(seen.faces).tolist()                 # the background and two faces
            [-1, 2, 4]
        """
        from mffdrake.recognition.visibility import drawing  # numba: slow to import

        solid, distance = model.solid, _DISTANCE * model.solid.size
        drawn = as_drawn(solid)
        camera = drawing.camera_at(direction, drawn, distance, pixels)
        down = np.cross(np.cross(direction, [0.0, 0.0, -1.0]), direction)
        if np.linalg.norm(down) > 1e-6:  # Else any direction will do.
            down /= np.linalg.norm(down)
            axes = np.stack([np.cross(direction, down), down, -direction])
            camera = camera._replace(axes=axes)
        canvas = drawing.Canvas(
            np.empty((pixels, pixels)), np.empty((pixels, pixels), dtype=np.int64)
        )
        drawing.draw(camera, drawn, canvas)
        owners = model.inside_faces
        arms = camera.place - model.inside_points
        facing = np.einsum("nk,nk->n", solid.normals[owners], arms) > 0.0
        seen = [
            facing[k] and drawing.is_seen(camera, canvas, drawn, point, owners[k])
            for k, point in enumerate(model.inside_points)
        ]
        portrait = cls(
            canvas.faces, np.empty((0, 2)), camera.axes, camera.place, camera.focal, distance
        )
        shown = model.inside_points[np.array(seen, dtype=bool)]
        return replace(portrait, points=portrait.project(shown))

    def project(self, points: Array) -> Array:
        """Pixel coordinates of points [m], shape (N, 2)."""
        x, y, z = self.axes @ (points - self.place).T
        middle = 0.5 * (len(self.faces) - 1)
        return np.stack([self.focal_length * x / z, self.focal_length * y / z], axis=1) + middle
