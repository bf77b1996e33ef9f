"""The hand-eye diagram of a scenario: its parts, its ports, its start, and the targets it takes."""

import colorsys
import gc
import math
import re
import subprocess
import sys

import numpy as np
import pytest
import yaml
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator

from mffdrake.experiment.scenario.scenario import Change, LoadScenario, ScenarioError
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.target import CalcDesiredPose
from mffdrake.recognition import AdaptiveWhiteBalance
from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.systems.arms.inverse_kinematics import UnreachablePathError
from mffdrake.systems.arms.models import FindModelsPath
from mffdrake.systems.arms.pa10 import MakePa10Plant
from mffdrake.systems.control.pd_gains import PD_GAINS
from mffdrake.systems.timing import Timing

PARTS = {
    "plant", "no_contacts", "scene_graph", "hand_path", "pd_controller", "gravity_compensation",
    "stereo_camera", "target", "recognizer", "predictor",
}  # fmt: skip


def load(text=""):
    """A scenario with small images and little time, where the text does not say otherwise."""
    values = {} if "camera" in text else {"camera.width": 160, "camera.height": 120}
    if "duration" not in text:
        values["duration"] = 0.3
    return Change(LoadScenario(text=text), values)


def names(diagram):
    return {system.get_name() for system in diagram.GetSystems()}


@pytest.fixture(scope="module")
def mff():
    return MakeHandEyeDiagram(load("method: mff"))


@pytest.fixture(scope="module")
def ga():
    return MakeHandEyeDiagram(load("method: ga"))


# Its parts and ports.


def test_the_parts_have_names(mff):
    assert mff.get_name() == "hand_eye"
    assert names(mff) == PARTS


def test_late_cameras_see_a_scene_of_their_own():
    late = MakeHandEyeDiagram(
        load("{camera: {width: 160, height: 120, latency: 0.033}, clutter: [occluder]}")
    )
    delay = {f"camera_delay{part}" for part in ("", "_input", "_output")}
    scene = {"render_scene", "exposed_target", "geometry_poser", "occluder_0_render_scene"}
    assert names(late) == PARTS | delay | scene | {"occluder_0"}


def test_the_plain_ga_has_no_predictor(ga, mff):
    assert names(ga) == PARTS - {"predictor"}
    for diagram, connected in ((ga, False), (mff, True)):
        recognizer = diagram.GetSubsystemByName("recognizer")
        context = recognizer.GetMyContextFromRoot(diagram.CreateDefaultContext())
        assert recognizer.GetInputPort("predicted_population").HasValue(context) == connected


@pytest.mark.parametrize("method", ["ga", "mff"])
def test_the_ports_are_those_of_the_docs(method, request):
    diagram = request.getfixturevalue(method)
    block = re.search(r"pydrake_system::\n\n(.*?)\n\n", MakeHandEyeDiagram.__doc__, re.DOTALL)
    docs = yaml.safe_load(block[1])
    assert docs["name"] == diagram.get_name()
    outputs = [diagram.get_output_port(k).get_name() for k in range(diagram.num_output_ports())]
    assert outputs == docs["output_ports"]
    assert diagram.num_input_ports() == 0


def test_the_exported_ports_are_the_parts_own(mff):
    context = mff.CreateDefaultContext()
    recognizer = mff.GetSubsystemByName("recognizer")
    inner = recognizer.GetMyContextFromRoot(context)
    for name in ("pose", "fitness", "population"):
        np.testing.assert_array_equal(
            mff.GetOutputPort(f"recognizer.{name}").Eval(context),
            recognizer.GetOutputPort(name).Eval(inner),
        )
    for side in ("right", "left"):
        image = mff.GetOutputPort(f"stereo_camera.color_image_{side}").Eval(context)
        assert image.data.shape == (120, 160, 4)
    assert mff.GetOutputPort("state").size() == mff.GetOutputPort("desired_state").size() == 14
    assert mff.GetOutputPort("actuation").size() == 7
    assert mff.GetOutputPort("query_object").Eval(context).inspector().num_sources() >= 2


def test_its_state_is_discrete_numbers_only(mff):
    context = mff.CreateDefaultContext()
    assert context.num_abstract_states() == 0
    assert context.num_continuous_states() == 0


# Its start.


@pytest.mark.parametrize("hand_path", ["{}", "{amplitude_deg: 10, omega: 0.314, distance: 0.7}"])
def test_the_arm_starts_at_rest_in_the_paths_first_pose(hand_path):
    scenario = load(f"hand_path: {hand_path}")
    diagram = MakeHandEyeDiagram(scenario)
    context = diagram.CreateDefaultContext()
    state = diagram.GetOutputPort("state").Eval(context)
    desired = diagram.GetOutputPort("desired_state").Eval(context)
    np.testing.assert_array_equal(state[:7], desired[:7])
    np.testing.assert_array_equal(state[7:], np.zeros(7))
    assert np.abs(desired[7:]).max() > 0.01  # The path itself starts at full speed.
    arm = MakePa10Plant()
    arm_context = arm.CreateDefaultContext()
    arm.SetPositions(arm_context, state[:7])
    X_WE = arm.GetFrameByName("hand").CalcPoseInWorld(arm_context)
    assert X_WE.IsNearlyEqualTo(scenario.hand_path.Make().CalcHandPose(0.0), 1e-8)


def test_the_target_lies_where_the_scenario_says():
    scenario = load(
        "target: {X_WM: {translation: [1.7, 0.05, 0.4], rotation: !Rpy {deg: [-80, 5, -95]}}}\n"
        "camera: {width: 160, height: 120, p_EC: [0.02, -0.1, 0.03], baseline: 0.12}"
    )
    diagram = MakeHandEyeDiagram(scenario)
    plant = diagram.GetSubsystemByName("plant")
    root = diagram.CreateDefaultContext()
    context = plant.GetMyContextFromRoot(root)
    query = diagram.GetOutputPort("query_object").Eval(root)
    frames = [
        f
        for f in query.inspector().GetAllFrameIds()
        if "target_box" in query.inspector().GetName(f)
    ]
    X_WM = query.GetPoseInWorld(*frames)
    assert X_WM.IsNearlyEqualTo(scenario.target.X_WM.GetDeterministicValue(), 1e-12)
    X_CM = plant.GetFrameByName("camera_right").CalcPoseInWorld(context).InvertAndCompose(X_WM)
    X_CL = plant.GetFrameByName("camera_left").CalcPose(
        context, plant.GetFrameByName("camera_right")
    )
    pose = pose_from_transform(X_CM.rotation().matrix(), X_CM.translation())
    np.testing.assert_allclose(CalcDesiredPose(scenario, 0.0), pose, atol=1e-7)
    np.testing.assert_allclose(X_CL.translation(), [-0.12, 0.0, 0.0], atol=1e-12)


def test_the_true_pose_fits_the_first_images(mff):
    """Cameras, target and recognizer agree on every frame, lens and color."""
    context = mff.CreateDefaultContext()
    images = tuple(
        mff.GetOutputPort(f"stereo_camera.color_image_{side}").Eval(context).data.copy()
        for side in ("right", "left")
    )
    pose = CalcDesiredPose(load(), 0.0)
    matcher = mff.GetSubsystemByName("recognizer").tracker.matcher
    (true, beside) = matcher.fitness([pose, pose + [0.05, 0, 0, 0, 0, 0]], images)
    assert true > 0.95  # Blended pixels at the borders count more in a small image.
    assert beside < 0.6


# What the scenario chooses reaches the parts.


def test_the_scenarios_choices_reach_the_parts():
    diagram = MakeHandEyeDiagram(
        load(
            "seed: 5\n"
            "recognizer: {population_size: 30, coding: gray, generations_per_frame: 2,"
            " white_balance_rate: 0.02}\n"
            "timing: {control_period: 0.002, vision_period: 0.05}\n"
            "controller: {gravity_compensation: false}\n"
        )
    )
    tracker = diagram.GetSubsystemByName("recognizer").tracker
    assert tracker.parameters.population_size == 30
    assert tracker.coding.coding == "gray"
    assert tracker.generations_per_frame == 2
    assert tracker.seed == 5
    assert tracker.white_balance == AdaptiveWhiteBalance(0.02)
    assert diagram.GetSubsystemByName("plant").time_step() == pytest.approx(0.002, rel=1e-14)
    assert names(diagram) == PARTS - {"gravity_compensation"}
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.149)
    recognizer = diagram.GetSubsystemByName("recognizer")
    context = recognizer.GetMyContextFromRoot(simulator.get_context())
    timing = Timing(control_period=0.002, vision_period=0.05).Coinciding()
    assert recognizer.timing == timing
    assert recognizer.GetOutputPort("frame_time").Eval(context)[0] == timing.TimeOfFrame(2)


@pytest.mark.parametrize(
    ("controller", "kp", "kd"),
    [
        ("{}", PD_GAINS["lightly_damped"].kp, PD_GAINS["lightly_damped"].kd),
        ("{gains: well_damped}", PD_GAINS["well_damped"].kp, PD_GAINS["well_damped"].kd),
        (
            "{gains: well_damped, kd: [1, 2, 3, 4, 5, 6, 7]}",
            PD_GAINS["well_damped"].kp,
            [1, 2, 3, 4, 5, 6, 7],
        ),
        ("{kp: [7, 6, 5, 4, 3, 2, 1]}", [7, 6, 5, 4, 3, 2, 1], PD_GAINS["lightly_damped"].kd),
    ],
)
def test_the_controller_has_the_chosen_gains(controller, kp, kd):
    diagram = MakeHandEyeDiagram(load(f"controller: {controller}"))
    context = diagram.CreateDefaultContext()
    part = diagram.GetSubsystemByName("pd_controller")
    inner = part.GetMyMutableContextFromRoot(context)
    error = 0.01 * np.arange(1.0, 15.0)
    part.GetInputPort("desired_state").FixValue(inner, error)
    part.GetInputPort("estimated_state").FixValue(inner, np.zeros(14))
    part.GetInputPort("feedforward_torque").FixValue(inner, np.zeros(7))
    part.CalcForcedDiscreteVariableUpdate(inner, inner.get_mutable_discrete_state())
    torque = diagram.GetOutputPort("actuation").Eval(context)
    expected = np.multiply(kp, error[:7]) + np.multiply(kd, error[7:])
    limit = MakePa10Plant().GetEffortUpperLimits()
    np.testing.assert_allclose(torque, np.clip(expected, -limit, limit), rtol=1e-12)


def test_the_first_population_is_spread_or_near_the_target_as_chosen():
    spread = {}
    for start in ("random", "near_target"):
        diagram = MakeHandEyeDiagram(
            load(f"recognizer: {{start: {start}, start_spread: [0.004, 0.008]}}")
        )
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.001)
        context = simulator.get_context()
        poses = diagram.GetOutputPort("recognizer.population").Eval(context).reshape(-1, 6)
        spread[start] = np.sqrt(np.mean((poses - CalcDesiredPose(load(), 0.0)) ** 2, axis=0))
    np.testing.assert_allclose(spread["near_target"], 3 * [0.004] + 3 * [0.008], rtol=0.4)
    assert np.all(spread["random"] > 3.0 * spread["near_target"])


def test_a_path_that_the_arm_cannot_follow_is_an_error_of_its_own():
    with pytest.raises(UnreachablePathError, match=r"t = \d"):
        MakeHandEyeDiagram(load("hand_path: {X_WE0: {translation: [1.5, 0, 0.455]}}"))


# A target outside the search range.


def test_a_target_inside_the_search_range_is_nothing_to_tell(caplog):
    for omega in (0.105, 0.314):
        MakeHandEyeDiagram(load(f"{{duration: 60, hand_path: {{omega: {omega}}}}}"))
    assert caplog.records == []


@pytest.mark.parametrize(
    ("text", "coordinate"),
    [
        ("recognizer: {search_range: {z: [0.4, 0.75]}}", "z"),
        ("recognizer: {search_range: {y: [0.16, 0.3]}}", "y"),
        # At the end of the path only: eps2 reaches 0.13.
        ("{duration: 20, recognizer: {search_range: {eps2: [-0.1, 0.1]}}}", "eps2"),
    ],
)
def test_a_target_outside_the_search_range_is_one_warning(caplog, text, coordinate):
    MakeHandEyeDiagram(load(text))
    (record,) = caplog.records
    message = record.getMessage()
    assert record.levelname == "WARNING"
    assert record.name.startswith("mffdrake")
    assert "outside the search range" in message
    assert f"search_range.{coordinate}" in message
    assert len(message.splitlines()) == 1


# Targets. A prism is written as the box is: SDF + OBJ + MTL, a material a face.


def write_solid(folder, faces, *, visual="", link="target", model=""):
    """Writes a solid with faces (hue in degrees, corners seen from outside) and returns its SDF.

    A face with the hue None is grey.
    """
    vertices, lines, materials = [], ["mtllib target.mtl"], []
    for k, (hue, corners) in enumerate(faces):
        color = (0.5, 0.5, 0.5) if hue is None else colorsys.hsv_to_rgb(hue / 360.0, 1.0, 1.0)
        materials.append(f"newmtl m{k}\nKa 0 0 0\nKd {color[0]} {color[1]} {color[2]}\nillum 1")
        normal = np.cross(np.subtract(corners[1], corners[0]), np.subtract(corners[2], corners[0]))
        normal = normal / np.linalg.norm(normal)
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        lines += ["vn {} {} {}".format(*normal), f"usemtl m{k}"]
        first = len(vertices) + 1
        vertices += list(corners)
        lines += ["f " + " ".join(f"{first + i}//{k + 1}" for i in range(len(corners)))]
    (folder / "target.obj").write_text("\n".join(lines) + "\n")
    (folder / "target.mtl").write_text("\n\n".join(materials) + "\n")
    sdf = folder / "target.sdf"
    sdf.write_text(
        f"<?xml version='1.0'?><sdf version='1.9'><model name='target'>{model}"
        f"<link name='{link}'>{visual or VISUAL}</link></model></sdf>"
    )
    return sdf


def mesh(uri):
    return f"<geometry><mesh><uri>{uri}</uri></mesh></geometry>"


VISUAL = f"<visual name='v'>{mesh('target.obj')}</visual>"


def prism(radius, height, hues):
    """A prism about the y axis, which in the camera points down: top, bottom, sides."""
    n = len(hues) - 2
    angles = 2.0 * math.pi * (np.arange(n) + 0.5) / n
    ring = [(radius * math.cos(a), radius * math.sin(a)) for a in angles]
    top = [(x, -0.5 * height, z) for x, z in ring]
    bottom = [(x, 0.5 * height, z) for x, z in ring]
    sides = [[top[k], top[k - 1], bottom[k - 1], bottom[k]] for k in range(n)]
    return list(zip(hues, [top, bottom[::-1], *sides], strict=True))


BOX = prism(0.07, 0.12, [60, 60, 180, 300, 180, 300])
HEXAGON = prism(0.08, 0.16, [30, 30, 60, 120, 180, 240, 300, 0])


@pytest.mark.parametrize("faces", [BOX, HEXAGON], ids=["small box", "hexagonal prism"])
def test_another_convex_colored_target_is_recognized(tmp_path, faces, caplog):
    sdf = write_solid(tmp_path, faces)
    rotation = "!Rpy {deg: [-90, 8, -70]}"
    scenario = load(
        f"target: {{model: {sdf}, X_WM: {{rotation: {rotation}}}}}\n"
        "recognizer: {start: near_target, matching: {hue_tolerance_deg: 14}}\n"
        "camera: {width: 320, height: 240}\n"
        "duration: 2\n"
    )
    diagram = MakeHandEyeDiagram(scenario)
    assert caplog.records == []
    solid = diagram.GetSubsystemByName("recognizer").tracker.matcher.search_model.solid
    assert len(solid.faces) == len(faces)
    expected = {round(hue) % 360 for hue, _ in faces}
    assert {round(hue) % 360 for hue in np.degrees(solid.hues)} == expected

    result = Simulate(scenario, diagram=diagram)
    late = result.time > 1.0
    error = result.recognized_pose - result.true_pose
    assert result.fitness[late].mean() > 0.95
    assert 1e3 * np.median(np.linalg.norm(error[late, :3], axis=1)) < 25.0
    assert np.abs(error[late, 3:]).mean() < 0.06


def test_a_target_may_be_named_by_its_url_or_its_path():
    scenario = Change(load(), {"target.model": str(FindModelsPath() / "target_box.sdf")})
    by_path, by_url = MakeHandEyeDiagram(scenario), MakeHandEyeDiagram(load())
    faces = [
        d.GetSubsystemByName("recognizer").tracker.matcher.search_model.solid.faces
        for d in (by_path, by_url)
    ]
    assert faces[0] == faces[1]


def visual(name, hue, geometry, pose="0 0 0 0 0 0"):
    color = " ".join(str(c) for c in colorsys.hsv_to_rgb(hue / 360.0, 1.0, 1.0))
    return (
        f"<visual name='{name}'><pose>{pose}</pose>{geometry}"
        f"<material><diffuse>{color} 1</diffuse></material></visual>"
    )


def test_a_target_may_be_made_of_several_visuals(tmp_path):
    """A solid at half its size, and a cylinder beside it, each of one color."""
    write_solid(tmp_path, BOX)
    text = (tmp_path / "target.obj").read_text()
    (tmp_path / "bare.obj").write_text(re.sub("(mtllib|usemtl) .*", "", text))
    half = mesh("bare.obj").replace("</uri>", "</uri><scale>.5 .5 .5</scale>")
    rod = "<geometry><cylinder><radius>.02</radius><length>.1</length></cylinder></geometry>"
    parts = visual("a", 60, half) + visual("b", 180, rod, "0 .2 0 0 0 0")
    sdf = write_solid(tmp_path, BOX, visual=parts)
    diagram = MakeHandEyeDiagram(Change(load(), {"target.model": str(sdf), "renderer": "flat"}))
    solid = diagram.GetSubsystemByName("recognizer").tracker.matcher.solid
    np.testing.assert_allclose(np.degrees(solid.hues[[0, -1]]), [60, 180])
    of = solid.material_numbers[solid.triangle_faces]
    small, beside = (solid.triangles[of == k].reshape(-1, 3) for k in (0, 1))
    corners = np.concatenate([face for _, face in BOX])
    np.testing.assert_allclose(np.ptp(small, axis=0), 0.5 * np.ptp(corners, axis=0), atol=1e-6)
    np.testing.assert_allclose(beside.min(axis=0)[1:], [0.18, -0.05], atol=1e-4)
    np.testing.assert_allclose(beside.max(axis=0)[1:], [0.22, 0.05], atol=1e-4)


UNUSABLE = {
    "two bodies": ("2 bodies", {"model": "<link name='other'/>"}),
    "no visual": ("no visual", {"visual": "<pose>0 0 0 0 0 0</pose>"}),
    "twice the same": ("4 faces", {"visual": VISUAL + VISUAL.replace("'v'", "'w'")}),
    "no color": (
        "no colors",
        {
            "visual": VISUAL.replace(
                mesh("target.obj"), "<geometry><box><size>.1 .1 .1</size></box></geometry>"
            )
        },
    ),
    "missing mesh": ("missing.obj", {"visual": VISUAL.replace("target.obj", "missing.obj")}),
    "grey face": ("grey", {"faces": [(None, BOX[0][1]), *BOX[1:]]}),
    "open solid": ("not a closed solid", {"faces": BOX[:-1]}),
    "inside out": ("inside out", {"faces": [(hue, face[::-1]) for hue, face in BOX]}),
    "welded to the world": ("static|world", {"model": "<static>true</static>"}),
}


@pytest.mark.parametrize("unusable", UNUSABLE)
def test_an_unusable_target_is_a_scenario_error_that_names_it(tmp_path, unusable):
    reason, arguments = UNUSABLE[unusable]
    sdf = write_solid(tmp_path, **({"faces": BOX} | arguments))
    check_unusable(sdf, reason)


@pytest.mark.parametrize(
    ("file", "content", "reason"),
    [
        ("target.mtl", None, "material"),
        ("target.obj", "# nothing\n", "target.obj"),
        ("target.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "no colors"),
        ("target.sdf", "", "cannot be loaded"),
        ("target.sdf", "no XML", "cannot be loaded"),
        ("target.sdf", "<sdf version='1.9'><model name='m'/></sdf>", "at least one link"),
    ],
    ids=["no materials", "empty mesh", "bare triangle", "empty", "text", "no body"],
)
def test_a_target_with_a_broken_file_is_a_scenario_error_that_names_it(
    tmp_path, file, content, reason
):
    sdf = write_solid(tmp_path, BOX)
    if content is None:
        (tmp_path / file).unlink()
    else:
        (tmp_path / file).write_text(content)
    check_unusable(sdf, reason)


def test_what_vtk_cannot_draw_is_told_with_the_remedy(tmp_path):
    sdf = write_solid(tmp_path, BOX)
    text = (tmp_path / "target.obj").read_text()
    (tmp_path / "target.obj").write_text(re.sub("//[0-9]+", "", re.sub("vn .*", "", text)))
    check_unusable(sdf, "no normals.*export the mesh with normals, or take the renderer 'flat'")
    MakeHandEyeDiagram(Change(load(), {"target.model": str(sdf), "renderer": "flat"}))
    sdf = write_solid(tmp_path, BOX, visual=VISUAL.replace("target.obj", "target.stl"))
    (tmp_path / "target.stl").write_text("")
    check_unusable(
        sdf, "vtk draws .obj and .gltf meshes only.*convert it .* or take renderer: flat"
    )


@pytest.mark.parametrize(
    "model",
    [
        "", "missing.sdf", "/tmp", "package://mffdrake/missing.sdf", "package://unknown/box.sdf",
        "package://", "https://example.invalid/box.sdf",
    ],
)  # fmt: skip
def test_a_target_that_is_not_there_is_a_scenario_error_that_names_it(model):
    check_unusable(model, "cannot be loaded")


def test_places_where_a_target_was_looked_for_are_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_unusable("own/box.sdf", f"current folder, {tmp_path}, nor beside the scenario file")
    check_unusable("/own/box.sdf", "there is no file ''$")


def check_unusable(model, reason):
    scenario = Change(load(), {"target.model": str(model)})
    with pytest.raises(ScenarioError) as error:
        MakeHandEyeDiagram(scenario)
    message = str(error.value)
    assert message.startswith("target.model")
    assert str(model) in message
    assert re.search(reason, message.replace(str(model), ""))
    assert len(message.splitlines()) == 1


@pytest.mark.parametrize("link", ["hand", "camera_right", "W2"])
def test_a_targets_names_may_be_those_of_the_arms_parts(tmp_path, link):
    sdf = write_solid(tmp_path, BOX, link=link)
    result = Simulate(load(f"{{duration: 0.03, target: {{model: {sdf}}}}}"))
    assert len(result.time) == 1


# Its life.


DROPPED = """
import gc
import numpy as np
from pydrake.systems.analysis import Simulator
from mffdrake import LoadScenario, MakeHandEyeDiagram, MakePa10Plant

for method in ("ga", "mff"):
    text = "{method: %s, duration: 0.1, camera: {width: 160, height: 120}}" % method
    diagram = MakeHandEyeDiagram(LoadScenario(text=text))
    gc.collect()
    litter = [MakePa10Plant() for _ in range(3)]  # Takes the memory of what was freed too soon.
    for arm in litter:
        arm.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.1)
    context = simulator.get_context()
    gravity = diagram.GetSubsystemByName("gravity_compensation")
    inner = gravity.GetMyContextFromRoot(context)
    torque = gravity.get_output_port_generalized_force().Eval(inner)
    arm = MakePa10Plant()
    arm_context = arm.CreateDefaultContext()
    arm.SetPositionsAndVelocities(arm_context, diagram.GetOutputPort("state").Eval(context))
    expected = -arm.CalcGravityGeneralizedForces(arm_context)
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(torque, expected, atol=1e-9)
    del diagram, simulator, context, gravity, inner
"""


def test_a_diagram_lives_without_the_python_objects_it_was_made_of():
    """Drake's gravity compensation only points to its plant, which nothing else keeps with "ga".

    In a process of its own: what was freed too soon is a segmentation fault.
    """
    finished = subprocess.run(
        [sys.executable, "-c", DROPPED], capture_output=True, text=True, check=False
    )
    assert finished.returncode == 0, finished.stderr


def test_a_part_lives_without_the_diagram_it_was_taken_from():
    recognizer = MakeHandEyeDiagram(load()).GetSubsystemByName("recognizer")
    gc.collect()
    assert recognizer.num_hypotheses == 60
    assert recognizer.CreateDefaultContext().num_total_states() > 0


# Meshcat.


def test_meshcat_shows_the_scene_and_the_estimate():
    meshcat = Meshcat()
    diagram = MakeHandEyeDiagram(load(), meshcat=meshcat)
    added = names(diagram) - PARTS
    assert "pose_estimate_visualizer" in added
    assert any("meshcat_visualizer" in name for name in added)
    diagram.ForcedPublish(diagram.CreateDefaultContext())
    assert meshcat.HasPath("estimate/ghost")
    assert meshcat.HasPath("estimate/frame")
    assert meshcat.HasPath("visualizer/pa10")
    assert meshcat.HasPath("visualizer/target_box")


def test_the_estimate_is_shown_where_the_recognizer_sees_it():
    meshcat = Meshcat()
    diagram = MakeHandEyeDiagram(load(), meshcat=meshcat)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.0995)
    context = simulator.get_context()
    diagram.ForcedPublish(context)
    plant = diagram.GetSubsystemByName("plant")
    X_WC = plant.GetFrameByName("camera_right").CalcPoseInWorld(plant.GetMyContextFromRoot(context))
    X_WM = X_WC @ diagram.GetOutputPort("recognizer.X_CM").Eval(context)
    assert transform(meshcat, "estimate").IsNearlyEqualTo(X_WM, 1e-12)


def transform(meshcat, path):
    """A path's transform in Meshcat, from its message: 16 numbers, column by column."""
    message = meshcat._GetPackedTransform(path)
    numbers = message[message.index(b"matrix\xdc\x00\x10") + 9 :]
    matrix = np.array([np.frombuffer(numbers[9 * k + 1 : 9 * k + 9], ">f8")[0] for k in range(16)])
    matrix = matrix.reshape(4, 4).T
    return RigidTransform(RotationMatrix(matrix[:3, :3]), matrix[:3, 3])
