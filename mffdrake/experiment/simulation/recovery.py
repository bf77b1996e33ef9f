"""How a recognition lost the target and found it again, and how well a hand followed it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.wiring.target import CalcWantedPose
from mffdrake.recognition.poses.pose import pose_errors, pose_from_transform
from mffdrake.systems.clutter.occluder import Occluder
from mffdrake.systems.disturbances.missing_images import Black, Frozen

__all__ = ["RECOVERY", "CalcHandErrors", "CalcRecovery", "FindLoss", "OutageEnd", "WantedPose"]

Array = NDArray[np.float64]

_LOST = (0.05, np.radians(15.0))  # A recognized pose farther off than that [m], [rad] ...
_LOST_FOR = 1.0  # ... for so long [s] is lost.

RECOVERY: dict[str, tuple[type, str]] = {
    "first_right": (int, "frames to find"), "longest_wrong": (int, "longest"),
    "after_outage": (int, "recover"), "recovered": (bool, "recovered"),
}  # fmt: skip
"""Names of the figures of `CalcRecovery`, their types and headings."""


def OutageEnd(scenario: Scenario) -> float | None:
    """When the last outage of a scenario ends.

    Outages are images that are frozen or black, and a plate that passes by once.

    Returns:
        The time [s]; None where there is no outage.

    Example:
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> OutageEnd(LoadScenario(text="disturbances: [!Black {starts: [1, 2], duration: 0.5}]"))
        2.5
    """
    ends = []
    for disturbance in scenario.disturbances:
        if isinstance(disturbance, Frozen):
            ends.append(disturbance.start + disturbance.duration)
        elif isinstance(disturbance, Black):
            ends += [start + disturbance.duration for start in disturbance.starts]
    for clutter in scenario.clutter:
        if isinstance(clutter, Occluder) and clutter.duration is not None:
            ends.append(clutter.start + clutter.duration)
    return max(ends, default=None)


def CalcRecovery(
    time: NDArray[np.float64], right: NDArray[np.bool_], outage_end: float | None
) -> dict[str, Any]:
    """Counts the frames that it took to find the target, and to find it again.

    Args:
        time: Times of the frames [s], shape (K,).
        right: Which frames' poses are right, shape (K,).
        outage_end: See `OutageEnd`.

    Returns:
        ``first_right``, the number of frames before the first right one; ``longest_wrong``, the
        longest stretch of frames after it that are not right; both None where no frame is right.
        ``after_outage``, the number of frames from the end of the outage to the first right one,
        and ``recovered``, whether there is one; both None where no frame comes after an outage,
        the former also where there is no right one.

    Example:
        >>> CalcRecovery(np.arange(6.0), np.array([0, 1, 0, 0, 0, 1], dtype=bool), 3.0)
        {'first_right': 1, 'longest_wrong': 3, 'after_outage': 2, 'recovered': True}
    """
    after = np.zeros(len(time), dtype=bool)
    if outage_end is not None:
        after = time >= outage_end - 1e-9  # A rounding error must not move the end past a frame.
    hits, again = np.flatnonzero(right), np.flatnonzero(right[after])
    gaps = np.diff([*hits, len(right)]) - 1
    return {
        "first_right": int(hits[0]) if len(hits) else None,
        "longest_wrong": int(gaps.max()) if len(hits) else None,
        "after_outage": int(again[0]) if len(again) else None,
        "recovered": bool(len(again)) if after.any() else None,
    }


def WantedPose(scenario: Scenario) -> Array:
    """Where the first camera is to see the target: the pose vector, shape (6,)."""
    X_CM = CalcWantedPose(scenario)
    return pose_from_transform(X_CM.rotation().matrix(), X_CM.translation())


def CalcHandErrors(result: SimulationResult, scenario: Scenario) -> tuple[Array, Array]:
    """How far the target truly is from where the camera is to see it, at every frame.

    Args:
        result: A simulation's record, of K frames.
        scenario: Its scenario.

    Returns:
        Distances [m] and angles [rad], each of shape (K,).

    Example:
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> distances, angles = CalcHandErrors(Simulate(short), short)
        >>> (1000 * distances).round()  # mm
        array([0., 0., 0., 1.])
    """
    return pose_errors(result.true_pose, WantedPose(scenario))


def FindLoss(result: SimulationResult) -> float | None:
    """When the target was lost [s]: a recognized pose that has nothing to do with it for a second.

    Returns:
        When that began first; None where it never did.
    """
    distances, angles = pose_errors(result.true_pose, result.recognized_pose)
    off = (distances > _LOST[0]) | (angles > _LOST[1])
    since: float | None = None
    for time, is_off in zip(result.time.tolist(), off.tolist(), strict=True):
        if not is_off:
            since = None
        elif since is None:
            since = time
        if since is not None and time - since >= _LOST_FOR:
            return since
    return None
