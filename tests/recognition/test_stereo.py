"""Equations (13)-(18): the two cameras' projections."""

import math

import numpy as np
import pytest
from synthetic import paper_box, pose, render, rotation

from mffdrake.recognition import StereoCamera
from mffdrake.recognition.pose import transform_from_pose

CAMERA = StereoCamera(width=640, height=480, focal_length=580.0, baseline=0.150)
POINTS = np.random.default_rng(0).uniform([-0.3, -0.2, 0.5], [0.3, 0.2, 1.5], size=(40, 3))


def test_projection_is_the_pinhole_s_closed_form():
    right, left = CAMERA.project(POINTS)
    x, y, z = POINTS.T
    np.testing.assert_allclose(right[:, 0], 580.0 * x / z + 319.5)
    np.testing.assert_allclose(right[:, 1], 580.0 * y / z + 239.5)
    np.testing.assert_allclose(left[:, 0], 580.0 * (x + 0.150) / z + 319.5)
    np.testing.assert_allclose(left[:, 1], right[:, 1])


def test_disparity_is_focal_length_times_baseline_over_depth():
    right, left = CAMERA.project(POINTS)
    np.testing.assert_allclose(left - right, [[580.0 * 0.150 / z, 0.0] for z in POINTS[:, 2]])


def test_both_images_and_the_focal_length_give_the_point_back():
    right, left = CAMERA.project(POINTS)
    z = 580.0 * 0.150 / (left - right)[:, 0]
    xy = (right - CAMERA.principal_point) * z[:, None] / 580.0
    np.testing.assert_allclose(np.column_stack([xy, z]), POINTS, atol=1e-12)


def test_left_camera_stands_to_the_left():
    np.testing.assert_array_equal(CAMERA.p_CL, [-0.150, 0.0, 0.0])
    _, left = CAMERA.project([-0.150, 0.0, 0.7])
    np.testing.assert_allclose(left, CAMERA.principal_point)


def test_a_pose_and_a_point_give_both_pixels_as_in_equation_18():
    psi = pose((0.03, 0.12, 0.85), (0.2, -0.3, 0.1))
    p_M = np.random.default_rng(1).uniform(-0.1, 0.1, size=(20, 3))
    R_CM, p_CM = transform_from_pose(psi)
    pixels = CAMERA.project(p_M @ R_CM.T + p_CM)
    # The same as a chain of matrices on homogeneous coordinates: (13), (16), then (15) or (17).
    X_CM, X_LC = np.eye(4), np.eye(4)
    X_CM[:3, :3], X_CM[:3, 3] = rotation(psi[3:]), psi[:3]
    X_LC[0, 3] = 0.150
    P = np.array([[580.0, 0.0, 319.5, 0.0], [0.0, 580.0, 239.5, 0.0], [0.0, 0.0, 1.0, 0.0]])
    for uv, X in zip(pixels, (X_CM, X_LC @ X_CM), strict=True):
        scaled = P @ X @ np.column_stack([p_M, np.ones(20)]).T
        np.testing.assert_allclose(uv.T, scaled[:2] / scaled[2])


def test_right_means_greater_u_and_down_means_greater_v():
    center, to_the_right, below = CAMERA.project([[0, 0, 1], [0.1, 0, 1], [0, 0.1, 1]])[0]
    assert to_the_right[0] > center[0] and to_the_right[1] == center[1]
    assert below[1] > center[1] and below[0] == center[0]


@pytest.mark.parametrize("shape", [(3,), (1, 3), (5, 3), (2, 4, 3)])
def test_projection_keeps_the_leading_shape(shape):
    right, left = CAMERA.project(np.full(shape, 0.5))
    assert right.shape == left.shape == (*shape[:-1], 2)


@pytest.mark.parametrize(("width", "height"), [(640, 480), (5, 3)])
def test_pixel_centers_are_whole_numbers_so_the_image_ends_half_a_pixel_outside(width, height):
    camera = StereoCamera.from_fov(width=width, height=height, fov_y=math.radians(45))
    # Rays on the border of the field of view.
    top = math.tan(math.radians(22.5))
    side = top * width / height
    corners, _ = camera.project([[-side, -top, 1.0], [side, top, 1.0]])
    np.testing.assert_allclose(corners, [[-0.5, -0.5], [width - 0.5, height - 0.5]])
    assert camera.principal_point == ((width - 1) / 2, (height - 1) / 2)


def test_odd_images_have_a_pixel_on_the_optical_axis():
    camera = StereoCamera.from_fov(width=5, height=3, fov_y=1.0)
    np.testing.assert_array_equal(camera.project([0.0, 0.0, 2.0])[0], [2.0, 1.0])


def test_a_solid_covers_the_pixels_between_its_projected_edges():
    psi = pose((0.02, -0.03, 0.8))
    images = render(paper_box(), psi, CAMERA)
    front = psi[:3] + np.array([[-0.05, -0.075, -0.1], [0.05, 0.075, -0.1]])
    for image, ((u0, v0), (u1, v1)) in zip(images, CAMERA.project(front), strict=True):
        rows, columns = np.nonzero((image == (0, 0, 255)).all(axis=-1))
        assert (columns.min(), columns.max()) == (math.ceil(u0), math.floor(u1))
        assert (rows.min(), rows.max()) == (math.ceil(v0), math.floor(v1))


@pytest.mark.parametrize("fov_deg", [20.0, 45.0, 90.0, 120.0])
def test_focal_length_from_the_vertical_field_of_view(fov_deg):
    camera = StereoCamera.from_fov(
        width=100, height=200, fov_y=math.radians(fov_deg), baseline=0.06
    )
    assert 2 * math.degrees(math.atan(100 / camera.focal_length)) == pytest.approx(fov_deg)
    assert (camera.width, camera.height, camera.baseline) == (100, 200, 0.06)


def test_defaults_are_the_project_s_camera():
    assert StereoCamera() == StereoCamera.from_fov(width=640, height=480, fov_y=math.radians(45))


@pytest.mark.parametrize("name", ["width", "height", "focal_length", "baseline"])
@pytest.mark.parametrize("value", [0, -1, math.nan, math.inf])
def test_quantities_must_be_positive(name, value):
    with pytest.raises(ValueError, match=name):
        StereoCamera(**{name: value})


@pytest.mark.parametrize("fov_y", [0.0, -1.0, math.pi, 45.0, math.nan])
def test_field_of_view_must_be_an_angle_below_half_a_turn(fov_y):
    with pytest.raises(ValueError, match="fov_y"):
        StereoCamera.from_fov(width=640, height=480, fov_y=fov_y)
