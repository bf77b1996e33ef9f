"""Rotations that bring a solid's shape, or one of its faces, onto itself, or nearly so.

A shape that looks alike from several sides invites wrong optima: the solid turned by one of these
rotations covers the same pixels, and only its colors tell that it is wrong. Where no more than one
face is to be seen, turns of that face do as well.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.poses.pose import (
    pose_from_transform,
    rotation_angle,
    rotation_matrix,
    transform_from_pose,
)
from mffdrake.recognition.poses.pose_motion import rotate_by
from mffdrake.recognition.solid.solid_model import SolidModel
from mffdrake.recognition.solid.spread_surface import Surface

Array = NDArray[np.float64]

_EXACTLY = 0.02  # as `find_turns`' tolerance
_ANY_ANGLES = (0.61, 1.7, 2.5)  # [rad] no fraction of a turn
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
    if not solid.is_plain:
        return Surface.of(solid).turns(by_color=False)[:_MOST]
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


@dataclass(frozen=True, eq=False)
class Symmetries:
    """How a solid can be turned without a change that is to be seen.

    Attributes:
        turns: Rotations, without the identity.
        axes: Unit vectors about which any rotation is one: none, that of a body of revolution, or
            the three axes of a ball; shape (K, 3).
        center: The point that those pass through [m], shape (3,).

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> box = SolidModel.box((1.0, 2.0, 4.0), (RED, GREEN, BLUE))
        >>> str(find_symmetries(box))
        '3 turns'
    """

    turns: Turns
    axes: Array
    center: Array

    def __str__(self) -> str:
        """What they are, in words."""
        if len(self.axes) > 1:
            return "any turn"
        words = [
            f"any turn about ({x:g}, {y:g}, {z:g})"
            for x, y, z in (self.axes.round(3) + 0.0).tolist()
        ]
        if len(self.turns.rotations):
            count = len(self.turns.rotations)
            words.append(f"{count} turn{'s' if count > 1 else ''}")
        return ", ".join(words) or "none"

    def contain(self, R: Array) -> bool:
        """Whether a rotation, shape (3, 3), is one of them, but for a few degrees."""
        all_turns = [np.eye(3), *self.turns.rotations]
        if len(self.axes) > 1:
            return True
        if len(self.axes):  # about which any turn may follow
            return any((R @ self.axes[0]) @ (S @ self.axes[0]) > 0.995 for S in all_turns)
        return any(np.trace(R @ S.T) > 2.99 for S in all_turns)

    def nearest(self, pose: Array, other: Array) -> Array:
        """Of all poses that look like one, the one that is turned least against another.

        Args:
            pose: Pose vector, shape (6,).
            other: Pose vector, shape (6,).

        Returns:
            A pose vector, shape (6,); the very same where it is the nearest.
        """
        from mffdrake.recognition.poses.rotations import angle_between  # numba: slow to import

        if len(self.axes) > 1:
            R, p = transform_from_pose(pose)
            onto = transform_from_pose(other)[0]
            return np.asarray(pose_from_transform(onto, p + (R - onto) @ self.center))
        if not len(self.axes) and 2.0 * angle_between(pose[3:], other[3:]) < self._least:
            return pose
        poses = np.concatenate([pose[None], self.turns.of(pose)])
        if len(self.axes):
            poses = np.concatenate([pose[None], *(self._turned(p, other)[None] for p in poses)])
        apart = rotation_angle(poses[:, 3:], np.broadcast_to(other[3:], (len(poses), 3)))
        best = int(np.argmin(apart.round(9)))
        return np.asarray(poses[best])

    @cached_property
    def _least(self) -> float:
        """The least angle of a turn [rad]; what is within half of it is the nearest."""
        cosines = 0.5 * (np.trace(self.turns.rotations, axis1=1, axis2=2) - 1.0)
        return float(np.arccos(np.clip(cosines, -1.0, 1.0)).min(initial=np.inf))

    def _turned(self, pose: Array, other: Array) -> Array:
        """A pose turned about the axis to be nearest to another."""
        d = self.axes[0]
        A = transform_from_pose(other)[0].T @ transform_from_pose(pose)[0]
        # The trace of A R(angle) is greatest there.
        sine = A[2, 1] * d[0] + A[0, 2] * d[1] + A[1, 0] * d[2]
        sine -= A[1, 2] * d[0] + A[2, 0] * d[1] + A[0, 1] * d[2]
        angle = math.atan2(-sine, float(np.trace(A) - d @ A @ d))
        R = rotation_matrix(rotate_by(angle * d))
        turned: Array = Turns(R[None], self.center[None]).of(pose)[0]
        return turned


NO_SYMMETRIES = Symmetries(
    Turns(np.empty((0, 3, 3)), np.empty((0, 3))), np.empty((0, 3)), np.zeros(3)
)
"""Of a solid that looks different from everywhere."""


@lru_cache(maxsize=16)  # Trackers and records ask for the same solid's.
def find_symmetries(solid: SolidModel) -> Symmetries:
    """The rotations that change nothing of a solid that is to be seen.

    Args:
        solid: The solid.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> box = SolidModel.box((1.0, 2.0, 4.0), (RED, GREEN, BLUE))
        >>> len(find_symmetries(box).turns.rotations)   # half turns
        3
    """
    if solid.is_plain:
        rotations = find_turns(solid, _EXACTLY)
        kept = np.array([R for R in rotations if _keeps_colors(solid, R)]).reshape(-1, 3, 3)
        middle = solid.vertices.mean(axis=0)
        return Symmetries(Turns(kept, np.tile(middle, (len(kept), 1))), np.empty((0, 3)), middle)
    surface = Surface.of(solid)
    free = [
        direction
        for direction in surface.directions
        if all(
            surface.coincides(rotation_matrix(rotate_by(angle * direction)), by_color=True)
            for angle in _ANY_ANGLES
        )
    ]
    if len(free) > 1:  # a ball
        return Symmetries(NO_SYMMETRIES.turns, np.eye(3), surface.center)
    rotations = surface.turns(by_color=True)
    for axis in free:  # One half turn, if any: all others follow from it by turns about the axis.
        rotations = np.array([R for R in rotations if (R @ axis) @ axis < -0.999])[:1]
    points = np.tile(surface.center, (len(rotations), 1))
    turns = Turns(rotations.reshape(-1, 3, 3), points)
    return Symmetries(turns, np.array(free).reshape(-1, 3), surface.center)


@lru_cache(maxsize=16)  # as `find_symmetries`
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
    if not solid.is_plain:
        surface, same = Surface.of(solid), find_symmetries(solid)
        alike = [R for R in surface.turns(by_color=False) if not same.contain(R)]
        around = np.tile(surface.center, (len(alike), 1))
        return Turns(np.array(alike).reshape(-1, 3, 3), around)
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
