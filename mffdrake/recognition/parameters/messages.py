"""What to say of wrong parameters: one line for the person who gave them."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pydantic import ValidationError

__all__ = ["TAG", "InputError", "did_you_mean", "explain", "shorten", "shown", "unknown_key"]

_LONG = 100  # characters of a value
_LONGEST = 1500  # characters of a message
_GAP = " ... "


class InputError(Exception):
    """Something that whoever gave the input can mend; the message is one line for that person."""

    def __str__(self) -> str:
        """The message in one line; one that is too long to be read lacks its middle."""
        text = "\\n".join(super().__str__().splitlines())
        half = (_LONGEST - len(_GAP)) // 2
        return text if len(text) <= _LONGEST else f"{text[:half]}{_GAP}{text[-half:]}"


TAG = "_tag"
"""The key under which a mapping's tag is kept once YAML is read."""


def shown(value: object) -> str:
    """A value as messages show it: as Python writes it, but no more than the first of it.

    Args:
        value: Anything.

    Example:
        >>> shown("long"), len(shown(list(range(10_000))))
        ("'long'", 103)
    """
    if isinstance(value, tuple):
        value = list(value)
    if isinstance(value, dict) and isinstance(value.get(TAG), str):
        items = {key: item for key, item in value.items() if key != TAG}
        text = f"{value[TAG]} {items}"
    else:
        try:
            text = repr(value)
        except ValueError:  # Python does not write out whole numbers of thousands of digits.
            text = "a number of thousands of digits"
    return shorten(text)


def shorten(text: str) -> str:
    """A text that stands in a message; of a long one, the first of it."""
    return text if len(text) <= _LONG else f"{text[:_LONG]}..."


def did_you_mean(given: object, known: Iterable[str]) -> str:
    """The nearest right name in brackets; nothing where none is near."""
    if isinstance(given, str) and len(given) > _LONG:
        return ""
    close = difflib.get_close_matches(str(given), list(known), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def unknown_key(key: object, known: Sequence[str], where: str = "") -> str:
    """What to say of a key that is not there, with the nearest right one."""
    place = f" in {where}" if where else ""
    names = ", ".join(known) or "none"
    return f"unknown key {shown(str(key))}{place}{did_you_mean(key, known)}; known keys: {names}"


def _one_of(context: dict[str, Any]) -> str:
    return "must be one of " + str(context["expected"]).replace("'", "").replace(" or ", ", ")


_WORDS: dict[str, Callable[[dict[str, Any]], str]] = {
    "int_type": lambda c: "must be a whole number",
    "int_from_float": lambda c: "must be a whole number",
    "float_type": lambda c: "must be a number",
    "string_type": lambda c: "must be a text",
    "bool_type": lambda c: "must be true or false",
    "finite_number": lambda c: "must be finite",
    "greater_than": lambda c: "must be positive" if c["gt"] == 0 else f"must be above {c['gt']:g}",
    "greater_than_equal": lambda c: f"must be at least {c['ge']:g}",
    "string_pattern_mismatch": lambda c: "must be a text without the character \\0",
    "less_than": lambda c: f"must be below {_number(c['lt'])}",
    "less_than_equal": lambda c: f"must be at most {c['le']:g}",
    "literal_error": _one_of,
    "tuple_type": lambda c: "must be a list",
    "too_short": lambda c: f"must be a list of {_least(c)} values",
    "too_long": lambda c: f"must be a list of {c['max_length']} values",
    "missing": lambda c: "must be given",
    "dataclass_exact_type": lambda c: f"must be a {c['class_name']}",
    "dataclass_type": lambda c: f"must be a {c['class_name']}",
    "none_required": lambda c: "must be null",
    "no_mapping": lambda c: str(c["text"]),
}


def _least(context: dict[str, Any]) -> str:
    return str(context.get("length", f"at least {context.get('min_length')}"))


def _IsTiny(least: float | None) -> bool:
    """Whether a lower bound is there to keep numbers above 0."""
    return least is not None and 0 < least <= 1e-3


def _number(value: float) -> str:
    return "2^63" if value == 2**63 else f"{value:g}"


def explain(error: ValidationError, where: str = "") -> str:
    """The first of the errors in one line: key, rule, value.

    Args:
        error: What pydantic found.
        where: Key of what was validated.

    Returns:
        Such as ``"min_value must be at most 1, not 2"``.
    """
    errors = error.errors(include_url=False)
    first = errors[0]
    kind, context, location = first["type"], first.get("ctx", {}), first["loc"]
    if kind == "missing" and isinstance(location[-1], int):  # A list is too short.
        kind, location = "too_short", location[:-1]
        missing = [e["loc"][-1] for e in errors if e["loc"][:-1] == location]
        context = {"length": 1 + max(index for index in missing if isinstance(index, int))}
    key = where
    for part in location:
        if isinstance(part, int):
            key += f"[{part}]"
        elif not part.startswith("!"):  # That is a choice of `OneOf`.
            key += f".{part}" if key else part
    if kind == "unknown_key":
        return unknown_key(context["key"], context["known"], key)
    if kind == "one_of":
        return f"{key} {context['text']}".lstrip()
    if kind == "unexpected_keyword_argument":
        return f"unknown parameter '{key}'"
    if kind == "value_error":
        text = str(context["error"])
        return f"{key}: {text}" if key else text
    if _IsTiny(context.get("ge")) and not first["input"] > 0:
        kind, context = "greater_than", {"gt": 0}  # That says it, too.
    rule = _WORDS[kind](context) if kind in _WORDS else first["msg"]
    value = "" if kind == "missing" else f", not {shown(first['input'])}"
    return f"{key} {rule}{value}".lstrip()
