"""Callbacks that Drake may hold without keeping their system alive."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

__all__ = ["WeakCallback"]


def WeakCallback(method: Callable[..., Any]) -> Callable[..., Any]:
    """A function that calls a method of an object as long as there is the object.

    A system owns its output ports, and pydrake's ports own the functions that compute them. Were
    those its bound methods, neither the system nor its diagram would ever be freed.

    Args:
        method: A bound method.

    Returns:
        A function that takes and returns the same.
    """
    reference = weakref.WeakMethod(method)
    return lambda *arguments: reference()(*arguments)  # type: ignore[misc]
