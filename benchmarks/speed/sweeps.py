"""Times many runs on one and on two worker processes, with the flat renderer.

The workers are started and have loaded everything before the clock starts.
"""

import time

from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.table import Markdown
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate

RUNS = 8
DURATION = 40.0
WORKERS = (1, 2)


def simulate(duration: float, seed: int) -> None:
    """One run."""
    Simulate(LoadScenario(text=f"{{renderer: flat, duration: {duration}, seed: {seed}}}"))


def throughput(workers: int) -> float:
    """Simulated seconds in a second of wall time."""
    with LocalProcesses(workers) as executor:
        run_all(executor, [(1.0, seed) for seed in range(2 * workers)])
        start = time.perf_counter()
        run_all(executor, [(DURATION, seed) for seed in range(RUNS)])
        return RUNS * DURATION / (time.perf_counter() - start)


def run_all(executor: LocalProcesses, arguments: list[tuple[float, int]]) -> None:
    """Runs all, and stops at the first that fails."""
    for outcome in executor.Run(simulate, arguments):
        if outcome.exception is not None:
            raise outcome.exception


def table() -> str:
    """Throughput against the number of workers."""
    rates = {workers: throughput(workers) for workers in WORKERS}
    rows = [
        [workers, f"{rate / rates[1]:.2f}", f"{60.0 * rate:.0f}"] for workers, rate in rates.items()
    ]
    return Markdown(["workers", "throughput / one worker's", "simulated s a minute"], rows)
