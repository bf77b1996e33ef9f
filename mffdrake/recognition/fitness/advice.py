"""What the recognizer makes of a target, and what will make it hard to recognize."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.fitness.matching import Matcher
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
