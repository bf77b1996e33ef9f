"""A motion that predicts worse than none: the target moves with the cameras."""

import dataclasses as dc
import re

import numpy as np
import pytest

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.record import Record, TrackCommand
from mffdrake.recognition import Estimate
from mffdrake.recognition.recordings.recording import MotionWarning, RecordingFrame, TrackedFrame
from mffdrake.recognition.recordings.trajectory import LoadTrajectory, SaveTrajectory, Trajectory

SURE = 0.6
WARNING = "motion feedforward made the prediction worse than none"
TEXT = """
renderer: flat
duration: 0.5
disturbances: [!GaussianNoise {deviation: 2}]   # No image is the last one's copy.
camera: {width: 320, height: 240}
recognizer: {start: near_target, refinement: REFINEMENT}
hand_path: {amplitude_deg: AMPLITUDE, omega: 0.314}
"""


def record(folder, *, amplitude, refinement="borders"):
    """Records a small scenario; returns the command that tracks it."""
    text = TEXT.replace("REFINEMENT", refinement).replace("AMPLITUDE", str(amplitude))
    scenario = LoadScenario(text=text)
    Record(scenario, folder)
    return TrackCommand(scenario, folder)


@pytest.fixture
def warnings(quickly, tmp_path, caplog):
    """What tracking warns of."""

    def of(command):
        finished = quickly(command.removeprefix("mffdrake "), tmp_path)
        assert finished.returncode == 0, finished.stderr
        told = [record.getMessage() for record in caplog.records]
        caplog.clear()
        return told

    return of


def lie(folder, step):
    """The rig is said to move sideways, so many meters a frame."""
    motion = LoadTrajectory(folder / "motion.tum")
    poses = motion.poses.copy()
    poses[:, 1] += step * np.arange(len(poses))
    SaveTrajectory(Trajectory(motion.times, poses), folder / "motion.tum")


@pytest.mark.parametrize("refinement", ["borders", "none"])
def test_a_target_that_moves_with_the_cameras_is_warned_of(refinement, tmp_path, warnings):
    """Nothing moves but the motion: for the images, that is a target that moves along."""
    command = record(tmp_path, amplitude=0.001, refinement=refinement)
    assert warnings(command) == []
    lie(tmp_path, 0.004)
    (line,) = warnings(command)
    told = re.search(rf"{WARNING} \(median (\S+) mm against (\S+) mm, along", line)
    with_motion, without = map(float, told.groups())
    assert 2.0 < with_motion < 6.0
    assert without < 0.5 * with_motion
    assert "leave --motion out" in line


def test_a_true_motion_is_not_warned_of(tmp_path, warnings):
    assert warnings(record(tmp_path, amplitude=15)) == []


def test_a_motion_below_the_noise_is_not_warned_of(tmp_path, warnings):
    command = record(tmp_path, amplitude=0.001)
    lie(tmp_path, 0.0005)
    assert warnings(command) == []


# The frames that count.


def frames(count=8, *, step=0.01, fitness=0.9, std=np.nan, seen=lambda k: 0.0):
    """A rig that moves by step [m] a frame, and where the target is seen."""
    tracked = []
    for k in range(count):
        pose_WC, pose = np.zeros(6), np.array([seen(k), 0.0, 0.8, 0.0, 0.0, 0.0])
        pose_WC[0] = step * k
        estimate = Estimate(pose, fitness, k, covariance=std**2 / 3 * np.eye(6), refined=std > 0.0)
        tracked.append(TrackedFrame(RecordingFrame(k, 0.1 * k, (), pose_WC), estimate, 1.0))
    return tracked


def test_it_tells_the_medians():
    said = MotionWarning(frames(seen=lambda k: 0.001 * (k % 2)), SURE)
    assert "(median 11.0 mm against 1.0 mm, along the motion)" in said


def test_what_is_off_across_the_motion_does_not_count():
    uneven = frames()
    for frame in uneven[::2]:
        frame.estimate.pose[2] += 0.1
    assert "(median 10.0 mm against 0.0 mm" in MotionWarning(uneven, SURE)


def test_a_target_at_rest_is_well_predicted():
    assert MotionWarning(frames(seen=lambda k: -0.01 * k), SURE) is None


def test_the_same_with_and_without_is_no_reason():
    assert MotionWarning(frames(seen=lambda k: -0.005 * k), SURE) is None


@pytest.mark.parametrize(
    "options", [{"fitness": 0.5}, {"count": 5}, {"step": 0.0009}, {"std": 0.006}], ids=str
)
def test_unsure_few_and_small_are_no_reason(options):
    assert MotionWarning(frames(), SURE) is not None
    assert MotionWarning(frames(**options), SURE) is None


def test_a_refined_pose_is_sure():
    assert MotionWarning(frames(fitness=0.1, std=0.0001), SURE) is not None


def test_without_motion_there_is_nothing_to_warn_of():
    still = [
        dc.replace(frame, recorded=dc.replace(frame.recorded, pose_WC=None)) for frame in frames()
    ]
    assert MotionWarning(still, SURE) is None
