"""The points at which a solid is compared with images: equations (19), (20).

`SearchModel` samples a `SolidModel`: inside points on every face (S_in), and points on every edge
from which the outside strip (S_out) grows once a pose tells which edges form the silhouette.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Le, MinLen
from numpy.typing import NDArray

from mffdrake.recognition.parameters import Length, ParameterError, parameters
from mffdrake.recognition.solid import surface
from mffdrake.recognition.solid.solid_model import SolidModel

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_TOO_MANY = 200_000  # points
_MOST_INSIDE, _MOST_ALONG = 600, 600  # points; each face and edge has some, if they are not many
_MOST_NEAR = 6  # sides of a face, near a point
_CANDIDATES = 16  # for a point on a curved surface
_PACKING = 0.8  # Points at least so many spacings apart are as dense as those of a grid.


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

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> len(SearchModel(box, SamplingParameters(spacing=0.040)).inside_points)
        216
    """

    spacing: Length = 0.020
    min_cells: Annotated[int, Ge(1), Le(100)] = 5
    margin: Length | None = 0.0015
    strip_offsets: Annotated[tuple[Length, ...], MinLen(1)] = (0.0015, 0.006, 0.020)


class Sides(NamedTuple):
    """Where faces, and curved surfaces made of faces, end.

    Attributes:
        starts: Where each begins [m], with its face on the left, shape (S, 3).
        centers: Their middles [m], shape (S, 3).
        directions: Unit vectors along them, shape (S, 3).
        lengths: Their lengths [m], shape (S,).
        inward: Unit vectors into their faces, across them, shape (S, 3).
        faces: Their faces, shape (S,).
        patches: The smooth surface that each is a side of, shape (S,).
    """

    starts: Array
    centers: Array
    directions: Array
    lengths: Array
    inward: Array
    faces: IntArray
    patches: IntArray

    @classmethod
    def of(cls, solid: SolidModel) -> Sides:
        """The sides of a solid."""
        smooth = {tuple(sorted(ends)) for ends in solid.edges[solid.smooth].tolist()}
        ends, faces = [], []
        for face in range(len(solid.faces)):
            for pair in solid.sides(face).tolist():
                if tuple(sorted(pair)) not in smooth:
                    ends.append(pair)
                    faces.append(face)
        corners = solid.vertices[np.array(ends, dtype=np.int64).reshape(-1, 2)]
        of_face = np.array(faces, dtype=np.int64)
        ways = corners[:, 1] - corners[:, 0]
        lengths = np.linalg.norm(ways, axis=1)
        directions = ways / lengths[:, None]
        inward = np.cross(solid.normals[of_face], directions)
        patches = solid.patches[of_face]
        centers = corners[:, 0] + 0.5 * ways
        return cls(corners[:, 0], centers, directions, lengths, inward, of_face, patches)

    def near(self, points: Array, among: IntArray) -> tuple[IntArray, Array]:
        """The sides that are nearest to each point, and the distances to their lines [m].

        Args:
            points: Points on the surface, shape (N, 3).
            among: Which sides count.

        Returns:
            Places in ``among``, the nearest first, and their distances, both of shape (N, K).
        """
        arm = points[:, None] - self.starts[among]
        height = np.einsum("nsk,sk->ns", arm, self.inward[among])
        if len(among) > _MOST_NEAR:
            along = np.einsum("nsk,sk->ns", arm, self.directions[among])
            beyond = np.maximum(0.0, np.maximum(-along, along - self.lengths[among]))
            # Beyond its ends a side is none: there the surface goes on.
            is_one = beyond <= 1e-9 + 1e-3 * self.lengths[among]
            height = np.where(is_one, np.abs(height), np.inf)
        places = np.argsort(height, axis=1, kind="stable")[:, :_MOST_NEAR]
        return places, np.take_along_axis(height, places, axis=1)

    def distances(self, points: Array, among: IntArray) -> Array:
        """Distance of each point to the nearest side [m], shape (N,)."""
        nearest = np.full(len(points), np.inf)
        for k in among:
            arm = points - self.starts[k]
            along = np.clip(arm @ self.directions[k], 0.0, self.lengths[k])
            away = np.linalg.norm(arm - along[:, None] * self.directions[k], axis=1)
            nearest = np.minimum(nearest, away)
        return nearest


class SearchModel:
    """A sampled solid: S_in of Eq. (19), and the edge points from which S_out of Eq. (20) grows.

    Args:
        solid: The solid.
        sampling: How densely to sample it.

    Raises:
        ParameterError: When it is far too large for that.

    Attributes:
        solid: The solid.
        sides: Where its faces end.
        inside_points: S_in in frame M [m], face by face, those nearest to its sides first, shape
            (P, 3). Faces of a curved surface are sampled as one, so that many have no point.
        inside_start: Where each face's points start in ``inside_points``, shape (F + 1,).
        inside_sides: The sides near each inside point, the nearest first, as places in its face's
            part of ``face_sides``, shape (P, K).
        inside_distances: Distances to them [m], with infinity for none, shape (P, K).
        face_sides: The sides that are near any of a face's points, face by face.
        face_sides_start: Where each face's start in ``face_sides``, shape (F + 1,).
        edge_points: Points on the edges in frame M [m], edge by edge, shape (Q, 3).
        edge_start: Where each edge's points start in ``edge_points``, shape (E + 1,).
        strip_offsets: Distances of the strip's rows from the silhouette [m], shape (K,).

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> cells = SamplingParameters(margin=None)
        >>> len(SearchModel(box, cells).inside_points)    # 2 x (5 x 8 + 5 x 10 + 8 x 10)
        340
    """

    def __init__(self, solid: SolidModel, sampling: SamplingParameters | None = None) -> None:
        sampling = SamplingParameters() if sampling is None else sampling
        self.solid = solid
        if solid.areas.sum() > _TOO_MANY * sampling.spacing**2:
            raise ParameterError(
                f"{solid.name} is {np.ptp(solid.vertices, axis=0).max():g} m long, too large for "
                f"points {sampling.spacing:g} m apart: the mesh is probably in millimeters, but "
                "meshes are in meters; scale its vertices, or increase the sampling's spacing"
            )
        self.sides = Sides.of(solid)
        inside: list[Array] = [np.empty((0, 3))] * len(solid.faces)
        patch_sides = [
            np.flatnonzero(self.sides.patches == patch)
            for patch in range(int(solid.patches.max()) + 1)
        ]
        for patch, sides in enumerate(patch_sides):
            faces = np.flatnonzero(solid.patches == patch)
            if len(faces) == 1:
                inside[faces[0]] = _face_points(solid, int(faces[0]), self.sides, sides, sampling)
            else:
                points, owners = _patch_points(solid, faces, self.sides, sides, sampling)
                for face in np.unique(owners):
                    inside[face] = points[owners == face]
        inside = _thin(inside, solid.areas, _MOST_INSIDE)
        self.inside_points: Array = np.concatenate(inside)
        self.inside_start: IntArray = np.cumsum([0, *map(len, inside)])
        self._find_near_sides(patch_sides)

        starts, distances = solid.vertices[solid.edges[:, 0]], _along_edges(solid, sampling)
        along = [
            start + distance[:, None] * direction
            for start, distance, direction in zip(
                starts, distances, solid.edge_directions, strict=True
            )
        ]
        self.edge_points: Array = np.concatenate(along)
        self.edge_start: IntArray = np.cumsum([0, *map(len, along)])
        self.strip_offsets: Array = np.array(sampling.strip_offsets)

    @property
    def inside_faces(self) -> IntArray:
        """The face of each inside point, shape (P,)."""
        return np.repeat(np.arange(len(self.solid.faces)), np.diff(self.inside_start))

    @property
    def point_edges(self) -> IntArray:
        """The edge of each edge point, shape (Q,)."""
        return np.repeat(np.arange(len(self.solid.edges)), np.diff(self.edge_start))

    def _find_near_sides(self, patch_sides: Sequence[IntArray]) -> None:
        solid, count = self.solid, np.diff(self.inside_start)
        width = max(1, min(_MOST_NEAR, max(map(len, patch_sides))))
        near_sides = np.zeros((len(self.inside_points), width), dtype=np.int64)
        near_distances = np.full((len(self.inside_points), width), np.inf)
        face_sides: list[IntArray] = []
        for face in range(len(solid.faces)):
            own = patch_sides[solid.patches[face]]
            if not count[face] or not len(own):
                face_sides.append(np.empty(0, dtype=np.int64))
                continue
            part = slice(*self.inside_start[face : face + 2])
            places, distances = self.sides.near(self.inside_points[part], own)
            used = np.unique(places)
            near_sides[part, : places.shape[1]] = np.searchsorted(used, places)
            near_distances[part, : places.shape[1]] = distances
            face_sides.append(own[used])
        order = np.lexsort([near_distances[:, 0], self.inside_faces])
        self.inside_points = self.inside_points[order]
        self.inside_sides: IntArray = near_sides[order]
        self.inside_distances: Array = near_distances[order]
        self.face_sides: IntArray = np.concatenate(face_sides)
        self.face_sides_start: IntArray = np.cumsum([0, *map(len, face_sides)])


def _cells(length: float, sampling: SamplingParameters, margin: float | None) -> Array:
    """Coordinates along a side: cell centers, or evenly from margin to length - margin."""
    inner = length - 2.0 * (margin or 0.0)
    if inner <= 0:
        return np.array([0.5 * length])
    count = max(sampling.min_cells, math.ceil(inner / sampling.spacing - 1e-9))
    if margin is None:
        return (np.arange(count) + 0.5) * length / count
    return np.linspace(margin, length - margin, count + 1)


def _along_edges(solid: SolidModel, sampling: SamplingParameters) -> list[Array]:
    """Where each edge's points lie along it [m].

    An edge that is but a piece of a curve has none or few, so that the curve has enough.
    """
    found, passed = [], 0.5 * sampling.spacing
    for length, going_on in zip(solid.edge_lengths, solid.continues, strict=True):
        if not going_on.any():
            found.append(_cells(length, sampling, margin=None))
            continue
        marks = np.arange(*(math.ceil(way / sampling.spacing) for way in (passed, passed + length)))
        found.append(marks * sampling.spacing - passed)
        passed = math.fmod(passed + length, sampling.spacing)
    straight = np.flatnonzero(~solid.continues.any(axis=1))
    fewer = _thin([found[e] for e in straight], solid.edge_lengths[straight], _MOST_ALONG)
    for e, distances in zip(straight, fewer, strict=True):
        found[e] = distances
    return found


def _thin(points: Sequence[Array], sizes: Array, most: int) -> list[Array]:
    """Leaves out points evenly where there are too many.

    Args:
        points: Points of each part.
        sizes: How large each part is. What is left stands for about equal sizes.
        most: How many may be left.
    """
    counts = np.array([len(part) for part in points])
    if counts.sum() <= most:
        return list(points)
    reached = np.cumsum(np.repeat(sizes / np.maximum(counts, 1), counts))
    marks = (np.arange(most) + 0.5) * reached[-1] / most
    kept = np.zeros(len(reached), dtype=bool)
    kept[np.searchsorted(reached, marks)] = True
    ends = np.cumsum(counts)
    return [
        part[kept[end - len(part) : end]] for part, end in zip(points, ends.tolist(), strict=True)
    ]


def _face_points(
    solid: SolidModel, face: int, sides: Sides, own: IntArray, sampling: SamplingParameters
) -> Array:
    """Grid points of a plane face, aligned with its first side."""
    corners = solid.vertices[list(solid.faces[face])]
    x = corners[1] - corners[0]
    x /= np.linalg.norm(x)
    y = np.cross(solid.normals[face], x)
    arm = corners - corners[0]
    polygon = np.column_stack([arm @ x, arm @ y])
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    u = low[0] + _cells(high[0] - low[0], sampling, sampling.margin)
    v = low[1] + _cells(high[1] - low[1], sampling, sampling.margin)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    points = corners[0] + grid[:, :1] * x + grid[:, 1:] * y
    least = 1e-9 if sampling.margin is None else sampling.margin - 1e-9
    triangles = solid.triangles[solid.triangle_faces == face]
    within = _is_within(triangles, points)
    points = points[within & (sides.distances(points, own) >= least)]
    if len(points):
        return np.asarray(points)
    if len(triangles) == len(corners) - 2 and solid.is_convex:
        return solid.centers[face : face + 1]
    areas = np.linalg.norm(np.cross(*(triangles[:, 1:] - triangles[:, :1]).swapaxes(0, 1)), axis=1)
    return np.asarray(triangles[np.argmax(areas)].mean(axis=0, keepdims=True))


def _is_within(triangles: Array, points: Array) -> NDArray[np.bool_]:
    """Whether points of a face's plane lie in one of its triangles, shape (T, 3, 3); (N,)."""
    within = np.zeros(len(points), dtype=bool)
    ways = np.roll(triangles, -1, axis=1) - triangles
    normals = np.cross(ways[:, 0], ways[:, 1])
    squared = np.einsum("tk,tk->t", normals, normals)
    inward = np.cross(normals[:, None], ways)
    for k in np.flatnonzero(squared > 0.0):
        heights = points @ inward[k].T - np.einsum("sk,sk->s", triangles[k], inward[k])
        within |= (heights >= -1e-9 * squared[k]).all(axis=1)
    return within


def _patch_points(
    solid: SolidModel, faces: IntArray, sides: Sides, own: IntArray, sampling: SamplingParameters
) -> tuple[Array, IntArray]:
    """Points about evenly spread over a curved surface, and the faces that they lie on."""
    rng = np.random.default_rng(0)  # The same solid has the same points.
    members = np.flatnonzero(np.isin(solid.triangle_faces, faces))
    area = float(surface.areas(solid.triangles[members]).sum())
    spacing = min(sampling.spacing, math.sqrt(area) / sampling.min_cells)
    count = math.ceil(_CANDIDATES * area / spacing**2)
    points, chosen = surface.spread(solid.triangles[members], count, rng)
    free = sides.distances(points, own) >= (sampling.margin or 0.0)
    points, chosen = points[free], chosen[free]
    kept: list[int] = []
    open_ones = np.ones(len(points), dtype=bool)
    for k in range(len(points)):
        if open_ones[k]:
            kept.append(k)
            near = np.linalg.norm(points - points[k], axis=1) < _PACKING * spacing
            open_ones &= ~near
    return points[kept], solid.triangle_faces[members[chosen[kept]]]
