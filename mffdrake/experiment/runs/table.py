"""The table of a plan's runs: its columns, its files, and its medians over the seeds."""

from __future__ import annotations

import csv
import html
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mffdrake.experiment.runs.engine import EndedRun, PlannedRun
from mffdrake.experiment.runs.store import Versions
from mffdrake.experiment.simulation.evaluation import COLUMNS, SETTLED_AFTER, Column, FlattenRow
from mffdrake.recognition.recordings.files import WholeFile

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "FORMATS",
    "Group",
    "GroupRows",
    "IsSettled",
    "MakeTable",
    "Markdown",
    "MarkdownTable",
    "Quartiles",
    "SummaryTable",
    "WindowNote",
    "WriteJson",
    "WriteRows",
    "WriteTable",
]

FORMATS = ("parquet", "csv")
"""The formats of a table's file."""

_PAPERS = tuple(f"rms.{name}" for name in ("x_mm", "y_mm", "z_mm", "eps1", "eps2", "eps3"))
_OUTCOME = {"seed": int, "status": str, "error": str, "attempts": int}


@dataclass(frozen=True, kw_only=True)
class Quartiles:
    """Quartiles of a figure over the seeds.

    Attributes:
        low: A quarter of the seeds lies below.
        median: One half.
        high: Three quarters.
        count: Number of seeds.

    Example:
        >>> Quartiles.Of([1.0, 2.0, 3.0, 4.0, None])
        Quartiles(low=1.75, median=2.5, high=3.25, count=4)
    """

    low: float
    median: float
    high: float
    count: int

    @classmethod
    def Of(cls, values: Sequence[float | None]) -> Quartiles | None:
        """Those of the numbers that are there.

        Args:
            values: Numbers; None where there is none.

        Returns:
            The quartiles; None when there are no numbers.
        """
        known = [value for value in values if value is not None]
        if not known:
            return None
        low, median, high = (float(value) for value in np.quantile(known, [0.25, 0.5, 0.75]))
        return cls(low=low, median=median, high=high, count=len(known))


@dataclass(frozen=True)
class Group:
    """Rows that differ in their seeds alone.

    Attributes:
        labels: What they have in common.
        rows: The rows, nested names joined by dots.
    """

    labels: dict[str, Any]
    rows: list[dict[str, Any]]

    @property
    def done(self) -> list[dict[str, Any]]:
        """Those that have figures."""
        return [row for row in self.rows if row.get("status", "done") == "done"]

    @property
    def error(self) -> str | None:
        """Why the first of the others has none; None where all have."""
        return next((r["error"] for r in self.rows if r.get("status", "done") != "done"), None)

    def Quartiles(self, name: str) -> Quartiles | None:
        """A column's quartiles over the seeds; None where there is no number."""
        return Quartiles.Of([row.get(name) for row in self.done])

    def Value(self, column: Column, settled: bool) -> float | None:
        """A column's median over the seeds, or mean; None where there is no number."""
        for name in (column.settled, column.name) if settled else (column.name,):
            known = [row[name] for row in self.done if row.get(name) is not None]
            if known:  # A hand that follows may not have settled yet.
                return float(np.mean(known) if column.is_mean else np.median(known))
        return None

    def Cell(self, column: Column, settled: bool, *, quartiles: bool = False) -> str:
        """What tables show of a column: its `Value`, with quartiles if there are several seeds."""
        value = self.Value(column, settled)
        if value is None:
            return "-"
        shown = format(value, column.form)
        found = self.Quartiles(column.settled if settled and column.settled else column.name)
        if not quartiles or column.is_mean or found is None or found.count == 1:
            return shown
        return f"{shown} ({found.low:{column.form}} - {found.high:{column.form}})"


def GroupRows(rows: Iterable[dict[str, Any]], by: Sequence[str]) -> list[Group]:
    """Groups rows by some of their columns.

    Args:
        rows: Rows of `EndedRun.Row` or `Evaluate`.
        by: The columns' names.

    Returns:
        The groups, in order of appearance.

    Example:
        >>> rows = [{"method": "ga", "frames": 1}, {"method": "ga", "frames": 3}]
        >>> [group.Quartiles("frames").median for group in GroupRows(rows, ["method"])]
        [2.0]
    """
    groups: dict[str, Group] = {}
    for row in map(FlattenRow, rows):
        labels = {name: row[name] for name in by}
        groups.setdefault(json.dumps(labels), Group(labels, [])).rows.append(row)
    return list(groups.values())


def IsSettled(rows: Iterable[dict[str, Any]]) -> bool:
    """Whether all runs that are done are long enough to leave out the search at their start.

    Args:
        rows: Rows, flat or not.
    """
    done = [row for row in rows if row.get("mean_fitness") is not None]
    return bool(done) and all(row["mean_fitness_settled"] is not None for row in done)


def Markdown(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown.

    Args:
        header: Its headings.
        rows: Its cells.

    Example:
        >>> print(Markdown(["a", "b"], [[1, 2]]))
        | a | b |
        |---:|---:|
        | 1 | 2 |
    """
    lines = [f"| {' | '.join(header)} |", f"|{'---:|' * len(header)}"]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row))} |" for row in rows)])


def SummaryTable(
    rows: Sequence[dict[str, Any]],
    by: Sequence[str],
    *,
    more: Sequence[str | Column] = (),
    headings: dict[str, str] | None = None,
    details: bool = False,
) -> str:
    """One line for each group of seeds, as Markdown.

    Args:
        rows: Rows of `EndedRun.Row` or `Evaluate`.
        by: What groups them, see `GroupRows`.
        more: Names of `COLUMNS`, or columns of one's own, beside those that are always shown.
        headings: Those of the columns ``by``, where they are not their names.
        details: Whether to show quartiles, and why runs failed instead of how many did.

    Returns:
        The table: medians over the seeds (of shares, means), of the frames after the first
        `SETTLED_AFTER` seconds, or of all frames where a run is shorter; the number of seeds that
        are done and, if any failed, of those that did.

    Example:
        >>> gray = {"coding": "gray", "mean_fitness": 0.8}
        >>> rows = [gray | {"mean_fitness_settled": fitness} for fitness in (0.8, 0.9, 0.9)]
        >>> print(SummaryTable(rows, ["coding"]))
        | coding | seeds | fitness |
        |---:|---:|---:|
        | gray | 3 | 0.900 |
    """
    groups, settled = GroupRows(rows, by), IsSettled(rows)
    columns = [column for column in COLUMNS if column.shown or column.name in more]
    columns += [column for column in more if isinstance(column, Column)]
    columns = [c for c in columns if any(g.Value(c, settled) is not None for g in groups)]
    last = ["remark" if details else "failed"] * any(group.error for group in groups)
    names = [(headings or {}).get(name, name) for name in by]
    body = []
    for group in groups:
        cells = [group.Cell(column, settled, quartiles=details) for column in columns]
        remark = html.escape(group.error or "", quote=False).replace("|", "\\|")
        failed = remark if details else str(len(group.rows) - len(group.done))
        labels = [f"{v:g}" if isinstance(v, float) else str(v) for v in group.labels.values()]
        body.append([*labels, len(group.done), *cells, *[failed] * len(last)])
    header = [*names, "seeds", *(column.title for column in columns), *last]
    return Markdown(header, body)


def WindowNote(rows: Sequence[dict[str, Any]]) -> str:
    """A sentence on what the figures of a `SummaryTable` are of.

    Args:
        rows: The table's rows.
    """
    frames = (
        f"the frames after the first {SETTLED_AFTER:g} s" if IsSettled(rows)
        else f"all frames with the search at the start, for want of {SETTLED_AFTER:g} s"
    )  # fmt: skip
    return (
        "Medians over the seeds, of shares means; mean fitness and root-mean-square errors of "
        f"{frames}."
    )


def MarkdownTable(rows: Sequence[dict[str, Any]]) -> str:
    """A table like the paper's: a line for each speed and method, as Markdown.

    Args:
        rows: Rows of `Evaluate`.

    Returns:
        See `SummaryTable`; with the errors of each coordinate, and `WindowNote` below.

    Example:
        >>> row = {"omega": 0.1, "mean_fitness": 0.8, "mean_fitness_settled": 0.9}
        >>> table = MarkdownTable([row | {"method": method} for method in ("ga", "mff")])
        >>> print(table.partition("Medians")[0].rstrip())
        | omega [rad/s] | method | seeds | fitness |
        |---:|---:|---:|---:|
        | 0.1 | ga | 1 | 0.900 |
        | 0.1 | mff | 1 | 0.900 |
    """
    table = SummaryTable(
        rows, ("omega", "method"), more=_PAPERS, headings={"omega": "omega [rad/s]"}
    )
    return f"{table}\n\n{WindowNote(rows)}"


# Files.


def MakeTable(plan: Sequence[PlannedRun], ended: Sequence[EndedRun | None]) -> pa.Table:
    """The table of a plan.

    Args:
        plan: The plan.
        ended: What became of each of its runs; None where nothing did yet.

    Returns:
        One row for each run that has ended, in the plan's order. The columns: the labels (lists
        and mappings as JSON), ``seed``, ``status``, ``error``, ``attempts``, and the `COLUMNS`;
        null where a run failed. Their types do not depend on how many did.
    """
    labels = {
        name: _KindOf(run.labels[name] for run in plan) for name in (plan[0].labels if plan else ())
    }
    always = {column.name: column.kind for column in COLUMNS if not column.needs_servo}
    rows = [FlattenRow(run.Row()) for run in ended if run is not None]
    return _Arrow(rows, labels | _OUTCOME | {c: k for c, k in always.items() if c not in labels})


def _Arrow(rows: Sequence[dict[str, Any]], kinds: dict[str, type]) -> pa.Table:
    """A table with columns of known types, and others as they come."""
    import pyarrow as pa  # Takes a moment to load, and serves files alone.

    arrow = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}
    columns: dict[str, pa.Array] = {}
    for name in dict.fromkeys([*kinds, *(name for row in rows for name in row)]):
        cells = [row.get(name) for row in rows]
        columns[name] = pa.array(cells, arrow[kinds.get(name) or _KindOf(cells)])
    return pa.table(columns)


def _KindOf(values: Iterable[Any]) -> type:
    """The type that all of a column's values fit in."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float}:
        return int if kinds == {int} else float
    return bool if kinds == {bool} else str


def WriteTable(table: pa.Table, path: Path) -> None:
    """Writes a table, whole or not at all.

    Args:
        table: See `MakeTable`.
        path: The file; its suffix is one of `FORMATS`.
    """
    from pyarrow import parquet

    with WholeFile(path) as part:
        if path.suffix == ".parquet":
            parquet.write_table(table, str(part))
            return
        with part.open("w", newline="", encoding="utf-8") as file:  # Quotes where they are needed.
            writer = csv.writer(file)
            writer.writerow(table.column_names)
            writer.writerows(row.values() for row in table.to_pylist())


def WriteRows(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Writes rows as a table, one line a row, nested names joined by dots.

    Args:
        rows: The rows; a figure that a row lacks is left empty.
        path: See `WriteTable`.
    """
    WriteTable(_Arrow([FlattenRow(row) for row in rows], {}), path)


def WriteJson(data: dict[str, Any], path: Path) -> None:
    """Writes numbers and the versions that they come from as JSON, whole or not at all.

    Args:
        data: What can be written as JSON.
        path: The file.
    """
    with WholeFile(path) as part:
        text = json.dumps({**data, "versions": Versions()}, indent=2)
        part.write_text(text + "\n", encoding="utf-8")
