"""What the recognizer makes of a target, and what will make it hard to recognize."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.fitness.colors import around_circle
from mffdrake.recognition.fitness.matching import Matcher, MatchingParameters
from mffdrake.recognition.solid.symmetry import find_symmetries
from mffdrake.recognition.visibility.search_model import SearchModel

__all__ = ["describe_target"]

_DISTANCE = 0.8  # [m] from which faces are judged
_LEAST_PIXELS = 10.0  # A face narrower than that hardly counts.
_MOST_NAMED = 3
_SIZES = (0.01, 3.0)  # [m] Others are probably in other units.


def describe_target(model: SearchModel) -> dict[str, Any]:
    """What the recognizer makes of a solid.

    Args:
        model: The sampled solid.

    Returns:
        Sizes [m], numbers of parts, colors, symmetries and ``warnings``, as plain data.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> told = describe_target(SearchModel(box))
        >>> told["faces"], told["symmetries"], told["warnings"]
        (6, '3 turns', [])
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
        "symmetries": str(find_symmetries(solid)), "warnings": _find_warnings(model),
    }  # fmt: skip


def _find_warnings(model: SearchModel) -> list[str]:
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
    found += _find_like_hues(model, rig)
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


def _find_like_hues(model: SearchModel, rig: CameraRig) -> list[str]:
    """Pairs of colors that are hard to tell apart: those side by side, and the others."""
    solid, names = model.solid, model.solid.material_names
    alike = Matcher(model, rig).colors.alike(names)
    hues = np.array([solid.hues[solid.material_numbers == k][0] for k in range(len(names))])
    borders = np.zeros(alike.shape)
    np.add.at(borders, tuple(solid.material_numbers[solid.edge_faces].T), solid.edge_lengths)
    borders += borders.T
    pairs = [(i, j) for i in range(len(names)) for j in range(i + 1, len(names)) if alike[i, j]]
    pairs.sort(key=lambda pair: -borders[pair])
    beside, others = [], []
    for i, j in pairs:
        one, other = (f"{names[k]} (hue {math.degrees(hues[k]):.0f} deg)" for k in (i, j))
        apart = math.degrees(abs(float(around_circle(hues[i] - hues[j]))))
        text = f"{one} and {other}, {apart:.0f} deg apart"
        if borders[i, j] > 0.0:
            beside.append(f"{text}, along {1e3 * borders[i, j]:.0f} mm")
        else:
            others.append(text)
    least = 2.0 * MatchingParameters().hue_tolerance_deg
    remedy = f"take hues more than {least:g} deg apart"
    found = []
    if beside:
        found.append(
            f"neighboring faces of nearly one hue: {_first(beside)}; colors are told apart by hue "
            f"alone, dark or light, so that these borders are not seen; {remedy}"
        )
    if others:
        found.append(
            f"colors of nearly one hue: {_first(others)}; their faces may be taken for each other; "
            f"{remedy}"
        )
    return found


def _first(pairs: list[str]) -> str:
    """The first few, and how many more there are."""
    more = len(pairs) - _MOST_NAMED
    rest = f", and {more} more pair{'s' if more > 1 else ''}" if more > 0 else ""
    return "; ".join(pairs[:_MOST_NAMED]) + rest
