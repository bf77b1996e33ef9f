"""The commands ``target`` and ``colors``: what the recognizer makes of a mesh and its colors."""

from __future__ import annotations

import argparse
import colorsys
import json
import logging
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mffdrake.experiment.commands.options.arguments import (
    ArgumentsError,
    ImagesByCamera,
    LoadTarget,
    SplitArguments,
)
from mffdrake.experiment.simulation.plotting import SaveFigure
from mffdrake.recognition import CameraRig, ColorModel, SearchModel, SolidModel
from mffdrake.recognition.fitness.advice import describe_target
from mffdrake.recognition.recordings.color_file import DumpColors, LearnColors, MasksOfPose
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile
from mffdrake.recognition.recordings.image_files import ReadImage, ReadMask, SaveImage
from mffdrake.recognition.recordings.rig_file import LoadRig
from mffdrake.recognition.recordings.trajectory import LoadPose
from mffdrake.recognition.solid.symmetry import Symmetries, find_symmetries
from mffdrake.recognition.visibility.portrait import Portrait

__all__ = ["PlotTarget", "RunColors", "RunTarget"]

Array = NDArray[np.float64]

_SIDES = ((3, 2, 2), (-3, -2, 2), (2, -3, -2), (-2, 1, 6))


def RunTarget(options: argparse.Namespace) -> int:
    """Draws a mesh as the recognizer knows it, and says what it makes of it."""
    solid = LoadTarget(options.mesh)
    model = SearchModel(solid)
    told = describe_target(model)
    folder = MakeOutputFolder(options.out)
    SaveFigure(PlotTarget(model, told["warnings"]), folder / "target.png")
    with WholeFile(folder / "target.json") as part:
        part.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    size = " x ".join(f"{1e3 * side:.3g}" for side in told["size_m"])
    kind = "convex" if told["convex"] else "not convex"
    print(
        f"{options.mesh}: {size} mm, {told['triangles']} triangles, {told['faces']} faces, "
        f"{told['edges']} edges, {kind}\nSymmetries: {told['symmetries']}"
    )
    for color in told["colors"]:
        print(
            f"  {color['name']}: hue {color['hue_deg']:.0f} deg, {1e4 * color['area_m2']:.3g} cm2"
        )
    for warning in told["warnings"]:
        print(f"Warning: {warning}")
    print(f"Picture and numbers: {folder}/target.png, target.json")
    return 0


def PlotTarget(model: SearchModel, warnings: Sequence[str]) -> Figure:
    """A solid from four sides: its colors, edges, inside points and the axes of its symmetries.

    Args:
        model: The sampled solid.
        warnings: What stands above.
    """
    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    symmetries = find_symmetries(model.solid)
    for axes, direction in zip(figure.subplots(2, 2).flat, _SIDES, strict=True):
        portrait = Portrait.of(model, np.array(direction) / np.linalg.norm(direction))
        to_mm = 1e3 * portrait.distance / portrait.focal_length
        half = 0.5 * to_mm * len(portrait.faces)
        axes.imshow(_Paint(model.solid, portrait), extent=(-half, half, -half, half))
        places = [(line, "--") for line in map(portrait.project, _Axes(model.solid, symmetries))]
        for pixels, style in (*places, (portrait.points, ".")):
            x, y = (to_mm * (pixels - 0.5 * (len(portrait.faces) - 1))).T
            axes.plot(x, -y, style, color="0.4" if style == "--" else "black", markersize=2.0)
        axes.set(xlim=(-half, half), ylim=(-half, half), xlabel="across, about [mm]")
        axes.set_title("from ({:g}, {:g}, {:g})".format(*direction))
    lines = [f"Symmetries: {symmetries}", *(f"Warning: {text}" for text in warnings)]
    text = "\n".join(textwrap.fill(line, 110) for line in lines)
    figure.suptitle(text, fontsize="medium", ha="left", x=0.02)
    return figure


def _Axes(solid: SolidModel, symmetries: Symmetries) -> list[Array]:
    """The ends of the axes about which a solid may be turned [m], each of shape (2, 3)."""
    axes = [] if len(symmetries.axes) > 1 else [*symmetries.axes]  # Those of a ball are any.
    for R in symmetries.turns.rotations:
        values, vectors = np.linalg.eig(R)
        axis = vectors[:, np.argmin(np.abs(values - 1.0))].real
        if all(abs(axis @ other) < 0.999 for other in axes):
            axes.append(axis)
    reach = 0.6 * solid.size
    return [np.stack([symmetries.center - reach * d, symmetries.center + reach * d]) for d in axes]


def _Paint(solid: SolidModel, portrait: Portrait) -> NDArray[np.uint8]:
    """The colors of a solid that is seen from a side, with its edges."""
    colors = np.array([colorsys.hsv_to_rgb(hue / (2.0 * math.pi), 0.8, 1.0) for hue in solid.hues])
    shade = 0.7 + 0.3 * np.abs(solid.normals @ portrait.axes[2])
    palette = np.concatenate([colors * shade[:, None], [[1.0, 1.0, 1.0]]])  # -1 is the background
    image = palette[portrait.faces]
    patches = np.append(solid.patches, -1)[portrait.faces]
    edges = np.zeros(patches.shape, dtype=bool)
    edges[1:] |= patches[1:] != patches[:-1]
    edges[:, 1:] |= patches[:, 1:] != patches[:, :-1]
    image[edges] = 0.1
    return np.rint(255 * image).astype(np.uint8)


Image = NDArray[np.uint8]

Masks = dict[str, dict[str, NDArray[np.bool_]]]

_log = logging.getLogger("mffdrake")


def RunColors(options: argparse.Namespace) -> int:
    """Learns colors from example images, and tells what came out."""
    rig, solid = LoadRig(options.rig), LoadTarget(options.target)
    out = Path(options.out)
    picture = out.with_suffix(".png")
    if picture == out:
        raise ArgumentsError(f"--out {out}: must be a text file such as colors.yaml, no picture")
    MakeOutputFolder(out.parent)
    images = {}
    for name, file in ImagesByCamera("NAME=FILE", options.images).items():
        if name not in rig.names:
            raise ArgumentsError(
                f"--images {name}=...: the rig has the cameras {', '.join(rig.names)}"
            )
        images[name] = ReadImage(file)
        try:
            rig.cameras[rig.names.index(name)].check_image(images[name])
        except ValueError as error:
            raise ArgumentsError(f"{file}: {error}") from error
    if options.pose is not None:
        seen = CameraRig(tuple(c for c in rig.cameras if c.name in images))
        masks = MasksOfPose(solid, seen, LoadPose(options.pose))
    else:
        masks = _ReadMasks(options.masks, solid, images)
    try:
        model = LearnColors(solid, images, masks)
    except ValueError as error:
        raise ArgumentsError(str(error)) from error
    _Warn(model, masks)
    with WholeFile(out) as part:
        part.write_text(DumpColors(model), encoding="utf-8")
    SaveImage(_DrawColors(model, images), picture)
    print("| material | hue [deg] | tolerance [deg] | pixels |")
    print("|---|---:|---:|---:|")
    for color in model.colors:
        count = sum(int(mask.sum()) for mask in masks.get(color.name, {}).values())
        hue, tolerance = math.degrees(color.hue), math.degrees(color.tolerance)
        print(f"| {color.name} | {hue:.1f} | {tolerance:.1f} | {count} |")
    print(f"\nColors: {out}; what they see in the images: {picture}")
    return 0


def _ReadMasks(given: list[str], solid: SolidModel, images: dict[str, Image]) -> Masks:
    """Masks by material and camera."""
    masks: Masks = {}
    for material, place in SplitArguments("--masks", "MATERIAL=NAME:FILE", given):
        name, colon, file = place.partition(":")
        if not colon:
            raise ArgumentsError(
                f"--masks {material}={place}: must be MATERIAL=NAME:FILE, NAME being a camera"
            )
        if material not in solid.materials:
            known = ", ".join(dict.fromkeys(solid.materials))
            raise ArgumentsError(f"--masks {material}=...: the target has the materials {known}")
        if name not in images:
            raise ArgumentsError(
                f"--masks {material}={name}:...: there is no image of camera '{name}', but of "
                f"{', '.join(images)}"
            )
        mask = ReadMask(file)
        if mask.shape != images[name].shape[:2]:
            raise ArgumentsError(
                f"{file}: the mask must be of the image's size, {images[name].shape[1]} x "
                f"{images[name].shape[0]}, not {mask.shape[1]} x {mask.shape[0]}"
            )
        seen = masks.setdefault(material, {})
        seen[name] = seen.get(name, np.zeros_like(mask)) | mask
    return masks


def _Warn(model: ColorModel, masks: Masks) -> None:
    """Says what will make tracking harder."""
    for name in model.names:
        if not any(mask.any() for mask in masks.get(name, {}).values()):
            _log.warning(
                "no pixels of material '%s': it keeps its mesh's hue, give or take 20 deg", name
            )
    for one, other in model.overlaps():
        _log.warning(
            "the hues of '%s' and '%s' overlap: a pixel in between counts for the nearer one, and "
            "the edge between two such faces is no border to refine a pose from, so that a view of "
            "these faces alone is less sure",
            one, other,
        )  # fmt: skip


def _DrawColors(model: ColorModel, images: dict[str, Image]) -> Image:
    """The images, and below each what shows which color."""
    columns = []
    for image in images.values():
        bits = model.classify(image)
        seen = np.full(image.shape, 40, dtype=np.uint8)
        for k, color in enumerate(model.colors):
            rgb = colorsys.hsv_to_rgb(color.hue / (2.0 * math.pi), 1.0, 1.0)
            seen[(bits >> k) & 1 > 0] = np.rint(255.0 * np.array(rgb))
        columns.append(np.vstack([image, seen]))
    height = max(column.shape[0] for column in columns)
    return np.hstack([np.pad(c, ((0, height - c.shape[0]), (0, 0), (0, 0))) for c in columns])
