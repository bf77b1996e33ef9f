"""Files of colors, how colors are learned, and which pixels show a face of a known pose."""

import math
from typing import ClassVar

import cv2
import numpy as np
import pytest

from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    Camera,
    CameraRig,
    ColorModel,
    Distortion,
    FaceColor,
    SolidModel,
)
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.recordings.color_file import (
    ColorFileError,
    DumpColors,
    LearnColors,
    LoadColors,
    MasksOfPose,
)

BOX = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
RED_NAME, GREEN_NAME, BLUE_NAME = dict.fromkeys(BOX.materials)
ONE = "red: {hue_deg: 3, tolerance_deg: 5}"


# Files


def load(folder, text):
    (folder / "colors.yaml").write_text(text, encoding="utf-8")
    return LoadColors(folder / "colors.yaml")


def test_colors_come_back(tmp_path):
    names = ("leaf", "Grün", "no", "60", "1e3", "null", "a: b", "#c", "it's", "[x]", "l " * 60)
    rng = np.random.default_rng(1)
    faces = [FaceColor(n, rng.uniform(0, 2 * math.pi), rng.uniform(0, math.pi)) for n in names]
    model = ColorModel(colors=tuple(faces), min_saturation=0.1, min_value=1 / 3, min_chroma=0.0)
    back = load(tmp_path, DumpColors(model))
    assert back.names == names
    for one, other in zip(back.colors, model.colors, strict=True):
        assert one.hue == pytest.approx(other.hue, abs=1e-7)
        assert one.tolerance == pytest.approx(other.tolerance, abs=1e-7)
    for gate in ("min_saturation", "min_value", "min_chroma"):
        assert getattr(back, gate) == getattr(model, gate)


def test_gates_may_be_left_out_and_numbers_be_whole(tmp_path):
    back = load(tmp_path, "{colors: {1: {hue_deg: 120, tolerance_deg: 1e1}}, min_value: 0}")
    assert back.names == ("1",)
    assert back.colors[0].hue == pytest.approx(math.radians(120))
    assert back.colors[0].tolerance == pytest.approx(math.radians(10))
    usual = ColorModel(colors=back.colors)
    assert (back.min_saturation, back.min_value) == (usual.min_saturation, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "colors must be a mapping of materials, such as red: {hue_deg: 3.0, tolerance_deg: "),
        ("colors: {}", "colors must be a mapping of materials"),
        ("colors: [red]", "colors must be a mapping of materials"),
        ("[red]", "must be a mapping"),
        ("colors: {red", "not YAML: line 2"),
        (
            f"colors: {{{ONE}}}\nmin_vale: 0.1",
            "unknown key 'min_vale'; known keys: colors, min_saturation, min_value, min_chroma",
        ),
        ("colors: {red: 3}", "colors.red must be a mapping with the keys hue_deg, tolerance_deg"),
        ("colors: {red: {hue_deg: 3}}", "colors.red.tolerance_deg must be given"),
        (
            "colors: {red: {hue_deg: 3, tolerance_deg: 5, x: 1}}",
            "unknown key 'x' in colors.red; known keys: hue_deg, tolerance_deg",
        ),
        (
            "colors: {red: {hue_deg: wide, tolerance_deg: 5}}",
            "colors.red.hue_deg must be a number, not 'wide'",
        ),
        (
            "colors: {red: {hue_deg: 3, tolerance_deg: -5}}",
            "color 'red': the hue's tolerance must be between 0 and 180 deg, not -5",
        ),
        ("colors: {red: {hue_deg: .inf, tolerance_deg: 5}}", "colors.red.hue_deg must be finite"),
        (f"colors: {{{ONE}}}\nmin_value: dark", "min_value must be a number, not 'dark'"),
        (f"colors: {{{ONE}}}\nmin_value: true", "min_value must be a number, not True"),
        (f"colors: {{{ONE}}}\nmin_value: 30", "min_value must be at most 1, not 30"),
    ],
)
def test_a_wrong_file_is_named_with_its_key(tmp_path, text, message):
    with pytest.raises(ColorFileError) as caught:
        load(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'colors.yaml'}: {message}")
    assert len(str(caught.value).splitlines()) == 1


def test_files_that_are_no_text_or_not_there(tmp_path):
    (tmp_path / "colors.yaml").write_bytes(b"\x89PNG\xff")
    with pytest.raises(ColorFileError, match="not a text file in UTF-8"):
        LoadColors(tmp_path / "colors.yaml")
    with pytest.raises(FileNotFoundError):
        LoadColors(tmp_path / "none.yaml")


# What is learned


def two_images():
    """Halves of orange-red and of green; the other camera's green is bluer."""
    images = {name: np.zeros((20, 40, 3), dtype=np.uint8) for name in ("a", "b")}
    for image in images.values():
        image[:, :20] = (200, 50, 0)  # hue 15 deg
    images["a"][:, 20:] = (0, 200, 0)
    images["b"][:, 20:] = (0, 200, 40)  # hue 132 deg
    return images


def halves():
    left = np.zeros((20, 40), dtype=bool)
    left[:, :20] = True
    return left, ~left


def degrees_of(model):
    return {c.name: (math.degrees(c.hue), math.degrees(c.tolerance)) for c in model.colors}


def test_hues_are_learned_from_all_of_a_material_s_masks():
    left, right = halves()
    masks = {RED_NAME: {"a": left, "b": left}, GREEN_NAME: {"a": right, "b": right}}
    model = LearnColors(BOX, two_images(), masks)
    learned = degrees_of(model)
    assert list(learned) == [RED_NAME, GREEN_NAME, BLUE_NAME]
    assert learned[RED_NAME] == pytest.approx((15.0, 5.0))  # of one hue: the least tolerance
    assert learned[GREEN_NAME] == pytest.approx((126.0, 18.0), abs=0.1)  # 3 times 6 deg


def test_a_material_without_pixels_keeps_its_mesh_s_hue():
    left, _ = halves()
    nothing = np.zeros_like(left)
    learned = degrees_of(
        LearnColors(BOX, two_images(), {RED_NAME: {"a": left}, BLUE_NAME: {"a": nothing}})
    )
    assert learned[RED_NAME] == pytest.approx((15.0, 5.0))
    assert learned[GREEN_NAME] == pytest.approx((120.0, 20.0))
    assert learned[BLUE_NAME] == pytest.approx((240.0, 20.0))


def test_pixels_without_a_hue_are_no_example():
    images = {"a": np.full((20, 40, 3), 90, dtype=np.uint8)}
    with pytest.raises(ValueError, match=f"'{RED_NAME}': only 0 of 400 pixels are bright"):
        LearnColors(BOX, images, {RED_NAME: {"a": halves()[0]}})


# Which pixels show a face


class Rays:
    """What stands behind every pixel, found without the package: a ray at a time."""

    models: ClassVar = {"plumb_bob": cv2.projectPoints, "equidistant": cv2.fisheye.projectPoints}

    def __init__(self, camera):
        v, u = np.mgrid[: camera.height, : camera.width].astype(float)
        center, focal = np.array([camera.cx, camera.cy]), np.array([camera.fx, camera.fy])
        pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
        rays = (pixels - center) / focal
        if camera.distortion.model != "none":
            project = self.models[camera.distortion.model]
            K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
            lens = np.array(camera.distortion.coefficients)
            for _ in range(60):  # Moves each ray by what its pixel lacks.
                points = np.column_stack([rays, np.ones(len(rays))])[:, None]
                found, _ = project(points, np.zeros(3), np.zeros(3), K, lens)
                rays += (pixels - found.reshape(-1, 2)) / focal
        self.directions_C = np.column_stack([rays, np.ones(len(rays))]) @ camera.R_CK.T
        self.camera = camera

    def face_seen(self, solid, pose):
        """The face at every pixel, or -1, shape (height, width)."""
        R_CM, p_CM = transform_from_pose(pose)
        directions = self.directions_C @ R_CM
        origin = R_CM.T @ (self.camera.p_CK - p_CM)
        seen = np.full(len(directions), -1)
        for k, face in enumerate(solid.faces):
            corners, normal = solid.vertices[list(face)], solid.normals[k]
            toward = directions @ normal
            depth = (corners[0] - origin) @ normal / np.where(toward < 0.0, toward, -1.0)
            hits = origin + depth[:, None] * directions
            inside = (toward < 0.0) & (depth > 0.0)
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                inside &= (hits - a) @ np.cross(normal, b - a) >= 0.0
            seen[inside] = k
        return seen.reshape(self.camera.height, self.camera.width)


def eroded(mask, border):
    kernel = np.ones((2 * border + 1, 2 * border + 1), np.uint8)
    small = mask.astype(np.uint8)
    return cv2.erode(small, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0


LENSES = {
    "none": Distortion(),
    "plumb_bob": Distortion("plumb_bob", (-0.5, 0.15, 2e-3, -1e-3)),
    "equidistant": Distortion("equidistant", (-0.3, 0.05, 0.0, 0.0)),
}
POSES = {
    "three faces": [0.02, 0.0, 0.5, 0.3, 0.3, 0.1],
    "partly outside": [0.15, 0.08, 0.4, -0.2, 0.5, 0.1],
    "one face": [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
}


@pytest.fixture(scope="module", params=LENSES)
def all_rays(request):
    """The rays of two cameras of one kind, the second one turned and aside."""
    numbers = {"width": 160, "height": 120, "fx": 170.0, "fy": 175.0, "cx": 78.0, "cy": 61.0}
    place = {
        "R_CK": cv2.Rodrigues(np.array([0.1, -0.3, 0.2]))[0], "p_CK": np.array([0.15, 0.1, 0.0])
    }  # fmt: skip
    lens = LENSES[request.param]
    cameras = [Camera(name="a", distortion=lens, **numbers)]
    cameras.append(Camera(name="b", distortion=lens, **numbers, **place))
    return [Rays(camera) for camera in cameras]


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
def test_masks_of_a_pose_are_the_faces_a_little_inside(all_rays, pose):
    six = SolidModel(BOX.vertices, BOX.faces, BOX.hues, [f"face {k}" for k in range(6)])
    pose = np.array(pose)
    masks = MasksOfPose(six, CameraRig(tuple(rays.camera for rays in all_rays)), pose)
    count = 0
    for rays in all_rays:
        seen = rays.face_seen(six, pose)
        for k, material in enumerate(six.materials):
            mask = masks.get(material, {}).get(rays.camera.name, np.zeros(seen.shape, dtype=bool))
            whole = seen == k
            # Pixels whose neighbors to 3 px show the face, give or take one at its border
            assert not (mask & ~eroded(whole, 2)).any()
            assert not (eroded(whole, 4) & ~mask).any()
            count += int(mask.sum())
    assert count > 1000
    assert all(mask.any() for by_camera in masks.values() for mask in by_camera.values())


def test_faces_of_one_material_share_a_mask():
    """Two neighbors: both are in it, and what lies between them is not."""
    pose = np.array(POSES["three faces"])
    rig = CameraRig((CameraRig.stereo(width=160, height=120).cameras[0],))
    apart = MasksOfPose(SolidModel(BOX.vertices, BOX.faces, BOX.hues, list("abcdef")), rig, pose)
    assert len(apart) == 3
    same = MasksOfPose(SolidModel(BOX.vertices, BOX.faces, BOX.hues, 6 * ["x"]), rig, pose)
    union = np.any([mask["right"] for mask in apart.values()], axis=0)
    assert list(same) == ["x"]
    np.testing.assert_array_equal(same["x"]["right"], union)


def test_what_is_not_in_view_has_no_mask():
    rig = CameraRig.stereo(width=160, height=120)
    for z in (-0.5, 0.0):
        assert MasksOfPose(BOX, rig, np.array([0.0, 0.0, z, 0.0, 0.0, 0.0])) == {}
    assert MasksOfPose(BOX, rig, np.array([2.0, 0.0, 0.5, 0.0, 0.0, 0.0])) == {}
    aside = MasksOfPose(BOX, rig, np.array([0.22, 0.0, 0.5, 0.0, 0.0, 0.0]))
    assert {name for by_camera in aside.values() for name in by_camera} == {"right"}
