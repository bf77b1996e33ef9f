"""Connects the parts to the hand-eye system of a scenario."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat, Role
from pydrake.math import RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import Diagram, DiagramBuilder

from mffdrake.experiment.parts import (
    AddEncoders,
    AddSceneRenderer,
    MakeController,
    MakeRig,
)
from mffdrake.experiment.scenario import Scenario
from mffdrake.experiment.target import (
    AddTarget,
    CalcDesiredPose,
    FindScenarioMesh,
    FindTargetMesh,
    LoadSolid,
    WarnOutside,
)
from mffdrake.experiment.visualization import AddMeshcat
from mffdrake.systems.camera_delay import AddDelay, GeometryPoser
from mffdrake.systems.hand_path import AddHandPathSource, SolveHandPath
from mffdrake.systems.pa10 import NUM_JOINTS, AddCameraFrames, AddPa10, MakePa10Plant
from mffdrake.systems.pd_controller import AddGravityCompensation
from mffdrake.systems.predictor import MffPredictor
from mffdrake.systems.recognizer import OneStepGaRecognizer
from mffdrake.systems.stereo_camera import AddStereoCamera

__all__ = ["CheckScenario", "MakeHandEyeDiagram"]


def CheckScenario(scenario: Scenario) -> None:
    """Finds what `MakeHandEyeDiagram` would complain or warn of, except for the graphics, faster.

    Args:
        scenario: What to check.

    Raises:
        ScenarioError: When a value is out of range or the target cannot be used.
        UnreachablePathError: When the arm cannot follow the path.

    Example:
        >>> CheckScenario(Scenario(duration=1.0))
    """
    SolveHandPath(MakePa10Plant(), scenario.hand_path.Make(), duration=scenario.duration)
    mesh = FindScenarioMesh(scenario)
    WarnOutside(scenario, LoadSolid(mesh, scenario), MakeRig(scenario))


def MakeHandEyeDiagram(scenario: Scenario, *, meshcat: Meshcat | None = None) -> Diagram:
    """Builds the whole hand-eye system.

    The subsystems are ``hand_path``, ``pd_controller``, ``gravity_compensation``, ``plant``,
    ``scene_graph``, ``render_scene``, ``stereo_camera``, ``recognizer`` and, for the method "mff",
    ``predictor``. Where the scenario has a camera latency or encoder noise, there are a
    ``camera_delay``, a ``geometry_poser`` and ``joint_encoders``, too. The port ``exposed_state``
    is the state that the images show.
    The arm's default state is at rest at the path's first pose. All systems see the state of the
    present time: the plant's ports are not sampled.

    .. pydrake_system::

        name: hand_eye
        output_ports:
        - stereo_camera.color_image_right
        - stereo_camera.color_image_left
        - state
        - exposed_state
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
    timing = scenario.timing
    rig = MakeRig(scenario)
    p_EC, baseline = scenario.camera.p_EC, scenario.camera.baseline
    # The arm as the controller and the predictor know it
    R_EC = RollPitchYaw(np.radians(scenario.predictor.hand_eye_error_deg)).ToRotationMatrix()
    arm = MakePa10Plant(p_EC=p_EC, R_EC=R_EC, baseline=baseline)
    path = SolveHandPath(arm, scenario.hand_path.Make(), duration=scenario.duration)

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=timing.control_period, use_sampled_output_ports=False),
        builder,
    )
    arm_instance = AddPa10(plant)
    AddCameraFrames(plant, p_EC=p_EC, baseline=baseline)
    target = AddTarget(plant, scenario)
    plant.Finalize()
    plant.SetDefaultPositions(path.value(0.0).reshape(-1))
    mesh = FindTargetMesh(scene_graph, plant, target, scenario.target.model)

    source = AddHandPathSource(builder, path)
    controller = builder.AddNamedSystem("pd_controller", MakeController(scenario, arm))
    builder.Connect(source.get_output_port(), controller.GetInputPort("desired_state"))
    estimated_state = AddEncoders(builder, plant, scenario)
    builder.Connect(estimated_state, controller.GetInputPort("estimated_state"))
    builder.Connect(controller.GetOutputPort("actuation"), plant.get_actuation_input_port())
    if scenario.controller.gravity_compensation:
        AddGravityCompensation(
            builder,
            arm_plant=arm,
            estimated_state=estimated_state,
            feedforward_torque=controller.GetInputPort("feedforward_torque"),
        )

    # The plant asks its scene for contacts in every step, which brings all renderers' poses up to
    # date. So the renderer gets a scene of its own, which is asked at frames only; and as nothing
    # touches in the experiment, the plant's own scene does without shapes for contact.
    render_scene = builder.AddNamedSystem("render_scene", scene_graph.Clone())
    for geometry in scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity):
        scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kProximity)
    exposed_state = AddDelay(
        builder,
        plant.get_state_output_port(),
        latency=scenario.camera.latency,
        initial_value=np.append(path.value(0.0), np.zeros(NUM_JOINTS)),
        timing=timing,
        name="camera_delay",
    )
    geometry_pose = plant.get_geometry_pose_output_port()
    if scenario.camera.latency > 0.0:
        poser = builder.AddNamedSystem("geometry_poser", GeometryPoser(plant))
        builder.Connect(exposed_state, poser.get_input_port())
        geometry_pose = poser.get_output_port()
    builder.Connect(geometry_pose, render_scene.get_source_pose_port(plant.get_source_id()))
    stereo = AddStereoCamera(
        builder,
        plant=plant,
        scene_graph=render_scene,
        rig=rig,
        renderer=AddSceneRenderer(render_scene, scenario),
        model_instance=arm_instance,
    )
    solid = LoadSolid(mesh, scenario)
    tracker = scenario.recognizer.make_tracker(
        solid=solid,
        rig=rig,
        seed=scenario.seed,
        start_pose=CalcDesiredPose(scenario, 0.0),
    )
    WarnOutside(scenario, solid, rig)
    recognizer = builder.AddNamedSystem(
        "recognizer", OneStepGaRecognizer(tracker=tracker, timing=timing)
    )
    for name in rig.names:
        image = f"color_image_{name}"
        builder.Connect(stereo.GetOutputPort(image), recognizer.GetInputPort(image))
        builder.ExportOutput(stereo.GetOutputPort(image), f"stereo_camera.{image}")
    if scenario.method == "mff":
        predictor = builder.AddNamedSystem(
            "predictor",
            MffPredictor(
                plant=arm,
                num_hypotheses=recognizer.num_hypotheses,
                mode=scenario.predictor.mode,
                latency=scenario.camera.latency
                if scenario.predictor.latency is None
                else scenario.predictor.latency,
                gain=scenario.predictor.gain,
                timing=timing,
            ),
        )
        builder.Connect(estimated_state, predictor.GetInputPort("estimated_state"))
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
    builder.ExportOutput(exposed_state, "exposed_state")
    builder.ExportOutput(source.get_output_port(), "desired_state")
    builder.ExportOutput(controller.GetOutputPort("actuation"), "actuation")
    for name in ("pose", "X_CM", "fitness", "population"):
        builder.ExportOutput(recognizer.GetOutputPort(name), f"recognizer.{name}")
    builder.ExportOutput(render_scene.get_query_output_port(), "query_object")
    diagram = builder.Build()
    diagram.set_name("hand_eye")
    return diagram
