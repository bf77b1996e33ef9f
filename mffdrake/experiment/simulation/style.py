"""What methods and coordinates are called and how they are colored, in every table and picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COORDINATES", "METHOD_COLORS", "METHOD_NAMES", "NewFigure"]

METHOD_NAMES = {"ga": "1-step GA", "mff": "MFF + 1-step GA"}
"""The methods as people call them."""

METHOD_COLORS = {"ga": "tab:orange", "mff": "tab:blue"}
"""Their colors in pictures."""

COORDINATES = (
    ("x [mm]", 1e3), ("y [mm]", 1e3), ("z [mm]", 1e3), ("eps1", 1.0), ("eps2", 1.0), ("eps3", 1.0),
)  # fmt: skip
"""The components of a pose vector: label with the unit, and factor to it from SI units."""


def NewFigure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, NDArray[Any]]:
    """A figure that belongs to no window and no global state.

    Args:
        rows: Rows of panels.
        columns: Panels in a row.
        size: Width and height [in].

    Returns:
        The figure, and its panels' axes, shape (rows, columns).
    """
    from matplotlib.figure import Figure  # Slow to import, and needed for plots alone.

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)
