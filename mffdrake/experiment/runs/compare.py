"""Methods x speeds x seeds, with every frame."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from mffdrake.experiment.runs.engine import EndedRun, PlannedRun, RunPlan
from mffdrake.experiment.runs.executors.executors import Executor, InProcess
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.store import STORE_NAME, RunStore
from mffdrake.experiment.scenario.scenario import Change, Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.recognition.recordings.files import MakeOutputFolder

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
    return [
        Change(scenario, {"hand_path.omega": omega, "method": method, "seed": seed})
        for omega in omegas
        for method in methods
        for seed in range(scenario.seed, scenario.seed + num_seeds)
    ]


def Compare(
    scenarios: Sequence[Scenario],
    *,
    workers: int = 1,
    executor: Executor | None = None,
    on_run: Callable[[EndedRun], None] | None = None,
    folder: Path | None = None,
) -> list[SimulationResult]:
    """Runs scenarios on one or more processes.

    Args:
        scenarios: What to run.
        workers: Number of processes. The results do not depend on it, except for the times.
        executor: Where to run them instead.
        on_run: Called for every run that has ended.
        folder: Where to keep every run as soon as it has ended. Runs that are there from before, by
            this very code, are not repeated.

    Returns:
        The records, in the scenarios' order.

    Raises:
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.
        WorkerDiedError: When a process that works on a run ended from outside, again and again.
        ClusterError: When a cluster cannot be reached (any more).

    Example:
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> pair = MakeVariants(short, methods=["ga", "mff"], omegas=[0.314], num_seeds=1)
        >>> [result.recognized_pose.shape for result in Compare(pair)]
        [(4, 6), (4, 6)]
    """

    def Tell(ended: EndedRun) -> None:
        if ended.exception is not None:
            raise ended.exception
        if on_run is not None:
            on_run(ended)

    plan = [PlannedRun(scenario=scenario, keeps_frames=True) for scenario in scenarios]
    count = min(workers, len(plan))
    executor = executor or (LocalProcesses(count) if count > 1 else InProcess())
    with tempfile.TemporaryDirectory() as forgotten:
        store = RunStore(MakeOutputFolder(folder or forgotten) / STORE_NAME)
        ended = RunPlan(plan, store, executor=executor, on_run=Tell)
    return [run.frames for run in ended if run.frames is not None]
