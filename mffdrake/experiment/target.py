"""The target of a scenario: its model, its solid, and where the camera should see it."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Mesh, Role, SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import Body
from pydrake.systems.framework import DiagramBuilder

from mffdrake.experiment.cameras import MakeMounts
from mffdrake.experiment.scenario import Scenario, ScenarioError
from mffdrake.recognition import POSE_COORDINATES, CameraRig, SolidModel
from mffdrake.recognition.pose import pose_from_transform, transform_from_pose
from mffdrake.systems.models import ConfigureParser

__all__ = [
    "AddTarget",
    "CalcDesiredPose",
    "FindScenarioMesh",
    "FindTargetMesh",
    "LoadSolid",
    "WarnOutside",
]

_log = logging.getLogger("mffdrake")


def AddTarget(plant: MultibodyPlant, scenario: Scenario) -> Body:
    """Adds the target's model, welded to the world at X_WM.

    Args:
        plant: Receives the model; not finalized yet.
        scenario: Its ``target`` counts.

    Returns:
        The target's body M.

    Raises:
        ScenarioError: When the model cannot be loaded or is not one free rigid body.
    """
    model = scenario.target.model
    num_joints = plant.num_joints()
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
    if plant.num_joints() > num_joints:
        raise ScenarioError(
            f"target.model '{model}' must be free: neither static nor joined to the world; "
            "target.X_WM tells where it is"
        )
    body = plant.get_body(bodies[0])
    X_WM = scenario.target.X_WM.GetDeterministicValue()
    plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WM)
    return body


def FindTargetMesh(scene_graph: SceneGraph, plant: MultibodyPlant, target: Body, name: str) -> Path:
    """The file of the very mesh that the renderers draw for a body.

    Args:
        scene_graph: The scene that the plant is registered with.
        plant: The plant, finalized.
        target: The body.
        name: The model's name, for messages.

    Returns:
        The mesh file.

    Raises:
        ScenarioError: When the body's visual is not one mesh at its origin, unscaled.
    """
    inspector = scene_graph.model_inspector()
    frame = plant.GetBodyFrameIdOrThrow(target.index())
    visuals = inspector.GetGeometries(frame, Role.kPerception)
    shapes = [inspector.GetShape(geometry) for geometry in visuals]
    if len(shapes) != 1 or not isinstance(shapes[0], Mesh):
        raise ScenarioError(
            f"target.model {name}: body '{target.name()}' must have exactly one visual, a mesh"
        )
    if not np.allclose(shapes[0].scale3(), 1.0):
        raise ScenarioError(
            f"target.model {name}: the mesh must have scale 1, not {shapes[0].scale3()}; scale its "
            "vertices instead"
        )
    if not inspector.GetPoseInFrame(visuals[0]).IsNearlyIdentity(1e-9):
        raise ScenarioError(f"target.model {name}: the mesh must lie at the body's origin")
    return Path(shapes[0].source().path())


def FindScenarioMesh(scenario: Scenario) -> Path:
    """The mesh file of a scenario's target, found without building the rest.

    Args:
        scenario: Its ``target`` counts.

    Returns:
        The mesh file.

    Raises:
        ScenarioError: See `AddTarget` and `FindTargetMesh`.

    Example:
        >>> FindScenarioMesh(Scenario()).name
        'target_box.obj'
    """
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=scenario.timing.control_period), DiagramBuilder()
    )
    target = AddTarget(plant, scenario)
    plant.Finalize()
    return FindTargetMesh(scene_graph, plant, target, scenario.target.model)


def LoadSolid(mesh: Path, scenario: Scenario) -> SolidModel:
    """The colored solid of the target's mesh.

    Args:
        mesh: The mesh file.
        scenario: The scenario, whose target's name messages mention.

    Returns:
        The solid, in the target's frame M.

    Raises:
        ScenarioError: When the mesh is no convex solid with a hue on every face.
    """
    try:
        return SolidModel.from_mesh_file(mesh)
    except ValueError as error:
        raise ScenarioError(f"target.model {scenario.target.model}: {error}") from error


def CalcDesiredPose(scenario: Scenario, time: float) -> NDArray[np.float64]:
    """The target's pose in the first camera when the hand is where the path wants it.

    Args:
        scenario: The scenario.
        time: Time [s].

    Returns:
        The pose vector, shape (6,).
    """
    return _CalcDesiredPoses(scenario, [time])[0]


def _CalcDesiredPoses(scenario: Scenario, times: Iterable[float]) -> NDArray[np.float64]:
    """The pose vectors of `CalcDesiredPose` at many times [s], shape (K, 6)."""
    path, X_EC = scenario.hand_path.Make(), MakeMounts(scenario)[0].X_EK
    X_WM = scenario.target.X_WM.GetDeterministicValue()
    X_CM = [(path.CalcHandPose(time) @ X_EC).InvertAndCompose(X_WM) for time in times]
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
