"""What the commands that work on images have in common."""

from __future__ import annotations

import errno
from collections.abc import Sequence
from pathlib import Path

from mffdrake.recognition import SolidModel

__all__ = ["ArgumentsError", "ImagesByCamera", "LoadTarget", "SplitArguments"]


class ArgumentsError(ValueError):
    """An argument of the command line is wrong; the message says how it must be."""


def SplitArguments(option: str, form: str, values: Sequence[str]) -> list[tuple[str, str]]:
    """Splits arguments of the form ``KEY=VALUE``.

    Args:
        option: The option's name, for messages.
        form: How an argument must look, for messages.
        values: The arguments.

    Raises:
        ArgumentsError: When one is of another form.

    Example:
        >>> SplitArguments("--images", "NAME=SOURCE", ["left=a.png"])
        [('left', 'a.png')]
    """
    pairs = []
    for value in values:
        key, equals, rest = value.partition("=")
        if not (equals and key and rest):
            raise ArgumentsError(f"{option} {value}: must be {form}")
        pairs.append((key, rest))
    return pairs


def ImagesByCamera(form: str, values: Sequence[str]) -> dict[str, str]:
    """Splits the arguments of ``--images``.

    Args:
        form: How an argument must look, for messages.
        values: The arguments, one a camera.

    Returns:
        Camera's name to where its images are.

    Raises:
        ArgumentsError: When one is of another form, or a camera stands there twice.

    Example:
        >>> ImagesByCamera("NAME=SOURCE", ["left=a.png", "right=b.png"])
        {'left': 'a.png', 'right': 'b.png'}
    """
    images: dict[str, str] = {}
    for name, place in SplitArguments("--images", form, values):
        if name in images:
            raise ArgumentsError(f"--images {name}=...: camera '{name}' stands there twice")
        images[name] = place
    return images


def LoadTarget(path: Path | str) -> SolidModel:
    """The colored solid of a mesh file.

    Args:
        path: The file.

    Raises:
        ArgumentsError: When it is no closed solid with a hue on every face.
        OSError: When there is no such file.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(errno.ENOENT, "no such mesh file", str(path))
    try:
        return SolidModel.from_mesh_file(path)
    except Exception as error:  # Readers of meshes raise of everything.
        text = " ".join(str(error).split())
        if not isinstance(error, ValueError):
            text = f"not a mesh that can be read: {text}"
        raise ArgumentsError(text if str(path) in text else f"{path}: {text}") from error
