"""Writes MCAP files with messages of ROS 2: recordings of a rig, and poses that were tracked."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.recognition.poses.pose_motion import quaternion_rate_matrix
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.recordings.image_files import EncodePng
from mffdrake.recognition.recordings.trajectory import Trajectory
from mffdrake.recognition.ros.messages import (
    RosError,
    camera_info,
    frame_of,
    make,
    nanoseconds,
    pose_message,
    rig_frame,
    ros_name,
    stamped,
    transform_message,
    typestore,
)
from mffdrake.recognition.tracking.pose_tracker import Estimate

__all__ = ["McapFile", "RigRecorder", "pose_covariance", "write_mcap", "write_poses"]

Array = NDArray[np.float64]

WORLD = "world"


class McapFile:
    """An MCAP file that is being written, see `write_mcap`.

    Args:
        writer: MCAP's own writer, started.
    """

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def write(self, topic: str, message: Any, log_time: int) -> None:
        """Writes a message.

        Args:
            topic: Its topic, always of messages of one type.
            message: The message.
            log_time: When it was received [ns], not before 0.
        """
        types, kind = typestore(), message.__msgtype__
        if kind not in self._schemas:
            text = types.generate_msgdef(kind, ros_version=2)[0]
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        if topic not in self._channels:
            facts = {"offered_qos_profiles": "", "topic_type_hash": types.hash_rihs01(kind)}
            self._channels[topic] = self._writer.register_channel(
                topic, "cdr", self._schemas[kind], facts
            )
        self._writer.add_message(
            channel_id=self._channels[topic], log_time=max(0, log_time),
            publish_time=max(0, log_time), data=bytes(types.serialize_cdr(message, kind)),
        )  # fmt: skip


@contextmanager
def write_mcap(path: Path | str) -> Iterator[McapFile]:
    """Writes an MCAP file, whole or not at all; the messages' definitions are in it.

    Args:
        path: The file.

    Yields:
        What writes messages.

    Raises:
        RosError: When the libraries are not installed.
        OSError: When the file cannot be written.
    """
    typestore()
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise RosError("MCAP files need more libraries: pip install 'mffdrake[ros]'") from error
    with WholeFile(path) as part, part.open("wb") as stream:
        writer: Any = Writer(stream)
        writer.start(profile="ros2", library="mffdrake")
        yield McapFile(writer)
        writer.finish()


class RigRecorder:
    """Writes what a rig's cameras see and how they move.

    - ``/NAME/image/compressed`` (PNG, which loses nothing) and ``/NAME/camera_info``, a pair of
      each camera and frame;
    - ``/tf_static``: the cameras' optical frames in the rig's, see `rig_frame`;
    - ``/tf``: the rig's frame in ``world``;
    - ``/target/true_pose``: the target's true pose in the rig's frame.

    Args:
        file: The file.
        rig: The cameras.
        latencies: Age of each camera's images when they arrive [s].

    Raises:
        RosError: When two cameras' names are one and the same in ROS.
    """

    def __init__(self, file: McapFile, rig: CameraRig, latencies: Sequence[float]) -> None:
        self.file, self.rig, self.latencies = file, rig, latencies
        names = [ros_name(name) for name in rig.names]
        if len(set(names)) < len(names):
            raise RosError(f"cameras' names must differ in letters and digits, not {rig.names}")
        base = rig_frame(rig)
        transforms = [
            transform_message(pose_from_transform(c.R_CK, c.p_CK), 0, base, frame_of(c))
            for c in rig.cameras
            if frame_of(c) != base
        ]
        if transforms:
            file.write("/tf_static", make("tf2_msgs/TFMessage", transforms=transforms), 0)

    def add_images(self, time: float, images: Sequence[NDArray[np.uint8]]) -> None:
        """Writes a frame's images.

        Args:
            time: When they arrive [s].
            images: RGB, one a camera.
        """
        log_time = nanoseconds(time)
        for camera, latency, image in zip(self.rig.cameras, self.latencies, images, strict=True):
            stamp, frame = nanoseconds(time - latency), frame_of(camera)
            compressed = make(
                "sensor_msgs/CompressedImage",
                header=stamped(stamp, frame), format="png", data=EncodePng(image),
            )  # fmt: skip
            topic = f"/{ros_name(camera.name)}"
            self.file.write(f"{topic}/image/compressed", compressed, log_time)
            self.file.write(f"{topic}/camera_info", camera_info(camera, stamp, frame), log_time)

    def add_motion(self, motion: Trajectory) -> None:
        """Writes the rig's motion.

        Args:
            motion: When the first camera's images arrived, and the rig's poses in the world at
                their acquisition.
        """
        for time, pose in zip(motion.times.tolist(), motion.poses, strict=True):
            stamp = nanoseconds(time - self.latencies[0])
            transform = transform_message(pose, stamp, WORLD, rig_frame(self.rig))
            message = make("tf2_msgs/TFMessage", transforms=[transform])
            self.file.write("/tf", message, nanoseconds(time))

    def add_true_poses(self, poses: Trajectory) -> None:
        """Writes the target's true poses.

        Args:
            poses: When the first camera's images arrived, and the target's poses in the rig's frame
                at their acquisition.
        """
        for time, pose in zip(poses.times.tolist(), poses.poses, strict=True):
            stamp = nanoseconds(time - self.latencies[0])
            header = stamped(stamp, rig_frame(self.rig))
            message = make("geometry_msgs/PoseStamped", header=header, pose=pose_message(pose))
            self.file.write("/target/true_pose", message, nanoseconds(time))


def pose_covariance(estimate: Estimate) -> Array:
    """A pose's covariance as ROS has it, the rotation about the frame's fixed axes.

    Args:
        estimate: A pose.

    Returns:
        Row by row, shape (36,); where it is not known, -1 and zeros, as in ROS's ``Imu``.

    Example:
        >>> pose_covariance(Estimate(np.zeros(6), 0.9, 0))[:3]
        array([-1.,  0.,  0.])
    """
    if not np.isfinite(estimate.covariance).all():
        return np.array([-1.0, *35 * [0.0]])
    J = np.eye(6)  # deps = 1/2 (eta I - S(eps)) dtheta, Eq. (6)
    J[3:, 3:] = np.linalg.pinv(quaternion_rate_matrix(estimate.pose[3:]))
    return np.asarray((J @ estimate.covariance @ J.T).reshape(36))


def write_poses(
    path: Path | str, frame: str, stamps: Sequence[int], estimates: Sequence[Estimate]
) -> None:
    """Writes poses that were tracked.

    - ``/target/pose``: ``geometry_msgs/PoseWithCovarianceStamped``;
    - ``/diagnostics``: what the tracker thinks of it: state, whether it may be relied on,
      confidence, fitness.

    Args:
        path: The MCAP file.
        frame: Name of the rig's frame.
        stamps: Times of the acquisition [ns].
        estimates: The poses.

    Raises:
        RosError: When the libraries are not installed.
        OSError: When the file cannot be written.
    """
    with write_mcap(path) as file:
        for stamp, estimate in zip(stamps, estimates, strict=True):
            header = stamped(stamp, frame)
            pose = make(
                "geometry_msgs/PoseWithCovariance",
                pose=pose_message(estimate.pose), covariance=pose_covariance(estimate),
            )  # fmt: skip
            message = make("geometry_msgs/PoseWithCovarianceStamped", header=header, pose=pose)
            file.write("/target/pose", message, stamp)
            file.write("/diagnostics", _diagnostics(header, estimate), stamp)


def _diagnostics(header: Any, estimate: Estimate) -> Any:
    """What the tracker thinks of a pose."""
    values = {
        "is_tracking": int(estimate.is_tracking),
        "confidence": "" if math.isnan(estimate.confidence) else estimate.confidence,
        "fitness": estimate.fitness,
        "refined": int(estimate.refined),
    }
    status = make(
        "diagnostic_msgs/DiagnosticStatus",
        level=int(not estimate.is_tracking), name="mffdrake", message=estimate.state.name.lower(),
        hardware_id="",
        values=[
            make("diagnostic_msgs/KeyValue", key=key, value=str(value))
            for key, value in values.items()
        ],
    )  # fmt: skip
    return make("diagnostic_msgs/DiagnosticArray", header=header, status=[status])
