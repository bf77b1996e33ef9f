"""Messages of ROS 2: poses and cameras as messages, and back.

The libraries are those of the extra ``mffdrake[ros]``; ROS itself is not needed.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.calibration import camera_from_values
from mffdrake.recognition.camera.cameras import CALIBRATION_ERROR, Camera, CameraRig
from mffdrake.recognition.parameters import InputError
from mffdrake.recognition.poses.pose import quaternion_scalar

__all__ = [
    "RosError",
    "camera_info",
    "camera_of",
    "frame_of",
    "make",
    "nanoseconds",
    "pose_message",
    "pose_of",
    "rig_frame",
    "ros_name",
    "stamped",
    "transform_message",
    "typestore",
]

Array = NDArray[np.float64]

_REGION = ("x_offset", "y_offset", "width", "height")


class RosError(InputError, ValueError):
    """A recording cannot be read or written; the message is one line for who gave it."""


@functools.cache
def typestore() -> Any:
    """The types of ROS 2's messages.

    Raises:
        RosError: When the library is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise RosError(
            "recordings of ROS (MCAP, bags) need more libraries: pip install 'mffdrake[ros]'"
        ) from error
    return get_typestore(Stores.ROS2_HUMBLE)


def nanoseconds(seconds: float) -> int:
    """A time in nanoseconds.

    Example:
        >>> nanoseconds(0.033)
        33000000
    """
    return round(1e9 * seconds)


def make(kind: str, **fields: Any) -> Any:
    """A message.

    Args:
        kind: Its type, as ``"geometry_msgs/Pose"``.
        **fields: Its fields, all of them.
    """
    package, _, name = kind.partition("/")
    return typestore().types[f"{package}/msg/{name}"](**fields)


def stamped(stamp: int, frame: str) -> Any:
    """A header.

    Args:
        stamp: Time of the acquisition [ns].
        frame: Name of the frame in which what follows is.
    """
    time = make("builtin_interfaces/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return make("std_msgs/Header", stamp=time, frame_id=frame)


def pose_message(pose: Array) -> Any:
    """A ``geometry_msgs/Pose`` of a pose vector ``(r [m], eps)``, shape (6,)."""
    x, y, z, w = _quaternion(pose)
    return make(
        "geometry_msgs/Pose",
        position=make("geometry_msgs/Point", **dict(zip("xyz", pose[:3].tolist(), strict=True))),
        orientation=make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w),
    )


def transform_message(pose: Array, stamp: int, parent: str, child: str) -> Any:
    """A ``geometry_msgs/TransformStamped``: the pose of the frame ``child`` in ``parent``."""
    x, y, z, w = _quaternion(pose)
    at = dict(zip("xyz", pose[:3].tolist(), strict=True))
    transform = make(
        "geometry_msgs/Transform",
        translation=make("geometry_msgs/Vector3", **at),
        rotation=make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w),
    )
    return make(
        "geometry_msgs/TransformStamped",
        header=stamped(stamp, parent), child_frame_id=child, transform=transform,
    )  # fmt: skip


def pose_of(message: Any) -> Array:
    """The pose vector of a message: a pose or a transform, with or without header and covariance.

    A quaternion of norm 1 but for rounding is left alone, so that what was written comes back to
    the bit.

    Raises:
        RosError: When it has no pose, or its quaternion is none.
    """
    while hasattr(message, "pose"):  # PoseStamped, PoseWithCovarianceStamped, Odometry
        message = message.pose
    message = getattr(message, "transform", message)
    place = getattr(message, "position", getattr(message, "translation", None))
    turn = getattr(message, "orientation", getattr(message, "rotation", None))
    if place is None or turn is None:
        raise RosError(f"a message of type {message.__msgtype__} has no pose")
    q = np.array([turn.x, turn.y, turn.z, turn.w])
    norm = float(np.sqrt(q @ q))
    if not abs(norm - 1.0) < 1e-2:
        raise RosError(f"a quaternion must have the norm 1, not {norm:.6g}")
    q = np.copysign(1.0, q[3]) * (q if abs(norm - 1.0) < 1e-15 else q / norm) + 0.0
    return np.array([place.x, place.y, place.z, *q[:3]])


def ros_name(name: str) -> str:
    """A camera's name as a part of a topic: letters, digits and underscores.

    Example:
        >>> ros_name("left eye"), ros_name("2")
        ('left_eye', 'camera_2')
    """
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"camera_{plain}" if plain[:1].isdigit() else plain


def frame_of(camera: Camera) -> str:
    """Name of a camera's optical frame: x right, y down, z along the line of sight."""
    return f"{ros_name(camera.name)}_optical_frame"


def rig_frame(rig: CameraRig) -> str:
    """Name of a rig's frame: the first camera's optical frame, unless that is somewhere else.

    Example:
        >>> rig_frame(CameraRig.stereo())
        'right_optical_frame'
    """
    first = rig.cameras[0]
    at_origin = np.array_equal(first.R_CK, np.eye(3)) and not first.p_CK.any()
    return frame_of(first) if at_origin else "rig"


def camera_info(camera: Camera, stamp: int, frame: str) -> Any:
    """A ``sensor_msgs/CameraInfo``.

    Args:
        camera: The camera.
        stamp: Time of the acquisition [ns].
        frame: Name of its optical frame.
    """
    lens = camera.distortion
    model: str = lens.model
    d = list(lens.coefficients)
    if model == "none" or (model == "plumb_bob" and len(d) < 6):
        model, d = "plumb_bob", [*d, *(5 - len(d)) * [0.0]]
    elif model == "plumb_bob":
        model = "rational_polynomial"
    fx, fy, cx, cy = map(float, (camera.fx, camera.fy, camera.cx, camera.cy))
    # A pinhole beside the first camera, with a parallel axis, is as one of a rectified pair.
    aside = np.array_equal(camera.R_CK, np.eye(3)) and not camera.p_CK[1:].any()
    tx = -fx * float(camera.p_CK[0]) if aside and lens.model == "none" else 0.0
    region = make(
        "sensor_msgs/RegionOfInterest",
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False,
    )  # fmt: skip
    return make(
        "sensor_msgs/CameraInfo",
        header=stamped(stamp, frame), height=camera.height, width=camera.width,
        distortion_model=model, d=np.array(d),
        k=np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        r=np.eye(3).reshape(9),
        p=np.array([fx, 0.0, cx, tx, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0, binning_y=0, roi=region,
    )  # fmt: skip


def camera_of(message: Any, name: str, where: str, *, rectified: bool = False) -> Camera:
    """The camera of a ``sensor_msgs/CameraInfo`` of ROS 2 or 1; its place is not told.

    Args:
        message: The message.
        name: What the camera is to be called.
        where: Where the message is from, for messages.
        rectified: Whether the images are rectified: the matrix P tells of them, without distortion.

    Raises:
        CalibrationError: When it is of no camera that this package knows.
    """
    k, d, p = (
        np.asarray(getattr(message, key, getattr(message, key.upper(), ())), float) for key in "kdp"
    )
    values: dict[str, Any] = {
        "image_width": message.width, "image_height": message.height,
        "K": (p.reshape(3, 4)[:, :3] if rectified else k.reshape(3, 3)).tolist(),
        "distortion_model": "none", "binning_x": message.binning_x,
        "binning_y": message.binning_y,
        "roi": {key: getattr(message.roi, key) for key in _REGION},
    }  # fmt: skip
    if d.any() and not rectified:
        values |= {"distortion_model": message.distortion_model, "D": d.tolist()}
    camera = camera_from_values(values, name, Path(where))
    return dc.replace(camera, calibration_error=CALIBRATION_ERROR)


def _quaternion(pose: Array) -> tuple[float, float, float, float]:
    """X y z w of a pose vector."""
    x, y, z = pose[3:].tolist()
    return x, y, z, float(quaternion_scalar(pose[3:]))
