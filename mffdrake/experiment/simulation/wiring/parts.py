"""The parts of the hand-eye system that a scenario describes, group by group."""

from __future__ import annotations

import colorsys
import dataclasses as dc
import math

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.trajectories import PiecewisePolynomial

from mffdrake.experiment.scenario.scenario import Scenario, ScenarioError
from mffdrake.experiment.simulation.wiring.cameras import (
    AddFrames,
    CalcKnownX_EC,
    MakeMounts,
    MakeRig,
)
from mffdrake.experiment.simulation.wiring.poses import MakeReferencePath
from mffdrake.experiment.simulation.wiring.target import AddScenarioTarget, LoadSolid
from mffdrake.recognition import CameraRig, SolidModel
from mffdrake.systems.arms.hand_path import SolveHandPath
from mffdrake.systems.cameras.camera_delay import AddDelay, GeometryPoser
from mffdrake.systems.cameras.camera_frames import AddCameraFrame
from mffdrake.systems.cameras.stereo_camera import AddStereoCamera
from mffdrake.systems.disturbances import AddDisturbances
from mffdrake.systems.rendering.graphics import GraphicsUnavailableError
from mffdrake.systems.rendering.renderers import AddRenderer
from mffdrake.systems.target_motion import AtRest
from mffdrake.systems.target_motion.target import Target

__all__ = [
    "AddCameras",
    "AddClutter",
    "AddStation",
    "Cameras",
    "MakeKnownArm",
    "SolvePath",
    "Station",
]


@dc.dataclass(frozen=True, kw_only=True)
class Station:
    """The arm with its cameras' frames, and the target.

    Attributes:
        plant: The arm.
        scene_graph: The shapes of arm and target, as Meshcat shows them.
        arm: The arm's model instance.
        known_arm: A plant with the arm alone, as the controller and the feedforward know it, and
            the frame of the first camera.
        path: The arm's desired joint motion.
        target: The target, which the scene is told the pose of.
        solid: The target's colored solid.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    arm: ModelInstanceIndex
    known_arm: MultibodyPlant
    path: PiecewisePolynomial
    target: Target
    solid: SolidModel


@dc.dataclass(frozen=True, kw_only=True)
class Cameras:
    """What the cameras see.

    Attributes:
        rig: The cameras as they are.
        images: The images as the recognizer gets them, by the cameras' names.
        exposed_state: The plant's state that the first camera's images show.
        query_object: The scene that the first camera sees.
    """

    rig: CameraRig
    images: dict[str, OutputPort]
    exposed_state: OutputPort
    query_object: OutputPort


def AddStation(builder: DiagramBuilder, scenario: Scenario) -> Station:
    """Adds the plant with the arm, at rest at the path's first pose, and the target."""
    known_arm = MakeKnownArm(scenario)
    path = SolvePath(known_arm, scenario)
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=scenario.timing.control_period, use_sampled_output_ports=False
        ),
        builder,
    )
    # The plant looks for contacts in every step, before which all shapes are moved. As nothing
    # touches in the experiment, it looks where nothing is.
    contacts = plant.get_geometry_query_input_port()
    builder.Disconnect(scene_graph.get_query_output_port(), contacts)
    empty = builder.AddNamedSystem("no_contacts", SceneGraph())
    builder.Connect(empty.get_query_output_port(), contacts)
    arm = scenario.arm.AddToPlant(plant)
    AddFrames(plant, arm, scenario)
    target = AddScenarioTarget(scene_graph, scenario)
    plant.Finalize()
    plant.SetDefaultPositions(path.value(0.0).reshape(-1))
    still = isinstance(scenario.target.motion, AtRest)
    target.AddPose(builder, scene_graph, scenario.target.CalcPose, name="target", still=still)
    return Station(
        plant=plant, scene_graph=scene_graph, arm=arm, known_arm=known_arm, path=path,
        target=target, solid=LoadSolid(target.mesh),
    )  # fmt: skip


def MakeKnownArm(scenario: Scenario) -> MultibodyPlant:
    """The arm as the controller and the feedforward know it, with the first camera's frame."""
    plant = scenario.arm.MakePlant()
    hand = plant.GetFrameByName(
        scenario.arm.hand_frame, plant.GetModelInstanceByName(scenario.arm.model)
    )
    name = MakeMounts(scenario)[0].frame_name
    AddCameraFrame(plant, name=name, parent=hand, X_PC=CalcKnownX_EC(scenario))
    plant.Finalize()
    return plant


def SolvePath(arm: MultibodyPlant, scenario: Scenario) -> PiecewisePolynomial:
    """The joint motion along which the hand follows the scenario's path."""
    return SolveHandPath(
        arm,
        MakeReferencePath(scenario),
        duration=scenario.duration,
        frame_name=scenario.arm.hand_frame,
        model_instance=arm.GetModelInstanceByName(scenario.arm.model),
        nominal=scenario.arm.nominal_positions,
        held_joints=scenario.arm.held_joints,
    )


def AddCameras(builder: DiagramBuilder, scenario: Scenario, station: Station) -> Cameras:
    """Adds the cameras, their latencies and disturbances, and the scenes that late ones see."""
    plant, mounts = station.plant, MakeMounts(scenario)
    images: dict[str, OutputPort] = {}
    exposed: list[OutputPort] = []
    queries: list[OutputPort] = []
    latencies = list(dict.fromkeys(mount.latency for mount in mounts))
    copies = {latency: station.scene_graph.Clone() for latency in latencies if latency > 0.0}
    AddClutter(builder, station.scene_graph, scenario, station.solid)
    for latency in latencies:
        cameras = tuple(mount.camera for mount in mounts if mount.latency == latency)
        suffix = f"_{cameras[0].name}" if exposed else ""
        scene, state = station.scene_graph, plant.get_state_output_port()
        if latency > 0.0:
            scene = builder.AddNamedSystem(f"render_scene{suffix}", copies[latency])
            state = _ShowLate(builder, scenario, station, scene, latency, suffix)
        renderer = _AddRenderer(scene, scenario)
        try:
            sensors = AddStereoCamera(
                builder,
                plant=plant,
                scene_graph=scene,
                rig=CameraRig(cameras),
                renderer=renderer,
                model_instance=station.arm,
                name=f"stereo_camera{suffix}",
            )
        except ValueError as error:  # Drake cannot draw such a camera.
            raise ScenarioError(str(error)) from error
        for camera in cameras:
            images[camera.name] = sensors.GetOutputPort(f"color_image_{camera.name}")
        exposed.append(state)
        queries.append(scene.get_query_output_port())
    rig = MakeRig(scenario)
    ordered = {name: images[name] for name in rig.names}
    try:
        disturbed = AddDisturbances(
            builder, ordered, scenario.disturbances, seed=scenario.seed, timing=scenario.timing
        )
    except ValueError as error:
        raise ScenarioError(str(error)) from error
    return Cameras(rig=rig, images=disturbed, exposed_state=exposed[0], query_object=queries[0])


def _ShowLate(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Station,
    scene: SceneGraph,
    latency: float,
    suffix: str,
) -> OutputPort:
    """Has a scene show everything as it was a latency [s] ago; returns the plant's state then."""
    plant = station.plant
    state = AddDelay(
        builder,
        plant.get_state_output_port(),
        latency=latency,
        initial_value=np.append(station.path.value(0.0), np.zeros(plant.num_velocities())),
        timing=scenario.timing,
        name=f"camera_delay{suffix}",
    )
    poser = builder.AddNamedSystem(f"geometry_poser{suffix}", GeometryPoser(plant))
    builder.Connect(state, poser.get_input_port())
    builder.Connect(poser.get_output_port(), scene.get_source_pose_port(plant.get_source_id()))
    station.target.AddPose(
        builder, scene, scenario.target.CalcPose, name=f"exposed_target{suffix}",
        latency=latency, still=isinstance(scenario.target.motion, AtRest),
    )  # fmt: skip
    AddClutter(builder, scene, scenario, station.solid, latency=latency)
    return state


def AddClutter(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    scenario: Scenario,
    solid: SolidModel,
    *,
    latency: float = 0.0,
) -> None:
    """Adds what moves in a scene beside the target, as it was a latency [s] ago."""
    hues = list(dict.fromkeys(solid.hues.tolist()))
    for index, clutter in enumerate(scenario.clutter):
        clutter.AddToScene(
            builder,
            scene_graph,
            X_WT=scenario.target.X_WM.GetDeterministicValue(),
            colors=[colorsys.hsv_to_rgb(hue / (2.0 * math.pi), 1.0, 1.0) for hue in hues],
            index=index,
            seed=scenario.seed,
            latency=latency,
        )


def _AddRenderer(scene_graph: SceneGraph, scenario: Scenario) -> str:
    """Adds the renderer, which is when the target's mesh is read for drawing."""
    try:
        return AddRenderer(scene_graph, scenario.renderer)
    except GraphicsUnavailableError:
        raise
    except (RuntimeError, ValueError, NotImplementedError) as error:
        reason = " ".join(str(error).split())
        raise ScenarioError(
            f"target.model '{scenario.target.model}' cannot be drawn: {reason}"
        ) from error
