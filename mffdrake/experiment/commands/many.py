"""The commands ``compare``, ``sweep`` and ``reproduce``: plans over one engine."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mffdrake.experiment.commands.one import SimulateOne, WriteScenario
from mffdrake.experiment.commands.options.arguments import GivenOptions
from mffdrake.experiment.paper.report.report import WriteReport
from mffdrake.experiment.paper.report.tables import SummaryLines
from mffdrake.experiment.paper.studies import MakeStudies
from mffdrake.experiment.paper.study import PlanRuns, RunStudies, Summarize
from mffdrake.experiment.progress import RunBar
from mffdrake.experiment.runs.compare import Compare, MakeVariants
from mffdrake.experiment.runs.engine import PlannedRun
from mffdrake.experiment.runs.executors import cluster
from mffdrake.experiment.runs.executors.cluster import DaskCluster
from mffdrake.experiment.runs.executors.executors import Executor, InProcess
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses, UsableCores
from mffdrake.experiment.runs.grid import Grid, LoadGrid
from mffdrake.experiment.runs.pictures import PlotComparison, PlotErrors
from mffdrake.experiment.runs.store import FRAMES_NAME, STORE_NAME, RunStore
from mffdrake.experiment.runs.sweep import Sweep
from mffdrake.experiment.runs.table import (
    MarkdownTable,
    SummaryTable,
    WindowNote,
    WriteJson,
    WriteRows,
)
from mffdrake.experiment.scenario.scenario import Change, LoadScenario, Scenario, ScenarioError
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.plotting import PlotHandPath, PlotPose, SaveFigure
from mffdrake.experiment.simulation.wiring.diagram import CheckScenario, MakeHandEyeDiagram
from mffdrake.recognition.parameters.yaml_text import ReadYaml
from mffdrake.recognition.recordings.files import MakeOutputFolder
from mffdrake.systems.arms.inverse_kinematics import UnreachablePathError
from mffdrake.systems.rendering.graphics import RequireGraphics
from mffdrake.systems.rendering.visualization import SaveDiagram

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["RunCompare", "RunReproduce", "RunSweep"]

_SHOWN_FAILURES = 5


def RunCompare(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    """Runs methods x speeds x seeds, and draws and tells what came out."""
    omegas = list(dict.fromkeys(options.omega))
    variants = MakeVariants(
        scenario, methods=list(dict.fromkeys(options.methods)), omegas=omegas,
        num_seeds=options.seeds,
    )  # fmt: skip
    _CheckSpeeds({variant.hand_path.omega: variant for variant in variants})
    plan = [PlannedRun(scenario=variant) for variant in variants]
    if options.graphviz:
        SaveDiagram(MakeHandEyeDiagram(variants[-1]), options.graphviz)
    _Begin(options, folder)
    try:
        with RunBar(plan) as on_run:
            place = _Place(options, plan, options.workers or 1)
            results = Compare(variants, executor=place, on_run=on_run, folder=folder)
    except KeyboardInterrupt:
        print("mffdrake: runs that have ended are kept: the same command goes on from there",
              file=sys.stderr)  # fmt: skip
        raise
    rows = [Evaluate(result) for result in results]
    WriteJson({"runs": rows}, folder / "results.json")
    WriteRows(rows, folder / "results.csv")
    WriteScenario(scenario, folder)
    first = [r for r, v in zip(results, variants, strict=True) if v.seed == scenario.seed]
    pictures: list[tuple[Callable[..., Any], Any, Path]] = [
        (PlotComparison, rows, folder / "comparison.png"),
        (PlotErrors, first, folder / "errors.png"),
    ]
    for k, omega in enumerate(omegas):  # The first seed's records come speed by speed.
        count = len(first) // len(omegas)
        chosen = first[k * count : (k + 1) * count]
        pictures.append((PlotHandPath, chosen[0], folder / f"hand_path_{omega:g}.png"))
        pictures.append((PlotPose, chosen, folder / f"pose_{omega:g}.png"))
    _DrawAll(pictures, options.workers or 1)
    if options.replay:
        SimulateOne(variants[-1], replay=options.replay)
    print(MarkdownTable(rows))
    print(f"Results and pictures: {folder}/")
    return 0


def _DrawAll(pictures: Sequence[tuple[Callable[..., Any], Any, Path]], workers: int) -> None:
    """Draws pictures, each most of a second's work, on as many processes as the simulations had."""
    count = min(workers, len(pictures))
    executor: Executor = LocalProcesses(count) if count > 1 else InProcess()
    with executor:
        for outcome in executor.Run(_Draw, pictures):
            if outcome.exception is not None:
                raise outcome.exception


def _Draw(plot: Callable[..., Figure], data: object, path: Path) -> None:
    SaveFigure(plot(data), path)


def RunSweep(options: argparse.Namespace) -> int:
    """Runs a sweep and tells what came out."""
    grid = _LoadGrid(options)
    place = _Place(options, grid.runs, UsableCores())
    folder = MakeOutputFolder(options.out)
    _Begin(options, folder)
    with RunBar(grid.runs) as on_run:
        table = Sweep(grid, folder, executor=place, file_format=options.format, on_run=on_run)
    rows = table.to_pylist()
    print(f"{SummaryTable(rows, list(grid.values))}\n\n{WindowNote(rows)}")
    failures = [row for row in rows if row["status"] == "failed"]
    status = _TellFailures(failures, len(rows), [*grid.values, "seed"], f"results.{options.format}")
    print(f"\nResults: {folder}/results.{options.format}")
    return status


def _LoadGrid(options: argparse.Namespace) -> Grid:
    """The scenario's file and text, the single options on top, and the grid file on top of that."""
    scenario = LoadScenario(options.scenario_file, options.scenario_text)
    given = GivenOptions(options, "duration", "seed", "renderer")
    grid = LoadGrid(options.grid, scenario=Change(scenario, given))
    data = ReadYaml(Path(options.grid).read_text(encoding="utf-8"))
    for name in given:
        lists_seeds = name == "seed" and isinstance(data.get("seeds"), list)
        if lists_seeds or name in data.get("scenario", {}) or name in grid.values:
            raise ScenarioError(
                f"--{name}: {options.grid} sets the {name} itself; change it there, or leave out "
                "the option"
            )
    return grid


def RunReproduce(options: argparse.Namespace) -> int:
    """Reproduces the paper's experiment and tells what came out."""
    base = LoadScenario(options.scenario_file, options.scenario_text)
    base = Change(base, GivenOptions(options, "duration", "seed"))
    studies = MakeStudies(options.seeds, vtk_seeds=options.vtk_seeds, short=options.short)
    plan = PlanRuns(studies, base)
    # Whether the paper's own speeds are possible; beyond them, that is a part of the answer.
    own = [run for run in plan if run.labels["study"] == studies[0].name]
    _CheckSpeeds({run.labels["value"]: run.scenario for run in own})
    place = _Place(options, plan, UsableCores())
    folder = MakeOutputFolder(options.out)
    if options.graphviz:
        SaveDiagram(MakeHandEyeDiagram(plan[0].scenario), options.graphviz)
    _Begin(options, folder)
    with RunBar(plan) as on_run:
        reproduction = RunStudies(studies, base, folder, executor=place, on_run=on_run)
    report = WriteReport(reproduction, folder)
    for line in SummaryLines(Summarize(reproduction.rows)):
        print(line)
    status = _TellFailures(
        reproduction.Failures(), len(plan), ["study", "label", "seed"], "runs.csv"
    )
    print(f"\nReport: {report}, and in one file: {report.with_suffix('.html')}")
    return status


# What they have in common.


def _CheckSpeeds(scenarios: Mapping[float, Scenario]) -> None:
    """Finds out before any long work whether the arm can follow the path at each speed."""
    for omega, scenario in scenarios.items():
        try:
            CheckScenario(scenario)
        except UnreachablePathError as error:
            raise ScenarioError(f"omega {omega:g} rad/s: {error}") from error


def _Place(options: argparse.Namespace, plan: Sequence[PlannedRun], workers: int) -> Executor:
    """Where to run a plan: on a cluster, or on processes of this machine."""
    if options.scheduler:
        return DaskCluster(options.scheduler)
    if any(run.scenario.renderer == "vtk" for run in plan):
        RequireGraphics()  # Rather once than at every run.
    count = min(options.workers or workers, len({run.scenario.fingerprint for run in plan}))
    return LocalProcesses(count) if count > 1 else InProcess()


def _Begin(options: argparse.Namespace, folder: Path) -> None:
    """Says which results from before are of no use, and quietens what all runs would warn of."""
    path, frames = folder / STORE_NAME, folder / FRAMES_NAME
    if path.exists():
        others = RunStore(path).CountOthers()
        if others:
            print(f"mffdrake: {path} has {others} runs of other code or versions; they stay there, "
                  "and are run anew", file=sys.stderr)  # fmt: skip
    elif frames.is_dir() and any(frames.iterdir()):
        print(f"mffdrake: {frames} has records of an earlier version, which cannot go on here; "
              "they stay there, and all is run anew", file=sys.stderr)  # fmt: skip
    if not options.verbose:
        logging.getLogger("mffdrake").setLevel(logging.ERROR)
        logging.getLogger(cluster.__name__).setLevel(
            logging.WARNING
        )  # It says why nothing goes on.


def _TellFailures(
    failures: Sequence[dict[str, Any]], count: int, labels: Sequence[str], file: str
) -> int:
    """Says which runs failed and why; returns the exit status."""
    if failures:
        print(f"\n{len(failures)} of {count} runs failed; the same command tries again:")
    for row in failures[:_SHOWN_FAILURES]:
        print(f"- {', '.join(f'{key} {row[key]}' for key in labels)}: {row['error']}")
    if len(failures) > _SHOWN_FAILURES:
        print(f"- ... (all in {file})")
    return 1 if failures else 0
