"""Cameras with lenses and places of their own, and rigs of them: equations (13)-(18).

Frames: C is the rig's frame, in which poses are recognized, and K a camera's own: x right, y down,
z along the line of sight. Pixel coordinates (u, v) are whole numbers at pixel centers, as in OpenCV
and ROS, so an image of width W spans u in [-0.5, W - 0.5].
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Gt, Lt
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.camera.distortion import MODELS, Distortion
from mffdrake.recognition.parameters import (
    Finite,
    NonNegative,
    Pixels,
    Positive,
    check,
    check_fields,
    shorten,
    shown,
)

if TYPE_CHECKING:
    from mffdrake.recognition.camera.lens import Eye, View

Array = NDArray[np.float64]

_FARTHEST = 1e9  # m
Image = NDArray[np.uint8]

CALIBRATION_ERROR = 0.5  # [px] What the calibration of a real camera may well leave


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """One camera K: its image, its lens and its place in the rig.

    Attributes:
        name: What it is called.
        width: Image width [px].
        height: Image height [px].
        fx: Focal length along u [px].
        fy: Focal length along v [px].
        cx: Principal point's u [px], where pixel centers are whole numbers.
        cy: Principal point's v [px].
        distortion: The lens's.
        R_CK: Its orientation in the rig's frame C, shape (3, 3).
        p_CK: Its position in the rig's frame C [m], shape (3,).
        calibration_error: Standard deviation [px] by which all that it shows may be off together,
            along u and v: what its calibration leaves. It counts in the covariance of refined
            poses; and points so much nearer to a border do not tell on which side they are.

    Raises:
        ValueError: When a size or a focal length is not positive, a number not finite, or R_CK no
            rotation.

    Example:
        >>> camera = Camera(width=640, height=480, fx=580, fy=580, cx=319.5, cy=239.5)
        >>> camera.project([0.1, 0.0, 1.0])
        array([377.5, 239.5])
    """

    name: str = "camera"
    width: Pixels
    height: Pixels
    fx: Positive
    fy: Positive
    cx: Finite
    cy: Finite
    distortion: Distortion = field(default_factory=Distortion)
    R_CK: Array = field(default_factory=lambda: np.eye(3))
    p_CK: Array = field(default_factory=lambda: np.zeros(3))
    calibration_error: NonNegative = 0.0

    def __post_init__(self) -> None:
        """Checks the numbers, and keeps the pose as arrays that cannot be written."""
        check_fields(self, f"camera '{self.name}': ")
        for name, shape in (("R_CK", (3, 3)), ("p_CK", (3,))):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape or not (np.abs(array) <= _FARTHEST).all():
                raise ValueError(
                    f"camera '{self.name}': {name} must be {shape} finite numbers up to "
                    f"{_FARTHEST:g}, not {array.tolist()}"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        R = self.R_CK
        if not (np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0.0):
            raise ValueError(f"camera '{self.name}': R_CK must be a rotation, not {R.tolist()}")

    def project(self, p_C: ArrayLike) -> Array:
        """Projects points into the image as it is, distortion included, Eq. (15)-(18).

        Args:
            p_C: Points in the rig's frame C [m], shape (..., 3).

        Returns:
            Pixel coordinates (u, v), shape (..., 2); NaN for a point behind the camera, or so far
            aside that the lens cannot show it.
        """
        return self._project(p_C, with_jacobian=False)[0]

    def project_with_jacobian(self, p_C: ArrayLike) -> tuple[Array, Array]:
        """Projects points, and tells how their pixels move with them.

        Args:
            p_C: Points in the rig's frame C [m], shape (..., 3).

        Returns:
            Pixel coordinates, shape (..., 2), and their derivatives by ``p_C`` [px/m], shape
            (..., 2, 3).

        Example:
            >>> camera = Camera(width=640, height=480, fx=580, fy=580, cx=319.5, cy=239.5)
            >>> camera.project_with_jacobian([0.0, 0.0, 2.0])[1]
            array([[290.,   0.,   0.],
                   [  0., 290.,   0.]])
        """
        return self._project(p_C, with_jacobian=True)

    def sees(self, p_C: ArrayLike) -> NDArray[np.bool_]:
        """Whether points are in the image, whatever may stand before them.

        Args:
            p_C: Points in the rig's frame C [m], shape (..., 3).

        Returns:
            Whether each is, shape (...).
        """
        pixels = self.project(p_C)  # NaN is outside
        end = np.array([self.width, self.height]) - 0.5
        return np.asarray(((pixels > -0.5) & (pixels < end)).all(axis=-1))

    def _project(self, p_C: ArrayLike, *, with_jacobian: bool) -> tuple[Array, Array]:
        from mffdrake.recognition.camera.lens import project  # numba: slow to import

        p_C = np.asarray(p_C, dtype=float)
        p_K = np.ascontiguousarray(((p_C - self.p_CK) @ self.R_CK).reshape(-1, 3))  # Eq. (16)
        jacobians = np.full((len(p_K) if with_jacobian else 0, 2, 3), np.nan)
        pixels = project(self.eye.lens, p_K, jacobians).reshape(*p_C.shape[:-1], 2)
        if not with_jacobian:
            return pixels, jacobians
        return pixels, (jacobians @ self.R_CK.T).reshape(*p_C.shape[:-1], 2, 3)

    @cached_property
    def eye(self) -> Eye:
        """What the compiled functions take, the image aside."""
        from mffdrake.recognition.camera.lens import Eye, Lens  # numba: slow to import

        k = [0.0] * 8
        k[: len(self.distortion.coefficients)] = self.distortion.coefficients
        lens = Lens(
            MODELS.index(self.distortion.model),
            float(self.fx), float(self.fy), float(self.cx), float(self.cy),
            tuple(k), (0.999 * self.distortion.max_radius) ** 2,
        )  # fmt: skip
        R_KC = self.R_CK.T
        p_KC = -R_KC @ self.p_CK + 0.0  # and no negative zeros
        return Eye(
            self.width, self.height, lens,
            tuple(R_KC.reshape(-1).tolist()), tuple(p_KC.tolist()), float(self.calibration_error),
        )  # fmt: skip

    def check_image(self, image: Image) -> None:
        """Checks that an image is one of this camera's.

        Args:
            image: RGB or RGBA, uint8, shape (height, width, 3 or 4).

        Raises:
            ValueError: When it has another type or size, or no colors.
        """
        h, w = self.height, self.width
        if not isinstance(image, np.ndarray):
            raise ValueError(
                f"camera '{self.name}': an image must be an array of type uint8 and shape ({h}, "
                f"{w}, 3 or 4), not {shown(image)}"
            )
        if image.shape not in ((h, w, 3), (h, w, 4)) or image.dtype != np.uint8:
            raise ValueError(
                f"camera '{self.name}': an image must be of type uint8 and shape ({h}, {w}, 3 or "
                f"4), not of type {image.dtype} and shape {image.shape}"
            )


@dataclass(frozen=True, eq=False)
class CameraRig:
    """One camera or several, rigidly joined.

    Attributes:
        cameras: The cameras, in the order in which their images are given.

    Raises:
        ValueError: When there is no camera, or two of one name.

    Example:
        >>> rig = CameraRig.stereo(width=640, height=480, fov_y=math.radians(45))
        >>> rig.names, rig.project([0.0, 0.0, 0.8])[0]     # right image: the principal point
        (('right', 'left'), array([319.5, 239.5]))
    """

    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        """Checks that cameras are told apart."""
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise ValueError("a rig must have at least one camera")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"a rig's cameras must have different names, not {list(self.names)}")

    @classmethod
    def stereo(
        cls,
        *,
        width: int = 640,
        height: int = 480,
        focal_length: float | None = None,
        fov_y: float = math.radians(45.0),
        baseline: float = 0.150,
    ) -> CameraRig:
        """The paper's pair: equal pinhole cameras with parallel axes, one to the other's left.

        The right camera's frame (the paper's Sigma_CR) is the rig's.

        Args:
            width: Image width [px].
            height: Image height [px].
            focal_length: Focal length [px], the same along u and v; None for that of ``fov_y``.
            fov_y: Vertical field of view [rad], between 0 and pi.
            baseline: Distance from the right camera to the left one [m].

        Returns:
            The rig, of the cameras "right" and "left".

        Raises:
            ValueError: When a quantity is outside its range.
        """
        check(Positive, baseline, "stereo camera: baseline")
        check(Positive | None, focal_length, "stereo camera: focal_length")
        if focal_length is None:
            check(Annotated[Finite, Gt(0), Lt(math.pi)], fov_y, "stereo camera: fov_y")
            focal_length = 0.5 * height / math.tan(0.5 * fov_y)
        p_CL = (-baseline, 0.0, 0.0)
        right, left = (
            Camera(
                name=name, width=width, height=height, fx=focal_length, fy=focal_length,
                cx=0.5 * (width - 1), cy=0.5 * (height - 1), p_CK=np.array(p_CK),
            )
            for name, p_CK in (("right", (0.0, 0.0, 0.0)), ("left", p_CL))
        )  # fmt: skip
        return cls((right, left))

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras' names."""
        return tuple(camera.name for camera in self.cameras)

    @property
    def middle(self) -> Array:
        """The mean of the cameras' positions in frame C [m], shape (3,)."""
        return np.asarray(np.mean([camera.p_CK for camera in self.cameras], axis=0))

    def project(self, p_C: ArrayLike) -> tuple[Array, ...]:
        """Projects points into all images, see `Camera.project`.

        Args:
            p_C: Points in frame C [m], shape (..., 3).

        Returns:
            Pixel coordinates (u, v) for each camera, each of shape (..., 2).
        """
        return tuple(camera.project(p_C) for camera in self.cameras)

    def check_images(self, images: Sequence[Image] | Mapping[str, Image]) -> tuple[Image, ...]:
        """Checks that there is one image a camera, of its size.

        Args:
            images: In the cameras' order, or by their names: RGB or RGBA, uint8, shape
                (height, width, 3 or 4).

        Returns:
            The images in the cameras' order.

        Raises:
            ValueError: When an image is missing, or has another type or size than its camera's.
        """
        if isinstance(images, Mapping):
            if set(images) != set(self.names):
                raise ValueError(
                    f"there must be an image of each camera, {', '.join(self.names)}, not of "
                    f"{shorten(', '.join(map(str, images))) or 'none'}"
                )
            images = [images[name] for name in self.names]
        is_list = isinstance(images, Sequence) and not isinstance(images, str | bytes)
        if not (is_list or (isinstance(images, np.ndarray) and images.ndim)):
            raise ValueError(
                f"there must be an image of each camera, {', '.join(self.names)}, not "
                f"{shown(images)}"
            )
        if len(images) != len(self.cameras):
            raise ValueError(
                f"there must be an image of each camera, {', '.join(self.names)}, not "
                f"{len(images)} images"
            )
        for camera, image in zip(self.cameras, images, strict=True):
            camera.check_image(image)
        return tuple(images)

    def views(self, images: Sequence[Image] | Mapping[str, Image]) -> tuple[View, ...]:
        """What the compiled functions take: images with their cameras' lenses and places.

        Args:
            images: See `check_images`.

        Raises:
            ValueError: See `check_images`.
        """
        from mffdrake.recognition.camera.lens import View  # numba: slow to import

        views = []
        for camera, image in zip(self.cameras, self.check_images(images), strict=True):
            pixels = np.ascontiguousarray(image).reshape(-1, image.shape[2]).view()
            pixels.flags.writeable = False  # all of one type, for one compiled function
            views.append(View(pixels, camera.eye))
        return tuple(views)
