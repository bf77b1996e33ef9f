"""What VTK draws lies where `StereoCamera` projects it, to a few hundredths of a pixel."""

import math

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.framework import DiagramBuilder

from mffdrake.recognition import SolidModel, StereoCamera
from mffdrake.systems.models import ConfigureParser, FindModelsPath
from mffdrake.systems.renderers import AddRenderer
from mffdrake.systems.stereo_camera import AddStereoCamera, MakeCameraInfo

CAMERA = StereoCamera.from_fov(width=640, height=480, fov_y=math.radians(45.0))
BOX = SolidModel.from_mesh_file(FindModelsPath() / "target_box.obj")
GREY = 128
X_WC = RigidTransform(RollPitchYaw(-0.5 * math.pi, 0.3, -0.4), [0.3, -0.2, 0.7])
"""A camera that stands askew, so that no axis of the world is one of the images."""


class Scene:
    """A stereo pair fixed in the world, and the target box before it."""

    def __init__(self, camera=CAMERA, p_CL=None, R_CL=None, renderer="vtk", left="camera_left"):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        parser = Parser(self.plant)
        ConfigureParser(parser)
        parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")
        frame_C = self.plant.AddFrame(
            FixedOffsetFrame("camera_right", self.plant.world_frame(), X_WC)
        )
        p_CL = camera.p_CL if p_CL is None else p_CL
        X_CL = RigidTransform(RollPitchYaw(R_CL or [0, 0, 0]), p_CL)
        self.plant.AddFrame(FixedOffsetFrame("camera_left", frame_C, X_CL))
        self.plant.Finalize()
        AddRenderer(scene_graph, "vtk")
        self.stereo = AddStereoCamera(
            builder,
            plant=self.plant,
            scene_graph=scene_graph,
            camera=camera,
            renderer=renderer,
            left_frame=left,
        )
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def place(self, X_CM):
        """Puts the box where the right camera sees it at X_CM."""
        plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        box = self.plant.GetBodyByName("target_box")
        self.plant.SetFreeBodyPose(plant_context, box, X_WC @ X_CM)

    def image(self, side):
        """The image of the right or left camera: a copy, shape (height, width, 4)."""
        stereo_context = self.stereo.GetMyContextFromRoot(self.context)
        port = self.stereo.GetOutputPort(f"color_image_{side}")
        return port.Eval(stereo_context).data.copy()


@pytest.fixture(scope="module")
def scene():
    return Scene()


def corners(X_CM):
    """Projections of the box's corners: right and left, each (8, 2)."""
    return CAMERA.project((X_CM @ BOX.vertices.T).T)


def silhouette(image):
    """Area and centroid (u, v) of the box in an image [px], by the coverage of its pixels.

    A pure red, green or blue face has two channels at zero, the background has all at grey. So a
    blended pixel's least channel tells how much of it is background.
    """
    coverage = 1.0 - image[:, :, :3].min(axis=2) / GREY
    area = coverage.sum()
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    return area, np.array([(coverage * u).sum(), (coverage * v).sum()]) / area


def polygon(points):
    """Area and centroid of the convex hull of some points: the box's silhouette."""
    p = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    q = np.roll(p, -1, axis=0)
    parts = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    area = 0.5 * parts.sum()
    return abs(area), ((p + q) * parts[:, None]).sum(axis=0) / (6.0 * area)


def in_view(points):
    return np.all(points > 10) and np.all(points < [CAMERA.width - 10, CAMERA.height - 10])


def random_poses(count):
    """X_CM at which both cameras see the whole box, in all parts of the images."""
    rng = np.random.default_rng(0)
    poses = []
    while len(poses) < count:
        p_CM = rng.uniform([-0.25, -0.25, 0.6], [0.2, 0.25, 1.0])
        X_CM = RigidTransform(RollPitchYaw(rng.uniform(-math.pi, math.pi, 3)), p_CM)
        if all(in_view(points) for points in corners(X_CM)):
            poses.append(X_CM)
    return poses


# Where things are in the images.


def test_silhouettes_lie_where_the_corners_project(scene):
    errors, areas = [], []
    for X_CM in random_poses(12):
        scene.place(X_CM)
        for side, points in zip(("right", "left"), corners(X_CM), strict=True):
            area, centroid = silhouette(scene.image(side))
            expected_area, expected = polygon(points)
            errors.append(centroid - expected)
            areas.append(area / expected_area)
    # Read with the principal point of CameraInfo, (W/2, H/2), all would be off by half a pixel.
    np.testing.assert_allclose(errors, 0.0, atol=0.1)  # an edge along the pixels costs the most
    np.testing.assert_allclose(np.mean(errors, axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(areas, 1.0, atol=0.005)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_face_seen_straight_on_lies_where_its_center_projects(scene, side):
    """One blue face, parallel to the image; turned, so that its edges cross the pixels askew."""
    p_CO = {"right": np.zeros(3), "left": CAMERA.p_CL}[side]
    for yaw, offset in ((0.3, [0.004, -0.003, 0.9]), (-0.5, [0.011, 0.007, 0.75])):
        X_CM = RigidTransform(RollPitchYaw(0.0, 0.0, yaw), p_CO + offset)
        scene.place(X_CM)
        image = scene.image(side)
        red, green, blue = (int((image[:, :, k] > 2 * GREY - 60).sum()) for k in range(3))
        assert (red, green) == (0, 0)
        _, centroid = silhouette(image)
        face_center = X_CM @ [0.0, 0.0, -0.1]
        expected = CAMERA.project(face_center)[["right", "left"].index(side)]
        np.testing.assert_allclose(centroid, expected, atol=0.05)
        depth = face_center[2]
        assert blue == pytest.approx(0.1 * 0.15 * (CAMERA.focal_length / depth) ** 2, rel=0.05)


def test_both_cameras_see_what_their_names_say(scene):
    X_CM = RigidTransform(RollPitchYaw(0.2, 0.3, 0.1), [0.0, 0.0, 0.8])
    scene.place(X_CM)
    (_, right), (_, left) = (silhouette(scene.image(side)) for side in ("right", "left"))
    # Seen from the left, things lie further to the right, by f b / z.
    disparity = CAMERA.focal_length * CAMERA.baseline / 0.8
    assert left[0] - right[0] == pytest.approx(disparity, rel=0.05)
    assert left[1] - right[1] == pytest.approx(0.0, abs=2.0)
    # x is to the right and y down in the image.
    scene.place(RigidTransform([0.1, 0.0, 0.0]) @ X_CM)
    assert silhouette(scene.image("right"))[1][0] > right[0] + 50
    scene.place(RigidTransform([0.0, 0.1, 0.0]) @ X_CM)
    assert silhouette(scene.image("right"))[1][1] > right[1] + 50


def test_images_have_the_cameras_size_and_their_own_camera_info():
    camera = StereoCamera(width=96, height=54, focal_length=60.0, baseline=0.2)
    scene = Scene(camera)
    scene.place(RigidTransform([0.0, 0.0, 0.8]))
    for side in ("right", "left"):
        assert scene.image(side).shape == (54, 96, 4)
        sensor = scene.stereo.GetSubsystemByName(f"camera_{side}")
        info = sensor.default_color_render_camera().core().intrinsics()
        assert (info.width(), info.height()) == (96, 54)
        assert (info.focal_x(), info.focal_y()) == (60.0, 60.0)
    info = MakeCameraInfo(CAMERA)
    assert info.fov_y() == pytest.approx(math.radians(45.0))


# When they are drawn.


def test_images_are_drawn_only_when_they_are_read_and_then_once(scene):
    rendered = {}
    stereo_context = scene.stereo.GetMyContextFromRoot(scene.context)
    for side in ("right", "left"):
        sensor = scene.stereo.GetSubsystemByName(f"camera_{side}")
        sensor_context = sensor.GetMyContextFromRoot(scene.context)
        entry = sensor.color_image_output_port().cache_entry()
        rendered[side] = lambda e=entry, c=sensor_context: not e.is_out_of_date(c)
        depth = sensor.depth_image_32F_output_port().cache_entry()
        rendered[f"{side} depth"] = lambda e=depth, c=sensor_context: not e.is_out_of_date(c)

    def drawn():
        return {name for name, is_rendered in rendered.items() if is_rendered()}

    scene.place(RigidTransform([0.0, 0.0, 0.7]))  # All images are of another time now.
    assert drawn() == set()
    scene.stereo.GetOutputPort("color_image_right").Eval(stereo_context)
    assert drawn() == {"right"}
    scene.stereo.GetOutputPort("color_image_left").Eval(stereo_context)
    assert drawn() == {"right", "left"}
    scene.place(RigidTransform([0.0, 0.0, 0.8]))
    assert drawn() == set()


# Mistakes.


@pytest.mark.parametrize(
    ("p_CL", "R_CL"),
    [
        ([-0.151, 0.0, 0.0], None),
        ([0.150, 0.0, 0.0], None),  # the left camera on the right
        ([-0.150, 0.001, 0.0], None),
        ([-0.150, 0.0, 0.0], [0.0, 0.001, 0.0]),
    ],
)
def test_frames_that_contradict_the_baseline_are_an_error(p_CL, R_CL):
    with pytest.raises(ValueError, match=r"frame 'camera_left' lies at .* baseline of 0.15 m"):
        Scene(p_CL=p_CL, R_CL=R_CL)


def test_the_same_frame_for_both_cameras_is_an_error():
    with pytest.raises(ValueError, match="baseline of 0.15 m"):
        Scene(left="camera_right")


def test_an_unknown_frame_is_named():
    with pytest.raises(RuntimeError, match="no_such_frame"):
        Scene(left="no_such_frame")


def test_an_unknown_renderer_is_named():
    with pytest.raises(ValueError, match="no renderer 'crayon'.*AddRenderer"):
        Scene(renderer="crayon")
