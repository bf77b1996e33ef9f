"""Which of the last exposures a frame of a late camera shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mffdrake.systems.timing import Timing

__all__ = ["Exposures"]

Array = NDArray[np.float64]


class Exposures:
    """The exposures of a camera whose images arrive late: ``latency`` before the frames' ticks.

    A system that keeps what it saw at the exposures keeps `num_samples` rows ``(time [s], values)``
    in discrete state, the newest first, NaN where there was none yet. The number of exposures whose
    frame is still to come varies by one where frames are not equally many ticks apart, and so does
    the row that belongs to a frame. Between two frames, the rows are those of the next frame.

    Args:
        timing: Control and vision periods.
        latency: Time from an exposure to its frame [s], a whole multiple of the control period.

    Raises:
        ValueError: When the latency is no such multiple or negative.

    Example:
        >>> exposures = Exposures(Timing(), 0.010)
        >>> [exposures.IsExposure(time) for time in (0.0, 0.023, 0.033, 0.056)]
        [False, True, False, True]
        >>> exposures.Rows(0.033, rows=np.array([[0.023, 7.0], [np.nan, np.nan]]), now=[8.0])[1]
        array([0.023, 7.   ])
    """

    def __init__(self, timing: Timing, latency: float) -> None:
        timing.CheckLatency(latency)
        self._timing = timing
        self._delay_ticks = timing.Tick(latency)

    @property
    def num_samples(self) -> int:
        """Number of rows to keep."""
        return self._timing.MaxFrames(self._delay_ticks) + 1

    @property
    def event_period(self) -> float:
        """How often a system that samples at the exposures needs an event [s]."""
        return self._timing.event_period if self._delay_ticks == 0 else self._timing.control_period

    def IsExposure(self, time: float) -> bool:
        """Whether the tick at a time [s] is an exposure's."""
        return self._timing.IsVisionTick(time, delay_ticks=self._delay_ticks)

    def NextFrame(self, time: float) -> int:
        """Number of the frame at the tick at a time [s], or of the next one after it."""
        return self._timing.FrameAtTick(self._timing.Tick(time) - 1) + 1

    def Rows(self, time: float, *, rows: Array, now: Array) -> tuple[Array, Array]:
        """The last frame's row and that of the frame at a time.

        Args:
            time: A frame's time [s], before its update, or one before it.
            rows: What is kept, shape (num_samples, 1 + n).
            now: Present values, which the frame shows without a latency, shape (n,).

        Returns:
            Rows of the frame before and of this frame, each of shape (1 + n,).
        """
        frame = self.NextFrame(time)
        # Exposures before this frame's tick, after that of this frame.
        newer = self._timing.FrameAtTick(self._timing.TickOfFrame(frame) + self._delay_ticks - 1)
        newer -= frame
        present = rows[newer] if newer >= 0 else np.append(time, now)
        return rows[newer + 1], present
