"""A renderer that draws every face in one flat color: a Drake RenderEngine in Python.

It needs no graphics driver, works through the unchanged RgbdSensor, and takes less than a tenth of
VTK's time. What it draws lies on the same pixels as in VTK's images.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import (
    ColorRenderCamera,
    DepthRenderCamera,
    GeometryId,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngine,
    RenderLabel,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

from mffdrake.systems.rendering import rasterizer
from mffdrake.systems.rendering.rasterizer import Lens, Rectangle, Surfaces
from mffdrake.systems.rendering.surfaces import MakeSurface, Surface

__all__ = ["AddFlatRenderer", "FlatRenderEngine", "MakeFlatRenderEngine"]

_BACKGROUND = (0.5, 0.5, 0.5, 1.0)
_MOST_CANVASES = 16  # A scene's cameras have as many images each time; others come once.
_NO_COLOR = 0  # a pixel of alpha 0: such triangles are left out of the color image
_EMPTY, _DO_NOT_RENDER = int(RenderLabel.kEmpty), int(RenderLabel.kDoNotRender)


class FlatRenderEngine(RenderEngine):
    """Draws colored triangles with a depth buffer: without light, shadows or anti-aliasing.

    Each face has its material's diffuse color all over, and the background is grey. It draws boxes,
    capsules, convex hulls, cylinders, ellipsoids, half spaces, spheres, and the meshes that the
    recognizer takes (see `ColoredMesh`). Colors come from where Drake's renderers take them: a
    mesh's own materials, else the property ("phong", "diffuse"), else Drake's default. Unlike in
    VTK, a mesh's texture gives each triangle its mean color (other textures are an error), and what
    is translucent is opaque; but as in VTK, what has an alpha of 0 is left out of the color image
    alone.

    The state is the geometries, their poses and the viewpoint; equal states give equal bits. On an
    image that it drew before it clears what it drew, and all of it where it finds it changed: do
    not draw on Drake's images, but on copies.

    Note:
        Add it to a scene with `AddFlatRenderer`, not with `SceneGraph.AddRenderer` alone.
    """

    def __init__(self) -> None:
        RenderEngine.__init__(self)
        self._geometries: dict[GeometryId, _Geometry] = {}
        self._X_WGs = np.empty((0, 3, 4))  # in the same order
        self._rows: dict[GeometryId, int] = {}  # Where each is in that.
        self._X_WC: NDArray[np.float64] = RigidTransform().GetAsMatrix34()
        self._scene: _Scene | None = None  # None when it is out of date
        self._scratch: NDArray[np.float32] = np.empty(0, dtype=np.float32)
        self._canvases: dict[tuple[Any, ...], _Canvas] = {}  # by their images' addresses

    def UpdateViewpoint(self, X_WR: RigidTransform) -> None:
        """Puts the camera at X_WR (x right, y down, z along the line of sight)."""
        self._X_WC = X_WR.GetAsMatrix34()

    def DoRegisterVisual(
        self, id: GeometryId, shape: Shape, properties: PerceptionProperties, X_WG: RigidTransform
    ) -> bool:
        """Accepts a geometry.

        Raises:
            ValueError: When the shape cannot be drawn; the message names it.
        """
        if id not in self._geometries:  # In a clone it is there already.
            label = RenderLabel.kDontCare  # as Drake's own renderers have it
            if properties.HasProperty("label", "id"):
                label = self.GetRenderLabelOrThrow(properties)
            self._geometries[id] = _Geometry(MakeSurface(shape, properties), label)
            self._rows[id] = len(self._X_WGs)
            self._X_WGs = np.concatenate([self._X_WGs, np.empty((1, 3, 4))])
        self._X_WGs[self._rows[id]] = X_WG.GetAsMatrix34()
        self._scene = None
        return True

    def DoUpdateVisualPose(self, id: GeometryId, X_WG: RigidTransform) -> None:
        """Moves a geometry.

        Drake moves all of them at every step of a simulation with contact, far more often than it
        renders, so this does no more than copy. (An X_WG kept would change with Drake's own.)
        """
        self._X_WGs[self._rows[id]] = X_WG.GetAsMatrix34()

    def DoRemoveGeometry(self, id: GeometryId) -> bool:
        """Forgets a geometry; false when there is none of that id."""
        if self._geometries.pop(id, None) is None:
            return False
        self._X_WGs = np.delete(self._X_WGs, self._rows[id], axis=0)
        self._rows = {id: row for row, id in enumerate(self._geometries)}
        self._scene = None
        return True

    def DoClone(self) -> FlatRenderEngine:
        """An engine of the same state that shares nothing that changes."""
        clone = FlatRenderEngine()
        clone._geometries, clone._rows = dict(self._geometries), dict(self._rows)
        clone._X_WGs = np.empty_like(self._X_WGs)
        for id, geometry in self._geometries.items():
            # Drake's own records of the geometries can be filled in no other way.
            properties = PerceptionProperties()
            properties.AddProperty("label", "id", geometry.label)
            clone.RegisterVisual(id, _ANY_SHAPE, properties, RigidTransform(), needs_updates=True)
        clone._X_WGs[:] = self._X_WGs
        clone._X_WC = self._X_WC
        clone._scene = self._scene
        return clone

    def DoRenderColorImage(self, camera: ColorRenderCamera, color_image_out: ImageRgba8U) -> None:
        """Draws the diffuse colors."""
        canvas = self._GetCanvas(color_image_out, _COLOR)
        del color_image_out  # see _Pixels
        self._Draw(camera.core(), self._GetScene().colors, _NO_COLOR, _GREY, canvas)

    def DoRenderLabelImage(self, camera: ColorRenderCamera, label_image_out: ImageLabel16I) -> None:
        """Draws the labels; RenderLabel.kEmpty where there is nothing."""
        canvas = self._GetCanvas(label_image_out, _LABEL)
        del label_image_out  # see _Pixels
        self._Draw(camera.core(), self._GetScene().labels, _DO_NOT_RENDER, _EMPTY, canvas)

    def DoRenderDepthImage(self, camera: DepthRenderCamera, depth_image_out: ImageDepth32F) -> None:
        """Draws the depths along the line of sight [m]; 0 where too close, infinity too far."""
        image = _Pixels(depth_image_out, _DEPTH)
        del depth_image_out  # see _Pixels
        nowhere = _Canvas(None)
        inverse_depth = self._Draw(camera.core(), None, 0, 0, nowhere)
        depths, far = camera.depth_range(), camera.core().clipping().far()
        rasterizer.convert_depth(
            inverse_depth, nowhere.drawn, far, depths.min_depth(), depths.max_depth(), image
        )

    def _GetCanvas(self, image: ImageRgba8U | ImageLabel16I, dtype: np.dtype[Any]) -> _Canvas:
        memory = image.mutable_data
        key = (memory.ctypes.data, memory.shape, dtype)
        if key not in self._canvases:
            if len(self._canvases) == _MOST_CANVASES:
                self._canvases.clear()
            canvas = _Canvas(_Pixels(image, dtype), (0, image.width(), 0, image.height()))
            self._canvases[key] = canvas
        return self._canvases[key]

    def _GetScene(self) -> _Scene:
        if self._scene is None:
            self._scene = _MakeScene(self._geometries.values())
        return self._scene

    def _Draw(
        self,
        core: RenderCameraCore,
        paint: NDArray[Any] | None,
        unpainted: int,
        background: int,
        canvas: _Canvas,
    ) -> NDArray[np.float32]:
        """Draws all geometries; returns their inverse depth, which holds where they are drawn."""
        camera, clipping = core.intrinsics(), core.clipping()
        lens = Lens(
            camera.focal_x(),
            camera.focal_y(),
            camera.center_x(),
            camera.center_y(),
            clipping.near(),
            clipping.far(),
        )
        width, height = camera.width(), camera.height()
        if len(self._scratch) < width * height:
            self._scratch = np.empty(width * height, dtype=np.float32)
        inverse_depth = self._scratch[: width * height].reshape(height, width)
        # Whatever interrupts it: until it is known, all of the image counts as drawn on.
        before, canvas.drawn = canvas.drawn, (0, width, 0, height)
        canvas.drawn = rasterizer.draw(
            self._GetScene().surfaces, self._X_WGs, self._X_WC, lens, paint, unpainted, background,
            inverse_depth, canvas.pixels, before,
        )  # fmt: skip
        return inverse_depth


def _Pixels(
    image: ImageRgba8U | ImageDepth32F | ImageLabel16I, dtype: np.dtype[Any]
) -> NDArray[Any]:
    """An image's memory as an array (height, width), valid for as long as Drake keeps the image.

    Unlike `mutable_data`, the array does not keep pydrake's image object alive, nor must a local
    variable: what a kernel's first call leaves for the garbage collector holds its arguments and
    its callers' variables. Were the image object among them, pydrake would take it for the next
    image at that address, one on the stack and gone: "negative dimensions are not allowed".
    """
    interface = image.mutable_data.__array_interface__
    interface["shape"], interface["typestr"] = (image.height(), image.width()), dtype.str
    return np.asarray(_Memory(interface))


@dataclass
class _Canvas:
    """An image's pixels (None for nowhere), and what columns and rows may not be background."""

    pixels: NDArray[Any] | None
    drawn: Rectangle = (0, 0, 0, 0)


@dataclass(frozen=True)
class _Memory:
    """Memory that NumPy makes an array of."""

    __array_interface__: dict[str, Any]


@dataclass(frozen=True)
class _Geometry:
    """What is drawn of a geometry."""

    surface: Surface
    label: RenderLabel


@dataclass(frozen=True)
class _Scene:
    """All geometries, and the value of each of their triangles in the images."""

    surfaces: Surfaces
    colors: NDArray[np.uint32]
    labels: NDArray[np.int16]


def _MakeScene(geometries: Collection[_Geometry]) -> _Scene:
    """Puts all geometries into the arrays that the rasterizer takes."""
    surfaces = [geometry.surface for geometry in geometries]
    vertex_start = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    num_triangles = [len(surface.triangles) for surface in surfaces]
    triangles = [s.triangles + start for s, start in zip(surfaces, vertex_start, strict=False)]
    spheres = np.zeros((len(surfaces), 4))
    for sphere, surface in zip(spheres, surfaces, strict=True):
        low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
        sphere[:3] = 0.5 * (low + high)
        sphere[3] = np.linalg.norm(surface.vertices - sphere[:3], axis=1).max()
    colors = np.concatenate([np.empty((0, 4)), *(surface.colors for surface in surfaces)])
    labels = np.array([int(geometry.label) for geometry in geometries], dtype=np.int16)
    return _Scene(
        surfaces=Surfaces(
            vertices=np.concatenate([np.empty((0, 3)), *(s.vertices for s in surfaces)]),
            vertex_start=vertex_start,
            triangles=np.concatenate([np.empty((0, 3), dtype=np.int64), *triangles]),
            triangle_start=np.cumsum([0, *num_triangles]),
            spheres=spheres,
            closed=np.array([surface.closed for surface in surfaces], dtype=bool),
        ),
        colors=np.where(colors[:, 3] > 0.0, _Pack(colors), _NO_COLOR).astype(np.uint32),
        labels=np.repeat(labels, num_triangles),
    )


def _Pack(colors: ArrayLike) -> NDArray[np.uint32]:
    """Opaque pixels, four bytes in one number, of colors in 0 to 1, shape (..., 4)."""
    channels = np.clip(np.asarray(colors, dtype=float), 0.0, 1.0)
    channels[..., 3] = 1.0
    return np.floor(255.0 * channels + 0.5).astype(np.uint8).view(np.uint32)[..., 0]


_GREY = int(_Pack(_BACKGROUND))
_COLOR, _LABEL, _DEPTH = np.dtype(np.uint32), np.dtype(np.int16), np.dtype(np.float32)
_ANY_SHAPE = Sphere(1.0)


def MakeFlatRenderEngine() -> RenderEngine:
    """Makes the flat renderer.

    Example:
        >>> MakeFlatRenderEngine().has_geometry(GeometryId.get_new_id())
        False
    """
    return FlatRenderEngine()


def AddFlatRenderer(scene_graph: SceneGraph, name: str = "flat") -> None:
    """Adds the flat renderer to a scene that is complete.

    Register all geometry first; with a plant, finalize it first. When Drake passes a shape to an
    engine in Python, Python must hold that very shape already, or pydrake fails:
    "return_value_policy = copy, but type is non-copyable". This function sees to it for the shapes
    there are.

    Args:
        scene_graph: The scene.
        name: The renderer's name in the scene.

    Raises:
        RuntimeError: When the scene has a renderer of that name.
        ValueError: When a shape in the scene cannot be drawn; the message names it.

    Example:
        >>> scene_graph = SceneGraph()
        >>> AddFlatRenderer(scene_graph)
        >>> scene_graph.HasRenderer("flat")
        True
    """
    inspector = scene_graph.model_inspector()
    shapes = [inspector.GetShape(id) for id in inspector.GetAllGeometryIds()]
    scene_graph.AddRenderer(name, MakeFlatRenderEngine())
    del shapes  # Drake has taken them. Contexts clone the engine, which needs no shapes.
