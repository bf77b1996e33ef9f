"""Colors learned from masks or a known pose; and a real cube found with them."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from mffdrake.recognition import CameraRig, ColorModel, FaceColor, SolidModel
from mffdrake.recognition.poses.pose import pose_from_transform, rotation_angle
from mffdrake.recognition.recordings.color_file import DumpColors, LoadColors, MasksOfPose
from mffdrake.recognition.recordings.rig_file import LoadRig

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "cube_v1"
needs_real = pytest.mark.skipif(not REAL.is_dir(), reason=f"no real images in {REAL}")

HALF = 0.0326
FACES = {
    "red": (0, (1, 0, 0)), "green": (1, (0, 1, 0)), "blue": (2, (0, 0, 1)),
    "yellow": (0, (1, 1, 0)), "magenta": (1, (1, 0, 1)), "cyan": (2, (0, 1, 1)),
}  # fmt: skip
"""The cube's materials: its axis and its color in the mesh; the last three look backward."""


def write_cube(folder):
    """The real cube as OBJ and MTL, by hand."""
    corners = [(x, y, z) for x in (-HALF, HALF) for y in (-HALF, HALF) for z in (-HALF, HALF)]
    lines = ["mtllib cube.mtl", *(f"v {x} {y} {z}" for x, y, z in corners)]
    for k, (name, (axis, _)) in enumerate(FACES.items()):
        sign = 1 if k < 3 else -1
        u, v = [(1, 2), (2, 0), (0, 1)][axis]
        around = [(-1, -1), (1, -1), (1, 1), (-1, 1)][::sign]
        ids = []
        for a, b in around:
            point = [0.0, 0.0, 0.0]
            point[axis], point[u], point[v] = sign * HALF, a * HALF, b * HALF
            ids.append(corners.index(tuple(point)) + 1)
        lines += [f"usemtl {name}", "f " + " ".join(map(str, ids))]
    (folder / "cube.obj").write_text("\n".join(lines) + "\n")
    materials = [f"newmtl {n}\nKd {r} {g} {b}" for n, (_, (r, g, b)) in FACES.items()]
    (folder / "cube.mtl").write_text("\n".join(materials) + "\n")


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    """The real cube's mesh and rig, and the options for its images and masks."""
    folder = tmp_path_factory.mktemp("cube")
    write_cube(folder)
    names = ("60", "180", "300")
    cameras = {f"camera{n}": {"calibration": str(REAL / f"camera_calib_{n}.yml")} for n in names}
    (folder / "rig.yaml").write_text(yaml.safe_dump({"cameras": cameras}, sort_keys=False))
    images = " ".join(f"camera{n}={REAL / f'camera{n}.png'}" for n in names)
    masks = " ".join(
        f"{material}=camera{n}:{REAL / f'{material[0]}{n}.png'}"
        for material in FACES
        for n in names
        if (REAL / f"{material[0]}{n}.png").is_file()
    )
    common = f"--rig rig.yaml --target cube.obj --images {images}"
    return folder, common, masks


@pytest.fixture(scope="module")
def learned(cube, mffdrake):
    folder, common, masks = cube
    finished = mffdrake(f"colors {common} --masks {masks} --out colors.yaml", folder)
    assert finished.returncode == 0, finished.stderr
    return folder, common, finished


# Real images


@needs_real
def test_the_hues_of_the_real_faces_are_learned(learned):
    folder, _, finished = learned
    model = LoadColors(folder / "colors.yaml")
    hues = {color.name: np.degrees(color.hue) for color in model.colors}
    assert set(hues) == set(FACES)
    for name, hue in {"green": 120, "yellow": 60, "cyan": 184, "blue": 208, "magenta": 347}.items():
        assert abs(hues[name] - hue) < 4.0
    assert "no pixels of material 'red'" in finished.stderr
    assert "the hues of 'cyan' and 'blue' overlap" in finished.stderr.replace(
        "'blue' and 'cyan'", "'cyan' and 'blue'"
    )
    assert cv2.imread(str(folder / "colors.png")).shape == (1080, 1620, 3)
    assert "| yellow |" in finished.stdout


@needs_real
def test_the_learned_colors_tell_the_faces_pixels_apart(learned):
    model = LoadColors(learned[0] / "colors.yaml")
    for material in ("green", "yellow", "cyan", "blue", "magenta"):
        for n in ("60", "180", "300"):
            mask = cv2.imread(str(REAL / f"{material[0]}{n}.png"), cv2.IMREAD_UNCHANGED)
            if mask is None:
                continue
            image = cv2.imread(str(REAL / f"camera{n}.png"))[:, :, ::-1]
            bits = model.classify(image[mask[:, :, 3] > 127])
            assert (bits == 1 << model.names.index(material)).mean() > 0.8


@needs_real
@pytest.mark.parametrize("seed", [101, 102, 103])
def test_the_real_cube_is_found_over_the_whole_arena(learned, quickly, tmp_path, seed):
    folder, common, _ = learned
    arena = (
        "{refinement: borders, search_range: {x: [-0.2, 0.2], y: [-0.2, 0.2], z: [-0.02, 0.2], "
        "eps1: [-1, 1], eps2: [-1, 1], eps3: [-1, 1]}}"
    )
    finished = quickly(
        f"track {common} --colors colors.yaml --generations 400 --start random --seed {seed} "
        f"--recognizer '{arena}' --out {tmp_path}",
        folder,
    )
    assert finished.returncode == 0, finished.stderr
    with open(tmp_path / "poses.csv", newline="") as file:
        last = list(csv.DictReader(file))[-1]
        row = {key: float(last[key]) for key in ("x", "y", "z", "qx", "qy", "qz", "qw", "refined")}
    R = cv2.Rodrigues(np.array([1.48171, 0.941179, -1.55799]))[0]
    expected = pose_from_transform(R, [-0.014, -0.024, 0.028])
    position = np.array([row["x"], row["y"], row["z"]])
    eps = np.sign(row["qw"]) * np.array([row["qx"], row["qy"], row["qz"]])
    assert np.linalg.norm(position - expected[:3]) < 0.010
    assert rotation_angle(eps, expected[3:]) < 0.2
    assert row["refined"] == 1.0


# Rendered images


def test_colors_of_a_known_pose(recording, quickly, tmp_path):
    folder, _ = recording
    images = " ".join(f"{side}=rec/images/{side}/000000.png" for side in ("right", "left"))
    finished = quickly(
        f"colors --rig rec/rig.yaml --target rec/target.obj --images {images} "
        f"--pose rec/true_poses.tum --out {tmp_path / 'colors.yaml'}",
        folder,
    )
    assert finished.returncode == 0, finished.stderr
    for color in LoadColors(tmp_path / "colors.yaml").colors:
        assert min(abs(np.degrees(color.hue) - hue) for hue in (0, 120, 240)) < 1e-6
    assert LoadColors(tmp_path / "colors.yaml").overlaps() == []


def test_masks_of_a_pose_lie_within_the_faces_that_are_seen():
    rig = CameraRig.stereo(width=320, height=240)
    box = SolidModel.box((0.1, 0.15, 0.2), np.radians([0.0, 120.0, 240.0]))
    pose = np.array([0.02, 0.1, 0.7, 0.2, 0.3, 0.1])
    masks = MasksOfPose(box, rig, pose)
    assert len(masks) == 3
    seen = {name: np.zeros((240, 320), dtype=int) for name in rig.names}
    for cameras in masks.values():
        for name, mask in cameras.items():
            seen[name] += mask
    for camera in rig.cameras:
        assert seen[camera.name].max() == 1  # no pixel shows two materials
        hull = cv2.convexHull(camera.project(_corners(box, pose)).astype(np.float32))
        whole = cv2.contourArea(hull)
        assert 0.5 * whole < seen[camera.name].sum() < 0.95 * whole
        for v, u in np.argwhere(seen[camera.name] > 0)[::97]:
            assert cv2.pointPolygonTest(hull, (float(u), float(v)), True) > 2.0


def _corners(box, pose):
    angle = 2.0 * np.arcsin(np.linalg.norm(pose[3:]))
    R = cv2.Rodrigues(pose[3:] / np.linalg.norm(pose[3:]) * angle)[0]
    return box.vertices @ R.T + pose[:3]


def test_a_color_file_comes_back(tmp_path):
    model = ColorModel(
        colors=(FaceColor("Grün", 2.1, 0.2), FaceColor("blue 2", 4.0, 0.1)), min_value=0.2
    )
    (tmp_path / "colors.yaml").write_text(DumpColors(model), encoding="utf-8")
    back = LoadColors(tmp_path / "colors.yaml")
    assert back.names == model.names and back.min_value == 0.2
    for one, other in zip(back.colors, model.colors, strict=True):
        assert one.hue == pytest.approx(other.hue, abs=1e-7)
        assert one.tolerance == pytest.approx(other.tolerance, abs=1e-7)


@pytest.fixture
def colors(recording, quickly, tmp_path, caplog):
    """Learns from masks, marked rows of the right image; returns how it ended and its warnings."""

    def learn(**marked):
        masks = []
        for name, rows in marked.items():
            mask = np.zeros((240, 320), np.uint8)
            mask[rows] = 255
            cv2.imwrite(str(tmp_path / f"{name}.png"), mask)
            masks.append(f"{name.rstrip('_')}=right:{tmp_path / name}.png")
        finished = quickly(
            "colors --rig rec/rig.yaml --target rec/target.obj "
            f"--images right=rec/images/right/000000.png --masks {' '.join(masks)} "
            f"--out {tmp_path / 'colors.yaml'}",
            recording[0],
        )
        assert finished.returncode == 0, finished.stderr
        return finished, [record.getMessage() for record in caplog.records]

    return learn


def test_materials_without_pixels_keep_the_mesh_s_hue_with_a_warning(colors, tmp_path):
    """Be there no mask, or a black one."""
    finished, warnings = colors(blue=slice(0, 240), red=slice(0, 0))
    for name, warning in zip(("green", "red"), warnings, strict=True):
        assert warning.startswith(f"no pixels of material '{name}': it keeps its mesh's hue")
    learned = {c.name: np.degrees(c.hue) for c in LoadColors(tmp_path / "colors.yaml").colors}
    assert learned == pytest.approx({"blue": 240.0, "green": 120.0, "red": 0.0}, abs=1e-6)
    assert "| green | 120.0 | 20.0 | 0 |" in finished.stdout
    assert "| red | 0.0 | 20.0 | 0 |" in finished.stdout


def test_faces_that_look_alike_are_named_with_what_that_means(colors):
    _, (missing, overlap) = colors(blue=slice(0, 240), red=slice(0, 240))
    assert "no pixels of material 'green'" in missing
    assert "the hues of 'blue' and 'red' overlap" in overlap
    assert "no border to refine a pose from" in overlap


def test_masks_of_one_material_add_up(colors):
    finished, _ = colors(blue=slice(0, 130), blue_=slice(120, 240))
    assert f"| blue | 240.0 | 5.0 | {240 * 320} |" in finished.stdout


# Mistakes


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--masks red:right:a.png", ["--masks red:right:a.png", "MATERIAL=NAME:FILE"]),
        ("--masks pink=right:a.png", ["pink", "the target has the materials"]),
        ("--masks {m}=top:a.png", ["no image of camera 'top'", "right"]),
        ("--masks {m}=right:nowhere.png", ["nowhere.png"]),
        ("--masks {m}=right:dark.png", [": only 0 of", "at least 20"]),
        ("--pose nowhere.tum", ["nowhere.tum"]),
        ("", ["--masks", "--pose", "required"]),
        ("--pose rec/start.tum --masks {m}=right:a.png", ["not allowed with"]),
    ],
)
def test_what_cannot_be_learned_from_is_named(recording, quickly, options, words, tmp_path):
    folder, _ = recording
    mask = np.zeros((240, 320), np.uint8)
    mask[:10, :10] = 255  # grey background
    cv2.imwrite(str(folder / "dark.png"), mask)
    material = SolidModel.from_mesh_file(folder / "rec/target.obj").materials[0]
    finished = quickly(
        "colors --rig rec/rig.yaml --target rec/target.obj "
        f"--images right=rec/images/right/000000.png {options.format(m=material)} "
        f"--out {tmp_path / 'colors.yaml'}",
        folder,
    )
    assert finished.returncode == 2
    for word in words:
        assert word in finished.stderr, finished.stderr
    assert not (tmp_path / "colors.yaml").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("right=rec/images/right/000001.png", ["--images right=...: camera 'right' stands there"]),
        ("--out colors.png", ["--out colors.png: must be a text file"]),
    ],
)
def test_what_would_overwrite_something_else_is_named(recording, quickly, options, words):
    finished = quickly(
        "colors --pose rec/start.tum --rig rec/rig.yaml --target rec/target.obj "
        f"--images right=rec/images/right/000000.png {options}",
        recording[0],
    )
    assert finished.returncode == 2
    for word in words:
        assert word in finished.stderr, finished.stderr
    assert not (recording[0] / "colors.png").exists()
    assert not (recording[0] / "colors.yaml").exists()


def test_an_image_of_another_size_is_named(recording, quickly, tmp_path):
    folder, _ = recording
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((10, 10, 3), np.uint8))
    finished = quickly(
        f"colors --rig rec/rig.yaml --target rec/target.obj --images right={tmp_path}/small.png "
        "--pose rec/start.tum",
        folder,
    )
    assert finished.returncode == 2
    assert "small.png" in finished.stderr and "(240, 320, 3 or 4)" in finished.stderr


def test_the_mesh_of_the_test_is_the_cube(tmp_path):
    write_cube(tmp_path)
    solid = SolidModel.from_mesh_file(tmp_path / "cube.obj")
    for material, normal in zip(solid.materials, solid.normals, strict=True):
        axis = FACES[material][0]
        assert normal[axis] == pytest.approx(1.0 if material in ("red", "green", "blue") else -1.0)
    if REAL.is_dir():
        (tmp_path / "rig.yaml").write_text(
            f"cameras: {{a: {{calibration: {REAL / 'camera_calib_60.yml'}}}}}"
        )
        assert LoadRig(tmp_path / "rig.yaml").cameras[0].calibration_error == 0.5
