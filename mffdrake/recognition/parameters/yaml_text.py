"""YAML with tags to plain data and back."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, ClassVar

import yaml

from mffdrake.recognition.parameters import OneOf, ParameterError

__all__ = ["DumpYaml", "ReadYaml"]


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Keeps tags, takes 1e-3 for a number and a date for a text, and refuses a key twice."""

    yaml_implicit_resolvers: ClassVar = {
        first: [pair for pair in pairs if not pair[0].endswith(":timestamp")]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes tags, and no anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        """Equal lists are written out."""
        return True


def _Mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    names = [key.value for key, _ in node.value]
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"the key '{name}' stands there twice")
    mapping: dict[Any, Any] = loader.construct_mapping(node, deep=True)
    return mapping


def _Tagged(loader: _Loader, suffix: str, node: yaml.Node) -> Any:
    tag = f"!{suffix}"
    if isinstance(node, yaml.MappingNode):
        return {OneOf.TAG: tag, **_Mapping(loader, node)}
    if isinstance(node, yaml.ScalarNode) and not node.value:
        return {OneOf.TAG: tag}
    raise ParameterError(f"{tag} must be followed by a mapping such as {{key: value}}")


def _RepresentMapping(dumper: _Dumper, data: Mapping[str, Any]) -> yaml.Node:
    items = {key: value for key, value in data.items() if key != OneOf.TAG}
    tag = data.get(OneOf.TAG, "tag:yaml.org,2002:map")
    node: yaml.Node = dumper.represent_mapping(tag, items)
    return node


# YAML 1.1, which PyYAML reads, takes 1e-3 and 1E5 for texts, everybody else for numbers.
for _either in (_Loader, _Dumper):
    _either.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?[0-9][0-9_]*(\.[0-9_]*)?[eE][-+]?[0-9]+$"),
        list("-+0123456789"),
    )
_Loader.add_constructor("tag:yaml.org,2002:map", _Mapping)
_Loader.add_multi_constructor("!", _Tagged)
_Dumper.add_representer(dict, _RepresentMapping)


def ReadYaml(text: str) -> dict[str, Any]:
    """Reads YAML into plain dictionaries, with tags under the key `OneOf.TAG`.

    Args:
        text: The YAML.

    Returns:
        The mapping; empty for an empty text.

    Raises:
        ParameterError: When it is not YAML, not a mapping, or has a key twice.

    Example:
        >>> ReadYaml("{refinement: !Borders {window: 8}, seed: 1e3}")
        {'refinement': {'_tag': '!Borders', 'window': 8}, 'seed': 1000.0}
    """
    try:
        data = yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = " ".join(str(getattr(error, "problem", error)).split())
        raise ParameterError(f"not YAML: {where}{problem}") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ParameterError(f"must be a mapping such as 'seed: 3', not {data!r}")
    return data


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
