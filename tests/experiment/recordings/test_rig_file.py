"""Rig files: places in the rig's frame, files that come back to the last bit, clear errors."""

import math
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from pydrake.math import RigidTransform, RollPitchYaw

from mffdrake.recognition import Camera, CameraRig, Distortion
from mffdrake.recognition.camera.calibration import read_calibration
from mffdrake.recognition.recordings.rig_file import DumpRig, LoadRig, RigError

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "cube_v1"
ONE = "width: 640, height: 480, fx: 580.0, fy: 581.0, cx: 319.5, cy: 239.5"
FIELDS = ("width", "height", "fx", "fy", "cx", "cy", "distortion", "calibration_error")
ALL_KEYS = (
    "calibration, width, height, fx, fy, cx, cy, distortion, X_CK, calibration_error"
)  # fmt: skip


def calibration(folder, name, X_KC=None):
    """A calibration file, with a place in the world where X_KC is given."""
    values = {"image_width": 540, "image_height": 480, "camera_name": "its own name"}
    values |= {"K": [580.0, 0.0, 270.0, 0.0, 585.0, 240.0, 0.0, 0.0, 1.0]}
    values |= {"D": [-0.2, 0.1, 0.001, 0.002, 0.0]}
    if X_KC is not None:
        data = X_KC.GetAsMatrix4().ravel().tolist()
        values["tf_world_to_camera"] = {"rows": 4, "cols": 4, "data": data}
    (folder / name).write_text(yaml.safe_dump(values))


def load(folder, text):
    (folder / "rig.yaml").write_text(text, encoding="utf-8")
    return LoadRig(folder / "rig.yaml")


def error_of(folder, text):
    """The message of what must be a RigError of one line that begins with the file."""
    with pytest.raises(RigError) as caught:
        load(folder, text)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith(f"{folder / 'rig.yaml'}: ")
    return message.removeprefix(f"{folder / 'rig.yaml'}: ")


def assert_same(rig, other):
    """To the last bit."""
    assert rig.names == other.names
    for a, b in zip(rig.cameras, other.cameras, strict=True):
        assert [getattr(a, f) for f in FIELDS] == [getattr(b, f) for f in FIELDS]
        assert a.R_CK.tobytes() == b.R_CK.tobytes()
        assert a.p_CK.tobytes() == b.p_CK.tobytes()


def random_rig(seed):
    rng = np.random.default_rng(seed)
    lenses = [
        Distortion(),
        Distortion("plumb_bob", tuple(rng.normal(0, 0.1, 5))),
        Distortion("plumb_bob", tuple(rng.normal(0, 1e-5, 8))),
        Distortion("equidistant", tuple(rng.normal(0, 0.1, 4))),
    ]
    return CameraRig(
        tuple(
            Camera(
                name=f"{'zyxw'[i]} {i}", width=int(rng.integers(10, 999)), height=480,
                fx=rng.uniform(100, 999), fy=rng.uniform(100, 999),
                cx=rng.uniform(0, 640), cy=rng.uniform(0, 480), distortion=lens,
                R_CK=cv2.Rodrigues(rng.normal(0, 1, 3))[0], p_CK=rng.normal(0, 1e-3, 3),
                calibration_error=float(rng.uniform(0, 1)),
            )
            for i, lens in enumerate(lenses)
        )
    )  # fmt: skip


# What is read


def test_cameras_by_their_numbers(tmp_path):
    rig = load(
        tmp_path,
        f"""
        cameras:
          right: {{{ONE}}}
          left:
            {{{ONE}, calibration_error: 3e-1,
            distortion: {{model: plumb_bob, coefficients: [-2e-1, 0.1, 0, 0]}},
            X_CK: {{translation: [-0.15, 1e-3, 0], rotation: !Rpy {{deg: [10, 20, 30]}}}}}}
        """,
    )
    right, left = rig.cameras
    assert rig.names == ("right", "left")  # in the file's order, not the alphabet's
    assert (right.width, right.height, right.fx, right.fy) == (640, 480, 580.0, 581.0)
    assert (right.cx, right.cy, right.calibration_error) == (319.5, 239.5, 0.0)
    np.testing.assert_array_equal(right.R_CK, np.eye(3))
    np.testing.assert_array_equal(right.p_CK, np.zeros(3))
    assert left.distortion == Distortion("plumb_bob", (-0.2, 0.1, 0.0, 0.0))
    assert left.calibration_error == 0.3
    np.testing.assert_allclose(left.p_CK, [-0.15, 0.001, 0.0])
    R_CK = RollPitchYaw(np.radians([10.0, 20.0, 30.0])).ToRotationMatrix().matrix()
    np.testing.assert_allclose(left.R_CK, R_CK, atol=1e-15)


@pytest.mark.parametrize(
    ("pose", "R_CK", "p_CK"),
    [
        ("{}", np.eye(3), [0, 0, 0]),
        ("{translation: [1, 2, 3]}", np.eye(3), [1, 2, 3]),
        ("{rotation: !Identity {}}", np.eye(3), [0, 0, 0]),
        ("{rotation: !Rpy {deg: [0, 0, 180]}}", np.diag([-1, -1, 1]), [0, 0, 0]),
        (
            "{rotation: !AngleAxis {angle_deg: 90, axis: [0, 0, 2]}}",
            [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
            [0, 0, 0],
        ),
        (
            "{translation: [1, 2, 3], rotation: !Matrix {rows: [[0, -1, 0], [1, 0, 0], "
            "[0, 0, 1]]}}",
            [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
            [1, 2, 3],
        ),
        ("{rotation: !Matrix {rows: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}", np.eye(3), [0, 0, 0]),
    ],
)
def test_poses(tmp_path, pose, R_CK, p_CK):
    camera = load(tmp_path, f"cameras: {{a: {{{ONE}, X_CK: {pose}}}}}").cameras[0]
    np.testing.assert_allclose(camera.R_CK, R_CK, atol=1e-15)
    np.testing.assert_array_equal(camera.p_CK, p_CK)


def test_files_of_calibrations_are_beside_the_rig_file(tmp_path, monkeypatch):
    (tmp_path / "lenses").mkdir()
    calibration(tmp_path / "lenses", "a.yaml")
    calibration(tmp_path, "b.yaml")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    text = (
        "cameras: {1: {calibration: lenses/a.yaml, calibration_error: 2}, "
        f"b: {{calibration: {tmp_path}/b.yaml, X_CK: {{translation: [1, 0, 0]}}}}}}"
    )
    one, b = load(tmp_path, text).cameras
    assert (one.name, b.name, one.calibration_error) == ("1", "b", 2.0)
    assert (one.width, one.fx, one.cy) == (540, 580.0, 240.0)
    assert one.distortion.coefficients == (-0.2, 0.1, 0.001, 0.002, 0.0)
    np.testing.assert_array_equal(b.p_CK, [1, 0, 0])


def test_places_in_the_world_by_files_and_by_hand(tmp_path):
    X_KC = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.2, 0.3])
    calibration(tmp_path, "a.yaml", X_KC)
    calibration(tmp_path, "b.yaml", X_KC)
    by_hand = f"{{{ONE}, X_CK: {{translation: [1, 0, 0]}}}}"
    files = "a: {calibration: a.yaml}, b: {calibration: b.yaml}"
    for text in (f"{files}, c: {by_hand}", f"c: {by_hand}, {files}"):
        rig = load(tmp_path, f"cameras: {{{text}}}")
        cameras = dict(zip(rig.names, rig.cameras, strict=True))
        np.testing.assert_allclose(cameras["a"].p_CK, X_KC.inverse().translation(), atol=1e-15)
        np.testing.assert_allclose(
            cameras["b"].R_CK, X_KC.inverse().rotation().matrix(), atol=1e-15
        )
        np.testing.assert_array_equal(cameras["c"].p_CK, [1, 0, 0])


def test_the_real_cameras(tmp_path):
    if not REAL.exists():
        pytest.skip(f"there is no {REAL}")
    numbers = (60, 180, 300)
    lines = [f"  c{n}: {{calibration: {REAL}/camera_calib_{n}.yml}}" for n in numbers]
    rig = load(tmp_path, "\n".join(["cameras:", *lines]))
    assert rig.names == ("c60", "c180", "c300")
    p_W = [-0.014, -0.024, 0.028]  # the cube's center, seen by all
    for n, camera, pixel in zip(numbers, rig.cameras, rig.project(p_W), strict=True):
        expected = read_calibration(REAL / f"camera_calib_{n}.yml").camera
        np.testing.assert_array_equal(pixel, expected.project(p_W))
        assert np.all((pixel > 100) & (pixel < 440))
        assert camera.name == f"c{n}"
    assert_same(rig, load(tmp_path, DumpRig(rig)))


# What is written


@pytest.mark.parametrize("seed", range(20))
def test_a_dumped_rig_comes_back_to_the_last_bit(tmp_path, seed):
    rig = random_rig(seed)
    assert_same(rig, load(tmp_path, DumpRig(rig)))


def test_other_dumped_rigs_come_back(tmp_path):
    stereo = CameraRig.stereo(fov_y=math.radians(45.0))
    assert_same(stereo, load(tmp_path, DumpRig(stereo)))
    numbers = {"width": 64, "height": 48, "fx": 5, "fy": 5, "cx": 0, "cy": 0}
    names = ("no", "60", "1e3", "null", "a: b", "#c", "ü", "it's", "[x]", "long " * 40)
    odd = CameraRig(
        tuple(
            Camera(name=name, p_CK=np.array([-0.0, 1e-300, 1e9 / 3]), **numbers) for name in names
        )
    )
    assert_same(odd, load(tmp_path, DumpRig(odd)))


def test_an_identity_is_written_without_a_rotation():
    camera = Camera(width=64, height=48, fx=5, fy=5, cx=0, cy=0)
    text = DumpRig(CameraRig((camera,)))
    assert "translation: [0.0, 0.0, 0.0]" in text
    for absent in ("rotation", "distortion", "calibration_error"):
        assert absent not in text


# Mistakes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", f"cameras must be a mapping from each camera's name to its keys {ALL_KEYS}, not None"),
        ("cameras: {}", "cameras must be a mapping from each camera's name to its keys"),
        ("cameras: [a]", "cameras must be a mapping from each camera's name to its keys"),
        ("cameras: !x {}", "cameras must be a mapping from each camera's name to its keys"),
        ("[a", "not YAML: line 2, column 1: did not find expected ',' or ']'"),
        ("- a", "must be a mapping such as"),
        ("camera: {}", "unknown key 'camera' (did you mean 'cameras'?); known keys: cameras"),
        ("cameras: {a: {}}\nx: 3", "unknown key 'x'; known keys: cameras"),
        (
            f"cameras: {{a: {{{ONE}}}, b: {{}}, a: {{}}}}",
            "the key 'a' stands there twice",
        ),
        (f"cameras: {{60: {{{ONE}}}, '60': {{}}}}", "the key '60' stands there twice"),
        (f"cameras: {{true: {{{ONE}}}}}", "a camera's name in cameras must be a text, not True"),
        (f"cameras: {{'': {{{ONE}}}}}", "a camera's name in cameras must be a text, not ''"),
        (
            "cameras: {a: b.yaml}",
            "cameras.a must be a mapping with the key calibration, or width, height, fx, fy, "
            "cx, cy",
        ),
        (
            "cameras: {a: {widht: 3}}",
            f"unknown key 'widht' in cameras.a (did you mean 'width'?); known keys: {ALL_KEYS}",
        ),
        (
            "cameras: {a: {width: 640, fx: 3, cx: 3, cy: 3}}",
            "cameras.a lacks height, fy: give a calibration, or width, height, fx, fy, cx, cy",
        ),
        ("cameras: {a: {}}", "cameras.a lacks width, height, fx, fy, cx, cy: give a calibration"),
        (
            f"cameras: {{a: {{{ONE}, calibration: a.yaml}}}}",
            "cameras.a.width is told by cameras.a.calibration: give either a calibration, or ",
        ),
        (
            "cameras: {a: {calibration: a.yaml, distortion: {model: none}}}",
            "cameras.a.distortion is told by cameras.a.calibration: give either a calibration, or",
        ),
        ("cameras: {a: {calibration: 3}}", "cameras.a.calibration must be a text, not 3"),
        (
            "cameras: {a: {calibration: none.yaml}}",
            "cameras.a.calibration: {folder}/none.yaml: No such file or directory",
        ),
        (
            "cameras: {a: {calibration: rig.yaml}}",
            "cameras.a.calibration: {folder}/rig.yaml: no image size; its keys are",
        ),
        (
            f"cameras: {{a: {{{ONE.replace('580.0', 'long')}}}}}",
            "cameras.a.fx must be a number, not 'long'",
        ),
        (
            f"cameras: {{a: {{{ONE.replace('640', '64.5')}}}}}",
            "cameras.a.width must be a whole number, not 64.5",
        ),
        (
            f"cameras: {{a: {{{ONE.replace('580.0', '-1')}}}}}",
            "cameras.a.fx must be positive, not -1.0",
        ),
        (
            f"cameras: {{a: {{{ONE}, calibration_error: -1}}}}",
            "cameras.a.calibration_error must be at least 0, not -1.0",
        ),
        (
            f"cameras: {{a: {{{ONE}, distortion: {{model: plum}}}}}}",
            "cameras.a.distortion.model must be one of none, plumb_bob, equidistant, not 'plum'",
        ),
        (
            f"cameras: {{a: {{{ONE}, distortion: {{model: equidistant, coefficients: [1]}}}}}}",
            "cameras.a.distortion: equidistant has 4 coefficients, not 1",
        ),
        (
            f"cameras: {{a: {{{ONE}, distortion: {{coeficients: [1]}}}}}}",
            "unknown key 'coeficients' in cameras.a.distortion (did you mean 'coefficients'?); "
            "known keys: model, coefficients",
        ),
        (
            f"cameras: {{a: {{{ONE}, distortion: {{coefficients: [x]}}}}}}",
            "cameras.a.distortion.coefficients[0] must be a number, not 'x'",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: 3}}}}",
            "cameras.a.X_CK must be a mapping with the keys translation, rotation, not 3",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: {{translation: [1, 2]}}}}}}",
            "cameras.a.X_CK.translation must be a list of 3 values, not [1, 2]",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: {{position: [1, 2]}}}}}}",
            "unknown key 'position' in cameras.a.X_CK (did you mean 'rotation'?); known keys: "
            "translation, rotation",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: {{rotation: !Rpy {{rad: [1, 2, 3]}}}}}}}}",
            "unknown key 'rad' in cameras.a.X_CK.rotation; known keys: deg",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: {{rotation: !Matrix {{rows: [[1, 0], [0, 1]]}}}}}}}}",
            "cameras.a.X_CK.rotation.rows[0] must be a list of 3 values, not [1, 0]",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: {{rotation: !Matrix {{row: 3}}}}}}}}",
            "unknown key 'row' in cameras.a.X_CK.rotation (did you mean 'rows'?)",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: {{rotation: !Matrix {{rows: [[1, 0, 0], [0, 1, 0], "
            "[0, 0, 2]]}}}}",
            "cameras.a.X_CK.rotation must be a rotation, not [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], "
            "[0.0, 0.0, 2.0]]",
        ),
        (
            f"cameras: {{a: {{{ONE}}}, b: {{{ONE}}}}}",
            "cameras.b lacks X_CK: only the first camera, 'a', may be without a pose, and the "
            "rig's frame is then its own",
        ),
        (
            f"cameras: {{a: {{{ONE}, X_CK: {{}}}}, b: {{{ONE}}}}}",
            "cameras.b lacks X_CK: only the first camera, 'a', may be without a pose",
        ),
        (
            f"cameras: {{a: {{{ONE}}}, w: {{calibration: world.yaml}}}}",
            "cameras.a lacks X_CK: the rig's frame is the world, in which the calibration of 'w' "
            "tells its place, so every camera must have its own there",
        ),
        (
            f"cameras: {{w: {{calibration: world.yaml}}, a: {{{ONE}}}}}",
            "cameras.a lacks X_CK: the rig's frame is the world, in which the calibration of 'w'",
        ),
        (
            "cameras: {w: {calibration: world.yaml, X_CK: {}}}",
            "cameras.w.X_CK is told by world.yaml, too, as tf_world_to_camera: give one of them",
        ),
    ],
)
def test_mistakes(tmp_path, text, message):
    calibration(tmp_path, "world.yaml", RigidTransform([0.0, 0.0, 1.0]))
    assert error_of(tmp_path, text).startswith(message.replace("{folder}", str(tmp_path)))


def test_a_file_that_is_no_text_or_not_there(tmp_path):
    (tmp_path / "rig.yaml").write_bytes(b"\x89PNG")
    with pytest.raises(RigError, match=r"rig\.yaml: not a text file in UTF-8$"):
        LoadRig(tmp_path / "rig.yaml")
    with pytest.raises(FileNotFoundError):
        LoadRig(tmp_path / "none.yaml")


def test_rig_errors_are_value_errors():
    assert issubclass(RigError, ValueError)


def test_the_rig_file_of_the_page_loads(tmp_path):
    page = Path(__file__).resolve().parents[3] / "docs" / "howto" / "recordings.md"
    found = re.findall(r"```yaml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (text,) = [block for block in found if block.startswith("cameras:")]
    calibration(tmp_path, "front.yaml")
    rig = load(tmp_path, text)
    assert rig.names == ("front", "side")
    assert [camera.calibration_error for camera in rig.cameras] == [0.3, 0.5]
    np.testing.assert_array_equal(rig.cameras[0].R_CK, np.eye(3))


def test_no_message_is_longer_than_what_is_of_use(tmp_path):
    long = "x" * 5000
    for text in (
        f"cameras: {long}",
        f"cameras:\n  ? {long}\n  : 3",
        f"cameras: {{no: {{calibration: !{long} {{}}}}}}",
        f"? {long}\n: 3",
    ):
        assert len(error_of(tmp_path, text)) < 500
