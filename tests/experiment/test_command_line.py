"""The command line as a person meets it: real processes, their files, their words, their status."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest
from terminal import on_terminal

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import SimulationResult

NO_PROGRESS = {"TQDM_DISABLE": "1"}  # A busy machine would bring a line of it.
MODULE = [sys.executable, "-m", "mffdrake"]
SCRIPT = [str(Path(sys.executable).parent / "mffdrake")]
PROGRAMS = pytest.mark.parametrize("program", [MODULE, SCRIPT], ids=["module", "script"])
SMALL = "camera: {width: 160, height: 120}"
RMS = ["x_mm", "y_mm", "z_mm", "eps1", "eps2", "eps3", "position_mm", "rotation_deg"]


def mffdrake(*arguments, cwd, program=MODULE, **environment):
    """Runs the command line with nobody watching: all streams are pipes or files."""
    return subprocess.run(
        [*program, *map(str, arguments)],
        cwd=cwd, env=os.environ | NO_PROGRESS | environment, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def files(folder):
    """All files below a folder, hidden ones too."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def is_picture(path):
    image = cv2.imread(str(path))
    return image is not None and image.std() > 2.0


def no_constant(text):
    raise AssertionError(f"{text} is no JSON")


def read_json(path):
    return json.loads(path.read_text(), parse_constant=no_constant)


# One run.


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A scenario file, a text on top, options on top of both, everything else as it comes."""
    cwd = tmp_path_factory.mktemp("run")
    (cwd / "my.yaml").write_text(
        "seed: 1\nduration: 9\nhand_path: {omega: 0.3}\nrecognizer: {population_size: 40}\n" + SMALL
    )
    text = "{recognizer: {coding: gray, start: near_target}, predictor: {mode: velocity}, seed: 2}"
    finished = mffdrake(
        "run", "--scenario-file", "my.yaml", "--scenario-text", text,
        "--duration", 0.5, "--seed", 3, "--method", "mff", "--omega", 0.2, "--renderer", "vtk",
        cwd=cwd,
    )  # fmt: skip
    assert finished.returncode == 0, finished.stderr
    return cwd, finished


def only_progress(stderr):
    """A run that takes long says now and then how far it is, in a line of its own."""
    return all(
        re.match(r"mffdrake: simulat\w+: \d+ % after ", line) for line in stderr.splitlines()
    )


def test_run_says_how_far_it_is_and_no_more(run):
    assert only_progress(run[1].stderr)


def test_run_writes_what_is_promised_into_out(run):
    cwd, _ = run
    names = set(files(cwd / "out"))
    assert names >= {"result.npz", "results.json", "scenario.yaml"}
    pictures = {name for name in names if name.endswith(".png")}
    assert len(pictures) >= 3
    assert names == pictures | {"result.npz", "results.json", "scenario.yaml"}
    assert all(is_picture(cwd / "out" / name) for name in pictures)
    assert files(cwd) == sorted(["my.yaml", *(f"out/{name}" for name in names)])


def test_runs_results_json_has_the_promised_keys(run):
    data = read_json(run[0] / "out" / "results.json")
    assert list(data) == ["runs", "versions"]
    (row,) = data["runs"]
    assert set(row) >= {
        "method", "omega", "seed", "duration", "frames", "mean_fitness", "mean_fitness_settled",
        "rms", "rms_settled", "wall_s", "realtime_factor", "stages_ms",
    }  # fmt: skip
    assert list(row["rms"]) == list(row["rms_settled"]) == RMS
    assert list(row["stages_ms"]) == ["render", "recognition", "prediction", "total"]
    assert set(data["versions"]) >= {"mffdrake", "drake", "numpy"}
    assert row["mean_fitness_settled"] is None  # Nothing is settled within half a second.
    assert 0.0 < row["mean_fitness"] <= 1.0
    assert row["frames"] == 16


def test_options_go_on_top_of_the_text_which_goes_on_top_of_the_file(run):
    (row,) = read_json(run[0] / "out" / "results.json")["runs"]
    result = SimulationResult.Load(run[0] / "out" / "result.npz")
    scenario = LoadScenario(text=result.scenario)
    assert (row["seed"], row["duration"], row["omega"]) == (3, 0.5, 0.2)
    assert (scenario.seed, scenario.duration, scenario.hand_path.omega) == (3, 0.5, 0.2)
    assert scenario.recognizer.coding == "gray"
    assert scenario.predictor.mode == "velocity"
    assert scenario.recognizer.population_size == 40
    assert scenario.camera.width == 160


def test_runs_result_npz_holds_every_frame(run):
    result = SimulationResult.Load(run[0] / "out" / "result.npz")
    np.testing.assert_array_equal(result.time, 33 * np.arange(16) * 0.001)
    for poses in (
        result.true_pose, result.recognized_pose, result.desired_hand_pose, result.actual_hand_pose
    ):  # fmt: skip
        assert poses.shape == (16, 6)
    assert result.joint_positions.shape == (16, 7)
    assert result.fitness.shape == (16,)


def test_run_prints_a_table_the_stage_times_and_where_the_results_are(run):
    output = run[1].stdout
    table = [line for line in output.splitlines() if line.startswith("|")]
    assert len(table) == 3
    assert "0.2 | mff | 1 |" in table[2]
    for stage in ("render", "recognition", "prediction", "total"):
        assert re.search(rf"\b{stage} \d+\.\d", output)
    assert "out" in output.splitlines()[-1]


def test_the_same_seed_gives_the_same_numbers_in_another_process(run, tmp_path):
    cwd, _ = run
    text = SimulationResult.Load(cwd / "out" / "result.npz").scenario
    finished = mffdrake("run", "--scenario-text", text, "--out", "again", cwd=tmp_path)
    assert finished.returncode == 0, finished.stderr
    first, again = (
        SimulationResult.Load(folder / "result.npz") for folder in (cwd / "out", tmp_path / "again")
    )
    assert first.scenario == again.scenario
    for name in ("recognized_pose", "fitness", "true_pose", "joint_positions", "joint_velocities"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()


@PROGRAMS
def test_run_draws_the_diagram_and_records_a_replay(program, tmp_path):
    suffix = "svg" if program is MODULE else "png"
    finished = mffdrake(
        "run", "--duration", 0.1, "--scenario-text", SMALL, "--out", "results",
        "--graphviz", f"pictures/diagram.{suffix}", "--replay", "replays/mine.html",
        cwd=tmp_path, program=program,
    )  # fmt: skip
    assert finished.returncode == 0, finished.stderr
    if suffix == "svg":
        text = " ".join(ET.parse(tmp_path / "pictures" / "diagram.svg").getroot().itertext())
        assert "recognizer" in text and "predictor" in text
    else:
        assert is_picture(tmp_path / "pictures" / "diagram.png")
    html = (tmp_path / "replays" / "mine.html").read_text()
    assert len(html) > 100_000
    others = [name for name in files(tmp_path) if not name.startswith("results/")]
    assert others == [f"pictures/diagram.{suffix}", "replays/mine.html"]
    assert finished.stderr == ""  # Quiet, Meshcat too.


def test_verbose_says_more_and_the_same_comes_out(tmp_path):
    finished = mffdrake(
        "run", "--duration", 0.1, "--scenario-text", SMALL, "--replay", "a.html", "--verbose",
        cwd=tmp_path,
    )  # fmt: skip
    assert finished.returncode == 0
    assert "INFO" in finished.stderr
    assert "Traceback" not in finished.stderr
    assert {"out/result.npz", "out/results.json"} <= set(files(tmp_path))


def test_a_target_outside_the_search_range_is_a_warning(tmp_path):
    finished = mffdrake(
        "run", "--duration", 0.1, "--scenario-text",
        "{camera: {width: 160, height: 120}, recognizer: {search_range: {z: [0.4, 0.7]}}}",
        cwd=tmp_path,
    )  # fmt: skip
    assert finished.returncode == 0
    (line,) = finished.stderr.splitlines()
    assert re.search(r"WARNING.*outside the search range.*search_range\.z", line)
    assert "out/results.json" in files(tmp_path)


# A comparison.


@pytest.fixture(scope="module")
def compare(tmp_path_factory):
    cwd = tmp_path_factory.mktemp("compare")
    finished = mffdrake(
        "compare", "--methods", "ga", "mff", "--omega", 0.314, 0.157, "--seeds", 2, "--seed", 5,
        "--workers", 2, "--duration", 0.2, "--scenario-text", SMALL, "--out", "a/b",
        "--graphviz", "diagram.png", "--replay", "replay.html",
        cwd=cwd, program=SCRIPT,
    )  # fmt: skip
    assert finished.returncode == 0, finished.stderr
    return cwd, finished


RUNS = [
    (omega, method, seed) for omega in (0.314, 0.157) for method in ("ga", "mff") for seed in (5, 6)
]


def test_compare_says_how_far_it_is_and_no_more(compare):
    assert only_progress(compare[1].stderr)


def test_compare_writes_what_is_promised(compare):
    cwd, _ = compare
    names = set(files(cwd / "a" / "b"))
    records = {name for name in names if name.startswith("records/")}
    pictures = {name for name in names if name.endswith(".png")}
    assert names == pictures | records | {
        "results.json", "results.csv", "runs.sqlite", "scenario.yaml",
    }  # fmt: skip
    assert len(records) == len(read_json(cwd / "a" / "b" / "results.json")["runs"])
    assert len(pictures) >= 3
    assert all(is_picture(cwd / "a" / "b" / name) for name in pictures)
    others = [name for name in files(cwd) if not name.startswith("a/b/")]
    assert others == ["diagram.png", "replay.html"]
    assert is_picture(cwd / "diagram.png")
    assert (cwd / "replay.html").stat().st_size > 100_000


def test_compares_results_json_has_every_run(compare):
    data = read_json(compare[0] / "a" / "b" / "results.json")
    assert [(row["omega"], row["method"], row["seed"]) for row in data["runs"]] == RUNS
    assert all(row["frames"] == 7 and row["duration"] == 0.2 for row in data["runs"])
    assert all(list(row["rms"]) == RMS for row in data["runs"])


def test_compares_results_csv_has_one_line_a_run_with_the_same_numbers(compare):
    rows = read_json(compare[0] / "a" / "b" / "results.json")["runs"]
    with (compare[0] / "a" / "b" / "results.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [(float(r["omega"]), r["method"], int(r["seed"])) for r in lines] == RUNS
    for line, row in zip(lines, rows, strict=True):
        assert float(line["mean_fitness"]) == row["mean_fitness"]
        assert float(line["rms.position_mm"]) == row["rms"]["position_mm"]


def test_compare_prints_a_markdown_table_of_medians(compare):
    table = [line for line in compare[1].stdout.splitlines() if line.startswith("|")]
    header, rule, *body = ([c.strip() for c in line.strip("|").split("|")] for line in table)
    assert len(rule) == len(header)
    rows = [dict(zip(header, line, strict=True)) for line in body]
    assert [(row["omega [rad/s]"], row["method"], row["seeds"]) for row in rows] == [
        ("0.314", "ga", "2"), ("0.314", "mff", "2"), ("0.157", "ga", "2"), ("0.157", "mff", "2"),
    ]  # fmt: skip


# Help.


@PROGRAMS
@pytest.mark.parametrize(
    ("command", "options"),
    [
        ([], ["run", "compare", "sweep"]),
        (["run"], ["--method", "--omega"]),
        (["compare"], ["--methods", "--omega", "--seeds", "--workers", "--scheduler"]),
    ],
)
def test_help_lists_the_options(program, command, options, tmp_path):
    finished = mffdrake(*command, "--help", cwd=tmp_path, program=program)
    assert finished.returncode == 0
    assert finished.stderr == ""
    common = [
        "--scenario-file", "--scenario-text", "--duration", "--seed", "--renderer", "--out",
        "--graphviz", "--replay", "--verbose",
    ]  # fmt: skip
    for option in [*options, *(common if command else [])]:
        assert option in finished.stdout


# Bad input: one line, status 2, nothing left behind.

LATIN1 = "seed: 3  # für später".encode("latin-1")
BAD = {
    "no command": ([], "run.*compare"),
    "unknown command": (["walk"], "walk.*run.*compare"),
    "unknown option": (["run", "--omgea", "1"], "--omgea"),
    "superfluous word": (["run", "fast"], "fast"),
    "option of the other command": (["compare", "--method", "ga", "--workers", "x"], "--workers"),
    "option without value": (["run", "--duration"], "--duration"),
    "duration 0": (["run", "--duration", "0"], "--duration.*positive.*'0'"),
    "duration negative": (["run", "--duration", "-3"], "--duration.*positive.*'-3'"),
    "duration nan": (["run", "--duration", "nan"], "--duration.*positive.*'nan'"),
    "duration text": (["run", "--duration", "long"], "--duration.*'long'"),
    "duration below a tick": (["run", "--duration", "0.0004"], "duration"),
    "seed negative": (["run", "--seed", "-1"], "seed.*at least 0.*-1"),
    "seed text": (["run", "--seed", "one"], "--seed.*'one'"),
    "seed too large": (["run", "--seed", "1" + 25 * "0"], "seed"),
    "method": (["run", "--method", "best"], "method.*ga, mff.*'best'"),
    "renderer": (["run", "--renderer", "crayon"], "renderer.*vtk.*'crayon'"),
    "omega text": (["run", "--omega", "fast"], "--omega.*'fast'"),
    "omega negative": (["run", "--omega", "-1"], "omega.*-1"),
    "omega nan": (["run", "--omega", "nan"], "omega.*nan"),
    "omega too fast": (["run", "--omega", "50"], "S1.*velocity limit.*[Rr]educe.*omega"),
    "methods": (["compare", "--methods", "ga", "best"], "method.*ga, mff.*'best'"),
    "omegas": (["compare", "--omega", "0.1", "-1"], "omega.*-1"),
    "one omega too fast": (["compare", "--omega", "0.1", "50"], "velocity limit"),
    "seeds": (["compare", "--seeds", "0"], "--seeds.*positive whole number.*'0'"),
    "workers": (["compare", "--workers", "1.5"], "--workers.*positive whole number.*'1.5'"),
    "no file": (["run", "--scenario-file", "no.yaml"], "no.yaml.*No such file"),
    "file is a folder": (["run", "--scenario-file", "folder"], "folder.*[Ii]s a directory"),
    "file is not text": (["run", "--scenario-file", "latin1.yaml"], "latin1.yaml"),
    "file has an unknown key": (["run", "--scenario-file", "bad.yaml"], "bad.yaml: .*'omga'"),
    "unknown key": (["run", "--scenario-text", "durration: 3"], "'durration'.*'duration'"),
    "wrong type": (["run", "--scenario-text", "duration: long"], "duration.*a number.*'long'"),
    "negative size": (["run", "--scenario-text", "camera: {width: -1}"], "camera.width.*at least"),
    "negative period": (["run", "--scenario-text", "timing: {vision_period: -1}"], "vision_period"),
    "fast vision": (["run", "--scenario-text", "timing: {vision_period: .0005}"], "vision_period"),
    "not YAML": (["run", "--scenario-text", "{seed: "], "scenario text: .*YAML"),
    "unreachable path": (
        ["run", "--scenario-text", "hand_path: {X_WE0: {translation: [3, 0, 0.4]}}"],
        r"not reachable at t = 0.00 s.*X_WE0",
    ),
    "unreachable later": (
        ["compare", "--scenario-text", "hand_path: {amplitude_deg: 170, omega: 0.1}"],
        r"at t = \d+\.\d\d s: .*[Rr]educe",
    ),
    "target": (["run", "--scenario-text", "target: {model: no.sdf}"], "target.model.*no.sdf"),
    "pose not finite": (["run", "--scenario-text", "camera: {p_EC: [.inf, 0, 0]}"], "camera.p_EC"),
    "out is a file": (["run", "--out", "bad.yaml"], "bad.yaml"),
    "out is below a file": (["run", "--out", "bad.yaml/out"], "bad.yaml"),
    "out is not writable": (["compare", "--out", "/proc/out"], "/proc/out"),
    "graphviz suffix": (["run", "--graphviz", "diagram.pdf"], r"diagram.pdf.*\.svg or \.png"),
    "graphviz folder": (["run", "--graphviz", "/proc/new/diagram.svg"], "/proc/new"),
    "replay suffix": (["run", "--replay", "replay.mp4"], r"replay.mp4.*\.html"),
    "replay folder": (["run", "--replay", "bad.yaml/replay.html"], "bad.yaml"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_status_2(case, tmp_path):
    arguments, expected = BAD[case]
    (tmp_path / "folder").mkdir()
    (tmp_path / "bad.yaml").write_text("hand_path: {omga: 0.1}")
    (tmp_path / "latin1.yaml").write_bytes(LATIN1)
    program = MODULE if len(case) % 2 else SCRIPT  # Both, by turns.
    finished = mffdrake(*arguments, cwd=tmp_path, program=program)
    assert "Traceback" not in finished.stderr
    assert finished.returncode == 2
    assert finished.stdout == ""
    (line,) = finished.stderr.splitlines()
    assert line.startswith("mffdrake") and "error: " in line
    assert re.search(expected, line), line
    assert files(tmp_path) == ["bad.yaml", "latin1.yaml"]


@pytest.mark.parametrize("option", ["--graphviz", "--replay"])
def test_a_folder_in_the_place_of_a_file_is_an_error_that_names_it(option, tmp_path):
    name = {"--graphviz": "mine.svg", "--replay": "mine.html"}[option]
    (tmp_path / name).mkdir()
    finished = mffdrake(
        "run", option, name, "--duration", 0.1, "--scenario-text", SMALL, cwd=tmp_path
    )
    assert finished.returncode == 2
    (line,) = finished.stderr.splitlines()
    assert re.search(rf"(^|[\s/]){re.escape(name)}: .*directory", line), line
    assert files(tmp_path) == []


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
@pytest.mark.parametrize("command", ["run", "compare"])
def test_without_a_graphics_driver_the_error_has_the_command_that_helps(command, tmp_path):
    finished = mffdrake(
        command, "--duration", 0.1, cwd=tmp_path,
        __EGL_VENDOR_LIBRARY_FILENAMES="/nonexistent.json",
    )  # fmt: skip
    assert finished.returncode == 2
    (line,) = finished.stderr.splitlines()
    assert "cannot render" in line
    assert "sudo apt-get install " in line and "libgl1-mesa-dri" in line
    assert files(tmp_path) == []


def test_without_graphviz_the_error_has_the_command_that_helps(tmp_path):
    finished = mffdrake(
        "run", "--graphviz", "diagram.svg", "--duration", 0.1, "--scenario-text", SMALL,
        cwd=tmp_path, PATH=str(tmp_path),
    )  # fmt: skip
    assert finished.returncode == 2
    (line,) = finished.stderr.splitlines()
    assert "sudo apt-get install graphviz" in line
    assert files(tmp_path) == []


# On a terminal: a progress bar, and Ctrl-C.


def test_on_a_terminal_a_bar_shows_simulated_time_and_speed(tmp_path):
    status, shown = on_terminal("run", "--duration", 1, "--scenario-text", SMALL, cwd=tmp_path)
    assert status == 0
    bars = [line for line in re.split(r"[\r\n]+", shown) if line.startswith("simulated")]
    assert len(bars) >= 3
    assert re.search(r" 0%\|.*0\.0/1\.0 s", bars[0])
    assert re.search(r"100%\|.*1\.0/1\.0 s, \d+\.\d\d x real time", bars[-1])
    assert "| 0.105 | mff | 1 |" in shown  # The table comes after it, on lines of its own.


def test_ctrl_c_ends_a_run_with_status_130_and_keeps_its_first_frames(tmp_path):
    status, shown = on_terminal(
        "run", "--duration", 60, "--scenario-text", SMALL, "--replay", "replay.html",
        cwd=tmp_path, ctrl_c_at="x real time",
    )  # fmt: skip
    assert status == 130
    assert "Traceback" not in shown
    assert re.search(r"interrupted: these are the first \d+ frames", shown.splitlines()[-1])
    result = SimulationResult.Load(tmp_path / "out" / "result.npz")
    assert 0 < len(result.time) < 60 / 0.033
    assert read_json(tmp_path / "out" / "results.json")["runs"][0]["frames"] == len(result.time)


def test_ctrl_c_ends_a_comparison_and_its_processes_with_status_130_and_keeps_its_runs(tmp_path):
    status, shown = on_terminal(
        "compare", "--duration", 1, "--omega", 0.1, 0.2, "--scenario-text", SMALL, "--workers", 2,
        cwd=tmp_path, ctrl_c_at="1/4",
    )  # fmt: skip
    assert status == 130
    assert re.search(r"simulations: .*25%.*1/4", shown)
    assert "Traceback" not in shown
    assert "the same command goes on from there" in shown
    assert "interrupted" in shown.splitlines()[-1]
    left = [Path(file) for file in files(tmp_path)]
    assert {path.parent.name for path in left} == {"records", "out"}
    assert [path.name for path in left if path.parent.name == "out"] == ["runs.sqlite"]


@pytest.mark.parametrize("module", ["argparse", "numpy"])
def test_an_interrupt_while_the_program_loads_needs_no_traceback(module, tmp_path):
    """With ``-X importtime`` Python tells what it has loaded: these come before Drake."""
    command = [sys.executable, "-X", "importtime", "-m", "mffdrake", "run", "--duration", "60"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        for line in process.stderr:
            if module in line:
                process.send_signal(signal.SIGINT)
                break
        rest = [line for line in process.stderr if not line.startswith("import time:")]
    assert process.returncode in (130, -signal.SIGINT)  # A shell shows 130 for both.
    assert not any("Traceback" in line for line in rest), "".join(rest)
    assert files(tmp_path) == []
