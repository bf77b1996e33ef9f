"""Disturbances that need images of the past, and the one system that remembers them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem, State
from pydrake.systems.sensors import ImageRgba8U

from mffdrake.recognition.parameters import parameters
from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.disturbances.image_disturbance import Image, ImageDisturbance, WriteImage
from mffdrake.systems.random_stream import RandomStream
from mffdrake.systems.timing import Timing

__all__ = ["FrameDisturbance", "ImageMemory"]


@parameters
class FrameDisturbance(ImageDisturbance):
    """A disturbance that delivers images of other times.

    Images are told apart by their control ticks. Between frames the camera delivers what it
    delivered at the last frame.
    """

    def MakeSystem(self, stream: RandomStream, timing: Timing) -> LeafSystem:
        """Makes the system that disturbs one camera's image."""
        return ImageMemory(self, stream=stream, timing=timing)

    def Takes(self, tick: int, timing: Timing) -> bool:
        """Whether the image of a tick is needed; those of frames always are."""
        return timing.IsVisionTick(timing.TimeOfTick(tick))

    @abstractmethod
    def Shown(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The images whose mean is delivered at a frame.

        Args:
            ticks: Those of the images there are, ascending: what was kept, and the present one.
            stream: Random numbers.
            timing: Control and vision periods.

        Returns:
            One or more of the ticks.
        """

    def Kept(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The images to keep for later: by default those that are shown; else as `Shown`."""
        return self.Shown(ticks, stream, timing)


@dataclass(frozen=True)
class _Memory:
    """What a camera remembers: never changed, only replaced.

    Attributes:
        tick: Of the last image that was taken; -1 before the first.
        delivered: What was delivered at the last frame.
        images: The images kept, by their ticks; not to be written.
    """

    tick: int = -1
    delivered: Image | None = None
    images: Mapping[int, Image] = field(default_factory=dict)

    def __deepcopy__(self, memo: dict[int, Any]) -> _Memory:
        """Itself, so that Drake may clone states at every step at no cost."""
        return self


class ImageMemory(LeafSystem):
    """Takes images, and delivers at every frame one of them or a mean of several.

    .. pydrake_system::

        name: ImageMemory
        input_ports:
        - color_image
        output_ports:
        - disturbed_image

    The images are kept in an abstract state. It is updated in the unrestricted updates at a tick,
    which Drake makes before the discrete updates, in which the recognizer reads the image. Who
    reads it just before the updates, as a recorder between two steps does, sees the same: the
    output is what the state is to become at this tick, whether or not it already is.

    Ports:
        color_image: ImageRgba8U.
        disturbed_image: What is delivered; before the first frame, the image itself.

    Args:
        disturbance: Which images are taken, shown and kept.
        stream: The random numbers for it.
        timing: Control and vision periods.

    Example:
        >>> from mffdrake.systems.disturbances import LateFrames
        >>> stream = RandomStream(seed=0, index=0, name="right")
        >>> system = ImageMemory(LateFrames(frames=1), stream=stream, timing=Timing())
        >>> system.get_output_port().get_name()
        'disturbed_image'
    """

    def __init__(
        self, disturbance: FrameDisturbance, *, stream: RandomStream, timing: Timing
    ) -> None:
        super().__init__()
        self._disturbance, self._stream, self._timing = disturbance, stream, timing
        model = AbstractValue.Make(ImageRgba8U())
        self._image = self.DeclareAbstractInputPort("color_image", model)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory()))
        self.DeclareAbstractOutputPort(
            "disturbed_image",
            lambda: AbstractValue.Make(ImageRgba8U()),
            WeakCallback(self._CalcDisturbedImage),
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(timing.control_period, 0.0, self._Remember)

    def _Remember(self, context: Context, state: State) -> None:
        memory = self._CalcMemory(context)
        state.get_mutable_abstract_state(self._memory).set_value(memory)

    def _CalcMemory(self, context: Context) -> _Memory:
        """The state once the updates of the present tick are made."""
        memory: _Memory = context.get_abstract_state(self._memory).get_value()
        tick = self._timing.Tick(context.get_time())
        if tick == memory.tick or not self._disturbance.Takes(tick, self._timing):
            return memory
        # A copy, as the next rendering overwrites the port's own value
        images = {**memory.images, tick: self._image.Eval(context).data.copy()}
        ticks, delivered = sorted(images), memory.delivered
        if self._timing.IsVisionTick(self._timing.TimeOfTick(tick)):
            shown = self._disturbance.Shown(ticks, self._stream, self._timing)
            delivered = _Mean([images[t] for t in shown])
        kept = self._disturbance.Kept(ticks, self._stream, self._timing)
        return _Memory(tick, delivered, {t: images[t] for t in kept})

    def _CalcDisturbedImage(self, context: Context, output: AbstractValue) -> None:
        delivered = self._CalcMemory(context).delivered
        WriteImage(output, self._image.Eval(context).data if delivered is None else delivered)


def _Mean(images: Sequence[Image]) -> Image:
    """The mean, rounded; of one image, that image."""
    if len(images) == 1:
        return images[0]
    total = np.zeros(images[0].shape, dtype=np.float32)  # exact for whole numbers up to 2^24
    for image in images:
        total += image
    return np.rint(total / len(images)).astype(np.uint8)
