"""The command ``servo``: the hand follows a moving target by what it sees."""

from __future__ import annotations

import argparse
import dataclasses as dc
import logging
import sys
from pathlib import Path
from typing import Any

from pydrake.geometry import Meshcat

from mffdrake.experiment.commands.one_run import SimulateOne, WriteScenario
from mffdrake.experiment.scenario.scenario import Change, Scenario
from mffdrake.experiment.scenario.scenario_sections import NoServo
from mffdrake.experiment.simulation.evaluation import Evaluate, WriteResults
from mffdrake.experiment.simulation.pictures import DrawCameraView, DrawScene, SaveImage
from mffdrake.experiment.simulation.plotting import SaveFigure
from mffdrake.experiment.simulation.servo_plots import PlotFollowing, PlotHandError, PlotSpace
from mffdrake.systems.target_motion import AtRest, Sinusoids

__all__ = ["RunServo", "ServoDefaults"]

_log = logging.getLogger("mffdrake")


def ServoDefaults() -> Scenario:
    """What ``servo`` starts from: `Scenario`'s defaults, with an arm and a servo that are fast."""
    return Change(
        Scenario(),
        {
            "controller": {"gains": "well_damped", "computed_torque": True},
            "recognizer": {"refinement": "borders"},
            "servo": {"_tag": "!Follow", "controller": {"gain": 8.0}},
            "target.motion": "sinusoids",
            "duration": 20.0,
        },
    )


def RunServo(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Runs one simulation in which the hand follows the target.

    Args:
        options: What the command line's parser made of the arguments.
        scenario: The scenario.
        folder: Where results and pictures go.

    Returns:
        The exit status: 0, 130 after an interrupt, 2 where the target left the arm's reach.

    Raises:
        ScenarioError: When an option does not fit the target's motion.
    """
    scenario = _WithOptions(options, scenario)
    meshcat = Meshcat() if options.meshcat else None
    if meshcat is not None:
        print(f"Meshcat: {meshcat.web_url()}", flush=True)
    one = SimulateOne(scenario, graphviz=options.graphviz, replay=options.replay, meshcat=meshcat)
    result, row = one.result, Evaluate(one.result)
    result.Save(folder / "result.npz")
    WriteResults([row], folder)
    WriteScenario(scenario, folder)
    SaveFigure(PlotFollowing(result), folder / "following.png")
    SaveFigure(PlotHandError(result), folder / "hand_error.png")
    SaveFigure(PlotSpace(result), folder / "space.png")
    camera = DrawCameraView(one.diagram, scenario, result, images=one.images or None)
    SaveImage(camera, folder / "camera.png")
    SaveImage(DrawScene(one.diagram, result), folder / "scene.png")
    print(_Describe(row))
    print(f"Results and pictures: {folder}/")
    if one.problem:
        print(f"mffdrake: error: {one.problem}", file=sys.stderr)
        return 2
    if one.interrupted:
        print(f"mffdrake: interrupted: these are the first {row['frames']} frames", file=sys.stderr)
    return 130 if one.interrupted else 0


def _WithOptions(options: argparse.Namespace, scenario: Scenario) -> Scenario:
    """With what --period and --amplitude say of the motion, and servoing in any case."""
    servo, motion = scenario.servo, scenario.target.motion
    if isinstance(servo, NoServo):
        servo = ServoDefaults().servo
    if options.period or options.amplitude:
        if not isinstance(motion, Sinusoids):
            if not isinstance(motion, AtRest):
                _log.warning("--period and --amplitude make the target's motion sinusoids")
            motion = Sinusoids()
        if options.period:
            motion = dc.replace(motion, period=(options.period,))
        if options.amplitude:
            motion = dc.replace(motion, amplitude=(0.0, options.amplitude, 0.0))
    return dc.replace(scenario, servo=servo, target=dc.replace(scenario.target, motion=motion))


def _Describe(row: dict[str, Any]) -> str:
    """What the errors were, in words."""
    settled = row["hand_rms_settled"]["position_mm"] is not None
    hand = row["hand_rms_settled" if settled else "hand_rms"]
    seen = row["rms_settled" if row["rms_settled"]["position_mm"] is not None else "rms"]
    lost = "never lost" if row["lost_s"] is None else f"lost at {row['lost_s']:.2f} s"
    return (
        "\n".join(
            f"{name}: {errors['position_mm']:.2f} mm, {errors['rotation_deg']:.3f} deg"
            for name, errors in (
                (f"Hand, root mean square{' after 10 s' if settled else ''}", hand),
                ("Recognition", seen),
            )
        )
        + f"\nThe target was {lost}."
    )
