"""Pictures of results, in the style of the paper's Fig. 6, 7 and 8."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.recovery import CalcHandErrors, WantedPose
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.style import (
    COLORS,
    COORDINATES,
    METHOD_COLORS,
    METHOD_NAMES,
    NewFigure,
)
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.recognition.poses.pose import pose_errors
from mffdrake.recognition.recordings.files import WholeFile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "PlotFollowing",
    "PlotHandError",
    "PlotHandPath",
    "PlotPose",
    "PlotSpace",
    "PlotTrack",
    "SaveFigure",
    "SixPanels",
]

_TRUE: dict[str, Any] = {"color": COLORS["true"], "linewidth": 3.0, "label": "true"}


def SaveFigure(figure: Figure, path: Path | str) -> None:
    """Writes a figure as PNG or SVG, whole or not at all.

    Args:
        figure: The figure.
        path: The file; its suffix tells the format.

    Raises:
        OSError: When it cannot be written.

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> file = Path(tempfile.mkdtemp()) / "pose.png"
        >>> SaveFigure(PlotPose([Simulate(short)]), file)
        >>> file.exists()
        True
    """
    with WholeFile(path) as part:
        figure.savefig(part, dpi=120)


def SixPanels(title: str) -> tuple[Figure, list[Axes]]:
    """A figure with a panel over time for each of a pose's coordinates."""
    figure, axes = NewFigure(2, 3, (12.0, 5.5))
    for axis, (label, _) in zip(axes.flat, COORDINATES, strict=True):
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

    Example:
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> len(PlotHandPath(Simulate(short)).axes)
        6
    """
    omega = LoadScenario(text=result.scenario).hand_path.omega
    figure, axes = SixPanels(f"Hand pose in the first hand frame, omega = {omega:g} rad/s")
    for k, (axis, (_, scale)) in enumerate(zip(axes, COORDINATES, strict=True)):
        for name, style, pose in (
            ("actual", "-", result.actual_hand_pose), ("desired", "--", result.desired_hand_pose),
        ):  # fmt: skip
            axis.plot(
                result.time, scale * pose[:, k], style, color=COLORS[name], lw=1.2, label=name
            )
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
        instead of hiding the rest; triangles at its border tell when.

    Example:
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> len(PlotPose([Simulate(short)]).axes)
        7
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
    for k, (axis, (label, scale)) in enumerate(zip(axes[:6], COORDINATES, strict=True)):
        true = scale * results[0].true_pose[:, k]
        axis.plot(results[0].time, true, **_TRUE)
        for result in results:
            method = LoadScenario(text=result.scenario).method
            axis.plot(
                result.time, scale * result.recognized_pose[:, k],
                color=METHOD_COLORS[method], label=METHOD_NAMES[method], linewidth=0.8,
            )  # fmt: skip
        room = max(np.ptp(true), 40.0 if k < 3 else 0.08)
        axis.set_ylim(true.min() - 0.6 * room, true.max() + 0.6 * room)
        axis.set_ylabel(label)
        for result in results:
            color = METHOD_COLORS[LoadScenario(text=result.scenario).method]
            _MarkClipped(axis, result.time, scale * result.recognized_pose[:, k], color)
    for result in results:
        method = LoadScenario(text=result.scenario).method
        axes[6].plot(result.time, result.fitness, color=METHOD_COLORS[method], linewidth=0.8)
    axes[6].set_ylabel("fitness")
    axes[6].set_ylim(0.0, 1.05)
    axes[6].set_xlabel("time [s]")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.margins(x=0.01)
    named = _CurvesByName(axes[:6])
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=len(named))
    figure.align_ylabels()
    return figure


def PlotFollowing(result: SimulationResult) -> Figure:
    """The target's pose in the camera over time: true, recognized and wanted.

    Returns:
        The figure: six panels over time.
    """
    scenario = LoadScenario(text=result.scenario)
    figure, axes = SixPanels(
        f"Target's pose in the {MakeMounts(scenario)[0].camera.name} camera, "
        f"method {scenario.method}, seed {scenario.seed}"
    )
    wanted = WantedPose(scenario)
    for k, (axis, (_, scale)) in enumerate(zip(axes, COORDINATES, strict=True)):
        axis.plot(
            result.time, scale * result.true_pose[:, k], color=COLORS["true"], lw=4, label="true"
        )
        axis.plot(
            result.time, scale * result.recognized_pose[:, k], color=COLORS["recognized"],
            lw=0.9, label="recognized",
        )  # fmt: skip
        axis.axhline(scale * wanted[k], color="k", ls="--", lw=1, label="wanted")
        room = max(np.ptp(scale * result.true_pose[:, k]), 10.0 if k < 3 else 0.02)
        middle = scale * wanted[k]
        low = min(middle, scale * result.true_pose[:, k].min()) - 0.3 * room
        axis.set_ylim(low, max(middle, scale * result.true_pose[:, k].max()) + 0.3 * room)
        recognized = scale * result.recognized_pose[:, k]
        _MarkClipped(axis, result.time, recognized, COLORS["recognized"])
    named = _CurvesByName(axes)
    axes[0].legend(named.values(), named.keys())
    return figure


def PlotHandError(result: SimulationResult) -> Figure:
    """The hand's and the recognition's errors over time.

    Returns:
        The figure: distances above, angles below, with logarithmic scales.
    """
    scenario = LoadScenario(text=result.scenario)
    distances, angles = CalcHandErrors(result, scenario)
    off, turned = pose_errors(result.true_pose, result.recognized_pose)
    figure, ((above,), (below,)) = NewFigure(2, 1, (9.0, 6.0))
    for axis, hand, seen, label in (
        (above, 1e3 * distances, 1e3 * off, "position error [mm]"),
        (below, np.degrees(angles), np.degrees(turned), "rotation error [deg]"),
    ):
        for values, color, width, name in (
            (hand, COLORS["actual"], 1.2, "hand"), (seen, COLORS["recognized"], 0.8, "recognition"),
        ):  # fmt: skip
            shown = np.maximum(values, 1e-3)
            axis.semilogy(result.time, shown, color=color, lw=width, label=name)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3, which="both")
        axis.margins(x=0.01)
    above.legend()
    above.set_title(f"Errors while following, method {scenario.method}, seed {scenario.seed}")
    below.set_xlabel("time [s]")
    return figure


def PlotSpace(result: SimulationResult) -> Figure:
    """The hand's paths in space, desired and actual.

    Returns:
        The figure: from above and from the side, in the first hand frame.
    """
    figure, axes = NewFigure(1, 2, (11.0, 5.0))
    actual, desired = 1e3 * result.actual_hand_pose, 1e3 * result.desired_hand_pose
    for axis, (a, b) in zip(axes[0], ((0, 2), (0, 1)), strict=True):
        axis.plot(
            desired[:, a], desired[:, b], "--", color=COLORS["desired"], lw=1.2, label="desired"
        )
        axis.plot(actual[:, a], actual[:, b], color=COLORS["actual"], lw=1.0, label="actual")
        axis.plot(*actual[0, [a, b]], "o", color=COLORS["start"], label="start")
        axis.set_xlabel(f"{'xyz'[a]} [mm]")
        axis.set_ylabel(f"{'xyz'[b]} [mm]")
        axis.grid(alpha=0.3)
        low, high = axis.get_ylim()
        axis.set_ylim(min(low, -10.0), max(high, 10.0))
    axis.invert_yaxis()  # y points down
    axis.legend()
    figure.suptitle("Hand in its first frame: from above (left) and from behind (right)")
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
    for k, (axis, (_, scale)) in enumerate(zip(axes, COORDINATES, strict=True)):
        axis.plot(times, scale * poses[:, k], color=COLORS["recognized"], linewidth=1.0)
    return figure


def _MarkClipped(
    axis: Axes, time: NDArray[np.float64], values: NDArray[np.float64], color: str
) -> None:
    """Marks at a panel's border where a curve is outside of it; its limits are set already."""
    low, high = axis.get_ylim()
    for outside, border, marker in ((values > high, high, "^"), (values < low, low, "v")):
        if outside.any():
            axis.plot(
                time[outside], np.full(np.count_nonzero(outside), border), marker, color=color,
                markersize=4, clip_on=False, label="beyond the panel",
            )  # fmt: skip


def _CurvesByName(axes: Sequence[Axes]) -> dict[str, Any]:
    """What to put into the legend of several panels, each name once."""
    named: dict[str, Any] = {}
    for axis in axes:  # Not every panel has triangles.
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    return named


def _WidenFlat(axis: Axes, least: float) -> None:
    """Gives a nearly constant curve some room, so that noise does not look like motion."""
    low, high = axis.get_ylim()
    if high - low < least:
        middle = 0.5 * (low + high)
        axis.set_ylim(middle - 0.5 * least, middle + 0.5 * least)
