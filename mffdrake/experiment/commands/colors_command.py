"""What ``mffdrake colors`` does."""

from __future__ import annotations

import argparse
import colorsys
import logging
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.commands.arguments import (
    ArgumentsError,
    ImagesByCamera,
    LoadTarget,
    SplitArguments,
)
from mffdrake.experiment.simulation.pictures import SaveImage
from mffdrake.recognition import CameraRig, ColorModel, SolidModel
from mffdrake.recognition.recordings.color_file import DumpColors, LearnColors, MasksOfPose
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile
from mffdrake.recognition.recordings.image_files import ReadImage, ReadMask
from mffdrake.recognition.recordings.rig_file import LoadRig
from mffdrake.recognition.recordings.trajectory import LoadPose

__all__ = ["RunColors"]

Image = NDArray[np.uint8]
Masks = dict[str, dict[str, NDArray[np.bool_]]]

_log = logging.getLogger("mffdrake")


def RunColors(options: argparse.Namespace) -> int:
    """Learns colors from example images, and tells what came out.

    Args:
        options: What the command line's parser made of the arguments.

    Returns:
        The exit status 0.

    Raises:
        ValueError, OSError: On bad input; the message is for the person who gave it.
    """
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
