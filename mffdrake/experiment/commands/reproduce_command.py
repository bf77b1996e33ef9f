"""What ``mffdrake reproduce`` does."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from mffdrake.experiment.commands.options import GivenOptions
from mffdrake.experiment.commands.progress import Advance, ProgressBar
from mffdrake.experiment.paper.report import WriteReport
from mffdrake.experiment.paper.report_tables import SummaryLines
from mffdrake.experiment.paper.reproduction import RunPlan, Summarize
from mffdrake.experiment.paper.studies import MakeStudies
from mffdrake.experiment.runs.executors.cluster import DaskCluster
from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses, UsableCores
from mffdrake.experiment.runs.store import Record
from mffdrake.experiment.runs.study import PlannedRun, PlanRuns
from mffdrake.experiment.scenario.scenario import Change, LoadScenario, ScenarioError
from mffdrake.experiment.simulation.pictures import SaveDiagram
from mffdrake.experiment.simulation.wiring.diagram import CheckScenario, MakeHandEyeDiagram
from mffdrake.recognition.recordings.files import MakeOutputFolder
from mffdrake.systems.arms.inverse_kinematics import UnreachablePathError
from mffdrake.systems.rendering.graphics import RequireGraphics

__all__ = ["RunReproduce"]


def RunReproduce(options: argparse.Namespace) -> int:
    """Reproduces the paper's experiment and tells what came out.

    Args:
        options: What the command line's parser made of the arguments.

    Returns:
        The exit status: 0, or 1 when runs failed for other reasons than the arm's limits.

    Raises:
        ScenarioError, UnreachablePathError, StoreError, ClusterError, GraphicsUnavailableError,
            OSError: On bad input.
    """
    base = LoadScenario(options.scenario_file, options.scenario_text)
    base = Change(base, GivenOptions(options, "duration", "seed"))
    studies = MakeStudies(options.seeds, vtk_seeds=options.vtk_seeds, short=options.short)
    plan = PlanRuns(studies, base)
    distinct = {run.scenario.fingerprint: run for run in plan}
    _Check(plan)
    if not options.scheduler and any(run.work > 1.0 for run in plan):
        RequireGraphics()  # Rather once than at every run.
    folder = MakeOutputFolder(options.out)
    if options.graphviz:
        SaveDiagram(MakeHandEyeDiagram(plan[0].scenario), options.graphviz)
    executor: Executor
    if options.scheduler:
        executor = DaskCluster(options.scheduler)
    else:
        executor = LocalProcesses(min(options.workers or UsableCores(), len(distinct)))
    if not options.verbose:  # Hundreds of runs would all warn of the same.
        logging.getLogger("mffdrake").setLevel(logging.ERROR)
    with _WorkBar(list(distinct.values())) as on_run:
        reproduction = RunPlan(plan, folder, executor=executor, on_run=on_run)
    report = WriteReport(reproduction, folder)
    for line in SummaryLines(Summarize(reproduction.rows)):
        print(line)
    failures = reproduction.Failures()
    if failures:
        print(f"\n{len(failures)} runs failed; the same command tries them again. The first:")
        print(f"- {failures[0]['study']}, {failures[0]['label']}: {failures[0]['error']}")
    print(f"\nReport: {report}, and in one file: {report.with_suffix('.html')}")
    return 1 if failures else 0


def _Check(plan: Sequence[PlannedRun]) -> None:
    """Finds out before any long work whether the paper's own speeds are possible.

    Beyond them, it is a part of the answer.
    """
    first = {
        run.variant.value: run.scenario for run in plan if run.study.name == plan[0].study.name
    }
    for omega, scenario in first.items():
        try:
            CheckScenario(scenario)
        except UnreachablePathError as error:
            raise ScenarioError(f"omega {omega:g} rad/s: {error}") from error


@contextmanager
def _WorkBar(runs: Sequence[PlannedRun]) -> Iterator[Callable[[PlannedRun, Record, bool], None]]:
    """A bar over the work that is done, as runs differ much."""
    form = "{desc}: {percentage:3.0f}%|{bar}| {unit} [{elapsed}<{remaining}]"
    total = sum(run.work for run in runs)
    with ProgressBar(total=total, desc="simulations", bar_format=form) as bar:
        ended, bar.unit = 0, f"0/{len(runs)} runs"

        def OnRun(run: PlannedRun, record: Record, kept: bool) -> None:
            nonlocal ended
            ended += 1
            bar.unit = f"{ended}/{len(runs)} runs"
            Advance(bar, run.work, kept=kept)

        yield OnRun
