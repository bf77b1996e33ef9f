"""Runs a grid of scenarios, keeps every run at once, and goes on where it was interrupted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.fingerprint import CodeFingerprint
from mffdrake.experiment.runs.grid import Grid
from mffdrake.experiment.runs.store import Record, RunKey, RunStore
from mffdrake.experiment.runs.sweep_table import MakeTable, WriteTable
from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["OtherCodeError", "RunScenario", "Sweep"]

STORE_NAME = "runs.sqlite"
"""The file in a sweep's folder that keeps the runs."""


class OtherCodeError(RuntimeError):
    """A worker would run other code than the process that asks it to."""


def Sweep(
    grid: Grid,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    file_format: str = "parquet",
    on_run: Callable[[Record, bool], None] | None = None,
) -> pa.Table:
    """Runs a grid of scenarios.

    Runs that the folder's store (``runs.sqlite``) has from before, by this very code, are not
    repeated, except for those that failed. Every run is kept there as soon as it has ended, so
    that an interrupted sweep goes on where it was. At the end, also at an early one, the folder
    gets ``results.parquet`` or ``results.csv``; ``grid.yaml`` from the start.

    Args:
        grid: What to run, see `LoadGrid`.
        folder: The folder, which is made where there is none.
        executor: Where to run it; processes of this machine, one a core, by default.
        file_format: ``parquet`` or ``csv``.
        on_run: Called for every run that has ended, with whether it was there from before.

    Returns:
        The table that was written, see `MakeTable`.

    Raises:
        StoreError: When the folder's store cannot be used.
        ClusterError: When the cluster cannot be reached (any more).
        OSError: When a file cannot be written.

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.runs.executors.executors import InProcess
        >>> from mffdrake.experiment.runs.grid import MakeGrid
        >>> small = {"duration": 0.1, "renderer": "flat", "camera": {"width": 64, "height": 48}}
        >>> grid = MakeGrid({"scenario": small, "grid": {"method": ["ga", "mff"]}, "seeds": 2})
        >>> table = Sweep(grid, tempfile.mkdtemp(), executor=InProcess())
        >>> table.select(["method", "seed", "status"]).to_pylist()[-1]
        {'method': 'mff', 'seed': 1, 'status': 'done'}
    """
    folder = MakeOutputFolder(folder)
    executor = executor or LocalProcesses()
    tell = on_run or (lambda record, kept: None)
    code = CodeFingerprint()
    keys = [RunKey(run.scenario, code) for run in grid.runs]
    store = RunStore(folder / STORE_NAME)
    with WholeFile(folder / "grid.yaml") as part:
        part.write_text(grid.Dump(), encoding="utf-8")
    kept = store.Get(keys)
    missing = []
    for index, key in enumerate(keys):
        if key not in kept or kept[key].status == "failed":
            missing.append(index)
        else:
            tell(kept[key], True)
    try:
        if missing:
            with executor:
                arguments = [(grid.runs[index].scenario, code) for index in missing]
                for outcome in executor.Run(_RunAndEvaluate, arguments):
                    index = missing[outcome.index]
                    record = Record(
                        row=outcome.value, error=outcome.error, attempts=outcome.attempts
                    )
                    store.Put(keys[index], grid.runs[index].scenario.Dump(), code, record)
                    tell(record, False)
    finally:  # The table says what the store has, wherever an interruption came.
        kept = store.Get(keys)
        table = MakeTable(grid, [kept.get(key) for key in keys])
        WriteTable(table, folder, file_format)
    return table


def RunScenario(scenario: Scenario, code: str) -> SimulationResult:
    """Runs a scenario in a worker.

    Args:
        scenario: The scenario.
        code: The asking process's `CodeFingerprint`.

    Returns:
        The record.

    Raises:
        OtherCodeError: When the worker's code is another one.
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.
    """
    own = CodeFingerprint()
    if code != own:
        raise OtherCodeError(
            f"the worker has other code ({own}) than this process ({code}); install the same "
            "versions, and start both again"
        )
    return Simulate(scenario)


def _RunAndEvaluate(scenario: Scenario, code: str) -> dict[str, Any]:
    return Evaluate(RunScenario(scenario, code))
