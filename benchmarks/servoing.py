# ruff: noqa: E501 (text)
"""Studies of the closed loop: writes docs/studies/servoing.md and its pictures.

    python benchmarks/servoing.py [--seeds 3] [--only NAME ...]

With three seeds it takes about half an hour on two cores.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from processes import call_all
from servoing_plots import bode, decay, stability
from tables import markdown

from mffdrake.experiment.commands.servo_command import ServoDefaults
from mffdrake.experiment.runs.fingerprint import CodeFingerprint
from mffdrake.experiment.scenario.scenario import Change, Scenario
from mffdrake.experiment.simulation.plotting import SaveFigure
from mffdrake.experiment.simulation.servo_evaluation import CalcHandErrors, EvaluateServo
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile

METHODS = ("ga", "mff")
FIRST_SEED = 300
FRAME = 0.033  # [s]
FAR = 0.1  # [m] A hand farther off than that after it has settled does not follow.


@dataclass(frozen=True)
class Followed:
    """One run.

    Attributes:
        row: What `EvaluateServo` tells.
        time: Of each frame [s].
        distance: The hand's error [m].
        angle: The same [deg].
        wanted: How far the hand should have moved along x of its first frame [m].
        moved: How far it did.
    """

    row: dict[str, Any]
    time: np.ndarray
    distance: np.ndarray
    angle: np.ndarray
    wanted: np.ndarray
    moved: np.ndarray

    def holds(self, since: float) -> bool:
        """Whether the hand still follows, from a time on [s]."""
        late = self.time >= since
        return self.row["lost_s"] is None and bool(self.distance[late].max() < FAR)


def follow(values: dict[str, Any], seed: int) -> Followed:
    """Runs a scenario of `ServoDefaults` with other values."""
    logging.getLogger("mffdrake").setLevel(logging.ERROR)
    base = {"renderer": "flat", "recognizer.start": "near_target", "seed": seed}
    scenario: Scenario = Change(ServoDefaults(), {**base, **values})
    result = Simulate(scenario)
    distance, angle = CalcHandErrors(result, scenario)
    return Followed(
        EvaluateServo(result, scenario), result.time, distance, np.degrees(angle),
        result.desired_hand_pose[:, 0], result.actual_hand_pose[:, 0],
    )  # fmt: skip


def swing(period: float, amplitude: float = 0.15) -> dict[str, Any]:
    """Along the world's y."""
    return {"_tag": "!Sinusoids", "amplitude": [0.0, amplitude, 0.0], "period": [period]}


def servo(**controller: float) -> dict[str, Any]:
    """A servo with other parameters of its controller."""
    return {"_tag": "!Follow", "controller": {"gain": 8.0, **controller}}


def runs_of(
    values: Sequence[dict[str, Any]], options: argparse.Namespace, title: str
) -> list[list[Followed]]:
    """The runs of every setting, one a seed."""
    seeds = range(FIRST_SEED, FIRST_SEED + options.seeds)
    tasks = [(value, seed) for value in values for seed in seeds]
    found = call_all(follow, tasks, [f"{title} {k}" for k in range(len(tasks))], title)
    return [found[k : k + len(seeds)] for k in range(0, len(found), len(seeds))]


def mean(values: Sequence[float]) -> float:
    """Their root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def steps(options: argparse.Namespace) -> str:
    """(a) A step."""
    motion = {
        "_tag": "!Step",
        "translation": [0.0, 0.1, 0.0],
        "rotation_deg": [0.0, 0.0, 10.0],
        "time": 1.0,
    }
    settings = [{"method": m, "duration": 6.0, "target.motion": motion} for m in METHODS]
    rows, curves = [], {}
    for method, runs in zip(METHODS, runs_of(settings, options, "step"), strict=True):
        times, overshoots = [], []
        for run in runs:
            after = run.time >= 1.0
            outside = after & ((run.distance > 5e-4) | (run.angle > 0.5))
            times.append(float(run.time[outside][-1]) + FRAME - 1.0 if outside.any() else 0.0)
            way = run.wanted[-1] - run.wanted[0]
            overshoots.append(max(0.0, float(np.max((run.moved - run.wanted[0]) / way)) - 1.0))
        rows.append(
            [method, f"{np.median(times):.2f}", f"{max(times):.2f}", f"{100 * max(overshoots):.1f}"]
        )
        curves[method] = (runs[0].time - 1.0, 1e3 * runs[0].distance)
    save(decay(curves, "time after the step [s]"), "servo_step", options)
    table = markdown(
        ["method", "settled after [s], median", "longest", "overshoot, most [%]"], rows
    )
    return f"""## A step

The target is 100 mm and 10 deg farther from one moment to the next. *Settled*: to 0.5 mm and 0.5 deg, for good.

{table}

![The hand's error after a step](images/servo_step.png)"""


def velocities(options: argparse.Namespace) -> str:
    """(b) Constant velocity."""
    speed, cases = 0.05, [(gain, share) for share in (0.0, 1.0) for gain in (1.0, 3.0, 8.0)]
    motion = {"_tag": "!Straight", "velocity": [0.0, speed, 0.0]}
    settings = [
        {"duration": 6.0, "target.motion": motion, "servo": servo(gain=gain, velocity_share=share)}
        for gain, share in cases
    ]
    rows = []
    for (gain, share), runs in zip(cases, runs_of(settings, options, "velocity"), strict=True):
        lag = mean([mean(run.distance[run.time > 5.0]) for run in runs])
        rows.append(
            [
                f"{gain:g}",
                "yes" if share else "no",
                f"{1e3 * (1 - share) * speed / gain:.1f}",
                f"{1e3 * lag:.2f}",
            ]
        )
    table = markdown(
        ["gain [1/s]", "velocity fed forward", "ideal: v / gain [mm]", "lag [mm]"], rows
    )
    return f"""## Constant velocity

The target goes at 50 mm/s. Without its velocity, the hand is late by v / gain; with it, not at all.

{table}"""


def frequencies(options: argparse.Namespace) -> str:
    """(c) Frequency response."""
    periods = (20.0, 10.0, 5.0, 3.0, 2.0, 1.5, 1.0)
    sources = {
        "ga": {"method": "ga"},
        "mff": {"method": "mff"},
        "true pose": {"servo": {**servo(), "source": "truth"}},
    }
    cases = [(name, period) for name in sources for period in periods]
    settings = [
        {
            "duration": max(8.0, 2.0 * period),
            "target.motion": swing(period, 0.05),
            "servo": servo(),
            **sources[name],
        }
        for name, period in cases
    ]
    rows, curves = [], {name: [] for name in sources}
    for (name, period), runs in zip(cases, runs_of(settings, options, "frequency"), strict=True):
        ratios = [response(run, period) for run in runs]
        gain, phase = float(np.mean(np.abs(ratios))), float(np.degrees(np.angle(np.mean(ratios))))
        held = sum(run.holds(period) for run in runs)
        curves[name].append((1.0 / period, gain, phase))
        error = mean([mean(run.distance[run.time >= period]) for run in runs])
        rows.append(
            [
                name,
                f"{period:g}",
                f"{gain:.3f}",
                f"{phase:.1f}",
                f"{1e3 * error:.2f}",
                f"{held}/{len(runs)}",
            ]
        )
    save(bode(curves), "servo_bode", options)
    table = markdown(
        ["pose from", "period [s]", "gain", "phase [deg]", "hand's error, RMS [mm]", "follows"],
        rows,
    )
    return f"""## Frequency response

The target swings by 50 mm; the gain and the phase are those of the hand's way against that which it should go.

{table}

![Bode plot of the hand against the target](images/servo_bode.png)"""


def response(run: Followed, period: float) -> complex:
    """The hand's complex amplitude over the wanted one's, over whole periods at the end."""
    whole = np.floor((run.time[-1] - 0.5 * period) / period) * period
    late = run.time > run.time[-1] - max(whole, period)
    wave = np.exp(-2j * np.pi * run.time[late] / period)

    def amplitude(x: np.ndarray) -> complex:
        return complex(np.mean((x - x.mean()) * wave))

    return amplitude(run.moved[late]) / amplitude(run.wanted[late])


def latencies(options: argparse.Namespace) -> str:
    """(d) Gain against latency."""
    gains, frames = (2.0, 4.0, 8.0, 16.0, 32.0), (0, 1, 2, 3, 5)
    cases = [
        (known, n, gain) for known in (True, False) for n in frames for gain in gains if n or known
    ]
    settings = [
        {
            "duration": 8.0, "target.motion": swing(5.0), "camera.latency": FRAME * n,
            "predictor.latency": None if known else 0.0, "servo": servo(gain=gain),
        }
        for known, n, gain in cases
    ]  # fmt: skip
    held: dict[tuple[bool, int], list[str]] = {}
    errors: dict[tuple[bool, int], list[str]] = {}
    for (known, n, gain), runs in zip(cases, runs_of(settings, options, "latency"), strict=True):
        if all(run.holds(4.0) for run in runs):
            held.setdefault((known, n), []).append(f"{gain:g}")
            error = mean([mean(run.distance[run.time >= 4.0]) for run in runs])
            errors.setdefault((known, n), []).append(f"{1e3 * error:.1f}")
    rows = [
        ["yes" if known else "no", str(n), held.get((known, n), ["none"])[-1], ", ".join(errors.get((known, n), ["-"]))]
        for known in (True, False) for n in frames if n or known
    ]  # fmt: skip
    table = markdown(
        [
            "latency known",
            "frames",
            "largest gain that follows [1/s]",
            "hand's error at each gain that does [mm]",
        ],
        rows,
    )
    return f"""## Latency

The images come late by so many frames of 33 ms, and the feedforward and the estimator know it or do not. Gains of 2, 4, 8, 16 and 32 / s were tried on a target that swings by 150 mm in 5 s; with feedforward.

{table}"""


def soft_gains(damping: float | str) -> Any:
    """Gains of joints that are damped so much, or those of the paper's arm."""
    if isinstance(damping, str):
        return "lightly_damped"
    return {"_tag": "!NaturalFrequency", "frequency_hz": 1.0, "damping_ratio": damping}


def maps(options: argparse.Namespace) -> str:
    """(e) Stability, with poses as the GA leaves them."""
    dampings, gains = ("the paper's", 0.1, 0.2, 0.4, 0.7), (1.0, 2.0, 4.0, 8.0)
    cases = [(m, d, g) for m in METHODS for d in dampings for g in gains]
    settings = [
        {
            "method": m, "duration": 10.0, "target.motion": swing(10.0), "servo": servo(gain=g),
            "recognizer.refinement": "none",
            "controller": {"gains": soft_gains(d), "computed_torque": False},
        }
        for m, d, g in cases
    ]  # fmt: skip
    found = {}
    for case, runs in zip(cases, runs_of(settings, options, "stability"), strict=True):
        error = 1e3 * mean([mean(run.distance[run.time >= 5.0]) for run in runs])
        lost = float(np.mean([run.row["lost_s"] is not None for run in runs]))
        if lost:
            found[case] = np.nan, f"lost in {100 * lost:.0f} %"
        else:
            near = all(run.holds(5.0) for run in runs)
            found[case] = error, f"{error:.1f}" if near else f"({error:.0f})"
    save(stability(found, METHODS, dampings, gains), "servo_stability", options)
    rows = [
        [m, str(d), *(found[m, d, g][1] for g in gains)] for m in METHODS for d in dampings
    ]  # fmt: skip
    table = markdown(["method", "damping ratio", *(f"gain {g:g}" for g in gains)], rows)
    return f"""## A soft arm

The paper's lightly damped arm, and joints with a natural frequency of 1 Hz, from hardly damped on, without the torques of the reference's accelerations, and poses as the 1-step GA leaves them, not refined; the target swings by 150 mm in 10 s. The hand's error [mm] after 5 s, in parentheses where it is more than {1e3 * FAR:.0f} mm at times; or in how many runs the target is lost.

{table}

![Where the loop is stable](images/servo_stability.png)"""


def troubles(options: argparse.Namespace) -> str:
    """(f), (g) Occlusion, stop and reversal."""
    cases = {
        "1 s of black images": {
            "target.motion": swing(10.0),
            "disturbances": [{"_tag": "!Black", "starts": [5.0], "duration": 1.0}],
        },
        "stop from 100 mm/s": {
            "target.motion": {
                "_tag": "!Straight",
                "velocity": [0.0, 0.1, 0.0],
                "start": 3.0,
                "duration": 2.0,
            }
        },
        "reversal at 100 mm/s": {
            "target.motion": {
                "_tag": "!Straight",
                "velocity": [0.0, 0.1, 0.0],
                "start": 2.5,
                "duration": 2.5,
                "then": "reverse",
            }
        },
    }
    pairs = [(m, name) for name in cases for m in METHODS]
    settings = [{"method": m, "duration": 9.0, **cases[name]} for m, name in pairs]
    rows, curves = [], {}
    for (m, name), runs in zip(pairs, runs_of(settings, options, "trouble"), strict=True):
        during = [run.distance[(run.time > 5.0) & (run.time < 7.0)].max() for run in runs]
        late = [run.distance[(run.time > 6.95) & (run.time < 7.05)].max() for run in runs]
        rows.append(
            [
                name,
                m,
                f"{1e3 * max(during):.1f}",
                f"{1e3 * max(late):.2f}",
                f"{sum(run.holds(7.0) for run in runs)}/{len(runs)}",
            ]
        )
        if m == "mff":
            curves[name] = (runs[0].time - 5.0, 1e3 * runs[0].distance)
    save(decay(curves, "time after it happens [s]"), "servo_troubles", options)
    table = markdown(
        [
            "what happens at 5 s",
            "method",
            "greatest error within 2 s [mm]",
            "2 s after it [mm]",
            "follows",
        ],
        rows,
    )
    return f"""## Occlusion, stop and reversal

{table}

![The hand's error](images/servo_troubles.png)"""


STUDIES: dict[str, Callable[[argparse.Namespace], str]] = {
    "step": steps, "velocity": velocities, "frequency": frequencies, "latency": latencies,
    "stability": maps, "trouble": troubles,
}  # fmt: skip


def save(figure: Any, name: str, options: argparse.Namespace) -> None:
    """Writes a picture of the page."""
    SaveFigure(figure, MakeOutputFolder(options.docs / "images") / f"{name}.png")


def main() -> None:
    """Runs the studies and writes the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3, help="runs of each setting")
    parser.add_argument("--only", nargs="+", choices=STUDIES, default=list(STUDIES), metavar="NAME")
    parser.add_argument("--docs", type=Path, default=Path(__file__).parents[1] / "docs" / "studies")
    options = parser.parse_args()
    parts = [STUDIES[name](options) for name in options.only]
    page = f"""# Servoing

Written by `python benchmarks/servoing.py --seeds {options.seeds}`. Code: {CodeFingerprint()}.

`mffdrake servo` lets the hand follow a moving target by what its cameras see. A Kalman filter on the recognized poses (`TargetMotionEstimator`) tells where the target is in the world and how it moves; `VisualServoController` leads the arm's reference there. Here: the well-damped PA-10 with the torques of its reference's accelerations, a servo gain of 8 / s, refined poses and flat images, unless it is said otherwise; seeds from {FIRST_SEED} on, {options.seeds} for each setting. *Follows*: the target is never lost, and the hand stays within {1e3 * FAR:.0f} mm.

{chr(10).join(f"{part}{chr(10)}" for part in parts).rstrip()}
"""
    with WholeFile(options.docs / "servoing.md") as part:
        part.write_text(page, encoding="utf-8")
    print(f"written: {options.docs / 'servoing.md'}")


if __name__ == "__main__":
    main()
