"""Checks a scenario's YAML against its dataclasses, for messages a person can act on.

Drake's own reader checks too, but its messages neither say where a key stands nor what is allowed.
"""

from __future__ import annotations

import dataclasses as dc
import difflib
import math
import types
import typing
from typing import Any

import yaml
from pydrake.common.schema import Transform
from pydrake.common.yaml import yaml_load_data

__all__ = ["CheckKeysAndTypes", "ReadYaml", "ScenarioError"]

_NAMES = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
_ROTATIONS = {"!Rpy": "deg", "!AngleAxis": "angle_deg, axis", "!Identity": ""}
_ROTATION_HELP = (
    "a rotation such as !Rpy {deg: [roll, pitch, yaw]} "
    "or !AngleAxis {angle_deg: a, axis: [x, y, z]}"
)


class ScenarioError(ValueError):
    """A scenario is wrong; the message is one line for the person who wrote it."""


def ReadYaml(text: str) -> dict[str, Any]:
    """Reads YAML into plain dictionaries.

    Raises:
        ScenarioError: When it is not YAML, or not a mapping.
    """
    try:
        data = yaml_load_data(text, private=True)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = " ".join(str(getattr(error, "problem", error)).split())
        raise ScenarioError(f"not YAML: {where}{problem}") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ScenarioError(f"must be a mapping such as 'seed: 3', not {data!r}")
    return data


def CheckKeysAndTypes(data: dict[str, Any], schema: type, where: str = "") -> None:
    """Checks a mapping's keys and the types of its values, all the way down.

    Args:
        data: The mapping.
        schema: The dataclass that it is to fill.
        where: The mapping's own key, for the message.

    Raises:
        ScenarioError: When a key is unknown or a value has the wrong type.
    """
    fields = {field.name: field.type for field in dc.fields(schema)}
    for key, value in data.items():
        if key not in fields:
            close = difflib.get_close_matches(str(key), fields, n=1)
            hint = f" (did you mean '{close[0]}'?)" if close else ""
            place = f" in {where}" if where else ""
            raise ScenarioError(
                f"unknown key '{key}'{place}{hint}; known keys: {', '.join(fields)}"
            )
        _CheckValue(value, fields[key], f"{where}.{key}" if where else str(key))


def _CheckValue(value: Any, kind: Any, where: str) -> None:
    if isinstance(kind, type) and dc.is_dataclass(kind):
        if not isinstance(value, dict):
            names = ", ".join(field.name for field in dc.fields(kind))
            raise ScenarioError(f"{where} must be a mapping with the keys {names}, not {value!r}")
        CheckKeysAndTypes(value, kind, where)
    elif kind is Transform:
        _CheckTransform(value, where)
    elif typing.get_origin(kind) is list:
        _CheckNumbers(value, where)
    elif isinstance(kind, types.UnionType):
        if value is not None:
            _CheckValue(value, typing.get_args(kind)[0], where)
    elif not _Fits(value, kind):
        raise ScenarioError(f"{where} must be {_NAMES[kind]}, not {value!r}")


def _Fits(value: Any, kind: type) -> bool:
    if kind is float:
        if isinstance(
            value, str
        ):  # YAML 1.1 takes 1e-3 for a text, and Drake's reader for a number.
            try:
                value = float(value)
            except ValueError:
                return False
        return type(value) in (int, float) and not math.isnan(value)
    if kind is int:
        return type(value) is int or (type(value) is float and value.is_integer())
    return type(value) is kind


def _CheckNumbers(value: Any, where: str, length: int | None = None) -> None:
    good = isinstance(value, list) and all(
        _Fits(v, float) and math.isfinite(float(v)) for v in value
    )
    if not good or (length is not None and len(value) != length):
        count = "" if length is None else f"{length} "
        raise ScenarioError(f"{where} must be a list of {count}numbers, not {value!r}")


def _CheckTransform(value: Any, where: str) -> None:
    if not isinstance(value, dict):
        raise ScenarioError(
            f"{where} must be a mapping with the keys translation, rotation, not {value!r}"
        )
    for key, item in value.items():
        if key == "translation":
            _CheckNumbers(item, f"{where}.translation", 3)
        elif key == "rotation":
            _CheckRotation(item, f"{where}.rotation")
        else:
            raise ScenarioError(
                f"unknown key '{key}' in {where}; known keys: translation, rotation"
            )


def _CheckRotation(value: Any, where: str) -> None:
    if value == {}:  # How Drake writes the identity.
        return
    tag = value.get("_tag") if isinstance(value, dict) else None
    keys = {k for k in value if k != "_tag"} if isinstance(value, dict) else set()
    if tag not in _ROTATIONS or keys != set(filter(None, _ROTATIONS[tag].split(", "))):
        raise ScenarioError(f"{where} must be {_ROTATION_HELP}")
    if tag == "!Rpy":
        _CheckNumbers(value["deg"], f"{where}.deg", 3)
    elif tag == "!AngleAxis":
        _CheckValue(value["angle_deg"], float, f"{where}.angle_deg")
        if math.isinf(float(value["angle_deg"])):
            raise ScenarioError(f"{where}.angle_deg must be a finite number")
        _CheckNumbers(value["axis"], f"{where}.axis", 3)
        if not any(float(component) for component in value["axis"]):
            raise ScenarioError(f"{where}.axis must not be zero")
