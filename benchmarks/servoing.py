"""Studies of the closed loop: writes docs/studies/servoing.md and its pictures.

    python benchmarks/servoing.py [--seeds 3] [--only NAME ...]

With three seeds it takes about half an hour on two cores. An interrupted study goes on with the
same command: every run is kept in out/servoing/.
"""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from studies.servoing_page import PARTS, Followed, page
from studies.servoing_plan import STUDIES, plan

from mffdrake.experiment.progress import RunBar
from mffdrake.experiment.runs.engine import RunPlan
from mffdrake.experiment.runs.store import STORE_NAME, CodeFingerprint, RunStore
from mffdrake.experiment.simulation.plotting import SaveFigure
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Runs the studies and writes the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3, help="runs of each setting")
    parser.add_argument("--only", nargs="+", choices=STUDIES, default=list(STUDIES), metavar="NAME")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "servoing", metavar="DIR")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs" / "studies", metavar="DIR")
    options = parser.parse_args()
    logging.getLogger("mffdrake").setLevel(logging.ERROR)
    store = RunStore(MakeOutputFolder(options.out) / STORE_NAME)
    plans = {name: plan(name, options.seeds) for name in options.only}
    runs = [run for name in plans for run in plans[name]]
    with RunBar(runs) as on_run:
        ended = RunPlan(runs, store, on_run=on_run)
    parts = []
    for name in options.only:
        members = [Followed.of(one) for one in ended if one.run.labels["study"] == name]
        text, pictures = PARTS[name](members)
        parts.append(text)
        for picture, figure in pictures.items():
            SaveFigure(figure, MakeOutputFolder(options.docs / "images") / f"{picture}.png")
    with WholeFile(options.docs / "servoing.md") as part:
        part.write_text(page(parts, options.seeds, CodeFingerprint()), encoding="utf-8")
    print(f"written: {options.docs / 'servoing.md'}")


if __name__ == "__main__":
    main()
