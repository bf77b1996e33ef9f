"""The renderers a scene can be drawn with, and the lights that keep the colors' hues."""

from __future__ import annotations

import math
from collections.abc import Callable

from pydrake.geometry import (
    LightParameter,
    MakeRenderEngineVtk,
    RenderEngine,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
)

from mffdrake.systems.rendering.graphics import RequireGraphics

__all__ = ["RENDERERS", "AddRenderer"]

_LIGHT_DIRECTIONS = ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
"""To the corners of a tetrahedron: every face of a box is lit, none too brightly."""

_LIGHT_INTENSITY = 0.86
_BACKGROUND = (0.5, 0.5, 0.5)


def _MakeVtk() -> RenderEngine:
    """Drake's VTK renderer, without a display.

    Its default headlight leaves faces black, and black has no hue. Four white directional lights,
    fixed in the world, without shadows, keep every face at full saturation (measured: hue error
    0.00 deg and saturation 1 on each face at any pose). The grey background has no hue.
    """
    RequireGraphics()
    lights = [
        LightParameter(
            type="directional",
            color=Rgba(1.0, 1.0, 1.0, 1.0),
            intensity=_LIGHT_INTENSITY,
            direction=[c / math.sqrt(3.0) for c in direction],
            frame="world",
        )
        for direction in _LIGHT_DIRECTIONS
    ]
    params = RenderEngineVtkParams(
        default_clear_color=_BACKGROUND, lights=lights, cast_shadows=False
    )
    return MakeRenderEngineVtk(params)


def _MakeFlat() -> RenderEngine:
    """Flat colors, drawn by this package: no driver, and a small part of VTK's time."""
    from mffdrake.systems.rendering.flat_renderer import (
        MakeFlatRenderEngine,  # numba: slow to import
    )

    return MakeFlatRenderEngine()


RENDERERS: dict[str, Callable[[], RenderEngine]] = {"vtk": _MakeVtk, "flat": _MakeFlat}
"""The renderers by name."""


def AddRenderer(scene_graph: SceneGraph, name: str = "vtk") -> str:
    """Adds one of the `RENDERERS` to a scene, under its own name.

    Use these, not a renderer with Drake's default lights: its headlight leaves faces so dark that
    they have no hue, and the recognizer needs the hue of every face.

    Args:
        scene_graph: The scene.
        name: "vtk": Drake's RenderEngineVtk, without a display; "flat": this package's
            `FlatRenderEngine`, which knows the shapes that are in the scene by now. So register all
            geometry before.

    Returns:
        The renderer's name in the scene.

    Raises:
        ValueError: When there is no renderer of that name, or a mesh lacks what it needs.
        GraphicsUnavailableError: When this machine lacks what the renderer needs; the message has
            the command that helps. (Without this check a missing driver is a segmentation fault.)

    Example:
        >>> AddRenderer(SceneGraph(), "vtk")
        'vtk'
    """
    if name not in RENDERERS:
        raise ValueError(f"unknown renderer '{name}'; known renderers: {', '.join(RENDERERS)}")
    if not scene_graph.HasRenderer(name):
        # pydrake hands a shape to a renderer in Python only if Python holds that shape already.
        inspector = scene_graph.model_inspector()
        shapes = [inspector.GetShape(geometry) for geometry in inspector.GetAllGeometryIds()]
        try:
            scene_graph.AddRenderer(name, RENDERERS[name]())
        except RuntimeError as error:
            if "has no normals" not in str(error):
                raise
            raise ValueError(
                f"{error}; VTK needs them: export the mesh with normals, or take the "
                "renderer 'flat'"
            ) from error
        del shapes
    return name
