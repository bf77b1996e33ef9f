"""Tracks a solid through recorded images."""

from __future__ import annotations

import dataclasses as dc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.parameters import InputError
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.poses.pose_motion import transport_pose
from mffdrake.recognition.recordings.image_files import ImageSource
from mffdrake.recognition.recordings.trajectory import Trajectory
from mffdrake.recognition.tracking.pose_tracker import Estimate, PoseTracker
from mffdrake.recognition.tracking.search import Found

__all__ = [
    "Frames",
    "MotionWarning",
    "Recording",
    "RecordingError",
    "RecordingFrame",
    "TrackRecording",
    "TrackedFrame",
    "ViewWarning",
]

Image = NDArray[np.uint8]

# A prediction is judged where it moves the pose by more than what the recognition may be off.
_LEAST_MOTION = 1e-3  # m
_TIMES_NOISE = 3.0
_LEAST_FRAMES = 5
_CLEARLY_WORSE = 2.0


class RecordingError(InputError, ValueError):
    """A recording is not whole; the message is one line for the person who made it."""


@dataclass(frozen=True)
class RecordingFrame:
    """What a recording holds of one moment.

    Attributes:
        frame: Number of the frame, as the recording counts.
        time: Its time [s].
        images: One a camera, in the rig's order.
        pose_WC: The rig's pose vector in the world, shape (6,), where its motion is known.
        stamp: The same time [ns], where the recording tells it so: of the acquisition, exactly.
    """

    frame: int
    time: float
    images: tuple[Image, ...]
    pose_WC: NDArray[np.float64] | None
    stamp: int | None = None


class Frames(Protocol):
    """Frames of a rig, one after the other: a `Recording`, or another one's like."""

    @property
    def rig(self) -> CameraRig:
        """The cameras."""
        ...

    @property
    def count(self) -> int | None:
        """How many frames count; None where that shows at the end only."""
        ...

    def __iter__(self) -> Iterator[RecordingFrame]:
        """The frames that count."""
        ...


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Images of a rig's cameras, taken at the same moments.

    Attributes:
        rig: The cameras.
        sources: Camera's name to its images.
        motion: The rig's pose in the world at every frame; None where it is not known.
        stride: Every n-th frame counts.
        rate: Frames a second, where no motion tells the times.

    Raises:
        RecordingError: When a camera has no images, there are images of a camera that is none of
            the rig's, or cameras have different numbers of images.
    """

    rig: CameraRig
    sources: Mapping[str, ImageSource]
    motion: Trajectory | None = None
    stride: int = 1
    rate: float = 30.0

    def __post_init__(self) -> None:
        """Checks that there is everything."""
        names, given = self.rig.names, set(self.sources)
        for name in names:
            if name not in given:
                raise RecordingError(
                    f"no images of camera '{name}'; the rig has the cameras {', '.join(names)}"
                )
        for name in self.sources:
            if name not in names:
                raise RecordingError(
                    f"images of a camera '{name}', but the rig has the cameras {', '.join(names)}"
                )
        counts = {name: self.sources[name].count for name in names}
        known = [count for count in counts.values() if count is not None]
        if len(set(known)) > 1:
            listed = ", ".join(f"{count} of '{name}'" for name, count in counts.items())
            raise RecordingError(f"cameras must have as many images as each other, not {listed}")

    @property
    def count(self) -> int | None:
        """How many frames count; None where that shows at the end only."""
        known = [self.sources[name].count for name in self.rig.names]
        return None if None in known else -(-min(c for c in known if c is not None) // self.stride)

    def __iter__(self) -> Iterator[RecordingFrame]:
        """The frames that count, one after the other.

        Raises:
            RecordingError: When a camera's images end before the others', an image does not fit its
                camera, or the motion ends before the images.
        """
        names = self.rig.names
        columns = [iter(self.sources[name]) for name in names]
        for frame, images in enumerate(zip_longest(*columns)):
            missing = [name for name, image in zip(names, images, strict=True) if image is None]
            if missing:
                raise RecordingError(
                    f"frame {frame}: no image of camera '{missing[0]}'; its images end before the "
                    "others'"
                )
            if frame % self.stride:
                continue
            try:
                self.rig.check_images(images)
            except ValueError as error:
                raise RecordingError(f"frame {frame}: {error}") from error
            if self.motion is None:
                yield RecordingFrame(frame, frame / self.rate, images, None)
                continue
            if frame >= len(self.motion):
                raise RecordingError(
                    f"frame {frame}: the motion has {len(self.motion)} lines only; there must be "
                    "one line a frame"
                )
            when = float(self.motion.times[frame])
            yield RecordingFrame(frame, when, images, self.motion.poses[frame])


@dataclass(frozen=True)
class TrackedFrame:
    """What was recognized in a frame.

    Attributes:
        recorded: The frame.
        estimate: The target's pose in the rig's frame.
        ms: Wall time that it took [ms].
        found: How it was searched for; None where it was tracked.
    """

    recorded: RecordingFrame
    estimate: Estimate
    ms: float
    found: Found | None = None

    def WithoutImages(self) -> TrackedFrame:
        """The same without the images, which are large."""
        return dc.replace(self, recorded=dc.replace(self.recorded, images=()))

    def Row(self) -> dict[str, Any]:
        """The columns of ``poses.csv``."""
        e = self.estimate
        x, y, z = e.p_CM.tolist()
        qx, qy, qz, qw = e.quaternion_xyzw.tolist()
        std: dict[str, float | None] = {"std_position_mm": None, "std_rotation_deg": None}
        if e.refined:
            std = {
                "std_position_mm": 1e3 * e.std_position,
                "std_rotation_deg": float(np.degrees(e.std_rotation)),
            }
        return {
            "frame": self.recorded.frame, "time": self.recorded.time,
            "x": x, "y": y, "z": z, "qx": qx, "qy": qy, "qz": qz, "qw": qw,
            "fitness": e.fitness, "refined": int(e.refined), **std, "ms": self.ms,
            "state": e.state.name.lower(), "is_tracking": int(e.is_tracking),
            "confidence": None if np.isnan(e.confidence) else e.confidence,
        }  # fmt: skip


def TrackRecording(
    tracker: PoseTracker,
    recording: Frames,
    *,
    generations: int | None = None,
    on_generation: Callable[[int, float], None] | None = None,
) -> Iterator[TrackedFrame]:
    """Tracks a solid through a recording, with motion feedforward where its motion is known.

    Args:
        tracker: The tracker, fresh.
        recording: The recording.
        generations: The first frame's images are searched with so many generations, or until the
            search has converged; None for the tracker's own start.
        on_generation: Called after every generation of the search with their number and the best
            fitness.

    Yields:
        Frame after frame.

    Raises:
        RecordingError: When the recording is not whole. What was tracked before was yielded.
    """
    last: NDArray[np.float64] | None = None
    first = True
    for recorded in recording:
        begin, found = time.perf_counter(), None
        if first and generations is not None:
            estimate, found = tracker.search(recorded.images, generations, on_generation)
        else:
            estimate = tracker.track(recorded.images, _Displacement(last, recorded.pose_WC))
        ms = 1e3 * (time.perf_counter() - begin)
        first, last = False, recorded.pose_WC
        yield TrackedFrame(recorded, estimate, ms, found)


def MotionWarning(tracked: Sequence[TrackedFrame], sure_fitness: float) -> str | None:
    """Whether motion feedforward has predicted worse than no motion at all would have.

    So it does where the target moves with the cameras, or the motion is another one's.

    Args:
        tracked: The frames, in order.
        sure_fitness: From there on an unrefined pose counts (0 to 1).

    Returns:
        What to tell the person who gave the motion; None where all is well, or where it does not
        show: too few sure frames with enough motion.

    Example:
        >>> MotionWarning([], 0.6) is None
        True
    """
    errors = []  # With and without motion [m].
    for last, present in pairwise(tracked):
        X_DC = _Displacement(last.recorded.pose_WC, present.recorded.pose_WC)
        if X_DC is None or not (_IsSure(last, sure_fitness) and _IsSure(present, sure_fitness)):
            continue
        predicted = transport_pose(last.estimate.pose, X_DC[:, :3], X_DC[:, 3])[:3]
        p_CM, p_DM = last.estimate.p_CM, present.estimate.p_CM
        distance = np.linalg.norm(predicted - p_CM)
        if distance < _LEAST_MOTION:
            continue
        # Along the motion alone: depth, which is often the least sure, would drown the rest.
        along = (predicted - p_CM) / distance
        variance = along @ present.estimate.covariance[:3, :3] @ along
        if not present.estimate.refined or distance > _TIMES_NOISE * np.sqrt(variance):
            errors.append([abs(along @ (predicted - p_DM)), abs(along @ (p_CM - p_DM))])
    if len(errors) < _LEAST_FRAMES:
        return None
    with_motion, without = 1e3 * np.median(errors, axis=0)
    if with_motion <= _CLEARLY_WORSE * without:
        return None
    return (
        f"motion feedforward made the prediction worse than none (median {with_motion:.1f} mm "
        f"against {without:.1f} mm, along the motion): the target seems to move with the cameras; "
        "leave --motion out (with a --recording: --motion none), or give the motion relative to "
        "the target"
    )


def ViewWarning(tracked: Sequence[TrackedFrame], rig: CameraRig) -> str | None:
    """Whether the pose is out of a camera's view, as it is where cameras contradict each other.

    Args:
        tracked: The frames, in order.
        rig: The cameras.

    Returns:
        What to tell the person who gave the cameras; None where all see most of the poses.

    Example:
        >>> ViewWarning([], CameraRig.stereo()) is None
        True
    """
    positions = np.array([frame.estimate.p_CM for frame in tracked]).reshape(-1, 3)
    for camera in rig.cameras:
        unseen = int(np.count_nonzero(~camera.sees(positions)))
        if 2 * unseen > len(tracked):
            return (
                f"camera '{camera.name}' does not see the recognized pose in {unseen} of "
                f"{len(tracked)} frames; if its images show the target, the rig file places a "
                "camera wrongly (X_CK), or images are given to the wrong camera"
            )
    return None


def _IsSure(frame: TrackedFrame, sure_fitness: float) -> bool:
    return frame.estimate.refined or frame.estimate.fitness > sure_fitness


def _Displacement(
    last: NDArray[np.float64] | None, present: NDArray[np.float64] | None
) -> NDArray[np.float64] | None:
    """X_DC, Eq. (14): the last frame's rig C in the present one's D; None where unknown."""
    if last is None or present is None:
        return None
    (R_WC, p_WC), (R_WD, p_WD) = transform_from_pose(last), transform_from_pose(present)
    return np.column_stack([R_WD.T @ R_WC, R_WD.T @ (p_WC - p_WD)])
