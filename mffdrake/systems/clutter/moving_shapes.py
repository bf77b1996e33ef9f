"""Colored shapes that move through a scene by themselves, apart from any plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    MakePhongIllustrationProperties,
    PerceptionProperties,
    RenderLabel,
    Rgba,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from mffdrake.systems.callbacks import WeakCallback

__all__ = ["AddMovingShapes", "Color", "MovingShape", "MovingShapes"]

Color = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""


@dataclass(frozen=True)
class MovingShape:
    """A colored shape.

    Attributes:
        shape: What is drawn.
        color: Its color.
    """

    shape: Shape
    color: Color


class MovingShapes(LeafSystem):
    """Poses the frames of shapes in a scene as functions of time.

    .. pydrake_system::

        name: MovingShapes
        output_ports:
        - geometry_pose

    It has no state and no input.

    Ports:
        geometry_pose: The frames' poses (FramePoseVector), for a SceneGraph.

    Args:
        frames: The frames that are registered with the scene.
        poses: Their poses X_WG at a time [s], in the same order.
        still: Whether they are the same at all times: a plant's scene asks for them in every step.

    Example:
        >>> still = MovingShapes([FrameId.get_new_id()], lambda t: [RigidTransform()])
        >>> still.get_output_port().Eval(still.CreateDefaultContext()).size()
        1
    """

    def __init__(
        self,
        frames: Sequence[FrameId],
        poses: Callable[[float], Sequence[RigidTransform]],
        *,
        still: bool = False,
    ) -> None:
        super().__init__()
        self._frames = list(frames)
        self._poses = poses
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            WeakCallback(self._CalcGeometryPose),
            {self.nothing_ticket() if still else self.time_ticket()},
        )

    def _CalcGeometryPose(self, context: Context, output: AbstractValue) -> None:
        poses = FramePoseVector()
        for frame, X_WG in zip(self._frames, self._poses(context.get_time()), strict=True):
            poses.set_value(frame, X_WG)
        output.set_value(poses)


def AddMovingShapes(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    shapes: Sequence[MovingShape],
    poses: Callable[[float], Sequence[RigidTransform]],
    *,
    name: str,
) -> MovingShapes:
    """Registers shapes with a scene, as a source of their own, and lets them move.

    They are seen by cameras and by Meshcat, and touch nothing.

    Args:
        builder: Receives a system and holds the scene.
        scene_graph: The scene; without this package's flat renderer as yet.
        shapes: What moves.
        poses: Their poses X_WG at a time [s], in the same order.
        name: Name of the system and of the scene's source, and first part of the shapes' names.

    Returns:
        The system.

    Raises:
        RuntimeError: When the scene or the builder has something of that name.
    """
    source = scene_graph.RegisterSource(name)
    frames = [GeometryFrame(f"{name}_{k}") for k in range(len(shapes))]
    for frame, shape in zip(frames, shapes, strict=True):
        scene_graph.RegisterFrame(source, frame)
        color = Rgba(*shape.color)
        instance = GeometryInstance(RigidTransform(), shape.shape, frame.name())
        properties = PerceptionProperties()
        properties.AddProperty("phong", "diffuse", color)
        properties.AddProperty("label", "id", RenderLabel.kDontCare)
        instance.set_perception_properties(properties)
        instance.set_illustration_properties(MakePhongIllustrationProperties(color.rgba))
        scene_graph.RegisterGeometry(source, frame.id(), instance)
    system = builder.AddNamedSystem(name, MovingShapes([frame.id() for frame in frames], poses))
    builder.Connect(system.get_output_port(), scene_graph.get_source_pose_port(source))
    return system
