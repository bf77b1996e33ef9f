"""Colored solids: the known object that is recognized.

A `SolidModel` is a closed surface of plane faces, each with one hue. It need not be convex, and
many small faces may approximate a curved surface.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.solid import soundness, surface

if TYPE_CHECKING:
    from mffdrake.recognition.solid.mesh_file import ColoredMesh

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

RED, GREEN, BLUE = 0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0
"""Hues [rad] of the three primary colors."""

_FEW = 100  # edges
_MANY = 200  # faces
_BINS = 5.0  # of a normal's components from 0 to 1
_SMOOTH = math.cos(math.radians(35.0))  # A surface that bends by less at an edge is curved there.


class Facets(NamedTuple):
    """Faces, or of many small ones those together that look in about the same direction.

    Attributes:
        normals: Their mean outward normals, shape (K, 3).
        centers: Their mean centers [m], shape (K, 3).
        areas: Their areas [m^2], shape (K,).
    """

    normals: Array
    centers: Array
    areas: Array


class SolidModel:
    """A closed polyhedron whose faces carry one hue each.

    Args:
        vertices: Corner points in the target's frame M [m], shape (V, 3).
        faces: For each face the indices of its corners, counterclockwise seen from outside.
        hues: Hue of each face [rad], shape (F,).
        materials: Name of each face's material; by default faces are named by their hues.

    Attributes:
        name: What messages call it.
        vertices: As given, shape (V, 3).
        faces: As given, a tuple of tuples: the outer side of each face.
        holes: For each face the corners of its holes, clockwise; most have none.
        hues: As given, in [0, 2 pi), shape (F,).
        materials: Name of each face's material, a tuple; faces of one material look alike.
        triangles: Corners of triangles that make up the faces [m], shape (T, 3, 3).
        triangle_faces: The face of each triangle, shape (T,).
        normals: Outward unit normals, shape (F, 3).
        areas: Of the faces [m^2], shape (F,).
        centers: Mean of each face's outer corners [m], shape (F, 3).
        edges: Corner indices of each edge, shape (E, 2).
        edge_lengths: Lengths of the edges [m], shape (E,).
        edge_directions: Unit vectors along the edges, shape (E, 3).
        edge_faces: The two faces that meet at each edge, shape (E, 2).
        edge_inward: Unit vectors into those faces, across the edge, shape (E, 2, 3).
        is_convex: Whether it is convex.

    Raises:
        ValueError: When the surface is not closed, a face has no area or is turned inside out, or
            there are other numbers of hues or materials than of faces.

    Example:
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> len(box.faces), len(box.edges), box.is_convex
        (6, 12, True)
    """

    name = "the solid"

    def __init__(
        self,
        vertices: ArrayLike,
        faces: Sequence[Sequence[int]],
        hues: ArrayLike,
        materials: Sequence[str] | None = None,
    ) -> None:
        corners = np.asarray(vertices, dtype=float).reshape(-1, 3)
        outer = tuple(tuple(int(i) for i in face) for face in faces)
        hues = np.asarray(hues, dtype=float).reshape(-1)
        if len(hues) != len(outer):
            raise ValueError(f"SolidModel: {len(outer)} faces need as many hues, not {len(hues)}")
        if materials is not None and len(materials) != len(outer):
            raise ValueError(
                f"SolidModel: {len(outer)} faces need as many materials, not {len(materials)}"
            )
        try:
            soundness.check_indices(len(corners), outer)
            soundness.check_size(corners)
            parts = [surface.triangulate(corners, face) for face in outer]
            triangle_faces = np.repeat(np.arange(len(outer)), [len(part) for part in parts])
            triangles = np.concatenate([np.asarray(part, dtype=np.int64) for part in parts])
            soundness.check_enclosed(corners, triangles, triangle_faces)
            loops = [(face,) for face in outer]
            self._fill(corners, loops, corners[triangles], triangle_faces, hues, materials)
        except ValueError as error:
            raise ValueError(f"SolidModel: {error}") from error

    def _fill(
        self,
        vertices: Array,
        loops: Sequence[Sequence[tuple[int, ...]]],
        triangles: Array,
        triangle_faces: IntArray,
        hues: Array,
        materials: Sequence[str] | None,
    ) -> None:
        self.vertices: Array = vertices
        self.faces = tuple(loop[0] for loop in loops)
        self.holes = tuple(tuple(loop[1:]) for loop in loops)
        soundness.check_hues(hues)
        self.hues: Array = np.mod(hues, 2.0 * math.pi)
        if materials is None:
            materials = [f"hue {math.degrees(hue):.6g} deg" for hue in self.hues]
        self.materials = tuple(materials)
        self.triangles: Array = triangles
        self.triangle_faces: IntArray = triangle_faces
        doubled = np.array([sum(self._doubled_area(side) for side in loop) for loop in loops])
        lengths = np.linalg.norm(doubled, axis=1)
        self.areas: Array = 0.5 * lengths
        self.centers: Array = np.array([self.vertices[list(f)].mean(axis=0) for f in self.faces])
        soundness.check_faces(self.areas, self.centers)
        self.normals: Array = doubled / lengths[:, None]
        self.edges, self.edge_faces, signs = surface.find_edges(loops)
        way = self.vertices[self.edges[:, 1]] - self.vertices[self.edges[:, 0]]
        self.edge_lengths: Array = np.linalg.norm(way, axis=1)
        soundness.check_edges(self.edge_lengths, self.edge_faces)
        self.edge_directions: Array = way / self.edge_lengths[:, None]
        inward = np.cross(self.normals[self.edge_faces], self.edge_directions[:, None])
        self.edge_inward: Array = np.asarray(signs[..., None] * inward, dtype=float)
        self.is_convex = surface.is_convex(vertices, self.normals, self.centers)

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
        """Reads a closed mesh with its colors (see `ColoredMesh`).

        Neighboring triangles that lie in one plane and share a color become one face.

        Args:
            path: The mesh file: OBJ with MTL, GLB, PLY or STL, in meters.

        Raises:
            FileNotFoundError: When there is no such file.
            ValueError: When it has no faces or no colors, a face is grey (it has no hue) or has no
                area, or the surface is not closed or turned inside out; with the place.
        """
        from mffdrake.recognition.solid.mesh_file import ColoredMesh

        return cls.from_mesh(ColoredMesh.read(path))

    @classmethod
    def from_mesh(cls, mesh: ColoredMesh) -> SolidModel:
        """The solid that a closed mesh encloses.

        Args:
            mesh: The mesh, each triangle of one color.

        Raises:
            ValueError: See `from_mesh_file`.
        """
        hues = mesh.hues
        try:
            solid = cls.from_triangles(mesh.triangles, hues, mesh.materials)
        except ValueError as error:
            raise ValueError(f"{mesh.name}: {error}") from error
        solid.name = mesh.name
        return solid

    @classmethod
    def from_triangles(
        cls, triangles: ArrayLike, hues: ArrayLike, materials: Sequence[str]
    ) -> SolidModel:
        """Merges neighboring triangles of one plane and one hue into faces.

        Args:
            triangles: Corners of each, counterclockwise seen from outside [m], shape (T, 3, 3).
                Corners that are the same but for rounding are one, and those that no face needs
                are left out.
            hues: Hue of each [rad], shape (T,).
            materials: Name of each one's material.

        Raises:
            ValueError: See `SolidModel`.
        """
        corners, hues = np.asarray(triangles, dtype=float), np.asarray(hues, dtype=float)
        unknown = np.flatnonzero(~np.isfinite(corners).all(axis=(1, 2)))
        if len(unknown):
            raise ValueError(
                f"face {unknown[0]} has corners at {corners[unknown[0]].tolist()} m, of which not "
                "all are finite numbers; leave it out or mend it"
            )
        if len(corners):
            soundness.check_size(corners.reshape(-1, 3))
        vertices, index, kept = surface.weld(corners)
        if not len(kept):
            raise ValueError("the surface has no faces")
        hues, names = hues[kept], [materials[k] for k in kept]
        soundness.check_enclosed(vertices, index, kept)
        labels = surface.merge_coplanar(vertices, index, hues)
        first = surface.largest(vertices, index, labels)
        solid = cls.__new__(cls)
        used, loops = surface.renumber(surface.trace_loops(vertices, index, labels))
        solid._fill(
            vertices[used], loops, vertices[index], labels, hues[first], [names[k] for k in first]
        )
        return solid

    @property
    def size(self) -> float:
        """Diagonal of the box around it, along the axes of its frame [m]."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @property
    def material_names(self) -> list[str]:
        """The different materials, in the order of the first faces that have them, C of them."""
        return list(dict.fromkeys(self.materials))

    @cached_property
    def material_numbers(self) -> IntArray:
        """Each face's place in `material_names`, shape (F,)."""
        numbers = {name: k for k, name in enumerate(self.material_names)}
        return np.array([numbers[name] for name in self.materials], dtype=np.int64)

    @cached_property
    def smooth(self) -> NDArray[np.bool_]:
        """Edges at which a surface of one hue is but curved, shape (E,)."""
        first, second = self.edge_faces.T
        cosines = np.einsum("ek,ek->e", self.normals[first], self.normals[second])
        same = surface.same_hues(self.hues[first], self.hues[second])
        return np.asarray(same & (cosines > _SMOOTH))

    @cached_property
    def patches(self) -> IntArray:
        """Numbers of the smooth surfaces that faces are parts of, shape (F,)."""
        return surface.connect(len(self.faces), self.edge_faces[self.smooth])

    @cached_property
    def facets(self) -> Facets:
        """What the size of its silhouette is told from."""
        if len(self.faces) <= _MANY:
            return Facets(self.normals, self.centers, self.areas)
        bins = np.column_stack([self.patches, np.rint(_BINS * self.normals)])
        number = np.unique(bins, axis=0, return_inverse=True)[1].reshape(-1)
        areas: Array = np.bincount(number, self.areas).astype(float)
        normals, centers = (
            np.stack([np.bincount(number, self.areas * column) for column in rows.T], axis=1)
            / areas[:, None]
            for rows in (self.normals, self.centers)
        )
        return Facets(normals, centers, areas)

    @cached_property
    def continues(self) -> NDArray[np.bool_]:
        """Whether a line that is an edge goes on at its two ends, shape (E, 2).

        It does where it is an edge of facets that make up a curve or a curved surface.
        """
        going_on = np.repeat(self.smooth[:, None], 2, axis=1)
        sharp = np.flatnonzero(~self.smooth)
        there: dict[int, list[int]] = {}
        for e in sharp.tolist():
            for v in self.edges[e].tolist():
                there.setdefault(v, []).append(e)
        for e in sharp.tolist():
            for end, v in enumerate(self.edges[e].tolist()):
                others = [k for k in there[v] if k != e]
                if len(others) == 1:
                    going_on[e, end] = self._goes_on(e, others[0], v)
        return going_on

    def _goes_on(self, edge: int, other: int, vertex: int) -> bool:
        """Whether an edge is a curve with another one, which begins at a vertex where it ends."""
        patches = [set(self.patches[self.edge_faces[e]].tolist()) for e in (edge, other)]
        (start,) = [v for v in self.edges[edge].tolist() if v != vertex]
        (end,) = [v for v in self.edges[other].tolist() if v != vertex]
        way, on = self.vertices[vertex] - self.vertices[start], self.vertices[end]
        on = on - self.vertices[vertex]
        straight = way @ on > _SMOOTH * np.linalg.norm(way) * np.linalg.norm(on)
        return patches[0] == patches[1] and bool(straight)

    @cached_property
    def fingerprint(self) -> str:
        """A digest by which solids are told apart."""
        digest = hashlib.sha256(repr((self.faces, self.holes, self.materials)).encode())
        for part in (self.vertices, self.hues, self.triangles, self.triangle_faces):
            digest.update(part.tobytes())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        """Whether another one is the same solid, so that what is known of it holds for this one."""
        return isinstance(other, SolidModel) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        """Of the fingerprint."""
        return hash(self.fingerprint)

    @property
    def is_plain(self) -> bool:
        """Whether it is convex with few edges: then normals alone tell what is seen of it."""
        return self.is_convex and len(self.edges) <= _FEW

    def sides(self, face: int) -> IntArray:
        """The corners of a face's sides, of its holes', too, shape (S, 2)."""
        loops = (self.faces[face], *self.holes[face])
        ends = [np.stack([loop, np.roll(loop, -1)], axis=1) for loop in loops]
        return np.concatenate(ends)

    def _doubled_area(self, face: Sequence[int]) -> Array:
        """Outward normal of a face, as long as twice its area (Newell's method)."""
        p = self.vertices[list(face)]
        return np.asarray(np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0))
