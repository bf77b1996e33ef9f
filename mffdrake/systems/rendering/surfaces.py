"""The surfaces of Drake's shapes as colored triangles."""

from __future__ import annotations

import math
from collections.abc import Sequence
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

from mffdrake.recognition.solid.mesh_file import ColoredMesh, color_name

__all__ = ["MakeSurface", "Surface"]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Triangles = tuple[Array, IntArray]

_DEFAULT_COLOR = Rgba(0.9, 0.45, 0.1, 1.0)  # as Drake's renderers have it
_HALF_SPACE_SIZE = 100.0  # m, as Drake's renderers draw it
_NUM_CHORDS = 50  # around a circle, and from pole to pole, as in VTK: 0.2 % off at most
_NO_TEXTURES = (
    "{} has the texture {}, but only that of a mesh file's own material is known, and as the mean "
    "colors of its triangles; give the shape a color, or the mesh a material"
)
_MOST_TESTS = 1_000_000  # of a vertex against a triangle's plane, to find out if a mesh is convex


@dataclass(frozen=True)
class Surface:
    """A shape's surface.

    Attributes:
        vertices: In the geometry's frame G [m], shape (V, 3).
        triangles: Indices of three vertices, counterclockwise seen from outside, shape (T, 3).
        colors: Red, green, blue and alpha of each triangle, 0 to 1, shape (T, 4).
        materials: Name of each triangle's material, or of its color; empty where nothing gives it
            one, so that it has Drake's default.
        closed: Whether no back face is ever seen from outside.
    """

    vertices: Array
    triangles: IntArray
    colors: Array
    materials: Sequence[str]
    closed: bool


def MakeSurface(shape: Shape, properties: PerceptionProperties) -> Surface:
    """Makes a shape's surface with the colors that Drake's renderers give it.

    Args:
        shape: A Box, Capsule, Convex, Cylinder, Ellipsoid, HalfSpace, Mesh (see `ColoredMesh`) or
            Sphere.
        properties: Its material: the color ("phong", "diffuse").

    Raises:
        ValueError: When the shape cannot be drawn; the message names it.
    """
    if properties.HasProperty("phong", "diffuse_map"):
        texture = properties.GetProperty("phong", "diffuse_map")
        raise ValueError(_NO_TEXTURES.format(shape, texture))
    if isinstance(shape, Mesh):
        return _ReadMesh(shape, properties)
    vertices, triangles = _Triangulate(shape)
    count, (color, name) = len(triangles), _FallbackColor(properties)
    return Surface(
        vertices, triangles, np.tile(color, (count, 1)), count * [name],
        not isinstance(shape, HalfSpace),
    )  # fmt: skip


def _FallbackColor(properties: PerceptionProperties) -> tuple[Array, str]:
    """The color, and its name, of what has no material of its own."""
    color = np.asarray(properties.GetPropertyOrDefault("phong", "diffuse", _DEFAULT_COLOR).rgba)
    return color, color_name(color) if properties.HasProperty("phong", "diffuse") else ""


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
    """Reads a mesh file and its colors; what has none has the geometry's."""
    source = shape.source()
    if not source.is_path():
        raise ValueError(
            f"meshes are read from files only, not {source.description()}; write it to one"
        )
    path = Path(source.path())
    try:
        mesh = ColoredMesh.read(path)
    except FileNotFoundError as error:
        raise ValueError(str(error)) from error
    bare = np.isnan(mesh.colors[:, 0])
    texture = path.with_suffix(".png")  # Drake's renderers take a file of this name as one.
    if bare.any() and texture.is_file() and not properties.HasProperty("phong", "diffuse"):
        raise ValueError(_NO_TEXTURES.format(f"the mesh {path}", texture))
    fallback, name = _FallbackColor(properties)
    colors = np.column_stack([mesh.colors, np.ones(len(bare))])
    colors[bare] = fallback
    vertices, index = np.unique(mesh.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    vertices, triangles = vertices * shape.scale3(), index.reshape(-1, 3)
    if np.prod(shape.scale3()) < 0.0:
        triangles = triangles[:, ::-1]  # A mirror image is turned inside out.
    materials = [name if b else m for b, m in zip(bare, mesh.materials, strict=True)]
    return Surface(vertices, triangles, colors, materials, _IsConvex(vertices, triangles))


def _IsConvex(vertices: Array, triangles: IntArray) -> bool:
    """Whether triangles of distinct vertices enclose a convex solid, all facing outward.

    False, for a mesh too large to tell, only makes drawing slower.
    """
    if len(vertices) * len(triangles) > _MOST_TESTS:
        return False
    sides = [
        tuple(side) for k in range(3) for side in np.roll(triangles, k, axis=1)[:, :2].tolist()
    ]
    if len(set(sides)) < len(sides) or set(sides) != {(b, a) for a, b in sides}:
        return False
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    heights = normals @ vertices.T - np.sum(normals * a, axis=1)[:, None]
    size = float(np.ptp(vertices, axis=0).max())
    return bool(np.all(heights <= 1e-6 * size * np.linalg.norm(normals, axis=1)[:, None]))
