"""Recordings of ROS, tracked as they are: images, cameras and motion from one file."""

from __future__ import annotations

import dataclasses as dc
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.cameras import Camera, CameraRig
from mffdrake.recognition.poses.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.recordings.recording import RecordingError, RecordingFrame
from mffdrake.recognition.recordings.trajectory import PoseAt, Trajectory
from mffdrake.recognition.ros.bag import Bag, find_images, info_topic
from mffdrake.recognition.ros.frames import Frames, compose, inverse
from mffdrake.recognition.ros.matching import half_frame, match_stamps
from mffdrake.recognition.ros.messages import RosError, camera_of, nanoseconds, pose_of, rig_frame
from mffdrake.recognition.ros.pixels import decode

__all__ = ["RosRecording", "open_recording"]

Array = NDArray[np.float64]

_POSES = (
    "geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/TransformStamped", "nav_msgs/Odometry",
)  # fmt: skip


@dc.dataclass(frozen=True, kw_only=True)
class RosRecording:
    """Images of a rig's cameras, put together by their acquisition times.

    Attributes:
        bag: The file.
        rig: The cameras.
        topics: Camera's name to the topic of its images.
        stamps: Each camera's acquisition times [ns], in the order of the file.
        rows: A row a frame, see `match_stamps`.
        motion: The rig's pose in the world at a time [ns]; it returns None where not known then.
        stride: Every n-th frame counts.
        frame: Name of the rig's frame.
        summary: What was found, in a line for people.
        warning: What was left out or is not known, in a line for people; empty where all is well.
    """

    bag: Bag
    rig: CameraRig
    topics: Mapping[str, str]
    stamps: tuple[NDArray[np.int64], ...]
    rows: NDArray[np.int64]
    motion: Callable[[int], Array | None] | None
    stride: int
    frame: str
    summary: str
    warning: str

    @property
    def count(self) -> int:
        """How many frames count."""
        return -(-len(self.rows) // self.stride)

    @property
    def rate(self) -> float:
        """Frames a second; 30 where there is but one."""
        times = self.stamps[0][self.rows[:, 0]]
        return 1e9 / float(np.median(np.diff(times))) if len(times) > 1 else 30.0

    def __iter__(self) -> Iterator[RecordingFrame]:
        """The frames that count, one after the other.

        Raises:
            RecordingError: When an image does not fit its camera.
            RosError, ImageSourceError: When an image cannot be read.
        """
        names = list(self.topics)
        wanted = {
            (self.topics[name], int(index)): (number, k)
            for number in range(0, len(self.rows), self.stride)
            for k, (name, index) in enumerate(zip(names, self.rows[number], strict=True))
        }
        seen: Counter[str] = Counter()
        waiting: dict[int, dict[int, Any]] = {}
        number = 0
        for topic, _, message in self.bag.messages(list(self.topics.values())):
            place = wanted.get((topic, seen[topic]))
            seen[topic] += 1
            if place is None:
                continue
            waiting.setdefault(place[0], {})[place[1]] = message
            while len(waiting.get(number, ())) == len(names):
                messages = waiting.pop(number)
                yield self._frame(number, [messages[k] for k in range(len(names))])
                number += self.stride

    def _frame(self, number: int, messages: list[Any]) -> RecordingFrame:
        """A frame of its cameras' messages."""
        images = tuple(
            decode(message, f"{self.bag.path}: {topic}, frame {number}")
            for topic, message in zip(self.topics.values(), messages, strict=True)
        )
        try:
            self.rig.check_images(images)
        except ValueError as error:
            raise RecordingError(f"frame {number}: {error}") from error
        stamp = int(self.stamps[0][self.rows[number, 0]])
        pose = None if self.motion is None else self.motion(stamp)
        return RecordingFrame(number, stamp / 1e9, images, pose, stamp)


def open_recording(
    path: Path | str,
    *,
    rig: CameraRig | None = None,
    images: Mapping[str, str] | None = None,
    motion: Trajectory | str | None = None,
    stride: int = 1,
    rate: float = 30.0,
) -> RosRecording:
    """Opens a recording of ROS: MCAP, a ROS 2 folder or a ROS 1 bag.

    Args:
        path: The recording.
        rig: The cameras; None for those of the recording: each has a ``CameraInfo`` beside its
            images, and ``/tf_static``, or the matrices P of a stereo pair, tell its place. The
            rig's frame is then the first camera's.
        images: Camera's name to topic; by default, a camera is called as its topic's namespace.
        motion: Poses of the rig in the world by time [s]; or a topic with such poses; or "none".
            By default from ``/tf``, where it tells how the first camera moves in the tree's root.
        stride: Every n-th frame counts.
        rate: Frames a second, where there is one frame only.

    Returns:
        The recording. Images of several cameras belong together when their acquisition times are
        the same or, else, the nearest ones and less than half a frame apart; what has no partner is
        left out.

    Raises:
        RosError: When it is no such recording, or lacks something; the message names the remedy.
        RecordingError: When the topics are not of the rig's cameras.
    """
    bag = Bag(path)
    names = None if rig is None else rig.names
    topics = find_images(bag, images or {}, names)
    if rig is not None:
        if set(topics) != set(rig.names):
            raise RecordingError(
                f"images of the cameras {', '.join(topics)}, but the rig has the cameras "
                f"{', '.join(rig.names)}"
            )
        topics = {name: topics[name] for name in rig.names}
    read = _read(bag, topics, motion if isinstance(motion, str) and motion != "none" else None)
    if rig is None:
        rig = _make_rig(bag, topics, read)
    stamps = tuple(np.array(read.stamps[topic], dtype=np.int64) for topic in topics.values())
    tolerance = half_frame(stamps[0], rate)
    rows = match_stamps(stamps, tolerance)
    if not len(rows):
        raise RosError(
            f"{path}: no images of the cameras {', '.join(topics)} were taken within "
            f"{1e-6 * tolerance:.3g} ms of each other"
        )
    moves, source = _motion(bag, rig, topics, read, motion)
    total = [len(times) for times in stamps]
    warning = ""
    if set(total) != {len(rows)}:
        left = ", ".join(
            f"{n - len(rows)} of '{name}'" for n, name in zip(total, topics, strict=True)
        )
        warning = (
            f"{path}: left out images without a partner within {1e-6 * tolerance:.3g} ms: {left}"
        )
    frames = stamps[0][rows[:, 0]].tolist()
    unknown = 0 if moves is None else sum(moves(stamp) is None for stamp in frames)
    if unknown:
        warning = f"{warning or path}; the motion is not known at {unknown} of {len(frames)} frames"
    listed = ", ".join(f"{name} ({topic})" for name, topic in topics.items())
    return RosRecording(
        bag=bag, rig=rig, topics=topics, stamps=stamps, rows=rows, motion=moves, stride=stride,
        frame=read.frame_ids[next(iter(topics))] if rig_frame(rig) != "rig" else "rig",
        summary=f"cameras {listed}; motion: {source}", warning=warning,
    )  # fmt: skip


@dc.dataclass
class _Read:
    """What a first pass over a recording finds."""

    stamps: dict[str, list[int]]
    frame_ids: dict[str, str] = dc.field(default_factory=dict)
    infos: dict[str, Any] = dc.field(default_factory=dict)
    frames: Frames = dc.field(default_factory=Frames)
    poses: dict[int, Array] = dc.field(default_factory=dict)


def _read(bag: Bag, topics: Mapping[str, str], motion: str | None) -> _Read:
    """Reads all but the pixels."""
    if motion is not None and motion not in bag.of_type(*_POSES):
        raise RosError(
            f"{bag.path}: no motion '{motion}'; its topics with poses are "
            f"{', '.join(bag.of_type(*_POSES)) or 'none'}"
        )
    read = _Read({topic: [] for topic in topics.values()})
    received: dict[str, list[int]] = {topic: [] for topic in topics.values()}
    infos = {info_topic(topic): name for name, topic in topics.items()}
    names = {topic: name for name, topic in topics.items()}
    tf = bag.of_type("tf2_msgs/TFMessage", "tf/tfMessage")
    for message in bag.messages([*received, *infos, *tf, *([motion] if motion else [])]):
        if message.topic in received:
            read.stamps[message.topic].append(message.stamp)
            received[message.topic].append(message.log_time)
            frame = message.message.header.frame_id.removeprefix("/")
            read.frame_ids.setdefault(names[message.topic], frame)
        elif message.topic in infos:
            read.infos.setdefault(infos[message.topic], message.message)
        elif message.topic in tf:
            fixed = message.topic.endswith("tf_static")
            read.frames.add(message.message.transforms, fixed=fixed)
        else:
            read.poses[message.stamp] = pose_of(message.message)
    for topic, stamps in read.stamps.items():
        if not stamps:
            raise RosError(f"{bag.path}: no messages in {topic}")
        if not any(stamps):  # The driver sets none: when it was received is the best there is.
            read.stamps[topic] = received[topic]
    return read


def _make_rig(bag: Bag, topics: Mapping[str, str], read: _Read) -> CameraRig:
    """The cameras as the recording has them, the first one's frame the rig's."""
    cameras: list[Camera] = []
    first = next(iter(topics))
    for name, topic in topics.items():
        info = info_topic(topic)
        if name not in read.infos:
            raise RosError(f"{bag.path}: no messages in {info}: give the cameras by --rig")
        where, rectified = f"{bag.path}: {info}", "rect" in topic
        camera = camera_of(read.infos[name], name, where, rectified=rectified)
        if cameras:
            X_CK = None
            if not rectified:
                X_CK = read.frames.between(read.frame_ids[first], read.frame_ids[name])
            if X_CK is None:
                X_CK = _stereo_place(read.infos[first], read.infos[name], rectified)
            if X_CK is None:
                raise RosError(
                    f"{bag.path}: nothing tells where camera '{name}' is: neither /tf_static, from "
                    f"'{read.frame_ids[first]}' to '{read.frame_ids[name]}', nor the matrix P in "
                    f"{info}: give the cameras by --rig"
                )
            R_CK, p_CK = transform_from_pose(X_CK)
            camera = dc.replace(camera, R_CK=R_CK, p_CK=p_CK)
        cameras.append(camera)
    return CameraRig(tuple(cameras))


def _stereo_place(first: Any, other: Any, rectified: bool) -> Array | None:
    """The pose of a stereo pair's other camera in the first one, by the matrices R and P."""
    (R, P), (S, Q) = (
        (
            np.reshape(getattr(info, "r", getattr(info, "R", ())), (3, 3)),
            np.reshape(getattr(info, "p", getattr(info, "P", ())), (3, 4)),
        )
        for info in (first, other)
    )
    if not (P[0, 0] > 0.0 and Q[0, 0] > 0.0) or P[0, 3] / P[0, 0] == Q[0, 3] / Q[0, 0]:
        return None
    along = np.array([P[0, 3] / P[0, 0] - Q[0, 3] / Q[0, 0], 0.0, 0.0])
    # S p_other = R p_first - along
    return pose_from_transform(*((np.eye(3), along) if rectified else (R.T @ S, R.T @ along)))


def _motion(
    bag: Bag,
    rig: CameraRig,
    topics: Mapping[str, str],
    read: _Read,
    motion: Trajectory | str | None,
) -> tuple[Callable[[int], Array | None] | None, str]:
    """The rig's pose in the world by time [ns], and where it is from, for people."""
    if isinstance(motion, Trajectory):
        order = np.argsort(motion.times, kind="stable")
        times = np.array([nanoseconds(t) for t in motion.times[order].tolist()])
        poses = motion.poses[order]
        return (lambda stamp: PoseAt(times, poses, stamp)), "of the file"
    if motion == "none":
        return None, "none"
    if motion is not None:
        times = np.array(sorted(read.poses))
        poses = np.array([read.poses[t] for t in times.tolist()]).reshape(-1, 6)
        return (lambda stamp: PoseAt(times, poses, stamp)), f"of {motion}"
    frame = read.frame_ids[next(iter(topics))]
    if not read.frames.moves(frame):
        return None, f"none, as /tf does not tell how '{frame}' moves"
    camera = rig.cameras[0]
    X_CK = pose_from_transform(camera.R_CK, camera.p_CK)
    back = (inverse(X_CK),) if X_CK.any() else ()  # the rig's frame is the first camera's, mostly

    def pose_of_rig(stamp: int) -> Array | None:
        X_WK = read.frames.in_root(frame, stamp)
        return None if X_WK is None else compose(X_WK, *back)

    return pose_of_rig, f"'{frame}' in '{read.frames.ancestors(frame)[-1]}', of /tf"
