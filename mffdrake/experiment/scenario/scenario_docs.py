"""What people and editors need to write scenario files: the commented defaults, and a schema."""

from __future__ import annotations

import dataclasses as dc
import inspect
import textwrap
import typing
from collections.abc import Iterator
from typing import Any

import pydantic

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.recognition.parameters import choices, describe, is_choice, kind_of, plain, tag_of
from mffdrake.recognition.parameters.yaml_text import DumpYaml

__all__ = ["DescribeDefaults", "MakeSchema"]

_WIDTH = 100


def MakeSchema() -> dict[str, Any]:
    """A JSON Schema of scenario files, with what the keys mean, for editors.

    YAML's tags are none of JSON Schema's business: an editor checks what is below a tag. (It must
    be told to accept tags; see the README.)

    Returns:
        The schema, as `json.dumps` takes it.

    Example:
        >>> MakeSchema()["properties"]["method"]["enum"]
        ['ga', 'mff']
    """
    schema = pydantic.TypeAdapter(Scenario).json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    described = {"Scenario": schema, **schema["$defs"]}
    for cls in _AllClasses(Scenario):
        part = described[cls.__name__]
        part["description"] = _FirstParagraph(cls)
        for key, text in describe(cls).items():
            if key in part["properties"]:
                part["properties"][key]["description"] = text
    return schema


def DescribeDefaults() -> str:
    """The default scenario as YAML, with a comment on every key.

    Returns:
        A scenario file.

    Example:
        >>> print(DescribeDefaults().partition("controller:")[0].rstrip())  # doctest: +ELLIPSIS
        # Everything a simulation depends on. The defaults are the paper's experiment.
        ...
        # The PD controller.
    """
    return "\n".join([*_Comment(_FirstParagraph(Scenario), ""), *_Describe(Scenario(), "")]) + "\n"


def _Describe(value: Any, indent: str) -> Iterator[str]:
    """Lines for all keys of a dataclass."""
    texts, hints = describe(type(value)), typing.get_type_hints(type(value), include_extras=True)
    for key, data in plain(value).items():
        inner = getattr(value, key)
        if not indent:
            yield ""
        yield from _Comment(texts.get(key, ""), indent)
        kinds = choices(hints[key])
        if dc.is_dataclass(inner) and not is_choice(hints[key]) and len(kinds) == 1:
            yield f"{indent}{key}:"
            yield from _Describe(inner, f"{indent}  ")
            continue
        for kind in kinds:
            tag = f"{tag_of(kind)} " if is_choice(hints[key]) else ""
            name = f"{tag}{_Form(kind)}" if dc.fields(kind) else kind_of(kind)
            yield from _Comment(f"{name}: {_FirstParagraph(kind)}", indent, "  ")
        yield f"{indent}{key}: {_Flow(data)}"


def _Form(kind: Any) -> str:
    """How a dataclass is written, with all of its parameters."""
    parameters, hints = [], typing.get_type_hints(kind, include_extras=True)
    for field in dc.fields(kind):
        default = field.default if field.default_factory is dc.MISSING else field.default_factory()
        value = "..."
        if default is not dc.MISSING:
            value = _Flow(plain(default, tagged=is_choice(hints[field.name])))
        parameters.append(f"{field.name}: {value}")
    return f"{{{', '.join(parameters)}}}"


def _Flow(value: Any) -> str:
    """A value in one line, as YAML has it."""
    return " ".join(DumpYaml([value], flow=True).split())[1:-1]


def _Comment(text: str, indent: str, bullet: str = "") -> list[str]:
    first, later = f"{indent}# {bullet}", f"{indent}# {2 * bullet}"
    return textwrap.wrap(text, _WIDTH, initial_indent=first, subsequent_indent=later)


def _FirstParagraph(cls: type) -> str:
    return " ".join(inspect.cleandoc(cls.__doc__ or "").split("\n\n")[0].split())


def _AllClasses(cls: type, seen: dict[str, type] | None = None) -> list[type]:
    """A dataclass and all that its parameters can be of, by their names."""
    seen = {} if seen is None else seen
    if cls.__name__ not in seen:
        seen[cls.__name__] = cls
        for hint in typing.get_type_hints(cls, include_extras=True).values():
            for inner in choices(hint):
                _AllClasses(inner, seen)
    return list(seen.values())
