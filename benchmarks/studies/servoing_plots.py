"""Pictures of the studies of servoing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from mffdrake.experiment.simulation.style import COLORS as POSE_COLORS
from mffdrake.experiment.simulation.style import METHOD_COLORS, PALETTE

COLORS = {**METHOD_COLORS, "true pose": POSE_COLORS["true"]}


def decay(curves: Mapping[str, tuple[np.ndarray, np.ndarray]], label: str) -> Figure:
    """The hand's error over time, each of some cases."""
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axis = figure.subplots()
    axis.set_prop_cycle(color=list(PALETTE.values()))
    for name, (time, error) in curves.items():
        axis.semilogy(time, np.maximum(error, 0.01), label=name, color=COLORS.get(name), lw=1.2)
    axis.set_xlabel(label)
    axis.set_ylabel("hand's error [mm]")
    axis.grid(alpha=0.3, which="both")
    axis.margins(x=0.01)
    axis.legend()
    return figure


def bode(curves: Mapping[str, Sequence[tuple[float, float, float]]]) -> Figure:
    """Gain and phase over frequency."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for name, rows in curves.items():
        frequency, gain, phase = np.array(rows).T
        above.semilogx(frequency, 20.0 * np.log10(gain), "o-", color=COLORS[name], label=name, ms=4)
        below.semilogx(frequency, phase, "o-", color=COLORS[name], ms=4)
    above.set_ylabel("gain [dB]")
    below.set_ylabel("phase [deg]")
    below.set_xlabel("frequency of the target [Hz]")
    for axis in (above, below):
        axis.grid(alpha=0.3, which="both")
    above.legend()
    return figure


def stability(
    found: Mapping[tuple[str, float | str, float], tuple[float, str]],
    methods: Sequence[str],
    dampings: Sequence[float | str],
    gains: Sequence[float],
) -> Figure:
    """The hand's error [mm], and what to write, over damping and gain; black where it is NaN."""
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    for axis, method in zip(figure.subplots(1, len(methods)), methods, strict=True):
        grid = np.array([[found[method, d, g][0] for g in gains] for d in dampings])
        axis.set_facecolor("black")
        image = axis.imshow(np.log10(grid), origin="lower", aspect="auto", vmin=0.0, vmax=2.0)
        for i in range(len(dampings)):
            for j in range(len(gains)):
                text = found[method, dampings[i], gains[j]][1].replace(" in ", "\n")
                axis.text(j, i, text, ha="center", va="center", color="white")
        axis.set_xticks(range(len(gains)), [f"{g:g}" for g in gains])
        axis.set_yticks(range(len(dampings)), [str(d) for d in dampings])
        axis.set_xlabel("servo gain [1/s]")
        axis.set_title(method)
    figure.axes[0].set_ylabel("arm's damping ratio")
    bar = figure.colorbar(image, ax=figure.axes, label="hand's error [mm]", ticks=[0, 1, 2])
    bar.ax.set_yticklabels(["1", "10", "100"])
    return figure
