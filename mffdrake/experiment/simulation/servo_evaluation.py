"""How well the hand followed a target."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.wiring.target import CalcWantedPose
from mffdrake.recognition.poses.pose import pose_errors, pose_from_transform

__all__ = ["CalcHandErrors", "EvaluateServo", "FindLoss", "WantedPose"]

Array = NDArray[np.float64]

_SETTLED_AFTER = 10.0  # [s]
_LOST = (0.05, np.radians(15.0))  # A recognized pose farther off than that [m], [rad] ...
_LOST_FOR = 1.0  # ... for so long [s] is lost.


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
    """
    return pose_errors(result.true_pose, WantedPose(scenario))


def FindLoss(result: SimulationResult) -> float | None:
    """When the target was lost [s]: a recognized pose that has nothing to do with it for a second.

    Args:
        result: A simulation's record.

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


def EvaluateServo(result: SimulationResult, scenario: Scenario) -> dict[str, Any]:
    """What a row of ``results.json`` has of servoing.

    Args:
        result: A simulation's record.
        scenario: Its scenario.

    Returns:
        ``hand_rms`` and ``hand_rms_settled``, each with ``position_mm`` and ``rotation_deg`` (None
        where there is no frame): the errors of `CalcHandErrors`, of all frames and of those from
        10 s on; and ``lost_s``, see `FindLoss`.
    """
    distances, angles = CalcHandErrors(result, scenario)

    def Rms(chosen: NDArray[np.bool_]) -> dict[str, float | None]:
        if not chosen.any():
            return {"position_mm": None, "rotation_deg": None}
        return {
            "position_mm": 1e3 * float(np.sqrt(np.mean(distances[chosen] ** 2))),
            "rotation_deg": float(np.degrees(np.sqrt(np.mean(angles[chosen] ** 2)))),
        }

    return {
        "hand_rms": Rms(np.ones(len(result.time), dtype=bool)),
        "hand_rms_settled": Rms(result.time >= _SETTLED_AFTER),
        "lost_s": FindLoss(result),
    }
