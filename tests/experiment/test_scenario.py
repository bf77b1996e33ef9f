"""Scenarios: the paper's values by default, YAML on top, and clear words for whatever is wrong."""

import dataclasses as dc
import inspect
import math
import os
import re
import types
import typing
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydrake.math import RigidTransform, RotationMatrix

from mffdrake.experiment.scenario.camera_sections import StereoCameraConfig
from mffdrake.experiment.scenario.scenario import (
    METHODS,
    Change,
    LoadScenario,
    Scenario,
    ScenarioError,
)
from mffdrake.experiment.simulation.wiring.target import CalcDesiredPose
from mffdrake.recognition import (
    CameraRig,
    LocalMoveParameters,
    MatchingParameters,
    OneStepGaTracker,
    ParameterError,
    SamplingParameters,
    SearchRange,
    TrackerParameters,
)
from mffdrake.systems.arms.hand_path import HandPath
from mffdrake.systems.arms.pa10 import AddCameraFrames
from mffdrake.systems.control.pd_gains import LightlyDamped
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.predictor import MffPredictor


def all_keys(schema=Scenario, above=()):
    """Every key that holds a value, with its type: {("camera", "width"): int, ...}."""
    keys = {}
    for name, kind in typing.get_type_hints(schema).items():
        key = (*above, name)
        if dc.is_dataclass(kind):
            keys |= all_keys(kind, key)
        elif typing.get_origin(kind) is not typing.ClassVar:
            keys[key] = kind
    return keys


def sections(schema=Scenario, above=()):
    """Every key that holds a mapping of keys."""
    found = []
    for name, kind in typing.get_type_hints(schema).items():
        if dc.is_dataclass(kind):
            found += [(*above, name), *sections(kind, (*above, name))]
    return found


def read(scenario, key):
    """The value of a key."""
    for name in key:
        scenario = getattr(scenario, name)
    return list(scenario) if isinstance(scenario, tuple) else scenario


def to_yaml(key, value):
    """YAML that gives one key a value."""
    for name in reversed(key):
        value = {name: value}
    return yaml.safe_dump(value, default_flow_style=True, width=math.inf)


def values(scenario):
    return {key: read(scenario, key) for key in all_keys()}


def error_of(text=None, file=None):
    """The message of what must be a ScenarioError of one line."""
    with pytest.raises(ScenarioError) as caught:
        LoadScenario(file, text)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


# Defaults.


def test_the_defaults_are_the_papers_values():
    scenario = Scenario()
    paper = {
        "hand_path.amplitude_deg": 15.0,
        "hand_path.distance": 0.8,
        "hand_path.omega": 0.105,
        "controller.gains": LightlyDamped(),
        "camera.width": 640,
        "camera.height": 480,
        "camera.fov_y_deg": 45.0,
        "camera.baseline": 0.15,
        "camera.p_EC": [0.0, -0.155, 0.0],
        "recognizer.population_size": 60,
        "recognizer.generations_per_frame": 1,
        "recognizer.coding": "binary",
        "recognizer.bits": 12,
        "recognizer.survivor_share": 0.25,
        "recognizer.mutation_probability": 0.02,
        "recognizer.search_range.x": [-0.15, 0.15],
        "recognizer.search_range.y": [0.0, 0.3],
        "recognizer.search_range.z": [0.65, 0.95],
        "recognizer.search_range.eps1": [-0.5, 0.5],
        "recognizer.search_range.eps2": [-0.5, 0.5],
        "recognizer.search_range.eps3": [-0.5, 0.5],
        "camera.latency": 0.0,
        "encoders.noise_deg": 0.0,
        "predictor.latency": None,
        "predictor.hand_eye_error_deg": [0.0, 0.0, 0.0],
        "predictor.gain": 1.0,
        "timing.control_period": 0.001,
        "timing.vision_period": 0.033,
        "method": "mff",
        "renderer": "vtk",
        "duration": 40.0,
        "seed": 0,
    }
    for key, value in paper.items():
        assert read(scenario, key.split(".")) == value, key
    assert METHODS == ("ga", "mff")
    first_hand_pose = RigidTransform(
        RotationMatrix(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
        [0.918, 0.0, 0.455],
    )
    X_WE0 = scenario.hand_path.X_WE0.GetDeterministicValue()
    assert X_WE0.IsNearlyEqualTo(first_hand_pose, 1e-15)


def test_the_target_starts_where_the_paper_has_it_in_the_camera():
    pose = CalcDesiredPose(Scenario(), 0.0)
    np.testing.assert_allclose(pose, [0.0, 0.155, 0.8, 0.0, 0.0, 0.0], atol=1e-12)


def test_the_defaults_are_valid_and_nothing_is_the_same_as_no_text_and_no_file(tmp_path):
    (tmp_path / "empty.yaml").write_text("")
    (tmp_path / "comment.yaml").write_text("# nothing yet\n")
    for scenario in (
        LoadScenario(),
        LoadScenario(text=""),
        LoadScenario(text="  \n"),
        LoadScenario(text="# only a comment"),
        LoadScenario(text="{}"),
        LoadScenario(tmp_path / "empty.yaml"),
        LoadScenario(str(tmp_path / "comment.yaml"), text=""),
    ):
        assert values(scenario) == values(Scenario())


def test_a_scenario_cannot_be_changed_but_another_one_be_made_of_it():
    scenario = Scenario()
    with pytest.raises(dc.FrozenInstanceError):
        scenario.seed = 3
    with pytest.raises(dc.FrozenInstanceError):
        scenario.camera.width = 320
    with pytest.raises(TypeError):
        scenario.camera.p_EC[0] = 1.0
    other = Change(scenario, {"camera.width": 320, "hand_path.omega": 0.2})
    assert (other.camera.width, other.hand_path.omega) == (320, 0.2)
    assert scenario == Scenario() != other


def test_every_key_of_the_issue_is_there():
    promised = {
        "hand_path": {"amplitude_deg", "distance", "omega"},
        "controller": set(),
        "camera": {"width", "height", "fov_y_deg", "baseline", "p_EC", "latency"},
        "encoders": {"noise_deg"},
        "target": {"model", "X_WM", "motion"},
        "recognizer": {
            "population_size", "generations_per_frame", "coding", "search_range", "start",
            "refinement",
        },
        "predictor": {"mode", "latency", "gain"},
        "timing": {"control_period", "vision_period"},
        "method": set(), "renderer": set(), "duration": set(), "seed": set(),
    }  # fmt: skip
    top = typing.get_type_hints(Scenario)
    assert set(top) >= set(promised)
    for key, inner in promised.items():
        if inner:
            assert inner <= {field.name for field in dc.fields(top[key])}


def test_the_hand_paths_defaults_are_those_of_the_class_behind_it():
    path, expected = Scenario().hand_path.Make(), HandPath()
    for name in ("amplitude", "distance", "omega"):
        assert getattr(path, name) == getattr(expected, name)
    assert path.X_WE0.IsNearlyEqualTo(expected.X_WE0, 1e-15)


def test_the_other_defaults_are_those_of_the_functions_and_classes_behind_them():
    scenario = Scenario()

    def default(function, name):
        return inspect.signature(function).parameters[name].default

    for name in ("mode", "gain"):
        assert getattr(scenario.predictor, name) == default(MffPredictor, name)
    right, left = CameraRig.stereo().cameras
    config = scenario.camera
    assert (config.width, config.height) == (right.width, right.height)
    baseline = float(np.linalg.norm(left.p_CK - right.p_CK))
    assert config.baseline == baseline == default(AddCameraFrames, "baseline")
    assert tuple(config.p_EC) == default(AddCameraFrames, "p_EC")
    focal_length = 0.5 * config.height / math.tan(0.5 * math.radians(config.fov_y_deg))
    assert focal_length == pytest.approx(right.fx, rel=1e-14)
    generations = default(OneStepGaTracker, "generations_per_frame")
    assert scenario.recognizer.generations_per_frame == generations
    assert scenario.seed == default(OneStepGaTracker, "seed")


# What a scenario holds reaches the parts.


def test_a_changed_value_reaches_the_part_it_is_for():
    text = """
        hand_path: {amplitude_deg: 10, distance: 0.7, omega: 0.2}
        timing: {control_period: 0.002, vision_period: 0.05}
        recognizer:
          population_size: 20
          coding: gray
          bits: 8
          search_range: {z: [0.5, 1.0]}
          sampling: {spacing: 0.03, margin: null, strip_offsets: [0.006]}
          matching: {hue_tolerance_deg: 15}
          local_moves: {sparsity: 0.25}
    """
    scenario = LoadScenario(text=text)
    path = scenario.hand_path.Make()
    assert (path.amplitude, path.distance, path.omega) == (math.radians(10), 0.7, 0.2)
    assert scenario.timing == Timing(control_period=0.002, vision_period=0.05)
    assert scenario.recognizer == TrackerParameters(
        population_size=20,
        coding="gray",
        bits=8,
        search_range=SearchRange(z=(0.5, 1.0)),
        sampling=SamplingParameters(spacing=0.03, margin=None, strip_offsets=(0.006,)),
        matching=MatchingParameters(hue_tolerance_deg=15),
        local_moves=LocalMoveParameters(sparsity=0.25),
    )


# A file, then a text on top.


OWN_FILES = """
target: {model: own/box.sdf, motion: !TrajectoryFile {file: poses.tum}}
arm:
  directives:
  - add_model: {name: pa10, file: arm.urdf}
  - add_directives: {file: table.dmd.yaml}
  - add_weld: {parent: world, child: pa10::base_link}
"""
NAMED = ("own/box.sdf", "poses.tum", "arm.urdf", "table.dmd.yaml")
POSES = "0 1 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n"


def write_own_files(folder):
    for name in NAMED:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(POSES)
    (folder / "own.yaml").write_text(OWN_FILES)


def named_files(scenario):
    model, add_directives, _ = scenario.arm.directives
    return (
        scenario.target.model, scenario.target.motion.file,
        model["add_model"]["file"], add_directives["add_directives"]["file"],
    )  # fmt: skip


def test_files_beside_a_scenario_file_are_found_from_anywhere(tmp_path, monkeypatch):
    write_own_files(tmp_path / "mine")
    for elsewhere in (tmp_path, tmp_path / "other"):
        elsewhere.mkdir(exist_ok=True)
        monkeypatch.chdir(elsewhere)
        file = os.path.relpath(tmp_path / "mine" / "own.yaml")
        found = named_files(LoadScenario(file))
        assert [os.path.abspath(path) for path in found] == [
            str(tmp_path / "mine" / name) for name in NAMED
        ]
    write_own_files(tmp_path / "other")  # in the current folder: the others come first
    assert named_files(LoadScenario(file)) == found


def test_files_in_the_current_folder_alone_are_named_as_they_were(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_own_files(tmp_path)
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "own.yaml").rename(tmp_path / "scenarios" / "own.yaml")
    scenario = LoadScenario("scenarios/own.yaml")
    assert named_files(scenario) == NAMED
    # A scenario text has no folder.
    assert LoadScenario(text=OWN_FILES) == scenario


def test_paths_that_lead_to_the_same_file_both_ways_stay_so_that_runs_keep_their_keys(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    write_own_files(tmp_path)
    given = LoadScenario(text=OWN_FILES).fingerprint
    for file in ("own.yaml", tmp_path / "own.yaml"):
        assert LoadScenario(file).fingerprint == given


@pytest.mark.parametrize("name", ["ur5e", "iiwa14"])
def test_the_arms_of_the_checkout_are_found_from_its_top(name, monkeypatch):
    root = Path(__file__).parents[2]
    monkeypatch.chdir(root)
    scenario = LoadScenario(f"scenarios/{name}.yaml")
    assert scenario.arm.directives[0]["add_model"]["file"] == f"scenarios/arms/{name}.urdf"
    assert scenario.arm.MakePlant().HasModelInstanceNamed(scenario.arm.model)


def test_a_text_goes_on_top_of_a_file_which_goes_on_top_of_the_defaults(tmp_path):
    file = tmp_path / "scenario.yaml"
    file.write_text(
        "seed: 3\n"
        "camera: {width: 320, height: 240}\n"
        "recognizer: {search_range: {x: [-0.2, 0.2], y: [0, 0.2]}}\n"
        "target: {X_WM: {translation: [1.8, 0, 0.4], rotation: !Rpy {deg: [-80, 0, -90]}}}\n"
    )
    scenario = LoadScenario(
        file, "{method: ga, camera: {height: 200}, recognizer: {search_range: {x: [-0.1, 0.1]}}}"
    )
    changed = {
        ("seed",): 3,
        ("camera", "width"): 320,
        ("camera", "height"): 200,
        ("method",): "ga",
        ("recognizer", "search_range", "x"): [-0.1, 0.1],
        ("recognizer", "search_range", "y"): [0.0, 0.2],
    }
    for key in all_keys():
        if key[:2] != ("target", "X_WM"):
            assert read(scenario, key) == changed.get(key, read(Scenario(), key)), key
    assert scenario.target == LoadScenario(file).target


@pytest.mark.parametrize("part", ["translation", "rotation"])
def test_half_a_pose_keeps_the_other_half(part):
    given = {"translation": "[1.8, 0, 0.4]", "rotation": "!Rpy {deg: [10, 20, 30]}"}[part]
    scenario = LoadScenario(text=f"target: {{X_WM: {{{part}: {given}}}}}")
    X, default = (s.target.X_WM.GetDeterministicValue() for s in (scenario, Scenario()))
    same_translation = np.array_equal(X.translation(), default.translation())
    same_rotation = np.array_equal(X.rotation().matrix(), default.rotation().matrix())
    assert (same_translation, same_rotation) == (part == "rotation", part == "translation")


@pytest.mark.parametrize(
    ("rotation", "expected"),
    [
        ("!Rpy {deg: [0, 0, 90]}", [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        ("!AngleAxis {angle_deg: 90, axis: [0, 0, 2]}", [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        ("!Identity {}", np.eye(3)),
    ],
)
def test_rotations_can_be_given_in_three_ways(rotation, expected):
    scenario = LoadScenario(text=f"target: {{X_WM: {{rotation: {rotation}}}}}")
    R = scenario.target.X_WM.GetDeterministicValue().rotation().matrix()
    np.testing.assert_allclose(R, expected, atol=1e-15)


def test_a_number_may_be_written_without_a_point_and_with_an_exponent_alone():
    scenario = LoadScenario(text="{duration: 2, camera: {fov_y_deg: 5e1, baseline: 1e-1}}")
    assert (scenario.duration, scenario.camera.fov_y_deg) == (2.0, 50.0)
    assert scenario.camera.baseline == 0.1


# Writing and reading back.

OTHER = """
hand_path:
  amplitude_deg: 12.5
  distance: 0.75
  omega: 0.2
  X_WE0: {translation: [0.9, 0.1, 0.4], rotation: !Rpy {deg: [-91.3, 0.7, -88.1]}}
controller:
  gains: well_damped
  kp: [100, 200, 30, 40, 5, 6.5, 7]
  kd: [1, 2, 3, 4, 0.5, 0.6, 0.7]
  gravity_compensation: false
  computed_torque: true
camera: {width: 320, height: 200, fov_y_deg: 33.3, baseline: 0.1, p_EC: [0.01, -0.1, 0.02],
  latency: 0.066}
encoders: {noise_deg: 0.01, offset_deg: [1, 2, 3, 4, 5, 6, 7], resolution_deg: 0.02}
arm:
  directives:
  - add_model: {name: ur5e, file: scenarios/arms/ur5e.urdf}
  - add_weld: {parent: world, child: ur5e::base_link, X_PC: {rotation: !Rpy {deg: [1, 2, 3]}}}
  model: ur5e
  hand_frame: tool
  nominal_deg: [17, -107, -107, 33, 73, 0]
  held_joints: []
cameras:
- {name: eye, width: 320, focal: !FocalLength {x: 300}, X_PB: {base_frame: tool}, latency: 0.002}
- {name: fish, distortion: !Equidistant {coefficients: [0.1, 0, 0, 0]}, center_x: 300.5}
calibration: {focal_error: 0.01, baseline_error: -0.002}
disturbances: [black, !GaussianNoise {cameras: [eye], deviation: 3}]
clutter: [!Distractors {number: 3}, occluder]
target:
  model: /tmp/prism.sdf
  X_WM: {translation: [1.5, 0.2, 0.3], rotation: !AngleAxis {angle_deg: 77.7, axis: [1, 2, 3]}}
  motion: !Straight {velocity: [0.01, 0, 0.02], duration: 3, then: reverse}
recognizer:
  population_size: 30
  generations_per_frame: 2
  coding: gray
  bits: 10
  survivor_share: 0.4
  mutation_probability: 0.01
  local_share: 0.3
  newcomer_share: 0.2
  first_candidates: 5
  average_best: false
  search_range:
    x: [-0.1, 0.2]
    y: [0.05, 0.2]
    z: [0.6, 1.0]
    eps1: [-0.4, 0.4]
    eps2: [-0.3, 0.3]
    eps3: [-0.2, 0.2]
  refinement: borders
  acquisition: none
  white_balance_rate: 0.02
  start: near_target
  start_spread: [0.02, 0.03]
  sampling: {spacing: 0.025, min_cells: 2, margin: null, strip_offsets: [0.006]}
  matching:
    hue_tolerance_deg: 25
    min_saturation: 0.4
    min_value: 0.3
    min_chroma: 0.1
    min_cosine: 0.02
    min_border_distance: 0
  local_moves: {depth: 0.1, shift: 0.02, rotation_deg: 20, decades: 1.5, sparsity: 0.4}
predictor: {mode: velocity, latency: 0.034, gain: 0.9, hand_eye_error_deg: [1, 2, -3],
  hand_eye_error: [0.001, 0, 0]}
timing: {control_period: 0.002, vision_period: 0.05}
method: ga
renderer: vtk
servo: follow
duration: 12.25
seed: 11
"""


def test_the_other_scenario_of_these_tests_has_another_value_for_every_key():
    other, default = values(LoadScenario(text=OTHER)), values(Scenario())
    same = [key for key in other if other[key] == default[key]]
    assert set(same) <= {("renderer",)}, same


EARLIER = """
camera:
  baseline: 0.15
  fov_y_deg: 45.0
  height: 480
  latency: 0.0
  p_EC: [0.0, -0.155, 0.0]
  width: 640
controller: {gains: lightly_damped, gravity_compensation: true, kd: null, kp: null}
duration: 40.0
encoders: {noise_deg: 0.0}
hand_path:
  X_WE0:
    rotation: !AngleAxis
      angle_deg: 77.7
      axis: [1.0, 2.0, 3.0]
    translation: [0.918, 0.0, 0.455]
  amplitude_deg: 15.0
  distance: 0.8
  omega: 0.105
method: mff
predictor:
  gain: 1.0
  hand_eye_error_deg: [0.0, 0.0, 0.0]
  latency: null
  mode: rigid
recognizer:
  average_best: true
  bits: 12
  coding: binary
  first_candidates: 30
  generations_per_frame: 1
  local_moves: {decades: 2.0, depth: 0.2, rotation_deg: 34.0, shift: 0.04, sparsity: 0.5}
  local_share: 0.6
  matching: {hue_tolerance_deg: 20.0, min_border_distance: 0.8, min_chroma: 0.0, min_cosine: 0.0,
    min_saturation: 0.62, min_value: 0.2}
  mutation_probability: 0.02
  newcomer_share: 0.15
  population_size: 60
  refinement: borders
  sampling:
    margin: 0.0015
    min_cells: 5
    spacing: 0.02
    strip_offsets: [0.0015, 0.006, 0.02]
  search_range:
    eps1: [-0.5, 0.5]
    eps2: [-0.5, 0.5]
    eps3: [-0.5, 0.5]
    x: [-0.15, 0.15]
    y: [0.0, 0.3]
    z: [0.65, 0.95]
  start: random
  start_spread: [0.01, 0.02]
  survivor_share: 0.25
  white_balance_rate: 0.0
renderer: vtk
seed: 0
target:
  X_WM:
    rotation: {}
    translation: [1.718, 0.0, 0.455]
  model: package://mffdrake/target_box.sdf
timing: {control_period: 0.001, vision_period: 0.033}
"""
"""As earlier versions dumped it: keys in alphabetical order, no rotation as Drake wrote it."""


def test_a_scenario_that_an_earlier_version_dumped_has_the_same_values():
    assert LoadScenario(text=EARLIER) == Change(
        Scenario(),
        {
            "hand_path.X_WE0.rotation": {
                "_tag": "!AngleAxis", "angle_deg": 77.7, "axis": [1, 2, 3],
            },
            "target.X_WM.rotation": "identity",
            "recognizer.refinement": "borders",
        },
    )  # fmt: skip


@pytest.mark.parametrize("text", ["", OTHER], ids=["default", "other"])
def test_a_dumped_scenario_is_read_back_to_the_last_bit(text):
    scenario = LoadScenario(text=text)
    again = LoadScenario(text=scenario.Dump())
    assert values(again) == values(scenario)
    assert again.Dump() == scenario.Dump()


def test_a_dumped_scenario_replaces_every_value_that_it_is_put_on_top_of(tmp_path):
    file = tmp_path / "other.yaml"
    file.write_text(OTHER)
    assert values(LoadScenario(file, Scenario().Dump())) == values(Scenario())


def test_a_dump_shows_every_key():
    data = yaml.safe_load(re.sub(r"!\w+", "", Scenario().Dump()))
    for key in all_keys():
        level = data
        for name in key:
            assert name in level, key
            level = level[name]


# What is wrong is said in one line that names the source, the key and what is allowed.


@pytest.mark.parametrize(
    ("text", "key", "allowed"),
    [
        # Unknown keys.
        ("sed: 3", "'sed'", "did you mean 'seed'.*known keys: hand_path, .*seed"),
        ("nonsense: 3", "'nonsense'", "known keys: hand_path, .*seed"),
        ("hand_path: {omga: 1}", "'omga' in hand_path", "did you mean 'omega'.*X_WE0"),
        ("camera: {Width: 1}", "'Width' in camera", "did you mean 'width'.*p_EC"),
        ("recognizer: {search_range: {u: [0, 1]}}", "'u' in recognizer.search_range", "x, y, z"),
        ("recognizer: {sampling: {margins: 1}}", "recognizer.sampling", "'margin'"),
        ("{1: 2}", "'1'", "known keys"),
        ("{camera: {50%d: 2}}", "'50%d' in camera", "known keys"),
        ("target: {X_WM: {base_frame: w}}", "'base_frame' in target.X_WM", "translation, rotation"),
        ("hand_path: !Circle {omega: 1}", "hand_path", "without a tag, not !Circle"),
        # Wrong types.
        ("seed: '3'", "seed", "a whole number, not '3'"),
        ("seed: 1.5", "seed", "a whole number, not 1.5"),
        ("seed: true", "seed", "a whole number, not True"),
        ("seed:", "seed", "a whole number, not None"),
        ("duration: long", "duration", "a number, not 'long'"),
        ("duration: [3]", "duration", "a number"),
        ("duration: .nan", "duration", "positive, not nan|finite"),
        ("method: 3", "method", "one of ga, mff, not 3"),
        ("camera: 640", "camera", "a mapping with the keys width, height"),
        ("camera:", "camera", "a mapping with the keys width, height"),
        ("camera: {width: wide}", "camera.width", "a whole number"),
        ("controller: {gravity_compensation: 1}", "gravity_compensation", "true or false, not 1"),
        ("controller: {kp: 100}", "controller.kp", "a list"),
        ("camera: {p_EC: [a, b, c]}", r"camera.p_EC\[0\]", "a number, not 'a'"),
        ("camera: {p_EC: [0, .nan, 0]}", r"camera.p_EC\[1\]", "finite"),
        # Sizes and periods that are zero, negative or infinite.
        ("camera: {width: 0}", "camera.width", "at least 1, not 0"),
        ("camera: {height: -480}", "camera.height", "at least 1, not -480"),
        ("camera: {baseline: -0.1}", "camera.baseline", "positive"),
        ("camera: {fov_y_deg: 0}", "camera.fov_y_deg", "positive"),
        ("camera: {fov_y_deg: 180}", "camera.fov_y_deg", "at most 179.9, not 180"),
        ("duration: 0", "duration", "positive"),
        ("duration: -1", "duration", "positive, not -1"),
        ("duration: .inf", "duration", "finite, not inf"),
        ("seed: -1", "seed", "at least 0, not -1"),
        ("timing: {control_period: 0}", "control_period", "positive"),
        ("timing: {control_period: -0.001}", "control_period", "positive, not -0.001"),
        ("timing: {vision_period: -0.033}", "vision_period", "positive, not -0.033"),
        ("timing: {vision_period: .inf}", "vision_period", "finite"),
        ("timing: {control_period: 0.1}", "vision_period", "at least control_period .*0.1 s"),
        ("hand_path: {omega: -0.1}", "hand.path.*omega", "at least 0, not -0.1"),
        ("hand_path: {omega: .inf}", "hand.path.*omega", "finite"),
        ("hand_path: {distance: 0}", "hand.path.*distance", "positive"),
        ("hand_path: {amplitude_deg: -1}", "hand.path.*amplitude", "at least 0"),
        ("hand_path: {amplitude_deg: 180}", "hand.path.*amplitude", "below"),
        ("predictor: {latency: -0.001}", "predictor.latency", "at least 0"),
        ("predictor: {latency: 0.0005}", "predictor.latency", "whole multiple"),
        ("predictor: {latency: .inf}", "predictor.latency", "finite"),
        ("camera: {latency: 0.0005}", "camera.latency", "whole multiple"),
        (
            "servo: !Follow {controller: {period: 1e-6}}",
            "servo.controller.period",
            r"at least timing.control_period \(0.001 s\), not 1e-06",
        ),
        (
            "{camera: {latency: 1}, timing: {control_period: 1e-6}}",
            "camera.latency",
            "at most 100000 control periods, which is 0.1 s, not 1 s",
        ),
        ("cameras: [{name: ../x}]", r"cameras\[0\]: name", "that of a folder, too, not '../x'"),
        ("cameras: [{name: /x}]", r"cameras\[0\]: name", "that of a folder, too, not '/x'"),
        ("camera: {latency: -1}", "camera.latency", "at least 0"),
        ("encoders: {noise_deg: -1}", "encoders.noise_deg", "at least 0"),
        ("predictor: {hand_eye_error_deg: [1, 2]}", "hand_eye_error_deg", "3 values"),
        ("predictor: {hand_eye_error_deg: [1, 2, .inf]}", "hand_eye_error_deg", "finite"),
        ("predictor: {gain: .inf}", "predictor.gain", "finite"),
        ("recognizer: {population_size: 1}", "recognizer.*population_size", "at least 3, not 1"),
        ("recognizer: {generations_per_frame: 0}", "generations_per_frame", "at least 1, not 0"),
        ("recognizer: {first_candidates: 0}", "recognizer.*first_candidates", "at least 1"),
        ("recognizer: {bits: 0}", "recognizer.*bits", "at least 1, not 0"),
        ("recognizer: {survivor_share: 1.1}", "recognizer.*survivor_share", "at most 1"),
        ("recognizer: {local_share: 0.95}", "local_share and newcomer_share", "not exceed 1"),
        ("recognizer: {start_spread: [-1, 0]}", "recognizer.start_spread", "at least 0"),
        ("recognizer: {sampling: {spacing: 0}}", "recognizer.sampling.*spacing", "positive"),
        ("recognizer: {sampling: {margin: -1}}", "recognizer.sampling.*margin", "positive"),
        ("recognizer: {sampling: {strip_offsets: []}}", "strip_offsets", "a list"),
        ("recognizer: {matching: {min_value: 2}}", "recognizer.matching.*min_value", "at most 1"),
        ("recognizer: {matching: {min_chroma: 2}}", "recognizer.matching.*min_chroma", "at most 1"),
        ("recognizer: {sampling: {min_cells: 0}}", "recognizer.sampling.*min_cells", "at least 1"),
        ("recognizer: {white_balance_rate: -0.1}", "recognizer.white_balance_rate", "at least 0"),
        ("recognizer: {local_moves: {depth: -1}}", "local_moves.*depth", "at least 0"),
        ("controller: {kd: [-1, 0, 0, 0, 0, 0, 0]}", "controller.kd", "at least 0"),
        # Choices.
        ("method: GA", "method", "one of ga, mff, not 'GA'"),
        ("renderer: gl", "renderer", "one of .*vtk.*, not 'gl'"),
        ("recognizer: {coding: hex}", "recognizer.coding", "one of binary, gray, not 'hex'"),
        ("recognizer: {start: middle}", "recognizer.start", "one of random, near_target"),
        ("predictor: {mode: exact}", "predictor.mode", "one of rigid, velocity, not 'exact'"),
        ("controller: {gains: soft}", "controller.gains", "one of lightly_damped, well_damped"),
        # Lists of the wrong length, ranges in the wrong order.
        ("camera: {p_EC: [0, 0]}", "camera.p_EC", "3 values"),
        ("recognizer: {start_spread: [0.1]}", "recognizer.start_spread", "2 values"),
        ("recognizer: {search_range: {x: [0.1, -0.1]}}", "search_range.*x", r"\[least, greatest\]"),
        ("recognizer: {search_range: {y: [0.1]}}", "search_range.*y", "2 values"),
        ("recognizer: {search_range: {y: [0.1, 0.1]}}", "search_range.*y", r"\[least, greatest\]"),
        ("recognizer: {search_range: {z: [-0.1, 1]}}", "search_range.*z", "in front of the camera"),
        ("recognizer: {search_range: {eps2: [-2, 2]}}", "search_range.*eps2", r"within \[-1, 1\]"),
        # Poses.
        ("target: {X_WM: [1, 2, 3]}", "target.X_WM", "translation, rotation"),
        ("target: {X_WM: {translation: [1, 2]}}", "target.X_WM.translation", "3 values"),
        ("target: {X_WM: {translation: !Uniform {}}}", "target.X_WM.translation", "a list"),
        ("target: {X_WM: {rotation: [1, 2, 3]}}", "target.X_WM.rotation", "!Rpy {deg: "),
        ("target: {X_WM: {rotation: !Rpy {rad: [1, 2, 3]}}}", "X_WM.rotation", "known keys: deg"),
        ("target: {X_WM: {rotation: !Rpy {deg: [1, 2]}}}", "X_WM.rotation.deg", "3 values"),
        ("target: {X_WM: {rotation: !Uniform {}}}", "target.X_WM.rotation", "!AngleAxis"),
        ("hand_path: {X_WE0: {rotation: 3}}", "hand_path.X_WE0.rotation", "!Rpy {deg: "),
        (
            "hand_path: {X_WE0: {rotation: !AngleAxis {angle_deg: x, axis: [1, 0, 0]}}}",
            "hand_path.X_WE0.rotation.angle_deg",
            "a number",
        ),
        # Not a scenario at all.
        ("{seed: [}", "YAML", "line 1, column"),
        ("seed: 1\n\tduration: 2", "YAML", "line 2, column"),
        ("\x00", "YAML", "character"),
        ("seed: 1\n---\nseed: 2", "YAML", "line 2"),
        ("hello", "mapping", "not 'hello'"),
        ("[seed, 3]", "mapping", "seed"),
        ("3", "mapping", "not 3"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, text, key, allowed):
    message = error_of(text)
    assert message.startswith("scenario text: ")
    assert re.search(key, message), message
    assert re.search(allowed, message), message
    (tmp_path / "my.yaml").write_text(text)
    assert error_of(file=tmp_path / "my.yaml") == message.replace(
        "scenario text", str(tmp_path / "my.yaml"), 1
    )


@pytest.mark.parametrize(
    "key",
    [
        "camera.p_EC", "controller.kp", "controller.kd", "recognizer.search_range.x",
        "recognizer.search_range.z", "recognizer.sampling.strip_offsets",
        "recognizer.start_spread", "hand_path.X_WE0.translation", "target.X_WM.translation",
    ],
)  # fmt: skip
def test_a_list_with_an_infinite_number_is_an_error_that_names_the_key(key):
    length = {"p_EC": 3, "kp": 7, "kd": 7, "translation": 3}.get(key.split(".")[-1], 2)
    message = error_of(to_yaml(key.split("."), [1.0] * (length - 1) + [math.inf]))
    assert key.split(".")[-1] in message or "X_WE0" in message


@pytest.mark.parametrize(
    "rotation",
    [
        "!Rpy {deg: [.inf, 0, 0]}",
        "!AngleAxis {angle_deg: .inf, axis: [1, 0, 0]}",
        "!AngleAxis {angle_deg: 10, axis: [.inf, 0, 0]}",
        "!AngleAxis {angle_deg: 10, axis: [0, 0, 0]}",
    ],
)
@pytest.mark.parametrize("key", ["hand_path.X_WE0", "target.X_WM"])
def test_what_is_no_rotation_is_an_error_that_names_the_key(key, rotation):
    section, name = key.split(".")
    message = error_of(f"{section}: {{{name}: {{rotation: {rotation}}}}}")
    assert name in message


def test_a_seed_that_is_too_large_for_the_generator_is_an_error():
    assert "seed" in error_of("seed: 100000000000000000000000000")


def test_a_duration_below_a_control_tick_is_an_error():
    """Not even the first frame would be taken in."""
    assert "duration" in error_of("duration: 0.0004")


def test_an_error_in_the_file_names_the_file_even_when_the_text_would_mend_it(tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text("duration: -1")
    assert error_of("duration: 1", file).startswith(f"{file}: duration")


def test_an_error_in_the_text_names_the_text(tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text("duration: 1")
    assert error_of("duration: -1", file).startswith("scenario text: duration")


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"seed: \xe9"])
def test_a_file_that_is_not_text_is_an_error_that_names_it(tmp_path, content):
    file = tmp_path / "my.yaml"
    file.write_bytes(content)
    assert error_of(file=file).startswith(f"{file}: ")


def test_a_file_that_cannot_be_read_is_an_os_error_that_names_it(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        LoadScenario(tmp_path / "missing.yaml")
    assert error.value.filename == str(tmp_path / "missing.yaml")
    with pytest.raises(IsADirectoryError):
        LoadScenario(tmp_path)


def test_values_given_in_python_are_checked_too():
    with pytest.raises(ParameterError, match="^Scenario: seed must be at least 0, not -1$"):
        Scenario(seed=-1)
    with pytest.raises(
        ParameterError, match=r"^StereoCameraConfig: width must be at least 1, not 0$"
    ):
        StereoCameraConfig(width=0)
    with pytest.raises(ScenarioError, match=r"^camera\.width must be at least 1, not 0$"):
        Change(Scenario(), {"camera.width": 0})


# No value of a wrong type, of any key, ends in anything but a ScenarioError that names the key.

_MAPPING = {"nonsense": 1}
WRONG = {
    float: ["text", True, None, [1.0], _MAPPING, math.nan],
    int: ["text", True, None, 1.5, [1], _MAPPING, math.nan, math.inf],
    str: [3, 1.5, True, None, ["text"], _MAPPING],
    bool: ["text", 1, None, [True], _MAPPING],
    tuple: ["text", 3, True, _MAPPING, [[1.0, [2.0]]], [None]],
    typing.Literal: ["text", 3, True, None, ["text"], _MAPPING],
    typing.Union: ["text", True, [None], _MAPPING],
    types.UnionType: ["text", True, [None], _MAPPING],
}


def wrong_values():
    for key in sections():
        for value in ("text", 3, None, [1.0], _MAPPING):
            yield pytest.param(key, value, id=f"{'.'.join(key)}={value}")
    for key, kind in all_keys().items():
        for value in WRONG[typing.get_origin(kind) or kind]:
            yield pytest.param(key, value, id=f"{'.'.join(key)}={value}")


@pytest.mark.parametrize(("key", "value"), list(wrong_values()))
def test_a_value_of_a_wrong_type_is_an_error_that_names_the_key(key, value):
    message = error_of(to_yaml(key, value))
    assert ".".join(key) in message
