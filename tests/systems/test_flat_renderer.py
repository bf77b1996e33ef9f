"""The flat renderer draws what VTK draws, on the same pixels, and keeps nothing but its state."""

import math
import os
import subprocess
import sys
import textwrap
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import trimesh
from pydrake.geometry import (
    Box,
    Capsule,
    ClippingRange,
    ColorRenderCamera,
    Convex,
    Cylinder,
    DepthRange,
    DepthRenderCamera,
    Ellipsoid,
    GeometryId,
    GeometryInstance,
    HalfSpace,
    Mesh,
    MeshcatCone,
    PerceptionProperties,
    RenderCameraCore,
    RenderLabel,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageLabel16I, ImageRgba8U

from mffdrake.recognition import CameraRig, SolidModel
from mffdrake.systems.arms.models import ConfigureParser, FindModelsPath
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, AddCameraFrames, AddPa10
from mffdrake.systems.cameras.camera_info import MakeCameraInfo
from mffdrake.systems.cameras.stereo_camera import AddStereoCamera
from mffdrake.systems.rendering.flat_renderer import (
    AddFlatRenderer,
    FlatRenderEngine,
    MakeFlatRenderEngine,
)
from mffdrake.systems.rendering.renderers import RENDERERS, AddRenderer

RIG = CameraRig.stereo(width=320, height=240, fov_y=math.radians(45.0), baseline=0.150)
CAMERA = RIG.cameras[0]
INFO = MakeCameraInfo(CAMERA)
TARGET = str(FindModelsPath() / "target_box.obj")
GREY, EMPTY = [128, 128, 128, 255], int(RenderLabel.kEmpty)
AHEAD = RigidTransform(RollPitchYaw(0.3, 0.5, 0.7), [0.03, 0.02, 1.0])
"""Askew and whole in the image of a camera at the world's origin."""


def cameras(renderer="any", info=INFO, near=0.01, far=10.0, depths=(0.1, 5.0)):
    core = RenderCameraCore(renderer, info, ClippingRange(near, far), RigidTransform())
    return ColorRenderCamera(core, False), DepthRenderCamera(core, DepthRange(*depths))


def photograph(renderer, color_camera, depth_camera, *where):
    """All three images, by an engine or a query object."""
    size = color_camera.core().intrinsics().width(), color_camera.core().intrinsics().height()
    color, depth, label = ImageRgba8U(*size), ImageDepth32F(*size), ImageLabel16I(*size)
    if where:
        color = renderer.RenderColorImage(color_camera, *where)
        depth = renderer.RenderDepthImage(depth_camera, *where)
        label = renderer.RenderLabelImage(color_camera, *where)
    else:
        renderer.RenderColorImage(color_camera, color)
        renderer.RenderDepthImage(depth_camera, depth)
        renderer.RenderLabelImage(color_camera, label)
    return SimpleNamespace(
        color=color.data.copy(), depth=depth.data[..., 0].copy(), label=label.data[..., 0].copy()
    )


def material(color=None, label=1):
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel(label) if isinstance(label, int) else label)
    if color is not None:
        properties.AddProperty("phong", "diffuse", Rgba(*color))
    return properties


def register(engine, shape, X_WG=AHEAD, color=None, label=1):
    id = GeometryId.get_new_id()
    assert engine.RegisterVisual(id, shape, material(color, label), X_WG)
    return id


def draw(*geometries, engine=None, X_WC=None, **camera):
    """What an engine, by default a new flat one, draws of (shape, X_WG, color, label)."""
    engine = engine or MakeFlatRenderEngine()
    ids = [register(engine, *geometry) for geometry in geometries]
    engine.UpdateViewpoint(X_WC or RigidTransform())
    images = photograph(engine, *cameras(**camera))
    for id in ids:
        assert engine.RemoveGeometry(id)
    return images


@pytest.fixture(scope="module")
def vtk():
    return RENDERERS["vtk"]()


def hue_and_saturation(images):
    hsv = cv2.cvtColor(images.color[:, :, :3].astype(np.float32) / 255.0, cv2.COLOR_RGB2HSV)
    return hsv[..., 0], hsv[..., 1]


def spread(values, width=1):
    """Greatest less least value within `width` pixels."""
    values, kernel = values.astype(np.float32), np.ones((2 * width + 1,) * 2)
    return cv2.dilate(values, kernel) - cv2.erode(values, kernel)


def is_smooth(depth):
    """Where 1 / depth hardly bends: inside a face it is linear in the image."""
    inverse = np.where(depth > 0.0, 1.0 / np.maximum(depth, 1e-3), 0.0)
    bend = np.abs(cv2.filter2D(inverse, -1, np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0.0]])))
    return (bend < 2e-3 * inverse) & np.isfinite(depth)


def assert_agree(flat, vtk, width=1):
    """Equal but for `width` pixels at outlines; depths within 1 mm, and 1 % of their slope."""
    for a, b in ((flat, vtk), (vtk, flat)):
        hue, saturation = hue_and_saturation(a)
        paint = np.where(saturation > 0.5, np.rint(hue / 10.0) + 1.0, 0.0)  # 10 deg apart
        border = (spread(a.label, width) > 0) | (spread(paint, width) > 0)
        assert np.all((a.label == b.label) | border)
        other_hue, other_saturation = hue_and_saturation(b)
        error = np.abs((hue - other_hue + 180.0) % 360.0 - 180.0)
        same = np.abs(saturation - other_saturation) < 0.02
        same &= (saturation <= 0.5) | (error < 1.0)
        # The arm's parts are of different greys; slivers of them appear in blended pixels alone.
        same |= (saturation < 0.1) & (other_saturation < 0.1)
        assert np.all(same | border)
        inside = is_smooth(a.depth) & ~border
        slope = spread(np.where(np.isfinite(a.depth), a.depth, 0.0))
        error = np.abs(a.depth[inside] - b.depth[inside])
        assert np.all(error < 1e-3 + 0.01 * slope[inside])
        assert inside.sum() >= 0.5 * np.sum(np.isfinite(a.depth) & (a.depth > 0.0))


# The hand-eye scene.


class HandEye:
    """The arm with its cameras, the target before it and the ground, with both renderers."""

    def __init__(self):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        AddPa10(self.plant)
        AddCameraFrames(self.plant)
        parser = Parser(self.plant)
        ConfigureParser(parser)
        parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")
        world = self.plant.world_body()
        ground = RigidTransform([0.0, 0.0, -0.2])
        self.plant.RegisterVisualGeometry(world, ground, HalfSpace(), "ground", [0.3, 0.3, 0.3, 1])
        self.plant.Finalize()
        AddFlatRenderer(scene_graph)
        AddRenderer(scene_graph, "vtk")
        self.port = scene_graph.get_query_output_port()
        self.diagram = builder.Build()  # Ports and contexts alone do not keep it alive.
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.scene_context = scene_graph.GetMyContextFromRoot(self.context)
        self.world = scene_graph.world_frame_id()

    def place(self, positions, X_CM):
        arm = self.plant.GetModelInstanceByName("pa10")
        self.plant.SetPositions(self.plant_context, arm, positions)
        box = self.plant.GetBodyByName("target_box")
        self.plant.SetFreeBodyPose(self.plant_context, box, self.pose("camera_right") @ X_CM)

    def pose(self, frame):
        return self.plant.GetFrameByName(frame).CalcPoseInWorld(self.plant_context)

    def photograph(self, renderer, X_WC):
        query = self.port.Eval(self.scene_context)
        return photograph(query, *cameras(renderer), self.world, X_WC)


@pytest.fixture(scope="module")
def hand_eye():
    return HandEye()


@pytest.mark.parametrize("seed", range(4))
def test_the_hand_eye_scene_is_as_vtk_draws_it(hand_eye, seed):
    rng = np.random.default_rng(seed)
    turn = rng.uniform(-math.pi, math.pi, 3)
    X_CM = RigidTransform(RollPitchYaw(turn), rng.uniform([-0.1, -0.1, 0.5], [0.1, 0.1, 0.9]))
    hand_eye.place(NOMINAL_POSITIONS + rng.uniform(-0.2, 0.2, 7), X_CM)
    aside = RigidTransform(RollPitchYaw(-0.5 * math.pi - 0.2, 0.1, 0.3), [0.3, -2.2, 0.9])
    for X_WC in (hand_eye.pose("camera_right"), hand_eye.pose("camera_left"), aside):
        flat = hand_eye.photograph("flat", X_WC)
        assert len(np.unique(flat.label)) >= 3  # the target, the ground and at least the sky
        assert_agree(flat, hand_eye.photograph("vtk", X_WC))


def test_contexts_are_independent(hand_eye):
    hand_eye.place(NOMINAL_POSITIONS, RigidTransform([0.0, 0.0, 0.8]))
    X_WC = hand_eye.pose("camera_right")
    before = hand_eye.photograph("flat", X_WC)
    root = hand_eye.context.Clone()
    box = hand_eye.plant.GetBodyByName("target_box")
    hand_eye.plant.SetFreeBodyPose(hand_eye.plant.GetMyContextFromRoot(root), box, RigidTransform())
    other = SimpleNamespace(**vars(hand_eye))
    other.scene_context = hand_eye.port.get_system().GetMyContextFromRoot(root)
    assert np.any(HandEye.photograph(other, "flat", X_WC).label != before.label)
    np.testing.assert_array_equal(hand_eye.photograph("flat", X_WC).color, before.color)


def test_images_outlive_a_first_call_that_compiles(tmp_path):
    """Its leftovers, until collected, must not hold on to Drake's images (see _Pixels)."""
    code = """
        import gc
        from pydrake.geometry import (
            Box, ClippingRange, ColorRenderCamera, GeometryInstance, RenderCameraCore, SceneGraph,
        )
        from pydrake.math import RigidTransform
        from pydrake.systems.sensors import CameraInfo
        from mffdrake.systems.rendering.flat_renderer import AddFlatRenderer

        gc.disable()
        scene_graph = SceneGraph()
        box = GeometryInstance(RigidTransform([0.0, 0.0, 1.0]), Box(0.2, 0.2, 0.2), "box")
        scene_graph.RegisterAnchoredGeometry(scene_graph.RegisterSource("source"), box)
        AddFlatRenderer(scene_graph)
        query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
        info, clipping = CameraInfo(320, 240, 1.0), ClippingRange(0.1, 5.0)
        core = RenderCameraCore("flat", info, clipping, RigidTransform())
        where = scene_graph.world_frame_id(), RigidTransform()
        for _ in range(2):
            print(query.RenderColorImage(ColorRenderCamera(core, False), *where).data.shape)
    """
    finished = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},  # so that it does compile
        capture_output=True,
        text=True,
    )
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.splitlines() == 2 * ["(240, 320, 4)"]


# Each shape alone.

CURVED = [Cylinder(0.1, 0.3), Sphere(0.15), Capsule(0.08, 0.2), Ellipsoid(0.1, 0.15, 0.2)]
FLAT = [
    Box(0.2, 0.3, 0.4),
    HalfSpace(),
    Mesh(TARGET),
    Mesh(TARGET, [1.0, 2.0, -1.5]),  # inside out but for the renderer's care
    Convex(TARGET, 1.5),
]


@pytest.mark.parametrize("shape", [*FLAT, *CURVED], ids=str)
def test_each_shape_is_as_vtk_draws_it(vtk, shape):
    rng = np.random.default_rng(3)
    for turn in rng.uniform(-math.pi, math.pi, (4, 3)):
        box = (shape, RigidTransform(RollPitchYaw(turn), [0.05, -0.03, 0.9]), (0.2, 0.4, 0.9, 1.0))
        flat = draw(box)
        assert np.any(flat.label == 1)
        assert_agree(flat, draw(box, engine=vtk), width=2 if shape in CURVED else 1)


def test_shapes_hide_and_cut_each_other_as_in_vtk(vtk):
    shapes = [
        (Box(0.3, 0.3, 0.3), AHEAD, (1, 0, 0, 1), 1),
        (Box(0.2, 0.6, 0.1), AHEAD, (0, 1, 0, 1), 2),  # it pierces the first
        (Mesh(TARGET), RigidTransform(RollPitchYaw(1, 2, 3), [-0.05, 0.05, 0.6]), None, 3),
        (Cylinder(0.2, 1.0), RigidTransform(RollPitchYaw(1, 0, 0), [0, 0, 1.5]), (1, 1, 0, 1), 4),
    ]
    flat = draw(*shapes)
    assert set(np.unique(flat.label)) == {1, 2, 3, 4, EMPTY}
    assert_agree(flat, draw(*shapes, engine=vtk))
    np.testing.assert_array_equal(draw(*shapes[::-1]).label, flat.label)


@pytest.mark.parametrize(
    ("shape", "position"),
    [
        (Box(0.2, 0.3, 1.0), [0.0, 0.0, 0.45]),  # around the camera: its far side is seen
        (Box(0.2, 0.3, 1.0), [0.08, 0.12, 0.505]),  # open, where the near plane cuts it
        (Box(4.0, 4.0, 8.0), [0.0, 0.0, 9.0]),  # through the far plane
        (Sphere(0.5), [0.1, 0.0, 0.3]),
        (HalfSpace(), [0.0, 0.5, 0.0]),  # a ground up to the horizon, or tilted
        (Mesh(TARGET, 4.0), [0.2, 0.1, 0.3]),
    ],
)
@pytest.mark.parametrize("roll", [0.1, 0.5 * math.pi - 0.2])
def test_the_near_and_the_far_plane_cut_as_in_vtk(vtk, shape, position, roll):
    cut = (shape, RigidTransform(RollPitchYaw(roll, 0.2, 0.3), position), (0.9, 0.1, 0.1, 1.0))
    for camera in ({"near": 0.01}, {"near": 0.15, "depths": (0.15, 10.0)}):
        assert_agree(draw(cut, **camera), draw(cut, engine=vtk, **camera))


def test_any_intrinsics_are_as_in_vtk(vtk):
    info = CameraInfo(200, 150, 210.0, 160.0, 121.3, 66.6)
    box = (Mesh(TARGET, 2.0), AHEAD)
    X_WC = RigidTransform(RollPitchYaw(0.1, -0.1, 0.4), [0.1, 0.05, -0.2])
    flat = draw(box, info=info, X_WC=X_WC)
    assert_agree(flat, draw(box, engine=vtk, info=info, X_WC=X_WC))


def test_an_image_can_be_all_covered_or_empty():
    wall = draw((Box(9, 9, 1), RigidTransform([0, 0, 2.5]), (1, 0, 0, 1), 7))
    assert np.all(wall.color == [255, 0, 0, 255])
    np.testing.assert_allclose(wall.depth, 2.0, rtol=1e-6)
    assert np.all(wall.label == 7)
    behind, beside, far = [0, 0, -1], [3, 0, 1], [0, 0, 20]
    scenes = [[]] + [[(Box(1, 1, 1), RigidTransform(p))] for p in (behind, beside, far)]
    for scene in scenes:
        empty = draw(*scene)
        assert np.all(empty.color == GREY)
        assert np.all(empty.depth == np.inf)
        assert np.all(empty.label == EMPTY)


def test_depths_out_of_range_are_zero_or_infinite():
    boxes = [(Box(0.1, 0.1, 0.1), RigidTransform([x, 0, z])) for x, z in ((-0.1, 0.3), (0.2, 0.8))]
    boxes += [(Box(9, 9, 1), RigidTransform([0, 0, 3.5]))]
    images = draw(*boxes, depths=(0.4, 2.0))
    assert set(np.unique(images.depth)) >= {0.0, np.inf}
    within = images.depth[(images.depth > 0.0) & np.isfinite(images.depth)]
    assert within.min() == pytest.approx(0.75)
    assert within.max() <= 2.0


# Where the pixels are.


def test_silhouettes_lie_where_the_corners_project():
    """As of VTK in test_stereo_camera.py, through RgbdSensors; without blended pixels."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    AddPa10(plant)
    AddCameraFrames(plant, baseline=0.150)
    parser = Parser(plant)
    ConfigureParser(parser)
    parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")
    plant.Finalize()
    AddFlatRenderer(scene_graph)
    stereo = AddStereoCamera(
        builder, plant=plant, scene_graph=scene_graph, rig=RIG, renderer="flat"
    )
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    box = SolidModel.from_mesh_file(TARGET)
    X_WC = plant.GetFrameByName("camera_right").CalcPoseInWorld(plant_context)
    rng, errors, areas = np.random.default_rng(0), [], []
    for turn in rng.uniform(-math.pi, math.pi, (40, 3)):
        X_CM = RigidTransform(RollPitchYaw(turn), rng.uniform([-0.2, -0.1, 0.7], [0.05, 0.1, 0.9]))
        plant.SetFreeBodyPose(plant_context, plant.GetBodyByName("target_box"), X_WC @ X_CM)
        corners = RIG.project((X_CM @ box.vertices.T).T)
        for side, p in zip(("right", "left"), corners, strict=True):
            port = stereo.GetOutputPort(f"color_image_{side}")
            image = port.Eval(stereo.GetMyContextFromRoot(context)).data
            v, u = np.nonzero(image[:, :, :3].min(axis=2) == 0)
            moments = cv2.moments(cv2.convexHull(p.astype(np.float32)))
            center = [moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]]
            errors.append([u.mean() - center[0], v.mean() - center[1]])
            areas.append(len(u) / moments["m00"])
    np.testing.assert_allclose(errors, 0.0, atol=0.25)
    np.testing.assert_allclose(np.mean(errors, axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(np.mean(areas), 1.0, atol=0.003)


def write_obj(path, vertices, faces, materials="", use=""):
    """An OBJ file with normals, which VTK wants, and an MTL file beside it."""
    lines = [f"v {x} {y} {z}" for x, y, z in np.asarray(vertices)] + ["vn 0 0 -1"]
    if materials:
        path.with_suffix(".mtl").write_text(materials, encoding="utf-8")
        lines.append(f"mtllib {path.stem}.mtl")
    for face, name in zip(faces, use or [""] * len(faces), strict=True):
        lines += [f"usemtl {name}"] if name else []
        lines.append("f " + " ".join(f"{k + 1}//1" for k in face))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Mesh(str(path))


def test_neighbors_share_no_pixel_and_leave_none_out(tmp_path):
    grid = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3), [0]), axis=-1).reshape(-1, 3)
    vertices = 0.1 * grid + np.random.default_rng(1).uniform(-0.03, 0.03, (25, 3))
    cells = [(k, k + 1, k + 6, k + 5) for k in range(19) if k % 5 < 4]
    triangles = [(a, b, c) for a, b, c, _ in cells] + [(a, c, d) for a, _, c, d in cells]

    def drawn(name, faces):
        mesh = write_obj(tmp_path / f"{name}.obj", vertices, faces)
        return draw((mesh, RigidTransform([0.0, 0.0, 1.0]))).label == 1

    parts = [drawn(k, [triangle]) for k, triangle in enumerate(triangles)]
    np.testing.assert_array_equal(np.sum(parts, axis=0), drawn("all", triangles).astype(int))
    assert np.sum(parts) > 10_000


# Colors and labels.

SQUARE = 0.1 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1)])
RED, GREEN, BLUE, DEFAULT = (255, 0, 0), (0, 255, 0), (0, 0, 255), (230, 115, 26)
MATERIALS = "newmtl red\nKd 1 0 0\nnewmtl odd\nKd 0.3 0.5 0.2\nnewmtl dark\nKa 1 1 1\n"


def center(images):
    return tuple(images.color[CAMERA.height // 2, CAMERA.width // 2, :3].tolist())


@pytest.mark.parametrize(
    "color", [(0.2, 0.4, 0.1), (1, 1, 0.5), (0.1, 0.0, 0.9), (0, 0, 0), (1, 1, 1)]
)
def test_a_face_has_its_materials_diffuse_color(color):
    images = draw((Box(0.3, 0.2, 0.1), AHEAD, (*color, 1.0)))
    expected = np.floor(255.0 * np.array([*color, 1.0]) + 0.5)
    assert np.all(images.color[images.label == 1] == expected)
    assert np.all(images.color[images.label != 1] == GREY)


@pytest.mark.parametrize(
    ("materials", "use", "color", "expected"),
    [
        ("", "", None, DEFAULT),
        ("", "", (0, 1, 0, 1), GREEN),
        (MATERIALS, ["red"], None, RED),
        (MATERIALS, ["red"], (0, 1, 0, 1), RED),  # the mesh's own material comes first
        (MATERIALS, ["odd"], None, (77, 128, 51)),
        (MATERIALS, ["dark"], None, (0, 0, 0)),
        (MATERIALS, ["none_such"], (0, 1, 0, 1), GREEN),
    ],
)
def test_colors_of_meshes_come_from_where_vtk_takes_them(
    vtk, tmp_path, materials, use, color, expected
):
    mesh = write_obj(tmp_path / "square.obj", SQUARE, [(0, 3, 2, 1)], materials, use)
    square = (mesh, RigidTransform([0.0, 0.0, 1.0]), color)
    assert center(draw(square)) == expected
    lit = np.array(center(draw(square, engine=vtk)))  # as bright as its direction to the lights
    np.testing.assert_allclose(lit, np.array(expected) * lit.max() / max(*expected, 1), atol=1.5)


def test_each_face_of_a_mesh_has_its_own_material(vtk, tmp_path):
    faces, use = [(0, 3, 2, 1), (0, 1, 4), (1, 2, 4)], ["odd", "red", "odd"]
    mesh = write_obj(tmp_path / "open.obj", SQUARE, faces, MATERIALS, use)
    assert_agree(draw((mesh, AHEAD)), draw((mesh, AHEAD), engine=vtk))  # seen from its inside, too
    turned = RigidTransform(RollPitchYaw(2.8, 0.3, 0.4), [0.0, 0.0, 0.8])
    flat = draw((mesh, turned))
    assert {(77, 128, 51), (255, 0, 0)} < {tuple(c) for c in flat.color.reshape(-1, 4)[:, :3]}
    assert_agree(flat, draw((mesh, turned), engine=vtk))


def test_a_convex_shape_has_one_color_as_in_vtk(vtk):
    images = draw((Convex(TARGET), AHEAD))
    assert {tuple(c) for c in images.color[images.label == 1][:, :3].tolist()} == {DEFAULT}
    assert_agree(images, draw((Convex(TARGET), AHEAD), engine=vtk))


def test_what_is_invisible_has_a_depth_and_a_label():
    wall = (Box(2, 2, 0.1), RigidTransform([0, 0, 1.5]), (1, 0, 0, 1), 7)
    images = draw((Box(0.1, 0.1, 0.1), RigidTransform([0, 0, 1.0]), (0, 0, 1, 0.0), 1), wall)
    assert center(images) == RED
    assert images.depth[120, 160] == pytest.approx(0.95)
    assert images.label[120, 160] == 1


def test_labels_are_drakes():
    wall = (Box(2, 2, 0.1), RigidTransform([0, 0, 1.5]), (1, 0, 0, 1), 7)
    pane = (Box(0.1, 0.1, 0.1), RigidTransform([0, 0, 1.0]), (0, 0, 1, 1))
    for label, expected in ((5, 5), (RenderLabel.kDontCare, 32764), (RenderLabel.kDoNotRender, 7)):
        images = draw((*pane, label), wall)
        assert (images.label[120, 160], center(images)) == (expected, BLUE)
    engine, id = MakeFlatRenderEngine(), GeometryId.get_new_id()
    engine.RegisterVisual(id, Box(1, 1, 1), PerceptionProperties(), RigidTransform([0, 0, 1]))
    assert photograph(engine, *cameras()).label[120, 160] == int(RenderLabel.kDontCare)
    with pytest.raises(RuntimeError, match="'unspecified' or 'empty'"):
        register(MakeFlatRenderEngine(), Box(1, 1, 1), label=RenderLabel.kEmpty)


# State.


def assert_equal(a, b):
    for image in ("color", "depth", "label"):
        np.testing.assert_array_equal(getattr(a, image), getattr(b, image))


def test_equal_states_give_equal_bits():
    engine = MakeFlatRenderEngine()
    for shape in (Mesh(TARGET), Sphere(0.1), Cylinder(0.03, 0.5)):
        register(engine, shape, AHEAD)
    view = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.0, 0.2])
    engine.UpdateViewpoint(view)
    first = photograph(engine, *cameras())
    copy = engine.Clone()
    small = cameras(info=CameraInfo(50, 30, 40.0, 40.0, 25.0, 15.0))
    for X_WC in (RigidTransform([0.1, 0.0, 0.0]), RigidTransform([0.0, 0.0, 0.99])):
        engine.UpdateViewpoint(X_WC)
        photograph(engine, *small)
        photograph(engine, *cameras(far=20.0))
    engine.UpdateViewpoint(view)
    assert_equal(photograph(engine, *cameras()), first)
    assert_equal(photograph(copy, *cameras()), first)
    assert_equal(photograph(copy.Clone(), *cameras()), first)


def test_poses_are_copied():
    engine, X_WG, X_WC = MakeFlatRenderEngine(), RigidTransform(AHEAD), RigidTransform()
    register(engine, Mesh(TARGET), X_WG)
    engine.UpdateViewpoint(X_WC)
    first = photograph(engine, *cameras())
    X_WG.set_translation([0.1, 0.0, 1.0])
    X_WC.set_translation([0.0, 0.1, 0.0])
    assert_equal(photograph(engine.Clone(), *cameras()), first)
    assert_equal(photograph(engine, *cameras()), first)


def test_clones_are_independent():
    engine = MakeFlatRenderEngine()
    id = register(engine, Mesh(TARGET), AHEAD)
    first = photograph(engine, *cameras())
    clone = engine.Clone()
    assert isinstance(clone, FlatRenderEngine)
    assert clone.has_geometry(id)
    register(clone, Box(0.1, 0.1, 0.1), RigidTransform([0.2, 0.0, 0.9]))
    clone.UpdateViewpoint(RigidTransform([0.0, 0.1, 0.0]))
    assert clone.RemoveGeometry(id)
    assert not clone.RemoveGeometry(id)
    assert_equal(photograph(engine, *cameras()), first)
    other = engine.Clone()
    assert engine.RemoveGeometry(id)
    assert np.all(photograph(engine, *cameras()).label == EMPTY)
    assert_equal(photograph(other, *cameras()), first)


def test_an_image_that_is_drawn_again_is_as_if_drawn_anew():
    """Only where something was drawn before, it is cleared: equal to what a new image shows."""
    engine = MakeFlatRenderEngine()
    register(engine, Mesh(TARGET), AHEAD)
    color, _ = cameras()
    again = {kind: kind(CAMERA.width, CAMERA.height) for kind in (ImageRgba8U, ImageLabel16I)}
    places = [[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0.3], [0, 0, 0.9], [0, 0, 3], [0.2, -0.2, 0.4]]
    for k, place in enumerate(places):
        engine.UpdateViewpoint(RigidTransform(place))
        new = photograph(engine, *cameras())
        engine.RenderColorImage(color, again[ImageRgba8U])
        engine.RenderLabelImage(color, again[ImageLabel16I])
        np.testing.assert_array_equal(again[ImageRgba8U].data, new.color)
        np.testing.assert_array_equal(again[ImageLabel16I].data[..., 0], new.label)
        if k % 2:  # Someone draws on Drake's image himself.
            cv2.rectangle(again[ImageRgba8U].mutable_data, (5, 5), (90, 70), (1, 2, 3, 4))
            again[ImageLabel16I].mutable_data[40:80, 9] = 5


# Mistakes.


def scene_with(shape, properties=None):
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("test")
    instance = GeometryInstance(RigidTransform([0.0, 0.0, 1.0]), shape, "shape")
    id = scene_graph.RegisterAnchoredGeometry(source, instance)
    scene_graph.AssignRole(source, id, properties or material((1, 0, 0, 1)))
    return scene_graph


def test_a_renderer_is_added_once_to_a_name():
    scene_graph = scene_with(Box(1.0, 1.0, 1.0))
    AddFlatRenderer(scene_graph)
    assert scene_graph.GetRendererTypeName("flat")
    with pytest.raises(RuntimeError, match="flat"):
        AddFlatRenderer(scene_graph)
    AddFlatRenderer(scene_graph, "another")
    assert scene_graph.RendererCount() == 2
    query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
    images = photograph(query, *cameras("flat"), scene_graph.world_frame_id(), RigidTransform())
    assert center(images) == RED  # What is fixed to the world is drawn, too.


def test_a_shape_that_cannot_be_drawn_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"cannot draw MeshcatCone\(.*; it draws Box, .*Sphere"):
        AddFlatRenderer(scene_with(MeshcatCone(0.1, 0.2, 0.3)))
    (tmp_path / "arm.dae").write_text("", encoding="utf-8")
    with pytest.raises(ValueError, match=r"arm\.dae: meshes are \.obj, .* files; convert"):
        AddFlatRenderer(scene_with(Mesh(str(tmp_path / "arm.dae"))))
    with pytest.raises(ValueError, match=r"no mesh file .*none\.obj"):
        AddFlatRenderer(scene_with(Mesh(str(tmp_path / "none.obj"))))
    for content, message in (
        ("v 0 0 0\nf 1 2 9\n", "no OBJ file that"),
        ("nonsense\n", "no triangles"),
    ):
        (tmp_path / "bad.obj").write_text(content, encoding="utf-8")
        with pytest.raises(ValueError, match=rf"bad\.obj: .*{message}"):
            AddFlatRenderer(scene_with(Mesh(str(tmp_path / "bad.obj"))))


@pytest.mark.parametrize("suffix", ["ply", "glb", "stl"])
def test_other_meshes_are_drawn_as_the_same_obj(tmp_path, suffix):
    triangles = [(0, 3, 2), (0, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    pose = RigidTransform(RollPitchYaw(2.8, 0.3, 0.4), [0.0, 0.0, 0.8])
    colors = [RED, RED, GREEN, BLUE, GREEN, BLUE] if suffix != "stl" else 6 * [GREEN]
    file = trimesh.Trimesh(SQUARE, triangles, process=False)
    if suffix == "glb":  # where y is upward
        file.vertices = SQUARE[:, [0, 2, 1]] * [1, 1, -1]
        file.unmerge_vertices()
        file.visual.vertex_colors = np.repeat(colors, 3, axis=0)
    elif suffix == "ply":
        file.visual.face_colors = colors
    file.export(tmp_path / f"pyramid.{suffix}")
    names = {RED: "red", GREEN: "green", BLUE: "blue"}
    paint = "newmtl red\nKd 1 0 0\nnewmtl green\nKd 0 1 0\nnewmtl blue\nKd 0 0 1\n"
    same = write_obj(tmp_path / "same.obj", SQUARE, triangles, paint, [names[c] for c in colors])
    wanted = draw((same, pose))
    images = draw((Mesh(str(tmp_path / f"pyramid.{suffix}")), pose, (0, 1, 0, 1)))
    np.testing.assert_array_equal(images.color, wanted.color)
    np.testing.assert_allclose(images.depth, wanted.depth, rtol=1e-6)


def test_a_meshs_texture_gives_each_triangle_its_mean_color(tmp_path):
    stripes = np.zeros((2, 4, 3), dtype=np.uint8)
    stripes[:, :2], stripes[:, 2:] = RED[::-1], BLUE[::-1]  # OpenCV: blue, green, red
    cv2.imwrite(str(tmp_path / "stripes.png"), stripes)
    (tmp_path / "two.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd stripes.png\n")
    lines = ["mtllib two.mtl", *("v {} {} {}".format(*p) for p in SQUARE), "vn 0 0 -1"]
    lines += ["vt .1 .5", "vt .2 .5", "vt .2 .6", "vt .8 .5", "vt .9 .5", "vt .9 .6", "usemtl m"]
    lines += ["f 1/1/1 4/2/1 3/3/1", "f 1/4/1 3/5/1 2/6/1"]
    (tmp_path / "two.obj").write_text("\n".join(lines) + "\n")
    images = draw((Mesh(str(tmp_path / "two.obj")), RigidTransform([0.0, 0.0, 1.0])))
    colors = {tuple(c) for c in images.color[images.label == 1][:, :3].tolist()}
    assert colors == {RED, BLUE}


def test_other_textures_are_an_error(tmp_path):
    cv2.imwrite(str(tmp_path / "wood.png"), np.zeros((2, 2, 3), dtype=np.uint8))
    textured = material((1, 0, 0, 1))
    textured.AddProperty("phong", "diffuse_map", str(tmp_path / "wood.png"))
    with pytest.raises(ValueError, match=r"Box\(.* has the texture .*wood\.png"):
        AddFlatRenderer(scene_with(Box(1.0, 1.0, 1.0), textured))
    plain = write_obj(tmp_path / "wood.obj", SQUARE, [(0, 3, 2, 1)])
    with pytest.raises(ValueError, match=r"the mesh .*wood\.obj has the texture .*wood\.png"):
        AddFlatRenderer(scene_with(plain, material()))
    AddFlatRenderer(scene_with(plain))
