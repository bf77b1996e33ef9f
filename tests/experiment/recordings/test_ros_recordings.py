"""Recordings as MCAP files and bags: the circle closes, and others' tools read and write them."""

import csv
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap_ros2")

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as IndependentWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mffdrake.recognition.recordings.image_files import ReadImage
from mffdrake.recognition.recordings.rig_file import LoadRig
from mffdrake.recognition.recordings.trajectory import LoadTrajectory, SaveTrajectory, Trajectory
from mffdrake.recognition.ros.ros_recording import open_recording

SMALL = (
    "{camera: {width: 320, height: 240}, duration: 0.3, seed: 3, hand_path: {omega: 0.314}, "
    "recognizer: {start: near_target, refinement: borders}}"
)


@pytest.fixture(scope="module")
def mcap(tmp_path_factory, make_recording):
    """The same recording as `recording`, as one file: (folder, command)."""
    folder = tmp_path_factory.mktemp("mcap")
    return folder, make_recording(folder, "--mcap", "rec/rec.mcap", text=SMALL)


def tracked(quickly, folder, command, out):
    finished = quickly(f"{command} --out {out}".removeprefix("mffdrake "), folder)
    assert finished.returncode == 0, finished.stderr
    return LoadTrajectory(Path(out) / "poses.tum"), finished


def without_out(command):
    return command.partition(" --out")[0]


@pytest.fixture(scope="module")
def options(mcap):
    """The command but the recording, the cameras and where to write."""
    before, _, after = without_out(mcap[1]).partition(" --recording rec/rec.mcap")
    return before.replace(" --rig rec/rig.yaml", "") + after


@pytest.fixture(scope="module")
def poses(mcap, mffdrake):
    """What is tracked from the MCAP file."""
    folder, command = mcap
    finished = mffdrake(command, folder)
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr == ""
    return LoadTrajectory(folder / "rec/tracked/poses.tum")


# The circle closes


def test_an_mcap_file_is_tracked_like_folders_and_live(mcap, poses, recording, mffdrake):
    """As folders to the last bit; live, where displacements are not taken from poses, all but."""
    folder, command = recording
    assert mffdrake(command, folder).returncode == 0
    folders = LoadTrajectory(folder / "rec/tracked/poses.tum")
    np.testing.assert_array_equal(poses.poses, folders.poses)
    np.testing.assert_allclose(poses.times, folders.times, rtol=0, atol=1e-9)
    live = LoadTrajectory(mcap[0] / "rec/live_poses.tum")
    np.testing.assert_allclose(poses.poses, live.poses, rtol=0, atol=1e-12)
    assert len(live) == 10


@pytest.mark.parametrize(
    ("text", "more"),
    [
        (SMALL, ("--method", "ga")),
        (
            "{camera: {width: 320, height: 240, latency: 0.033}, duration: 0.3, recognizer: "
            "{start: near_target, refinement: borders}, encoders: {noise_deg: 0.02}}",
            (),
        ),
    ],
    ids=["without feedforward", "late images, noisy joints"],
)
def test_other_scenarios_close_the_circle(tmp_path, quickly, make_recording, text, more):
    command = make_recording(tmp_path, *more, "--mcap", "rec.mcap", text=text, run=quickly)
    found, _ = tracked(quickly, tmp_path, without_out(command), "out")
    live = LoadTrajectory(tmp_path / "rec/live_poses.tum")
    np.testing.assert_allclose(found.poses, live.poses, rtol=0, atol=1e-9)
    late = 0.033 if "latency" in text else 0.0
    np.testing.assert_allclose(found.times, live.times - late, rtol=0, atol=1e-9)


def test_an_mcap_file_brings_its_cameras_and_motion(mcap, options, tmp_path, quickly):
    """Without --rig, the calibration is taken for a real camera's: less is relied on."""
    command = f"{options} --recording rec/rec.mcap"
    found, finished = tracked(quickly, mcap[0], command, tmp_path / "out")
    true = LoadTrajectory(mcap[0] / "rec/true_poses.tum")
    assert np.linalg.norm((found.poses - true.poses)[:, :3], axis=1).max() < 0.005
    assert "right (/right/image/compressed), left (/left/image/compressed)" in finished.stdout
    assert "'right_optical_frame' in 'world', of /tf" in finished.stdout


def test_images_cameras_and_motion_are_in_it_to_the_bit(mcap, recording):
    opened = open_recording(mcap[0] / "rec/rec.mcap")
    rec = recording[0] / "rec"
    motion = LoadTrajectory(rec / "motion.tum")
    for one, other in zip(opened.rig.cameras, LoadRig(rec / "rig.yaml").cameras, strict=True):
        for key in ("name", "width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(one, key) == getattr(other, key)
        np.testing.assert_array_equal(one.p_CK, other.p_CK)
        np.testing.assert_array_equal(one.R_CK, other.R_CK)
    frames = list(opened)
    assert [frame.frame for frame in frames] == list(range(10))
    for frame, time, pose in zip(frames, motion.times, motion.poses, strict=True):
        np.testing.assert_array_equal(frame.pose_WC, pose)
        assert frame.stamp == round(1e9 * time)
        for name, image in zip(opened.rig.names, frame.images, strict=True):
            path = rec / f"images/{name}/{frame.frame:06d}.png"
            np.testing.assert_array_equal(image, ReadImage(path))


def test_frames_can_be_left_out(mcap, poses):
    opened = open_recording(mcap[0] / "rec/rec.mcap", stride=3)
    assert opened.count == 4
    assert [frame.frame for frame in opened] == [0, 3, 6, 9]
    assert opened.rate == pytest.approx(1 / 0.033)


# Others read what is written here


def read_independently(path):
    """By the reader that this package does not use: topic to messages."""
    received = {}
    with open(path, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            received.setdefault(channel.topic, []).append(message)
    return received


def test_an_independent_reader_reads_the_recording(mcap):
    received = read_independently(mcap[0] / "rec/rec.mcap")
    assert {topic: len(messages) for topic, messages in received.items()} == {
        "/right/image/compressed": 10, "/right/camera_info": 10, "/left/image/compressed": 10,
        "/left/camera_info": 10, "/tf": 10, "/tf_static": 1, "/target/true_pose": 10,
    }  # fmt: skip
    true = LoadTrajectory(mcap[0] / "rec/true_poses.tum")
    for message, time, pose in zip(
        received["/target/true_pose"], true.times, true.poses, strict=True
    ):
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == round(1e9 * time)
        assert message.header.frame_id == "right_optical_frame"
        place, turn = message.pose.position, message.pose.orientation
        np.testing.assert_array_equal([place.x, place.y, place.z, turn.x, turn.y, turn.z], pose)
    info = received["/left/camera_info"][0]
    assert (info.width, info.height, info.distortion_model) == (320, 240, "plumb_bob")
    assert info.p[3] == pytest.approx(0.15 * info.k[0])
    assert bytes(received["/left/image/compressed"][3].data).startswith(b"\x89PNG")


def test_tracked_poses_are_written_for_others(mcap, poses, tmp_path, quickly):
    out = tmp_path / "poses.mcap"
    command = f"{without_out(mcap[1])} --mcap-out {out}"
    tracked(quickly, mcap[0], command, tmp_path / "out")
    with open(tmp_path / "out/poses.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    received = read_independently(out)
    assert {topic: len(messages) for topic, messages in received.items()} == {
        "/target/pose": 10, "/diagnostics": 10
    }  # fmt: skip
    for k, (message, thought, row) in enumerate(
        zip(received["/target/pose"], received["/diagnostics"], rows, strict=True)
    ):
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == 33_000_000 * k
        assert message.header.frame_id == "right_optical_frame"
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        found = [place.x, place.y, place.z, turn.x, turn.y, turn.z]
        np.testing.assert_array_equal(found, poses.poses[k])
        covariance = np.reshape(message.pose.covariance, (6, 6))
        if row["refined"] == "1":
            np.testing.assert_allclose(covariance, covariance.T)
            std = 1e3 * np.sqrt(np.trace(covariance[:3, :3]))
            assert std == pytest.approx(float(row["std_position_mm"]))
            std = np.degrees(np.sqrt(np.trace(covariance[3:, 3:])))
            assert std == pytest.approx(float(row["std_rotation_deg"]))
        else:
            assert covariance[0, 0] == -1.0 and not covariance[1:].any()
        values = {item.key: item.value for item in thought.status[0].values}
        assert values["is_tracking"] == row["is_tracking"]
        assert thought.status[0].message == row["state"]


# What others write is read here


STORE = get_typestore(Stores.ROS2_HUMBLE)


def messages_of(path):
    """All that is in a recording: topic, type, time, message."""
    with AnyReader([path]) as reader:
        return [
            (c.topic, c.msgtype, time, reader.deserialize(data, c.msgtype))
            for c, time, data in reader.messages()
        ]


def write_ros2(path, messages, plugin):
    with Ros2Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, kind, time, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], time, STORE.serialize_cdr(message, kind))


def write_ros1(path, messages):
    """The same as ROS 1 has it: a header counts, and matrices are called in capitals."""
    store = get_typestore(Stores.ROS1_NOETIC)
    text = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))

    def converted(message, kind):
        fields = {}
        for name, (_, kind_of) in zip(
            (f[0] for f in store.fielddefs[kind][1]), store.fielddefs[kind][1], strict=True
        ):
            value = getattr(message, name, getattr(message, name.lower(), 0))
            fields[name] = value_of(value, kind_of)
        return store.types[kind](**fields)

    def value_of(value, description):
        number, detail = int(description[0]), description[1]
        if number == 2:
            return converted(value, detail)
        if number in (3, 4) and int(detail[0][0]) == 2:
            return [converted(item, detail[0][1]) for item in value]
        return value

    with Ros1Writer(path) as writer:
        connections = {}
        for topic, kind, time, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            data = store.serialize_ros1(converted(message, kind), kind)
            writer.write(connections[topic], time, data)


def write_independently(path, messages):
    """By the writer that this package does not use."""

    def plain(message):
        if isinstance(message, list):
            return [plain(item) for item in message]
        if not hasattr(message, "__dataclass_fields__"):
            return message.tolist() if isinstance(message, np.ndarray) else message
        names = [name for name in message.__dataclass_fields__ if not name.startswith("__")]
        return {name: plain(getattr(message, name)) for name in names}

    with open(path, "wb") as stream, IndependentWriter(stream) as writer:
        schemas = {}
        for topic, kind, time, message in messages:
            if kind not in schemas:
                text = STORE.generate_msgdef(kind, ros_version=2)[0]
                schemas[kind] = writer.register_msgdef(kind, text)
            writer.write_message(topic, schemas[kind], plain(message), log_time=time)


@pytest.mark.parametrize("form", ["mcap folder", "sqlite folder", "ros1 bag", "independent"])
def test_recordings_of_others_are_tracked_to_the_same_poses(
    mcap, poses, options, tmp_path, quickly, form
):
    messages = messages_of(mcap[0] / "rec/rec.mcap")
    path = tmp_path / ("a.bag" if form == "ros1 bag" else "a.mcap" if form[0] == "i" else "a")
    if form == "ros1 bag":
        write_ros1(path, messages)
    elif form == "independent":
        write_independently(path, messages)
    else:
        write_ros2(
            path, messages, StoragePlugin[form.split()[0].upper().replace("SQLITE", "SQLITE3")]
        )
    command = f"{options} --rig rec/rig.yaml --recording {path}"
    found, _ = tracked(quickly, mcap[0], command, tmp_path / "out")
    np.testing.assert_array_equal(found.poses, poses.poses)
    np.testing.assert_array_equal(found.times, poses.times)


def raw_images(messages):
    """Other topics' names, raw images, times of a clock, the second camera a little later."""
    import cv2

    for topic, kind, time, message in messages:
        if hasattr(message, "header"):
            stamp = message.header.stamp
            late = 4_000_000 if "/left/" in topic else 0
            now = 1_700_000_000_000_000_000 + stamp.sec * 10**9 + stamp.nanosec + late
            stamp.sec, stamp.nanosec = divmod(now, 10**9)
        if kind.endswith("CompressedImage"):
            image = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_COLOR)
            kind = "sensor_msgs/msg/Image"
            message = STORE.types[kind](
                header=message.header, height=240, width=320, encoding="bgr8", is_bigendian=0,
                step=960, data=image.reshape(-1),
            )  # fmt: skip
            topic = topic.replace("image/compressed", "image_raw")
        yield (
            topic.replace("/left", "/stereo/left").replace("/right", "/stereo/right"),
            kind,
            time,
            message,
        )


def test_raw_images_of_cameras_out_of_step(mcap, poses, options, tmp_path, quickly):
    messages = [
        m for m in raw_images(messages_of(mcap[0] / "rec/rec.mcap")) if not m[0].startswith("/tf")
    ]
    write_independently(tmp_path / "a.mcap", messages)
    command = (
        f"{options} --rig rec/rig.yaml --recording {tmp_path / 'a.mcap'} --motion "
        f"{tmp_path / 'm.tum'}"
    )
    motion = LoadTrajectory(mcap[0] / "rec/motion.tum")
    SaveTrajectory(Trajectory(1_700_000_000 + motion.times, motion.poses), tmp_path / "m.tum")
    found, _ = tracked(quickly, mcap[0], command, tmp_path / "out")
    np.testing.assert_allclose(found.poses, poses.poses, atol=2e-4)
    np.testing.assert_allclose(found.times, 1_700_000_000 + poses.times, rtol=0, atol=1e-6)


def test_what_has_no_partner_is_left_out_and_told(mcap, options, tmp_path, quickly):
    messages = [
        m
        for m in messages_of(mcap[0] / "rec/rec.mcap")
        if not (m[0].startswith("/left/image") and m[2] in (99_000_000, 198_000_000))
    ]
    write_independently(tmp_path / "a.mcap", messages)
    command = f"{options} --rig rec/rig.yaml --recording {tmp_path / 'a.mcap'}"
    found, _ = tracked(quickly, mcap[0], command, tmp_path / "out")
    np.testing.assert_allclose(found.times, 0.033 * np.delete(np.arange(10), [3, 6]), atol=1e-9)
    true = LoadTrajectory(mcap[0] / "rec/true_poses.tum").poses[[0, 1, 2, 4, 5, 7, 8, 9]]
    assert np.linalg.norm((found.poses - true)[:, :3], axis=1).max() < 0.003


def test_the_warning_of_what_was_left_out_is_one_line(mcap, tmp_path):
    messages = [
        m
        for m in messages_of(mcap[0] / "rec/rec.mcap")
        if not (m[0].startswith("/left/image") and m[2] in (99_000_000, 198_000_000))
    ]
    write_independently(tmp_path / "a.mcap", messages)
    opened = open_recording(tmp_path / "a.mcap")
    assert opened.count == 8
    assert "without a partner within 16.5 ms: 2 of 'right', 0 of 'left'" in opened.warning
    assert "\n" not in opened.warning
    assert open_recording(mcap[0] / "rec/rec.mcap").warning == ""


def test_a_motion_that_ends_too_early_is_told(mcap):
    motion = LoadTrajectory(mcap[0] / "rec/motion.tum")
    short = Trajectory(motion.times[:6], motion.poses[:6])
    opened = open_recording(mcap[0] / "rec/rec.mcap", motion=short)
    assert opened.warning.endswith("rec.mcap; the motion is not known at 4 of 10 frames")
    assert [frame.pose_WC is None for frame in opened] == 6 * [False] + 4 * [True]


def test_a_rectified_pair_is_placed_by_its_matrices(mcap, tmp_path):
    messages = [
        (topic.replace("image/", "image_rect_color/"), *rest)
        for topic, *rest in messages_of(mcap[0] / "rec/rec.mcap")
        if topic != "/tf_static"
    ]
    write_independently(tmp_path / "a.mcap", messages)
    rig = open_recording(tmp_path / "a.mcap").rig
    np.testing.assert_allclose(rig.cameras[1].p_CK, [-0.15, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(rig.cameras[1].R_CK, np.eye(3))


def test_topics_are_chosen_by_name(mcap, options, tmp_path, quickly):
    """The other way round: the left camera's frame is then the rig's."""
    command = (
        f"{options} --recording rec/rec.mcap --start random --images a=/left/image b=/right/image"
    )
    command = command.replace(" --start rec/start.tum", "")
    _, finished = tracked(quickly, mcap[0], command, tmp_path / "out")
    assert "cameras a (/left/image/compressed), b (/right/image/compressed)" in finished.stdout
    opened = open_recording(
        mcap[0] / "rec/rec.mcap", images={"a": "/left/image", "b": "/right/image"}
    )
    np.testing.assert_allclose(opened.rig.cameras[1].p_CK, [0.15, 0, 0])
    assert opened.frame == "left_optical_frame"


def test_motion_comes_from_a_topic_or_not_at_all(mcap):
    path = mcap[0] / "rec/rec.mcap"
    true = LoadTrajectory(mcap[0] / "rec/true_poses.tum")
    by_topic = list(open_recording(path, motion="/target/true_pose"))
    np.testing.assert_array_equal([frame.pose_WC for frame in by_topic], true.poses)
    assert {frame.pose_WC is None for frame in open_recording(path, motion="none")} == {True}


# What cannot be used


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("--recording nowhere.mcap", ["nowhere.mcap", "no such recording"]),
        ("--recording rec/rig.yaml", ["rec/rig.yaml", "not a recording", "MCAP"]),
        ("--recording rec", ["rec", "metadata.yaml"]),
        ("--recording rec/cut.mcap", ["rec/cut.mcap", "not a recording"]),
        ("--recording rec/rec.mcap --images a=/top/image", ["'/top/image'", "/left/image"]),
        ("--recording rec/rec.mcap --motion /top", ["no motion '/top'", "/target/true_pose"]),
        (
            "--recording rec/rec.mcap --rig rec/three.yaml",
            ["no images of camera 'top'", "--images"],
        ),
        ("--recording rec/rec.mcap --mcap-out a.txt", ["--mcap-out a.txt", ".mcap"]),
        ("--rig rec/rig.yaml", ["--images", "--recording"]),
        ("", ["--rig", "--recording"]),
    ],
)
def test_what_cannot_be_tracked_is_named(mcap, options, tmp_path, quickly, more, words):
    rec = mcap[0] / "rec"
    (rec / "cut.mcap").write_bytes((rec / "rec.mcap").read_bytes()[:300])
    text = (rec / "rig.yaml").read_text()
    top = "{width: 3, height: 3, fx: 1, fy: 1, cx: 1, cy: 1, X_CK: {translation: [0, 0, 0]}}"
    (rec / "three.yaml").write_text(f"{text}\n  top: {top}\n")
    finished = quickly(f"{options.removeprefix('mffdrake ')} {more} --out {tmp_path}/out", mcap[0])
    assert finished.returncode == 2, finished.stdout
    (line,) = finished.stderr.splitlines()
    for word in words:
        assert word in line, line


def test_record_refuses_another_suffix(tmp_path, quickly):
    finished = quickly("record --mcap a.bag --out rec", tmp_path)
    assert finished.returncode == 2
    assert "--mcap a.bag: the file must end in .mcap" in finished.stderr


@pytest.mark.parametrize("command", ["record --mcap a.mcap", "{options} --recording rec/rec.mcap"])
def test_without_the_libraries_one_line_says_what_to_install(mcap, options, command):
    """In a process that cannot import them."""
    code = (
        "import sys; sys.modules['rosbags'] = sys.modules['rosbags.typesys'] = None\n"
        "from mffdrake.experiment.commands.main import main\n"
        f"sys.exit(main({shlex.split(command.format(options=options))!r}))"
    )
    code = code.replace("['mffdrake', ", "[")
    finished = subprocess.run(
        [sys.executable, "-c", code], cwd=mcap[0], capture_output=True, text=True, check=False
    )
    assert finished.returncode == 2
    (line,) = finished.stderr.splitlines()
    assert "pip install 'mffdrake[ros]'" in line
