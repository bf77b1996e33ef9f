"""One simulation with all that may be drawn, shown and recorded of it on the way."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, Diagram

from mffdrake.experiment.interrupts import CollectInterrupts, Interrupted
from mffdrake.experiment.progress import TimeBar
from mffdrake.experiment.runs.table import WriteJson
from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.pictures import Describe, DrawCameraView, DrawScene
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.poses import TruePose
from mffdrake.experiment.simulation.wiring.servoing import OutOfReach
from mffdrake.experiment.simulation.wiring.target import LoadSolid, ReadScenarioMesh
from mffdrake.recognition import PoseTracker, TrackingState
from mffdrake.recognition.poses.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.recordings.image_files import SaveImage
from mffdrake.recognition.recordings.overlay import MakeVideo
from mffdrake.recognition.recordings.recording import TrackedFrame
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.recognition.solid.symmetry import find_symmetries
from mffdrake.recognition.visibility.outline import AddCaption, DrawViews
from mffdrake.systems.rendering.visualization import PAGE_VIEW, SaveDiagram, SaveReplay
from mffdrake.systems.view.controls import LiveControls
from mffdrake.systems.view.pose_view import PoseView

__all__ = ["OneSimulation", "OpenMeshcat", "SimulateOne", "WatchTracking", "WriteScenario"]


@dataclass
class OneSimulation:
    """A simulation, and what its cameras saw at its last frame.

    Attributes:
        diagram: The diagram.
        result: The record.
        images: The images of the last frame, one a camera.
        interrupted: Why it ended early, by request; None where it did not.
        problem: Why it ended early by itself; empty where it did not.
    """

    diagram: Diagram
    result: SimulationResult
    images: list[NDArray[np.uint8]]
    interrupted: Interrupted | None
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
        if self.interrupted is None:
            return 0
        frames = len(self.result.time)
        print(f"mffdrake: {self.interrupted}: these are the first {frames} frames", file=sys.stderr)
        return self.interrupted.status


def SimulateOne(
    scenario: Scenario,
    *,
    graphviz: str | None = None,
    replay: str | None = None,
    video: str | None = None,
    meshcat: Meshcat | None = None,
) -> OneSimulation:
    """One simulation with a progress bar, drawn and recorded where that is wanted.

    An interrupt ends it after the next frame; a second one at once.

    Args:
        scenario: The scenario.
        graphviz: File for the diagram.
        replay: HTML file for a Meshcat recording.
        video: MP4 file for the cameras' images with the recognized pose and its numbers.
        meshcat: Where to show it as it happens, with buttons and sliders; reset begins anew.
    """
    controls = None if meshcat is None else LiveControls(meshcat)
    if controls is not None:
        controls.LookFrom(*PAGE_VIEW)
    if meshcat is None and replay:
        meshcat = Meshcat()
    diagram = MakeHandEyeDiagram(scenario, meshcat=meshcat)
    if graphviz:
        SaveDiagram(diagram, graphviz)
    while True:
        if meshcat is not None and replay:
            meshcat.DeleteRecording()
            meshcat.StartRecording(set_visualizations_while_recording=controls is not None)
        one = _SimulateOnce(scenario, diagram, controls, video)
        if one is not None:
            break
    if meshcat is not None and replay is not None:
        SaveReplay(meshcat, replay)
    return one


def _SimulateOnce(
    scenario: Scenario, diagram: Diagram, controls: LiveControls | None, video: str | None
) -> OneSimulation | None:
    """From the beginning to the end, or None where a person on the page wants to begin anew."""
    names = diagram.GetSubsystemByName("recognizer").tracker.rig.names
    ports = [diagram.GetOutputPort(f"stereo_camera.color_image_{name}") for name in names]
    images: list[NDArray[np.uint8]] = []
    reach = OutOfReach(diagram)
    last_frame = scenario.timing.NumFrames(scenario.duration) - 1
    ended, anew, contexts = False, False, list[Context]()

    with ExitStack() as stack:
        show = stack.enter_context(TimeBar(scenario.duration))
        interrupted = stack.enter_context(CollectInterrupts())
        film = None
        if video is not None:
            film = stack.enter_context(_OpenFilm(scenario, diagram, Path(video)))

        def Look(context: Context) -> None:
            nonlocal ended
            contexts[:] = [context]
            reach.Look(context)
            ended = bool(interrupted) or scenario.timing.FrameAt(context.get_time()) == last_frame
            # Late and lost images cannot be drawn again afterwards.
            if ended or film is not None:
                images[:] = [port.Eval(context).data.copy() for port in ports]
            if film is not None:
                film.Expose(context)

        def OnFrame(simulated: float, wall: float) -> bool:
            nonlocal anew
            show(simulated, wall)
            if film is not None:
                film.Add(contexts[0], images)
            if controls is not None:
                fitness, confidence, state = (
                    float(diagram.GetOutputPort(f"recognizer.{name}").Eval(contexts[0])[0])
                    for name in ("fitness", "confidence", "state")
                )
                controls.Tell(fitness, confidence, TrackingState(int(state)))
                anew = controls.Wait(simulated, lambda: bool(interrupted))
            return ended or anew or reach.IsLeft(simulated)

        result = Simulate(scenario, diagram=diagram, on_frame=OnFrame, on_exposure=Look)
        return (
            None
            if anew
            else OneSimulation(
                diagram,
                result,
                images if ended else [],
                Interrupted(interrupted[0]) if interrupted else None,
                reach.message,
            )
        )


class _Film:
    """A video of a simulation's frames."""

    def __init__(
        self, scenario: Scenario, diagram: Diagram, add: Callable[[NDArray[np.uint8]], None]
    ) -> None:
        self._add, self._diagram = add, diagram
        self._rig = diagram.GetSubsystemByName("recognizer").tracker.rig
        self._solid = LoadSolid(ReadScenarioMesh(scenario))
        self._symmetries = find_symmetries(self._solid)
        self._truth = TruePose(scenario, diagram)
        self._time, self._true_pose = 0.0, np.zeros(6)

    def Expose(self, context: Context) -> None:
        """Notes the truth of what the images show, before the recognizer reads them."""
        self._time = context.get_time()
        X_CM = self._truth.Calc(context, self._time)
        self._true_pose = pose_from_transform(X_CM.rotation().matrix(), X_CM.translation())

    def Add(self, context: Context, images: list[NDArray[np.uint8]]) -> None:
        """Draws the frame, when the recognizer is through with it."""
        pose, fitness, state = (
            self._diagram.GetOutputPort(f"recognizer.{name}").Eval(context)
            for name in ("pose", "fitness", "state")
        )
        nearest = self._symmetries.nearest(pose, self._true_pose)
        text = Describe(self._time, fitness[0], state[0], self._true_pose, nearest)
        self._add(AddCaption(DrawViews(images, pose, self._solid, self._rig), text))


@contextmanager
def _OpenFilm(scenario: Scenario, diagram: Diagram, path: Path) -> Iterator[_Film]:
    """A film at the rate of the vision."""
    with MakeVideo(path, 1.0 / scenario.timing.vision_period) as add:
        yield _Film(scenario, diagram, add)


def WriteScenario(scenario: Scenario, folder: Path) -> None:
    """Writes what the results came from; it can be given as a scenario file again."""
    with WholeFile(folder / "scenario.yaml") as part:
        part.write_text(scenario.Dump(), encoding="utf-8")


def OpenMeshcat() -> Meshcat:
    """A page for the browser; says where it is."""
    meshcat = Meshcat()
    print(f"Meshcat: {meshcat.web_url()}", flush=True)
    return meshcat


def WatchTracking(
    tracker: PoseTracker, options: argparse.Namespace
) -> Callable[[TrackedFrame], None]:
    """What shows every frame in Meshcat: the rig, the pose and the best hypotheses."""
    meshcat, matcher = OpenMeshcat(), tracker.ga.matcher
    mesh = ColoredMesh.read(options.target)
    view = PoseView(meshcat, mesh, solid=matcher.solid, rig=matcher.rig)
    controls = LiveControls(meshcat, can_reset=False)
    # Where its motion is not known, the rig looks along the world's x axis, with z upward.
    ahead = RotationMatrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

    def Transform(pose: np.ndarray) -> RigidTransform:
        R, p = transform_from_pose(pose)
        return RigidTransform(RotationMatrix(R), p)

    def Watch(frame: TrackedFrame) -> None:
        estimate, pose_WC = frame.estimate, frame.recorded.pose_WC
        X_WC = RigidTransform(ahead, [0, 0, 0]) if pose_WC is None else Transform(pose_WC)
        X_CM = Transform(estimate.pose)
        if estimate.frame == 0:  # From behind the rig, from its right and from above
            depth = float(np.linalg.norm(X_CM.translation()))
            eye = X_WC @ (depth * np.array([0.9, -0.7, -0.4]))
            controls.LookFrom(eye, X_WC @ (0.6 * X_CM.translation()))
        assert tracker.generation is not None
        view.Show(X_WC, X_CM, tracker.generation.poses)
        controls.Tell(estimate.fitness, estimate.confidence, estimate.state)
        controls.Wait(frame.recorded.time)

    return Watch
