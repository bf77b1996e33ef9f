"""Times a pair of color images of the hand-eye scene, by VTK and by the flat renderer.

The arm moves between the pairs, so that each is drawn anew, and each number is the median of many.
"""

import statistics
import time

from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

import mffdrake as mff
from mffdrake.experiment.runs.table import Markdown
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS
from mffdrake.systems.rendering.flat_renderer import AddFlatRenderer

ADDERS = {"vtk": mff.AddRenderer, "flat": AddFlatRenderer}
PAIRS = {"vtk": 20, "flat": 300}
SIZES = ((320, 240), (640, 480), (1280, 960))


def time_pair(renderer: str, width: int, height: int) -> float:
    """Median wall time of a pair, from the arm's pose to both images [ms]."""
    rig = mff.CameraRig.stereo(width=width, height=height, fov_y=0.785, baseline=0.150)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    mff.AddPa10(plant)
    mff.AddCameraFrames(plant, baseline=0.150)
    parser = Parser(plant)
    mff.ConfigureParser(parser)
    parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")
    plant.Finalize()
    ADDERS[renderer](scene_graph, renderer)
    stereo = mff.AddStereoCamera(
        builder, plant=plant, scene_graph=scene_graph, rig=rig, renderer=renderer
    )
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    stereo_context = stereo.GetMyContextFromRoot(context)
    arm = plant.GetModelInstanceByName("pa10")
    plant.SetPositions(plant_context, arm, NOMINAL_POSITIONS)
    X_WC = plant.GetFrameByName("camera_right").CalcPoseInWorld(plant_context)
    box = plant.GetBodyByName("target_box")
    plant.SetFreeBodyPose(plant_context, box, X_WC @ RigidTransform([0.0, 0.155, 0.8]))
    ports = [stereo.GetOutputPort(f"color_image_{side}") for side in ("right", "left")]
    times = []
    for k in range(PAIRS[renderer]):
        plant.SetPositions(plant_context, arm, NOMINAL_POSITIONS + 1e-4 * k)
        start = time.perf_counter()
        for port in ports:
            port.EvalAbstract(stereo_context)
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)


def table() -> str:
    """Times of a pair against the image size."""
    rows = []
    for width, height in SIZES:
        vtk, flat = time_pair("vtk", width, height), time_pair("flat", width, height)
        rows.append([f"{width} x {height}", f"{vtk / flat:.0f}", f"{vtk:.1f}", f"{flat:.2f}"])
    return Markdown(["images", "vtk / flat", "vtk [ms a pair]", "flat [ms a pair]"], rows)
