"""What methods and coordinates are called and how they are colored, in every table and picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLORS", "COORDINATES", "METHOD_COLORS", "METHOD_NAMES", "PALETTE", "NewFigure"]

METHOD_NAMES = {"ga": "1-step GA", "mff": "MFF + 1-step GA"}
"""The methods as people call them."""

PALETTE = {
    "blue": "#0072b2", "vermilion": "#d55e00", "green": "#009e73", "purple": "#cc79a7",
    "orange": "#e69f00", "sky": "#56b4e9",
}  # fmt: skip
"""Colors that the color-blind can tell apart, too: those of Okabe and Ito."""

METHOD_COLORS = {"ga": PALETTE["vermilion"], "mff": PALETTE["blue"]}
"""The methods' colors in pictures."""

COLORS = {
    "true": "0.6", "recognized": PALETTE["blue"], "desired": "black", "actual": PALETTE["green"],
    "start": PALETTE["purple"],
}  # fmt: skip
"""Those of poses: the target's true and recognized one, the hand's desired and actual one."""

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
    axes: NDArray[Any] = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_prop_cycle(color=list(PALETTE.values()))
    return figure, axes
