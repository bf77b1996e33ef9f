"""The command line: ``mffdrake run``, ``compare``, ``track`` and the others.

What a command needs is imported when it is called: the help comes at once. A command is a function
of the parsed options (some also of the scenario and the folder for results, see `_WithScenario`)
that returns the exit status: 0; 1 when runs failed; 2 where the target left the arm's reach; 130
after an interrupt. On bad input it raises an `InputError` or an OSError, most of it before any long
work.
"""

from __future__ import annotations

import argparse
import json
import logging
import signal
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Any, NoReturn

from mffdrake.experiment.runs.executors.executors import WorkerDiedError
from mffdrake.experiment.runs.executors.local_processes import PrepareWorkers

__all__ = ["main"]


_MESHCAT = "show it in a browser as it happens, with buttons to pause, step and reset"


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and takes options by their whole names only."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _Positive(kind: type[int] | type[float]) -> Callable[[str], float]:
    """A converter for positive numbers, with a message that says so."""

    def Convert(text: str) -> float:
        try:
            value: float = kind(text)
        except ValueError:
            value = 0
        if not 0 < value < float("inf"):
            name = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"must be a positive {name}, not '{text}'")
        return value

    return Convert


def _MakeParser() -> argparse.ArgumentParser:
    common = _Parser(add_help=False)
    add = common.add_argument
    add("--scenario-file", metavar="F", help="YAML file with the scenario")
    add("--scenario-text", metavar="YAML", help="scenario as YAML, on top of the file")
    add("--duration", metavar="S", type=_Positive(float), help="simulated time [s]")
    add("--seed", metavar="N", type=int, help="seed of the random numbers, of several the first")
    add("--out", metavar="DIR", default="out", help="folder for the results (default: out)")
    add("--verbose", action="store_true", help="say more on the way")
    renderer, diagram, replay, path, live = (_Parser(add_help=False) for _ in range(5))
    renderer.add_argument("--renderer", metavar="NAME", help="what draws the images: vtk or flat")
    diagram.add_argument(
        "--graphviz", metavar="FILE", help="write the (last run's) diagram as SVG or PNG"
    )
    replay.add_argument("--replay", metavar="FILE.html",
                        help="write a Meshcat recording (of the last run) as one HTML file"
    )  # fmt: skip
    live.add_argument("--meshcat", action="store_true", help=_MESHCAT)
    live.add_argument("--video", metavar="FILE.mp4",
                      help="write the cameras' images, with the model and the numbers, as a video"
    )  # fmt: skip
    path.add_argument("--method", metavar="ga|mff", help="without or with motion feedforward")
    path.add_argument("--omega", metavar="W", type=float, help="speed of the hand's path [rad/s]")
    pictures = [common, renderer, diagram, replay]

    parser = _Parser(
        prog="mffdrake",
        description="Recognizes a target's pose with stereo cameras on a moving robot hand.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {version('mffdrake')}")
    commands = parser.add_subparsers(
        dest="command",
        required=True,
        metavar="run|servo|compare|sweep|reproduce|track|colors|target|record|defaults|schema",
    )
    commands.add_parser("run", parents=[*pictures, path, live], help="one simulation")
    servo = commands.add_parser(
        "servo", parents=[*pictures, live],
        help="one simulation in which the hand follows the target",
        description="The target moves, and the hand follows it by what its cameras see.",
    )  # fmt: skip
    add = servo.add_argument
    add("--method", metavar="ga|mff", help="without or with motion feedforward")
    add("--period", metavar="S", type=_Positive(float), help="of the target's swing [s]")
    add("--amplitude", metavar="M", type=_Positive(float), help="of its swing along y [m]")
    compare = commands.add_parser(
        "compare", parents=pictures, help="methods x speeds x seeds, with a table"
    )
    compare.add_argument(
        "--methods", metavar="M", nargs="+", default=["ga", "mff"], help="methods (default: ga mff)"
    )
    add = compare.add_argument
    add("--omega", metavar="W", nargs="+", type=float, default=[0.105, 0.157, 0.314],
        help="speeds of the hand's path [rad/s] (default: 0.105 0.157 0.314)")  # fmt: skip
    compare.add_argument("--seeds", metavar="K", type=_Positive(int), default=1,
                         help="number of seeds, from --seed on (default: 1)")  # fmt: skip
    _AddPlaces(compare, "1")
    sweep = commands.add_parser("sweep", parents=[common, renderer],
                                help="a grid of scenarios, with a table; goes on where it was"
    )  # fmt: skip
    sweep.add_argument("grid", metavar="GRID.yaml", help="file with the grid")
    sweep.add_argument("--format", choices=["parquet", "csv"], default="parquet",
                       help="of the table of results (default: parquet)")  # fmt: skip
    _AddPlaces(sweep, "the number of cores")
    reproduce = commands.add_parser(
        "reproduce", parents=[common, diagram],
        help="the paper's figures and table, and more, as a report; goes on where it was",
        description="Runs the paper's experiment with many seeds and studies beyond it, and writes "
        "a report. With the defaults that takes about an hour on two cores, with --short a "
        "minute. The same command goes on where it was interrupted.",
    )  # fmt: skip
    reproduce.add_argument(
        "--seeds", metavar="K", type=_Positive(int), default=20,
        help="number of seeds of the paper's table, from --seed on; the studies beyond it have "
        "at most 5 (default: 20)",
    )  # fmt: skip
    reproduce.add_argument("--vtk-seeds", metavar="K", type=_NotNegative, default=5,
                           help="of the same table on VTK's images; 0 leaves it out (default: 5)"
    )  # fmt: skip
    reproduce.add_argument("--short", action="store_true",
                           help="one seed, the flat renderer alone, and a few of the studies"
    )  # fmt: skip
    _AddPlaces(reproduce, "the number of cores")
    _AddImageCommands(commands)
    commands.add_parser(
        "record", parents=[common, renderer, path],
        help="images, rig and motion from a scenario, for track",
        description="Runs a scenario and writes its cameras' images, rig file, motion and true "
        "poses to --out, and prints the command that tracks them.",
    )  # fmt: skip
    commands.add_parser("defaults", help="print the default scenario with a comment on every key")
    commands.add_parser("schema", help="print a JSON Schema of scenario files, for editors")
    return parser


def _AddImageCommands(commands: Any) -> None:
    """Adds the commands that work on images: track and colors."""
    images = _Parser(add_help=False)
    add = images.add_argument
    add("--rig", metavar="RIG.yaml", required=True, help="file with the cameras")
    add("--target", metavar="MESH", required=True, help="closed, colored mesh, e.g. OBJ")
    add("--verbose", action="store_true", help="say more on the way")
    track = commands.add_parser(
        "track", parents=[images], help="poses from your images, calibrations and mesh",
        description="Recognizes the target's pose in every frame of recorded images. Writes "
        "poses.csv, poses.tum, track.json and pictures to --out.",
    )  # fmt: skip
    add = track.add_argument
    add(
        "--images", metavar="NAME=SOURCE", nargs="+", required=True,
        help="a camera's images: a folder, a pattern in quotes, a video or a file",
    )  # fmt: skip
    add("--colors", metavar="FILE", help="how the materials look, from 'mffdrake colors'")
    add(
        "--motion", metavar="FILE",
        help="the rig's pose in the world, a line 'time x y z qx qy qz qw' a frame; switches "
        "motion feedforward on",
    )  # fmt: skip
    add(
        "--start", metavar="FILE|random",
        help="file with the first frame's pose, a line 'x y z qx qy qz qw'; or random",
    )  # fmt: skip
    add(
        "--generations", metavar="N", type=_Positive(int),
        help="search the first frame's images until N generations or convergence",
    )  # fmt: skip
    add("--stride", metavar="N", type=_Positive(int), default=1, help="every N-th frame only")
    add(
        "--rate", metavar="HZ", type=_Positive(float), default=30.0,
        help="frames a second, where no motion tells their times (default: 30)",
    )  # fmt: skip
    add("--seed", metavar="N", type=_NotNegative, default=0, help="of the random numbers")
    add(
        "--recognizer", metavar="YAML",
        help="keys of a scenario's section recognizer, or a file with them, e.g. "
        "'{refinement: borders, search_range: {z: [0, 0.3]}}'",
    )  # fmt: skip
    add(
        "--overlay", metavar="images|video", nargs="?", const="images",
        choices=["images", "video"], help="draw the outline over every frame (default: images)",
    )  # fmt: skip
    add("--meshcat", action="store_true", help=_MESHCAT)
    add("--out", metavar="DIR", default="out", help="folder for the results (default: out)")
    colors = commands.add_parser(
        "colors", parents=[images], help="learn how the target's materials look",
        description="Learns the mean hue and the spread of each of the target's materials from "
        "example images, one a camera.",
    )  # fmt: skip
    add = colors.add_argument
    add("--images", metavar="NAME=FILE", nargs="+", required=True, help="a camera's image")
    where = colors.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--masks", metavar="MATERIAL=NAME:FILE", nargs="+",
        help="an image of a camera's size that marks a material's pixels",
    )  # fmt: skip
    where.add_argument(
        "--pose", metavar="FILE", help="the target's pose, a line 'x y z qx qy qz qw'"
    )
    add("--out", metavar="FILE", default="colors.yaml", help="default: colors.yaml")
    target = commands.add_parser(
        "target", help="what the recognizer makes of a mesh",
        description="Draws a mesh with its colors, edges and sample points, and tells its size, "
        "symmetries and what will make it hard to recognize. Writes target.png and target.json.",
    )  # fmt: skip
    add = target.add_argument
    add("mesh", metavar="MESH", help="OBJ with MTL, GLB, PLY or STL file with colors")
    add("--out", metavar="DIR", default="out", help="folder for the results (default: out)")


def _NotNegative(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 on, not '{text}'")
    if int(text) >= 2**63:
        raise argparse.ArgumentTypeError(f"must be below 2^63, not '{text}'")
    return int(text)


def _AddPlaces(command: argparse.ArgumentParser, default: str) -> None:
    """Adds the options that say where to run."""
    places = command.add_mutually_exclusive_group()
    places.add_argument("--workers", metavar="N", type=_Positive(int),
                        help=f"number of processes (default: {default})")  # fmt: skip
    places.add_argument(
        "--scheduler", metavar="ADDRESS", help="run on the Dask cluster with this scheduler instead"
    )


_COMMANDS = {
    "run": "run.RunOne", "servo": "run.RunServo", "record": "run.RunRecord",
    "compare": "many.RunCompare", "sweep": "many.RunSweep", "reproduce": "many.RunReproduce",
    "track": "track.RunTrack", "colors": "target.RunColors", "target": "target.RunTarget",
}  # fmt: skip
_OF_A_SCENARIO = ("run", "servo", "record", "compare")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        arguments: Without the program's name; the process's own by default.

    Returns:
        The exit status: 0, 1 when runs of a sweep or a reproduction failed, 2 after a message on
        bad input, or 130 after an interrupt.
    """
    options = _MakeParser().parse_args(arguments)
    logging.basicConfig(format="mffdrake: %(levelname)s: %(message)s", level=logging.WARNING)
    # Drake takes a moment to load. An interrupt in the midst of that would come out as an import
    # error, so it ends the process as if there was none.
    on_interrupt = signal.signal(signal.SIGINT, signal.SIG_DFL)
    if _NeedsWorkers(options):  # They load in the background what this process loads, too.
        PrepareWorkers()
    from mffdrake.experiment.commands.arguments import CheckFiles
    from mffdrake.recognition.parameters import InputError

    command = _Find(options.command)
    signal.signal(signal.SIGINT, on_interrupt)
    for name in ("mffdrake", "drake"):  # Drake sets its level when it is imported.
        logging.getLogger(name).setLevel(
            logging.INFO if getattr(options, "verbose", False) else logging.WARNING
        )
    try:
        CheckFiles(options)
        return command(options)
    except OSError as error:
        name = f"cannot use {error.filename}: " if error.filename else ""
        message = f"{name}{error.strerror or error}"
    except (InputError, WorkerDiedError) as error:
        message = str(error)
    except KeyboardInterrupt:
        print("mffdrake: interrupted", file=sys.stderr)
        return 130
    print(f"mffdrake: error: {' '.join(message.split())}", file=sys.stderr)
    return 2


def _Find(name: str) -> Callable[[argparse.Namespace], int]:
    """What a command does."""
    if name in ("defaults", "schema"):
        return _PrintDocs
    module, _, function = _COMMANDS[name].partition(".")
    command = getattr(import_module(f"mffdrake.experiment.commands.{module}"), function)
    return _WithScenario(command) if name in _OF_A_SCENARIO else command


def _PrintDocs(options: argparse.Namespace) -> int:
    from mffdrake.experiment.scenario.scenario import Scenario
    from mffdrake.recognition.parameters.documentation import commented_yaml, json_schema

    if options.command == "schema":
        print(json.dumps(json_schema(Scenario), indent=2))
    else:
        print(commented_yaml(Scenario()), end="")
    return 0


def _WithScenario(command: Callable[..., int]) -> Callable[[argparse.Namespace], int]:
    """A command that is called with the options' scenario and output folder."""
    from mffdrake.experiment.commands.arguments import ReadScenario
    from mffdrake.recognition.recordings.files import MakeOutputFolder

    def Call(options: argparse.Namespace) -> int:
        scenario = ReadScenario(options)
        return command(options, scenario, MakeOutputFolder(options.out))

    return Call


def _NeedsWorkers(options: argparse.Namespace) -> bool:
    if options.command not in ("compare", "sweep", "reproduce") or options.scheduler:
        return False
    return options.command in ("sweep", "reproduce") or (options.workers or 1) > 1


if __name__ == "__main__":
    sys.exit(main())
