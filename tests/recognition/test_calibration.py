"""Calibration files: as OpenCV and ROS write them, and clear words for whatever is wrong.

Expectations come from OpenCV: it writes the files, and `cv2.projectPoints` projects.
"""

import gzip
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from mffdrake.recognition.camera.calibration import CalibrationError, read_calibration, read_camera

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "real" / "cube_v1"
K = np.array([[584.2393058000735, 0.0, 278.4135], [0.0, 586.92, 289.4802], [0.0, 0.0, 1.0]])
LENS = {
    4: (-0.23, 0.098, -0.0033, 0.0003),
    5: (-0.23, 0.098, -0.0033, 0.0003, -0.006),
    8: (0.3, -0.1, 0.001, -0.002, 0.01, 0.35, -0.05, 0.02),
}
POINTS = np.random.default_rng(0).uniform([-0.2, -0.2, 0.6], [0.2, 0.2, 1.2], size=(30, 3))
GOOD = {
    "camera_name": "left",
    "image_width": 540,
    "image_height": 480,
    "distortion_model": "plumb_bob",
    "camera_matrix": {"rows": 3, "cols": 3, "data": K.ravel().tolist()},
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": list(LENS[5])},
}
"""What ROS's calibrator writes."""
ROTATION = cv2.Rodrigues(np.array([0.3, -2.0, 1.1]))[0]


def write(folder, values, name="calibration.yaml"):
    """A file of these keys; one whose value is None is left out."""
    file = folder / name
    values = {key: value for key, value in values.items() if value is not None}
    file.write_text(values if isinstance(values, str) else yaml.safe_dump(values))
    return file


def storage(folder, suffix, values):
    """A file that OpenCV writes."""
    file = folder / f"camera.{suffix}"
    writer = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    for key, value in values.items():
        writer.write(key, value)
    writer.release()
    return file


def tf(R=ROTATION, p=(0.1, -0.2, 0.7)):
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return {"rows": 4, "cols": 4, "data": X.ravel().tolist()}


def error_of(file):
    """The message of what must be a CalibrationError of one line that begins with the file."""
    with pytest.raises(CalibrationError) as caught:
        read_camera(file)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith(f"{file}: ")
    return message.removeprefix(f"{file}: ")


def check_projection(camera, coefficients, matrix=K):
    expected = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), matrix, np.array(coefficients))
    np.testing.assert_allclose(camera.project(POINTS), expected[0][:, 0], atol=1e-6)


# What OpenCV writes


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("count", LENS)
@pytest.mark.parametrize(
    "names",
    [
        ("camera_matrix", "distortion_coefficients"),
        ("cameraMatrix", "distCoeffs"),
        ("Camera_Matrix", "Distortion_Coefficients"),
        ("K", "D"),
        ("M1", "D1"),
        ("camera_matrix", "dist_coeffs"),
    ],
)
def test_files_of_opencv(tmp_path, suffix, count, names):
    lens = np.array(LENS[count])[:, None]
    values = {"image_width": 540, "image_height": 480, names[0]: K, names[1]: lens}
    calibration = read_calibration(storage(tmp_path, suffix, values))
    camera = calibration.camera
    assert not calibration.has_pose
    assert (camera.name, camera.width, camera.height) == ("camera", 540, 480)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    assert camera.distortion.model == "plumb_bob"
    assert camera.distortion.coefficients == LENS[count]
    check_projection(camera, LENS[count])


def test_the_sample_calibrator_s_fisheye_flag(tmp_path):
    lens = np.array([[0.1, -0.02, 0.003, -0.001]])
    values = {"image_width": 540, "image_height": 480, "camera_matrix": K}
    values |= {"distortion_coefficients": lens}
    camera = read_camera(storage(tmp_path, "xml", values | {"fisheye_model": 1}))
    assert camera.distortion.model == "equidistant"
    expected = cv2.fisheye.projectPoints(POINTS[:, None], np.zeros(3), np.zeros(3), K, lens[0])
    np.testing.assert_allclose(camera.project(POINTS), expected[0][:, 0], atol=1e-6)
    camera = read_camera(storage(tmp_path, "xml", values | {"fisheye_model": 0}))
    assert camera.distortion.model == "plumb_bob"


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_the_size_as_a_pair_and_the_name_with_a_blank(tmp_path, suffix):
    values = {"K": K.astype(np.float32), "D": np.zeros((1, 5)), "camera_name": "left eye"}
    camera = read_camera(storage(tmp_path, suffix, values | {"image_size": np.array([540, 480])}))
    assert (camera.name, camera.width, camera.height) == ("left eye", 540, 480)
    assert camera.fx == pytest.approx(K[0, 0], rel=1e-7)
    file = tmp_path / f"pair.{suffix}"
    writer = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    writer.startWriteStruct("calibration", cv2.FileNode_MAP)
    writer.startWriteStruct("size", cv2.FileNode_SEQ)
    writer.write("", 540)
    writer.write("", 480)
    writer.endWriteStruct()
    writer.writeComment("The camera itself")
    writer.write("camera_matrix", K)
    writer.write("dist_coeffs", np.zeros((5, 1)))
    writer.endWriteStruct()
    writer.release()
    camera = read_camera(file)
    assert (camera.name, camera.width, camera.height, camera.cx) == ("pair", 540, 480, K[0, 2])


def test_opencv_s_old_first_line(tmp_path):
    text = storage(tmp_path, "yml", {"image_width": 540, "image_height": 480, "K": K}).read_text()
    body = text.split("---", 1)[1] + "D: !!opencv-matrix { rows: 1, cols: 0, dt: d, data: [ ] }\n"
    for head in ("%YAML:1.0\n---", "%YAML:1.0\n", "%YAML 1.2\n---", "\ufeff%YAML:1.0\r\n---"):
        (tmp_path / "old.yml").write_text(head + body, encoding="utf-8")
        camera = read_camera(tmp_path / "old.yml")
        assert (camera.fx, camera.distortion.model) == (K[0, 0], "none")


# What ROS writes


@pytest.mark.parametrize(
    ("model", "count"),
    [
        ("plumb_bob", 4), ("plumb_bob", 5), ("rational_polynomial", 8),
        ("", 4), ("", 5), ("", 8), (None, 4), (None, 5), (None, 8),
    ],
)  # fmt: skip
def test_files_of_ros(tmp_path, model, count):
    lens = {"rows": 1, "cols": count, "data": list(LENS[count])}
    values = GOOD | {"distortion_model": model, "distortion_coefficients": lens}
    camera = read_camera(write(tmp_path, values))
    assert (camera.name, camera.width, camera.height) == ("left", 540, 480)
    assert camera.distortion.coefficients == LENS[count]
    check_projection(camera, LENS[count])


@pytest.mark.parametrize("model", ["equidistant", "fisheye"])
def test_a_fisheye_of_ros(tmp_path, model):
    lens = {"rows": 1, "cols": 4, "data": [0.1, -0.02, 0.003, -0.001]}
    values = {"distortion_model": model, "distortion_coefficients": lens}
    camera = read_camera(write(tmp_path, GOOD | values))
    assert camera.distortion.model == "equidistant"
    assert camera.distortion.coefficients == (0.1, -0.02, 0.003, -0.001)


MESSAGE = """
header:
  stamp: {sec: 1700000000, nanosec: 5}
  frame_id: 2001-99-99
height: 480
width: 540
distortion_model: plumb_bob
%s:
- -0.23
- 9.8e-2
- -33e-4
- 0.0003
- -6e-3
%s: [584.2393058000735, 0.0, 278.4135, 0.0, 586.92, 289.4802, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
---
"""


@pytest.mark.parametrize("keys", ["DK", "dk"])
def test_messages_of_ros(tmp_path, keys):
    file = tmp_path / "echo.txt"
    file.write_text(MESSAGE % tuple(keys) * 2)  # as `ros2 topic echo` prints two of them
    camera = read_camera(file)
    assert (camera.name, camera.width, camera.height) == ("echo", 540, 480)
    check_projection(camera, LENS[5])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("binning_x: 0", "binning_x: 2", "binning_x must be 0 or 1, not '2': binned images differ"),
        ("height: 0, width: 0", "height: 9, width: 9", "roi must be the whole image, 540 x 480, n"),
        ("x_offset: 0", "x_offset: 5", "roi must be the whole image, 540 x 480, not {"),
    ],
)
def test_cut_and_binned_images_are_refused(tmp_path, old, new, message):
    file = tmp_path / "echo.yaml"
    file.write_text((MESSAGE % tuple("dk")).replace(old, new))
    assert error_of(file).startswith(message)


def test_a_camera_without_distortion(tmp_path):
    for changes in (
        {"distortion_model": "none", "distortion_coefficients": None},
        {"distortion_model": "none"} | {"distortion_coefficients": [0.0] * 5},
        {"distortion_coefficients": []},
    ):
        camera = read_camera(write(tmp_path, GOOD | changes))
        assert (camera.distortion.model, camera.distortion.coefficients) == ("none", ())


# The format is told from the content, the pixels' convention is Camera's.


def test_the_suffix_tells_nothing(tmp_path):
    written = storage(tmp_path, "xml", {"image_size": np.array([540, 480]), "K": K, "D": K[:1]})
    file = written.rename(tmp_path / "camera.yaml")
    assert error_of(file).startswith("D must be 0 or 4 or 5 or 8 numbers")  # so it is read as XML
    file = tmp_path / "camera.xml"
    for text in (json.dumps(GOOD), yaml.safe_dump(GOOD), yaml.safe_dump(GOOD)[:-1] + "\n\n"):
        file.write_text(text)
        assert read_camera(file).fx == K[0, 0]
    file.write_text(yaml.safe_dump(GOOD, default_flow_style=True).replace("'", ""))
    assert file.read_text().startswith("{camera_matrix:")  # YAML that looks like JSON
    assert read_camera(file).fx == K[0, 0]


def test_the_pixels_of_both_are_whole_numbers_at_pixel_centers(tmp_path):
    """OpenCV's maps tell by array index where in the image each ray's pixel is."""
    camera = read_camera(write(tmp_path, GOOD))
    lens = np.array(LENS[5])
    P = np.array([[584.0, 0.0, 260.0], [0.0, 584.0, 250.0], [0.0, 0.0, 1.0]])
    u, v = cv2.initUndistortRectifyMap(K, lens, None, P, (540, 480), cv2.CV_32FC1)
    for row, column in ((250, 260), (0, 0), (400, 123)):
        ray = np.linalg.solve(P, [column, row, 1.0])
        np.testing.assert_allclose(camera.project(ray), [u[row, column], v[row, column]], atol=1e-3)


def test_names(tmp_path):
    assert read_camera(write(tmp_path, GOOD)).name == "left"
    assert read_camera(write(tmp_path, GOOD), name="right").name == "right"
    assert read_camera(write(tmp_path, GOOD | {"camera_name": 60})).name == "60"
    assert read_camera(write(tmp_path, GOOD | {"camera_name": None}, "a.b.yml")).name == "a.b"


# Places


def test_a_place_in_the_world(tmp_path):
    calibration = read_calibration(write(tmp_path, GOOD | {"tf_world_to_camera": tf()}))
    assert calibration.has_pose
    p_K = ROTATION @ [0.3, 0.2, 0.1] + [0.1, -0.2, 0.7]  # a point in the world, in the camera
    camera = calibration.camera
    np.testing.assert_allclose(camera.R_CK.T @ ([0.3, 0.2, 0.1] - camera.p_CK), p_K, atol=1e-15)
    np.testing.assert_allclose(camera.R_CK, ROTATION.T, atol=1e-15)
    nested = np.reshape(tf()["data"], (4, 4)).tolist()
    again = read_camera(write(tmp_path, GOOD | {"tf_world_to_camera": nested}))
    np.testing.assert_array_equal(again.R_CK, camera.R_CK)
    here = read_calibration(
        write(tmp_path, GOOD | {"tf_world_to_camera": tf(np.eye(3), [0, 0, 0])})
    )
    assert here.has_pose
    np.testing.assert_array_equal(here.camera.R_CK, np.eye(3))
    assert not np.signbit(here.camera.p_CK).any()


def test_an_averaged_rotation_gives_the_nearest_one(tmp_path):
    off = ROTATION @ np.diag([1.004, 0.997, 1.001])
    camera = read_camera(write(tmp_path, GOOD | {"tf_world_to_camera": tf(off)}))
    np.testing.assert_allclose(camera.R_CK @ camera.R_CK.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(camera.R_CK, ROTATION.T, atol=1e-12)


@pytest.mark.parametrize("number", [60, 180, 300])
def test_real_files(number):
    file = REAL / f"camera_calib_{number}.yml"
    if not file.exists():
        pytest.skip(f"there is no {file}")
    calibration = read_calibration(file)
    camera = calibration.camera
    assert calibration.has_pose
    assert (camera.name, camera.width, camera.height) == (f"camera{number}", 540, 540)
    values = yaml.safe_load(file.read_text())
    X_KW = np.reshape(values["tf_world_to_camera"]["data"], (4, 4))
    p_W = np.random.default_rng(1).uniform(-0.08, 0.08, size=(50, 3))  # near the world's origin
    expected, _ = cv2.projectPoints(
        p_W, cv2.Rodrigues(X_KW[:3, :3])[0], X_KW[:3, 3],
        np.reshape(values["camera_matrix"]["data"], (3, 3)),
        np.array(values["distortion_coefficients"]["data"]),
    )  # fmt: skip
    np.testing.assert_allclose(camera.project(p_W), expected[:, 0], atol=1e-3)


# Mistakes


def test_zeros_past_what_the_models_have_are_cut(tmp_path):
    for count in (12, 14):
        lens = list(LENS[8]) + [0.0] * (count - 8)
        camera = read_camera(write(tmp_path, GOOD | {"distortion_coefficients": lens}))
        assert camera.distortion.coefficients == LENS[8]
        check_projection(camera, lens)
    fisheye = {"distortion_model": "equidistant", "distortion_coefficients": [0.1, 0, 0, 0, 0]}
    camera = read_camera(write(tmp_path, GOOD | fisheye))  # as RealSense's driver fills them up
    assert camera.distortion.coefficients == (0.1, 0.0, 0.0, 0.0)


MATRIX = K.ravel().tolist()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"image_width": None, "image_height": None},
            "no image size; its keys are image_width and image_height, or image_size: "
            "[width, height]",
        ),
        (
            {"image_width": None, "image_wdth": 3},
            "no image width; its key is one of image_width, width (is it 'image_wdth'?)",
        ),
        ({"image_height": 48.5}, "image_height must be a positive whole number, not '48.5'"),
        ({"image_width": 0}, "image_width must be a positive whole number, not '0'"),
        ({"image_width": "wide"}, "image_width must be a positive whole number, not 'wide'"),
        (
            {"image_width": None, "image_height": None, "image_size": [640]},
            "image_size must be [width, height], whole and positive, not ['640']",
        ),
        (
            {"image_width": None, "image_height": None, "image_size": {"width": 640}},
            "image_size must be [width, height], whole and positive, not ['640', None]",
        ),
        (
            {"camera_matrix": None, "camera_matix": MATRIX},
            "no camera matrix; its key is one of camera_matrix, K, M1, cameraMatrix1 "
            "(is it 'camera_matix'?)",
        ),
        (
            {"camera_matrix": MATRIX[:8]},
            "camera_matrix must be 3 x 3 finite numbers, not 8",
        ),
        (
            {"camera_matrix": {"rows": 3, "cols": 3, "data": MATRIX[:8]}},
            "camera_matrix.data must be rows x cols numbers, '3' x '3', not 8",
        ),
        (
            {"camera_matrix": {"rows": 1, "cols": 9, "data": MATRIX}},
            "camera_matrix must be 3 x 3 finite numbers, not 1 x 9",
        ),
        (
            {"camera_matrix": {"rows": "x", "cols": 9, "data": MATRIX}},
            "camera_matrix.data must be rows x cols numbers, 'x' x '9', not 9",
        ),
        ({"camera_matrix": "sharp"}, "camera_matrix must be 3 x 3 finite numbers, not 'sharp'"),
        ({"camera_matrix": {}}, "camera_matrix must be 3 x 3 finite numbers, not None"),
        (
            {"camera_matrix": [*MATRIX[:8], "one"]},
            "camera_matrix must be 3 x 3 finite numbers, not ['584.2393058000735', '0.0',",
        ),
        (
            {"camera_matrix": [*MATRIX[:8], float("nan")]},
            "camera_matrix must be 3 x 3 finite numbers, not ['584.2393058000735', '0.0',",
        ),
        (
            {"camera_matrix": [580, 0.5, 320, 0, 580, 240, 0, 0, 1]},
            "camera_matrix must have no skew in row 1, column 2, not 0.5",
        ),
        (
            {"camera_matrix": [580, 0, 320, 0, 580, 240, 0, 0, 2]},
            "camera_matrix must be fx, 0, cx, 0, fy, cy, 0, 0, 1, not [580.0, 0.0,",
        ),
        (
            {"camera_matrix": [-580, 0, 320, 0, 580, 240, 0, 0, 1]},
            "camera 'left': fx must be positive, not -580.0",
        ),
        (
            {"distortion_coefficients": None},
            "no distortion coefficients; its key is one of distortion_coefficients, dist_coeffs, D",
        ),
        (
            {"distortion_coefficients": [0.1] * 6},
            "distortion_coefficients must be 0 or 4 or 5 or 8 numbers with the model plumb_bob (or "
            "12 or 14, 0 past the first 8), not 6",
        ),
        (
            {"distortion_coefficients": {"rows": 2, "cols": 4, "data": LENS[8]}},
            "distortion_coefficients must be one row or column, not 2 x 4",
        ),
        (
            {"distortion_coefficients": {"rows": 1, "cols": 4, "data": [0.1] * 5}},
            "distortion_coefficients.data must be rows x cols numbers, '1' x '4', not 5",
        ),
        (
            {"distortion_coefficients": [0.1] * 12},
            "distortion_coefficients must be 0 past the first 8 with the model plumb_bob, not "
            "[0.1, 0.1, 0.1, 0.1]",
        ),
        (
            {"distortion_coefficients": ["a"] * 4},
            "distortion_coefficients must be finite numbers, not ['a', 'a', 'a', 'a']",
        ),
        (
            {"distortion_model": "rational_polynomial"},
            "distortion_coefficients must be 8 numbers with the model rational_polynomial",
        ),
        (
            {"distortion_model": "fisheye"},
            "distortion_coefficients must be 0 past the first 4 with the model fisheye, not "
            "[-0.006]",
        ),
        (
            {"distortion_model": "plum_bob"},
            "distortion_model must be one of plumb_bob, rational_polynomial, equidistant, fisheye, "
            "none, not 'plum_bob' (did you mean 'plumb_bob'?)",
        ),
        ({"distortion_model": ["x"]}, "distortion_model must be one of plumb_bob, rational_polyn"),
        ({"fisheye_model": "2"}, "fisheye_model must be 0 or 1, not '2'"),
        (
            {"fisheye_model": 1},
            "distortion_model must be equidistant or fisheye with fisheye_model, not 'plumb_bob'",
        ),
        ({"camera_name": ["a"]}, "camera_name must be a text, not ['a']"),
        ({"M2": MATRIX}, "must be of one camera, and M2 is of a second one"),
        (
            {"camera_matrix": None, "left": {"K": MATRIX}, "right": {"K": MATRIX}},
            "must be of one camera, not of several: left, right",
        ),
        (
            {"tf_world_to_camera": MATRIX},
            "tf_world_to_camera must be 4 x 4 finite numbers, not 9",
        ),
        (
            {"tf_world_to_camera": [*np.eye(4).ravel().tolist()[:12], 0, 0, 1, 1]},
            "tf_world_to_camera must have the last row [0, 0, 0, 1], not [0.0, 0.0, 1.0, 1.0]",
        ),
        (
            {"tf_world_to_camera": tf(1.02 * np.eye(3))},
            "tf_world_to_camera must have a rotation in its upper left 3 x 3 numbers, to 0.01; the "
            "nearest one is 0.02 off",
        ),
        (
            {"tf_world_to_camera": tf(np.diag([1.0, 1.0, -1.0]))},
            "tf_world_to_camera must have a rotation in its upper left 3 x 3 numbers, to 0.01; the",
        ),
    ],
)
def test_wrong_values(tmp_path, changes, message):
    assert error_of(write(tmp_path, GOOD | changes)).startswith(message)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"\xef\xbb\xbf \n", "the file is empty"),
        (b"# nothing here\n", "must be a mapping such as 'image_width: 640', not None"),
        (b"%YAML:1.0\n---\n", "must be a mapping such as 'image_width: 640', not None"),
        (b"- 3\n", "must be a mapping such as 'image_width: 640', not ['3']"),
        (b"<K>3</K>", "must be a mapping such as 'image_width: 640', not '3'"),
        (b"\x89PNG\r\n\x1a\n\0\0", "not a text file in UTF-8"),
        (b"image_width: 3\0", "not a text file in UTF-8"),
        ("image_width: 3".encode("utf-16"), "not a text file in UTF-8"),
        (gzip.compress(b"image_width: 3", mtime=0), "not a text file in UTF-8"),
        (b"a: [1, 2", "not YAML, XML or JSON: line 1, column 9: expected ',' or ']'"),
        (b'{"a": [1, 2}', "not YAML, XML or JSON: line 1, column 12: expected ',' or ']'"),
        (b"a: \x01", "not YAML, XML or JSON: unacceptable character #x0001: special"),
        (b"<a><b></a>", "not XML: mismatched tag: line 1, column 8"),
        (b"<" * 9, "not XML: not well-formed"),
        (b"[" * 20000, "nested too deeply for a calibration"),
        (b"a: &a [*a]", "not YAML, XML or JSON: line 1, column 4: found unconstructable recursive"),
        (b'{"image_size": [1' + b"0" * 400 + b", 1]}", "image_size must be [width, height]"),
        (b'{"image_size": true}', "image_size must be [width, height], whole and positive, not Tr"),
    ],
)
def test_what_is_no_calibration(tmp_path, content, message):
    file = tmp_path / "file.yml"
    file.write_bytes(content)
    assert error_of(file).startswith(message)


def test_a_file_that_cannot_be_read_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_camera(tmp_path / "none.yml")
    with pytest.raises(OSError):
        read_camera(tmp_path)


def test_calibration_errors_are_value_errors():
    assert issubclass(CalibrationError, ValueError)
