"""Measures what disturbances do to the robust tracker, and writes docs/studies/robustness.md.

    python benchmarks/robustness.py [--seeds 20] [--duration 4] [--workers 2] [--only NAME ...]

An interrupted study goes on with the same command: every run is kept in out/robustness/.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies import robustness_page, robustness_picture
from studies.robustness_conditions import MOTIONS, conditions, motion

from mffdrake.experiment.progress import RunBar
from mffdrake.experiment.runs.engine import PlannedRun, RunPlan
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses, UsableCores
from mffdrake.experiment.runs.store import STORE_NAME, CodeFingerprint, RunStore
from mffdrake.experiment.runs.table import WriteRows
from mffdrake.experiment.scenario.scenario import Change
from mffdrake.experiment.simulation.evaluation import FlattenRow
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile

ROOT = Path(__file__).parents[1]
FIRST_SEED = 1000  # apart from those that the parameters were tuned on


def plan(options: argparse.Namespace) -> list[PlannedRun]:
    """The runs: conditions x motions x methods x seeds."""
    known = [(group, strength, changes, condition_name(group, strength))
             for group, strength, changes in conditions(options.duration)]  # fmt: skip
    for name in options.only:
        if not any(name in (group, condition) for group, _, _, condition in known):
            names = ", ".join(dict.fromkeys(group for group, *_ in known))
            raise SystemExit(
                f"robustness.py: --only must be some of {names}, or of their conditions such as "
                f"{known[1][-1]}, not '{name}'"
            )
    return [
        PlannedRun(
            scenario=Change(motion(name, options.duration),
                            {**changes, "method": method, "seed": FIRST_SEED + k}),
            labels={"group": group, "strength": strength, "motion": name, "method": method},
        )
        for group, strength, changes, condition in known
        if not options.only or {group, condition} & set(options.only)
        for name in MOTIONS for method in robustness_page.METHODS for k in range(options.seeds)
    ]  # fmt: skip


def condition_name(group: str, strength: str) -> str:
    """A condition's name on the command line."""
    text = f"{group} {strength}".replace("%", "percent")
    return "-".join("".join(c if c.isalnum() or c in "._" else " " for c in text).split())


def run(options: argparse.Namespace) -> list[dict[str, Any]]:
    """All runs' rows, kept ones included."""
    runs = plan(options)
    logging.getLogger("mffdrake").setLevel(logging.ERROR)  # Thousands would warn of the same.
    store = RunStore(MakeOutputFolder(options.out) / STORE_NAME)
    with RunBar(runs) as on_run:
        place = LocalProcesses(options.workers)
        return [
            FlattenRow(one.Row()) for one in RunPlan(runs, store, executor=place, on_run=on_run)
        ]


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
    WriteRows(rows, options.out / "rows.csv")
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
