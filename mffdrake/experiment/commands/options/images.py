"""Options of the commands that work on images and meshes: track, colors and target."""

from __future__ import annotations

from typing import Any

from mffdrake.experiment.commands.options.kinds import MESHCAT, NotNegative, Parser, Positive

__all__ = ["AddImageCommands"]


def AddImageCommands(commands: Any) -> None:
    """Adds the commands that work on images: track and colors."""
    images = Parser(add_help=False)
    add = images.add_argument
    add("--target", metavar="MESH", required=True, help="closed, colored mesh, e.g. OBJ")
    add("--verbose", action="store_true", help="say more on the way")
    track = commands.add_parser(
        "track", parents=[images], help="poses from your images, calibrations and mesh",
        description="Recognizes the target's pose in every frame of recorded images. Writes "
        "poses.csv, poses.tum, track.json and pictures to --out.",
    )  # fmt: skip
    add = track.add_argument
    add("--rig", metavar="RIG.yaml", help="file with the cameras; a --recording may bring them")
    add(
        "--recording", metavar="FILE",
        help="a recording of ROS, which brings images, cameras and motion: MCAP, a ROS 2 folder or "
        "a ROS 1 bag; --rig, --images and --motion say otherwise",
    )  # fmt: skip
    add(
        "--images", metavar="NAME=SOURCE", nargs="+", default=[],
        help="a camera's images: a folder, a pattern in quotes, a video or a file; of a "
        "--recording, the topic",
    )  # fmt: skip
    add("--colors", metavar="FILE", help="how the materials look, from 'mffdrake colors'")
    add(
        "--motion", metavar="FILE",
        help="the rig's pose in the world, a line 'time x y z qx qy qz qw' a frame; switches "
        "motion feedforward on; of a --recording, by time, or a topic with poses, or none",
    )  # fmt: skip
    add(
        "--start", metavar="FILE|random",
        help="file with the first frame's pose, a line 'x y z qx qy qz qw' or of TUM, 'time x y z "
        "qx qy qz qw'; or random (default)",
    )  # fmt: skip
    add(
        "--generations", metavar="N", type=Positive(int),
        help="search the first frame's images until N generations or convergence",
    )  # fmt: skip
    add("--stride", metavar="N", type=Positive(int), default=1, help="every N-th frame only")
    add(
        "--rate", metavar="HZ", type=Positive(float), default=30.0,
        help="frames a second, where no motion tells their times (default: 30)",
    )  # fmt: skip
    add("--seed", metavar="N", type=NotNegative, default=0, help="of the random numbers")
    add(
        "--recognizer", metavar="YAML",
        help="keys of a scenario's section recognizer, or a file with them, e.g. "
        "'{search_range: {z: [0, 0.3]}}' (default: poses anywhere in view, refined)",
    )  # fmt: skip
    add(
        "--overlay", metavar="images|video", nargs="?", const="images",
        choices=["images", "video"], help="draw the outline over every frame (default: images)",
    )  # fmt: skip
    add("--mcap-out", metavar="FILE.mcap", help="write the poses for ROS 2's tools, too")
    add("--meshcat", action="store_true", help=MESHCAT)
    add("--out", metavar="DIR", default="out", help="folder for the results (default: out)")
    colors = commands.add_parser(
        "colors", parents=[images], help="learn how the target's materials look",
        description="Learns the mean hue and the spread of each of the target's materials from "
        "example images, one a camera.",
    )  # fmt: skip
    add = colors.add_argument
    add("--rig", metavar="RIG.yaml", required=True, help="file with the cameras")
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
