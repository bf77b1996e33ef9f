"""Shows a simulation in Meshcat, records it as a self-contained HTML file, draws a diagram."""

from __future__ import annotations

import dataclasses as dc
import math
import shutil
from pathlib import Path

import numpy as np
import pydot
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    FrameId,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    QueryObject,
    RenderCameraCore,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.sensors import CameraInfo

from mffdrake.recognition.camera.cameras import Camera, CameraRig
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.recognition.solid.solid_model import SolidModel
from mffdrake.systems.finite import EvalFinite
from mffdrake.systems.view.pose_view import PoseView, SetView, ViewRim

__all__ = [
    "PAGE_VIEW", "AddMeshcat", "PoseEstimateVisualizer", "SaveDiagram", "SaveReplay", "SceneView",
]  # fmt: skip

_PUBLISH_PERIOD = 0.033


class PoseEstimateVisualizer(LeafSystem):
    """Shows the estimated pose in Meshcat: a frame, a ghost of the target, and hypotheses.

    .. pydrake_system::

        name: PoseEstimateVisualizer
        input_ports:
        - X_CM
        - state
        - population (optional)

    Ports:
        X_CM: The estimated pose in the camera, a RigidTransform.
        state: State of the plant, which tells where the camera is.
        population: The N hypotheses, best first, shape (6 N,).

    Args:
        meshcat: Where to show it; for the paths see `PoseView`.
        plant: The plant with the camera.
        mesh: The target's mesh.
        camera_frame: The camera's frame C in the plant, or its name.
        solid: The target as a solid; without, its edges and the hypotheses are not shown.
        rig: The cameras, whose pyramids are shown.
        num_hypotheses: Number N of hypotheses.

    Example:
        >>> import mffdrake as mff
        >>> meshcat, plant = Meshcat(), mff.MakePa10Plant()
        >>> mesh = ColoredMesh.read(mff.FindModelsPath() / "target_box.obj")
        >>> ghost = PoseEstimateVisualizer(
        ...     meshcat=meshcat, plant=plant, mesh=mesh, camera_frame="hand"
        ... )
        >>> context = ghost.CreateDefaultContext()
        >>> _ = ghost.GetInputPort("X_CM").FixValue(context, RigidTransform([0.0, 0.0, 0.8]))
        >>> _ = ghost.GetInputPort("state").FixValue(context, np.zeros(14))
        >>> ghost.ForcedPublish(context)
        >>> meshcat.HasPath("estimate/ghost")
        True
    """

    def __init__(
        self,
        *,
        meshcat: Meshcat,
        plant: MultibodyPlant,
        mesh: ColoredMesh,
        camera_frame: Frame | str = "camera_right",
        solid: SolidModel | None = None,
        rig: CameraRig | None = None,
        num_hypotheses: int = 1,
    ) -> None:
        super().__init__()
        self._view = PoseView(meshcat, mesh, solid=solid, rig=rig)
        self._plant = plant
        if isinstance(camera_frame, str):
            camera_frame = plant.GetFrameByName(camera_frame)
        self._frame = camera_frame
        self._kinematics = plant.CreateDefaultContext()  # Scratch space, written before every use.
        self._estimate = self.DeclareAbstractInputPort("X_CM", AbstractValue.Make(RigidTransform()))
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self._population = self.DeclareVectorInputPort("population", 6 * num_hypotheses)
        self.DeclarePeriodicPublishEvent(_PUBLISH_PERIOD, 0.0, self._Publish)
        self.DeclareForcedPublishEvent(self._Publish)

    def _Publish(self, context: Context) -> None:
        state = EvalFinite(self, self._state, context)
        self._plant.SetPositionsAndVelocities(self._kinematics, state)
        hypotheses = None
        if self._population.HasValue(context):
            hypotheses = self._population.Eval(context).reshape(-1, 6)
        X_WC = self._frame.CalcPoseInWorld(self._kinematics)
        self._view.Show(X_WC, self._estimate.Eval(context), hypotheses, context.get_time())


def AddMeshcat(
    builder: DiagramBuilder,
    *,
    meshcat: Meshcat,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    estimate: OutputPort,
    mesh: ColoredMesh,
    camera_frame: Frame | str = "camera_right",
    population: OutputPort | None = None,
    solid: SolidModel | None = None,
    rig: CameraRig | None = None,
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
        population: The port of the hypotheses, shape (6 N,); not shown without.
        solid: See `PoseEstimateVisualizer`.
        rig: See `PoseEstimateVisualizer`.

    Example:
        >>> import mffdrake as mff
        >>> from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
        >>> from pydrake.systems.primitives import ConstantValueSource
        >>> builder, meshcat = DiagramBuilder(), Meshcat()
        >>> plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        >>> _ = mff.AddPa10(plant)
        >>> plant.Finalize()
        >>> pose = AbstractValue.Make(RigidTransform([0.0, 0.0, 0.8]))
        >>> AddMeshcat(
        ...     builder, meshcat=meshcat, plant=plant, scene_graph=scene_graph, camera_frame="hand",
        ...     estimate=builder.AddSystem(ConstantValueSource(pose)).get_output_port(),
        ...     mesh=ColoredMesh.read(mff.FindModelsPath() / "target_box.obj"),
        ... )
        >>> diagram = builder.Build()
        >>> diagram.ForcedPublish(diagram.CreateDefaultContext())
        >>> meshcat.HasPath("estimate/ghost")
        True
    """
    params = MeshcatVisualizerParams(publish_period=_PUBLISH_PERIOD)
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    ghost = builder.AddNamedSystem(
        "pose_estimate_visualizer",
        PoseEstimateVisualizer(
            meshcat=meshcat, plant=plant, mesh=mesh, camera_frame=camera_frame, solid=solid,
            rig=rig, num_hypotheses=1 if population is None else population.size() // 6,
        ),
    )  # fmt: skip
    if population is not None:
        builder.Connect(population, ghost.GetInputPort("population"))
    SetView(meshcat, *PAGE_VIEW)
    builder.Connect(estimate, ghost.GetInputPort("X_CM"))
    builder.Connect(plant.get_state_output_port(), ghost.GetInputPort("state"))


@dc.dataclass(frozen=True)
class SceneView:
    """A view V of a whole scene from the side, with the viewing pyramids of its cameras.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        eye: Where the scene is looked at from [m], in the world.
        look_at: What is in the image's middle [m], in the world.
        fov_y: Vertical field of view [rad].
    """

    width: int = 960
    height: int = 720
    eye: tuple[float, float, float] = (1.3, -2.6, 1.5)
    look_at: tuple[float, float, float] = (0.95, 0.0, 0.45)
    fov_y: float = math.radians(34.0)

    @property
    def X_WV(self) -> RigidTransform:
        """Its pose in the world: z forward, x right, y down."""
        forward = np.subtract(self.look_at, self.eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        axes = np.column_stack([right, np.cross(forward, right), forward])
        return RigidTransform(RotationMatrix(axes / np.linalg.norm(axes, axis=0)), list(self.eye))

    @property
    def intrinsics(self) -> CameraInfo:
        """Of its pinhole camera."""
        return CameraInfo(self.width, self.height, self.fov_y)

    def Render(self, query: QueryObject, world: FrameId, renderer: str) -> NDArray[np.uint8]:
        """An RGB image, shape (height, width, 3).

        Args:
            query: Of the scene.
            world: Its world frame.
            renderer: The renderer's name there.
        """
        core = RenderCameraCore(
            renderer, self.intrinsics, ClippingRange(0.05, 20.0), RigidTransform()
        )
        rendered = query.RenderColorImage(ColorRenderCamera(core, False), world, self.X_WV)
        image: NDArray[np.uint8] = rendered.data[:, :, :3].copy()
        return image

    def DrawPyramid(self, image: NDArray[np.uint8], camera: Camera, X_WK: RigidTransform) -> None:
        """Draws what a camera sees into an image of `Render`.

        Args:
            image: The image.
            camera: The camera.
            X_WK: Its pose in the world.
        """
        import cv2

        p_K = np.vstack([np.zeros(3), ViewRim(camera)])
        X_VK = self.X_WV.InvertAndCompose(X_WK)
        homogeneous = (X_VK @ p_K.T).T @ self.intrinsics.intrinsic_matrix().T
        pixels = np.rint(16.0 * homogeneous[:, :2] / homogeneous[:, 2:]).astype(np.int32)
        color = (255, 255, 160)
        cv2.polylines(image, [pixels[1:]], True, color, 2, cv2.LINE_AA, shift=4)
        for corner in pixels[1:]:
            cv2.line(image, pixels[0].tolist(), corner.tolist(), color, 2, cv2.LINE_AA, shift=4)


PAGE_VIEW = ((1.1, -1.25, 0.95), (1.1, 0.0, 0.45))
"""Where a page looks from and to [m]; it has a wide angle, and a panel on the right."""


def SaveReplay(meshcat: Meshcat, path: Path | str) -> None:
    """Writes what Meshcat recorded as one HTML file that needs nothing else.

    Args:
        meshcat: After a simulation between ``StartRecording`` and now.
        path: The file.

    Raises:
        OSError: When it cannot be written.

    Example:
        >>> import tempfile
        >>> meshcat, file = Meshcat(), Path(tempfile.mkdtemp()) / "replay.html"
        >>> meshcat.StartRecording()
        >>> meshcat.SetTransform("target", RigidTransform([0.0, 0.0, 0.8]), time_in_recording=1.0)
        >>> SaveReplay(meshcat, file)
        >>> file.exists()
        True
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

    Example:
        >>> import tempfile
        >>> from pydrake.systems.primitives import ConstantVectorSource
        >>> builder, file = DiagramBuilder(), Path(tempfile.mkdtemp()) / "diagram.svg"
        >>> _ = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
        >>> SaveDiagram(builder.Build(), file)
        >>> "source" in file.read_text()
        True
    """
    if shutil.which("dot") is None:
        raise FileNotFoundError(
            "drawing the diagram needs Graphviz; install it with: sudo apt-get install graphviz"
        )
    graphs = pydot.graph_from_dot_data(diagram.GetGraphvizString(max_depth=1))
    assert graphs is not None  # Drake writes what pydot reads.
    with WholeFile(path) as part:
        graphs[0].write(str(part), format=Path(path).suffix[1:])
