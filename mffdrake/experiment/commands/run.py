"""The commands ``run``, ``servo`` and ``record``: one simulation."""

from __future__ import annotations

import argparse
import dataclasses as dc
import logging
from pathlib import Path
from typing import Any

from mffdrake.experiment.commands.one import OneSimulation, OpenMeshcat, SimulateOne
from mffdrake.experiment.progress import TimeBar
from mffdrake.experiment.runs.table import MarkdownTable
from mffdrake.experiment.scenario.scenario import Scenario, ServoDefaults
from mffdrake.experiment.scenario.scenario_sections import NoServo
from mffdrake.experiment.simulation.plotting import (
    PlotFollowing,
    PlotHandError,
    PlotHandPath,
    PlotPose,
    PlotSpace,
    SaveFigure,
)
from mffdrake.experiment.simulation.record import Record, TrackCommand
from mffdrake.systems.target_motion import AtRest, Sinusoids

__all__ = ["RunOne", "RunRecord", "RunServo"]

_log = logging.getLogger("mffdrake")


def RunOne(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Runs one simulation, and draws and tells what came out."""
    one = _Simulate(options, scenario)
    row = one.Write(scenario, folder)
    SaveFigure(PlotHandPath(one.result), folder / "hand_path.png")
    SaveFigure(PlotPose([one.result]), folder / "pose.png")
    print(MarkdownTable([row]))
    stages = ", ".join(f"{name} {ms:.2f}" for name, ms in row["stages_ms"].items())
    print(f"Wall time a frame [ms]: {stages}.")
    return one.Tell(folder)


def _Simulate(options: argparse.Namespace, scenario: Scenario) -> OneSimulation:
    """The simulation, shown as it happens where that is wanted."""
    return SimulateOne(
        scenario, graphviz=options.graphviz, replay=options.replay, video=options.video,
        meshcat=OpenMeshcat() if options.meshcat else None,
    )  # fmt: skip


def RunRecord(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Records images, rig and motion, and tells how they are tracked."""
    mcap = None if options.mcap is None else Path(options.mcap)
    with TimeBar(scenario.duration) as on_frame:
        result = Record(scenario, folder, mcap=mcap, on_frame=on_frame)
    print(f"{len(result.time)} frames. To track them as they were tracked just now:")
    print(TrackCommand(scenario, folder, mcap))
    print(f"Recording: {folder}/" + ("" if mcap is None else f" and {mcap}"))
    return 0


def RunServo(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Runs one simulation in which the hand follows the target."""
    scenario = _WithOptions(options, scenario)
    one = _Simulate(options, scenario)
    row = one.Write(scenario, folder)
    SaveFigure(PlotFollowing(one.result), folder / "following.png")
    SaveFigure(PlotHandError(one.result), folder / "hand_error.png")
    SaveFigure(PlotSpace(one.result), folder / "space.png")
    print(_Describe(row))
    return one.Tell(folder)


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
