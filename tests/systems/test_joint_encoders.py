"""Encoders read positions with normal errors, the same for the same seed, offset and rounded."""

import math

import numpy as np
import pytest

from mffdrake.systems.control.joint_encoders import JointEncoders

STATE = np.linspace(-1.0, 1.0, 14)


def read(encoders, time=0.0, state=STATE):
    context = encoders.CreateDefaultContext()
    context.SetTime(time)
    encoders.get_input_port().FixValue(context, state)
    return encoders.get_output_port().Eval(context)


def test_errors_scatter_as_told_and_leave_the_velocities():
    encoders = JointEncoders(noise=0.01, seed=3)
    readings = np.array([read(encoders, 0.001 * tick) for tick in range(2000)])
    np.testing.assert_array_equal(readings[:, 7:], np.tile(STATE[7:], (2000, 1)))
    errors = (readings[:, :7] - STATE[:7]) / 0.01
    # Five standard deviations of the mean, of the spread and of a correlation.
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=5 / math.sqrt(2000))
    np.testing.assert_allclose(errors.std(axis=0), 1.0, atol=5 / math.sqrt(4000))
    assert np.abs(np.corrcoef(errors.T) - np.eye(7)).max() < 5 / math.sqrt(2000)
    following = [np.corrcoef(e[1:], e[:-1])[0, 1] for e in errors.T]
    assert np.abs(following).max() < 5 / math.sqrt(2000)


def test_the_same_seed_and_tick_give_the_same_error_and_others_do_not():
    first = read(JointEncoders(noise=0.01, seed=3), 0.033)
    np.testing.assert_array_equal(first, read(JointEncoders(noise=0.01, seed=3), 0.033))
    for seed, time in ((4, 0.033), (3, 0.034)):
        assert np.all(read(JointEncoders(noise=0.01, seed=seed), time)[:7] != first[:7])
    np.testing.assert_allclose(
        read(JointEncoders(noise=0.01, seed=3), 0.033, np.zeros(14))[:7], first[:7] - STATE[:7],
        atol=1e-15,
    )  # fmt: skip


def test_without_errors_they_read_the_truth():
    np.testing.assert_array_equal(read(JointEncoders()), STATE)


@pytest.mark.parametrize("offset", [0.02, [0.01, -0.02, 0.03, 0.0, 0.05, -0.06, 0.07]])
def test_an_offset_is_added_at_all_times(offset):
    for time in (0.0, 0.5):
        reading = read(JointEncoders(offset=offset), time)
        np.testing.assert_allclose(reading[:7], STATE[:7] + offset, rtol=1e-15)
        np.testing.assert_array_equal(reading[7:], STATE[7:])


def test_a_resolution_rounds_to_the_nearest_step():
    step = 0.03
    reading = read(JointEncoders(resolution=step))
    np.testing.assert_allclose(reading[:7] / step, np.rint(reading[:7] / step), atol=1e-12)
    assert np.abs(reading[:7] - STATE[:7]).max() <= 0.5 * step * (1 + 1e-12)
    np.testing.assert_array_equal(reading[7:], STATE[7:])
    np.testing.assert_array_equal(read(JointEncoders(resolution=step), state=reading), reading)


def test_what_is_rounded_is_the_position_with_offset_and_noise():
    errors = {"noise": 0.01, "offset": 0.02, "seed": 3}
    exact = read(JointEncoders(**errors), 0.033)[:7]
    noise = read(JointEncoders(noise=0.01, seed=3), 0.033)[:7]
    np.testing.assert_allclose(exact, noise + 0.02, rtol=1e-15)
    rounded = read(JointEncoders(resolution=0.03, **errors), 0.033)[:7]
    np.testing.assert_allclose(rounded, 0.03 * np.rint(exact / 0.03), atol=1e-15)


def test_noise_alone_is_the_noise_of_philox_to_the_bit():
    """What made earlier results stays: the stream's key and the counter's place."""
    rng = np.random.Generator(np.random.Philox(key=[3, 2**63], counter=[0, 0, 0, 33]))
    expected = STATE[:7] + 0.01 * rng.standard_normal(7)
    reading = read(JointEncoders(noise=0.01, seed=3), 0.033)
    np.testing.assert_array_equal(reading[:7], expected)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"noise": -0.1}, "noise must be at least 0 rad, not -0.1"),
        ({"noise": math.nan}, "noise must be at least 0 rad, not nan"),
        ({"offset": [0.1, 0.2]}, "offset must be one finite number or 7 of them, .* not .0.1, 0.2"),
        ({"offset": math.inf}, "offset must be one finite number or 7 of them, .* not inf"),
        ({"resolution": -1.0}, r"resolution must be at least 0 rad \(0 for no rounding\), not -1"),
        ({"noise": 0.1, "num_joints": 0}, "num_joints must be at least 1, not 0"),
        ({"noise": 0.1, "seed": -1}, "seed must be at least 0, not -1"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        JointEncoders(**arguments)
