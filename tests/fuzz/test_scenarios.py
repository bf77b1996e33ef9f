"""Scenarios and grids of any text: what is read can be written and read again, or one line says."""

import json

import yaml
from hypothesis import example
from hypothesis import strategies as st
from judging import ODD_NUMBERS, ROOT, mutated, outcome, prop

import mffdrake as mff
from mffdrake.recognition.parameters import plain

TEXTS = [
    mff.Scenario().Dump(),
    *(
        file.read_text(encoding="utf-8")
        for file in sorted((ROOT / "scenarios").rglob("*.yaml"))
        if "scenario:" not in file.read_text(encoding="utf-8")
    ),
    "servo: !Follow {controller: {gain: 8}}\nrecognizer: {refinement: !Borders {window: 8}}",
    "disturbances: [!MotionBlur {exposure: 0.008}, !GaussianNoise {deviation: 8}, !SaltAndPepper {"
    "}, black, !DroppedFrames {cameras: [left], probability: 0.1}, !LateFrames {}, !Frozen {}]\n"
    "clutter: [!Occluder {size: [0.1, 0.2, 0.3], period: 2}, !Distractors {number: 3}]",
    "cameras: [{name: a, width: 64}, {name: b, focal: 50}]\ncalibration: {focal_error: 0.01}",
    "target: {motion: !Sinusoids {}, X_WM: {rotation: !AngleAxis {angle_deg: 3, axis: [0, 0, 1]}}}",
    "target: {motion: !Waypoints {}, model: wedge}\ncontroller: {gains: !NaturalFrequency {}}",
    "disturbances: [!Brightness {offset: 0.1}, !ColorTemperature {}]\nservo: follow\nmethod: ga",
]
GRIDS = [
    (ROOT / "scenarios" / "population_size.yaml").read_text(encoding="utf-8"),
    "grid: {method: [ga, mff], hand_path.omega: [0.1, 0.3]}\nseeds: [1, 2]\n",
    "{scenario: {seed: 3}, grid: {camera.width: [320, 640]}, seeds: 2}",
]


def keys_of(data, path=()):
    """All dotted keys of nested mappings, those of sections, too."""
    for key, value in data.items():
        yield ".".join((*path, key))
        if isinstance(value, dict):
            yield from keys_of(value, (*path, key))


KEYS = [key for key in keys_of(plain(mff.Scenario())) if "_tag" not in key]
LEAVES = st.one_of(
    ODD_NUMBERS,
    st.integers(),
    st.sampled_from([2**63, 2**64, -(2**63), 10**400, 0, 1, 2, 640, -1]),
    st.booleans(),
    st.none(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["mff", "ga", "borders", "well_damped", "vtk", "\0", "x" * 5000, "_tag"]),
)
TAGS = st.sampled_from(
    [
        "!Rpy",
        "!Borders",
        "!Follow",
        "!GaussianNoise",
        "!Black",
        "!Occluder",
        "!Sinusoids",
        "!Waypoints",
        "!Foo",
        "",
        "Rpy",
        3,
        None,
    ]
)
NAMES = st.one_of(
    st.sampled_from(sorted({part for key in KEYS for part in key.split(".")})), st.text(max_size=4)
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(NAMES, inner, max_size=3),
        st.builds(lambda tag, data: data | {"_tag": tag}, TAGS, st.dictionaries(NAMES, inner)),
    ),
    max_leaves=6,
)
CHANGES = st.dictionaries(st.one_of(st.sampled_from(KEYS), st.text(max_size=6)), VALUES, max_size=4)


def check_round_trip(scenario):
    """A scenario that was read is written and read back, to the last bit."""
    if scenario is not None:
        again = mff.LoadScenario(text=scenario.Dump())
        assert again.fingerprint == scenario.fingerprint


@prop(CHANGES)
def test_any_values_of_the_real_keys_are_taken_or_told(values):
    check_round_trip(outcome(mff.Change, mff.Scenario(), values, error=mff.ScenarioError))


@prop(CHANGES)
def test_any_yaml_of_the_real_keys_is_taken_or_told(values):
    nested = {}
    for key, value in values.items():
        *sections, name = key.split(".")
        inner = nested
        for section in sections:
            below = inner.setdefault(section, {})
            inner[section] = inner = below if isinstance(below, dict) else {}
        inner[name] = value
    text = yaml.safe_dump(nested) if len(nested) % 2 else json.dumps(nested)
    check_round_trip(outcome(mff.LoadScenario, text=text, error=mff.ScenarioError))


@prop(mutated(TEXTS))
def test_any_damaged_scenario_is_taken_or_told(text):
    check_round_trip(outcome(mff.LoadScenario, text=text, error=mff.ScenarioError))


@prop(st.one_of(mutated([text.encode() for text in TEXTS]), st.binary(max_size=40)), share=0.5)
def test_any_bytes_of_a_scenario_file_are_taken_or_told(tmp_path_factory, data):
    file = tmp_path_factory.getbasetemp() / "scenario.yaml"
    file.write_bytes(data)
    check_round_trip(outcome(mff.LoadScenario, file, error=mff.ScenarioError))


@example("seeds: [1, 2]")
@prop(mutated(GRIDS))
def test_any_damaged_grid_is_taken_or_told(tmp_path_factory, text):
    file = tmp_path_factory.getbasetemp() / "grid.yaml"
    file.write_bytes(text.encode(errors="surrogatepass"))
    grid = outcome(mff.LoadGrid, file, error=mff.ScenarioError)
    if grid is not None and len(grid.runs) < 100:
        file.write_text(grid.Dump(), encoding="utf-8")
        again = mff.LoadGrid(file)
        assert [(run.labels, run.scenario.fingerprint) for run in again.runs] == [
            (run.labels, run.scenario.fingerprint) for run in grid.runs
        ]


@prop(
    st.dictionaries(
        st.sampled_from(["scenario", "grid", "seeds", "x"]),
        st.one_of(VALUES, st.dictionaries(st.sampled_from(KEYS), st.lists(VALUES, max_size=3))),
    )
)
def test_any_values_of_a_grid_are_taken_or_told(data):
    outcome(mff.MakeGrid, data, error=mff.ScenarioError)
