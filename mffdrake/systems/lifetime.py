"""Frees the memory of diagrams with systems in Python."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from typing import TypeVar

from pydrake.systems.framework import Diagram, System

__all__ = ["UseDiagram"]

T = TypeVar("T")


def UseDiagram(make: Callable[[], Diagram], use: Callable[[Diagram], T]) -> T:
    """Makes a diagram, uses it and frees it, megabytes at a time.

    Its Python systems and their ports refer to each other. Python's collector sees to that, but
    for a flaw of Python 3.11 with pydrake's classes, and has no idea how much memory hangs on it.

    Args:
        make: Makes the diagram.
        use: What is done with it; it keeps no reference to it.

    Returns:
        What that returns.
    """
    gc.freeze()  # Looking through all that was there before would take a tenth of a second.
    try:
        diagram = make()
        python_systems = list(_PythonSystems(diagram))
        try:
            return use(diagram)
        finally:
            for system in python_systems:
                vars(system).clear()
            del diagram, python_systems
            gc.collect()
    finally:
        gc.unfreeze()


def _PythonSystems(diagram: Diagram) -> Iterator[System]:
    """The systems written in Python, with all that is in them, also those of diagrams inside."""
    is_python = type(diagram).__module__.partition(".")[0] != "pydrake"
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _PythonSystems(system)
        if is_python or type(system).__module__.partition(".")[0] != "pydrake":
            yield system
