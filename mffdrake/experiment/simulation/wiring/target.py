"""The target of a scenario: its model, its solid, and where the camera should see it."""

from __future__ import annotations

import dataclasses as dc
import logging
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform

from mffdrake.experiment.scenario.scenario import Scenario, ScenarioError
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts
from mffdrake.experiment.simulation.wiring.poses import MakeDesiredHand
from mffdrake.recognition import POSE_COORDINATES, CameraRig, SolidModel
from mffdrake.recognition.poses.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.systems.target_motion.target import AddTarget, Target, TargetError

__all__ = [
    "AddScenarioTarget",
    "CalcDesiredPose",
    "CalcWantedPose",
    "LoadSolid",
    "ReadScenarioMesh",
    "WarnOutside",
]

_log = logging.getLogger("mffdrake")


def AddScenarioTarget(scene_graph: SceneGraph, scenario: Scenario) -> Target:
    """Adds a scenario's target to a scene."""
    try:
        target = AddTarget(scene_graph, scenario.target.model, renderer=scenario.renderer)
    except TargetError as error:
        raise ScenarioError(f"target.model {error}") from error
    return dc.replace(target, mesh=dc.replace(target.mesh, name=f"target.model {target.mesh.name}"))


def ReadScenarioMesh(scenario: Scenario) -> ColoredMesh:
    """What is drawn of a scenario's target, found without building the rest.

    Returns:
        The mesh in the target's frame M.

    Example:
        >>> ReadScenarioMesh(Scenario()).triangles.shape
        (12, 3, 3)
    """
    return AddScenarioTarget(SceneGraph(), scenario).mesh


def LoadSolid(mesh: ColoredMesh) -> SolidModel:
    """The colored solid of the target's mesh.

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
    R_CM = np.array([X.rotation().matrix() for X in X_CM])
    return pose_from_transform(R_CM, np.array([X.translation() for X in X_CM]))


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
