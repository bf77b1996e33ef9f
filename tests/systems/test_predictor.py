"""The prediction is the motion of the camera and of the target, as Drake's kinematics computes it.

Frames: W world, C the right camera at the last frame, D the right camera at the present one, M the
target.
"""

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.predictor import MffPredictor

ARM = MakePa10Plant()
PERIOD = 0.033
AT_REST = np.zeros(7)
V_WM = np.array([0.3, -0.2, 0.1])  # m/s
W_WM = np.array([0.5, 1.0, -0.8])  # rad/s


def random_poses(rng, count):
    """X_CM of targets in front of the camera, turned by up to 150 deg."""
    axes = rng.standard_normal((count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return [
        RigidTransform(RotationMatrix(AngleAxis(angle, axis)), p)
        for axis, angle, p in zip(
            axes,
            rng.uniform(0.0, np.radians(150.0), count),
            rng.uniform([-0.2, -0.2, 0.5], [0.2, 0.3, 1.0], (count, 3)),
            strict=True,
        )
    ]


def random_joints(rng):
    return NOMINAL_POSITIONS + rng.uniform(-0.5, 0.5, 7)


def vector(X_CM):
    """The pose vector (r, eps), eta >= 0."""
    q = X_CM.rotation().ToQuaternion()
    return np.append(X_CM.translation(), q.xyz() * (1.0 if q.w() >= 0.0 else -1.0))


def vectors(poses):
    return np.concatenate([vector(X_CM) for X_CM in poses])


def camera_pose(q):
    """X_WC of the right camera."""
    context = ARM.CreateDefaultContext()
    ARM.SetPositions(context, q)
    return ARM.GetFrameByName("camera_right").CalcPoseInWorld(context)


def turned(angular_velocity, time):
    """The rotation at a constant angular velocity."""
    speed = np.linalg.norm(angular_velocity)
    return RotationMatrix(AngleAxis(speed * time, angular_velocity / speed))


def moved_target(X_WM, time):
    """The target after moving with V_WM and W_WM."""
    R_WM = turned(W_WM, time) @ X_WM.rotation()
    return RigidTransform(R_WM, X_WM.translation() + time * V_WM)


def sample(predictor, context):
    predictor.CalcForcedDiscreteVariableUpdate(context, context.get_mutable_discrete_state())


def predict(last, present, poses, *, last_velocity=AT_REST, target_velocity=None, **arguments):
    """The predicted population after two frames with these joint positions: (N, 6)."""
    predictor = MffPredictor(plant=ARM, num_hypotheses=len(poses), **arguments)
    context = predictor.CreateDefaultContext()
    predictor.GetInputPort("population").FixValue(context, vectors(poses))
    if target_velocity is not None:
        predictor.GetInputPort("target_velocity").FixValue(context, target_velocity)
    state = predictor.GetInputPort("estimated_state")
    state.FixValue(context, np.append(last, last_velocity))
    sample(predictor, context)
    state.FixValue(context, np.append(present, AT_REST))
    return predictor.GetOutputPort("predicted_population").Eval(context).reshape(-1, 6)


# The exact mode.


def test_rigid_prediction_is_the_transport_by_the_cameras_own_motion():
    rng = np.random.default_rng(0)
    for _ in range(20):
        last, present = random_joints(rng), random_joints(rng)
        poses = random_poses(rng, 8)
        X_DC = camera_pose(present).inverse() @ camera_pose(last)
        expected = [vector(X_DC @ X_CM) for X_CM in poses]
        np.testing.assert_allclose(predict(last, present, poses), expected, atol=1e-13)


def test_the_prediction_keeps_the_targets_place_in_the_world():
    """The same, in other words: X_WC X_CM = X_WD X_DM."""
    rng = np.random.default_rng(1)
    last, present = random_joints(rng), random_joints(rng)
    (X_CM,) = random_poses(rng, 1)
    (predicted,) = predict(last, present, [X_CM])
    eta = np.sqrt(1.0 - predicted[3:] @ predicted[3:])
    X_DM = RigidTransform(Quaternion(wxyz=[eta, *predicted[3:]]), predicted[:3])
    X_WM = camera_pose(present) @ X_DM
    assert X_WM.IsNearlyEqualTo(camera_pose(last) @ X_CM, 1e-13)


def test_an_arm_at_rest_changes_nothing():
    rng = np.random.default_rng(2)
    poses = random_poses(rng, 8)
    last = random_joints(rng)
    for mode in ("rigid", "velocity"):
        predicted = predict(last, last, poses, mode=mode)
        np.testing.assert_allclose(predicted.ravel(), vectors(poses), atol=1e-14)


@pytest.mark.parametrize("period", [0.033, 0.1])
def test_rigid_prediction_of_a_moving_target_is_exact(period):
    rng = np.random.default_rng(3)
    timing = Timing(vision_period=period)
    for _ in range(5):
        last, present = random_joints(rng), random_joints(rng)
        poses = random_poses(rng, 8)
        X_WC, X_WD = camera_pose(last), camera_pose(present)
        expected = [vector(X_WD.inverse() @ moved_target(X_WC @ X, period)) for X in poses]
        predicted = predict(
            last, present, poses, target_velocity=np.append(V_WM, W_WM), timing=timing
        )
        np.testing.assert_allclose(predicted, expected, atol=1e-13)


# The first-order mode.


def test_velocity_prediction_errs_in_the_second_order_of_the_period():
    rng = np.random.default_rng(4)
    last, velocity = random_joints(rng), rng.uniform(-1.0, 1.0, 7)
    poses = random_poses(rng, 8)
    errors = []
    for period in (0.008, 0.016, 0.032):
        predicted = predict(
            last,
            last + 1.0,  # Where the arm is now does not matter to this mode.
            poses,
            last_velocity=velocity,
            target_velocity=np.append(V_WM, W_WM),
            mode="velocity",
            timing=Timing(vision_period=period),
        )
        X_WC, X_WD = camera_pose(last), camera_pose(last + period * velocity)
        truth = [vector(X_WD.inverse() @ moved_target(X_WC @ X, period)) for X in poses]
        errors.append(np.linalg.norm(predicted - truth, axis=1))
    ratios = np.array(errors[1:]) / errors[:-1]
    np.testing.assert_allclose(ratios, 4.0, rtol=0.1)


def test_velocity_prediction_is_the_pose_rate_times_the_period():
    rng = np.random.default_rng(5)
    last, velocity = random_joints(rng), rng.uniform(-1.0, 1.0, 7)
    (X_CM,) = random_poses(rng, 1)
    predictor = MffPredictor(plant=ARM, num_hypotheses=1, mode="velocity")
    context = predictor.CreateDefaultContext()
    predictor.GetInputPort("population").FixValue(context, vector(X_CM))
    predictor.GetInputPort("estimated_state").FixValue(context, np.append(last, velocity))
    sample(predictor, context)
    rate = predictor.GetOutputPort("pose_rate").Eval(context)
    predicted = predictor.GetOutputPort("predicted_population").Eval(context)
    np.testing.assert_allclose(predicted, vector(X_CM) + PERIOD * rate, atol=1e-15)


@pytest.mark.parametrize("target_moves", [False, True])
def test_pose_rate_is_the_derivative_of_the_true_motion(target_moves):
    rng = np.random.default_rng(6)
    step = 1e-5
    for _ in range(10):
        q, velocity = random_joints(rng), rng.uniform(-1.0, 1.0, 7)
        poses = random_poses(rng, 3)
        predictor = MffPredictor(plant=ARM, num_hypotheses=3)
        context = predictor.CreateDefaultContext()
        predictor.GetInputPort("population").FixValue(context, vectors(poses))
        predictor.GetInputPort("estimated_state").FixValue(context, np.append(q, velocity))
        if target_moves:
            target_velocity = predictor.GetInputPort("target_velocity")
            target_velocity.FixValue(context, np.append(V_WM, W_WM))
        X_WM = camera_pose(q) @ poses[0]

        def true_pose(time, q=q, velocity=velocity, X_WM=X_WM):
            present = moved_target(X_WM, time) if target_moves else X_WM
            return vector(camera_pose(q + time * velocity).inverse() @ present)

        derivative = (true_pose(step) - true_pose(-step)) / (2.0 * step)
        rate = predictor.GetOutputPort("pose_rate").Eval(context)
        np.testing.assert_allclose(rate, derivative, atol=1e-8)


# The gain.


@pytest.mark.parametrize("mode", ["rigid", "velocity"])
def test_without_gain_nothing_is_predicted(mode):
    rng = np.random.default_rng(7)
    poses = random_poses(rng, 8)
    predicted = predict(
        random_joints(rng),
        random_joints(rng),
        poses,
        last_velocity=rng.uniform(-1.0, 1.0, 7),
        target_velocity=np.append(V_WM, W_WM),
        mode=mode,
        gain=0.0,
    )
    np.testing.assert_allclose(predicted.ravel(), vectors(poses), atol=1e-14)


def test_half_the_gain_is_half_the_displacement():
    rng = np.random.default_rng(8)
    last = random_joints(rng)
    present = last + rng.uniform(-0.1, 0.1, 7)
    poses = random_poses(rng, 8)
    X_DC = camera_pose(present).inverse() @ camera_pose(last)
    half_turn = Quaternion.Identity().slerp(0.5, X_DC.rotation().ToQuaternion())
    half = RigidTransform(half_turn, 0.5 * X_DC.translation())
    expected = [vector(half @ X_CM) for X_CM in poses]
    np.testing.assert_allclose(predict(last, present, poses, gain=0.5), expected, atol=1e-13)


def test_half_the_gain_is_half_the_step():
    rng = np.random.default_rng(9)
    last, velocity = random_joints(rng), rng.uniform(-1.0, 1.0, 7)
    poses = random_poses(rng, 8)
    start = np.reshape(vectors(poses), (-1, 6))
    half, whole = (
        predict(last, last, poses, last_velocity=velocity, mode="velocity", gain=gain)
        for gain in (0.5, 1.0)
    )
    np.testing.assert_allclose(half - start, 0.5 * (whole - start), atol=1e-15)
    assert np.all(np.any(whole != start, axis=1))


def test_the_gain_counts_for_the_targets_own_motion_too():
    rng = np.random.default_rng(10)
    last = random_joints(rng)
    poses = random_poses(rng, 8)
    X_WC = camera_pose(last)
    expected = [vector(X_WC.inverse() @ moved_target(X_WC @ X, 0.5 * PERIOD)) for X in poses]
    predicted = predict(last, last, poses, target_velocity=np.append(V_WM, W_WM), gain=0.5)
    np.testing.assert_allclose(predicted, expected, atol=1e-13)


# In a simulation, with and without a camera delay.

KNOTS = np.linspace(0.0, 0.5, 26)
JOINTS = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
    KNOTS,
    NOMINAL_POSITIONS[:, None]
    + np.array([0.3, 0.2, -0.25, 0.15, 0.5, -0.4, 0.6])[:, None]
    * np.sin(np.outer(np.arange(3.0, 10.0), KNOTS)),
)
"""An arm in quick motion, all of its joints at frequencies of their own."""


class MovingArm:
    """A simulation of a predictor with that arm, at its frames."""

    def __init__(self, poses, **arguments):
        builder = DiagramBuilder()
        arm = builder.AddSystem(TrajectorySource(JOINTS, output_derivative_order=1))
        population = builder.AddSystem(ConstantVectorSource(vectors(poses)))
        self.predictor = builder.AddSystem(
            MffPredictor(plant=ARM, num_hypotheses=len(poses), **arguments)
        )
        state, previous = (
            self.predictor.GetInputPort(name) for name in ("estimated_state", "population")
        )
        builder.Connect(arm.get_output_port(), state)
        builder.Connect(population.get_output_port(), previous)
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.timing = self.predictor.timing

    def at_frame(self, frame):
        """The predicted population and the displacement that the recognizer reads at a frame."""
        # Events at that time run in the next step: this is what a system's update reads there.
        if frame > 0:  # Advancing by no time would run the events at 0 already.
            self.simulator.AdvanceTo(self.timing.TimeOfFrame(frame))
        context = self.predictor.GetMyContextFromRoot(self.simulator.get_context())
        return (
            self.predictor.GetOutputPort("predicted_population").Eval(context).reshape(-1, 6),
            self.predictor.GetOutputPort("camera_displacement").Eval(context),
        )


@pytest.mark.parametrize("latency", [0.0, 0.001, 0.010, 0.032, 0.033, 0.034, 0.040, 0.066, 0.100])
def test_the_prediction_is_the_transport_between_the_last_two_exposures(latency):
    poses = random_poses(np.random.default_rng(11), 4)
    arm = MovingArm(poses, latency=latency)
    predicting = 0
    for frame in range(10):
        time = Timing().TimeOfFrame(frame)
        predicted, X_DC = arm.at_frame(frame)
        if time - latency - PERIOD < -1e-9:  # The last exposure was before the simulation.
            np.testing.assert_array_equal(predicted.ravel(), vectors(poses))
            assert X_DC.IsExactlyIdentity()
            continue
        X_WC = camera_pose(JOINTS.value(max(0.0, time - latency - PERIOD)).ravel())
        X_WD = camera_pose(JOINTS.value(time - latency).ravel())
        expected = X_WD.inverse() @ X_WC
        assert X_DC.IsNearlyEqualTo(expected, 1e-12)
        np.testing.assert_allclose(predicted, [vector(expected @ X) for X in poses], atol=1e-12)
        assert not expected.IsNearlyIdentity(1e-3)
        predicting += 1
    assert predicting == 10 - np.ceil(round((latency + PERIOD) / PERIOD, 6))


@pytest.mark.parametrize("latency", [0.0, 0.010, 0.040])
def test_velocity_prediction_starts_from_the_last_exposures_joints(latency):
    poses = random_poses(np.random.default_rng(12), 4)
    arm = MovingArm(poses, latency=latency, mode="velocity")
    velocities = JOINTS.MakeDerivative()
    for frame in range(3, 8):
        predicted, _ = arm.at_frame(frame)
        exposure = Timing().TimeOfFrame(frame) - latency - PERIOD
        expected = predict(
            JOINTS.value(exposure).ravel(),
            AT_REST,
            poses,
            last_velocity=velocities.value(exposure).ravel(),
            mode="velocity",
        )
        np.testing.assert_allclose(predicted, expected, atol=1e-12)


@pytest.mark.parametrize("latency", [0.0, 0.001, 0.033, 0.034, 0.067, 0.101, 0.167, 0.233])
@pytest.mark.parametrize("mode", ["rigid", "velocity"])
def test_a_camera_of_30_hz_that_is_no_whole_number_of_control_ticks(mode, latency):
    timing = Timing(vision_period=1 / 30)
    poses = random_poses(np.random.default_rng(20), 4)
    arm = MovingArm(poses, timing=timing, latency=latency, mode=mode)
    velocities = JOINTS.MakeDerivative()
    steps = set()
    for frame in range(15):
        predicted, X_DC = arm.at_frame(frame)
        last, present = (timing.TimeOfFrame(k) - latency for k in (frame - 1, frame))
        if last < -1e-9:
            np.testing.assert_array_equal(predicted.ravel(), vectors(poses))
            continue
        q_C, q_D = (JOINTS.value(max(0.0, time)).ravel() for time in (last, present))
        assert X_DC.IsNearlyEqualTo(camera_pose(q_D).inverse() @ camera_pose(q_C), 1e-12)
        expected = [vector(X_DC @ X) for X in poses]
        if mode == "velocity":
            step = round(present - last, 3)  # what the recognizer's frames are really apart
            steps.add(step)
            qdot_C = velocities.value(max(0.0, last)).ravel()
            expected = predict(
                q_C,
                q_D,
                poses,
                last_velocity=qdot_C,
                mode=mode,
                timing=Timing(vision_period=step),
            )
        np.testing.assert_allclose(predicted, expected, atol=1e-12)
    assert steps == ({0.033, 0.034} if mode == "velocity" else set())


def test_the_vision_period_is_that_of_the_timing():
    timing = Timing(control_period=0.002, vision_period=0.05)
    poses = random_poses(np.random.default_rng(13), 2)
    arm = MovingArm(poses, timing=timing, latency=0.020)
    arm.simulator.AdvanceTo(0.25)
    context = arm.predictor.GetMyContextFromRoot(arm.simulator.get_context())
    X_DC = arm.predictor.GetOutputPort("camera_displacement").Eval(context)
    X_WD, X_WC = (camera_pose(JOINTS.value(time).ravel()) for time in (0.230, 0.180))
    assert X_DC.IsNearlyEqualTo(X_WD.inverse() @ X_WC, 1e-12)


# As a Drake system.


def test_until_two_exposures_are_known_nothing_moved():
    rng = np.random.default_rng(14)
    poses = random_poses(rng, 4)
    for mode in ("rigid", "velocity"):
        predictor = MffPredictor(plant=ARM, num_hypotheses=4, mode=mode)
        context = predictor.CreateDefaultContext()
        predictor.GetInputPort("population").FixValue(context, vectors(poses))
        predictor.GetInputPort("target_velocity").FixValue(context, np.append(V_WM, W_WM))
        state = np.append(random_joints(rng), np.ones(7))
        predictor.GetInputPort("estimated_state").FixValue(context, state)
        predicted = predictor.GetOutputPort("predicted_population").Eval(context)
        np.testing.assert_array_equal(predicted, vectors(poses))
        X_DC = predictor.GetOutputPort("camera_displacement").Eval(context)
        assert X_DC.IsExactlyIdentity()


def test_a_single_hypothesis_is_predicted_like_one_of_many():
    rng = np.random.default_rng(15)
    last, present = random_joints(rng), random_joints(rng)
    poses = random_poses(rng, 5)
    many = predict(last, present, poses)
    for X_CM, expected in zip(poses, many, strict=True):
        (one,) = predict(last, present, [X_CM])
        np.testing.assert_allclose(one, expected, atol=1e-15)


def test_camera_displacement_is_the_whole_motion_whatever_mode_and_gain():
    rng = np.random.default_rng(16)
    last, present = random_joints(rng), random_joints(rng)
    expected = camera_pose(present).inverse() @ camera_pose(last)
    for arguments in ({}, {"mode": "velocity"}, {"gain": 0.5}):
        # It needs neither a population nor a target's velocity.
        predictor = MffPredictor(plant=ARM, **arguments)
        context = predictor.CreateDefaultContext()
        state = predictor.GetInputPort("estimated_state")
        state.FixValue(context, np.append(last, AT_REST))
        sample(predictor, context)
        state.FixValue(context, np.append(present, AT_REST))
        X_DC = predictor.GetOutputPort("camera_displacement").Eval(context)
        assert X_DC.IsNearlyEqualTo(expected, 1e-13)


def test_another_camera_frame():
    rng = np.random.default_rng(17)
    last, present = random_joints(rng), random_joints(rng)
    poses = random_poses(rng, 3)
    left = RigidTransform([-0.150, 0.0, 0.0])
    X_DC = (camera_pose(present) @ left).inverse() @ camera_pose(last) @ left
    predicted = predict(last, present, poses, camera_frame="camera_left")
    np.testing.assert_allclose(predicted, [vector(X_DC @ X) for X in poses], atol=1e-13)


def test_a_forced_update_takes_a_sample_at_any_time():
    rng = np.random.default_rng(18)
    joints = [random_joints(rng) for _ in range(4)]
    predictor = MffPredictor(plant=ARM, num_hypotheses=1, latency=0.033)
    context = predictor.CreateDefaultContext()
    displacement = predictor.GetOutputPort("camera_displacement")
    for time, q in zip((0.0, 0.0123, 0.5, 7.0), joints, strict=True):
        context.SetTime(time)
        state = np.append(q, AT_REST)
        predictor.GetInputPort("estimated_state").FixValue(context, state)
        sample(predictor, context)
    # A frame's delay: the exposures are the last two samples, not counting the present state.
    expected = camera_pose(joints[3]).inverse() @ camera_pose(joints[2])
    assert displacement.Eval(context).IsNearlyEqualTo(expected, 1e-13)


def test_all_of_its_state_is_discrete_numbers():
    for latency, samples in ((0.0, 1), (0.010, 2), (0.033, 2), (0.034, 3)):
        predictor = MffPredictor(plant=ARM, latency=latency)
        context = predictor.CreateDefaultContext()
        assert context.num_abstract_states() == 0
        assert context.num_continuous_states() == 0
        assert context.get_discrete_state_vector().size() == (1 + 14) * samples


def test_simulations_from_cloned_contexts_are_equal_to_the_last_bit():
    poses = random_poses(np.random.default_rng(19), 4)
    arm = MovingArm(poses, latency=0.010)
    arm.at_frame(3)
    clone = arm.simulator.get_context().Clone()
    expected, _ = arm.at_frame(8)
    arm.simulator = Simulator(arm.diagram, clone)
    np.testing.assert_array_equal(arm.at_frame(8)[0], expected)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_hypotheses": 0}, "num_hypotheses must be at least 1, not 0"),
        ({"mode": "exact"}, "mode must be 'rigid' or 'velocity', not 'exact'"),
        ({"gain": np.nan}, "gain must be a finite number, not nan"),
        ({"gain": np.inf}, "gain must be a finite number, not inf"),
        ({"latency": -0.001}, "latency must be .* a whole multiple .* not -0.001 s"),
        ({"latency": 0.0005}, "a whole multiple of the control period of 0.001 s"),
        ({"latency": np.inf}, "latency must be"),
        ({"latency": np.nan}, "latency must be"),
        ({"latency": 0.001, "timing": Timing(control_period=0.003)}, "latency must be"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        MffPredictor(plant=ARM, **arguments)


def test_an_unknown_camera_frame_is_named():
    with pytest.raises(RuntimeError, match="no_such_camera"):
        MffPredictor(plant=ARM, camera_frame="no_such_camera")


def test_the_joints_must_be_connected():
    predictor = MffPredictor(plant=ARM, num_hypotheses=1)
    context = predictor.CreateDefaultContext()
    predictor.GetInputPort("population").FixValue(context, np.zeros(6))
    with pytest.raises(RuntimeError, match="estimated_state"):
        predictor.GetOutputPort("predicted_population").Eval(context)
    with pytest.raises(RuntimeError, match="estimated_state"):
        sample(predictor, context)


def test_turning_about_the_world_is_seen_in_the_camera():
    """By hand: the base turns by a quarter, so what was ahead is then to the camera's right."""
    quarter = NOMINAL_POSITIONS + np.array([np.pi / 2, 0, 0, 0, 0, 0, 0])
    X_WC = camera_pose(NOMINAL_POSITIONS)
    X_WM = RigidTransform(RollPitchYaw(-np.pi / 2, 0, -np.pi / 2), [1.718, 0.0, 0.455])
    (predicted,) = predict(NOMINAL_POSITIONS, quarter, [X_WC.inverse() @ X_WM])
    reach, height = X_WC.translation()[0], X_WC.translation()[2]
    np.testing.assert_allclose(predicted[:3], [1.718, height - 0.455, -reach], atol=1e-12)
    np.testing.assert_allclose(predicted[3:], [0.0, np.sqrt(0.5), 0.0], atol=1e-12)
