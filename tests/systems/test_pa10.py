"""The PA-10 of ``models/pa10.urdf`` is the arm of the published figures, and fits the paper."""

from itertools import pairwise

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Role
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, RevoluteJoint, WeldJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from mffdrake.systems.arms.pa10 import (
    DEFAULT_BASELINE,
    DEFAULT_P_EC,
    JOINT_NAMES,
    NOMINAL_POSITIONS,
    NUM_JOINTS,
    AddCameraFrames,
    AddPa10,
    MakePa10Plant,
)

# joint: parent, child, origin z [m], axis, limit [rad], velocity [rad/s], effort [N m],
# armature [kg m^2]
JOINTS = {
    "S1": ("base_link", "link1", 0.200, "z", 3.08923, 1.0, 158.0, 0.75),
    "S2": ("link1", "link2", 0.115, "y", 1.58825, 1.0, 158.0, 0.75),
    "S3": ("link2", "link3", 0.280, "z", 3.03687, 2.0, 68.0, 0.2125),
    "E1": ("link3", "link4", 0.170, "y", 2.39110, 2.0, 68.0, 0.2125),
    "E2": ("link4", "link5", 0.250, "z", 4.45059, 6.2832, 17.0, 0.00575),
    "W1": ("link5", "link6", 0.250, "y", 2.87979, 6.2832, 17.0, 0.00575),
    "W2": ("link6", "link7", 0.080, "z", 4.45059, 6.2832, 17.0, 0.00575),
}

# link: mass [kg], center of mass z [m], central ixx, iyy, izz [kg m^2]
LINKS = {
    "base_link": (3.04, 0.07500, (0.02704, 0.02704, 0.03382)),
    "link1": (9.78, -0.05182, (0.10091, 0.08505, 0.05518)),
    "link2": (8.41, 0.06325, (0.08388, 0.08072, 0.02044)),
    "link3": (3.51, 0.08056, (0.02505, 0.01697, 0.01553)),
    "link4": (4.31, 0.04609, (0.02989, 0.02927, 0.00531)),
    "link5": (3.45, 0.08530, (0.02899, 0.02256, 0.01102)),
    "link6": (1.46, -0.03000, (0.00670, 0.00648, 0.00106)),
    "link7": (0.24, -0.02900, (0.00012, 0.00012, 0.00013)),
}

# link: (axis, radius, length, center) for cylinders, (side lengths, center) for plates [m].
SHAPES = {
    "base_link": [("z", 0.115, 0.20, (0, 0, 0.10))],
    "link1": [
        ("z", 0.09, 0.16, (0, 0, -0.09)),
        ("z", 0.115, 0.02, (0, 0, 0.01)),
        ((0.12, 0.055, 0.175), (0, 0.105, 0.09)),
        ((0.12, 0.055, 0.175), (0, -0.105, 0.09)),
    ],
    "link2": [("y", 0.07, 0.15, (0, 0, 0)), ("z", 0.055, 0.26, (0, 0, 0.15))],
    "link3": [
        ("z", 0.06, 0.07, (0, 0, 0.035)),
        ((0.12, 0.045, 0.20), (0, 0.073, 0.12)),
        ((0.12, 0.045, 0.20), (0, -0.073, 0.12)),
    ],
    "link4": [("y", 0.05, 0.10, (0, 0, 0)), ("z", 0.038, 0.20, (0, 0, 0.15))],
    "link5": [
        ("z", 0.06, 0.07, (0, 0, 0.035)),
        ((0.07, 0.03, 0.27), (0, 0.065, 0.14)),
        ((0.07, 0.03, 0.27), (0, -0.065, 0.14)),
    ],
    "link6": [
        ("y", 0.035, 0.09, (0, 0, 0)),
        ("z", 0.033, 0.095, (0, 0, -0.0975)),
        ("z", 0.033, 0.05, (0, 0, 0.06)),
    ],
    "link7": [("z", 0.033, 0.05, (0, 0, -0.029))],
    "hand": [],
}

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}

# The paper's Eq. (29): hand z ahead (+x of the world), hand x to the right (-y), hand y down (-z).
X_WE0 = RigidTransform(
    RotationMatrix(np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])), [0.918, 0, 0.455]
)

# The paper's Eq. (30): the hand swings by 15 deg on a circle of 800 mm about the target.
RADIUS = 0.800
AMPLITUDE = np.radians(15.0)


@pytest.fixture(scope="module")
def plant():
    return MakePa10Plant()


@pytest.fixture(scope="module")
def scene():
    """The arm with its shapes: the diagram, its plant and its scene graph."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    AddPa10(plant)
    plant.Finalize()
    return builder.Build(), plant, scene_graph


def hand_pose(plant, q) -> RigidTransform:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return plant.GetFrameByName("hand").CalcPoseInWorld(context)


def hand_jacobian(plant, q) -> np.ndarray:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return plant.CalcJacobianSpatialVelocity(
        context,
        JacobianWrtVariable.kV,
        plant.GetFrameByName("hand"),
        np.zeros(3),
        plant.world_frame(),
        plant.world_frame(),
    )


def desired_hand_pose(theta) -> RigidTransform:
    """Eqs. (30), (31); turned by -theta, which keeps the line of sight on the target."""
    return X_WE0 @ RigidTransform(
        RotationMatrix.MakeYRotation(-theta),
        [RADIUS * np.sin(theta), 0.0, RADIUS * (1.0 - np.cos(theta))],
    )


def pose_difference(X_WA, X_WB) -> np.ndarray:
    """Rotation vector [rad] and translation [m] from A to B, in the world."""
    turn = (X_WB.rotation() @ X_WA.rotation().inverse()).ToAngleAxis()
    return np.r_[turn.angle() * turn.axis(), X_WB.translation() - X_WA.translation()]


def solve_with_s3_at_zero(plant, X_WE, q_guess) -> np.ndarray:
    """Newton's method on the other six joints."""
    q = np.array(q_guess)
    others = [0, 1, 3, 4, 5, 6]
    for _ in range(20):
        error = pose_difference(hand_pose(plant, q), X_WE)
        if np.max(np.abs(error)) < 1e-12:
            return q
        q[others] += np.linalg.solve(hand_jacobian(plant, q)[:, others], error)
    raise AssertionError(f"no inverse-kinematics solution near {np.degrees(q_guess)} deg")


@pytest.fixture(scope="module")
def arc(plant) -> np.ndarray:
    """Joint angles [rad] with S3 at zero along the paper's whole arc, one row a degree."""
    halves = []
    for end in (-AMPLITUDE, AMPLITUDE):
        q, rows = NOMINAL_POSITIONS, []
        for theta in np.linspace(0.0, end, 16):
            q = solve_with_s3_at_zero(plant, desired_hand_pose(theta), q)
            rows.append(q)
        halves.append(rows)
    return np.array([*reversed(halves[0]), *halves[1][1:]])


# The tables.


def test_the_arm_has_seven_joints_in_order_and_a_fixed_base(plant):
    assert tuple(JOINTS) == JOINT_NAMES
    assert len(JOINT_NAMES) == NUM_JOINTS
    arm = plant.GetModelInstanceByName("pa10")
    assert plant.num_positions() == plant.num_velocities() == plant.num_actuators() == NUM_JOINTS
    for index, name in enumerate(JOINT_NAMES):
        joint = plant.GetJointByName(name, arm)
        actuator = plant.GetJointActuatorByName(name, arm)
        assert joint.position_start() == joint.velocity_start() == index
        assert actuator.input_start() == index
        assert actuator.joint().name() == name
    bodies = [plant.get_body(index).name() for index in plant.GetBodyIndices(arm)]
    assert bodies == [*LINKS, "hand"]


@pytest.mark.parametrize("name", JOINT_NAMES)
def test_joint(plant, name):
    parent, child, origin_z, axis, limit, velocity, effort, armature = JOINTS[name]
    joint = plant.GetJointByName(name)
    assert isinstance(joint, RevoluteJoint)
    assert (joint.parent_body().name(), joint.child_body().name()) == (parent, child)
    X_PJ = joint.frame_on_parent().GetFixedPoseInBodyFrame()
    assert X_PJ.IsNearlyEqualTo(RigidTransform([0.0, 0.0, origin_z]), 1e-12)
    X_CJ = joint.frame_on_child().GetFixedPoseInBodyFrame()
    assert X_CJ.IsNearlyEqualTo(RigidTransform(), 1e-12)
    np.testing.assert_array_equal(joint.revolute_axis(), AXES[axis])
    assert (joint.position_lower_limit(), joint.position_upper_limit()) == (-limit, limit)
    assert (joint.velocity_lower_limit(), joint.velocity_upper_limit()) == (-velocity, velocity)
    assert joint.default_damping() == 0.0
    actuator = plant.GetJointActuatorByName(name)
    assert actuator.effort_limit() == effort
    assert actuator.default_gear_ratio() == 50.0
    assert actuator.default_reflected_inertia() == pytest.approx(armature, rel=1e-9)


@pytest.mark.parametrize("name", LINKS)
def test_link(plant, name):
    mass, com_z, central_moments = LINKS[name]
    body = plant.GetBodyByName(name)
    assert body.default_mass() == mass
    inertia = body.default_spatial_inertia()
    np.testing.assert_allclose(inertia.get_com(), [0.0, 0.0, com_z], atol=1e-12)
    central = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    np.testing.assert_allclose(central, np.diag(central_moments), atol=1e-12)


def test_the_hand_is_a_massless_frame_180_mm_ahead_of_link7(plant):
    mount = plant.GetJointByName("hand_mount")
    assert isinstance(mount, WeldJoint)
    assert mount.parent_body().name() == "link7"
    hand = mount.child_body()
    assert hand.name() == "hand"
    assert hand.default_mass() == 0.0
    X_7E = RigidTransform(RollPitchYaw(0.0, 0.0, -np.pi / 2), [0.0, 0.0, 0.180])
    context = plant.CreateDefaultContext()
    actual = hand.body_frame().CalcPose(context, plant.GetFrameByName("link7"))
    assert actual.IsNearlyEqualTo(X_7E, 1e-12)


def test_the_armature_enters_the_mass_matrix(plant):
    # The diagonal from which the PD gains of the paper's Fig. 6 were derived [kg m^2].
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, NOMINAL_POSITIONS)
    diagonal = np.diag(plant.CalcMassMatrix(context))
    np.testing.assert_allclose(diagonal[:4], [2.95, 4.09, 1.09, 1.07], atol=0.005)
    assert np.all(diagonal >= [armature for *_, armature in JOINTS.values()])


# The shapes.


@pytest.mark.parametrize("role", [Role.kIllustration, Role.kPerception, Role.kProximity])
@pytest.mark.parametrize("name", SHAPES)
def test_shapes(scene, name, role):
    _, plant, scene_graph = scene
    inspector = scene_graph.model_inspector()
    frame_id = plant.GetBodyFrameIdOrThrow(plant.GetBodyByName(name).index())
    ids = inspector.GetGeometries(frame_id, role)
    assert len(ids) == len(SHAPES[name])
    for expected in SHAPES[name]:
        assert sum(is_shape(inspector, geometry_id, expected) for geometry_id in ids) == 1


def is_shape(inspector, geometry_id, expected) -> bool:
    """Whether a geometry is the cylinder or plate of a row of ``SHAPES``."""
    shape = inspector.GetShape(geometry_id)
    X_LG = inspector.GetPoseInFrame(geometry_id)
    if not np.allclose(X_LG.translation(), expected[-1], atol=1e-12):
        return False
    if len(expected) == 2:
        return (
            isinstance(shape, Box)
            and np.allclose(shape.size(), expected[0])
            and X_LG.rotation().IsNearlyIdentity(1e-12)
        )
    axis, radius, length, _ = expected
    along = X_LG.rotation().matrix()[:, 2] @ AXES[axis]
    return (
        isinstance(shape, Cylinder)
        and np.isclose(shape.radius(), radius)
        and np.isclose(shape.length(), length)
        and np.isclose(abs(along), 1.0)
    )


def test_every_color_of_the_arm_is_a_grey(scene):
    # The recognizer takes pixels of a saturation above 0.5 for the target's: stay far below.
    inspector = scene[2].model_inspector()
    colors = [
        inspector.GetPerceptionProperties(geometry_id).GetProperty("phong", "diffuse")
        for geometry_id in inspector.GetAllGeometryIds(Role.kPerception)
    ]
    assert len(colors) == sum(map(len, SHAPES.values()))
    for color in colors:
        rgb = np.array([color.r(), color.g(), color.b()])
        assert (rgb.max() - rgb.min()) / rgb.max() < 0.1
        assert rgb.min() > 0.3  # not so dark that noise has a color
        assert color.a() == 1.0


def contacts(scene, q) -> set[frozenset[str]]:
    """The pairs of links that touch each other."""
    diagram, plant, scene_graph = scene
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyContextFromRoot(context), q)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    return {
        frozenset(
            plant.GetBodyFromFrameId(inspector.GetFrameId(geometry_id)).name()
            for geometry_id in (pair.id_A, pair.id_B)
        )
        for pair in query.ComputePointPairPenetration()
    }


def test_the_arm_does_not_touch_itself_along_the_arc(scene, arc):
    assert contacts(scene, np.zeros(NUM_JOINTS)) == set()
    for q in arc:
        assert contacts(scene, q) == set(), np.degrees(q)


def test_links_far_apart_still_collide(scene):
    # Folded back, the forearm runs into the base: the filters do not hide that.
    folded = contacts(scene, np.radians([0.0, 90.0, 0.0, 136.0, 0.0, 0.0, 0.0]))
    assert frozenset({"base_link", "link5"}) in folded


def test_neighbors_never_touch_wherever_the_joints_are():
    # Drake filters neighbors too; where a user switches that off, the file's own groups do.
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    plant.set_adjacent_bodies_collision_filters(False)
    AddPa10(plant)
    plant.Finalize()
    scene = (builder.Build(), plant, scene_graph)
    neighbors = {frozenset(pair) for pair in pairwise(LINKS)}
    random = np.random.default_rng(1)
    for _ in range(200):
        q = random.uniform(plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())
        assert not contacts(scene, q) & neighbors


def test_no_part_of_the_arm_is_ahead_of_the_cameras_along_the_arc(scene, arc):
    _, plant, scene_graph = scene
    inspector = scene_graph.model_inspector()
    context = plant.CreateDefaultContext()
    for q in arc:
        plant.SetPositions(context, q)
        X_EW = plant.GetFrameByName("hand").CalcPoseInWorld(context).inverse()
        for geometry_id in inspector.GetAllGeometryIds(Role.kPerception):
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry_id))
            X_WL = plant.EvalBodyPoseInWorld(context, body)
            p_EG = (X_EW @ X_WL @ inspector.GetPoseInFrame(geometry_id)).translation()
            assert p_EG[2] + bounding_radius(inspector.GetShape(geometry_id)) < 0.0


def bounding_radius(shape) -> float:
    if isinstance(shape, Box):
        return 0.5 * float(np.linalg.norm(shape.size()))
    return float(np.hypot(shape.radius(), 0.5 * shape.length()))


# The paper's poses.


def test_the_first_hand_pose_is_reached_at_round_joint_angles(plant):
    np.testing.assert_allclose(np.degrees(NOMINAL_POSITIONS), [0, 30, 0, 90, 0, -30, 0], atol=1e-12)
    X_WE = hand_pose(plant, NOMINAL_POSITIONS)
    np.testing.assert_allclose(1000 * X_WE.translation(), [918.01, 0.0, 454.71], atol=0.005)
    np.testing.assert_allclose(X_WE.rotation().matrix(), X_WE0.rotation().matrix(), atol=1e-12)


@pytest.mark.parametrize(
    ("theta_deg", "q_deg"),
    [
        (0.0, (0.0, 29.98, 0.0, 89.99, 0.0, -29.97, 0.0)),
        (15.0, (-21.57, 40.11, 0.0, 73.98, -61.17, -42.85, 53.10)),
        (-15.0, (21.57, 40.11, 0.0, 73.98, 61.17, -42.85, -53.10)),
    ],
)
def test_known_inverse_kinematics(plant, theta_deg, q_deg):
    # Angles rounded to 0.01 deg leave up to 0.2 mm and 0.02 deg.
    X_WEd = desired_hand_pose(np.radians(theta_deg))
    error = pose_difference(hand_pose(plant, np.radians(q_deg)), X_WEd)
    assert np.linalg.norm(error[:3]) < np.radians(0.02)
    assert np.linalg.norm(error[3:]) < 0.2e-3
    q = solve_with_s3_at_zero(plant, X_WEd, np.radians(q_deg))
    np.testing.assert_allclose(np.degrees(q), q_deg, atol=0.0051)


def test_the_elbow_is_up_at_the_first_pose(plant):
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, NOMINAL_POSITIONS)
    heights = {
        name: plant.GetFrameByName(name).CalcPoseInWorld(context).translation()[2]
        for name in ("link2", "link4", "link6")
    }
    assert heights["link4"] > max(heights["link2"], heights["link6"])


def test_the_whole_arc_is_reached_47_deg_clear_of_every_limit(plant, arc):
    for theta, q in zip(np.linspace(-AMPLITUDE, AMPLITUDE, len(arc)), arc, strict=True):
        error = pose_difference(hand_pose(plant, q), desired_hand_pose(theta))
        assert np.max(np.abs(error)) < 1e-9
    limits = plant.GetPositionUpperLimits()
    np.testing.assert_array_equal(plant.GetPositionLowerLimits(), -limits)
    assert np.degrees(np.min(limits - np.abs(arc))) >= 47.0


def test_the_arc_is_clear_of_singularities(plant, arc):
    jacobians = [hand_jacobian(plant, q) for q in arc]
    manipulability = np.sqrt([np.linalg.det(J @ J.T) for J in jacobians])
    # 0.107 and 0.151 are rounded to three decimals. Measured, S3 at zero: 0.1069 to 0.1436.
    assert np.min(manipulability) == pytest.approx(0.107, abs=0.0005)
    assert np.max(manipulability) < 0.1515


def test_gravity_torques_along_the_arc(plant, arc):
    context = plant.CreateDefaultContext()
    holding = []
    for q in arc:
        plant.SetPositions(context, q)
        holding.append(-plant.CalcGravityGeneralizedForces(context))
    # Holding torques [N m]; both joints hold the arm up against its fall ahead. E1 reaches 19.50
    # with S3 at zero (19.38 with the least joint motion instead).
    s2, e1 = -np.array(holding)[:, 1], -np.array(holding)[:, 3]
    assert 48.0 <= np.min(s2) <= np.max(s2) <= 58.0
    assert 18.0 <= np.min(e1) <= np.max(e1) <= 19.51
    efforts = [effort for *_, effort, _ in JOINTS.values()]
    assert np.all(np.abs(holding) < 0.4 * np.array(efforts))


# The functions.


def test_the_arm_stands_where_it_is_told(plant):
    X_WB = RigidTransform(RollPitchYaw(0.0, 0.0, 0.5), [1.0, -2.0, 0.3])
    moved = MultibodyPlant(0.0)
    arm = AddPa10(moved, X_WB=X_WB)
    moved.Finalize()
    assert moved.GetModelInstanceName(arm) == "pa10"
    expected = X_WB @ hand_pose(plant, NOMINAL_POSITIONS)
    assert hand_pose(moved, NOMINAL_POSITIONS).IsNearlyEqualTo(expected, 1e-12)


def test_an_arm_is_refused_where_it_cannot_be_added():
    plant = MultibodyPlant(0.0)
    AddPa10(plant)
    with pytest.raises(RuntimeError, match="already holds a model named 'pa10'"):
        AddPa10(plant)
    plant.Finalize()
    with pytest.raises(RuntimeError, match="finalized already"):
        AddPa10(plant)


@pytest.mark.parametrize(
    ("options", "p_EC", "baseline"),
    [
        ({}, (0.0, -0.155, 0.0), 0.150),
        ({"p_EC": (0.01, -0.02, 0.03), "baseline": 0.2}, (0.01, -0.02, 0.03), 0.2),
    ],
)
def test_camera_frames(options, p_EC, baseline):
    plant = MultibodyPlant(0.0)
    AddPa10(plant)
    assert (DEFAULT_P_EC, DEFAULT_BASELINE) == ((0.0, -0.155, 0.0), 0.150)
    frame_C, frame_L = AddCameraFrames(plant, **options)
    plant.Finalize()
    assert plant.GetFrameByName("camera_right").index() == frame_C.index()
    assert plant.GetFrameByName("camera_left").index() == frame_L.index()
    hand = plant.GetBodyByName("hand")
    assert frame_C.body().index() == frame_L.body().index() == hand.index()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, NOMINAL_POSITIONS)
    X_EC = frame_C.CalcPose(context, hand.body_frame())
    assert X_EC.IsNearlyEqualTo(RigidTransform(p_EC), 1e-12)
    X_CL = frame_L.CalcPose(context, frame_C)
    assert X_CL.IsNearlyEqualTo(RigidTransform([-baseline, 0.0, 0.0]), 1e-12)


def test_the_cameras_look_ahead_side_by_side_155_mm_above_the_hand(plant):
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, NOMINAL_POSITIONS)
    p_WE, p_WC, p_WL = (
        plant.GetFrameByName(name).CalcPoseInWorld(context).translation()
        for name in ("hand", "camera_right", "camera_left")
    )
    np.testing.assert_allclose(p_WC - p_WE, [0.0, 0.0, 0.155], atol=1e-12)
    np.testing.assert_allclose(p_WL - p_WC, [0.0, 0.150, 0.0], atol=1e-12)  # left is world +y


def test_the_target_of_the_paper_stays_at_its_numbers_in_the_right_camera(plant, arc):
    # At (1.718, 0, 0.455) m in the world, at (0, 155, 800) mm in the camera, all along the arc.
    context = plant.CreateDefaultContext()
    for q in arc:
        plant.SetPositions(context, q)
        X_CW = plant.GetFrameByName("camera_right").CalcPoseInWorld(context).inverse()
        p_CM = X_CW.multiply(np.array([1.718, 0.0, 0.455]))
        np.testing.assert_allclose(1000 * p_CM, [0.0, 155.0, 800.0], atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"p_EC": (0.0, 0.1)}, "p_EC must be three finite numbers"),
        ({"p_EC": (0.0, np.nan, 0.1)}, "p_EC must be three finite numbers"),
        ({"baseline": 0.0}, "baseline must be a positive distance"),
        ({"baseline": -0.15}, "baseline must be a positive distance"),
        ({"baseline": np.inf}, "baseline must be a positive distance"),
    ],
)
def test_wrong_camera_parameters_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        MakePa10Plant(**options)


def test_camera_frames_are_refused_where_they_cannot_be_added(plant):
    with pytest.raises(RuntimeError, match="finalized already"):
        AddCameraFrames(plant)
    armless = MultibodyPlant(0.0)
    with pytest.raises(RuntimeError, match="Call AddPa10 first"):
        AddCameraFrames(armless)
    AddPa10(armless)
    AddCameraFrames(armless)
    with pytest.raises(RuntimeError, match="camera frames already"):
        AddCameraFrames(armless)


@pytest.mark.parametrize("time_step", [0.0, 0.001])
def test_the_controller_plant_is_the_finalized_arm_with_camera_frames(time_step):
    plant = MakePa10Plant(time_step, p_EC=(0.0, -0.1, 0.0), baseline=0.12)
    assert plant.is_finalized()
    assert plant.time_step() == time_step
    np.testing.assert_array_equal(plant.gravity_field().gravity_vector(), [0.0, 0.0, -9.81])
    assert plant.geometry_source_is_registered() is False
    context = plant.CreateDefaultContext()
    hand = plant.GetFrameByName("hand")
    X_EL = plant.GetFrameByName("camera_left").CalcPose(context, hand)
    np.testing.assert_allclose(X_EL.translation(), [-0.12, -0.1, 0.0], atol=1e-12)


@pytest.mark.parametrize("time_step", [-0.001, np.nan])
def test_a_wrong_time_step_is_refused(time_step):
    # Drake itself would end the process, not raise.
    with pytest.raises(ValueError, match="time_step"):
        MakePa10Plant(time_step)


@pytest.mark.parametrize("time_step", [0.0, 0.001])
def test_the_arm_simulates_and_gravity_compensation_holds_it(time_step):
    # A body without mass must upset neither kind of plant.
    plant = MakePa10Plant(time_step)
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    plant.SetPositions(context, NOMINAL_POSITIONS)
    holding = -plant.CalcGravityGeneralizedForces(context)
    plant.get_actuation_input_port().FixValue(context, holding)
    simulator.AdvanceTo(0.1)
    np.testing.assert_allclose(plant.GetPositions(context), NOMINAL_POSITIONS, atol=1e-9)
    plant.get_actuation_input_port().FixValue(context, np.zeros(NUM_JOINTS))
    simulator.AdvanceTo(0.2)
    assert plant.GetVelocities(context)[1] > 0.5  # let go, the shoulder falls ahead


def test_the_nominal_positions_cannot_be_changed_by_accident():
    with pytest.raises(ValueError, match="read-only"):
        NOMINAL_POSITIONS[0] = 1.0
