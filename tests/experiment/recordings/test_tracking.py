"""What makes a recording whole, which of its frames count and when, and what a frame's row says."""

import dataclasses as dc

import numpy as np
import pytest

from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    CameraRig,
    Estimate,
    NearStart,
    PoseTracker,
    SolidModel,
)
from mffdrake.recognition.recordings.recording import (
    Recording,
    RecordingError,
    TrackedFrame,
    TrackRecording,
)
from mffdrake.recognition.recordings.trajectory import Trajectory

RIG = CameraRig.stereo(width=16, height=12)


class Images:
    """Images in memory, each of one grey; their number is known or not."""

    def __init__(self, count, *, told=True, size=(12, 16), first=0):
        self.count = count if told else None
        self._images = [np.full((*size, 3), first + k, dtype=np.uint8) for k in range(count)]
        self.taken = 0

    def __iter__(self):
        for image in self._images:
            self.taken += 1
            yield image


def motion(count):
    """A rig that moves sideways, with odd times."""
    poses = np.zeros((count, 6))
    poses[:, 0] = 0.01 * np.arange(count)
    return Trajectory(5.0 + np.arange(count) ** 2, poses)


def both(count, **options):
    return {"right": Images(count, **options), "left": Images(count, **options)}


# Which frames count, and when they were


def test_frames_have_their_numbers_times_and_images():
    frames = list(Recording(rig=RIG, sources=both(3), rate=20.0))
    assert [frame.frame for frame in frames] == [0, 1, 2]
    assert [frame.time for frame in frames] == [0.0, 0.05, 0.1]
    assert [[int(image[0, 0, 0]) for image in frame.images] for frame in frames] == [
        [0, 0], [1, 1], [2, 2],
    ]  # fmt: skip
    assert all(frame.pose_WC is None for frame in frames)


def test_images_come_in_the_rig_s_order():
    sources = {"left": Images(1, first=77), "right": Images(1)}
    (frame,) = Recording(rig=RIG, sources=sources)
    assert [int(image[0, 0, 0]) for image in frame.images] == [0, 77]


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize(("stride", "numbers"), [(1, range(7)), (2, range(0, 7, 2)), (9, [0])])
def test_every_nth_frame_counts(stride, numbers, told):
    recording = Recording(rig=RIG, sources=both(7, told=told), stride=stride, rate=10.0)
    frames = list(recording)
    assert [frame.frame for frame in frames] == list(numbers)
    assert [int(frame.images[1][0, 0, 0]) for frame in frames] == list(numbers)
    np.testing.assert_allclose([frame.time for frame in frames], np.array(numbers) / 10.0)
    assert recording.count == (len(frames) if told else None)


def test_the_motion_tells_when_and_where():
    """A line is a frame, also of those that do not count; lines may be left over."""
    frames = list(Recording(rig=RIG, sources=both(5), motion=motion(8), stride=2, rate=10.0))
    assert [frame.time for frame in frames] == [5.0, 9.0, 21.0]
    np.testing.assert_array_equal([f.pose_WC[0] for f in frames], motion(8).poses[[0, 2, 4], 0])


def test_a_recording_can_be_gone_through_again_and_reads_as_it_goes():
    sources = both(4)
    recording = Recording(rig=RIG, sources=sources)
    next(iter(recording))
    assert sources["left"].taken == 1
    assert len(list(recording)) == len(list(recording)) == 4


def test_a_recording_without_images_has_no_frames():
    recording = Recording(rig=RIG, sources=both(0))
    assert (recording.count, list(recording)) == (0, [])


# What is not whole


def test_every_camera_must_have_images_and_no_other():
    with pytest.raises(RecordingError, match="no images of camera 'left'; .* cameras right, left"):
        Recording(rig=RIG, sources={"right": Images(1)})
    with pytest.raises(RecordingError, match="images of a camera 'top', but .* right, left"):
        Recording(rig=RIG, sources={**both(1), "top": Images(1)})


def test_cameras_must_have_as_many_images_as_each_other():
    with pytest.raises(RecordingError, match="not 3 of 'right', 2 of 'left'"):
        Recording(rig=RIG, sources={"right": Images(3), "left": Images(2)})
    with pytest.raises(RecordingError, match="not 3 of 'right', 0 of 'left'"):
        Recording(rig=RIG, sources={"right": Images(3), "left": Images(0)})


def taken_before_error(recording, message):
    """Numbers of the frames that there are before an error."""
    frames = []
    with pytest.raises(RecordingError, match=message):
        for frame in recording:
            frames.append(frame.frame)
    return frames


@pytest.mark.parametrize("stride", [1, 4])
def test_where_that_shows_at_the_end_only_the_frames_before_are_there(stride):
    """Also when the frame that lacks an image would not count."""
    sources = {"right": Images(6), "left": Images(5, told=False)}
    recording = Recording(rig=RIG, sources=sources, stride=stride)
    message = "frame 5: no image of camera 'left'; its images end before the others'"
    assert taken_before_error(recording, message) == list(range(0, 5, stride))


def test_an_image_must_fit_its_camera():
    sources = {"right": Images(3), "left": Images(3, size=(12, 20))}
    message = r"frame 0: camera 'left': .* \(12, 16, 3 or 4\), not .* \(12, 20, 3\)"
    assert taken_before_error(Recording(rig=RIG, sources=sources), message) == []


def test_the_motion_must_have_a_line_a_frame():
    recording = Recording(rig=RIG, sources=both(5), motion=motion(3))
    message = "frame 3: the motion has 3 lines only; there must be one line a frame"
    assert taken_before_error(recording, message) == [0, 1, 2]


# What is tracked


@pytest.fixture
def tracker():
    """A tracker in black images: whatever it does comes from its own numbers and the motion."""
    box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
    tracker = PoseTracker.of(RIG, box, channel_order="rgb", refine=False)
    start = NearStart(np.array([0.0, 0.155, 0.8, 0.0, 0.0, 0.0]))
    return PoseTracker(dc.replace(tracker.algorithm, start=start))


def test_feedforward_is_the_rig_s_motion_between_the_frames_that_count(tracker):
    """What `PoseTracker` does with that motion, given by hand."""
    sources = both(7)
    recording = Recording(rig=RIG, sources=sources, motion=motion(7), stride=3)
    frames = list(TrackRecording(tracker, recording))
    by_hand = PoseTracker(tracker.algorithm)
    X_DC = np.column_stack([np.eye(3), [-0.03, 0.0, 0.0]])  # three steps of 10 mm to the right
    for frame, X in zip(frames, [None, X_DC, X_DC], strict=True):
        expected = by_hand.track(frame.recorded.images, X)
        np.testing.assert_allclose(frame.estimate.pose, expected.pose, rtol=0, atol=1e-12)
    still = list(TrackRecording(PoseTracker(tracker.algorithm), dc.replace(recording, motion=None)))
    np.testing.assert_array_equal(still[0].estimate.pose, frames[0].estimate.pose)
    assert abs(still[1].estimate.pose[0] - frames[1].estimate.pose[0]) > 0.02


def test_the_first_frame_alone_is_searched(tracker):
    generations = []
    frames = list(
        TrackRecording(
            tracker, Recording(rig=RIG, sources=both(3)), generations=7,
            on_generation=lambda number, fitness: generations.append(number),
        )
    )  # fmt: skip
    assert [frame.found is not None for frame in frames] == [True, False, False]
    assert frames[0].found.num_generations == generations[-1] == 7
    assert [frame.estimate.frame for frame in frames] == [0, 1, 2]
    assert all(frame.ms > 0.0 for frame in frames)


def test_nothing_is_searched_unless_that_is_wanted(tracker):
    frames = list(TrackRecording(tracker, Recording(rig=RIG, sources=both(2))))
    assert [frame.found for frame in frames] == [None, None]


# What is said of a frame


def frame_of(covariance=None):
    recording = Recording(rig=RIG, sources=both(1))
    pose = np.array([0.1, -0.2, 0.3, 0.6, 0.0, 0.0])
    estimate = Estimate(pose, 0.75, 0)
    if covariance is not None:
        estimate = dc.replace(estimate, covariance=covariance, refined=True)
    return TrackedFrame(next(iter(recording)), estimate, 12.5)


def test_a_row_has_the_promised_columns():
    row = frame_of().Row()
    expected = {
        "frame": 0, "time": 0.0, "x": 0.1, "y": -0.2, "z": 0.3, "qx": 0.6, "qy": 0.0, "qz": 0.0,
        "qw": 0.8, "fitness": 0.75, "refined": 0, "std_position_mm": None, "std_rotation_deg": None,
        "ms": 12.5, "state": "searching", "is_tracking": 0, "confidence": None,
    }  # fmt: skip
    assert list(row) == list(expected)
    assert row == expected


def test_a_refined_pose_s_deviations_are_in_mm_and_degrees():
    """A spread of a hundredth about the axis that it is turned about: deps = eta/2 dtheta there."""
    covariance = np.diag([1e-6, 4e-6, 4e-6, (0.4 * 0.01) ** 2, 0.0, 0.0])
    row = frame_of(covariance).Row()
    assert row["refined"] == 1
    assert row["std_position_mm"] == pytest.approx(3.0)
    assert row["std_rotation_deg"] == pytest.approx(np.degrees(0.01))


def test_without_its_images_a_frame_is_the_same():
    frame = frame_of()
    light = frame.WithoutImages()
    assert (len(frame.recorded.images), light.recorded.images) == (2, ())
    assert light.Row() == frame.Row()
    assert light.estimate is frame.estimate
