"""Rotations that bring a solid's shape, or one of its faces, onto itself, or nearly so.

A shape that looks alike from several sides invites wrong optima: the solid turned by one of these
rotations covers the same pixels, and only its colors tell that it is wrong. Where no more than one
face is to be seen, turns of that face do as well.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.pose import pose_from_transform, rotation_matrix, transform_from_pose
from mffdrake.recognition.pose_motion import rotate_by
from mffdrake.recognition.solid_model import SolidModel

Array = NDArray[np.float64]

_EXACTLY = 0.02  # as `find_turns`' tolerance
_MOST = 60  # the largest finite group of rotations of a solid, but for prisms of many sides


def find_turns(solid: SolidModel, tolerance: float = 0.3) -> Array:
    """Rotations about the middle of a solid's corners that bring its corners near to each other.

    Args:
        solid: The solid; its colors do not count.
        tolerance: How far corners may come to lie from corners, as a share of the greatest distance
            of a corner from the middle.

    Returns:
        Rotation matrices in the solid's frame, without the identity, those that fit best first, at
        most 60, shape (K, 3, 3).

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> len(find_turns(SolidModel.box((1.0, 1.0, 1.0), (RED, GREEN, BLUE))))   # a cube's
        23
        >>> len(find_turns(SolidModel.box((1.0, 2.0, 4.0), (RED, GREEN, BLUE))))   # half turns
        3
    """
    arms = solid.vertices - solid.vertices.mean(axis=0)
    limit = tolerance * np.linalg.norm(arms, axis=1).max()
    # A rotation is known from where it brings two corners that are not in line with the middle.
    first = arms[0]
    across = np.linalg.norm(np.cross(first, arms), axis=1)
    second = arms[np.argmax(across)]
    turns: list[Array] = []
    misfits: list[float] = []
    for a, b in itertools.permutations(arms, 2):
        if np.linalg.norm(np.cross(a, b)) < 1e-9 * limit**2:
            continue
        R = _frame(a, b) @ _frame(first, second).T
        if np.trace(R) > 2.999 or any(np.trace(R @ S.T) > 2.99 for S in turns):
            continue
        apart = np.linalg.norm((arms @ R.T)[:, None] - arms[None], axis=-1)
        misfit = max(float(apart.min(axis=0).max()), float(apart.min(axis=1).max()))
        if misfit <= limit:
            turns.append(R)
            misfits.append(misfit)
    order = np.argsort(misfits, kind="stable")[:_MOST]
    return np.array(turns).reshape(-1, 3, 3)[order]


def _frame(a: Array, b: Array) -> Array:
    """Axes along a and in the plane of a and b, as columns."""
    x = a / np.linalg.norm(a)
    z = np.cross(a, b)
    z /= np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def turn_about_middle(pose: Array, solid: SolidModel, turns: Array) -> Array:
    """Poses of a solid turned about the middle of its corners, which stays where it is.

    Args:
        pose: Pose vector, shape (6,).
        solid: The solid.
        turns: Rotations in the solid's frame, shape (K, 3, 3).

    Returns:
        Pose vectors, shape (K, 6).

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> cube = SolidModel.box((1.0, 1.0, 1.0), (RED, GREEN, BLUE))
        >>> turn_about_middle(np.zeros(6), cube, np.diag([1.0, -1.0, -1.0])[None])
        array([[0., 0., 0., 1., 0., 0.]])
    """
    middle = solid.vertices.mean(axis=0)
    return Turns(turns, np.broadcast_to(middle, (len(turns), 3))).of(pose)


class Turns(NamedTuple):
    """Rotations of a solid about points of it.

    Attributes:
        rotations: Rotation matrices in the solid's frame, shape (K, 3, 3).
        points: For each the point that stays where it is [m], shape (K, 3).
    """

    rotations: Array
    points: Array

    def of(self, pose: Array) -> Array:
        """The turned poses, shape (K, 6), of a pose vector."""
        R, p = transform_from_pose(pose)
        turned = R @ self.rotations
        stays = np.einsum("kij,kj->ki", R - turned, self.points)
        return np.asarray(pose_from_transform(turned, p + stays))


def find_symmetries(solid: SolidModel) -> Array:
    """Rotations about the middle of a solid's corners that change nothing that is to be seen.

    Args:
        solid: The solid.

    Returns:
        Rotation matrices in the solid's frame, without the identity, shape (K, 3, 3).

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> len(find_symmetries(SolidModel.box((1.0, 2.0, 4.0), (RED, GREEN, BLUE))))  # half turns
        3
    """
    turns = find_turns(solid, _EXACTLY)
    return np.array([R for R in turns if _keeps_colors(solid, R)]).reshape(-1, 3, 3)


def find_look_alikes(solid: SolidModel) -> Turns:
    """Turns by which a solid looks the same from some sides, but not from all.

    They bring its shape onto itself, but not its colors; or one face onto itself, but not the
    others, which are not seen when the face is seen straight on or all else is hidden.

    Args:
        solid: The solid.

    Returns:
        The turns, those of the shape first.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> cube = SolidModel.box((1.0, 1.0, 2.0), (RED, GREEN, BLUE))
        >>> find_look_alikes(cube).rotations.shape                                 # quarter turns
        (4, 3, 3)
    """
    middle = solid.vertices.mean(axis=0)
    found = [(R, middle) for R in find_turns(solid, _EXACTLY) if not _keeps_colors(solid, R)]
    for face, normal in zip(solid.faces, solid.normals, strict=True):
        corners = solid.vertices[list(face)]
        center = corners.mean(axis=0)
        limit = _EXACTLY * np.linalg.norm(corners - center, axis=1).max()
        for step in range(1, len(face)):
            angle = math.remainder(2.0 * math.pi * step / len(face), 2.0 * math.pi)
            R = rotation_matrix(rotate_by(angle * normal))
            onto = np.roll(corners, -step, axis=0)
            if np.abs((corners - center) @ R.T + center - onto).max() > limit:
                continue
            if not _keeps_shape(solid, R, center):
                found.append((R, center))
    rotations, points = zip(*found, strict=True) if found else ((), ())
    return Turns(np.array(rotations).reshape(-1, 3, 3), np.array(points).reshape(-1, 3))


def _keeps_shape(solid: SolidModel, R: Array, point: Array) -> bool:
    """Whether a rotation about a point brings every corner onto one."""
    arms = solid.vertices - point
    apart = np.linalg.norm((arms @ R.T)[:, None] - arms, axis=-1)
    return bool(apart.min(axis=1).max() <= _EXACTLY * np.linalg.norm(arms, axis=1).max())


def _keeps_colors(solid: SolidModel, R: Array) -> bool:
    """Whether a rotation brings every face onto one of its color."""
    middle = solid.vertices.mean(axis=0)
    turned = (solid.centers - middle) @ R.T + middle
    onto = np.linalg.norm(turned[:, None] - solid.centers, axis=-1).argmin(axis=1)
    return all(solid.materials[k] == solid.materials[j] for k, j in enumerate(onto))
