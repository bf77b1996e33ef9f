"""What ``mffdrake sweep`` does."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from mffdrake.experiment.commands.options import GivenOptions
from mffdrake.experiment.commands.progress import RunBar
from mffdrake.experiment.runs.executors.cluster import DaskCluster
from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses, UsableCores
from mffdrake.experiment.runs.grid import Grid, LoadGrid
from mffdrake.experiment.runs.sweep import Sweep
from mffdrake.experiment.runs.sweep_table import MedianTable
from mffdrake.experiment.scenario.scenario import Change, LoadScenario, ScenarioError
from mffdrake.recognition.parameters.yaml_text import ReadYaml
from mffdrake.recognition.recordings.files import MakeOutputFolder
from mffdrake.systems.rendering.graphics import RequireGraphics

__all__ = ["RunSweep"]

_SHOWN_FAILURES = 5


def RunSweep(options: argparse.Namespace) -> int:
    """Runs a sweep and tells what came out.

    Args:
        options: What the command line's parser made of the arguments.

    Returns:
        The exit status: 0, or 1 when runs failed.

    Raises:
        ScenarioError, StoreError, ClusterError, GraphicsUnavailableError, OSError: On bad input.
    """
    grid = _LoadGrid(options)
    if not options.scheduler and any(run.scenario.renderer == "vtk" for run in grid.runs):
        RequireGraphics()  # Rather once than at every run.
    folder = MakeOutputFolder(options.out)
    executor: Executor
    if options.scheduler:
        executor = DaskCluster(options.scheduler)
    else:
        executor = LocalProcesses(min(options.workers or UsableCores(), len(grid.runs)))
    if not options.verbose:  # Thousands of runs would all warn of the same.
        logging.getLogger("mffdrake").setLevel(logging.ERROR)
    with RunBar(len(grid.runs)) as on_run:
        table = Sweep(grid, folder, executor=executor, file_format=options.format, on_run=on_run)
    print(MedianTable(grid, table))
    failures = [row for row in table.to_pylist() if row["status"] == "failed"]
    if failures:
        print(f"\n{len(failures)} of {len(grid.runs)} runs failed; the same command tries again:")
    for row in failures[:_SHOWN_FAILURES]:
        where = ", ".join(f"{key} {row[key]}" for key in [*grid.values, "seed"])
        print(f"- {where}: {row['error']}")
    if len(failures) > _SHOWN_FAILURES:
        print(f"- ... (all in results.{options.format})")
    print(f"\nResults: {folder}/results.{options.format}")
    return 1 if failures else 0


def _LoadGrid(options: argparse.Namespace) -> Grid:
    """The scenario's file and text, the single options on top, and the grid file on top of that."""
    scenario = LoadScenario(options.scenario_file, options.scenario_text)
    given = GivenOptions(options, "duration", "seed", "renderer")
    scenario = Change(scenario, given)
    grid = LoadGrid(options.grid, scenario=scenario)
    data = ReadYaml(Path(options.grid).read_text(encoding="utf-8"))
    for name in given:
        lists_seeds = name == "seed" and isinstance(data.get("seeds"), list)
        if lists_seeds or name in data.get("scenario", {}) or name in grid.values:
            raise ScenarioError(
                f"--{name}: {options.grid} sets the {name} itself; change it there, or leave out "
                "the option"
            )
    return grid
