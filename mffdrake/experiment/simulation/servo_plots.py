"""Pictures of a hand that follows a target."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.plotting import SixPanels
from mffdrake.experiment.simulation.servo_evaluation import CalcHandErrors, WantedPose
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.recognition.poses.pose import pose_errors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PlotFollowing", "PlotHandError", "PlotSpace"]


def PlotFollowing(result: SimulationResult) -> Figure:
    """The target's pose in the camera over time: true, recognized and wanted.

    Args:
        result: A simulation's record.

    Returns:
        The figure: six panels over time.
    """
    scenario = LoadScenario(text=result.scenario)
    figure, axes = SixPanels(
        f"Target's pose in the {MakeMounts(scenario)[0].camera.name} camera, "
        f"method {scenario.method}, seed {scenario.seed}"
    )
    wanted = WantedPose(scenario)
    for k, axis in enumerate(axes):
        scale = 1e3 if k < 3 else 1.0
        axis.plot(result.time, scale * result.true_pose[:, k], color="0.75", lw=4, label="true")
        axis.plot(
            result.time, scale * result.recognized_pose[:, k], "tab:blue", lw=0.9,
            label="recognized",
        )  # fmt: skip
        axis.axhline(scale * wanted[k], color="k", ls="--", lw=1, label="wanted")
        room = max(np.ptp(scale * result.true_pose[:, k]), 10.0 if k < 3 else 0.02)
        middle = scale * wanted[k]
        low = min(middle, scale * result.true_pose[:, k].min()) - 0.3 * room
        axis.set_ylim(low, max(middle, scale * result.true_pose[:, k].max()) + 0.3 * room)
    axes[0].legend()
    return figure


def PlotHandError(result: SimulationResult) -> Figure:
    """The hand's and the recognition's errors over time.

    Args:
        result: A simulation's record.

    Returns:
        The figure: distances above, angles below, with logarithmic scales.
    """
    from matplotlib.figure import Figure

    scenario = LoadScenario(text=result.scenario)
    distances, angles = CalcHandErrors(result, scenario)
    off, turned = pose_errors(result.true_pose, result.recognized_pose)
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for axis, hand, seen, label in (
        (above, 1e3 * distances, 1e3 * off, "position error [mm]"),
        (below, np.degrees(angles), np.degrees(turned), "rotation error [deg]"),
    ):
        axis.semilogy(result.time, np.maximum(hand, 1e-3), "tab:orange", lw=1.2, label="hand")
        axis.semilogy(result.time, np.maximum(seen, 1e-3), "tab:blue", lw=0.8, label="recognition")
        axis.set_ylabel(label)
        axis.grid(alpha=0.3, which="both")
        axis.margins(x=0.01)
    above.legend()
    above.set_title(f"Errors while following, method {scenario.method}, seed {scenario.seed}")
    below.set_xlabel("time [s]")
    return figure


def PlotSpace(result: SimulationResult) -> Figure:
    """The hand's paths in space, desired and actual.

    Args:
        result: A simulation's record.

    Returns:
        The figure: from above and from the side, in the first hand frame.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.0), layout="constrained")
    actual, desired = 1e3 * result.actual_hand_pose, 1e3 * result.desired_hand_pose
    for axis, (a, b) in zip(figure.subplots(1, 2), ((0, 2), (0, 1)), strict=True):
        axis.plot(desired[:, a], desired[:, b], "k--", lw=1.2, label="desired")
        axis.plot(actual[:, a], actual[:, b], "tab:blue", lw=1.0, label="actual")
        axis.plot(*actual[0, [a, b]], "o", color="tab:green", label="start")
        axis.set_xlabel(f"{'xyz'[a]} [mm]")
        axis.set_ylabel(f"{'xyz'[b]} [mm]")
        axis.grid(alpha=0.3)
        low, high = axis.get_ylim()
        axis.set_ylim(min(low, -10.0), max(high, 10.0))
    axis.invert_yaxis()  # y points down
    axis.legend()
    figure.suptitle("Hand in its first frame: from above (left) and from behind (right)")
    return figure
