"""Pinhole stereo geometry with parallel axes: equations (13)-(18)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class StereoCamera:
    """Two equal pinhole cameras with parallel axes, the left one ``baseline`` to the left.

    The right camera's frame C (the paper's Sigma_CR) is the reference: x right, y down, z along
    the line of sight. Pixel coordinates (u, v) are whole numbers at pixel centers, so an image of
    width W spans u in [-0.5, W - 0.5].

    Attributes:
        width: Image width [px].
        height: Image height [px].
        focal_length: Focal length [px], the same along u and v.
        baseline: Distance from the right camera to the left one [m].

    Raises:
        ValueError: When a size, the focal length or the baseline is not positive.

    Example:
        >>> camera = StereoCamera.from_fov(width=640, height=480, fov_y=math.radians(45))
        >>> camera.project([0.0, 0.0, 0.8])[0]     # right image: the principal point
        array([319.5, 239.5])
    """

    width: int = 640
    height: int = 480
    focal_length: float = 240.0 / math.tan(math.radians(22.5))
    baseline: float = 0.150

    def __post_init__(self) -> None:
        """Checks that every quantity is positive."""
        for name in ("width", "height", "focal_length", "baseline"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"StereoCamera: {name} must be positive, not {value}")

    @classmethod
    def from_fov(
        cls, *, width: int, height: int, fov_y: float, baseline: float = 0.150
    ) -> StereoCamera:
        """Makes the camera from its vertical field of view.

        Args:
            width: Image width [px].
            height: Image height [px].
            fov_y: Vertical field of view [rad], between 0 and pi.
            baseline: Distance between the cameras [m].

        Raises:
            ValueError: When a quantity is outside its range.
        """
        if not 0 < fov_y < math.pi:
            raise ValueError(f"StereoCamera: fov_y must be between 0 and pi rad, not {fov_y}")
        focal_length = 0.5 * height / math.tan(0.5 * fov_y)
        return cls(width=width, height=height, focal_length=focal_length, baseline=baseline)

    @property
    def principal_point(self) -> tuple[float, float]:
        """Image center (u, v) [px], where pixel centers are whole numbers."""
        return 0.5 * (self.width - 1), 0.5 * (self.height - 1)

    @property
    def p_CL(self) -> Array:
        """Left camera's position in the right one's frame [m], shape (3,)."""
        return np.array([-self.baseline, 0.0, 0.0])

    def project(self, p_C: ArrayLike) -> tuple[Array, Array]:
        """Projects points into both images, Eq. (15)-(18).

        Args:
            p_C: Points in frame C [m], shape (..., 3), with z > 0.

        Returns:
            ``(right, left)``: pixel coordinates (u, v), each of shape (..., 2).
        """
        p_C = np.asarray(p_C, dtype=float)
        p_L = p_C - self.p_CL  # Eq. (16): parallel axes, so X_LC is a translation
        f, center = self.focal_length, np.array(self.principal_point)
        right = f * p_C[..., :2] / p_C[..., 2:] + center  # Eq. (15)
        left = f * p_L[..., :2] / p_L[..., 2:] + center  # Eq. (17)
        return right, left
