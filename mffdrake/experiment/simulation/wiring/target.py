"""The target of a scenario: its model, its solid, and where the camera should see it."""

from __future__ import annotations

import dataclasses as dc
import logging
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import FrameId, Mesh, Role, SceneGraph, SourceId
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from mffdrake.experiment.scenario.scenario import Scenario, ScenarioError
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.experiment.simulation.wiring.desired_hand import MakeDesiredHand
from mffdrake.recognition import POSE_COORDINATES, CameraRig, SolidModel
from mffdrake.recognition.poses.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.systems.arms.models import ConfigureParser
from mffdrake.systems.clutter.moving_shapes import MovingShapes
from mffdrake.systems.rendering.surfaces import MakeSurface
from mffdrake.systems.target_motion import AtRest

__all__ = [
    "AddTarget",
    "CalcDesiredPose",
    "CalcWantedPose",
    "LoadSolid",
    "ReadScenarioMesh",
    "Target",
    "WarnOutside",
]

_DRAWN_BY_VTK = (".obj", ".gltf")

_log = logging.getLogger("mffdrake")


@dc.dataclass(frozen=True)
class Target:
    """The target in a scene, and in the scene's clones.

    Attributes:
        source: It is a source of its own there, ...
        frame: ... and this its frame M.
        mesh: What the renderers draw, in that frame.
    """

    source: SourceId
    frame: FrameId
    mesh: ColoredMesh

    def AddPose(
        self,
        builder: DiagramBuilder,
        scene_graph: SceneGraph,
        scenario: Scenario,
        *,
        name: str,
        latency: float = 0.0,
    ) -> None:
        """Adds what tells a scene where the target was a latency [s] ago, as is prescribed."""
        motion = scenario.target
        poser = MovingShapes(
            [self.frame],
            lambda time: [motion.CalcPose(time - latency)],
            still=isinstance(motion.motion, AtRest),
        )
        builder.AddNamedSystem(name, poser)
        builder.Connect(poser.get_output_port(), scene_graph.get_source_pose_port(self.source))


def AddTarget(scene_graph: SceneGraph, scenario: Scenario) -> Target:
    """Adds the target's model to a scene: no plant's, as it moves as is prescribed.

    Args:
        scene_graph: Receives the model.
        scenario: Its ``target`` counts.

    Returns:
        The target.

    Raises:
        ScenarioError: When the model cannot be loaded, is not one free rigid body, or nothing is
            drawn of it, or what the renderer cannot draw.
    """
    plant = MultibodyPlant(0.0)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    model = scenario.target.model
    parser = Parser(plant)
    ConfigureParser(parser)
    try:
        if model.startswith("package://"):
            (instance,) = parser.AddModelsFromUrl(model)
        else:
            (instance,) = parser.AddModels(model)
    except (RuntimeError, ValueError, NotImplementedError) as error:
        reason = " ".join(str(error).split())
        raise ScenarioError(f"target.model '{model}' cannot be loaded: {reason}") from error
    bodies = plant.GetBodyIndices(instance)
    if len(bodies) != 1:
        raise ScenarioError(
            f"target.model '{model}' must be one rigid body, but has {len(bodies)} bodies"
        )
    if plant.num_joints() > 0:
        raise ScenarioError(
            f"target.model '{model}' must be free: neither static nor joined to the world; "
            "target.X_WM tells where it is"
        )
    body = plant.get_body(bodies[0])
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    mesh = _ReadMesh(scene_graph, frame, body.name(), scenario)
    return Target(plant.get_source_id(), frame, mesh)


def _ReadMesh(
    scene_graph: SceneGraph, frame: FrameId, body: str, scenario: Scenario
) -> ColoredMesh:
    """What the renderers draw for a body: all of its visuals as one mesh in its frame."""
    inspector, model = scene_graph.model_inspector(), scenario.target.model
    triangles, colors, materials = [np.empty((0, 3, 3))], [np.empty((0, 3))], []
    for visual in inspector.GetGeometries(frame, Role.kPerception):
        shape = inspector.GetShape(visual)
        is_mesh = isinstance(shape, Mesh)
        if is_mesh and scenario.renderer == "vtk" and shape.extension() not in _DRAWN_BY_VTK:
            raise ScenarioError(
                f"target.model {model}: the renderer vtk draws {' and '.join(_DRAWN_BY_VTK)} "
                f"meshes only, and would leave {shape.source().description()} out; convert it "
                "to one of these, or take renderer: flat"
            )
        try:
            surface = MakeSurface(shape, inspector.GetPerceptionProperties(visual))
        except ValueError as error:
            raise ScenarioError(f"target.model {model}: {error}") from error
        X_BG = inspector.GetPoseInFrame(visual)
        vertices = surface.vertices @ X_BG.rotation().matrix().T + X_BG.translation()
        names, drawn = np.array(surface.materials), surface.colors[:, 3] > 0.0
        triangles.append(vertices[surface.triangles[drawn]])
        # No color was chosen where the renderers have to take their own.
        colors.append(np.where(names[:, None] == "", np.nan, surface.colors[:, :3])[drawn])
        materials += names[drawn].tolist()
    if not materials:
        raise ScenarioError(
            f"target.model {model}: body '{body}' has no visual; give it a closed, colored mesh, "
            "or several visuals that together are one"
        )
    name = f"target.model {model}"
    return ColoredMesh(name, np.concatenate(triangles), np.concatenate(colors), materials)


def ReadScenarioMesh(scenario: Scenario) -> ColoredMesh:
    """What is drawn of a scenario's target, found without building the rest.

    Args:
        scenario: Its ``target`` counts.

    Returns:
        The mesh in the target's frame M.

    Raises:
        ScenarioError: See `AddTarget`.

    Example:
        >>> ReadScenarioMesh(Scenario()).triangles.shape
        (12, 3, 3)
    """
    return AddTarget(SceneGraph(), scenario).mesh


def LoadSolid(mesh: ColoredMesh) -> SolidModel:
    """The colored solid of the target's mesh.

    Args:
        mesh: The mesh.

    Returns:
        The solid, in the target's frame M.

    Raises:
        ScenarioError: When the mesh is no closed solid with a hue on every face.
    """
    try:
        return SolidModel.from_mesh(mesh)
    except ValueError as error:
        raise ScenarioError(str(error)) from error


def CalcDesiredPose(scenario: Scenario, time: float) -> NDArray[np.float64]:
    """The target's pose in the first camera when the hand is where it is wanted.

    Args:
        scenario: The scenario.
        time: Time [s].

    Returns:
        The pose vector, shape (6,).
    """
    return _CalcDesiredPoses(scenario, [time])[0]


def CalcWantedPose(scenario: Scenario) -> RigidTransform:
    """Where the first camera sees the target, at rest at its X_WM, from the hand's first pose."""
    X_WC = scenario.hand_path.Make().CalcHandPose(0.0) @ MakeMounts(scenario)[0].X_EK
    return X_WC.InvertAndCompose(scenario.target.X_WM.GetDeterministicValue())


def _CalcDesiredPoses(scenario: Scenario, times: Iterable[float]) -> NDArray[np.float64]:
    """The pose vectors of `CalcDesiredPose` at many times [s], shape (K, 6)."""
    CalcHandPose, X_EC = MakeDesiredHand(scenario), MakeMounts(scenario)[0].X_EK
    X_CM = [
        (CalcHandPose(time) @ X_EC).InvertAndCompose(scenario.target.CalcPose(time))
        for time in times
    ]
    return np.array([pose_from_transform(X.rotation().matrix(), X.translation()) for X in X_CM])


def WarnOutside(scenario: Scenario, solid: SolidModel, rig: CameraRig) -> None:
    """Logs a warning where the target leaves the search range or the images on the desired path.

    Args:
        scenario: The scenario.
        solid: The target's solid.
        rig: The cameras.
    """
    search_range = scenario.recognizer.search_range
    times = np.linspace(0.0, scenario.duration, 201)
    poses = _CalcDesiredPoses(scenario, times)
    for k, name in enumerate(POSE_COORDINATES):
        least, greatest = search_range.lower[k], search_range.upper[k]
        low, high = poses[:, k].min(), poses[:, k].max()
        if low < least or high > greatest:
            unit = " m" if k < 3 else ""
            _log.warning(
                "target outside the search range: on the hand's path its %s in the camera is "
                "between %.3f and %.3f%s, but recognizer.search_range.%s is [%g, %g]",
                name, low, high, unit, name, least, greatest,
            )  # fmt: skip
    R_CM, p_CM = transform_from_pose(poses)
    p_CV = solid.vertices @ np.swapaxes(R_CM, 1, 2) + p_CM[:, None]
    for camera in rig.cameras:
        pixels = camera.project(p_CV)  # NaN for what is not seen
        size = np.array([camera.width, camera.height])
        if not np.all((pixels > -0.5) & (pixels < size - 0.5)):
            _log.warning(
                "target outside the image: on the hand's path parts of it leave the %s camera's "
                "view, so that its fitness stays below 1",
                camera.name,
            )
