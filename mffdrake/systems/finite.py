"""Refuses numbers at input ports of which nothing can be computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pydrake.systems.framework import Context, InputPort, System

__all__ = ["EvalFinite"]

_MOST = 1e100  # far beyond all sense, so that products do not overflow


def EvalFinite(system: System, port: InputPort, context: Context) -> NDArray[np.float64]:
    """A port's numbers.

    Drake ends the process where a plant's positions are not finite.

    Args:
        system: The system, for the message.
        port: One of its input ports, of a vector.
        context: The system's context.

    Returns:
        The numbers, all of them finite.

    Raises:
        RuntimeError: When one is not finite, or beyond 1e100; with the system and the port.

    Example:
        >>> from pydrake.systems.primitives import PassThrough
        >>> system = PassThrough(1)
        >>> context = system.CreateDefaultContext()
        >>> _ = system.get_input_port().FixValue(context, [0.5])
        >>> EvalFinite(system, system.get_input_port(), context)
        array([0.5])
    """
    values: NDArray[np.float64] = port.Eval(context)
    # Most often the sum of their squares tells, at once. (`@` would warn where that overflows.)
    if not np.vdot(values, values) <= _MOST**2 and not (np.abs(values) <= _MOST).all():  # NaN, too
        k = int(np.argmin(np.abs(values) <= _MOST))
        raise RuntimeError(
            f"{system.get_name() or type(system).__name__}: input port '{port.get_name()}' must "
            f"be finite numbers up to {_MOST:g}, but number {k} is {values[k]}"
        )
    return values
