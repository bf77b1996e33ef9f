"""The commands ``run``, ``servo`` and ``record``: one simulation."""

from __future__ import annotations

import argparse
import dataclasses as dc
import logging
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram

from mffdrake.experiment.progress import TimeBar
from mffdrake.experiment.runs.table import MarkdownTable, WriteJson
from mffdrake.experiment.scenario.scenario import Change, Scenario
from mffdrake.experiment.scenario.scenario_sections import NoServo
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.pictures import DrawCameraView, DrawScene
from mffdrake.experiment.simulation.plotting import (
    PlotFollowing,
    PlotHandError,
    PlotHandPath,
    PlotPose,
    PlotSpace,
    SaveFigure,
)
from mffdrake.experiment.simulation.record import Record, TrackCommand
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.servoing import OutOfReach
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.recordings.image_files import SaveImage
from mffdrake.systems.rendering.visualization import SaveDiagram, SaveReplay
from mffdrake.systems.target_motion import AtRest, Sinusoids

__all__ = [
    "OneSimulation", "RunOne", "RunRecord", "RunServo", "ServoDefaults", "SimulateOne",
    "WriteScenario",
]  # fmt: skip

_log = logging.getLogger("mffdrake")


@dataclass
class OneSimulation:
    """A simulation, and what its cameras saw at its last frame.

    Attributes:
        diagram: The diagram.
        result: The record.
        images: The images of the last frame, one a camera.
        interrupted: Whether it ended early, by request.
        problem: Why it ended early by itself; empty where it did not.
    """

    diagram: Diagram
    result: SimulationResult
    images: list[NDArray[np.uint8]]
    interrupted: bool
    problem: str = ""

    def Write(self, scenario: Scenario, folder: Path) -> dict[str, Any]:
        """Writes record, numbers, scenario and rendered pictures; returns the row of figures."""
        row = Evaluate(self.result)
        self.result.Save(folder / "result.npz")
        WriteJson({"runs": [row]}, folder / "results.json")
        WriteScenario(scenario, folder)
        view = DrawCameraView(
            self.diagram, scenario, self.result, images=self.images or None, caption=True
        )
        SaveImage(view, folder / "camera.png")
        SaveImage(DrawScene(self.diagram, self.result), folder / "scene.png")
        return row

    def Tell(self, folder: Path) -> int:
        """Says where everything is and how the simulation ended; returns the exit status."""
        print(f"Results and pictures: {folder}/")
        if self.problem:
            print(f"mffdrake: error: {self.problem}", file=sys.stderr)
            return 2
        if self.interrupted:
            frames = len(self.result.time)
            print(f"mffdrake: interrupted: these are the first {frames} frames", file=sys.stderr)
        return 130 if self.interrupted else 0


def RunOne(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Runs one simulation, and draws and tells what came out."""
    one = SimulateOne(scenario, graphviz=options.graphviz, replay=options.replay)
    row = one.Write(scenario, folder)
    SaveFigure(PlotHandPath(one.result), folder / "hand_path.png")
    SaveFigure(PlotPose([one.result]), folder / "pose.png")
    print(MarkdownTable([row]))
    stages = ", ".join(f"{name} {ms:.2f}" for name, ms in row["stages_ms"].items())
    print(f"Wall time a frame [ms]: {stages}.")
    return one.Tell(folder)


def RunRecord(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Records images, rig and motion, and tells how they are tracked."""
    with TimeBar(scenario.duration) as on_frame:
        result = Record(scenario, folder, on_frame=on_frame)
    print(f"{len(result.time)} frames. To track them as they were tracked just now:")
    print(TrackCommand(scenario, folder))
    print(f"Recording: {folder}/")
    return 0


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
    """Runs one simulation in which the hand follows the target."""
    scenario = _WithOptions(options, scenario)
    meshcat = Meshcat() if options.meshcat else None
    if meshcat is not None:
        print(f"Meshcat: {meshcat.web_url()}", flush=True)
    one = SimulateOne(scenario, graphviz=options.graphviz, replay=options.replay, meshcat=meshcat)
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


def SimulateOne(
    scenario: Scenario,
    *,
    graphviz: str | None = None,
    replay: str | None = None,
    meshcat: Meshcat | None = None,
) -> OneSimulation:
    """One simulation with a progress bar, drawn and recorded where that is wanted.

    An interrupt ends it after the next frame; a second one at once.
    """
    if meshcat is None and replay:
        meshcat = Meshcat()
    diagram = MakeHandEyeDiagram(scenario, meshcat=meshcat)
    if graphviz:
        SaveDiagram(diagram, graphviz)
    if meshcat is not None and replay:
        meshcat.StartRecording(set_visualizations_while_recording=False)
    names = diagram.GetSubsystemByName("recognizer").tracker.rig.names
    ports = [diagram.GetOutputPort(f"stereo_camera.color_image_{name}") for name in names]
    images: list[NDArray[np.uint8]] = []

    reach = OutOfReach(diagram)
    last_frame = scenario.timing.NumFrames(scenario.duration) - 1

    with TimeBar(scenario.duration) as show, _Interrupt() as interrupted:

        def Look(context: Context) -> None:
            reach.Look(context)
            # Late and lost images cannot be drawn again afterwards.
            if interrupted or scenario.timing.FrameAt(context.get_time()) == last_frame:
                images.extend(port.Eval(context).data.copy() for port in ports)

        def OnFrame(simulated: float, wall: float) -> bool:
            show(simulated, wall)
            return bool(images) or reach.IsLeft(simulated)

        result = Simulate(scenario, diagram=diagram, on_frame=OnFrame, on_exposure=Look)
    if meshcat is not None and replay is not None:
        SaveReplay(meshcat, replay)
    return OneSimulation(diagram, result, images, bool(interrupted), reach.message)


@contextmanager
def _Interrupt() -> Iterator[list[int]]:
    """A list that an interrupt fills; a second interrupt works as ever."""
    received: list[int] = []

    def OnSignal(number: int, frame: object) -> None:
        received.append(number)
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, OnSignal)
    try:
        yield received
    finally:
        signal.signal(signal.SIGINT, before)


def WriteScenario(scenario: Scenario, folder: Path) -> None:
    """Writes what the results came from; it can be given as a scenario file again."""
    with WholeFile(folder / "scenario.yaml") as part:
        part.write_text(scenario.Dump(), encoding="utf-8")
