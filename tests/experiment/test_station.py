"""A station of one's own from a scenario: arms, cameras, disturbances, trackers."""

import dataclasses as dc
import typing
from pathlib import Path

import numpy as np
import pytest

from mffdrake.experiment.runs.grid import MakeGrid
from mffdrake.experiment.scenario.scenario import Change, LoadScenario, Scenario, ScenarioError
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.recognition import Generation, RefinementParameters, TrackerParameters
from mffdrake.recognition.parameters import plain
from mffdrake.recognition.parameters.documentation import commented_yaml, json_schema
from mffdrake.systems.vision.recognizer import PoseRecognizer

ROOT = Path(__file__).parents[2]
REFINED = "renderer: flat, recognizer: {refinement: borders, start: near_target}"
RIGHT = "{name: right, X_PB: {translation: [0, -0.155, 0]}}"
LEFT = "{name: left, X_PB: {translation: [-0.15, -0.155, 0]}}"
TOP = (
    "{name: top, width: 320, height: 240, focal: !FocalLength {x: 290}, latency: 0.005, "
    "X_PB: {translation: [-0.07, -0.3, 0], rotation: !Rpy {deg: [-8, 0, 0]}}}"
)


def position_error(result):
    """Root of the mean squared distance after the first frames [m]."""
    error = result.recognized_pose[10:, :3] - result.true_pose[10:, :3]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


# A parameter is declared in one place.


def parameters_of(cls, above=""):
    for name, hint in typing.get_type_hints(cls).items():
        if dc.is_dataclass(hint):
            yield from parameters_of(hint, f"{above}{name}.")
        elif typing.get_origin(hint) is not typing.ClassVar:
            yield f"{above}{name}"


def test_every_parameter_of_the_recognizer_is_a_key_that_can_be_swept_and_is_described():
    keys = [f"recognizer.{key}" for key in parameters_of(TrackerParameters)]
    keys += [f"recognizer.refinement.{field.name}" for field in dc.fields(RefinementParameters)]
    base = LoadScenario(text="recognizer: {refinement: !Borders {window: 9}}")
    text = commented_yaml(Scenario())
    for key in keys:
        found = plain(base)
        for name in key.split("."):
            found = found[name]
        data = {"scenario": {"recognizer": {"refinement": "borders"}}, "grid": {key: [found]}}
        assert len(MakeGrid(data).runs) == 1, key
        assert f"{key.rpartition('.')[2]}:" in text, key


def test_the_described_defaults_are_the_defaults_and_the_schema_knows_their_keys():
    assert LoadScenario(text=commented_yaml(Scenario())) == Scenario()
    schema = json_schema(Scenario)
    assert set(schema["properties"]) == {field.name for field in dc.fields(Scenario)}
    assert all("description" in part for part in schema["properties"].values())


def test_the_described_defaults_and_the_schema_tell_bounds():
    text = commented_yaml(Scenario())
    for words in (
        "Image width [px]. From 1 to 16384.\n",
        "Vertical field of view [deg]. From 0.001 to 179.9.\n",
        "Time between control ticks [s]. From 1e-06 to 1000.\n",
    ):
        assert words in text
    width = json_schema(Scenario)["$defs"]["StereoCameraConfig"]["properties"]["width"]
    assert (width["minimum"], width["maximum"]) == (1, 16384)


# Cameras.


@pytest.mark.parametrize("cameras", [[RIGHT], [RIGHT, LEFT], [RIGHT, LEFT, TOP]])
def test_one_two_and_three_cameras_track_the_target(cameras):
    text = f"{{duration: 1.5, {REFINED}, cameras: [{', '.join(cameras)}]}}"
    assert position_error(Simulate(LoadScenario(text=text))) < 0.001


def test_two_cameras_of_a_list_are_the_stereo_pair_to_the_bit():
    pair = Simulate(LoadScenario(text=f"{{duration: 0.5, {REFINED}}}"))
    listed = Simulate(
        LoadScenario(text=f"{{duration: 0.5, {REFINED}, cameras: [{RIGHT}, {LEFT}]}}")
    )
    np.testing.assert_allclose(listed.recognized_pose, pair.recognized_pose, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"cameras: [{RIGHT}, {RIGHT}]", "cameras must have different names, not right, right"),
        ("cameras: []", r"cameras must be a list of at least 1"),
        ("cameras: [{X_PB: {}}]", r"cameras\[0\]\.name must be given"),
        ("cameras: [{name: a, latency: 0.0005}]", r"cameras\[0\]\.latency must be .*multiple"),
        ("cameras: [{name: a, distortion: !PlumbBob {coefficients: [1]}}]", "4 or 5 or 8"),
    ],
)
def test_mistakes_in_cameras_are_told(text, message):
    with pytest.raises(ScenarioError, match=message):
        LoadScenario(text=text)


def test_a_camera_elsewhere_than_on_the_hand_is_told():
    scenario = LoadScenario(text="cameras: [{name: a, X_PB: {base_frame: base_link}}]")
    with pytest.raises(ScenarioError, match=r"cameras\[0\]\.X_PB\.base_frame must be .*'hand'"):
        MakeHandEyeDiagram(scenario)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("center_x: 1000", "camera 'a': center_x and center_y must be inside the image of 640 x"),
        ("distortion: equidistant, focal: !FocalLength {x: 100}", "camera 'a': .* 80 deg from"),
    ],
)
def test_a_camera_that_drake_cannot_draw_is_told(keys, message):
    scenario = LoadScenario(text=f"{{renderer: flat, cameras: [{{name: a, {keys}}}]}}")
    with pytest.raises(ScenarioError, match=message):
        MakeHandEyeDiagram(scenario)


# Disturbances: what is off adds no system, and what is on reaches the recognizer.


def test_disturbances_stand_between_camera_and_recognizer():
    plain_names = names_of("renderer: flat")
    text = "{renderer: flat, disturbances: [black, !GaussianNoise {cameras: [left]}], "
    added = names_of(text + "clutter: [occluder]}") - plain_names
    assert added == {"black_right", "black_left", "gaussian_noise_left", "occluder_0"}


def names_of(text):
    diagram = MakeHandEyeDiagram(LoadScenario(text=text))
    return {system.get_name() for system in diagram.GetSystems()}


def test_a_disturbance_of_a_camera_that_there_is_not_is_told():
    scenario = LoadScenario(text="{renderer: flat, disturbances: [!Black {cameras: [top]}]}")
    with pytest.raises(ScenarioError, match="cameras must be some of right, left, not 'top'"):
        MakeHandEyeDiagram(scenario)


# Arms.


@pytest.mark.parametrize("name", ["ur5e", "iiwa14"])
def test_another_arm_tracks_as_well_as_the_pa10(name, monkeypatch):
    monkeypatch.chdir(ROOT)  # the arms' files are named from there
    text = f"{{duration: 4, {REFINED}, hand_path: {{omega: 0.314}}}}"
    other = Simulate(LoadScenario(f"scenarios/{name}.yaml", text))
    assert other.joint_positions.shape[1] == {"ur5e": 6, "iiwa14": 7}[name]
    pa10 = Simulate(LoadScenario(text=text))
    assert position_error(other) < 1.5 * max(position_error(pa10), 1e-4)


def test_gains_of_the_wrong_number_are_told():
    scenario = Change(Scenario(), {"controller.kp": [1.0, 2.0]})
    with pytest.raises(ScenarioError, match=r"controller\.kp must be a list of 7 numbers.*S1"):
        MakeHandEyeDiagram(scenario)


# Systems and trackers of one's own.


class Carried:
    """A tracker that believes what the feedforward says."""

    num_hypotheses = 1

    def __init__(self, rig, start_pose):
        self.rig, self.initial_pose = rig, start_pose

    def start_population(self, images, *, frame):
        return Generation(self.initial_pose[None], np.ones(1))

    def track(self, generation, images, *, frame):
        return Generation(generation.poses, np.ones(1))


def test_another_tracker_takes_the_recognizers_place_with_and_without_feedforward():
    seen = []
    for method in ("mff", "ga"):
        scenario = LoadScenario(
            text=f"{{renderer: flat, duration: 1, method: {method}, hand_path: {{omega: 0.314}}}}"
        )
        diagram = MakeHandEyeDiagram(
            scenario,
            make_tracker=lambda *, solid, rig, seed, start_pose: Carried(rig, start_pose),
            prebuild_callback=lambda builder, parts: seen.append(parts.recognizer),
        )
        assert isinstance(diagram.GetSubsystemByName("recognizer"), PoseRecognizer)
        error = position_error(Simulate(scenario, diagram=diagram))
        assert (error < 1e-6) if method == "mff" else (error > 0.01)
    assert len(seen) == 2
