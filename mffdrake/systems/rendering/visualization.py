"""Shows a simulation in Meshcat, records it as a self-contained HTML file, draws a diagram."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pydot
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Cylinder,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort

from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.solid.mesh_file import ColoredMesh

__all__ = ["AddMeshcat", "PoseEstimateVisualizer", "SaveDiagram", "SaveReplay"]

_PUBLISH_PERIOD = 0.033
_GHOST_SCALE = 1.02  # A little larger than the target, so that their faces do not flicker.
_GHOST_OPACITY = 0.5
_AXIS_LENGTH, _AXIS_RADIUS = 0.2, 0.003


class PoseEstimateVisualizer(LeafSystem):
    """Shows the estimated pose in Meshcat: a frame, and a ghost of the target.

    .. pydrake_system::

        name: PoseEstimateVisualizer
        input_ports:
        - X_CM
        - state

    Ports:
        X_CM: The estimated pose in the camera, a RigidTransform.
        state: State of the plant, which tells where the camera is.

    Args:
        meshcat: Where to show it, below the path "estimate".
        plant: The plant with the camera.
        mesh: The target's mesh.
        camera_frame: The camera's frame C in the plant, or its name.
    """

    def __init__(
        self,
        *,
        meshcat: Meshcat,
        plant: MultibodyPlant,
        mesh: ColoredMesh,
        camera_frame: Frame | str = "camera_right",
    ) -> None:
        super().__init__()
        self._meshcat = meshcat
        self._plant = plant
        if isinstance(camera_frame, str):
            camera_frame = plant.GetFrameByName(camera_frame)
        self._frame = camera_frame
        self._kinematics = plant.CreateDefaultContext()  # Scratch space, written before every use.
        self._estimate = self.DeclareAbstractInputPort("X_CM", AbstractValue.Make(RigidTransform()))
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        corners = mesh.triangles.reshape(-1, 3).T
        meshcat.SetTriangleColorMesh(
            "estimate/ghost",
            vertices=_GHOST_SCALE * corners,
            faces=np.arange(corners.shape[1]).reshape(-1, 3).T,
            colors=np.repeat(mesh.colors, 3, axis=0).T,
        )
        meshcat.SetProperty("estimate/ghost", "modulated_opacity", _GHOST_OPACITY)
        _DrawFrame(meshcat, "estimate/frame")
        self.DeclarePeriodicPublishEvent(_PUBLISH_PERIOD, 0.0, self._Publish)
        self.DeclareForcedPublishEvent(self._Publish)

    def _Publish(self, context: Context) -> None:
        self._plant.SetPositionsAndVelocities(self._kinematics, self._state.Eval(context))
        X_WM = self._frame.CalcPoseInWorld(self._kinematics) @ self._estimate.Eval(context)
        self._meshcat.SetTransform("estimate", X_WM, time_in_recording=context.get_time())


def _DrawFrame(meshcat: Meshcat, path: str) -> None:
    """Three thin cylinders: x red, y green, z blue."""
    axis = Cylinder(_AXIS_RADIUS, _AXIS_LENGTH)
    along_z = RigidTransform([0.0, 0.0, 0.5 * _AXIS_LENGTH])
    for name, turn, color in (
        ("x", RotationMatrix.MakeYRotation(0.5 * math.pi), Rgba(1, 0, 0)),
        ("y", RotationMatrix.MakeXRotation(-0.5 * math.pi), Rgba(0, 1, 0)),
        ("z", RotationMatrix(), Rgba(0, 0, 1)),
    ):
        meshcat.SetObject(f"{path}/{name}", axis, color)
        meshcat.SetTransform(f"{path}/{name}", RigidTransform(turn, [0, 0, 0]) @ along_z)


def AddMeshcat(
    builder: DiagramBuilder,
    *,
    meshcat: Meshcat,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    estimate: OutputPort,
    mesh: ColoredMesh,
    camera_frame: Frame | str = "camera_right",
) -> None:
    """Adds the scene and the estimated pose to Meshcat.

    Args:
        builder: Receives the visualizers.
        meshcat: Where to show them.
        plant: The plant with the camera's frame.
        scene_graph: The scene.
        estimate: The estimated pose's port, a RigidTransform X_CM.
        mesh: The target's mesh.
        camera_frame: See `PoseEstimateVisualizer`.
    """
    params = MeshcatVisualizerParams(publish_period=_PUBLISH_PERIOD)
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    ghost = builder.AddNamedSystem(
        "pose_estimate_visualizer",
        PoseEstimateVisualizer(meshcat=meshcat, plant=plant, mesh=mesh, camera_frame=camera_frame),
    )
    builder.Connect(estimate, ghost.GetInputPort("X_CM"))
    builder.Connect(plant.get_state_output_port(), ghost.GetInputPort("state"))


def SaveReplay(meshcat: Meshcat, path: Path | str) -> None:
    """Writes what Meshcat recorded as one HTML file that needs nothing else.

    Args:
        meshcat: After a simulation between ``StartRecording`` and now.
        path: The file.

    Raises:
        OSError: When it cannot be written.
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    with WholeFile(path) as part:
        part.write_text(meshcat.StaticHtml(), encoding="utf-8")


def SaveDiagram(diagram: Diagram, path: Path | str) -> None:
    """Draws a diagram with Graphviz.

    Args:
        diagram: The diagram.
        path: The file; its suffix tells the format, SVG or PNG.

    Raises:
        FileNotFoundError: When Graphviz's program ``dot`` is not installed.
        OSError: When the file cannot be written.
    """
    if shutil.which("dot") is None:
        raise FileNotFoundError(
            "drawing the diagram needs Graphviz; install it with: sudo apt-get install graphviz"
        )
    graphs = pydot.graph_from_dot_data(diagram.GetGraphvizString(max_depth=1))
    assert graphs is not None  # Drake writes what pydot reads.
    with WholeFile(path) as part:
        graphs[0].write(str(part), format=Path(path).suffix[1:])
