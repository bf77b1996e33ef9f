"""Pictures of several runs: errors over time, and figures against the hand's speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mffdrake.experiment.runs.table import GroupRows, IsSettled
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.evaluation import COLUMNS, SETTLED_AFTER
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.style import METHOD_COLORS, METHOD_NAMES, NewFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PlotComparison", "PlotErrors"]

_PANELS = {
    "mean_fitness": "mean fitness",
    "rms.position_mm": "position error (rms) [mm]",
    "rms.rotation_deg": "rotation error (rms) [deg]",
}


def PlotErrors(results: Sequence[SimulationResult]) -> Figure:
    """Position error over time of several runs, a panel for each speed.

    Args:
        results: Records of several methods and speeds.

    Returns:
        The figure, with a logarithmic error axis.

    Example:
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> PlotErrors([Simulate(short)]).axes[0].get_title()
        'omega = 0.105 rad/s'
    """
    scenarios = [LoadScenario(text=result.scenario) for result in results]
    speeds = list(dict.fromkeys(scenario.hand_path.omega for scenario in scenarios))
    figure, axes = NewFigure(len(speeds), 1, (12.0, 2.6 * len(speeds)))
    for axis, omega in zip(axes[:, 0], speeds, strict=True):
        for result, scenario in zip(results, scenarios, strict=True):
            if scenario.hand_path.omega == omega:
                error = result.recognized_pose[:, :3] - result.true_pose[:, :3]
                axis.semilogy(
                    result.time,
                    1e3 * np.linalg.norm(error, axis=1),
                    color=METHOD_COLORS[scenario.method],
                    label=f"{METHOD_NAMES[scenario.method]}, seed {scenario.seed}",
                    linewidth=0.8,
                )
        axis.axvline(
            SETTLED_AFTER, color="gray", linestyle=":", linewidth=1, label="settled from here on"
        )
        axis.set_title(f"omega = {omega:g} rad/s")
        axis.set_ylabel("position error [mm]")
        axis.grid(alpha=0.3, which="both")
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))  # where it hides nothing
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def PlotComparison(rows: Sequence[dict[str, Any]]) -> Figure:
    """Fitness and errors against the hand's speed, as in Fig. 8: medians and all seeds.

    Args:
        rows: Rows of `Evaluate`.

    Returns:
        The figure: three panels over omega.

    Example:
        >>> from mffdrake.experiment.simulation.evaluation import Evaluate
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> [axis.get_ylabel() for axis in PlotComparison([Evaluate(Simulate(short))]).axes][0]
        'mean fitness'
    """
    settled, groups = IsSettled(rows), GroupRows(rows, ("method", "omega"))
    figure, axes = NewFigure(1, 3, (13.0, 4.0))
    columns = (column for column in COLUMNS if column.name in _PANELS)
    for axis, column in zip(axes[0], columns, strict=True):
        name = column.settled if settled else column.name
        for method in dict.fromkeys(group.labels["method"] for group in groups):
            color = METHOD_COLORS[method]
            own = sorted(
                (group for group in groups if group.labels["method"] == method),
                key=lambda group: group.labels["omega"],
            )
            seeds = [(row["omega"], row[name]) for group in own for row in group.rows]
            axis.plot(*zip(*seeds, strict=True), "o", color=color, alpha=0.35, markersize=4)
            medians = [(group.labels["omega"], group.Value(column, settled)) for group in own]
            axis.plot(*zip(*medians, strict=True), "-", color=color, label=METHOD_NAMES[method])
        axis.set_xlabel("omega [rad/s]")
        axis.set_ylabel(_PANELS[column.name])
        axis.grid(alpha=0.3)
        if column.name != "mean_fitness":
            axis.set_ylim(bottom=0.0)
    axes[0, 0].legend()
    window = f"after the first {SETTLED_AFTER:g} s" if settled else "all frames"
    figure.suptitle(f"Medians over the seeds (points: single seeds), {window}")
    return figure
