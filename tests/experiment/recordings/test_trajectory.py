"""Poses as text: what was written comes back to the bit, and a wrong line is named."""

import math

import numpy as np
import pytest

from mffdrake.recognition.poses.pose import rotation_matrix
from mffdrake.recognition.recordings.trajectory import (
    LoadPose,
    LoadTrajectory,
    SaveTrajectory,
    Trajectory,
    TrajectoryError,
)


def written(folder, text):
    path = folder / "poses.tum"
    path.write_text(text, encoding="utf-8")
    return path


def random_poses(count):
    rng = np.random.default_rng(5)
    q = rng.normal(size=(count, 4))
    q *= np.sign(q[:, 3:]) / np.linalg.norm(q, axis=1, keepdims=True)
    return np.column_stack([rng.normal(size=(count, 3)), q[:, :3]])


# What is written


def test_a_trajectory_comes_back_to_the_bit(tmp_path):
    half_turns = [[1e-300, 1e22, -0.1, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.6, -0.8, 0.0]]
    small_turns = [[0.1, 0.2, 0.3, 1e-9, -1e-17, 0.0], [0.1, 0.2, 0.3, 0.0, 0.0, 0.0]]
    poses = np.concatenate([random_poses(300), half_turns, small_turns])
    times = np.cumsum(np.random.default_rng(6).uniform(0.0, 0.1, len(poses)))
    SaveTrajectory(Trajectory(times, poses), tmp_path / "poses.tum")
    back = LoadTrajectory(tmp_path / "poses.tum")
    assert len(back) == len(poses)
    assert back.times.tobytes() == times.tobytes()
    np.testing.assert_array_equal(back.poses, poses)


def test_the_file_is_what_other_tools_read(tmp_path):
    """A number in each of eight columns, and a unit quaternion with its scalar last."""
    poses = random_poses(20)
    SaveTrajectory(Trajectory(np.arange(20) / 30.0, poses), tmp_path / "poses.tum")
    assert (tmp_path / "poses.tum").read_text().startswith("# time x y z qx qy qz qw\n")
    table = np.loadtxt(tmp_path / "poses.tum")
    np.testing.assert_array_equal(table[:, 1:7], poses)
    np.testing.assert_allclose(np.linalg.norm(table[:, 4:], axis=1), 1.0, rtol=0, atol=1e-15)
    assert (table[:, 7] >= 0.0).all()


# What is read


def test_comments_blank_lines_and_commas(tmp_path):
    text = "# time x y z\n\n1.5 1 2 3 0 0 0 1\n  # more\n\t2.5,4,5,6, 1,0,0,0\n"
    back = LoadTrajectory(written(tmp_path, text))
    np.testing.assert_array_equal(back.times, [1.5, 2.5])
    np.testing.assert_array_equal(back.poses, [[1, 2, 3, 0, 0, 0], [4, 5, 6, 1, 0, 0]])


def test_a_quaternion_and_its_negative_are_one_rotation(tmp_path):
    back = LoadTrajectory(written(tmp_path, "0 1 2 3 .1 .1 .7 .7\n0 1 2 3 -.1 -.1 -.7 -.7"))
    np.testing.assert_array_equal(back.poses[0], back.poses[1])
    assert (back.poses[0, 3:] > 0.0).all()


def test_a_rounded_quaternion_is_made_a_unit_one(tmp_path):
    q = np.array([0.1, -0.2, 0.3, 0.4]) / math.sqrt(0.3)
    rounded = " ".join(f"{c:.4f}" for c in q)
    pose = LoadPose(written(tmp_path, f"0 0 0 {rounded}"))
    expected = np.round(q, 4) / np.linalg.norm(np.round(q, 4))
    np.testing.assert_allclose(pose[3:], expected[:3], rtol=0, atol=1e-15)
    R = rotation_matrix(pose[3:])
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)


def test_one_pose_is_the_first_line_with_or_without_its_time(tmp_path):
    for text in ("# here\n1 2 3 1 0 0 0\n4 5 6 0 1 0 0", "9.5 1 2 3 1 0 0 0\n0 4 5 6 0 1 0 0"):
        np.testing.assert_array_equal(LoadPose(written(tmp_path, text)), [1, 2, 3, 1, 0, 0])


# Mistakes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no poses; each is a line of time x y z qx qy qz qw"),
        ("# time x y z qx qy qz qw\n", "no poses"),
        ("0 1 2 3 0 0 0 1\n# a\n0 1 2 3\n", "line 3 must be 8 numbers (time x y z qx qy qz qw), "),
        ("0 1 2 3 0 0 0 1 5", "line 1 must be 8 numbers"),
        ("0 1 2 three 0 0 0 1", "line 1 must be 8 numbers"),
        ("0 1 2 nan 0 0 0 1", "line 1 must be 8 numbers"),
        ("0 1 2 inf 0 0 0 1", "line 1 must be 8 numbers"),
        ("time,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1", "line 1 must be 8 numbers"),
        ("0 1 2 3 0 0 0 0", "a quaternion must have the norm 1, not 0"),
        ("0 1 2 3 0 0 0 1.002", "a quaternion must have the norm 1, not 1.002"),
    ],
)
def test_a_wrong_file_is_named_with_its_line(tmp_path, text, message):
    path = written(tmp_path, text)
    with pytest.raises(TrajectoryError) as caught:
        LoadTrajectory(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert len(str(caught.value).splitlines()) == 1


def test_a_trajectory_has_times_and_one_pose_need_not(tmp_path):
    path = written(tmp_path, "1 2 3 0 0 0 1")
    with pytest.raises(TrajectoryError, match="line 1 must be 8 numbers"):
        LoadTrajectory(path)
    with pytest.raises(TrajectoryError, match="line 1 must be 7 or 8 numbers"):
        LoadPose(written(tmp_path, "1 2 3 0 0 0"))


def test_files_that_are_no_text_or_not_there(tmp_path):
    (tmp_path / "poses.tum").write_bytes(b"\x89PNG\xff")
    for load in (LoadTrajectory, LoadPose):
        with pytest.raises(TrajectoryError, match="not a text file in UTF-8"):
            load(tmp_path / "poses.tum")
        with pytest.raises(FileNotFoundError):
            load(tmp_path / "none.tum")
