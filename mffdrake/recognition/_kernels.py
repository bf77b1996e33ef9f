"""The compiled fitness kernel (numba). Import only where it runs: numba takes time to load."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Image = NDArray[np.uint8]
Pose: TypeAlias = tuple[float, ...]
"""A rotation matrix, row by row, and a position: twelve numbers."""


@njit(cache=True, error_model="numpy")
def _shows_hue(
    red: np.uint8,
    green: np.uint8,
    blue: np.uint8,
    hues: Array,
    hue_tolerance: float,
    min_saturation: float,
    min_value: float,
) -> bool:
    """Whether an 8-bit pixel has one of some hues: delta of Eq. (21), with a tolerance.

    Hues and their tolerance are in sixths of the color circle. Everything is multiplied by the
    pixel's chroma, which spares the division.
    """
    high = float(max(red, green, blue))
    chroma = high - float(min(red, green, blue))
    if chroma <= 0.0 or chroma < min_saturation * high or high < 255.0 * min_value:
        return False
    r, g, b = float(red), float(green), float(blue)
    if high == r:
        hue = g - b
    elif high == g:
        hue = 2.0 * chroma + b - r
    else:
        hue = 4.0 * chroma + r - g
    for wanted in hues:
        difference = abs(hue - wanted * chroma)
        # Around the circle
        if min(difference, abs(6.0 * chroma - difference)) <= hue_tolerance * chroma:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _count_matches(
    a: Array,
    b: Array,
    c: Array,
    pose: Pose,
    pixels: Image,
    width: int,
    height: int,
    focal_length: float,
    hues: Array,
    hue_tolerance: float,
    min_saturation: float,
    min_value: float,
    scratch: IntArray,
) -> int:
    """Number of points (a, b, c) in the target's frame that fall on a pixel of one of some hues."""
    R00, R01, R02, R10, R11, R12, R20, R21, R22, x, y, z = pose
    for j in range(len(a)):  # without branches, for the compiler to take several points at once
        depth = R20 * a[j] + R21 * b[j] + R22 * c[j] + z
        scale = focal_length / depth
        # Eq. (13), (15), (17), (18); rounding finds the pixel, whose center is a whole number.
        u = math.floor((R00 * a[j] + R01 * b[j] + R02 * c[j] + x) * scale + 0.5 * width)
        v = math.floor((R10 * a[j] + R11 * b[j] + R12 * c[j] + y) * scale + 0.5 * height)
        seen = (depth > 0.0) & (u >= 0.0) & (u < width) & (v >= 0.0) & (v < height)
        scratch[j] = int(v * width + u) if seen else -1
    matches = 0
    for j in range(len(a)):
        if scratch[j] >= 0:
            pixel = pixels[scratch[j]]
            matches += _shows_hue(
                pixel[0], pixel[1], pixel[2], hues, hue_tolerance, min_saturation, min_value
            )
    return matches


@njit(cache=True, error_model="numpy")
def fitness_of_poses(
    poses: Array,
    pixels_right: Image,
    pixels_left: Image,
    width: int,
    height: int,
    focal_length: float,
    baseline: float,
    inside_points: Array,
    inside_start: IntArray,
    inside_distances: Array,
    nearest: Array,
    side_centers: Array,
    side_directions: Array,
    normals: Array,
    centers: Array,
    face_hues: Array,
    edge_points: Array,
    edge_start: IntArray,
    edge_directions: Array,
    edge_faces: IntArray,
    strip_offsets: Array,
    body_center: Array,
    model_hues: Array,
    hue_tolerance: float,
    min_saturation: float,
    min_value: float,
    min_cosine: float,
    min_border_distance: float,
) -> Array:
    """Fitness, Eq. (22), of many poses.

    The arguments are the attributes of the same names of `StereoCamera`, `SearchModel`,
    `SolidModel` and `MatchingParameters`, but for these: images are lists of pixels, shape
    (height * width, 3 or 4); the points are transposed, shape (3, number), and ``nearest`` is each
    one's distance to the nearest side; ``model_hues`` are the hues that occur, ``face_hues`` those
    of the faces; hues are in sixths of the color circle.
    """
    num_faces, num_edges = len(normals), len(edge_directions)
    most_sides = inside_distances.shape[1]
    visible = np.empty(num_faces, dtype=np.bool_)
    least = np.zeros(most_sides)
    inward = np.zeros((most_sides, 3))
    most_points = max(inside_points.shape[1], edge_points.shape[1] * len(strip_offsets))
    moved = np.empty((3, most_points))
    scratch = np.empty(most_points, dtype=np.int64)
    fitness = np.zeros(len(poses))
    for i in range(len(poses)):
        x, y, z, e1, e2, e3 = poses[i]
        eta = math.sqrt(max(0.0, 1.0 - e1 * e1 - e2 * e2 - e3 * e3))
        R00, R01, R02 = (
            1 - 2 * (e2 * e2 + e3 * e3),
            2 * (e1 * e2 - eta * e3),
            2 * (e1 * e3 + eta * e2),
        )
        R10, R11, R12 = (
            2 * (e1 * e2 + eta * e3),
            1 - 2 * (e1 * e1 + e3 * e3),
            2 * (e2 * e3 - eta * e1),
        )
        R20, R21, R22 = (
            2 * (e1 * e3 - eta * e2),
            2 * (e2 * e3 + eta * e1),
            1 - 2 * (e1 * e1 + e2 * e2),
        )
        total = 0.0
        for camera in range(2):
            pixels = pixels_right if camera == 0 else pixels_left
            # Eq. (16): the left camera sees everything shifted by the baseline.
            rx = x if camera == 0 else x + baseline
            pose = (R00, R01, R02, R10, R11, R12, R20, R21, R22, rx, y, z)
            # The camera's center in the target's frame tells which faces look at it.
            ox = -(R00 * rx + R10 * y + R20 * z)
            oy = -(R01 * rx + R11 * y + R21 * z)
            oz = -(R02 * rx + R12 * y + R22 * z)
            count = 0  # Lambda of Eq. (21): the inside points of the visible faces
            matches = 0
            for k in range(num_faces):  # Eq. (19): those that are visible
                dx, dy, dz = ox - centers[k, 0], oy - centers[k, 1], oz - centers[k, 2]
                cosine = normals[k, 0] * dx + normals[k, 1] * dy + normals[k, 2] * dz
                visible[k] = cosine > min_cosine * math.sqrt(dx * dx + dy * dy + dz * dz)
                if not visible[k]:
                    continue
                # How far from each side [m] a point must lie to be min_border_distance [px] off
                # in the image, where a face seen obliquely is foreshortened.
                for s in range(most_sides):
                    a, b, c = side_centers[k, s]
                    sx, sy, sz = a - ox, b - oy, c - oz
                    dx, dy, dz = side_directions[k, s]
                    nx, ny, nz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
                    # Inward from the side in the face's plane: normal x direction.
                    fx, fy, fz = normals[k]
                    mx, my, mz = fy * dz - fz * dy, fz * dx - fx * dz, fx * dy - fy * dx
                    inward[s, 0], inward[s, 1], inward[s, 2] = mx, my, mz
                    norm = math.sqrt(nx * nx + ny * ny + nz * nz)
                    across = abs(mx * nx + my * ny + mz * nz)
                    depth = R20 * a + R21 * b + R22 * c + z
                    least[s] = 0.0
                    if across > 0.0:
                        least[s] = min_border_distance * depth * norm / (focal_length * across)
                greatest = least.max()
                kept = 0
                for j in range(inside_start[k], inside_start[k + 1]):
                    a, b, c = inside_points[0, j], inside_points[1, j], inside_points[2, j]
                    if nearest[j] < greatest:
                        for s in range(most_sides):
                            gap = max(0.0, least[s] - inside_distances[j, s])
                            a += gap * inward[s, 0]
                            b += gap * inward[s, 1]
                            c += gap * inward[s, 2]
                        clear = True  # Where the face is too narrow, it now is beyond another side.
                        for s in range(most_sides):
                            if inside_distances[j, s] < np.inf:
                                distance = (
                                    (a - side_centers[k, s, 0]) * inward[s, 0]
                                    + (b - side_centers[k, s, 1]) * inward[s, 1]
                                    + (c - side_centers[k, s, 2]) * inward[s, 2]
                                )
                                clear = clear and distance > (1.0 - 1e-9) * least[s]
                        if not clear:
                            continue
                    moved[0, kept], moved[1, kept], moved[2, kept] = a, b, c
                    kept += 1
                count += kept
                matches += _count_matches(
                    moved[0, :kept], moved[1, :kept], moved[2, :kept], pose,
                    pixels, width, height, focal_length,
                    face_hues[k : k + 1], hue_tolerance, min_saturation, min_value, scratch,
                )  # fmt: skip
            # The strip S_out, Eq. (20): outside the edges between a visible and a hidden face.
            kept = 0
            for k in range(num_edges):
                if visible[edge_faces[k, 0]] == visible[edge_faces[k, 1]]:
                    continue
                # Perpendicular to the edge and to the line of sight (in M), away from the body.
                first = edge_start[k]
                a, b, c = edge_points[0, first], edge_points[1, first], edge_points[2, first]
                sx, sy, sz = a - ox, b - oy, c - oz
                dx, dy, dz = edge_directions[k]
                nx, ny, nz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
                toward = (
                    nx * (body_center[0] - a)
                    + ny * (body_center[1] - b)
                    + nz * (body_center[2] - c)
                )
                norm = math.sqrt(nx * nx + ny * ny + nz * nz)
                if toward > 0.0:
                    norm = -norm
                nx, ny, nz = nx / norm, ny / norm, nz / norm
                depth = R20 * a + R21 * b + R22 * c + z
                least_offset = min_border_distance * depth / focal_length
                for strip_offset in strip_offsets:
                    offset = max(strip_offset, least_offset)
                    for j in range(edge_start[k], edge_start[k + 1]):
                        moved[0, kept] = edge_points[0, j] + offset * nx
                        moved[1, kept] = edge_points[1, j] + offset * ny
                        moved[2, kept] = edge_points[2, j] + offset * nz
                        kept += 1
            # Any hue of the model, hidden faces' too, and once a point.
            matches -= _count_matches(
                moved[0, :kept], moved[1, :kept], moved[2, :kept], pose,
                pixels, width, height, focal_length,
                model_hues, hue_tolerance, min_saturation, min_value, scratch,
            )  # fmt: skip
            if count > 0 and matches > 0:
                total += matches / count  # Eq. (21), at least zero
        fitness[i] = 0.5 * total  # Eq. (22)
    return fitness
