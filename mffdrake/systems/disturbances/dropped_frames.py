"""Frames that get lost."""

from __future__ import annotations

from collections.abc import Sequence

from mffdrake.recognition.parameters import Share, parameters
from mffdrake.systems.disturbances.image_memory import FrameDisturbance
from mffdrake.systems.disturbances.random_stream import RandomStream
from mffdrake.systems.timing import Timing

__all__ = ["DroppedFrames"]


@parameters
class DroppedFrames(FrameDisturbance):
    """Loses frames at random; instead of a lost one, the camera delivers the last one again.

    The first frame is never lost. Each camera loses frames of its own.

    Attributes:
        probability: Of a frame to be lost.

    Example:
        >>> DroppedFrames(probability=0.5)
        DroppedFrames(cameras=None, probability=0.5)
    """

    probability: Share = 0.1

    def Shown(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The present image or the last one delivered, see `FrameDisturbance.Shown`."""
        is_lost = stream.At(ticks[-1]).random() < self.probability
        return ticks[:1] if is_lost else ticks[-1:]
