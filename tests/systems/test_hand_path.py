"""The hand's circle is the paper's; the joints follow it exactly, smoothly and within limits."""

import math
import re
import time

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.systems.arms.hand_path import (
    AddHandPathSource,
    HandPath,
    SolveHandPath,
    UnreachablePathError,
)
from mffdrake.systems.arms.inverse_kinematics import ArmKinematics
from mffdrake.systems.arms.models import ConfigureParser
from mffdrake.systems.arms.pa10 import DEFAULT_P_EC, AddPa10, MakePa10Plant

PAPER_SPEEDS = (0.105, 0.157, 0.314)  # rad/s
QUARTER = 0.5 * math.pi  # phase [rad] at which the hand is at the end of its arc
X_EC = RigidTransform(DEFAULT_P_EC)


@pytest.fixture(scope="module")
def plant():
    return MakePa10Plant()


def pose_of(path: HandPath, t: float) -> np.ndarray:
    """Pose vector (6,) of the hand in E0, Eq. (30)."""
    X_E0E = path.X_WE0.inverse() @ path.CalcHandPose(t)
    return pose_from_transform(X_E0E.rotation().matrix(), X_E0E.translation())


def turn(axis: str, degrees: float) -> RotationMatrix:
    return getattr(RotationMatrix, f"Make{axis.upper()}Rotation")(math.radians(degrees))


# The path, Eqs. (29)-(31).


def test_the_path_starts_at_the_papers_first_hand_pose():
    expected = [[0, 0, 1, 0.918], [-1, 0, 0, 0], [0, -1, 0, 0.455], [0, 0, 0, 1]]
    np.testing.assert_array_equal(HandPath().CalcHandPose(0.0).GetAsMatrix4(), expected)


@pytest.mark.parametrize("omega", PAPER_SPEEDS)
def test_the_hand_follows_equation_30_with_the_sign_of_eps2_corrected(omega):
    path = HandPath(omega=omega)
    for t in np.linspace(0.0, 40.0, 23):
        theta = math.radians(15.0) * math.sin(omega * t)
        expected = [
            0.8 * math.sin(theta),
            0.0,
            0.8 - 0.8 * math.cos(theta),
            0.0,
            -math.sin(theta / 2.0),
            0.0,
        ]
        np.testing.assert_allclose(pose_of(path, t), expected, rtol=0, atol=1e-15)


def test_the_target_stays_where_the_right_camera_first_saw_it():
    path = HandPath()
    p_WM = path.CalcTargetPosition()
    np.testing.assert_allclose(p_WM, [1.718, 0.0, 0.455], atol=1e-15)
    X_WM = RigidTransform((path.CalcHandPose(0.0) @ X_EC).rotation(), p_WM)  # psi_M(0): eps = 0
    seen = []
    for t in np.linspace(0.0, 60.0, 241):
        X_CM = (path.CalcHandPose(t) @ X_EC).inverse() @ X_WM
        seen.append(pose_from_transform(X_CM.rotation().matrix(), X_CM.translation()))
    seen = np.array(seen)
    np.testing.assert_allclose(seen[:, :3], np.tile([0, 0.155, 0.8], (241, 1)), atol=1e-12)
    np.testing.assert_allclose(seen[:, [3, 5]], 0.0, atol=1e-12)
    assert seen[:, 4].max() == pytest.approx(0.1305, abs=1e-4)
    assert seen[:, 4].min() == pytest.approx(-0.1305, abs=1e-4)


def test_the_hands_velocity_is_the_derivative_of_its_pose():
    path = HandPath(
        amplitude=0.7,
        distance=0.5,
        omega=1.3,
        X_WE0=RigidTransform(turn("x", 40.0) @ turn("z", -70.0), [0.3, 0.2, 0.9]),
    )
    h = 1e-5
    for t in np.linspace(0.0, 6.0, 17):
        before, after = path.CalcHandPose(t - h), path.CalcHandPose(t + h)
        V_WE = path.CalcHandVelocity(t)
        v = (after.translation() - before.translation()) / (2.0 * h)
        np.testing.assert_allclose(V_WE.translational(), v, atol=1e-9)
        W = (after.rotation().matrix() - before.rotation().matrix()) / (2.0 * h)
        S = W @ path.CalcHandPose(t).rotation().matrix().T  # dR/dt = S(omega) R
        np.testing.assert_allclose(V_WE.rotational(), [S[2, 1], S[0, 2], S[1, 0]], atol=1e-9)


@pytest.mark.parametrize("still", [{"omega": 0.0}, {"amplitude": 0.0}])
def test_the_hand_can_stay(still, plant):
    path = HandPath(**still)
    assert path.CalcHandPose(7.0).IsExactlyEqualTo(path.X_WE0)
    np.testing.assert_array_equal(path.CalcHandVelocity(7.0).get_coeffs(), 0.0)
    trajectory = SolveHandPath(plant, path, duration=40.0)
    np.testing.assert_allclose(trajectory.value(33.3), trajectory.value(0.0), atol=1e-12)
    np.testing.assert_allclose(trajectory.EvalDerivative(33.3, 1), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"distance": 0.0}, "hand path: distance must be positive, not 0.0 m"),
        ({"distance": -0.8}, "hand path: distance must be positive, not -0.8 m"),
        ({"distance": math.inf}, "hand path: distance must be positive, not inf m"),
        ({"omega": -0.1}, "hand path: omega must be 0 or positive, not -0.1 rad/s"),
        ({"omega": math.nan}, "hand path: omega must be 0 or positive, not nan rad/s"),
        ({"amplitude": 15}, "hand path: amplitude must be from 0 to below pi rad, not 15 rad"),
        ({"amplitude": -1.0}, "hand path: amplitude must be from 0 to below pi rad, not -1.0 rad"),
        ({"X_WE0": RigidTransform([math.nan, 0, 0])}, "hand path: X_WE0 must be finite"),
    ],
)
def test_invalid_values_are_rejected_in_one_line(values, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        HandPath(**values)


# The joints.


def test_the_joints_are_those_of_the_arms_fact_sheet(plant):
    path = HandPath(omega=0.314)
    trajectory = SolveHandPath(plant, path, duration=16.0)
    start = np.degrees(trajectory.value(0.0)).ravel()
    np.testing.assert_allclose(start, [0, 29.98, 0, 89.99, 0, -29.97, 0], atol=0.006)
    for sign in (1, -1):  # The arc's two ends, mirror images of each other.
        q = np.degrees(trajectory.value((2 - sign) * QUARTER / path.omega)).ravel()
        expected = [-21.57 * sign, 40.11, 0, 73.98, -61.17 * sign, -42.85, 53.10 * sign]
        np.testing.assert_allclose(q, expected, atol=0.006)


@pytest.mark.parametrize("omega", [*PAPER_SPEEDS, 1.3])
def test_the_hand_is_on_the_path_between_the_knots_too(omega, plant):
    path = HandPath(omega=omega)
    trajectory = SolveHandPath(plant, path, duration=40.0)
    velocities = trajectory.derivative(1)
    assert trajectory.end_time() > 40.0
    arm = ArmKinematics(plant)
    context = plant.CreateDefaultContext()
    hand = plant.GetFrameByName("hand")
    for t in np.r_[np.random.default_rng(seed=1).uniform(0.0, 40.0, 200), 0.0, 40.0]:
        q, v = trajectory.value(t).ravel(), velocities.value(t).ravel()
        np.testing.assert_allclose(arm.CalcPoseError(q, path.CalcHandPose(t)), 0.0, atol=1e-8)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        np.testing.assert_allclose(
            hand.CalcSpatialVelocityInWorld(context).get_coeffs(),
            path.CalcHandVelocity(t).get_coeffs(),
            atol=2e-6,
        )
        assert abs(q[2]) < 1e-12 and q[3] > 0.0  # S3 at rest, elbow up.


def test_positions_velocities_and_accelerations_are_continuous(plant):
    trajectory = SolveHandPath(plant, HandPath(omega=0.314), duration=25.0)
    assert trajectory.get_number_of_segments() > 100
    for order in range(3):
        derivative = trajectory.derivative(order)
        breaks = np.array(trajectory.get_segment_times())[1:-1]
        jumps = [derivative.value(t) - derivative.value(t - 1e-9) for t in breaks]
        np.testing.assert_allclose(jumps, 0.0, atol=1e-8)


def test_solving_is_fast(plant):
    start = time.process_time()
    SolveHandPath(plant, HandPath(omega=1.3), duration=40.0)
    assert time.process_time() - start < 1.0  # It takes 0.1 s.


@pytest.mark.parametrize(
    "X_WE0",
    [
        RigidTransform(HandPath().X_WE0.rotation(), [0.70, 0.0, 0.50]),
        RigidTransform(HandPath().X_WE0.rotation(), [1.10, 0.0, 0.30]),
        RigidTransform(HandPath().X_WE0.rotation(), [0.70, 0.3, 0.20]),
        RigidTransform(turn("z", 90.0)) @ HandPath().X_WE0,
        RigidTransform(turn("z", -150.0)) @ HandPath().X_WE0,
        RigidTransform(turn("y", 60.0) @ HandPath().X_WE0.rotation(), [0.7, 0.0, 0.6]),
        HandPath().X_WE0 @ RigidTransform(turn("z", 90.0), [0.0, 0.0, 0.0]),
    ],
)
def test_other_first_poses_are_reached_elbow_up(X_WE0, plant):
    path = HandPath(X_WE0=X_WE0, distance=0.6)
    trajectory = SolveHandPath(plant, path, duration=40.0)
    arm = ArmKinematics(plant)
    for t in (0.0, 11.0, 40.0):
        q = trajectory.value(t).ravel()
        np.testing.assert_allclose(arm.CalcPoseError(q, path.CalcHandPose(t)), 0.0, atol=1e-6)
        assert q[3] > 0.0


def test_the_plant_may_hold_more_than_the_arm_and_be_part_of_a_diagram(plant):
    builder = DiagramBuilder()
    full_plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
    parser = Parser(full_plant)
    ConfigureParser(parser)
    parser.AddModels(url="package://mffdrake/target_box.sdf")  # A free body comes first.
    AddPa10(full_plant)
    full_plant.Finalize()
    trajectory = SolveHandPath(full_plant, HandPath(), duration=5.0)
    source = AddHandPathSource(builder, trajectory)
    builder.Build()
    assert source.get_name() == "hand_path"
    expected = SolveHandPath(plant, HandPath(), duration=5.0)
    np.testing.assert_allclose(trajectory.value(4.2), expected.value(4.2), atol=1e-9)


def test_the_source_gives_positions_then_velocities_until_the_very_end(plant):
    trajectory = SolveHandPath(plant, HandPath(), duration=2.0)
    source = AddHandPathSource(DiagramBuilder(), trajectory)
    context = source.CreateDefaultContext()
    for t in (0.0, 1.234, 2.0, np.nextafter(2.0, 3.0), 2.001):
        context.SetTime(t)
        state = source.get_output_port().Eval(context)
        np.testing.assert_allclose(state[:7], trajectory.value(t).ravel(), atol=1e-15)
        np.testing.assert_allclose(state[7:], trajectory.EvalDerivative(t, 1).ravel(), atol=1e-15)
        assert state[7] < -0.01  # S1 moves.


# Paths the arm cannot follow.


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (  # The hand moves away from the base, until the arm is straight.
            {"amplitude": math.radians(35.0)},
            r"hand path not reachable at t = 9\.\d\d s: no inverse-kinematics solution, as the arm "
            r"is almost stretched; the hand stays [\d.]+ mm and [\d.]+ deg off\. "
            r"Reduce the path's amplitude or distance, or move X_WE0\.",
        ),
        (
            {"X_WE0": RigidTransform(HandPath().X_WE0.rotation(), [1.3, 0.0, 0.455])},
            r"hand path not reachable at t = 0\.00 s: no inverse-kinematics solution, .*",
        ),
        (
            {"X_WE0": RigidTransform(HandPath().X_WE0.rotation(), [0.3, 0.0, 0.5])},
            r"hand path not reachable at t = 0\.00 s: joint E1 would pass its limit 2\.391 rad "
            r"\(it needs 2\.7\d\d rad\)\. Reduce the path's amplitude or distance, or move X_WE0\.",
        ),
        (
            {"X_WE0": RigidTransform(HandPath().X_WE0.rotation(), [0.918, 0.0, -0.2])},
            r"hand path not reachable at t = 0\.00 s: joint S2 would pass its limit 1\.588 rad .*",
        ),
        (
            {"omega": 3.0},
            r"hand path too fast at t = 0\.00 s: joint S1 would pass its velocity limit 1 rad/s "
            r"\(it needs 1\.265 rad/s\)\. Reduce the path's omega or amplitude\.",
        ),
    ],
)
def test_the_error_says_when_and_why_a_path_is_not_reachable_and_what_to_change(
    values, message, plant
):
    with pytest.raises(UnreachablePathError, match=f"^{message}$") as error:
        SolveHandPath(plant, HandPath(**values), duration=40.0)
    assert isinstance(error.value, ValueError)
    assert "\n" not in str(error.value)


def test_only_the_part_of_the_path_that_is_used_must_be_reachable(plant):
    path = HandPath(amplitude=math.radians(35.0))
    SolveHandPath(plant, path, duration=8.0)
    with pytest.raises(UnreachablePathError):
        SolveHandPath(plant, path, duration=10.0)


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan, math.inf])
def test_the_duration_must_be_positive(duration, plant):
    with pytest.raises(
        ValueError, match=f"^SolveHandPath: duration must be positive, .*{duration}"
    ):
        SolveHandPath(plant, HandPath(), duration=duration)
