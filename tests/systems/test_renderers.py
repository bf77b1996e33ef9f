"""Every face keeps its hue in any light direction and at any pose; nothing grey gains one."""

import math

import cv2
import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.framework import DiagramBuilder

from mffdrake.recognition import CameraRig, SolidModel
from mffdrake.systems.arms.models import ConfigureParser, FindModelsPath
from mffdrake.systems.arms.pa10 import AddPa10
from mffdrake.systems.cameras.stereo_camera import AddStereoCamera
from mffdrake.systems.rendering.renderers import RENDERERS, AddRenderer

RIG = CameraRig.stereo(width=320, height=240, fov_y=math.radians(45.0))
CAMERA, LEFT = RIG.cameras
BOX = SolidModel.from_mesh_file(FindModelsPath() / "target_box.obj")


class Scene:
    """What stands in a plant, seen by a camera that is fixed in the world at X_WC."""

    def __init__(self, add_models, renderer, X_WC):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        add_models(self.plant)
        world = self.plant.world_frame()
        frame_C = self.plant.AddFrame(FixedOffsetFrame("camera_right", world, X_WC))
        self.plant.AddFrame(FixedOffsetFrame("camera_left", frame_C, RigidTransform(LEFT.p_CK)))
        self.plant.Finalize()
        stereo = AddStereoCamera(
            builder,
            plant=self.plant,
            scene_graph=scene_graph,
            rig=RIG,
            renderer=AddRenderer(scene_graph, renderer),
        )
        self._port = stereo.GetOutputPort("color_image_right")
        self._diagram = builder.Build()  # Ports and contexts alone do not keep it alive.
        context = self._diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(context)
        self._stereo_context = stereo.GetMyContextFromRoot(context)

    def hsv(self):
        """Hue [deg], saturation and value (0 to 1) of the right image, (height, width, 3)."""
        image = self._port.Eval(self._stereo_context).data[:, :, :3]
        return cv2.cvtColor(image.astype(np.float32) / 255.0, cv2.COLOR_RGB2HSV)


def add_target(plant):
    parser = Parser(plant)
    ConfigureParser(parser)
    parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")


def inside(face, X_CM):
    """The pixels inside a face, at least 2 px from its sides: none where it faces away."""
    center, normal = X_CM @ BOX.centers[face], X_CM.rotation() @ BOX.normals[face]
    if normal @ center >= 0.0:
        return np.zeros((CAMERA.height, CAMERA.width), dtype=bool)
    p = CAMERA.project((X_CM @ BOX.vertices[list(BOX.faces[face])].T).T)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    side = np.roll(p, -1, axis=0) - p
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    distance = side[:, 0] * (v[..., None] - p[:, 1]) - side[:, 1] * (u[..., None] - p[:, 0])
    return np.all(distance > 2.0, axis=-1) | np.all(distance < -2.0, axis=-1)


def outside(X_CM):
    """The pixels at least 2 px off the box's silhouette."""
    p = CAMERA.project((X_CM @ BOX.vertices.T).T)
    mask = np.zeros((CAMERA.height, CAMERA.width), dtype=np.uint8)
    hull = cv2.convexHull(np.rint(p).astype(np.int32))
    cv2.fillConvexPoly(mask, hull, 1)
    cv2.polylines(mask, [hull], isClosed=True, color=1, thickness=5)
    return mask == 0


def box_poses():
    """Along each axis, and turned at random: all faces are seen, towards all sides of the world."""
    rng = np.random.default_rng(0)
    right_angles = [(roll, pitch, 0.0) for roll in range(4) for pitch in range(4)]
    turns = [0.5 * math.pi * np.array(k) + [0.25, 0.3, 0.2] for k in right_angles]
    turns += list(rng.uniform(-math.pi, math.pi, (16, 3)))
    return [
        RigidTransform(RollPitchYaw(turn), rng.uniform([-0.1, -0.1, 0.6], [0.1, 0.1, 0.9]))
        for turn in turns
    ]


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("heading", [0.0, 1.2], ids=["ahead", "aside"])
def test_every_face_keeps_its_hue(renderer, heading):
    X_WC = RigidTransform(
        RollPitchYaw(-0.5 * math.pi, 0.0, -0.5 * math.pi + heading), [0.9, 0, 0.5]
    )
    scene = Scene(add_target, renderer, X_WC)
    seen = np.zeros(len(BOX.faces), dtype=int)
    for X_CM in box_poses():
        box = scene.plant.GetBodyByName("target_box")
        scene.plant.SetFreeBodyPose(scene.plant_context, box, X_WC @ X_CM)
        hsv = scene.hsv()
        for face, hue in enumerate(np.degrees(BOX.hues)):
            h, s, v = hsv[inside(face, X_CM)].T
            seen[face] += h.size > 50
            error = (h - hue + 180.0) % 360.0 - 180.0
            assert np.all(np.abs(error) < 1.0)
            assert np.all(s > 0.95)
            assert np.all(v > 0.5)
        _, s, v = hsv[outside(X_CM)].T
        assert np.all(s == 0.0)
        assert np.all(v > 0.0)
    assert np.all(seen >= 5)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_arm_and_the_background_have_no_hue(renderer):
    X_WC = RigidTransform(RollPitchYaw(-0.5 * math.pi, 0.0, 0.0), [0.0, -2.0, 0.6])
    scene = Scene(AddPa10, renderer, X_WC)
    background = scene.hsv()[0, 0]
    rng = np.random.default_rng(1)
    for _ in range(6):
        scene.plant.SetPositions(scene.plant_context, rng.uniform(-1.5, 1.5, 7))
        hsv = scene.hsv()
        drawn = np.any(np.abs(hsv - background) > 0.02, axis=-1)
        assert drawn.sum() > 1000  # The arm is in the image.
        assert hsv[:, :, 1].max() < 0.1  # A pixel with a hue has a saturation above 0.5.


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_renderer_is_added_under_its_own_name_and_once(renderer):
    scene_graph = SceneGraph()
    assert not scene_graph.HasRenderer(renderer)
    for _ in range(2):
        assert AddRenderer(scene_graph, renderer) == renderer
        assert scene_graph.HasRenderer(renderer)
        assert scene_graph.RendererCount() == 1


def test_vtk_is_the_default():
    scene_graph = SceneGraph()
    assert AddRenderer(scene_graph) == "vtk"
    assert scene_graph.GetRendererTypeName("vtk").endswith("RenderEngineVtk")


def test_an_unknown_renderer_is_named_with_the_known_ones():
    scene_graph = SceneGraph()
    with pytest.raises(ValueError, match="unknown renderer 'crayon'; known renderers: .*vtk"):
        AddRenderer(scene_graph, "crayon")
    assert scene_graph.RendererCount() == 0
