"""Where frames are in each other over time, as ``/tf`` and ``/tf_static`` tell it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.poses.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.recordings.trajectory import PoseAt
from mffdrake.recognition.ros.messages import pose_of

__all__ = ["Frames", "compose", "inverse"]

Array = NDArray[np.float64]


def compose(first: Array, *others: Array) -> Array:
    """The product of poses; of one alone it is that, to the bit.

    Example:
        >>> compose(np.array([1.0, 0, 0, 0, 0, 0]), np.array([0.0, 2, 0, 0, 0, 0]))
        array([1., 2., 0., 0., 0., 0.])
    """
    for other in others:
        (R, p), (S, q) = transform_from_pose(first), transform_from_pose(other)
        first = pose_from_transform(R @ S, R @ q + p)
    return first


def inverse(pose: Array) -> Array:
    """The inverse of a pose.

    Example:
        >>> inverse(np.array([1.0, 0, 0, 0, 0, 0])).tolist()[0]
        -1.0
    """
    R, p = transform_from_pose(pose)
    return pose_from_transform(R.T, -R.T @ p)


class Frames:
    """A tree of frames."""

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}
        self._fixed: dict[str, Array] = {}
        self._moving: dict[str, dict[int, Array]] = {}
        self._tables: dict[str, tuple[NDArray[np.int64], Array]] = {}

    def add(self, transforms: Sequence[Any], *, fixed: bool) -> None:
        """Adds what a message tells.

        Args:
            transforms: Of ``TransformStamped``.
            fixed: Whether they are the same at all times.
        """
        for transform in transforms:
            parent = transform.header.frame_id.removeprefix("/")
            child = transform.child_frame_id.removeprefix("/")
            self._parents[child] = parent
            if fixed:
                self._fixed[child] = pose_of(transform)
            else:
                time = transform.header.stamp
                stamp = int(time.sec) * 10**9 + int(time.nanosec)
                self._moving.setdefault(child, {})[stamp] = pose_of(transform)
                self._tables.pop(child, None)

    def ancestors(self, frame: str) -> list[str]:
        """A frame and all in which it is, up to the root."""
        path = [frame.removeprefix("/")]
        while path[-1] in self._parents and self._parents[path[-1]] not in path:
            path.append(self._parents[path[-1]])
        return path

    def moves(self, frame: str) -> bool:
        """Whether it is known how a frame moves in the root."""
        return any(name in self._moving for name in self.ancestors(frame)[:-1])

    def in_root(self, frame: str, stamp: int) -> Array | None:
        """The pose of a frame in the root at a time [ns]; None where it is not known then."""
        return self._up(self.ancestors(frame), stamp)

    def between(self, base: str, frame: str) -> Array | None:
        """The pose of a frame in another one; None where no fixed transforms lead there."""
        down, up = self.ancestors(base), self.ancestors(frame)
        common = next((name for name in down if name in up), None)
        if common is None:
            return None
        X_AB = self._up(down[: down.index(common) + 1], None)
        X_AF = self._up(up[: up.index(common) + 1], None)
        if X_AB is None or X_AF is None:
            return None
        return X_AF if common == down[0] else compose(inverse(X_AB), X_AF)

    def _up(self, path: Sequence[str], stamp: int | None) -> Array | None:
        """The pose of a path's first frame in its last one; without a time by fixed ones only."""
        poses = []
        for child in reversed(path[:-1]):
            if child in self._fixed:
                poses.append(self._fixed[child])
                continue
            pose = None if stamp is None else self._at(child, stamp)
            if pose is None:
                return None
            poses.append(pose)
        return compose(*poses) if poses else np.zeros(6)

    def _at(self, child: str, stamp: int) -> Array | None:
        """A moving frame's pose in its parent."""
        if child not in self._tables:
            items = sorted(self._moving[child].items())
            self._tables[child] = (
                np.array([time for time, _ in items]),
                np.array([pose for _, pose in items]),
            )
        return PoseAt(*self._tables[child], stamp)
