"""Compiled kernels (numba). Import this module only where they run: numba takes time to load."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Image = NDArray[np.uint8]

_SIXTY_DEGREES = math.pi / 3.0


@njit(cache=True)
def pixel_hue(
    red: np.uint8, green: np.uint8, blue: np.uint8, min_saturation: float, min_value: float
) -> float:
    """Hue [rad] of an 8-bit pixel, or -1 where saturation or value is too low to have one."""
    high = max(red, green, blue)
    low = min(red, green, blue)
    chroma = float(high) - float(low)
    if chroma <= 0.0 or chroma < min_saturation * high or high < 255.0 * min_value:
        return -1.0
    r, g, b = float(red), float(green), float(blue)
    if high == red:
        hue = (g - b) / chroma
        if hue < 0.0:
            hue += 6.0
    elif high == green:
        hue = 2.0 + (b - r) / chroma
    else:
        hue = 4.0 + (r - g) / chroma
    return _SIXTY_DEGREES * hue


@njit(cache=True)
def _has_hue(hue: float, wanted: float, tolerance: float) -> bool:
    """Whether a pixel's hue is within the tolerance of the wanted one, around the circle."""
    if hue < 0.0:
        return False
    difference = abs(hue - wanted)
    return min(difference, 2.0 * math.pi - difference) <= tolerance


@njit(cache=True)
def _hue_seen(
    image: Image,
    x: float,
    y: float,
    z: float,
    focal_length: float,
    min_saturation: float,
    min_value: float,
) -> float:
    """Hue [rad] of the pixel on which a point in a camera's frame falls, or -1 for none."""
    if z <= 0.0:
        return -1.0
    height, width = image.shape[0], image.shape[1]
    # Eq. (15), (17); rounding finds the pixel, whose center is a whole number.
    u = math.floor(focal_length * x / z + 0.5 * width)
    v = math.floor(focal_length * y / z + 0.5 * height)
    if u < 0 or u >= width or v < 0 or v >= height:
        return -1.0
    pixel = image[int(v), int(u)]
    hue: float = pixel_hue(pixel[0], pixel[1], pixel[2], min_saturation, min_value)
    return hue


@njit(cache=True)
def fitness_of_poses(
    poses: Array,
    image_right: Image,
    image_left: Image,
    focal_length: float,
    baseline: float,
    inside_points: Array,
    inside_start: IntArray,
    inside_distances: Array,
    side_centers: Array,
    side_directions: Array,
    normals: Array,
    centers: Array,
    hues: Array,
    edge_points: Array,
    edge_start: IntArray,
    edge_directions: Array,
    edge_faces: IntArray,
    strip_offsets: Array,
    body_center: Array,
    hue_tolerance: float,
    min_saturation: float,
    min_value: float,
    min_cosine: float,
    min_border_distance: float,
) -> Array:
    """Fitness (22) of many poses.

    The arguments are the attributes of the same names of `StereoCamera`, `SearchModel`,
    `SolidModel` and `MatchingParameters`.
    """
    num_faces, num_edges = len(normals), len(edge_directions)
    most_sides = inside_distances.shape[1]
    visible = np.empty(num_faces, dtype=np.bool_)
    least = np.zeros(most_sides)
    inward = np.zeros((most_sides, 3))
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
            image = image_right if camera == 0 else image_left
            # Eq. (16): the left camera sees everything shifted by the baseline.
            rx = x if camera == 0 else x + baseline
            # The camera's center in the target's frame tells which faces look at it.
            ox = -(R00 * rx + R10 * y + R20 * z)
            oy = -(R01 * rx + R11 * y + R21 * z)
            oz = -(R02 * rx + R12 * y + R22 * z)
            count = 0  # Lambda of Eq. (21): the inside points of the visible faces
            matches = 0
            for k in range(num_faces):
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
                    if across > 0.0:
                        least[s] = min_border_distance * depth * norm / (focal_length * across)
                    else:
                        least[s] = 0.0
                for j in range(inside_start[k], inside_start[k + 1]):
                    a, b, c = inside_points[j]
                    moved = False
                    for s in range(most_sides):
                        gap = least[s] - inside_distances[j, s]
                        if gap > 0.0:
                            a += gap * inward[s, 0]
                            b += gap * inward[s, 1]
                            c += gap * inward[s, 2]
                            moved = True
                    if moved:  # Where the face is too narrow, the point is now beyond another side.
                        clear = True
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
                    count += 1
                    hue = _hue_seen(
                        image,
                        R00 * a + R01 * b + R02 * c + rx,
                        R10 * a + R11 * b + R12 * c + y,
                        R20 * a + R21 * b + R22 * c + z,
                        focal_length, min_saturation, min_value,
                    )  # fmt: skip
                    if _has_hue(hue, hues[k], hue_tolerance):
                        matches += 1
            # The strip S_out: outside the edges between a visible and a hidden face.
            for k in range(num_edges):
                if visible[edge_faces[k, 0]] == visible[edge_faces[k, 1]]:
                    continue
                # Perpendicular to the edge and to the line of sight (in M), away from the body.
                a, b, c = edge_points[edge_start[k]]
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
                for j in range(edge_start[k], edge_start[k + 1]):
                    for strip_offset in strip_offsets:
                        offset = max(strip_offset, least_offset)
                        a = edge_points[j, 0] + offset * nx
                        b = edge_points[j, 1] + offset * ny
                        c = edge_points[j, 2] + offset * nz
                        hue = _hue_seen(
                            image,
                            R00 * a + R01 * b + R02 * c + rx,
                            R10 * a + R11 * b + R12 * c + y,
                            R20 * a + R21 * b + R22 * c + z,
                            focal_length, min_saturation, min_value,
                        )  # fmt: skip
                        # Any hue of the model, hidden faces' too, and once a point.
                        for wanted in hues:
                            if _has_hue(hue, wanted, hue_tolerance):
                                matches -= 1
                                break
            if count > 0 and matches > 0:
                total += matches / count  # Eq. (21), at least zero
        fitness[i] = 0.5 * total  # Eq. (22)
    return fitness
