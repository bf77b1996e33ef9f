"""Connects the parts to the hand-eye system of a scenario."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Mesh, Meshcat, Role, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import Body
from pydrake.systems.framework import Diagram, DiagramBuilder

from mffdrake.experiment.scenario import Scenario, ScenarioError
from mffdrake.experiment.scenario_sections import ControllerConfig
from mffdrake.experiment.visualization import AddMeshcat
from mffdrake.recognition import (
    POSE_COORDINATES,
    Matcher,
    NearStart,
    OneStepGaTracker,
    RandomStart,
    SearchModel,
    SolidModel,
    Start,
    StereoCamera,
)
from mffdrake.recognition.pose import pose_from_transform, transform_from_pose
from mffdrake.systems.graphics import GraphicsUnavailableError
from mffdrake.systems.hand_path import AddHandPathSource, SolveHandPath
from mffdrake.systems.models import ConfigureParser
from mffdrake.systems.pa10 import AddCameraFrames, AddPa10, MakePa10Plant
from mffdrake.systems.pd_controller import PD_GAINS, AddGravityCompensation, PdController, PdGains
from mffdrake.systems.predictor import MffPredictor
from mffdrake.systems.recognizer import OneStepGaRecognizer
from mffdrake.systems.renderers import AddRenderer
from mffdrake.systems.stereo_camera import AddStereoCamera
from mffdrake.systems.timing import Timing

__all__ = ["CalcDesiredPose", "MakeHandEyeDiagram", "MakeTracker"]

_log = logging.getLogger("mffdrake")


def MakeHandEyeDiagram(scenario: Scenario, *, meshcat: Meshcat | None = None) -> Diagram:
    """Builds the whole hand-eye system.

    The subsystems are ``hand_path``, ``pd_controller``, ``gravity_compensation``, ``plant``,
    ``scene_graph``, ``render_scene``, ``stereo_camera``, ``recognizer`` and, for the method "mff",
    ``predictor``.
    The arm's default state is at rest at the path's first pose. All systems see the state of the
    present time: the plant's ports are not sampled.

    .. pydrake_system::

        name: hand_eye
        output_ports:
        - stereo_camera.color_image_right
        - stereo_camera.color_image_left
        - state
        - desired_state
        - actuation
        - recognizer.pose
        - recognizer.X_CM
        - recognizer.fitness
        - recognizer.population
        - query_object

    Args:
        scenario: What to build.
        meshcat: Where to show the scene and the estimated pose; not shown without.

    Returns:
        The diagram, named ``hand_eye``.

    Raises:
        ScenarioError: When a value is out of range or the target cannot be used.
        UnreachablePathError: When the arm cannot follow the path.
        GraphicsUnavailableError: When this machine cannot render.

    Example:
        >>> from mffdrake.experiment.scenario import Scenario
        >>> diagram = MakeHandEyeDiagram(Scenario(duration=1.0))
        >>> diagram.GetSubsystemByName("recognizer").num_hypotheses
        60
    """
    scenario.Validate()
    timing = scenario.timing.Make()
    camera = _MakeCamera(scenario)
    p_EC, baseline = scenario.camera.p_EC, scenario.camera.baseline
    arm = MakePa10Plant(p_EC=p_EC, baseline=baseline)
    path = SolveHandPath(arm, scenario.hand_path.Make(), duration=scenario.duration)

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=timing.control_period, use_sampled_output_ports=False),
        builder,
    )
    arm_instance = AddPa10(plant)
    AddCameraFrames(plant, p_EC=p_EC, baseline=baseline)
    target = _AddTarget(plant, scenario)
    plant.Finalize()
    plant.SetDefaultPositions(path.value(0.0).reshape(-1))
    mesh = _FindTargetMesh(scene_graph, plant, target, scenario.target.model)

    source = AddHandPathSource(builder, path)
    controller = builder.AddNamedSystem(
        "pd_controller", _MakeController(scenario.controller, arm, timing)
    )
    builder.Connect(source.get_output_port(), controller.GetInputPort("desired_state"))
    builder.Connect(plant.get_state_output_port(), controller.GetInputPort("estimated_state"))
    builder.Connect(controller.GetOutputPort("actuation"), plant.get_actuation_input_port())
    if scenario.controller.gravity_compensation:
        AddGravityCompensation(
            builder,
            arm_plant=arm,
            estimated_state=plant.get_state_output_port(),
            feedforward_torque=controller.GetInputPort("feedforward_torque"),
        )

    # The plant asks its scene for contacts in every step, which brings all renderers' poses up to
    # date. So the renderer gets a scene of its own, which is asked at frames only.
    render_scene = builder.AddNamedSystem("render_scene", scene_graph.Clone())
    builder.Connect(
        plant.get_geometry_pose_output_port(),
        render_scene.get_source_pose_port(plant.get_source_id()),
    )
    stereo = AddStereoCamera(
        builder,
        plant=plant,
        scene_graph=render_scene,
        camera=camera,
        renderer=_AddRenderer(render_scene, scenario),
        model_instance=arm_instance,
    )
    solid = _LoadSolid(mesh, scenario)
    tracker = MakeTracker(scenario, solid, CalcDesiredPose(scenario, 0.0))
    _WarnOutside(scenario, solid, camera)
    recognizer = builder.AddNamedSystem(
        "recognizer", OneStepGaRecognizer(tracker=tracker, timing=timing)
    )
    for side in ("right", "left"):
        image = f"color_image_{side}"
        builder.Connect(stereo.GetOutputPort(image), recognizer.GetInputPort(image))
        builder.ExportOutput(stereo.GetOutputPort(image), f"stereo_camera.{image}")
    if scenario.method == "mff":
        predictor = builder.AddNamedSystem(
            "predictor",
            MffPredictor(
                plant=arm,
                num_hypotheses=recognizer.num_hypotheses,
                mode=cast(Literal["rigid", "velocity"], scenario.predictor.mode),
                latency=scenario.predictor.latency,
                gain=scenario.predictor.gain,
                timing=timing,
            ),
        )
        builder.Connect(plant.get_state_output_port(), predictor.GetInputPort("estimated_state"))
        for output, system in (("population", recognizer), ("predicted_population", predictor)):
            receiver = predictor if system is recognizer else recognizer
            builder.Connect(system.GetOutputPort(output), receiver.GetInputPort(output))

    if meshcat is not None:
        AddMeshcat(
            builder,
            meshcat=meshcat,
            plant=plant,
            scene_graph=scene_graph,
            estimate=recognizer.GetOutputPort("X_CM"),
            mesh=mesh,
        )
    builder.ExportOutput(plant.get_state_output_port(), "state")
    builder.ExportOutput(source.get_output_port(), "desired_state")
    builder.ExportOutput(controller.GetOutputPort("actuation"), "actuation")
    for name in ("pose", "X_CM", "fitness", "population"):
        builder.ExportOutput(recognizer.GetOutputPort(name), f"recognizer.{name}")
    builder.ExportOutput(render_scene.get_query_output_port(), "query_object")
    diagram = builder.Build()
    diagram.set_name("hand_eye")
    return diagram


def MakeTracker(
    scenario: Scenario, solid: SolidModel, start_pose: NDArray[np.float64]
) -> OneStepGaTracker:
    """The scenario's tracker for a solid.

    Args:
        scenario: Its ``recognizer``, ``camera`` and ``seed`` count.
        solid: The object to recognize.
        start_pose: Where the first population lies for ``start: near_target``: the target's pose
            vector in the right camera, shape (6,).

    Returns:
        The tracker.
    """
    config = scenario.recognizer
    position_spread, quaternion_spread = config.start_spread
    starts: dict[str, Start] = {
        "random": RandomStart(),
        "near_target": NearStart(start_pose, (position_spread, quaternion_spread)),
    }
    model = SearchModel(solid, config.MakeSampling())
    return OneStepGaTracker(
        matcher=Matcher(model, _MakeCamera(scenario), config.MakeMatching()),
        coding=config.MakeCoding(),
        parameters=config.MakeParameters(),
        local_moves=config.MakeLocalMoves(),
        generations_per_frame=config.generations_per_frame,
        start=starts[config.start],
        seed=scenario.seed,
    )


def CalcDesiredPose(scenario: Scenario, time: float) -> NDArray[np.float64]:
    """The target's pose in the right camera when the hand is where the path wants it.

    Args:
        scenario: The scenario.
        time: Time [s].

    Returns:
        The pose vector, shape (6,).
    """
    X_WC = scenario.hand_path.Make().CalcHandPose(time) @ RigidTransform(scenario.camera.p_EC)
    X_CM = X_WC.InvertAndCompose(scenario.target.X_WM.GetDeterministicValue())
    return pose_from_transform(X_CM.rotation().matrix(), X_CM.translation())


def _FindTargetMesh(
    scene_graph: SceneGraph, plant: MultibodyPlant, target: Body, name: str
) -> Path:
    """The file of the very mesh that the renderers draw for a body."""
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


def _LoadSolid(mesh: Path, scenario: Scenario) -> SolidModel:
    try:
        return SolidModel.from_mesh_file(mesh)
    except ValueError as error:
        raise ScenarioError(f"target.model {scenario.target.model}: {error}") from error


def _MakeCamera(scenario: Scenario) -> StereoCamera:
    config = scenario.camera
    return StereoCamera.from_fov(
        width=config.width,
        height=config.height,
        fov_y=np.radians(config.fov_y_deg),
        baseline=config.baseline,
    )


def _AddTarget(plant: MultibodyPlant, scenario: Scenario) -> Body:
    """Adds the target's model, welded to the world at X_WM."""
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


def _MakeController(config: ControllerConfig, arm: MultibodyPlant, timing: Timing) -> PdController:
    preset: PdGains = PD_GAINS[config.gains]
    return PdController(
        kp=preset.kp if config.kp is None else config.kp,
        kd=preset.kd if config.kd is None else config.kd,
        effort_limit=arm.GetEffortUpperLimits(),
        timing=timing,
    )


def _WarnOutside(scenario: Scenario, solid: SolidModel, camera: StereoCamera) -> None:
    """Warns where the target leaves the search range or the images on the desired path."""
    search_range = scenario.recognizer.MakeCoding().search_range
    times = np.linspace(0.0, scenario.duration, 201)
    poses = np.array([CalcDesiredPose(scenario, t) for t in times])
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
    margin = np.array([0.5, 0.5])
    size = np.array([camera.width, camera.height])
    for side, pixels in zip(("right", "left"), camera.project(p_CV), strict=True):
        inside = (p_CV[..., 2] > 0) & np.all((pixels > -margin) & (pixels < size - margin), axis=-1)
        if not inside.all():
            _log.warning(
                "target outside the image: on the hand's path parts of it leave the %s camera's "
                "view, so that its fitness stays below 1",
                side,
            )
