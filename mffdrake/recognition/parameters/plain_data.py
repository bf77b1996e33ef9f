"""Parameters to plain data and back, as YAML has it, and what they mean in words."""

from __future__ import annotations

import dataclasses as dc
import functools
import inspect
import re
import typing
from collections.abc import Mapping
from typing import Any

from mffdrake.recognition.parameters.one_of import (
    OneOf,
    is_choice,
    kind_of,
    required_parameters,
    tag_of,
)

__all__ = ["describe", "merge", "plain"]


@functools.cache
def _fields(cls: Any) -> tuple[tuple[str, bool], ...]:
    """Names of a class's parameters, and whether each is of one of several tagged classes."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return tuple((f.name, is_choice(hints[f.name])) for f in dc.fields(cls) if f.init)


def plain(value: Any, *, tagged: bool = False) -> Any:
    """Parameters as YAML has them: mappings, lists, numbers, texts.

    Args:
        value: Parameters, or a parameter's value.
        tagged: Whether it is one of several classes, and gets its tag or its name.

    Returns:
        What is read back as the same.
    """
    if isinstance(value, tuple | list):
        return [plain(item, tagged=tagged) for item in value]
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if not dc.is_dataclass(value):
        return value
    cls: Any = type(value)
    if tagged and not required_parameters(cls) and value == cls():
        return kind_of(cls)
    data = {name: plain(getattr(value, name), tagged=choice) for name, choice in _fields(cls)}
    return {OneOf.TAG: tag_of(cls), **data} if tagged else data


def merge(value: Any, data: Any, *, tagged: bool = False) -> Any:
    """Plain data on top of parameters, for `read_parameters`.

    Mappings go key by key, all else is replaced. A mapping with a tag replaces what it is put on;
    one without is for the class that is there.

    Args:
        value: Parameters, or a parameter's value.
        data: Plain data for some of its keys.
        tagged: Whether it is one of several classes.

    Returns:
        Plain data with all keys.

    Example:
        >>> from mffdrake.recognition import LocalMoveParameters
        >>> merge(LocalMoveParameters(depth=0.1), {"shift": 0.2})["shift"]
        0.2
    """
    if not (dc.is_dataclass(value) and isinstance(data, Mapping)) or OneOf.TAG in data:
        return data
    cls: Any = type(value)
    if tagged and not (data and dc.fields(cls)):  # Nothing is the choice without parameters.
        return data
    merged = {OneOf.TAG: tag_of(cls)} if tagged else {}
    for name, choice in _fields(cls):
        old = getattr(value, name)
        new = merge(old, data[name], tagged=choice) if name in data else plain(old, tagged=choice)
        merged[name] = new
    return {**merged, **{key: item for key, item in data.items() if key not in merged}}


def describe(cls: type) -> dict[str, str]:
    """What the docstrings of a dataclass and of its bases say of each parameter.

    Args:
        cls: The class, with a section ``Attributes:`` as Google's style has it.

    Returns:
        Sentences by the parameters' names.

    Example:
        >>> class Noise:
        ...     '''Noise.
        ...
        ...     Attributes:
        ...         deviation: How much
        ...             it varies.
        ...     '''
        >>> describe(Noise)
        {'deviation': 'How much it varies.'}
    """
    said: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        _, found, section = inspect.cleandoc(base.__doc__ or "").partition("Attributes:\n")
        body = re.split(r"\n(?=\S)", section)[0] if found else ""
        for match in re.finditer(r"^    (\w+): (.*(?:\n {5,}.*)*)", body, re.MULTILINE):
            said[match[1]] = " ".join(match[2].split())
    return said
