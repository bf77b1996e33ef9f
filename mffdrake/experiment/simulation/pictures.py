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
from mffdrake.recognition.visibility.outline import DrawViews
from mffdrake.systems.rendering.visualization import SceneView

__all__ = ["DrawCameraView", "DrawScene"]


def DrawCameraView(
    diagram: Diagram,
    scenario: Scenario,
    result: SimulationResult,
    frame: int = -1,
    *,
    images: Sequence[NDArray[np.uint8]] | None = None,
) -> NDArray[np.uint8]:
    """Both cameras' images at a frame, with the recognized pose's outline over them.

    Args:
        diagram: The scenario's diagram.
        scenario: The scenario.
        result: Its record.
        frame: Which frame; the last by default.
        images: What the cameras saw then; drawn anew without, where late and lost images are not.

    Returns:
        An RGB image, the left camera's on the left, shape (height, 2 width, 3); see `DrawViews`.
    """
    rig = diagram.GetSubsystemByName("recognizer").tracker.rig
    if images is None:
        context = _ContextOfFrame(diagram, result, frame)
        images = [
            diagram.GetOutputPort(f"stereo_camera.color_image_{name}").Eval(context).data.copy()
            for name in rig.names
        ]
    solid = LoadSolid(ReadScenarioMesh(scenario))
    return DrawViews(images, result.recognized_pose[frame], solid, rig)


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
