"""Things in the target's own colors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from pydrake.geometry import Box, Sphere

from mffdrake.recognition.parameters import Duration, Length, Position, parameters
from mffdrake.systems.clutter.moving_shapes import Color, MovingShape
from mffdrake.systems.clutter.scene_clutter import Array, SceneClutter
from mffdrake.systems.random_stream import RandomStream

__all__ = ["Distractors"]

_NUM_SINES = 3  # along each axis; more make a path no less regular to the eye


@parameters
class Distractors(SceneClutter):
    """Spheres and cubes, by turns, in the target's colors, on smooth random paths.

    Along each axis a center's place is a sum of three sines with random phases, periods and
    amplitudes, so that it never leaves the region and never repeats itself.

    Attributes:
        number: How many there are.
        size: Diameter of the spheres and side of the cubes [m].
        center: Middle of the region in the target's frame T [m]; by default behind a target that
            turns its z axis away from the camera, as it does at the hand's first pose.
        region: Size of the region along the axes of T [m]; the centers stay within it.
        period: Mean period of the sines [s]; they are from 2/3 to 2 of it.

    Raises:
        ValueError: When the region has a negative size.

    Example:
        >>> Distractors(number=2, size=0.02).region
        (0.8, 0.6, 0.1)
    """

    number: Annotated[int, Ge(1), Le(1000)] = 6
    size: Length = 0.03
    center: Position = (0.0, 0.0, 0.3)
    region: Position = (0.8, 0.6, 0.1)
    period: Duration = 5.0

    def __post_init__(self) -> None:
        """Checks the region."""
        if min(self.region) < 0.0:
            raise ValueError(f"region must be three numbers from 0 on, not {list(self.region)}")

    def Make(
        self, colors: Sequence[Color], stream: RandomStream
    ) -> tuple[Sequence[MovingShape], Callable[[float], Array]]:
        """Makes the things and their paths, see `SceneClutter.Make`."""
        shapes = [
            MovingShape(
                Sphere(0.5 * self.size) if k % 2 == 0 else Box(self.size, self.size, self.size),
                colors[k // 2 % len(colors)],
            )
            for k in range(self.number)
        ]
        rng = stream.At(0)
        count = (self.number, 3, _NUM_SINES)
        weights = rng.uniform(0.2, 1.0, count)
        weights /= weights.sum(axis=2, keepdims=True)
        rates = 2.0 * np.pi * rng.uniform(0.5, 1.5, count) / self.period
        phases = rng.uniform(0.0, 2.0 * np.pi, count)
        center, reach = np.array(self.center), 0.5 * np.array(self.region)

        def CalcPositions(time: float) -> Array:
            swing = (weights * np.sin(rates * time + phases)).sum(axis=2)
            return np.asarray(center + reach * swing)

        return shapes, CalcPositions
