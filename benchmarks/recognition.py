"""Times one generation of the recognizer, selection and crossover included.

    python benchmarks/recognition.py

On flat-colored images of the box, with the population where it is after 60 generations. The first
column is the cost relative to the default's, in the same run.
"""

import itertools

import numpy as np
from tables import markdown, median_ms

import mffdrake as mff
from mffdrake.experiment.diagram import MakeHandEyeDiagram
from mffdrake.experiment.scenario import LoadScenario

GENERATIONS = 300
DEFAULT = {"population": 60, "spacing": 0.020, "width": 640}
POPULATIONS = (30, 60, 120, 240)
SPACINGS = (0.040, 0.020, 0.010, 0.005)
WIDTHS = (320, 640, 1280)


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
    camera = mff.StereoCamera.from_fov(width=width, height=width * 3 // 4, fov_y=0.785)
    tracker = mff.OneStepGaTracker(
        matcher=mff.Matcher(model, camera),
        parameters=mff.GeneticParameters(population_size=population),
        start=mff.NearStart([0.0, 0.155, 0.8, 0.0, 0.0, 0.0]),
    )
    right, left = images(width)
    generation = tracker.start_population(right, left)
    for frame in range(1, 61):
        generation = tracker.track(generation, right, left, frame=frame)
    frames = itertools.count(61)
    ms = median_ms(lambda: tracker.track(generation, right, left, frame=next(frames)), GENERATIONS)
    strip = len(model.edge_points) * len(model.strip_offsets)
    return ms, len(model.inside_points) + strip


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
    return markdown(header, rows)


if __name__ == "__main__":
    print(table())
