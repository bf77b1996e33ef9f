"""Where hand and target are to be, and where they truly are.

A scenario wants the hand on its path, or where the camera sees the target as at first.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, Diagram

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.scenario.scenario_sections import NoServo
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.systems.arms.hand_path import HandPath

__all__ = ["CalcTruePoses", "MakeDesiredHand", "MakeReferencePath", "TruePose"]

Array = NDArray[np.float64]


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


class TruePose:
    """Tells where the target truly was in the first camera C when its images were exposed.

    Args:
        scenario: The scenario.
        diagram: Its diagram.
    """

    def __init__(self, scenario: Scenario, diagram: Diagram) -> None:
        self._plant = diagram.GetSubsystemByName("plant")
        arm = self._plant.GetModelInstanceByName(scenario.arm.model)
        reference = MakeMounts(scenario)[0]
        self._camera = self._plant.GetFrameByName(reference.frame_name, arm)
        self._num_joints = self._plant.num_positions()
        # What the images show, with a delayed camera, is posed apart.
        self._exposed_state = diagram.GetOutputPort("exposed_state")
        self._exposed_context = self._plant.CreateDefaultContext()
        self._target, self._latency = scenario.target, reference.latency

    def Calc(self, context: Context, frame_time: float) -> RigidTransform:
        """X_CM of the images that a recognizer reads at a frame.

        Args:
            context: The diagram's, just before that.
            frame_time: The frame's time [s].
        """
        return self.CalcShown(self._exposed_state.Eval(context), frame_time)

    def CalcShown(self, exposed_state: Array, frame_time: float) -> RigidTransform:
        """X_CM of images that show the plant in a state.

        Args:
            exposed_state: Of the diagram's port of that name.
            frame_time: The frame's time [s].
        """
        self._plant.SetPositions(self._exposed_context, exposed_state[: self._num_joints])
        X_WC = self._camera.CalcPoseInWorld(self._exposed_context)
        return X_WC.InvertAndCompose(self._target.CalcPose(frame_time - self._latency))


def CalcTruePoses(
    scenario: Scenario, diagram: Diagram, times: Array, states: Array, exposed_states: Array
) -> tuple[Array, Array, Array]:
    """Where target and hand were and should have been, at all frames of a simulation.

    Args:
        scenario: The scenario.
        diagram: Its diagram.
        times: The K frames' times [s].
        states: What the diagram's port ``state`` told, shape (K, size).
        exposed_states: What its port ``exposed_state`` told.

    Returns:
        Pose vectors of the target in the first camera C, and of the actual and of the desired hand
        in the first hand frame E0, each of shape (K, 6).

    Example:
        >>> from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
        >>> scenario = Scenario(duration=1.0)
        >>> diagram = MakeHandEyeDiagram(scenario)
        >>> state = diagram.GetOutputPort("state").Eval(diagram.CreateDefaultContext())
        >>> _, actual, _ = CalcTruePoses(scenario, diagram, [0.0], state[None], state[None])
        >>> (1000 * actual).round(3) + 0.0
        array([[0., 0., 0., 0., 0., 0.]])
    """
    plant = diagram.GetSubsystemByName("plant")
    arm, context = plant.GetModelInstanceByName(scenario.arm.model), plant.CreateDefaultContext()
    hand = plant.GetFrameByName(scenario.arm.hand_frame, arm)
    true_pose, CalcDesired = TruePose(scenario, diagram), MakeDesiredHand(scenario)
    X_E0W = scenario.hand_path.Make().CalcHandPose(0.0).inverse()
    X = np.empty((3, len(times), 3, 4))
    for k, (frame_time, state) in enumerate(zip(times, states, strict=True)):
        plant.SetPositionsAndVelocities(context, state)
        X[0, k] = true_pose.CalcShown(exposed_states[k], frame_time).GetAsMatrix34()
        X[1, k] = (X_E0W @ hand.CalcPoseInWorld(context)).GetAsMatrix34()
        X[2, k] = (X_E0W @ CalcDesired(frame_time)).GetAsMatrix34()
    true, actual, desired = pose_from_transform(X[..., :3], X[..., 3])
    return true, actual, desired
