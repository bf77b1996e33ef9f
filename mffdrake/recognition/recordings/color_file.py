"""Color models as YAML files, and how they are learned from example images."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.fitness.colors import ColorModel, FaceColor, learn_color
from mffdrake.recognition.parameters import (
    Finite,
    InputError,
    ParameterError,
    parameters,
    read_parameters,
    shorten,
    shown,
)
from mffdrake.recognition.parameters.yaml_text import DumpYaml, ReadYaml
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.solid.solid_model import SolidModel

__all__ = ["ColorFileError", "DumpColors", "LearnColors", "LoadColors", "MasksOfPose"]

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_UNSEEN_TOLERANCE = math.radians(20.0)
_BORDER = 3  # pixels that may show a neighboring face or a blend
_PIECES = 16  # of a face's side, which a lens may bend


class ColorFileError(InputError, ValueError):
    """A file of colors is wrong; the message is one line for the person who wrote it."""


@parameters
class _ColorKeys:
    """The keys of a color."""

    hue_deg: Finite
    tolerance_deg: Finite


def LoadColors(path: Path | str) -> ColorModel:
    """Reads a color model.

    Args:
        path: A YAML file as `DumpColors` makes them.

    Returns:
        The model.

    Raises:
        ColorFileError: When a key or a value is wrong; the message names it.
        OSError: When the file cannot be read.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "colors.yaml"
        >>> _ = file.write_text("colors: {red: {hue_deg: 3.0, tolerance_deg: 15.0}}")
        >>> LoadColors(file).names
        ('red',)
    """
    try:
        data = ReadYaml(Path(path).read_text(encoding="utf-8"))
        gates = {f.name: f.default for f in dc.fields(ColorModel) if f.name != "colors"}
        for key, value in data.items():
            if key != "colors" and key not in gates:
                raise ParameterError(
                    f"unknown key {shown(key)}; known keys: colors, {', '.join(gates)}"
                )
            if key in gates and type(value) not in (int, float):
                raise ParameterError(f"{key} must be a number, not {shown(value)}")
        colors = data.get("colors")
        if not isinstance(colors, dict) or not colors:
            raise ParameterError(
                "colors must be a mapping of materials, such as "
                "red: {hue_deg: 3.0, tolerance_deg: 15.0}"
            )
        faces = []
        for name, keys in colors.items():
            where = f"colors.{shorten(str(name))}"
            color = read_parameters(_ColorKeys, keys, where)
            hue, tolerance = color.hue_deg, color.tolerance_deg
            faces.append(FaceColor(str(name), math.radians(hue), math.radians(tolerance)))
        chosen = {key: float(data[key]) for key in gates if key in data}
        return ColorModel(colors=tuple(faces), **chosen)
    except UnicodeDecodeError as error:
        raise ColorFileError(f"{path}: not a text file in UTF-8") from error
    except ValueError as error:
        raise ColorFileError(f"{path}: {error}") from error


def DumpColors(model: ColorModel) -> str:
    """A color model as YAML, which `LoadColors` reads back.

    Args:
        model: The model.

    Example:
        >>> red = FaceColor("red", 0.0, math.radians(15.0))
        >>> print(DumpColors(ColorModel(colors=(red,))), end="")
        colors:
          red: {hue_deg: 0.0, tolerance_deg: 15.0}
        min_saturation: 0.28
        min_value: 0.15
        min_chroma: 0.09
    """
    data: dict[str, Any] = {
        "colors": {
            color.name: {
                "hue_deg": round(math.degrees(color.hue), 6),
                "tolerance_deg": round(math.degrees(color.tolerance), 6),
            }
            for color in model.colors
        }
    }
    for field in dc.fields(ColorModel):
        if field.name != "colors":
            data[field.name] = getattr(model, field.name)
    return DumpYaml(data)


def LearnColors(
    solid: SolidModel, images: Mapping[str, Image], masks: Mapping[str, Mapping[str, Mask]]
) -> ColorModel:
    """Learns how a solid's materials look.

    Args:
        solid: The solid.
        images: Camera's name to its image, RGB, shape (height, width, 3).
        masks: Material to camera's name to the pixels that show it, shape (height, width).

    Returns:
        The model; a material of which there is no pixel has its mesh's hue, give or take 20 deg.

    Raises:
        ValueError: When a material's pixels are too few, too dark or too grey.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> image = np.full((48, 64, 3), (230, 60, 20), dtype=np.uint8)  # of its red face, close up
        >>> masks = {box.materials[0]: {"right": np.ones((48, 64), dtype=bool)}}
        >>> model = LearnColors(box, {"right": image}, masks)
        >>> round(math.degrees(model.colors[0].hue), 1)
        11.4
    """
    hues = dict(zip(solid.materials, solid.hues.tolist(), strict=True))
    unseen = ColorModel(
        colors=tuple(FaceColor(name, hue, _UNSEEN_TOLERANCE) for name, hue in hues.items())
    )
    learned = []
    for color in unseen.colors:
        parts = [images[name][mask] for name, mask in masks.get(color.name, {}).items()]
        pixels = np.concatenate([np.empty((0, 3)), *parts])
        learned.append(learn_color(color.name, pixels, unseen) if len(pixels) else color)
    return dc.replace(unseen, colors=tuple(learned))


def MasksOfPose(
    solid: SolidModel, rig: CameraRig, pose: NDArray[np.float64]
) -> dict[str, dict[str, Mask]]:
    """The pixels that show each material of a solid at a known pose, a little inside the faces.

    Args:
        solid: The solid.
        rig: The cameras.
        pose: Pose vector in the rig's frame, shape (6,).

    Returns:
        Material to camera's name to a mask, shape (height, width); where a face is seen.
    """
    import cv2

    R_CM, p_CM = transform_from_pose(pose)
    masks: dict[str, dict[str, Mask]] = {}
    shares = np.arange(_PIECES)[:, None] / _PIECES
    kernel = np.ones((2 * _BORDER + 1,) * 2, dtype=np.uint8)
    for camera in rig.cameras:
        p_MK = R_CM.T @ (camera.p_CK - p_CM)
        for k, face in enumerate(solid.faces):
            corners = solid.vertices[list(face)]
            if solid.normals[k] @ (p_MK - solid.centers[k]) <= 0.0:
                continue
            outline = np.concatenate(
                [
                    a + shares * (b - a)
                    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)
                ]
            )
            pixels = camera.project(outline @ R_CM.T + p_CM)
            if not np.isfinite(pixels).all() or np.abs(pixels).max() > 1e5:
                continue
            mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
            cv2.fillPoly(mask, [np.rint(16 * pixels).astype(np.int32)], 1, shift=4)
            inner = cv2.erode(mask, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
            if inner.any():
                seen = masks.setdefault(solid.materials[k], {})
                seen[camera.name] = seen.get(camera.name, np.zeros_like(inner)) | inner
    return masks
