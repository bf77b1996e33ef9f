"""Fits the confidence's weights, checks it on other runs, and writes docs/confidence.md.

    python benchmarks/confidence.py [--seeds 2] [--duration 2] [--workers 2] [--fit] [--only NAME]

With two seeds of 2 s it takes about a quarter of an hour on two cores, with --fit twice as long.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from robustness_conditions import MOTIONS, conditions, motion
from robustness_page import percent
from tables import markdown

from mffdrake.experiment.evaluation import IsRight
from mffdrake.experiment.files import MakeOutputFolder, WholeFile
from mffdrake.experiment.fingerprint import CodeFingerprint
from mffdrake.experiment.local_processes import LocalProcesses
from mffdrake.experiment.progress import ProgressBar
from mffdrake.experiment.scenario import Change, Scenario
from mffdrake.experiment.simulation import Simulate
from mffdrake.recognition import robust_tracker
from mffdrake.recognition.acquisition import AcquisitionParameters
from mffdrake.recognition.confidence import WEIGHTS, Evidence, confidence, features
from mffdrake.recognition.tracking_state import TrackingState

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROOT = Path(__file__).parents[1]
TRAINING_SEED, CHECK_SEED = 2000, 3000
METHODS = ("ga", "mff")
RIDGE, STEPS = 0.01, 100
BINS = np.array([0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 1.0])
MOST = 8  # lines of the list of what deceives most
Z = 1.959964  # of a normal distribution's middle 95 %

FEATURES = {
    "1": "the constant",
    "hidden": "share of the borders that the images do not show",
    "rough": "log of how far borders lie from edges, in units of 1.1 times what is expected; "
    "0 below",
    "hidden · rough": "both together",
    "unfit": "1 - fitness",
    "distrusted": "1 - mean robust weight of the borders",
    "surprise": "log of 1 + how far the pose is from where it was expected, squared, in units of "
    "what is known of the motion",
    "vague": "1 - probability that an error of the stated covariance is within 5 mm and 1 deg",
    "disagreement": "log of 1 + how far one camera's borders alone would move the pose [mm]",
}
"""Names of the `features`, and what they are."""

PAGE = """# Confidence

Written by `python benchmarks/confidence.py --seeds {seeds} --duration {duration:g}{more}`. Code:
{code}.

With `recognizer: {{refinement: borders}}` the tracker tells of every pose that it sees how likely it
is right, to 5 mm and 1 deg (`confidence`). From {believe} on it relies on the pose (`is_tracking`),
until the confidence falls below {keep} (`AcquisitionParameters.believe` and `keep`).

## What it is made of

A logistic function of these features, each at least 0 and 0 where nothing speaks against the pose
(`mffdrake.recognition.confidence.features`). No weight but the constant may be positive: more that
speaks against a pose never makes it likelier. {fitted}

{weights}

## How reliable it is

{runs} runs of {duration:g} s with seeds from {first} on, which were not used for fitting: the
conditions of the robustness study ({names}), each for two motions ({motions}) and with `ga` and
`mff`, with the flat renderer, from a random start.{failed} They have {frames} frames, of which the
{tracking} with the state TRACKING count here; {share} of these are right. (In the other states there
is no such confidence: a pose that is not seen is never called likelier than when it was.) Over all
of them the mean confidence is {mean:.4f}, and the mean squared difference between the confidence and
1 or 0 for right or wrong is {brier:.4f}; it would be {naive:.4f} if every pose was given the share
that is right.

![Share of right poses against the confidence](images/reliability.png)

{table}

The intervals (95 %, Wilson) are those of as many independent frames. Frames of a run are not: what
is wrong with one often is with the next. Where a bin's frames come from few runs, the share is less
certain than its interval says. {outside}

## What the thresholds do

*False*: the confidence is at least the threshold, but the pose is not right. *Missed*: it is below
although the pose is right. Shares of the frames above, each frame for itself, while the tracker
starts with {believe} and goes on with {keep}.

{thresholds}

{worst}

The mix of conditions is the study's own: all count alike, and most images of it are disturbed. In
another mix the same confidence may be right more or less often. No image tells of errors that agree
with it, such as a wrong focal length, or good images of another time while nothing is known of the
motion."""


@dataclass(frozen=True)
class Frames:
    """Frames with the state TRACKING, K in all.

    Attributes:
        features: See `features`, shape (K, 9).
        right: Whether their poses are, shape (K,).
        run: Numbers of the runs that they are of, shape (K,).
        names: The runs' conditions.
        total: Number of frames of all states.
        failed: Number of runs that failed.
    """

    features: Array
    right: Flags
    run: NDArray[np.int64]
    names: list[str]
    total: int
    failed: int

    def confidence(self, weights: Array) -> Array:
        """What the weights make of the frames, shape (K,)."""
        return np.asarray(1.0 / (1.0 + np.exp(-np.clip(self.features @ weights, -500.0, 500.0))))


def record(scenario: Scenario) -> tuple[Array, Flags, int]:
    """Runs a scenario.

    Returns:
        Features and whether they are right of its K frames with the state TRACKING, shapes (K, 9)
        and (K,), and the number of all frames.

    Raises:
        RuntimeError: When what was recorded is not what the tracker judged by.
    """
    judged: list[Evidence | None] = []
    with mock.patch.object(robust_tracker, "confidence", wraps=confidence) as judge:

        def on_frame(time: float, wall_s: float) -> None:
            judged.append(judge.call_args.args[0] if judge.called else None)
            judge.reset_mock()

        result = Simulate(scenario, on_frame=on_frame)
    rows, right = [], []
    for k in np.flatnonzero(result.state == TrackingState.TRACKING):
        evidence = judged[k]
        if evidence is None or confidence(evidence) != result.confidence[k]:
            raise RuntimeError(f"frame {k}: {evidence} is not what it was judged by")
        rows.append(features(evidence))
        right.append(IsRight(result)[k])
    return np.reshape(rows, (-1, len(WEIGHTS))), np.array(right, dtype=bool), len(result.time)


def collect(options: argparse.Namespace, first_seed: int, title: str) -> Frames:
    """Runs all conditions with seeds from a first one on."""
    chosen = [
        c for c in conditions(options.duration) if not options.only or c.group in options.only
    ]
    scenarios, names = [], []
    for condition in chosen:
        for name in MOTIONS:
            for method in METHODS:
                for seed in range(first_seed, first_seed + options.seeds):
                    base = motion(name, options.duration)
                    given = {"method": method, "seed": seed}
                    scenarios.append(Change(Change(base, condition.changes), given))
                    label = f"{condition.group}, {condition.strength}".removesuffix(", -")
                    names.append(f"{label} ({name}, `{method}`)")
    found: dict[int, tuple[Array, Flags, int]] = {}
    failed = 0
    with (
        LocalProcesses(options.workers) as executor,
        ProgressBar(total=len(scenarios), desc=title, unit="run") as bar,
    ):
        for outcome in executor.Run(record, [(scenario,) for scenario in scenarios]):
            if outcome.error is None:
                found[outcome.index] = outcome.value
            else:
                failed += 1
                print(f"{names[outcome.index]}: {outcome.error}")
            bar.update(1)
    if not found:
        raise SystemExit("confidence.py: no run has ended; is --only a group of the conditions?")
    order = sorted(found)  # whichever ended first, so that sums come out the same
    return Frames(
        features=np.concatenate([found[k][0] for k in order]),
        right=np.concatenate([found[k][1] for k in order]),
        run=np.concatenate([np.full(len(found[k][1]), k) for k in order]),
        names=names,
        total=sum(found[k][2] for k in order),
        failed=failed,
    )


def fit(frames: Frames) -> Array:
    """Weights of the greatest likelihood under a ridge penalty, none but the first positive.

    Newton steps among the weights that are free: at 0, one is not that would turn positive.
    """
    X, y = frames.features, frames.right
    ridge = np.full(X.shape[1], RIDGE)
    ridge[0] = 0.0

    def loss(weights: Array) -> float:
        score = X @ weights
        return float(np.sum(np.logaddexp(0.0, score) - y * score) + 0.5 * ridge @ weights**2)

    weights = np.zeros(X.shape[1])
    for _ in range(STEPS):
        p = frames.confidence(weights)
        slope = X.T @ (p - y) + ridge * weights
        free = (weights < 0.0) | (slope > 0.0)
        free[0] = True
        if np.abs(slope[free]).max() < 1e-6 * len(y):
            break
        A = X[:, free]
        curve = (A * (p * (1.0 - p))[:, None]).T @ A + np.diag(ridge[free] + 1e-9)
        step, size = np.zeros_like(weights), 1.0
        step[free] = -np.linalg.solve(curve, slope[free])
        while size > 1e-6:
            new = weights + size * step
            new[1:] = np.minimum(new[1:], 0.0)
            if loss(new) < loss(weights):
                break
            size *= 0.5
        else:
            break
        weights = new
    return weights


@dataclass(frozen=True)
class Bin:
    """Frames of like confidence: its range and mean, how many are right, of how many runs."""

    low: float
    high: float
    mean: float
    right: int
    count: int
    runs: int

    @property
    def share(self) -> float:
        """Of right poses."""
        return self.right / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """That holds the true share with 95 %, after Wilson."""
        n, share = self.count, self.share
        middle = (share + 0.5 * Z**2 / n) / (1.0 + Z**2 / n)
        half = Z / (1.0 + Z**2 / n) * np.sqrt(share * (1.0 - share) / n + 0.25 * (Z / n) ** 2)
        return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def bins(frames: Frames, weights: Array) -> list[Bin]:
    """The reliability curve; ranges without frames are left out."""
    p, found = frames.confidence(weights), []
    which = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    for k in np.unique(which):
        m = which == k
        right, count = int(frames.right[m].sum()), int(m.sum())
        runs = len(np.unique(frames.run[m]))
        found.append(Bin(BINS[k], BINS[k + 1], float(p[m].mean()), right, count, runs))
    return found


def reliability(curve: Sequence[Bin]) -> str:
    """The table of the curve."""
    header = ["confidence", "mean", "right", "95 % interval", "frames", "wrong", "of runs"]
    rows: list[list[object]] = []
    for b in curve:
        low, high = b.interval
        rows.append([
            f"{b.low:g} to {b.high:g}", f"{b.mean:.4f}", f"{b.share:.4f}",
            f"{low:.4f} to {high:.4f}", b.count, b.count - b.right, b.runs,
        ])  # fmt: skip
    return markdown(header, rows)


def thresholds(frames: Frames, weights: Array) -> str:
    """The table of false and missed frames."""
    given = AcquisitionParameters()
    p, rows = frames.confidence(weights), []
    for name, least in (("believe", given.believe), ("keep", given.keep)):
        says, right = p >= least, frames.right
        shares = [float(np.mean(m)) for m in (says, says & ~right, ~says & right)]
        rows.append([f"{least:g} (`{name}`)", *(percent(share) for share in shares)])
    return markdown(["threshold", "at least that", "false", "missed"], rows)


def worst(frames: Frames) -> str:
    """Sentences on which runs deceive most."""
    false = (frames.confidence(WEIGHTS) >= AcquisitionParameters().believe) & ~frames.right
    names = np.array(frames.names)[frames.run]
    counts = {str(name): int(false[names == name].sum()) for name in dict.fromkeys(names[false])}
    total = sum(counts.values())
    if not total:
        return "At the higher threshold no frame is false."
    most = sorted(counts, key=lambda name: -counts[name])[:MOST]
    runs = len(np.unique(frames.run[false]))
    lines = "\n".join(f"- {name}: {counts[name]} of {np.sum(names == name)}" for name in most)
    return (
        f"At the higher threshold {total} frames, of {runs} runs, are false. Most of them, of the "
        f"frames that count of the same condition:\n\n{lines}"
    )


def outside(curve: Sequence[Bin]) -> str:
    """A sentence on where the curve is off."""
    named = {True: [], False: []}  # type: dict[bool, list[str]]
    for b in curve:
        low, high = b.interval
        if not low <= b.mean <= high:
            named[b.share > b.mean].append(f"{b.low:g} to {b.high:g}")
    parts = [
        f"the poses are {word} than told in {', '.join(named[side])}"
        for side, word in ((True, "right more often"), (False, "right less often"))
        if named[side]
    ]
    if not parts:
        return "The mean confidence of every bin is within its interval."
    return f"Where the mean confidence is outside the interval, {'; '.join(parts)}."


def plot(curve: Sequence[Bin]) -> Figure:
    """The curve, and below it the numbers of frames."""
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    least, most = 0.005, 0.9998
    x = np.clip([b.mean for b in curve], least, most)
    ends = np.clip([b.interval for b in curve], least, most)
    line = 1.0 / (1.0 + np.exp(-np.linspace(-6.0, 9.0, 100)))
    above.plot(line, line, color="0.6", linestyle="--", label="as told")
    above.vlines(x, *ends.T, color="tab:blue", linewidth=1.5, label="95 % interval")
    for inner, label in ((True, "share"), (False, "share is 0 or 1")):
        m = np.array([(0 < b.right < b.count) == inner for b in curve])
        shares = np.clip([b.share for b in curve], least, most)
        face = "tab:blue" if inner else "white"
        above.plot(x[m], shares[m], "o", color="tab:blue", mfc=face, label=label, clip_on=False)
    ticks = [0.01, 0.1, 0.5, 0.9, 0.99, 0.999]
    for axis in (above.xaxis, above.yaxis):
        axis.axes.set(**{f"{axis.axis_name}scale": "logit"})
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_ticks([], minor=True)
    above.set(xlim=(least, most), ylim=(least, most), ylabel="share of right poses")
    below.vlines(x, 0.5, [b.count for b in curve], color="0.6", linewidth=9.0)
    for value, b in zip(x, curve, strict=True):
        below.annotate(
            str(b.count), (value, b.count), (0, 3), textcoords="offset points", ha="center",
            fontsize=8,
        )  # fmt: skip
    below.set(yscale="log", ylim=(0.5, 8 * max(b.count for b in curve)), ylabel="frames")
    below.set_xlabel("mean confidence of the bin")
    above.legend(loc="upper left")
    for panel in (above, below):
        panel.grid(alpha=0.3)
    return figure


def page(frames: Frames, curve: Sequence[Bin], fitted: Array | None, given: Any) -> str:
    """The whole page."""
    p, right = frames.confidence(WEIGHTS), frames.right
    header, columns = ["feature", "weight"], [WEIGHTS]
    if fitted is not None:
        header, columns = [*header, "fitted anew"], [WEIGHTS, fitted]
    rows = [
        [name, *(f"{column[k]:.2f}" for column in columns), text]
        for k, (name, text) in enumerate(FEATURES.items())
    ]
    groups = dict.fromkeys(c.group for c in conditions(given.duration))
    known = AcquisitionParameters()
    return PAGE.format(
        seeds=given.seeds, duration=given.duration, code=CodeFingerprint(),
        more=" --fit" * given.fit + "".join(f' --only "{name}"' for name in given.only),
        believe=f"{known.believe:g}", keep=f"{known.keep:g}",
        fitted="The last column was fitted by this run to as many others, with seeds from "
        f"{TRAINING_SEED} on; everything below is of the weights in use." * (fitted is not None),
        weights=markdown([*header, "what it is"], rows), runs=len(frames.names) - frames.failed,
        first=CHECK_SEED, names=", ".join(given.only or groups),
        motions=" and ".join(MOTIONS.values()), failed=f" {frames.failed} more runs failed."
        * bool(frames.failed), frames=frames.total, tracking=len(right),
        share=percent(float(right.mean())), mean=p.mean(), brier=np.mean((p - right) ** 2),
        naive=right.var(), table=reliability(curve), outside=outside(curve),
        thresholds=thresholds(frames, WEIGHTS), worst=worst(frames),
    )  # fmt: skip


def main() -> None:
    """Runs, fits and writes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="runs of each kind")
    parser.add_argument("--duration", type=float, default=2.0, help="of a run [s]")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--fit", action="store_true", help="fit the weights on other seeds before")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="a disturbance")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs", metavar="FOLDER")
    options = parser.parse_args()
    logging.getLogger("mffdrake").setLevel(logging.ERROR)  # Hundreds would warn of the same.
    fitted = None
    if options.fit:
        training = collect(options, TRAINING_SEED, "training")
        fitted = fit(training)
        print(f"WEIGHTS = np.array([{', '.join(f'{w:.2f}' for w in fitted)}])")
        print(f"of {len(training.right)} frames, {percent(training.right.mean())} right")
    frames = collect(options, CHECK_SEED, "check")
    curve = bins(frames, WEIGHTS)
    for title, weights in (("in use", WEIGHTS), ("fitted", fitted)):
        if weights is not None:
            table = reliability(bins(frames, weights))
            print(f"\nweights {title}\n{table}\n\n{thresholds(frames, weights)}")
    picture = MakeOutputFolder(options.docs / "images") / "reliability.png"
    with WholeFile(picture) as part, part.open("wb") as file:
        plot(curve).savefig(file, format="png", dpi=120)
    with WholeFile(options.docs / "confidence.md") as part:
        part.write_text(page(frames, curve, fitted, options) + "\n", encoding="utf-8")
    print(f"\nwritten: {options.docs / 'confidence.md'}, {picture}")


if __name__ == "__main__":
    main()
