"""A plate in the line of sight."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from pydrake.geometry import Box

from mffdrake.recognition.parameters import (
    Duration,
    Finite,
    NonNegative,
    Position,
    Share,
    Vector3,
    parameters,
)
from mffdrake.systems.clutter.moving_shapes import Color, MovingShape
from mffdrake.systems.clutter.scene_clutter import Array, SceneClutter
from mffdrake.systems.random_stream import RandomStream

__all__ = ["Occluder"]


_THINNEST = 1e-6  # m
_SHORTEST = 1e-9  # of a direction


@parameters
class Occluder(SceneClutter):
    """A grey plate without hue that moves on a line, to and fro or past the target once.

    Its center's place on the line is ``amplitude sin(2 pi t / period)``; with a ``duration``, it
    goes once at constant speed from ``-amplitude`` to ``amplitude``, and stands there before and
    after.

    Attributes:
        size: Of the plate along the axes of the target's frame T [m].
        center: The middle of the line in T [m]; by default in front of a target that turns its z
            axis away from the camera, as it does at the hand's first pose.
        direction: Of the line in T; of any length but 0.
        amplitude: How far the plate's center moves from the middle [m].
        period: Of the motion to and fro [s].
        start: When the passage begins [s].
        duration: How long the passage takes [s]; null for a motion to and fro.
        grey: The plate's color, from 0 for black to 1 for white.

    Raises:
        ValueError: When a size is not positive or the direction is 0.

    Example:
        >>> occluder = Occluder(start=2.0, duration=4.0, amplitude=0.5)
        >>> [occluder.CalcPlace(t) for t in (0.0, 4.0, 5.0, 9.0)]
        [-0.5, 0.0, 0.25, 0.5]
    """

    size: Position = (0.06, 0.4, 0.01)
    center: Position = (0.0, 0.0, -0.3)
    direction: Vector3 = (1.0, 0.0, 0.0)
    amplitude: Annotated[Finite, Ge(0), Le(1e3)] = 0.3
    period: Duration = 5.0
    start: NonNegative = 0.0
    duration: Duration | None = None
    grey: Share = 0.3

    def __post_init__(self) -> None:
        """Checks size and direction."""
        if min(self.size) < _THINNEST:
            raise ValueError(
                f"size must be three positive numbers, at least {_THINNEST:g} m, "
                f"not {list(self.size)}"
            )
        if np.linalg.norm(self.direction) < _SHORTEST:
            raise ValueError("direction must be a vector other than 0, such as [1, 0, 0]")

    def CalcPlace(self, time: float) -> float:
        """The plate's place on the line at a time [s]: its distance from the middle [m]."""
        if self.duration is None:
            return self.amplitude * math.sin(2.0 * math.pi * time / self.period)
        share = min(1.0, max(0.0, (time - self.start) / self.duration))
        return self.amplitude * (2.0 * share - 1.0)

    def Make(
        self, colors: Sequence[Color], stream: RandomStream
    ) -> tuple[Sequence[MovingShape], Callable[[float], Array]]:
        """Makes the plate, see `SceneClutter.Make`."""
        center, direction = np.array(self.center), np.array(self.direction)
        direction /= np.linalg.norm(direction)
        plate = MovingShape(Box(*self.size), (self.grey, self.grey, self.grey))
        return [plate], lambda time: (center + self.CalcPlace(time) * direction)[None]
