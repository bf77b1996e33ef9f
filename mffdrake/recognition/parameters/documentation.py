"""What people and editors need to write parameters: commented defaults, and a JSON Schema."""

from __future__ import annotations

import dataclasses as dc
import inspect
import textwrap
import typing
from collections.abc import Iterator
from typing import Any

import pydantic

from mffdrake.recognition.parameters.one_of import choices, is_choice, kind_of, tag_of
from mffdrake.recognition.parameters.plain_data import describe, plain
from mffdrake.recognition.parameters.yaml_text import DumpYaml

__all__ = ["commented_yaml", "json_schema"]

_WIDTH = 100
_WIDE = ((-1e9, 1e9), (1e-12, 1e9), (0, 1e9), (1, 10**6), (0, 10**6), (0, 2**63))  # of no use


def json_schema(cls: type) -> dict[str, Any]:
    """A JSON Schema of files with parameters, with what the keys mean, for editors.

    YAML's tags are none of JSON Schema's business: an editor checks what is below a tag. (It must
    be told to accept tags; see docs/howto/command_line.md.)

    Args:
        cls: The class of all of a file's parameters.

    Returns:
        The schema, as `json.dumps` takes it.

    Example:
        >>> from mffdrake.recognition import TrackerParameters
        >>> json_schema(TrackerParameters)["properties"]["coding"]["enum"]
        ['binary', 'gray']
    """
    schema = pydantic.TypeAdapter(cls).json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    described = {cls.__name__: schema, **schema["$defs"]}
    for part in _all_classes(cls):
        found = described[part.__name__]
        found["description"] = _first_paragraph(part)
        for key, text in describe(part).items():
            if key in found["properties"]:
                found["properties"][key]["description"] = text
    return schema


def commented_yaml(value: Any) -> str:
    """Parameters as YAML, with a comment on every key.

    Args:
        value: A dataclass of parameters, such as the defaults.

    Example:
        >>> from mffdrake.recognition import LocalMoveParameters
        >>> print(commented_yaml(LocalMoveParameters()).splitlines()[-1])
        sparsity: 0.5
    """
    heading = _comment(_first_paragraph(type(value)), "")
    return "\n".join([*heading, *_describe(value, "")]) + "\n"


def _describe(value: Any, indent: str) -> Iterator[str]:
    """Lines for all keys of a dataclass."""
    texts, hints = describe(type(value)), typing.get_type_hints(type(value), include_extras=True)
    for key, data in plain(value).items():
        inner = getattr(value, key)
        if not indent:
            yield ""
        yield from _comment(f"{texts.get(key, '')}{_bounds(hints[key])}", indent)
        kinds = choices(hints[key])
        if dc.is_dataclass(inner) and not is_choice(hints[key]) and len(kinds) == 1:
            yield f"{indent}{key}:"
            yield from _describe(inner, f"{indent}  ")
            continue
        for kind in kinds:
            tag = f"{tag_of(kind)} " if is_choice(hints[key]) else ""
            name = f"{tag}{_form(kind)}" if dc.fields(kind) else kind_of(kind)
            yield from _comment(f"{name}: {_first_paragraph(kind)}", indent, "  ")
        yield f"{indent}{key}: {_flow(data)}"


def _bounds(hint: Any) -> str:
    """The least and the greatest value of a number, or of each of a list's, in words."""
    if choices(hint):
        return ""
    schema = pydantic.TypeAdapter(hint).json_schema()
    schema = next(iter(schema.get("anyOf", [schema])))  # The other one is null.
    for part in (schema.get("items"), *schema.get("prefixItems", ())):
        schema = part if isinstance(part, dict) else schema
    least = max((schema[k] for k in ("minimum", "exclusiveMinimum") if k in schema), default=None)
    most = min((schema[k] for k in ("maximum", "exclusiveMaximum") if k in schema), default=None)
    if least is None or most is None or (least, most) in _WIDE:
        return ""
    below = "below " if schema.get("exclusiveMaximum") == most else ""
    return f" From {least:g} to {below}{most:g}."


def _form(kind: Any) -> str:
    """How a dataclass is written, with all of its parameters."""
    parameters, hints = [], typing.get_type_hints(kind, include_extras=True)
    for field in dc.fields(kind):
        default = field.default if field.default_factory is dc.MISSING else field.default_factory()
        value = "..."
        if default is not dc.MISSING:
            value = _flow(plain(default, tagged=is_choice(hints[field.name])))
        parameters.append(f"{field.name}: {value}")
    return f"{{{', '.join(parameters)}}}"


def _flow(value: Any) -> str:
    """A value in one line, as YAML has it."""
    return " ".join(DumpYaml([value], flow=True).split())[1:-1]


def _comment(text: str, indent: str, bullet: str = "") -> list[str]:
    first, later = f"{indent}# {bullet}", f"{indent}# {2 * bullet}"
    return textwrap.wrap(text, _WIDTH, initial_indent=first, subsequent_indent=later)


def _first_paragraph(cls: type) -> str:
    return " ".join(inspect.cleandoc(cls.__doc__ or "").split("\n\n")[0].split())


def _all_classes(cls: type, seen: dict[str, type] | None = None) -> list[type]:
    """A dataclass and all that its parameters can be of, by their names."""
    seen = {} if seen is None else seen
    if cls.__name__ not in seen:
        seen[cls.__name__] = cls
        for hint in typing.get_type_hints(cls, include_extras=True).values():
            for inner in choices(hint):
                _all_classes(inner, seen)
    return list(seen.values())
