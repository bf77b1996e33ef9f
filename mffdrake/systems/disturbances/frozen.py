"""A camera that hangs for a while."""

from __future__ import annotations

from collections.abc import Sequence

from mffdrake.recognition.parameters import NonNegative, Positive, parameters
from mffdrake.systems.disturbances.image_memory import FrameDisturbance
from mffdrake.systems.disturbances.random_stream import RandomStream
from mffdrake.systems.timing import Timing

__all__ = ["Frozen"]


@parameters
class Frozen(FrameDisturbance):
    """Delivers for a while always the same image: the last one before.

    Attributes:
        start: When the camera begins to hang [s]; at 0 it delivers the first image again and again.
        duration: For how long [s]; a frame just at the end is a new one.

    Example:
        >>> Frozen(start=2.0)
        Frozen(cameras=None, start=2.0, duration=0.5)
    """

    start: NonNegative = 1.0
    duration: Positive = 0.5

    def Shown(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The present image or the last one delivered, see `FrameDisturbance.Shown`."""
        first, end = timing.Tick(self.start), timing.Tick(self.start + self.duration)
        return ticks[:1] if first <= ticks[-1] < end else ticks[-1:]
