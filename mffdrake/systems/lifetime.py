"""Frees the memory of diagrams with systems in Python."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from pydrake.systems.framework import Diagram, System

__all__ = ["FreedDiagram"]


@contextmanager
def FreedDiagram(diagram: Diagram) -> Iterator[Diagram]:
    """Frees a diagram at the end, megabytes at a time.

    Its Python systems and their ports refer to each other. Python's collector sees to that, but
    for a flaw of Python 3.11 with pydrake's classes, and has no idea how much memory hangs on it.

    Args:
        diagram: The diagram, of which the caller has no other reference to be used afterwards.

    Yields:
        The diagram.
    """
    python_systems = list(_PythonSystems(diagram))
    try:
        yield diagram
    finally:
        for system in python_systems:
            vars(system).clear()
        del diagram, python_systems
        gc.collect()


def _PythonSystems(diagram: Diagram) -> Iterator[System]:
    """The systems written in Python, with all that is in them, also those of diagrams inside."""
    is_python = type(diagram).__module__.partition(".")[0] != "pydrake"
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _PythonSystems(system)
        if is_python or type(system).__module__.partition(".")[0] != "pydrake":
            yield system
