"""Pictures of results, in the style of the paper's Fig. 6, 7 and 8."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.evaluation import SETTLED_AFTER, Medians
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.recognition.recordings.files import WholeFile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "PlotComparison",
    "PlotErrors",
    "PlotHandPath",
    "PlotPose",
    "PlotToFile",
    "PlotTrack",
    "SaveFigure",
    "SixPanels",
]

_COORDINATES = (
    ("x [mm]", 1e3), ("y [mm]", 1e3), ("z [mm]", 1e3), ("eps1", 1.0), ("eps2", 1.0), ("eps3", 1.0),
)  # fmt: skip
_LABELS = {"ga": "1-step GA", "mff": "MFF + 1-step GA"}
_COLORS = {"ga": "tab:orange", "mff": "tab:blue"}
_TRUE: dict[str, Any] = {"color": "0.7", "linewidth": 3.0, "label": "true"}


def _Figure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, NDArray[Any]]:
    """A figure that belongs to no window and no global state."""
    from matplotlib.figure import Figure  # Slow to import, and needed for plots alone.

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def SaveFigure(figure: Figure, path: Path | str) -> None:
    """Writes a figure as PNG or SVG, whole or not at all.

    Args:
        figure: The figure.
        path: The file; its suffix tells the format.

    Raises:
        OSError: When it cannot be written.
    """
    with WholeFile(path) as part:
        figure.savefig(part, dpi=120)


def SixPanels(title: str) -> tuple[Figure, list[Axes]]:
    """A figure with a panel over time for each of a pose's coordinates."""
    figure, axes = _Figure(2, 3, (12.0, 5.5))
    for axis, (label, _) in zip(axes.flat, _COORDINATES, strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        axis.margins(x=0.01)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.align_ylabels()
    figure.suptitle(title)
    return figure, list(axes.flat)


def PlotHandPath(result: SimulationResult) -> Figure:
    """Desired and actual hand pose in the first hand frame E0, as in Fig. 6.

    Args:
        result: A simulation's record.

    Returns:
        The figure: six panels over time.
    """
    omega = LoadScenario(text=result.scenario).hand_path.omega
    figure, axes = SixPanels(f"Hand pose in the first hand frame, omega = {omega:g} rad/s")
    for k, (axis, (_, scale)) in enumerate(zip(axes, _COORDINATES, strict=True)):
        axis.plot(result.time, scale * result.actual_hand_pose[:, k], "tab:blue", label="actual")
        axis.plot(result.time, scale * result.desired_hand_pose[:, k], "k--", lw=1, label="desired")
        _WidenFlat(axis, 5.0 if k < 3 else 0.01)
    axes[0].legend()
    return figure


def PlotPose(results: Sequence[SimulationResult]) -> Figure:
    """True and recognized pose over time, as in Fig. 7, and the fitness.

    Args:
        results: Records of one or more methods on the same path.

    Returns:
        The figure: seven panels over time, the fitness below the others. The range of each follows
        the true pose (a wide gray line), so that wild guesses at the start run out of the panel
        instead of hiding the rest.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 9.0), layout="constrained")
    grid = figure.add_gridspec(4, 2)
    axes = [figure.add_subplot(grid[k % 3, k // 3]) for k in range(6)]
    axes.append(figure.add_subplot(grid[3, :]))
    scenario = LoadScenario(text=results[0].scenario)
    figure.suptitle(
        f"Target's pose in the right camera, omega = {scenario.hand_path.omega:g} rad/s, "
        f"seed {scenario.seed}"
    )
    for k, (axis, (label, scale)) in enumerate(zip(axes[:6], _COORDINATES, strict=True)):
        true = scale * results[0].true_pose[:, k]
        axis.plot(results[0].time, true, **_TRUE)
        for result in results:
            method = LoadScenario(text=result.scenario).method
            axis.plot(
                result.time, scale * result.recognized_pose[:, k],
                color=_COLORS[method], label=_LABELS[method], linewidth=0.8,
            )  # fmt: skip
        room = max(np.ptp(true), 40.0 if k < 3 else 0.08)
        axis.set_ylim(true.min() - 0.6 * room, true.max() + 0.6 * room)
        axis.set_ylabel(label)
    for result in results:
        method = LoadScenario(text=result.scenario).method
        axes[6].plot(result.time, result.fitness, color=_COLORS[method], linewidth=0.8)
    axes[6].set_ylabel("fitness")
    axes[6].set_ylim(0.0, 1.05)
    axes[6].set_xlabel("time [s]")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.margins(x=0.01)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.align_ylabels()
    return figure


def PlotErrors(results: Sequence[SimulationResult]) -> Figure:
    """Position error over time of several runs, a panel for each speed.

    Args:
        results: Records of several methods and speeds.

    Returns:
        The figure, with a logarithmic error axis.
    """
    scenarios = [LoadScenario(text=result.scenario) for result in results]
    speeds = list(dict.fromkeys(scenario.hand_path.omega for scenario in scenarios))
    figure, axes = _Figure(len(speeds), 1, (10.0, 2.6 * len(speeds)))
    for axis, omega in zip(axes[:, 0], speeds, strict=True):
        for result, scenario in zip(results, scenarios, strict=True):
            if scenario.hand_path.omega == omega:
                error = result.recognized_pose[:, :3] - result.true_pose[:, :3]
                axis.semilogy(
                    result.time,
                    1e3 * np.linalg.norm(error, axis=1),
                    color=_COLORS[scenario.method],
                    label=f"{_LABELS[scenario.method]}, seed {scenario.seed}",
                    linewidth=0.8,
                )
        axis.axvline(SETTLED_AFTER, color="gray", linestyle=":", linewidth=1)
        axis.set_title(f"omega = {omega:g} rad/s")
        axis.set_ylabel("position error [mm]")
        axis.grid(alpha=0.3, which="both")
        axis.legend(loc="upper right")
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def PlotComparison(rows: Sequence[dict[str, Any]]) -> Figure:
    """Fitness and errors against the hand's speed, as in Fig. 8: medians and all seeds.

    Args:
        rows: Rows of `Evaluate`.

    Returns:
        The figure: three panels over omega.
    """
    settled = all(row["mean_fitness_settled"] is not None for row in rows)
    suffix = "_settled" if settled else ""
    figure, axes = _Figure(1, 3, (13.0, 4.0))
    panels = (
        ("mean fitness", lambda row: row[f"mean_fitness{suffix}"], False),
        ("position error (rms) [mm]", lambda row: row[f"rms{suffix}"]["position_mm"], True),
        ("rotation error (rms) [deg]", lambda row: row[f"rms{suffix}"]["rotation_deg"], True),
    )
    medians = Medians(rows)
    for axis, (label, read, from_zero) in zip(axes[0], panels, strict=True):
        for method in dict.fromkeys(row["method"] for row in rows):
            color = _COLORS[method]
            seeds = [row for row in rows if row["method"] == method]
            middle = sorted(
                (row for row in medians if row["method"] == method), key=lambda row: row["omega"]
            )
            axis.plot(
                [row["omega"] for row in seeds], [read(row) for row in seeds],
                "o", color=color, alpha=0.35, markersize=4,
            )  # fmt: skip
            axis.plot(
                [row["omega"] for row in middle], [read(row) for row in middle],
                "-", color=color, label=_LABELS[method],
            )  # fmt: skip
        axis.set_xlabel("omega [rad/s]")
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if from_zero:
            axis.set_ylim(bottom=0.0)
    axes[0, 0].legend()
    window = f"after the first {SETTLED_AFTER:g} s" if settled else "all frames"
    figure.suptitle(f"Medians over the seeds (points: single seeds), {window}")
    return figure


def PlotTrack(
    times: NDArray[np.float64], poses: NDArray[np.float64], fitness: NDArray[np.float64]
) -> Figure:
    """Recognized poses and their fitness over time.

    Args:
        times: Of the frames [s], shape (K,).
        poses: Pose vectors ``(r [m], eps)`` in the rig's frame, shape (K, 6).
        fitness: Their fitness, shape (K,).
    """
    figure, axes = SixPanels(f"Recognized pose; mean fitness {fitness.mean():.3f}")
    for k, (axis, (_, scale)) in enumerate(zip(axes, _COORDINATES, strict=True)):
        axis.plot(times, scale * poses[:, k], color="tab:blue", linewidth=1.0)
    return figure


def _WidenFlat(axis: Axes, least: float) -> None:
    """Gives a nearly constant curve some room, so that noise does not look like motion."""
    low, high = axis.get_ylim()
    if high - low < least:
        middle = 0.5 * (low + high)
        axis.set_ylim(middle - 0.5 * least, middle + 0.5 * least)


def PlotToFile(plot: Callable[..., Figure], data: object, path: Path | str) -> None:
    """Plots and writes the picture, for a process that does nothing else.

    Args:
        plot: One of this module's functions that make a figure.
        data: What it plots.
        path: See `SaveFigure`.

    Raises:
        OSError: When it cannot be written.
    """
    SaveFigure(plot(data), path)
