"""The table of a sweep's runs: its columns, its files, its medians over the seeds."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mffdrake.experiment.runs.grid import Grid
from mffdrake.experiment.runs.store import Record
from mffdrake.experiment.simulation.evaluation import RMS_ERRORS, TRACKING_SHARES, FlattenRow
from mffdrake.experiment.simulation.recovery import RECOVERY
from mffdrake.recognition.recordings.files import WholeFile

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["FORMATS", "MakeTable", "MedianTable", "WriteTable"]

FORMATS = ("parquet", "csv")
"""The formats of a sweep's table."""

# The columns of `Evaluate`'s rows that are there even where no run was done: all but the stages'.
_EVALUATED: dict[str, type] = {
    "method": str, "omega": float, "seed": int, "start": str, "coding": str,
    "refinement": str, "renderer": str,
    "duration": float, "frames": int, "mean_fitness": float, "mean_fitness_settled": float,
    **{f"{when}.{name}": float for when in ("rms", "rms_settled") for name in RMS_ERRORS},
    **{f"tracking.{name}": float for name in TRACKING_SHARES},
    **{f"rms_tracked.{name}": float for name in RMS_ERRORS},
    **{f"recovery.{name}": kind for name, kind in RECOVERY.items()},
    "wall_s": float, "realtime_factor": float, "symmetries": str,
}  # fmt: skip


def MakeTable(grid: Grid, records: Sequence[Record | None]) -> pa.Table:
    """The table of a sweep.

    Args:
        grid: The grid.
        records: What became of each of its runs; None where nothing did yet.

    Returns:
        One row for each run that has ended, in the grid's order. The columns: the grid's keys
        (lists and mappings as JSON), ``seed``, ``status`` (``done`` or ``failed``), ``error``,
        ``attempts``, and the figures of `Evaluate`, nested names joined by dots; null where a run
        failed. Their types do not depend on how many did.

    Example:
        >>> from mffdrake.experiment.runs.grid import MakeGrid
        >>> table = MakeTable(MakeGrid({"grid": {"method": ["ga", "mff"]}}), [None, Record()])
        >>> table.select(["method", "seed", "status", "frames"]).to_pylist()
        [{'method': 'mff', 'seed': 0, 'status': 'failed', 'frames': None}]
    """
    import pyarrow as pa  # Takes a moment to load, and serves sweeps alone.

    ended = [pair for pair in zip(grid.runs, records, strict=True) if pair[1] is not None]
    flat = [FlattenRow(record.row or {}) for _, record in ended if record is not None]
    arrow = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}
    columns: dict[str, pa.Array] = {}
    for key, values in grid.values.items():
        cells = [_Scalar(run.values[key]) for run, _ in ended]
        columns[key] = pa.array(cells, arrow[_KindOf(values)])
    columns["seed"] = pa.array([run.seed for run, _ in ended], pa.int64())
    for name, kind in (("status", str), ("error", str), ("attempts", int)):
        columns[name] = pa.array([getattr(record, name) for _, record in ended], arrow[kind])
    for name in dict.fromkeys([*(name for row in flat for name in row), *_EVALUATED]):
        if name not in columns:  # The grid's own stands there for failed runs too.
            figures = [row.get(name) for row in flat]
            columns[name] = pa.array(figures, arrow[_EVALUATED.get(name) or _KindOf(figures)])
    return pa.table(columns)


def _KindOf(values: Iterable[Any]) -> type:
    """The type that all of a column's values fit in."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float}:
        return int if kinds == {int} else float
    return bool if kinds == {bool} else str


def _Scalar(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | dict) else value


def WriteTable(table: pa.Table, folder: Path, file_format: str = "parquet") -> Path:
    """Writes a table as ``results.parquet`` or ``results.csv``, whole or not at all.

    Args:
        table: See `MakeTable`.
        folder: An existing folder.
        file_format: One of `FORMATS`.

    Returns:
        The file.

    Raises:
        OSError: When it cannot be written.
    """
    from pyarrow import csv, parquet

    path = folder / f"results.{file_format}"
    write = {"parquet": parquet.write_table, "csv": csv.write_csv}[file_format]
    with WholeFile(path) as part:
        write(table, str(part))
    return path


def MedianTable(grid: Grid, table: pa.Table) -> str:
    """Medians over the seeds, as Markdown.

    Args:
        grid: The grid.
        table: See `MakeTable`.

    Returns:
        One line for each of the grid's combinations, with its keys' values, mean fitness and
        root-mean-square errors of the frames after the first seconds (of all frames, where no
        run is longer), the number of seeds that are done and of those that failed.
    """
    keys = list(grid.values)
    rows = table.to_pylist()
    settled = any(row["mean_fitness_settled"] is not None for row in rows)
    suffix = "_settled" if settled else ""
    figures = (
        (f"mean_fitness{suffix}", "fitness", ".3f"),
        (f"rms{suffix}.position_mm", "position [mm]", ".2f"),
        (f"rms{suffix}.rotation_deg", "rotation [deg]", ".2f"),
    )
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(_Cell(row[key]) for key in keys), []).append(row)
    header = [*keys, *(title for _, title, _ in figures), "seeds", "failed"]
    lines = [f"| {' | '.join(header)} |", f"|{'---:|' * len(header)}"]
    for values, members in groups.items():
        cells = list(values)
        for name, _, form in figures:
            known = [row[name] for row in members if row[name] is not None]
            cells.append(format(np.median(known), form) if known else "-")
        failed = sum(row["status"] == "failed" for row in members)
        cells += [str(len(members) - failed), str(failed)]
        lines.append(f"| {' | '.join(cells)} |")
    frames = "the frames after the search at the start" if settled else "all frames"
    lines += ["", f"Medians over the seeds; mean fitness and root-mean-square errors of {frames}."]
    return "\n".join(lines)


def _Cell(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
