"""Closes the loop of a scenario that servoes."""

from __future__ import annotations

from typing import Any

from pydrake.systems.framework import DiagramBuilder, System

from mffdrake.experiment.cameras import MakeMounts
from mffdrake.experiment.control import Control
from mffdrake.experiment.parts import Station
from mffdrake.experiment.scenario import Scenario
from mffdrake.experiment.scenario_sections import ServoConfig
from mffdrake.systems.predictor import MffPredictor
from mffdrake.systems.prescribed_target import PrescribedTarget
from mffdrake.systems.recognizer import PoseRecognizer
from mffdrake.systems.target_motion_estimator import TargetMotionEstimator

__all__ = ["ConnectServo"]


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
    latency = _KnownLatency(scenario)
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


def _KnownLatency(scenario: Scenario) -> float:
    """The age of the images, as it is reckoned with [s]."""
    known = scenario.predictor.latency
    return MakeMounts(scenario)[0].latency if known is None else known
