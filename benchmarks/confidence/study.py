"""Fits the confidence's weights, checks it on other runs, and writes docs/studies/confidence.md.

    python benchmarks confidence [--seeds 2] [--duration 2] [--fit] [--only NAME]

With two seeds of 2 s it takes about a quarter of an hour on two cores, with --fit twice as long.
"""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from studies.robustness_page import TEXTS, percent

from confidence.evidence import of_starts, of_wrong_optima
from confidence.fit import fit
from confidence.frames import CHECK_SEED, TRAINING_SEED, of_images, of_study
from confidence.page import of_others, page, reliability, thresholds
from confidence.reliability import bins, plot
from mffdrake.experiment.simulation.plotting import SaveFigure
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile
from mffdrake.recognition.tracking.confidence import WEIGHTS


def main() -> None:
    """Runs, fits and writes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="runs of each kind")
    parser.add_argument("--duration", type=float, default=2.0, help="of a run [s]")
    parser.add_argument("--fit", action="store_true", help="fit the weights on other seeds before")
    parser.add_argument("--only", action="append", default=[], choices=TEXTS, help="a group")
    parser.add_argument("--docs", type=Path, default=Path(__file__).parents[2] / "docs" / "studies")
    options = parser.parse_args()
    logging.getLogger("mffdrake").setLevel(logging.ERROR)  # Hundreds would warn of the same.
    fitted = None
    if options.fit:
        training = [
            of_study(options, TRAINING_SEED, "training: runs"),
            of_images(of_starts, options, TRAINING_SEED, "training: hidden targets"),
            of_images(of_wrong_optima, options, TRAINING_SEED, "training: wrong optima"),
        ]
        fitted = fit(training)
        print(f"WEIGHTS = np.array([{', '.join(f'{w:.2f}' for w in fitted)}])")
        for some in training:
            print(f"of {len(some.right)} frames, {percent(some.right.mean())} right")
    frames = of_study(options, CHECK_SEED, "check: runs")
    hidden = of_images(of_starts, options, CHECK_SEED, "check: hidden targets")
    wrong = of_images(of_wrong_optima, options, CHECK_SEED, "check: wrong optima")
    for weights in (WEIGHTS,) if fitted is None else (WEIGHTS, fitted):
        table = reliability(bins(frames, weights))
        print(f"\nweights {weights.round(2)}\n{table}\n\n{thresholds(frames, weights)}")
        print(f"\n{of_others(hidden, wrong, weights)}")
    picture = MakeOutputFolder(options.docs / "images") / "reliability.png"
    SaveFigure(plot(bins(frames, WEIGHTS)), picture)
    with WholeFile(options.docs / "confidence.md") as part:
        part.write_text(
            page(frames, of_others(hidden, wrong, WEIGHTS), fitted, options) + "\n",
            encoding="utf-8",
        )
    print(f"\nwritten: {options.docs / 'confidence.md'}, {picture}")
