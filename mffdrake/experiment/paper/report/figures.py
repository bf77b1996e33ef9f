"""Pictures of the report: the paper's table, and what the error depends on, with quartiles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mffdrake.experiment.paper.paper_numbers import CELLS, PAPER
from mffdrake.experiment.paper.studies import PAPER_OMEGAS
from mffdrake.experiment.paper.study import FindGroup, QuartilesOf
from mffdrake.experiment.runs.table import Group, IsSettled
from mffdrake.experiment.simulation.style import (
    METHOD_COLORS,
    METHOD_NAMES,
    PALETTE,
    NewFigure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["AXIS_LABELS", "PlotStudies", "PlotTable", "ShownWindow"]

AXIS_LABELS = {
    "mean_fitness": "mean fitness", "x_mm": "x [mm]", "y_mm": "y [mm]", "z_mm": "z [mm]",
    "eps1": "eps1", "eps2": "eps2", "eps3": "eps3",
    "position_mm": "position [mm]", "rotation_deg": "rotation [deg]",
}  # fmt: skip
"""How people call the figures of `Summarize`."""

_CURVE_COLORS = {
    "GA": METHOD_COLORS["ga"], "MFF": METHOD_COLORS["mff"], "MFF, velocity mode": PALETTE["green"],
    "plain GA": PALETTE["orange"], "MFF + plain GA": PALETTE["purple"],
}  # fmt: skip
_DODGE = 0.13  # Between the points of one speed, whose distance is 1.


def ShownWindow(summary: Sequence[Group]) -> str:
    """Which frames to show: ``settled`` ones, or ``all`` where the runs are too short for that.

    Example:
        >>> ShownWindow([])
        'all'
    """
    return "settled" if IsSettled(row for group in summary for row in group.rows) else "all"


def PlotTable(summary: Sequence[Group]) -> Figure:
    """The numbers of the paper's Fig. 8 beside ours: medians with quartiles, over all frames.

    Args:
        summary: See `Summarize`; with the studies ``near`` and ``random``, as far as they are done.

    Returns:
        The figure: a panel for the fitness and one for each error, with a logarithmic axis.
    """
    figure, axes = NewFigure(2, 4, (13.0, 6.4))
    series = [
        (method, source) for method in ("ga", "mff") for source in ("paper", "near", "random")
    ]
    for axis, cell in zip(axes.flat, (*CELLS, "position_mm"), strict=True):
        for k, (method, source) in enumerate(series):
            shift = _DODGE * (k - 0.5 * (len(series) - 1))
            label = f"{METHOD_NAMES[method]}, {_SOURCES[source]}"
            if source == "paper":
                at = [n + shift for n in range(len(PAPER_OMEGAS))]
                values = [PAPER[method, omega][cell] for omega in PAPER_OMEGAS]
                axis.plot(
                    at, values, "D", color=METHOD_COLORS[method], fillstyle="none", markersize=6,
                    label=label,
                )  # fmt: skip
                continue
            points = [
                (n + shift, ours)
                for n, omega in enumerate(PAPER_OMEGAS)
                if (ours := QuartilesOf(FindGroup(summary, source, method, omega), cell, "all"))
            ]
            form, alpha = ("o", 1.0) if source == "near" else ("^", 0.5)
            _ErrorBars(
                axis, points, color=METHOD_COLORS[method], label=label, fmt=form, alpha=alpha
            )
        axis.set_title(AXIS_LABELS[cell], fontsize=10)
        axis.set_xticks(range(len(PAPER_OMEGAS)), [f"{omega:g}" for omega in PAPER_OMEGAS])
        axis.set_xlim(-0.5, len(PAPER_OMEGAS) - 0.5)
        axis.grid(alpha=0.3, axis="y", which="both")
        if cell != "mean_fitness":
            _MakeLogarithmic(axis)
    for axis in axes[-1]:
        axis.set_xlabel("omega [rad/s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    order = [f"{name}, {source}" for source in _SOURCES.values() for name in METHOD_NAMES.values()]
    figure.legend(
        [named[label] for label in order], order, loc="outside lower center", ncols=3, fontsize=9
    )
    figure.suptitle(
        "Mean fitness and root-mean-square errors over all frames: medians with quartiles"
    )
    return figure


_SOURCES = {"paper": "the paper", "near": "start near the target", "random": "random start"}


def PlotStudies(summary: Sequence[Group]) -> Figure | None:
    """What the position error depends on, a panel for each question: medians with quartiles.

    Args:
        summary: See `Summarize`.

    Returns:
        The figure, with the questions of which a curve has two points or more; None without any.
    """
    window = ShownWindow(summary)
    panels: tuple[tuple[str, str, tuple[tuple[str, str, str], ...]], ...] = (
        ("Speed", "omega [rad/s]", (
            ("random", "ga", "GA"), ("faster", "ga", ""), ("random", "mff", "MFF"),
            ("faster", "mff", ""), ("velocity", "mff", "MFF, velocity mode"),
            ("plain", "ga", "plain GA"), ("plain", "mff", "MFF + plain GA"))),
        ("Latency", "camera latency [frames]", (
            ("latency", "known", "reckoned with"), ("latency", "ignored", "ignored"))),
        ("Feedforward gain", "gain", (("gain", "mff", "MFF"),)),
        ("Hand-eye calibration", "rotation error [deg]", tuple(
            ("hand_eye", axis, f"about {axis}") for axis in "xyz")),
        ("Encoder noise", "standard deviation [deg]", (("noise", "mff", "MFF"),)),
        ("Generations", "generations a frame", (
            ("generations", "ga", "GA"), ("generations", "mff", "MFF"))),
    )  # fmt: skip
    asked = ((title, label, _Curves(summary, window, curves)) for title, label, curves in panels)
    found = [panel for panel in asked if any(len(points) > 1 for points in panel[2].values())]
    if not found:
        return None
    columns = min(3, len(found))
    rows = -(-len(found) // columns)
    figure, axes = NewFigure(rows, columns, (max(8.0, 13.0 * columns / 3), 3.6 * rows))
    fixed = QuartilesOf(FindGroup(summary, "fixed", "fixed", 0.0), "position_mm", window)
    for axis in axes.flat[len(found) :]:
        axis.remove()
    for axis, (title, label, curves) in zip(axes.flat, found, strict=False):
        for name, points in curves.items():
            color = _CURVE_COLORS.get(name)
            _ErrorBars(axis, points, fmt="o-", label=name, color=color)
        if fixed:
            axis.axhline(fixed.median, color="0.5", ls="--", lw=1, label="fixed camera")
        axis.set_title(title, fontsize=10)
        axis.set_xlabel(label)
        _MakeLogarithmic(axis)
        axis.grid(alpha=0.3, which="both")
        if axis.get_legend_handles_labels()[0]:
            low, high = axis.get_ylim()
            axis.set_ylim(low, high * (high / low) ** 0.4)  # Room for the legend.
            axis.legend(loc="upper left", fontsize=8, ncols=2)
    for axis in axes[:, 0]:
        axis.set_ylabel("position error (rms) [mm]")
    frames = "after the first seconds" if window == "settled" else "over all frames"
    figure.suptitle(f"Position error {frames}: medians with quartiles")
    return figure


def _Curves(
    summary: Sequence[Group], window: str, curves: Sequence[tuple[str, str, str]]
) -> dict[str, list[tuple[float, Any]]]:
    """Points of curves (study, curve, label); one without a label goes on with the one before."""
    joined: dict[str, list[tuple[float, Any]]] = {}
    name = ""
    for study, curve, label in curves:
        name = label or name
        joined.setdefault(name, []).extend(
            (group.labels["value"], ours)
            for group in summary
            if (group.labels["study"], group.labels["curve"]) == (study, curve)
            and (ours := QuartilesOf(group, "position_mm", window))
        )
    return {
        label: sorted(points, key=lambda point: point[0])
        for label, points in joined.items()
        if points
    }


def _MakeLogarithmic(axis: Axes) -> None:
    """A logarithmic axis with plain numbers: 0.5, not 5 x 10^-1."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    axis.set_yscale("log")
    axis.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    for set_formatter in (axis.yaxis.set_major_formatter, axis.yaxis.set_minor_formatter):
        set_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.tick_params(axis="y", which="both", labelsize=9)


def _ErrorBars(axis: Axes, points: Sequence[tuple[float, Any]], **style: Any) -> None:
    """Medians, with bars from the lower to the upper quartile."""
    axis.errorbar(
        [x for x, _ in points],
        [quartiles.median for _, quartiles in points],
        yerr=[
            [quartiles.median - quartiles.low for _, quartiles in points],
            [quartiles.high - quartiles.median for _, quartiles in points],
        ],
        markersize=4, linewidth=1.2, capsize=2, **style,
    )  # fmt: skip
