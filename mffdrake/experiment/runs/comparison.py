"""Runs many simulations, on several processes, with the same numbers for any number of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mffdrake.experiment.runs.executors.executors import Executor, InProcess
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.fingerprint import CodeFingerprint
from mffdrake.experiment.runs.store import RecordPath, RunKey
from mffdrake.experiment.runs.sweep import RunScenario
from mffdrake.experiment.scenario.scenario import Change, Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult

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
    on_result: Callable[[SimulationResult, bool], None] | None = None,
    folder: Path | None = None,
) -> list[SimulationResult]:
    """Runs scenarios on one or more processes.

    Args:
        scenarios: What to run.
        workers: Number of processes. The results do not depend on it, except for the times.
        executor: Where to run them instead.
        on_result: Called after every run, with whether it was there from before.
        folder: Where to keep every run as soon as it has ended. Runs that are there from before, by
            this very code, are not repeated.

    Returns:
        The records, in the scenarios' order.

    Raises:
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.
        WorkerDiedError: When a process that works on a run ended from outside, again and again.
        ClusterError: When a cluster cannot be reached (any more).
    """
    code = CodeFingerprint()
    tell = on_result or (lambda result, kept: None)
    results: dict[int, SimulationResult] = {}
    for index, scenario in enumerate(scenarios):
        result = None if folder is None else _Load(folder, RunKey(scenario, code))
        if result is not None:
            results[index] = result
            tell(result, True)
    missing = [index for index in range(len(scenarios)) if index not in results]
    if executor is None:
        count = min(workers, len(missing))
        executor = LocalProcesses(count) if count > 1 else InProcess()
    with executor:
        arguments = [(scenarios[index], code) for index in missing]
        for outcome in executor.Run(RunScenario, arguments) if missing else ():
            if outcome.exception is not None:
                raise outcome.exception
            index, result = missing[outcome.index], outcome.value
            if folder is not None:
                path = RecordPath(folder, RunKey(scenarios[index], code))
                path.parent.mkdir(parents=True, exist_ok=True)
                result.Save(path)
            results[index] = result
            tell(result, False)
    return [results[k] for k in range(len(scenarios))]


def _Load(folder: Path, key: str) -> SimulationResult | None:
    """A run that was kept, unless there is none or its file is damaged."""
    try:
        return SimulationResult.Load(RecordPath(folder, key))
    except (OSError, ValueError):
        return None
