"""What stands or moves in the scene beside the target: what all kinds have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from mffdrake.recognition.parameters import kind_of, parameters
from mffdrake.systems.clutter.moving_shapes import (
    AddMovingShapes,
    Color,
    MovingShape,
    MovingShapes,
)
from mffdrake.systems.random_stream import RandomStream

__all__ = ["Array", "SceneClutter"]

Array = NDArray[np.float64]


@parameters
class SceneClutter:
    """Things in the scene that are not the target: their parameters, which make their systems."""

    def AddToScene(
        self,
        builder: DiagramBuilder,
        scene_graph: SceneGraph,
        *,
        X_WT: RigidTransform,
        colors: Sequence[Color],
        index: int,
        seed: int,
        latency: float = 0.0,
    ) -> MovingShapes:
        """Adds the things to a scene.

        Call it before `AddRenderer`, as the flat renderer draws what is there by then. With the
        same arguments they move in a second scene just as in the first one.

        Args:
            builder: Holds the scene; receives a system such as ``occluder_0``, by the index.
            scene_graph: The scene, such as the one that is drawn.
            X_WT: The target's pose in the world, in whose frame T places are told.
            colors: The target's colors.
            index: Position in the list of clutter, from 0. It keeps random numbers apart.
            seed: Of the random numbers, at least 0.
            latency: So much earlier is what the scene shows [s], as for late cameras.

        Returns:
            The system that moves the things.
        """
        kind = kind_of(type(self))
        shapes, positions = self.Make(colors, RandomStream(seed, index, kind))
        name = f"{kind}_{index}"
        if builder.HasSubsystemNamed(name):
            name = f"{kind}_{index}_{scene_graph.get_name()}"
        return AddMovingShapes(
            builder,
            scene_graph,
            shapes,
            lambda time: [X_WT @ RigidTransform(p_TG) for p_TG in positions(time - latency)],
            name=name,
        )

    @abstractmethod
    def Make(
        self, colors: Sequence[Color], stream: RandomStream
    ) -> tuple[Sequence[MovingShape], Callable[[float], Array]]:
        """Makes the things.

        Args:
            colors: The target's colors.
            stream: Random numbers.

        Returns:
            The shapes, and their centers p_TG in the target's frame [m] at a time [s], shape
            (number, 3). Their axes are those of T.
        """
