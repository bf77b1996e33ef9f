"""Files of cameras, rigs, poses and colors, of any text: taken whole, or one line tells; and lenses
of any numbers: pixels are finite or NaN, and move as their derivatives say."""

import json
import math

import cv2
import numpy as np
import yaml
from hypothesis import example
from hypothesis import strategies as st
from judging import NUMBERS, mutated, outcome, prop

import mffdrake as mff
from mffdrake.recognition.parameters import InputError

ROS = """image_width: 640
image_height: 480
camera_name: left
camera_matrix:
  rows: 3
  cols: 3
  data: [580, 0, 320, 0, 580, 240, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.2, 0.1, 0, 0, 0]
roi: {x_offset: 0, y_offset: 0, width: 0, height: 0}
binning_x: 0
"""
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 580., 0., 3.2e+02, 0., 580., 240., 0., 0., 1. ]
dist_coeffs: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 0.1, 0., 0., 0. ]
fisheye_model: 1
tf_world_to_camera: [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""
XML = """<?xml version="1.0"?>
<opencv_storage>
<image_size>640 480</image_size>
<M1 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>580. 0. 320. 0. 580. 240. 0. 0. 1.</data></M1>
<D1 type_id="opencv-matrix"><rows>1</rows><cols>5</cols><dt>d</dt><data>0. 0. 0. 0. 0.</data></D1>
</opencv_storage>
"""
JSON = json.dumps(yaml.safe_load(ROS))
CAMERAS = [ROS, OPENCV, XML, JSON, "cam0:\n" + "\n".join("  " + line for line in ROS.splitlines())]
RIGS = [
    mff.DumpRig(mff.CameraRig.stereo()),
    "cameras:\n  right: {calibration: right.yaml}\n  left:\n    calibration: left.yaml\n"
    "    X_CK: {translation: [-0.15, 0, 0], rotation: !Rpy {deg: [0, 10, 0]}}\n"
    "    calibration_error: 0.3\n",
    "cameras: {a: {width: 64, height: 48, fx: 60, fy: 60, cx: 31, cy: 23, distortion: {model: "
    "equidistant, coefficients: [0.1, 0, 0, 0]}}, b: {calibration: right.yaml, X_CK: {rotation: "
    "!Matrix {rows: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}}}",
    "cameras: {a: {calibration: right.yaml, X_CK: {rotation: !AngleAxis {angle_deg: 10, axis: "
    "[0, 0, 1]}}}}",
]
TUM = (
    "# time x y z\n0.0 0 0 0.8 0 0 0 1\n0.1,0.02,0,0.8,0.6,0,0,0.8\n\n0.2 0 0 1e-3 0 -0.6 0 -0.8\n"
)
COLORS = (
    "colors:\n  red: {hue_deg: 3.0, tolerance_deg: 15.0}\n  green: {hue_deg: 120, tolerance_deg: 20"
    "}\nmin_saturation: 0.28\nmin_value: 0.15\nmin_chroma: 0.09\n"
)


def written(tmp_path_factory, name, text):
    """A file with a text, or with bytes."""
    file = tmp_path_factory.getbasetemp() / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode(errors="surrogatepass"))
    return file


def any_of(texts):
    """Damaged texts, some as bytes that are no text, and texts of anything."""
    raw = [text.encode() for text in texts]
    return st.one_of(mutated(texts), mutated(texts), mutated(raw), st.text(max_size=30))


def check_camera(camera):
    """A camera that was read projects a point to finite pixels, or to none."""
    ahead = np.array([0.01, 0.02, 1.0]) @ camera.R_CK.T + camera.p_CK
    pixels = camera.project(ahead)
    assert np.isfinite(pixels).all() or np.isnan(pixels).all()


@prop(any_of(CAMERAS))
def test_any_damaged_calibration_is_taken_or_told(tmp_path_factory, text):
    file = written(tmp_path_factory, "camera.yaml", text)
    camera = outcome(mff.read_camera, file, error=mff.CalibrationError)
    if camera is not None:
        check_camera(camera)
        rig = mff.CameraRig((camera,))
        again = mff.LoadRig(written(tmp_path_factory, "again.yaml", mff.DumpRig(rig)))
        assert again.cameras[0].distortion == camera.distortion
        assert again.cameras[0].fx == camera.fx


VALUES = st.one_of(
    NUMBERS, st.integers(), st.none(), st.booleans(), st.text(max_size=4), st.just(10**400),
    st.lists(NUMBERS, max_size=16), st.lists(st.lists(NUMBERS, max_size=4), max_size=4),
    st.fixed_dictionaries(
        {"rows": st.one_of(st.integers(-1, 5), NUMBERS), "cols": st.integers(-1, 5)},
        optional={"data": st.lists(NUMBERS, max_size=9)},
    ),
    st.dictionaries(st.text(max_size=3), NUMBERS, max_size=2),
)  # fmt: skip


@example({"distortion_coefficients": [0.0, 0.0, 0.0, 1e18]})
@prop(st.dictionaries(st.sampled_from(sorted(yaml.safe_load(ROS))), VALUES, max_size=3))
def test_any_values_of_a_calibration_are_taken_or_told(tmp_path_factory, values):
    text = json.dumps(yaml.safe_load(ROS) | values)
    file = written(tmp_path_factory, "camera.json", text)
    camera = outcome(mff.read_camera, file, error=mff.CalibrationError)
    if camera is not None:
        check_camera(camera)


@prop(any_of(RIGS))
def test_any_damaged_rig_is_taken_or_told(tmp_path_factory, text):
    written(tmp_path_factory, "right.yaml", ROS)
    written(tmp_path_factory, "left.yaml", OPENCV.replace("tf_world", "no"))
    rig = outcome(mff.LoadRig, written(tmp_path_factory, "rig.yaml", text), error=InputError)
    if rig is not None:
        for camera in rig.cameras:
            check_camera(camera)
        again = mff.LoadRig(written(tmp_path_factory, "again.yaml", mff.DumpRig(rig)))
        assert again.names == rig.names
        for one, other in zip(again.cameras, rig.cameras, strict=True):
            assert np.array_equal(one.R_CK, other.R_CK) and np.array_equal(one.p_CK, other.p_CK)


WORDS = st.one_of(NUMBERS.map(repr), st.sampled_from(["", "x", "#", ",", "1e999", "1_0", "٣"]))


@prop(st.one_of(mutated([TUM], WORDS), any_of([TUM])))
def test_any_damaged_trajectory_is_taken_or_told(tmp_path_factory, text):
    file = written(tmp_path_factory, "poses.tum", text)
    motion = outcome(mff.LoadTrajectory, file, error=InputError)
    if motion is not None:
        assert np.isfinite(motion.times).all() and np.isfinite(motion.poses).all()
        assert motion.poses.shape == (len(motion), 6)
        assert (np.linalg.norm(motion.poses[:, 3:], axis=1) <= 1.0 + 1e-9).all()


@prop(any_of([COLORS]))
def test_any_damaged_colors_are_taken_or_told(tmp_path_factory, text):
    file = written(tmp_path_factory, "colors.yaml", text)
    colors = outcome(mff.LoadColors, file, error=InputError)
    if colors is not None:
        assert all(math.isfinite(c.hue) and math.isfinite(c.tolerance) for c in colors.colors)
        again = mff.LoadColors(written(tmp_path_factory, "again.yaml", mff.DumpColors(colors)))
        assert again.names == colors.names


# Lenses.

COUNTS = {"none": [0], "plumb_bob": [4, 5, 8], "equidistant": [4]}
SANE = st.floats(-1.0, 1.0)


@st.composite
def cameras(draw, numbers, coefficients):
    """A camera, or what `Camera` says of such numbers."""
    model = draw(st.sampled_from([*COUNTS, *COUNTS, "fisheye"]))
    count = draw(st.sampled_from(COUNTS.get(model, [4])))
    bends = draw(st.lists(coefficients, min_size=count, max_size=count))

    def make():
        fx, fy, cx, cy = (draw(numbers) for _ in range(4))
        turn = cv2.Rodrigues(np.array([draw(SANE) for _ in range(3)]))[0]
        return mff.Camera(
            width=draw(st.integers(1, 2000)), height=draw(st.integers(1, 2000)),
            fx=fx, fy=fy, cx=cx, cy=cy, distortion=mff.Distortion(model, tuple(bends)),
            R_CK=turn, p_CK=[draw(numbers) for _ in range(3)],
        )  # fmt: skip

    return outcome(make, error=ValueError)


POINTS = st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=1, max_size=4)
REAL = st.one_of(SANE, st.floats(10.0, 2000.0))


@prop(st.one_of(cameras(NUMBERS, NUMBERS), cameras(REAL, NUMBERS)), POINTS)
def test_pixels_of_any_lens_are_finite_or_nan(camera, points):
    if camera is None:
        return
    with np.errstate(all="ignore"):
        pixels, jacobians = camera.project_with_jacobian(points)
        seen = camera.sees(points)
        assert np.array_equal(camera.project(points), pixels, equal_nan=True)
    assert (np.isfinite(pixels).all(axis=1) | np.isnan(pixels).all(axis=1)).all(), pixels
    assert np.isfinite(pixels[seen]).all()
    unseen = np.isnan(pixels[:, 0])
    assert np.isnan(jacobians[unseen]).all()


@prop(
    cameras(REAL, st.floats(-0.3, 0.3)), st.lists(SANE, min_size=2, max_size=2), st.floats(0.1, 3)
)
def test_pixels_move_as_their_derivatives_say(camera, across, depth):
    if camera is None:
        return
    ray = np.array([0.7 * across[0], 0.7 * across[1], 1.0]) @ camera.R_CK.T
    point = camera.p_CK + depth * ray
    pixel, J = camera.project_with_jacobian(point)
    if np.isnan(pixel).any():
        return
    assert np.isfinite(J).all()
    size = np.abs(J).max()
    assert np.abs(J @ ray).max() <= 1e-9 * size * (1 + np.abs(camera.p_CK).max())
    step = 1e-5 * depth
    for axis in np.eye(3):
        way = step * axis
        ahead, behind = camera.project(point + way), camera.project(point - way)
        if np.isnan(ahead).any() or np.isnan(behind).any():
            continue
        # Central differences err in the second order, and by the rounding of far places
        rounding = 1e-13 * (1 + np.abs(point).max() / depth) * size * depth / step
        error = np.abs((ahead - behind) / (2 * step) - J @ axis).max()
        assert error <= 1e-3 * size + 100 * rounding, (error, size)
