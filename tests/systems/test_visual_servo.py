"""The servo's reference arm: it goes where the camera is wanted, as fast as it is allowed to."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from mffdrake.recognition.parameters import ParameterError
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
from mffdrake.systems.control.visual_servo import ServoParameters, VisualServoController
from mffdrake.systems.target_motion.prescribed_target import PrescribedTarget

PLANT = MakePa10Plant()
FRAME = PLANT.GetFrameByName("camera_right")


def camera(q):
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositions(context, q)
    return FRAME.CalcPoseInWorld(context)


X_CM = RigidTransform(RollPitchYaw(0.1, -0.2, 0.3), [0.0, 0.15, 0.8])
HOME = camera(NOMINAL_POSITIONS) @ X_CM
"""Where the target is where it is wanted, at the start."""


class Known(LeafSystem):
    """1 but between two times."""

    def __init__(self, start, end):
        super().__init__()
        self.DeclareVectorOutputPort(
            "is_known",
            1,
            lambda c, out: out.SetFromVector([float(not start <= c.get_time() < end)]),
        )


def follow(pose, velocity=None, duration=2.0, hidden=(9e9, 9e9), **parameters):
    """Reference positions, velocities, accelerations and whether it sticks, every 5 ms."""
    builder = DiagramBuilder()
    target = builder.AddSystem(PrescribedTarget(pose, velocity or (lambda t: np.zeros(6))))
    known = builder.AddSystem(Known(*hidden))
    servo = builder.AddSystem(
        VisualServoController(
            plant=PLANT, X_CM=X_CM, start=NOMINAL_POSITIONS,
            parameters=ServoParameters(**parameters),
        )
    )  # fmt: skip
    for name in ("X_WM", "target_velocity"):
        builder.Connect(target.GetOutputPort(name), servo.GetInputPort(name))
    builder.Connect(known.get_output_port(), servo.GetInputPort("is_known"))
    simulator = Simulator(builder.Build())
    context = servo.GetMyContextFromRoot(simulator.get_context())
    rows = []
    for t in np.arange(0.0025, duration, 0.005):
        simulator.AdvanceTo(t)
        rows.append([
            t, *servo.GetOutputPort("desired_state").Eval(context),
            *servo.GetOutputPort("desired_acceleration").Eval(context),
            *servo.GetOutputPort("is_stuck").Eval(context),
        ])  # fmt: skip
    rows = np.array(rows)
    return rows[:, 0], rows[:, 1:8], rows[:, 8:15], rows[:, 15:22], rows[:, 22]


def errors(pose, times, positions):
    """Distance [m] and angle [rad] between where the camera is wanted and the reference's."""
    found = []
    for t, q in zip(times, positions, strict=True):
        between = (pose(t) @ X_CM.inverse()).inverse() @ camera(q)
        found.append(
            [np.linalg.norm(between.translation()), between.rotation().ToAngleAxis().angle()]
        )
    return np.array(found).T


def test_where_all_is_well_it_stays():
    _, q, v, _, stuck = follow(lambda t: HOME, duration=0.5)
    np.testing.assert_allclose(q, np.tile(NOMINAL_POSITIONS, (len(q), 1)), atol=1e-9)
    np.testing.assert_allclose(v, 0.0, atol=1e-9)
    assert not stuck.any()


def test_an_error_falls_exponentially_with_the_gain():
    away = RigidTransform(HOME.rotation(), HOME.translation() + [0.0, 0.02, 0.01])
    times, q, *_ = follow(lambda t: away, gain=3.0, max_acceleration=1e6)
    distance, _ = errors(lambda t: away, times, q)
    # A step of 5 ms takes back 3 * 5 ms of it.
    expected = np.linalg.norm([0.02, 0.01]) * (1.0 - 3.0 * 0.005) ** (times / 0.005)
    np.testing.assert_allclose(distance, expected, rtol=0.01)


def test_a_gain_that_grows_toward_the_end():
    p = ServoParameters(gain=8.0, far_gain=2.0, far_error=0.02)
    assert p.CalcGain(0.0) == 8.0 and p.CalcGain(1.0) == pytest.approx(2.0)
    assert p.CalcGain(0.02) == pytest.approx(2.0 + 6.0 / np.e)
    away = RigidTransform(HOME.rotation(), HOME.translation() + [0.0, 0.1, 0.0])
    slow = follow(lambda t: away, gain=2.0, max_acceleration=1e6)
    both = follow(lambda t: away, gain=8.0, far_gain=2.0, max_acceleration=1e6)
    assert np.abs(both[2][0]).max() == pytest.approx(np.abs(slow[2][0]).max(), rel=0.05)
    assert errors(lambda t: away, *both[:2])[0][-1] < 0.1 * errors(lambda t: away, *slow[:2])[0][-1]


@pytest.mark.parametrize(("share", "lag"), [(0.0, 0.05 / 3.0), (0.5, 0.025 / 3.0), (1.0, 0.0)])
def test_the_lag_behind_a_constant_velocity_is_what_is_not_fed_forward(share, lag):
    """The ideal v / gain without the target's velocity, none with it."""

    def pose(t):
        return RigidTransform(HOME.rotation(), HOME.translation() + [0.0, 0.05 * t, 0.0])

    times, q, *_ = follow(
        pose,
        lambda t: np.array([0, 0.05, 0, 0, 0, 0]),
        duration=3.0,
        gain=3.0,
        velocity_share=share,
    )
    distance, angle = errors(pose, times, q)
    assert distance[-1] == pytest.approx(lag, abs=2e-4)
    assert angle[-1] < 1e-3


def test_a_turning_target_swings_the_camera_about_it():
    axis = np.array([0.0, 0.0, 1.0])

    def pose(t):
        return RigidTransform(RollPitchYaw(0, 0, 0.15 * t).ToRotationMatrix() @ HOME.rotation(),
                              HOME.translation())  # fmt: skip

    velocity = np.concatenate([np.zeros(3), 0.15 * axis])
    times, q, *_ = follow(pose, lambda t: velocity, duration=2.0, gain=5.0)
    distance, angle = errors(pose, times, q)
    assert distance[-1] < 5e-4 and angle[-1] < 1e-3
    assert np.linalg.norm(camera(q[-1]).translation() - camera(q[0]).translation()) > 0.2


def test_joints_keep_their_limits_and_velocities_do_not_jump():
    away = RigidTransform(HOME.rotation(), HOME.translation() + [0.0, 0.5, 0.0])
    times, q, v, a, _ = follow(lambda t: away, gain=20.0, max_acceleration=3.0, duration=1.5)
    assert (np.abs(v) <= PLANT.GetVelocityUpperLimits() + 1e-9).all()
    assert (q >= PLANT.GetPositionLowerLimits() - 1e-9).all()
    assert (q <= PLANT.GetPositionUpperLimits() + 1e-9).all()
    assert np.abs(a).max() == pytest.approx(3.0)
    np.testing.assert_allclose(np.diff(v, axis=0), 0.005 * a[1:], atol=1e-9)
    # Between two steps of velocity, positions go on as the velocities tell.
    middle = 0.5 * (v[1:] + v[:-1])
    np.testing.assert_allclose(np.diff(q, axis=0) / 0.005, middle, atol=1e-9)
    assert len(times) == len(q)


def test_a_target_that_is_not_known_is_waited_for():
    def pose(t):
        return RigidTransform(HOME.rotation(), HOME.translation() + [0.0, 0.1 * t, 0.0])

    times, q, v, _, _ = follow(
        pose, lambda t: np.array([0, 0.1, 0, 0, 0, 0]), duration=3.0, hidden=(1.0, 2.0), gain=3.0
    )
    assert np.abs(v[(times > 0.8) & (times < 1.0)]).max() > 0.05
    holds = (times > 1.5) & (times < 2.0)
    np.testing.assert_allclose(v[holds], 0.0, atol=0.02)  # but back to its nominal posture
    # Neither at the end nor at the beginning does it jump.
    assert np.abs(np.diff(v, axis=0)).max() <= 10.0 * 0.005 + 1e-9
    assert errors(pose, times, q)[0][-1] < 0.02


def test_a_target_out_of_reach_is_told():
    away = RigidTransform(HOME.rotation(), HOME.translation() + [1.5, 0.0, 0.0])
    *_, stuck = follow(lambda t: away, gain=3.0, duration=4.0)
    assert stuck[-100:].all()


def test_the_same_reference_whatever_the_ports_are_asked_between():
    servo = VisualServoController(plant=PLANT, X_CM=X_CM, start=NOMINAL_POSITIONS)
    context = servo.CreateDefaultContext()
    servo.GetInputPort("X_WM").FixValue(context, AbstractValue.Make(HOME))
    before = servo.GetOutputPort("desired_state").Eval(context).copy()
    context.SetTime(0.004)
    np.testing.assert_array_equal(servo.GetOutputPort("desired_state").Eval(context), before)


@pytest.mark.parametrize("name", ["gain", "far_gain", "max_acceleration", "period"])
def test_wrong_parameters_are_told(name):
    with pytest.raises(ParameterError, match=name):
        ServoParameters(**{name: 0.0})


def test_a_period_below_control_s_and_a_start_of_another_arm_are_refused():
    with pytest.raises(ValueError, match="at least the control period"):
        VisualServoController(
            plant=PLANT, X_CM=X_CM, start=NOMINAL_POSITIONS,
            parameters=ServoParameters(period=0.0005),
        )  # fmt: skip
    with pytest.raises(ValueError, match=r"start must have shape \(7,\)"):
        VisualServoController(plant=PLANT, X_CM=X_CM, start=np.zeros(6))
