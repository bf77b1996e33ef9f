"""One simulation at the command line: with a progress bar, pictures, and an end by request."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram

from mffdrake.experiment.commands.progress import ProgressBar
from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.pictures import SaveDiagram
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.servoing import OutOfReach
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.systems.rendering.visualization import SaveReplay

__all__ = ["OneSimulation", "SimulateOne", "TimeBar", "WriteScenario"]


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


@contextmanager
def TimeBar(duration: float) -> Iterator[Callable[[float, float], None]]:
    """A bar over simulated time, with the speed."""
    form = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s{postfix}"
    with ProgressBar(total=duration, desc="simulated", bar_format=form) as bar:

        def OnFrame(simulated: float, wall: float) -> None:
            bar.set_postfix_str(f"{simulated / max(wall, 1e-9):.2f} x real time", refresh=False)
            bar.update(simulated - bar.n)

        yield OnFrame


def WriteScenario(scenario: Scenario, folder: Path) -> None:
    """Writes what the results came from; it can be given as a scenario file again."""
    with WholeFile(folder / "scenario.yaml") as part:
        part.write_text(scenario.Dump(), encoding="utf-8")
