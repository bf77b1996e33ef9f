"""Reads cameras from calibration files, as ROS and OpenCV write them.

Both take pixel coordinates as whole numbers at pixel centers, and so does `Camera`: numbers pass
unchanged. What is read holds for images as they come from the camera, not for rectified ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.calibration_file import (
    CalibrationError,
    Keys,
    flat,
    parse_text,
    shorten,
)
from mffdrake.recognition.camera.cameras import Camera
from mffdrake.recognition.camera.distortion import Distortion
from mffdrake.recognition.parameters import did_you_mean

__all__ = [
    "Calibration",
    "CalibrationError",
    "camera_from_values",
    "read_calibration",
    "read_camera",
]

Array = NDArray[np.float64]
_Model = Literal["none", "plumb_bob", "equidistant"]

# Keys, however they are spelled: camera_matrix is also cameraMatrix, k also K.
_MATRIX = ("camera_matrix", "K", "M1", "cameraMatrix1")
_DISTORTION = ("distortion_coefficients", "dist_coeffs", "D", "D1", "distCoeffs1")
_WIDTH, _HEIGHT, _SIZE = (
    ("image_width", "width"),
    ("image_height", "height"),
    ("image_size", "size"),
)
_POSE = ("tf_world_to_camera",)
_SECOND = ("M2", "cameraMatrix2")

_MODELS: dict[str, _Model] = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "plumb_bob",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "none": "none",
}
_COUNTS = {
    "plumb_bob": (0, 4, 5, 8),
    "rational_polynomial": (8,),
    "equidistant": (4,),
    "fisheye": (4,),
    "none": (0,),
}
_LONGER = {  # What drivers and OpenCV fill up with zeros
    "plumb_bob": (12, 14),
    "rational_polynomial": (12, 14),
    "equidistant": (5,),
    "fisheye": (5,),
    "none": (4, 5, 8, 12, 14),
}
_ROTATION_TOLERANCE = 1e-2


@dataclass(frozen=True)
class Calibration:
    """What a calibration file tells.

    Attributes:
        camera: The camera; at the origin of the rig's frame where the file tells no place.
        has_pose: Whether the file tells the camera's place; the rig's frame is then the world.
    """

    camera: Camera
    has_pose: bool


def read_camera(path: Path | str, *, name: str | None = None) -> Camera:
    """Reads a camera from a calibration file of ROS or OpenCV, see `read_calibration`.

    Args:
        path: The file.
        name: What the camera is to be called; by default the file's ``camera_name``, or the file's
            own name without its suffix.

    Returns:
        The camera; with its pose in the world where the file tells it.

    Raises:
        CalibrationError: When the file is not such a calibration; one line, with file and key.
        OSError: When it cannot be read.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "left.yaml"
        >>> _ = file.write_text('''
        ...     image_width: 640
        ...     image_height: 480
        ...     camera_matrix: {rows: 3, cols: 3, data: [580, 0, 320, 0, 580, 240, 0, 0, 1]}
        ...     distortion_coefficients: {rows: 1, cols: 5, data: [-0.2, 0.1, 0, 0, 0]}
        ... ''')
        >>> camera = read_camera(file)
        >>> camera.name, camera.cx, camera.distortion.model
        ('left', 320.0, 'plumb_bob')
    """
    return read_calibration(path, name=name).camera


def read_calibration(path: Path | str, *, name: str | None = None) -> Calibration:
    """Reads a camera, and whether its place is known, from a calibration file of ROS or OpenCV.

    The syntax (YAML, XML or JSON) is told from the content, not from the file's name. The keys:

    - ``image_width`` and ``image_height``, ``width`` and ``height``, or ``image_size: [width,
      height]``;
    - ``camera_matrix`` or ``K``, 3 x 3, without skew;
    - ``distortion_coefficients``, ``dist_coeffs`` or ``D``;
    - ``distortion_model``, optional: "plumb_bob" (the default; by the number of coefficients
      also rational), "rational_polynomial", "equidistant" or "fisheye", "none"; or OpenCV's
      ``fisheye_model: 1``;
    - ``tf_world_to_camera``, optional, 4 x 4: it takes a point in the world [m] to one in the
      camera. Its rotation, where it is an average, is replaced by the nearest one;
    - ``camera_name``, optional.

    A matrix is ``{rows, cols, data}`` or a list. Keys may be spelled in any case, with or without
    underscores, and stand in one section of their own. Of several YAML documents, as ``rostopic
    echo`` prints them, the first one counts.

    Args:
        path: The file.
        name: What the camera is to be called, see `read_camera`.

    Returns:
        The camera; with its pose in the world where the file tells it.

    Raises:
        CalibrationError: When the file is not such a calibration; one line, with file and key.
        OSError: When it cannot be read.
    """
    return _calibration(_one_camera(Path(path)), name)


def camera_from_values(values: dict[str, Any], name: str, where: Path) -> Camera:
    """Makes a camera of keys and values that do not come from a file of their own.

    Args:
        values: Keys and values, see `read_calibration`.
        name: What the camera is to be called.
        where: Where they are from, for messages.

    Returns:
        The camera.

    Raises:
        CalibrationError: When they are not a calibration.

    Example:
        >>> K = [[580, 0, 320], [0, 580, 240], [0, 0, 1]]
        >>> values = {"width": 640, "height": 480, "K": K, "distortion_model": "none"}
        >>> camera_from_values(values, "left", Path("a.bag")).fx
        580.0
    """
    return _calibration(Keys(where, values), name).camera


def _calibration(keys: Keys, name: str | None) -> Calibration:
    """What the keys of one camera tell."""
    width, height = _image_size(keys)
    _check_whole_image(keys, width, height)
    (fx, _, cx), (_, fy, cy), _ = _pinhole(keys).tolist()
    distortion = _distortion(keys)
    key, tf = keys.find(_POSE)
    R_CK, p_CK = (np.eye(3), np.zeros(3)) if tf is None else _pose(keys, key, tf)
    title = keys.find(("camera_name",))[1]
    if isinstance(title, dict | list):
        raise keys.error(f"camera_name must be a text, not {shorten(title)}")
    try:
        camera = Camera(
            name=name or str(title or "").strip() or keys.path.stem,
            width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy,
            distortion=distortion, R_CK=R_CK, p_CK=p_CK,
        )  # fmt: skip
    except ValueError as error:
        raise keys.error(str(error)) from error
    return Calibration(camera, has_pose=tf is not None)


def _one_camera(path: Path) -> Keys:
    """A file's keys, those of the section that holds the camera among them."""
    tree = parse_text(path)
    keys = Keys(path, tree)
    if keys.find(_MATRIX)[1] is None:
        sections = {k: v for k, v in tree.items() if isinstance(v, dict)}
        cameras = [k for k, v in sections.items() if Keys(path, v).find(_MATRIX)[1] is not None]
        if len(cameras) > 1:
            raise keys.error(f"must be of one camera, not of several: {', '.join(cameras)}")
        for name in cameras:
            keys = Keys(path, tree | sections[name])
    key, second = keys.find(_SECOND)
    if second is not None:
        raise keys.error(f"must be of one camera, and {key} is of a second one")
    return keys


def _pinhole(keys: Keys) -> Array:
    """The camera matrix."""
    key, value = keys.require("camera matrix", _MATRIX)
    K = keys.matrix(key, value, 3, 3)
    if K[0, 1] != 0.0:
        raise keys.error(f"{key} must have no skew in row 1, column 2, not {K[0, 1]}")
    if K[1, 0] != 0.0 or K[2].tolist() != [0.0, 0.0, 1.0]:
        raise keys.error(f"{key} must be fx, 0, cx, 0, fy, cy, 0, 0, 1, not {K.ravel().tolist()}")
    return K


def _image_size(keys: Keys) -> tuple[int, int]:
    """Width and height [px]."""
    if keys.find(_WIDTH)[1] is None and keys.find(_HEIGHT)[1] is None:
        names = "image_width and image_height, or image_size"
        key, value = keys.find(_SIZE)
        if value is None:
            raise keys.error(f"no image size; its keys are {names}: [width, height]")
        if isinstance(value, dict) and "data" not in value:
            sides = Keys(keys.path, value)
            value = [sides.find(_WIDTH)[1], sides.find(_HEIGHT)[1]]
        found = [(key, value)]
    else:
        found = [keys.require("image width", _WIDTH), keys.require("image height", _HEIGHT)]
    sizes: list[float] = []
    for key, value in found:
        count = 3 - len(found)
        wanted = "a positive whole number" if count == 1 else "[width, height], whole and positive"
        numbers, _ = keys.numbers(key, value, wanted)
        if len(numbers) != count or any(n < 1 or n != int(n) for n in numbers):
            raise keys.error(f"{key} must be {wanted}, not {shorten(value)}")
        sizes += numbers
    return int(sizes[0]), int(sizes[1])


def _check_whole_image(keys: Keys, width: int, height: int) -> None:
    """Refuses a ROS message of cut or binned images: its matrix is the whole image's."""
    for name in ("binning_x", "binning_y"):
        key, value = keys.find((name,))
        if value is not None and flat(value) not in ([0.0], [1.0]):
            raise keys.error(f"{key} must be 0 or 1, not {shorten(value)}: binned images differ")
    roi = keys.find(("roi",))[1]
    if isinstance(roi, dict):
        cut = [flat(roi.get(k, 0)) for k in ("x_offset", "y_offset", "width", "height")]
        if cut not in ([[0.0]] * 4, [[0.0], [0.0], [float(width)], [float(height)]]):
            raise keys.error(f"roi must be the whole image, {width} x {height}, not {shorten(roi)}")


def _distortion(keys: Keys) -> Distortion:
    """The lens's distortion, of a model that `Distortion` knows."""
    model = _model(keys)
    if model == "none" and keys.find(_DISTORTION)[1] is None:
        return Distortion()
    key, value = keys.require("distortion coefficients", _DISTORTION)
    numbers, shape = keys.numbers(key, value, "finite numbers")
    if shape and min(shape) > 1:
        raise keys.error(f"{key} must be one row or column, not {shape[0]} x {shape[1]}")
    counts, longer, most = _COUNTS[model], _LONGER[model], _COUNTS[model][-1]
    if len(numbers) in longer:
        if any(numbers[most:]):
            raise keys.error(
                f"{key} must be 0 past the first {most} with the model {model}, not "
                f"{numbers[most:]}"
            )
        numbers = numbers[:most]
    if len(numbers) not in counts:
        raise keys.error(
            f"{key} must be {' or '.join(map(str, counts))} numbers with the model {model} (or "
            f"{' or '.join(map(str, longer))}, 0 past the first {most}), not {len(numbers)}"
        )
    try:
        return Distortion(_MODELS[model], tuple(numbers)) if numbers else Distortion()
    except ValueError as error:
        raise keys.error(str(error)) from error


def _model(keys: Keys) -> str:
    """The distortion model, one of `_MODELS`."""
    key, value = keys.find(("distortion_model", "dist_model"))
    flag = keys.find(("fisheye_model", "fisheye"))
    fisheye = str(flag[1]).lower() in ("1", "true", "yes")
    if flag[1] is not None and not fisheye and str(flag[1]).lower() not in ("0", "false", "no"):
        raise keys.error(f"{flag[0]} must be 0 or 1, not {shorten(flag[1])}")
    if value is None or value == "":
        return "fisheye" if fisheye else "plumb_bob"
    if value not in tuple(_MODELS):
        hint = did_you_mean(value, _MODELS)
        raise keys.error(f"{key} must be one of {', '.join(_MODELS)}, not {shorten(value)}{hint}")
    if fisheye and _MODELS[value] != "equidistant":
        raise keys.error(f"{key} must be equidistant or fisheye with {flag[0]}, not '{value}'")
    return str(value)


def _pose(keys: Keys, key: str, value: Any) -> tuple[Array, Array]:
    """R_CK and p_CK from the transform X_KC, C being the world."""
    X_KC = keys.matrix(key, value, 4, 4)
    if X_KC[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise keys.error(f"{key} must have the last row [0, 0, 0, 1], not {X_KC[3].tolist()}")
    U, _, Vt = np.linalg.svd(X_KC[:3, :3])
    R_KC = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    error = float(np.abs(X_KC[:3, :3] - R_KC).max())
    if error > _ROTATION_TOLERANCE:
        raise keys.error(
            f"{key} must have a rotation in its upper left 3 x 3 numbers, to "
            f"{_ROTATION_TOLERANCE:g}; the nearest one is {error:.2g} off"
        )
    return R_KC.T, -R_KC.T @ X_KC[:3, 3] + 0.0  # and no negative zeros
