"""Compiled looks of a solid from many sides, and orientations (numba). Import only where it runs.

A *look* is a row of numbers: of every color its share of the area that is seen, and that share
times its center's place; then the second moments about the whole's center (xx, xy, yy). Lengths are
in units of the root of the area, so that a look does not depend on the distance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.fitness.structs import Solid
from mffdrake.recognition.poses.rotations import multiply, rotation
from mffdrake.recognition.visibility.drawing import Camera, Canvas, Drawn, draw

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RESOLUTION = 64  # pixels across, of a drawn look


class Looks(NamedTuple):
    """How a solid looks from many sides, from a usual distance.

    Attributes:
        turns: Quaternions (scalar part first) of its orientation R_FM, shape (N, 4).
        area: Area of what is seen of it, at its distance [m^2], shape (N,).
        center: Where its middle lies from the center of what is seen [m], shape (N, 2).
        looks: Their looks, shape (N, 3 C + 3).
    """

    turns: Array
    area: Array
    center: Array
    looks: Array


class Corners(NamedTuple):
    """Of a `SolidModel`, its attributes of the same names."""

    vertices: Array
    edges: IntArray
    edge_faces: IntArray


@njit(cache=True, error_model="numpy")
def add_to_look(
    look: Array, color: int, num_colors: int, area: float, x: float, y: float,
    xx: float, xy: float, yy: float,
) -> None:  # fmt: skip
    """Adds a piece of one color: its area, center, and second moments about that."""
    last = 3 * num_colors
    look[3 * color] += area
    look[3 * color + 1] += area * x
    look[3 * color + 2] += area * y
    look[last] += area * (x * x + xx)
    look[last + 1] += area * (x * y + xy)
    look[last + 2] += area * (y * y + yy)


@njit(cache=True, error_model="numpy")
def finish_look(look: Array, num_colors: int) -> tuple[float, float, float]:
    """Makes a look of the sums. Returns the area and the center."""
    last = 3 * num_colors
    area, x, y = 0.0, 0.0, 0.0
    for k in range(num_colors):
        area += look[3 * k]
        x += look[3 * k + 1]
        y += look[3 * k + 2]
    x, y = x / area, y / area
    size = math.sqrt(area)
    for k in range(num_colors):
        share = look[3 * k] / area
        look[3 * k + 1] = (look[3 * k + 1] / area - share * x) / size
        look[3 * k + 2] = (look[3 * k + 2] / area - share * y) / size
        look[3 * k] = share
    look[last] = (look[last] / area - x * x) / area
    look[last + 1] = (look[last + 1] / area - x * y) / area
    look[last + 2] = (look[last + 2] / area - y * y) / area
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
def draw_looks(
    drawn: Drawn, classes: NDArray[np.int8], num_colors: int, distance: float, turns: Array
) -> Looks:
    """The looks of a solid whose middle is straight ahead, drawn. ``classes``: faces' colors."""
    count = len(turns)
    table = Looks(
        turns, np.empty(count), np.empty((count, 2)), np.zeros((count, 3 * num_colors + 3))
    )
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
                    add_to_look(
                        table.looks[n], classes[canvas.faces[i, j]], num_colors, pixel**2,
                        (j - half) * pixel, (i - half) * pixel, pixel**2 / 12.0, 0.0,
                        pixel**2 / 12.0,
                    )  # fmt: skip
        area, x, y = finish_look(table.looks[n], num_colors)
        table.area[n] = area * distance * distance
        table.center[n, 0], table.center[n, 1] = -x * distance, -y * distance
    return table


@njit(cache=True, error_model="numpy")
def make_looks(
    solid: Solid,
    corners_of: Corners,
    classes: NDArray[np.int8],
    num_colors: int,
    distance: float,
    turns: Array,
) -> Looks:
    """The looks of a convex solid whose middle is straight ahead. ``classes``: faces' colors."""
    vertices, edges, edge_faces = corners_of
    count, num_faces = len(turns), len(solid.normals)
    table = Looks(
        turns, np.empty(count), np.empty((count, 2)), np.zeros((count, 3 * num_colors + 3))
    )
    seen = np.empty(num_faces, dtype=np.bool_)
    corners, centers = np.empty((3, 2)), np.empty((num_faces, 2))
    points = np.empty((len(vertices), 2))
    for n in range(count):
        R = rotation(turns[n, 1:])
        for k in range(len(points)):
            points[k] = _ahead(R, vertices[k], solid.middle, distance)
        for f in range(num_faces):
            centers[f] = _ahead(R, solid.centers[f], solid.middle, distance)
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
                corners[2] = centers[f]
                x, y = corners[:, 0].sum() / 3.0, corners[:, 1].sum() / 3.0
                area = 0.5 * abs(
                    (corners[1, 0] - corners[0, 0]) * (corners[2, 1] - corners[0, 1])
                    - (corners[2, 0] - corners[0, 0]) * (corners[1, 1] - corners[0, 1])
                )
                xx, xy, yy = 0.0, 0.0, 0.0
                for k in range(3):
                    dx, dy = corners[k, 0] - x, corners[k, 1] - y
                    xx, xy, yy = xx + dx * dx / 12.0, xy + dx * dy / 12.0, yy + dy * dy / 12.0
                add_to_look(table.looks[n], classes[f], num_colors, area, x, y, xx, xy, yy)
        area, x, y = finish_look(table.looks[n], num_colors)
        table.area[n] = area * distance * distance
        table.center[n, 0], table.center[n, 1] = -x * distance, -y * distance
    return table


@njit(cache=True, error_model="numpy")
def _ahead(R: Array, point: Array, middle: Array, distance: float) -> tuple[float, float]:
    """Normalized coordinates of a point of a solid whose middle is straight ahead."""
    a, b, c = point[0] - middle[0], point[1] - middle[1], point[2] - middle[2]
    z = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + distance
    return (
        (R[0, 0] * a + R[0, 1] * b + R[0, 2] * c) / z,
        (R[1, 0] * a + R[1, 1] * b + R[1, 2] * c) / z,
    )


@njit(cache=True, error_model="numpy")
def multiply_all(a: Array, b: Array) -> Array:
    """Products of a quaternion with others, shape (N, 4)."""
    products = np.empty((len(b), 4))
    for n in range(len(b)):
        products[n] = multiply(a, b[n])
    return products


@njit(cache=True, error_model="numpy")
def find_alike(look: Array, table: Looks, count: int, alike: IntArray) -> None:
    """Fills in the looks of a table that are most like a blob's, the likest first."""
    best = np.full(count, np.inf)
    last = len(look) - 3
    for n in range(len(table.area)):
        distance = 0.0
        for k in range(len(look)):
            apart = look[k] - table.looks[n, k]
            distance += apart * apart if k < last else 4.0 * apart * apart
            if distance >= best[count - 1]:
                break
        if distance < best[count - 1]:
            place = count - 1
            while place > 0 and best[place - 1] > distance:
                best[place], alike[place] = best[place - 1], alike[place - 1]
                place -= 1
            best[place], alike[place] = distance, n
