"""What leads a scenario's arm, and what controls it."""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import TrajectorySource

from mffdrake.experiment.scenario.scenario import Scenario, ScenarioError
from mffdrake.experiment.scenario.scenario_sections import ServoConfig
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.experiment.simulation.wiring.parts import Station
from mffdrake.experiment.simulation.wiring.target import CalcWantedPose
from mffdrake.systems.arms.arm_joints import JointNames, MovingJoints
from mffdrake.systems.arms.hand_path import AddHandPathSource
from mffdrake.systems.control.joint_encoders import JointEncoders
from mffdrake.systems.control.pd_controller import (
    AddComputedTorque,
    AddGravityCompensation,
    PdController,
)
from mffdrake.systems.control.visual_servo import VisualServoController

__all__ = ["AddControl", "Control", "MakeController"]


@dc.dataclass(frozen=True, kw_only=True)
class Control:
    """What the arm is to do and does, each with the joints' positions first.

    Attributes:
        reference: What leads the arm: the path's source, or the servo's controller.
        desired_state: The state that it wants.
        estimated_state: The arm's state as the encoders read it.
        actuation: The torques [N m].
    """

    reference: System
    desired_state: OutputPort
    estimated_state: OutputPort
    actuation: OutputPort


def AddControl(builder: DiagramBuilder, scenario: Scenario, station: Station) -> Control:
    """Adds what leads the arm, the joint encoders and the PD controller, connected to the arm."""
    plant, config = station.plant, scenario.controller
    reference, desired_state, desired_acceleration = _AddReference(builder, scenario, station)
    controller = builder.AddNamedSystem(
        "pd_controller", MakeController(scenario, station.known_arm)
    )
    estimated_state = _AddEncoders(builder, plant, scenario)
    builder.Connect(desired_state, controller.GetInputPort("desired_state"))
    builder.Connect(estimated_state, controller.GetInputPort("estimated_state"))
    builder.Connect(controller.GetOutputPort("actuation"), plant.get_actuation_input_port())
    feedforward = {
        "arm_plant": station.known_arm,
        "estimated_state": estimated_state,
        "feedforward_torque": controller.GetInputPort("feedforward_torque"),
    }
    if config.computed_torque and desired_acceleration is not None:
        AddComputedTorque(builder, desired_acceleration=desired_acceleration, **feedforward)
    elif config.gravity_compensation:
        AddGravityCompensation(builder, **feedforward)
    return Control(
        reference=reference,
        desired_state=desired_state,
        estimated_state=estimated_state,
        actuation=controller.GetOutputPort("actuation"),
    )


def _AddReference(
    builder: DiagramBuilder, scenario: Scenario, station: Station
) -> tuple[System, OutputPort, OutputPort | None]:
    """Adds what leads the arm; returns it and its ports of desired states and accelerations.

    (Of accelerations only where they are wanted.)
    """
    servo = scenario.servo
    if isinstance(servo, ServoConfig):
        system = builder.AddNamedSystem(
            "visual_servo",
            VisualServoController(
                plant=station.known_arm,
                camera_frame=MakeMounts(scenario)[0].frame_name,
                X_CM=CalcWantedPose(scenario),
                start=station.path.value(0.0).reshape(-1),
                parameters=servo.controller,
                timing=scenario.timing,
            ),
        )
        return (
            system,
            system.GetOutputPort("desired_state"),
            system.GetOutputPort("desired_acceleration"),
        )
    source = AddHandPathSource(builder, station.path)
    if not scenario.controller.computed_torque:
        return source, source.get_output_port(), None
    acceleration = builder.AddNamedSystem(
        "hand_path_acceleration", TrajectorySource(station.path.MakeDerivative(2))
    )
    return source, source.get_output_port(), acceleration.get_output_port()


def MakeController(scenario: Scenario, arm: MultibodyPlant) -> PdController:
    """The scenario's controller, with the effort limits of the arm's model.

    Raises:
        ScenarioError: When there is not one gain for each joint.
    """
    config = scenario.controller
    instance = arm.GetModelInstanceByName(scenario.arm.model)
    try:
        made = config.gains.MakeGains(
            arm,
            positions=scenario.arm.nominal_positions,
            model_instance=instance,
            timing=scenario.timing,
        )
    except ValueError as error:
        raise ScenarioError(f"controller.gains: {error}") from error
    gains = {
        "kp": made.kp if config.kp is None else config.kp,
        "kd": made.kd if config.kd is None else config.kd,
    }
    joints = MovingJoints(arm, instance)
    for name, values in gains.items():
        if len(values) != len(joints):
            raise ScenarioError(
                f"controller.{name} must be a list of {len(joints)} numbers, one for each of "
                f"{JointNames(joints)}, not {list(values)}"
            )
    return PdController(
        kp=gains["kp"],
        kd=gains["kd"],
        effort_limit=arm.GetEffortUpperLimits(),
        timing=scenario.timing,
    )


def _AddEncoders(builder: DiagramBuilder, plant: MultibodyPlant, scenario: Scenario) -> OutputPort:
    """The port with the arm's state as it is read; free of error, that is the plant's own."""
    config, num_joints = scenario.encoders, plant.num_positions()
    if config.noise_deg == 0.0 and config.resolution_deg == 0.0 and not any(config.offset_deg):
        return plant.get_state_output_port()
    if len(config.offset_deg) not in (0, num_joints):
        raise ScenarioError(
            f"encoders.offset_deg must be a list of {num_joints} numbers, one a joint, or empty, "
            f"not {list(config.offset_deg)}"
        )
    encoders = builder.AddNamedSystem(
        "joint_encoders",
        JointEncoders(
            num_joints=num_joints,
            noise=math.radians(config.noise_deg),
            offset=np.radians(config.offset_deg) if config.offset_deg else 0.0,
            resolution=math.radians(config.resolution_deg),
            seed=scenario.seed,
            timing=scenario.timing,
        ),
    )
    builder.Connect(plant.get_state_output_port(), encoders.get_input_port())
    return encoders.get_output_port()
