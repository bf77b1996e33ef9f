"""A six-joint and a seven-joint arm of ``scenarios/arms`` lead the cameras as the PA-10 does."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_data
from pydrake.geometry import Cylinder, Role
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import DiagramBuilder

from mffdrake.recognition.parameters import read_parameters
from mffdrake.systems.arms.arm import ArmModel
from mffdrake.systems.arms.arm_joints import MovingJoints
from mffdrake.systems.arms.hand_path import HandPath, SolveHandPath, UnreachablePathError
from mffdrake.systems.arms.inverse_kinematics import ArmKinematics
from mffdrake.systems.arms.pa10 import MakePa10Plant
from mffdrake.systems.cameras.camera_frames import AddCameraFrames
from mffdrake.systems.control.pd_gains import NaturalFrequency

ROOT = Path(__file__).parents[2]
NAMES = ("ur5e", "iiwa14")
PATH = HandPath(omega=0.314)


class Case:
    """An arm of a scenario, its plant without geometry, and what it takes to follow the path."""

    def __init__(self, name: str) -> None:
        text = (ROOT / "scenarios" / f"{name}.yaml").read_text()
        self.scenario = yaml_load_data(text, private=True)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(ROOT)  # The scenario's file is relative to the checkout.
            self.arm = read_parameters(ArmModel, self.scenario["arm"], "arm")
            self.plant = self.arm.MakePlant()
            self.plant.Finalize()
            self.posture = {
                "nominal": self.arm.nominal_positions,
                "held_joints": self.arm.held_joints,
            }
        self.kinematics = ArmKinematics(self.plant, **self.posture)
        self.trajectory = self.solve(PATH)

    def solve(self, path: HandPath, **options):
        return SolveHandPath(self.plant, path, **{"duration": 45.0, **self.posture, **options})

    def hand(self, q) -> RigidTransform:
        context = self.plant.CreateDefaultContext()
        self.plant.SetPositions(context, q)
        return self.plant.GetFrameByName("hand").CalcPoseInWorld(context)

    def q(self, t: float) -> np.ndarray:
        return self.trajectory.value(t).ravel()


@pytest.fixture(scope="module")
def cases():
    return {name: Case(name) for name in NAMES}


@pytest.fixture(params=NAMES)
def case(request, cases):
    return cases[request.param]


@pytest.fixture
def iiwa(cases):
    return cases["iiwa14"]


def screw(axis: str, angle: float, *p: float) -> RigidTransform:
    return RigidTransform(getattr(RotationMatrix, f"Make{axis.upper()}Rotation")(angle), p)


# The models.


def test_the_ur5e_has_the_published_denavit_hartenberg_chain(cases):
    case = cases["ur5e"]
    d = [0.1625, 0, 0, 0.1333, 0.0997, 0.0996]
    a = [0, -0.425, -0.3922, 0, 0, 0]
    alpha = [math.pi / 2, 0, 0, math.pi / 2, -math.pi / 2, 0]
    for q in np.random.default_rng(seed=2).uniform(-3.0, 3.0, (5, 6)):
        X_WE = RigidTransform(RotationMatrix.MakeZRotation(math.pi), [0.3, -0.1333, 0.0])
        for i in range(6):
            X_WE = X_WE @ screw("z", q[i], 0, 0, d[i]) @ screw("x", alpha[i], a[i], 0, 0)
        assert case.hand(q).IsNearlyEqualTo(X_WE, 1e-12)


def test_the_iiwa_has_the_published_lengths_between_its_joints(iiwa):
    for q in np.random.default_rng(seed=3).uniform(-2.0, 2.0, (5, 7)):
        X_WE = (
            screw("z", q[0], 0.3, 0, 0.360)
            @ screw("y", q[1], 0, 0, 0)
            @ screw("z", q[2], 0, 0, 0.420)
            @ screw("y", -q[3], 0, 0, 0)
            @ screw("z", q[4], 0, 0, 0.400)
            @ screw("y", q[5], 0, 0, 0)
            @ screw("z", q[6], 0, 0, 0.126)
            @ screw("z", -math.pi / 2, 0, 0, 0)
        )
        assert iiwa.hand(q).IsNearlyEqualTo(X_WE, 1e-12)


@pytest.mark.parametrize(("name", "mass"), [("ur5e", 21.7), ("iiwa14", 30.6)])
def test_the_arms_weigh_what_they_should(name, mass, cases):
    """With 4.0 kg for the UR5e's base; the data sheets say 20.6 kg and 29.9 kg in all."""
    plant = cases[name].plant
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(mass, abs=0.05)


def test_no_color_has_a_hue(case):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
        case.arm.AddToPlant(plant)
    inspector = scene_graph.model_inspector()
    shapes = inspector.GetAllGeometryIds(Role.kIllustration)
    assert len(shapes) > 6
    for shape in shapes:
        color = inspector.GetIllustrationProperties(shape).GetProperty("phong", "diffuse")
        assert color.r() == color.g() == color.b()


# The path.


def test_the_nominal_posture_has_the_hand_near_the_paths_first_pose(case):
    X_EE0 = case.hand(case.posture["nominal"]).inverse() @ HandPath().X_WE0
    assert np.linalg.norm(X_EE0.translation()) < 0.02
    assert X_EE0.rotation().ToAngleAxis().angle() < np.radians(3.0)


@pytest.mark.parametrize("omega", [0.314, 1.2])
def test_the_hand_is_on_the_path_between_the_knots_too(omega, case):
    path = HandPath(omega=omega)
    trajectory = case.solve(path)
    velocity = trajectory.derivative(1)
    context = case.plant.CreateDefaultContext()
    hand = case.plant.GetFrameByName("hand")
    for t in np.random.default_rng(seed=1).uniform(0.0, 45.0, 100):
        case.plant.SetPositions(context, trajectory.value(t))
        case.plant.SetVelocities(context, velocity.value(t))
        X_EdE = path.CalcHandPose(t).inverse() @ hand.CalcPoseInWorld(context)
        assert np.linalg.norm(X_EdE.translation()) < 1e-6
        assert X_EdE.rotation().ToAngleAxis().angle() < 1e-6
        V_WE = hand.CalcSpatialVelocityInWorld(context).get_coeffs()
        np.testing.assert_allclose(V_WE, path.CalcHandVelocity(t).get_coeffs(), atol=1e-5)


def test_the_joints_stay_well_within_their_limits(case):
    trajectory = case.solve(HandPath(omega=1.2))
    times = np.linspace(0.0, 6.0, 61)
    joints = MovingJoints(case.plant)
    for joint, q, v in zip(
        joints,
        trajectory.vector_values(times),
        trajectory.derivative(1).vector_values(times),
        strict=True,
    ):
        margin = np.radians(14.0)
        assert joint.position_lower_limits()[0] + margin < q.min()
        assert q.max() < joint.position_upper_limits()[0] - margin
        assert np.abs(v).max() < 0.7 * joint.velocity_upper_limits()[0]


def test_the_hand_moves_a_long_way_from_singular_poses(case):
    context = case.plant.CreateDefaultContext()
    world, hand = case.plant.world_frame(), case.plant.GetFrameByName("hand")
    for t in np.linspace(0.0, 20.0, 21):
        case.plant.SetPositions(context, case.q(t))
        J = case.plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, hand, np.zeros(3), world, world
        )
        assert np.linalg.svd(J)[1][-1] > 0.15


def test_no_part_of_the_arm_is_in_the_cameras_view(case):
    """None is within 60 deg of a line of sight; so no link hides the target."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        instance = case.arm.AddToPlant(plant)
    AddCameraFrames(plant, model_instance=instance, hand_frame=case.arm.hand_frame)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    context = plant.CreateDefaultContext()
    for t in np.linspace(0.0, 20.0, 11):
        plant.SetPositions(context, case.q(t))
        for name in ("camera_right", "camera_left"):
            X_CW = plant.GetFrameByName(name).CalcPoseInWorld(context).inverse()
            for shape in inspector.GetAllGeometryIds(Role.kIllustration):
                cylinder = inspector.GetShape(shape)
                assert isinstance(cylinder, Cylinder)
                body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
                X_CG = X_CW @ plant.EvalBodyPoseInWorld(context, body)
                X_CG = X_CG @ inspector.GetPoseInFrame(shape)
                r, h = cylinder.radius(), 0.5 * cylinder.length()
                corners = [[x, y, z] for x in (-r, 0, r) for y in (-r, 0, r) for z in (-h, 0, h)]
                for x, y, z in (X_CG @ np.array(corner) for corner in corners):
                    assert math.atan2(math.hypot(x, y), z) > np.radians(60.0)


# The seventh joint.


def test_the_joints_repeat_with_every_swing_and_depend_on_the_pose_alone(iiwa):
    period = 2.0 * math.pi / PATH.omega
    for t in np.linspace(0.5, 20.0, 14):
        np.testing.assert_allclose(iiwa.q(t + period), iiwa.q(t), atol=1e-7)
        back = (0.5 * period - t) % period  # The hand passes the same pose on its way back.
        np.testing.assert_allclose(iiwa.q(back), iiwa.q(t), atol=1e-7)


def test_no_posture_with_the_hand_there_is_nearer_to_nominal(iiwa):
    nominal = iiwa.posture["nominal"]
    six = ArmKinematics(iiwa.plant, nominal=nominal, held_joints=["A3"])
    for t in (0.0, 2.5, 5.0, 13.0):
        q, X_WE = iiwa.q(t), PATH.CalcHandPose(t)
        distance = np.linalg.norm(q - nominal)
        for aside in (-0.3, -0.01, 0.01, 0.3):  # The elbow swings about the line to the wrist.
            other = six.SolvePose(X_WE, q + aside * np.eye(7)[2])
            assert np.max(np.abs(six.CalcPoseError(other, X_WE))) < 1e-9
            assert np.linalg.norm(other - nominal) > distance


def test_from_the_nominal_posture_the_arms_own_motion_is_left_out(iiwa):
    """The conditions of the minimum: ``q - nominal`` has no part that leaves the hand at rest."""
    context = iiwa.plant.CreateDefaultContext()
    world, hand = iiwa.plant.world_frame(), iiwa.plant.GetFrameByName("hand")
    for t in np.linspace(0.0, 20.0, 9):
        iiwa.plant.SetPositions(context, iiwa.q(t))
        J = iiwa.plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, hand, np.zeros(3), world, world
        )
        aside = iiwa.q(t) - iiwa.posture["nominal"]
        multipliers, *_ = np.linalg.lstsq(J.T, aside, rcond=None)
        np.testing.assert_allclose(J.T @ multipliers, aside, atol=1e-6)
        assert abs(iiwa.kinematics.CalcNominalError(iiwa.q(t))[0]) < 1e-6


def test_the_rates_are_the_derivatives_of_the_joint_angles(iiwa):
    h = 1e-4
    for t in (0.3, 4.0, 11.0):
        poses = [PATH.CalcHandPose(t + dt) for dt in (-h, 0.0, h)]
        before, q, after = (iiwa.kinematics.SolvePose(X_WE, iiwa.q(t)) for X_WE in poses)
        v = iiwa.kinematics.SolveVelocity(q, PATH.CalcHandVelocity(t))
        np.testing.assert_allclose(v, (after - before) / (2.0 * h), atol=1e-7)


def test_a_held_joint_leaves_six_and_stays(iiwa):
    trajectory = iiwa.solve(PATH, held_joints=["A3"])
    q = trajectory.vector_values(np.linspace(0.0, 20.0, 21))
    np.testing.assert_allclose(q[2], 0.0, atol=1e-12)
    assert np.all(q[3] < 0.0)  # The elbow stays bent as in the nominal posture.


def test_the_pa10_need_not_hold_s3():
    plant = MakePa10Plant()
    trajectory = SolveHandPath(plant, PATH, duration=20.0, held_joints=[])
    kinematics = ArmKinematics(plant, held_joints=[])
    for t in (0.0, 3.0, 5.0, 17.0):
        q = trajectory.value(t).ravel()
        error = kinematics.CalcPoseError(q, PATH.CalcHandPose(t))
        np.testing.assert_allclose(error, 0.0, atol=1e-6)
    assert abs(trajectory.value(5.0)[2, 0]) > np.radians(5.0)


# Other first poses and what cannot be.


def test_a_first_pose_to_the_side_is_reached_with_the_elbow_bent_alike(case):
    X_WE0 = RigidTransform(RotationMatrix.MakeZRotation(np.radians(35.0))) @ HandPath().X_WE0
    path = HandPath(X_WE0=X_WE0, distance=0.6)
    trajectory = case.solve(path, duration=5.0)
    error = case.kinematics.CalcPoseError(trajectory.value(4.0).ravel(), path.CalcHandPose(4.0))
    np.testing.assert_allclose(error, 0.0, atol=1e-6)
    elbow = {"ur5e": 2, "iiwa14": 3}[case.arm.model]
    assert np.sign(trajectory.value(4.0)[elbow, 0]) == np.sign(case.posture["nominal"][elbow])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"X_WE0": RigidTransform(HandPath().X_WE0.rotation(), [1.6, 0.0, 0.455])},
            r"hand path not reachable at t = 0\.00 s: no inverse-kinematics solution, as the arm "
            r"is almost stretched; .*move X_WE0\.",
        ),
        (
            {"omega": 8.0},
            r"hand path too fast at t = [\d.]+ s: joint (wrist_2|A\d) would pass its velocity "
            r"limit [\d.]+ rad/s \(it needs [\d.]+ rad/s\)\. Reduce the path's omega .*\.",
        ),
    ],
)
def test_the_error_says_why_a_path_is_not_reachable(values, message, case):
    with pytest.raises(UnreachablePathError, match=f"^{message}$"):
        case.solve(HandPath(**values))


# Control.


def test_the_scenarios_gains_outweigh_the_hold(case):
    gains = dict(case.scenario["controller"]["gains"])
    assert gains.pop("_tag") == "!NaturalFrequency"
    frequency = read_parameters(NaturalFrequency, gains)
    made = frequency.MakeGains(case.plant, positions=case.q(0.0))
    assert np.all(np.array(made.kd) > 0.001 * np.array(made.kp))
    M = np.array(made.kp) / (2.0 * np.pi * frequency.frequency_hz) ** 2
    assert M.min() >= 0.0099 * M.max()
