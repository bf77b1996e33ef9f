"""Where a scenario wants the hand: on its path, or where the camera sees the target as at first."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

from pydrake.math import RigidTransform

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.scenario.scenario_sections import NoServo
from mffdrake.systems.arms.hand_path import HandPath

__all__ = ["MakeDesiredHand", "MakeReferencePath"]


def MakeDesiredHand(scenario: Scenario) -> Callable[[float], RigidTransform]:
    """The hand's desired pose X_WE as a function of time [s].

    Args:
        scenario: The scenario. Where it servoes, the hand is to be to the target as its path's
            first pose is to the target's ``X_WM``.

    Example:
        >>> MakeDesiredHand(Scenario())(0.0).translation()
        array([0.918, 0.   , 0.455])
    """
    path = scenario.hand_path.Make()
    if isinstance(scenario.servo, NoServo):
        return path.CalcHandPose
    X_ME = scenario.target.X_WM.GetDeterministicValue().InvertAndCompose(path.CalcHandPose(0.0))
    return lambda time: scenario.target.CalcPose(time) @ X_ME


def MakeReferencePath(scenario: Scenario) -> HandPath:
    """The path that the hand's reference follows by itself: none but its first pose in servoing."""
    path = scenario.hand_path.Make()
    return path if isinstance(scenario.servo, NoServo) else dc.replace(path, omega=0.0)
