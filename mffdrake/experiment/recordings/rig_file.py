"""Camera rigs as YAML files: cameras by their numbers or calibration files, and their places."""

# No `from __future__ import annotations`: the check of the keys needs the fields' types themselves.

import dataclasses as dc
import difflib
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from pydrake.common.schema import Transform
from pydrake.common.yaml import yaml_dump, yaml_load_typed

from mffdrake.experiment.scenario_check import CheckKeysAndTypes, ReadYaml, ScenarioError
from mffdrake.recognition import Camera, CameraRig, Distortion
from mffdrake.recognition.calibration import CalibrationError, read_calibration

__all__ = ["DumpRig", "LoadRig", "RigError"]

_NUMBERS = ("width", "height", "fx", "fy", "cx", "cy")
_ALL_NUMBERS = ", ".join(_NUMBERS)

_FILE_ERROR = 1.0  # [px] What the calibration of a real camera may well leave


class RigError(ValueError):
    """A rig file is wrong; the message is one line for the person who wrote it."""


@dc.dataclass(kw_only=True, slots=True)
class _DistortionKeys:
    """The keys of a distortion, see `Distortion`."""

    model: str = "none"
    coefficients: list[float] = dc.field(default_factory=list)


@dc.dataclass(kw_only=True, slots=True)
class _CameraKeys:
    """The keys of a camera."""

    calibration: str | None = None
    width: int | None = None
    height: int | None = None
    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None
    distortion: _DistortionKeys | None = None
    X_CK: Transform | None = None
    calibration_error: float | None = None


@dc.dataclass(kw_only=True, slots=True)
class _PoseKeys:
    """A pose, for Drake's reader."""

    X_CK: Transform = dc.field(default_factory=Transform)


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
    - ``calibration_error`` [px], optional, see `Camera`; by default 1 px with a calibration file,
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
    except (RigError, ScenarioError) as error:
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
            X_CK:
              translation: [0.0, 0.0, 0.0]
            cx: 319.5
            cy: 239.5
            fx: 580.0
            fy: 580.0
            height: 480
            width: 640
        <BLANKLINE>
    """
    # One camera at a time: Drake's writer sorts the keys, and the cameras' order counts.
    parts = [yaml_dump({camera.name: _Entry(camera)}) for camera in rig.cameras]
    return "cameras:\n" + textwrap.indent("".join(parts), "  ")


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
        close = difflib.get_close_matches(unknown[0], ["cameras"])
        hint = " (did you mean 'cameras'?)" if close else ""
        raise RigError(f"unknown key '{unknown[0]}'{hint}; known keys: cameras")
    cameras = data.get("cameras")
    if not isinstance(cameras, dict) or not cameras or "_tag" in cameras:
        raise RigError(
            "cameras must be a mapping from each camera's name to its keys "
            f"{', '.join(field.name for field in dc.fields(_CameraKeys))}, not {cameras!r}"
        )
    _CheckDifferentNames(text)
    for name in cameras:
        if type(name) not in (str, int) or not str(name).strip():
            raise RigError(f"a camera's name in cameras must be a text, not {name!r}")
    return {str(name): keys for name, keys in cameras.items()}


def _CheckDifferentNames(text: str) -> None:
    """Raises where a camera's name stands twice: YAML's reader keeps the last one alone."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)  # as `ReadYaml` has made sure
    for key, section in root.value:
        names = [name.value for name, _ in section.value] if key.value == "cameras" else []
        for name in names:
            if names.count(name) > 1:
                raise RigError(f"cameras must have different names, not '{name}' twice")


def _ReadCamera(folder: Path, name: str, data: Any) -> _Placed:
    """A camera from its keys and values."""
    where = f"cameras.{name}"
    if not isinstance(data, dict) or "_tag" in data:
        raise RigError(f"{where} must be a mapping with the key calibration, or {_ALL_NUMBERS}")
    data = {key: value for key, value in data.items() if value is not None}
    R_CK, data = _TakeMatrix(data, where)
    CheckKeysAndTypes(data, _CameraKeys, where)
    read = _FromFile if "calibration" in data else _FromNumbers
    try:
        placed = read(folder, name, data)
        changes: dict[str, Any] = {}
        if "calibration_error" in data:
            changes["calibration_error"] = float(data["calibration_error"])
        if "X_CK" in data:
            if placed.source:
                raise RigError(
                    f"{where}.X_CK is told by {data['calibration']}, too, as tf_world_to_camera: "
                    "give one of them"
                )
            # By Drake's own reader, as in a scenario
            pose = yaml_load_typed(schema=_PoseKeys, data=yaml_dump({"X_CK": data["X_CK"]}))
            X_CK = pose.X_CK.GetDeterministicValue()
            changes["R_CK"] = X_CK.rotation().matrix() if R_CK is None else R_CK
            changes["p_CK"] = X_CK.translation()
        source = "X_CK" if "X_CK" in data else placed.source
        return _Placed(dc.replace(placed.camera, **changes), source)
    except RigError:
        raise
    except ValueError as error:
        reason = str(error).removeprefix(f"camera '{name}': ").replace("R_CK", "X_CK.rotation")
        raise RigError(f"{where}.{reason}") from error


def _FromFile(folder: Path, name: str, data: dict[str, Any]) -> _Placed:
    """A camera from its calibration file."""
    where = f"cameras.{name}"
    both = [key for key in (*_NUMBERS, "distortion") if key in data]
    if both:
        raise RigError(
            f"{where}.{both[0]} is told by {where}.calibration: give either a calibration, or "
            f"{_ALL_NUMBERS}"
        )
    file = folder / data["calibration"]
    try:
        read = read_calibration(file, name=name)
    except CalibrationError as error:
        raise RigError(f"{where}.calibration: {error}") from error
    except OSError as error:
        raise RigError(f"{where}.calibration: {file}: {error.strerror}") from error
    camera = dc.replace(read.camera, calibration_error=_FILE_ERROR)
    return _Placed(camera, "world" if read.has_pose else "")


def _FromNumbers(folder: Path, name: str, data: dict[str, Any]) -> _Placed:
    """A camera from its own numbers."""
    missing = [key for key in _NUMBERS if key not in data]
    if missing:
        raise RigError(
            f"cameras.{name} lacks {', '.join(missing)}: give a calibration, or {_ALL_NUMBERS}"
        )
    keys = data.get("distortion", {})
    coefficients = tuple(float(c) for c in keys.get("coefficients", ()))
    distortion = Distortion(keys.get("model", "none"), coefficients)
    numbers: dict[str, Any] = {key: float(data[key]) for key in _NUMBERS}
    return _Placed(Camera(name=name, distortion=distortion, **numbers), "")


def _TakeMatrix(
    data: dict[str, Any], where: str
) -> tuple[NDArray[np.float64] | None, dict[str, Any]]:
    """R_CK where it is a !Matrix, which Drake's Transform does not know, and the other keys."""
    pose = data.get("X_CK")
    rotation = pose.get("rotation") if isinstance(pose, dict) else None
    if not isinstance(rotation, dict) or rotation.get("_tag") != "!Matrix":
        return None, data
    try:
        R_CK = np.array(rotation.get("rows"), dtype=float)
    except (ValueError, TypeError):
        R_CK = np.zeros(0)
    if set(rotation) != {"_tag", "rows"} or R_CK.shape != (3, 3):
        raise RigError(
            f"{where}.X_CK.rotation must be !Matrix {{rows: [[...], [...], [...]]}} of 3 x 3 "
            "numbers"
        )
    rest = {key: value for key, value in data["X_CK"].items() if key != "rotation"}
    return R_CK, data | {"X_CK": rest}


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
