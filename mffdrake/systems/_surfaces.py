"""The surfaces of Drake's shapes as colored triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Mesh,
    PerceptionProperties,
    Rgba,
    Shape,
    Sphere,
)

__all__ = ["MakeSurface", "Surface"]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Triangles = tuple[Array, IntArray]

_DEFAULT_COLOR = Rgba(0.9, 0.45, 0.1, 1.0)  # as Drake's renderers have it
_HALF_SPACE_SIZE = 100.0  # m, as Drake's renderers draw it
_NUM_CHORDS = 50  # around a circle, and from pole to pole, as in VTK: 0.2 % off at most
_MOST_TESTS = 1_000_000  # of a vertex against a triangle's plane, to find out if a mesh is convex


@dataclass(frozen=True)
class Surface:
    """A shape's surface.

    Attributes:
        vertices: In the geometry's frame G [m], shape (V, 3).
        triangles: Indices of three vertices, counterclockwise seen from outside, shape (T, 3).
        colors: Red, green, blue and alpha of each triangle, 0 to 1, shape (T, 4).
        closed: Whether no back face is ever seen from outside.
    """

    vertices: Array
    triangles: IntArray
    colors: Array
    closed: bool


def MakeSurface(shape: Shape, properties: PerceptionProperties) -> Surface:
    """Makes a shape's surface with the colors that Drake's renderers give it.

    Args:
        shape: A Box, Capsule, Convex, Cylinder, Ellipsoid, HalfSpace, Mesh (OBJ) or Sphere.
        properties: Its material: the color ("phong", "diffuse").

    Raises:
        ValueError: When the shape cannot be drawn; the message names it.
    """
    if properties.HasProperty("phong", "diffuse_map"):
        texture = properties.GetProperty("phong", "diffuse_map")
        raise ValueError(f"the flat renderer draws no textures, but {shape} has {texture}")
    if isinstance(shape, Mesh):
        return _ReadMesh(shape, properties)
    vertices, triangles = _Triangulate(shape)
    color = _FallbackColor(properties)
    return Surface(
        vertices, triangles, np.tile(color, (len(triangles), 1)), not isinstance(shape, HalfSpace)
    )


def _FallbackColor(properties: PerceptionProperties) -> Array:
    """The color of what has no material of its own."""
    return np.asarray(properties.GetPropertyOrDefault("phong", "diffuse", _DEFAULT_COLOR).rgba)


def _Triangulate(shape: Shape) -> Triangles:
    """The triangles of every shape but a mesh."""
    polar = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _NUM_CHORDS + 1)
    radii, heights = np.array([0.0, *np.cos(polar[1:-1]), 0.0]), np.sin(polar)  # a unit sphere
    match shape:
        case Box():
            return _MakeBox(shape.size())
        case Cylinder():
            r, h = shape.radius(), 0.5 * shape.length()
            return _Revolve([0.0, r, r, 0.0], [-h, -h, h, h], 0.5)
        case Sphere():
            return _Revolve(shape.radius() * radii, shape.radius() * heights)
        case Ellipsoid():
            vertices, triangles = _Revolve(radii, heights)
            return vertices * [shape.a(), shape.b(), shape.c()], triangles
        case Capsule():
            r, h, half = shape.radius(), 0.5 * shape.length(), len(radii) // 2 + 1
            z = r * heights
            ends = np.concatenate([z[:half] - h, z[-half:] + h])
            return _Revolve(r * np.concatenate([radii[:half], radii[-half:]]), ends, 0.5)
        case HalfSpace():
            s = 0.5 * _HALF_SPACE_SIZE
            corners = [(-s, -s, 0.0), (s, -s, 0.0), (s, s, 0.0), (-s, s, 0.0)]
            return np.array(corners), np.array([(0, 1, 2), (0, 2, 3)])
        case Convex():
            return _MakeHull(shape)
    raise ValueError(
        f"the flat renderer cannot draw {shape}; it draws Box, Capsule, Convex, Cylinder, "
        "Ellipsoid, HalfSpace, Mesh and Sphere"
    )


def _MakeBox(size: ArrayLike) -> Triangles:
    x, y, z = 0.5 * np.asarray(size, dtype=float)
    vertices = [(a, b, c) for a in (-x, x) for b in (-y, y) for c in (-z, z)]
    quads = [(4, 6, 7, 5), (0, 1, 3, 2), (2, 3, 7, 6), (0, 4, 5, 1), (1, 5, 7, 3), (0, 2, 6, 4)]
    return np.array(vertices), _Fan(quads)


def _Revolve(radii: ArrayLike, heights: ArrayLike, first: float = 0.0) -> Triangles:
    """Turns a line, given from the bottom to the top, about z, from ``first`` chords off x on."""
    radii, heights = np.asarray(radii, dtype=float), np.asarray(heights, dtype=float)
    angle = (np.arange(_NUM_CHORDS) + first) * 2.0 * math.pi / _NUM_CHORDS
    x, y = np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle))
    z = np.repeat(heights[:, None], _NUM_CHORDS, axis=1)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    ring = np.arange(len(radii) - 1)[:, None] * _NUM_CHORDS
    here = np.arange(_NUM_CHORDS)
    after = np.roll(here, -1)
    quads = [ring + here, ring + after, ring + after + _NUM_CHORDS, ring + here + _NUM_CHORDS]
    triangles = _Fan(np.stack(quads, axis=-1).reshape(-1, 4))
    return vertices, triangles[_Areas(vertices, triangles) > 0.0]  # none at the poles is flat


def _MakeHull(shape: Convex) -> Triangles:
    hull = shape.GetConvexHull()
    data, polygons = list(hull.face_data()), []
    while data:
        polygons.append(data[1 : 1 + data[0]])
        del data[: 1 + data[0]]
    return np.array([hull.vertex(k) for k in range(hull.num_vertices())]), _Fan(polygons)


def _Fan(polygons: Any) -> IntArray:
    """Cuts convex polygons into triangles."""
    return np.array([(p[0], p[k - 1], p[k]) for p in polygons for k in range(2, len(p))])


def _Areas(vertices: Array, triangles: IntArray) -> Array:
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _ReadMesh(shape: Mesh, properties: PerceptionProperties) -> Surface:
    """Reads an OBJ file and the materials in its MTL file."""
    import trimesh  # Slow to import, and needed here alone.

    source = shape.source()
    if not source.is_path() or shape.extension().lower() != ".obj":
        raise ValueError(
            f"the flat renderer draws meshes from OBJ files only, not {source.description()}"
        )
    path = Path(source.path())
    try:
        parts = trimesh.load_scene(path, process=False).geometry.values()
        meshes = [part for part in parts if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except Exception as error:  # of whatever kind the file's contents bring about
        raise ValueError(f"the flat renderer cannot read the mesh {path}: {error}") from error
    if not meshes:
        raise ValueError(f"the flat renderer cannot draw the mesh {path}: it has no faces")
    vertices, triangles, colors, start = [], [], [], 0
    for mesh in meshes:
        color = _MaterialColor(mesh, path, properties)
        vertices.append(np.asarray(mesh.vertices, dtype=float) * shape.scale3())
        triangles.append(np.asarray(mesh.faces, dtype=np.int64) + start)
        colors.append(np.tile(color, (len(mesh.faces), 1)))
        start += len(mesh.vertices)
    corners, indices = np.concatenate(vertices), np.concatenate(triangles)
    if np.prod(shape.scale3()) < 0.0:
        indices = indices[:, ::-1]  # A mirror image is turned inside out.
    return Surface(corners, indices, np.concatenate(colors), _IsConvex(corners, indices))


def _MaterialColor(mesh: Any, path: Path, properties: PerceptionProperties) -> Array:
    """The color of a mesh's part that has one material: its own, or else the geometry's."""
    material = getattr(mesh.visual, "material", None)
    texture = None
    if material is not None:
        texture = material.image
    elif not properties.HasProperty("phong", "diffuse") and path.with_suffix(".png").is_file():
        texture = path.with_suffix(".png")  # Drake's renderers take a file of this name as one.
    if texture is not None:
        raise ValueError(f"the flat renderer draws no textures, but the mesh {path} has one")
    if material is None:
        return _FallbackColor(properties)
    return np.array([*material.kwargs.get("kd", (0.0, 0.0, 0.0)), 1.0])


def _IsConvex(vertices: Array, triangles: IntArray) -> bool:
    """Whether triangles enclose a convex solid, all facing outward.

    False, for a mesh too large to tell, only makes drawing slower.
    """
    if len(vertices) * len(triangles) > _MOST_TESTS:
        return False
    unique, index = np.unique(vertices, axis=0, return_inverse=True)
    corners = index.reshape(-1)[triangles]
    sides = [tuple(side) for k in range(3) for side in np.roll(corners, k, axis=1)[:, :2].tolist()]
    if len(set(sides)) < len(sides) or set(sides) != {(b, a) for a, b in sides}:
        return False
    a, b, c = unique[corners].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    heights = normals @ unique.T - np.sum(normals * a, axis=1)[:, None]
    size = float(np.ptp(unique, axis=0).max())
    return bool(np.all(heights <= 1e-6 * size * np.linalg.norm(normals, axis=1)[:, None]))
