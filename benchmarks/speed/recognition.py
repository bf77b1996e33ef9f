"""Times one generation of the recognizer, selection and crossover included, and a refinement.

On flat-colored images of the box, with the population where it is after 60 generations. The first
columns are costs relative to the default's, in the same run.
"""

import dataclasses as dc
import itertools
import math
from collections.abc import Callable

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.framework import DiagramBuilder
from timing import median_ms

import mffdrake as mff
from mffdrake.experiment.runs.table import Markdown
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.recognition.poses.pose import compose_quaternion_vectors, rotation_matrix
from mffdrake.recognition.poses.pose_motion import rotate_by

GENERATIONS = 300
DEFAULT = {"population": 60, "spacing": 0.020, "width": 640}
POPULATIONS = (30, 60, 120, 240)
SPACINGS = (0.040, 0.020, 0.010, 0.005)
WIDTHS = (320, 640, 1280)

STARTS = 50
ROUNDS, CALLS = 10, 50
TRUTH = np.array([0.0, 0.155, 0.8, 0.1, -0.2, 0.05])
"""A pose at which three faces are seen, so that one camera can tell it."""

LENSES = {
    "none": mff.Distortion(),
    "plumb_bob": mff.Distortion("plumb_bob", (-0.28, 0.12, 1.5e-3, -1.0e-3, -0.02)),
    "equidistant": mff.Distortion("equidistant", (0.04, -0.012, 0.005, -0.001)),
}
FINER = 5
"""Rays a pixel along u and v in the images from which those of a lens are taken; odd, for one to
be the middle."""


def images(width: int) -> tuple[np.ndarray, np.ndarray]:
    """Both images at the path's start."""
    camera = f"{{width: {width}, height: {width * 3 // 4}}}"
    text = f"{{renderer: flat, duration: 1.0, camera: {camera}}}"
    diagram = MakeHandEyeDiagram(LoadScenario(text=text))
    context = diagram.CreateDefaultContext()
    return tuple(
        diagram.GetOutputPort(f"stereo_camera.color_image_{side}").Eval(context).data.copy()
        for side in ("right", "left")
    )


def time_generation(*, population: int, spacing: float, width: int) -> tuple[float, int]:
    """Median wall time of a generation [ms], and the number of the model's points."""
    box = mff.SolidModel.from_mesh_file(mff.FindModelsPath() / "target_box.obj")
    model = mff.SearchModel(box, mff.SamplingParameters(spacing=spacing))
    rig = mff.CameraRig.stereo(width=width, height=width * 3 // 4, fov_y=0.785)
    tracker = mff.OneStepGaTracker(
        matcher=mff.Matcher(model, rig),
        parameters=mff.GeneticParameters(population_size=population),
        start=mff.NearStart([0.0, 0.155, 0.8, 0.0, 0.0, 0.0]),
    )
    generate, _ = track(tracker, images(width))
    ms = median_ms(generate, GENERATIONS)
    strip = len(model.edge_points) * len(model.strip_offsets)
    return ms, len(model.inside_points) + strip


def track(
    tracker: mff.OneStepGaTracker, pictures: tuple[np.ndarray, ...]
) -> tuple[Callable[[], object], np.ndarray]:
    """What computes a generation, the 61st on the same images, and the pose found before."""
    generation = tracker.start_population(pictures)
    for frame in range(1, 61):
        generation = tracker.track(generation, pictures, frame=frame)
    frames = itertools.count(61)
    return lambda: tracker.track(generation, pictures, frame=next(frames)), generation.best


def table() -> str:
    """Cost of a generation against population, points and image size."""
    variants = [DEFAULT | {"population": size} for size in POPULATIONS]
    variants += [DEFAULT | {"spacing": spacing} for spacing in SPACINGS]
    variants += [DEFAULT | {"width": width} for width in WIDTHS]
    usual, _ = time_generation(**DEFAULT)
    rows = []
    for variant in variants:
        ms, points = time_generation(**variant)
        size = f"{variant['width']} x {variant['width'] * 3 // 4}"
        rows.append([f"{ms / usual:.2f}", variant["population"], points, size, f"{ms:.2f}"])
    header = ["cost / default's", "population", "points of the model", "images", "generation [ms]"]
    return Markdown(header, rows)


def make_rig(count: int, lens: str) -> mff.CameraRig:
    """The pair's right camera, the pair, or the pair and a third camera that looks from above."""
    right, left = mff.CameraRig.stereo().cameras
    down = RotationMatrix.MakeXRotation(-0.3).matrix()
    above = dc.replace(right, name="above", R_CK=down, p_CK=np.array([-0.075, -0.12, 0.0]))
    cameras = (right, left, above)[:count]
    return mff.CameraRig(tuple(dc.replace(c, distortion=LENSES[lens]) for c in cameras))


def pictures_of(rig: mff.CameraRig) -> tuple[np.ndarray, ...]:
    """What a rig's cameras show of the box at `TRUTH`, lenses included."""
    straight = mff.CameraRig(
        tuple(
            dc.replace(
                c, distortion=LENSES["none"], width=FINER * c.width, height=FINER * c.height,
                fx=FINER * c.fx, fy=FINER * c.fy,
                cx=FINER * (c.cx + 0.5) - 0.5, cy=FINER * (c.cy + 0.5) - 0.5,
            )
            for c in rig.cameras
        )
    )  # fmt: skip
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    parser = Parser(plant)
    mff.ConfigureParser(parser)
    parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")
    for c in rig.cameras:
        X_CK = RigidTransform(RotationMatrix(c.R_CK), c.p_CK)
        plant.AddFrame(FixedOffsetFrame(f"camera_{c.name}", plant.world_frame(), X_CK))
    plant.Finalize()
    mff.AddRenderer(scene_graph, "flat")
    sensors = mff.AddStereoCamera(
        builder, plant=plant, scene_graph=scene_graph, rig=straight, renderer="flat"
    )
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    X_CM = RigidTransform(RotationMatrix(rotation_matrix(TRUTH[3:])), TRUTH[:3])
    box = plant.GetBodyByName("target_box")
    plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), box, X_CM)
    sensors_context = sensors.GetMyContextFromRoot(context)
    return tuple(
        through_lens(
            c, sensors.GetOutputPort(f"color_image_{c.name}").Eval(sensors_context).data[..., :3]
        )
        for c in rig.cameras
    )


def through_lens(camera: mff.Camera, fine: np.ndarray) -> np.ndarray:
    """A camera's image from a finer one without distortion: every pixel shows its middle."""
    lens = dc.replace(camera, R_CK=np.eye(3), p_CK=np.zeros(3))
    v, u = np.mgrid[: camera.height, : camera.width]
    pixels, center = np.stack([u, v], axis=-1), [camera.cx, camera.cy]
    f = np.array([camera.fx, camera.fy])
    rays = (pixels - center) / f
    for _ in range(40):  # Moves each ray by what its pixel lacks.
        rays += (pixels - lens.project(np.concatenate([rays, np.ones_like(u)[..., None]], -1))) / f
    column, row = np.rint(FINER * (rays * f + center + 0.5) - 0.5).astype(int).transpose(2, 0, 1)
    height, width, _ = fine.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    picture = fine[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.where(inside[..., None], picture, np.uint8(128))


def starts() -> list[np.ndarray]:
    """Poses 3 mm and 1 deg off the truth, in random directions."""
    rng, poses = np.random.default_rng(0), []
    for shift, turn in rng.normal(size=(STARTS, 2, 3)):
        eps = rotate_by(math.radians(1.0) * turn / np.linalg.norm(turn))
        position = TRUTH[:3] + 0.003 * shift / np.linalg.norm(shift)
        poses.append(np.concatenate([position, compose_quaternion_vectors(eps, TRUTH[3:])]))
    return poses


def prepare(count: int, lens: str) -> tuple[Callable[[], object], Callable[[], object]]:
    """What computes a generation, and what a refinement.

    Raises:
        RuntimeError: When the box is not found, for then it would not be what is timed.
    """
    box = mff.SolidModel.from_mesh_file(mff.FindModelsPath() / "target_box.obj")
    rig = make_rig(count, lens)
    matcher = mff.Matcher(mff.SearchModel(box), rig)
    tracker, refiner = (
        mff.OneStepGaTracker(matcher=matcher, start=mff.NearStart(TRUTH)),
        mff.BorderRefiner(matcher),
    )
    pictures = pictures_of(rig)
    generate, found = track(tracker, pictures)
    refined = [refiner.refine(pose, pictures) for pose in starts()]
    errors = [np.linalg.norm(r.pose[:3] - TRUTH[:3]) for r in refined if r.converged]
    far = np.linalg.norm(found[:2] - TRUTH[:2]) > 0.005  # Depth stays vague in a plain search.
    if far or len(errors) < 0.9 * len(refined) or np.median(errors) > 0.002:
        raise RuntimeError(
            f"{count} cameras, {lens}: found at {found}, {len(errors)} of {len(refined)} refined "
            f"with a median error of {1e3 * np.median(errors):.2f} mm"
        )
    poses = itertools.cycle(starts())
    return generate, lambda: refiner.refine(next(poses), pictures)


def table_of_rigs() -> str:
    """Cost of a generation and of a refinement against the number of cameras and their lenses."""
    calls = {(count, lens): prepare(count, lens) for count in (1, 2, 3) for lens in LENSES}
    times = {rig: [math.inf, math.inf] for rig in calls}
    for _ in range(ROUNDS):  # in turn, so that what else runs on the machine bears on all alike
        for rig, pair in calls.items():
            medians = [median_ms(call, CALLS) for call in pair]
            times[rig] = [min(ms) for ms in zip(times[rig], medians, strict=True)]
    usual, rows = times[2, "none"], []
    for (count, lens), measured in times.items():
        ratios = [f"{ms / pair:.2f}" for ms, pair in zip(measured, usual, strict=True)]
        rows.append([*ratios, count, lens, *(f"{ms:.2f}" for ms in measured)])
    header = ["generation / the pair's", "refinement / the pair's", "cameras", "distortion"]
    return Markdown([*header, "generation [ms]", "refinement [ms]"], rows)
