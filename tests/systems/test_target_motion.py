"""A target's motions: what they are at every time, and their velocities."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from mffdrake.recognition.parameters import ParameterError
from mffdrake.systems.target_motion import (
    AtRest,
    Sinusoids,
    Step,
    Straight,
    Waypoint,
    Waypoints,
)

X_WM0 = RigidTransform(RollPitchYaw(0.3, -0.2, 0.5), [1.7, 0.1, 0.4])
TIMES = np.linspace(0.0, 12.0, 61)


def rotation_vector(R):
    turn = R.ToAngleAxis()
    return turn.angle() * turn.axis()


def offsets(motion, times=TIMES):
    """Shift, and turn in the world, from X_WM0, at many times, shape (K, 6)."""
    rows = []
    for t in times:
        X = motion.CalcPose(X_WM0, t)
        turn = rotation_vector(X.rotation() @ X_WM0.rotation().inverse())
        rows.append([*(X.translation() - X_WM0.translation()), *turn])
    return np.array(rows)


def test_at_rest_it_stays_to_the_last_bit():
    for t in TIMES:
        np.testing.assert_array_equal(
            AtRest().CalcPose(X_WM0, t).GetAsMatrix34(), X_WM0.GetAsMatrix34()
        )
    np.testing.assert_array_equal(AtRest().CalcVelocity(X_WM0, 3.0), np.zeros(6))


def test_six_sines():
    amplitude, degrees = (0.1, 0.15, 0.05), (3.0, 20.0, 7.0)
    period, phase = (3.0, 5.0, 7.0, 2.0, 4.0, 9.0), (0.0, 30.0, 90.0, 10.0, 20.0, 200.0)
    motion = Sinusoids(amplitude=amplitude, amplitude_deg=degrees, period=period, phase_deg=phase)
    sines = np.sin(2 * np.pi * TIMES[:, None] / period + np.radians(phase))
    expected = sines * np.concatenate([amplitude, np.radians(degrees)])
    np.testing.assert_allclose(offsets(motion), expected, atol=1e-12)
    # The velocity of the shift is its derivative; the turn's is about one axis where one turns.
    rates = np.cos(2 * np.pi * TIMES[:, None] / period + np.radians(phase)) * 2 * np.pi / period
    found = np.array([motion.CalcVelocity(X_WM0, t) for t in TIMES])
    np.testing.assert_allclose(found[:, :3], rates[:, :3] * amplitude, atol=1e-7)
    about_y = Sinusoids(amplitude=(0, 0, 0), amplitude_deg=(0, 20, 0), period=(4.0,))
    w = 2 * np.pi / 4.0
    found = np.array([about_y.CalcVelocity(X_WM0, t) for t in TIMES])
    np.testing.assert_allclose(found[:, 4], np.radians(20) * w * np.cos(w * TIMES), atol=1e-6)
    np.testing.assert_allclose(found[:, [0, 1, 2, 3, 5]], 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("then", "gone"),
    [("stop", [0, 0, 1, 2, 3, 3, 3, 3, 3]), ("reverse", [0, 0, 1, 2, 3, 2, 1, 0, 1])],
)
def test_straight_on_then_stop_or_back(then, gone):
    motion = Straight(
        velocity=(0.1, -0.2, 0.05),
        angular_velocity_deg=(0, 0, 8),
        start=1.0,
        duration=3.0,
        then=then,
    )
    times = np.arange(9.0)
    expected = np.outer(gone, [0.1, -0.2, 0.05, 0, 0, np.radians(8)])
    np.testing.assert_allclose(offsets(motion, times), expected, atol=1e-12)
    np.testing.assert_allclose(
        motion.CalcVelocity(X_WM0, 2.5), [0.1, -0.2, 0.05, 0, 0, np.radians(8)], atol=1e-9
    )


def test_for_ever_straight_on():
    motion = Straight(velocity=(0.01, 0, 0))
    np.testing.assert_allclose(offsets(motion, [100.0])[0], [1, 0, 0, 0, 0, 0], atol=1e-12)


def test_a_step_is_made_at_its_time():
    motion = Step(translation=(0.1, 0, 0.02), rotation_deg=(0, 10, 0), time=0.3)
    before, at, after = offsets(motion, [0.299, 0.1 + 0.2, 5.0])
    np.testing.assert_array_equal(before, np.zeros(6))
    np.testing.assert_allclose(at, [0.1, 0, 0.02, 0, np.radians(10), 0], atol=1e-12)
    np.testing.assert_array_equal(at, after)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_waypoints_are_met_and_not_passed(count):
    rng = np.random.default_rng(count)
    points = tuple(
        Waypoint(
            time=float(k * k + 1),
            translation=tuple(rng.uniform(-0.1, 0.1, 3)),
            rotation_deg=tuple(rng.uniform(-20, 20, 3)),
        )
        for k in range(count)
    )
    motion = Waypoints(points=points)
    values = np.array([[*p.translation, *np.radians(p.rotation_deg)] for p in points])
    times = [p.time for p in points]
    np.testing.assert_allclose(offsets(motion, times), values, atol=1e-12)
    np.testing.assert_allclose(offsets(motion, [0.0, times[-1] + 9]), values[[0, -1]], atol=1e-12)
    for k in range(count - 1):
        a, b, low, high = times[k], times[k + 1], values[k], values[k + 1]
        between = offsets(motion, np.linspace(a, b, 20))
        assert (between >= np.minimum(low, high) - 1e-9).all()
        assert (between <= np.maximum(low, high) + 1e-9).all()
    assert np.linalg.norm(motion.CalcVelocity(X_WM0, times[0] - 0.5)) == 0.0


@pytest.mark.parametrize(
    ("cls", "values", "message"),
    [
        (Sinusoids, {"period": (1.0, 2.0)}, "period must be a list of one number or of six"),
        (Sinusoids, {"phase_deg": ()}, "phase_deg must be a list of one number or of six"),
        (Sinusoids, {"period": (0.0,)}, "period"),
        (Straight, {"duration": 0.0}, "duration"),
        (Straight, {"then": "turn"}, "then"),
        (Step, {"time": -1.0}, "time"),
        (Waypoints, {"points": ()}, "points"),
        (Waypoints, {"points": (Waypoint(time=2), Waypoint(time=2))}, "order of their times"),
        (
            Waypoints,
            {"points": (Waypoint(time=0), Waypoint(time=1e-300), Waypoint(time=1))},
            r"at least 1e-06 s apart, not at \[0.0, 1e-300, 1.0\] s",
        ),
    ],
)
def test_wrong_values_are_told(cls, values, message):
    with pytest.raises(ParameterError, match=message):
        cls(**values)
