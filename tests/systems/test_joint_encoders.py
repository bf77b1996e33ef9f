"""Encoders read the positions with independent normal errors, the same for the same seed."""

import math

import numpy as np
import pytest

from mffdrake.systems.joint_encoders import JointEncoders

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


def test_without_noise_they_read_the_truth():
    np.testing.assert_array_equal(read(JointEncoders(noise=0.0)), STATE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"noise": -0.1}, "noise must be at least 0 rad, not -0.1"),
        ({"noise": math.nan}, "noise must be at least 0 rad, not nan"),
        ({"noise": 0.1, "num_joints": 0}, "num_joints must be at least 1, not 0"),
        ({"noise": 0.1, "seed": -1}, "seed must be at least 0, not -1"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        JointEncoders(**arguments)
