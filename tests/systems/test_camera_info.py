"""Cameras from Drake's CameraInfo and back: half a pixel apart, and what is drawn agrees."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    GeometryInstance,
    PerceptionProperties,
    RenderCameraCore,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from mffdrake.recognition import Camera, Distortion
from mffdrake.systems.cameras.camera_info import CameraFromInfo, MakeCameraInfo
from mffdrake.systems.rendering.flat_renderer import AddFlatRenderer

CAMERA = Camera(name="own", width=320, height=200, fx=290.0, fy=310.0, cx=150.25, cy=110.5)
X_CK = RigidTransform(RollPitchYaw(0.1, -0.2, 0.3), [0.1, 0.2, -0.3])


def numbers(info):
    return (
        info.width(), info.height(),
        info.focal_x(), info.focal_y(), info.center_x(), info.center_y(),
    )  # fmt: skip


def test_the_image_center_is_the_image_center():
    info = CameraInfo(640, 480, 580.0, 570.0, 320.0, 240.0)
    camera = CameraFromInfo(info)
    assert (camera.cx, camera.cy) == (319.5, 239.5)  # between the four pixels in the middle
    assert (camera.width, camera.height, camera.fx, camera.fy) == (640, 480, 580.0, 570.0)
    assert (camera.name, camera.distortion) == ("camera", Distortion())
    np.testing.assert_array_equal(camera.R_CK, np.eye(3))
    np.testing.assert_array_equal(camera.p_CK, np.zeros(3))


def test_what_is_made_of_a_camera_makes_it_again():
    info = MakeCameraInfo(CAMERA)
    assert numbers(info) == (320, 200, 290.0, 310.0, 150.75, 111.0)
    again = CameraFromInfo(info, name="own", X_CK=X_CK)
    assert numbers(MakeCameraInfo(again)) == numbers(info)
    assert (again.name, again.cx, again.cy) == ("own", CAMERA.cx, CAMERA.cy)
    np.testing.assert_array_equal(again.R_CK, X_CK.rotation().matrix())
    np.testing.assert_array_equal(again.p_CK, X_CK.translation())


def test_points_project_as_by_drakes_intrinsics_but_for_the_half_pixel():
    info = MakeCameraInfo(CAMERA)
    p_K = np.array([0.1, -0.05, 0.8])
    u, v, w = info.intrinsic_matrix() @ p_K
    camera = CameraFromInfo(info, X_CK=X_CK)
    np.testing.assert_allclose(camera.project(X_CK @ p_K), [u / w - 0.5, v / w - 0.5], atol=1e-9)


def test_what_is_drawn_lies_where_the_camera_projects_it():
    """A small plate parallel to the image: the center of its pixels, off the image's center."""
    p_K = np.array([0.11, -0.09, 0.7])
    builder = DiagramBuilder()
    scene_graph = builder.AddSystem(SceneGraph())
    source = scene_graph.RegisterSource("plate")
    turned = RigidTransform(RollPitchYaw(0.0, 0.0, 0.3), p_K)  # its edges cross the pixels askew
    plate = GeometryInstance(turned, Box(0.12, 0.1, 1e-6), "plate")
    properties = PerceptionProperties()
    properties.AddProperty("phong", "diffuse", Rgba(1.0, 0.0, 0.0))
    plate.set_perception_properties(properties)
    scene_graph.RegisterAnchoredGeometry(source, plate)
    AddFlatRenderer(scene_graph, "flat")
    clipping = ClippingRange(0.01, 10.0)
    core = RenderCameraCore("flat", MakeCameraInfo(CAMERA), clipping, RigidTransform())
    sensor = builder.AddSystem(
        RgbdSensor(
            parent_id=scene_graph.world_frame_id(),
            X_PB=RigidTransform(),
            color_camera=ColorRenderCamera(core, False),
            depth_camera=DepthRenderCamera(core, DepthRange(0.1, 5.0)),
        )
    )
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    diagram = builder.Build()
    context = sensor.GetMyContextFromRoot(diagram.CreateDefaultContext())
    image = sensor.color_image_output_port().Eval(context).data
    v, u = np.nonzero(image[:, :, 0] > 200)
    assert len(u) == pytest.approx(0.12 * 0.1 * CAMERA.fx * CAMERA.fy / 0.7**2, rel=0.02)
    np.testing.assert_allclose([u.mean(), v.mean()], CAMERA.project(p_K), atol=0.05)


def test_a_distortion_is_refused_unless_it_is_ignored():
    bent = dc.replace(CAMERA, distortion=Distortion("plumb_bob", (-0.2, 0.1, 0.0, 0.0)))
    message = (
        "camera 'own': Drake's renderers draw no distortion, and it has the plumb_bob coefficients "
        "[-0.2, 0.1, 0.0, 0.0]; give a camera without distortion, or ignore_distortion=True"
    )
    with pytest.raises(ValueError) as caught:
        MakeCameraInfo(bent)
    assert str(caught.value) == message
    assert numbers(MakeCameraInfo(bent, ignore_distortion=True)) == numbers(MakeCameraInfo(CAMERA))


def test_zero_coefficients_bend_nothing_but_in_a_fisheye():
    flat = dc.replace(CAMERA, distortion=Distortion("plumb_bob", (0.0,) * 5))
    assert numbers(MakeCameraInfo(flat)) == numbers(MakeCameraInfo(CAMERA))
    with pytest.raises(ValueError, match="equidistant"):
        MakeCameraInfo(dc.replace(CAMERA, distortion=Distortion("equidistant", (0.0,) * 4)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cx": -0.5}, "cx must be between -0.5 and 319.5, inside the image, for Drake, not -0.5"),
        ({"cy": 250.0}, "cy must be between -0.5 and 199.5, inside the image, for Drake, not 250"),
    ],
)
def test_a_principal_point_outside_the_image_is_refused(changes, message):
    with pytest.raises(ValueError) as caught:
        MakeCameraInfo(dc.replace(CAMERA, **changes))
    assert message in str(caught.value)
