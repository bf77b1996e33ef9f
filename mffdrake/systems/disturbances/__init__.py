"""What disturbs images on their way from the cameras to the recognizer.

A disturbance is a class of parameters that makes its own systems. A new one is a class here and a
line in `Disturbance`.
"""

from typing import Annotated, TypeAlias

from mffdrake.recognition.parameters import OneOf, choices
from mffdrake.systems.disturbances.chain import AddDisturbances
from mffdrake.systems.disturbances.image_disturbance import ImageDisturbance
from mffdrake.systems.disturbances.light import Brightness, ColorTemperature
from mffdrake.systems.disturbances.missing_images import Black, DroppedFrames, Frozen, LateFrames
from mffdrake.systems.disturbances.motion_blur import MotionBlur
from mffdrake.systems.disturbances.noise import GaussianNoise, SaltAndPepper

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
