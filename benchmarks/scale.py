"""Runs a sweep of very many tiny runs on a Dask cluster of this machine, and watches it.

What a run costs beside its simulation (the workers' time a run, less what the same run takes in a
process that does nothing else), whether rows are kept as they come, and how much memory the
command and its workers have.
"""

from __future__ import annotations

import argparse
import os
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
import pyarrow.parquet
from distributed import LocalCluster

from mffdrake.experiment.progress import ProgressBar
from mffdrake.experiment.runs.engine import SimulateInWorker
from mffdrake.experiment.runs.grid import LoadGrid
from mffdrake.experiment.runs.store import STORE_NAME, CodeFingerprint
from mffdrake.experiment.runs.table import Markdown

GRID = """
scenario: {{renderer: flat, duration: 0.033, camera: {{width: 64, height: 48}}}}
seeds: {runs}
"""
ALONE = 40  # runs, to know what one takes by itself
WATCHED = 10  # times, evenly spread over the runs


@dataclass(frozen=True)
class Seen:
    """What was to be seen at a moment.

    Attributes:
        seconds: Wall time since the beginning.
        rows: How many runs the store has.
        command_mb: Memory of the command [MB].
        workers_mb: Memory of the workers, on average [MB].
        command_cpu: CPU time of the command so far [s].
        workers_cpu: Of all workers [s].
    """

    seconds: float
    rows: int
    command_mb: float
    workers_mb: float
    command_cpu: float
    workers_cpu: float


def seconds_alone(grid: Path) -> tuple[float, float]:
    """Wall and CPU time of a run in a process that does nothing else."""
    runs = LoadGrid(grid).runs[: ALONE + 1]
    SimulateInWorker(runs[0].scenario, CodeFingerprint())  # loads everything
    wall, cpu = time.perf_counter(), time.process_time()
    for run in runs[1:]:
        SimulateInWorker(run.scenario, CodeFingerprint())
    count = len(runs) - 1
    return (time.perf_counter() - wall) / count, (time.process_time() - cpu) / count


def rows_in(store: Path) -> int:
    """How many runs are kept."""
    with (
        suppress(sqlite3.Error),
        closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True)) as connection,
    ):
        return int(connection.execute("SELECT COUNT(*) FROM runs").fetchone()[0])
    return 0


def used(pids: list[int]) -> tuple[float, float]:
    """Processes' memory, on average [MB], and their CPU time so far [s]."""
    processes = [psutil.Process(pid) for pid in pids]
    megabytes = sum(process.memory_info().rss / 1e6 for process in processes) / len(pids)
    return megabytes, sum(sum(process.cpu_times()[:2]) for process in processes)


def sweep(grid: Path, folder: Path, runs: int, workers: int) -> list[Seen]:
    """Runs the command; what was seen meanwhile, from the first row that was kept on."""
    seen: list[Seen] = []
    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        ProgressBar(total=runs, desc="runs", unit="run") as bar,
    ):
        pids = [worker.pid for worker in cluster.workers.values()]
        command = subprocess.Popen(
            [sys.executable, "-m", "mffdrake", "sweep", str(grid), "--out", str(folder),
             "--scheduler", cluster.scheduler_address],
            stdout=subprocess.DEVNULL, env=os.environ | {"TQDM_DISABLE": "1"},
        )  # fmt: skip
        begin = time.perf_counter()
        while command.poll() is None:
            time.sleep(0.25)
            rows = rows_in(folder / STORE_NAME)
            bar.update(rows - bar.n)
            if rows > len(seen) * (runs - 1) / WATCHED:
                with suppress(psutil.Error):
                    (mb, cpu), (workers_mb, workers_cpu) = used([command.pid]), used(pids)
                    now = time.perf_counter() - begin
                    seen.append(Seen(now, rows, mb, workers_mb, cpu, workers_cpu))
    if command.returncode != 0:
        sys.exit(f"the command ended with status {command.returncode}")
    return seen


def main() -> None:
    """Prints what was seen; ends with status 1 where not every run is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000, help="how many (default: 10000)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="scale-"))
    grid = folder / "many.yaml"
    grid.write_text(GRID.format(runs=options.runs))
    alone, cpu_alone = seconds_alone(grid)
    seen = sweep(grid, folder / "out", options.runs, options.workers)
    first, last = seen[0], seen[-1]
    print(Markdown(
        ["s", "rows", "command MB", "a worker MB"],
        [[f"{s.seconds:.1f}", s.rows, f"{s.command_mb:.1f}", f"{s.workers_mb:.1f}"] for s in seen],
    ))  # fmt: skip
    runs = max(1, last.rows - first.rows) / 1e3
    per_run = options.workers * (last.seconds - first.seconds) / runs
    worker_cpu = (last.workers_cpu - first.workers_cpu) / runs
    command_cpu = (last.command_cpu - first.command_cpu) / runs
    print(f"A run takes {per_run:.1f} ms of a worker, {1e3 * alone:.1f} ms by itself: "
          f"{per_run - 1e3 * alone:.1f} ms more.")  # fmt: skip
    print(f"CPU time of a run: {worker_cpu:.1f} ms in the worker and {command_cpu:.1f} ms in the "
          f"command, {1e3 * cpu_alone:.1f} ms by itself: "
          f"{worker_cpu + command_cpu - 1e3 * cpu_alone:.1f} ms more.")  # fmt: skip
    status = pyarrow.parquet.read_table(folder / "out" / "results.parquet")["status"].to_pylist()
    done = status.count("done")
    print(f"{done} of {options.runs} runs are in the table of results.")
    sys.exit(0 if done == options.runs else 1)


if __name__ == "__main__":
    main()
