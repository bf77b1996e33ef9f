"""Sweeps: what they keep and write, how they go on; on the command line and from Python."""

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing, contextmanager
from pathlib import Path

import psutil
import pyarrow.csv
import pyarrow.parquet
import pytest
from worker_functions import wait_for

from mffdrake.experiment.runs.engine import EndedRun, OtherCodeError, SimulateInWorker
from mffdrake.experiment.runs.executors.cluster import ClusterError, DaskCluster
from mffdrake.experiment.runs.executors.executors import InProcess
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.grid import LoadGrid, MakeGrid
from mffdrake.experiment.runs.store import CodeFingerprint, Record, RunStore, StoreError
from mffdrake.experiment.runs.sweep import Sweep
from mffdrake.experiment.runs.table import MakeTable, SummaryTable
from mffdrake.experiment.scenario.scenario import LoadScenario, Scenario
from mffdrake.experiment.simulation.evaluation import Evaluate, FlattenRow
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import CheckScenario

NO_PROGRESS = {"TQDM_DISABLE": "1"}  # A busy machine would bring a line of it.
SMALL = {"renderer": "flat", "duration": 0.1, "camera": {"width": 64, "height": 48}}
TIMES = re.compile(r"wall_s|realtime_factor|stages_ms\..*")
UNREACHABLE = 3.0  # m; where the hand cannot be


def make_grid(seeds=2, **keys):
    grid = {"method": ["ga", "mff"], **{key.replace("__", "."): keys[key] for key in keys}}
    return MakeGrid({"scenario": SMALL, "grid": grid, "seeds": seeds})


def table_of(grid, records):
    """The table of a grid whose runs came to these records; None where they did not end."""
    ended = [
        record and EndedRun(run=run, record=record)
        for run, record in zip(grid.runs, records, strict=True)
    ]
    return MakeTable(grid.runs, ended)


def half_bad():
    """Every second run fails: a bad hand pose shows only where the joints are solved for."""
    bad, good = [UNREACHABLE, 0.0, 0.455], [0.918, 0.0, 0.455]
    return make_grid(hand_path__X_WE0__translation=[good, bad])


def numbers(table):
    """All that does not depend on the machine's speed."""
    return table.drop_columns([name for name in table.column_names if TIMES.fullmatch(name)])


def stored(folder):
    with closing(sqlite3.connect(folder / "runs.sqlite")) as store:
        return dict(store.execute("SELECT key, row FROM runs WHERE status = 'done'").fetchall())


def mffdrake(*arguments, cwd, **environment):
    return subprocess.run(
        [sys.executable, "-m", "mffdrake", *map(str, arguments)], cwd=cwd, text=True,
        env=os.environ | NO_PROGRESS | environment, stdin=subprocess.DEVNULL, capture_output=True,
        check=False,
    )  # fmt: skip


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


# The same rows, wherever they come from.


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone")
    return folder, Sweep(make_grid(seeds=6), folder, executor=InProcess())


@pytest.mark.parametrize("workers", [1, 2])
def test_local_processes_give_the_same_bits(workers, alone, tmp_path):
    table = Sweep(make_grid(seeds=6), tmp_path, executor=LocalProcesses(workers))
    assert numbers(table).equals(numbers(alone[1]))


def test_a_dask_cluster_gives_the_same_bits_also_when_a_worker_is_killed(cluster, alone, tmp_path):
    victim = cluster.add_worker()
    cluster.add_worker(threads=3)
    ended = []

    def kill(run):
        ended.append(run)
        if len(ended) == 3:
            victim.kill()

    executor = DaskCluster(cluster.address)
    table = Sweep(make_grid(seeds=6), tmp_path, executor=executor, on_run=kill)
    assert victim.wait() == -signal.SIGKILL
    assert numbers(table).equals(numbers(alone[1]))


def test_rows_are_what_simulating_and_evaluating_by_hand_gives(alone):
    grid, rows = make_grid(seeds=6), alone[1].to_pylist()
    expected = FlattenRow(Evaluate(Simulate(grid.runs[7].scenario)))
    assert rows[7]["method"] == "mff" and rows[7]["seed"] == 1
    assert {**expected, "status": "done", "error": None, "attempts": 1}.keys() == rows[7].keys()
    for name, value in expected.items():
        if not TIMES.fullmatch(name):
            assert rows[7][name] == value, name


# Going on.


def test_a_second_call_repeats_nothing(alone):
    folder, table = alone
    before, told = stored(folder), []
    again = Sweep(
        make_grid(seeds=6), folder, executor=None, on_run=lambda run: told.append(run.was_kept)
    )
    assert told == [True] * 12
    assert stored(folder) == before
    assert again.equals(table)  # The times too: nothing was simulated again.


def test_a_larger_grid_runs_only_what_is_new_and_other_rows_stay_out_of_the_table(tmp_path):
    Sweep(make_grid(seeds=[1, 2]), tmp_path, executor=InProcess())
    told = []
    table = Sweep(
        make_grid(seeds=[2, 3]), tmp_path, executor=InProcess(),
        on_run=lambda run: told.append(run.was_kept),
    )  # fmt: skip
    assert sorted(told) == [False, False, True, True]
    assert table["seed"].to_pylist() == [2, 3, 2, 3]
    assert len(stored(tmp_path)) == 6


def test_runs_of_other_code_are_left_alone_and_not_taken_for_this_ones(tmp_path):
    grid = make_grid(seeds=1)
    Sweep(grid, tmp_path, executor=InProcess())
    with closing(sqlite3.connect(tmp_path / "runs.sqlite")) as store, store:
        store.execute("UPDATE runs SET key = 'of other code' WHERE rowid = 1")
    told = []
    Sweep(grid, tmp_path, executor=InProcess(), on_run=lambda run: told.append(run.was_kept))
    assert sorted(told) == [False, True]
    assert "of other code" in stored(tmp_path)


def test_the_command_says_that_runs_of_other_code_are_run_anew(folder):
    assert mffdrake("sweep", "grid.yaml", cwd=folder).returncode == 0
    with closing(sqlite3.connect(folder / "out" / "runs.sqlite")) as store, store:
        store.execute("UPDATE runs SET key = key || 'x', code = 'mffdrake 0.0.1'")
    again = mffdrake("sweep", "grid.yaml", cwd=folder)
    assert again.returncode == 0
    (line,) = again.stderr.splitlines()
    assert line == (
        "mffdrake: out/runs.sqlite has 4 runs of other code or versions; they stay there, and are "
        "run anew"
    )
    assert len(stored(folder / "out")) == 8


def test_the_command_says_that_an_earlier_versions_records_cannot_go_on(folder):
    (folder / "out" / "records").mkdir(parents=True)
    (folder / "out" / "records" / "0123456789abcdef.npz").write_bytes(b"frames")
    finished = mffdrake("sweep", "grid.yaml", cwd=folder)
    assert finished.returncode == 0
    (line,) = finished.stderr.splitlines()
    assert line.startswith("mffdrake: out/records has records of an earlier version")


def test_a_worker_with_other_code_refuses():
    with pytest.raises(OtherCodeError, match="the worker has other code"):
        SimulateInWorker(Scenario(), "mffdrake 0.0.1")
    with pytest.raises(OtherCodeError, match=re.escape(CodeFingerprint())):
        SimulateInWorker(Scenario(), "mffdrake 0.0.1")


def test_failed_runs_are_rows_and_are_tried_again(tmp_path):
    for kept_before in (0, 4):
        told = []
        table = Sweep(
            half_bad(), tmp_path, executor=InProcess(),
            on_run=lambda run, told=told: told.append((run.status, run.was_kept)),
        )  # fmt: skip
        assert sum(kept for _, kept in told) == kept_before
        assert told.count(("failed", False)) == 4
        rows = table.to_pylist()
        assert [row["status"] for row in rows] == ["done"] * 2 + ["failed"] * 2 + ["done"] * 2 + [
            "failed"
        ] * 2
        assert "not reachable at t = 0.00 s" in rows[2]["error"]
        assert rows[2]["mean_fitness"] is None and rows[0]["mean_fitness"] is not None


# The table.


def test_the_columns_are_the_grids_keys_then_the_outcome_then_the_figures(alone):
    names = alone[1].column_names
    assert names[:7] == ["method", "seed", "status", "error", "attempts", "omega", "start"]
    assert len(set(names)) == len(names)
    assert {"mean_fitness_settled", "rms.position_mm", "rms_settled.rotation_deg"} <= set(names)


def test_column_types_do_not_depend_on_how_many_runs_failed(alone):
    grid = make_grid(seeds=6)
    done = [Record(row=json.loads(row)) for row in stored(alone[0]).values()]
    failed = Record(error="ValueError: no")
    types = table_of(grid, done).schema
    assert types.field("error").type == "string"
    assert types.field("mean_fitness_settled").type == "double"  # All null: the runs are short.
    assert table_of(grid, [failed, *done[1:]]).schema == types
    assert table_of(grid, [failed] * 12).schema == types
    assert table_of(grid, [None] * 12).schema == types


def test_values_of_all_kinds_have_columns():
    grid = MakeGrid(
        {
            "grid": {
                "recognizer.sampling.margin": [None, 0.004],
                "recognizer.population_size": [30],
                "controller.gravity_compensation": [True, False],
                "target.X_WM.translation": [[1.7, 0, 0.45]],
                "predictor": [{"gain": 0.5}],
            }
        }
    )
    table = table_of(grid, [Record(error="no")] * 4)
    assert [str(field.type) for field in table.schema][:5] == [
        "double", "int64", "bool", "string", "string",
    ]  # fmt: skip
    row = table.to_pylist()[3]
    assert row["recognizer.sampling.margin"] == 0.004
    assert row["controller.gravity_compensation"] is False
    assert json.loads(row["target.X_WM.translation"]) == [1.7, 0.0, 0.45]
    assert json.loads(row["predictor"])["gain"] == 0.5


def test_the_median_table_has_a_line_for_each_combination():
    grid = make_grid(seeds=3)
    rows = [
        Record(row={"mean_fitness": f, "mean_fitness_settled": f / 2, "rms_settled": {
            "position_mm": 10 * f, "rotation_deg": f}, "tracking": {"right": f}})
        for f in (0.1, 0.5, 0.9)
    ]  # fmt: skip
    table = table_of(grid, [*rows[:2], Record(error="no"), *rows[:1], None, None])
    lines = SummaryTable(table.to_pylist(), list(grid.values)).splitlines()
    assert lines[0] == (
        "| method | seeds | fitness | position [mm] | rotation [deg] | right | failed |"
    )
    assert lines[2:4] == [
        "| ga | 2 | 0.150 | 3.00 | 0.30 | 30.00% | 1 |",
        "| mff | 1 | 0.050 | 1.00 | 0.10 | 10.00% | 0 |",
    ]


# The store.


@pytest.mark.parametrize("content", [b"this is no database, but long enough for one" * 99, "other"])
def test_a_store_that_is_not_ours_is_an_error_that_names_it_and_stays(content, tmp_path):
    path = tmp_path / "runs.sqlite"
    if content == "other":
        with closing(sqlite3.connect(path)) as other, other:
            other.execute("CREATE TABLE runs (a)")
    else:
        path.write_bytes(content)
    before = path.read_bytes()
    with pytest.raises(StoreError, match=r"runs\.sqlite: .*(--out)"):
        RunStore(path)
    assert path.read_bytes() == before


def test_a_damaged_store_is_an_error_that_names_it(tmp_path):
    path = tmp_path / "runs.sqlite"
    store = RunStore(path)
    for k in range(50):
        store.Put(f"k{k}", "scenario" * 100, "code", Record(row={"frames": k}))
    content = bytearray(path.read_bytes())
    content[4096:-4096] = b"\xff" * (len(content) - 8192)
    path.write_bytes(content)
    with pytest.raises(StoreError, match=r"runs\.sqlite: cannot be used"):
        store.Get([f"k{k}" for k in range(50)])


def test_what_is_done_stays_done(tmp_path):
    store = RunStore(tmp_path / "runs.sqlite")
    store.Put("k", "", "", Record(error="no", attempts=3))
    assert store.Get(["k"])["k"] == Record(error="no", attempts=3)
    store.Put("k", "", "", Record(row={"frames": 4}))
    store.Put("k", "", "", Record(error="no"))
    assert store.Get(["k"])["k"] == Record(row={"frames": 4})


# The command.


@pytest.fixture
def folder(tmp_path):
    scenario = "scenario: {renderer: flat, duration: 0.1, camera: {width: 64, height: 48}}\n"
    (tmp_path / "grid.yaml").write_text(scenario + "grid: {method: [ga, mff]}\nseeds: 2")
    (tmp_path / "long.yaml").write_text(
        scenario.replace("0.1", "1") + "grid: {method: [ga, mff]}\nseeds: 12"
    )
    (tmp_path / "bad.yaml").write_text(
        scenario + f"grid: {{hand_path.X_WE0.translation: [[{UNREACHABLE}, 0, 0.4]]}}\nseeds: 7"
    )
    return tmp_path


def test_sweep_writes_what_is_promised_and_prints_medians(folder):
    finished = mffdrake("sweep", "grid.yaml", "--workers", 2, cwd=folder)
    assert (finished.returncode, finished.stderr) == (0, "")
    assert files(folder / "out") == ["grid.yaml", "results.parquet", "runs.sqlite"]
    table = pyarrow.parquet.read_table(folder / "out" / "results.parquet")
    assert [(r["method"], r["seed"], r["status"]) for r in table.to_pylist()] == [
        ("ga", 0, "done"), ("ga", 1, "done"), ("mff", 0, "done"), ("mff", 1, "done"),
    ]  # fmt: skip
    lines = [line for line in finished.stdout.splitlines() if line.startswith("|")]
    assert re.match(r"\| ga \| 2 \| 0\.\d{3} \| \d+\.\d\d \| \d+\.\d\d \| \d+\.\d\d% \|", lines[2])
    assert len(lines) == 4
    assert finished.stdout.splitlines()[-1] == "Results: out/results.parquet"
    runs = LoadGrid(folder / "grid.yaml").runs
    assert LoadGrid(folder / "out" / "grid.yaml").runs == runs


def test_csv_has_the_same_rows(folder):
    for arguments in ([], ["--format", "csv"]):
        finished = mffdrake("sweep", "grid.yaml", *arguments, cwd=folder)
        assert finished.returncode == 0, finished.stderr
    table = pyarrow.parquet.read_table(folder / "out" / "results.parquet")
    lines = pyarrow.csv.read_csv(folder / "out" / "results.csv")
    assert lines.column_names == table.column_names
    for name in ("method", "seed", "status", "mean_fitness", "rms.position_mm", "wall_s"):
        assert lines[name].to_pylist() == table[name].to_pylist()


def test_failed_runs_are_listed_and_the_status_is_1(folder):
    finished = mffdrake("sweep", "bad.yaml", cwd=folder)
    assert (finished.returncode, finished.stderr) == (1, "")
    assert "7 of 7 runs failed" in finished.stdout
    failures = [line for line in finished.stdout.splitlines() if line.startswith("- ")]
    assert len(failures) == 6
    assert re.search(r"translation \[3.0, 0.0, 0.4\], seed 0: .*not reachable", failures[0])
    assert "all in results.parquet" in failures[5]
    table = pyarrow.parquet.read_table(folder / "out" / "results.parquet")
    assert table["status"].to_pylist() == ["failed"] * 7


@contextmanager
def long_sweep(folder):
    """A sweep that has kept some runs, and has many to go; with its children."""
    store = folder / "out" / "runs.sqlite"

    def some():
        assert process.poll() is None, process.stderr.read()
        try:
            return store.exists() and len(stored(store.parent)) >= 3
        except sqlite3.OperationalError:  # The table is not there yet.
            return False

    with subprocess.Popen(
        [sys.executable, "-m", "mffdrake", "sweep", "long.yaml", "--workers", "2"],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | NO_PROGRESS,
    ) as process:  # fmt: skip
        try:
            wait_for(some, "three runs")
            children = psutil.Process(process.pid).children(recursive=True)
            yield process
            process.wait()
            wait_for(lambda: not any(one.is_running() for one in children), "the workers' end")
        finally:
            process.kill()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_ctrl_c_and_its_like_end_it_with_the_rows_so_far(name, folder):
    number = signal.Signals[name]
    with long_sweep(folder) as process:
        process.send_signal(number)
        shown, errors = process.communicate()
    assert process.returncode == 128 + number
    by = "" if name == "SIGINT" else f" by {name}"
    assert errors.splitlines() == [f"mffdrake: interrupted{by}"]
    assert shown == ""
    table = pyarrow.parquet.read_table(folder / "out" / "results.parquet")
    assert 3 <= len(table) < 24
    assert len(table) == len(stored(folder / "out"))


def test_after_sigkill_the_same_command_repeats_nothing_that_was_kept(folder):
    with long_sweep(folder) as process:
        process.kill()
    before = stored(folder / "out")
    assert 3 <= len(before) < 24
    finished = mffdrake("sweep", "long.yaml", cwd=folder)
    assert finished.returncode == 0, finished.stderr
    after = stored(folder / "out")
    assert len(after) == 24
    assert {key: after[key] for key in before} == before  # With the times they took.


def test_two_sweeps_on_one_folder_do_not_disturb_each_other(folder):
    command = [sys.executable, "-m", "mffdrake", "sweep", "grid.yaml", "--workers", "1"]
    processes = [subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE) for _ in range(2)]
    for process in processes:
        process.communicate()
    assert [process.returncode for process in processes] == [0, 0]
    assert len(stored(folder / "out")) == 4
    assert len(pyarrow.parquet.read_table(folder / "out" / "results.parquet")) == 4


def test_a_cluster_serves_sweep_and_compare(cluster, folder):
    cluster.add_worker()
    finished = mffdrake("sweep", "grid.yaml", "--scheduler", cluster.address, cwd=folder)
    assert (finished.returncode, finished.stderr) == (0, "")
    finished = mffdrake(
        "compare", "--scheduler", cluster.address, "--omega", 0.2, "--duration", 0.1,
        "--renderer", "flat", "--out", "compared", cwd=folder,
    )  # fmt: skip
    assert (finished.returncode, finished.stderr) == (0, "")
    assert {"results.csv", "pose_0.2.png"} <= set(files(folder / "compared"))


def test_a_scheduler_that_goes_away_is_an_error_and_the_rows_stay(cluster, tmp_path):
    cluster.add_worker()

    def kill(run):
        cluster.scheduler.kill()

    with pytest.raises(ClusterError, match="is gone"):
        Sweep(make_grid(seeds=20), tmp_path, executor=DaskCluster(cluster.address), on_run=kill)
    table = pyarrow.parquet.read_table(tmp_path / "results.parquet")
    assert 1 <= len(table) == len(stored(tmp_path))


def test_help_lists_the_options(tmp_path):
    finished = mffdrake("sweep", "--help", cwd=tmp_path)
    assert (finished.returncode, finished.stderr) == (0, "")
    for option in (
        "GRID.yaml", "--workers", "--scheduler", "--format", "--out", "--scenario-file",
        "--scenario-text", "--duration", "--seed", "--renderer", "--verbose",
    ):  # fmt: skip
        assert option in finished.stdout
    assert "--replay" not in finished.stdout and "--graphviz" not in finished.stdout


WRONG = {
    "no file": (["no.yaml"], "no.yaml.*No such file"),
    "no grid": ([], "GRID.yaml"),
    "wrong key": (["wrong.yaml"], "wrong.yaml: grid: .*method must be one of ga, mff"),
    "both places": (["grid.yaml", "--workers", "2", "--scheduler", "x"], "not allowed with"),
    "workers": (["grid.yaml", "--workers", "0"], "--workers.*positive whole number.*'0'"),
    "format": (["grid.yaml", "--format", "xls"], "--format.*'xls'.*parquet.*csv"),
    "no scheduler": (["grid.yaml", "--scheduler", "127.0.0.1:1"], "no Dask scheduler.*refused"),
    "set twice": (["grid.yaml", "--duration", "3"], "--duration: grid.yaml sets the duration"),
    "renderer": (["no_scenario.yaml", "--renderer", "crayon"], "renderer.*vtk.*'crayon'"),
    "out is a file": (["grid.yaml", "--out", "bad.yaml"], "bad.yaml"),
    "foreign store": (["grid.yaml", "--out", "foreign"], "foreign/runs.sqlite: .*--out"),
}


@pytest.mark.parametrize("case", WRONG)
def test_bad_input_is_one_line_and_status_2(case, folder):
    arguments, expected = WRONG[case]
    (folder / "wrong.yaml").write_text("grid: {method: [best]}")
    (folder / "no_scenario.yaml").write_text("grid: {method: [ga]}")
    (folder / "foreign").mkdir()
    (folder / "foreign" / "runs.sqlite").write_text("mine\n" * 999)
    finished = mffdrake("sweep", *arguments, cwd=folder)
    assert (finished.returncode, finished.stdout) == (2, "")
    (line,) = finished.stderr.splitlines()
    assert line.startswith("mffdrake") and "error: " in line
    assert re.search(expected, line), line


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
def test_without_a_graphics_driver_it_says_so_once(folder):
    (folder / "vtk.yaml").write_text("grid: {renderer: [flat, vtk]}")
    finished = mffdrake(
        "sweep", "vtk.yaml", cwd=folder, __EGL_VENDOR_LIBRARY_FILENAMES="/nonexistent.json"
    )
    assert finished.returncode == 2
    (line,) = finished.stderr.splitlines()
    assert "cannot render" in line


def test_the_example_grids_and_scenarios_load_and_can_be_run():
    folder = Path(__file__).parents[2] / "scenarios"
    examples = set(folder.glob("*.yaml"))
    grids = {file for file in examples if "\ngrid:" in file.read_text(encoding="utf-8")}
    assert grids and examples - grids
    for file in grids:
        assert LoadGrid(file).runs
    for file in examples - grids:
        CheckScenario(LoadScenario(file))


def test_the_grid_file_of_the_page_loads(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "howto" / "sweeps.md"
    found = re.findall(r"```yaml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (text,) = [block for block in found if "\ngrid:" in block]
    (tmp_path / "grid.yaml").write_text(text)
    assert len(LoadGrid(tmp_path / "grid.yaml").runs) == 30
