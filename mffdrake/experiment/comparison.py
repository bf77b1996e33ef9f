"""Runs many simulations, on several processes, with the same numbers for any number of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mffdrake.experiment.executors import Executor, InProcess
from mffdrake.experiment.fingerprint import CodeFingerprint
from mffdrake.experiment.local_processes import LocalProcesses
from mffdrake.experiment.scenario import Change, Scenario
from mffdrake.experiment.simulation import SimulationResult
from mffdrake.experiment.sweep import RunScenario

__all__ = ["Compare", "MakeVariants"]


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
                values = {"hand_path.omega": omega, "method": method, "seed": seed}
                variants.append(Change(scenario, values))
    return variants


def Compare(
    scenarios: Sequence[Scenario],
    *,
    workers: int = 1,
    executor: Executor | None = None,
    on_result: Callable[[SimulationResult], None] | None = None,
) -> list[SimulationResult]:
    """Runs scenarios on one or more processes.

    Args:
        scenarios: What to run.
        workers: Number of processes. The results do not depend on it, except for the times.
        executor: Where to run them instead.
        on_result: Called after every run.

    Returns:
        The records, in the scenarios' order.

    Raises:
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.
        WorkerDiedError: When a process that works on a run ended from outside, again and again.
        ClusterError: When a cluster cannot be reached (any more).
    """
    if executor is None:
        count = min(workers, len(scenarios))
        executor = LocalProcesses(count) if count > 1 else InProcess()
    code = CodeFingerprint()
    results: dict[int, SimulationResult] = {}
    with executor:
        arguments = [(scenario, code) for scenario in scenarios]
        for outcome in executor.Run(RunScenario, arguments):
            if outcome.exception is not None:
                raise outcome.exception
            results[outcome.index] = outcome.value
            if on_result is not None:
                on_result(outcome.value)
    return [results[k] for k in range(len(scenarios))]
