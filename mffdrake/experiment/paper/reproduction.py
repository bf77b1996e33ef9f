"""Runs the studies of the paper's experiment, and goes on where it was interrupted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mffdrake.experiment.paper.paper_numbers import Quartiles
from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.fingerprint import CodeFingerprint
from mffdrake.experiment.runs.store import Record, RecordPath, RunKey, RunStore
from mffdrake.experiment.runs.study import PlannedRun, Study
from mffdrake.experiment.runs.sweep import STORE_NAME, RunScenario
from mffdrake.experiment.simulation.evaluation import RMS_ERRORS, Evaluate
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.recognition.recordings.files import MakeOutputFolder

__all__ = ["RECORDED", "FindEntry", "Reproduction", "RunPlan", "Summarize"]

RECORDED = "near"
"""The study whose first seed is kept frame by frame, for the paper's Fig. 6 and 7."""

# Trying again what the arm cannot do would give the same answer.
_FINAL = "UnreachablePathError: "


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """What came out.

    Attributes:
        studies: What was run.
        rows: One for each of their runs, in order: ``study``, ``label``, ``curve``, ``value``,
            ``seed``, ``status`` (``done``, ``unreachable`` or ``failed``), ``error``, and, where
            it is done, the entries of `Evaluate`'s row.
        records: Of the first seed of the study `RECORDED`: the frames by (method, omega [rad/s]).
    """

    studies: tuple[Study, ...]
    rows: tuple[dict[str, Any], ...]
    records: dict[tuple[str, float], SimulationResult]

    def Failures(self) -> list[dict[str, Any]]:
        """The rows of the runs that failed, other than for the arm's limits."""
        return [row for row in self.rows if row["status"] == "failed"]


def RunPlan(
    plan: Sequence[PlannedRun],
    folder: Path | str,
    *,
    executor: Executor | None = None,
    on_run: Callable[[PlannedRun, Record, bool], None] | None = None,
) -> Reproduction:
    """Runs studies.

    Every run is kept in the folder's store, ``runs.sqlite``, as soon as it has ended, like a
    sweep's; what is there from before, by this very code, is not repeated. Runs that several
    studies have in common are run once.

    Args:
        plan: See `PlanRuns`.
        folder: The folder, which is made where there is none.
        executor: Where to run; processes of this machine, one a core, by default.
        on_run: Called for every distinct run that has ended, with whether it was there before.

    Returns:
        What came out. A run that failed is a row with its error, tried again next time.

    Raises:
        StoreError: When the folder's store cannot be used.
        ClusterError: When the cluster cannot be reached (any more).
        OSError: When a file cannot be written.

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.runs.executors.executors import InProcess
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> from mffdrake.experiment.paper.studies import MakeStudies
        >>> from mffdrake.experiment.runs.study import PlanRuns
        >>> base = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> plan = PlanRuns(MakeStudies(1, short=True)[:1], base)
        >>> result = RunPlan(plan, tempfile.mkdtemp(), executor=InProcess())
        >>> [row["status"] for row in result.rows] == 6 * ["done"], sorted(result.records)[0]
        (True, ('ga', 0.105))
    """
    folder = MakeOutputFolder(folder)
    distinct = {run.scenario.fingerprint: run for run in plan}
    recorded = {
        run.scenario.fingerprint: run for run in plan
        if run.study.name == RECORDED and run.seed == plan[0].seed
    }  # fmt: skip
    records = _Run(list(distinct.values()), recorded, folder, executor, on_run)
    results = {
        (str(run.variant.curve), run.variant.value): SimulationResult.Load(path)
        for run in recorded.values()
        if (path := RecordPath(folder, RunKey(run.scenario, CodeFingerprint()))).exists()
    }
    rows = tuple(_MakeRow(run, records[run.scenario.fingerprint]) for run in plan)
    studies = tuple({run.study.name: run.study for run in plan}.values())
    return Reproduction(studies=studies, rows=rows, records=results)


def _Run(
    runs: list[PlannedRun],
    recorded: dict[str, PlannedRun],
    folder: Path,
    executor: Executor | None,
    on_run: Callable[[PlannedRun, Record, bool], None] | None,
) -> dict[str, Record]:
    """Runs what the store does not have, the longest first; all records by scenario."""
    code = CodeFingerprint()
    tell = on_run or (lambda run, record, kept: None)
    store = RunStore(folder / STORE_NAME)
    keys = {run.scenario.fingerprint: RunKey(run.scenario, code) for run in runs}
    kept = store.Get(list(keys.values()))
    records: dict[str, Record] = {}
    missing = []
    for run in runs:
        key = keys[run.scenario.fingerprint]
        record = kept.get(key)
        needs_frames = run.scenario.fingerprint in recorded
        lacks_frames = needs_frames and not RecordPath(folder, key).exists()
        if record is None or (not _IsFinal(record)) or (record.row is not None and lacks_frames):
            missing.append(run)
        else:
            records[run.scenario.fingerprint] = record
            tell(run, record, True)
    missing.sort(key=lambda run: -run.work)
    if not missing:
        return records
    with executor or LocalProcesses() as place:
        for outcome in place.Run(RunScenario, [(run.scenario, code) for run in missing]):
            run = missing[outcome.index]
            key, result = keys[run.scenario.fingerprint], outcome.value
            row = None if result is None else Evaluate(result)
            record = Record(row=row, error=outcome.error, attempts=outcome.attempts)
            # The frames before the row, which says that nothing is missing.
            if run.scenario.fingerprint in recorded and result is not None:
                path = RecordPath(folder, key)
                path.parent.mkdir(exist_ok=True)
                result.Save(path)
            store.Put(key, run.scenario.Dump(), code, record)
            records[run.scenario.fingerprint] = record
            tell(run, record, False)
    return records


def _IsFinal(record: Record) -> bool:
    return record.error is None or record.error.startswith(_FINAL)


def _MakeRow(run: PlannedRun, record: Record) -> dict[str, Any]:
    error = record.error
    status = record.status
    if error is not None and error.startswith(_FINAL):
        status, error = "unreachable", error.removeprefix(_FINAL)
    return {
        "study": run.study.name, "label": run.variant.label, "curve": run.variant.curve,
        "value": run.variant.value, "seed": run.seed, "status": status, "error": error,
        **(record.row or {}),
    }  # fmt: skip


def Summarize(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Medians and quartiles over the seeds.

    Args:
        rows: See `Reproduction`.

    Returns:
        One entry for each study's variant, in order: ``study``, ``label``, ``curve``, ``value``,
        ``done`` (number of runs), ``error`` (why others did not; None), and ``all`` and
        ``settled``, over all frames and without the first seconds: the `Quartiles`, or None, of
        ``mean_fitness`` and of each of `RMS_ERRORS`.

    Example:
        >>> rms = dict.fromkeys(RMS_ERRORS, 1.0)
        >>> row = dict(study="a", label="b", curve="c", value=1.0, status="done", error=None,
        ...            mean_fitness=0.9, rms=rms, mean_fitness_settled=None, rms_settled=rms)
        >>> entry = Summarize([row, {**row, "mean_fitness": 0.8}])[0]
        >>> round(entry["all"]["mean_fitness"].median, 3), entry["settled"]["mean_fitness"]
        (0.85, None)
    """
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["study"], row["label"]), []).append(row)
    summary = []
    for members in groups.values():
        done = [row for row in members if row["status"] == "done"]
        errors = [row["error"] for row in members if row["status"] != "done"]
        entry = {name: members[0][name] for name in ("study", "label", "curve", "value")}
        entry.update(done=len(done), error=errors[0] if errors else None)
        for when, suffix in (("all", ""), ("settled", "_settled")):
            cells = {"mean_fitness": Quartiles.Of([row[f"mean_fitness{suffix}"] for row in done])}
            for name in RMS_ERRORS:
                cells[name] = Quartiles.Of([row[f"rms{suffix}"][name] for row in done])
            entry[when] = cells
        summary.append(entry)
    return summary


def FindEntry(
    summary: Sequence[dict[str, Any]], study: str, curve: str, value: float
) -> dict[str, Any] | None:
    """The entry of a study's variant.

    Args:
        summary: See `Summarize`.
        study: The study's name.
        curve: The variant's curve.
        value: The variant's value.

    Returns:
        The entry; None when there is none.

    Example:
        >>> FindEntry([], "near", "mff", 0.105) is None
        True
    """
    for entry in summary:
        if (entry["study"], entry["curve"], entry["value"]) == (study, curve, value):
            return entry
    return None
