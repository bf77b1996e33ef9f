"""Messages of ROS: what is written comes back, and what others write is understood."""

import math

import numpy as np
import pytest

pytest.importorskip("rosbags")

from mffdrake.recognition import Camera, CameraRig
from mffdrake.recognition.camera.distortion import Distortion
from mffdrake.recognition.ros.frames import Frames
from mffdrake.recognition.ros.matching import half_frame, match_stamps
from mffdrake.recognition.ros.messages import (
    RosError,
    camera_info,
    camera_of,
    make,
    pose_message,
    pose_of,
    stamped,
    transform_message,
)
from mffdrake.recognition.ros.pixels import decode

POSES = np.random.default_rng(3).uniform(-0.5, 0.5, (50, 6))


def test_poses_come_back_to_the_bit():
    for pose in POSES:
        np.testing.assert_array_equal(pose_of(pose_message(pose)), pose)
        np.testing.assert_array_equal(pose_of(transform_message(pose, 0, "a", "b")), pose)


def test_what_is_no_pose_is_named():
    with pytest.raises(RosError, match="Header has no pose"):
        pose_of(stamped(0, "a"))
    message = pose_message(np.zeros(6))
    message.orientation.w = 0.0
    with pytest.raises(RosError, match="norm 1, not 0"):
        pose_of(message)


def test_times_before_zero_are_times():
    stamp = stamped(-33_000_000, "a").stamp
    assert stamp.sec * 10**9 + stamp.nanosec == -33_000_000


@pytest.mark.parametrize(
    ("distortion", "model", "count"),
    [
        (Distortion(), "plumb_bob", 5),
        (Distortion("plumb_bob", (-0.2, 0.05, 0.001, 0.002)), "plumb_bob", 5),
        (Distortion("plumb_bob", (-0.2, 0.05, 0.001, 0.002, 0.01)), "plumb_bob", 5),
        (Distortion("plumb_bob", (0.1, 0.2, 0, 0, 0.3, 0.4, 0.5, 0.6)), "rational_polynomial", 8),
        (Distortion("equidistant", (0.01, 0.02, 0.03, 0.04)), "equidistant", 4),
    ],
)
def test_cameras_come_back(distortion, model, count):
    camera = Camera(
        name="a", width=64, height=48, fx=50.5, fy=51.5, cx=31.25, cy=23.75, distortion=distortion
    )
    info = camera_info(camera, 5, "a_frame")
    assert (info.distortion_model, len(info.d)) == (model, count)
    back = camera_of(info, "b", "here")
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(back, key) == getattr(camera, key)
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 1.0], [0.2, 0.2, 2.0], (20, 3))
    np.testing.assert_array_equal(back.project(points), camera.project(points))
    assert (back.name, back.calibration_error) == ("b", 0.5)


def test_the_matrix_p_projects_the_other_camera_of_a_pair():
    left = CameraRig.stereo(fov_y=math.radians(40)).cameras[1]
    P = camera_info(left, 0, "a").p.reshape(3, 4)
    u, v, w = P @ [0.1, 0.2, 0.9, 1.0]
    np.testing.assert_allclose([u / w, v / w], left.project([0.1, 0.2, 0.9]))


# Images


def raw(encoding, array, step=None):
    height, width = array.shape[:2]
    rows = np.ascontiguousarray(array).reshape(height, -1)
    step = step or rows.shape[1]
    data = np.pad(rows, ((0, 0), (0, step - rows.shape[1]))).reshape(-1)
    return make(
        "sensor_msgs/Image",
        header=stamped(0, "a"), height=height, width=width, encoding=encoding, is_bigendian=0,
        step=step, data=data,
    )  # fmt: skip


IMAGE = np.random.default_rng(1).integers(0, 256, (6, 8, 3), dtype=np.uint8)
ALPHA = np.full((6, 8, 1), 255, np.uint8)


@pytest.mark.parametrize(
    ("encoding", "array"),
    [
        ("rgb8", IMAGE),
        ("bgr8", IMAGE[:, :, ::-1]),
        ("8UC3", IMAGE[:, :, ::-1]),
        ("rgba8", np.dstack([IMAGE, ALPHA])),
        ("bgra8", np.dstack([IMAGE[:, :, ::-1], ALPHA])),
    ],
)
@pytest.mark.parametrize("padding", [0, 5])
def test_raw_images_are_rgb(encoding, array, padding):
    step = array.shape[1] * array.shape[2] + padding
    np.testing.assert_array_equal(decode(raw(encoding, array, step), "a"), IMAGE)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_are_named_from_the_first_pixel(pattern):
    color = np.array([200, 100, 50], np.uint8)
    tile = np.array([color["rgb".index(letter)] for letter in pattern]).reshape(2, 2)
    image = decode(raw(f"bayer_{pattern}8", np.tile(tile, (4, 4))), "a")
    np.testing.assert_array_equal(image[2:-2, 2:-2], np.broadcast_to(color, (4, 4, 3)))


def test_yuv_is_rgb():
    grey = np.empty((4, 8, 2), np.uint8)
    grey[..., 0], grey[..., 1] = 128, 180  # U or V, and Y
    image = decode(raw("yuv422", grey), "a")
    assert np.ptp(image) <= 1 and abs(int(image.mean()) - 191) < 3


@pytest.mark.parametrize(
    ("encoding", "word"), [("mono8", "grey"), ("16UC1", "grey"), ("nv24", "no encoding that is")]
)
def test_what_has_no_colors_is_named(encoding, word):
    with pytest.raises(RosError, match=f"here: .*{word}.*rgb8"):
        decode(raw(encoding, IMAGE), "here")


def test_an_image_with_too_few_bytes_is_named():
    message = raw("rgb8", IMAGE)
    message.data = message.data[:-1]
    with pytest.raises(RosError, match="8 x 6 pixels lacks bytes"):
        decode(message, "here")


# Matching


def matched(*stamps, tolerance):
    return match_stamps([np.array(s, dtype=np.int64) for s in stamps], tolerance).tolist()


def test_equal_times_are_partners():
    assert matched([0, 10, 20], [0, 10, 20], tolerance=5) == [[0, 0], [1, 1], [2, 2]]


def test_the_nearest_one_is_the_partner():
    assert matched([0, 10, 20], [3, 13, 23], tolerance=5) == [[0, 0], [1, 1], [2, 2]]


def test_what_has_no_partner_is_left_out():
    assert matched([0, 10, 20, 30], [0, 20, 30], tolerance=5) == [[0, 0], [2, 1], [3, 2]]
    assert matched([10, 20], [0, 10, 20, 30], tolerance=5) == [[0, 1], [1, 2]]
    assert matched([0, 10], [0, 10], [1000], tolerance=5) == []
    assert matched([0, 10], [], tolerance=5) == []


def test_no_image_is_in_two_frames():
    assert matched([0, 4, 20], [3, 20], tolerance=5) == [[1, 0], [2, 1]]


def test_the_order_in_the_file_does_not_matter():
    assert matched([20, 0, 10], [10, 20, 0], tolerance=5) == [[1, 2], [2, 0], [0, 1]]


def test_half_a_frame_is_told_by_the_times_or_the_rate():
    assert half_frame(np.array([0, 30, 10, 20]), 1.0) == 5
    assert half_frame(np.array([7]), 100.0) == 5_000_000


# Frames


def tree(*edges):
    frames = Frames()
    for parent, child, pose, stamp in edges:
        transform = transform_message(np.asarray(pose, float), stamp or 0, parent, child)
        frames.add([transform], fixed=stamp is None)
    return frames


def at(x):
    return [x, 0, 0, 0, 0, 0]


def test_a_camera_moves_with_what_carries_it():
    frames = tree(
        ("base", "tool", at(1.0), 100), ("base", "tool", at(2.0), 200),
        ("tool", "eye", at(0.5), None),
    )  # fmt: skip
    assert frames.moves("eye") and not frames.moves("base")
    assert frames.ancestors("eye") == ["eye", "tool", "base"]
    np.testing.assert_allclose(frames.in_root("eye", 150), at(2.0))
    assert frames.in_root("eye", 99) is None and frames.in_root("eye", 201) is None


def test_frames_are_placed_by_fixed_transforms_only():
    frames = tree(
        ("rig", "right", at(1.0), None), ("rig", "left", at(3.0), None), ("rig", "arm", at(1.0), 5)
    )  # fmt: skip
    np.testing.assert_allclose(frames.between("right", "left"), at(2.0))
    np.testing.assert_array_equal(frames.between("rig", "left"), at(3.0))
    assert frames.between("right", "arm") is None
    assert frames.between("right", "elsewhere") is None


def test_a_loop_ends():
    assert tree(("a", "b", at(1), None), ("b", "a", at(1), None)).ancestors("a") == ["a", "b"]
