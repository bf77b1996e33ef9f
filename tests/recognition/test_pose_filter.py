"""The filter on poses: against closed forms, numerical derivatives, brute force and chance."""

import dataclasses as dc

import cv2
import numpy as np
import pytest

from mffdrake.recognition import ParameterError
from mffdrake.recognition.poses import filter_steps
from mffdrake.recognition.poses.pose import (
    pose_from_transform,
    rotation_matrix,
    skew,
    transform_from_pose,
)
from mffdrake.recognition.poses.pose_filter import (
    NUM_NUMBERS,
    PoseFilter,
    PoseFilterParameters,
    body_covariance,
)
from mffdrake.recognition.poses.pose_motion import quaternion_rate_matrix, transport_pose

SEEDS = range(3)
RULES = PoseFilterParameters()
STILL = PoseFilterParameters(
    acceleration=1e-12, angular_acceleration=1e-12, speed=0.3, angular_speed=1.0
)
"""Moves with a constant velocity, all but exactly."""
SPRINGY = dc.replace(STILL, lasting=2.0, swing=1e-6)
"""Moves as on a spring whose stiffness is what it is, all but exactly."""
MODELS = {"velocity": STILL, "swing": SPRINGY}


def turn(vector):
    """Rotation matrix of a rotation vector [rad]."""
    return cv2.Rodrigues(np.asarray(vector, dtype=float))[0]


def vector_of(R):
    """Rotation vector [rad] of a rotation matrix that is no half turn."""
    sine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    length = np.linalg.norm(sine)
    if length == 0.0:
        return np.zeros(3)
    return sine / length * np.arctan2(length, 0.5 * (np.trace(R) - 1.0))


def unit(rng):
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def pose_at(angle, rng):
    """A pose vector anywhere near, turned by an angle [rad] about some axis."""
    return np.concatenate([rng.uniform(-1, 1, 3), unit(rng) * np.sin(0.5 * angle)])


def spread(rng, size, scale=1.0):
    """A covariance without any symmetry."""
    A = rng.normal(size=(size, size))
    return scale**2 * (A @ A.T / size + 0.1 * np.eye(size))


def pose_covariance(pose, C):
    """Pose vector's covariance from that of translation and rotation vector in the pose's frame."""
    A = np.eye(6)
    A[3:, 3:] = quaternion_rate_matrix(pose[3:])
    return A @ C @ A.T


def apart(known, true):
    """The error of one filter's pose and motion, where another one's are true."""
    (R, p), (R_true, p_true) = transform_from_pose(known.pose), transform_from_pose(true.pose)
    moved = [R.T @ (p_true - p), vector_of(R.T @ R_true)]
    return np.concatenate([*moved, true.motion - known.motion])


def moved_by(known, error):
    """The filter that is away from another by an error."""
    R, p = transform_from_pose(known.pose)
    pose = pose_from_transform(R @ turn(error[3:6]), p + R @ error[:3])
    return PoseFilter(pose, known.motion + error[6:], known.covariance)


def some_filter(rng, angle=1.0, scale=0.1, rules=RULES):
    motion = np.concatenate([rng.normal(size=3), 2.0 * rng.normal(size=3)])
    if rules.lasting:
        motion = np.concatenate([motion, 2.0 * rng.normal(size=6), rng.uniform(0, 9, size=2)])
    return PoseFilter(pose_at(angle, rng), motion, spread(rng, 6 + motion.size, scale))


def least_correlation(P):
    """The least eigenvalue, where every error is in units of its standard deviation."""
    std = np.sqrt(np.diag(P))
    return np.linalg.eigvalsh(P / np.outer(std, std))[0]


def assert_same_filter(a, b, atol):
    np.testing.assert_allclose(apart(a, b), 0, atol=atol)
    np.testing.assert_allclose(a.covariance, b.covariance, atol=atol * np.abs(a.covariance).max())


ANGLES = [0.0, 1.0, 2.5, np.pi - 2e-3, np.pi]
"""Of orientations, up to half turns, where the pose vector is on the unit sphere."""


# Rotation vectors


@pytest.mark.parametrize("angle", [1e-12, 1e-8, 3e-6, 1e-4, 0.1, 1.0, 3.0, np.pi - 1e-5])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_rotation_vector_comes_back_from_its_quaternion_however_short_it_is(seed, angle):
    vector = angle * unit(np.random.default_rng(seed))
    q = filter_steps.quaternion_exp(vector)
    for sign in (1.0, -1.0):  # the same turn
        np.testing.assert_allclose(
            filter_steps.rotation_log(sign * q), vector, rtol=0, atol=1e-8 * angle
        )


def test_no_rotation_has_no_vector():
    np.testing.assert_array_equal(filter_steps.quaternion_exp(np.zeros(3)), [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(filter_steps.rotation_log(np.array([1.0, 0, 0, 0])), np.zeros(3))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_rotation_is_its_vectors_power_series(seed):
    vector = np.random.default_rng(seed).uniform(-2, 2, 3)
    term, R = np.eye(3), np.eye(3)
    for k in range(1, 60):
        term = term @ skew(vector) / k
        R = R + term
    q = filter_steps.quaternion_exp(vector)
    np.testing.assert_allclose(rotation_matrix(np.copysign(1.0, q[0]) * q[1:]), R, atol=1e-13)


# What a measurement's covariance is, seen from the target


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0, 3.0, np.pi - 0.02])
def test_the_body_covariance_is_that_of_errors_that_are_drawn(angle):
    rng = np.random.default_rng(0)
    pose = pose_at(angle, rng)
    R, p = transform_from_pose(pose)
    C = spread(rng, 6, 2e-4)
    errors = rng.multivariate_normal(np.zeros(6), C, size=10000)
    errors -= errors.mean(axis=0)
    poses = [pose_from_transform(R @ turn(e[3:]), p + R @ e[:3]) for e in errors]
    drawn = body_covariance(pose, np.cov(np.array(poses).T))
    np.testing.assert_allclose(drawn, np.cov(errors.T), atol=2e-3 * np.abs(C).max())


@pytest.mark.parametrize("angle", ANGLES[:-1])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_body_covariance_undoes_the_pose_vectors_jacobian(seed, angle):
    rng = np.random.default_rng(seed)
    pose, C = pose_at(angle, rng), spread(rng, 6)
    back = np.kron(np.eye(2), transform_from_pose(pose)[0].T)
    expected = back @ C @ back.T
    np.testing.assert_allclose(
        body_covariance(pose, pose_covariance(pose, C)), expected, atol=1e-6 * np.abs(C).max()
    )


@pytest.mark.parametrize("away", [0.0, 1e-9, 1e-7, 1e-5])
@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_taken_for_certain_at_a_half_turn(seed, away):
    rng = np.random.default_rng(seed)
    pose, C = pose_at(np.pi - away, rng), spread(rng, 6, 1e-3)
    P = body_covariance(pose, pose_covariance(pose, C))
    least, most = np.linalg.eigvalsh(P)[[0, -1]]
    known = np.linalg.eigvalsh(C)
    assert 0.3 * known[0] < least and most < 3.0 * known[-1]
    np.testing.assert_allclose(P, P.T, atol=1e-5 * most)


# The first measurement


@pytest.mark.parametrize("angle", ANGLES)
def test_after_one_measurement_the_velocity_is_as_uncertain_as_the_rules_say(angle):
    rng = np.random.default_rng(0)
    pose = pose_at(angle, rng)
    C = pose_covariance(pose, spread(rng, 6, 1e-3))
    known = PoseFilter.of(pose, C, PoseFilterParameters(speed=0.2, angular_speed=0.7))
    np.testing.assert_array_equal(known.pose, pose)
    np.testing.assert_array_equal(known.twist, np.zeros(6))
    expected = np.zeros((12, 12))
    expected[:6, :6] = body_covariance(pose, C)
    expected[6:, 6:] = np.diag(3 * [0.2**2] + 3 * [0.7**2])
    np.testing.assert_allclose(known.covariance, expected, rtol=1e-14)


# Prediction: the mean


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("dt", [1e-3, 0.033, 1.0, 5.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_velocity_in_the_poses_frame_is_constant_and_carries_the_pose(seed, dt, angle):
    known = some_filter(np.random.default_rng(seed), angle)
    v, w = known.velocity[:3], known.velocity[3:]
    R, p = transform_from_pose(known.pose)
    later = known.predict(dt, RULES)
    R_later, p_later = transform_from_pose(later.pose)
    np.testing.assert_allclose(p_later, p + v * dt, atol=1e-7)
    np.testing.assert_allclose(R_later, turn(w * dt) @ R, atol=1e-7)
    np.testing.assert_allclose(later.velocity, known.velocity, atol=1e-6)
    np.testing.assert_allclose(later.twist[3:], known.twist[3:], rtol=1e-14)


def test_a_spinning_target_passes_half_turns_and_comes_round():
    known = PoseFilter(
        np.array([0.1, 0.2, 0.8, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 1.0]), np.eye(12)
    )
    for k in range(1, 9):
        known = known.predict(0.25 * np.pi, RULES)
        half = 0.125 * np.pi * k
        eps = np.sin(half) * np.sign(np.cos(half))
        if k == 4:  # A half turn is one either way.
            assert abs(known.pose[5]) == pytest.approx(1.0)
        else:
            np.testing.assert_allclose(known.pose, [0.1, 0.2, 0.8, 0, 0, eps], atol=1e-7)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("seed", SEEDS)
def test_many_small_steps_are_one_large_one_but_for_the_accelerations(seed, angle):
    known = some_filter(np.random.default_rng(seed), angle)
    small = known
    for _ in range(20):
        small = small.predict(0.05, STILL)
    assert_same_filter(known.predict(1.0, STILL), small, 1e-6)


@pytest.mark.parametrize("angle", ANGLES)
def test_many_small_steps_are_one_large_one_where_it_swings_along_lines_and_about_an_axis(angle):
    rng = np.random.default_rng(0)
    known = some_filter(rng, angle, rules=SPRINGY)
    # While it turns about one axis alone, turns add up; places are told from the world.
    axis, motion = unit(rng), known.motion.copy()
    motion[3:6], motion[9:12] = 0.3 * axis, 0.4 * axis
    small = known = PoseFilter(known.pose, motion, known.covariance)
    for _ in range(20):
        small = small.predict(0.015, SPRINGY)
    # But for the stiffness, which is slowly forgotten
    np.testing.assert_allclose(apart(known.predict(0.3, SPRINGY), small)[:12], 0, atol=3e-4)


@pytest.mark.parametrize("stiffness", [0.3, 4.0])
def test_a_target_on_a_spring_swings_as_the_sine_does(stiffness):
    rules = dc.replace(SPRINGY, lasting=1e9)
    v, a, w = np.array([0.1, 0.0, 0.02]), np.array([0.0, 0.3, 0.1]), np.sqrt(stiffness)
    motion = np.concatenate([v, np.zeros(3), a, np.zeros(3), [stiffness, 0.0]])
    known = PoseFilter(np.array([0.1, 0.2, 0.8, 0, 0, 0]), motion, np.zeros((20, 20)))
    for t in (0.033, 1.0, 5.0):
        later = known.predict(t, rules)
        sine, cosine = np.sin(w * t), np.cos(w * t)
        way = v * sine / w + a * (1 - cosine) / stiffness
        np.testing.assert_allclose(later.pose[:3], known.pose[:3] + way, atol=1e-8)
        np.testing.assert_allclose(later.twist[:3], v * cosine + a * sine / w, atol=1e-8)


# Prediction: one axis


def brute_force(dt, lasting, stiffness, steps=4000):
    """Transition and noise of `filter_steps.transition`, by many small steps."""
    A = np.array([[0, 1, 0], [0, 0, 1], [0, -stiffness, -1 / lasting]])
    h, M, Q = dt / steps, np.eye(3), np.zeros((3, 3))
    half = A * h / 2
    step = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)  # the trapezoidal rule
    white = np.zeros((3, 3))
    white[2, 2] = h
    for _ in range(steps):
        M, Q = step @ M, step @ (Q + 0.5 * white) @ step.T + 0.5 * white
    return M, Q


@pytest.mark.parametrize("stiffness", [0.0, 0.4, 4.0, 40.0])
@pytest.mark.parametrize("lasting", [0.3, 10.0])
@pytest.mark.parametrize("dt", [0.033, 1.0])
def test_one_axis_goes_on_as_in_many_small_steps(dt, lasting, stiffness):
    M, dM, Q = filter_steps.transition(dt, lasting, stiffness)
    stepped, noise = brute_force(dt, lasting, stiffness)
    np.testing.assert_allclose(M, stepped, atol=2e-5 * (1 + stiffness))
    np.testing.assert_allclose(Q, noise, atol=1e-5 * np.abs(noise).max())
    ahead, *_ = filter_steps.transition(dt, lasting, stiffness + 1e-4)
    behind, *_ = filter_steps.transition(dt, lasting, stiffness - 1e-4)
    np.testing.assert_allclose(dM, (ahead - behind) / 2e-4, atol=1e-7)


def test_one_axis_with_white_accelerations_and_in_singers_model_is_as_in_the_textbook():
    t, lasting = 0.7, 0.4
    M, dM, Q = filter_steps.transition(t, 0.0, 0.0)
    np.testing.assert_allclose(M, [[1, t, 0], [0, 1, 0], [0, 0, 1]], atol=1e-15)
    assert not dM[:2, :2].any()
    np.testing.assert_allclose(Q[:2, :2], [[t**3 / 3, t**2 / 2], [t**2 / 2, t]], rtol=1e-14)
    M, _, Q = filter_steps.transition(t, lasting, 0.0)
    left = np.exp(-t / lasting)
    np.testing.assert_allclose(
        M[:, 2], [lasting * (t - lasting * (1 - left)), lasting * (1 - left), left], rtol=1e-13
    )
    assert Q[2, 2] == pytest.approx(lasting / 2 * (1 - left**2), rel=1e-13)
    assert Q[1, 2] == pytest.approx(lasting**2 / 2 * (1 - left) ** 2, rel=1e-12)


# Prediction: the covariance


@pytest.mark.parametrize("angle", ANGLES[:-1])
@pytest.mark.parametrize("dt", [0.033, 0.5])
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("seed", SEEDS)
def test_errors_grow_as_they_do_when_the_pose_and_the_motion_are_moved(seed, model, dt, angle):
    rules = MODELS[model]
    known = some_filter(np.random.default_rng(seed), angle, rules=rules)
    later, h, n = known.predict(dt, rules), 1e-4, len(known.covariance)
    J = np.empty((n, n))
    for k, error in enumerate(h * np.eye(n)):
        ahead = apart(later, moved_by(known, error).predict(dt, rules))
        behind = apart(later, moved_by(known, -error).predict(dt, rules))
        J[:, k] = (ahead - behind) / (2 * h)
    expected = J @ known.covariance @ J.T
    np.testing.assert_allclose(later.covariance, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("noise_scale", [1.0, 3.0])
def test_a_target_at_rest_gains_the_noise_of_white_accelerations(noise_scale):
    rules = PoseFilterParameters(acceleration=0.4, angular_acceleration=1.5, adaptive=True)
    pose, dt = np.array([0.1, 0.2, 0.8, 0.1, 0.2, 0.3]), 0.2
    known = PoseFilter(pose, np.zeros(6), np.zeros((12, 12)), noise_scale=noise_scale)
    q = noise_scale**2 * np.diag(3 * [0.4**2] + 3 * [1.5**2])
    expected = np.block([[q * dt**3 / 3, q * dt**2 / 2], [q * dt**2 / 2, q * dt]])
    P = known.predict(dt, rules).covariance
    np.testing.assert_allclose(P, expected, rtol=1e-13, atol=1e-18)


@pytest.mark.parametrize("seed", SEEDS)
def test_many_small_steps_are_one_large_one_where_nothing_turns(seed):
    rng = np.random.default_rng(seed)
    known = some_filter(rng)
    known = PoseFilter(known.pose, known.twist * np.repeat([1, 0], 3), 1e-3 * known.covariance)
    small = known
    for _ in range(10):
        small = small.predict(0.05, RULES)
    assert_same_filter(known.predict(0.5, RULES), small, 1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_many_small_steps_are_one_large_one_to_first_order_of_the_turn(seed):
    known = some_filter(np.random.default_rng(seed))
    known = PoseFilter(known.pose, known.twist, np.zeros((12, 12)))
    differences = []
    for dt in (0.02, 0.04):
        small = known
        for _ in range(10):
            small = small.predict(dt / 10, RULES)
        one = known.predict(dt, RULES).covariance
        scale = np.sqrt(np.outer(np.diag(one), np.diag(one)))
        differences.append(np.abs((one - small.covariance) / scale).max())
    assert differences[0] < 0.05
    assert 1.5 < differences[1] / differences[0] < 4.5  # They vanish with the turn.


def test_accelerations_come_and_go_as_the_rules_say():
    rng = np.random.default_rng(0)
    known, lasting = some_filter(rng), PoseFilterParameters(lasting=2.0, swing=1.5)
    more = known.predict(0.0, lasting)
    assert more.motion.shape == (14,) and more.covariance.shape == (20, 20)
    np.testing.assert_allclose(more.covariance[:12, :12], known.covariance, rtol=1e-12)
    steady = [np.sqrt(0.5**2 / 4)] * 3 + [np.sqrt(2.0**2 / 4)] * 3 + [1.5**2] * 2
    np.testing.assert_allclose(np.sqrt(np.diag(more.covariance)[12:]), steady)
    assert_same_filter(more.predict(0.0, RULES), known, 1e-6)


# Measurements


@pytest.mark.parametrize("seed", SEEDS)
def test_a_shift_is_weighed_as_in_the_textbook(seed):
    rng = np.random.default_rng(seed)
    P = np.zeros((12, 12))
    linear, angular = np.r_[0:3, 6:9], np.r_[3:6, 9:12]
    P[np.ix_(linear, linear)], P[np.ix_(angular, angular)] = spread(rng, 6, 0.1), spread(rng, 6)
    known = PoseFilter(np.r_[rng.normal(size=3), np.zeros(3)], rng.normal(size=6), P)
    C = np.zeros((6, 6))
    C[:3, :3], C[3:, 3:] = spread(rng, 3, 0.1), spread(rng, 3)
    seen = known.pose + np.r_[0.1 * rng.normal(size=3), np.zeros(3)]
    new = known.update(seen, C)

    H = np.eye(6, 12)
    N = np.block([[C[:3, :3], np.zeros((3, 3))], [np.zeros((3, 3)), 4 * C[3:, 3:]]])  # eps: half
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + N)
    away = seen - known.pose
    change = K @ away
    np.testing.assert_allclose(new.pose, known.pose + change[:6], atol=1e-12)
    np.testing.assert_allclose(new.twist, known.twist + change[6:], atol=1e-12)
    np.testing.assert_allclose(new.covariance, (np.eye(12) - K @ H) @ P, atol=1e-12)
    assert new.nis == pytest.approx(away @ np.linalg.inv(H @ P @ H.T + N) @ away / 6)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("seed", SEEDS)
def test_seeing_the_expected_pose_moves_nothing_and_makes_all_more_certain(seed, angle):
    rng = np.random.default_rng(seed)
    known = some_filter(rng, angle)
    new = known.update(known.pose, pose_covariance(known.pose, spread(rng, 6, 0.01)))
    np.testing.assert_allclose(apart(known, new), 0, atol=1e-6)
    assert new.nis < 1e-9
    shrunk = known.covariance - new.covariance
    assert np.linalg.eigvalsh(shrunk).min() > -1e-6 * np.abs(shrunk).max()
    assert np.trace(new.covariance[:6, :6]) < 0.1 * np.trace(known.covariance[:6, :6])


@pytest.mark.parametrize("angle", [0.5, 3.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_who_knows_nothing_takes_the_measurement_as_it_is(seed, angle):
    rng = np.random.default_rng(seed)
    known = PoseFilter(pose_at(angle, rng), np.zeros(6), 1e4 * np.eye(12))
    seen = pose_at(1.0, rng)
    C = pose_covariance(seen, spread(rng, 6, 0.01))
    new = known.update(seen, C)
    np.testing.assert_allclose(new.pose, seen, atol=1e-6)
    np.testing.assert_allclose(new.covariance[:6, :6], body_covariance(seen, C), atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_rounding_hides_no_measurement_that_is_far_finer_than_what_is_known(seed):
    rng = np.random.default_rng(seed)
    known = some_filter(rng, scale=1e3)
    seen = pose_at(1.0, rng)
    C = pose_covariance(seen, spread(rng, 6, 1e-5))
    new, expected = known.update(seen, C), body_covariance(seen, C)
    assert least_correlation(new.covariance) > 0
    np.testing.assert_allclose(new.covariance[:6, :6], expected, atol=1e-5 * expected.max())


@pytest.mark.parametrize("seed", SEEDS)
def test_a_turn_that_is_seen_leaves_the_direction_in_which_the_place_is_uncertain(seed):
    rng = np.random.default_rng(seed)
    P = np.diag([1e-6, 1e-6, 1e-2, 1, 1, 1, 1e-4, 1e-4, 1e-4, 1, 1, 1])
    known = PoseFilter(pose_at(1.0, rng), np.zeros(6), P)
    R, p = transform_from_pose(known.pose)
    seen = pose_from_transform(R @ turn(0.6 * unit(rng)), p)
    new = known.update(seen, pose_covariance(seen, np.diag([1e6, 1e6, 1e6, 1e-6, 1e-6, 1e-6])))
    R_new = transform_from_pose(new.pose)[0]
    before, after = R @ P[:3, :3] @ R.T, R_new @ new.covariance[:3, :3] @ R_new.T
    np.testing.assert_allclose(after, before, atol=1e-7)


@pytest.mark.parametrize("seed", range(2))
def test_the_covariance_stays_one_over_thousands_of_steps(seed):
    rng = np.random.default_rng(seed)
    true = PoseFilter(pose_at(np.pi - 0.1, rng), np.zeros(6), np.eye(12))
    known = PoseFilter.of(true.pose, 1e-6 * np.eye(6), RULES)
    for _ in range(1500):
        known = known.predict(10 ** rng.uniform(-4, 0), RULES)
        assert least_correlation(known.covariance) > 0
        if rng.random() < 0.7:
            scale = 10 ** rng.uniform(-5, -1)
            seen = moved_by(true, scale * rng.normal(size=12)).pose
            known = known.update(seen, pose_covariance(seen, spread(rng, 6, scale)))
            np.testing.assert_array_equal(known.covariance, known.covariance.T)
            assert least_correlation(known.covariance) > 0
        assert np.isfinite(known.covariance).all() and np.isfinite(known.pose).all()


class Targets:
    """Many targets that move by white accelerations, seen with errors that are normal.

    The first half of them is anywhere, the other half near half turns.
    """

    def __init__(self, rng, count, rules):
        self.rng, self.rules = rng, rules
        angles = np.r_[np.arccos(rng.uniform(-1, 1, count // 2)), np.full(count // 2, np.pi - 0.05)]
        self.poses = [transform_from_pose(pose_at(angle, rng)) for angle in angles]
        self.v = rules.speed * rng.normal(size=(count, 3))  # in the pose's frame
        self.w = rules.angular_speed * rng.normal(size=(count, 3))  # seen from the target

    def move(self, dt, parts=5):
        h, count = dt / parts, len(self.poses)
        for _ in range(parts):
            kicks = np.sqrt(h) * self.rng.normal(size=(2, count, 3))
            v = self.v + self.rules.acceleration * kicks[0]
            w = self.w + self.rules.angular_acceleration * kicks[1]
            ways, turns = 0.5 * h * (self.v + v), 0.5 * h * (self.w + w)
            self.poses = [
                (R @ turn(part), p + way)
                for (R, p), part, way in zip(self.poses, turns, ways, strict=True)
            ]
            self.v, self.w = v, w

    def see(self, L):
        """Pose vectors with errors L x, where x is standard normal, and their covariances."""
        for R, p in self.poses:
            error = L @ self.rng.normal(size=6)
            seen = pose_from_transform(turn(error[3:]) @ R, p + error[:3])
            yield seen, pose_covariance(seen, L @ L.T)

    def errors(self, filters):
        for (R, p), v, w, known in zip(self.poses, self.v, self.w, filters, strict=True):
            true = PoseFilter(pose_from_transform(R, p), np.r_[R.T @ v, w], np.eye(12))
            yield apart(known, true), known.covariance


def test_errors_are_as_large_as_the_filter_says_and_innovations_too():
    rng, rules, dt, frames = np.random.default_rng(1), PoseFilterParameters(speed=0.5), 0.033, 12
    targets = Targets(rng, 200, rules)
    L = np.linalg.cholesky(spread(rng, 6) * np.outer(*2 * [np.repeat([1e-3, 4e-3], 3)]))
    filters = [PoseFilter.of(seen, C, rules) for seen, C in targets.see(L)]
    ratios, sizes = [], []
    for _ in range(frames):
        targets.move(dt)
        filters = [
            known.predict(dt, rules).update(seen, C)
            for known, (seen, C) in zip(filters, targets.see(L), strict=True)
        ]
        ratios.append([known.nis for known in filters])
        sizes.append([e @ np.linalg.solve(P, e) for e, P in targets.errors(filters)])
    # Chi-square of 12 and 6 degrees of freedom; four standard deviations of the means.
    np.testing.assert_allclose(np.mean(sizes, axis=1), 12, atol=4 * np.sqrt(2 * 12 / 200))
    assert np.mean(ratios) == pytest.approx(1, abs=4 * np.sqrt(2 / 6 / (200 * frames)))
    for part in (slice(0, 100), slice(100, 200)):  # anywhere, and near half turns
        assert np.mean(np.array(sizes)[-1, part]) == pytest.approx(12, abs=4 * np.sqrt(0.24))


@pytest.mark.parametrize("period", [3.0, 6.0])
def test_how_a_target_swings_is_learned_and_carries_it_through_an_occlusion(period):
    rng, dt, w = np.random.default_rng(0), 0.033, 2 * np.pi / period
    steady = PoseFilterParameters(acceleration=0.2, angular_acceleration=0.2, adaptive=True)
    swinging = dc.replace(steady, lasting=10.0, swing=4.0)

    def pose(t):
        half = 0.2 * np.sin(w * t)  # +-0.4 rad
        return np.array([0.0, 0.15 * np.sin(w * t), 0.8, 0.0, 0.0, np.sin(half)])

    C = np.diag(3 * [1e-9] + 3 * [1e-8])
    known = {rules: PoseFilter.of(pose(0.0), C, rules) for rules in (steady, swinging)}
    off = {rules: [] for rules in known}
    for k in range(1, 600):
        seen = pose(k * dt) + rng.multivariate_normal(np.zeros(6), C)
        for rules, before in known.items():
            known[rules] = after = before.predict(dt, rules).update(seen, C)
            # A second without images
            off[rules].append(after.predict(1.0, rules).pose - pose(k * dt + 1.0))
    stiffness = known[swinging].motion[12:]
    std = np.sqrt(np.diag(known[swinging].covariance)[18:])
    assert (np.abs(stiffness - w**2) < 3.3 * std).all() and (std < w**2).all()
    for part in (slice(0, 3), slice(3, 6)):
        errors = {rules: np.std(np.array(e)[300:, part]) for rules, e in off.items()}
        assert errors[swinging] < 0.25 * errors[steady]


# Seen from elsewhere


@pytest.mark.parametrize("angle", [0.3, 2.0, np.pi - 0.01])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_filter_is_the_same_from_wherever_it_is_seen(seed, angle):
    rng = np.random.default_rng(seed)
    known = some_filter(rng, 0.5)
    R, p = transform_from_pose(known.pose)
    R_seen, p_seen = R @ turn(0.1 * rng.normal(size=3)), p + 0.1 * rng.normal(size=3)
    seen, C = pose_from_transform(R_seen, p_seen), spread(rng, 6, 0.05)

    # Such a motion that the target's turn is about a half one from there, and back
    R_DC, p_DC = turn(angle * unit(rng)) @ R.T, rng.normal(size=3)
    carried = known.carried(R_DC, p_DC)
    np.testing.assert_array_equal(carried.twist, known.twist)
    np.testing.assert_array_equal(carried.covariance, known.covariance)

    back = np.kron(np.eye(2), R_DC)
    seen_D = transport_pose(seen, R_DC, p_DC)
    new = known.update(seen, pose_covariance(seen, C))
    new_D = carried.update(seen_D, pose_covariance(seen_D, back @ C @ back.T))
    assert new_D.nis == pytest.approx(new.nis, rel=1e-6)
    for a, b in ((new, new_D), (known.predict(0.1, RULES), carried.predict(0.1, RULES))):
        assert_same_filter(a.carried(R_DC, p_DC), b, 1e-8)


# Keeping


@pytest.mark.parametrize("lasting", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_filter_comes_back_from_its_numbers_and_goes_along_with_the_pose_beside_it(seed, lasting):
    rng = np.random.default_rng(seed)
    known = some_filter(rng)
    known = known.update(pose_at(1.1, rng), spread(rng, 6, 0.01)).predict(0.033, RULES)
    beside = pose_at(0.4, rng)
    if lasting:
        known = known.predict(0.033, SPRINGY)
    numbers = known.numbers(beside)
    assert numbers.shape == (NUM_NUMBERS,)
    again = PoseFilter.of_numbers(beside, numbers)
    np.testing.assert_allclose(again.pose, known.pose, atol=1e-12)
    for name in ("motion", "covariance", "nis", "noise_scale", "innovation"):
        np.testing.assert_array_equal(getattr(again, name), getattr(known, name))
    R_DC, p_DC = turn(rng.normal(size=3)), rng.normal(size=3)
    along = PoseFilter.of_numbers(transport_pose(beside, R_DC, p_DC), numbers)
    np.testing.assert_allclose(along.pose, known.carried(R_DC, p_DC).pose, atol=1e-12)


def test_steps_leave_the_filter_that_takes_them_as_it_is():
    rng = np.random.default_rng(0)
    known = some_filter(rng)
    numbers = known.numbers(known.pose)
    known.predict(0.033, RULES)
    known.update(pose_at(1.0, rng), np.eye(6))
    known.carried(np.eye(3), np.zeros(3)).pose[:] = 1.0
    np.testing.assert_array_equal(known.numbers(known.pose), numbers)


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_a_filter_that_is_told_wrong_errors_still_learns_how_restless_a_target_is(scale):
    """By whether innovations are alike, not by how large they are."""
    rng, dt, found = np.random.default_rng(2), 0.033, {}
    for strength in (0.05, 0.8):
        moves = PoseFilterParameters(acceleration=strength, angular_acceleration=strength)
        targets = Targets(rng, 8, dc.replace(moves, speed=1e-3, angular_speed=1e-3))
        L = np.diag(3 * [1e-4] + 3 * [1e-3])
        rules = PoseFilterParameters(acceleration=0.2, angular_acceleration=0.2, adaptive=True)
        filters = [PoseFilter.of(seen, scale**2 * C, rules) for seen, C in targets.see(L)]
        noise_scales = []
        for _ in range(250):
            targets.move(dt, parts=1)
            filters = [
                known.predict(dt, rules).update(seen, scale**2 * C)
                for known, (seen, C) in zip(filters, targets.see(L), strict=True)
            ]
            noise_scales.append([known.noise_scale for known in filters])
        found[strength] = 0.2 * np.exp(np.mean(np.log(noise_scales[100:])))
    assert found[0.05] < 0.16 * scale and found[0.8] > 0.3 * scale


def test_an_adaptive_filter_scales_its_noise_up_after_a_jolt_and_down_again():
    rules = PoseFilterParameters(acceleration=0.1, angular_acceleration=0.1, adaptive=True)
    pose = np.array([0.0, 0.1, 0.8, 0.0, 0.0, 0.0])
    known = PoseFilter.of(pose, 1e-8 * np.eye(6), rules)
    for _ in range(30):
        known = known.predict(0.033, rules).update(pose, 1e-8 * np.eye(6))
    calmest = known.noise_scale
    assert calmest < 0.5  # As expected for so long, it is trusted to go on like that.
    jumped = known.predict(0.033, rules).update(pose + [0.1, 0, 0, 0, 0, 0], 1e-8 * np.eye(6))
    assert jumped.nis > 100.0 and jumped.noise_scale > 2.0
    wide, narrow = (
        jumped.predict(0.033, rules),
        dc.replace(jumped, noise_scale=1.0).predict(0.033, rules),
    )
    assert np.trace(wide.covariance) > np.trace(narrow.covariance)
    unmoved = known.reject(pose + [0.1, 0, 0, 0, 0, 0], 1e-8 * np.eye(6))
    np.testing.assert_array_equal(unmoved.pose, known.pose)
    assert unmoved.noise_scale > 2.0
    for _ in range(60):
        known = jumped = jumped.predict(0.033, rules)
        jumped = jumped.update(known.pose, 1e-8 * np.eye(6))
    assert jumped.noise_scale == calmest


# Parameters


@pytest.mark.parametrize("key", ["acceleration", "angular_acceleration", "speed", "angular_speed"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_what_is_not_positive_is_refused_by_its_name(key, value):
    with pytest.raises(ParameterError, match=rf"\b{key}\b"):
        PoseFilterParameters(**{key: value})
