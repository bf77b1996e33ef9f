"""Meshcat: the estimated pose as a frame and a ghost, and a replay in one file."""

import base64
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.systems.arms.models import FindModelsPath
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
from mffdrake.systems.rendering.visualization import PoseEstimateVisualizer, SaveReplay

BOX = ColoredMesh.read(FindModelsPath() / "target_box.obj")
X_CM = RigidTransform(RollPitchYaw(0.1, -0.2, 0.3), [0.02, 0.15, 0.8])
STATE = np.append(NOMINAL_POSITIONS + 0.1, 0.2 * np.ones(7))


def read_transform(message):
    """The transform in one of Meshcat's messages: 16 numbers, column by column."""
    numbers = message[message.index(b"matrix\xdc\x00\x10") + 9 :][: 16 * 9]
    assert numbers[::9] == b"\xcb" * 16  # msgpack's mark of a float64
    values = [np.frombuffer(numbers[9 * k + 1 : 9 * k + 9], ">f8")[0] for k in range(16)]
    matrix = np.reshape(values, (4, 4)).T
    return RigidTransform(RotationMatrix(matrix[:3, :3]), matrix[:3, 3])


def expected_pose(state=STATE, X_CM=X_CM):
    arm = MakePa10Plant()
    context = arm.CreateDefaultContext()
    arm.SetPositionsAndVelocities(context, state)
    return arm.GetFrameByName("camera_right").CalcPoseInWorld(context) @ X_CM


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat()


# The visualizer alone.


@pytest.fixture
def visualizer(meshcat):
    meshcat.Delete()
    return PoseEstimateVisualizer(meshcat=meshcat, plant=MakePa10Plant(), mesh=BOX)


def test_its_ports_are_those_of_its_docs(visualizer):
    block = re.search(r"pydrake_system::\n\n(.*?)\n\n", PoseEstimateVisualizer.__doc__, re.DOTALL)
    docs = yaml.safe_load(block[1])
    assert docs["name"] == type(visualizer).__name__
    names = [visualizer.get_input_port(k).get_name() for k in range(visualizer.num_input_ports())]
    assert names == [name.removesuffix(" (optional)") for name in docs["input_ports"]]
    assert visualizer.num_output_ports() == 0
    assert "output_ports" not in docs


def test_it_draws_a_ghost_of_the_target_and_three_axes(meshcat, visualizer):
    corners = BOX.triangles.reshape(-1, 3)
    ghost = meshcat._GetPackedObject("estimate/ghost")
    assert BOX.colors.repeat(3, axis=0).astype("<f4").tobytes() in ghost
    assert (1.02 * corners).astype("<f4").tobytes() in ghost  # a little larger
    opacity = meshcat._GetPackedProperty("estimate/ghost", "modulated_opacity")
    assert 0.2 < np.frombuffer(opacity[-8:], ">f8")[0] < 0.8
    for k, axis in enumerate("xyz"):
        assert b"Cylinder" in meshcat._GetPackedObject(f"estimate/frame/{axis}")
        X = read_transform(meshcat._GetPackedTransform(f"estimate/frame/{axis}"))
        middle = X.translation()
        assert middle[k] > 0.05  # Each from the origin along its own direction,
        np.testing.assert_allclose(np.delete(middle, k), 0.0, atol=1e-12)
        direction = (
            2.0 * middle[k] * X.rotation().matrix()[:, 2]
        )  # A cylinder stands on its z axis.
        np.testing.assert_allclose(direction, 2.0 * middle, atol=1e-12)


def test_it_shows_the_estimate_in_the_world_of_the_arms_state(meshcat, visualizer):
    context = visualizer.CreateDefaultContext()
    visualizer.GetInputPort("X_CM").FixValue(context, X_CM)
    visualizer.GetInputPort("state").FixValue(context, STATE)
    visualizer.ForcedPublish(context)
    shown = read_transform(meshcat._GetPackedTransform("estimate"))
    assert shown.IsNearlyEqualTo(expected_pose(), 1e-12)
    other = RigidTransform([0.0, 0.1, 0.7])
    visualizer.GetInputPort("X_CM").FixValue(context, other)
    visualizer.GetInputPort("state").FixValue(context, np.zeros(14))
    visualizer.ForcedPublish(context)
    shown = read_transform(meshcat._GetPackedTransform("estimate"))
    assert shown.IsNearlyEqualTo(expected_pose(np.zeros(14), other), 1e-12)


def test_in_a_simulation_it_shows_the_estimate_by_itself(meshcat, visualizer):
    builder = DiagramBuilder()
    builder.AddSystem(visualizer)
    estimate = builder.AddSystem(ConstantValueSource(Value(X_CM)))
    state = builder.AddSystem(ConstantVectorSource(STATE))
    builder.Connect(estimate.get_output_port(), visualizer.GetInputPort("X_CM"))
    builder.Connect(state.get_output_port(), visualizer.GetInputPort("state"))
    Simulator(builder.Build()).AdvanceTo(0.05)
    shown = read_transform(meshcat._GetPackedTransform("estimate"))
    assert shown.IsNearlyEqualTo(expected_pose(), 1e-12)


def test_an_unknown_camera_frame_is_an_error(meshcat):
    with pytest.raises(RuntimeError, match="camera_middle"):
        PoseEstimateVisualizer(
            meshcat=meshcat,
            plant=MakePa10Plant(),
            mesh=BOX,
            camera_frame="camera_middle",
        )


# The replay.


class Page(HTMLParser):
    """Collects what a page would load from elsewhere, and its scripts."""

    def __init__(self):
        super().__init__()
        self.loaded, self.scripts, self._in_script = [], [], False

    def handle_starttag(self, tag, attrs):
        self._in_script = tag == "script"
        self.loaded += [
            value for name, value in attrs
            if name in ("src", "href", "data", "srcset") and tag != "a"
        ]  # fmt: skip
        if self._in_script:
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._in_script = False

    def handle_data(self, data):
        if self._in_script:
            self.scripts[-1] += data


def read_page(path):
    page = Page()
    page.html = path.read_text(encoding="utf-8")
    page.feed(page.html)
    page.close()
    return page


def told(page):
    """What the page tells Meshcat: messages that it holds itself."""
    pattern = r"fetch\(\"data:application/octet-binary;base64,([^\"]+)\"\)"
    return [base64.b64decode(text) for text in re.findall(pattern, page.html)]


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    meshcat = Meshcat()
    scenario = LoadScenario(text="{duration: 0.4, camera: {width: 160, height: 120}}")
    diagram = MakeHandEyeDiagram(scenario, meshcat=meshcat)
    meshcat.StartRecording(set_visualizations_while_recording=False)
    Simulate(scenario, diagram=diagram)
    SaveReplay(meshcat, path)
    return path


def test_the_replay_is_one_file_that_needs_nothing_else(replay):
    assert [path.name for path in replay.parent.iterdir()] == ["replay.html"]
    assert replay.stat().st_size > 100_000
    page = read_page(replay)
    assert "<html" in page.html[:500]
    assert page.loaded == []  # No script, style or picture from elsewhere.
    assert max(map(len, page.scripts)) > 100_000  # Meshcat's own script is inside.


def test_the_replay_holds_the_scene_and_the_estimate(replay):
    objects = [message for message in told(read_page(replay)) if b"set_object" in message]
    paths = b" ".join(message[:300] for message in objects)
    for path in (b"/drake/estimate/ghost", b"/drake/estimate/frame/x", b"/target_box", b"/pa10"):
        assert path in paths


def test_the_replay_holds_the_animation_of_the_arm_and_of_the_estimate(replay):
    (animation,) = [m for m in told(read_page(replay)) if b"set_animation" in m]
    assert b"/pa10/" in animation
    _, of_estimate = animation.split(b"/drake/estimate", 1)
    track = of_estimate.split(b".position", 1)[1].split(b"tracks", 1)[0].split(b".quaternion")[0]
    keys = re.findall(rb"value\x93((?:\xcb.{8}){3})", track, re.DOTALL)
    assert len(keys) == 13  # At 0 ms, 33 ms, ... 396 ms.
    assert len(set(keys)) > 8  # It moves.
    for key in keys:
        position = [np.frombuffer(key[9 * k + 1 : 9 * k + 9], ">f8")[0] for k in range(3)]
        np.testing.assert_allclose(position, [1.7, 0.0, 0.45], atol=0.3)  # Near the target.


def find_browser():
    """A browser's path or None; one from a snap sees no files in /tmp."""
    is_snap = Path("/snap/bin/chromium").exists()
    names = ["google-chrome", *([] if is_snap else ["chromium", "chromium-browser"])]
    return next((path for path in map(shutil.which, names) if path), None)


@pytest.mark.skipif(find_browser() is None, reason="no chromium or google-chrome is installed")
def test_a_browser_draws_the_replay(replay, tmp_path):
    shot = tmp_path / "shot.png"
    command = [
        find_browser(), "--headless=new", "--no-sandbox", "--disable-dev-shm-usage",
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader",  # WebGL without a graphics driver
        f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1280,720", "--hide-scrollbars",
        "--virtual-time-budget=5000", f"--screenshot={shot}", replay.as_uri(),
    ]  # fmt: skip
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    assert shot.is_file(), finished.stderr
    picture = cv2.cvtColor(cv2.imread(str(shot)), cv2.COLOR_BGR2RGB)
    vivid = np.ptp(picture, axis=2) > 100
    red, green, blue = (vivid & (np.argmax(picture, axis=2) == k) for k in range(3))
    assert red.any()
    # Of a page without its scene, grid and axes are left: thin lines.
    _, _, boxes, _ = cv2.connectedComponentsWithStats(red.astype(np.uint8))
    left, top, width, height, area = boxes[1 + np.argmax(boxes[1:, cv2.CC_STAT_AREA])]
    assert 2000 < area < 20_000 and area > 0.4 * width * height  # the target's red face,
    around = slice(top - 30, top + height + 30), slice(left - 30, left + width + 30)
    assert green[around].sum() > 300 and blue[around].sum() > 250  # and its others beside it


def test_without_a_recording_there_would_be_no_animation(tmp_path):
    meshcat = Meshcat()
    (tmp_path / "still.html").write_text(meshcat.StaticHtml(), encoding="utf-8")
    assert not [m for m in told(read_page(tmp_path / "still.html")) if b"set_animation" in m]


def test_watching_changes_no_number():
    scenario = LoadScenario(text="{duration: 0.2, camera: {width: 160, height: 120}}")
    watched = Simulate(scenario, diagram=MakeHandEyeDiagram(scenario, meshcat=Meshcat()))
    alone = Simulate(scenario)
    assert watched.recognized_pose.tobytes() == alone.recognized_pose.tobytes()
    assert watched.joint_positions.tobytes() == alone.joint_positions.tobytes()


def test_a_replay_that_cannot_be_saved_is_an_os_error(tmp_path, meshcat):
    meshcat.StartRecording()
    with pytest.raises(OSError):
        SaveReplay(meshcat, tmp_path / "missing" / "replay.html")
    assert list(tmp_path.iterdir()) == []
