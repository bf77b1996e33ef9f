"""The target's motion, estimated from poses: in the world, at the present time, with its errors."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from mffdrake.recognition.poses.pose import pose_from_transform, rotation_matrix
from mffdrake.recognition.poses.pose_filter import PoseFilterParameters, pose_covariance
from mffdrake.recognition.poses.pose_motion import rotate_by
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.target_motion_estimator import (
    EstimatorParameters,
    TargetMotionEstimator,
)

CALM = EstimatorParameters(
    motion=PoseFilterParameters(
        acceleration=0.05, angular_acceleration=0.2, speed=0.2, angular_speed=0.5
    ),
    refined_factor=1.0,
    systematic=0.0,
)
X_CW = RigidTransform(RollPitchYaw(1.4, 0.2, -0.3), [0.1, 0.2, 0.9])
"""Any camera."""


def vector(X):
    return pose_from_transform(X.rotation().matrix(), X.translation())


def _matrix(eps):
    return RotationMatrix(rotation_matrix(eps))


class Loop:
    """An estimator that is told of frames, one after the other."""

    def __init__(self, parameters=CALM, latency=0.0):
        self.system = TargetMotionEstimator(parameters=parameters, latency=latency)
        self.context = self.system.CreateDefaultContext()
        self.latency = latency

    def see(self, time, X_WM, *, body=None, fitness=0.95, is_tracking=1.0):
        """A frame at a time, of a pose that was seen a latency before."""
        seen = vector(X_CW @ X_WM)
        covariance = np.full(36, np.nan)
        if body is not None:
            covariance = pose_covariance(seen, body).reshape(-1)
        self.context.SetTime(time + 0.001)
        for name, value in (
            ("pose", seen), ("fitness", [fitness]), ("pose_covariance", covariance),
            ("frame_time", [time]), ("is_tracking", [is_tracking]),
            ("X_WM", AbstractValue.Make(X_WM)),
        ):  # fmt: skip
            self.system.GetInputPort(name).FixValue(self.context, value)
        state = self.system.AllocateDiscreteVariables()
        self.system.CalcForcedDiscreteVariableUpdate(self.context, state)
        self.context.SetDiscreteState(state)

    def at(self, time):
        """What it says at a time: pose, velocity, covariance, whether it is known."""
        self.context.SetTime(time)
        out = [self.system.GetOutputPort(name).Eval(self.context) for name in (
            "X_WM", "target_velocity", "covariance", "is_known"
        )]  # fmt: skip
        return out[0], out[1], out[2].reshape(12, 12), bool(out[3][0])


SMALL = np.diag([1e-8] * 3 + [1e-7] * 3)
START = RigidTransform(RollPitchYaw(-0.4, 0.3, 0.6), [1.7, 0.1, 0.4])


def moved(t, velocity=(0.05, -0.02, 0.03), rate=0.0):
    turn = RotationMatrix(RollPitchYaw(0.0, 0.0, rate * t))
    return RigidTransform(turn @ START.rotation(), START.translation() + t * np.array(velocity))


@pytest.mark.parametrize("latency", [0.0, 0.066])
def test_a_constant_velocity_is_found_and_carries_the_pose_over_the_latency(latency):
    loop = Loop(latency=latency)
    for k in range(1, 60):
        loop.see(0.033 * k, moved(0.033 * k - latency), body=SMALL)
    now = 0.033 * 59 + 0.020
    X, velocity, _, is_known = loop.at(now)
    assert is_known
    np.testing.assert_allclose(velocity, [0.05, -0.02, 0.03, 0, 0, 0], atol=2e-3)
    np.testing.assert_allclose(X.translation(), moved(now).translation(), atol=3e-4)


def test_a_turning_target_is_followed():
    loop = Loop()
    for k in range(90):
        loop.see(0.033 * k, moved(0.033 * k, velocity=(0, 0, 0), rate=0.4), body=SMALL)
    X, velocity, _, _ = loop.at(0.033 * 89)
    np.testing.assert_allclose(velocity, [0, 0, 0, 0, 0, 0.4], atol=8e-3)
    apart = (moved(0.033 * 89, (0, 0, 0), 0.4).rotation().inverse() @ X.rotation()).ToAngleAxis()
    assert apart.angle() < 2e-3


def swung(t, period=3.0):
    y = 0.15 * np.sin(2 * np.pi * t / period)
    return RigidTransform(START.rotation(), START.translation() + [0, y, 0])


def test_two_frames_of_latency_cost_little_where_the_target_swings():
    """Its velocity changes by up to 44 mm/s meanwhile."""
    off = {}
    for latency in (0.0, 0.066):
        loop, errors = Loop(EstimatorParameters(), latency), []
        rng = np.random.default_rng(0)
        for k in range(3, 500):
            seen = RigidTransform(np.sqrt(1e-8) * rng.normal(size=3))  # as seen from the target
            loop.see(0.033 * k, swung(0.033 * k - latency) @ seen, body=SMALL)
            _, velocity, _, _ = loop.at(0.033 * k + 0.020)
            wave = 2 * np.pi / 3.0
            true = 0.15 * wave * np.cos(wave * (0.033 * k + 0.020))
            errors.append(velocity[:3] - [0, true, 0])
        off[latency] = np.sqrt(np.mean(np.square(errors[200:])))
    assert off[0.0] < 0.003 and off[0.066] < 2.0 * off[0.0]


def test_what_is_systematic_is_not_averaged_away():
    covariances = []
    for share in (0.0, 0.5):
        loop = Loop(dc.replace(CALM, systematic=share))
        for k in range(100):
            loop.see(0.033 * k, START, body=SMALL)
        covariances.append(loop.at(0.033 * 99)[2])
    more = np.zeros((12, 12))
    more[:6, :6] = 0.5 * SMALL  # SMALL is the same along all axes.
    np.testing.assert_allclose(covariances[1] - covariances[0], more, atol=1e-15)


def test_before_anything_is_seen_nothing_is_known():
    loop = Loop()
    loop.see(0.0, START, body=SMALL, is_tracking=0.0)
    _, velocity, covariance, is_known = loop.at(0.1)
    assert not is_known and np.isnan(covariance).all()
    np.testing.assert_array_equal(velocity, np.zeros(6))


def test_unseen_it_goes_on_and_is_lost_in_the_end():
    loop = Loop()
    for k in range(60):
        loop.see(0.033 * k, moved(0.033 * k), body=SMALL)
    last = 0.033 * 59
    errors = []
    for away in (0.0, 0.5, 1.0, 2.0):
        X, _, covariance, is_known = loop.at(last + away)
        assert is_known
        assert np.linalg.norm(X.translation() - moved(last + away).translation()) < 3e-3 * (
            1 + away
        )
        errors.append(np.trace(covariance[:3, :3]))
    assert np.all(np.diff(errors) > 0)
    assert not loop.at(last + 30.0)[3]


def test_outliers_are_left_out_but_not_for_ever():
    loop = Loop()
    for k in range(60):
        loop.see(0.033 * k, START, body=SMALL)
    away = RigidTransform(START.rotation(), START.translation() + [0, 0.2, 0])
    for k in range(60, 60 + CALM.patience):
        loop.see(0.033 * k, away, body=SMALL)
        X, *_ = loop.at(0.033 * k + 0.001)
        assert np.linalg.norm(X.translation() - START.translation()) < 2e-3
    loop.see(0.033 * 70, away, body=SMALL)
    X, *_ = loop.at(0.033 * 70 + 0.001)
    np.testing.assert_allclose(X.translation(), away.translation(), atol=1e-6)


def test_an_unrefined_pose_is_least_certain_along_the_line_of_sight_and_where_it_is_less_fit():
    sight = X_CW.rotation().inverse() @ (X_CW @ START).translation()
    sight /= np.linalg.norm(sight)
    across = np.cross(sight, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    found = {}
    for fitness in (0.9, 0.6):
        loop = Loop(EstimatorParameters())
        loop.see(0.0, START, fitness=fitness)
        covariance = loop.at(0.0)[2][:3, :3]
        p = EstimatorParameters()
        expected = p.unrefined_factor * (1 - fitness) ** 2
        assert sight @ covariance @ sight == pytest.approx(expected * p.depth_error**2, rel=1e-6)
        assert across @ covariance @ across == pytest.approx(
            expected * p.lateral_error**2, rel=1e-6
        )
        found[fitness] = np.trace(covariance)
    assert found[0.6] == pytest.approx(16.0 * found[0.9])


def test_a_frame_is_told_once_and_the_state_is_in_the_context():
    loop = Loop()
    loop.see(0.0, START, body=SMALL)
    once = loop.context.get_discrete_state(0).CopyToVector()
    loop.see(0.0, START, body=SMALL)
    np.testing.assert_array_equal(loop.context.get_discrete_state(0).CopyToVector(), once)
    other = loop.system.CreateDefaultContext()
    assert np.isnan(other.get_discrete_state(0).CopyToVector()).all()


def test_the_errors_are_as_large_as_it_says():
    """NEES of many targets that move as it reckons, in the world's axes."""
    rng = np.random.default_rng(3)
    dt, count, runs = 0.033, 40, 60
    q, p = CALM.motion.acceleration, CALM.motion.angular_acceleration
    noise = np.diag([4e-8] * 3 + [4e-7] * 3)
    L, values = np.linalg.cholesky(noise), []
    for _ in range(runs):
        X = START
        v = rng.normal(0, CALM.motion.speed, 3)
        w = rng.normal(0, CALM.motion.angular_speed, 3)
        loop = Loop()
        for k in range(count):
            error = L @ rng.normal(size=6)  # as seen from the target
            seen = X @ RigidTransform(_matrix(rotate_by(error[3:])), error[:3])
            loop.see(dt * k, seen, body=noise)
            if k < count - 1:
                # From the target, velocities are constant but for white accelerations.
                for _ in range(4):
                    h = dt / 4
                    v = v + q * np.sqrt(h) * rng.normal(size=3)
                    w = w + p * np.sqrt(h) * rng.normal(size=3)
                    X = X @ RigidTransform(_matrix(rotate_by(w * h)), v * h)
        found, velocity, covariance, _ = loop.at(dt * (count - 1))
        turn = (X.rotation() @ found.rotation().inverse()).ToAngleAxis()
        R = X.rotation().matrix()
        errors = np.concatenate([
            X.translation() - found.translation(), turn.angle() * turn.axis(),
            R @ v - velocity[:3], R @ w - velocity[3:],
        ])  # fmt: skip
        values.append(errors @ np.linalg.solve(covariance, errors))
    # Chi square with so many degrees of freedom is nearly normal.
    freedom = 12 * runs
    assert abs(np.sum(values) - freedom) < 3.3 * np.sqrt(2.0 * freedom)


def test_an_impossible_latency_is_refused():
    with pytest.raises(ValueError, match="whole multiple of the control period"):
        TargetMotionEstimator(latency=0.0005, timing=Timing())
