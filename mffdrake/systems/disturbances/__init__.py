"""What disturbs images on their way from the cameras to the recognizer.

A disturbance is a class of parameters that makes its own systems. A new one is a file here and a
line in `Disturbance`.
"""

from typing import Annotated, TypeAlias

from mffdrake.recognition.parameters import OneOf, choices
from mffdrake.systems.disturbances.black import Black
from mffdrake.systems.disturbances.brightness import Brightness
from mffdrake.systems.disturbances.chain import AddDisturbances
from mffdrake.systems.disturbances.color_temperature import ColorTemperature
from mffdrake.systems.disturbances.dropped_frames import DroppedFrames
from mffdrake.systems.disturbances.frozen import Frozen
from mffdrake.systems.disturbances.gaussian_noise import GaussianNoise
from mffdrake.systems.disturbances.image_disturbance import ImageDisturbance
from mffdrake.systems.disturbances.late_frames import LateFrames
from mffdrake.systems.disturbances.motion_blur import MotionBlur
from mffdrake.systems.disturbances.salt_and_pepper import SaltAndPepper

__all__ = [
    "DISTURBANCES",
    "AddDisturbances",
    "Black",
    "Brightness",
    "ColorTemperature",
    "Disturbance",
    "DroppedFrames",
    "Frozen",
    "GaussianNoise",
    "ImageDisturbance",
    "LateFrames",
    "MotionBlur",
    "SaltAndPepper",
]

Disturbance: TypeAlias = Annotated[
    MotionBlur
    | GaussianNoise
    | SaltAndPepper
    | Brightness
    | ColorTemperature
    | DroppedFrames
    | LateFrames
    | Frozen
    | Black,
    OneOf(),
]
"""A parameter that is one of the disturbances; in YAML a tag or a name such as ``black``."""

DISTURBANCES: tuple[type, ...] = choices(Disturbance)
"""All of them."""
