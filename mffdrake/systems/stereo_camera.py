"""The stereo pair on the hand: two of Drake's RgbdSensors."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    RenderCameraCore,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from mffdrake.recognition import StereoCamera

__all__ = ["AddStereoCamera", "MakeCameraInfo"]

_CLIPPING = ClippingRange(0.01, 10.0)
_DEPTH_RANGE = DepthRange(0.1, 5.0)


def MakeCameraInfo(camera: StereoCamera) -> CameraInfo:
    """Drake's intrinsics for a camera: the one place that knows of the half pixel.

    Drake's renderers draw half a pixel up and to the left of where CameraInfo says when one reads
    whole numbers as pixel centers. So the sensor's principal point is (W/2, H/2), while
    `StereoCamera` projects with the center at ((W - 1)/2, (H - 1)/2), and the two agree.

    Args:
        camera: The stereo geometry.

    Returns:
        The intrinsics for an RgbdSensor.

    Example:
        >>> info = MakeCameraInfo(StereoCamera(width=640, height=480))
        >>> info.center_x(), info.center_y()
        (320.0, 240.0)
    """
    f = camera.focal_length
    return CameraInfo(camera.width, camera.height, f, f, 0.5 * camera.width, 0.5 * camera.height)


def AddStereoCamera(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    camera: StereoCamera,
    renderer: str,
    right_frame: str = "camera_right",
    left_frame: str = "camera_left",
    model_instance: ModelInstanceIndex | None = None,
) -> Diagram:
    """Adds a right and a left RgbdSensor on the plant's camera frames, connected to the scene.

    The result is one Diagram, ``stereo_camera``. Its images are rendered only when they are read,
    each at most once at a time.

    .. pydrake_system::

        name: stereo_camera
        input_ports:
        - geometry_query
        output_ports:
        - color_image_right
        - color_image_left

    Args:
        builder: Receives the diagram.
        plant: Holds the frames; registered with the scene and finalized.
        scene_graph: The scene.
        camera: Image size, focal length and baseline.
        renderer: Name of a renderer in the scene (see `AddRenderer`).
        right_frame: Name of the right camera's frame C (x right, y down, z along the line of
            sight).
        left_frame: Name of the left camera's frame L.
        model_instance: The model that the frames belong to, where other models of the plant have
            frames of the same names.

    Returns:
        The stereo pair.

    Raises:
        ValueError: When the frames are not ``camera.baseline`` apart with parallel axes, or the
            scene lacks the renderer.
    """
    if not scene_graph.HasRenderer(renderer):
        raise ValueError(f"the scene has no renderer '{renderer}'; add it with AddRenderer")
    where = () if model_instance is None else (model_instance,)
    names = {"right": right_frame, "left": left_frame}
    frames = {side: plant.GetFrameByName(name, *where) for side, name in names.items()}
    _CheckBaseline(plant, frames["right"], frames["left"], camera)
    core = RenderCameraCore(renderer, MakeCameraInfo(camera), _CLIPPING, RigidTransform())
    pair = DiagramBuilder()
    for side, frame in frames.items():
        sensor = pair.AddNamedSystem(
            f"camera_{side}",
            RgbdSensor(
                parent_id=plant.GetBodyFrameIdOrThrow(frame.body().index()),
                X_PB=frame.GetFixedPoseInBodyFrame(),
                color_camera=ColorRenderCamera(core, False),
                depth_camera=DepthRenderCamera(core, _DEPTH_RANGE),
            ),
        )
        if side == "right":
            query = pair.ExportInput(sensor.query_object_input_port(), "geometry_query")
        else:
            pair.ConnectInput(query, sensor.query_object_input_port())
        pair.ExportOutput(sensor.color_image_output_port(), f"color_image_{side}")
    diagram = pair.Build()
    diagram.set_name("stereo_camera")
    builder.AddSystem(diagram)
    builder.Connect(scene_graph.get_query_output_port(), diagram.GetInputPort("geometry_query"))
    return diagram


def _CheckBaseline(plant: MultibodyPlant, frame_C, frame_L, camera: StereoCamera) -> None:
    """Raises where the plant's frames contradict the camera's geometry."""
    X_CL = frame_L.CalcPose(plant.CreateDefaultContext(), frame_C)
    expected = RigidTransform(camera.p_CL)
    if not np.allclose(X_CL.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-9):
        raise ValueError(
            f"frame '{frame_L.name()}' lies at {X_CL.translation().round(6)} m in "
            f"'{frame_C.name()}', but the camera's baseline of {camera.baseline} m asks for "
            f"{camera.p_CL} m with parallel axes"
        )
