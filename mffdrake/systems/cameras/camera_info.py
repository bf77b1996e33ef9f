"""Cameras from Drake's CameraInfo and back: the one place that knows of the half pixel.

Drake's renderers draw half a pixel up and to the left of where CameraInfo says when one reads whole
numbers as pixel centers: its image spans u in [0, W], and the image's center is (W/2, H/2). A
`Camera` takes whole numbers at pixel centers, as OpenCV and ROS do: its image spans u in [-0.5,
W - 0.5], and the center is ((W - 1)/2, (H - 1)/2). So the principal points differ by half a pixel.
"""

from __future__ import annotations

from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

from mffdrake.recognition import Camera
from mffdrake.systems.cameras.lens import NeedsLens

__all__ = ["CameraFromInfo", "MakeCameraInfo"]

_HALF_PIXEL = 0.5


def CameraFromInfo(
    info: CameraInfo, *, name: str = "camera", X_CK: RigidTransform | None = None
) -> Camera:
    """The camera that Drake's intrinsics describe.

    Args:
        info: The intrinsics, e.g. an RgbdSensor's.
        name: What the camera is to be called.
        X_CK: Its pose in the rig's frame C (x right, y down, z along the line of sight); None for
            the frame itself.

    Returns:
        The camera, without distortion.

    Example:
        >>> camera = CameraFromInfo(CameraInfo(640, 480, 580.0, 580.0, 320.0, 240.0))
        >>> camera.cx, camera.cy
        (319.5, 239.5)
    """
    X_CK = RigidTransform() if X_CK is None else X_CK
    return Camera(
        name=name,
        width=info.width(),
        height=info.height(),
        fx=info.focal_x(),
        fy=info.focal_y(),
        cx=info.center_x() - _HALF_PIXEL,
        cy=info.center_y() - _HALF_PIXEL,
        R_CK=X_CK.rotation().matrix(),
        p_CK=X_CK.translation(),
    )


def MakeCameraInfo(camera: Camera, *, ignore_distortion: bool = False) -> CameraInfo:
    """Drake's intrinsics for a camera, with which a renderer draws what the camera projects.

    The camera's place is not part of them.

    Args:
        camera: The camera.
        ignore_distortion: Whether a camera with a distortion is taken as one without.

    Returns:
        The intrinsics for an RgbdSensor.

    Raises:
        ValueError: When the camera has a distortion, which Drake's renderers cannot draw, or its
            principal point is outside the image, which Drake does not take.

    Example:
        >>> camera = Camera(width=640, height=480, fx=580, fy=580, cx=319.5, cy=239.5)
        >>> info = MakeCameraInfo(camera)
        >>> info.center_x(), info.center_y()
        (320.0, 240.0)
    """
    if NeedsLens(camera) and not ignore_distortion:
        raise ValueError(
            f"camera '{camera.name}': Drake's renderers draw no distortion, and it has the "
            f"{camera.distortion.model} coefficients {list(camera.distortion.coefficients)}; give "
            "a camera without distortion, or ignore_distortion=True"
        )
    for key, center, size in (
        ("cx", camera.cx, camera.width),
        ("cy", camera.cy, camera.height),
    ):
        if not 0.0 < center + _HALF_PIXEL < size:
            raise ValueError(
                f"camera '{camera.name}': {key} must be between {-_HALF_PIXEL} and "
                f"{size - _HALF_PIXEL}, inside the image, for Drake, not {center}"
            )
    return CameraInfo(
        camera.width,
        camera.height,
        camera.fx,
        camera.fy,
        camera.cx + _HALF_PIXEL,
        camera.cy + _HALF_PIXEL,
    )
