"""Runs all benchmarks and writes their tables into docs/performance.md.

    python benchmarks/report.py

It takes about ten minutes, on an otherwise idle machine.
"""

import os
import platform
from importlib.metadata import version
from pathlib import Path

import memory
import recognition
import renderers
import simulation
import sweeps
from tqdm import tqdm

from mffdrake.recognition.recordings.files import WholeFile

PAGE = Path(__file__).parents[1] / "docs" / "performance.md"

SECTIONS = (
    (
        "Rendering",
        renderers.table,
        "A pair of color images of the hand-eye scene, drawn anew after each motion of the arm.",
    ),
    (
        "One generation",
        recognition.table,
        "Selection, crossover and the fitness of the whole population on both images. The cost is "
        "linear in the population and in the points, and all but independent of the images' size: "
        "only the pixels under the model's points are looked at. An image shows about half of the "
        "model's points at a time.",
    ),
    (
        "Cameras",
        recognition.table_of_rigs,
        "The same and a refinement from 3 mm and 1 deg off, for one camera, the pair, and the pair "
        "with a third one that looks from above, of 640 x 480 pixels each. Lenses with a "
        "distortion are projected as they are: no image is rectified.",
    ),
    (
        "Whole simulations",
        simulation.table,
        "With motion feedforward, on one core; VTK's software rendering takes the others, too. The "
        "stages are means over the frames; the total includes 33 ticks of dynamics and control "
        "a frame.",
    ),
    (
        "Sweeps",
        sweeps.table,
        "Simulations of 40 s with the flat renderer, on local worker processes that are warm.",
    ),
    (
        "Memory",
        memory.table,
        "Peak of a process with one simulation of 40 s, and what a process holds after many.",
    ),
)


def machine() -> str:
    """What the numbers were measured on."""
    facts = [f"{os.cpu_count()} cores", platform.machine(), f"Python {platform.python_version()}"]
    facts += [f"{name} {version(name)}" for name in ("mffdrake", "drake", "numpy", "numba")]
    return ", ".join(facts)


def main() -> None:
    """Measures and writes."""
    parts = [
        "# Performance\n\nWritten by `make bench`. The ratios come first, as they were measured in "
        f"one run each and depend least on the machine: {machine()}."
    ]
    for title, table, text in tqdm(SECTIONS, unit="benchmark"):
        parts.append(f"## {title}\n\n{text}\n\n{table()}")
    with WholeFile(PAGE) as part:
        part.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    print(f"written: {PAGE}")


if __name__ == "__main__":
    main()
