"""YAML with tags to plain data and back."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, ClassVar

import yaml

from mffdrake.recognition.parameters import OneOf, ParameterError, shorten, shown

__all__ = ["DumpYaml", "ReadYaml", "check_tags"]

_MOST_LEVELS = 50
_MOST_DIGITS = 300
_MOST_VALUES = 100_000


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Keeps tags, and takes only what everybody does for numbers, true, false and null."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes tags, and no anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        """Equal lists are written out."""
        return True


def _Mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    names = set()
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise ParameterError(f"{_Place(key.start_mark)}a key must be a text")
        if key.value in names:
            raise ParameterError(f"the key {shown(key.value)} stands there twice")
        names.add(key.value)
    mapping: dict[Any, Any] = loader.construct_mapping(node, deep=True)
    _CheckTag(mapping, "")
    return mapping


def _CheckTag(mapping: Mapping[Any, Any], where: str) -> None:
    tag = mapping.get(OneOf.TAG, "!Any")
    if not (isinstance(tag, str) and tag.startswith("!") and len(tag) > 1):
        raise ParameterError(f"{where}a tag must be a text such as !Rpy, not {shown(tag)}")


def check_tags(data: object, where: str = "") -> None:
    """Checks the tags in plain data, for which there is no other rule.

    Args:
        data: Mappings, lists and values, nested at will.
        where: What the message begins with.

    Raises:
        ParameterError: When a tag could not be written as YAML, and read again.

    Example:
        >>> check_tags([{"rotation": {"_tag": "!Rpy", "deg": [0, 0, 180]}}])
    """
    if isinstance(data, Mapping):
        _CheckTag(data, where)
        data = list(data.values())
    if isinstance(data, list | tuple):
        for each in data:
            check_tags(each, where)


def _Tagged(loader: _Loader, suffix: str, node: yaml.Node) -> Any:
    tag = f"!{suffix}"
    if isinstance(node, yaml.MappingNode):
        return {OneOf.TAG: tag, **_Mapping(loader, node)}
    if isinstance(node, yaml.ScalarNode) and not node.value:
        return {OneOf.TAG: tag}
    raise ParameterError(f"{shown(tag)[1:-1]} must be followed by a mapping such as {{key: value}}")


def _RepresentMapping(dumper: _Dumper, data: Mapping[str, Any]) -> yaml.Node:
    items = {key: value for key, value in data.items() if key != OneOf.TAG}
    tag = data.get(OneOf.TAG, "tag:yaml.org,2002:map")
    node: yaml.Node = dumper.represent_mapping(tag, items)
    return node


def _WholeNumber(loader: _Loader, node: yaml.ScalarNode) -> int:
    if len(node.value) > _MOST_DIGITS:
        raise ParameterError(
            f"{_Place(node.start_mark)}a number must have at most {_MOST_DIGITS} digits, not "
            f"{len(node.value)}"
        )
    return int(node.value)


# As YAML 1.2 and JSON have them. YAML 1.1, which PyYAML reads, takes yes for true, 1:30 for 90,
# 010 for 8, 1_000 and +1 for numbers, and 1e-3 for a text.
_IMPLICIT = {
    "null": (r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    "bool": ("true|True|TRUE|false|False|FALSE", list("tTfF")),
    "int": ("-?(?:0|[1-9][0-9]*)", list("-0123456789")),
    "float": (
        r"-?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
        r"|-?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-.0123456789"),
    ),
    "merge": ("<<", ["<"]),
}
for _either in (_Loader, _Dumper):  # What is read as a number must be written as a text in quotes.
    for _kind, (_form, _first) in _IMPLICIT.items():
        _either.add_implicit_resolver(
            f"tag:yaml.org,2002:{_kind}", re.compile(rf"^(?:{_form})$"), _first
        )
_Loader.add_constructor("tag:yaml.org,2002:map", _Mapping)
_Loader.add_constructor("tag:yaml.org,2002:int", _WholeNumber)
_Loader.add_multi_constructor("!", _Tagged)
_Dumper.add_representer(dict, _RepresentMapping)


def ReadYaml(text: str) -> dict[str, Any]:
    """Reads YAML into plain dictionaries, with tags under the key `OneOf.TAG`.

    Args:
        text: The YAML.

    Returns:
        The mapping; empty for an empty text.

    Raises:
        ParameterError: When it is not YAML, not a mapping, or has a key twice; when it is nested
            too deeply, or has a tag of YAML's own such as ``!!int``.

    Example:
        >>> ReadYaml("{refinement: !Borders {window: 8}, seed: 1e3}")
        {'refinement': {'_tag': '!Borders', 'window': 8}, 'seed': 1000.0}
    """
    try:
        data = _Construct(text, _CheckEvents(text))
    except yaml.YAMLError as error:
        where = _Place(getattr(error, "problem_mark", None))
        problem = shorten(" ".join(str(getattr(error, "problem", error)).split()))
        raise ParameterError(f"not YAML: {where}{problem}") from error
    except UnicodeError as error:
        raise ParameterError("not YAML: not a text in UTF-8") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ParameterError(f"must be a mapping such as 'seed: 3', not {shown(data)}")
    return data


def _Place(mark: Any) -> str:
    """What messages begin with."""
    return f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""


def _CheckEvents(text: str) -> bool:
    """Checks tags, and levels before anything goes down them; tells whether there are aliases."""
    depth, has_aliases = 0, False
    for event in yaml.parse(text, _Loader):
        tag = getattr(event, "tag", None) or ""
        if tag.startswith("tag:"):
            name = shown(tag.replace("tag:yaml.org,2002:", "!!"))[1:-1]
            raise ParameterError(
                f"{_Place(event.start_mark)}{name} is no tag that is known here; write the value "
                "without it"
            )
        has_aliases = has_aliases or isinstance(event, yaml.AliasEvent)
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _MOST_LEVELS:
            raise ParameterError(
                f"{_Place(event.start_mark)}nested too deeply; {_MOST_LEVELS} levels of lists and "
                "mappings are the most"
            )
    return has_aliases


def _Construct(text: str, has_aliases: bool) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        if has_aliases:
            _Size(node, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _Size(node: yaml.Node, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """The numbers of values and of levels, with those of an alias where it stands.

    Loading shares what an alias stands for. Whatever goes through the values does not.
    """
    if isinstance(node, yaml.ScalarNode):
        return 1, 0
    if id(node) not in known:
        known[id(node)] = (0, _MOST_LEVELS)  # until it is known: it is too deep within itself
        items = node.value
        if isinstance(node, yaml.MappingNode):
            items = [item for pair in node.value for item in pair]
        sizes = [_Size(item, known) for item in items]
        values = 1 + sum(number for number, _ in sizes)
        levels = 1 + max((number for _, number in sizes), default=0)
        if values > _MOST_VALUES or levels > _MOST_LEVELS:
            raise ParameterError(
                f"{_Place(node.start_mark)}aliases make more than {_MOST_VALUES} values or "
                f"{_MOST_LEVELS} levels of it; write fewer of them"
            )
        known[id(node)] = values, levels
    return known[id(node)]


def DumpYaml(data: Any, *, flow: bool | None = None) -> str:
    """Writes plain data as YAML, floats to the last bit.

    Args:
        data: Mappings, lists, numbers, texts; tags under the key `OneOf.TAG`.
        flow: Whether all is written in braces and brackets; by default what holds no mappings or
            lists of its own is.

    Returns:
        The YAML.

    Example:
        >>> print(DumpYaml({"refinement": {"_tag": "!Borders", "window": 8}}), end="")
        refinement: !Borders {window: 8}
    """
    text: str = yaml.dump(
        data,
        Dumper=_Dumper,
        default_flow_style=flow,
        width=100,
        sort_keys=False,
        allow_unicode=True,
    )
    return text
