# ruff: noqa: E501 (text)
"""The page of the studies of servoing: every number in it is read off the runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from studies.servoing_plan import DAMPINGS, FIRST_SEED, FRAME, METHODS, SOFT_GAINS
from studies.servoing_plots import bode, decay, stability

from mffdrake.experiment.runs.engine import EndedRun
from mffdrake.experiment.runs.table import SummaryTable
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.evaluation import Column, FlattenRow
from mffdrake.experiment.simulation.recovery import CalcHandErrors

FAR = 0.1  # [m] A hand farther off than that after it has settled does not follow.


@dataclass(frozen=True)
class Followed:
    """One run.

    Attributes:
        labels: What tables call it.
        row: Its figures; what the study makes of it is added.
        time: Of each frame [s].
        distance: The hand's error [m].
        angle: The same [deg].
        wanted: How far the hand should have moved along x of its first frame [m].
        moved: How far it did.
    """

    labels: dict[str, Any]
    row: dict[str, Any]
    time: np.ndarray
    distance: np.ndarray
    angle: np.ndarray
    wanted: np.ndarray
    moved: np.ndarray

    @classmethod
    def of(cls, ended: EndedRun) -> Followed:
        """What was kept of a run."""
        if ended.frames is None:
            raise RuntimeError(f"{dict(ended.run.labels)}: {ended.record.error}")
        frames = ended.frames
        distance, angle = CalcHandErrors(frames, LoadScenario(text=frames.scenario))
        return cls(
            {k: v for k, v in ended.run.labels.items() if k != "study"}, FlattenRow(ended.Row()),
            frames.time, distance, np.degrees(angle),
            frames.desired_hand_pose[:, 0], frames.actual_hand_pose[:, 0],
        )  # fmt: skip

    def rms_mm(self, since: float) -> float:
        """The hand's root-mean-square error from a time on [s]."""
        return 1e3 * float(np.sqrt(np.mean(self.distance[self.time >= since] ** 2)))

    def follows(self, since: float) -> bool:
        """Whether the hand still follows, from a time on [s]."""
        late = self.time >= since
        return self.row["lost_s"] is None and bool(self.distance[late].max() < FAR)


Pictures = dict[str, Figure]


def column(name: str, form: str = ".2f", *, is_mean: bool = False) -> Column:
    """A figure that a study adds to its rows, called as its heading is."""
    return Column(name, float, lambda run: None, name, form, is_mean=is_mean)


FOLLOWS = column("follows", ".0%", is_mean=True)


def table(runs: Sequence[Followed], *more: Column) -> str:
    """Medians over the seeds."""
    return SummaryTable([run.row for run in runs], list(runs[0].labels), more=more)


def step(runs: Sequence[Followed]) -> tuple[str, Pictures]:
    """A step."""
    curves: dict[str, Any] = {}
    for run in runs:
        after = run.time >= 1.0
        outside = run.time[after & ((run.distance > 5e-4) | (run.angle > 0.5))]
        way = run.wanted[-1] - run.wanted[0]
        beyond = float(np.max((run.moved - run.wanted[0]) / way)) - 1.0
        run.row["settled after [s]"] = float(outside[-1]) + FRAME - 1.0 if len(outside) else 0.0
        run.row["overshoot"] = max(0.0, beyond)
        curves.setdefault(run.labels["method"], (run.time - 1.0, 1e3 * run.distance))
    return (
        f"""## A step

The target is 100 mm and 10 deg farther from one moment to the next. *Settled*: to 0.5 mm and 0.5 deg, for good.

{table(runs, column("settled after [s]"), column("overshoot", ".1%"))}

![The hand's error after a step](images/servo_step.png)""",
        {"servo_step": decay(curves, "time after the step [s]")},
    )


def velocity(runs: Sequence[Followed]) -> tuple[str, Pictures]:
    """Constant velocity."""
    for run in runs:
        run.row["lag [mm]"] = run.rms_mm(5.0)
    return (
        f"""## Constant velocity

The target goes at 50 mm/s. Without its velocity, the hand is late by v / gain, the ideal lag; with it, not at all.

{table(runs, column("lag [mm]"))}""",
        {},
    )


def frequency(runs: Sequence[Followed]) -> tuple[str, Pictures]:
    """Frequency response."""
    ratios: dict[tuple[str, float], list[complex]] = {}
    for run in runs:
        source, period = run.labels.values()
        ratio = response(run, period)
        ratios.setdefault((source, period), []).append(ratio)
        run.row["gain"], run.row["phase [deg]"] = abs(ratio), float(np.degrees(np.angle(ratio)))
        run.row["error [mm]"], run.row["follows"] = run.rms_mm(period), run.follows(period)
    curves: dict[str, list[tuple[float, float, float]]] = {}
    for (source, period), found in ratios.items():
        phase = float(np.degrees(np.angle(np.mean(found))))
        curves.setdefault(source, []).append((1.0 / period, float(np.mean(np.abs(found))), phase))
    more = (column("gain", ".3f"), column("phase [deg]", ".1f"), column("error [mm]"), FOLLOWS)
    return (
        f"""## Frequency response

The target swings by 50 mm; the gain and the phase are those of the hand's way against that which it should go.

{table(runs, *more)}

![Bode plot of the hand against the target](images/servo_bode.png)""",
        {"servo_bode": bode(curves)},
    )


def response(run: Followed, period: float) -> complex:
    """The hand's complex amplitude over the wanted one's, over whole periods at the end."""
    whole = np.floor((run.time[-1] - 0.5 * period) / period) * period
    late = run.time > run.time[-1] - max(whole, period)
    wave = np.exp(-2j * np.pi * run.time[late] / period)

    def amplitude(x: np.ndarray) -> complex:
        return complex(np.mean((x - x.mean()) * wave))

    return amplitude(run.moved[late]) / amplitude(run.wanted[late])


def latency(runs: Sequence[Followed]) -> tuple[str, Pictures]:
    """Gain against latency."""
    for run in runs:
        run.row["error [mm]"], run.row["follows"] = run.rms_mm(4.0), run.follows(4.0)
    return (
        f"""## Latency

The images come late by so many frames of 33 ms, and the feedforward and the estimator know it or do not. The target swings by 150 mm in 5 s; with feedforward. The error is that of the hand after 4 s.

{table(runs, column("error [mm]", ".1f"), FOLLOWS)}""",
        {},
    )


def soft(runs: Sequence[Followed]) -> tuple[str, Pictures]:
    """Stability."""
    groups: dict[tuple[str, str, float], list[Followed]] = {}
    for run in runs:
        run.row["error [mm]"], run.row["follows"] = run.rms_mm(5.0), run.follows(5.0)
        run.row["lost"] = float(run.row["lost_s"] is not None)
        groups.setdefault(tuple(run.labels.values()), []).append(run)
    found: dict[tuple[str, float | str, float], tuple[float, str]] = {}
    for (method, damping, gain), members in groups.items():
        error = float(np.sqrt(np.mean([run.row["error [mm]"] ** 2 for run in members])))
        lost = float(np.mean([run.row["lost"] for run in members]))
        near = all(run.row["follows"] for run in members)
        told = f"{error:.1f}" if near else f"({error:.0f})"
        key = (method, damping, gain)
        found[key] = (np.nan, f"lost in {100 * lost:.0f} %") if lost else (error, told)
    picture = stability(found, METHODS, [str(d) for d in DAMPINGS], SOFT_GAINS)
    more = (column("error [mm]", ".1f"), column("lost", ".0%", is_mean=True), FOLLOWS)
    return (
        f"""## A soft arm

The paper's lightly damped arm, and joints with a natural frequency of 1 Hz, from hardly damped on, without the torques of the reference's accelerations, and poses as the 1-step GA leaves them, not refined; the target swings by 150 mm in 10 s. The error is that of the hand after 5 s; in the picture in parentheses where it is more than {1e3 * FAR:.0f} mm at times.

{table(runs, *more)}

![Where the loop is stable](images/servo_stability.png)""",
        {"servo_stability": picture},
    )


def trouble(runs: Sequence[Followed]) -> tuple[str, Pictures]:
    """Occlusion, stop and reversal."""
    curves: dict[str, Any] = {}
    for run in runs:
        during = (run.time > 5.0) & (run.time < 7.0)
        late = (run.time > 6.95) & (run.time < 7.05)
        run.row["within 2 s [mm]"] = 1e3 * float(run.distance[during].max())
        run.row["2 s after [mm]"] = 1e3 * float(run.distance[late].max())
        run.row["follows"] = run.follows(7.0)
        if run.labels["method"] == "mff":
            curves.setdefault(run.labels["at 5 s"], (run.time - 5.0, 1e3 * run.distance))
    more = (column("within 2 s [mm]", ".1f"), column("2 s after [mm]"), FOLLOWS)
    return (
        f"""## Occlusion, stop and reversal

The hand's greatest error within 2 s from when it happens, and 2 s after it.

{table(runs, *more)}

![The hand's error](images/servo_troubles.png)""",
        {"servo_troubles": decay(curves, "time after it happens [s]")},
    )


PARTS: dict[str, Callable[[Sequence[Followed]], tuple[str, Pictures]]] = {
    "step": step, "velocity": velocity, "frequency": frequency, "latency": latency,
    "stability": soft, "trouble": trouble,
}  # fmt: skip


def page(parts: Sequence[str], seeds: int, code: str) -> str:
    """The whole page, of its parts."""
    text = "\n\n".join(parts)
    return f"""# Servoing

Written by `python benchmarks/servoing.py --seeds {seeds}`. Code: {code}.

`mffdrake servo` lets the hand follow a moving target by what its cameras see. A Kalman filter on the recognized poses (`TargetMotionEstimator`) tells where the target is in the world and how it moves; `VisualServoController` leads the arm's reference there. Here: the well-damped PA-10 with the torques of its reference's accelerations, a servo gain of 8 / s, refined poses and flat images, unless it is said otherwise; seeds from {FIRST_SEED} on, {seeds} for each setting. *hand*: root mean square of the hand's error, of all frames (or those from 10 s on, where all runs are that long). *follows*: share of the runs in which the target is never lost, and the hand stays within {1e3 * FAR:.0f} mm. Tables have medians over the seeds, of shares means.

{text}
"""
