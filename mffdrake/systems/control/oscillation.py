"""How the hand swings: frequency and decay, measured from a run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FitOscillation", "Oscillation"]

Array = NDArray[np.float64]

_LEAST_OSCILLATIONS = 3.0
_ROUNDS = 40  # Of a search whose grid gets twice as fine as soon as the optimum is inside.
_STEPS = (-2, -1, 0, 1, 2)


@dataclass(frozen=True, kw_only=True)
class Oscillation:
    """A decaying oscillation ``amplitude exp(-t / decay_s) cos(2 pi frequency_hz t + phase)``.

    Attributes:
        frequency_hz: Its frequency [Hz].
        decay_s: The time in which it falls to 1/e [s]; infinite where it does not decay.
        amplitude: At time 0, in the signal's unit.
        explained: Share of the swing's variance that it explains, up to 1.

    Example:
        >>> swing = Oscillation(frequency_hz=0.73, decay_s=15.0, amplitude=5.0, explained=0.99)
        >>> round(swing.AmplitudeAt(30.0), 2), round(swing.damping_ratio, 4)
        (0.68, 0.0145)
    """

    frequency_hz: float
    decay_s: float
    amplitude: float
    explained: float

    @property
    def damping_ratio(self) -> float:
        """Damping ratio [-]: 0 without decay, 1 at the border to no oscillation."""
        rate = 1.0 / self.decay_s
        return rate / math.hypot(rate, 2.0 * math.pi * self.frequency_hz)

    def AmplitudeAt(self, time: float) -> float:
        """Its amplitude at a time [s], in the signal's unit."""
        return self.amplitude * math.exp(-time / self.decay_s)


def FitOscillation(time: Array, signal: Array, *, slow_omega: float = 0.0) -> Oscillation:
    """Fits one decaying oscillation to a signal.

    The signal is modeled as the oscillation plus a constant plus sine and cosine of a known slow
    motion. For a frequency and a decay rate the rest is a linear least-squares problem; these two
    are searched on a grid that shrinks, around the strongest line of the spectrum at first.

    Args:
        time: Evenly spaced times [s], shape (K,).
        signal: The signal in any unit, shape (K,).
        slow_omega: Angular frequency of the slow motion [rad/s]; 0 where there is none.

    Returns:
        The oscillation.

    Raises:
        ValueError: When the signal is constant or shorter than three of its oscillations.

    Example:
        >>> t = np.arange(0.0, 40.0, 0.033)
        >>> fit = FitOscillation(t, 2.0 + 5.0 * np.exp(-t / 15.0) * np.cos(4.6 * t + 1.0))
        >>> round(fit.frequency_hz, 4), round(fit.decay_s, 3), round(fit.amplitude, 3)
        (0.7321, 15.0, 5.0)
    """
    time, signal = np.asarray(time, dtype=float), np.asarray(signal, dtype=float)
    slow = [np.ones_like(time)]
    if slow_omega > 0:
        slow += [np.cos(slow_omega * time), np.sin(slow_omega * time)]
    base = np.column_stack(slow)
    if len(time) <= base.shape[1] + 4:
        raise ValueError("FitOscillation: the signal is too short")
    swing = signal - base @ np.linalg.lstsq(base, signal, rcond=None)[0]
    if not np.ptp(swing) > 1e-9 * max(np.abs(signal).max(), 1e-300):
        raise ValueError("FitOscillation: the signal does not swing")
    span = float(time[-1] - time[0])
    step = span / (len(time) - 1)
    spectrum = np.abs(np.fft.rfft(swing * np.hanning(len(swing))))
    frequency = float(np.fft.rfftfreq(len(swing), step)[int(np.argmax(spectrum))])
    if frequency * span < _LEAST_OSCILLATIONS:
        raise ValueError("FitOscillation: the signal is shorter than three oscillations")

    rate = 1.0 / span
    width_f, width_r = 0.5 / span, 0.5 / span
    for _ in range(_ROUNDS):
        candidates = [
            (_Fit(time, signal, base, frequency + i * width_f, rate + j * width_r)[0], i, j)
            for i in _STEPS
            for j in _STEPS
            if frequency + i * width_f > 0 and rate + j * width_r >= 0
        ]
        _, i, j = min(candidates)
        frequency, rate = frequency + i * width_f, rate + j * width_r
        # An optimum at the grid's border may lie beyond it.
        width_f = width_f if abs(i) == _STEPS[-1] else width_f / 2.0
        width_r = width_r if abs(j) == _STEPS[-1] else width_r / 2.0
    error, weights = _Fit(time, signal, base, frequency, rate)
    without = float(np.sum(swing**2))
    return Oscillation(
        frequency_hz=frequency,
        decay_s=1.0 / rate if rate > 0 else math.inf,
        amplitude=float(math.hypot(*weights[:2])),
        explained=1.0 - error / without,
    )


def _Fit(
    time: Array, signal: Array, base: Array, frequency: float, rate: float
) -> tuple[float, Array]:
    """Sum of squared residuals, and the weights of cosine, sine and the slow part."""
    envelope, phase = np.exp(-rate * time), 2.0 * math.pi * frequency * time
    model = np.column_stack([envelope * np.cos(phase), envelope * np.sin(phase), base])
    weights = np.linalg.lstsq(model, signal, rcond=None)[0]
    return float(np.sum((signal - model @ weights) ** 2)), weights
