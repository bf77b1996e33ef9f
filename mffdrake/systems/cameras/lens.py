"""Lenses with a distortion, drawn behind Drake's pinhole cameras.

Drake's renderers draw what a pinhole shows. For a camera with a distortion, they draw a pinhole's
image that is large enough, and from it each pixel of the camera's image takes the mean of the
colors that its lines of sight meet there.
"""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from mffdrake.recognition import Camera, Distortion
from mffdrake.systems.callbacks import WeakCallback

__all__ = ["LensDistortion", "MakeCoveringPinhole", "NeedsLens"]

Array = NDArray[np.float64]

_MAX_ANGLE = math.radians(80.0)
"""Greatest angle from the axis: from there on a pinhole's image grows beyond all measure."""

_MAX_STEPS = 30
_TOLERANCE = 1e-6  # px
_SHARPNESS = 2.0
_MARGIN = 2  # px around what the lens shows, so that no line of sight ends at the very border


def NeedsLens(camera: Camera) -> bool:
    """Whether a camera differs from a pinhole.

    Example:
        >>> NeedsLens(Camera(width=64, height=48, fx=60, fy=60, cx=31.5, cy=23.5))
        False
    """
    distortion = camera.distortion  # A fisheye bends with all of its coefficients at zero.
    return distortion.model == "equidistant" or any(distortion.coefficients)


def MakeCoveringPinhole(camera: Camera, *, sharpness: float = _SHARPNESS) -> Camera:
    """The pinhole camera that sees all that a camera with a distortion sees.

    Args:
        camera: The camera.
        sharpness: Pixels of the pinhole's image to one of the camera's, along u as along v, at the
            principal point.

    Returns:
        A camera of the same name and place, with its principal point inside its image.

    Raises:
        ValueError: When the sharpness is not positive, or the camera sees farther from its axis
            than a pinhole can draw.

    Example:
        >>> lens = Distortion("plumb_bob", (-0.2, 0.05, 0.0, 0.0))
        >>> camera = Camera(width=64, height=48, fx=60, fy=60, cx=31.5, cy=23.5, distortion=lens)
        >>> pinhole = MakeCoveringPinhole(camera, sharpness=1.0)
        >>> pinhole.width, pinhole.height, pinhole.fx
        (76, 58, 60.0)
    """
    if not 0.0 < sharpness < math.inf:
        raise ValueError(
            f"camera '{camera.name}': sharpness must be positive, not {sharpness}; 1 keeps the "
            "resolution at the principal point"
        )
    rays = _CalcRays(camera)
    angle = math.atan(float(np.nanmax(np.linalg.norm(rays, axis=2))))
    # What a fisheye does not show is beyond its limit of 89 degrees.
    beyond = camera.distortion.model == "equidistant" and bool(np.isnan(rays).any())
    if beyond or angle > _MAX_ANGLE:
        how_far = "89 deg or more" if beyond else f"{math.degrees(angle):.1f} deg"
        raise ValueError(
            f"camera '{camera.name}': its image must reach no farther than "
            f"{math.degrees(_MAX_ANGLE):g} deg from its axis for a pinhole to draw it, not "
            f"{how_far}; give a greater focal length or a smaller image"
        )
    flat = rays.reshape(-1, 2)
    places = {}
    for side, focal, center, k in (
        ("width", camera.fx, camera.cx, 0),
        ("height", camera.fy, camera.cy, 1),
    ):
        low = min(0.0, float(np.nanmin(flat[:, k]))) * sharpness * focal
        high = max(0.0, float(np.nanmax(flat[:, k]))) * sharpness * focal
        # Without distortion and at sharpness 1, pixels shall lie on the camera's own.
        own = sharpness * (center + 0.5) - 0.5
        before = math.ceil(-low - own) + _MARGIN
        places[side] = (own + before, math.ceil(own + before + high) + 1 + _MARGIN)
    return dc.replace(
        camera,
        width=places["width"][1],
        height=places["height"][1],
        fx=sharpness * camera.fx,
        fy=sharpness * camera.fy,
        cx=places["width"][0],
        cy=places["height"][0],
        distortion=Distortion(),
    )


class LensDistortion(LeafSystem):
    """Makes the image of a camera with a distortion from that of a pinhole.

    .. pydrake_system::

        name: LensDistortion
        input_ports:
        - color_image
        output_ports:
        - distorted_image

    Each pixel takes the mean of 4 x 4 lines of sight, which see the nearest pixels of the pinhole's
    image: at a border, its colors are mixed by the areas that they cover, as in a real camera.
    It was chosen by measurement: of 30 poses of the target box at 0.6 to 1.0 m, drawn by the flat
    renderer and a pinhole twice as sharp as the camera, all were refined, to 0.05 mm in the median.
    With one line of sight a pixel it was 0.2 mm, and a tenth of the poses could not be refined; by
    interpolation between four pixels it was 0.06 to 0.1 mm, and as many could not.
    What the lens cannot show is black.

    Ports:
        color_image: ImageRgba8U of the pinhole camera.
        distorted_image: ImageRgba8U of the camera.

    Args:
        camera: The camera.
        pinhole: The camera of the given images, at the same place, such as
            `MakeCoveringPinhole` makes.

    Raises:
        ValueError: At an image of another size than the pinhole's.

    Example:
        >>> lens = Distortion("equidistant", (0.0, 0.0, 0.0, 0.0))
        >>> camera = Camera(width=64, height=48, fx=60, fy=60, cx=31.5, cy=23.5, distortion=lens)
        >>> pinhole = MakeCoveringPinhole(camera)
        >>> system = LensDistortion(camera, pinhole)
        >>> context = system.CreateDefaultContext()
        >>> _ = system.get_input_port().FixValue(
        ...     context, ImageRgba8U(pinhole.width, pinhole.height, 128))
        >>> system.get_output_port().Eval(context).at(0, 0)
        array([128, 128, 128, 128], dtype=uint8)
    """

    def __init__(self, camera: Camera, pinhole: Camera) -> None:
        super().__init__()
        self._camera, self._pinhole = camera, pinhole
        places = _CalcRays(camera) * [pinhole.fx, pinhole.fy] + [pinhole.cx, pinhole.cy]
        self._places = places.astype(np.float32)
        image = AbstractValue.Make(ImageRgba8U())
        self._image = self.DeclareAbstractInputPort("color_image", image)
        self.DeclareAbstractOutputPort(
            "distorted_image",
            lambda: AbstractValue.Make(ImageRgba8U(camera.width, camera.height)),
            WeakCallback(self._CalcDistortedImage),
        )

    def _CalcDistortedImage(self, context: Context, output: AbstractValue) -> None:
        from mffdrake.systems.cameras import resampling  # numba: slow to import

        pixels = self._image.Eval(context).data
        self._pinhole.check_image(pixels)
        image = output.get_mutable_value()
        image.resize(self._camera.width, self._camera.height)
        resampling.resample(pixels, self._places, image.mutable_data)


def _CalcRays(camera: Camera) -> Array:
    """Normalized coordinates (x, y) that are seen at the pixels' corners.

    Newton's method on the camera's own projection. The shape is (height + 1, width + 1, 2); NaN
    where nothing is seen.
    """
    eye = dc.replace(camera, R_CK=np.eye(3), p_CK=np.zeros(3))
    v, u = np.mgrid[: camera.height + 1, : camera.width + 1] - 0.5
    wanted = np.stack([u, v], axis=-1).reshape(-1, 2)
    start = (wanted - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    # A start beyond what the lens shows is drawn in to where it shows something.
    radius = np.linalg.norm(start, axis=1, keepdims=True)
    limit = 0.9 * camera.distortion.max_radius
    rays = start * np.minimum(1.0, limit / np.maximum(radius, 1e-12))
    for _ in range(_MAX_STEPS):
        pixels, jacobians = eye.project_with_jacobian(_Ahead(rays))
        error = wanted - pixels
        if np.nanmax(np.abs(error)) < _TOLERANCE:
            break
        (a, b), (c, d) = np.moveaxis(jacobians[:, :, :2], 0, -1)
        e, f = error.T
        rays += np.column_stack([d * e - b * f, a * f - c * e]) / (a * d - b * c)[:, None]
    unseen = ~(np.abs(wanted - eye.project(_Ahead(rays))).max(axis=1) < 1e3 * _TOLERANCE)
    rays[unseen] = math.nan
    return rays.reshape(camera.height + 1, camera.width + 1, 2)


def _Ahead(rays: Array) -> Array:
    """Points at depth 1, shape (n, 3)."""
    return np.column_stack([rays, np.ones(len(rays))])
