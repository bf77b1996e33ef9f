"""What corners and faces must be before anything is computed of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "check_edges",
    "check_enclosed",
    "check_faces",
    "check_hues",
    "check_indices",
    "check_size",
]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FARTHEST, _SMALLEST = 1e9, 1e-9  # m: far beyond what makes sense, so that no power overflows
_SAME_LENGTH = 1e-4  # as in `surface`


def check_size(points: Array) -> None:
    """Raises where points are not finite, or together far too large or too small for a solid.

    Args:
        points: Of the surface [m], shape (N, 3), at least one.

    Raises:
        ValueError: With what is allowed.

    Example:
        >>> check_size(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]))
    """
    if not (np.abs(points) <= _FARTHEST).all():  # NaN, too
        worst = points[np.argmax(~(np.abs(points) <= _FARTHEST).all(axis=1))]
        raise ValueError(
            f"a corner is at {worst.tolist()} m; coordinates must be finite and at most "
            f"{_FARTHEST:g} m"
        )
    extent = float(np.ptp(points, axis=0).max())
    if extent < _SMALLEST:
        raise ValueError(
            f"the solid is {extent:g} m long, but must be at least {_SMALLEST:g} m; meshes are in "
            "meters"
        )


def check_hues(hues: Array) -> None:
    """Raises where a hue [rad] is not finite."""
    if not np.isfinite(hues).all():
        k = int(np.argmin(np.isfinite(hues)))
        raise ValueError(f"the hue of face {k} must be finite, not {hues[k]}")


def check_indices(count: int, faces: Sequence[Sequence[int]]) -> None:
    """Raises where a face is none of three or more different corners.

    Args:
        count: Number of corners.
        faces: Indices of each one's corners.

    Raises:
        ValueError: With the face.

    Example:
        >>> check_indices(4, [(0, 1, 2), (0, 1, 3)])
    """
    if not len(faces):
        raise ValueError("the surface has no faces")
    for k, face in enumerate(faces):
        if len(face) < 3 or len(set(face)) < len(face):
            raise ValueError(f"face {k} must have three different corners or more, not {[*face]}")
        if not all(0 <= i < count for i in face):
            raise ValueError(f"face {k} must have corners from 0 to {count - 1}, not {[*face]}")


def check_enclosed(vertices: Array, triangles: IntArray, names: ArrayLike) -> None:
    """Raises where triangles do not enclose a solid.

    Args:
        vertices: Corner points, shape (V, 3).
        triangles: Their corners, shape (T, 3).
        names: The number by which a message names each, shape (T,).

    Raises:
        ValueError: With the face or the edge, and the remedy.
    """
    names = np.asarray(names)
    heads: dict[tuple[int, int], list[int]] = {}
    for k, (a, b, c) in enumerate(triangles.tolist()):
        for side in ((a, b), (b, c), (c, a)):
            heads.setdefault(side, []).append(k)
    for (a, b), there in heads.items():
        back = heads.get((b, a), [])
        if len(there) == len(back) == 1:
            continue
        edge = f"the edge from {_place(vertices[a])} to {_place(vertices[b])}"
        if len(there) + len(back) == 1:
            raise ValueError(
                f"not a closed solid: open at {edge}, which has face {names[there[0]]} alone; "
                "close it there (neighbors share corners), or export it again if it was cut short"
            )
        if len(there) + len(back) == 2:
            raise ValueError(
                f"faces {names[there[0]]} and {names[there[1]]} lie on opposite sides: at {edge} "
                "one of them is listed clockwise, seen from outside; turn it around"
            )
        raise ValueError(
            f"not a closed solid: {edge} has {len(there) + len(back)} faces instead of two; make "
            "parts that touch there one solid, or part them"
        )
    p, q, r = vertices[triangles].transpose(1, 0, 2)
    doubled = np.cross(q - p, r - p)
    volume = float(np.einsum("tk,tk->", doubled, vertices[triangles[:, 0]])) / 6.0
    if abs(volume) <= _SAME_LENGTH * float(np.ptp(vertices, axis=0).max()) ** 3 * _SAME_LENGTH:
        raise ValueError(
            f"the solid encloses no volume: face {names[0]} and all others lie in one plane or on "
            "each other; give it a thickness"
        )
    if volume < 0.0:
        raise ValueError(
            f"the solid is turned inside out (or mirrored): face {names[0]} and all others are "
            "listed clockwise, seen from outside; turn all faces around"
        )


def check_faces(areas: ArrayLike, centers: Array) -> None:
    """Raises where a face has no area, so that it looks in no direction.

    Args:
        areas: Of the faces, shape (F,).
        centers: Where they are [m], shape (F, 3).

    Raises:
        ValueError: With the face and its place.
    """
    without = np.flatnonzero(~(np.asarray(areas) > 0.0))
    if len(without):
        k = int(without[0])
        raise ValueError(
            f"face {k} at {_place(centers[k])} has no area: its corners lie in line; leave it out "
            "and join its neighbors"
        )


def check_edges(lengths: Array, faces: IntArray) -> None:
    """Raises where an edge has no length, so that it goes in no direction.

    Args:
        lengths: Of the edges, shape (E,).
        faces: The two faces at each, shape (E, 2).

    Raises:
        ValueError: With the faces.
    """
    without = np.flatnonzero(~(lengths > 0.0))
    if len(without):
        first, second = faces[without[0]].tolist()
        raise ValueError(
            f"the edge between the faces {first} and {second} has no length: two corners are the "
            "same; make one of them"
        )


def _place(point: Array) -> str:
    """A place in a message [m]."""
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*(point + 0.0))
