"""Ends commands at random moments, starts them again, and looks at what is left each time.

Real processes get SIGKILL, SIGINT or SIGTERM, or one of their workers is killed. Whatever the
moment: every file of the output folder can be read, runs that were kept stay as they are, all of
them are those of an undisturbed command, bit for bit except for times and attempts, and the same
command goes on to the same results.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import random
import shlex
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pyarrow.parquet

SCENARIO = "--renderer flat --duration 0.3 --scenario-text 'camera: {width: 160, height: 120}'"
GRID = """
scenario: {duration: 0.3, renderer: flat, camera: {width: 160, height: 120}}
grid: {method: [ga, mff], hand_path.omega: [0.1, 0.2]}
seeds: 2
"""
COMMANDS = {
    "run": f"run {SCENARIO}",
    "servo": f"servo {SCENARIO}",
    "compare": f"compare {SCENARIO} --omega 0.1 0.2 --workers 2",
    "sweep": "sweep grid.yaml --workers 2 --format csv",
    "reproduce": "reproduce --short --duration 0.1 --workers 2 --scenario-text "
    "'camera: {width: 64, height: 48}'",
    "track": "",  # what `record` says
}
IN_A_ROW = 3  # kills, before a command may come to its end
SIGNALS = {"SIGKILL": {-9}, "SIGINT": {130, -2}, "SIGTERM": {143, -15}}
WORKER = "worker"
TIMES = ("wall_s", "realtime_factor", "stages_ms", "stage_means_ms", "ms", "attempts")
NOISE = ("Traceback", "Exception ignored", "leaked", "Warning")


@dataclass
class Tally:
    """What became of one command."""

    seconds: float  # of the command by itself
    reference: Path
    kills: int = 0
    ended: int = 0  # before the signal came
    parts: int = 0  # hidden files that SIGKILL left
    failures: list[str] = field(default_factory=list)


def start(command: str, folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "mffdrake", *shlex.split(command), "--out", "out"],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        stdin=subprocess.DEVNULL, env=os.environ | {"TQDM_DISABLE": "1"},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def finish(command: str, folder: Path) -> str:
    """Lets a command come to its end; what is wrong with that."""
    process = start(command, folder)
    _, errors = process.communicate()
    if process.returncode or any(word in errors for word in NOISE):
        return f"undisturbed: status {process.returncode}, {errors.strip()[-600:]}"
    return ""


def disturb(command: str, folder: Path, kind: str, moment: float, rng: random.Random) -> str | None:
    """Sends a signal after a while; what is wrong with the end, None where it came before."""
    process = start(command, folder)
    with suppress(subprocess.TimeoutExpired):
        process.communicate(timeout=moment)
        return None
    descendants = psutil.Process(process.pid).children(recursive=True)
    expected = {0} if kind == WORKER else SIGNALS[kind] | {0}
    if kind == WORKER:
        # The tracker of resources is no worker, and is named after what it runs.
        victims = [one for one in descendants if "forkserver" in " ".join(words(one))]
        if victims:
            rng.choice(victims).kill()
    else:
        process.send_signal(signal.Signals[kind])
    _, errors = process.communicate()
    _, alive = psutil.wait_procs(descendants, timeout=60)
    if alive:
        return f"{len(alive)} processes are left"
    if process.returncode not in expected:
        return f"status {process.returncode}, {errors.strip()[-600:]}"
    if kind != "SIGKILL" and any(word in errors for word in NOISE):
        return errors.strip()[-600:]
    return ""


def words(process: psutil.Process) -> list[str]:
    with suppress(psutil.Error):
        return list(process.cmdline())
    return []


# What is in a folder.


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {
            key: without_times(one)
            for key, one in value.items()
            if key.partition(".")[0] not in TIMES
        }
    return [without_times(one) for one in value] if isinstance(value, list) else value


def read_csv(path: Path) -> Any:
    with path.open(newline="") as file:
        return without_times(list(csv.DictReader(file)))


def read_npz(path: Path) -> Any:
    with np.load(path) as arrays:
        return {name: (arrays[name].shape, arrays[name].tobytes())
                for name in arrays if name not in TIMES}  # fmt: skip


def read_picture(path: Path) -> Any:
    image = cv2.imread(str(path))
    if image is None:
        raise ValueError("no picture")
    # Times are drawn in some of them.
    return image.tobytes() if path.parent.name == "overlay" else image.shape


def read_runs(path: Path) -> Any:
    with closing(sqlite3.connect(path)) as store:
        if store.execute("PRAGMA integrity_check").fetchone() != ("ok",):
            raise ValueError("damaged")
        if not store.execute("SELECT 1 FROM sqlite_master").fetchone():
            return {}
        return dict(store.execute("SELECT key, row FROM runs WHERE status = 'done'").fetchall())


READERS: dict[str, Callable[[Path], Any]] = {
    ".csv": read_csv,
    ".json": lambda path: without_times(json.loads(path.read_text())),
    ".npz": read_npz,
    ".parquet": lambda path: without_times(pyarrow.parquet.read_table(path).to_pylist()),
    ".png": read_picture,
    ".sqlite": read_runs,
    ".tum": lambda path: path.read_text().splitlines(),
    ".yaml": lambda path: path.read_text(),
}


def contents(folder: Path) -> dict[str, Any]:
    """What the files say, by name; other kinds only have to be there."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and ".part" not in path.name and not path.name.endswith("-journal"):
            try:
                found[str(path.relative_to(folder))] = READERS.get(path.suffix, bool)(path)
            except Exception as error:
                raise ValueError(f"{path.name}: {type(error).__name__}: {error}") from error
    return found


def runs_of(found: dict[str, Any]) -> dict[str, Any]:
    rows = found.get("runs.sqlite", {})
    return {key: without_times(json.loads(row)) for key, row in rows.items()}


def lacks(found: dict[str, Any], before: dict[str, Any], reference: dict[str, Any]) -> list[str]:
    """What is wrong with a folder of a command that was ended early."""
    wrong = []
    kept, was_kept = found.get("runs.sqlite", {}), before.get("runs.sqlite", {})
    if any(kept.get(key) != row for key, row in was_kept.items()):
        wrong.append("a run that was kept is lost or another one")
    right = runs_of(reference)
    if any(right.get(key) != row for key, row in runs_of(found).items()):
        wrong.append("a run is not as without a disturbance")
    for name, value in found.items():
        if name.startswith(("records/", "overlay/")) and value != reference.get(name):
            wrong.append(f"{name} is not as without a disturbance")
        if name in ("poses.csv", "poses.tum") and value != reference[name][: len(value)]:
            wrong.append(f"{name} is not the beginning of the right one")
    first, whole = found.get("result.npz"), reference.get("result.npz")
    if first is not None and whole is not None:
        for name, (_, content) in first.items():
            # The scenario of a record that ends early is a shorter one.
            if name != "scenario" and not whole[name][1].startswith(content):
                wrong.append(f"result.npz: {name} is not the beginning of the right one")
    return wrong


def differences(found: dict[str, Any], reference: dict[str, Any]) -> list[str]:
    """What is wrong with a folder of a command that came to its end."""
    wrong = [f"{name} is missing" for name in reference if name not in found]
    for name, value in found.items():
        if name not in reference:
            wrong.append(f"{name} should not be there")
        elif name != "runs.sqlite" and value != reference[name]:
            wrong.append(f"{name} is not as without a disturbance")
    if runs_of(found) != runs_of(reference):
        wrong.append("the runs are not those without a disturbance")
    return wrong


# The study.


def prepare(folder: Path) -> None:
    """What the commands read."""
    folder.mkdir()
    (folder / "grid.yaml").write_text(GRID)
    (folder / "rec").symlink_to("../rec")


def measure(name: str, command: str, top: Path) -> Tally:
    """Runs a command undisturbed."""
    folder = top / f"{name}-reference"
    prepare(folder)
    begin = time.perf_counter()
    trouble = finish(command, folder)
    tally = Tally(seconds=time.perf_counter() - begin, reference=folder / "out")
    tally.failures += [trouble] if trouble else []
    return tally


def series(name: str, command: str, folder: Path, tally: Tally, rng: random.Random) -> None:
    """Some kills in a row in one folder, and then to the end."""
    prepare(folder)
    reference, before = contents(tally.reference), dict[str, Any]()
    for _ in range(IN_A_ROW):
        kind = rng.choice([*SIGNALS, WORKER] if "--workers" in command else [*SIGNALS])
        moment = rng.uniform(0.0, tally.seconds)
        begin = time.perf_counter()
        trouble = disturb(command, folder, kind, moment, rng)
        if trouble is None:  # It was over, so that it takes less time than was thought.
            tally.ended += 1
            tally.seconds = min(tally.seconds, time.perf_counter() - begin)
            break
        tally.kills += 1
        told = [trouble] if trouble else []
        try:
            found = contents(folder / "out") if (folder / "out").exists() else {}
            told += lacks(found, before, reference)
            before = found
        except ValueError as error:
            told.append(str(error))
        tally.failures += [f"{kind} after {moment:.2f} s: {one} ({folder})" for one in told]
    told = [finish(command, folder)]
    tally.parts += sum(".part" in path.name for path in (folder / "out").rglob(".*"))
    try:
        told += differences(contents(folder / "out"), reference)
    except ValueError as error:
        told.append(str(error))
    tally.failures += [f"in the end: {one} ({folder})" for one in told if one]


def main() -> None:
    """Prints a table, and what failed; ends with status 1 where something did."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=60, help="how many in all (default: 60)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    options = parser.parse_args()
    rng, top = random.Random(options.seed), Path(tempfile.mkdtemp(prefix="kills-"))
    commands = {name: COMMANDS[name] for name in options.commands}
    if "track" in commands:
        said = subprocess.run(
            [sys.executable, "-m", "mffdrake", "record", *shlex.split(SCENARIO), "--out", "rec"],
            cwd=top, stdout=subprocess.PIPE, text=True, check=True,
        ).stdout.splitlines()[1]  # fmt: skip
        commands["track"] = said.removeprefix("mffdrake ").partition(" --out")[0] + " --overlay"
    tallies = {name: measure(name, command, top) for name, command in commands.items()}
    count = 0
    while sum(tally.kills for tally in tallies.values()) < options.kills:
        name = [*commands][count % len(commands)]
        known = len(tallies[name].failures)
        series(name, commands[name], top / f"{name}-{count}", tallies[name], rng)
        count += 1
        done, failed = tallies[name].kills, tallies[name].failures
        print(f"{name}: {done} kills, {len(failed)} failures", *failed[known:], sep="\n  ",
              file=sys.stderr, flush=True)  # fmt: skip
    print(f"{'command':<12}{'s':>7}{'kills':>7}{'too late':>10}{'parts':>7}{'failures':>10}")
    for name, tally in tallies.items():
        print(f"{name:<12}{tally.seconds:>7.1f}{tally.kills:>7}{tally.ended:>10}{tally.parts:>7}"
              f"{len(tally.failures):>10}")  # fmt: skip
    failures = [f"{name}: {one}" for name, tally in tallies.items() for one in tally.failures]
    print("\n".join(failures))
    print(f"{len(failures)} failures of {sum(tally.kills for tally in tallies.values())} kills")
    sys.exit(1 if failures else 0)
