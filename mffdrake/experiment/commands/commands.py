"""What the commands of the command line do."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mffdrake.experiment.commands.arguments import ArgumentsError
from mffdrake.experiment.commands.colors_command import RunColors
from mffdrake.experiment.commands.one_run import SimulateOne, TimeBar, WriteScenario
from mffdrake.experiment.commands.options import GivenOptions
from mffdrake.experiment.commands.progress import Advance, ProgressBar
from mffdrake.experiment.commands.reproduce_command import RunReproduce
from mffdrake.experiment.commands.servo_command import RunServo, ServoDefaults
from mffdrake.experiment.commands.sweep_command import RunSweep
from mffdrake.experiment.commands.target_command import RunTarget
from mffdrake.experiment.commands.track_command import RunTrack
from mffdrake.experiment.runs.comparison import Compare, MakeVariants
from mffdrake.experiment.runs.executors.cluster import ClusterError, DaskCluster
from mffdrake.experiment.runs.executors.executors import Executor, InProcess, WorkerDiedError
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.store import StoreError
from mffdrake.experiment.runs.sweep import OtherCodeError
from mffdrake.experiment.scenario.scenario import Change, LoadScenario, Scenario
from mffdrake.experiment.scenario.scenario_docs import DescribeDefaults, MakeSchema
from mffdrake.experiment.simulation.evaluation import Evaluate, MarkdownTable, WriteResults
from mffdrake.experiment.simulation.pictures import (
    DrawCameraView,
    DrawScene,
    SaveDiagram,
    SaveImage,
)
from mffdrake.experiment.simulation.plotting import (
    PlotComparison,
    PlotErrors,
    PlotHandPath,
    PlotPose,
    PlotToFile,
    SaveFigure,
)
from mffdrake.experiment.simulation.record import Record, TrackCommand
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.experiment.simulation.wiring.diagram import CheckScenario, MakeHandEyeDiagram
from mffdrake.recognition import ParameterError
from mffdrake.recognition.camera.calibration import CalibrationError
from mffdrake.recognition.recordings.color_file import ColorFileError
from mffdrake.recognition.recordings.files import MakeOutputFolder
from mffdrake.recognition.recordings.image_files import ImageSourceError
from mffdrake.recognition.recordings.recording import RecordingError
from mffdrake.recognition.recordings.rig_file import RigError
from mffdrake.recognition.recordings.trajectory import TrajectoryError
from mffdrake.systems.arms.arm_joints import ArmError
from mffdrake.systems.arms.inverse_kinematics import UnreachablePathError
from mffdrake.systems.rendering.graphics import GraphicsUnavailableError

__all__ = ["RunCommand", "UserError"]


_USER_ERRORS = (
    ParameterError, ArmError, UnreachablePathError, GraphicsUnavailableError, WorkerDiedError,
    ClusterError,
    StoreError, OtherCodeError, ArgumentsError, CalibrationError, ColorFileError,
    ImageSourceError, RecordingError, RigError, TrajectoryError,
)  # fmt: skip


def _PrintDefaults(options: argparse.Namespace) -> int:
    print(DescribeDefaults(), end="")
    return 0


def _PrintSchema(options: argparse.Namespace) -> int:
    print(json.dumps(MakeSchema(), indent=2))
    return 0


_OWN_COMMANDS = {
    "sweep": RunSweep, "track": RunTrack, "colors": RunColors, "target": RunTarget,
    "defaults": _PrintDefaults, "schema": _PrintSchema,
}  # fmt: skip
"""Those that read no scenario, or one in a way of their own."""


class UserError(Exception):
    """Something that the person at the command line can mend."""


def RunCommand(options: argparse.Namespace) -> int:
    """Runs a command.

    Args:
        options: What the command line's parser made of the arguments.

    Returns:
        The exit status: 0, or 1 when runs of a sweep or a reproduction failed.

    Raises:
        UserError: On bad input; the message is for the person who gave it.
    """
    try:
        if options.command in _OWN_COMMANDS:
            return _OWN_COMMANDS[options.command](options)
        if options.command == "reproduce":
            _CheckFiles(options)
            return RunReproduce(options)
        _CheckFiles(options)
        scenario = _LoadScenario(options)
        folder = MakeOutputFolder(options.out)
        command = {"run": _Run, "compare": _Compare, "record": _Record, "servo": RunServo}[
            options.command
        ]
        return command(options, scenario, folder)
    except OSError as error:
        name = f"cannot use {error.filename}: " if error.filename else ""
        raise UserError(f"{name}{error.strerror or error}") from error
    except _USER_ERRORS as error:
        raise UserError(str(error)) from error


def _CheckFiles(options: argparse.Namespace) -> None:
    """Finds out before any long work whether the wanted files can be written."""
    for option, path, suffixes in (
        ("--graphviz", getattr(options, "graphviz", None), (".svg", ".png")),
        ("--replay", getattr(options, "replay", None), (".html",)),
    ):
        if path is None:
            continue
        if Path(path).suffix not in suffixes:
            raise UserError(f"{option} {path}: the file must end in {' or '.join(suffixes)}")
        MakeOutputFolder(Path(path).parent)
        if Path(path).is_dir():
            raise UserError(f"{option} {path}: is a directory, not a file")


def _LoadScenario(options: argparse.Namespace) -> Scenario:
    """The scenario's file and text, with the single options on top."""
    defaults = ServoDefaults() if options.command == "servo" else None
    scenario = LoadScenario(options.scenario_file, options.scenario_text, defaults=defaults)
    values = GivenOptions(options, "duration", "seed", "renderer", "method")
    if options.command in ("run", "record") and options.omega is not None:
        values["hand_path.omega"] = options.omega
    return Change(scenario, values)


def _Run(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    one = SimulateOne(scenario, graphviz=options.graphviz, replay=options.replay)
    diagram, result = one.diagram, one.result
    row = Evaluate(result)
    result.Save(folder / "result.npz")
    WriteResults([row], folder)
    WriteScenario(scenario, folder)
    SaveFigure(PlotHandPath(result), folder / "hand_path.png")
    SaveFigure(PlotPose([result]), folder / "pose.png")
    SaveImage(DrawCameraView(diagram, scenario, result, images=one.images), folder / "camera.png")
    SaveImage(DrawScene(diagram, result), folder / "scene.png")
    print(MarkdownTable([row]))
    stages = ", ".join(f"{name} {ms:.2f}" for name, ms in row["stages_ms"].items())
    print(f"Wall time a frame [ms]: {stages}.")
    _SayWhere(folder)
    if one.interrupted:
        print(f"mffdrake: interrupted: these are the first {row['frames']} frames", file=sys.stderr)
    return 130 if one.interrupted else 0


def _Record(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    with TimeBar(scenario.duration) as on_frame:
        result = Record(scenario, folder, on_frame=on_frame)
    print(f"{len(result.time)} frames. To track them as they were tracked just now:")
    print(TrackCommand(scenario, folder))
    print(f"Recording: {folder}/")
    return 0


def _Compare(options: argparse.Namespace, scenario: Scenario, folder: Path) -> int:
    variants = MakeVariants(
        scenario,
        methods=list(dict.fromkeys(options.methods)),
        omegas=list(dict.fromkeys(options.omega)),
        num_seeds=options.seeds,
    )
    # Every speed is checked now, so that bad input shows before any long work.
    for variant in {variant.hand_path.omega: variant for variant in variants}.values():
        try:
            CheckScenario(variant)
        except UnreachablePathError as error:
            raise UserError(f"omega {variant.hand_path.omega:g} rad/s: {error}") from error
    if options.graphviz:
        SaveDiagram(MakeHandEyeDiagram(variants[-1]), options.graphviz)
    # What there is to warn of has been said.
    logging.getLogger("mffdrake").setLevel(logging.ERROR)
    with _RunBar(len(variants)) as on_result:
        cluster = DaskCluster(options.scheduler) if options.scheduler else None
        try:
            results = Compare(
                variants, workers=options.workers or 1, executor=cluster, on_result=on_result,
                folder=folder,
            )  # fmt: skip
        except KeyboardInterrupt:
            print("mffdrake: runs that have ended are kept: the same command goes on from there",
                  file=sys.stderr)  # fmt: skip
            raise
    rows = [Evaluate(result) for result in results]
    WriteResults(rows, folder, as_csv=True)
    WriteScenario(scenario, folder)
    first_seed = [r for r, v in zip(results, variants, strict=True) if v.seed == scenario.seed]
    pictures: list[tuple[Callable[..., Any], Any, Path]] = [
        (PlotComparison, rows, folder / "comparison.png"),
        (PlotErrors, first_seed, folder / "errors.png"),
    ]
    for omega in dict.fromkeys(options.omega):
        chosen = [r for r, row in zip(results, rows, strict=True)
                  if row["omega"] == omega and row["seed"] == scenario.seed]  # fmt: skip
        pictures.append((PlotHandPath, chosen[0], folder / f"hand_path_{omega:g}.png"))
        pictures.append((PlotPose, chosen, folder / f"pose_{omega:g}.png"))
    _DrawAll(pictures, options.workers or 1)
    if options.replay:
        SimulateOne(variants[-1], replay=options.replay)
    print(MarkdownTable(rows))
    _SayWhere(folder)
    return 0


def _DrawAll(pictures: Sequence[tuple[Callable[..., Any], Any, Path]], workers: int) -> None:
    """Draws pictures, each most of a second's work, on as many processes as the simulations had."""
    count = min(workers, len(pictures))
    executor: Executor = LocalProcesses(count) if count > 1 else InProcess()
    with executor:
        for outcome in executor.Run(PlotToFile, pictures):
            if outcome.exception is not None:
                raise outcome.exception


def _SayWhere(folder: Path) -> None:
    print(f"Results and pictures: {folder}/")


@contextmanager
def _RunBar(count: int) -> Iterator[Callable[[SimulationResult, bool], None]]:
    """A bar over finished runs."""
    with ProgressBar(total=count, desc="simulations", unit="run") as bar:

        def OnResult(result: SimulationResult, kept: bool) -> None:
            speed = (result.time[-1] if len(result.time) else 0.0) / result.wall_s
            bar.set_postfix_str(f"{speed:.2f} x real time", refresh=False)
            Advance(bar, kept=kept)

        yield OnResult
