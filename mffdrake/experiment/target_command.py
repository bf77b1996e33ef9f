"""The command ``target``: what the recognizer makes of a mesh."""

from __future__ import annotations

import argparse
import colorsys
import json
import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mffdrake.experiment.files import MakeOutputFolder, WholeFile
from mffdrake.experiment.plotting import SaveFigure
from mffdrake.experiment.recordings.arguments import LoadTarget
from mffdrake.recognition import CameraRig, Matcher, SearchModel
from mffdrake.recognition.aspects import as_drawn
from mffdrake.recognition.symmetry import find_symmetries

__all__ = ["DescribeTarget", "PlotTarget", "RunTarget"]

Array = NDArray[np.float64]

_SIDES = ((3, 2, 2), (-3, -2, 2), (2, -3, -2), (-2, 1, 6))
_PIXELS = 480
_DISTANCE = 0.8  # [m] from which faces are judged
_LEAST_PIXELS = 10.0  # A face narrower than that hardly counts.
_MOST_NAMED = 3
_SIZES = (0.01, 3.0)  # [m] Others are probably in other units.


def RunTarget(options: argparse.Namespace) -> int:
    """Draws a mesh as the recognizer knows it, and says what it makes of it.

    Args:
        options: What the command line's parser made of the arguments.

    Returns:
        The exit status, 0.

    Raises:
        ArgumentsError: When the mesh is no closed solid with a hue on every face.
        OSError: When a file cannot be read or written.
    """
    solid = LoadTarget(options.mesh)
    model = SearchModel(solid)
    told = DescribeTarget(model)
    folder = MakeOutputFolder(options.out)
    SaveFigure(PlotTarget(model), folder / "target.png")
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


def DescribeTarget(model: SearchModel) -> dict[str, Any]:
    """What the recognizer makes of a solid.

    Args:
        model: The sampled solid.

    Returns:
        Sizes, numbers of parts, colors, symmetries and warnings, as plain data.
    """
    solid = model.solid
    of = solid.material_numbers
    colors = [
        {
            "name": name,
            "hue_deg": math.degrees(solid.hues[of == k][0]),
            "area_m2": float(solid.areas[of == k].sum()),
        }
        for k, name in enumerate(solid.material_names)
    ]
    return {
        "size_m": np.ptp(solid.vertices, axis=0).tolist(),
        "triangles": len(solid.triangles), "faces": len(solid.faces), "edges": len(solid.edges),
        "curved_surfaces": int((np.bincount(solid.patches) > 1).sum()),
        "convex": solid.is_convex, "colors": colors,
        "inside_points": len(model.inside_points), "edge_points": len(model.edge_points),
        "symmetries": str(find_symmetries(solid)), "warnings": _Warnings(model),
    }  # fmt: skip


def _Warnings(model: SearchModel) -> list[str]:
    """What will make it hard to recognize."""
    solid, names, found = model.solid, model.solid.material_names, []
    side = float(np.ptp(solid.vertices, axis=0).max())
    if not _SIZES[0] <= side <= _SIZES[1]:
        unit = "millimeters" if side > _SIZES[1] else "other units"
        found.append(
            f"it is {side:g} m long, so the mesh is probably in {unit}: meshes are in meters; "
            "scale its vertices"
        )
    rig = CameraRig.stereo()
    alike = Matcher(model, rig).colors.alike(names)
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            if alike[i, j]:
                found.append(
                    f"the hues of {names[i]} and {names[j]} overlap: borders between them are "
                    "not seen; take hues at least 40 deg apart"
                )
    if len(names) == 1:
        found.append("it has one color alone: only its silhouette tells its pose")
    areas = np.bincount(solid.patches, solid.areas)
    small = np.flatnonzero(np.sqrt(areas) * rig.cameras[0].fx / _DISTANCE < _LEAST_PIXELS)
    if len(small):
        faces = [int(np.flatnonzero(solid.patches == patch)[0]) for patch in small[:_MOST_NAMED]]
        named = [
            "face {} ({}) at ({:.3g}, {:.3g}, {:.3g}) m".format(
                face, solid.materials[face], *(solid.centers[face] + 0.0)
            )
            for face in faces
        ]
        named += ["..."] if len(small) > _MOST_NAMED else []
        found.append(
            f"{len(small)} of {len(areas)} surfaces are less than {_LEAST_PIXELS:g} pixels wide "
            f"from {_DISTANCE} m and hardly count: {', '.join(named)}"
        )
    return found


def PlotTarget(model: SearchModel) -> Figure:
    """A solid from four sides: its colors, edges and inside points.

    Args:
        model: The sampled solid.
    """
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    for axis, direction in zip(figure.subplots(2, 2).flat, _SIDES, strict=True):
        image, half = _DrawSide(model, np.array(direction) / np.linalg.norm(direction))
        axis.imshow(image, extent=(-half, half, -half, half))
        axis.set_title("from ({:g}, {:g}, {:g})".format(*direction))
        axis.set_xlabel("across, about [mm]")
    return figure


def _DrawSide(model: SearchModel, direction: Array) -> tuple[NDArray[np.uint8], float]:
    """A solid seen from a direction, and half of the picture's width at its middle [mm]."""
    from mffdrake.recognition import _aspects  # numba: slow to import

    solid = model.solid
    drawn = as_drawn(solid)
    distance = 3.0 * solid.size
    camera = _aspects.camera_at(direction, drawn, distance, _PIXELS)
    canvas = _aspects.Canvas(
        np.empty((_PIXELS, _PIXELS)), np.empty((_PIXELS, _PIXELS), dtype=np.int64)
    )
    _aspects.draw(camera, drawn, canvas)
    colors = np.array([colorsys.hsv_to_rgb(hue / (2.0 * math.pi), 0.8, 1.0) for hue in solid.hues])
    shade = 0.7 + 0.3 * np.abs(solid.normals @ direction)
    palette = np.concatenate([colors * shade[:, None], [[1.0, 1.0, 1.0]]])  # -1 is the background
    image = palette[canvas.faces]
    patches = np.append(solid.patches, -1)[canvas.faces]
    edges = np.zeros(patches.shape, dtype=bool)
    edges[1:] |= patches[1:] != patches[:-1]
    edges[:, 1:] |= patches[:, 1:] != patches[:, :-1]
    image[edges] = 0.1
    for point, face in zip(model.inside_points, model.inside_faces, strict=True):
        looks = solid.normals[face] @ (camera.place - point) > 0.0
        if looks and _aspects.is_seen(camera, canvas, point, face):
            u, v, _ = _aspects.project(camera, point, 0.5 * _PIXELS)
            image[int(v) : int(v) + 2, int(u) : int(u) + 2] = 0.0
    half = 1e3 * 0.5 * _PIXELS * distance / camera.focal
    return np.rint(255 * image).astype(np.uint8), half
