"""The decorator of parameters, and ranges that many of them have."""

from __future__ import annotations

import dataclasses as dc
import functools
import inspect
import json
import typing
from collections.abc import Hashable, Mapping
from typing import Annotated, Any, Literal, TypeVar, cast, dataclass_transform

import pydantic
import pydantic.dataclasses
from annotated_types import Ge, Gt, Le, Lt
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from mffdrake.recognition.parameters.messages import TAG, InputError, explain

__all__ = [
    "Coordinate",
    "Count",
    "Duration",
    "Finite",
    "Interval",
    "Latency",
    "Length",
    "Limit",
    "NonNegative",
    "Number",
    "ParameterError",
    "Period",
    "Pixels",
    "Position",
    "Positive",
    "Seed",
    "Share",
    "Text",
    "Vector3",
    "check",
    "check_fields",
    "parameters",
    "read_parameters",
]

_T = TypeVar("_T")

# Bounds far beyond all that makes sense, within which nothing overflows or takes for ever.
Finite = Annotated[float, Ge(-1e9), Le(1e9), pydantic.Field(allow_inf_nan=False)]
"""A number of any sign, up to 1e9."""
Positive = Annotated[float, Gt(0), Ge(1e-12), Le(1e9), pydantic.Field(allow_inf_nan=False)]
"""A number from 1e-12 to 1e9."""
NonNegative = Annotated[float, Ge(0), Le(1e9), pydantic.Field(allow_inf_nan=False)]
"""A number from 0 to 1e9."""
Share = Annotated[float, Ge(0), Le(1), pydantic.Field(allow_inf_nan=False)]
"""A number from 0 to 1."""
Limit = Annotated[float, Ge(0)]
"""A number from 0 on, or infinity, that something must not exceed."""
Count = Annotated[int, Ge(1), Le(10**6)]
"""A whole number from 1 to a million."""
Number = Annotated[int, Ge(0), Le(10**6)]
"""A whole number from 0 to a million."""
Pixels = Annotated[int, Ge(1), Le(16384)]
"""The width or height of an image or of a part of one [px]."""
Length = Annotated[float, Gt(0), Ge(1e-6), Le(1e3), pydantic.Field(allow_inf_nan=False)]
"""A length from 1 micrometer to 1 km [m]."""
Coordinate = Annotated[float, Ge(-1e3), Le(1e3), pydantic.Field(allow_inf_nan=False)]
"""A coordinate within 1 km [m]."""
Period = Annotated[float, Gt(0), Ge(1e-6), Le(1e3), pydantic.Field(allow_inf_nan=False)]
"""A time between events from 1 microsecond to 1000 s [s]."""
Duration = Annotated[float, Gt(0), Ge(1e-6), Le(1e6), pydantic.Field(allow_inf_nan=False)]
"""A time from 1 microsecond to a million seconds [s]."""
Latency = Annotated[float, Ge(0), Le(60), pydantic.Field(allow_inf_nan=False)]
"""The age of something from 0 s to 60 s [s]."""
Text = Annotated[str, pydantic.StringConstraints(pattern=r"^[^\x00]*$")]
"""A text without the character 0, which ends texts elsewhere."""
Seed = Annotated[int, Ge(0), Lt(2**63)]
"""Of random numbers."""
Vector3 = tuple[Finite, Finite, Finite]
"""Three numbers of any sign."""
Position = tuple[Coordinate, Coordinate, Coordinate]
"""A position or a displacement within 1 km [m]."""
Interval = tuple[Finite, Finite]
"""Two numbers of any sign."""


class ParameterError(InputError, ValueError):
    """A parameter is wrong; the message is one line for the person who gave it.

    Example:
        >>> from mffdrake.recognition import SearchRange
        >>> try:
        ...     SearchRange(z=(0.9, 0.5))
        ... except ParameterError as error:
        ...     print(error)
        SearchRange: z must be [least, greatest], not [0.9, 0.5]
    """


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(dc.field,))
def parameters(cls: type[_T]) -> type[_T]:
    """Makes a class a frozen dataclass, with keyword arguments only, that checks its values.

    Lists become tuples, and NumPy's scalars Python's. Checks of several values together stand in
    ``__post_init__`` and raise a ValueError.

    Args:
        cls: The class, annotated like any dataclass.

    Returns:
        The dataclass. Making one raises a `ParameterError` for a wrong value.

    Example:
        >>> @parameters
        ... class Noise:
        ...     deviation: NonNegative = 1.0
        >>> try:
        ...     Noise(deviation=-1)
        ... except ParameterError as error:
        ...     print(error)
        Noise: deviation must be at least 0, not -1
    """

    def _check_keys(owner: type, data: Any) -> Any:
        known = [field.name for field in dc.fields(owner)]
        tagged = isinstance(data, Mapping) and TAG in data
        if tagged or data is None or isinstance(data, str | int | float | tuple | list):
            rule = f"must be a mapping with the keys {', '.join(known)}" if known else "has no keys"
            rule += ", without a tag" if tagged else ""
            raise PydanticCustomError("no_mapping", "{text}", {"text": rule})
        if isinstance(data, Mapping):
            for key in data:
                if key not in known:
                    context = {"key": str(key), "known": known}
                    raise PydanticCustomError("unknown_key", "unknown key", context)
            return {key: _tidy(value) for key, value in data.items()}
        return data

    validator: Any = classmethod(_check_keys)
    cls._check_keys = pydantic.model_validator(mode="before")(validator)  # type: ignore[attr-defined]
    config = pydantic.ConfigDict(strict=True, arbitrary_types_allowed=True, extra="forbid")
    made: Any = pydantic.dataclasses.dataclass(cls, frozen=True, kw_only=True, config=config)
    checked = made.__init__

    def init(self: Any, **values: Any) -> None:
        try:
            checked(self, **{name: _tidy(value) for name, value in values.items()})
        except ValidationError as error:
            raise ParameterError(f"{cls.__name__}: {explain(error)}") from error

    init.__doc__ = checked.__doc__
    init.__signature__ = inspect.signature(checked)  # type: ignore[attr-defined]
    made.__init__ = init
    return made  # type: ignore[no-any-return]


def _tidy(value: Any) -> Any:
    """Lists as tuples, and NumPy's numbers and arrays as Python's."""
    if hasattr(value, "tolist") and not isinstance(value, type):
        value = value.tolist()
    return tuple(_tidy(item) for item in value) if isinstance(value, list | tuple) else value


def _listed(value: Any) -> Any:
    """What JSON does not know: NumPy's as Python's, all else as a text to be refused or shown."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


_Adapter = pydantic.TypeAdapter[Any]


@functools.cache
def _adapter(cls: Hashable) -> _Adapter:
    return pydantic.TypeAdapter(cls)  # type: ignore[arg-type]


def read_parameters(cls: type[_T], data: Any, where: str = "") -> _T:
    """Parameters from plain data, as YAML or JSON has them.

    Args:
        cls: A class of `parameters`.
        data: Mappings, lists, numbers, texts; tags under the key `OneOf.TAG`.
        where: What to call the whole in messages.

    Returns:
        The parameters.

    Raises:
        ParameterError: One line that names the key, what is allowed and what is given.

    Example:
        >>> @parameters
        ... class Noise:
        ...     deviation: NonNegative = 1.0
        >>> read_parameters(Noise, {"deviation": 2})
        Noise(deviation=2.0)
        >>> try:
        ...     read_parameters(Noise, {"deviations": 2}, "noise")
        ... except ParameterError as error:
        ...     print(error)
        unknown key 'deviations' in noise (did you mean 'deviation'?); known keys: deviation
    """
    try:
        text = json.dumps(data, default=_listed)
    except (RecursionError, ValueError) as error:  # ValueError: it holds itself.
        raise ParameterError(f"{where}: nested too deeply".removeprefix(": ")) from error
    try:
        made: _T = _adapter(cast(Hashable, cls)).validate_json(text)
    except ValidationError as error:
        raise ParameterError(explain(error, where)) from error
    return made


def check(annotation: Any, value: Any, name: str) -> Any:
    """A single value, of the range that an annotation tells.

    Args:
        annotation: Such as `Positive`, or a Literal.
        value: The value; NumPy's numbers are taken for Python's.
        name: What to call it in messages.

    Returns:
        The value, as a number of the annotation's type.

    Raises:
        ParameterError: When it is outside the range; one line.

    Example:
        >>> try:
        ...     check(Positive, -1.0, "rate")
        ... except ParameterError as error:
        ...     print(error)
        rate must be positive, not -1.0
    """
    try:
        return _adapter(annotation).validate_python(_tidy(value))
    except ValidationError as error:
        raise ParameterError(explain(error, name)) from error


def check_fields(instance: Any, prefix: str = "") -> None:
    """Checks the fields of a plain dataclass whose annotations tell a range.

    For classes that are no `parameters`, as they are made with positional arguments or hold what
    is no parameter; to be called in ``__post_init__``. Checked values take the place of the given
    ones.

    Args:
        instance: The dataclass's instance.
        prefix: What messages begin with.

    Raises:
        ParameterError: See `check`.

    Example:
        >>> @dc.dataclass(frozen=True)
        ... class Disk:
        ...     radius: Positive
        ...     def __post_init__(self):
        ...         check_fields(self, "disk: ")
        >>> try:
        ...     Disk(0.0)
        ... except ParameterError as error:
        ...     print(error)
        disk: radius must be positive, not 0.0
    """
    cls = cast(Hashable, type(instance))
    for name, annotation in _ranges(cls):
        value = check(annotation, getattr(instance, name), f"{prefix}{name}")
        object.__setattr__(instance, name, value)


@functools.cache
def _ranges(cls: Any) -> tuple[tuple[str, Any], ...]:
    """Names and annotations of the fields that have a range."""
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = ((field.name, hints[field.name]) for field in dc.fields(cls) if field.init)
    return tuple((name, hint) for name, hint in fields if _has_range(hint))


def _has_range(hint: Any) -> bool:
    inside = typing.get_args(hint) if typing.get_origin(hint) is tuple else ()
    is_range = typing.get_origin(hint) in (Annotated, Literal)
    return is_range or any(_has_range(item) for item in inside)
