"""The port blocks in the docstrings tell the real ports, and which inputs may stay unconnected.

Every system of the package is found by itself: a new one without a block, or without an entry in
`SYSTEMS` here, fails.
"""

import importlib
import inspect
import pkgutil
import re
import textwrap

import numpy as np
import pytest
import yaml
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import Diagram, DiagramBuilder, PortDataType, System
from pydrake.systems.sensors import ImageRgba8U

import mffdrake
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    Camera,
    CameraRig,
    Distortion,
    Matcher,
    OneStepGaTracker,
    SearchModel,
    SolidModel,
)
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.systems.arms.models import FindModelsPath
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, AddCameraFrames, AddPa10, MakePa10Plant
from mffdrake.systems.cameras.camera_delay import GeometryPoser
from mffdrake.systems.cameras.lens import LensDistortion
from mffdrake.systems.cameras.stereo_camera import AddStereoCamera
from mffdrake.systems.clutter.moving_shapes import MovingShapes
from mffdrake.systems.control.joint_encoders import JointEncoders
from mffdrake.systems.control.pd_controller import PdController
from mffdrake.systems.control.visual_servo import VisualServoController
from mffdrake.systems.disturbances import Frozen, GaussianNoise
from mffdrake.systems.disturbances.image_disturbance import PixelFilter
from mffdrake.systems.disturbances.image_memory import ImageMemory
from mffdrake.systems.random_stream import RandomStream
from mffdrake.systems.rendering.renderers import AddRenderer
from mffdrake.systems.rendering.visualization import PoseEstimateVisualizer
from mffdrake.systems.target_motion.prescribed_target import PrescribedTarget
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.frame_recorder import FrameRecorder
from mffdrake.systems.vision.predictor import MffPredictor
from mffdrake.systems.vision.recognizer import OneStepGaRecognizer, PoseRecognizer
from mffdrake.systems.vision.target_motion_estimator import TargetMotionEstimator

DIRECTIVE = ".. pydrake_system::"
FISHEYE = Camera(
    width=64, height=48, fx=40.0, fy=40.0, cx=31.5, cy=23.5,
    distortion=Distortion("equidistant", (0.0, 0.0, 0.0, 0.0)),
)  # fmt: skip
RIG = CameraRig.stereo(width=64, height=48, focal_length=60.0, baseline=0.150)


def modules():
    """All modules of the package but the command line's start."""
    for info in pkgutil.walk_packages(mffdrake.__path__, "mffdrake."):
        if info.name != "mffdrake.__main__":
            yield importlib.import_module(info.name)


def documented():
    """Classes and functions of the package that are systems or have a port block, by name."""
    found = {}
    for module in modules():
        for name, value in vars(module).items():
            if not callable(value) or getattr(value, "__module__", "") != module.__name__:
                continue
            is_class = inspect.isclass(value) and not name.startswith("_")
            if (is_class and issubclass(value, System)) or DIRECTIVE in (
                inspect.getdoc(value) or ""
            ):
                found[name] = value
    return found


def port_block(value):
    """What the YAML in a docstring says."""
    _, found, rest = inspect.getdoc(value).partition(DIRECTIVE + "\n")
    assert found, f"{value.__name__}: the docstring lacks its '{DIRECTIVE}' block"
    block = re.match(r"(?:[ ]+.*\n|\n)+", rest)[0]
    return yaml.safe_load(textwrap.dedent(block))


def make_tracker():
    box = SolidModel.box((0.100, 0.150, 0.200), (RED, GREEN, BLUE))
    return OneStepGaTracker(matcher=Matcher(SearchModel(box), RIG))


def make_visualizer():
    return PoseEstimateVisualizer(
        meshcat=Meshcat(),
        plant=MakePa10Plant(),
        mesh=ColoredMesh.read(FindModelsPath() / "target_box.obj"),
    )


def make_stereo_camera():
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    AddPa10(plant)
    AddCameraFrames(plant, baseline=0.150)
    plant.Finalize()
    return AddStereoCamera(
        builder,
        plant=plant,
        scene_graph=scene_graph,
        rig=RIG,
        renderer=AddRenderer(scene_graph),
    )


def make_hand_eye():
    return MakeHandEyeDiagram(LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}"))


def make_geometry_poser():
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.001)
    AddPa10(plant)
    plant.Finalize()
    return GeometryPoser(plant)


SYSTEMS = {
    "FrameRecorder": lambda: FrameRecorder(signals={"state": 14}),
    "GeometryPoser": make_geometry_poser,
    "JointEncoders": lambda: JointEncoders(noise=0.01),
    "AddStereoCamera": make_stereo_camera,
    "MakeHandEyeDiagram": make_hand_eye,
    "MffPredictor": lambda: MffPredictor(plant=MakePa10Plant()),
    "PixelFilter": lambda: PixelFilter(
        GaussianNoise(), stream=RandomStream(0, 0, "right"), timing=Timing()
    ),
    "ImageMemory": lambda: ImageMemory(
        Frozen(), stream=RandomStream(0, 0, "right"), timing=Timing()
    ),
    "LensDistortion": lambda: LensDistortion(FISHEYE, RIG.cameras[0]),
    "MovingShapes": lambda: MovingShapes([], lambda time: []),
    "OneStepGaRecognizer": lambda: OneStepGaRecognizer(tracker=make_tracker()),
    "PdController": lambda: PdController(kp=[1.0, 2.0], kd=[0.1, 0.2]),
    "PoseEstimateVisualizer": make_visualizer,
    "PoseRecognizer": lambda: PoseRecognizer(tracker=make_tracker()),
    "PrescribedTarget": lambda: PrescribedTarget(
        lambda time: RigidTransform(), lambda time: np.zeros(6)
    ),
    "TargetMotionEstimator": TargetMotionEstimator,
    "VisualServoController": lambda: VisualServoController(
        plant=MakePa10Plant(), X_CM=RigidTransform([0.0, 0.0, 0.8]), start=NOMINAL_POSITIONS
    ),
}
"""How to make each documented system."""


def test_every_system_of_the_package_is_tested_here():
    assert sorted(documented()) == sorted(SYSTEMS)


@pytest.fixture(params=sorted(SYSTEMS))
def name(request):
    return request.param


def test_the_docstring_names_the_ports_in_their_order(name):
    block = port_block(documented()[name])
    system = SYSTEMS[name]()
    inputs = [system.get_input_port(k).get_name() for k in range(system.num_input_ports())]
    outputs = [system.get_output_port(k).get_name() for k in range(system.num_output_ports())]
    documented_inputs = [port.removesuffix(" (optional)") for port in block.get("input_ports", [])]
    assert documented_inputs == inputs
    assert block.get("output_ports", []) == outputs
    assert set(block) <= {"name", "input_ports", "output_ports"}
    if type(system) is Diagram:  # which a function makes
        assert block["name"] == system.get_name()
    else:
        assert block["name"] == type(system).__name__


NEEDED_INPUTS = {"X_WM": "X_WC"}
"""Output ports that only an optional input makes known."""


def run(system, connected):
    """Evaluates all outputs and forced events with some of the input ports connected."""
    context = system.CreateDefaultContext()
    for k in range(system.num_input_ports()):
        port = system.get_input_port(k)
        if port.get_name() not in connected:
            continue
        if port.get_data_type() == PortDataType.kVectorValued:
            port.FixValue(context, np.zeros(port.size()))
        elif port.get_name().startswith("color_image"):
            port.FixValue(context, ImageRgba8U(64, 48))
        else:
            port.FixValue(context, AbstractValue.Make(RigidTransform()))
    system.CalcForcedDiscreteVariableUpdate(context, context.get_mutable_discrete_state())
    system.ForcedPublish(context)
    for k in range(system.num_output_ports()):
        port = system.get_output_port(k)
        if NEEDED_INPUTS.get(port.get_name(), "") in ("", *connected):
            port.Eval(context)


LEAF_SYSTEMS = sorted(name for name in SYSTEMS if inspect.isclass(documented().get(name)))


@pytest.mark.parametrize("name", LEAF_SYSTEMS)
def test_only_the_optional_inputs_may_stay_unconnected(name):
    inputs = port_block(documented()[name]).get("input_ports", [])
    required = [port for port in inputs if not port.endswith(" (optional)")]
    system = SYSTEMS[name]()
    run(system, required)
    run(system, [port.removesuffix(" (optional)") for port in inputs])
    for missing in required:
        with pytest.raises(RuntimeError, match=missing):
            run(system, [port for port in required if port != missing])


def test_the_stereo_camera_needs_its_scene():
    stereo = make_stereo_camera()
    context = stereo.CreateDefaultContext()
    for side in ("right", "left"):
        with pytest.raises(RuntimeError, match="geometry_query"):
            stereo.GetOutputPort(f"color_image_{side}").Eval(context)


def test_the_hand_eye_diagram_needs_no_input():
    diagram = make_hand_eye()
    context = diagram.CreateDefaultContext()
    for k in range(diagram.num_output_ports()):
        diagram.get_output_port(k).Eval(context)
