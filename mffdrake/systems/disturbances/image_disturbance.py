"""What disturbs the images between a camera and the recognizer: what all kinds have in common."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.sensors import ImageRgba8U

from mffdrake.recognition.parameters import kind_of, parameters
from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.random_stream import RandomStream
from mffdrake.systems.timing import Timing

__all__ = ["Image", "ImageDisturbance", "PixelDisturbance", "PixelFilter", "WriteImage"]

Image = NDArray[np.uint8]


@parameters
class ImageDisturbance:
    """A disturbance of images: its parameters, which make its systems.

    Attributes:
        cameras: Names of the cameras that it concerns; null for all.
    """

    cameras: tuple[str, ...] | None = None

    def AddToBuilder(
        self,
        builder: DiagramBuilder,
        image: OutputPort,
        *,
        camera: str,
        index: int,
        seed: int,
        timing: Timing,
    ) -> OutputPort:
        """Adds the disturbance of one camera's image.

        Args:
            builder: Receives a system such as ``gaussian_noise_right``; a second one of that name
                is ``gaussian_noise_1_right``, by its index.
            image: The port of the image, an ImageRgba8U.
            camera: The camera's name.
            index: Position in the list of disturbances, from 0. It and the camera's name keep
                random numbers apart.
            seed: Of the random numbers, at least 0.
            timing: Control and vision periods.

        Returns:
            The port of the disturbed image; where this camera is not concerned, the image's own.

        Raises:
            ValueError: When a parameter does not suit the periods.
        """
        if self.cameras is not None and camera not in self.cameras:
            return image
        name = f"{kind_of(type(self))}_{camera}"
        if builder.HasSubsystemNamed(name):
            name = f"{kind_of(type(self))}_{index}_{camera}"
        stream = RandomStream(seed, index, camera)
        system = builder.AddNamedSystem(name, self.MakeSystem(stream, timing))
        builder.Connect(image, system.get_input_port())
        return system.get_output_port()

    @abstractmethod
    def MakeSystem(self, stream: RandomStream, timing: Timing) -> LeafSystem:
        """Makes the system that disturbs one camera's image."""


@parameters
class PixelDisturbance(ImageDisturbance):
    """A disturbance of each image by itself, whatever other images there were.

    It disturbs an image at any time, whether or not that is a frame's.
    """

    def MakeSystem(self, stream: RandomStream, timing: Timing) -> LeafSystem:
        """Makes the system that disturbs one camera's image."""
        return PixelFilter(self, stream=stream, timing=timing)

    @abstractmethod
    def Disturb(self, colors: Image, *, time: float, rng: np.random.Generator) -> Image:
        """Disturbs the colors of an image.

        Args:
            colors: Red, green and blue, shape (height, width, 3); not to be written.
            time: When the image is taken [s].
            rng: Random numbers of this time's control tick.

        Returns:
            The disturbed colors, of the same shape.
        """


class PixelFilter(LeafSystem):
    """Disturbs each image by itself.

    .. pydrake_system::

        name: PixelFilter
        input_ports:
        - color_image
        output_ports:
        - disturbed_image

    It has no state, and disturbs only when its output is read, once at a time.

    Ports:
        color_image: ImageRgba8U.
        disturbed_image: The same disturbed; its alpha is unchanged.

    Args:
        disturbance: What is done to the colors.
        stream: The random numbers for it.
        timing: Gives the control period.

    Example:
        >>> from mffdrake.systems.disturbances import Black
        >>> stream = RandomStream(seed=0, index=0, name="right")
        >>> system = PixelFilter(Black(starts=[0.0]), stream=stream, timing=Timing())
        >>> context = system.CreateDefaultContext()
        >>> _ = system.get_input_port().FixValue(context, ImageRgba8U(4, 3, 255))
        >>> system.get_output_port().Eval(context).at(0, 0)
        array([  0,   0,   0, 255], dtype=uint8)
    """

    def __init__(
        self, disturbance: PixelDisturbance, *, stream: RandomStream, timing: Timing
    ) -> None:
        super().__init__()
        self._disturbance, self._stream, self._timing = disturbance, stream, timing
        model = AbstractValue.Make(ImageRgba8U())
        self._image = self.DeclareAbstractInputPort("color_image", model)
        self.DeclareAbstractOutputPort(
            "disturbed_image",
            lambda: AbstractValue.Make(ImageRgba8U()),
            WeakCallback(self._CalcDisturbedImage),
        )

    def _CalcDisturbedImage(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time()
        pixels = self._image.Eval(context).data
        disturbed = pixels.copy()
        disturbed[..., :3] = self._disturbance.Disturb(
            pixels[..., :3], time=time, rng=self._stream.At(self._timing.Tick(time))
        )
        WriteImage(output, disturbed)


def WriteImage(output: AbstractValue, pixels: Image) -> None:
    """Writes pixels, shape (height, width, 4), to an output port's value."""
    height, width = pixels.shape[:2]
    image = output.get_mutable_value()
    image.resize(width, height)
    image.mutable_data[:] = pixels
