"""A grid of scenarios as one table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from mffdrake.experiment.runs.engine import EndedRun, KeptRuns, RunPlan
from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.grid import Grid
from mffdrake.experiment.runs.store import STORE_NAME, RunStore
from mffdrake.experiment.runs.table import MakeTable, WriteTable
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Sweep"]


def Sweep(
    grid: Grid,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    file_format: str = "parquet",
    on_run: Callable[[EndedRun], None] | None = None,
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
        on_run: Called for every run that has ended.

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
    store = RunStore(folder / STORE_NAME)
    with WholeFile(folder / "grid.yaml") as part:
        part.write_text(grid.Dump(), encoding="utf-8")
    try:
        RunPlan(grid.runs, store, executor=executor, on_run=on_run)
    finally:  # The table says what the store has, wherever an interruption came.
        table = MakeTable(grid.runs, KeptRuns(grid.runs, store))
        WriteTable(table, folder / f"results.{file_format}")
    return table
