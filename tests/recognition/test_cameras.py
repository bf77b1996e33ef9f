"""Equations (13)-(18): projections into the images of cameras with lenses and places of their own.

The stereo pair has closed forms; lenses are compared with OpenCV's.
"""

import dataclasses
import math

import cv2
import numpy as np
import pytest
from synthetic import LENSES, intrinsics, odd_camera, paper_box, pose, render, rotation

from mffdrake.recognition import Camera, CameraRig, Distortion
from mffdrake.recognition.poses.pose import transform_from_pose

RIG = CameraRig.stereo(width=640, height=480, focal_length=580.0, baseline=0.150)
PRINCIPAL_POINT = (319.5, 239.5)
POINTS = np.random.default_rng(0).uniform([-0.3, -0.2, 0.5], [0.3, 0.2, 1.5], size=(40, 3))
CAMERAS = {name: odd_camera(name) for name in LENSES}

cameras = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)


def camera(**numbers):
    """A camera of few numbers."""
    return Camera(**{"width": 64, "height": 48, "fx": 50, "fy": 50, "cx": 31, "cy": 23} | numbers)


# The parallel pair


def test_projection_is_the_pinhole_s_closed_form():
    right, left = RIG.project(POINTS)
    x, y, z = POINTS.T
    np.testing.assert_allclose(right[:, 0], 580.0 * x / z + 319.5)
    np.testing.assert_allclose(right[:, 1], 580.0 * y / z + 239.5)
    np.testing.assert_allclose(left[:, 0], 580.0 * (x + 0.150) / z + 319.5)
    np.testing.assert_allclose(left[:, 1], right[:, 1])


def test_a_point_that_is_too_far_aside_for_numbers_is_not_seen():
    camera = Camera(width=640, height=480, fx=10.0, fy=10.0, cx=0.0, cy=0.0)
    pixels, jacobians = camera.project_with_jacobian([[1.0, 1e308, 1.0], [1.0, 1e300, 1.0]])
    assert np.isnan(pixels[0]).all() and np.isnan(jacobians[0]).all()
    np.testing.assert_allclose(pixels[1], [10.0, 1e301])


def test_disparity_is_focal_length_times_baseline_over_depth():
    right, left = RIG.project(POINTS)
    disparity = np.column_stack([580.0 * 0.150 / POINTS[:, 2], np.zeros(len(POINTS))])
    np.testing.assert_allclose(left - right, disparity, atol=1e-12)


def test_both_images_and_the_focal_length_give_the_point_back():
    right, left = RIG.project(POINTS)
    z = 580.0 * 0.150 / (left - right)[:, 0]
    xy = (right - PRINCIPAL_POINT) * z[:, None] / 580.0
    np.testing.assert_allclose(np.column_stack([xy, z]), POINTS, atol=1e-12)


def test_left_camera_stands_to_the_left():
    assert RIG.names == ("right", "left")
    np.testing.assert_array_equal(RIG.cameras[0].p_CK, [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(RIG.cameras[1].p_CK, [-0.150, 0.0, 0.0])
    np.testing.assert_array_equal(RIG.middle, [-0.075, 0.0, 0.0])
    _, left = RIG.project([-0.150, 0.0, 0.7])
    np.testing.assert_allclose(left, PRINCIPAL_POINT)


def test_a_pose_and_a_point_give_both_pixels_as_in_equation_18():
    psi = pose((0.03, 0.12, 0.85), (0.2, -0.3, 0.1))
    p_M = np.random.default_rng(1).uniform(-0.1, 0.1, size=(20, 3))
    R_CM, p_CM = transform_from_pose(psi)
    pixels = RIG.project(p_M @ R_CM.T + p_CM)
    # The same as a chain of matrices on homogeneous coordinates: (13), (16), then (15) or (17).
    X_CM, X_LC = np.eye(4), np.eye(4)
    X_CM[:3, :3], X_CM[:3, 3] = rotation(psi[3:]), psi[:3]
    X_LC[0, 3] = 0.150
    P = np.array([[580.0, 0.0, 319.5, 0.0], [0.0, 580.0, 239.5, 0.0], [0.0, 0.0, 1.0, 0.0]])
    for uv, X in zip(pixels, (X_CM, X_LC @ X_CM), strict=True):
        scaled = P @ X @ np.column_stack([p_M, np.ones(20)]).T
        np.testing.assert_allclose(uv.T, scaled[:2] / scaled[2])


def test_right_means_greater_u_and_down_means_greater_v():
    center, to_the_right, below = RIG.project([[0, 0, 1], [0.1, 0, 1], [0, 0.1, 1]])[0]
    assert to_the_right[0] > center[0] and to_the_right[1] == center[1]
    assert below[1] > center[1] and below[0] == center[0]


@pytest.mark.parametrize("shape", [(3,), (1, 3), (5, 3), (2, 4, 3), (0, 3)])
def test_projection_keeps_the_leading_shape(shape):
    rig = CameraRig([odd_camera(lens, name=lens) for lens in LENSES])
    points = np.full(shape, 0.5)
    for pixels in rig.project(points):
        assert pixels.shape == (*shape[:-1], 2)
    for seen in rig.cameras:
        pixels, J = seen.project_with_jacobian(points)
        assert pixels.shape == (*shape[:-1], 2) and J.shape == (*shape[:-1], 2, 3)


@pytest.mark.parametrize(("width", "height"), [(640, 480), (5, 3)])
def test_pixel_centers_are_whole_numbers_so_the_image_ends_half_a_pixel_outside(width, height):
    rig = CameraRig.stereo(width=width, height=height, fov_y=math.radians(45))
    # Rays on the border of the field of view.
    top = math.tan(math.radians(22.5))
    side = top * width / height
    corners, _ = rig.project([[-side, -top, 1.0], [side, top, 1.0]])
    np.testing.assert_allclose(corners, [[-0.5, -0.5], [width - 0.5, height - 0.5]])
    right = rig.cameras[0]
    assert (right.cx, right.cy) == ((width - 1) / 2, (height - 1) / 2)


def test_odd_images_have_a_pixel_on_the_optical_axis():
    rig = CameraRig.stereo(width=5, height=3, fov_y=1.0)
    np.testing.assert_array_equal(rig.project([0.0, 0.0, 2.0])[0], [2.0, 1.0])


def test_a_camera_sees_what_it_projects_into_its_image():
    camera = Camera(width=64, height=48, fx=60, fy=60, cx=31.5, cy=23.5)
    edge = 32.0 / 60.0  # of half the image's width, at 1 m
    points = [[0, 0, 1], [edge - 1e-6, 0, 1], [edge + 1e-6, 0, 1], [0, 0.39, 1], [0, 0.41, 1]]
    assert camera.sees(points).tolist() == [True, True, False, True, False]
    assert not camera.sees([0.0, 0.0, -1.0])


def test_a_solid_covers_the_pixels_between_its_projected_edges():
    psi = pose((0.02, -0.03, 0.8))
    images = render(paper_box(), psi, RIG)
    front = psi[:3] + np.array([[-0.05, -0.075, -0.1], [0.05, 0.075, -0.1]])
    for image, ((u0, v0), (u1, v1)) in zip(images, RIG.project(front), strict=True):
        rows, columns = np.nonzero((image == (0, 0, 255)).all(axis=-1))
        assert (columns.min(), columns.max()) == (math.ceil(u0), math.floor(u1))
        assert (rows.min(), rows.max()) == (math.ceil(v0), math.floor(v1))


@pytest.mark.parametrize("fov_deg", [20.0, 45.0, 90.0, 120.0])
def test_focal_length_from_the_vertical_field_of_view(fov_deg):
    rig = CameraRig.stereo(width=100, height=200, fov_y=math.radians(fov_deg), baseline=0.06)
    for each in rig.cameras:
        assert 2 * math.degrees(math.atan(100 / each.fy)) == pytest.approx(fov_deg)
        assert each.fx == each.fy
        assert (each.width, each.height) == (100, 200)
    assert np.linalg.norm(rig.cameras[1].p_CK - rig.cameras[0].p_CK) == 0.06


def test_defaults_are_the_project_s_camera():
    given = CameraRig.stereo(width=640, height=480, fov_y=math.radians(45), baseline=0.150)
    for a, b in zip(CameraRig.stereo().cameras, given.cameras, strict=True):
        for field in dataclasses.fields(Camera):
            np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


@pytest.mark.parametrize("name", ["width", "height", "focal_length", "baseline"])
@pytest.mark.parametrize("value", [0, -1, math.nan, math.inf])
def test_quantities_of_a_pair_must_be_positive(name, value):
    with pytest.raises(ValueError, match=name):
        CameraRig.stereo(**{name: value})


@pytest.mark.parametrize("fov_y", [0.0, -1.0, math.pi, 45.0, math.nan])
def test_field_of_view_must_be_an_angle_below_half_a_turn(fov_y):
    with pytest.raises(ValueError, match="fov_y"):
        CameraRig.stereo(width=640, height=480, fov_y=fov_y)


# Lenses and places, against OpenCV


@cameras
def test_projection_is_opencv_s(camera):
    # OpenCV takes the rig's pose in the camera's frame.
    rvec, tvec = cv2.Rodrigues(camera.R_CK.T)[0], -camera.R_CK.T @ camera.p_CK
    K, k = intrinsics(camera), np.array(camera.distortion.coefficients)
    # Up to 50 deg off the axis, far beyond the image
    p_K = np.random.default_rng(2).uniform([-1.2, -1.2, 1.0], [1.2, 1.2, 1.0], size=(200, 3))
    p_K *= np.random.default_rng(3).uniform(0.2, 2.0, size=(200, 1))
    points = p_K @ camera.R_CK.T + camera.p_CK
    if camera.distortion.model == "equidistant":
        expected, _ = cv2.fisheye.projectPoints(points[:, None], rvec, tvec, K, k)
    else:
        expected, _ = cv2.projectPoints(points, rvec, tvec, K, k if len(k) else None)
    np.testing.assert_allclose(camera.project(points), expected[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(camera.project_with_jacobian(points)[0], camera.project(points))


def test_a_lens_without_distortion_is_a_pinhole_whatever_its_model():
    plain = odd_camera("none").project(POINTS)
    for count in (4, 5, 8):
        zero = Distortion("plumb_bob", (0.0,) * count)
        bent = odd_camera("none", distortion=zero).project(POINTS)
        np.testing.assert_allclose(bent, plain, rtol=0, atol=1e-10)


def test_an_ideal_fisheye_s_radius_is_the_angle_off_its_axis():
    fisheye = camera(distortion=Distortion("equidistant", (0.0, 0.0, 0.0, 0.0)))
    angles = np.radians([0.0, 1e-7, 10.0, 45.0, 80.0])
    uv = fisheye.project(np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)]))
    np.testing.assert_allclose(uv, np.column_stack([50 * angles + 31, 0 * angles + 23]))


def numerical_jacobian(camera, p_C, h=1e-6):
    """Derivatives of the pixels by the point, shape (n, 2, 3)."""
    steps = h * np.eye(3)
    return np.stack(
        [(camera.project(p_C + step) - camera.project(p_C - step)) / (2 * h) for step in steps],
        axis=-1,
    )


@cameras
def test_the_jacobian_is_the_numerical_derivative(camera):
    points = POINTS @ camera.R_CK.T + camera.p_CK
    J = camera.project_with_jacobian(points)[1]
    np.testing.assert_allclose(J, numerical_jacobian(camera, points), rtol=1e-6, atol=1e-4)


@cameras
def test_the_jacobian_on_the_axis_is_the_pinhole_s(camera):
    # There every lens is a pinhole; a fisheye's formula divides by the radius.
    on_axis = camera.R_CK @ [0.0, 0.0, 0.8] + camera.p_CK
    pixel, J = camera.project_with_jacobian(on_axis)
    np.testing.assert_allclose(pixel, [camera.cx, camera.cy], atol=1e-9)
    pinhole = np.array([[camera.fx / 0.8, 0.0, 0.0], [0.0, camera.fy / 0.8, 0.0]])
    np.testing.assert_allclose(J, pinhole @ camera.R_CK.T, atol=1e-6)


@cameras
def test_points_behind_the_camera_are_not_seen(camera):
    p_K = np.array([[0.1, 0.1, -0.5], [0.0, 0.0, -1.0], [0.1, 0.1, 0.0], [0.0, 0.0, 0.0]])
    points = np.vstack([p_K, [0.1, 0.1, 0.5]]) @ camera.R_CK.T + camera.p_CK
    # A plane's points are there only to within rounding.
    pixels, J = camera.project_with_jacobian(points[[0, 1, 4]])
    np.testing.assert_array_equal(np.isnan(pixels).all(axis=1), [True, True, False])
    np.testing.assert_array_equal(np.isnan(J).all(axis=(1, 2)), [True, True, False])
    at_origin = dataclasses.replace(camera, R_CK=np.eye(3), p_CK=np.zeros(3))
    assert np.isnan(at_origin.project(p_K)).all()


FOLDING = {
    "barrel": Distortion("plumb_bob", (-0.35, 0.02, 0.0, 0.0)),
    "sixth power": Distortion("plumb_bob", (0.1, 0.1, 0.0, 0.0, -0.1)),
    "rational": Distortion("plumb_bob", (0.1, -0.05, 0.0, 0.0, 0.0, 0.2, 0.05, 0.02)),
    "pole": Distortion("plumb_bob", (0.3, 0.1, 0.0, 0.0, 0.0, 0.2, -0.5, 0.0)),
    "equidistant": Distortion("equidistant", (-0.1, -0.05, 0.0, 0.0)),
}


@pytest.mark.parametrize("distortion", FOLDING.values(), ids=FOLDING)
def test_what_a_lens_would_fold_back_into_the_image_is_not_seen(distortion):
    # By trying: OpenCV's radius of points ever farther off the axis, until it falls.
    radii = np.linspace(0.0, 6.0, 60_001)
    points = np.column_stack([radii, 0 * radii, 0 * radii + 1])
    K, k, still = np.eye(3), np.array(distortion.coefficients), np.zeros(3)
    if distortion.model == "equidistant":
        image, _ = cv2.fisheye.projectPoints(points[:, None], still, still, K, k)
    else:
        image, _ = cv2.projectPoints(points, still, still, K, k)
    falls = np.flatnonzero(np.diff(image[:, 0, 0]) < 0.0)
    fold = radii[falls[0]]
    assert distortion.max_radius == pytest.approx(fold, abs=2e-4)
    turned = odd_camera("none", distortion=distortion)
    for turn in np.linspace(0.0, 6.0, 7):
        ray = np.array([math.cos(turn), math.sin(turn), 0.0])
        near, far = (
            turned.R_CK @ (r * ray + [0.0, 0.0, 1.0]) + turned.p_CK
            for r in (0.998 * fold, 1.001 * fold)
        )
        assert np.isfinite(turned.project(near)).all()
        assert np.isnan(turned.project(far)).all()
        assert np.isfinite(turned.project_with_jacobian(near)[1]).all()
        assert np.isnan(turned.project_with_jacobian(far)[1]).all()


@pytest.mark.parametrize("name", LENSES)
def test_usual_lenses_show_all_of_their_image(name):
    # A fisheye shows what is up to 89 deg off its axis.
    widest = math.tan(math.radians(89)) if name == "equidistant" else math.inf
    assert LENSES[name].max_radius == pytest.approx(widest)


@pytest.mark.parametrize("tiny", [5e-324, -1e-310, 1e-300])
@pytest.mark.parametrize(
    ("model", "count"), [("plumb_bob", 5), ("plumb_bob", 8), ("equidistant", 4)]
)
def test_a_coefficient_next_to_nothing_is_none(model, count, tiny):
    """Nothing is divided by it."""
    assert (
        Distortion(model, (tiny,) * count).max_radius
        == Distortion(model, (0.0,) * count).max_radius
    )


# Images


def images_of(rig):
    return [np.zeros((each.height, each.width, 3), dtype=np.uint8) for each in rig.cameras]


TWO_SIZES = CameraRig((camera(name="near"), camera(name="far", width=32, height=20)))


def test_images_are_given_in_the_cameras_order_or_by_name():
    near, far = images_of(TWO_SIZES)
    for given in ([near, far], (near, far), {"near": near, "far": far}, {"far": far, "near": near}):
        checked = TWO_SIZES.check_images(given)
        assert checked[0] is near and checked[1] is far
    with_alpha = [np.dstack([image, image[..., 0]]) for image in (near, far)]
    assert len(TWO_SIZES.check_images(with_alpha)) == 2


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda near, far: [near], "each camera, near, far, not 1 images"),
        (lambda near, far: [], "each camera, near, far, not 0 images"),
        (lambda near, far: [near, far, far], "each camera, near, far, not 3 images"),
        (lambda near, far: {"near": near}, "each camera, near, far, not of near"),
        (lambda near, far: {}, "each camera, near, far, not of none"),
        (lambda near, far: {"near": near, "fat": far}, "not of near, fat"),
        (lambda near, far: [far, near], "'near'.*48, 64, 3 or 4.*20, 32, 3"),
        (lambda near, far: {"near": near, "far": near}, "'far'.*20, 32, 3 or 4.*48, 64, 3"),
        (lambda near, far: [near, far[..., 0]], r"'far'.*\(20, 32\)"),
        (lambda near, far: [near, far[..., :2]], r"'far'.*\(20, 32, 2\)"),
        (lambda near, far: [near[:0], far], r"'near'.*\(0, 64, 3\)"),
        (lambda near, far: [near.astype(float), far], "'near'.*float64"),
    ],
)  # fmt: skip
def test_wrong_images_are_told_by_their_camera_s_name(given, message):
    with pytest.raises(ValueError, match=message):
        TWO_SIZES.check_images(given(*images_of(TWO_SIZES)))
    with pytest.raises(ValueError, match=message):
        TWO_SIZES.views(given(*images_of(TWO_SIZES)))


# What does not make sense


@pytest.mark.parametrize(
    ("model", "count", "wanted"),
    [
        ("none", 1, "none has 0 coefficients, not 1"),
        ("plumb_bob", 0, "4 or 5 or 8 coefficients, not 0"),
        ("plumb_bob", 3, "not 3"), ("plumb_bob", 6, "not 6"), ("plumb_bob", 14, "not 14"),
        ("equidistant", 0, "equidistant has 4 coefficients, not 0"),
        ("equidistant", 5, "4 coefficients, not 5"),
    ],
)  # fmt: skip
def test_every_lens_has_its_number_of_coefficients(model, count, wanted):
    with pytest.raises(ValueError, match=wanted):
        Distortion(model, (0.01,) * count)


def test_other_lenses_are_named():
    with pytest.raises(ValueError, match="one of none, plumb_bob, equidistant, not 'fisheye'"):
        Distortion("fisheye", (0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="finite"):
        Distortion("plumb_bob", (0.0, 0.0, math.nan, 0.0))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"width": 0}, "width must be at least 1"), ({"height": -1}, "height must be at least 1"),
        ({"width": 64.5}, "width must be a whole number"), ({"fx": 0.0}, "fx must be positive"),
        ({"fy": math.inf}, "fy must be finite"), ({"cx": math.nan}, "cx must be finite"),
        ({"cy": math.inf}, "cy must be finite"),
        ({"calibration_error": -0.1}, "calibration_error must be at least 0"),
        ({"calibration_error": math.nan}, "calibration_error must be finite"),
        ({"p_CK": (0.0, 0.0)}, "p_CK must be"), ({"p_CK": (0.0, 0.0, math.nan)}, "p_CK must be"),
        ({"R_CK": np.eye(2)}, "R_CK must be"), ({"R_CK": 1.1 * np.eye(3)}, "must be a rotation"),
        ({"R_CK": np.diag([1.0, 1.0, -1.0])}, "must be a rotation"),
        ({"R_CK": np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])}, "a rotation"),
    ],
)  # fmt: skip
def test_numbers_of_a_camera_out_of_range_are_named(wrong, message):
    with pytest.raises(ValueError, match=f"camera 'wrist'.*{message}"):
        camera(name="wrist", **wrong)


def test_cameras_of_a_rig_are_told_apart():
    with pytest.raises(ValueError, match="different names, not.*'wrist', 'wrist'"):
        CameraRig((camera(name="wrist"), camera(name="wrist", p_CK=(0.1, 0.0, 0.0))))
    with pytest.raises(ValueError, match="at least one camera"):
        CameraRig(())


def test_a_camera_s_place_cannot_be_changed_from_outside():
    R, p = np.eye(3), np.zeros(3)
    placed = camera(R_CK=R, p_CK=p)
    before = placed.project([0.1, 0.1, 1.0])
    R[:], p[:] = np.diag([1.0, -1.0, -1.0]), 5.0
    np.testing.assert_array_equal(placed.project([0.1, 0.1, 1.0]), before)
    with pytest.raises(ValueError, match="read-only"):
        placed.p_CK[0] = 1.0
