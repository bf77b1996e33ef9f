"""Figures of constructed records against closed forms, and the files and the table made of them."""

import csv
import json
import math
from importlib.metadata import version

import numpy as np
import pytest

from mffdrake.experiment.paper.report import tables
from mffdrake.experiment.paper.study import Study, Summarize
from mffdrake.experiment.runs import table
from mffdrake.experiment.runs.engine import EndedRun, PlannedRun
from mffdrake.experiment.runs.store import Record, Versions
from mffdrake.experiment.runs.table import (
    GroupRows,
    MakeTable,
    MarkdownTable,
    WriteJson,
    WriteRows,
)
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation import evaluation
from mffdrake.experiment.simulation.evaluation import SETTLED_AFTER, Column, Evaluate
from mffdrake.experiment.simulation.recovery import RECOVERY
from mffdrake.experiment.simulation.simulation import SimulationResult

STAGES = {"render": 8.0, "recognition": 2.0, "prediction": 0.5, "total": 12.5}
RMS_KEYS = ["x_mm", "y_mm", "z_mm", "eps1", "eps2", "eps3", "position_mm", "rotation_deg"]
SETTINGS = ["start", "coding", "refinement", "renderer"]  # Beyond what the issue lists.
ROW_KEYS = [
    "method", "omega", "seed", *SETTINGS, "duration", "frames", "mean_fitness",
    "mean_fitness_settled", "rms", "rms_settled", "tracking", "rms_tracked", "recovery", "wall_s",
    "realtime_factor", "stages_ms", "symmetries",
]  # fmt: skip


def make_result(time, *, true=0.0, recognized=0.0, fitness=1.0, state=1, wall_s=4.0, **scenario):
    """A record with these poses, shape (6,) or (K, 6), and nothing remarkable besides."""
    text = "{" + ", ".join(f"{key}: {value}" for key, value in scenario.items()) + "}"
    count = len(time)
    return SimulationResult(
        scenario=LoadScenario(text=text).Dump(),
        time=np.asarray(time, dtype=float),
        true_pose=np.broadcast_to(true, (count, 6)).astype(float),
        recognized_pose=np.broadcast_to(recognized, (count, 6)).astype(float),
        fitness=np.broadcast_to(fitness, (count,)).astype(float),
        state=np.broadcast_to(state, (count,)).astype(float),
        confidence=np.full(count, np.nan),
        is_tracking=np.broadcast_to(np.asarray(state) == 1, (count,)).astype(float),
        desired_hand_pose=np.zeros((count, 6)),
        actual_hand_pose=np.zeros((count, 6)),
        joint_positions=np.zeros((count, 7)),
        joint_velocities=np.zeros((count, 7)),
        stages_ms=dict(STAGES),
        wall_s=wall_s,
    )


LONG = 0.5 * np.arange(21)  # 0 s to 10 s; half of it and one frame are settled.
SHORT = 0.1 * np.arange(10)


# One row.


def test_a_perfect_recognition_has_no_error():
    pose = [0.01, 0.15, 0.8, 0.1, -0.2, 0.3]
    row = Evaluate(make_result(LONG, true=pose, recognized=pose))
    for rms in (row["rms"], row["rms_settled"]):
        assert list(rms) == RMS_KEYS
        assert all(value == pytest.approx(0.0, abs=1e-5) for value in rms.values())
    assert row["mean_fitness"] == row["mean_fitness_settled"] == 1.0


def test_constant_errors_are_their_own_rms():
    true = np.array([0.01, 0.15, 0.8, 0.0, 0.0, 0.0])
    error = np.array([0.003, -0.004, 0.012, 0.0, 0.0, 0.0])
    rms = Evaluate(make_result(LONG, true=true, recognized=true + error))["rms"]
    assert rms["x_mm"] == pytest.approx(3.0)
    assert rms["y_mm"] == pytest.approx(4.0)
    assert rms["z_mm"] == pytest.approx(12.0)
    assert rms["position_mm"] == pytest.approx(13.0)
    assert rms["rotation_deg"] == pytest.approx(0.0, abs=1e-5)


def test_a_sine_has_the_rms_of_its_amplitude_over_root_two():
    phase = 2.0 * math.pi * np.arange(100) / 100
    recognized = np.zeros((100, 6))
    recognized[:, 0] = 0.010 * np.sin(phase)
    recognized[:, 2] = 0.010 * np.cos(phase)
    recognized[:, 4] = 0.020 * np.sin(phase)
    rms = Evaluate(make_result(0.01 * np.arange(100), recognized=recognized))["rms"]
    assert rms["x_mm"] == pytest.approx(10.0 / math.sqrt(2.0))
    assert rms["z_mm"] == pytest.approx(10.0 / math.sqrt(2.0))
    assert rms["position_mm"] == pytest.approx(10.0)
    assert rms["eps2"] == pytest.approx(0.020 / math.sqrt(2.0))


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -1, 0), (2, 3, 6)])
def test_the_rotation_error_is_the_angle_between_the_orientations(axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    true = np.concatenate([np.zeros(3), math.sin(math.radians(10.0)) * axis])  # 20 deg
    recognized = np.concatenate([np.zeros(3), math.sin(math.radians(17.5)) * axis])  # 35 deg
    rms = Evaluate(make_result(LONG, true=true, recognized=recognized))["rms"]
    assert rms["rotation_deg"] == pytest.approx(15.0)
    for k, name in enumerate(("eps1", "eps2", "eps3")):
        assert rms[name] == pytest.approx(abs(recognized[3 + k] - true[3 + k]), abs=1e-12)


def test_rotation_errors_about_different_axes_compose():
    half = math.sin(math.radians(45.0))  # 90 deg about x, then about y: 120 deg apart
    row = Evaluate(make_result(LONG, true=[0, 0, 0, half, 0, 0], recognized=[0, 0, 0, 0, half, 0]))
    assert row["rms"]["rotation_deg"] == pytest.approx(120.0)


def test_settled_figures_are_those_from_five_seconds_on():
    assert SETTLED_AFTER == 5.0
    late = LONG >= 5.0
    recognized = np.zeros((len(LONG), 6))
    recognized[:, 0] = np.where(late, 0.001, 0.100)
    recognized[LONG == 5.0, 0] = 0.003  # Belongs to the settled ones.
    fitness = np.where(late, 0.9, 0.2)
    row = Evaluate(make_result(LONG, recognized=recognized, fitness=fitness))
    settled = 10 * 1.0**2 + 3.0**2
    assert row["rms_settled"]["x_mm"] == pytest.approx(math.sqrt(settled / 11))
    assert row["rms_settled"]["position_mm"] == pytest.approx(math.sqrt(settled / 11))
    assert row["mean_fitness_settled"] == pytest.approx(0.9)
    assert row["rms"]["x_mm"] == pytest.approx(math.sqrt((settled + 10 * 100.0**2) / 21))
    assert row["mean_fitness"] == pytest.approx((11 * 0.9 + 10 * 0.2) / 21)


def test_where_nothing_is_settled_the_settled_figures_are_none():
    row = Evaluate(make_result(SHORT, recognized=0.001, fitness=0.5))
    assert row["mean_fitness_settled"] is None
    assert row["rms_settled"] == dict.fromkeys(RMS_KEYS)
    assert row["mean_fitness"] == 0.5
    assert row["rms"]["x_mm"] == pytest.approx(1.0)


def test_tracked_figures_are_those_of_the_frames_that_the_tracker_calls_good():
    tracks = np.arange(len(SHORT)) % 2
    recognized = np.zeros((len(SHORT), 6))
    recognized[:, 0] = np.where(tracks == 1, 0.002, 0.1)
    row = Evaluate(make_result(SHORT, recognized=recognized, state=tracks))
    assert row["rms_tracked"]["position_mm"] == pytest.approx(2.0)
    assert row["tracking"] == {"right": 0.5, "says_so": 0.5, "false": 0.0, "missed": 0.0}
    never = Evaluate(make_result(SHORT, recognized=recognized, state=0))
    assert never["rms_tracked"] == dict.fromkeys(RMS_KEYS)
    assert never["tracking"]["missed"] == 0.5


def test_frames_to_recover_follow_the_scenarios_outage():
    recognized = np.zeros((len(SHORT), 6))
    recognized[3:8, 0] = 0.1
    black = "[!Black {starts: [0.3], duration: 0.2}]"
    row = Evaluate(make_result(SHORT, recognized=recognized, disturbances=black))
    assert row["recovery"] == {
        "first_right": 0, "longest_wrong": 5, "after_outage": 3, "recovered": True,
    }  # fmt: skip
    assert Evaluate(make_result(SHORT))["recovery"]["recovered"] is None


def test_a_row_tells_what_was_run_and_how_fast():
    result = make_result(
        SHORT, wall_s=0.5, method="ga", seed=7, duration=1.0, hand_path="{omega: 0.157}",
        recognizer="{start: near_target, coding: gray}",
    )  # fmt: skip
    row = Evaluate(result)
    assert list(row) == ROW_KEYS
    expected = {
        "method": "ga", "omega": 0.157, "seed": 7, "start": "near_target", "coding": "gray",
        "refinement": "none",
        "renderer": "vtk", "duration": 1.0, "frames": 10, "wall_s": 0.5, "realtime_factor": 2.0,
        "stages_ms": STAGES,
    }  # fmt: skip
    assert {key: row[key] for key in expected} == expected


# Medians over the seeds.


def rows_of_seeds(errors, fitness=None, time=LONG, **scenario):
    """One row a seed, with these position errors [m]."""
    fitness = [1.0] * len(errors) if fitness is None else fitness
    return [
        Evaluate(make_result(time, recognized=[e, 0, 0, 0, 0, 0], fitness=f, seed=k, **scenario))
        for k, (e, f) in enumerate(zip(errors, fitness, strict=True))
    ]


def test_medians_are_of_the_seeds_of_one_method_and_speed():
    rows = [
        *rows_of_seeds([0.001, 0.090, 0.003], [0.9, 0.1, 0.8], method="mff"),
        *rows_of_seeds([0.010, 0.030], [0.6, 0.5], method="ga"),
        *rows_of_seeds([0.007], [0.7], method="ga", hand_path="{omega: 0.314}"),
    ]
    groups = GroupRows(rows, ("method", "omega"))
    assert [(*group.labels.values(), len(group.done)) for group in groups] == [
        ("mff", 0.105, 3), ("ga", 0.105, 2), ("ga", 0.314, 1),
    ]  # fmt: skip

    def medians(name):
        return [group.Quartiles(name).median for group in groups]

    assert medians("rms.x_mm") == pytest.approx([3.0, 20.0, 7.0])
    assert medians("rms_settled.x_mm") == pytest.approx([3.0, 20.0, 7.0])
    assert medians("mean_fitness") == pytest.approx([0.8, 0.55, 0.7])
    assert medians("mean_fitness_settled") == pytest.approx([0.8, 0.55, 0.7])
    assert medians("realtime_factor")[0] == pytest.approx(10.0)  # 40 s in 4 s


def test_medians_of_figures_that_are_missing_are_missing():
    (group,) = GroupRows(rows_of_seeds([0.001, 0.003], time=SHORT), ("method",))
    assert group.Quartiles("mean_fitness_settled") is None
    assert group.Quartiles("rms_settled.position_mm") is None
    assert group.Quartiles("rms.position_mm").median == pytest.approx(2.0)


# Files.


def test_results_json_has_every_key_of_the_schema_in_order(tmp_path):
    rows = rows_of_seeds([0.001, 0.002])
    WriteJson({"runs": rows}, tmp_path / "results.json")
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]
    data = json.loads((tmp_path / "results.json").read_text())
    assert list(data) == ["runs", "versions"]
    assert data["runs"] == rows
    for run in data["runs"]:
        assert list(run) == ROW_KEYS
        assert list(run["rms"]) == list(run["rms_settled"]) == RMS_KEYS
        assert list(run["stages_ms"]) == ["render", "recognition", "prediction", "total"]


def test_missing_figures_are_null_in_json(tmp_path):
    WriteJson({"runs": rows_of_seeds([0.001], time=SHORT)}, tmp_path / "results.json")

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    data = json.loads((tmp_path / "results.json").read_text(), parse_constant=refuse)
    assert data["runs"][0]["mean_fitness_settled"] is None
    assert data["runs"][0]["rms_settled"]["z_mm"] is None


def test_versions_are_those_of_what_the_numbers_depend_on():
    versions = Versions()
    for package in ("mffdrake", "drake", "numpy", "numba"):
        assert versions[package] == version(package)
    assert versions["python"].count(".") == 2


def test_results_csv_has_one_line_a_run_and_a_column_a_figure(tmp_path):
    rows = rows_of_seeds([0.001, 0.002, 0.003])
    WriteRows(rows, tmp_path / "results.csv")
    assert len((tmp_path / "results.csv").read_text().splitlines()) == 1 + len(rows)
    with (tmp_path / "results.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    for line, row in zip(read, rows, strict=True):
        assert None not in line and None not in line.values()  # As many cells as columns.
        assert line["method"] == row["method"]
        assert int(line["seed"]) == row["seed"]
        assert float(line["rms.position_mm"]) == row["rms"]["position_mm"]
        assert float(line["rms_settled.eps3"]) == row["rms_settled"]["eps3"]
        assert float(line["stages_ms.total"]) == row["stages_ms"]["total"]
    columns = {key for key in ROW_KEYS if not isinstance(rows[0][key], dict)}
    columns |= {
        f"{section}.{key}" for section in ("rms", "rms_settled", "rms_tracked") for key in RMS_KEYS
    }
    columns |= {f"tracking.{key}" for key in ("right", "says_so", "false", "missed")}
    columns |= {f"recovery.{key}" for key in RECOVERY}
    columns |= {f"stages_ms.{stage}" for stage in STAGES}
    assert set(read[0]) == columns


def test_missing_figures_are_empty_in_csv(tmp_path):
    WriteRows(rows_of_seeds([0.001], time=SHORT), tmp_path / "results.csv")
    with (tmp_path / "results.csv").open(newline="") as file:
        (line,) = csv.DictReader(file)
    assert line["mean_fitness_settled"] == line["rms_settled.x_mm"] == ""
    assert float(line["mean_fitness"]) == 1.0


def test_a_failure_leaves_the_old_results_as_they_were(tmp_path):
    WriteJson({"runs": rows_of_seeds([0.001])}, tmp_path / "results.json")
    before = (tmp_path / "results.json").read_bytes()
    with pytest.raises(TypeError):
        WriteJson({"runs": [{"method": object()}]}, tmp_path / "results.json")
    assert (tmp_path / "results.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


# The table.


def cells(line):
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_the_table_is_markdown_with_a_line_for_each_speed_and_method():
    rows = [
        *rows_of_seeds([0.0012, 0.0034], [0.9, 0.8], method="ga"),
        *rows_of_seeds([0.0100], [0.5], method="mff", hand_path="{omega: 0.314}"),
    ]
    lines = MarkdownTable(rows).splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert all(line.startswith("|") and line.endswith("|") for line in table)
    header, rule, *body = map(cells, table)
    assert all(len(line) == len(header) for line in (rule, *body))
    assert all(set(cell) <= set(":-") for cell in rule)
    assert "omega [rad/s]" in header and "position [mm]" in header and "rotation [deg]" in header
    first, second = (dict(zip(header, line, strict=True)) for line in body)
    assert (first["omega [rad/s]"], first["method"], first["seeds"]) == ("0.105", "ga", "2")
    assert (second["omega [rad/s]"], second["method"], second["seeds"]) == ("0.314", "mff", "1")
    assert (first["fitness"], second["fitness"]) == ("0.850", "0.500")
    assert (first["x [mm]"], second["x [mm]"]) == ("2.30", "10.00")
    assert (first["position [mm]"], second["position [mm]"]) == ("2.30", "10.00")
    assert first["real-time factor"] == "10.00"


def test_the_table_shows_settled_figures_and_says_so():
    late = LONG >= SETTLED_AFTER
    recognized = np.zeros((len(LONG), 6))
    recognized[:, 1] = np.where(late, 0.002, 0.1)
    table = MarkdownTable([Evaluate(make_result(LONG, recognized=recognized))])
    header, _, body = (cells(line) for line in table.splitlines()[:3])
    assert dict(zip(header, body, strict=True))["y [mm]"] == "2.00"
    assert "after the first 5 s" in table.splitlines()[-1]


def test_the_table_of_short_runs_shows_all_frames_and_says_so():
    rows = rows_of_seeds([0.004], time=SHORT) + rows_of_seeds([0.006], time=LONG)
    table = MarkdownTable(rows)
    header, _, body = (cells(line) for line in table.splitlines()[:3])
    assert dict(zip(header, body, strict=True))["x [mm]"] == "5.00"
    assert "all frames" in table.splitlines()[-1]


# A new column.


def test_one_line_adds_a_figure_to_every_row_file_and_table(tmp_path, monkeypatch):
    new = Column("jitter", float, lambda run: 0.25, "jitter", ".2f", shown=True)
    monkeypatch.setattr(evaluation, "COLUMNS", (*evaluation.COLUMNS, new))
    monkeypatch.setattr(table, "COLUMNS", evaluation.COLUMNS)
    rows = rows_of_seeds([0.001, 0.002])
    assert [row["jitter"] for row in rows] == [0.25, 0.25]
    WriteRows(rows, tmp_path / "results.csv")
    header = (tmp_path / "results.csv").read_text().splitlines()[0]
    assert "jitter" in header.split(",")
    plan = [PlannedRun(scenario=LoadScenario(text="seed: 3"), labels={"a": 1})]
    ended = [EndedRun(run=plan[0], record=Record(row=rows[0]))]
    assert MakeTable(plan, ended)["jitter"].to_pylist() == [0.25]
    study = Study("a", "A", "?", "b", (), seeds=1)
    labels = {"study": "a", "label": "one", "curve": "c", "value": 0.0, "status": "done"}
    of_study = tables.StudyTable(Summarize([{**labels, "error": None, **rows[0]}]), study)
    for text in (MarkdownTable(rows), table.SummaryTable(rows, ("method",)), of_study):
        heading, _, line = (cells(line) for line in text.splitlines()[:3])
        assert dict(zip(heading, line, strict=True))["jitter"] == "0.25"
