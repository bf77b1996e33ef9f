"""What the command line's options say of a scenario."""

from __future__ import annotations

import argparse
from typing import Any

__all__ = ["GivenOptions"]


def GivenOptions(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """The options that were given, by the scenario's keys.

    Args:
        options: What the command line's parser made of the arguments.
        names: Options that are called as the scenario's keys.

    Example:
        >>> GivenOptions(argparse.Namespace(seed=3, renderer=None), "seed", "renderer", "method")
        {'seed': 3}
    """
    values = {name: getattr(options, name, None) for name in names}
    return {name: value for name, value in values.items() if value is not None}
