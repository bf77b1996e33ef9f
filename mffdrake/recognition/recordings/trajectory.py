"""Poses over time as text, in the format of the TUM benchmark: time x y z qx qy qz qw."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.parameters import InputError
from mffdrake.recognition.poses.pose import quaternion_scalar
from mffdrake.recognition.recordings.files import WholeFile

__all__ = [
    "LoadPose",
    "LoadTrajectory",
    "PoseAt",
    "SaveTrajectory",
    "Trajectory",
    "TrajectoryError",
]

Array = NDArray[np.float64]

_COLUMNS = "time x y z qx qy qz qw"
_UNIT_TOLERANCE = 1e-3


class TrajectoryError(InputError, ValueError):
    """A file of poses is wrong; the message is one line for the person who wrote it."""


@dataclass(frozen=True)
class Trajectory:
    """Poses over time.

    Attributes:
        times: Of each pose [s], shape (K,).
        poses: Pose vectors ``(r [m], eps)``, shape (K, 6).
    """

    times: Array
    poses: Array

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.times)


def PoseAt(times: NDArray[Any], poses: Array, when: float) -> Array | None:
    """The pose at a time between others: straight ahead, at a constant turning rate.

    Args:
        times: Ascending, of any unit, shape (K,).
        poses: Pose vectors, shape (K, 6).
        when: The time, of the same unit.

    Returns:
        The pose vector, shape (6,), to the bit one of `poses` at its own time; None before the
        first and after the last one.

    Example:
        >>> poses = np.array([[1.0, 0, 0, 0, 0, 0], [2.0, 0, 0, 0.6, 0, 0]])
        >>> PoseAt(np.array([0, 2]), poses, 1).round(3)
        array([1.5  , 0.   , 0.   , 0.316, 0.   , 0.   ])
    """
    k = int(np.searchsorted(times, when))
    if k < len(times) and times[k] == when:
        return np.asarray(poses[k])
    if k in (0, len(times)):
        return None
    share = float((when - times[k - 1]) / (times[k] - times[k - 1]))
    a, b = (np.append(pose[3:], quaternion_scalar(pose[3:])) for pose in poses[k - 1 : k + 1])
    b = np.copysign(1.0, a @ b) * b  # the shorter way
    angle = math.atan2(float(np.linalg.norm(b - (a @ b) * a)), float(a @ b))
    q = (1.0 - share) * a + share * b
    if angle > 1e-9:
        q = math.sin((1.0 - share) * angle) * a + math.sin(share * angle) * b
    q *= np.copysign(1.0, q[3]) / np.linalg.norm(q)
    return np.append((1.0 - share) * poses[k - 1, :3] + share * poses[k, :3], q[:3])


def LoadTrajectory(path: Path | str) -> Trajectory:
    """Reads a TUM file.

    Args:
        path: The file: ``time x y z qx qy qz qw`` a line, [s] and [m], separated by blanks or
            commas; lines that begin with ``#`` do not count.

    Returns:
        The poses, at least one, in the file's order.

    Raises:
        TrajectoryError: When a line is wrong; the message names it.
        OSError: When the file cannot be read.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "motion.tum"
        >>> np.savetxt(file, [[0.0, 0, 0, 0.8, 0, 0, 0, 1], [0.1, 0.02, 0, 0.8, 0, 0, 0, 1]])
        >>> motion = LoadTrajectory(file)
        >>> np.diff(motion.poses[:, 0]) / np.diff(motion.times)  # m/s
        array([0.2])
    """
    rows = _Rows(path, (8,))
    data = np.array(rows)
    return Trajectory(data[:, 0], np.array([_Pose(path, row[1:]) for row in rows]))


def LoadPose(path: Path | str) -> Array:
    """Reads one pose: the first line of a TUM file, with or without its time.

    Args:
        path: The file.

    Returns:
        The pose vector, shape (6,).

    Raises:
        TrajectoryError: When the line is wrong.
        OSError: When the file cannot be read.
    """
    return _Pose(path, _Rows(path, (7, 8))[0][-7:])


def SaveTrajectory(trajectory: Trajectory, path: Path | str) -> None:
    """Writes a TUM file, whole or not at all, in full precision.

    Args:
        trajectory: The poses.
        path: The file.

    Raises:
        OSError: When it cannot be written.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "poses.tum"
        >>> SaveTrajectory(Trajectory(np.array([0.1]), np.array([[1.0, 2, 3, 0.6, 0, 0]])), file)
        >>> LoadTrajectory(file).poses
        array([[1. , 2. , 3. , 0.6, 0. , 0. ]])
    """
    lines = [f"# {_COLUMNS}"]
    for time, pose in zip(trajectory.times, trajectory.poses, strict=True):
        numbers = [time, *pose, quaternion_scalar(pose[3:])]
        lines.append(" ".join(repr(float(number)) for number in numbers))
    with WholeFile(path) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _Rows(path: Path | str, counts: Sequence[int]) -> list[list[float]]:
    """The numbers of every line that counts."""
    rows: list[list[float]] = []
    try:
        text = Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file in UTF-8") from error
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = line.replace(",", " ").split()
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            row = []
        if len(row) not in counts or not all(map(math.isfinite, row)):
            wanted = " or ".join(map(str, counts))
            raise TrajectoryError(
                f"{path}: line {number} must be {wanted} numbers ({_COLUMNS}), not "
                f"'{line.strip()[:60]}'"
            )
        rows.append(row)
    if not rows:
        raise TrajectoryError(f"{path}: no poses; each is a line of {_COLUMNS}")
    return rows


def _Pose(path: Path | str, numbers: Iterable[float]) -> Array:
    """Pose vector of x y z qx qy qz qw."""
    x, y, z, *q = numbers
    norm = math.sqrt(sum(c * c for c in q))
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        raise TrajectoryError(
            f"{path}: a quaternion must have the norm 1, not {norm:.6g} ({_COLUMNS})"
        )
    # A norm of 1 but for rounding is left alone, so that what was written comes back to the bit.
    scale = math.copysign(1.0, q[3]) / (1.0 if abs(norm - 1.0) < 1e-15 else norm)
    return np.array([x, y, z, *(c * scale + 0.0 for c in q[:3])])
