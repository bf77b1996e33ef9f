"""The recorded circle closes: what was recorded is tracked to the very poses of the live run."""

import csv
import json
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

from mffdrake.recognition import CameraRig
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.recordings.rig_file import LoadRig
from mffdrake.recognition.recordings.trajectory import LoadTrajectory

COLUMNS = [
    "frame", "time", "x", "y", "z", "qx", "qy", "qz", "qw", "fitness", "refined",
    "std_position_mm", "std_rotation_deg", "ms", "state", "is_tracking", "confidence",
]  # fmt: skip
SMALL = "camera: {width: 320, height: 240}, duration: 0.3, seed: 3, hand_path: {omega: 0.314}"


def rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def numbers(path):
    trajectory = LoadTrajectory(path)
    return np.column_stack([trajectory.times, trajectory.poses])


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (f"{{{SMALL}, recognizer: {{refinement: borders}}}}", ()),
        (f"{{{SMALL}, recognizer: {{start: near_target}}}}", ("--method", "ga")),
        (f"{{{SMALL}, recognizer: {{start: near_target, coding: gray}}}}", ("--seed", 11)),
        (
            "{camera: {width: 320, height: 240, latency: 0.033}, duration: 0.3, recognizer: "
            "{start: near_target, refinement: borders}, encoders: {noise_deg: 0.02}}",
            (),
        ),
    ],
    ids=["random start", "without feedforward", "another coding", "late images, noisy joints"],
)
def test_tracking_a_recording_gives_the_live_poses(
    tmp_path, quickly, make_recording, text, options
):
    command = make_recording(tmp_path, *options, text=text, run=quickly)
    finished = quickly(command.removeprefix("mffdrake "), tmp_path)
    assert finished.returncode == 0, finished.stderr
    live, tracked = (
        numbers(tmp_path / "rec" / name) for name in ("live_poses.tum", "tracked/poses.tum")
    )
    assert len(live) == 10
    np.testing.assert_allclose(tracked, live, rtol=0, atol=1e-9)


def test_a_recording_holds_what_is_promised(recording):
    folder, command = recording
    rec = folder / "rec"
    names = {p.name for p in rec.iterdir()} - {"tracked"}
    assert names == {
        "images", "rig.yaml", "motion.tum", "true_poses.tum", "live_poses.tum", "start.tum",
        "target.obj", "target.mtl", "scenario.yaml", "recognizer.yaml",
    }  # fmt: skip
    for side in ("right", "left"):
        images = sorted((rec / "images" / side).iterdir())
        assert [p.name for p in images] == [f"{k:06d}.png" for k in range(10)]
        assert cv2.imread(str(images[0])).shape == (240, 320, 3)
    read, made = LoadRig(rec / "rig.yaml"), CameraRig.stereo(width=320, height=240)
    for one, other in zip(read.cameras, made.cameras, strict=True):
        assert (one.name, one.fx, one.cx, one.cy) == (other.name, other.fx, other.cx, other.cy)
        np.testing.assert_array_equal(one.p_CK, other.p_CK)
        assert one.calibration_error == 0.0
    assert command.startswith("mffdrake track --rig rec/rig.yaml")


def test_the_recorded_motion_and_true_poses_belong_together(recording):
    """The target at rest: its pose in the world is the same in every frame."""
    rec = recording[0] / "rec"
    motion, true = LoadTrajectory(rec / "motion.tum"), LoadTrajectory(rec / "true_poses.tum")
    R_WC, p_WC = transform_from_pose(motion.poses)
    R_CM, p_CM = transform_from_pose(true.poses)
    p_WM = np.einsum("kij,kj->ki", R_WC, p_CM) + p_WC
    np.testing.assert_allclose(p_WM, [[1.718, 0.0, 0.455]] * 10, atol=1e-9)
    R_WM = R_WC @ R_CM
    np.testing.assert_allclose(R_WM, R_WM[:1].repeat(10, axis=0), atol=1e-9)
    assert np.ptp(p_WC, axis=0).max() > 1e-3  # and the rig moves


# What tracking writes


@pytest.fixture(scope="module")
def tracked(recording, mffdrake):
    folder, command = recording
    finished = mffdrake(f"{command} --overlay", folder)
    assert finished.returncode == 0, finished.stderr
    return folder / "rec" / "tracked", finished


def test_it_writes_its_files_and_is_quiet(tracked):
    folder, finished = tracked
    assert finished.stderr == ""
    names = {p.name for p in folder.iterdir()}
    assert names == {
        "poses.csv",
        "poses.tum",
        "track.json",
        "last_frame.png",
        "poses.png",
        "overlay",
    }
    assert "10 frames" in finished.stdout and "refined, give or take" in finished.stdout


def test_poses_csv_has_the_promised_columns(tracked):
    table = rows(tracked[0] / "poses.csv")
    assert list(table[0]) == COLUMNS
    assert [row["frame"] for row in table] == [str(k) for k in range(10)]
    poses = numbers(tracked[0] / "poses.tum")
    for row, pose in zip(table, poses, strict=True):
        written = [float(row[name]) for name in ("time", "x", "y", "z", "qx", "qy", "qz")]
        np.testing.assert_array_equal(written, pose)
        q = np.array([float(row[name]) for name in ("qx", "qy", "qz", "qw")])
        assert np.linalg.norm(q) == pytest.approx(1.0)
        assert row["refined"] in ("0", "1")
        assert (row["std_position_mm"] != "") == (row["refined"] == "1")
        assert float(row["ms"]) > 0.0
    assert [row["refined"] for row in table].count("1") > 5


def test_the_poses_are_the_target_s(tracked):
    true = numbers(tracked[0].parent / "true_poses.tum")
    found = numbers(tracked[0] / "poses.tum")
    assert np.linalg.norm((found - true)[3:, 1:4], axis=1).max() < 0.003


def test_track_json_has_settings_versions_and_means(tracked):
    data = json.loads((tracked[0] / "track.json").read_text())
    assert data["settings"]["seed"] == 3
    assert data["settings"]["motion"] == "rec/motion.tum"
    assert {"mffdrake", "drake", "numpy", "python"} <= set(data["versions"])
    table = rows(tracked[0] / "poses.csv")
    for name, column in (("fitness", "fitness"), ("refined", "refined"), ("ms", "ms")):
        mean = np.mean([float(row[column]) for row in table])
        assert data["means"][name] == pytest.approx(mean)
    assert data["last_refinement"]["refined"] == (table[-1]["refined"] == "1")


def test_the_overlay_is_the_images_with_an_outline(tracked, recording):
    overlay = sorted((tracked[0] / "overlay").iterdir())
    assert [p.name for p in overlay] == [f"{k:06d}.png" for k in range(10)]
    drawn = cv2.imread(str(overlay[5]))
    sides = [
        cv2.imread(str(recording[0] / f"rec/images/{side}/000005.png"))
        for side in ("left", "right")
    ]
    plain = np.hstack(sides)
    changed = np.any(drawn != plain, axis=2)
    assert 0.002 < changed.mean() < 0.1


def test_a_video_instead(tmp_path, recording, quickly):
    folder, command = recording
    command = command.replace("--out rec/tracked", f"--out {tmp_path} --overlay video --stride 2")
    finished = quickly(command.removeprefix("mffdrake "), folder)
    assert finished.returncode == 0, finished.stderr
    capture = cv2.VideoCapture(str(tmp_path / "overlay.mp4"))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == 5
    assert capture.read()[1].shape == (240, 640, 3)
    assert [row["frame"] for row in rows(tmp_path / "poses.csv")] == ["0", "2", "4", "6", "8"]


def test_one_set_of_images_is_searched(tmp_path, recording, quickly):
    folder, _ = recording
    images = "right=rec/images/right/000004.png left=rec/images/left/000004.png"
    finished = quickly(
        f"track --rig rec/rig.yaml --target rec/target.obj --images {images} --start random "
        "--generations 300 --seed 2 --recognizer '{refinement: borders}' --rate 10 "
        f"--out {tmp_path}",
        folder,
    )
    assert finished.returncode == 0, finished.stderr
    table = rows(tmp_path / "poses.csv")
    true = numbers(folder / "rec/true_poses.tum")[4]
    answer = [float(table[-1][name]) for name in ("x", "y", "z")]
    assert np.linalg.norm(np.array(answer) - true[1:4]) < 0.003
    search = json.loads((tmp_path / "track.json").read_text())["search"]
    assert 1 <= search["generations"] <= 300 and search["rounds"] >= 1
    assert "Search:" in finished.stdout
    assert not (tmp_path / "poses.png").exists()


# Bad input: one line, status 2, and what was tracked so far is kept.


def bad(finished, *words):
    assert finished.returncode == 2, finished.stdout
    assert "Traceback" not in finished.stderr
    (line,) = [
        text
        for text in finished.stderr.splitlines()
        if text.startswith("mffdrake") and "WARNING" not in text
    ]
    for word in words:
        assert word in line, line


TRACK = "track --rig rec/rig.yaml --target rec/target.obj --out {out} "
BOTH = "--images right=rec/images/right left=rec/images/left "


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--images right=rec/images/right", ["no images of camera 'left'", "right, left"]),
        (BOTH + "top=rec/images/right", ["camera 'top'", "right, left"]),
        ("--images right=nowhere left=rec/images/left", ["nowhere", "no such folder"]),
        ("--images right=rec left=rec/images/left", ["rec", "no images"]),
        ("--images right left=rec/images/left", ["--images right", "NAME=SOURCE"]),
        (
            "--images right=rec/images/right left=rec/images/left/000000.png",
            ["10 of 'right', 1 of 'left'"],
        ),
        (BOTH + "--recognizer '{popsize: 3}'", ["unknown key 'popsize'", "population_size"]),
        (BOTH + "--recognizer '{start: near_target}'", ["--start"]),
        (BOTH + "--motion nowhere.tum", ["nowhere.tum"]),
        (BOTH + "--colors nowhere.yaml", ["nowhere.yaml"]),
        (BOTH + "--start nowhere.tum", ["nowhere.tum"]),
        (BOTH + "--stride 0", ["--stride", "positive"]),
        (BOTH + "--overlay film", ["--overlay", "film"]),
    ],
)  # fmt: skip
def test_what_cannot_be_tracked_is_named(tmp_path, recording, quickly, options, words):
    bad(quickly(TRACK.format(out=tmp_path / "out") + options, recording[0]), *words)
    assert not (tmp_path / "out" / "poses.csv").exists()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("rig", "cameras: {a: {calibration: no.yaml}}", ["cameras.a.calibration", "no.yaml"]),
        ("rig", "cameras: {a: {width: 3}}", ["cameras.a lacks height"]),
        ("rig", "camera: {}", ["unknown key 'camera'"]),
        ("target", "v 0 0 0\n", ["target.obj"]),
        ("motion", "0 1 2 3\n", ["line 1", "8 numbers"]),
        ("motion", "0 1 2 3 0 0 0 2\n", ["quaternion"]),
        ("colors", "colors: {red: {hue: 3}}", ["colors.red", "hue_deg"]),
        ("colors", "colors: {red: {hue_deg: 3, tolerance_deg: 5}}", ["no color", "green"]),
    ],
)
def test_files_that_are_wrong_are_named(tmp_path, recording, quickly, name, content, words):
    file = tmp_path / f"{name}.{'obj' if name == 'target' else 'yaml'}"
    file.write_text(content)
    arguments = {"rig": "rec/rig.yaml", "target": "rec/target.obj"} | {name: str(file)}
    options = " ".join(f"--{key} {value}" for key, value in arguments.items())
    bad(quickly(f"track {options} {BOTH} --out {tmp_path / 'out'}", recording[0]), *words)


def copied(recording, tmp_path):
    """The recorded images, to spoil one of them."""
    for side in ("right", "left"):
        (tmp_path / side).mkdir()
        for path in (recording[0] / "rec/images" / side).iterdir():
            (tmp_path / side / path.name).write_bytes(path.read_bytes())
    return f"--images right={tmp_path / 'right'} left={tmp_path / 'left'} "


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda file: cv2.imwrite(file, np.zeros((240, 320), np.uint8)), ["000006", "grey"]),
        (
            lambda file: cv2.imwrite(file, np.zeros((100, 320, 3), np.uint8)),
            ["frame 6", "camera 'left'", "(240, 320, 3 or 4)"],
        ),
        (lambda file: cv2.imwrite(file, np.zeros((240, 320, 3), np.uint16)), ["000006", "8 bits"]),
        (lambda file: open(file, "wb").close(), ["000006", "not an image"]),
    ],
    ids=["grey", "another size", "16 bits", "empty"],
)
def test_what_was_tracked_before_a_spoiled_image_is_kept(
    tmp_path, recording, quickly, spoil, words
):
    images = copied(recording, tmp_path)
    spoil(str(tmp_path / "left" / "000006.png"))
    bad(quickly(TRACK.format(out=tmp_path / "out") + images, recording[0]), *words)
    assert len(rows(tmp_path / "out" / "poses.csv")) == 6
    assert len(numbers(tmp_path / "out" / "poses.tum")) == 6


def test_a_motion_that_ends_too_early_keeps_what_was_tracked(tmp_path, recording, quickly):
    lines = (recording[0] / "rec/motion.tum").read_text().splitlines()
    (tmp_path / "short.tum").write_text("\n".join(lines[:5]))
    finished = quickly(
        TRACK.format(out=tmp_path / "out") + BOTH + f"--motion {tmp_path / 'short.tum'}",
        recording[0],
    )
    bad(finished, "frame 4", "4 lines only", "one line a frame")
    assert len(rows(tmp_path / "out" / "poses.csv")) == 4


def test_an_interrupt_keeps_what_was_tracked(tmp_path, recording):
    """Interrupted as soon as the first overlay picture is there."""
    images = copied(recording, tmp_path)
    for side in ("right", "left"):  # enough for the interrupt to come before the end
        for k in range(10, 400):
            (tmp_path / side / f"{k:06d}.png").symlink_to(tmp_path / side / f"{k % 10:06d}.png")
    words = TRACK.format(out=tmp_path / "out") + images + "--overlay"
    process = subprocess.Popen(
        [sys.executable, "-m", "mffdrake", *words.split()],
        cwd=recording[0], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while process.poll() is None and not (tmp_path / "out/overlay/000003.png").exists():
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert 3 <= len(rows(tmp_path / "out" / "poses.csv")) < 400
