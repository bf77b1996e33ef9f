"""What the commands make of their arguments."""

from __future__ import annotations

import argparse
import errno
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mffdrake.experiment.scenario.scenario import Change, LoadScenario, Scenario, ServoDefaults
from mffdrake.recognition import SolidModel
from mffdrake.recognition.parameters import InputError
from mffdrake.recognition.recordings.files import MakeOutputFolder

__all__ = [
    "ArgumentsError", "CheckFiles", "GivenOptions", "ImagesByCamera", "LoadTarget", "ReadScenario",
    "SplitArguments",
]  # fmt: skip


_WRITTEN = {
    "graphviz": (".svg", ".png"), "replay": (".html",), "video": (".mp4",), "mcap": (".mcap",),
    "mcap_out": (".mcap",),
}  # fmt: skip


class ArgumentsError(InputError, ValueError):
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


def GivenOptions(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """The options that were given, by the scenario's keys.

    Args:
        options: What the command line's parser made of the arguments.
        names: Options that are called as the scenario's keys.

    Example:
        >>> GivenOptions(argparse.Namespace(seed=3, renderer=None), "seed", "renderer", "method")
        {'seed': 3}
    """
    values = {name: getattr(options, name, None) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def CheckFiles(options: argparse.Namespace) -> None:
    """Finds out before any long work whether the wanted files can be written.

    Args:
        options: What the command line's parser made of the arguments.

    Raises:
        ArgumentsError: When one has another suffix than it must have, or is a folder.
        OSError: When its folder cannot be written to.
    """
    for name, suffixes in _WRITTEN.items():
        given = getattr(options, name, None)
        if given is None:
            continue
        if Path(given).suffix not in suffixes:
            name = name.replace("_", "-")
            raise ArgumentsError(f"--{name} {given}: the file must end in {' or '.join(suffixes)}")
        MakeOutputFolder(Path(given).parent)
        if Path(given).is_dir():
            raise ArgumentsError(f"--{name} {given}: is a directory, not a file")


def ReadScenario(options: argparse.Namespace) -> Scenario:
    """The scenario of the options: its file and text, with the single options on top.

    Args:
        options: What the command line's parser made of the arguments.

    Raises:
        ScenarioError: When a key is unknown or a value is wrong.
    """
    defaults = ServoDefaults() if options.command == "servo" else None
    scenario = LoadScenario(options.scenario_file, options.scenario_text, defaults=defaults)
    values = GivenOptions(options, "duration", "seed", "renderer", "method")
    if options.command in ("run", "record") and options.omega is not None:
        values["hand_path.omega"] = options.omega
    return Change(scenario, values)
