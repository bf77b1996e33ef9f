"""The compiled fitness kernel (numba). Import only where it runs: numba takes time to load."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition._edge_lines import rotation
from mffdrake.recognition._lens import (
    NO_DISTORTION,
    Eye,
    Image,
    View,
    distort,
    in_view,
    magnification,
)

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
        vertices: Corner points in the target's frame M [m], shape (V, 3).
        edges: Corner indices of each edge, shape (E, 2).
        edge_faces: The two faces that meet at each edge, shape (E, 2).
        normals: Outward unit normals, shape (F, 3).
        centers: Faces' centers [m], shape (F, 3).
        middle: Mean of the corners [m], shape (3,).
        colors: Bit of each face's color in a `ColorGate`, shape (F,).
        alike: Whether two faces' colors overlap, shape (F, F).
    """

    vertices: Array
    edges: IntArray
    edge_faces: IntArray
    normals: Array
    centers: Array
    middle: Array
    colors: Bits
    alike: NDArray[np.bool_]


class Scene(NamedTuple):
    """What there is to compare: images, a solid, and how its colors look.

    Attributes:
        views: One a camera.
        solid: The solid.
        gate: Its colors.
    """

    views: tuple[View, ...]
    solid: Solid
    gate: ColorGate


class Samples(NamedTuple):
    """Its points: the attributes of the same names of `SearchModel`, but for these.

    Attributes:
        inside_points: Transposed, shape (3, P).
        inside_start: As in `SearchModel`.
        inside_distances: As in `SearchModel`.
        nearest: Each inside point's distance to the nearest side [m], shape (P,).
        side_centers: As in `SearchModel`.
        side_directions: As in `SearchModel`.
        edge_points: Transposed, shape (3, Q).
        edge_start: As in `SearchModel`.
        edge_directions: As in `SearchModel`.
        strip_offsets: As in `SearchModel`.
    """

    inside_points: Array
    inside_start: IntArray
    inside_distances: Array
    nearest: Array
    side_centers: Array
    side_directions: Array
    edge_points: Array
    edge_start: IntArray
    edge_directions: Array
    strip_offsets: Array


class Rules(NamedTuple):
    """When a face and a point count: attributes of the same names of `MatchingParameters`."""

    min_cosine: float
    min_border_distance: float


class Scratch(NamedTuple):
    """Memory for points.

    Attributes:
        points: In the target's frame, shape (3, n).
        colors: The bits of the colors that count at each, shape (n,).
        pixels: The pixel that each falls on, or -1, shape (n,).
    """

    points: Array
    colors: Bits
    pixels: NDArray[np.int32]


class Placed(NamedTuple):
    """A solid at a pose before a camera K: X_KM, and the camera's position in the target's frame."""

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
def new_placed() -> Placed:
    """Memory for a `Placed`."""
    return Placed(np.empty((3, 3)), np.empty(3), np.empty(3))


@njit(cache=True, error_model="numpy")
def shown_colors(gate: ColorGate, red: int, green: int, blue: int) -> int:
    """The colors of an 8-bit pixel, one bit each."""
    places = gate.places
    return gate.table[places[0, red] + places[1, green] + places[2, blue]]  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def _find_pixels(scratch: Scratch, count: int, placed: Placed, eye: Eye) -> None:
    """Finds the pixels that the first ``count`` points fall on."""
    a, b, c, pixels = scratch.points[0], scratch.points[1], scratch.points[2], scratch.pixels
    lens = eye.lens
    R00, R01, R02 = placed.R[0]
    R10, R11, R12 = placed.R[1]
    R20, R21, R22 = placed.R[2]
    tx, ty, tz = placed.p
    right, below = float(eye.width), float(eye.height)
    width, nowhere = np.int32(eye.width), np.int32(-1)
    fx, fy, cu, cv = lens.fx, lens.fy, lens.cx + 0.5, lens.cy + 0.5
    # Eq. (13), (15), (17), (18); rounding finds the pixel, whose center is a whole number.
    if lens.model == NO_DISTORTION:
        for j in range(count):  # without branches, for the compiler to take several at once
            depth = R20 * a[j] + R21 * b[j] + R22 * c[j] + tz
            closeness = 1.0 / depth
            u = (R00 * a[j] + R01 * b[j] + R02 * c[j] + tx) * closeness * fx + cu
            v = (R10 * a[j] + R11 * b[j] + R12 * c[j] + ty) * closeness * fy + cv
            seen = (depth > 0.0) & (u >= 0.0) & (u < right) & (v >= 0.0) & (v < below)
            pixels[j] = np.int32(v) * width + np.int32(u) if seen else nowhere
        return
    for j in range(count):
        depth = R20 * a[j] + R21 * b[j] + R22 * c[j] + tz
        closeness = 1.0 / depth
        x = (R00 * a[j] + R01 * b[j] + R02 * c[j] + tx) * closeness
        y = (R10 * a[j] + R11 * b[j] + R12 * c[j] + ty) * closeness
        near = x * x + y * y <= lens.max_radius_squared
        x, y = distort(lens, x, y)
        u, v = x * fx + cu, y * fy + cv
        seen = near & (depth > 0.0) & (u >= 0.0) & (u < right) & (v >= 0.0) & (v < below)
        pixels[j] = np.int32(v) * width + np.int32(u) if seen else nowhere


@njit(cache=True, error_model="numpy")
def _count_matches(scratch: Scratch, start: int, stop: int, image: Image, gate: ColorGate) -> int:
    """Number of points that fall on a pixel of a color that counts: delta of Eq. (21)."""
    pixels, colors, places, table = scratch.pixels, scratch.colors, gate.places, gate.table
    matches = 0
    for j in range(start, stop):
        if pixels[j] >= 0:
            k = np.uint64(pixels[j])  # unsigned: without a check for an index from the end
            shown = table[places[0, image[k, 0]] + places[1, image[k, 1]] + places[2, image[k, 2]]]
            matches += (shown & colors[j]) != 0
    return matches


@njit(cache=True, error_model="numpy")
def _place_inside(
    visible: NDArray[np.bool_],
    scale: float,
    placed: Placed,
    solid: Solid,
    samples: Samples,
    scratch: Scratch,
) -> int:
    """Writes the points of S_in, Eq. (19), moved off their face's sides; returns their number.

    A point must lie ``scale`` off in normalized coordinates, which is
    `MatchingParameters.min_border_distance` in the image; where a face is seen obliquely, that is
    more on the face.
    """
    points, colors = scratch.points, scratch.colors
    inside_points, inside_distances = samples.inside_points, samples.inside_distances
    nearest, start = samples.nearest, samples.inside_start
    side_centers, side_directions = samples.side_centers, samples.side_directions
    normals, R, depth_0 = solid.normals, placed.R, placed.p[2]
    ox, oy, oz = placed.p_MK
    most_sides = inside_distances.shape[1]
    least, inward = np.empty(most_sides), np.empty((most_sides, 3))
    kept = 0
    for face in range(len(visible)):
        if not visible[face]:
            continue
        fx, fy, fz = normals[face, 0], normals[face, 1], normals[face, 2]
        for s in range(most_sides):
            a, b, c = side_centers[face, s, 0], side_centers[face, s, 1], side_centers[face, s, 2]
            sx, sy, sz = a - ox, b - oy, c - oz
            dx, dy, dz = (
                side_directions[face, s, 0],
                side_directions[face, s, 1],
                side_directions[face, s, 2],
            )
            nx, ny, nz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
            # Inward from the side in the face's plane: normal x direction.
            mx, my, mz = fy * dz - fz * dy, fz * dx - fx * dz, fx * dy - fy * dx
            inward[s, 0], inward[s, 1], inward[s, 2] = mx, my, mz
            norm = math.sqrt(nx * nx + ny * ny + nz * nz)
            across = abs(mx * nx + my * ny + mz * nz)
            depth = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + depth_0
            least[s] = scale * depth * norm / across if across > 0.0 else 0.0
        greatest = least.max()
        color = solid.colors[face]
        for j in range(start[face], start[face + 1]):
            a, b, c = inside_points[0, j], inside_points[1, j], inside_points[2, j]
            if nearest[j] < greatest:
                moved = 0.0
                for s in range(most_sides):
                    gap = max(0.0, least[s] - inside_distances[j, s])
                    moved += gap
                    a += gap * inward[s, 0]
                    b += gap * inward[s, 1]
                    c += gap * inward[s, 2]
                clear = True  # Where the face is too narrow, it now is beyond another side.
                if moved > 0.0:
                    for s in range(most_sides):
                        if inside_distances[j, s] < np.inf:
                            distance = (
                                (a - side_centers[face, s, 0]) * inward[s, 0]
                                + (b - side_centers[face, s, 1]) * inward[s, 1]
                                + (c - side_centers[face, s, 2]) * inward[s, 2]
                            )
                            clear = clear and distance > (1.0 - 1e-9) * least[s]
                if not clear:
                    continue
            points[0, kept], points[1, kept], points[2, kept] = a, b, c
            colors[kept] = color
            kept += 1
    return kept


@njit(cache=True, error_model="numpy")
def _place_strip(
    first: int,
    visible: NDArray[np.bool_],
    scale: float,
    placed: Placed,
    solid: Solid,
    samples: Samples,
    scratch: Scratch,
) -> int:
    """Writes the points of S_out, Eq. (20), from ``first`` on; returns where they end.

    They lie outside the silhouette. Any color of the model counts there, hidden faces' too.
    """
    points, colors = scratch.points, scratch.colors
    edge_points, edge_start = samples.edge_points, samples.edge_start
    edge_directions, edge_faces = samples.edge_directions, solid.edge_faces
    middle, R, depth_0 = solid.middle, placed.R, placed.p[2]
    ox, oy, oz = placed.p_MK
    any_color = np.uint32(0)
    for color in solid.colors:
        any_color |= color
    kept = first
    for k in range(len(edge_directions)):
        # The edges between a visible and a hidden face
        if visible[edge_faces[k, 0]] == visible[edge_faces[k, 1]]:
            continue
        # Perpendicular to the edge and to the line of sight (in M), away from the body.
        j0, j1 = edge_start[k], edge_start[k + 1]
        a, b, c = edge_points[0, j0], edge_points[1, j0], edge_points[2, j0]
        sx, sy, sz = a - ox, b - oy, c - oz
        dx, dy, dz = edge_directions[k, 0], edge_directions[k, 1], edge_directions[k, 2]
        nx, ny, nz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
        toward = nx * (middle[0] - a) + ny * (middle[1] - b) + nz * (middle[2] - c)
        norm = math.sqrt(nx * nx + ny * ny + nz * nz)
        if toward > 0.0:
            norm = -norm
        nx, ny, nz = nx / norm, ny / norm, nz / norm
        depth = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + depth_0
        for strip_offset in samples.strip_offsets:
            offset = max(strip_offset, scale * depth)
            for j in range(j0, j1):
                points[0, kept] = edge_points[0, j] + offset * nx
                points[1, kept] = edge_points[1, j] + offset * ny
                points[2, kept] = edge_points[2, j] + offset * nz
                colors[kept] = any_color
                kept += 1
    return kept


@njit(cache=True, error_model="numpy")
def find_visible(
    placed: Placed, solid: Solid, min_cosine: float, visible: NDArray[np.bool_]
) -> None:
    """Fills in which faces look at the camera."""
    ox, oy, oz = placed.p_MK
    normals, centers = solid.normals, solid.centers
    for k in range(len(normals)):
        dx, dy, dz = ox - centers[k, 0], oy - centers[k, 1], oz - centers[k, 2]
        cosine = normals[k, 0] * dx + normals[k, 1] * dy + normals[k, 2] * dz
        visible[k] = cosine > min_cosine * math.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, error_model="numpy")
def fitness_of_poses(poses: Array, scene: Scene, samples: Samples, rules: Rules) -> Array:
    """Fitness, Eq. (22), of pose vectors, shape (N, 6)."""
    solid = scene.solid
    visible = np.empty(len(solid.normals), dtype=np.bool_)
    most_points = (
        samples.inside_points.shape[1]
        + samples.edge_points.shape[1] * len(samples.strip_offsets)
    )
    scratch = Scratch(
        np.empty((3, most_points)),
        np.empty(most_points, dtype=np.uint32),
        np.empty(most_points, dtype=np.int32),
    )
    placed = new_placed()
    fitness = np.zeros(len(poses))
    for view in scene.views:
        eye = view.eye
        for i in range(len(poses)):
            place(rotation(poses[i, 3:]), poses[i, :3], eye, placed)
            find_visible(placed, solid, rules.min_cosine, visible)
            z = placed.p[2]
            pixels_a_unit = magnification(eye.lens, placed.p[0] / z, placed.p[1] / z)
            scale = (rules.min_border_distance + eye.calibration_error) / pixels_a_unit
            # Lambda of Eq. (21): the inside points of the visible faces
            count = _place_inside(visible, scale, placed, solid, samples, scratch)
            end = _place_strip(count, visible, scale, placed, solid, samples, scratch)
            _find_pixels(scratch, end, placed, eye)
            matches = _count_matches(scratch, 0, count, view.pixels, scene.gate)
            matches -= _count_matches(scratch, count, end, view.pixels, scene.gate)
            if count > 0 and matches > 0:
                fitness[i] += matches / count  # Eq. (21), at least zero
    return fitness / len(scene.views)  # Eq. (22)


@njit(cache=True, error_model="numpy")
def middle_shown(poses: Array, scene: Scene) -> IntArray:
    """In how many views a solid's middle falls on a pixel of one of its colors, shape (N,)."""
    shown = np.zeros(len(poses), dtype=np.int64)
    placed, middle = new_placed(), scene.solid.middle
    scratch = Scratch(np.empty((3, 1)), np.zeros(1, dtype=np.uint32), np.empty(1, dtype=np.int32))
    scratch.points[:, 0] = middle
    for color in scene.solid.colors:
        scratch.colors[0] |= color
    for view in scene.views:
        for i in range(len(poses)):
            place(rotation(poses[i, 3:]), poses[i, :3], view.eye, placed)
            _find_pixels(scratch, 1, placed, view.eye)
            shown[i] += _count_matches(scratch, 0, 1, view.pixels, scene.gate)
    return shown
