"""Hand-eye calibration of synthetic poses, whose X_EC is known."""

import numpy as np
import pytest

from mffdrake.recognition.camera.hand_eye import HandEyeError, calibrate_hand_eye
from mffdrake.recognition.poses.pose import (
    pose_from_transform,
    rotation_matrix,
    transform_from_pose,
)

X_EC = np.array([0.02, -0.155, 0.03, 0.05, -0.1, 0.7])
X_BM = np.array([1.7, 0.1, 0.45, -0.5, 0.4, -0.5])


def times(a, b):
    (R, p), (S, q) = transform_from_pose(a), transform_from_pose(b)
    return pose_from_transform(R @ S, np.einsum("...ij,...j->...i", R, q) + p)


def inverse(a):
    R, p = transform_from_pose(a)
    R = np.swapaxes(R, -1, -2)
    return pose_from_transform(R, -np.einsum("...ij,...j->...i", R, p))


def turned(poses, turns):
    """Poses with small turns [rad] after them."""
    R, p = transform_from_pose(poses)
    return pose_from_transform(R @ rotation_matrix(0.5 * turns), p)


def motion(number, turn_deg=30.0, seed=0, axes=3):
    """Hand poses that turn about all axes, or about the first ones only."""
    rng = np.random.default_rng(seed)
    turns = np.zeros((number, 3))
    turns[:, :axes] = np.radians(turn_deg) * rng.uniform(-1.0, 1.0, (number, axes))
    p = np.array([1.0, 0.0, 0.5]) + rng.uniform(-0.1, 0.1, (number, 3))
    return pose_from_transform(rotation_matrix(0.5 * turns), p)


def seen_from(X_BE):
    return times(inverse(times(X_BE, X_EC)), X_BM)


def noisy(X_CM, position, rotation, seed=1):
    rng = np.random.default_rng(seed)
    moved = X_CM + np.column_stack(
        [rng.normal(0, position, (len(X_CM), 3)), np.zeros_like(X_CM[:, 3:])]
    )
    return turned(moved, rng.normal(0, rotation, (len(X_CM), 3)))


def errors(found):
    """Of X_EC [m] and [rad]."""
    R, S = rotation_matrix(found.X_EC[3:]), rotation_matrix(X_EC[3:])
    cosine = np.clip(0.5 * (np.trace(R.T @ S) - 1.0), -1.0, 1.0)
    return float(np.linalg.norm(found.X_EC[:3] - X_EC[:3])), float(np.arccos(cosine))


@pytest.mark.parametrize("number", [3, 4, 12, 300])
def test_without_noise_it_is_exact(number):
    X_BE = motion(number)
    found = calibrate_hand_eye(X_BE, seen_from(X_BE))
    np.testing.assert_allclose(found.X_EC, X_EC, atol=1e-8)
    np.testing.assert_allclose(found.X_BM, X_BM, atol=1e-8)
    assert max(found.rms_position, found.rms_rotation) < 1e-8


def test_with_noise_it_is_as_good_as_it_says():
    """Over twenty seeds: errors of the size of the standard deviations, residuals of the noise."""
    ratios = []
    for seed in range(20):
        X_BE = motion(60, seed=seed)
        found = calibrate_hand_eye(X_BE, noisy(seen_from(X_BE), 1e-3, 2e-3, seed))
        position, rotation = errors(found)
        ratios.append([position / found.std_position, rotation / found.std_rotation])
        assert found.rms_position == pytest.approx(np.sqrt(3.0) * 1e-3, rel=0.35)
        assert found.rms_rotation == pytest.approx(np.sqrt(3.0) * 2e-3, rel=0.35)
        assert position < 2e-3 and rotation < 2e-3
    mean = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert (mean > 0.5).all() and (mean < 1.6).all()


def test_more_poses_are_better():
    few, many = (
        np.mean([
            errors(calibrate_hand_eye(X_BE, noisy(seen_from(X_BE), 1e-3, 2e-3, seed)))[0]
            for seed in range(10)
            for X_BE in [motion(number, seed=seed)]
        ])
        for number in (8, 200)
    )  # fmt: skip
    assert many < 0.5 * few


def test_poses_of_a_lost_target_do_not_count():
    X_BE = motion(100)
    X_CM = noisy(seen_from(X_BE), 1e-3, 2e-3)
    lost = np.arange(3, 100, 12)
    X_CM[lost, :3] += 0.1
    found = calibrate_hand_eye(X_BE, X_CM)
    assert not found.used[lost].any()
    assert found.used.sum() > 80
    assert errors(found)[0] < 2e-3


def test_how_far_the_hand_turned_about_a_second_axis_is_told():
    X_BE = motion(50, turn_deg=3.0, axes=2)
    little = calibrate_hand_eye(X_BE, seen_from(X_BE)).turn
    X_BE = motion(50, turn_deg=30.0)
    assert (
        np.degrees(little) < 4.0 < 10.0 < np.degrees(calibrate_hand_eye(X_BE, seen_from(X_BE)).turn)
    )


def test_turns_about_one_axis_tell_nothing():
    X_BE = motion(50, axes=1)
    with pytest.raises(HandEyeError, match="second axis"):
        calibrate_hand_eye(X_BE, seen_from(X_BE))


def test_two_poses_are_too_few():
    with pytest.raises(HandEyeError, match="three poses or more, not 2"):
        calibrate_hand_eye(motion(2), seen_from(motion(2)))
