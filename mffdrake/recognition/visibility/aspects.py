"""What is seen of a solid from where: which edges, and which points.

Of a convex solid with few edges the faces' normals tell it. Of any other one it is found out
beforehand, by drawing it from the corners of many *aspects* (ranges of directions): what counts in
an aspect is what holds at all of its corners. A pose's aspect is then looked up.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from mffdrake.recognition.solid.disk_cache import cached
from mffdrake.recognition.solid.solid_model import SolidModel
from mffdrake.recognition.visibility.search_model import SearchModel

if TYPE_CHECKING:
    from mffdrake.recognition.visibility.drawing import Drawn, Survey

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Flags = NDArray[np.bool_]

GRID = 32  # aspects along and across, 6 degrees wide
_PIECES = 40  # Edges are looked at in so many places over the solid's size, ...
_MOST_PIECES = 6000  # but, where they are many, in about so many in all.
_MOST_BENDS = 1000  # of curved surfaces, in an aspect
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class Outlines(NamedTuple):
    """The edges, and parts of edges, along which an image may show a border.

    Attributes:
        grid: That of the aspects, see `drawing`.
        start: Where each aspect's segments start in ``segments``, shape (A + 1,).
        segments: Numbers of the segments, aspect by aspect.
        ends: Of each segment [m], shape (M, 2, 3).
        faces: The two faces that meet there, shape (M, 2).
        inward: Unit vectors into those, across the segment, shape (M, 2, 3).
        stops: 1 where a segment stops at an end, 0 where it goes on as a curve, shape (M, 2).
        smooth: Whether it is but a bend of a curved surface, shape (M,).
    """

    grid: int
    start: IntArray
    segments: IntArray
    ends: Array
    faces: IntArray
    inward: Array
    stops: Array
    smooth: Flags


class Visibility(NamedTuple):
    """Which of a search model's points count.

    Attributes:
        grid: That of the aspects, see `drawing`.
        faces_start: Where each aspect's faces start in ``faces``, shape (A + 1,).
        faces: Numbers of the faces that may be seen and whose points or edges count.
        shown: Whether nothing hides an inside point, shape (A, P).
        edges_start: Where each aspect's edges start in ``edges``, shape (A + 1,).
        edges: Numbers of the edges that may be silhouettes, aspect by aspect.
        points_start: Where each of those entries' points start in ``points``.
        points: Numbers of the edges' points that count.
        rows: For each of them one bit for each row of the strip that does.
    """

    grid: int
    faces_start: IntArray
    faces: IntArray
    shown: Flags
    edges_start: IntArray
    edges: IntArray
    points_start: IntArray
    points: IntArray
    rows: NDArray[np.uint32]


def find_outlines(solid: SolidModel, alike: Flags) -> Outlines:
    """The segments that may be borders.

    Args:
        solid: The solid.
        alike: Which two of its faces' materials (by their numbers) look alike, shape (C, C).
    """
    ends = solid.vertices[solid.edges]
    if solid.is_plain:
        every = np.arange(len(solid.edges))
        return Outlines(
            0, np.array([0, len(every)]), every, ends, solid.edge_faces, solid.edge_inward,
            np.where(solid.continues, 0.0, 1.0), solid.smooth,
        )  # fmt: skip
    lengths = solid.edge_lengths
    per_length = min(_PIECES / solid.size, _MOST_PIECES / lengths.sum())
    counts = np.maximum(1, np.ceil(lengths * per_length)).astype(np.int64)
    return cached(_draw_outlines, solid, alike, counts, key=[solid.fingerprint, alike, counts])


def _draw_outlines(solid: SolidModel, alike: Flags, counts: IntArray) -> Outlines:
    """`find_outlines`, with so many pieces of each edge."""
    ends = solid.vertices[solid.edges]
    edge = np.repeat(np.arange(len(counts)), counts)
    piece = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (piece + 0.5) / counts[edge]
    points = ends[edge, 0] + share[:, None] * (ends[edge, 1] - ends[edge, 0])
    _, states, facing = _survey(
        solid, alike, np.empty((0, 3)), np.empty(0, dtype=np.int64), edge, points, np.empty(0)
    )

    from mffdrake.recognition.visibility import drawing  # numba: slow to import

    relevant = (states & (drawing.CONTOUR | drawing.CREASE)) > 0
    free = (states & drawing.FREE) > 0
    hidden = (states & drawing.HIDDEN) > 0
    some, bad = _of_corners(relevant), _of_corners((relevant & ~free) | hidden)
    allowed = (some | _find_silhouettes(solid, facing)[:, edge]) & ~bad
    # Runs of neighboring pieces of an edge
    padded = np.pad(allowed, ((0, 0), (1, 1)))
    ahead = np.concatenate([[False], edge[1:] == edge[:-1], [False]])
    first = padded[:, 1:] & ~(padded[:, :-1] & ahead)
    begins = np.argwhere(first[:, :-1] & allowed)
    last = padded[:, :-1] & ~(padded[:, 1:] & ahead)
    stops_at = np.argwhere(last[:, 1:] & allowed)[:, 1]
    # As one number each, which are sorted much faster
    runs, number = np.unique(begins[:, 1] * len(edge) + stops_at, return_inverse=True)
    runs = np.stack(np.divmod(runs, len(edge)), axis=1)
    start = np.searchsorted(begins[:, 0], np.arange(GRID * GRID + 1))
    of_edge = edge[runs[:, 0]]
    shares = np.stack(
        [piece[runs[:, 0]] / counts[of_edge], (piece[runs[:, 1]] + 1) / counts[of_edge]], axis=1
    )
    way = ends[of_edge, 1] - ends[of_edge, 0]
    cut = ends[of_edge, 0][:, None] + shares[..., None] * way[:, None]
    stops = np.where((shares == [0.0, 1.0]) & solid.continues[of_edge], 0.0, 1.0)
    return Outlines(
        GRID, start, number.reshape(-1), cut, solid.edge_faces[of_edge],
        solid.edge_inward[of_edge], stops, solid.smooth[of_edge],
    )  # fmt: skip


def _find_silhouettes(solid: SolidModel, facing: Flags) -> Flags:
    """Which bends of curved surfaces are silhouettes somewhere in an aspect, shape (A, E).

    They need not be one at its corners. Of very many, enough are taken.
    """
    first, second = facing[:, solid.edge_faces].transpose(2, 0, 1)
    found = _of_corners(first | second) & _of_corners(~(first & second)) & solid.smooth
    chance = np.mod(np.arange(len(solid.smooth)) * _GOLDEN, 1.0)  # the same at each call
    share = _MOST_BENDS / np.maximum(found.sum(axis=1), 1)
    return np.asarray(found & (chance < share[:, None]))


def find_visibility(model: SearchModel, alike: Flags) -> Visibility:
    """Which points of a search model count from where.

    Args:
        model: The sampled solid.
        alike: As for `find_outlines`.
    """
    solid = model.solid
    if solid.is_plain:
        every = np.arange(len(model.edge_points))
        all_rows = np.full(len(every), 2 ** len(model.strip_offsets) - 1, dtype=np.uint32)
        return Visibility(
            0, np.array([0, len(solid.faces)]), np.arange(len(solid.faces)),
            np.ones((1, len(model.inside_points)), dtype=bool),
            np.array([0, len(solid.edges)]), np.arange(len(solid.edges)), model.edge_start,
            every, all_rows,
        )  # fmt: skip
    points = [model.inside_points, model.edge_points, model.strip_offsets]
    return cached(_draw_visibility, model, alike, key=[solid.fingerprint, alike, *points])


def _draw_visibility(model: SearchModel, alike: Flags) -> Visibility:
    """`find_visibility`."""
    solid, offsets, edge = model.solid, model.strip_offsets, model.point_edges
    hidden, states, facing = _survey(
        solid, alike, model.inside_points, model.inside_faces, edge, model.edge_points, offsets
    )

    from mffdrake.recognition.visibility import drawing  # numba: slow to import

    contour = (states & drawing.CONTOUR) > 0
    rows = np.zeros((GRID * GRID, len(edge)), dtype=np.uint32)
    some = _of_corners(contour)
    for k in range(len(offsets)):
        covered = contour & ((states & (drawing.FIRST_ROW << k)) == 0)
        rows |= np.where(some & ~_of_corners(covered), np.uint32(1 << k), np.uint32(0))
    entry, point = map(np.ascontiguousarray, np.nonzero(rows))
    changes = (np.diff(entry, prepend=-1) != 0) | (np.diff(edge[point], prepend=-1) != 0)
    heads = np.flatnonzero(changes)
    edges = edge[point[heads]]
    # The faces whose visibility has to be known in an aspect
    shown = ~_of_corners(hidden)
    until = np.pad(np.cumsum(shown, axis=1), ((0, 0), (1, 0)))[:, model.inside_start]
    needed = _of_corners(facing) & (np.diff(until, axis=1) > 0)
    for face in solid.edge_faces[edges].T:
        needed[entry[heads], face] = True
    field, faces = map(np.ascontiguousarray, np.nonzero(needed))
    fields = np.arange(GRID * GRID + 1)
    return Visibility(
        GRID, np.searchsorted(field, fields), faces, shown,
        np.searchsorted(entry[heads], fields), edges, np.append(heads, len(point)), point,
        rows[entry, point],
    )  # fmt: skip


def as_drawn(solid: SolidModel) -> Drawn:
    """What the compiled functions draw of a solid."""
    from mffdrake.recognition.visibility.drawing import Drawn  # numba: slow to import

    middle = solid.vertices.mean(axis=0)
    radius = float(np.linalg.norm(solid.vertices - middle, axis=1).max())
    vertices, index = np.unique(solid.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return Drawn(
        vertices, index.reshape(-1, 3), solid.triangle_faces, solid.patches, solid.normals,
        solid.centers, middle, radius,
    )  # fmt: skip


def _of_corners(flags: Flags) -> Flags:
    """Of each aspect, whether it holds at any of its four corners, shape (A, ...)."""
    grid = flags.reshape(GRID + 1, GRID + 1, -1)
    corners = [grid[:-1, :-1], grid[1:, :-1], grid[:-1, 1:], grid[1:, 1:]]
    together = corners[0] | corners[1] | corners[2] | corners[3]
    return together.reshape(GRID * GRID, -1)


def _survey(
    solid: SolidModel,
    alike: Flags,
    inside: Array,
    owners: IntArray,
    edge: IntArray,
    points: Array,
    offsets: Array,
) -> Survey:
    """What is seen from all corners of all aspects."""
    from mffdrake.recognition.visibility import drawing  # numba: slow to import

    marks = drawing.Marks(
        inside, owners, points, solid.edge_directions[edge], solid.edge_faces[edge],
        solid.edge_inward[edge], offsets, solid.material_numbers, alike,
    )  # fmt: skip
    count, drawn = (GRID + 1) ** 2, as_drawn(solid)
    found = drawing.Survey(
        np.zeros((count, len(inside)), dtype=bool),
        np.zeros((count, len(edge)), dtype=np.uint32),
        np.zeros((count, len(solid.faces)), dtype=bool),
    )

    def look(row: int) -> None:
        drawing.survey_row(GRID, row, drawn, marks, found)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = pool.map(look, range(GRID + 1))
        told = "looking at the target from all sides"
        for _ in tqdm(rows, told, GRID + 1, delay=1.0, leave=False, disable=None):
            pass
    return found
