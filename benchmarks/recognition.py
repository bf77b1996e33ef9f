"""Times one generation of the recognizer, selection and crossover included.

    python benchmarks/recognition.py

Prints medians over many generations, for several population sizes, on images of an empty scene: the
cost does not depend on what the images show.
"""

import statistics
import time

import numpy as np

import mffdrake as mff

GENERATIONS = 300


def time_generation(population_size: int) -> float:
    """Median wall time of one generation [ms]."""
    box = mff.SolidModel.from_mesh_file(mff.FindModelsPath() / "target_box.obj")
    tracker = mff.OneStepGaTracker(
        matcher=mff.Matcher(mff.SearchModel(box), mff.StereoCamera()),
        parameters=mff.GeneticParameters(population_size=population_size),
        start=mff.NearStart([0.0, 0.155, 0.8, 0.0, 0.0, 0.0]),
    )
    image = np.full((480, 640, 4), 128, dtype=np.uint8)
    generation = tracker.start_population(image, image)
    times = []
    for frame in range(1, GENERATIONS + 1):
        start = time.perf_counter()
        generation = tracker.track(generation, image, image, frame=frame)
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)


if __name__ == "__main__":
    print("| population | ms a generation |\n|---:|---:|")
    for size in (30, 60, 120, 240):
        print(f"| {size} | {time_generation(size):.2f} |")
