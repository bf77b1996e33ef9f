"""Connects the parts to the hand-eye system of a scenario."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from typing import Any

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.wiring.cameras import (
    KnownLatency,
    MakeKnownRig,
    MakeMounts,
    MakeRig,
)
from mffdrake.experiment.simulation.wiring.control import AddControl, Control, MakeController
from mffdrake.experiment.simulation.wiring.parts import (
    AddCameras,
    AddStation,
    Cameras,
    MakeKnownArm,
    SolvePath,
    Station,
)
from mffdrake.experiment.simulation.wiring.servoing import CheckReach, ConnectServo
from mffdrake.experiment.simulation.wiring.target import (
    CalcDesiredPose,
    LoadSolid,
    ReadScenarioMesh,
    WarnOutside,
)
from mffdrake.recognition import OneStepGaTracker, Tracker
from mffdrake.systems.rendering.visualization import AddMeshcat
from mffdrake.systems.vision.feedforward import ConnectFeedforward
from mffdrake.systems.vision.predictor import MffPredictor
from mffdrake.systems.vision.recognizer import OneStepGaRecognizer, PoseRecognizer

__all__ = ["CheckScenario", "HandEyeParts", "MakeHandEyeDiagram"]


@dc.dataclass(frozen=True, kw_only=True)
class HandEyeParts:
    """The parts of a hand-eye diagram before it is built, for systems of one's own.

    Attributes:
        scenario: The scenario.
        station: Arm and target.
        control: What moves the arm.
        cameras: What sees the target.
        recognizer: What recognizes it.
        predictor: The motion feedforward; None without.

    Example:
        >>> from pydrake.systems.primitives import LogVectorOutput
        >>> def AddLog(builder: DiagramBuilder, parts: HandEyeParts) -> None:
        ...     LogVectorOutput(parts.recognizer.GetOutputPort("fitness"), builder).set_name("log")
        >>> diagram = MakeHandEyeDiagram(Scenario(duration=1.0), prebuild_callback=AddLog)
        >>> diagram.HasSubsystemNamed("log")
        True
    """

    scenario: Scenario
    station: Station
    control: Control
    cameras: Cameras
    recognizer: PoseRecognizer[Any]
    predictor: MffPredictor | None


def CheckScenario(scenario: Scenario) -> None:
    """Finds what `MakeHandEyeDiagram` would complain or warn of, except for the graphics, faster.

    Args:
        scenario: What to check.

    Raises:
        ScenarioError: When parts of the scenario do not fit together, or the target cannot be used.
        ArmError: When the arm's directives make no arm.
        UnreachablePathError: When the arm cannot follow the path.

    Example:
        >>> CheckScenario(Scenario(duration=1.0))
    """
    arm = MakeKnownArm(scenario)
    SolvePath(arm, scenario)
    CheckReach(scenario, arm)
    MakeController(scenario, arm)
    WarnOutside(scenario, LoadSolid(ReadScenarioMesh(scenario)), MakeRig(scenario))


def MakeHandEyeDiagram(
    scenario: Scenario,
    *,
    meshcat: Meshcat | None = None,
    make_tracker: Callable[..., Tracker] | None = None,
    prebuild_callback: Callable[[DiagramBuilder, HandEyeParts], None] | None = None,
) -> Diagram:
    """Builds the whole hand-eye system.

    The subsystems are ``hand_path``, ``pd_controller``, ``gravity_compensation``, ``plant``,
    ``no_contacts`` (the scene in which the plant looks for contacts, an empty one),
    ``scene_graph``, ``target``, which poses the target in it, ``stereo_camera``, ``recognizer``
    and, for the method "mff", ``predictor``. Where the scenario has encoder errors, disturbances or
    clutter, there are ``joint_encoders`` and systems such as ``gaussian_noise_right`` or
    ``occluder_0``, too. Late cameras see a scene of their own, a ``render_scene`` with an
    ``exposed_target``, by a ``camera_delay`` and a ``geometry_poser``. Where it servoes, a
    ``visual_servo`` is in the hand path's place, and there is a ``target_motion_estimator``. The
    images are those that the recognizer gets, and the port ``exposed_state`` is the state that the
    first camera's show. The arm's default state is at rest at the path's first pose. All systems
    see the state of the present time: the plant's ports are not sampled.

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
        - recognizer.state
        - recognizer.confidence
        - recognizer.is_tracking
        - query_object

    Args:
        scenario: What to build.
        meshcat: Where to show the scene and the estimated pose; not shown without.
        make_tracker: Makes a pose estimator of one's own, called as
            `TrackerParameters.make_tracker` is; the scenario's 1-step GA without.
        prebuild_callback: Called with the builder and the parts before the diagram is built, to add
            systems of one's own.

    Returns:
        The diagram, named ``hand_eye``.

    Raises:
        ScenarioError: When parts of the scenario do not fit together, or the target cannot be used.
        ArmError: When the arm's directives make no arm.
        UnreachablePathError: When the arm cannot follow the path.
        GraphicsUnavailableError: When this machine cannot render.

    Example:
        >>> from mffdrake.experiment.scenario.scenario import Scenario
        >>> diagram = MakeHandEyeDiagram(Scenario(duration=1.0))
        >>> diagram.GetSubsystemByName("recognizer").num_hypotheses
        60
    """
    builder = DiagramBuilder()
    scenario = dc.replace(scenario, timing=scenario.timing.Coinciding())
    station = AddStation(builder, scenario)
    control = AddControl(builder, scenario, station)
    cameras = AddCameras(builder, scenario, station)
    tracker = (make_tracker or scenario.recognizer.make_tracker)(
        solid=station.solid,
        rig=MakeKnownRig(scenario),
        seed=scenario.seed,
        start_pose=CalcDesiredPose(scenario, 0.0),
    )
    recognizer = _AddRecognizer(builder, scenario, cameras, tracker)
    predictor = None
    if scenario.method == "mff":
        predictor = builder.AddNamedSystem(
            "predictor", _MakePredictor(scenario, station, tracker.num_hypotheses)
        )
        ConnectFeedforward(
            builder,
            recognizer=recognizer,
            predictor=predictor,
            estimated_state=control.estimated_state,
        )
    ConnectServo(builder, scenario, station, control, recognizer, predictor)
    CheckReach(scenario, station.known_arm)
    WarnOutside(scenario, station.solid, cameras.rig)
    if meshcat is not None:
        _AddView(builder, scenario, station, cameras, recognizer, meshcat)
    builder.ExportOutput(station.plant.get_state_output_port(), "state")
    builder.ExportOutput(cameras.exposed_state, "exposed_state")
    builder.ExportOutput(control.desired_state, "desired_state")
    builder.ExportOutput(control.actuation, "actuation")
    for name in ("pose", "X_CM", "fitness", "population", "state", "confidence", "is_tracking"):
        builder.ExportOutput(recognizer.GetOutputPort(name), f"recognizer.{name}")
    builder.ExportOutput(cameras.query_object, "query_object")
    if prebuild_callback is not None:
        parts = HandEyeParts(
            scenario=scenario, station=station, control=control, cameras=cameras,
            recognizer=recognizer, predictor=predictor,
        )  # fmt: skip
        prebuild_callback(builder, parts)
    diagram = builder.Build()
    diagram.set_name("hand_eye")
    return diagram


def _AddRecognizer(
    builder: DiagramBuilder, scenario: Scenario, cameras: Cameras, tracker: Tracker
) -> PoseRecognizer[Any]:
    """Adds the system around a tracker, connected to the images, which the diagram shows, too."""
    system: Any = OneStepGaRecognizer if isinstance(tracker, OneStepGaTracker) else PoseRecognizer
    recognizer: PoseRecognizer[Any] = builder.AddNamedSystem(
        "recognizer", system(tracker=tracker, timing=scenario.timing)
    )
    for name, image in cameras.images.items():
        builder.Connect(image, recognizer.GetInputPort(f"color_image_{name}"))
        builder.ExportOutput(image, f"stereo_camera.color_image_{name}")
    return recognizer


def _MakePredictor(scenario: Scenario, station: Station, num_hypotheses: int) -> MffPredictor:
    config, reference = scenario.predictor, MakeMounts(scenario)[0]
    return MffPredictor(
        plant=station.known_arm,
        camera_frame=reference.frame_name,
        num_hypotheses=num_hypotheses,
        mode=config.mode,
        latency=KnownLatency(scenario),
        gain=config.gain,
        timing=scenario.timing,
    )


def _AddView(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Station,
    cameras: Cameras,
    recognizer: PoseRecognizer[Any],
    meshcat: Meshcat,
) -> None:
    """Adds what shows arm, target, clutter and the estimated pose in Meshcat."""
    plant = station.plant
    AddMeshcat(
        builder,
        meshcat=meshcat,
        plant=plant,
        scene_graph=station.scene_graph,
        estimate=recognizer.GetOutputPort("X_CM"),
        mesh=station.target.mesh,
        camera_frame=plant.GetFrameByName(MakeMounts(scenario)[0].frame_name, station.arm),
        population=recognizer.GetOutputPort("population"),
        solid=station.solid,
        rig=cameras.rig,
    )
