"""Reads recordings of ROS: MCAP files, folders and databases of ROS 2, bags of ROS 1."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from mffdrake.recognition.parameters import InputError, did_you_mean
from mffdrake.recognition.ros.messages import RosError, ros_name, typestore

__all__ = ["Bag", "Received", "find_images", "info_topic"]

_COMPRESSED = "/compressed"
_REMEDY = "say which by --images NAME=/TOPIC, one a camera"


class Received(NamedTuple):
    """A message of a recording.

    Attributes:
        topic: Its topic.
        log_time: When it was received [ns].
        message: The message; of ROS 1's, too, in ROS 2's types' names.
    """

    topic: str
    log_time: int
    message: Any

    @property
    def stamp(self) -> int:
        """When it was acquired, as its header tells [ns]; 0 where nobody told."""
        time = self.message.header.stamp
        return int(time.sec) * 10**9 + int(time.nanosec)


class Bag:
    """A recording.

    Args:
        path: An MCAP file, a ROS 2 folder or ``.db3``, or a ROS 1 ``.bag``.

    Raises:
        RosError: When the libraries are not installed, or it is no such recording.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise RosError(f"{path}: no such recording")
        typestore()
        with self._opened() as reader:
            self.topics = {c.topic: str(c.msgtype) for c in reader.connections}
        """Topic to type, as ``sensor_msgs/msg/Image``, in the recording's order."""

    def of_type(self, *kinds: str) -> list[str]:
        """The topics whose messages are of some types, as ``sensor_msgs/Image``."""
        wanted = {kind.replace("/", "/msg/") for kind in kinds}
        return [topic for topic, kind in self.topics.items() if kind in wanted]

    def messages(self, topics: Collection[str]) -> Iterator[Received]:
        """The messages of some topics, in the order in which they were received.

        Raises:
            RosError: When the recording is broken there.
        """
        with self._opened() as reader:
            connections = [c for c in reader.connections if c.topic in topics]
            if not connections:
                return
            for connection, time, data in reader.messages(connections=connections):
                message = reader.deserialize(data, connection.msgtype)
                yield Received(connection.topic, time, message)

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        """The library's reader; what it raises comes as one line that names the file."""
        from rosbags.highlevel import AnyReader

        try:
            with AnyReader([self.path], default_typestore=typestore()) as reader:
                yield reader
        except InputError:
            raise
        except Exception as error:  # It raises of everything for a file that is none.
            if isinstance(error, OSError) and error.errno is not None:
                raise
            text = " ".join(str(error).split()) or type(error).__name__
            raise RosError(
                f"{self.path}: not a recording that can be read, which are MCAP files, folders of "
                f"ROS 2 with metadata.yaml, .db3 and .bag: {text}"
            ) from error


def info_topic(topic: str) -> str:
    """The topic of an image topic's ``CameraInfo``: beside the images.

    Example:
        >>> info_topic("/right/image/compressed")
        '/right/camera_info'
    """
    return f"{_namespace(topic)}/camera_info"


def find_images(bag: Bag, given: Mapping[str, str], names: Sequence[str] | None) -> dict[str, str]:
    """Finds the cameras' image topics.

    Args:
        bag: The recording.
        given: Camera's name to topic, where a person said so; the ending ``/compressed`` may be
            left out.
        names: The rig's cameras; None for all cameras of the recording.

    Returns:
        Camera's name to topic.

    Raises:
        RosError: When it is not clear which; the message lists the topics that there are.
    """
    topics = [
        topic
        for topic in bag.of_type("sensor_msgs/Image", "sensor_msgs/CompressedImage")
        if not topic.endswith("/compressedDepth")
    ]
    there = f"{bag.path}: its topics with images are {', '.join(topics) or 'none'}"
    if not topics:
        raise RosError(there)
    if given:
        found = {}
        for name, topic in given.items():
            choice = next((t for t in (topic, topic + _COMPRESSED) if t in topics), None)
            if choice is None:
                raise RosError(f"no images '{topic}'{did_you_mean(topic, topics)}; {there}")
            found[name] = choice
        return found
    cameras: dict[str, list[str]] = {}
    for topic in topics:
        plain = topic.removesuffix(_COMPRESSED)
        if plain == topic or plain not in topics:  # What is there raw, too, counts once.
            cameras.setdefault(_namespace(topic), []).append(topic)
    labels = [_label(place) for place in cameras]
    if len(set(labels)) < len(labels):
        labels = [ros_name(place.strip("/")) for place in cameras]
    by_label = dict(zip(labels, cameras.values(), strict=True))
    if names is None:
        names = labels
    elif len(names) == len(by_label) == 1:
        by_label = {ros_name(names[0]): next(iter(by_label.values()))}
    found = {}
    for name in names:
        choices = by_label.get(ros_name(name), [])
        if len(choices) != 1:
            several = " several topics with" if choices else " no"
            raise RosError(f"{there}:{several} images of camera '{name}'; {_REMEDY}")
        found[name] = choices[0]
    return found


def _namespace(topic: str) -> str:
    """A camera's namespace: of /right/image/compressed it is /right."""
    return topic.removesuffix(_COMPRESSED).rpartition("/")[0]


def _label(place: str) -> str:
    """What a camera is called by its namespace."""
    return ros_name(place.rpartition("/")[2]) or "camera"
