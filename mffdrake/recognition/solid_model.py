"""Colored convex solids and their search models: equations (19), (20).

A `SolidModel` is the known object: its faces, each with one hue. `SearchModel` samples it: inside
points on every face (S_in), and points on every edge from which the outside strip (S_out) grows
once a pose tells which edges form the silhouette.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import MinLen
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.parameters import Count, Positive, parameters

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

RED, GREEN, BLUE = 0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0
"""Hues [rad] of the three primary colors."""

_SAME_NORMAL, _SAME_HUE = 1e-3, 1e-3  # Unit normals and hues [rad] this close are the same;
_SAME_LENGTH = 1e-4  # so are lengths, as a share of the solid's size.


class SolidModel:
    """A closed convex polyhedron whose faces carry one hue each.

    Args:
        vertices: Corner points in the target's frame M [m], shape (V, 3).
        faces: For each face the indices of its corners, counterclockwise seen from outside.
        hues: Hue of each face [rad], shape (F,).
        materials: Name of each face's material; by default faces are named by their hues.

    Attributes:
        vertices: As given, shape (V, 3).
        faces: As given, a tuple of tuples.
        hues: As given, in [0, 2 pi), shape (F,).
        materials: Name of each face's material, a tuple; faces of one material look alike.
        normals: Outward unit normals, shape (F, 3).
        areas: Of the faces [m^2], shape (F,).
        centers: Mean of each face's corners [m], shape (F, 3).
        edges: Corner indices of each edge, shape (E, 2).
        edge_faces: The two faces that meet at each edge, shape (E, 2).

    Raises:
        ValueError: When the solid is not closed, not convex, or has other numbers of hues or
            materials than of faces.

    Example:
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> len(box.faces), len(box.edges)
        (6, 12)
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: Sequence[Sequence[int]],
        hues: ArrayLike,
        materials: Sequence[str] | None = None,
    ) -> None:
        self.vertices: Array = np.asarray(vertices, dtype=float).reshape(-1, 3)
        self.faces = tuple(tuple(int(i) for i in face) for face in faces)
        self.hues: Array = np.mod(np.asarray(hues, dtype=float).reshape(-1), 2.0 * math.pi)
        if len(self.hues) != len(self.faces):
            raise ValueError(
                f"SolidModel: {len(self.faces)} faces need as many hues, not {len(self.hues)}"
            )
        if materials is None:
            materials = [f"hue {math.degrees(hue):.6g} deg" for hue in self.hues]
        self.materials = tuple(materials)
        if len(self.materials) != len(self.faces):
            raise ValueError(
                f"SolidModel: {len(self.faces)} faces need as many materials, not "
                f"{len(self.materials)}"
            )
        doubled = np.array([self._doubled_area(face) for face in self.faces])
        lengths = np.linalg.norm(doubled, axis=1)
        self.normals: Array = doubled / lengths[:, None]
        self.areas: Array = 0.5 * lengths
        self.centers: Array = np.array([self.vertices[list(f)].mean(axis=0) for f in self.faces])
        self.edges, self.edge_faces = self._find_edges()
        heights = np.einsum("fk,fvk->fv", self.normals, self.vertices[None] - self.centers[:, None])
        if heights.max() > _SAME_LENGTH * np.ptp(self.vertices, axis=0).max():
            raise ValueError(
                "SolidModel: the solid is not convex (or a face is listed clockwise); hidden faces "
                "are found by their normals alone, so only convex solids can be recognized"
            )

    @classmethod
    def box(cls, size: ArrayLike, hues: ArrayLike) -> SolidModel:
        """A box centered at the frame's origin, opposite faces of the same hue.

        Args:
            size: Side lengths along x, y, z [m], shape (3,).
            hues: Hues [rad] of the faces normal to x, y, z, shape (3,).
        """
        hx, hy, hz = 0.5 * np.asarray(size, dtype=float)
        vertices = [(x, y, z) for x in (-hx, hx) for y in (-hy, hy) for z in (-hz, hz)]
        faces = [(4, 6, 7, 5), (0, 1, 3, 2), (2, 3, 7, 6), (0, 4, 5, 1), (1, 5, 7, 3), (0, 2, 6, 4)]
        return cls(vertices, faces, np.repeat(np.asarray(hues, dtype=float), 2))

    @classmethod
    def from_mesh_file(cls, path: Path | str) -> SolidModel:
        """Reads a convex mesh with one material a face, e.g. OBJ + MTL (meters).

        Triangles that lie in one plane and share a color become one face.

        Args:
            path: The mesh file, of a format that `trimesh` reads with its materials.

        Raises:
            FileNotFoundError: When there is no such file.
            ValueError: When there are no faces or materials, a face is grey (it has no hue), or the
                solid is not closed or not convex.
        """
        import trimesh  # Slow to import, and needed here alone.

        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"no mesh file {path}")
        scene = trimesh.load_scene(path, process=False)
        corners, hues, materials = [], [], []
        for name, mesh in scene.geometry.items():
            material = getattr(mesh.visual, "material", None)
            if material is None:
                raise ValueError(
                    f"{path}: the mesh has no materials; every face of the target needs a color, "
                    "e.g. as an OBJ file with an MTL file beside it"
                )
            color = np.asarray(material.main_color, dtype=float)[:3] / 255.0
            hue, saturation, _ = colorsys.rgb_to_hsv(*color)
            if saturation < 0.5:
                raise ValueError(
                    f"{path}: a material has the grey color {color.round(2).tolist()}, which "
                    "has no hue; every face of the target needs a saturated color"
                )
            corners.append(np.asarray(mesh.triangles))
            hues.append(np.full(len(mesh.triangles), 2.0 * math.pi * hue))
            materials += [str(getattr(material, "name", None) or name)] * len(mesh.triangles)
        if not corners:
            raise ValueError(f"{path}: the file has no faces")
        return cls._from_triangles(np.concatenate(corners), np.concatenate(hues), materials)

    @classmethod
    def _from_triangles(cls, triangles: Array, hues: Array, materials: Sequence[str]) -> SolidModel:
        """Merges coplanar triangles of one hue into convex faces with counterclockwise corners.

        Files carry rounded coordinates, so what belongs together agrees within tolerances only.
        """
        size = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        distances = np.einsum("tk,tk->t", normals, triangles.mean(axis=1))
        plane = np.column_stack(
            [normals / _SAME_NORMAL, distances / (_SAME_LENGTH * size), hues / _SAME_HUE]
        )
        label = _cluster(plane)
        index = _cluster(triangles.reshape(-1, 3) / (_SAME_LENGTH * size)).reshape(-1, 3)
        vertices = np.array(
            [
                triangles.reshape(-1, 3)[index.reshape(-1) == k].mean(0)
                for k in range(index.max() + 1)
            ]
        )
        faces, face_hues, face_materials = [], [], []
        for k in range(label.max() + 1):
            members = np.flatnonzero(label == k)
            ids = np.unique(index[members])
            normal = normals[members].mean(axis=0)
            arm = vertices[ids] - vertices[ids].mean(axis=0)
            # Sorting the corners by angle about the normal is right for convex faces.
            first = arm[0] / np.linalg.norm(arm[0])
            angle = np.arctan2(arm @ np.cross(normal, first), arm @ first)
            faces.append(tuple(ids[np.argsort(angle)]))
            face_hues.append(hues[members[0]])
            face_materials.append(materials[members[0]])
        return cls(vertices, faces, face_hues, face_materials)

    @property
    def size(self) -> float:
        """Diagonal of the box around it, along the axes of its frame [m]."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    def _doubled_area(self, face: Sequence[int]) -> Array:
        """Outward normal of a face, as long as twice its area (Newell's method)."""
        p = self.vertices[list(face)]
        return np.asarray(np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0))

    def _find_edges(self) -> tuple[IntArray, IntArray]:
        """Edges with the two faces that meet there."""
        sides: dict[tuple[int, int], list[int]] = {}
        for f, face in enumerate(self.faces):
            for a, b in zip(face, (*face[1:], face[0]), strict=True):
                sides.setdefault((min(a, b), max(a, b)), []).append(f)
        if any(len(f) != 2 for f in sides.values()):
            raise ValueError("SolidModel: not a closed solid: an edge has not exactly two faces")
        return np.array(list(sides)), np.array(list(sides.values()))


def _cluster(rows: Array) -> IntArray:
    """Labels rows so that those less than one apart in every column share a label."""
    labels = np.full(len(rows), -1, dtype=np.int64)
    for k in range(len(rows)):
        if labels[k] < 0:
            near = np.abs(rows - rows[k]).max(axis=1) < 1.0
            labels[near & (labels < 0)] = labels.max() + 1
    return labels


@parameters
class SamplingParameters:
    """How densely a solid is sampled.

    Attributes:
        spacing: Largest distance between neighboring points on a face and along an edge [m].
        min_cells: Small faces and short edges are sampled more closely, so that points part them
            into at least so many pieces along each of their directions.
        margin: Distance of the outermost inside points from their face's edges [m]; None puts
            the points at the centers of equal cells.
        strip_offsets: Distances of the outside strip's rows from the silhouette [m].

    Raises:
        ValueError: When a length is not positive.
    """

    spacing: Positive = 0.020
    min_cells: Count = 5
    margin: Positive | None = 0.0015
    strip_offsets: Annotated[tuple[Positive, ...], MinLen(1)] = (0.0015, 0.006, 0.020)


class SearchModel:
    """A sampled solid: S_in of Eq. (19), and the edge points from which S_out of Eq. (20) grows.

    Args:
        solid: The solid.
        sampling: How densely to sample it.

    Attributes:
        solid: The solid.
        inside_points: S_in in frame M [m], face by face, shape (P, 3).
        inside_start: Where each face's points start in ``inside_points``, shape (F + 1,).
        inside_distances: Each inside point's distances to its face's sides [m], shape (P, K), with
            infinity beyond the last side of a face with fewer than K.
        side_centers: Middle of each face's sides [m], shape (F, K, 3).
        side_directions: Unit vectors along the sides, shape (F, K, 3).
        edge_points: Points on the edges in frame M [m], edge by edge, shape (Q, 3).
        edge_start: Where each edge's points start in ``edge_points``, shape (E + 1,).
        edge_directions: Unit vectors along the edges, shape (E, 3).
        strip_offsets: Distances of the strip's rows from the silhouette [m], shape (K,).

    Example:
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> cells = SamplingParameters(margin=None)
        >>> len(SearchModel(box, cells).inside_points)    # 2 x (5 x 8 + 5 x 10 + 8 x 10)
        340
    """

    def __init__(self, solid: SolidModel, sampling: SamplingParameters | None = None) -> None:
        sampling = SamplingParameters() if sampling is None else sampling
        self.solid = solid
        inside = [_face_points(solid.vertices[list(face)], sampling) for face in solid.faces]
        self.inside_points: Array = np.concatenate(inside)
        self.inside_start: IntArray = np.cumsum([0, *map(len, inside)])
        most_sides = max(map(len, solid.faces))
        self.inside_distances: Array = np.full((len(self.inside_points), most_sides), np.inf)
        self.side_centers: Array = np.zeros((len(solid.faces), most_sides, 3))
        self.side_directions: Array = np.zeros((len(solid.faces), most_sides, 3))
        for k, face in enumerate(solid.faces):
            corners = solid.vertices[list(face)]
            sides = np.roll(corners, -1, axis=0) - corners
            directions = sides / np.linalg.norm(sides, axis=1, keepdims=True)
            self.side_centers[k, : len(face)] = corners + 0.5 * sides
            self.side_directions[k, : len(face)] = directions
            points = slice(*self.inside_start[k : k + 2])
            inward = np.cross(solid.normals[k], directions)
            self.inside_distances[points, : len(face)] = np.einsum(
                "psk,sk->ps", self.inside_points[points, None] - corners, inward
            )
        ends = solid.vertices[solid.edges]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        self.edge_directions: Array = (ends[:, 1] - ends[:, 0]) / lengths[:, None]
        along = [
            start + _cells(length, sampling, margin=None)[:, None] * direction
            for start, length, direction in zip(
                ends[:, 0], lengths, self.edge_directions, strict=True
            )
        ]
        self.edge_points: Array = np.concatenate(along)
        self.edge_start: IntArray = np.cumsum([0, *map(len, along)])
        self.strip_offsets: Array = np.array(sampling.strip_offsets)


def _cells(length: float, sampling: SamplingParameters, margin: float | None) -> Array:
    """Coordinates along a side: cell centers, or evenly from margin to length - margin."""
    inner = length - 2.0 * (margin or 0.0)
    if inner <= 0:
        return np.array([0.5 * length])
    count = max(sampling.min_cells, math.ceil(inner / sampling.spacing - 1e-9))
    if margin is None:
        return (np.arange(count) + 0.5) * length / count
    return np.linspace(margin, length - margin, count + 1)


def _face_points(corners: Array, sampling: SamplingParameters) -> Array:
    """Grid points of a convex face, aligned with its first edge."""
    x = corners[1] - corners[0]
    x /= np.linalg.norm(x)
    arm = corners - corners[0]
    normal = np.cross(arm[1:-1], arm[2:]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    y = np.cross(normal, x)
    polygon = np.column_stack([arm @ x, arm @ y])
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    u = low[0] + _cells(high[0] - low[0], sampling, sampling.margin)
    v = low[1] + _cells(high[1] - low[1], sampling, sampling.margin)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    side = np.roll(polygon, -1, axis=0) - polygon
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    # Distance of every grid point to every side, positive on the inner (left) side.
    to_point = grid[:, None] - polygon[None]
    depth = side[None, :, 0] * to_point[..., 1] - side[None, :, 1] * to_point[..., 0]
    least = 1e-9 if sampling.margin is None else sampling.margin - 1e-9
    inside = grid[depth.min(axis=1) >= least]
    if len(inside) == 0:
        inside = polygon.mean(axis=0, keepdims=True)
    return np.asarray(corners[0] + inside[:, :1] * x + inside[:, 1:] * y)
