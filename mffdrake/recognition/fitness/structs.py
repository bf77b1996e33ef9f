"""What the compiled functions take: plain numbers and arrays in named tuples (numba; import late).

Numba caches functions of named tuples, and passes tuples of numbers at no cost; one that holds many
arrays is better taken apart by the caller of an inner loop.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.camera.lens import Eye, View, in_view, measure_noise
from mffdrake.recognition.poses.rotations import rotated
from mffdrake.recognition.visibility.aspects import Outlines, Visibility
from mffdrake.recognition.visibility.drawing import aspect_of

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Bits = NDArray[np.uint32]


class ColorGate(NamedTuple):
    """Which colors of the model a pixel shows, see `ColorModel`.

    Attributes:
        places: What each value of each channel adds to the place in the table, shape (3, 256).
        table: For each place one bit a color.
    """

    places: Bits
    table: Bits


class Solid(NamedTuple):
    """The solid, see `SolidModel`.

    Attributes:
        outlines: The segments that may be borders, see `Outlines`.
        normals: Outward unit normals, shape (F, 3).
        centers: Faces' centers [m], shape (F, 3).
        middle: Mean of the corners [m], shape (3,).
        colors: Bit of each face's color in a `ColorGate`, shape (F,).
        all_colors: The bits of all of them.
        kinds: Numbers of the faces' materials, shape (F,).
        alike: Whether two materials' colors overlap, shape (C, C).
        symmetry_axes: Unit vectors about which any rotation changes nothing, see `Symmetries`,
            shape (K, 3).
    """

    outlines: Outlines
    normals: Array
    centers: Array
    middle: Array
    colors: Bits
    all_colors: np.uint32
    kinds: IntArray
    alike: NDArray[np.bool_]
    symmetry_axes: Array


class Scene(NamedTuple):
    """What there is to compare: images, a solid, and how its colors look.

    Attributes:
        views: One a camera.
        solid: The solid.
        gate: Its colors.
        noise: What `noise_of` keeps, shape (1,); NaN until it is asked for.
    """

    views: tuple[View, ...]
    solid: Solid
    gate: ColorGate
    noise: Array


class Samples(NamedTuple):
    """Its points: the attributes of the same names of `SearchModel`, but for these.

    Attributes:
        visibility: Which of them count.
        inside_points: Transposed, shape (3, P).
        inside_start: As in `SearchModel`.
        inside_sides: As in `SearchModel`.
        inside_distances: As in `SearchModel`.
        nearest: Each inside point's distance to the nearest side [m], shape (P,).
        second: To the one that is next to nearest, infinite where there is none, shape (P,).
        nearest_sides: The nearest ones: the first of ``inside_sides``, shape (P,).
        face_sides: As in `SearchModel`.
        face_sides_start: As in `SearchModel`.
        most_sides: Of a face.
        side_centers: As in `Sides`.
        side_directions: As in `Sides`.
        side_inward: As in `Sides`.
        edge_points: Transposed, shape (3, Q).
        edge_directions: As in `SolidModel`.
        edge_faces: As in `SolidModel`.
        edge_inward: As in `SolidModel`.
        strip_offsets: As in `SearchModel`.
    """

    visibility: Visibility
    inside_points: Array
    inside_start: IntArray
    inside_sides: IntArray
    inside_distances: Array
    nearest: Array
    second: Array
    nearest_sides: NDArray[np.uint64]
    face_sides: IntArray
    face_sides_start: IntArray
    most_sides: int
    side_centers: Array
    side_directions: Array
    side_inward: Array
    edge_points: Array
    edge_directions: Array
    edge_faces: IntArray
    edge_inward: Array
    strip_offsets: Array


class Rules(NamedTuple):
    """When a face and a point count: attributes of the same names of `MatchingParameters`."""

    min_cosine: float
    min_border_distance: float


class Scratch(NamedTuple):
    """Memory for points.

    Attributes:
        points: In the target's frame, shape (3, n).
        pixels: The pixels that points fall on, -1 for none, shape (n,).
        least: How far points must lie off each side of a face [m], shape (S,).
        inward: Unit vectors off those sides, shape (S, 3).
    """

    points: Array
    pixels: NDArray[np.int32]
    least: Array
    inward: Array


class Placed(NamedTuple):
    """A solid at a pose before a camera K: X_KM, and the camera's place in the target's frame."""

    R: Array
    p: Array
    p_MK: Array


@njit(cache=True, error_model="numpy")
def place(R_CM: Array, p_CM: Array, eye: Eye, placed: Placed) -> None:
    """Fills in where a solid lies before a camera, Eq. (13), (16)."""
    W, R, p = eye.R_KC, placed.R, placed.p
    for j in range(3):
        x, y, z = R_CM[0, j], R_CM[1, j], R_CM[2, j]
        R[0, j] = W[0] * x + W[1] * y + W[2] * z
        R[1, j] = W[3] * x + W[4] * y + W[5] * z
        R[2, j] = W[6] * x + W[7] * y + W[8] * z
    p[0], p[1], p[2] = in_view(eye, p_CM[0], p_CM[1], p_CM[2])
    for j in range(3):
        placed.p_MK[j] = -(R[0, j] * p[0] + R[1, j] * p[1] + R[2, j] * p[2])


@njit(cache=True, error_model="numpy")
def in_camera(placed: Placed, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point of a placed solid in the camera's frame."""
    x, y, z = rotated(placed.R, x, y, z)
    return x + placed.p[0], y + placed.p[1], z + placed.p[2]


@njit(cache=True, error_model="numpy")
def aspect_shown(placed: Placed, middle: Array, grid: int) -> int:
    """The aspect that a placed solid shows to the camera."""
    eye = placed.p_MK
    aspect: int = aspect_of(eye[0] - middle[0], eye[1] - middle[1], eye[2] - middle[2], grid)
    return aspect


@njit(cache=True, error_model="numpy")
def noise_of(scene: Scene) -> float:
    """Standard deviation of the pixels' noise, see `measure_noise`; measured once a scene."""
    if math.isnan(scene.noise[0]):
        scene.noise[0] = measure_noise(scene.views)
    noise: float = scene.noise[0]
    return noise


@njit(cache=True, error_model="numpy")
def look_up(places: Bits, table: Bits, red: int, green: int, blue: int) -> int:
    """The colors that an 8-bit pixel shows, one bit each; arguments as in a `ColorGate`."""
    return table[places[0, red] + places[1, green] + places[2, blue]]  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def new_placed() -> Placed:
    """Memory for a `Placed`."""
    return Placed(np.empty((3, 3)), np.empty(3), np.empty(3))
