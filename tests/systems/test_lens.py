"""What a camera with a distortion draws lies where it projects it, in all parts of its image."""

import dataclasses as dc
import math

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ImageRgba8U

from mffdrake.recognition import (
    BorderRefiner,
    Camera,
    CameraRig,
    Distortion,
    Matcher,
    SearchModel,
    SolidModel,
)
from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.systems.arms.models import ConfigureParser, FindModelsPath
from mffdrake.systems.cameras.lens import LensDistortion, MakeCoveringPinhole, NeedsLens
from mffdrake.systems.cameras.stereo_camera import AddStereoCamera
from mffdrake.systems.rendering.renderers import AddRenderer

BARREL = Distortion("plumb_bob", (-0.25, 0.08, 0.001, -0.0005))
PINCUSHION = Distortion("plumb_bob", (0.15, 0.05, -0.001, 0.001, 0.01))
FISHEYE = Distortion("equidistant", (0.02, -0.01, 0.0, 0.0))
LENSES = {"barrel": BARREL, "pincushion": PINCUSHION, "fisheye": FISHEYE}
STEREO = CameraRig.stereo(width=640, height=480, fov_y=math.radians(45.0), baseline=0.150)
BOX = SolidModel.from_mesh_file(FindModelsPath() / "target_box.obj")
GREY = 128


def bent(distortion, rig=STEREO):
    return CameraRig(tuple(dc.replace(camera, distortion=distortion) for camera in rig.cameras))


class Scene:
    """A rig at the world's origin, and the target box before it."""

    def __init__(self, rig, renderer="flat"):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        parser = Parser(self.plant)
        ConfigureParser(parser)
        parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")
        for camera in rig.cameras:
            X_CK = RigidTransform(RotationMatrix(camera.R_CK), camera.p_CK)
            frame = FixedOffsetFrame(f"camera_{camera.name}", self.plant.world_frame(), X_CK)
            self.plant.AddFrame(frame)
        self.plant.Finalize()
        AddRenderer(scene_graph, renderer)
        self.stereo = AddStereoCamera(
            builder, plant=self.plant, scene_graph=scene_graph, rig=rig, renderer=renderer
        )
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def image(self, name, X_CM):
        plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.plant.SetFreeBodyPose(plant_context, self.plant.GetBodyByName("target_box"), X_CM)
        stereo_context = self.stereo.GetMyContextFromRoot(self.context)
        port = self.stereo.GetOutputPort(f"color_image_{name}")
        return port.Eval(stereo_context).data.copy()


def outline(camera, X_CM):
    """The sides of the box's silhouette as curves in the image: corner to corner, (100, 2) each.

    The silhouette's corners are the convex hull of the vertices as a pinhole sees them.
    """
    p_K = ((X_CM @ BOX.vertices.T).T - camera.p_CK) @ camera.R_CK
    hull = cv2.convexHull((p_K[:, :2] / p_K[:, 2:]).astype(np.float32), returnPoints=False)[:, 0]
    corners = p_K[hull]
    share = np.linspace(0.0, 1.0, 100)[:, None]
    return [
        camera.project((a + share * (b - a)) @ camera.R_CK.T + camera.p_CK)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]


def random_poses(count, rig):
    """X_CM at which all cameras see the whole box, in all parts of the images."""
    rng = np.random.default_rng(0)
    poses = []
    while len(poses) < count:
        p_CM = rng.uniform([-0.3, -0.25, 0.6], [0.2, 0.25, 1.0])
        X_CM = RigidTransform(RollPitchYaw(rng.uniform(-math.pi, math.pi, 3)), p_CM)
        points = [np.concatenate(outline(camera, X_CM)) for camera in rig.cameras]
        if all(np.all((p > 8) & (p < [631, 471])) for p in points):
            poses.append(X_CM)
    return poses


def coverage(image):
    """How much of each pixel is box: faces have a channel at zero, the background none."""
    return 1.0 - image[:, :, :3].min(axis=2) / GREY


def edge_errors(image, sides):
    """How far outside of its place the border is [px], at places along the silhouette's sides.

    The coverage along the normal, from a reach inside to a reach outside, adds up to the reach.
    """
    reach, errors, covered = 4.0, [], coverage(image).astype(np.float32)
    steps = np.linspace(-reach, reach, 81)
    center = np.mean(np.concatenate(sides), axis=0)
    for side in sides:
        tangents = np.gradient(side, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        for point, (tu, tv) in zip(side, tangents, strict=True):
            ends = np.linalg.norm(point - side[[0, -1]], axis=1)
            if ends.min() < 10.0:
                continue  # A corner is near.
            normal = np.array([tv, -tu])
            normal *= np.sign(normal @ (point - center))
            u, v = (point + steps[:, None] * normal).T.astype(np.float32)
            profile = cv2.remap(covered, u, v, cv2.INTER_LINEAR)
            errors.append(np.trapezoid(profile.ravel(), steps) - reach)
    return np.array(errors)


@pytest.mark.parametrize("renderer", ["flat", "vtk"])
@pytest.mark.parametrize("lens", LENSES)
def test_edges_lie_where_the_camera_projects_them(lens, renderer):
    camera = bent(LENSES[lens]).cameras[1]
    rig = CameraRig((camera,))
    scene = Scene(rig, renderer)
    all_errors = []
    for X_CM in random_poses(6, rig):
        errors = edge_errors(scene.image(camera.name, X_CM), outline(camera, X_CM))
        assert len(errors) > 100
        all_errors.append(errors)
    errors = np.concatenate(all_errors)
    assert np.abs(errors).max() < 0.5
    assert abs(errors.mean()) < 0.02
    assert errors.std() < 0.12


@pytest.mark.parametrize("lens", LENSES)
def test_a_straight_edge_is_bent_by_pixels(lens):
    """What the test above rests on: a pinhole's image would not pass it."""
    rig, plain = bent(LENSES[lens]), Scene(STEREO)
    (X_CM,) = random_poses(1, rig)
    camera = rig.cameras[0]
    errors = edge_errors(plain.image(camera.name, X_CM), outline(camera, X_CM))
    assert np.abs(errors).max() > 1.0


@pytest.mark.parametrize("lens", ["barrel", "fisheye"])
def test_poses_are_refined_to_tenths_of_a_millimeter(lens):
    rig = bent(LENSES[lens])
    scene = Scene(rig)
    refiner = BorderRefiner(Matcher(SearchModel(BOX), rig))
    errors = []
    for X_CM in random_poses(6, rig):
        true = pose_from_transform(X_CM.rotation().matrix(), X_CM.translation())
        images = [scene.image(name, X_CM) for name in rig.names]
        start = true + [0.001, -0.001, 0.001, 0.002, -0.002, 0.001]
        refined = refiner.refine(start, images)
        assert refined.converged, refined.reason
        errors.append(1000.0 * np.linalg.norm(refined.pose[:3] - true[:3]))
    assert np.median(errors) < 0.15
    assert max(errors) < 0.5


def test_a_camera_without_distortion_has_no_lens_and_the_same_bits():
    flat = bent(Distortion("plumb_bob", (0.0,) * 5))
    assert not NeedsLens(flat.cameras[0])
    assert NeedsLens(
        dc.replace(STEREO.cameras[0], distortion=Distortion("equidistant", (0.0,) * 4))
    )
    scene, plain = Scene(flat), Scene(STEREO)
    X_CM = RigidTransform(RollPitchYaw(0.2, 0.3, 0.1), [0.0, 0.0, 0.8])
    np.testing.assert_array_equal(scene.image("right", X_CM), plain.image("right", X_CM))
    assert not scene.stereo.HasSubsystemNamed("lens_right")
    mixed = Scene(CameraRig((STEREO.cameras[0], bent(BARREL).cameras[1])))
    assert not mixed.stereo.HasSubsystemNamed("lens_right")
    assert mixed.stereo.HasSubsystemNamed("lens_left")
    np.testing.assert_array_equal(mixed.image("right", X_CM), plain.image("right", X_CM))


# Without a renderer.


CAMERA = Camera(
    name="own", width=80, height=60, fx=70.0, fy=75.0, cx=37.25, cy=31.5, distortion=BARREL
)


def draw(camera, pinhole, pixels):
    system = LensDistortion(camera, pinhole)
    context = system.CreateDefaultContext()
    image = ImageRgba8U(pixels.shape[1], pixels.shape[0])
    image.mutable_data[:] = pixels
    system.get_input_port().FixValue(context, image)
    return system.get_output_port().Eval(context).data.copy()


def test_a_lens_that_bends_nothing_cuts_the_image_out():
    camera = dc.replace(CAMERA, distortion=Distortion())
    pinhole = MakeCoveringPinhole(camera, sharpness=1.0)
    shape = (pinhole.height, pinhole.width, 4)
    pixels = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    left, top = pinhole.cx - camera.cx, pinhole.cy - camera.cy
    assert left == round(left) and top == round(top)
    expected = pixels[round(top) :, round(left) :][:60, :80]
    np.testing.assert_array_equal(draw(camera, pinhole, pixels), expected)


@pytest.mark.parametrize("sharpness", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("lens", LENSES)
def test_the_pinhole_covers_the_image_and_keeps_its_resolution(lens, sharpness):
    camera = dc.replace(CAMERA, distortion=LENSES[lens])
    pinhole = MakeCoveringPinhole(camera, sharpness=sharpness)
    assert (pinhole.fx, pinhole.fy) == (sharpness * camera.fx, sharpness * camera.fy)
    assert (pinhole.name, pinhole.distortion) == ("own", Distortion())
    white = np.full((pinhole.height, pinhole.width, 4), 255, dtype=np.uint8)
    assert (draw(camera, pinhole, white) == 255).all()
    white[2:-2, 2:-2] = 0  # No more than it takes: the outer pixels are hardly seen.
    seen = draw(camera, pinhole, white)
    assert not seen[5:-5, 5:-5].any()


def test_each_pixel_sees_what_projects_onto_it():
    """Single white blocks in the pinhole's image, at places all over the camera's."""
    pinhole = MakeCoveringPinhole(CAMERA, sharpness=4.0)
    rng = np.random.default_rng(2)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    for _ in range(20):
        place = np.array([rng.integers(80, 260), rng.integers(80, 190)])
        pixels = np.zeros((pinhole.height, pinhole.width, 4), dtype=np.uint8)
        pixels[place[1] - 8 : place[1] + 9, place[0] - 8 : place[0] + 9] = 255
        seen = draw(CAMERA, pinhole, pixels)[..., 0].astype(float)
        found = np.array([(seen * u).sum(), (seen * v).sum()]) / seen.sum()
        x, y = (place - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy]
        np.testing.assert_allclose(found, CAMERA.project([x, y, 1.0]), atol=0.08)


def test_what_the_lens_cannot_show_is_black():
    """Beyond the greatest radius the polynomial would fold back."""
    folding = Distortion("plumb_bob", (-0.35, 0.15, 0.0, 0.0, -0.03))
    camera = dc.replace(CAMERA, fx=31.0, fy=31.0, cx=39.5, cy=29.5, distortion=folding)
    pinhole = MakeCoveringPinhole(camera)
    white = np.full((pinhole.height, pinhole.width, 4), 255, dtype=np.uint8)
    seen = draw(camera, pinhole, white)[..., 0] == 255
    edge = camera.project([0.998 * folding.max_radius, 0.0, 1.0])[0] - camera.cx  # its radius
    v, u = np.mgrid[:60, :80]
    radius = np.hypot(u - camera.cx, v - camera.cy)
    assert seen[radius < edge - 1.0].all()
    assert not seen[radius > edge + 1.0].any()
    assert 0.2 < seen.mean() < 0.8


# Mistakes.


@pytest.mark.parametrize(
    ("focal_length", "angle"), [(285.0, r"80\.\d"), (250.0, "89 deg or more|9\\d")]
)
def test_a_field_of_view_that_no_pinhole_draws_is_refused(focal_length, angle):
    wide = Camera(
        name="wide", width=640, height=480, fx=focal_length, fy=focal_length, cx=319.5, cy=239.5,
        distortion=Distortion("equidistant", (0.0, 0.0, 0.0, 0.0)),
    )  # fmt: skip
    message = (
        "camera 'wide': its image must reach no farther than 80 deg from its axis for a pinhole to "
        rf"draw it, not ({angle}).*; give a greater focal length or a smaller image"
    )
    with pytest.raises(ValueError, match=message):
        Scene(CameraRig((wide,)))


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="camera 'own': sharpness must be positive, not 0"):
        MakeCoveringPinhole(CAMERA, sharpness=0.0)
    pinhole = MakeCoveringPinhole(CAMERA)
    with pytest.raises(ValueError, match="camera 'own': an image must be of type uint8 and shape"):
        draw(CAMERA, pinhole, np.zeros((60, 80, 4), dtype=np.uint8))
