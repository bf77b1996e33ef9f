"""Reproducing the paper's experiment: what it writes, keeps and says; how it goes on."""

import csv
import json
import multiprocessing
import os
import re
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from html.parser import HTMLParser

import cv2
import psutil
import pytest
from terminal import on_terminal
from worker_functions import wait_for

from mffdrake.experiment.paper.report.report import Reproduce
from mffdrake.experiment.paper.studies import MakeStudies
from mffdrake.experiment.paper.study import PlanRuns, RunStudies, Study, Summarize, Variant
from mffdrake.experiment.runs.executors.cluster import DaskCluster
from mffdrake.experiment.runs.executors.executors import InProcess
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.simulation import Simulate

NO_PROGRESS = {"TQDM_DISABLE": "1"}  # A busy machine would bring a line of it.
SMALL = "camera: {width: 64, height: 48}"
SHORT = ["reproduce", "--short", "--duration", 0.4, "--scenario-text", SMALL, "--workers", 2]
BASE = "{duration: 0.1, camera: {width: 64, height: 48}}"
PICTURES = ["fig6.png", "fig7.png", "fig7_fast.png", "fig8.png", "studies.png"]
RUNS = sum(len(study.variants) * study.seeds for study in MakeStudies(short=True))
NUMBERS = ["runs.csv", "runs.json", "runs.sqlite", "summary.json"]


def mffdrake(*arguments, cwd, **environment):
    return subprocess.run(
        [sys.executable, "-m", "mffdrake", *map(str, arguments)], cwd=cwd, text=True,
        env=os.environ | NO_PROGRESS | environment, stdin=subprocess.DEVNULL, capture_output=True,
        check=False,
    )  # fmt: skip


def stored(folder):
    with closing(sqlite3.connect(folder / "runs.sqlite")) as store:
        return dict(store.execute("SELECT key, row FROM runs WHERE status = 'done'").fetchall())


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def study(*variants, name="own", seeds=1):
    return Study(
        name=name, title="My own", question="Why not?", axis="speed", seeds=seeds,
        variants=tuple(
            Variant(label=label, curve="a", value=value, changes=(change,))
            for value, (label, change) in enumerate(variants)
        ),
    )  # fmt: skip


# The command.


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    cwd = tmp_path_factory.mktemp("short")
    finished = mffdrake(*SHORT, "--graphviz", "diagram.png", cwd=cwd)
    assert (finished.returncode, finished.stderr) == (0, "")
    return cwd, finished


def test_it_writes_all_that_is_promised_and_nothing_else(short):
    cwd, _ = short
    names = files(cwd / "out")
    records = [name for name in names if name.startswith("records/")]
    assert len(records) == 6 and all(name.endswith(".npz") for name in records)
    assert sorted({*names} - {*records}) == sorted(
        [*PICTURES, *NUMBERS, "report.html", "report.md"]
    )
    assert cv2.imread(str(cwd / "diagram.png")).std() > 5.0


def test_it_says_what_came_out_and_where(short):
    lines = short[1].stdout.splitlines()
    assert re.match(r"With feedforward, from a start near the target.* of 21 medians", lines[0])
    assert lines[-1] == "Report: out/report.md, and in one file: out/report.html"


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_show_something(name, short):
    image = cv2.imread(str(short[0] / "out" / name))
    assert min(image.shape[:2]) > 400
    assert image.std() > 15.0
    assert len({tuple(pixel) for pixel in image[::7, ::7].reshape(-1, 3).tolist()}) > 20


class Links(HTMLParser):
    """What a page wants from elsewhere, and its words."""

    def __init__(self, page):
        super().__init__()
        self.links, self.tags, self.words = [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name in ("src", "href", "srcset")]

    def handle_data(self, data):
        self.words += data


def test_the_page_needs_no_other_file(short):
    page = Links((short[0] / "out" / "report.html").read_text(encoding="utf-8"))
    assert len(page.links) == len(PICTURES)
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not {"script", "link", "iframe"} & set(page.tags)
    assert page.tags.count("table") == (short[0] / "out" / "report.md").read_text().count(
        "|---:|\n"
    )
    assert "|" not in page.words.replace("|cos|", "")  # Every table became one.


def test_the_text_shows_the_pictures_beside_it(short):
    text = (short[0] / "out" / "report.md").read_text(encoding="utf-8")
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text)
    assert sorted(shown) == sorted(PICTURES)
    assert all((short[0] / "out" / name).is_file() for name in shown)
    for study in MakeStudies(short=True):
        assert f"### {study.title}" in text


def test_numbers_are_the_same_everywhere(short):
    folder = short[0] / "out"
    rows = json.loads((folder / "runs.json").read_text())["runs"]
    with (folder / "runs.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(rows) == len(lines) == RUNS and {row["status"] for row in rows} == {"done"}
    for row, line in zip(rows, lines, strict=True):
        assert (row["study"], row["label"]) == (line["study"], line["label"])
        assert row["rms"]["position_mm"] == float(line["rms.position_mm"])
    variants = json.loads((folder / "summary.json").read_text())["variants"]
    assert [(v["study"], v["label"]) for v in variants] == [(r["study"], r["label"]) for r in rows]
    for row, variant in zip(rows, variants, strict=True):
        assert variant["all"]["mean_fitness"]["median"] == pytest.approx(row["mean_fitness"])
        assert variant["settled"]["mean_fitness"] is None  # Too short for that.


def test_a_second_call_runs_nothing_and_writes_the_same_report(short):
    folder = short[0] / "out"
    before, text = stored(folder), (folder / "report.md").read_bytes()
    times = {path: path.stat().st_mtime_ns for path in (folder / "records").iterdir()}
    finished = mffdrake(*SHORT, cwd=short[0])
    assert finished.returncode == 0 and finished.stdout == short[1].stdout
    assert stored(folder) == before  # With the times they took.
    assert {path: path.stat().st_mtime_ns for path in (folder / "records").iterdir()} == times
    assert (folder / "report.md").read_bytes() == text


def test_after_sigkill_the_same_command_goes_on(tmp_path):
    def some():
        assert process.poll() is None, process.stderr.read()
        try:
            return (tmp_path / "out" / "runs.sqlite").exists() and len(stored(tmp_path / "out")) > 2
        except sqlite3.OperationalError:  # The table is not there yet.
            return False

    with subprocess.Popen(
        [sys.executable, "-m", "mffdrake", *map(str, SHORT)], cwd=tmp_path,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | NO_PROGRESS,
    ) as process:  # fmt: skip
        try:
            wait_for(some, "three runs")
            children = psutil.Process(process.pid).children(recursive=True)
        finally:
            process.kill()
    wait_for(lambda: not any(child.is_running() for child in children), "the workers' end")
    before = stored(tmp_path / "out")
    assert not (tmp_path / "out" / "report.md").exists()
    assert 3 <= len(before) < RUNS
    finished = mffdrake(*SHORT, cwd=tmp_path)
    assert (finished.returncode, finished.stderr) == (0, "")
    after = stored(tmp_path / "out")
    assert len(after) == RUNS
    assert {key: after[key] for key in before} == before


def test_on_a_terminal_a_bar_shows_the_time_left_and_ctrl_c_keeps_what_is_done(tmp_path):
    status, shown = on_terminal(*SHORT, cwd=tmp_path, ctrl_c_at=f" 1/{RUNS} runs")
    assert status == 130
    assert "interrupted" in shown.splitlines()[-1] and "Traceback" not in shown
    time = r"\d\d:\d\d"
    assert re.search(rf"simulations: +\d+%\|.*\| 1/{RUNS} runs \[{time}<{time}\]", shown), shown
    assert 1 <= len(stored(tmp_path / "out")) < RUNS
    left = [name for name in files(tmp_path / "out") if not name.startswith("records/")]
    assert left == ["runs.sqlite"]


def test_help_lists_the_options_and_how_long_it_takes(tmp_path):
    finished = mffdrake("reproduce", "--help", cwd=tmp_path)
    assert (finished.returncode, finished.stderr) == (0, "")
    for option in (
        "--seeds", "--vtk-seeds", "--short", "--workers", "--scheduler", "--out", "--seed",
        "--duration", "--scenario-file", "--scenario-text", "--graphviz", "--verbose",
    ):  # fmt: skip
        assert option in finished.stdout
    assert "hour" in finished.stdout
    assert "--renderer" not in finished.stdout and "--replay" not in finished.stdout


WRONG = {
    "seeds": (["--seeds", "0"], "--seeds.*positive whole number.*'0'"),
    "vtk seeds": (["--vtk-seeds", "-1"], "--vtk-seeds.*from 0 on.*'-1'"),
    "both places": (["--workers", "2", "--scheduler", "x"], "not allowed with"),
    "no scheduler": (["--short", "--scheduler", "127.0.0.1:1"], "no Dask scheduler.*refused"),
    "unknown key": (["--scenario-text", "camra: {}"], "camra.*camera"),
    "duration": (["--duration", "0.0001"], "duration"),
    "the paper's own speed": (
        ["--short", "--scenario-text", "hand_path: {X_WE0: {translation: [3, 0, 0.4]}}"],
        r"omega 0.105 rad/s: .*not reachable",
    ),
    "out is a file": (["--short", "--out", "a.yaml"], "a.yaml"),
    "graphviz": (["--short", "--graphviz", "a.pdf"], r"a.pdf.*\.svg or \.png"),
    "foreign store": (["--short", "--out", "foreign"], "foreign/runs.sqlite: .*--out"),
}


@pytest.mark.parametrize("case", WRONG)
def test_bad_input_is_one_line_and_status_2(case, tmp_path):
    arguments, expected = WRONG[case]
    (tmp_path / "a.yaml").touch()
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "runs.sqlite").write_text("mine\n" * 999)
    finished = mffdrake("reproduce", *arguments, cwd=tmp_path)
    assert (finished.returncode, finished.stdout) == (2, "")
    (line,) = finished.stderr.splitlines()
    assert line.startswith("mffdrake") and "error: " in line
    assert re.search(expected, line), line


# From Python.


def test_a_speed_that_the_joints_do_not_allow_has_a_reason_instead_of_a_number(tmp_path):
    own = study(("slow", "method: ga"), ("too fast", "hand_path: {omega: 50}"), seeds=2)
    ended = []
    for _ in range(2):  # The answer would be the same, so it is not asked for twice.
        result = Reproduce(
            tmp_path, studies=[own], base=LoadScenario(text=BASE), executor=InProcess(),
            on_run=lambda one: ended.append((one.run.labels["label"], one.was_kept)),
        )  # fmt: skip
    assert sorted(ended[:4]) == [("slow", False)] * 2 + [("too fast", False)] * 2
    assert sorted(ended[4:]) == [("slow", True)] * 2 + [("too fast", True)] * 2
    assert [row["status"] for row in result.rows] == ["done"] * 2 + ["unreachable"] * 2
    assert result.Failures() == []
    (line,) = [
        line for line in (tmp_path / "report.md").read_text().splitlines() if "| too fast |" in line
    ]
    assert re.search(r"\| too fast \| 0 \| - \| - \| - \|.* velocity limit.* \|$", line)


def test_other_failures_are_told_and_tried_again(tmp_path):
    own = study(("good", "method: ga"), ("bad", "target: {model: no.sdf}"))
    statuses = []
    for _ in range(2):
        result = Reproduce(
            tmp_path, studies=[own], base=LoadScenario(text=BASE), executor=InProcess(),
            on_run=lambda one: statuses.append((one.status, one.was_kept)),
        )  # fmt: skip
    assert statuses == [
        ("done", False), ("failed", False), ("done", True), ("failed", False),
    ]  # fmt: skip
    (failure,) = result.Failures()
    assert "no.sdf" in failure["error"]
    assert "**1 run failed**" in (tmp_path / "report.md").read_text()


def test_runs_that_studies_share_are_run_once(tmp_path):
    studies = [study(("a", "method: ga"), name="one"), study(("b", "method: ga"), name="two")]
    ended = []
    result = RunStudies(
        studies, LoadScenario(text=BASE), tmp_path, executor=InProcess(), on_run=ended.append
    )
    assert len(ended) == len(stored(tmp_path)) == 1
    assert [(row["study"], row["label"]) for row in result.rows] == [("one", "a"), ("two", "b")]
    assert result.rows[0]["rms"] == result.rows[1]["rms"]


def test_rows_and_frames_are_what_simulating_by_hand_gives_also_when_a_worker_dies(tmp_path):
    (near,) = (s for s in MakeStudies(1, short=True) if s.name == "near")
    plan = PlanRuns([near], LoadScenario(text=BASE))
    killed = []

    def kill(one):
        if not killed:
            worker = multiprocessing.active_children()[0]
            worker.kill()
            killed.append(worker)

    base = LoadScenario(text=BASE)
    result = RunStudies([near], base, tmp_path, executor=LocalProcesses(2), on_run=kill)
    assert killed[0].exitcode == -signal.SIGKILL
    for run, row in zip(plan, result.rows, strict=True):
        expected = Simulate(run.scenario)
        assert row["rms"] == Evaluate(expected)["rms"]
        frames = result.records[row["method"], row["omega"]]
        assert frames.recognized_pose.tobytes() == expected.recognized_pose.tobytes()


def test_a_dask_cluster_gives_the_same_rows_and_frames(cluster, tmp_path):
    cluster.add_worker()
    (near,) = (s for s in MakeStudies(1, short=True) if s.name == "near")
    base = LoadScenario(text=BASE)
    here = RunStudies([near], base, tmp_path / "here", executor=InProcess())
    there = RunStudies([near], base, tmp_path / "there", executor=DaskCluster(cluster.address))
    assert [row["rms"] for row in there.rows] == [row["rms"] for row in here.rows]
    for key, record in here.records.items():
        assert there.records[key].fitness.tobytes() == record.fitness.tobytes()


def test_frames_that_are_lost_are_simulated_again(tmp_path):
    (near,) = (s for s in MakeStudies(1, short=True) if s.name == "near")
    base = LoadScenario(text=BASE)
    first = RunStudies([near], base, tmp_path, executor=InProcess())
    lost = sorted((tmp_path / "records").iterdir())[0]
    lost.unlink()
    told = []
    again = RunStudies(
        [near], base, tmp_path, executor=InProcess(),
        on_run=lambda one: told.append(one.was_kept),
    )  # fmt: skip
    assert sorted(told) == [False] + 5 * [True]
    assert lost.exists()
    for key, record in first.records.items():
        assert again.records[key].fitness.tobytes() == record.fitness.tobytes()


def test_medians_leave_out_what_is_not_done():
    row = Evaluate(Simulate(LoadScenario(text="{renderer: flat, " + BASE[1:])))
    about = {"study": "a", "label": "b", "curve": "c", "value": 1.0, "status": "done"}
    rows = [{**about, **row, "error": None, "mean_fitness": f} for f in (0.2, 0.4, 0.9)]
    rows.append({**about, "status": "unreachable", "error": "too fast"})
    (group,) = Summarize(rows)
    assert (len(group.done), group.error) == (3, "too fast")
    assert group.Quartiles("mean_fitness").median == 0.4
