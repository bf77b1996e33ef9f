"""Rendered pictures: what the cameras see, the whole scene, and the diagram."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import ClippingRange, ColorRenderCamera, RenderCameraCore
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.sensors import CameraInfo

from mffdrake.experiment.scenario.scenario import LoadScenario, Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.experiment.simulation.wiring.target import LoadSolid, ReadScenarioMesh
from mffdrake.recognition import Camera
from mffdrake.recognition.visibility.outline import DrawViews

__all__ = ["DrawCameraView", "DrawScene"]

_EYE = (1.3, -2.6, 1.5)  # Where the scene is looked at from [m], in the world.
_LOOK_AT = (0.95, 0.0, 0.45)
_FOV_Y = math.radians(34.0)
_VIEW_DEPTH = 0.2  # Length of the drawn viewing pyramids [m].


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
    scene_graph = diagram.GetSubsystemByName("scene_graph")
    query = diagram.GetOutputPort("query_object").Eval(context)
    forward = np.subtract(_LOOK_AT, _EYE)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    axes = np.column_stack([right, np.cross(forward, right), forward])
    X_WV = RigidTransform(RotationMatrix(axes / np.linalg.norm(axes, axis=0)), list(_EYE))
    intrinsics = CameraInfo(width, height, _FOV_Y)
    core = RenderCameraCore(
        scenario.renderer,
        intrinsics,
        ClippingRange(0.05, 20.0),
        RigidTransform(),
    )
    rendered = query.RenderColorImage(
        ColorRenderCamera(core, False), scene_graph.world_frame_id(), X_WV
    )
    image = rendered.data[:, :, :3].copy()
    plant = diagram.GetSubsystemByName("plant")
    plant_context = plant.GetMyContextFromRoot(context)
    arm = plant.GetModelInstanceByName(scenario.arm.model)
    for mount in MakeMounts(scenario):
        X_WK = plant.GetFrameByName(mount.frame_name, arm).CalcPoseInWorld(plant_context)
        _DrawViewingPyramid(image, mount.camera, X_WV.InvertAndCompose(X_WK), intrinsics)
    return image


def _DrawViewingPyramid(
    image: NDArray[np.uint8], camera: Camera, X_VK: RigidTransform, intrinsics: CameraInfo
) -> None:
    """Draws what a camera K sees into an image that is seen from V."""
    import cv2

    x = _VIEW_DEPTH * 0.5 * camera.width / camera.fx
    y = _VIEW_DEPTH * 0.5 * camera.height / camera.fy
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    p_K = np.array([[0.0, 0.0, 0.0], *((a, b, _VIEW_DEPTH) for a, b in corners)])
    homogeneous = (X_VK @ p_K.T).T @ intrinsics.intrinsic_matrix().T
    pixels = np.rint(16.0 * homogeneous[:, :2] / homogeneous[:, 2:]).astype(np.int32)
    color = (255, 255, 160)
    cv2.polylines(image, [pixels[1:]], True, color, 2, cv2.LINE_AA, shift=4)
    for corner in pixels[1:]:
        cv2.line(image, pixels[0].tolist(), corner.tolist(), color, 2, cv2.LINE_AA, shift=4)


def _ContextOfFrame(diagram: Diagram, result: SimulationResult, frame: int) -> Context:
    """A context with the arm where it was at a frame."""
    context = diagram.CreateDefaultContext()
    context.SetTime(result.time[frame])
    plant = diagram.GetSubsystemByName("plant")
    state = np.append(result.joint_positions[frame], result.joint_velocities[frame])
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    return context
