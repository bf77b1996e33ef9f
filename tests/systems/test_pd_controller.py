"""The controller computes what a PD controller computes, once a tick, and swings as the paper's."""

import re

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from mffdrake.systems.arms.hand_path import AddHandPathSource, HandPath, SolveHandPath
from mffdrake.systems.arms.pa10 import JOINT_NAMES, AddPa10, MakePa10Plant
from mffdrake.systems.control.pd_controller import AddGravityCompensation, PdController
from mffdrake.systems.control.pd_gains import PdGains
from mffdrake.systems.timing import Timing

KP, KD = np.array([100.0, 20.0]), np.array([3.0, 0.5])


def actuation(controller: PdController, **inputs) -> np.ndarray:
    """The torques of one forced update."""
    context = controller.CreateDefaultContext()
    for name, value in inputs.items():
        controller.GetInputPort(name).FixValue(context, value)
    state = context.get_mutable_discrete_state()
    controller.CalcForcedDiscreteVariableUpdate(context, state)
    return controller.GetOutputPort("actuation").Eval(context)


# The system alone.


def test_torques_are_proportional_to_position_and_velocity_errors():
    torque = actuation(
        PdController(kp=KP, kd=KD),
        estimated_state=[0.1, -0.2, 1.0, 2.0],
        desired_state=[0.3, 0.5, -1.0, 2.5],
    )
    np.testing.assert_allclose(torque, [100 * 0.2 - 3 * 2.0, 20 * 0.7 + 0.5 * 0.5], rtol=1e-14)


def test_the_feedforward_torque_is_added_where_it_is_connected():
    controller = PdController(kp=KP, kd=KD)
    states = {"estimated_state": [0.1, 0, 0, 0], "desired_state": [0.2, 0, 0, 0]}
    np.testing.assert_allclose(actuation(controller, **states), [10.0, 0.0], atol=1e-14)
    torque = actuation(controller, **states, feedforward_torque=[-4.0, 7.0])
    np.testing.assert_allclose(torque, [6.0, 7.0], atol=1e-14)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_torques_stay_within_the_effort_limits(sign):
    torque = actuation(
        PdController(kp=KP, kd=KD, effort_limit=[5.0, np.inf]),
        estimated_state=np.zeros(4),
        desired_state=[sign, sign, 0, 0],
        feedforward_torque=[sign * 50.0, 0.0],
    )
    np.testing.assert_allclose(torque, [sign * 5.0, sign * 20.0])


def test_the_number_of_joints_is_that_of_the_gains():
    controller = PdController(kp=[1.0] * 5, kd=[1.0] * 5)
    sizes = [controller.get_input_port(i).size() for i in range(controller.num_input_ports())]
    assert sizes == [10, 10, 5]
    assert controller.GetOutputPort("actuation").size() == 5


def test_the_output_depends_on_the_state_only():
    assert not PdController(kp=KP, kd=KD).HasAnyDirectFeedthrough()


@pytest.mark.parametrize("period", [0.001, 0.01])
def test_a_torque_is_held_until_the_next_tick(period):
    """Desired: q_d = t. So the torque [N m] tells the time [s] at which it was computed."""
    builder = DiagramBuilder()
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], [[0.0, 1.0]])
    desired = builder.AddSystem(TrajectorySource(ramp, output_derivative_order=1))
    timing = Timing(control_period=period, vision_period=3 * period)
    controller = builder.AddSystem(PdController(kp=[1.0], kd=[0.0], timing=timing))
    builder.Connect(desired.get_output_port(), controller.GetInputPort("desired_state"))
    builder.ExportOutput(controller.get_output_port(), "actuation")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    controller_context = controller.GetMyMutableContextFromRoot(context)
    controller.GetInputPort("estimated_state").FixValue(controller_context, [0.0, 0.0])
    for time, computed_at in [(0.5, 0), (1.0, 0), (1.5, 1), (2.999, 2), (3.0, 2), (3.001, 3)]:
        simulator.AdvanceTo(time * period)  # It stops before the events at that time.
        torque = diagram.GetOutputPort("actuation").Eval(context)
        assert torque[0] == pytest.approx(computed_at * period, abs=1e-12), time


def test_the_first_torque_is_computed_at_initialization():
    controller = PdController(kp=[10.0], kd=[0.0])
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    controller.GetInputPort("estimated_state").FixValue(context, [0.0, 0.0])
    controller.GetInputPort("desired_state").FixValue(context, [0.5, 0.0])
    simulator.Initialize()
    assert controller.get_output_port().Eval(context)[0] == 5.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kd": [1.0]}, "PdController: kd must have shape (2,), not (1,)"),
        ({"kp": [[1.0, 2.0]]}, "PdController: kp must have shape (2,), not (1, 2)"),
        ({"kp": []}, "PdController: kp must have one number a joint, but is empty"),
        ({"kp": [1.0, -2.0]}, "PdController: kp must be finite and not negative, not [ 1. -2.]"),
        ({"kd": [1.0, np.nan]}, "PdController: kd must be finite and not negative, not [ 1. nan]"),
        ({"effort_limit": [0.0, 1.0]}, "PdController: effort_limit must be positive, not [0. 1.]"),
        ({"effort_limit": [1.0]}, "PdController: effort_limit must have shape (2,), not (1,)"),
    ],
)
def test_invalid_vectors_are_rejected_in_one_line(values, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        PdController(**{"kp": [1.0, 2.0], "kd": [1.0, 2.0], **values})


# The arm under control, without cameras.


def hand_deviation(gains: PdGains, path: HandPath, *, duration: float):
    """Simulates the arm along a path, from rest in the path's first pose, at its effort limits.

    Returns:
        Times [s] (T,), the hand's distance from its desired position [m] (T,) and the angle
        between its axes and the desired ones [rad] (T,).
    """
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.001, use_sampled_output_ports=False)
    plant, _ = AddMultibodyPlant(config, builder)
    AddPa10(plant)
    plant.Finalize()
    arm_plant = MakePa10Plant()
    trajectory = SolveHandPath(arm_plant, path, duration=duration)
    limits = [plant.GetJointActuatorByName(name).effort_limit() for name in JOINT_NAMES]
    controller = builder.AddSystem(
        PdController(kp=gains.kp, kd=gains.kd, effort_limit=limits, timing=Timing())
    )
    state = plant.get_state_output_port()
    desired = AddHandPathSource(builder, trajectory)
    builder.Connect(desired.get_output_port(), controller.GetInputPort("desired_state"))
    builder.Connect(state, controller.GetInputPort("estimated_state"))
    builder.Connect(controller.get_output_port(), plant.get_actuation_input_port())
    AddGravityCompensation(
        builder,
        arm_plant=arm_plant,
        estimated_state=state,
        feedforward_torque=controller.GetInputPort("feedforward_torque"),
    )
    logger = LogVectorOutput(state, builder, publish_period=0.01)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, trajectory.value(0.0))
    simulator.AdvanceTo(duration)

    log = logger.FindLog(simulator.get_context())
    context = arm_plant.CreateDefaultContext()
    hand = arm_plant.GetFrameByName("hand")
    distance, angle = [], []
    for t, x in zip(log.sample_times(), log.data().T, strict=True):
        arm_plant.SetPositionsAndVelocities(context, x)
        X_EdE = path.CalcHandPose(t).inverse() @ hand.CalcPoseInWorld(context)
        distance.append(np.linalg.norm(X_EdE.translation()))
        angle.append(X_EdE.rotation().ToAngleAxis().angle())
    return log.sample_times(), np.array(distance), np.array(angle)


@pytest.mark.parametrize("omega", [0.105, 0.314])
def test_the_lightly_damped_hand_swings_visibly_and_calms_down_after_30_s(omega):
    t, distance, angle = hand_deviation(
        PdGains.LightlyDamped(), HandPath(omega=omega), duration=40.0
    )
    speed = omega / 0.105  # The oscillation is in proportion to it.

    def peak(values, start, end):
        return values[(t >= start) & (t < end)].max() / speed

    assert peak(distance, 0.0, 5.0) == pytest.approx(0.0103, rel=0.03)
    assert peak(angle, 0.0, 5.0) == pytest.approx(np.radians(1.08), rel=0.03)
    for start in (0.0, 5.0, 10.0):
        assert peak(distance, start, start + 5.0) > 0.003
    assert 0.10 < peak(distance, 30.0, 35.0) / peak(distance, 0.0, 5.0) < 0.20
    peaks = [peak(distance, start, start + 5.0) for start in range(0, 40, 5)]
    assert peaks == sorted(peaks, reverse=True)


def test_the_well_damped_hand_is_soon_on_its_path():
    t, distance, angle = hand_deviation(PdGains.WellDamped(), HandPath(), duration=5.0)
    assert distance.max() < 0.0015
    assert distance[t > 0.5].max() < 1e-4
    assert angle[t > 0.5].max() < np.radians(0.01)


def test_the_arm_at_rest_stays_where_it_is_from_the_first_tick_on():
    """Gravity compensation carries it, and the first torque is there when the first tick begins."""
    _, distance, _ = hand_deviation(PdGains.LightlyDamped(), HandPath(omega=0.0), duration=1.0)
    assert distance.max() < 1e-8
