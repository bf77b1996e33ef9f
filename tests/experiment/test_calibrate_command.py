"""`mffdrake calibrate hand-eye`: from two files of poses to the camera's place on the hand."""

import re

import numpy as np
import pytest

from mffdrake.experiment.commands.main import main
from mffdrake.recognition.poses.pose import (
    pose_from_transform,
    rotation_matrix,
    transform_from_pose,
)
from mffdrake.recognition.recordings.rig_file import LoadRig
from mffdrake.recognition.recordings.trajectory import PoseAt, SaveTrajectory, Trajectory

X_EC = np.array([0.02, -0.155, 0.03, 0.05, -0.1, 0.7])
X_BM = np.array([1.7, 0.1, 0.45, -0.5, 0.4, -0.5])


def seen_from(X_BE):
    """The target in the camera."""
    (R, p), (S, q), (T, t) = map(transform_from_pose, (X_BE, X_EC, X_BM))
    R_BC, p_BC = R @ S, R @ q + p
    return pose_from_transform(R_BC.T @ T, R_BC.T @ (t - p_BC))


def write(folder, *, turn_deg=30.0, axes=3, noise=0.0, start=0.0):
    """A second of a hand's motion at 500 Hz, and of tracked poses at 30 Hz."""
    rng = np.random.default_rng(0)
    times = np.linspace(start, start + 1.0, 501)
    waves = np.sin(2 * np.pi * np.outer(times, [1.0, 1.7, 2.3]) + [0.0, 1.0, 2.0])
    turns = np.radians(turn_deg) * waves * (np.arange(3) < axes)
    hand = pose_from_transform(rotation_matrix(0.5 * turns), 0.1 * waves[:, ::-1] + [1.0, 0.0, 0.5])
    SaveTrajectory(Trajectory(times, hand), folder / "hand.tum")
    when = np.arange(0.01, 0.95, 1 / 30)
    poses = np.array([seen_from(PoseAt(times - start, hand, t)) for t in when])
    poses[:, :3] += rng.normal(0.0, noise, (len(when), 3))
    SaveTrajectory(Trajectory(when, poses), folder / "poses.tum")


def calibrate(folder, capfd, caplog):
    caplog.clear()
    status = main(f"calibrate hand-eye --poses {folder}/poses.tum --hand {folder}/hand.tum".split())
    printed = capfd.readouterr()
    return status, printed.out, printed.err + caplog.text


def test_it_prints_the_camera_s_pose_in_three_ways(tmp_path, capfd, caplog):
    write(tmp_path)
    status, out, problems = calibrate(tmp_path, capfd, caplog)
    assert (status, problems) == (0, "")
    assert out.startswith("29 poses\n")
    translation = re.search("translation x y z .m.: (.*)", out)[1].split()
    np.testing.assert_allclose([float(c) for c in translation], X_EC[:3], atol=1e-4)
    quaternion = [float(c) for c in re.search("quaternion qx qy qz qw: (.*)", out)[1].split()]
    np.testing.assert_allclose(quaternion[:3], X_EC[3:], atol=1e-4)
    assert np.linalg.norm(quaternion) == pytest.approx(1.0)
    numbers = "width: 3, height: 3, fx: 1, fy: 1, cx: 1, cy: 1"
    (tmp_path / "rig.yaml").write_text(
        f"cameras: {{a: {{{numbers}, X_CK: {out.splitlines()[-1]}}}}}"
    )
    camera = LoadRig(tmp_path / "rig.yaml").cameras[0]
    np.testing.assert_allclose(camera.p_CK, X_EC[:3], atol=1e-4)
    np.testing.assert_allclose(camera.R_CK, rotation_matrix(X_EC[3:]), atol=1e-4)


def test_a_scenario_takes_it(tmp_path, capfd, caplog):
    from mffdrake.experiment.scenario.scenario import LoadScenario

    write(tmp_path)
    _, out, _ = calibrate(tmp_path, capfd, caplog)
    text = f"cameras: [{{name: a, X_PB: {out.splitlines()[-1]}}}]"
    X_PB = LoadScenario(text=text).cameras[0].X_PB.GetDeterministicValue()
    np.testing.assert_allclose(X_PB.rotation().matrix(), rotation_matrix(X_EC[3:]), atol=1e-4)


def test_residuals_tell_the_noise(tmp_path, capfd, caplog):
    write(tmp_path, noise=1e-3)
    _, out, problems = calibrate(tmp_path, capfd, caplog)
    residual = float(re.search(r"mean square: ([\d.]+) mm", out)[1])
    assert residual == pytest.approx(np.sqrt(3.0), rel=0.3)
    assert problems == ""


def test_little_rotation_is_warned_of(tmp_path, capfd, caplog):
    write(tmp_path, turn_deg=4.0)
    status, _, problems = calibrate(tmp_path, capfd, caplog)
    assert status == 0
    assert "about a second axis" in problems and "10 deg or more" in problems


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axes": 1}, ["second axis", "two axes"]),
        ({"start": 100.0}, ["hand.tum", "100.000 to 101.000 s"]),
    ],
)
def test_what_tells_nothing_is_said(tmp_path, capfd, caplog, change, words):
    write(tmp_path, **change)
    status, _, problems = calibrate(tmp_path, capfd, caplog)
    assert status == 2
    (line,) = problems.splitlines()
    for word in words:
        assert word in line


def test_poses_beyond_the_hand_s_are_left_out_and_told(tmp_path, capfd, caplog):
    write(tmp_path)
    lines = (tmp_path / "hand.tum").read_text().splitlines()
    (tmp_path / "hand.tum").write_text("\n".join(lines[:400]))
    status, out, problems = calibrate(tmp_path, capfd, caplog)
    assert status == 0 and out.startswith("24 poses")
    assert "left out 5 of 29 poses" in problems


def test_no_such_file(tmp_path, capfd, caplog):
    status, _, problems = calibrate(tmp_path, capfd, caplog)
    assert status == 2 and "poses.tum" in problems
