"""Small random motions around a pose."""

import math

import numpy as np
import pytest
from synthetic import rotation

from mffdrake.recognition import LocalMoveParameters, LocalMoves
from mffdrake.recognition.poses.pose import rotation_angle

POSE = np.array([0.03, 0.155, 0.80, 0.10, -0.20, 0.15])
MIDDLE = np.array([-0.075, 0.0, 0.0])
NORMAL_LOG = -0.5 * (np.euler_gamma + math.log(2)) / math.log(10)
"""Mean of log10 |n| of a standard normal n."""


def draw(count, *, pivots=((0, 0, 0),), seed=0, pose=POSE, **parameters):
    """Moves with everything left out that is not named, each of full size."""
    nothing = {"depth": 0.0, "shift": 0.0, "rotation_deg": 0.0, "decades": 0.0, "sparsity": 0.0}
    moves = LocalMoves(pivots, MIDDLE, LocalMoveParameters(**nothing | parameters))
    return moves.draw(pose, count, np.random.default_rng(seed))


def rotation_vectors(poses, pose=POSE):
    """Rotation vectors [rad], in the camera's frame, that turn a pose into others."""
    vectors = []
    for eps in poses[:, 3:]:
        R = rotation(eps) @ rotation(pose[3:]).T
        axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        sine = 0.5 * np.linalg.norm(axis)
        vectors.append(axis / (2 * sine) * math.atan2(sine, 0.5 * (np.trace(R) - 1)))
    return np.array(vectors)


def test_no_move_leaves_the_pose():
    np.testing.assert_allclose(draw(5), np.tile(POSE, (5, 1)), atol=1e-15)


def test_number_of_moves():
    assert draw(7, shift=0.01).shape == (7, 6)
    assert draw(0, shift=0.01).shape == (0, 6)


def test_the_same_random_numbers_give_the_same_moves():
    every = {"shift": 0.01, "depth": 0.01, "rotation_deg": 5.0, "decades": 2.0, "sparsity": 0.5}
    np.testing.assert_array_equal(draw(20, **every), draw(20, **every))
    assert (draw(20, **every) != draw(20, seed=1, **every)).any(axis=1).sum() >= 18


def test_shifts_scatter_along_each_axis_and_do_not_turn():
    moved = draw(4000, shift=0.040)
    steps = (moved[:, :3] - POSE[:3]) / 0.040
    np.testing.assert_allclose(steps.mean(axis=0), 0.0, atol=5 / math.sqrt(4000))
    np.testing.assert_allclose(steps.std(axis=0), 1.0, atol=5 / math.sqrt(2 * 4000))
    assert np.abs(np.corrcoef(steps.T) - np.eye(3)).max() < 5 / math.sqrt(4000)
    np.testing.assert_allclose(moved[:, 3:], np.tile(POSE[3:], (4000, 1)), atol=1e-15)


def test_depth_moves_along_the_line_of_sight_of_the_middle_between_the_cameras():
    moved = draw(4000, depth=0.020)
    step = moved[:, :3] - POSE[:3]
    sight = (POSE[:3] - MIDDLE) / np.linalg.norm(POSE[:3] - MIDDLE)
    along = step @ sight
    np.testing.assert_allclose(step, along[:, None] * sight, atol=1e-15)
    assert along.std() == pytest.approx(0.020, rel=5 / math.sqrt(2 * 4000))
    assert along.mean() == pytest.approx(0.0, abs=0.020 * 5 / math.sqrt(4000))
    # So the direction from there to the solid stays: it moves alike in both images.
    direction = moved[:, :3] - MIDDLE
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    np.testing.assert_allclose(direction, np.tile(sight, (4000, 1)), atol=1e-14)
    np.testing.assert_allclose(moved[:, 3:], np.tile(POSE[3:], (4000, 1)), atol=1e-15)


def test_rotations_scatter_about_each_axis_of_the_camera():
    vectors = np.degrees(rotation_vectors(draw(4000, rotation_deg=2.0)))
    np.testing.assert_allclose(vectors.mean(axis=0), 0.0, atol=2 * 5 / math.sqrt(4000))
    np.testing.assert_allclose(vectors.std(axis=0), 2.0, rtol=5 / math.sqrt(2 * 4000) + 0.002)
    assert np.abs(np.corrcoef(vectors.T) - np.eye(3)).max() < 5 / math.sqrt(4000)


@pytest.mark.parametrize("rotation_deg", [1.0, 34.0, 300.0])
def test_a_rotation_leaves_its_pivot_where_it_is(rotation_deg):
    pivot = np.array([0.05, -0.03, 0.10])
    moved = draw(200, pivots=[pivot], rotation_deg=rotation_deg)
    fixed = POSE[:3] + rotation(POSE[3:]) @ pivot
    for psi in moved:
        np.testing.assert_allclose(psi[:3] + rotation(psi[3:]) @ pivot, fixed, atol=1e-7)
    assert np.linalg.norm(moved[:, :3] - POSE[:3], axis=1).max() > 1e-3
    assert rotation_angle(moved[:, 3:], POSE[3:]).max() > math.radians(rotation_deg) / 2


def test_a_rotation_about_the_solid_s_origin_leaves_its_position():
    np.testing.assert_allclose(
        draw(50, rotation_deg=34.0)[:, :3], np.tile(POSE[:3], (50, 1)), atol=1e-15
    )


def test_every_pivot_is_chosen_equally_often():
    pivots = np.array([(0, 0, 0), (0.05, 0, 0), (0, -0.075, 0), (0, 0, 0.1)])
    moved = draw(2000, pivots=pivots, rotation_deg=20.0)
    fixed = POSE[:3] + pivots @ rotation(POSE[3:]).T
    chosen = [
        np.argmin(np.linalg.norm(psi[:3] + pivots @ rotation(psi[3:]).T - fixed, axis=1))
        for psi in moved
    ]
    share = np.bincount(chosen, minlength=4) / 2000
    np.testing.assert_allclose(share, 0.25, atol=5 * math.sqrt(0.25 * 0.75 / 2000))


@pytest.mark.parametrize("sparsity", [0.0, 0.3, 0.5, 0.9])
def test_each_component_is_left_out_with_the_sparsity_s_chance(sparsity):
    shifted = draw(2000, shift=0.01, sparsity=sparsity)[:, :3] != POSE[:3]
    deepened = (draw(2000, depth=0.01, sparsity=sparsity, seed=1)[:, :3] != POSE[:3]).any(axis=1)
    tolerance = 5 * math.sqrt(sparsity * (1 - sparsity) / 2000)
    np.testing.assert_allclose(1 - shifted.mean(axis=0), sparsity, atol=tolerance)
    assert 1 - deepened.mean() == pytest.approx(sparsity, abs=tolerance)
    # Independently of each other.
    both = (~shifted[:, 0] & ~shifted[:, 1]).mean()
    assert both == pytest.approx(sparsity**2, abs=5 * sparsity / math.sqrt(2000))
    turned = rotation_angle(
        draw(2000, rotation_deg=5.0, sparsity=sparsity, seed=2)[:, 3:], POSE[3:]
    )
    assert np.mean(turned < 1e-9) == pytest.approx(
        sparsity**3, abs=5 * math.sqrt(sparsity**3 * (1 - sparsity**3) / 2000)
    )


@pytest.mark.parametrize("decades", [0.0, 1.0, 2.0, 4.0])
def test_sizes_spread_evenly_in_the_logarithm_over_the_decades(decades):
    moved = draw(4000, shift=0.040, decades=decades)
    logs = np.log10(np.abs(moved[:, 0] - POSE[0]) / 0.040)
    # log10 |step| = log10 |normal| - uniform(0, decades)
    spread_of_normal = math.pi / math.sqrt(8) / math.log(10)
    spread = math.hypot(spread_of_normal, decades / math.sqrt(12))
    tolerance = 5 * spread / math.sqrt(4000)
    assert logs.mean() == pytest.approx(NORMAL_LOG - 0.5 * decades, abs=tolerance)
    assert logs.std() == pytest.approx(spread, rel=0.1)


def test_a_move_s_components_are_large_or_small_together():
    # Over six decades of sizes, the components of one move differ by much less than moves do.
    steps = np.abs(draw(1000, shift=0.04, depth=0.0, decades=6.0)[:, :3] - POSE[:3])
    logs = np.log10(np.maximum(steps, 1e-12))
    assert np.corrcoef(logs.T)[np.triu_indices(3, 1)].min() > 0.8


def test_moves_with_everything_stay_rigid():
    moved = draw(500, shift=0.04, depth=0.2, rotation_deg=200.0, decades=1.0, sparsity=0.5)
    assert np.isfinite(moved).all()
    assert np.linalg.norm(moved[:, 3:], axis=1).max() <= 1 + 1e-12


@pytest.mark.parametrize("name", ["depth", "shift", "rotation_deg", "decades"])
@pytest.mark.parametrize("value", [-0.1, math.inf, math.nan])
def test_lengths_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=f"LocalMoveParameters: {name} "):
        LocalMoveParameters(**{name: value})


@pytest.mark.parametrize("value", [-0.1, 1.0, math.nan])
def test_sparsity_out_of_range_is_named(value):
    with pytest.raises(ValueError, match="LocalMoveParameters: sparsity "):
        LocalMoveParameters(sparsity=value)
