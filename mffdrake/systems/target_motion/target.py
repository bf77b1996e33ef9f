"""The target in a scene: its model's visuals as one mesh, moved as is prescribed."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.geometry import FrameId, Mesh, Role, SceneGraph, SourceId
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from mffdrake.recognition.parameters import InputError
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.systems.arms.models import ConfigureParser, DescribeMissing
from mffdrake.systems.clutter.moving_shapes import MovingShapes
from mffdrake.systems.rendering.surfaces import MakeSurface

__all__ = ["AddTarget", "Target", "TargetError"]

_DRAWN_BY_VTK = (".obj", ".gltf")


class TargetError(InputError, ValueError):
    """A target's model cannot be used; the message begins with its name."""


@dc.dataclass(frozen=True)
class Target:
    """The target in a scene, and in the scene's clones.

    Attributes:
        source: It is a source of its own there, ...
        frame: ... and this its frame M.
        mesh: What the renderers draw, in that frame.
    """

    source: SourceId
    frame: FrameId
    mesh: ColoredMesh

    def AddPose(
        self,
        builder: DiagramBuilder,
        scene_graph: SceneGraph,
        calc_pose: Callable[[float], RigidTransform],
        *,
        name: str,
        latency: float = 0.0,
        still: bool = False,
    ) -> None:
        """Adds what tells a scene where the target was a latency [s] ago.

        Args:
            builder: Receives the system.
            scene_graph: The scene, or a clone of it.
            calc_pose: Its pose X_WM at a time [s].
            name: The system's name.
            latency: The latency [s].
            still: Whether it never moves.
        """
        poser = MovingShapes([self.frame], lambda time: [calc_pose(time - latency)], still=still)
        builder.AddNamedSystem(name, poser)
        builder.Connect(poser.get_output_port(), scene_graph.get_source_pose_port(self.source))


def AddTarget(scene_graph: SceneGraph, model: str, *, renderer: str = "flat") -> Target:
    """Adds a target's model to a scene: no plant's, as it moves as is prescribed.

    Args:
        scene_graph: Receives the model.
        model: URL or path of its SDF or URDF.
        renderer: What will draw it, see `AddRenderer`.

    Returns:
        The target.

    Raises:
        TargetError: When the model cannot be loaded, is not one free rigid body, or nothing is
            drawn of it, or what the renderer cannot draw.

    Example:
        >>> AddTarget(SceneGraph(), "package://mffdrake/target_box.sdf").mesh.triangles.shape
        (12, 3, 3)
    """
    if "://" not in model and not Path(model).exists():
        raise TargetError(f"'{model}' cannot be loaded: {DescribeMissing(model)}")
    plant = MultibodyPlant(0.0)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    parser = Parser(plant)
    ConfigureParser(parser)
    try:
        if model.startswith("package://"):
            (instance,) = parser.AddModelsFromUrl(model)
        else:
            (instance,) = parser.AddModels(model)
    except (RuntimeError, ValueError, NotImplementedError) as error:
        reason = " ".join(str(error).split())
        raise TargetError(f"'{model}' cannot be loaded: {reason}") from error
    bodies = plant.GetBodyIndices(instance)
    if len(bodies) != 1:
        raise TargetError(f"'{model}' must be one rigid body, but has {len(bodies)} bodies")
    if plant.num_joints() > 0:
        raise TargetError(
            f"'{model}' must be free: neither static nor joined to the world; "
            "target.X_WM tells where it is"
        )
    body = plant.get_body(bodies[0])
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    mesh = _ReadMesh(scene_graph, frame, f"{model}: body '{body.name()}'", model, renderer)
    return Target(plant.get_source_id(), frame, mesh)


def _ReadMesh(
    scene_graph: SceneGraph, frame: FrameId, body: str, model: str, renderer: str
) -> ColoredMesh:
    """What the renderers draw for a body: all of its visuals as one mesh in its frame."""
    inspector = scene_graph.model_inspector()
    triangles, colors, materials = [np.empty((0, 3, 3))], [np.empty((0, 3))], []
    for visual in inspector.GetGeometries(frame, Role.kPerception):
        shape = inspector.GetShape(visual)
        is_mesh = isinstance(shape, Mesh)
        if is_mesh and renderer == "vtk" and shape.extension() not in _DRAWN_BY_VTK:
            raise TargetError(
                f"{model}: the renderer vtk draws {' and '.join(_DRAWN_BY_VTK)} "
                f"meshes only, and would leave {shape.source().description()} out; convert it "
                "to one of these, or take renderer: flat"
            )
        try:
            surface = MakeSurface(shape, inspector.GetPerceptionProperties(visual))
        except ValueError as error:
            raise TargetError(f"{model}: {error}") from error
        X_BG = inspector.GetPoseInFrame(visual)
        vertices = surface.vertices @ X_BG.rotation().matrix().T + X_BG.translation()
        names, drawn = np.array(surface.materials), surface.colors[:, 3] > 0.0
        triangles.append(vertices[surface.triangles[drawn]])
        # No color was chosen where the renderers have to take their own.
        colors.append(np.where(names[:, None] == "", np.nan, surface.colors[:, :3])[drawn])
        materials += names[drawn].tolist()
    if not materials:
        raise TargetError(
            f"{body} has no visual; give it a closed, colored mesh, "
            "or several visuals that together are one"
        )
    return ColoredMesh(model, np.concatenate(triangles), np.concatenate(colors), materials)
