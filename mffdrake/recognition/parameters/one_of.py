"""Parameters that are of one of several classes, told by a tag in YAML."""

from __future__ import annotations

import dataclasses as dc
import re
import types
import typing
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from mffdrake.recognition.parameters.messages import TAG, did_you_mean, shown

__all__ = ["OneOf", "choices", "is_choice", "kind_of", "required_parameters", "tag_of"]


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

    TAG: ClassVar[str] = TAG
    """The key under which a mapping's tag is kept once YAML is read."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Instances as they are; mappings by their tag; names as the class's defaults."""
        kinds = typing.get_args(source) or (source,)
        by_tag = {tag_of(kind): kind for kind in kinds}
        by_name = {kind_of(kind): kind for kind in kinds if not required_parameters(kind)}
        forms = ", ".join(_form(kind) for kind in kinds if dc.fields(kind))
        empty = next((tag for tag, kind in by_tag.items() if not dc.fields(kind)), None)

        def choose(value: Any) -> str | None:
            if isinstance(value, Mapping):
                tag = value.get(self.TAG, None if value else empty)
                return tag if isinstance(tag, str) and tag in by_tag else None
            if isinstance(value, str):
                return "!" if value in by_name else None
            return tag_of(type(value)) if type(value) in kinds else None

        def check(value: Any) -> Any:
            if choose(value) is None:
                given = value.get(self.TAG, value) if isinstance(value, Mapping) else value
                hint = did_you_mean(given, [*by_tag, *by_name])
                text = f"must be one of {', '.join([*by_name, forms])}, not {shown(given)}{hint}"
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
            choices["!"] = core_schema.no_info_after_validator_function(
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


def required_parameters(cls: Any) -> list[str]:
    """Names of a class's parameters without a default."""
    return [
        field.name
        for field in dc.fields(cls)
        if field.default is dc.MISSING and field.default_factory is dc.MISSING
    ]


def _form(kind: type) -> str:
    """How a tagged mapping looks."""
    required = required_parameters(kind)
    return f"{tag_of(kind)} {{{', '.join(f'{key}: ...' for key in required) or '...'}}}"


def choices(annotation: Any) -> tuple[type, ...]:
    """The dataclasses that a parameter's value, or each of its values, can be of.

    Args:
        annotation: The parameter's type.

    Example:
        >>> from mffdrake.recognition import NoRefinement, RefinementParameters
        >>> kinds = choices(Annotated[NoRefinement | RefinementParameters, OneOf()])
        >>> [kind_of(kind) for kind in kinds], choices(int)
        (['none', 'borders'], ())
    """
    if isinstance(annotation, type) and dc.is_dataclass(annotation):
        return (annotation,)
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) in (
        Annotated, typing.Union, tuple,
    ):  # fmt: skip
        return tuple(kind for item in typing.get_args(annotation) for kind in choices(item))
    return ()


def is_choice(annotation: Any) -> bool:
    """Whether a parameter's value, or each of its values, is of one of several tagged classes.

    Args:
        annotation: The parameter's type.

    Example:
        >>> from mffdrake.recognition import NoRefinement, RefinementParameters
        >>> is_choice(Annotated[NoRefinement | RefinementParameters, OneOf()]), is_choice(int)
        (True, False)
    """
    inside = (*typing.get_args(annotation), *getattr(annotation, "__metadata__", ()))
    return any(isinstance(item, OneOf) or is_choice(item) for item in inside)
