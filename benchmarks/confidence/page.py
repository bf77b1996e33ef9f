# ruff: noqa: E501 (text)
"""The page: its tables, and its sentences on what they show."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence

import numpy as np
from studies.robustness_conditions import MOTIONS
from studies.robustness_page import TEXTS, percent

from confidence.frames import CHECK_SEED, TRAINING_SEED, Array, Frames
from confidence.reliability import Bin, bins
from mffdrake.experiment.runs.store import CodeFingerprint
from mffdrake.experiment.runs.table import Markdown
from mffdrake.recognition.acquisition.acquisition import AcquisitionParameters
from mffdrake.recognition.tracking.confidence import WEIGHTS

FEATURES = {
    "1": "the constant",
    "hidden · unfit": "share of the borders that the images do not show, times 1 - fitness",
    "uneven": "how much larger the share that they show is in one camera's image than in another's",
    "rough": "log of how far borders lie from edges, in units of 1.1 times what is expected; 0 below",
    "unfit · rough": "1 - fitness, times that",
    "distrusted": "1 - mean robust weight of the borders",
    "surprise": "log of 1 + how far the pose is from where it was expected, squared, in units of what is known of the motion",
    "vague": "1 - probability that an error of the stated covariance is within 5 mm and 1 deg",
    "disagreement": "log of 1 + how far one camera's borders alone would move the pose [mm]",
}
"""Names of the `features`, and what they are."""

PAGE = """# Confidence

Written by `python benchmarks confidence --seeds {seeds} --duration {duration:g}{more}`. Code: {code}.

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


def reliability(curve: Sequence[Bin]) -> str:
    """The table of the curve."""
    header = "confidence", "mean", "right", "95 % interval", "frames", "runs", "wrong", "of runs"
    rows: list[list[object]] = []
    for b in curve:
        share, interval = f"{b.right / b.frames:.4f}", "{:.4f} to {:.4f}".format(*b.interval)
        counts = b.frames, b.runs, b.frames - b.right, b.wrong_runs
        rows.append([f"{b.low:g} to {b.high:g}", f"{b.mean:.4f}", share, interval, *counts])
    return Markdown(list(header), rows)


def thresholds(frames: Frames, weights: Array) -> str:
    """The table of false and missed frames."""
    given, p, right = AcquisitionParameters(), frames.confidence(weights), frames.right
    rows: list[list[object]] = []
    for name, least in (("believe", given.believe), ("keep", given.keep)):
        says = p >= least
        shares = [percent(float(np.mean(m))) for m in (says, says & ~right, ~says & right)]
        rows.append([f"{least:g} (`{name}`)", *shares])
    return Markdown(["threshold", "at least that", "false", "missed"], rows)


def of_others(hidden: Frames, wrong: Frames, weights: Array) -> str:
    """Sentences on the check's hidden targets and wrong optima."""
    least = AcquisitionParameters().believe
    says = hidden.confidence(weights) >= least
    false, missed = np.mean(says & ~hidden.right), np.mean(~says & hidden.right)
    deceive = np.sum(wrong.confidence(weights) >= least)
    return f"Of {len(says)} frames with targets of all shapes that are hidden by 40 % from the start (`benchmarks/acquisition/study.py`, {len(hidden.names)} cases, flat and VTK), {percent(float(false))} are false at the higher threshold and {percent(float(missed))} missed. Of {len(wrong.right)} wrong poses that explain their borders, to which steps lead from beside the true ones of all cases, {deceive} reach it."


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
        weights=Markdown(["feature", *columns, "what it is"], rows), runs=len(frames.names),
        first=CHECK_SEED, names=", ".join(given.only or TEXTS),
        motions=" and ".join(MOTIONS.values()), frames=frames.total, tracking=len(right),
        share=percent(float(right.mean())), mean=p.mean(), brier=np.mean((p - right) ** 2),
        naive=right.var(), table=reliability(curve), outside=outside(curve),
        thresholds=thresholds(frames, WEIGHTS), others=others, worst=worst(frames),
    )  # fmt: skip
