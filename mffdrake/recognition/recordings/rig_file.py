"""Camera rigs as YAML files: cameras by their numbers or calibration files, and their places."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.calibration import CalibrationError, read_calibration
from mffdrake.recognition.camera.cameras import CALIBRATION_ERROR, Camera, CameraRig
from mffdrake.recognition.camera.distortion import Distortion
from mffdrake.recognition.parameters import (
    Finite,
    InputError,
    OneOf,
    ParameterError,
    Text,
    Vector3,
    parameters,
    read_parameters,
    shorten,
    shown,
    unknown_key,
)
from mffdrake.recognition.parameters.rotations import AngleAxisDeg, Identity, RpyDeg
from mffdrake.recognition.parameters.yaml_text import DumpYaml, ReadYaml

__all__ = ["DumpRig", "LoadRig", "RigError"]

_NUMBERS = ("width", "height", "fx", "fy", "cx", "cy")
_ALL_NUMBERS = ", ".join(_NUMBERS)


class RigError(InputError, ValueError):
    """A rig file is wrong; the message is one line for the person who wrote it.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "rig.yaml"
        >>> _ = file.write_text("camera: {right: {calibration: right.yaml}}")
        >>> try:
        ...     LoadRig(file)
        ... except RigError as error:
        ...     print(str(error).removeprefix(f"{file}: "))
        unknown key 'camera' (did you mean 'cameras'?); known keys: cameras
    """


@parameters
class Matrix:
    """A rotation to the last bit, which angles would lose.

    Attributes:
        rows: The rotation matrix.
    """

    rows: tuple[Vector3, Vector3, Vector3]

    def CalcMatrix(self) -> NDArray[np.float64]:
        """The rotation matrix, shape (3, 3)."""
        return np.array(self.rows)


@parameters
class _Pose:
    """A pose, also by its rotation matrix."""

    translation: Vector3 = (0.0, 0.0, 0.0)
    rotation: Annotated[Identity | RpyDeg | AngleAxisDeg | Matrix, OneOf()] = Identity()


@parameters
class _DistortionKeys:
    """The keys of a distortion, see `Distortion`."""

    model: Literal["none", "plumb_bob", "equidistant"] = "none"
    coefficients: tuple[Finite, ...] = ()


@parameters
class _CameraKeys:
    """The keys of a camera."""

    calibration: Text | None = None
    width: int | None = None
    height: int | None = None
    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None
    distortion: _DistortionKeys | None = None
    X_CK: _Pose | None = None
    calibration_error: float | None = None


@dc.dataclass(frozen=True)
class _Placed:
    """A camera, and where its place was found: "" (nowhere), "X_CK" or "world" (its file)."""

    camera: Camera
    source: str


def LoadRig(path: Path | str) -> CameraRig:
    """Reads a rig of cameras.

    The key ``cameras`` maps each camera's name to

    - ``calibration``: a file that `read_calibration` reads, relative to the rig file's folder; or
      ``width``, ``height``, ``fx``, ``fy``, ``cx``, ``cy`` [px] and, optionally, ``distortion:
      {model, coefficients}``, as `Camera` and `Distortion` have them;
    - ``X_CK``, optional: the camera's pose in the rig's frame, ``{translation: [x, y, z], rotation:
      !Rpy {deg: [r, p, y]}}``, with ``!AngleAxis {angle_deg: a, axis: [x, y, z]}`` as in scenarios
      or the exact ``!Matrix {rows: [[...], [...], [...]]}`` instead of ``!Rpy``;
    - ``calibration_error`` [px], optional, see `Camera`; by default 0.5 px with a calibration file,
      which stands for a real camera, and 0 px with numbers.

    The rig's frame is the world where a calibration file tells its camera's place there: then each
    camera has a place, by its file or by ``X_CK``. Otherwise only the first camera may be without
    ``X_CK``, and its frame is the rig's.

    Args:
        path: The rig file.

    Returns:
        The rig, its cameras in the file's order.

    Raises:
        RigError: When the file or one of its calibrations is wrong or missing; the message names
            the file, the camera and the key.
        OSError: When the rig file cannot be read.

    Example:
        >>> import math, tempfile
        >>> file = Path(tempfile.mkdtemp()) / "rig.yaml"
        >>> _ = file.write_text(DumpRig(CameraRig.stereo(fov_y=math.radians(45.0))))
        >>> LoadRig(file).names
        ('right', 'left')
    """
    path = Path(path)
    try:
        cameras = _ReadCameras(path.read_text(encoding="utf-8"))
        placed = [_ReadCamera(path.parent, name, keys) for name, keys in cameras.items()]
        _CheckPlaces(placed)
    except UnicodeDecodeError as error:
        raise RigError(f"{path}: not a text file in UTF-8") from error
    except (RigError, ParameterError) as error:
        raise RigError(f"{path}: {error}") from error
    return CameraRig(tuple(p.camera for p in placed))


def DumpRig(rig: CameraRig) -> str:
    """A rig as YAML, which `LoadRig` reads back to the last bit.

    Args:
        rig: The rig.

    Returns:
        YAML. Each camera has its own numbers: no other file is needed.

    Example:
        >>> camera = Camera(width=640, height=480, fx=580, fy=580, cx=319.5, cy=239.5)
        >>> print(DumpRig(CameraRig((camera,))))
        cameras:
          camera:
            width: 640
            height: 480
            fx: 580.0
            fy: 580.0
            cx: 319.5
            cy: 239.5
            X_CK:
              translation: [0.0, 0.0, 0.0]
        <BLANKLINE>
    """
    return DumpYaml({"cameras": {camera.name: _Entry(camera) for camera in rig.cameras}})


def _Entry(camera: Camera) -> dict[str, Any]:
    """A camera's keys and values."""
    entry: dict[str, Any] = {"width": camera.width, "height": camera.height}
    entry |= {key: float(getattr(camera, key)) for key in ("fx", "fy", "cx", "cy")}
    if camera.distortion.model != "none":
        coefficients = list(camera.distortion.coefficients)
        entry["distortion"] = {"model": camera.distortion.model, "coefficients": coefficients}
    entry["X_CK"] = {"translation": camera.p_CK.tolist()}
    if camera.R_CK.tobytes() != np.eye(3).tobytes():
        # Angles would lose the last bits.
        entry["X_CK"]["rotation"] = {"_tag": "!Matrix", "rows": camera.R_CK.tolist()}
    if camera.calibration_error:
        entry["calibration_error"] = float(camera.calibration_error)
    return entry


def _ReadCameras(text: str) -> dict[str, Any]:
    """The cameras' keys and values, by name."""
    data = ReadYaml(text)
    unknown = [str(key) for key in data if key != "cameras"]
    if unknown:
        raise RigError(unknown_key(unknown[0], ["cameras"]))
    cameras = data.get("cameras")
    if not isinstance(cameras, dict) or not cameras or "_tag" in cameras:
        raise RigError(
            "cameras must be a mapping from each camera's name to its keys "
            f"{', '.join(field.name for field in dc.fields(_CameraKeys))}, not {shown(cameras)}"
        )
    for name in cameras:
        if type(name) not in (str, int) or not str(name).strip():
            raise RigError(f"a camera's name in cameras must be a text, not {shown(name)}")
    return {str(name): keys for name, keys in cameras.items()}


def _ReadCamera(folder: Path, name: str, data: Any) -> _Placed:
    """A camera from its keys and values."""
    where = f"cameras.{shorten(name)}"
    if not isinstance(data, dict) or "_tag" in data:
        raise RigError(f"{where} must be a mapping with the key calibration, or {_ALL_NUMBERS}")
    data = {key: value for key, value in data.items() if value is not None}
    keys = read_parameters(_CameraKeys, data, where)
    read = _FromNumbers if keys.calibration is None else _FromFile
    try:
        placed = read(folder, name, keys)
        changes: dict[str, Any] = {}
        if keys.calibration_error is not None:
            changes["calibration_error"] = keys.calibration_error
        if keys.X_CK is not None:
            if placed.source:
                raise RigError(
                    f"{where}.X_CK is told by {keys.calibration}, too, as tf_world_to_camera: "
                    "give one of them"
                )
            changes["R_CK"] = keys.X_CK.rotation.CalcMatrix()
            changes["p_CK"] = np.array(keys.X_CK.translation)
        source = placed.source if keys.X_CK is None else "X_CK"
        return _Placed(dc.replace(placed.camera, **changes), source)
    except RigError:
        raise
    except ValueError as error:
        reason = str(error).removeprefix(f"camera '{name}': ").replace("R_CK", "X_CK.rotation")
        raise RigError(f"{where}.{reason}") from error


def _FromFile(folder: Path, name: str, keys: _CameraKeys) -> _Placed:
    """A camera from its calibration file."""
    where = f"cameras.{shorten(name)}"
    both = [key for key in (*_NUMBERS, "distortion") if getattr(keys, key) is not None]
    if both:
        raise RigError(
            f"{where}.{both[0]} is told by {where}.calibration: give either a calibration, or "
            f"{_ALL_NUMBERS}"
        )
    file = folder / str(keys.calibration)
    try:
        read = read_calibration(file, name=name)
    except CalibrationError as error:
        raise RigError(f"{where}.calibration: {error}") from error
    except OSError as error:
        raise RigError(f"{where}.calibration: {shorten(str(file))}: {error.strerror}") from error
    camera = dc.replace(read.camera, calibration_error=CALIBRATION_ERROR)
    return _Placed(camera, "world" if read.has_pose else "")


def _FromNumbers(folder: Path, name: str, keys: _CameraKeys) -> _Placed:
    """A camera from its own numbers."""
    missing = [key for key in _NUMBERS if getattr(keys, key) is None]
    if missing:
        raise RigError(
            f"cameras.{name} lacks {', '.join(missing)}: give a calibration, or {_ALL_NUMBERS}"
        )
    bends = keys.distortion or _DistortionKeys()
    distortion = Distortion(bends.model, bends.coefficients)
    numbers: dict[str, Any] = {key: getattr(keys, key) for key in _NUMBERS}
    return _Placed(Camera(name=name, distortion=distortion, **numbers), "")


def _CheckPlaces(placed: list[_Placed]) -> None:
    """Raises where a camera's place in the rig's frame cannot be known."""
    in_world = [p.camera.name for p in placed if p.source == "world"]
    for i, p in enumerate(placed):
        if p.source:
            continue
        where = f"cameras.{p.camera.name}"
        if in_world:
            raise RigError(
                f"{where} lacks X_CK: the rig's frame is the world, in which the calibration of "
                f"'{in_world[0]}' tells its place, so every camera must have its own there"
            )
        if i > 0:
            raise RigError(
                f"{where} lacks X_CK: only the first camera, '{placed[0].camera.name}', may be "
                "without a pose, and the rig's frame is then its own"
            )
