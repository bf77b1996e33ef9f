"""The one place that knows ticks, periods and when vision coincides with control.

Control and vision run at different rates, and every vision event must fall on a control tick. In
floating point two periodic events of 0.033 s and 0.001 s do not: ``k * 0.033 != (33 * k) * 0.001``
for one k in six, so vision would run one rounding error beside the tick, in a simulation step of
its own. The remedy: all systems declare events with the control period, and those that work at the
vision rate act on the frames' ticks only, found by counting ticks instead of comparing times.

That costs each of them some microseconds at every tick. Where the vision period is a whole multiple
of the control period to the last bit (as it is when the latter is 1e-18 s more than 0.001 s), both
products are rounded from the same number, and events of the vision period will do.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cached_property

from mffdrake.recognition.parameters import Period, parameters

__all__ = ["Timing"]

_MAX_DENOMINATOR = 1_000_000
_MOST_COINCIDING = 4096  # ticks a frame: so the periods change by less than 2^-40
_MOST_TICKS = 100_000  # of a latency: so many states are kept, and copied at every tick


@parameters
class Timing:
    """Control and vision periods.

    Frame k falls on the control tick nearest to ``k * vision_period``; in the middle between two,
    on the later one. So the frames of a camera of 30 Hz are 33 and 34 control ticks of 1 ms apart
    and never drift; those of a vision period that is a whole multiple are all equally far apart.

    That is computed with whole numbers, however late it gets: the quotient of the periods is the
    nearest fraction with a denominator up to a million, so 1/30 s is 100/3 control periods of 1 ms
    and no rounding error more or less.

    Attributes:
        control_period: Time between control ticks [s].
        vision_period: Mean time between frames [s], at least control_period.

    Raises:
        ParameterError: When a period is not positive or vision's is below control's.

    Example:
        >>> timing = Timing()
        >>> [t for t in (0.0, 0.001, 0.033, 0.034) if timing.IsVisionTick(t)]
        [0.0, 0.033]
        >>> [Timing(vision_period=1 / 30).TickOfFrame(k) for k in range(5)]
        [0, 33, 67, 100, 133]
    """

    control_period: Period = 0.001
    vision_period: Period = 0.033

    def __post_init__(self) -> None:
        """Checks the periods together."""
        ticks, frames = self._ticks_and_frames
        if ticks < frames:
            raise ValueError(
                f"vision_period must be at least control_period ({self.control_period} s), "
                f"not {self.vision_period}; make one larger or the other smaller"
            )

    @cached_property
    def _ticks_and_frames(self) -> tuple[int, int]:
        """The least whole numbers of control ticks and of frames that take the same time."""
        quotient = Fraction(self.vision_period) / Fraction(self.control_period)
        return quotient.limit_denominator(_MAX_DENOMINATOR).as_integer_ratio()

    @property
    def coincides(self) -> bool:
        """Whether the vision period is a whole multiple of the control period to the last bit."""
        ticks, frames = self._ticks_and_frames
        exact = ticks * Fraction(self.control_period)
        return frames == 1 and Fraction(self.vision_period) == exact

    def Coinciding(self) -> Timing:
        """These periods, longer by less than one part in 10^12 where that makes them coincide.

        Returns:
            A timing that `coincides`; this one where the vision period is not nearly a whole
            multiple of the control period, or is more than 4096 of them.

        Example:
            >>> Timing().coincides, Timing().Coinciding().coincides
            (False, True)
            >>> Timing().Coinciding().vision_period - 0.033 < 1e-16
            True
        """
        ticks, frames = self._ticks_and_frames
        if self.coincides or frames > 1 or ticks > _MOST_COINCIDING:
            return self
        mantissa, exponent = math.frexp(self.control_period)  # of 53 bits, as the product's
        digits = 2 ** (53 - ticks.bit_length())
        control = math.ldexp(math.ceil(mantissa * digits) / digits, exponent)
        return Timing(control_period=control, vision_period=ticks * control)

    @property
    def event_period(self) -> float:
        """How often a system that works at the frames needs an event [s]; `IsVisionTick` says when.

        The vision period where that `coincides`, otherwise the control period.
        """
        return self.vision_period if self.coincides else self.control_period

    def IsShort(self, seconds: float) -> bool:
        """Whether a time [s] is less than a control period, which may be a little lengthened."""
        return seconds < (1.0 - 1e-9) * self.control_period

    def Tick(self, time: float) -> int:
        """Number of the control tick at (or nearest to) a time [s]."""
        return round(time / self.control_period)

    def TickOfFrame(self, frame: int) -> int:
        """Number of the control tick on which a frame falls."""
        ticks, frames = self._ticks_and_frames
        return (2 * frame * ticks + frames) // (2 * frames)

    def FrameAtTick(self, tick: int) -> int:
        """Number of the last frame at a control tick or before it."""
        ticks, frames = self._ticks_and_frames
        return ((2 * tick + 1) * frames - 1) // (2 * ticks)

    def FrameAt(self, time: float) -> int:
        """Number of the last frame at the tick at a time [s], or before it."""
        return self.FrameAtTick(self.Tick(time))

    def TimeOfTick(self, tick: int) -> float:
        """Time of a tick [s], to the bit as Drake computes it for a periodic event."""
        return tick * self.control_period

    def TimeOfFrame(self, frame: int) -> float:
        """Time of a frame [s], to the bit that of its control tick."""
        return self.TimeOfTick(self.TickOfFrame(frame))

    def TimeBefore(self, frame: int) -> float:
        """Time from the frame before to this one [s], between their ticks.

        It is ``vision_period``, to the bit, where that is a whole multiple of the control period.
        """
        _, frames = self._ticks_and_frames
        if frames == 1:
            return self.vision_period
        return self.TimeOfTick(self.TickOfFrame(frame) - self.TickOfFrame(frame - 1))

    def IsVisionTick(self, time: float, *, delay_ticks: int = 0) -> bool:
        """Whether the tick at a time [s] is a frame's, or ``delay_ticks`` before a frame's."""
        # This runs every millisecond, in every system that works at the frames.
        tick = round(time / self.control_period) + delay_ticks
        ticks, frames = self._ticks_and_frames
        if frames == 1:
            return tick % ticks == 0
        # Whether the quotient in `FrameAtTick` has just passed a whole number.
        return ((2 * tick + 1) * frames - 1) % (2 * ticks) < 2 * frames

    def CheckLatency(self, latency: float) -> None:
        """Checks that a latency [s] is a whole number of control ticks.

        Raises:
            ValueError: When it is not, or negative, or of more than 100 000 ticks.
        """
        ticks = latency / self.control_period
        if not 0.0 <= latency < math.inf or abs(ticks - round(ticks)) > 1e-6:
            raise ValueError(
                f"latency must be at least 0 and a whole multiple of the control period of "
                f"{self.control_period} s, not {latency} s"
            )
        if round(ticks) > _MOST_TICKS:
            raise ValueError(
                f"latency must be at most {_MOST_TICKS} control periods, which is "
                f"{_MOST_TICKS * self.control_period:g} s, not {latency:g} s; make it smaller, or "
                "the control period greater"
            )

    def NumFrames(self, duration: float) -> int:
        """Number of frames from time 0 until just before ``duration`` [s]."""
        ticks = math.ceil(duration / self.control_period - 1e-6)
        return self.FrameAtTick(ticks - 1) + 1

    def MaxFrames(self, ticks: int) -> int:
        """The most frames that any so many control ticks in a row hold."""
        period, frames = self._ticks_and_frames
        return -(-ticks * frames // period)
