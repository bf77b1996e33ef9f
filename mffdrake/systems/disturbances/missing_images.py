"""Images that are black, frozen, lost or late."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from mffdrake.recognition.parameters import Duration, NonNegative, Share, parameters
from mffdrake.systems.disturbances.image_disturbance import Image, PixelDisturbance
from mffdrake.systems.disturbances.image_memory import FrameDisturbance
from mffdrake.systems.random_stream import RandomStream
from mffdrake.systems.timing import Timing

__all__ = ["Black", "DroppedFrames", "Frozen", "LateFrames"]


@parameters
class Black(PixelDisturbance):
    """Makes images black, as with a covered lens.

    Attributes:
        starts: When the images become black [s].
        duration: For how long each time [s]; an image just at the end is no longer black.

    Example:
        >>> Black(starts=[1.0, 2.5], duration=0.2)
        Black(cameras=None, starts=(1.0, 2.5), duration=0.2)
    """

    starts: tuple[NonNegative, ...] = (1.0,)
    duration: Duration = 0.2

    def Disturb(self, colors: Image, *, time: float, rng: np.random.Generator) -> Image:
        """Blackens, see `PixelDisturbance.Disturb`."""
        # A rounding error must not move an image into or out of the interval.
        since = [time - start + 1e-9 for start in self.starts]
        is_black = any(0.0 <= s < self.duration for s in since)
        return np.zeros_like(colors) if is_black else colors


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
    duration: Duration = 0.5

    def Shown(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The present image or the last one delivered, see `FrameDisturbance.Shown`."""
        first, end = timing.Tick(self.start), timing.Tick(self.start + self.duration)
        return ticks[:1] if first <= ticks[-1] < end else ticks[-1:]


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

    frames: Annotated[int, Ge(1), Le(1000)] = 1
    probability: Share | None = None

    def Shown(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The newest image that has arrived, see `FrameDisturbance.Shown`."""
        arrived = [k - self.Delay(tick, stream) for k, tick in enumerate(ticks)]
        newest = max(0, *arrived)
        return [ticks[newest]]

    def Kept(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """Those that may still be delivered, see `FrameDisturbance.Kept`."""
        return ticks[-self.frames :]

    def Delay(self, tick: int, stream: RandomStream) -> int:
        """How many frames the image delivered at a frame is old at most."""
        if self.probability is None:
            return self.frames
        rng = stream.At(tick)
        return int(rng.integers(1, self.frames + 1)) if rng.random() < self.probability else 0
