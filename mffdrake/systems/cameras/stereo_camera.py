"""The cameras on the hand: Drake's RgbdSensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    RenderCameraCore,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.sensors import RgbdSensor

from mffdrake.recognition import Camera, CameraRig
from mffdrake.systems.cameras.camera_info import MakeCameraInfo
from mffdrake.systems.cameras.lens import LensDistortion, MakeCoveringPinhole, NeedsLens

__all__ = ["AddStereoCamera"]

_CLIPPING = ClippingRange(0.01, 10.0)
_DEPTH_RANGE = DepthRange(0.1, 5.0)


def AddStereoCamera(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    rig: CameraRig,
    renderer: str,
    frames: Mapping[str, str] | None = None,
    model_instance: ModelInstanceIndex | None = None,
    name: str = "stereo_camera",
) -> Diagram:
    """Adds an RgbdSensor for each camera of a rig on the plant's frames, connected to the scene.

    The result is one Diagram. Its images are rendered only when they are read,
    each at most once at a time. Behind the sensor of a camera with a distortion stands a
    `LensDistortion`, ``lens_...``, and the sensor itself is a pinhole that sees all that is needed.

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
        rig: The cameras; the ports above are those of `CameraRig.stereo`, and in general there is
            a ``color_image_...`` for each camera's name.
        renderer: Name of a renderer in the scene (see `AddRenderer`).
        frames: Camera's name to the name of its frame (x right, y down, z along the line of
            sight), by default ``camera_...``, where one is not named.
        model_instance: The model that the frames belong to, where other models of the plant have
            frames of the same names.
        name: The diagram's name.

    Returns:
        The cameras.

    Raises:
        ValueError: When the frames do not lie to each other as the rig's cameras do, a camera sees
            farther from its axis than can be drawn, or the scene lacks the renderer.

    Example:
        >>> import mffdrake as mff
        >>> from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
        >>> builder, rig = DiagramBuilder(), CameraRig.stereo(baseline=0.120)
        >>> plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        >>> _ = mff.AddPa10(plant), mff.AddCameraFrames(plant, baseline=0.120)
        >>> plant.Finalize()
        >>> renderer = mff.AddRenderer(scene_graph, "flat")
        >>> cameras = AddStereoCamera(
        ...     builder, plant=plant, scene_graph=scene_graph, rig=rig, renderer=renderer
        ... )
        >>> cameras.GetOutputPort("color_image_left").get_name()
        'color_image_left'
    """
    if not scene_graph.HasRenderer(renderer):
        raise ValueError(f"the scene has no renderer '{renderer}'; add it with AddRenderer")
    where = () if model_instance is None else (model_instance,)
    names = {camera: f"camera_{camera}" for camera in rig.names} | dict(frames or {})
    placed = [plant.GetFrameByName(names[camera], *where) for camera in rig.names]
    _CheckPlaces(plant, placed, rig)
    pair = DiagramBuilder()
    sensors = []
    for camera, frame in zip(rig.cameras, placed, strict=True):
        drawn = MakeCoveringPinhole(camera) if NeedsLens(camera) else camera
        core = RenderCameraCore(renderer, MakeCameraInfo(drawn), _CLIPPING, RigidTransform())
        sensor = pair.AddNamedSystem(
            f"camera_{camera.name}",
            RgbdSensor(
                parent_id=plant.GetBodyFrameIdOrThrow(frame.body().index()),
                X_PB=frame.GetFixedPoseInBodyFrame(),
                color_camera=ColorRenderCamera(core, False),
                depth_camera=DepthRenderCamera(core, _DEPTH_RANGE),
            ),
        )
        sensors.append(sensor)
        image = sensor.color_image_output_port()
        if drawn is not camera:
            lens = pair.AddNamedSystem(f"lens_{camera.name}", LensDistortion(camera, drawn))
            pair.Connect(image, lens.get_input_port())
            image = lens.get_output_port()
        pair.ExportOutput(image, f"color_image_{camera.name}")
    query = pair.ExportInput(sensors[0].query_object_input_port(), "geometry_query")
    for sensor in sensors[1:]:
        pair.ConnectInput(query, sensor.query_object_input_port())
    diagram = pair.Build()
    diagram.set_name(name)
    builder.AddSystem(diagram)
    builder.Connect(scene_graph.get_query_output_port(), diagram.GetInputPort("geometry_query"))
    return diagram


def _CheckPlaces(plant: MultibodyPlant, frames: Sequence[Frame], rig: CameraRig) -> None:
    """Raises where the plant's frames contradict the rig's geometry."""
    context = plant.CreateDefaultContext()
    X_C0 = _Pose(rig.cameras[0])
    for camera, frame in zip(rig.cameras[1:], frames[1:], strict=True):
        X_0K = frame.CalcPose(context, frames[0])
        expected = X_C0.InvertAndCompose(_Pose(camera))
        if not np.allclose(X_0K.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-9):
            angle = X_0K.rotation().InvertAndCompose(expected.rotation()).ToAngleAxis().angle()
            raise ValueError(
                f"frame '{frame.name()}' lies at {X_0K.translation().round(6)} m in "
                f"'{frames[0].name()}', but the rig has camera '{camera.name}' at "
                f"{expected.translation().round(6)} m, with axes turned by "
                f"{np.degrees(angle):.3f} deg from the frame's"
            )


def _Pose(camera: Camera) -> RigidTransform:
    """X_CK."""
    return RigidTransform(RotationMatrix(camera.R_CK), camera.p_CK)
