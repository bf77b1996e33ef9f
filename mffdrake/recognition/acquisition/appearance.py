"""Compiled appearances of a solid from many sides, and orientations (numba; import it late).

An *appearance* describes a silhouette: every color's share of its area with that color's first
moments, and the second moments of the whole, all about the whole's center. Lengths are in units of
the root of the area, so that an appearance does not depend on the distance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.fitness.structs import Solid
from mffdrake.recognition.poses.rotations import multiply, rotated, rotation
from mffdrake.recognition.visibility.drawing import Camera, Canvas, Drawn, draw

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

Colors = NDArray[np.void]
Moments = NDArray[np.void]

_RESOLUTION = 64  # pixels across, of a drawn view

COLOR = np.dtype(
    [
        ("share", np.float64),  # of the silhouette's area
        ("x", np.float64),  # that share times its center's place
        ("y", np.float64),
    ]
)
"""How one color is seen."""

SECOND_MOMENTS = np.dtype([("xx", np.float64), ("xy", np.float64), ("yy", np.float64)])
"""Of a silhouette, about its center."""


class Appearances(NamedTuple):
    """How something looks, N times.

    Attributes:
        colors: Of each of C colors a `COLOR`, shape (N, C).
        moments: The `SECOND_MOMENTS`, shape (N,).
    """

    colors: Colors
    moments: Moments


class AppearanceTable(NamedTuple):
    """How a solid looks from many sides, from a usual distance.

    Attributes:
        turns: Quaternions (scalar part first) of its orientation R_FM, shape (N, 4).
        area: Area of what is seen of it, at its distance [m^2], shape (N,).
        center: Where its middle lies from the center of what is seen [m], shape (N, 2).
        appearances: How it looks, N times.
    """

    turns: Array
    area: Array
    center: Array
    appearances: Appearances


class Corners(NamedTuple):
    """Of a `SolidModel`, its attributes of the same names."""

    vertices: Array
    edges: IntArray
    edge_faces: IntArray


@njit(cache=True, error_model="numpy")
def new_appearances(count: int, num_colors: int) -> Appearances:
    """So many, all of nothing yet."""
    return Appearances(
        np.zeros((count, num_colors), dtype=COLOR), np.zeros(count, dtype=SECOND_MOMENTS)
    )


@njit(cache=True, error_model="numpy")
def add_patch(
    appearances: Appearances, n: int, color: int, area: float, x: float, y: float,
    xx: float, xy: float, yy: float,
) -> None:  # fmt: skip
    """Adds a patch of one color: its area, center, and second moments about that."""
    part, whole = appearances.colors[n, color], appearances.moments[n]
    part.share += area
    part.x += area * x
    part.y += area * y
    whole.xx += area * (x * x + xx)
    whole.xy += area * (x * y + xy)
    whole.yy += area * (y * y + yy)


@njit(cache=True, error_model="numpy")
def normalize(appearances: Appearances, n: int) -> tuple[float, float, float]:
    """Makes an appearance of the sums over its patches. Returns its area and center."""
    colors, whole = appearances.colors[n], appearances.moments[n]
    area, x, y = 0.0, 0.0, 0.0
    for color in colors:
        area += color.share
        x += color.x
        y += color.y
    x, y = x / area, y / area
    size = math.sqrt(area)
    for color in colors:
        share = color.share / area
        color.x = (color.x / area - share * x) / size
        color.y = (color.y / area - share * y) / size
        color.share = share
    whole.xx = (whole.xx / area - x * x) / area
    whole.xy = (whole.xy / area - x * y) / area
    whole.yy = (whole.yy / area - y * y) / area
    return area, x, y


@njit(cache=True, error_model="numpy")
def spread_turns(count: int) -> Array:
    """Quaternions spread evenly over all orientations, shape (count, 4)."""
    turns = np.empty((count, 4))
    for n in range(count):
        # A sequence of low discrepancy (Roberts's), and Shoemake's map to orientations
        a = (0.5 + 0.8191725133961645 * n) % 1.0
        b = 2.0 * math.pi * ((0.5 + 0.6710436067037893 * n) % 1.0)
        c = 2.0 * math.pi * ((0.5 + 0.5497004779019703 * n) % 1.0)
        p, q = math.sqrt(1.0 - a), math.sqrt(a)
        turns[n, 0], turns[n, 1] = p * math.sin(b), p * math.cos(b)
        turns[n, 2], turns[n, 3] = q * math.sin(c), q * math.cos(c)
        if turns[n, 0] < 0.0:
            turns[n] *= -1.0
    return turns


@njit(cache=True, error_model="numpy")
def draw_appearances(
    drawn: Drawn, classes: NDArray[np.int8], num_colors: int, distance: float, turns: Array
) -> tuple[Array, Array, Colors, Moments]:
    """The appearances of a solid straight ahead, drawn. ``classes``: faces' colors.

    Returns an `AppearanceTable`'s areas and centers, and the fields of its `Appearances`.
    """
    count = len(turns)
    appearances = new_appearances(count, num_colors)
    areas, centers = np.empty(count), np.empty((count, 2))
    canvas = Canvas(
        np.empty((_RESOLUTION, _RESOLUTION)),
        np.empty((_RESOLUTION, _RESOLUTION), dtype=np.int64),
    )
    tangent = drawn.radius / math.sqrt(max(distance, 1.1 * drawn.radius) ** 2 - drawn.radius**2)
    focal, half = 0.49 * _RESOLUTION / tangent, 0.5 * _RESOLUTION - 0.5
    pixel = 1.0 / focal
    for n in range(count):
        R = rotation(turns[n, 1:])
        draw(Camera(R, drawn.middle - distance * R[2], focal), drawn, canvas)
        for i in range(_RESOLUTION):
            for j in range(_RESOLUTION):
                if canvas.faces[i, j] >= 0:
                    add_patch(
                        appearances, n, classes[canvas.faces[i, j]], pixel**2,
                        (j - half) * pixel, (i - half) * pixel, pixel**2 / 12.0, 0.0,
                        pixel**2 / 12.0,
                    )  # fmt: skip
        area, x, y = normalize(appearances, n)
        areas[n] = area * distance * distance
        centers[n, 0], centers[n, 1] = -x * distance, -y * distance
    return areas, centers, appearances.colors, appearances.moments


@njit(cache=True, error_model="numpy")
def project_appearances(
    solid: Solid,
    corners_of: Corners,
    classes: NDArray[np.int8],
    num_colors: int,
    distance: float,
    turns: Array,
) -> tuple[Array, Array, Colors, Moments]:
    """The appearances of a convex solid straight ahead, as `draw_appearances` returns them."""
    vertices, edges, edge_faces = corners_of
    count, num_faces = len(turns), len(solid.normals)
    appearances = new_appearances(count, num_colors)
    areas, centers = np.empty(count), np.empty((count, 2))
    seen = np.empty(num_faces, dtype=np.bool_)
    corners, middles = np.empty((3, 2)), np.empty((num_faces, 2))
    points = np.empty((len(vertices), 2))
    for n in range(count):
        R = rotation(turns[n, 1:])
        for k in range(len(points)):
            points[k] = _ahead(R, vertices[k], solid.middle, distance)
        for f in range(num_faces):
            middles[f] = _ahead(R, solid.centers[f], solid.middle, distance)
            toward = 0.0  # the face's normal with the line from the camera to its center
            for i in range(3):
                arm = 0.0
                for j in range(3):
                    arm += R[i, j] * (solid.centers[f, j] - solid.middle[j])
                if i == 2:
                    arm += distance
                for j in range(3):
                    toward += R[i, j] * solid.normals[f, j] * arm
            seen[f] = toward < 0.0
        for e in range(len(edges)):
            for side in range(2):
                f = edge_faces[e, side]
                if not seen[f]:
                    continue
                # The triangle between the edge and the face's center
                corners[0], corners[1] = points[edges[e, 0]], points[edges[e, 1]]
                corners[2] = middles[f]
                x, y = corners[:, 0].sum() / 3.0, corners[:, 1].sum() / 3.0
                area = 0.5 * abs(
                    (corners[1, 0] - corners[0, 0]) * (corners[2, 1] - corners[0, 1])
                    - (corners[2, 0] - corners[0, 0]) * (corners[1, 1] - corners[0, 1])
                )
                xx, xy, yy = 0.0, 0.0, 0.0
                for k in range(3):
                    dx, dy = corners[k, 0] - x, corners[k, 1] - y
                    xx, xy, yy = xx + dx * dx / 12.0, xy + dx * dy / 12.0, yy + dy * dy / 12.0
                add_patch(appearances, n, classes[f], area, x, y, xx, xy, yy)
        area, x, y = normalize(appearances, n)
        areas[n] = area * distance * distance
        centers[n, 0], centers[n, 1] = -x * distance, -y * distance
    return areas, centers, appearances.colors, appearances.moments


@njit(cache=True, error_model="numpy")
def _ahead(R: Array, point: Array, middle: Array, distance: float) -> tuple[float, float]:
    """Normalized coordinates of a point of a solid whose middle is straight ahead."""
    x, y, z = rotated(R, point[0] - middle[0], point[1] - middle[1], point[2] - middle[2])
    return x / (z + distance), y / (z + distance)


@njit(cache=True, error_model="numpy")
def multiply_all(a: Array, b: Array) -> Array:
    """Products of a quaternion with others, shape (N, 4)."""
    products = np.empty((len(b), 4))
    for n in range(len(b)):
        products[n] = multiply(a, b[n])
    return products


@njit(cache=True, error_model="numpy")
def _distance(a: Appearances, n: int, b: Appearances, m: int, limit: float) -> float:
    """Squared distance of two appearances; of one that exceeds the limit, only that it does."""
    distance = 0.0
    for k in range(a.colors.shape[1]):
        one, other = a.colors[n, k], b.colors[m, k]
        distance += (one.share - other.share) * (one.share - other.share)
        distance += (one.x - other.x) * (one.x - other.x)
        distance += (one.y - other.y) * (one.y - other.y)
        if distance >= limit:
            return distance  # type: ignore[no-any-return]
    whole, rival = a.moments[n], b.moments[m]
    distance += 4.0 * (whole.xx - rival.xx) * (whole.xx - rival.xx)
    distance += 4.0 * (whole.xy - rival.xy) * (whole.xy - rival.xy)
    distance += 4.0 * (whole.yy - rival.yy) * (whole.yy - rival.yy)
    return distance  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def find_similar(
    appearances: Appearances, n: int, table: AppearanceTable, count: int, similar: IntArray
) -> None:
    """Fills in the views of a table that look most like an appearance, the most similar first."""
    best = np.full(count, np.inf)
    for m in range(len(table.area)):
        distance = _distance(appearances, n, table.appearances, m, best[count - 1])
        if distance < best[count - 1]:
            place = count - 1
            while place > 0 and best[place - 1] > distance:
                best[place], similar[place] = best[place - 1], similar[place - 1]
                place -= 1
            best[place], similar[place] = distance, m
