"""Triangles that make up a solid's surface: whether they enclose it, and its faces and edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Loop = tuple[int, ...]

_SAME_NORMAL, _SAME_HUE = 1e-3, 1e-3  # Unit normals and hues [rad] this close are the same;
_SAME_LENGTH = 1e-4  # so are lengths, as a share of the solid's size.
_ODD_DIRECTION = np.array([0.5270463, 0.6871843, 0.4996572])


def triangulate(vertices: Array, face: Sequence[int]) -> list[Loop]:
    """Cuts a plane polygon into triangles, ear by ear.

    Args:
        vertices: Corner points, shape (V, 3).
        face: Indices of its corners in their order.

    Returns:
        Triangles of these indices, in the same order; fewer than corners less two where corners lie
        in line.
    """
    corners = vertices[list(face)]
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    left = list(face)
    triangles: list[Loop] = []
    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            if _is_ear(vertices, (a, b, c), left, normal):
                triangles.append((a, b, c))
                del left[k]
                break
        else:  # Its sides cross; it cannot be cut properly.
            break
    triangles.append((left[0], left[1], left[2]))
    return triangles


def _is_ear(vertices: Array, ear: Loop, polygon: Sequence[int], normal: Array) -> bool:
    """Whether a corner can be cut off: it bulges, and no other corner lies in it."""
    a, b, c = vertices[list(ear)]
    if np.cross(b - a, c - b) @ normal <= 1e-12 * (normal @ normal):
        return False
    others = vertices[[i for i in polygon if i not in ear]]
    inside = np.ones(len(others), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= np.cross(end - start, others - start) @ normal >= 0.0
    return not inside.any()


def weld(triangles: Array) -> tuple[Array, IntArray, IntArray]:
    """Makes one vertex of corners that are the same but for rounding.

    Args:
        triangles: Corner points, shape (T, 3, 3).

    Returns:
        The vertices, shape (V, 3); the triangles' vertices, shape (K, 3), and which triangles those
        are: all but those of which two corners are the same.
    """
    points = triangles.reshape(-1, 3)
    tolerance = _SAME_LENGTH * float(np.ptp(points, axis=0).max()) if len(points) else 1.0
    label = cluster(points / max(tolerance, 1e-300))
    count = np.bincount(label)
    vertices = np.stack([np.bincount(label, points[:, k]) / count for k in range(3)], axis=1)
    index = label.reshape(-1, 3)
    a, b, c = index.T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    return vertices, index[kept], kept


def areas(triangles: Array) -> Array:
    """Areas of triangles, given by their corners, shape (T, 3, 3)."""
    return np.asarray(0.5 * np.linalg.norm(_doubled_areas(triangles), axis=1))


def spread(triangles: Array, count: int, rng: np.random.Generator) -> tuple[Array, IntArray]:
    """Points drawn evenly over triangles.

    Args:
        triangles: Their corners, shape (T, 3, 3).
        count: Number N of points.
        rng: Source of randomness.

    Returns:
        The points, shape (N, 3), and the triangles that they lie on, shape (N,).
    """
    ways = triangles[:, 1:] - triangles[:, :1]
    sizes = areas(triangles)
    chosen = rng.choice(len(triangles), size=count, p=sizes / sizes.sum())
    a, b = rng.random((2, count, 1))
    a, b = np.where(a + b > 1.0, 1.0 - a, a), np.where(a + b > 1.0, 1.0 - b, b)
    return triangles[chosen, 0] + a * ways[chosen, 0] + b * ways[chosen, 1], chosen


def cluster(rows: Array) -> IntArray:
    """Labels rows so that those less than one apart in every column share a label.

    Labels are in the order of the rows that are the first to have them.
    """
    labels = np.full(len(rows), -1, dtype=np.int64)
    # Sorted along an odd direction, in which rows with the same numbers in a column lie apart.
    along = rows @ _ODD_DIRECTION
    order = np.argsort(along, kind="stable")
    start = np.searchsorted(along[order], along - _ODD_DIRECTION.sum())
    stop = np.searchsorted(along[order], along + _ODD_DIRECTION.sum(), side="right")
    count = 0
    for k in range(len(rows)):
        if labels[k] < 0:
            near = order[start[k] : stop[k]]
            near = near[labels[near] < 0]
            labels[near[np.abs(rows[near] - rows[k]).max(axis=1) < 1.0]] = count
            count += 1
    return labels


def _doubled_areas(triangles: Array) -> Array:
    """Normals of triangles, as long as twice their areas, shape (T, 3)."""
    a, b, c = triangles.transpose(1, 0, 2)
    return np.asarray(np.cross(b - a, c - a))


def merge_coplanar(vertices: Array, triangles: IntArray, hues: Array) -> IntArray:
    """Numbers of the faces that triangles are parts of, in the order of the first ones, (T,)."""
    normals = _doubled_areas(vertices[triangles])
    lengths = np.linalg.norm(normals, axis=1)
    sides = np.linalg.norm(np.roll(vertices[triangles], -1, 1) - vertices[triangles], axis=2)
    flat = lengths <= _SAME_LENGTH * sides.max(axis=1) ** 2
    normals /= np.maximum(lengths, 1e-300)[:, None]
    heights = np.einsum("tk,tk->t", normals, vertices[triangles].mean(axis=1))
    ends, pairs = _sides(triangles)
    first, second = pairs.T
    size = float(np.ptp(vertices, axis=0).max())
    same = np.abs(normals[first] - normals[second]).max(axis=1) < _SAME_NORMAL
    same &= same_hues(hues[first], hues[second])
    same &= np.abs(heights[first] - heights[second]) < _SAME_LENGTH * size
    same &= ~(flat[first] | flat[second])
    # A triangle without area, as modeling tools leave them, belongs to the one at its longest side.
    for k in np.flatnonzero(flat):
        around = np.flatnonzero((first == k) | (second == k))
        apart = np.linalg.norm(vertices[ends[around, 1]] - vertices[ends[around, 0]], axis=1)
        same[around[np.argmax(apart)]] = True
    return connect(len(triangles), pairs[same])


def same_hues(first: Array, second: Array) -> NDArray[np.bool_]:
    """Which hues [rad] are the same but for rounding."""
    return np.abs(np.mod(first - second + np.pi, 2.0 * np.pi) - np.pi) < _SAME_HUE


def largest(vertices: Array, triangles: IntArray, faces: IntArray) -> IntArray:
    """The largest triangle of every face, the first of those, shape (F,)."""
    doubled = 2.0 * areas(vertices[triangles])
    order = np.lexsort((np.arange(len(doubled)), -doubled.round(15), faces))
    return order[np.unique(faces[order], return_index=True)[1]]


def connect(count: int, pairs: IntArray) -> IntArray:
    """Numbers of the groups of things that pairs connect, in the order of the first ones."""
    parent = list(range(count))

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = parent[k]
        return k

    for a, b in pairs.tolist():
        a, b = root(a), root(b)
        parent[max(a, b)] = min(a, b)
    roots = np.array([root(k) for k in range(count)], dtype=np.int64)
    return np.unique(roots, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _sides(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """The sides of closed triangles, and the two that share each; the first has it so directed."""
    sides: dict[tuple[int, int], int] = {}
    ends, pairs = [], []
    for k, (a, b, c) in enumerate(triangles.tolist()):
        for p, q in ((a, b), (b, c), (c, a)):
            other = sides.pop((q, p), None)
            if other is None:
                sides[p, q] = k
            else:
                ends.append((q, p))
                pairs.append((other, k))
    return np.array(ends, dtype=np.int64), np.array(pairs, dtype=np.int64)


def find_edges(loops: Sequence[Sequence[Loop]]) -> tuple[IntArray, IntArray, IntArray]:
    """Edges between faces.

    Args:
        loops: For each face the loops of its corners, with the face on their left.

    Returns:
        Their ends, their two faces, and for each of those 1 where it lies on the left of the edge
        from its first to its second end, else -1, all of shape (E, 2).
    """
    sides: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for f, face in enumerate(loops):
        for loop in face:
            for a, b in zip(loop, (*loop[1:], loop[0]), strict=True):
                sides.setdefault((min(a, b), max(a, b)), []).append((f, 1 if a < b else -1))
    crossing = [there for there in sides.values() if len(there) != 2]
    if crossing:
        raise ValueError(f"the sides of face {crossing[0][0][0]} cross; cut it into triangles")
    both = np.moveaxis(np.array(list(sides.values()), dtype=np.int64), 2, 0)
    faces, signs = np.ascontiguousarray(both)
    return np.array(list(sides), dtype=np.int64), faces, signs


def trace_loops(vertices: Array, triangles: IntArray, faces: IntArray) -> list[list[Loop]]:
    """The sides of every face: loops of its corners, the outer one first, holes clockwise.

    Where no more than two faces meet, corners in the middle of a straight side are left out.
    """
    meeting = np.unique(np.stack([triangles.reshape(-1), np.repeat(faces, 3)], axis=1), axis=0)
    is_end = np.bincount(meeting[:, 0], minlength=len(vertices)) > 2
    outgoing: list[dict[int, list[int]]] = [{} for _ in range(int(faces.max()) + 1)]
    ends, pairs = _sides(triangles)
    for (a, b), (s, t) in zip(ends.tolist(), faces[pairs].tolist(), strict=True):
        if s != t:
            outgoing[s].setdefault(a, []).append(b)
            outgoing[t].setdefault(b, []).append(a)
    found = []
    for after in outgoing:
        loops = []
        while after:
            start = min(after)
            loop, here = [], start
            while True:
                loop.append(here)
                following = after[here].pop()
                if not after[here]:
                    del after[here]
                here = following
                if here == start:
                    break
            loops.append(_without_straight(vertices, loop, is_end))
        if not loops or min(map(len, loops)) < 3:
            raise ValueError(
                "parts of the surface have no area; leave them out, or make them whole"
            )
        if len(loops) > 1:
            loops.sort(key=lambda loop: -_doubled_area(vertices, loop))
        loops[0] = _started(vertices, loops[0])
        found.append(loops)
    return found


def renumber(loops: Sequence[Sequence[Loop]]) -> tuple[IntArray, list[list[Loop]]]:
    """The vertices that loops use, and the loops with numbers of those."""
    used = sorted({k for face in loops for loop in face for k in loop})
    number = {k: place for place, k in enumerate(used)}
    return np.array(used), [[tuple(number[k] for k in loop) for loop in face] for face in loops]


def _doubled_area(vertices: Array, loop: Loop) -> float:
    p = vertices[list(loop)]
    return float(np.linalg.norm(np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)))


def _without_straight(vertices: Array, loop: list[int], is_end: NDArray[np.bool_]) -> Loop:
    """A loop without corners at which it does not turn and no side ends."""
    if len(loop) == 3:  # by far the most in meshes of curved surfaces
        return tuple(loop)
    p = vertices[loop]
    before, after = p - np.roll(p, 1, axis=0), np.roll(p, -1, axis=0) - p
    turn = np.linalg.norm(np.cross(before, after), axis=1)
    length = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    kept = is_end[loop] | (turn > _SAME_NORMAL * length)
    return tuple(k for k, is_kept in zip(loop, kept, strict=True) if is_kept)


def _started(vertices: Array, loop: Loop) -> Loop:
    """A loop from its corner on that is the first by angle, from its corner of the least index."""
    if len(loop) == 3:
        k = loop.index(min(loop)) - 1
        return loop[k:] + loop[:k]
    arm = vertices[list(loop)] - vertices[sorted(loop)].mean(axis=0)
    normal = np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0)
    first = arm[int(np.argmin(loop))]
    angle = np.arctan2(arm @ np.cross(normal / np.linalg.norm(normal), first), arm @ first)
    k = int(np.argmin(angle))
    return loop[k:] + loop[:k]


def is_convex(vertices: Array, normals: Array, centers: Array) -> bool:
    """Whether no vertex lies outside a face."""
    limit = _SAME_LENGTH * np.ptp(vertices, axis=0).max()
    return all(
        ((vertices - center) @ normal).max() <= limit
        for normal, center in zip(normals, centers, strict=True)
    )
