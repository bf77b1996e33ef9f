"""Memory of simulations: of one of 40 s, and of a hundred in one process, which must not grow."""

import multiprocessing
import resource

from mffdrake.experiment.runs.table import Markdown
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate

RUNS = 100


def resident_mb() -> float:
    """Memory that this process holds at present [MB]."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6


def peak_of_long_run(renderer: str) -> float:
    """Peak memory of a process with one simulation of 40 s [MB]."""
    Simulate(LoadScenario(text=f"{{renderer: {renderer}, duration: 40.0}}"))
    # (getrusage would also count what the process was forked from.)
    with open("/proc/self/status") as file:
        (line,) = [line for line in file if line.startswith("VmHWM")]
    return 1.024e-3 * int(line.split()[1])


def memory_after_runs(renderer: str) -> list[float]:
    """Memory after each of many short simulations in this process [MB]."""
    held = []
    for seed in range(RUNS):
        Simulate(LoadScenario(text=f"{{renderer: {renderer}, duration: 0.5, seed: {seed}}}"))
        held.append(resident_mb())
    return held


def table() -> str:
    """Peak, and growth from the tenth to the last of many runs."""
    rows = []
    context = multiprocessing.get_context("spawn")
    for renderer in ("flat", "vtk"):
        with context.Pool(1, maxtasksperchild=1) as pool:
            peak = pool.apply(peak_of_long_run, [renderer])
            held = pool.apply(memory_after_runs, [renderer])
        growth = (held[-1] - held[9]) / (RUNS - 10)
        cells = [f"{held[-1] / held[9]:.3f}", f"{growth:.3f}"]
        cells += [f"{megabytes:.0f}" for megabytes in (held[9], held[-1], peak)]
        rows.append([renderer, *cells])
    header = ["renderer", "after 100 runs / after 10", "growth [MB a run]", "after 10 runs [MB]"]
    header += ["after 100 runs [MB]", "peak of one 40 s run [MB]"]
    return Markdown(header, rows)
