"""The files that a scenario file names: those beside it come first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["FindOwnFiles"]

_KEYS = (
    ("target", "model"),
    ("target", "motion", "file"),
    ("arm", "directives", "add_model", "file"),
    ("arm", "directives", "add_directives", "file"),
)


def FindOwnFiles(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A scenario file's data, in which relative paths of files beside it lead to these.

    All other paths stay as they are: whoever opens them looks from the current folder. So do those
    that lead to the same file from there, so that equal scenarios stay equal.

    Args:
        data: What the file says.
        folder: Where it is.

    Example:
        >>> FindOwnFiles({"target": {"model": "package://mffdrake/mug.sdf"}}, Path("scenarios"))
        {'target': {'model': 'package://mffdrake/mug.sdf'}}
    """

    def Find(path: str) -> str:
        beside, here = folder / path, Path(path)
        if not path or "://" in path or not beside.is_file():
            return path
        return path if here.is_file() and here.samefile(beside) else str(beside)

    changed = dict(data)
    for keys in _KEYS:
        changed = _Changed(changed, keys, Find)
    return changed


def _Changed(data: Any, keys: Sequence[str], change: Callable[[str], str]) -> Any:
    """The data with another text at a place, if there is a text; lists are gone through."""
    if isinstance(data, list):
        return [_Changed(item, keys, change) for item in data]
    if not keys:
        return change(data) if isinstance(data, str) else data
    if not isinstance(data, Mapping) or keys[0] not in data:
        return data
    return {**data, keys[0]: _Changed(data[keys[0]], keys[1:], change)}
