"""Grids: their file, the order of their runs, and what is said of a wrong one."""

import re

import pytest

from mffdrake.experiment.runs.grid import LoadGrid, MakeGrid
from mffdrake.experiment.scenario.scenario import LoadScenario, ScenarioError


def combinations(grid):
    return [(*run.labels.values(), run.scenario.seed) for run in grid.runs]


def load(text, tmp_path, **options):
    file = tmp_path / "grid.yaml"
    file.write_text(text)
    return LoadGrid(file, **options)


def test_keys_vary_in_the_files_order_the_last_one_fastest_and_then_the_seeds(tmp_path):
    text = "grid:\n  method: [mff, ga]\n  hand_path.omega: [0.3, 0.1]\nseeds: 2"
    grid = load(text, tmp_path)
    assert combinations(grid) == [
        ("mff", 0.3, 0), ("mff", 0.3, 1), ("mff", 0.1, 0), ("mff", 0.1, 1),
        ("ga", 0.3, 0), ("ga", 0.3, 1), ("ga", 0.1, 0), ("ga", 0.1, 1),
    ]  # fmt: skip
    assert list(grid.values) == ["method", "hand_path.omega"]


@pytest.mark.parametrize(
    ("seeds", "expected"), [("", [5]), ("seeds: 3", [5, 6, 7]), ("seeds: [9, 2]", [9, 2])]
)
def test_seeds_are_a_number_from_the_scenarios_on_or_a_list(seeds, expected, tmp_path):
    grid = load(f"scenario: {{seed: 5}}\n{seeds}", tmp_path)
    assert combinations(grid) == [(seed,) for seed in expected]


def test_each_runs_scenario_is_what_loading_it_by_hand_gives(tmp_path):
    """Of all kinds of values: numbers, texts, null, lists, rotations, whole sections."""
    text = """
scenario: {duration: 2, recognizer: {coding: gray}}
grid:
  hand_path.omega: [1e-1, 0.314]
  recognizer.sampling.margin: [null, 0.004]
  target.X_WM.translation: [[1.7, 0.0, 0.45]]
  target.X_WM.rotation: [!Rpy {deg: [-80, 0, -90]}, !AngleAxis {angle_deg: 9, axis: [0, 0, 1]}]
  controller: [{gains: well_damped, kp: [7, 6, 5, 4, 3, 2, 1]}]
  predictor.mode: [velocity]
seeds: [4]
"""
    grid = load(text, tmp_path)
    assert len(grid.runs) == 8
    expected = LoadScenario(
        text="""
duration: 2
hand_path: {omega: 0.314}
recognizer: {coding: gray, sampling: {margin: null}}
target: {X_WM: {translation: [1.7, 0.0, 0.45], rotation: !Rpy {deg: [-80, 0, -90]}}}
controller: {gains: well_damped, kp: [7, 6, 5, 4, 3, 2, 1]}
predictor: {mode: velocity}
seed: 4
"""
    )
    assert grid.runs[4].scenario == expected
    for run in grid.runs:
        assert LoadScenario(text=run.scenario.Dump()) == run.scenario
    assert len({run.scenario.fingerprint for run in grid.runs}) == 8


def test_the_files_scenario_goes_on_top_of_the_given_one(tmp_path):
    given = LoadScenario(text="{duration: 3, camera: {width: 64, height: 48}}")
    before = given.Dump()
    grid = load("scenario: {duration: 2, camera: {width: 32}}", tmp_path, scenario=given)
    scenario = grid.runs[0].scenario
    assert (scenario.duration, scenario.camera.width, scenario.camera.height) == (2, 32, 48)
    assert given.Dump() == before


def test_what_a_grid_writes_reads_back_as_the_same_runs(tmp_path):
    text = """
scenario: {seed: 3, recognizer: {sampling: {margin: null}}}
grid:
  target.X_WM.rotation: [!Rpy {deg: [-80, 0, -90]}]
  target.X_WM.translation: [[1.7, 0.0, 0.45]]
  target.model: [package://mffdrake/target_box.sdf]
  method: [ga, mff]
seeds: 2
"""
    grid = load(text, tmp_path)
    assert load(grid.Dump(), tmp_path).runs == grid.runs


def test_runs_share_nothing_with_the_mapping_that_they_were_made_of():
    data = {"grid": {"target.X_WM.translation": [[1.7, 0.0, 0.45]]}}
    grid = MakeGrid(data)
    data["grid"]["target.X_WM.translation"][0][0] = 9.0
    assert grid.runs[0].labels == {"target.X_WM.translation": [1.7, 0.0, 0.45]}


def test_values_that_are_good_together_only_are_good(tmp_path):
    text = """
scenario: {recognizer: {refinement: borders}}
grid: {recognizer.refinement.fine_window: [3, 10], recognizer.refinement.window: [12, 16]}
"""
    grid = load(text, tmp_path)
    windows = [
        (run.scenario.recognizer.refinement.fine_window, run.scenario.recognizer.refinement.window)
        for run in grid.runs
    ]
    assert windows == [(3, 12), (3, 16), (10, 12), (10, 16)]
    assert load(grid.Dump(), tmp_path).runs == grid.runs


BAD = {
    "empty": ("", "must be a mapping with some of the keys scenario, grid, seeds"),
    "a list": ("[1, 2]", "must be a mapping"),
    "no YAML": ("grid: {a: ", "not YAML: line 2"),
    "unknown key": ("gird: {}", "unknown key 'gird'.*did you mean 'grid'.*scenario, grid, seeds"),
    "scenario null": ("scenario:", "scenario must be a mapping.*None"),
    "scenario's key": ("scenario: {durtion: 1}", "scenario: unknown key 'durtion'.*'duration'"),
    "scenario's value": ("scenario: {duration: -1}", "scenario: duration must be positive.*-1"),
    "grid a list": ("grid: [1]", r"grid must be a mapping.*not \[1\]"),
    "grid empty": ("grid: {}", "grid has no keys"),
    "unknown scenario key": (
        "grid: {hand_path.omga: [0.1]}",
        "grid: hand_path.omga: unknown key 'omga' in hand_path.*did you mean 'omega'",
    ),
    "unknown key without a list": ("grid: {metod: ga}", "grid: metod: unknown key.*'method'"),
    "below a value": ("grid: {duration.s: [1]}", "grid: duration.s: duration must be a number"),
    "key a number": ("grid: {1: [1]}", "grid: a key must be a scenario's key.*1"),
    "seed": ("grid: {seed: [1, 2]}", "'seed' cannot be varied here.*'seeds'"),
    "no list": ("grid: {method: ga}", "grid: method must be a list of values, not 'ga'"),
    "empty list": ("grid: {method: []}", "grid: method must be a list of values, not an empty"),
    "wrong type": (
        "grid: {hand_path.omega: [0.1, fast]}", "grid: hand_path.omega must be a number.*'fast'"
    ),
    "wrong choice": ("grid: {method: [ga, best]}", "grid: .*method must be one of ga, mff.*'best'"),
    "wrong range": ("grid: {hand_path.omega: [-1]}", "grid: .*omega must be at least 0.*-1"),
    "wrong together": (
        "grid: {recognizer.local_share: [0.8], recognizer.newcomer_share: [0.1, 0.3]}",
        "with recognizer.local_share 0.8, recognizer.newcomer_share 0.3: .*must not exceed 1",
    ),
    "twice": ("grid: {hand_path.omega: [1, 2, 1.0]}", "hand_path.omega has the value 1.0 twice"),
    "a key twice": ("grid: {method: [ga], method: [mff]}", "the key 'method' stands there twice"),
    "overlap": (
        "grid: {hand_path: [{omega: 0.1}], hand_path.omega: [0.1]}",
        "'hand_path.omega' and 'hand_path' overlap",
    ),
    "seeds 0": ("seeds: 0", "seeds must be a positive whole number or a list.*0"),
    "seeds true": ("seeds: true", "seeds must be a positive whole number.*True"),
    "seeds text": ("seeds: [1, two]", "seeds must be a positive.*two"),
    "seeds empty": ("seeds: []", "seeds must be a positive"),
    "seeds twice": ("seeds: [1, 2, 1]", "seeds: the list has the value 1 twice"),
    "seed negative": ("seeds: [-1]", "a seed must be at least 0.*-1"),
    "seed too large": ("seeds: [9223372036854775808]", r"below 2\^63"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_grid_is_an_error_of_one_line_that_names_the_file(case, tmp_path):
    text, expected = BAD[case]
    with pytest.raises(ScenarioError) as error:
        load(text, tmp_path)
    (line,) = str(error.value).splitlines()
    assert line.startswith(f"{tmp_path / 'grid.yaml'}: ")
    assert re.search(expected, line), line


def test_a_file_that_is_no_text_is_an_error_that_names_it(tmp_path):
    (tmp_path / "grid.yaml").write_bytes("seeds: 3  # für später".encode("latin-1"))
    with pytest.raises(ScenarioError, match=r"grid\.yaml: not a text file in UTF-8"):
        LoadGrid(tmp_path / "grid.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seeds: 1000000000000", "seeds must be at most 100000, not 1000000000000"),
        (
            "grid: {duration: [1, 2], camera.width: [3, 4]}\nseeds: 50000",
            "grid: that makes 200000 runs, but 100000 are the most; list fewer values or seeds",
        ),
        (f"grid:\n  ? {'a.' * 2000}b\n  : [1]", "grid: a[.]a[.].*nested too deeply"),
        (f"grid:\n  ? {'x' * 5000}\n  : [1]", "unknown key 'xx"),
        (f"grid: {{camera.width: [{'x' * 5000}]}}", "camera.width must be a whole number, not 'xx"),
        (f"grid: {'x' * 5000}", "grid must be a mapping .*, not 'xx"),
        (f"seeds: {'x' * 5000}", "seeds must be a positive .*, not 'xx"),
        ("grid: {recognizer.refinement._tag: [[1]]}", "recognizer.refinement must be one of"),
        ("seeds: +3", "seeds must be a positive whole number .*, not '[+]3'"),
    ],
)
def test_what_would_never_end_or_fill_the_screen_is_refused_in_one_short_line(
    text, message, tmp_path
):
    with pytest.raises(ScenarioError, match=message) as caught:
        load(text, tmp_path)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 600
