"""Runs all benchmarks of speed and memory, and writes docs/studies/performance.md.

    python benchmarks performance [--only TITLE] [--record]

It takes about ten minutes, on an otherwise idle machine. --record only measures this version's line
in benchmarks/history.csv, in a minute or two.
"""

import argparse
import os
import platform
from importlib.metadata import version
from pathlib import Path

from tqdm import tqdm

from mffdrake.recognition.recordings.files import WholeFile
from speed import history, memory, recognition, renderers, simulation, sweeps

PAGE = Path(__file__).parents[2] / "docs" / "studies" / "performance.md"

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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    titles = [title for title, _, _ in SECTIONS]
    parser.add_argument("--only", choices=titles, help="print this table, and write no page")
    parser.add_argument(
        "--record", action="store_true", help=f"write a line in {history.FILE.name}"
    )
    options = parser.parse_args()
    if options.record:
        line = history.measure()
        history.record(line)
        print("\n".join(f"{name:<18}{value}" for name, value in line.items()))
        print(f"written: {history.FILE}")
        return
    if options.only:
        (table,) = [table for title, table, _ in SECTIONS if title == options.only]
        print(table())
        return
    parts = [
        "# Performance\n\nWritten by `make bench`. The ratios come first, as they were measured in "
        f"one run each and depend least on the machine: {machine()}. "
        "[`benchmarks/history.csv`](../../benchmarks/history.csv) has the main ones of each "
        "release."
    ]
    for title, table, text in tqdm(SECTIONS, unit="benchmark"):
        parts.append(f"## {title}\n\n{text}\n\n{table()}")
    with WholeFile(PAGE) as part:
        part.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    print(f"written: {PAGE}")
