"""What is seen of a solid from many sides, by drawing it (numba). Import only where it runs.

Directions from a solid's middle to a camera are told apart by an octahedron that is unfolded to a
square of ``grid x grid`` fields; a field is an *aspect*. With a grid of 0 there is one for all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.poses.rotations import rotated

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
States = NDArray[np.uint32]

CONTOUR, CREASE, FREE, HIDDEN, FIRST_ROW = 1, 2, 4, 8, 16
"""What an edge's point is: between a visible and a hidden face, or between two visible ones; seen,
with the face, and nothing else of its color behind it; and, from the last bit on, whether each row
of the strip lies outside the solid there. What is no border, as a crease of one color, is nothing;
but where it nearly is a contour and something hides it."""

_RESOLUTION = 192  # pixels across
_DISTANCE = 3.0  # of the camera from the solid, in sizes of it
_BESIDE = 1.5  # pixels: so far from an edge its face and what is behind it are looked at
_DEPTH_TOLERANCE = 3.0  # pixels
_BENT = 6.0  # times that, for a surface that bends away
_NEARLY = 0.26  # sine of the angle from corner to corner of an aspect


class Drawn(NamedTuple):
    """A solid to be drawn.

    Attributes:
        vertices: Corner points [m], shape (V, 3).
        triangles: Their corners, shape (T, 3).
        triangle_faces: The face of each, shape (T,).
        patches: The smooth surface that each face is a part of, shape (F,).
        normals: Of the faces, shape (F, 3).
        centers: Of the faces [m], shape (F, 3).
        middle: The point that all cameras look at [m], shape (3,).
        radius: That of the ball about it that holds the solid [m].
    """

    vertices: Array
    triangles: IntArray
    triangle_faces: IntArray
    patches: IntArray
    normals: Array
    centers: Array
    middle: Array
    radius: float


class Marks(NamedTuple):
    """Points of a solid.

    Attributes:
        inside: Points on faces [m], shape (P, 3).
        inside_faces: Their faces, shape (P,).
        edges: Points on edges [m], shape (Q, 3).
        directions: Unit vectors along the edges there, shape (Q, 3).
        edge_faces: The two faces of the edges there, shape (Q, 2).
        inward: Unit vectors into them, across the edge, shape (Q, 2, 3).
        offsets: Distances of the strip's rows [m], shape (K,).
        kinds: Numbers of all faces' materials, shape (F,).
        alike: Which materials look alike, shape (C, C).
    """

    inside: Array
    inside_faces: IntArray
    edges: Array
    directions: Array
    edge_faces: IntArray
    inward: Array
    offsets: Array
    kinds: IntArray
    alike: NDArray[np.bool_]


@njit(cache=True, error_model="numpy")
def aspect_of(x: float, y: float, z: float, grid: int) -> int:
    """The aspect of a direction."""
    if grid == 0:
        return 0
    total = abs(x) + abs(y) + abs(z)
    u, v = x / total, y / total
    if z < 0.0:
        u, v = (
            (1.0 - abs(v)) * (1.0 if u >= 0.0 else -1.0),
            (1.0 - abs(u)) * (1.0 if v >= 0.0 else -1.0),
        )
    i = min(grid - 1, max(0, int(0.5 * (u + 1.0) * grid)))
    j = min(grid - 1, max(0, int(0.5 * (v + 1.0) * grid)))
    return i * grid + j


@njit(cache=True, error_model="numpy")
def corner_direction(i: int, j: int, grid: int) -> Array:
    """The direction at a corner of the aspects, i and j from 0 to grid; a unit vector."""
    u, v = 2.0 * i / grid - 1.0, 2.0 * j / grid - 1.0
    z = 1.0 - abs(u) - abs(v)
    x, y = u, v
    if z < 0.0:
        x = (1.0 - abs(v)) * (1.0 if u >= 0.0 else -1.0)
        y = (1.0 - abs(u)) * (1.0 if v >= 0.0 else -1.0)
    direction = np.array([x, y, z])
    return direction / math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def facing(normals: Array, centers: Array, face: int, eye: Array) -> tuple[float, float]:
    """How a face looks at a camera: its normal times the way to the camera, and that way squared.

    The first is positive where it looks toward the camera.
    """
    dx = eye[0] - centers[face, 0]
    dy = eye[1] - centers[face, 1]
    dz = eye[2] - centers[face, 2]
    toward = normals[face, 0] * dx + normals[face, 1] * dy + normals[face, 2] * dz
    return toward, dx * dx + dy * dy + dz * dz


class Canvas(NamedTuple):
    """What is drawn: inverse depth [1/m] and face of each pixel, -1 for none, shape (n, n)."""

    closeness: Array
    faces: IntArray


class Camera(NamedTuple):
    """Where it is.

    Attributes:
        axes: Its axes in the solid's frame as rows; the last one is the line of sight.
        place: Its place [m].
        focal: Its focal length [px].
    """

    axes: Array
    place: Array
    focal: float


@njit(cache=True, error_model="numpy")
def camera_at(direction: Array, drawn: Drawn, distance: float, resolution: int) -> Camera:
    """A camera that looks at a solid's middle from a direction."""
    axes = np.empty((3, 3))
    axes[2] = -direction
    least = np.argmin(np.abs(direction))
    across = np.zeros(3)
    across[least] = 1.0
    axes[0] = np.cross(across, axes[2])
    axes[0] /= math.sqrt((axes[0] ** 2).sum())
    axes[1] = np.cross(axes[2], axes[0])
    tangent = drawn.radius / math.sqrt(distance**2 - drawn.radius**2)
    return Camera(axes, drawn.middle + distance * direction, 0.49 * resolution / tangent)


@njit(cache=True, error_model="numpy")
def project(camera: Camera, point: Array, half: float) -> tuple[float, float, float]:
    """Pixel coordinates and depth [m] of a point; pixel centers are whole numbers."""
    dx, dy, dz = (
        point[0] - camera.place[0], point[1] - camera.place[1], point[2] - camera.place[2]
    )  # fmt: skip
    x, y, z = rotated(camera.axes, dx, dy, dz)
    return camera.focal * x / z + half - 0.5, camera.focal * y / z + half - 0.5, z


@njit(cache=True, error_model="numpy")
def draw(camera: Camera, drawn: Drawn, canvas: Canvas) -> None:
    """Draws all triangles that face the camera."""
    n = len(canvas.faces)
    half = 0.5 * n
    canvas.closeness[:] = 0.0
    canvas.faces[:] = -1
    seen = np.empty((len(drawn.vertices), 3))
    for k in range(len(seen)):
        seen[k] = project(camera, drawn.vertices[k], half)
    for t in range(len(drawn.triangles)):
        a, b, c = drawn.triangles[t]
        ax, ay, az = seen[a]
        bx, by, bz = seen[b]
        cx, cy, cz = seen[c]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        # Counterclockwise seen from outside is clockwise in an image with y downward.
        if area >= 0.0:
            continue
        left, right = max(0, math.ceil(min(ax, bx, cx))), min(n - 1, math.floor(max(ax, bx, cx)))
        top, bottom = max(0, math.ceil(min(ay, by, cy))), min(n - 1, math.floor(max(ay, by, cy)))
        face = drawn.triangle_faces[t]
        ab, bc, ca = (bx - ax) / (by - ay), (cx - bx) / (cy - by), (ax - cx) / (ay - cy)
        for y in range(int(top), int(bottom) + 1):
            # Where the triangle's sides cross the row, and one pixel more
            low, high = 1e9, -1e9
            if (ay <= y) != (by <= y):
                low = high = ax + (y - ay) * ab
            if (by <= y) != (cy <= y):
                x = bx + (y - by) * bc
                low, high = min(low, x), max(high, x)
            if (cy <= y) != (ay <= y):
                x = cx + (y - cy) * ca
                low, high = min(low, x), max(high, x)
            first, last = max(left, math.floor(low) - 1), min(right, math.ceil(high) + 1)
            for x in range(int(first), int(last) + 1):
                wa = (bx - x) * (cy - y) - (by - y) * (cx - x)
                wb = (cx - x) * (ay - y) - (cy - y) * (ax - x)
                wc = (ax - x) * (by - y) - (ay - y) * (bx - x)
                if wa <= 0.0 and wb <= 0.0 and wc <= 0.0:
                    closeness = (wa / az + wb / bz + wc / cz) / area
                    if closeness > canvas.closeness[y, x]:
                        canvas.closeness[y, x], canvas.faces[y, x] = closeness, face


@njit(cache=True, error_model="numpy")
def is_seen(camera: Camera, canvas: Canvas, drawn: Drawn, point: Array, face: int) -> bool:
    """Whether a point of a face that looks at the camera is hidden by nothing."""
    n = len(canvas.faces)
    u, v, z = project(camera, point, 0.5 * n)
    x, y = math.floor(u + 0.5), math.floor(v + 0.5)
    tolerance = _DEPTH_TOLERANCE * z / camera.focal
    for i in range(max(0, y - 1), min(n, y + 2)):
        for j in range(max(0, x - 1), min(n, x + 2)):
            there = canvas.faces[i, j]
            if there < 0:
                continue
            depth = 1.0 / canvas.closeness[i, j]
            if depth > z - tolerance:
                return True
            # A surface that is seen obliquely is much nearer or farther beside the point.
            near = drawn.patches[there] == drawn.patches[face] and depth > z - _BENT * tolerance
            if there == face or near:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _face_at(camera: Camera, canvas: Canvas, x: float, y: float, z: float) -> int:
    """The face that is drawn where a point is, -1 for none."""
    n = len(canvas.faces)
    u, v, _ = project(camera, np.array([x, y, z]), 0.5 * n)
    i, j = math.floor(v + 0.5), math.floor(u + 0.5)
    if not (0 <= i < n and 0 <= j < n):
        return -1
    return canvas.faces[i, j]  # type: ignore[no-any-return]


class Survey(NamedTuple):
    """What is seen from the corners of all aspects, N of them.

    Attributes:
        hidden: Which inside points are hidden though their face looks at the camera, shape (N, P).
        states: The states of the edges' points, shape (N, Q).
        facing: Which faces look at the camera, shape (N, F).
    """

    hidden: NDArray[np.bool_]
    states: States
    facing: NDArray[np.bool_]


@njit(cache=True, error_model="numpy", nogil=True)
def survey_row(grid: int, row: int, drawn: Drawn, marks: Marks, survey: Survey) -> None:
    """Finds out what is seen from a row of the aspects' corners."""
    hidden, states, looks = survey
    canvas = Canvas(
        np.empty((_RESOLUTION, _RESOLUTION)),
        np.empty((_RESOLUTION, _RESOLUTION), dtype=np.int64),
    )
    size = 2.0 * drawn.radius
    for k in range(row * (grid + 1), (row + 1) * (grid + 1)):
        direction = corner_direction(k // (grid + 1), k % (grid + 1), grid)
        camera = camera_at(direction, drawn, _DISTANCE * size, _RESOLUTION)
        draw(camera, drawn, canvas)
        eye = camera.place
        for f in range(len(drawn.normals)):
            looks[k, f] = facing(drawn.normals, drawn.centers, f, eye)[0] > 0.0
        for p in range(len(marks.inside)):
            face = marks.inside_faces[p]
            if looks[k, face]:
                hidden[k, p] = not is_seen(camera, canvas, drawn, marks.inside[p], face)
        for q in range(len(marks.edges)):
            states[k, q] = _edge_state(camera, canvas, drawn, marks, q, looks[k])


@njit(cache=True, error_model="numpy")
def _edge_state(
    camera: Camera,
    canvas: Canvas,
    drawn: Drawn,
    marks: Marks,
    q: int,
    looks: NDArray[np.bool_],
) -> int:
    """The state of a point on an edge."""
    first, second = marks.edge_faces[q]
    if not (looks[first] or looks[second]):
        return 0
    crease = looks[first] and looks[second]
    point, eye = marks.edges[q], camera.place
    if crease and marks.alike[marks.kinds[first], marks.kinds[second]]:
        toward, apart = 0.0, 0.0
        for axis in range(3):
            toward += drawn.normals[first, axis] * (eye[axis] - point[axis])
            apart += (eye[axis] - point[axis]) ** 2
        if toward * toward > _NEARLY**2 * apart or is_seen(camera, canvas, drawn, point, first):
            return 0
        return HIDDEN
    state = CREASE
    inside = first
    if not crease:
        state = CONTOUR
        inside = first if looks[first] else second
    else:
        best = -1.0
        for face in (first, second):
            toward = 0.0
            for axis in range(3):
                toward += drawn.normals[face, axis] * (eye[axis] - point[axis])
            if toward > best:
                best, inside = toward, face
    m = marks.inward[q, 0] if inside == first else marks.inward[q, 1]
    depth = 0.0
    for axis in range(3):
        depth += camera.axes[2, axis] * (point[axis] - eye[axis])
    pixel = depth / camera.focal
    # Across the edge as it is seen, away from the face
    n = np.cross(marks.directions[q], point - eye)
    n /= math.sqrt((n**2).sum())
    if (n * m).sum() > 0.0:
        n = -n
    if not is_seen(camera, canvas, drawn, point + _BESIDE * pixel * m, inside):
        return state
    if state == CREASE:
        return state | FREE
    beyond = point + (1.0 + _BESIDE) * pixel * n
    behind = _face_at(camera, canvas, beyond[0], beyond[1], beyond[2])
    if behind < 0 or not marks.alike[marks.kinds[inside], marks.kinds[behind]]:
        state |= FREE
    for k in range(len(marks.offsets)):
        row = point + max(marks.offsets[k], (1.0 + _BESIDE) * pixel) * n
        if _face_at(camera, canvas, row[0], row[1], row[2]) < 0:
            state |= FIRST_ROW << k
    return state
