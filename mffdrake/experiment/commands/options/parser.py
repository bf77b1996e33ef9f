"""The command line's parser: commands that simulate; the others are in `images`."""

from __future__ import annotations

import argparse
from importlib.metadata import version

from mffdrake.experiment.commands.calibrate import AddCalibrate
from mffdrake.experiment.commands.options.images import AddImageCommands
from mffdrake.experiment.commands.options.kinds import MESHCAT, NotNegative, Parser, Positive

__all__ = ["MakeParser"]


def MakeParser() -> argparse.ArgumentParser:
    """The parser of all commands; importing it loads nothing that is slow."""
    common = Parser(add_help=False)
    add = common.add_argument
    add("--scenario-file", metavar="F", help="YAML file with the scenario")
    add("--scenario-text", metavar="YAML", help="scenario as YAML, on top of the file")
    add("--duration", metavar="S", type=Positive(float), help="simulated time [s]")
    add("--seed", metavar="N", type=int, help="seed of the random numbers, of several the first")
    add("--out", metavar="DIR", default="out", help="folder for the results (default: out)")
    add("--verbose", action="store_true", help="say more on the way")
    renderer, diagram, replay, path, live = (Parser(add_help=False) for _ in range(5))
    renderer.add_argument("--renderer", metavar="NAME", help="what draws the images: vtk or flat")
    diagram.add_argument(
        "--graphviz", metavar="FILE", help="write the (last run's) diagram as SVG or PNG"
    )
    replay.add_argument("--replay", metavar="FILE.html",
                        help="write a Meshcat recording (of the last run) as one HTML file"
    )  # fmt: skip
    live.add_argument("--meshcat", action="store_true", help=MESHCAT)
    live.add_argument("--video", metavar="FILE.mp4",
                      help="write the cameras' images, with the model and the numbers, as a video"
    )  # fmt: skip
    path.add_argument("--method", metavar="ga|mff", help="without or with motion feedforward")
    path.add_argument("--omega", metavar="W", type=float, help="speed of the hand's path [rad/s]")
    pictures = [common, renderer, diagram, replay]

    parser = Parser(
        prog="mffdrake",
        description="Recognizes a target's pose with stereo cameras on a moving robot hand.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {version('mffdrake')}")
    commands = parser.add_subparsers(
        dest="command",
        required=True,
        metavar="run|servo|compare|sweep|reproduce|track|colors|target|record|calibrate|defaults|"
        "schema|doctor",
    )
    commands.add_parser("run", parents=[*pictures, path, live], help="one simulation")
    servo = commands.add_parser(
        "servo", parents=[*pictures, live],
        help="one simulation in which the hand follows the target",
        description="The target moves, and the hand follows it by what its cameras see.",
    )  # fmt: skip
    add = servo.add_argument
    add("--method", metavar="ga|mff", help="without or with motion feedforward")
    add("--period", metavar="S", type=Positive(float), help="of the target's swing [s]")
    add("--amplitude", metavar="M", type=Positive(float), help="of its swing along y [m]")
    compare = commands.add_parser(
        "compare", parents=pictures, help="methods x speeds x seeds, with a table"
    )
    compare.add_argument(
        "--methods", metavar="M", nargs="+", default=["ga", "mff"], help="methods (default: ga mff)"
    )
    add = compare.add_argument
    add("--omega", metavar="W", nargs="+", type=float, default=[0.105, 0.157, 0.314],
        help="speeds of the hand's path [rad/s] (default: 0.105 0.157 0.314)")  # fmt: skip
    compare.add_argument("--seeds", metavar="K", type=Positive(int), default=1,
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
        "--seeds", metavar="K", type=Positive(int), default=20,
        help="number of seeds of the paper's table, from --seed on; the studies beyond it have "
        "at most 5 (default: 20)",
    )  # fmt: skip
    reproduce.add_argument("--vtk-seeds", metavar="K", type=NotNegative, default=5,
                           help="of the same table on VTK's images; 0 leaves it out (default: 5)"
    )  # fmt: skip
    reproduce.add_argument("--short", action="store_true",
                           help="one seed, the flat renderer alone, and a few of the studies"
    )  # fmt: skip
    _AddPlaces(reproduce, "the number of cores")
    AddImageCommands(commands)
    record = commands.add_parser(
        "record", parents=[common, renderer, path],
        help="images, rig and motion from a scenario, for track",
        description="Runs a scenario and writes its cameras' images, rig file, motion and true "
        "poses to --out, and prints the command that tracks them.",
    )  # fmt: skip
    record.add_argument(
        "--mcap", metavar="FILE.mcap",
        help="write images, cameras, motion and true poses into one file for ROS 2's tools",
    )  # fmt: skip
    AddCalibrate(commands)
    commands.add_parser("defaults", help="print the default scenario with a comment on every key")
    commands.add_parser("schema", help="print a JSON Schema of scenario files, for editors")
    commands.add_parser("doctor", help="say whether this machine has all that is needed")
    return parser


def _AddPlaces(command: argparse.ArgumentParser, default: str) -> None:
    """Adds the options that say where to run."""
    places = command.add_mutually_exclusive_group()
    places.add_argument("--workers", metavar="N", type=Positive(int),
                        help=f"number of processes (default: {default})")  # fmt: skip
    places.add_argument(
        "--scheduler", metavar="ADDRESS", help="run on the Dask cluster with this scheduler instead"
    )
