"""How often poses are right of which the same confidence is told: the curve and its picture."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from confidence.frames import Array, Frames
from mffdrake.experiment.simulation.style import PALETTE

BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 1.0)
Z = 1.959964  # of a normal distribution's middle 95 %


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


def plot(curve: Sequence[Bin]) -> Figure:
    """The curve, and below it the numbers of frames."""
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.2))
    least, most = 0.005, 0.9998
    points = np.array([(b.mean, b.right / b.frames, *b.interval) for b in curve])
    x, shares, *ends = points.clip(least, most).T
    line = 1.0 / (1.0 + np.exp(-np.linspace(-6.0, 9.0, 100)))
    above.plot(line, line, color="0.6", linestyle="--", label="as told")
    above.vlines(x, *ends, color=PALETTE["blue"], linewidth=1.5, label="95 % interval")
    label = "share (at the border where 0 or 1)"
    above.plot(x, shares, "o", color=PALETTE["blue"], label=label, clip_on=False, zorder=3)
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
