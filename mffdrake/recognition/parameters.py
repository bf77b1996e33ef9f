"""Parameters as frozen dataclasses that check types and ranges, in Python and from YAML alike.

A parameter is declared once, in the class that uses it, with its type, its range and its default::

    @parameters
    class MatchingParameters:
        min_value: Share = 0.3

`Share` and the others here are ranges that many parameters have. Wrong values raise a
`ParameterError` of one line, from ``MatchingParameters(min_value=2)`` as from a scenario file.
"""

from __future__ import annotations

import dataclasses as dc
import difflib
import functools
import inspect
import json
import re
import types
import typing
from collections.abc import Hashable, Mapping
from typing import Annotated, Any, ClassVar, TypeVar, cast, dataclass_transform

import pydantic
import pydantic.dataclasses
from annotated_types import Ge, Gt, Le, Lt
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from mffdrake.recognition._parameter_messages import explain, unknown_key

__all__ = [
    "Count",
    "Finite",
    "Interval",
    "NonNegative",
    "OneOf",
    "ParameterError",
    "Positive",
    "Seed",
    "Share",
    "Vector3",
    "choices",
    "describe",
    "kind_of",
    "merge",
    "parameters",
    "plain",
    "read_parameters",
    "tag_of",
]

_T = TypeVar("_T")

Finite = Annotated[float, pydantic.Field(allow_inf_nan=False)]
"""A finite number."""
Positive = Annotated[float, Gt(0), pydantic.Field(allow_inf_nan=False)]
"""A finite number above 0."""
NonNegative = Annotated[float, Ge(0), pydantic.Field(allow_inf_nan=False)]
"""A finite number from 0 on."""
Share = Annotated[float, Ge(0), Le(1)]
"""A number from 0 to 1."""
Count = Annotated[int, Ge(1)]
"""A whole number from 1 on."""
Seed = Annotated[int, Ge(0), Lt(2**63)]
"""Of random numbers."""
Vector3 = tuple[Finite, Finite, Finite]
"""Three finite numbers."""
Interval = tuple[Finite, Finite]
"""Two finite numbers."""


class ParameterError(ValueError):
    """A parameter is wrong; the message is one line for the person who gave it."""


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
        >>> Noise(deviation=-1)
        Traceback (most recent call last):
        ...
        mffdrake.recognition.parameters.ParameterError: Noise: deviation must be at least 0, not -1
    """

    def _check_keys(owner: type, data: Any) -> Any:
        known = [field.name for field in dc.fields(owner)]
        if data is None or isinstance(data, str | int | float | tuple | list):
            rule = f"must be a mapping with the keys {', '.join(known)}" if known else "has no keys"
            raise PydanticCustomError("no_mapping", "{text}", {"text": rule})
        if isinstance(data, Mapping):
            for key in data:
                if key not in known:
                    raise PydanticCustomError(
                        "unknown_key", "{text}", {"text": unknown_key(str(key), known)}
                    )
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
        >>> read_parameters(Noise, {"deviations": 2}, "noise")  # doctest: +ELLIPSIS
        Traceback (most recent call last):
        ...
        mffdrake.recognition.parameters.ParameterError: unknown key 'deviations' in noise ...
    """
    try:
        made: _T = _adapter(cast(Hashable, cls)).validate_json(json.dumps(data))
    except ValidationError as error:
        raise ParameterError(explain(error, where)) from error
    return made


def kind_of(cls: type) -> str:
    """The short name of one of several classes that a parameter can be of.

    Args:
        cls: A class with the name as its ``kind``, or the name itself in CamelCase.

    Example:
        >>> class GaussianNoise: ...
        >>> kind_of(GaussianNoise), tag_of(GaussianNoise)
        ('gaussian_noise', '!GaussianNoise')
    """
    kind: str = getattr(cls, "kind", re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower())
    return kind


def tag_of(cls: type) -> str:
    """The YAML tag of one of several classes that a parameter can be of."""
    return "!" + "".join(part.capitalize() for part in kind_of(cls).split("_"))


class OneOf:
    """Marks a parameter that is of one of several classes: ``Annotated[A | B, OneOf()]``.

    In YAML such a parameter is a tagged mapping, such as ``!Borders {window: 8}``, or a class's
    short name alone, such as ``borders``, for its defaults.
    """

    TAG: ClassVar[str] = "_tag"
    """The key under which a mapping's tag is kept once YAML is read."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Instances as they are; mappings by their tag; names as the class's defaults."""
        kinds = typing.get_args(source) or (source,)
        by_tag = {tag_of(kind): kind for kind in kinds}
        by_name = {kind_of(kind): kind for kind in kinds if not _required(kind)}
        forms = ", ".join(_form(kind) for kind in kinds if dc.fields(kind))
        empty = next((tag for tag, kind in by_tag.items() if not dc.fields(kind)), None)

        def choose(value: Any) -> str | None:
            if isinstance(value, Mapping):
                tag = value.get(self.TAG, None if value else empty)
                return tag if tag in by_tag else None
            if isinstance(value, str):
                return "name" if value in by_name else None
            return tag_of(type(value)) if type(value) in kinds else None

        def check(value: Any) -> Any:
            if choose(value) is None:
                given = value.get(self.TAG, value) if isinstance(value, Mapping) else value
                close = difflib.get_close_matches(str(given), [*by_tag, *by_name], n=1)
                hint = f" (did you mean '{close[0]}'?)" if close else ""
                text = f"must be one of {', '.join([*by_name, forms])}, not {given!r}{hint}"
                raise PydanticCustomError("one_of", "{text}", {"text": text})
            return value

        def untag(value: Any) -> Any:
            if isinstance(value, Mapping):
                return {key: item for key, item in value.items() if key != self.TAG}
            return value

        choices: dict[Any, CoreSchema] = {
            tag: core_schema.no_info_before_validator_function(untag, handler.generate_schema(kind))
            for tag, kind in by_tag.items()
        }
        if by_name:
            choices["name"] = core_schema.no_info_after_validator_function(
                lambda name: by_name[name](), core_schema.literal_schema(list(by_name))
            )
        return core_schema.no_info_before_validator_function(
            check, core_schema.tagged_union_schema(choices, choose)
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Any of the choices; a tag itself is none of JSON Schema's business."""
        listed = handler(schema)
        return {"anyOf": listed["oneOf"]} if "oneOf" in listed else listed


def _required(cls: Any) -> list[str]:
    """Names of a class's parameters without a default."""
    return [
        field.name
        for field in dc.fields(cls)
        if field.default is dc.MISSING and field.default_factory is dc.MISSING
    ]


def _form(kind: type) -> str:
    """How a tagged mapping looks."""
    required = _required(kind)
    return f"{tag_of(kind)} {{{', '.join(f'{key}: ...' for key in required) or '...'}}}"


def choices(annotation: Any) -> tuple[type, ...]:
    """The dataclasses that a parameter's value, or each of its values, can be of.

    Args:
        annotation: The parameter's type.

    Example:
        >>> choices(int), choices(Annotated[ParameterError | None, OneOf()])
        ((), ())
    """
    if isinstance(annotation, type) and dc.is_dataclass(annotation):
        return (annotation,)
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) in (
        Annotated, typing.Union, tuple,
    ):  # fmt: skip
        return tuple(kind for item in typing.get_args(annotation) for kind in choices(item))
    return ()


@functools.cache
def _fields(cls: Any) -> tuple[tuple[str, bool], ...]:
    """Names of a class's parameters, and whether each is of one of several tagged classes."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return tuple((f.name, _is_tagged(hints[f.name])) for f in dc.fields(cls) if f.init)


def _is_tagged(annotation: Any) -> bool:
    return any(
        isinstance(item, OneOf) or _is_tagged(item)
        for item in (*typing.get_args(annotation), *getattr(annotation, "__metadata__", ()))
    )


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
    if tagged and not _required(cls) and value == cls():
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
        >>> @parameters
        ... class Noise:
        ...     deviation: NonNegative = 1.0
        ...     share: Share = 0.5
        >>> merge(Noise(share=0.1), {"deviation": 2})
        {'deviation': 2, 'share': 0.1}
    """
    if not (dc.is_dataclass(value) and isinstance(data, Mapping)) or OneOf.TAG in data:
        return data
    if tagged and not data:  # That is one of the choices: the one without parameters.
        return data
    cls: Any = type(value)
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
