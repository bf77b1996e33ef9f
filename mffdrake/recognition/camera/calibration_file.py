"""Calibration files: YAML, XML and JSON, each read into plain dictionaries, and their numbers."""

from __future__ import annotations

import difflib
import json
import re
import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.parameters import InputError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


class CalibrationError(InputError, ValueError):
    """A calibration file is wrong; the message is one line that names the file and the key.

    Example:
        >>> import tempfile
        >>> from mffdrake.recognition.camera.calibration import read_camera
        >>> file = Path(tempfile.mkdtemp()) / "right.yaml"
        >>> _ = file.write_text("{image_width: 640, image_height: 480}")
        >>> try:
        ...     read_camera(file)
        ... except CalibrationError as error:
        ...     print(str(error).removeprefix(f"{file}: ").partition(";")[0])
        no camera matrix
    """


class Keys:
    """The keys of one camera's calibration, and where they stand.

    Keys are compared without case and underscores: camera_matrix is also cameraMatrix, k also K.

    Args:
        path: The file, for messages.
        values: The keys and their values, see `parse_text`.
    """

    def __init__(self, path: Path, values: dict[str, Any]) -> None:
        self.path = path
        self.values = values
        self._spelled = {_plain(key): key for key in reversed(values)}

    def error(self, message: str) -> CalibrationError:
        """An error that names the file."""
        return CalibrationError(f"{self.path}: {message}")

    def find(self, names: Sequence[str]) -> tuple[str, Any]:
        """The first of some keys that is there, as the file spells it, and its value or None."""
        for name in names:
            key = self._spelled.get(_plain(name))
            if key is not None and self.values[key] is not None:
                return key, self.values[key]
        return names[0], None

    def require(self, what: str, names: Sequence[str]) -> tuple[str, Any]:
        """What `find` finds, or an error that tells what is missing."""
        key, value = self.find(names)
        if value is None:
            close = difflib.get_close_matches(names[0], map(str, self.values), n=1)
            hint = f" (is it '{close[0]}'?)" if close else ""
            raise self.error(f"no {what}; its key is one of {', '.join(names)}{hint}")
        return key, value

    def numbers(self, key: str, value: Any, wanted: str) -> tuple[list[float], tuple[int, ...]]:
        """The numbers of a matrix or a list, and its rows and columns where it tells them."""
        shape: tuple[int, ...] = ()
        data = value.get("data") if isinstance(value, dict) else value
        numbers = flat(data)
        if numbers is None:
            raise self.error(f"{key} must be {wanted}, not {shorten(data)}")
        if isinstance(value, dict) and {"rows", "cols"} <= set(value):
            sides = [flat(value[side]) for side in ("rows", "cols")]
            shape = tuple(int(side[0]) for side in sides if side and len(side) == 1)
            if len(shape) != 2 or shape[0] * shape[1] != len(numbers):
                raise self.error(
                    f"{key}.data must be rows x cols numbers, {shorten(value['rows'])} x "
                    f"{shorten(value['cols'])}, not {len(numbers)}"
                )
        return numbers, shape

    def matrix(self, key: str, value: Any, rows: int, cols: int) -> NDArray[np.float64]:
        """A matrix of a known shape."""
        wanted = f"{rows} x {cols} finite numbers"
        numbers, shape = self.numbers(key, value, wanted)
        if len(numbers) != rows * cols or shape not in ((), (rows, cols)):
            told = " x ".join(map(str, shape)) or str(len(numbers))
            raise self.error(f"{key} must be {wanted}, not {told}")
        return np.reshape(numbers, (rows, cols))


def flat(value: Any, depth: int = 2) -> list[float] | None:
    """All numbers of a scalar, a text or a list of lists; None where something is not one."""
    if isinstance(value, list) and depth > 0:
        parts = [flat(item, depth - 1) for item in value]
        return None if None in parts else [n for part in parts for n in part or ()]
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return None
    try:
        numbers = [float(word) for word in (value.split() if isinstance(value, str) else [value])]
    except (ValueError, OverflowError):
        return None
    return numbers if numbers and np.isfinite(numbers).all() else None


def parse_text(path: Path) -> dict[str, Any]:
    """Reads a file of whatever syntax its content shows.

    Numbers may come as texts: what is one is for the reader to tell.

    Args:
        path: The file.

    Returns:
        Its keys and values: texts, numbers, lists and dictionaries.

    Raises:
        CalibrationError: When it is empty, not text, of no such syntax, or not a mapping.
        OSError: When it cannot be read.
    """
    data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{path}: not a text file in UTF-8") from error
    if "\0" in text:
        raise CalibrationError(f"{path}: not a text file in UTF-8")
    if not text.strip():
        raise CalibrationError(f"{path}: the file is empty")
    try:
        tree = _parse_xml(path, text) if text.lstrip().startswith("<") else _parse(path, text)
    except RecursionError as error:
        raise CalibrationError(f"{path}: nested too deeply for a calibration") from error
    if not isinstance(tree, dict):
        raise CalibrationError(
            f"{path}: must be a mapping such as 'image_width: 640', not {shorten(tree)}"
        )
    return tree


def shorten(value: object) -> str:
    """A value on a part of one line, for messages."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = 60
    return short.repr(value)


def _parse(path: Path, text: str) -> Any:
    """JSON or YAML."""
    if text.lstrip().startswith("{"):
        try:
            return json.loads(re.sub(r"(?m)^\s*//.*$", "", text))  # OpenCV comments its JSON
        except ValueError:
            pass  # YAML may start like this, too.
    import yaml  # slow to import

    # OpenCV's first line, %YAML:1.0 or %YAML 1.2, is no directive that PyYAML takes.
    text = re.sub(r"\A\s*%YAML[^\n]*", "", text)
    try:
        # Without types and tags: !!opencv-matrix is a mapping, and no text becomes a date.
        for document in yaml.load_all(text, Loader=yaml.BaseLoader):
            if document:
                return document
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        raise CalibrationError(f"{path}: not YAML, XML or JSON: {where}{problem}") from error
    return None


def _parse_xml(path: Path, text: str) -> Any:
    from xml.etree import ElementTree

    try:
        # lstrip: a declaration must stand first.
        return _plain_element(ElementTree.fromstring(text.lstrip()))
    except (ElementTree.ParseError, ValueError) as error:
        problem = " ".join(str(error).split())
        raise CalibrationError(f"{path}: not XML: {problem}") from error


def _plain_element(element: Element) -> Any:
    """A mapping where there are elements inside, a list where OpenCV calls all of them _."""
    inside = [(child.tag, _plain_element(child)) for child in element]
    if inside and all(tag == "_" for tag, _ in inside):
        return [value for _, value in inside]
    if inside:
        return dict(inside)
    text = (element.text or "").strip()
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text


def _plain(key: object) -> str:
    return str(key).replace("_", "").lower()
