"""Measures what disturbances do to the robust tracker, and writes docs/studies/robustness.md.

    python benchmarks/robustness.py [--seeds 20] [--duration 4] [--workers 2] [--only NAME ...]

An interrupted study goes on with the same command: every run is kept in out/robustness/.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import robustness_page
import robustness_picture
from robustness_conditions import MOTIONS, Condition, conditions, motion

from mffdrake.experiment.commands.progress import RunBar
from mffdrake.experiment.runs.executors.executors import Executor, Outcome
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses, UsableCores
from mffdrake.experiment.runs.fingerprint import CodeFingerprint
from mffdrake.experiment.runs.grid import Grid, MakeGrid
from mffdrake.experiment.runs.sweep import Sweep
from mffdrake.experiment.simulation.evaluation import WriteCsv
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile

ROOT = Path(__file__).parents[1]
FIRST_SEED = 1000  # apart from those that the parameters were tuned on
METHODS = ["ga", "mff"]


class Lent:
    """An executor's workers, which one sweep leaves to the next."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def __enter__(self) -> Lent:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass

    def Run(
        self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Outcome]:
        return self._executor.Run(function, arguments)


def plan(options: argparse.Namespace) -> list[tuple[Condition, str, Grid]]:
    """What to run: a grid for each condition and motion."""
    known = list(conditions(options.duration))
    for name in options.only:
        if not any(name in (condition.group, condition.name) for condition in known):
            names = ", ".join(dict.fromkeys(c.group for c in known))
            raise SystemExit(
                f"robustness.py: --only must be some of {names}, or of their conditions such as "
                f"{known[1].name}, not '{name}'"
            )
    chosen = [c for c in known if not options.only or {c.group, c.name} & set(options.only)]
    seeds = [FIRST_SEED + k for k in range(options.seeds)]
    return [
        (
            condition,
            name,
            MakeGrid(
                {"scenario": condition.changes, "grid": {"method": METHODS}, "seeds": seeds},
                scenario=motion(name, options.duration),
            ),
        )
        for condition in chosen
        for name in MOTIONS
    ]


def run(options: argparse.Namespace) -> list[dict[str, Any]]:
    """All runs' rows, kept ones included, with what they are of."""
    grids = plan(options)
    logging.getLogger("mffdrake").setLevel(logging.ERROR)  # Thousands would warn of the same.
    rows = []
    total = sum(len(grid.runs) for _, _, grid in grids)
    with LocalProcesses(options.workers) as executor, RunBar(total, "robustness") as on_run:
        for condition, name, grid in grids:
            folder = MakeOutputFolder(options.out / name / condition.name)
            table = Sweep(grid, folder, executor=Lent(executor), file_format="csv", on_run=on_run)
            what = {"group": condition.group, "strength": condition.strength, "motion": name}
            rows += [what | row for row in table.to_pylist()]
    return rows


def read_options(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="runs of each kind")
    parser.add_argument("--duration", type=float, default=4.0, help="of a run [s]")
    parser.add_argument("--workers", type=int, default=UsableCores(), help="processes")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME",
        help="disturbances or conditions; the page then has these alone",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "robustness", metavar="DIR")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs" / "studies", metavar="DIR")
    return parser.parse_args(arguments)


def main() -> None:
    """Measures and writes."""
    options = read_options()
    try:
        rows = run(options)
    except KeyboardInterrupt:
        print(f"\ninterrupted; the same command goes on with what is in {options.out}")
        sys.exit(130)
    WriteCsv(rows, options.out / "rows.csv")
    page, picture = options.docs / "robustness.md", options.docs / "images" / "robustness.png"
    MakeOutputFolder(picture.parent)
    done = [row for row in rows if row["status"] == "done"]
    if done:
        with WholeFile(picture) as part:
            robustness_picture.save(done, part)
    with WholeFile(page) as part:
        text = robustness_page.page(rows, options, CodeFingerprint())
        part.write_text(text, encoding="utf-8")
    print(f"written: {page}, {picture}, {options.out / 'rows.csv'}")
    if len(done) < len(rows):
        print(f"{len(rows) - len(done)} of {len(rows)} runs failed; the same command tries again")
        sys.exit(1)


if __name__ == "__main__":
    main()
