"""Runs many simulations, on several processes, with the same numbers for any number of them."""

from __future__ import annotations

import logging
import multiprocessing
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from mffdrake.experiment.scenario import LoadScenario, Scenario
from mffdrake.experiment.simulation import Simulate, SimulationResult

__all__ = ["Compare", "MakeVariants", "WorkerDiedError"]


class WorkerDiedError(RuntimeError):
    """A process of a comparison ended before its work was done."""


def MakeVariants(
    scenario: Scenario, *, methods: Sequence[str], omegas: Sequence[float], num_seeds: int
) -> list[Scenario]:
    """Every method at every speed with every seed.

    Args:
        scenario: What the variants have in common, and the first seed.
        methods: Methods, see `METHODS`.
        omegas: Angular frequencies of the hand's path [rad/s].
        num_seeds: Number of seeds, from the scenario's on.

    Returns:
        The scenarios: speed by speed, method by method, seed by seed.

    Raises:
        ScenarioError: When one of them is wrong.

    Example:
        >>> len(MakeVariants(Scenario(), methods=["ga", "mff"], omegas=[0.1, 0.2], num_seeds=3))
        12
    """
    variants = []
    for omega in omegas:
        for method in methods:
            for seed in range(scenario.seed, scenario.seed + num_seeds):
                variant = LoadScenario(text=scenario.Dump())
                variant.hand_path.omega, variant.method, variant.seed = omega, method, seed
                variant.Validate()
                variants.append(variant)
    return variants


def Compare(
    scenarios: Sequence[Scenario],
    *,
    workers: int = 1,
    on_result: Callable[[SimulationResult], None] | None = None,
) -> list[SimulationResult]:
    """Runs scenarios on one or more processes.

    Args:
        scenarios: What to run.
        workers: Number of processes. The results do not depend on it, except for the times.
        on_result: Called after every run.

    Returns:
        The records, in the scenarios' order.

    Raises:
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.
        WorkerDiedError: When a process ended from outside.
    """
    notify = on_result or (lambda result: None)
    results: dict[int, SimulationResult] = {}
    if workers == 1:
        for k, scenario in enumerate(scenarios):
            results[k] = Simulate(scenario)
            notify(results[k])
        return list(results.values())
    # Fresh processes: a forked copy of a process that has rendered would share its graphics state.
    context = multiprocessing.get_context("spawn")
    count = min(workers, len(scenarios))
    level = logging.getLogger("mffdrake").getEffectiveLevel()
    with ProcessPoolExecutor(
        count, mp_context=context, initializer=_StartWorker, initargs=(level,)
    ) as pool:
        jobs = {pool.submit(_Run, scenario.Dump()): k for k, scenario in enumerate(scenarios)}
        try:
            for job in as_completed(jobs):
                results[jobs[job]] = job.result()
                notify(job.result())
        except BrokenProcessPool as error:
            raise WorkerDiedError(
                "a worker process died, for lack of memory perhaps; run again with fewer workers"
            ) from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()
            raise
    return [results[k] for k in range(len(scenarios))]


def _StartWorker(log_level: int) -> None:
    """Logs like the parent, and ends on Ctrl-C without a word, which is the parent's to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    logging.getLogger("mffdrake").setLevel(log_level)


def _Run(scenario: str) -> SimulationResult:
    """Runs a scenario given as YAML, which travels between processes as text."""
    return Simulate(LoadScenario(text=scenario))
