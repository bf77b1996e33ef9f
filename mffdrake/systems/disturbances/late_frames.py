"""Frames that arrive late."""

from __future__ import annotations

from collections.abc import Sequence

from mffdrake.recognition.parameters import Count, Share, parameters
from mffdrake.systems.disturbances.image_memory import FrameDisturbance
from mffdrake.systems.disturbances.random_stream import RandomStream
from mffdrake.systems.timing import Timing

__all__ = ["LateFrames"]


@parameters
class LateFrames(FrameDisturbance):
    """Delivers images some frames late, always as late or at random.

    At every frame the camera delivers the newest image that has arrived by then, so never one
    that is older than the one before; until one has arrived, it delivers the first one.

    Attributes:
        frames: How many frames an image is late, or is late at most.
        probability: Of an image to be late, by 1 to ``frames`` frames, all equally likely; null
            where all images are late by ``frames``.

    Example:
        >>> late, stream = LateFrames(frames=2), RandomStream(seed=0, index=0, name="right")
        >>> late.Shown([0, 33, 66, 99], stream, Timing())
        [33]
    """

    frames: Count = 1
    probability: Share | None = None

    def Shown(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The newest image that has arrived, see `FrameDisturbance.Shown`."""
        arrived = [k - self._Delay(tick, stream) for k, tick in enumerate(ticks)]
        newest = max(0, *arrived)
        return [ticks[newest]]

    def Kept(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """Those that may still be delivered, see `FrameDisturbance.Kept`."""
        return ticks[-self.frames :]

    def _Delay(self, tick: int, stream: RandomStream) -> int:
        """How many frames the image delivered at a frame is old at most."""
        if self.probability is None:
            return self.frames
        rng = stream.At(tick)
        return int(rng.integers(1, self.frames + 1)) if rng.random() < self.probability else 0
