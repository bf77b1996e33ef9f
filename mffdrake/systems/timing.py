"""The one place that knows ticks, periods and when vision coincides with control.

Control and vision run at different rates, and every vision event must fall on a control tick. In
floating point two periodic events of 0.033 s and 0.001 s do not: ``k * 0.033 != (33 * k) * 0.001``
for one k in six, so vision would run one rounding error beside the tick, in a simulation step of
its own. The remedy: all systems declare events with the control period, and those that work at the
vision rate act on every 33rd tick only, found by counting ticks instead of comparing times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Timing"]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Control and vision periods, the second a whole multiple of the first.

    Attributes:
        control_period: Time between control ticks [s].
        vision_period: Time between frames [s].

    Raises:
        ValueError: When a period is not positive, or vision's is not a whole multiple of control's.

    Example:
        >>> timing = Timing()
        >>> timing.ticks_per_frame
        33
        >>> [t for t in (0.0, 0.001, 0.033, 0.034) if timing.IsVisionTick(t)]
        [0.0, 0.033]
    """

    control_period: float = 0.001
    vision_period: float = 0.033

    def __post_init__(self) -> None:
        """Checks the periods."""
        for name in ("control_period", "vision_period"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise ValueError(f"timing: {name} must be positive, not {value} s")
        ratio = self.vision_period / self.control_period
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6 * ratio:
            raise ValueError(
                f"timing: vision_period must be a whole multiple of control_period, but "
                f"{self.vision_period} s is {ratio:.6g} times {self.control_period} s"
            )

    @property
    def ticks_per_frame(self) -> int:
        """Control ticks from one frame to the next."""
        return round(self.vision_period / self.control_period)

    def Tick(self, time: float) -> int:
        """Number of the control tick at (or nearest to) a time [s]."""
        return round(time / self.control_period)

    def TimeOfTick(self, tick: int) -> float:
        """Time of a tick [s], to the bit as Drake computes it for a periodic event."""
        return tick * self.control_period

    def TimeOfFrame(self, frame: int) -> float:
        """Time of a frame [s], to the bit that of its control tick."""
        return self.TimeOfTick(frame * self.ticks_per_frame)

    def IsVisionTick(self, time: float, *, delay_ticks: int = 0) -> bool:
        """Whether the tick at a time [s] is a frame's, or ``delay_ticks`` before a frame's."""
        return (self.Tick(time) + delay_ticks) % self.ticks_per_frame == 0

    def CheckLatency(self, latency: float) -> None:
        """Checks that a latency [s] is a whole number of control ticks.

        Raises:
            ValueError: When it is not, or negative.
        """
        ticks = latency / self.control_period
        if not 0.0 <= latency < math.inf or abs(ticks - round(ticks)) > 1e-6:
            raise ValueError(
                f"latency must be at least 0 and a whole multiple of the control period of "
                f"{self.control_period} s, not {latency} s"
            )

    def NumFrames(self, duration: float) -> int:
        """Number of frames from time 0 until just before ``duration`` [s]."""
        ticks = math.ceil(duration / self.control_period - 1e-6)
        return -(-ticks // self.ticks_per_frame)
