"""Compiled kernels that draw triangles with a depth buffer (numba: import where they run).

Sampling is at pixel centers: pixel (i, j) shows the point (i + 0.5, j + 0.5) of the plane in which
`CameraInfo` has its focal lengths and principal point. A pixel center on an edge that two triangles
share belongs to exactly one of them. Depth is kept as 1 / z, which is linear in the image.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Floats = NDArray[np.float32]
Point = tuple[float, float, float]
Rectangle = tuple[int, int, int, int]

_HIDDEN, _WHOLE, _CUT = 0, 1, 2  # out of view; before the near plane; cut by it
_ROW_STEP = 32  # pixels between the rows that are looked at


class Surfaces(NamedTuple):
    """All geometries, one after the other.

    Attributes:
        vertices: In each geometry's own frame G [m], shape (V, 3).
        vertex_start: Where each geometry's vertices start, shape (G + 1,).
        triangles: Indices of three vertices, counterclockwise seen from outside, shape (T, 3).
        triangle_start: Where each geometry's triangles start, shape (G + 1,).
        spheres: Center x, y, z and radius of a sphere around each geometry [m], shape (G, 4).
        closed: Whether each geometry's back faces are hidden behind its front, shape (G,).
    """

    vertices: Array
    vertex_start: IntArray
    triangles: IntArray
    triangle_start: IntArray
    spheres: Array
    closed: NDArray[np.bool_]


class Lens(NamedTuple):
    """Pinhole intrinsics [px] and the depths between which things are drawn [m]."""

    focal_x: float
    focal_y: float
    center_x: float
    center_y: float
    near: float
    far: float


@njit(cache=True)
def draw(
    surfaces: Surfaces,
    X_WGs: Array,
    X_WC: Array,
    lens: Lens,
    paint: NDArray[Any] | None,
    unpainted: int,
    background: int,
    inverse_depth: Floats,
    image: NDArray[Any] | None,
    before: Rectangle,
) -> Rectangle:
    """Draws all geometries as a camera sees them.

    Args:
        surfaces: The geometries.
        X_WGs: Their poses in the world, shape (G, 3, 4).
        X_WC: The camera's pose in the world, shape (3, 4).
        lens: The camera's intrinsics.
        paint: The value of each triangle in the image, shape (T,).
        unpainted: Triangles of this value are left out.
        background: The value where nothing is drawn.
        inverse_depth: Receives 1 / z [1/m], or 1 / far where nothing is drawn, but only inside the
            returned rectangle. Shape (height, width).
        image: Receives the values; shape (height, width). None, with ``paint`` None, draws depth
            alone.
        before: What this function returned when it last drew on this very image. The whole image is
            drawn again only where that has visibly changed since.

    Returns:
        The columns ``i0 <= i < i1`` and rows ``j0 <= j < j1`` outside of which nothing is drawn.
    """
    height, width = inverse_depth.shape
    if image is not None:
        _clear(image, background, before)
    p_C = np.empty((len(surfaces.vertices), 3))
    uv = np.empty((len(surfaces.vertices), 2))
    view = np.zeros(len(surfaces.closed), dtype=np.int64)
    u0, u1, v0, v1 = math.inf, -math.inf, math.inf, -math.inf
    for g in range(len(view)):
        X_CG = _inverse_times(X_WC, X_WGs[g])
        view[g] = _find_view(surfaces.spheres[g], X_CG, lens, width, height)
        if view[g] == _HIDDEN:
            continue
        for k in range(surfaces.vertex_start[g], surfaces.vertex_start[g + 1]):
            p_C[k, 0], p_C[k, 1], p_C[k, 2] = _transform(X_CG, surfaces.vertices[k])
            if view[g] == _WHOLE:
                u, v = _project(p_C[k], lens)
                uv[k, 0], uv[k, 1] = u, v
                u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
        if view[g] == _CUT:
            u0, u1, v0, v1 = 0.0, float(width), 0.0, float(height)
    i0, i1 = _centers_between(u0, u1, width)
    j0, j1 = _centers_between(v0, v1, height)
    for j in range(j0, j1):
        inverse_depth[j, i0:i1] = 1.0 / lens.far

    polygon, corners = np.empty((4, 3)), np.empty((4, 2))
    for g in range(len(view)):
        if view[g] == _HIDDEN:
            continue
        for t in range(surfaces.triangle_start[g], surfaces.triangle_start[g + 1]):
            value = unpainted
            if paint is not None:
                if paint[t] == unpainted:
                    continue
                value = paint[t]
            ka, kb, kc = surfaces.triangles[t]
            facing, plane = _inverse_depth_plane(p_C[ka], p_C[kb], p_C[kc], lens)
            if facing == 0.0:
                continue  # It is seen edge-on.
            if view[g] == _WHOLE:
                if facing > 0.0 or not surfaces.closed[g]:
                    _fill(uv[ka], uv[kb], uv[kc], plane, value, inverse_depth, image)
                continue
            # Where the near plane cuts a closed solid open, its back faces are seen, too.
            num_corners = _clip(p_C[ka], p_C[kb], p_C[kc], lens.near, polygon)
            for k in range(num_corners):
                corners[k, 0], corners[k, 1] = _project(polygon[k], lens)
            for k in range(2, num_corners):
                _fill(corners[0], corners[k - 1], corners[k], plane, value, inverse_depth, image)
    return i0, i1, j0, j1


@njit(cache=True)
def _clear(image: NDArray[Any], background: int, before: Rectangle) -> None:
    """Makes an image all background where it is so outside a rectangle; else, too, but slowly.

    That is found out by some rows. Writing all of an image, and later fetching all else from where
    its megabytes drove it, takes longer than drawing.
    """
    i0, i1, j0, j1 = before
    value, changed = image.dtype.type(background), 0
    for j in range(0, len(image), _ROW_STEP):
        left, right = (i0, i1) if j0 <= j < j1 else (0, 0)
        for pixel in image[j, :left]:
            changed += pixel != value
        for pixel in image[j, right:]:
            changed += pixel != value
    if changed > 0:
        image[:, :] = background
    else:
        image[j0:j1, i0:i1] = background


@njit(cache=True)
def convert_depth(
    inverse_depth: Floats,
    rectangle: Rectangle,
    far: float,
    min_depth: float,
    max_depth: float,
    image: Floats,
) -> None:
    """Turns what `draw` left into depths [m]: 0 where too close, infinity where too far or empty.

    Args:
        inverse_depth: As `draw` left it.
        rectangle: As `draw` returned it.
        far: The camera's far plane [m].
        min_depth: What is closer is too close [m].
        max_depth: What is farther is too far [m].
        image: Receives the depths, shape (height, width).
    """
    image[:, :] = np.inf
    nothing = np.float32(1.0 / far)
    i0, i1, j0, j1 = rectangle
    for j in range(j0, j1):
        for i in range(i0, i1):
            if inverse_depth[j, i] > nothing:
                depth = 1.0 / inverse_depth[j, i]
                if depth < min_depth:
                    image[j, i] = 0.0
                elif depth <= max_depth:
                    image[j, i] = depth


@njit(cache=True)
def _inverse_times(X_WC: Array, X_WG: Array) -> Array:
    """X_CG, shape (3, 4)."""
    X_CG = np.empty((3, 4))
    x, y, z = X_WG[0, 3] - X_WC[0, 3], X_WG[1, 3] - X_WC[1, 3], X_WG[2, 3] - X_WC[2, 3]
    for r in range(3):
        a, b, c = X_WC[0, r], X_WC[1, r], X_WC[2, r]
        for k in range(3):
            X_CG[r, k] = a * X_WG[0, k] + b * X_WG[1, k] + c * X_WG[2, k]
        X_CG[r, 3] = a * x + b * y + c * z
    return X_CG


@njit(cache=True)
def _transform(X: Array, p: Array) -> Point:
    """A point in another frame."""
    return (
        X[0, 0] * p[0] + X[0, 1] * p[1] + X[0, 2] * p[2] + X[0, 3],
        X[1, 0] * p[0] + X[1, 1] * p[1] + X[1, 2] * p[2] + X[1, 3],
        X[2, 0] * p[0] + X[2, 1] * p[1] + X[2, 2] * p[2] + X[2, 3],
    )


@njit(cache=True)
def _project(p: Array, lens: Lens) -> tuple[float, float]:
    """Where a point before the camera lies in the image [px]."""
    u, v = lens.focal_x * p[0] / p[2], lens.focal_y * p[1] / p[2]
    return u + lens.center_x, v + lens.center_y


@njit(cache=True)
def _find_view(sphere: Array, X_CG: Array, lens: Lens, width: int, height: int) -> int:
    """Whether a geometry, by the sphere around it, is _HIDDEN, _WHOLE or _CUT."""
    x, y, z = _transform(X_CG, sphere)
    radius = sphere[3]
    fx, fy, cx, cy = lens.focal_x, lens.focal_y, lens.center_x, lens.center_y
    if z + radius <= lens.near or z - radius >= lens.far:
        return _HIDDEN
    # The image's left, right, top and bottom borders are planes through the camera's center.
    if (
        fx * x + cx * z < -radius * math.hypot(fx, cx)
        or (width - cx) * z - fx * x < -radius * math.hypot(fx, width - cx)
        or fy * y + cy * z < -radius * math.hypot(fy, cy)
        or (height - cy) * z - fy * y < -radius * math.hypot(fy, height - cy)
    ):
        return _HIDDEN
    return _WHOLE if z - radius > lens.near else _CUT


@njit(cache=True)
def _inverse_depth_plane(a: Array, b: Array, c: Array, lens: Lens) -> tuple[float, Point]:
    """A triangle's side and plane in the image.

    Returns:
        A number that is positive where the triangle's outside faces the camera, and (ku, kv, k0)
        with 1 / z = ku u + kv v + k0.
    """
    bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    cx, cy, cz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    distance = nx * a[0] + ny * a[1] + nz * a[2]  # n . p for every point p of the plane
    if distance == 0.0:
        return 0.0, (0.0, 0.0, 0.0)
    ku, kv = nx / (lens.focal_x * distance), ny / (lens.focal_y * distance)
    return -distance, (ku, kv, nz / distance - ku * lens.center_x - kv * lens.center_y)


@njit(cache=True)
def _clip(a: Array, b: Array, c: Array, near: float, polygon: Array) -> int:
    """Finds the part of a triangle beyond the near plane: its corners and their number."""
    count = 0
    for p, q in ((a, b), (b, c), (c, a)):
        if p[2] >= near:
            polygon[count] = p
            count += 1
        if (p[2] >= near) != (q[2] >= near):
            # From the far end, so that the triangle beyond this edge finds the very same point.
            inner, outer = (p, q) if p[2] >= near else (q, p)
            share = (inner[2] - near) / (inner[2] - outer[2])
            for r in range(2):
                polygon[count, r] = inner[r] + share * (outer[r] - inner[r])
            polygon[count, 2] = near
            count += 1
    return count


@njit(cache=True)
def _centers_between(start: float, stop: float, size: int) -> tuple[int, int]:
    """The first pixel k of 0 ... size - 1, and one past the last, with start <= k + 0.5 < stop."""
    first = math.ceil(min(max(start, 0.0), float(size)) - 0.5)
    last = math.ceil(min(max(stop, 0.0), float(size)) - 0.5)
    return max(first, 0), min(last, size)


@njit(cache=True)
def _fill(
    a: Array,
    b: Array,
    c: Array,
    plane: Point,
    value: Any,
    inverse_depth: Floats,
    image: NDArray[Any] | None,
) -> None:
    """Draws a triangle where it is closer than what is drawn already."""
    if a[1] > b[1]:
        a, b = b, a
    if b[1] > c[1]:
        b, c = c, b
    if a[1] > b[1]:
        a, b = b, a
    height, width = inverse_depth.shape
    ku, kv, k0 = plane
    first, last = _centers_between(a[1], c[1], height)
    for j in range(first, last):
        v = j + 0.5
        # Each edge from its upper end, so that both triangles beside it find the same pixel.
        long = a[0] + (v - a[1]) * ((c[0] - a[0]) / (c[1] - a[1]))
        if v < b[1]:
            short = a[0] + (v - a[1]) * ((b[0] - a[0]) / (b[1] - a[1]))
        else:
            short = b[0] + (v - b[1]) * ((c[0] - b[0]) / (c[1] - b[1]))
        i0, i1 = _centers_between(min(long, short), max(long, short), width)
        start = kv * v + k0
        depths = inverse_depth[j, i0:i1]
        if image is not None:
            shown, painted = image[j, i0:i1], image.dtype.type(value)
        for i in range(i1 - i0):  # without branches, for the compiler to take several at once
            w = np.float32(start + ku * (i0 + i + 0.5))
            closer = w > depths[i]
            depths[i] = w if closer else depths[i]
            if image is not None:  # known when it is compiled
                shown[i] = painted if closer else shown[i]
