"""Rendered pictures: what the cameras see, the whole scene, and the diagram."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram

from mffdrake.experiment.scenario.scenario import LoadScenario, Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.experiment.simulation.wiring.target import LoadSolid, ReadScenarioMesh
from mffdrake.recognition import TrackingState
from mffdrake.recognition.poses.pose import pose_errors
from mffdrake.recognition.visibility.outline import AddCaption, DrawViews
from mffdrake.systems.rendering.visualization import SceneView

__all__ = ["Describe", "DescribeFrame", "DrawCameraView", "DrawScene"]


def DrawCameraView(
    diagram: Diagram,
    scenario: Scenario,
    result: SimulationResult,
    frame: int = -1,
    *,
    images: Sequence[NDArray[np.uint8]] | None = None,
    caption: bool = False,
) -> NDArray[np.uint8]:
    """Both cameras' images at a frame, with the recognized pose's outline over them.

    Args:
        diagram: The scenario's diagram.
        scenario: The scenario.
        result: Its record.
        frame: Which frame; the last by default.
        images: What the cameras saw then; drawn anew without, where late and lost images are not.
        caption: Whether to tell the time, the figures and what the outline is, in a strip below.

    Returns:
        An RGB image, the left camera's on the left, shape (height, 2 width, 3); see `DrawViews`
        and `AddCaption`.

    Example:
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> diagram = MakeHandEyeDiagram(short)
        >>> DrawCameraView(diagram, short, Simulate(short, diagram=diagram)).shape
        (48, 128, 3)
    """
    rig = diagram.GetSubsystemByName("recognizer").tracker.rig
    if images is None:
        context = _ContextOfFrame(diagram, result, frame)
        images = [
            diagram.GetOutputPort(f"stereo_camera.color_image_{name}").Eval(context).data.copy()
            for name in rig.names
        ]
    solid = LoadSolid(ReadScenarioMesh(scenario))
    views = DrawViews(images, result.recognized_pose[frame], solid, rig)
    return AddCaption(views, DescribeFrame(result, frame)) if caption else views


def DescribeFrame(result: SimulationResult, frame: int) -> str:
    """A frame's time, fitness, error and state as a line of text.

    Args:
        result: The record.
        frame: Which frame; negative ones count from the end.
    """
    return Describe(
        result.time[frame], result.fitness[frame], result.state[frame],
        result.true_pose[frame], result.recognized_pose[frame],
    )  # fmt: skip


def Describe(
    time: float,
    fitness: float,
    state: float,
    true_pose: NDArray[np.float64],
    recognized_pose: NDArray[np.float64],
) -> str:
    """The same of a frame's numbers; for their meaning see `SimulationResult`.

    Example:
        >>> Describe(1.0, 0.5, 1.0, np.zeros(6), np.zeros(6))
        't 1.00 s   fitness 0.50   off 0.0 mm, 0.0 deg   tracking'
    """
    distance, angle = pose_errors(true_pose, recognized_pose)
    name = "" if np.isnan(state) else f"   {TrackingState(int(state)).name.lower()}"
    return (
        f"t {time:.2f} s   fitness {fitness:.2f}   "
        f"off {1e3 * distance:.1f} mm, {np.degrees(angle):.1f} deg{name}"
    )


def DrawScene(
    diagram: Diagram,
    result: SimulationResult,
    frame: int = -1,
    *,
    width: int = 960,
    height: int = 720,
) -> NDArray[np.uint8]:
    """The arm and the target at a frame, seen from the side, with the cameras' viewing pyramids.

    Args:
        diagram: The diagram.
        result: Its record.
        frame: Which frame; the last by default.
        width: Image width [px].
        height: Image height [px].

    Returns:
        An RGB image, shape (height, width, 3).

    Example:
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> diagram = MakeHandEyeDiagram(short)
        >>> DrawScene(diagram, Simulate(short, diagram=diagram), width=320, height=240).shape
        (240, 320, 3)
    """
    scenario = LoadScenario(text=result.scenario)
    context = _ContextOfFrame(diagram, result, frame)
    view = SceneView(width=width, height=height)
    image = view.Render(
        diagram.GetOutputPort("query_object").Eval(context),
        diagram.GetSubsystemByName("scene_graph").world_frame_id(),
        scenario.renderer,
    )
    plant = diagram.GetSubsystemByName("plant")
    plant_context = plant.GetMyContextFromRoot(context)
    arm = plant.GetModelInstanceByName(scenario.arm.model)
    for mount in MakeMounts(scenario):
        X_WK = plant.GetFrameByName(mount.frame_name, arm).CalcPoseInWorld(plant_context)
        view.DrawPyramid(image, mount.camera, X_WK)
    return image


def _ContextOfFrame(diagram: Diagram, result: SimulationResult, frame: int) -> Context:
    """A context with the arm where it was at a frame."""
    context = diagram.CreateDefaultContext()
    context.SetTime(result.time[frame])
    plant = diagram.GetSubsystemByName("plant")
    state = np.append(result.joint_positions[frame], result.joint_velocities[frame])
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    return context
