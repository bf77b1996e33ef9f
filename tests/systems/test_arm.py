"""Any arm of six or more joints, told by Drake's directives; what is none is refused in a line."""

import re

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_data
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from mffdrake.recognition.parameters import ParameterError, plain, read_parameters
from mffdrake.systems.arms.arm import ArmModel
from mffdrake.systems.arms.arm_joints import ArmError, JointNames, MovingJoints
from mffdrake.systems.arms.models import FindModelsPath
from mffdrake.systems.arms.pa10 import AddPa10, MakePa10Plant
from mffdrake.systems.cameras.camera_frames import AddCameraFrame, AddCameraFrames

PA10 = {"add_model": {"name": "pa10", "file": "package://mffdrake/pa10.urdf"}}
WELD = {"add_weld": {"parent": "world", "child": "pa10::base_link"}}


def write_chain(path, *, kinds, name="chain", actuated=None):
    """An arm whose joints J1, J2, ... turn about or slide along x, y, z, x, ... in turn."""
    inertia = "".join(f' {i}="{v}"' for i, v in zip(
        ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), (0.1, 0, 0, 0.1, 0, 0.1), strict=True,
    ))  # fmt: skip
    body = f'<inertial><mass value="1"/><inertia{inertia}/></inertial>'
    joints = [f"J{i}" for i in range(1, len(kinds) + 1)]
    links = "".join(f'<link name="L{i}">{body}</link>' for i in range(len(kinds) + 1))
    for i, (joint, kind) in enumerate(zip(joints, kinds, strict=True)):
        axis = " ".join("1" if j == i % 3 else "0" for j in range(3))
        links += (
            f'<joint name="{joint}" type="{kind}"><parent link="L{i}"/><child link="L{i + 1}"/>'
            f'<origin xyz="0 0.1 0.2"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" velocity="2" effort="100"/></joint>'
        )
    links += f'<link name="hand"/><joint name="mount" type="fixed"><parent link="L{len(kinds)}"/>'
    links += '<child link="hand"/></joint>'
    for joint in joints if actuated is None else actuated:
        links += (
            f'<transmission><type>SimpleTransmission</type><joint name="{joint}"/>'
            f'<actuator name="{joint}"/></transmission>'
        )
    path.write_text(f'<robot name="{name}">{links}</robot>')
    return path


def chain(path, **options):
    """An ArmModel of such a chain."""
    kinds = options.get("kinds", ["revolute"] * 6)
    write_chain(path, **{**options, "kinds": kinds})
    return ArmModel(
        directives=[
            {"add_model": {"name": "chain", "file": str(path)}},
            {"add_weld": {"parent": "world", "child": "chain::L0"}},
        ],
        model="chain",
        nominal_deg=[1.0] * len(kinds),
        held_joints=[],
    )


# What makes an arm.


def test_the_default_is_the_pa10():
    plant = ArmModel().MakePlant()
    AddCameraFrames(plant)
    plant.Finalize()
    expected = MakePa10Plant()
    assert JointNames(MovingJoints(plant)) == JointNames(MovingJoints(expected))
    contexts = plant.CreateDefaultContext(), expected.CreateDefaultContext()
    q = ArmModel().nominal_positions
    poses = []
    for model, context in zip((plant, expected), contexts, strict=True):
        model.SetPositions(context, q)
        poses.append(model.GetFrameByName("camera_left").CalcPoseInWorld(context))
    assert poses[0].IsExactlyEqualTo(poses[1])
    np.testing.assert_allclose(np.degrees(q), [0, 30, 0, 90, 0, -30, 0], rtol=1e-15)


@pytest.mark.parametrize("tag", ["", 3, "Rpy", "!", None])
def test_a_tag_that_yaml_cannot_have_is_refused(tag):
    rotation = {"_tag": tag, "deg": [0.0, 0.0, 90.0]}
    with pytest.raises(ValueError, match="directives: a tag must be a text such as !Rpy, not"):
        ArmModel(directives=({"add_weld": {"X_PC": {"rotation": [rotation]}}},))


def test_yaml_with_drakes_tags_places_the_arm():
    text = """
        directives:
        - add_model: {name: lifted, file: package://mffdrake/pa10.urdf}
        - add_weld:
            parent: world
            child: lifted::base_link
            X_PC: {translation: [0.1, 0.2, 0.3], rotation: !Rpy {deg: [0, 0, 90]}}
        - add_frame: {name: eye, X_PF: {base_frame: lifted::hand, translation: [0, 0, 0.5]}}
        model: lifted
        hand_frame: eye
    """
    arm = read_parameters(ArmModel, yaml_load_data(text, private=True))
    assert read_parameters(ArmModel, plain(arm)) == arm
    plant = arm.MakePlant()
    plant.Finalize()
    context = plant.CreateDefaultContext()
    X_WE = plant.GetFrameByName("eye").CalcPoseInWorld(context)
    still = MakePa10Plant()
    X_BE = still.GetFrameByName("hand").CalcPoseInWorld(still.CreateDefaultContext())
    X_WB = RigidTransform(RotationMatrix.MakeZRotation(np.pi / 2), [0.1, 0.2, 0.3])
    assert X_WE.IsNearlyEqualTo(X_WB @ X_BE @ RigidTransform([0, 0, 0.5]), 1e-12)


def test_a_file_without_a_scheme_is_looked_for_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "arms").mkdir()
    (tmp_path / "arms" / "my arm.urdf").write_bytes((FindModelsPath() / "pa10.urdf").read_bytes())
    monkeypatch.chdir(tmp_path)
    directives = [{"add_model": {"name": "pa10", "file": "arms/my arm.urdf"}}, WELD]
    assert ArmModel(directives=directives).MakePlant().HasJointNamed("E1")
    (tmp_path / "arm.dmd.yaml").write_text(
        "directives:\n- add_model: {name: pa10, file: package://mffdrake/pa10.urdf}\n"
    )
    directives = [{"add_directives": {"file": "arm.dmd.yaml"}}, WELD]
    assert ArmModel(directives=directives).MakePlant().HasJointNamed("E1")


def test_the_arm_joins_what_the_plant_holds_and_the_table_it_stands_on_is_welded():
    table = [
        {"add_model": {"name": "table", "file": "package://mffdrake/target_box.sdf"}},
        {"add_weld": {"parent": "world", "child": "table::target_box"}},
    ]
    plant = MultibodyPlant(0.001)
    AddPa10(plant)
    other = [{"add_model": {**PA10["add_model"], "name": "other"}}]
    other.append({"add_weld": {"parent": "world", "child": "other::base_link"}})
    instance = ArmModel(directives=[*table, *other], model="other").AddToPlant(plant)
    plant.Finalize()
    assert plant.GetModelInstanceName(instance) == "other"
    assert plant.num_positions() == 14
    joints = MovingJoints(plant, instance)
    assert [joint.position_start() for joint in joints] == list(range(7, 14))


def test_joints_may_slide_then_nominal_is_in_meters(tmp_path):
    kinds = ["prismatic", *["revolute"] * 6]
    arm = chain(tmp_path / "rail.urdf", kinds=kinds)
    np.testing.assert_allclose(arm.nominal_positions, [1.0, *[np.radians(1.0)] * 6])


# What does not.


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"directives": [{"add_modl": {}}]},
            r"Drake refuses the directives: .*'add_modl'.* Write them as Drake's model .*",
        ),
        (
            {"directives": [{"add_model": {"name": "pa10", "file": "no.urdf"}}]},
            r"there is no file 'no\.urdf' in the current folder, /.*, nor beside the scenario.*",
        ),
        (
            {"directives": [{"add_model": {"name": "pa10"}}]},
            r"Drake refuses the directives: (one lacks a name, a frame or a file|"
            r"error: add_model: `file` must be non-empty).*",
        ),
        (
            {"directives": [PA10, {"add_weld": {"parent": "world", "child": "pa10::foot"}}]},
            r"Drake refuses the directives: .*no Frame named 'foot'.*base_link.*",
        ),
        (
            {"model": "ur5e"},
            r"the directives add no model named 'ur5e'; they add: pa10\. Set model to one .*\.",
        ),
        (
            {"directives": [PA10]},
            r"'pa10::base_link' hangs in the air\. "
            r"Weld it: add_weld \{parent: world, child: pa10::base_link\}\.",
        ),
        (
            {"hand_frame": "hnd"},
            r"the model 'pa10' has no frame 'hnd'; it has hand\. Set hand_frame, or add one by "
            r"add_frame\.",
        ),
        (
            {"nominal_deg": [0.0] * 6},
            r"the nominal posture \(nominal_deg\) must have 7 numbers, one for each of "
            r"S1, S2, S3, E1, E2, W1, W2, not 6\.",
        ),
        (
            {"nominal_deg": [0, 30, 0, 170, 0, 0, 0]},
            r"the nominal posture \(nominal_deg\) has joint E1 at 2\.967, outside its limits "
            r"-2\.391 to 2\.391 rad\. Move it inside\.",
        ),
        (
            {"held_joints": ["A3"]},
            r"held_joints names A3, but the joints are S1, S2, S3, E1, E2, W1, W2\. "
            r"Use these names, or \[\] to hold none\.",
        ),
        (
            {"held_joints": ["S3", "E2"]},
            r"held_joints leaves 5 of 7 joints, but a hand pose takes 6\. Hold fewer\.",
        ),
    ],
)
def test_what_is_no_arm_is_refused_in_one_line(values, message):
    with pytest.raises(ArmError, match=f"^arm: {message}$"):
        ArmModel(**values).MakePlant()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"kinds": ["revolute"] * 5},
            r"the model 'chain' has 5 moving joints (J1, J2, J3, J4, J5), but a hand pose takes at "
            r"least 6. Use an arm with more.",
        ),
        (
            {"kinds": [*["revolute"] * 6, "planar"], "actuated": [f"J{i}" for i in range(1, 7)]},
            r"joint J7 is of type 'planar', but must be revolute or prismatic. Split it, or make "
            r"it fixed.",
        ),
        (
            {"actuated": ["J1", "J2", "J4", "J6"]},
            r"no actuator at J3, J5. Give every moving joint a <transmission> with an <actuator> "
            r"in the model's file.",
        ),
        (
            {"actuated": ["J1", "J2", "J3", "J4", "J6", "J5"]},
            r"the actuators' order is J1, J2, J3, J4, J6, J5, the joints' J1, J2, J3, J4, J5, J6. "
            r"List the model's transmissions in the joints' order.",
        ),
    ],
)
def test_joints_that_cannot_be_led_are_named(options, message, tmp_path):
    with pytest.raises(ArmError, match=f"^arm: {re.escape(message)}$"):
        chain(tmp_path / "chain.urdf", **options).MakePlant()


def test_nothing_else_may_move(tmp_path):
    write_chain(tmp_path / "gripper.urdf", kinds=["prismatic"] * 2)
    gripper = [
        {"add_model": {"name": "gripper", "file": str(tmp_path / "gripper.urdf")}},
        {"add_weld": {"parent": "pa10::hand", "child": "gripper::L0"}},
    ]
    message = (
        r"arm: the model 'gripper' has moving joints \(J1, J2\), but only the arm 'pa10' may have "
        r"some\. Make them fixed\."
    )
    plant = MultibodyPlant(0.0)
    with pytest.raises(ArmError, match=f"^{message}$"):
        ArmModel(directives=[PA10, WELD, *gripper]).AddToPlant(plant)
    assert not plant.HasModelInstanceNamed("pa10")  # The plant is as it was.


def test_a_scenarios_wrong_values_are_named():
    with pytest.raises(ParameterError, match=r"^arm\.nominal_deg\[0\] must be a number, not 'x'$"):
        read_parameters(ArmModel, {"nominal_deg": ["x"]}, "arm")


def test_the_plant_must_be_open():
    with pytest.raises(RuntimeError, match="finalized already"):
        ArmModel().AddToPlant(MakePa10Plant())


# Frames for cameras.


def test_a_camera_can_be_anywhere_on_the_arm():
    plant = ArmModel().MakePlant()
    arm = plant.GetModelInstanceByName("pa10")
    X_PC = RigidTransform(RotationMatrix.MakeXRotation(0.3), [0.1, 0.2, 0.3])
    elbow = plant.GetFrameByName("link4", arm)
    frame_C = AddCameraFrame(plant, name="elbow_eye", parent=elbow, X_PC=X_PC)
    with pytest.raises(RuntimeError, match=r"'pa10' has a frame 'elbow_eye' already\.$"):
        AddCameraFrame(plant, name="elbow_eye", parent=elbow, X_PC=X_PC)
    plant.Finalize()
    assert frame_C.CalcPose(plant.CreateDefaultContext(), elbow).IsNearlyEqualTo(X_PC, 1e-15)
    with pytest.raises(RuntimeError, match="finalized already"):
        AddCameraFrame(plant, name="late", parent=elbow, X_PC=X_PC)


def test_the_stereo_camera_goes_on_any_arms_hand(tmp_path):
    plant = MultibodyPlant(0.0)
    arm = chain(tmp_path / "chain.urdf").AddToPlant(plant)
    with pytest.raises(RuntimeError, match="no model named 'pa10'.*model_instance"):
        AddCameraFrames(plant)
    frame_C, _ = AddCameraFrames(plant, model_instance=arm, hand_frame="L6", p_EC=(0, 0, 0.1))
    plant.Finalize()
    assert frame_C.body().name() == "L6"
    assert frame_C.model_instance() == arm
