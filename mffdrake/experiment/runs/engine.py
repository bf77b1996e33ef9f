"""Runs a plan, a list of labeled scenarios: the one engine below compare, sweep and reproduce."""

from __future__ import annotations

import dataclasses as dc
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.store import CodeFingerprint, Record, RunKey, RunStore, StoreError
from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.recognition.parameters import InputError

__all__ = ["EndedRun", "KeptRuns", "OtherCodeError", "PlannedRun", "RunPlan", "SimulateInWorker"]

_VTK_WORK = 12.0  # Times as long as with the flat renderer, on two cores without a GPU.
_UNREACHABLE = "UnreachablePathError: "


class OtherCodeError(InputError, RuntimeError):
    """A worker would run other code than the process that asks it to."""


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """One run of a plan.

    Attributes:
        scenario: The scenario.
        labels: What tables call it: column to value, in order.
        keeps_frames: Whether its record is kept frame by frame.
        may_be_unreachable: Whether it is an answer, too, that the arm cannot follow the path.

    Example:
        >>> plan = [
        ...     PlannedRun(scenario=Scenario(method=method, seed=seed), labels={"method": method})
        ...     for method in ("ga", "mff") for seed in (0, 1)
        ... ]
        >>> plan[-1].labels["method"], plan[-1].scenario.seed
        ('mff', 1)
    """

    scenario: Scenario
    labels: Mapping[str, Any] = field(default_factory=dict)
    keeps_frames: bool = False
    may_be_unreachable: bool = False

    @property
    def work(self) -> float:
        """About how much longer it takes than a run with the flat renderer."""
        return _VTK_WORK if self.scenario.renderer == "vtk" else 1.0


@dataclass(frozen=True, kw_only=True)
class EndedRun:
    """What became of a planned run.

    Attributes:
        run: What was planned.
        record: Its figures, or why there are none.
        frames: Its frames, where they are kept.
        was_kept: Whether it was there from before.
        exception: Why it failed just now; None where it did not.

    Example:
        >>> run = PlannedRun(scenario=Scenario(seed=7), labels={"method": "mff"})
        >>> ended = EndedRun(run=run, record=Record(error="ValueError: too dark"))
        >>> ended.status, ended.Row()["error"]
        ('failed', 'ValueError: too dark')
    """

    run: PlannedRun
    record: Record
    frames: SimulationResult | None = None
    was_kept: bool = False
    exception: BaseException | None = None

    @property
    def status(self) -> str:
        """``done``, ``failed`` or, where that is an answer, ``unreachable``."""
        error = self.record.error or ""
        is_answer = self.run.may_be_unreachable and error.startswith(_UNREACHABLE)
        return "unreachable" if is_answer else self.record.status

    @property
    def lacks_frames(self) -> bool:
        """Whether its frames should have been kept, but are not there or damaged."""
        return self.run.keeps_frames and self.status == "done" and self.frames is None

    def Row(self) -> dict[str, Any]:
        """Labels, ``seed``, ``status``, ``error``, ``attempts`` and the row of `Evaluate`.

        Labels that are lists or mappings are written as JSON.
        """
        error = self.record.error
        if self.status == "unreachable" and error is not None:
            error = error.removeprefix(_UNREACHABLE)
        return {
            **{name: _Plain(label) for name, label in self.run.labels.items()},
            "seed": self.run.scenario.seed, "status": self.status, "error": error,
            "attempts": self.record.attempts, **(self.record.row or {}),
        }  # fmt: skip


def _Plain(label: Any) -> Any:
    return json.dumps(label) if isinstance(label, list | dict) else label


def RunPlan(
    plan: Sequence[PlannedRun],
    store: RunStore,
    *,
    executor: Executor | None = None,
    on_run: Callable[[EndedRun], None] | None = None,
) -> list[EndedRun]:
    """Runs a plan, except for what the store has from before, by this very code.

    Every run is kept as soon as it has ended, so that an interrupted plan goes on where it was.
    Runs of the same scenario are run once; those that failed before are tried again.

    Args:
        plan: The runs.
        store: Where runs are kept.
        executor: Where to run; processes of this machine, one a core, by default.
        on_run: Called for every distinct run that has ended; what it raises ends the plan.

    Returns:
        What became of each run, in the plan's order. The numbers do not depend on the executor.

    Raises:
        StoreError: When the store cannot be used.
        ClusterError: When the cluster cannot be reached (any more).

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.runs.executors.executors import InProcess
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> plan = [PlannedRun(scenario=short, labels={"name": "first"})]
        >>> store = RunStore(f"{tempfile.mkdtemp()}/runs.sqlite")
        >>> ended = RunPlan(plan, store, executor=InProcess())
        >>> row = ended[0].Row()
        >>> row["name"], row["status"], row["frames"]
        ('first', 'done', 4)
    """
    code = CodeFingerprint()
    tell = on_run or (lambda ended: None)
    # Of equal runs, that which keeps its frames.
    ordered = sorted(plan, key=lambda run: run.keeps_frames)
    distinct = {run.scenario.fingerprint: run for run in ordered}
    runs = [distinct[name] for name in dict.fromkeys(run.scenario.fingerprint for run in plan)]
    found: dict[str, EndedRun] = {}
    missing: list[PlannedRun] = []
    for run, ended in zip(runs, KeptRuns(runs, store), strict=True):
        if ended is None or ended.status == "failed" or ended.lacks_frames:
            missing.append(run)
        else:
            found[run.scenario.fingerprint] = ended
            tell(ended)
    missing.sort(key=lambda run: -run.work)
    if missing:
        tasks = [(run.scenario, code, run.keeps_frames) for run in missing]
        with executor or LocalProcesses() as place:
            for outcome in place.Run(_Work, tasks):
                run, (row, frames) = missing[outcome.index], outcome.value or (None, None)
                record = Record(row=row, error=outcome.error, attempts=outcome.attempts)
                store.Put(RunKey(run.scenario, code), run.scenario.Dump(), code, record, frames)
                ended = EndedRun(run=run, record=record, frames=frames, exception=outcome.exception)
                if frames is not None:
                    found[run.scenario.fingerprint] = ended
                tell(ended)
    # Meanwhile, thousands of records take no memory.
    others = [run for run in missing if run.scenario.fingerprint not in found]
    for run, kept in zip(others, KeptRuns(others, store), strict=True):
        if kept is None:
            raise StoreError("runs that were kept just now are gone; the same command repeats them")
        found[run.scenario.fingerprint] = dc.replace(kept, was_kept=False)
    return [dc.replace(found[run.scenario.fingerprint], run=run) for run in plan]


def KeptRuns(plan: Sequence[PlannedRun], store: RunStore) -> list[EndedRun | None]:
    """What a store has of a plan, run by this very code.

    Returns:
        What became of each run; None where nothing did yet.

    Raises:
        StoreError: When the store cannot be used.
    """
    keys = [RunKey(run.scenario, CodeFingerprint()) for run in plan]
    kept = store.Get(keys)
    return [
        EndedRun(
            run=run, record=kept[key], was_kept=True,
            frames=store.Frames(key) if run.keeps_frames else None,
        )
        if key in kept else None
        for run, key in zip(plan, keys, strict=True)
    ]  # fmt: skip


def SimulateInWorker(scenario: Scenario, code: str) -> SimulationResult:
    """Runs a scenario in a worker.

    Args:
        scenario: The scenario.
        code: The asking process's `CodeFingerprint`.

    Raises:
        OtherCodeError: When the worker's code is another one.
    """
    own = CodeFingerprint()
    if code != own:
        raise OtherCodeError(
            f"the worker has other code ({own}) than this process ({code}); install the same "
            "versions, and start both again"
        )
    return Simulate(scenario)


def _Work(
    scenario: Scenario, code: str, keeps_frames: bool
) -> tuple[dict[str, Any], SimulationResult | None]:
    """A run's row, and its frames where they are kept."""
    result = SimulateInWorker(scenario, code)
    return Evaluate(result), result if keeps_frames else None
