"""A target that moves, in the whole simulation."""

import numpy as np
import pytest

from mffdrake.experiment.scenario.scenario import LoadScenario, ScenarioError
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.recognition.recordings.trajectory import LoadTrajectory, SaveTrajectory, Trajectory

MOVING = """
duration: {duration}
renderer: flat
hand_path: {{omega: 0}}
target: {{motion: !Sinusoids {{amplitude: [0, 0.03, 0], amplitude_deg: [0, 0, 5], period: [2]}}}}
recognizer: {{refinement: borders, start: near_target}}
camera: {{latency: {latency}}}
"""


def load(duration=1.0, latency=0.0, text=""):
    scenario = LoadScenario(text=MOVING.format(duration=duration, latency=latency))
    return LoadScenario(text=text or "{}", defaults=scenario)


@pytest.mark.parametrize("latency", [0.0, 0.05])
def test_the_images_show_it_where_the_record_says(latency):
    """The recognizer knows nothing of the motion, and finds what the record calls true."""
    result = Simulate(load(latency=latency))
    assert np.ptp(result.true_pose[:, :3], axis=0).max() > 0.02
    error = np.linalg.norm((result.recognized_pose - result.true_pose)[3:, :3], axis=1)
    assert error.max() < 2e-3
    # The arm hardly moves, so that the pose's change is that of a latency ago.
    scenario = load(latency=latency)
    moved = [scenario.target.CalcPose(t - latency).translation() for t in result.time[[2, 20]]]
    seen = result.true_pose[[2, 20], :3]
    expected = np.linalg.norm(moved[1] - moved[0])
    assert np.linalg.norm(seen[1] - seen[0]) == pytest.approx(expected, abs=2e-3)


def test_a_file_of_poses_moves_it(tmp_path):
    still = load(duration=0.3, text="target: {motion: at_rest}")
    X_WM0 = still.target.CalcPose(0.0)
    times = np.array([0.0, 0.1, 0.3])
    shifts = np.array([[0, 0, 0], [0, 0.01, 0], [0, 0.01, 0.02]])
    start = pose_from_transform(X_WM0.rotation().matrix(), X_WM0.translation())
    poses = start + np.pad(shifts, ((0, 0), (0, 3)))
    file = tmp_path / "poses.tum"
    SaveTrajectory(Trajectory(times, poses), file)
    moved = load(duration=0.3, text=f"target: {{motion: !TrajectoryFile {{file: {file}}}}}")
    for t, shift in ((-1.0, shifts[0]), (0.05, shifts[1] / 2), (0.1, shifts[1]), (9.0, shifts[2])):
        X = moved.target.CalcPose(t)
        np.testing.assert_allclose(X.translation() - X_WM0.translation(), shift, atol=1e-9)
        np.testing.assert_allclose(X.rotation().matrix(), X_WM0.rotation().matrix(), atol=1e-9)
    assert len(LoadTrajectory(file)) == 3
    found = Simulate(moved).true_pose - Simulate(still).true_pose
    assert np.linalg.norm(found[-1, :3]) > 0.02


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("!TrajectoryFile {file: missing.tum}", "no file 'missing.tum' in the current folder, /"),
        ("!TrajectoryFile {}", "file"),
        ("!Sinusoids {period: [1, 2]}", "one number or of six"),
        ("!Wobble {}", "at_rest"),
        ("spin", "at_rest"),
    ],
)
def test_a_wrong_motion_is_one_clear_line(text, message):
    with pytest.raises(ScenarioError, match="target.motion") as caught:
        LoadScenario(text=f"target: {{motion: {text}}}")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_target_that_leaves_the_search_range_is_told(caplog):
    MakeHandEyeDiagram(load(text="target: {motion: !Straight {velocity: [0, 1, 0]}}"))
    assert any("outside the search range" in record.message for record in caplog.records)
