"""Parsers and kinds of arguments, with messages that say what is wrong in one line."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NoReturn

__all__ = ["MESHCAT", "NotNegative", "Parser", "Positive"]

MESHCAT = "show it in a browser as it happens, with buttons to pause, step and reset"
"""What the option ``--meshcat`` does."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and takes options by their whole names only."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)

    def error(self, message: str) -> NoReturn:
        """Ends with the message and status 2."""
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def Positive(kind: type[int] | type[float]) -> Callable[[str], float]:
    """A converter for positive numbers, with a message that says so."""

    def Convert(text: str) -> float:
        try:
            value: float = kind(text)
        except ValueError:
            value = 0
        if not 0 < value < float("inf"):
            name = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"must be a positive {name}, not '{text}'")
        return value

    return Convert


def NotNegative(text: str) -> int:
    """A converter for whole numbers from 0 on, with a message that says so."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 on, not '{text}'")
    if int(text) >= 2**63:
        raise argparse.ArgumentTypeError(f"must be below 2^63, not '{text}'")
    return int(text)
