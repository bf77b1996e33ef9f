"""Closes the loop of a scenario that servoes."""

from __future__ import annotations

import logging
import math
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.scenario.scenario_sections import ServoConfig
from mffdrake.experiment.simulation.wiring.cameras import KnownLatency, MakeMounts
from mffdrake.experiment.simulation.wiring.control import Control
from mffdrake.experiment.simulation.wiring.parts import Station
from mffdrake.experiment.simulation.wiring.poses import MakeDesiredHand
from mffdrake.systems.arms.inverse_kinematics import ArmKinematics, UnreachablePathError
from mffdrake.systems.target_motion.prescribed_target import PrescribedTarget
from mffdrake.systems.vision.predictor import MffPredictor
from mffdrake.systems.vision.recognizer import PoseRecognizer
from mffdrake.systems.vision.target_motion_estimator import TargetMotionEstimator

__all__ = ["CheckReach", "ConnectServo", "OutOfReach"]

_log = logging.getLogger("mffdrake")

_STUCK_FOR = 1.0  # [s] so long that it will not go on
_REACH_STEP = 0.1  # [s]


def ConnectServo(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Station,
    control: Control,
    recognizer: PoseRecognizer[Any],
    predictor: MffPredictor | None,
) -> None:
    """Lets the hand follow the target, where the scenario says so.

    Args:
        builder: Has all of these systems.
        scenario: What is built.
        station: Arm and target.
        control: Its reference is a `VisualServoController`.
        recognizer: What recognizes the target.
        predictor: The motion feedforward; None without.
    """
    servo = scenario.servo
    if not isinstance(servo, ServoConfig):
        return
    latency = KnownLatency(scenario)
    estimator: System = builder.AddNamedSystem(
        "target_motion_estimator",
        TargetMotionEstimator(parameters=servo.estimator, latency=latency, timing=scenario.timing),
    )
    if predictor is None:
        # Without feedforward, too, the estimator has to know where the camera was.
        predictor = builder.AddNamedSystem(
            "camera_pose",
            MffPredictor(
                plant=station.known_arm,
                camera_frame=MakeMounts(scenario)[0].frame_name,
                num_hypotheses=1,
                latency=latency,
                timing=scenario.timing,
            ),
        )
        builder.Connect(control.estimated_state, predictor.GetInputPort("estimated_state"))
        builder.Connect(predictor.GetOutputPort("X_WC"), recognizer.GetInputPort("X_WC"))
    elif servo.feed_velocity:
        builder.Connect(
            estimator.GetOutputPort("target_velocity"), predictor.GetInputPort("target_velocity")
        )
    for name in ("pose", "fitness", "pose_covariance", "frame_time", "is_tracking", "X_WM"):
        builder.Connect(recognizer.GetOutputPort(name), estimator.GetInputPort(name))
    source = estimator
    if servo.source == "truth":
        target = scenario.target
        source = builder.AddNamedSystem(
            "true_target", PrescribedTarget(target.CalcPose, target.CalcVelocity)
        )
    for name in ("X_WM", "target_velocity", "is_known"):
        builder.Connect(source.GetOutputPort(name), control.reference.GetInputPort(name))


class OutOfReach:
    """Finds out whether the arm can follow no longer.

    Args:
        diagram: A hand-eye diagram; where it does not servo, it is always in reach.

    Attributes:
        message: What to tell the person; empty while the arm is in reach.
    """

    def __init__(self, diagram: Diagram) -> None:
        self._servo: System | None = None
        if diagram.HasSubsystemNamed("visual_servo"):
            self._servo = diagram.GetSubsystemByName("visual_servo")
        self._is_stuck, self._since = False, math.inf
        self.message = ""

    def Look(self, context: Context) -> None:
        """Looks at the diagram's context at a frame."""
        if self._servo is not None:
            own = self._servo.GetMyContextFromRoot(context)
            self._is_stuck = self._servo.GetOutputPort("is_stuck").Eval(own)[0] == 1.0

    def IsLeft(self, time: float) -> bool:
        """Whether it has been stuck for long, at a time [s]."""
        self._since = min(self._since, time) if self._is_stuck else math.inf
        if time - self._since >= _STUCK_FOR:
            self.message = (
                f"the target left the arm's reach at {self._since:.2f} s: limits of its joints or "
                "a singular pose keep it from following; reduce target.motion, or move "
                "target.X_WM or hand_path.X_WE0"
            )
        return bool(self.message)


def CheckReach(scenario: Scenario, arm: MultibodyPlant) -> None:
    """Finds out beforehand where the arm cannot follow the target, as far as its path is known.

    Args:
        scenario: The scenario; only one that servoes counts.
        arm: The arm alone.

    Raises:
        UnreachablePathError: When it cannot right at the start. A later time is a warning, for
            results until then are worth having.
    """
    if not isinstance(scenario.servo, ServoConfig):
        return
    CalcHandPose = MakeDesiredHand(scenario)
    kinematics = ArmKinematics(
        arm,
        frame_name=scenario.arm.hand_frame,
        model_instance=arm.GetModelInstanceByName(scenario.arm.model),
        nominal=scenario.arm.nominal_positions,
        held_joints=scenario.arm.held_joints,
    )
    q = kinematics.SolveStart(CalcHandPose(0.0))
    for time in np.arange(0.0, scenario.duration, _REACH_STEP)[1:]:
        q = kinematics.SolvePose(CalcHandPose(time), q)
        try:
            kinematics.CheckPose(q, CalcHandPose(time), time)
        except UnreachablePathError as error:
            _log.warning("the hand cannot follow the target for the whole time: %s", error)
            return
