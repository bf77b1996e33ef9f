"""The compiled fitness kernel (numba). Import only where it runs: numba takes time to load."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.camera.lens import (
    NO_DISTORTION,
    PLUMB_BOB,
    Eye,
    Image,
    distort,
    magnification,
    plumb_bob,
)
from mffdrake.recognition.fitness.structs import (
    ColorGate,
    Placed,
    Rules,
    Samples,
    Scene,
    Scratch,
    Solid,
    aspect_shown,
    in_camera,
    look_up,
    new_placed,
    place,
)
from mffdrake.recognition.poses.rotations import cross_product, rotation
from mffdrake.recognition.visibility.drawing import facing

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Flags = NDArray[np.bool_]
Pixels = NDArray[np.int32]
Point = tuple[float, float, float]

# For each pose: a call that is not inlined passes all of its tuples' arrays, some hundred numbers.
_inlined = njit(cache=True, error_model="numpy", inline="always")


@_inlined
def _projection(placed: Placed, eye: Eye) -> tuple[float, ...]:
    """X_KM row by row, twelve numbers; without distortion the first rows are in pixels already."""
    R, p = placed.R, placed.p
    fx, fy = (eye.lens.fx, eye.lens.fy) if eye.lens.model == NO_DISTORTION else (1.0, 1.0)
    return (
        fx * R[0, 0], fx * R[0, 1], fx * R[0, 2], fx * p[0],
        fy * R[1, 0], fy * R[1, 1], fy * R[1, 2], fy * p[1],
        R[2, 0], R[2, 1], R[2, 2], p[2],
    )  # fmt: skip


@_inlined
def _seen_at(projection: tuple[float, ...], a: float, b: float, c: float) -> Point:
    """Where a point is seen, and its depth, Eq. (13), (15)."""
    R00, R01, R02, tx, R10, R11, R12, ty, R20, R21, R22, tz = projection
    depth = R20 * a + R21 * b + R22 * c + tz
    closeness = 1.0 / depth
    x = (R00 * a + R01 * b + R02 * c + tx) * closeness
    y = (R10 * a + R11 * b + R12 * c + ty) * closeness
    return x, y, depth


@_inlined
def _pixel_at(u: float, v: float, seen: bool, eye: Eye) -> np.int32:
    """The pixel nearest to (u, v), which count from the principal point; -1 for none."""
    u, v = u + (eye.lens.cx + 0.5), v + (eye.lens.cy + 0.5)  # Eq. (17), (18)
    inside = (u >= 0.0) & (u < float(eye.width)) & (v >= 0.0) & (v < float(eye.height))
    return np.int32(v) * np.int32(eye.width) + np.int32(u) if seen & inside else np.int32(-1)


@_inlined
def _find_pixels(
    points: Array, start: int, stop: int, pixels: Pixels, projection: tuple[float, ...], eye: Eye
) -> None:
    """Finds the pixels that some of the points, of shape (3, n), fall on; -1 for none."""
    a, b, c = points[0, start:stop], points[1, start:stop], points[2, start:stop]
    lens = eye.lens
    # Eq. (13), (15), (17), (18), without branches: then the compiler takes several points at once
    if lens.model == NO_DISTORTION:
        for j in range(len(a)):
            u, v, depth = _seen_at(projection, a[j], b[j], c[j])
            pixels[j] = _pixel_at(u, v, depth > 0.0, eye)
    elif lens.model == PLUMB_BOB:
        for j in range(len(a)):
            x, y, depth = _seen_at(projection, a[j], b[j], c[j])
            near = (depth > 0.0) & (x * x + y * y <= lens.max_radius_squared)
            x, y = plumb_bob(lens.k, x, y)
            pixels[j] = _pixel_at(x * lens.fx, y * lens.fy, near, eye)
    else:
        for j in range(len(a)):
            x, y, depth = _seen_at(projection, a[j], b[j], c[j])
            near = (depth > 0.0) & (x * x + y * y <= lens.max_radius_squared)
            x, y = distort(lens, x, y)
            pixels[j] = _pixel_at(x * lens.fx, y * lens.fy, near, eye)


@_inlined
def _hide(pixels: Pixels, shown: Flags) -> int:
    """Takes out the points that another face hides; returns how many are left."""
    left, nowhere = 0, np.int32(-1)
    for j in range(len(shown)):
        pixels[j] = pixels[j] if shown[j] else nowhere
        left += shown[j]
    return left


@_inlined
def _count_matches(
    pixels: Pixels, count: int, color: np.uint32, image: Image, gate: ColorGate
) -> int:
    """Number of points that fall on a pixel of a color that counts: delta of Eq. (21)."""
    places, table = gate.places, gate.table
    matches = 0
    for j in range(count):
        if pixels[j] >= 0:
            k = np.uint64(pixels[j])  # unsigned: without a check for an index from the end
            shown = look_up(places, table, image[k, 0], image[k, 1], image[k, 2])
            matches += (shown & color) != 0
    return matches


class EdgePlane(NamedTuple):
    """The plane through an edge and the camera's center.

    Attributes:
        nx, ny, nz: A normal, in the target's frame; not of unit length.
        norm: Its length [m], which is the camera's distance from the edge's line.
        depth: Of a point on the edge [m].
    """

    nx: float
    ny: float
    nz: float
    norm: float
    depth: float


@njit(cache=True, error_model="numpy")
def _edge_plane(
    a: float, b: float, c: float, directions: Array, k: int, placed: Placed
) -> EdgePlane:
    """The plane of an edge through a point (a, b, c) of the target, along the k-th direction."""
    eye = placed.p_MK
    dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
    nx, ny, nz = cross_product(dx, dy, dz, a - eye[0], b - eye[1], c - eye[2])
    norm = math.sqrt(nx * nx + ny * ny + nz * nz)
    return EdgePlane(nx, ny, nz, norm, in_camera(placed, a, b, c)[2])


@_inlined
def _place_near(
    face: int, shown: Flags, scale: float, placed: Placed, samples: Samples, scratch: Scratch
) -> tuple[int, int]:
    """Writes a face's points near its sides, Eq. (19), moved off them.

    A point must lie ``scale`` off in normalized coordinates, which is
    `MatchingParameters.min_border_distance` in the image; where a face is seen obliquely, that is
    more on the face.

    Returns how many of them count, and the first of the points that are far enough off.
    """
    points = scratch.points
    inside_points, inside_distances = samples.inside_points, samples.inside_distances
    nearest, second, nearest_sides = samples.nearest, samples.second, samples.nearest_sides
    start, inside_sides = samples.inside_start, samples.inside_sides
    side_centers, side_directions = samples.side_centers, samples.side_directions
    face_sides, side_inward = samples.face_sides, samples.side_inward
    num_near = inside_distances.shape[1]
    least, inward = scratch.least, scratch.inward
    first = samples.face_sides_start[face]
    greatest = 0.0
    for s in range(samples.face_sides_start[face + 1] - first):
        side = face_sides[first + s]
        a, b, c = side_centers[side, 0], side_centers[side, 1], side_centers[side, 2]
        nx, ny, nz, norm, depth = _edge_plane(a, b, c, side_directions, side, placed)
        mx, my, mz = side_inward[side, 0], side_inward[side, 1], side_inward[side, 2]
        inward[s, 0], inward[s, 1], inward[s, 2] = mx, my, mz
        across = abs(mx * nx + my * ny + mz * nz)
        least[s] = scale * depth * norm / across if across > 0.0 else 0.0
        greatest = max(greatest, least[s])
    kept, j, stop = 0, start[face], start[face + 1]
    while j < stop and nearest[j] < greatest:  # These come first, each one's nearest side, too.
        a, b, c = inside_points[0, j], inside_points[1, j], inside_points[2, j]
        s = nearest_sides[j]
        moved, clear = max(0.0, least[s] - nearest[j]), shown[j]
        a += moved * inward[s, 0]
        b += moved * inward[s, 1]
        c += moved * inward[s, 2]
        # Most are near one side alone.
        k = 1 if second[j] < greatest + moved else num_near
        while k < num_near and inside_distances[j, k] < greatest:
            s = inside_sides[j, k]
            gap = least[s] - inside_distances[j, k]
            if gap > 0.0:
                moved += gap
                a += gap * inward[s, 0]
                b += gap * inward[s, 1]
                c += gap * inward[s, 2]
            k += 1
        k = 0 if second[j] < greatest + moved else num_near
        # Where the face is too narrow, it now is beyond another side.
        while k < num_near and inside_distances[j, k] < greatest + moved:
            s = inside_sides[j, k]
            if inside_distances[j, k] < least[s] + moved:  # else it still is clear
                side = face_sides[first + s]
                distance = (
                    (a - side_centers[side, 0]) * inward[s, 0]
                    + (b - side_centers[side, 1]) * inward[s, 1]
                    + (c - side_centers[side, 2]) * inward[s, 2]
                )
                clear = clear and distance > (1.0 - 1e-9) * least[s]
            k += 1
        # The next one overwrites what does not count.
        points[0, kept], points[1, kept], points[2, kept] = a, b, c
        kept += clear
        j += 1
    return kept, j


@_inlined
def _place_strip(
    aspect: int,
    visible: Flags,
    scale: float,
    placed: Placed,
    samples: Samples,
    scratch: Scratch,
) -> int:
    """Writes the points of S_out, Eq. (20), outside the silhouette; returns how many there are."""
    points = scratch.points
    edge_points, edge_directions = samples.edge_points, samples.edge_directions
    edge_faces, edge_inward = samples.edge_faces, samples.edge_inward
    visibility, offsets = samples.visibility, samples.strip_offsets
    counted, rows = visibility.points, visibility.rows
    kept = 0
    for entry in range(visibility.edges_start[aspect], visibility.edges_start[aspect + 1]):
        # The edges between a visible and a hidden face
        k = visibility.edges[entry]
        inner = 0 if visible[edge_faces[k, 0]] else 1
        if visible[edge_faces[k, 0]] == visible[edge_faces[k, 1]]:
            continue
        # Perpendicular to the edge and to the line of sight (in M), away from the visible face.
        j0, j1 = visibility.points_start[entry], visibility.points_start[entry + 1]
        q = counted[j0]
        a, b, c = edge_points[0, q], edge_points[1, q], edge_points[2, q]
        nx, ny, nz, norm, depth = _edge_plane(a, b, c, edge_directions, k, placed)
        m = edge_inward[k, inner]
        toward = nx * m[0] + ny * m[1] + nz * m[2]
        if toward > 0.0:
            norm = -norm
        nx, ny, nz = nx / norm, ny / norm, nz / norm
        for j in range(j0, j1):
            q, counts = counted[j], rows[j]
            a, b, c = edge_points[0, q], edge_points[1, q], edge_points[2, q]
            for row in range(len(offsets)):
                if (counts >> row) & 1:
                    offset = max(offsets[row], scale * depth)
                    points[0, kept] = a + offset * nx
                    points[1, kept] = b + offset * ny
                    points[2, kept] = c + offset * nz
                    kept += 1
    return kept


@njit(cache=True, error_model="numpy")
def find_visible(
    faces: IntArray, placed: Placed, solid: Solid, min_cosine: float, visible: Flags
) -> None:
    """Fills in which of some faces look at the camera."""
    normals, centers, eye = solid.normals, solid.centers, placed.p_MK
    for k in faces:
        toward, squared = facing(normals, centers, k, eye)
        visible[k] = toward > min_cosine * math.sqrt(squared)


@njit(cache=True, error_model="numpy")
def fitness_of_poses(poses: Array, scene: Scene, samples: Samples, rules: Rules) -> Array:
    """Fitness, Eq. (22), of pose vectors, shape (N, 6)."""
    solid, visibility = scene.solid, samples.visibility
    inside_points, start = samples.inside_points, samples.inside_start
    visible = np.empty(len(solid.normals), dtype=np.bool_)
    strip = samples.edge_points.shape[1] * len(samples.strip_offsets)
    most_points = max(inside_points.shape[1], strip) + 1  # and a place for one that does not count
    scratch = Scratch(
        np.empty((3, most_points)),
        np.empty(most_points, dtype=np.int32),
        np.empty(samples.most_sides),
        np.empty((samples.most_sides, 3)),
    )
    pixels = scratch.pixels
    placed = new_placed()
    fitness = np.zeros(len(poses))
    for view in scene.views:
        image, eye = view.pixels, view.eye
        for i in range(len(poses)):
            place(rotation(poses[i, 3:]), poses[i, :3], eye, placed)
            aspect = aspect_shown(placed, solid.middle, visibility.grid)
            first, last = visibility.faces_start[aspect], visibility.faces_start[aspect + 1]
            faces, shown = visibility.faces[first:last], visibility.shown[aspect]
            find_visible(faces, placed, solid, rules.min_cosine, visible)
            z = placed.p[2]
            pixels_a_unit = magnification(eye.lens, placed.p[0] / z, placed.p[1] / z)
            scale = (rules.min_border_distance + eye.calibration_error) / pixels_a_unit
            projection = _projection(placed, eye)
            count, matches = 0, 0  # Lambda of Eq. (21): the inside points of the visible faces
            for face in faces:
                if visible[face]:
                    near, j = _place_near(face, shown, scale, placed, samples, scratch)
                    far = shown[j : start[face + 1]]
                    _find_pixels(scratch.points, 0, near, pixels, projection, eye)
                    _find_pixels(inside_points, j, start[face + 1], pixels[near:], projection, eye)
                    count += near + _hide(pixels[near:], far)
                    matches += _count_matches(
                        pixels, near + len(far), solid.colors[face], image, scene.gate
                    )
            # Any color of the model counts outside the silhouette, hidden faces' too.
            end = _place_strip(aspect, visible, scale, placed, samples, scratch)
            _find_pixels(scratch.points, 0, end, pixels, projection, eye)
            matches -= _count_matches(pixels, end, solid.all_colors, image, scene.gate)
            if count > 0 and matches > 0:
                fitness[i] += matches / count  # Eq. (21), at least zero
    return fitness / len(scene.views)  # Eq. (22)


@njit(cache=True, error_model="numpy")
def middle_shown(poses: Array, scene: Scene) -> IntArray:
    """In how many views a solid's middle falls on a pixel of one of its colors, shape (N,)."""
    shown = np.zeros(len(poses), dtype=np.int64)
    placed, pixels = new_placed(), np.empty(1, dtype=np.int32)
    middle, color = scene.solid.middle.reshape(3, 1), scene.solid.all_colors
    for view in scene.views:
        for i in range(len(poses)):
            place(rotation(poses[i, 3:]), poses[i, :3], view.eye, placed)
            _find_pixels(middle, 0, 1, pixels, _projection(placed, view.eye), view.eye)
            shown[i] += _count_matches(pixels, 1, color, view.pixels, scene.gate)
    return shown
