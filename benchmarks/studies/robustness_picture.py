"""The picture of the robustness study: a heat map of right, false and missed frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from studies.robustness_conditions import MOTIONS
from studies.robustness_page import METHODS, select, share

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = {"right": "Greens", "false": "Reds", "missed": "Blues"}
LEAST_TOP = 10.0  # %, so that small shares of false frames do not look like large ones
ROW_INCHES = 0.19


def save(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Writes the picture as PNG."""
    with path.open("wb") as file:
        plot(rows).savefig(file, format="png", dpi=120)


def plot(rows: Sequence[dict[str, Any]]) -> Figure:
    """A panel for each share: a line for each condition, columns for motions and methods."""
    from matplotlib.figure import Figure

    lines = list(dict.fromkeys((row["group"], row["strength"]) for row in rows))
    columns = [(motion, method) for motion in MOTIONS for method in METHODS]
    figure = Figure(figsize=(11.0, 2.2 + ROW_INCHES * len(lines)), layout="constrained")
    axes = figure.subplots(1, len(PANELS), sharey=True)
    for axis, (name, colors) in zip(axes, PANELS.items(), strict=True):
        values = np.full((len(lines), len(columns)), np.nan)
        for i, (group, strength) in enumerate(lines):
            for k, (motion, method) in enumerate(columns):
                given = {"group": group, "strength": strength, "motion": motion, "method": method}
                seeds = select(rows, **given)
                if seeds:
                    values[i, k] = 100.0 * share(seeds, name)
        _panel(axis, values, name, colors)
        axis.set_xticks(range(len(columns)), [f"{motion}\n{m}" for motion, m in columns])
    labels = [group if strength == "-" else f"{group}: {strength}" for group, strength in lines]
    axes[0].set_yticks(range(len(lines)), labels)
    starts = [i for i in range(1, len(lines)) if lines[i][0] != lines[i - 1][0]]
    for axis in axes:
        for start in starts:
            axis.axhline(start - 0.5, color="0.6", linewidth=0.6)
    return figure


def _panel(axis: Axes, values: np.ndarray, name: str, colors: str) -> None:
    """One share [%], with its numbers."""
    known = values[np.isfinite(values)]
    top = 100.0 if name == "right" else max(LEAST_TOP, float(known.max()))
    image = axis.imshow(values, cmap=colors, vmin=0.0, vmax=top, aspect="auto")
    for (i, k), value in np.ndenumerate(values):
        if np.isfinite(value):
            text = "0" if value == 0.0 else "100" if value == 100.0 else f"{value:.1f}"
            ink = "white" if value > 0.6 * top else "black"
            axis.text(k, i, text, ha="center", va="center", fontsize=7, color=ink)
    axis.xaxis.tick_top()
    axis.tick_params(length=0, labelsize=8)
    axis.figure.colorbar(
        image, ax=axis, location="bottom", fraction=0.03, pad=0.01, label=f"{name} [% of frames]"
    )
    axis.set_title(name)
