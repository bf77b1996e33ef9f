"""A shutter that is open for a while."""

from __future__ import annotations

from collections.abc import Sequence

from pydrake.systems.framework import LeafSystem

from mffdrake.recognition.parameters import Latency, parameters
from mffdrake.systems.disturbances.image_memory import FrameDisturbance
from mffdrake.systems.random_stream import RandomStream
from mffdrake.systems.timing import Timing

__all__ = ["MotionBlur"]


@parameters
class MotionBlur(FrameDisturbance):
    """Delivers the mean of the images at all control ticks while the shutter is open.

    The shutter closes at the frame's time. All of these images are really rendered, so it takes
    ``exposure / control_period`` times longer to draw. Where there are other disturbances, let it
    be the first: what follows then disturbs the blurred image, as in a camera.

    Attributes:
        exposure: How long the shutter is open [s]: a whole multiple of the control period, up to
            the vision period; 0 for a sharp image.

    Example:
        >>> MotionBlur(exposure=0.02).Takes(13, Timing()), MotionBlur().Takes(14, Timing())
        (True, False)
    """

    exposure: Latency = 0.010

    def MakeSystem(self, stream: RandomStream, timing: Timing) -> LeafSystem:
        """Makes the system that blurs one camera's image.

        Raises:
            ValueError: When the exposure is no such multiple of the control period.
        """
        ticks = self.exposure / timing.control_period
        if abs(ticks - round(ticks)) > 1e-6 or self.exposure > (1 + 1e-6) * timing.vision_period:
            raise ValueError(
                f"motion_blur: exposure must be a whole multiple of the control period of "
                f"{timing.control_period} s, up to the vision period of {timing.vision_period} s, "
                f"not {self.exposure} s"
            )
        return super().MakeSystem(stream, timing)

    def Takes(self, tick: int, timing: Timing) -> bool:
        """Whether a frame is due within the exposure, see `FrameDisturbance.Takes`."""
        return timing.FrameAtTick(tick + self._NumTicks(timing)) > timing.FrameAtTick(tick - 1)

    def Shown(self, ticks: Sequence[int], stream: RandomStream, timing: Timing) -> Sequence[int]:
        """The images since the shutter opened, see `FrameDisturbance.Shown`."""
        return [t for t in ticks if t >= ticks[-1] - self._NumTicks(timing)]

    def _NumTicks(self, timing: Timing) -> int:
        return timing.Tick(self.exposure)
