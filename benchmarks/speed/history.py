"""What each release cost: a line a release, with times as multiples of a reference's.

The reference is a computation of this file that never changes, compiled as the recognizer's own
kernels are, and timed in turn with them, so that lines from different machines compare, as well as
machines are alike. Of several rounds the fastest counts, for other programs can only slow one down.
"""

from __future__ import annotations

import csv
import datetime
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numba
import numpy as np
from timing import median_ms

import mffdrake as mff
from mffdrake.experiment.runs.store import CodeFingerprint
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition.recordings.files import WholeFile
from speed import recognition

FILE = Path(__file__).parents[1] / "history.csv"
COLUMNS = (
    "version", "date", "python", "drake", "files", "reference_ms",
    "generation", "refinement", "acquisition", "flat_frame", "vtk_frame",
)  # fmt: skip
"""What a line has. `files` is the code's fingerprint; then the reference's time, and what takes how
many times that: a generation of the GA, a refinement, finding the target in one frame from nothing,
and a frame of a simulation with flat images and with VTK's, all of 640 x 480 pixels."""

ROUNDS = 7
CALLS = {"generation": 100, "refinement": 100, "acquisition": 20}
DURATIONS = {"flat_frame": 3.0, "vtk_frame": 1.0}


@numba.njit
def _reference(values: np.ndarray, steps: int) -> float:
    """A sum over points that turn: arithmetic, roots, a branch, and reads from memory."""
    total = 0.0
    for step in range(steps):
        c, s = math.cos(0.01 * step), math.sin(0.01 * step)
        for k in range(len(values)):
            x, y, z = values[k]
            u, v = c * x - s * y, s * x + c * y
            if u > v:
                total += math.sqrt(u * u + v * v + z * z)
            else:
                total -= u * z
    return total


def reference() -> Callable[[], float]:
    """The reference computation, compiled: about a millisecond. It must never change."""
    values = np.random.default_rng(0).normal(size=(1000, 3))
    _reference(values, 1)
    return lambda: _reference(values, 250)


def measure() -> dict[str, str]:
    """This version's line."""
    compute, calls = reference(), _calls()
    fastest = dict.fromkeys(("reference", *calls), math.inf)
    for _ in range(ROUNDS):  # in turn, as what else runs on the machine comes and goes
        for name, cost in calls.items():
            fastest["reference"] = min(fastest["reference"], median_ms(compute, 50))
            fastest[name] = min(fastest[name], cost())
    unit = fastest.pop("reference")
    facts = dict(fact.rsplit(" ", 1) for fact in CodeFingerprint().split(", "))
    return {
        "version": version("mffdrake"),
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "python": platform.python_version(),
        "drake": facts["drake"],
        "files": facts["files"],
        "reference_ms": f"{unit:.3f}",
        **{name: f"{ms / unit:.3g}" for name, ms in fastest.items()},
    }


def _calls() -> dict[str, Callable[[], float]]:
    """What times each of the things that a line has [ms]."""
    generate, refine = recognition.prepare(2, "none")
    run = {"generation": generate, "refinement": refine, "acquisition": _acquisition()}
    costs = {name: partial(median_ms, run[name], count) for name, count in CALLS.items()}
    for name, duration in DURATIONS.items():
        renderer = name.removesuffix("_frame")
        costs[name] = partial(_frame_ms, f"{{renderer: {renderer}, duration: {duration}}}")
    return costs


def _frame_ms(text: str) -> float:
    """Mean wall time of a simulation's frame, of a scenario's text [ms]."""
    return Simulate(LoadScenario(text=text)).stages_ms["total"]


def _acquisition() -> Callable[[], object]:
    """What finds the target in one frame, from no knowledge at all.

    Raises:
        RuntimeError: When it is not found, for then it would not be what is timed.
    """
    rig = recognition.make_rig(2, "none")
    box = mff.SolidModel.from_mesh_file(mff.FindModelsPath() / "target_box.obj")
    tracker = mff.TrackerParameters(refinement=mff.RefinementParameters()).make_tracker(
        solid=box, rig=rig
    )
    pictures = recognition.pictures_of(rig)
    found = tracker.start_population(pictures, frame=0)
    if np.linalg.norm(found.best[:3] - recognition.TRUTH[:3]) > 0.005:
        raise RuntimeError(f"the target is not at {found.best}")
    return lambda: tracker.start_population(pictures, frame=0)


def read(file: Path = FILE) -> list[dict[str, str]]:
    """All lines, in their order; none where there is no file yet."""
    if not file.exists():
        return []
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def record(line: Mapping[str, str], file: Path = FILE) -> None:
    """Adds a line, in the place of the one of the same version if there is one.

    Raises:
        ValueError: When the line has other columns than `COLUMNS`.
    """
    if set(line) != set(COLUMNS):
        raise ValueError(f"a line has {', '.join(COLUMNS)}, not {', '.join(line)}")
    lines: Sequence[Mapping[str, str]] = read(file)
    known = [old["version"] for old in lines]
    if line["version"] in known:
        lines = [line if old["version"] == line["version"] else old for old in lines]
    else:
        lines = [*lines, line]
    with WholeFile(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
