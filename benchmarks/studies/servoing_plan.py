"""What the studies of the closed loop run: plans for the engine."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

from mffdrake.experiment.runs.engine import PlannedRun
from mffdrake.experiment.scenario.scenario import Change, ServoDefaults

METHODS = ("ga", "mff")
FIRST_SEED = 300
FRAME = 0.033  # [s]
SPEED = 0.05  # [m/s], of constant velocity
BASE = {"renderer": "flat", "recognizer.start": "near_target"}
DAMPINGS, SOFT_GAINS = ("the paper's", 0.1, 0.2, 0.4, 0.7), (1.0, 2.0, 4.0, 8.0)
Case = tuple[dict[str, Any], dict[str, Any]]  # What tables call it, and what the scenario changes.


def swing(period: float, amplitude: float = 0.15) -> dict[str, Any]:
    """A motion along the world's y."""
    return {"_tag": "!Sinusoids", "amplitude": [0.0, amplitude, 0.0], "period": [period]}


def straight(speed: float, **more: Any) -> dict[str, Any]:
    """A motion at constant velocity along the world's y."""
    return {"_tag": "!Straight", "velocity": [0.0, speed, 0.0], **more}


def servo(gain: float = 8.0, **controller: float) -> dict[str, Any]:
    """A servo with other parameters of its controller."""
    return {"_tag": "!Follow", "controller": {"gain": gain, **controller}}


def step() -> Iterator[Case]:
    """A step of 100 mm and 10 deg."""
    motion = {"_tag": "!Step", "translation": [0.0, 0.1, 0.0], "rotation_deg": [0.0, 0.0, 10.0],
              "time": 1.0}  # fmt: skip
    for method in METHODS:
        yield {"method": method}, {"method": method, "duration": 6.0, "target.motion": motion}


def velocity() -> Iterator[Case]:
    """Constant velocity, with and without its feedforward."""
    for share, gain in itertools.product((0.0, 1.0), (1.0, 3.0, 8.0)):
        yield (
            {"velocity fed forward": "yes" if share else "no", "gain [1/s]": gain,
             "ideal lag [mm]": 1e3 * (1.0 - share) * SPEED / gain},
            {"duration": 6.0, "target.motion": straight(SPEED),
             "servo": servo(gain, velocity_share=share)},
        )  # fmt: skip


def frequency() -> Iterator[Case]:
    """A swing of 50 mm at many frequencies."""
    sources = {"ga": {"method": "ga"}, "mff": {"method": "mff"},
               "true pose": {"servo": {**servo(), "source": "truth"}}}  # fmt: skip
    for source, period in itertools.product(sources, (20.0, 10.0, 5.0, 3.0, 2.0, 1.5, 1.0)):
        yield (
            {"pose from": source, "period [s]": period},
            {"duration": max(8.0, 2.0 * period), "target.motion": swing(period, 0.05),
             "servo": servo(), **sources[source]},
        )  # fmt: skip


def latency() -> Iterator[Case]:
    """Gain against latency, known or not."""
    cases = itertools.product((True, False), (0, 1, 2, 3, 5), (2.0, 4.0, 8.0, 16.0, 32.0))
    for known, frames, gain in cases:
        if frames or known:
            yield (
                {"latency known": "yes" if known else "no", "frames": frames, "gain [1/s]": gain},
                {"duration": 8.0, "target.motion": swing(5.0), "camera.latency": FRAME * frames,
                 "predictor.latency": None if known else 0.0, "servo": servo(gain)},
            )  # fmt: skip


def stability() -> Iterator[Case]:
    """Soft arms, with poses as the GA leaves them."""
    for method, damping, gain in itertools.product(METHODS, DAMPINGS, SOFT_GAINS):
        gains: Any = "lightly_damped"
        if not isinstance(damping, str):
            gains = {"_tag": "!NaturalFrequency", "frequency_hz": 1.0, "damping_ratio": damping}
        yield (
            {"method": method, "damping ratio": str(damping), "gain [1/s]": gain},
            {"method": method, "duration": 10.0, "target.motion": swing(10.0),
             "servo": servo(gain), "recognizer.refinement": "none",
             "controller": {"gains": gains, "computed_torque": False}},
        )  # fmt: skip


def trouble() -> Iterator[Case]:
    """What happens at 5 s: black images, a stop, a reversal."""
    cases: dict[str, dict[str, Any]] = {
        "1 s of black images": {
            "target.motion": swing(10.0),
            "disturbances": [{"_tag": "!Black", "starts": [5.0], "duration": 1.0}]},
        "stop from 100 mm/s": {"target.motion": straight(0.1, start=3.0, duration=2.0)},
        "reversal at 100 mm/s": {
            "target.motion": straight(0.1, start=2.5, duration=2.5, then="reverse")},
    }  # fmt: skip
    for what, method in itertools.product(cases, METHODS):
        yield {"at 5 s": what, "method": method}, {"method": method, "duration": 9.0, **cases[what]}


STUDIES = {"step": step, "velocity": velocity, "frequency": frequency, "latency": latency,
           "stability": stability, "trouble": trouble}  # fmt: skip


def plan(name: str, seeds: int) -> list[PlannedRun]:
    """The runs of a study, every frame of which is kept."""
    return [
        PlannedRun(scenario=Change(ServoDefaults(), {**BASE, "seed": FIRST_SEED + k, **values}),
                   labels={"study": name, **labels}, keeps_frames=True)
        for labels, values in STUDIES[name]() for k in range(seeds)
    ]  # fmt: skip
