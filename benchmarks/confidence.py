# ruff: noqa: E501 (text)
"""Fits the confidence's weights, checks it on other runs, and writes docs/confidence.md.

    python benchmarks/confidence.py [--seeds 2] [--duration 2] [--fit] [--only NAME]

With two seeds of 2 s it takes about a quarter of an hour on two cores, with --fit twice as long.
"""

from __future__ import annotations

import argparse
import itertools
import logging
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from acquisition import CASES
from confidence_frames import Judged, of_run, of_starts, of_wrong_optima
from matplotlib.figure import Figure
from numpy.typing import NDArray
from processes import call_all
from robustness_conditions import MOTIONS, conditions, motion, texts
from robustness_page import METHODS, percent
from tables import markdown

from mffdrake.experiment.runs.fingerprint import CodeFingerprint
from mffdrake.experiment.scenario.scenario import Change
from mffdrake.experiment.simulation.plotting import SaveFigure
from mffdrake.recognition.acquisition.acquisition import AcquisitionParameters
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile
from mffdrake.recognition.tracking.confidence import WEIGHTS

Array = NDArray[np.float64]

TRAINING_SEED, CHECK_SEED = 2000, 3000
RIDGE, STEPS = 0.01, 100
POSES = 20  # of each of the acquisition study's cases, a seed and a renderer
RENDERERS = ("flat", "vtk")
LIMITS = np.array([np.inf] + (len(WEIGHTS) - 1) * [0.0])
BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 1.0)
Z = 1.959964  # of a normal distribution's middle 95 %

FEATURES = {
    "1": "the constant",
    "hidden · unfit": "share of the borders that the images do not show, times 1 - fitness",
    "uneven": "how much larger the share that they show is in one camera's image than in another's",
    "rough": "log of how far borders lie from edges, in units of 1.1 times what is expected; 0 below",
    "unfit · rough": "1 - fitness, times that",
    "outliers": "1 - mean robust weight of the borders",
    "innovation": "log of 1 + how far the pose is from where it was expected, squared, in units of what is known of the motion",
    "vague": "1 - probability that an error of the stated covariance is within 5 mm and 1 deg",
    "disagreement": "log of 1 + how far one camera's borders alone would move the pose [mm]",
}
"""Names of the `features`, and what they are."""

PAGE = """# Confidence

Written by `python benchmarks/confidence.py --seeds {seeds} --duration {duration:g}{more}`. Code: {code}.

With `recognizer: {{refinement: borders}}` the tracker tells of every pose that it sees how likely it is right, to 5 mm and 1 deg (`confidence`). From {believe:g} on it relies on the pose (`is_tracking`), until the confidence falls below {keep:g} (`AcquisitionParameters.believe` and `keep`).

## What it is made of

A logistic function of these features, each at least 0 and 0 where nothing speaks against the pose (`mffdrake.recognition.tracking.confidence.features`). No weight but the constant's may be positive: more that speaks against a pose never makes it likelier. {fitted}

{weights}

## How reliable it is

{runs} runs of {duration:g} s with seeds from {first} on, apart from those of `--fit`: the conditions of the robustness study ({names}), each for two motions ({motions}) and with `ga` and `mff`, with the flat renderer, from a random start. They have {frames} frames, of which the {tracking} with the state TRACKING count here; {share} of these are right. (Other states have no confidence of this kind.) The mean confidence is {mean:.4f}; the mean squared difference between the confidence and 1 or 0 for right or wrong is {brier:.4f}, and would be {naive:.4f} if every pose was given the share that is right.

![Share of right poses against the confidence](images/reliability.png)

{table}

The intervals (95 %, Wilson) are those of as many independent frames. Frames of a run are not: what is wrong with one often is with the next. Where a bin's wrong frames come from few runs, its share is less certain than the interval says. {outside}

## What the thresholds do

*False*: the confidence is at least the threshold, but the pose is not right. *Missed*: it is below although the pose is right. Shares of the frames above, each judged by itself; the tracker starts with the higher threshold and goes on with the lower one.

{thresholds}

{others}

{worst}

All conditions count alike, and most images are disturbed. In another mix the same confidence may be right more or less often. No image tells of errors that agree with it, such as a wrong focal length."""


@dataclass(frozen=True)
class Frames:
    """Frames with the state TRACKING: their features, whether the poses are right, of which run.

    And the names of the runs' conditions, and the number of frames of all states.
    """

    features: Array
    right: NDArray[np.bool_]
    run: NDArray[np.int64]
    names: list[str]
    total: int

    @classmethod
    def of(cls, parts: Sequence[Judged], names: list[str]) -> Frames:
        """The frames of several runs with names."""
        rows, right, totals = zip(*parts, strict=True)
        run = np.repeat(np.arange(len(right)), [len(one) for one in right])
        return cls(np.concatenate(rows), np.concatenate(right), run, names, sum(totals))

    def confidence(self, weights: Array) -> Array:
        """What the weights make of the frames, shape (K,)."""
        return logistic(self.features, weights)


def of_study(options: argparse.Namespace, first_seed: int, title: str) -> Frames:
    """The frames of all conditions' runs with seeds from a first one on."""
    groups = options.only or texts()
    chosen = [c for c in conditions(options.duration) if c.group in groups]
    scenarios, names = [], []
    seeds = range(first_seed, first_seed + options.seeds)
    for condition, name, method, seed in itertools.product(chosen, MOTIONS, METHODS, seeds):
        base = Change(motion(name, options.duration), condition.changes)
        scenarios.append((Change(base, {"method": method, "seed": seed}),))
        label = f"{condition.group}, {condition.strength}".removesuffix(", -")
        names.append(f"{label} ({name}, `{method}`)")
    return Frames.of(call_all(of_run, scenarios, names, title), names)


def of_images(
    function: Callable[..., Judged], options: argparse.Namespace, seed: int, title: str
) -> Frames:
    """What a function judges of poses of the acquisition study's cases, with each renderer."""
    cases = [case for case in CASES if case.hidden or function is of_wrong_optima]
    shown = list(itertools.product(cases, RENDERERS))
    tasks = [(case, renderer, seed, range(POSES * options.seeds)) for case, renderer in shown]
    names = [f"{case.name} ({renderer})" for case, renderer in shown]
    return Frames.of(call_all(function, tasks, names, title), names)


def fit(frames: Sequence[Frames]) -> Array:
    """Weights of the greatest likelihood under a ridge penalty, none but the first positive.

    Newton steps among the weights that are free: at 0, one is not that would turn positive.
    """
    X = np.concatenate([some.features for some in frames])
    y = np.concatenate([some.right for some in frames])
    ridge = np.where(np.isinf(LIMITS), 0.0, RIDGE)

    def loss(weights: Array) -> float:
        score = X @ weights
        return float(np.sum(np.logaddexp(0.0, score) - y * score) + 0.5 * ridge @ weights**2)

    weights = np.zeros(X.shape[1])
    for _ in range(STEPS):
        p = logistic(X, weights)
        slope = X.T @ (p - y) + ridge * weights
        free = (weights < LIMITS) | (slope > 0.0)
        if np.abs(slope[free]).max() < 1e-6 * len(y):
            break
        A = X[:, free]
        curve = (A * (p * (1.0 - p))[:, None]).T @ A + np.diag(ridge[free] + 1e-9)
        step = np.zeros_like(weights)
        step[free] = -np.linalg.solve(curve, slope[free])
        trials = (np.minimum(weights + size * step, LIMITS) for size in 0.5 ** np.arange(20))
        weights = next((trial for trial in trials if loss(trial) < loss(weights)), weights)
    else:
        raise RuntimeError(f"the fit has not settled after {STEPS} steps")
    return weights


def logistic(rows: Array, weights: Array) -> Array:
    """The confidence that weights make of features, shape (K,)."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(rows @ weights, -500.0, 500.0))))


class Bin(NamedTuple):
    """Frames of like confidence: its range and mean, how many are right, and of how many runs."""

    low: float
    high: float
    mean: float
    right: int
    frames: int
    runs: int
    wrong_runs: int

    @property
    def interval(self) -> tuple[float, float]:
        """That holds the true share of right poses with 95 %, after Wilson."""
        n, share = self.frames, self.right / self.frames
        middle, scale = share + 0.5 * Z**2 / n, 1.0 + Z**2 / n
        half = Z * math.sqrt(share * (1.0 - share) / n + 0.25 * (Z / n) ** 2)
        return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


def bins(frames: Frames, weights: Array) -> list[Bin]:
    """The reliability curve; ranges without frames are left out."""
    p, found = frames.confidence(weights), []
    for low, high in itertools.pairwise(BINS):
        m = (p >= low) & ((p < high) | (high == 1.0))
        if m.any():
            right, of, wrong = frames.right[m], frames.run[m], frames.run[m & ~frames.right]
            runs = len(np.unique(of)), len(np.unique(wrong))
            found.append(Bin(low, high, float(p[m].mean()), int(right.sum()), len(of), *runs))
    return found


def reliability(curve: Sequence[Bin]) -> str:
    """The table of the curve."""
    header = "confidence", "mean", "right", "95 % interval", "frames", "runs", "wrong", "of runs"
    rows: list[list[object]] = []
    for b in curve:
        share, interval = f"{b.right / b.frames:.4f}", "{:.4f} to {:.4f}".format(*b.interval)
        counts = b.frames, b.runs, b.frames - b.right, b.wrong_runs
        rows.append([f"{b.low:g} to {b.high:g}", f"{b.mean:.4f}", share, interval, *counts])
    return markdown(list(header), rows)


def thresholds(frames: Frames, weights: Array) -> str:
    """The table of false and missed frames."""
    given, p, right = AcquisitionParameters(), frames.confidence(weights), frames.right
    rows: list[list[object]] = []
    for name, least in (("believe", given.believe), ("keep", given.keep)):
        says = p >= least
        shares = [percent(float(np.mean(m))) for m in (says, says & ~right, ~says & right)]
        rows.append([f"{least:g} (`{name}`)", *shares])
    return markdown(["threshold", "at least that", "false", "missed"], rows)


def of_others(hidden: Frames, wrong: Frames, weights: Array) -> str:
    """Sentences on the check's hidden targets and wrong optima."""
    least = AcquisitionParameters().believe
    says = hidden.confidence(weights) >= least
    false, missed = np.mean(says & ~hidden.right), np.mean(~says & hidden.right)
    deceive = np.sum(wrong.confidence(weights) >= least)
    return f"Of {len(says)} frames with targets of all shapes that are hidden by 40 % from the start (`benchmarks/acquisition.py`, {len(hidden.names)} cases, flat and VTK), {percent(float(false))} are false at the higher threshold and {percent(float(missed))} missed. Of {len(wrong.right)} wrong poses that explain their borders, to which steps lead from beside the true ones of all cases, {deceive} reach it."


def worst(frames: Frames) -> str:
    """Sentences on which runs deceive most."""
    false = (frames.confidence(WEIGHTS) >= AcquisitionParameters().believe) & ~frames.right
    if not false.any():
        return "At the higher threshold no frame is false."
    names = np.array(frames.names)[frames.run]
    most = Counter(names[false].tolist()).most_common(8)
    lines = "\n".join(f"- {name}: {count} of {np.sum(names == name)}" for name, count in most)
    runs = len(np.unique(frames.run[false]))
    return f"At the higher threshold {false.sum()} frames, of {runs} runs, are false. The conditions with most of them, and of how many frames that count:\n\n{lines}"


def outside(curve: Sequence[Bin]) -> str:
    """A sentence on where the curve is off."""
    off = [
        f"{b.low:g} to {b.high:g} (too {'high' if b.mean > b.interval[1] else 'low'})"
        for b in curve
        if not b.interval[0] <= b.mean <= b.interval[1]
    ]
    named = f"outside it in {len(off)} of {len(curve)} bins: {', '.join(off)}"
    return f"The mean confidence is {named if off else 'within the interval of every bin'}."


def plot(curve: Sequence[Bin]) -> Figure:
    """The curve, and below it the numbers of frames."""
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.2))
    least, most = 0.005, 0.9998
    points = np.array([(b.mean, b.right / b.frames, *b.interval) for b in curve])
    x, shares, *ends = points.clip(least, most).T
    line = 1.0 / (1.0 + np.exp(-np.linspace(-6.0, 9.0, 100)))
    above.plot(line, line, color="0.6", linestyle="--", label="as told")
    above.vlines(x, *ends, color="tab:blue", linewidth=1.5, label="95 % interval")
    label = "share (at the border where 0 or 1)"
    above.plot(x, shares, "o", color="tab:blue", label=label, clip_on=False, zorder=3)
    ticks = [0.01, 0.1, 0.5, 0.9, 0.99, 0.999]
    for axis in (above.xaxis, above.yaxis):
        axis.axes.set(**{f"{axis.axis_name}scale": "logit"})
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_ticks([], minor=True)
    above.set(xlim=(least, most), ylim=(least, most), ylabel="share of right poses")
    below.vlines(x, 0.5, [b.frames for b in curve], color="0.6", linewidth=9.0)
    for value, b in zip(x, curve, strict=True):
        below.text(value, 1.3 * b.frames, str(b.frames), ha="center", fontsize=8)
    below.set(yscale="log", ylim=(0.5, 8 * max(b.frames for b in curve)))
    below.set(xlabel="mean confidence of the bin", ylabel="frames")
    above.legend(loc="upper left")
    above.grid(alpha=0.3)
    below.grid(alpha=0.3)
    return figure


def page(frames: Frames, others: str, fitted: Array | None, given: argparse.Namespace) -> str:
    """The whole page."""
    p, right, curve = frames.confidence(WEIGHTS), frames.right, bins(frames, WEIGHTS)
    columns = {"weight": WEIGHTS} | ({} if fitted is None else {"fitted anew": fitted})
    numbers = np.transpose(list(columns.values()))
    rows: list[list[object]] = [
        [name, *(f"{number:.2f}" for number in line), text]
        for (name, text), line in zip(FEATURES.items(), numbers, strict=True)
    ]
    known = AcquisitionParameters()
    return PAGE.format(
        seeds=given.seeds, duration=given.duration, code=CodeFingerprint(),
        more=" --fit" * given.fit + "".join(f' --only "{name}"' for name in given.only),
        believe=known.believe, keep=known.keep,
        fitted=f"Those fitted anew are of as many other runs, with seeds from {TRAINING_SEED} on, of hidden targets, and of wrong optima; all below "
        "is of the weights in use." * (fitted is not None),
        weights=markdown(["feature", *columns, "what it is"], rows), runs=len(frames.names),
        first=CHECK_SEED, names=", ".join(given.only or texts()),
        motions=" and ".join(MOTIONS.values()), frames=frames.total, tracking=len(right),
        share=percent(float(right.mean())), mean=p.mean(), brier=np.mean((p - right) ** 2),
        naive=right.var(), table=reliability(curve), outside=outside(curve),
        thresholds=thresholds(frames, WEIGHTS), others=others, worst=worst(frames),
    )  # fmt: skip


def main() -> None:
    """Runs, fits and writes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="runs of each kind")
    parser.add_argument("--duration", type=float, default=2.0, help="of a run [s]")
    parser.add_argument("--fit", action="store_true", help="fit the weights on other seeds before")
    parser.add_argument("--only", action="append", default=[], choices=texts(), help="a group")
    parser.add_argument("--docs", type=Path, default=Path(__file__).parents[1] / "docs")
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


if __name__ == "__main__":
    main()
