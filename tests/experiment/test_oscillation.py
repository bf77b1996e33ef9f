"""Frequency and decay of a swing, against signals made of known ones."""

import math

import numpy as np
import pytest

from mffdrake.systems.control.oscillation import FitOscillation, Oscillation

TIME = 0.033 * np.arange(1213)


def swing(frequency, decay, *, time=TIME, amplitude=4.0, phase=0.7):
    return amplitude * np.exp(-time / decay) * np.cos(2 * math.pi * frequency * time + phase)


@pytest.mark.parametrize("frequency", [0.3, 0.744, 1.0, 2.37])
@pytest.mark.parametrize("decay", [4.0, 17.0, 60.0])
def test_a_decaying_oscillation_is_found(frequency, decay):
    fit = FitOscillation(TIME, 12.0 + swing(frequency, decay))
    assert fit.frequency_hz == pytest.approx(frequency, rel=1e-4)
    assert fit.decay_s == pytest.approx(decay, rel=1e-3)
    assert fit.amplitude == pytest.approx(4.0, rel=1e-3)
    assert fit.explained == pytest.approx(1.0, abs=1e-5)
    assert fit.AmplitudeAt(decay) == pytest.approx(4.0 / math.e, rel=2e-3)


def test_a_slow_motion_of_known_frequency_does_not_matter():
    slow = 9.0 * np.sin(0.314 * TIME + 0.4)
    fit = FitOscillation(TIME, slow + swing(0.75, 19.0), slow_omega=0.314)
    assert fit.frequency_hz == pytest.approx(0.75, rel=1e-4)
    assert fit.decay_s == pytest.approx(19.0, rel=1e-3)


def test_the_rest_is_told_as_not_explained():
    main, other = swing(0.75, 20.0), swing(1.9, 20.0, amplitude=2.0)
    fit = FitOscillation(TIME, main + other)
    assert fit.frequency_hz == pytest.approx(0.75, rel=1e-3)
    share = np.sum(main**2) / np.sum((main + other) ** 2)
    assert fit.explained == pytest.approx(share, abs=0.01)


def test_an_oscillation_that_does_not_decay_has_no_damping():
    fit = FitOscillation(TIME, np.cos(5.0 * TIME))
    assert fit.decay_s > 1e3
    assert fit.damping_ratio == pytest.approx(0.0, abs=1e-4)


def test_the_damping_ratio_is_that_of_the_characteristic_polynomial():
    zeta, natural = 0.12, 5.0  # s^2 + 2 zeta w s + w^2
    root = np.roots([1.0, 2 * zeta * natural, natural**2])[0]
    fit = Oscillation(
        frequency_hz=abs(root.imag) / (2 * math.pi), decay_s=-1 / root.real,
        amplitude=1.0, explained=1.0,
    )  # fmt: skip
    assert fit.damping_ratio == pytest.approx(zeta)


@pytest.mark.parametrize(
    ("time", "signal", "reason"),
    [
        (TIME[:4], TIME[:4], "too short"),
        (TIME, np.full(1213, 3.0), "does not swing"),
        (TIME[:60], swing(1.0, 20.0)[:60], "shorter than three"),
    ],
    ids=["few samples", "constant", "two oscillations"],
)
def test_what_cannot_be_measured_is_an_error(time, signal, reason):
    with pytest.raises(ValueError, match=reason):
        FitOscillation(time, signal)
