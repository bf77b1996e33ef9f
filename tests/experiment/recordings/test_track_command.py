"""What track makes of its options: sources, times, seeds, colors; and what it cannot use."""

import csv
import json
import shlex

import cv2
import numpy as np
import pytest
import yaml

from mffdrake.recognition.recordings.trajectory import LoadTrajectory

SEARCH = "track --rig rec/rig.yaml --target rec/target.obj "
TRACK = SEARCH + "--start rec/start.tum "
FOLDERS = "--images right=rec/images/right left=rec/images/left "


def rows(folder):
    with open(folder / "poses.csv", newline="") as file:
        return list(csv.DictReader(file))


def column(folder, name):
    return [float(row[name]) for row in rows(folder)]


def without_ms(folder):
    return [{key: value for key, value in row.items() if key != "ms"} for row in rows(folder)]


@pytest.fixture
def track(recording, quickly, tmp_path, caplog):
    """Tracks the recording near its start; returns the folder with what was written."""

    def track_here(options, name="out"):
        finished = quickly(f"{TRACK} {options} --out {tmp_path / name}", recording[0])
        assert finished.returncode == 0, finished.stderr
        assert (finished.stderr, caplog.text) == ("", "")
        return tmp_path / name

    return track_here


def position_errors(recording, folder):
    """Distances from the true positions [m], by the frames' numbers."""
    true = LoadTrajectory(recording[0] / "rec/true_poses.tum").poses[:, :3]
    return [
        float(np.linalg.norm([float(row[c]) for c in "xyz"] - true[int(row["frame"])]))
        for row in rows(folder)
    ]


# Where images come from


def test_a_pattern_is_as_good_as_a_folder(track):
    folder = track(FOLDERS, "folders")
    pattern = track("--images 'right=rec/images/right/*.png' 'left=rec/**/left/0*.png'", "pattern")
    assert without_ms(pattern) == without_ms(folder)
    assert (pattern / "poses.tum").read_bytes() == (folder / "poses.tum").read_bytes()


def test_videos_and_a_folder(recording, track, tmp_path):
    """Lossy ones: the poses are not the same, but as right."""
    video = cv2.VideoWriter(
        str(tmp_path / "right.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (320, 240)
    )
    for path in sorted((recording[0] / "rec/images/right").iterdir()):
        video.write(cv2.imread(str(path)))
    video.release()
    images = f"--images right={tmp_path / 'right.avi'} left=rec/images/left"
    folder = track(f"{images} --motion rec/motion.tum --recognizer '{{refinement: borders}}'")
    assert column(folder, "frame") == list(range(10))
    assert max(position_errors(recording, folder)[5:]) < 0.005


# Which frames, and when


def test_times_come_from_the_rate_without_a_motion(track):
    folder = track(f"{FOLDERS} --rate 20 --stride 3")
    assert column(folder, "frame") == [0.0, 3.0, 6.0, 9.0]
    np.testing.assert_allclose(column(folder, "time"), [0.0, 0.15, 0.3, 0.45])
    assert json.loads((folder / "track.json").read_text())["frames"] == 4


def test_times_come_from_the_motion_where_there_is_one(recording, track):
    folder = track(f"{FOLDERS} --rate 20 --stride 3 --motion rec/motion.tum")
    times = LoadTrajectory(recording[0] / "rec/motion.tum").times[::3]
    np.testing.assert_array_equal(column(folder, "time"), times)
    np.testing.assert_array_equal(LoadTrajectory(folder / "poses.tum").times, times)


# What a run depends on


def test_a_seed_tells_all_and_another_tells_another(track):
    first, again, other = (
        track(f"{FOLDERS} --seed {seed}", name) for seed, name in ((1, "a"), (1, "b"), (2, "c"))
    )
    assert without_ms(first) == without_ms(again)
    assert without_ms(first) != without_ms(other)


def test_the_recognizer_s_keys_come_as_text_or_in_a_file(track, tmp_path):
    text = "{refinement: borders, population_size: 20, coding: gray}"
    (tmp_path / "keys.yaml").write_text(text)
    given = track(f"{FOLDERS} --recognizer '{text}'", "text")
    read = track(f"{FOLDERS} --recognizer {tmp_path / 'keys.yaml'}", "file")
    usual = track(FOLDERS, "usual")
    assert without_ms(given) == without_ms(read) != without_ms(usual)


def test_other_colors_find_another_fitness(recording, track, tmp_path):
    """The mesh's hues, and hues that nothing in the images has."""
    fitness = {}
    for turn in (0.0, 60.0):
        hues = {"blue": 240.0 + turn, "green": 120.0 + turn, "red": turn}
        keys = {name: {"hue_deg": hue, "tolerance_deg": 15.0} for name, hue in hues.items()}
        (tmp_path / "colors.yaml").write_text(yaml.safe_dump({"colors": keys}))
        folder = track(f"{FOLDERS} --motion rec/motion.tum --colors {tmp_path / 'colors.yaml'}")
        fitness[turn] = column(folder, "fitness")[-1]
    assert fitness[0.0] > 0.8
    assert fitness[60.0] == 0.0


def test_a_search_on_the_first_frame_and_tracking_from_there(recording, quickly, tmp_path):
    finished = quickly(
        f"{SEARCH} {FOLDERS} --motion rec/motion.tum "
        f"--generations 200 --recognizer '{{refinement: borders}}' --out {tmp_path}",
        recording[0],
    )
    assert finished.returncode == 0, finished.stderr
    assert len(rows(tmp_path)) == 10
    assert max(position_errors(recording, tmp_path)) < 0.005  # from the first frame on
    data = json.loads((tmp_path / "track.json").read_text())
    assert 1 <= data["search"]["generations"] <= 200
    assert data["settings"]["generations"] == 200


def test_a_search_range_that_nobody_sees_is_warned_of(recording, quickly, tmp_path, caplog):
    finished = quickly(
        f"{SEARCH} {FOLDERS} --out {tmp_path} --recognizer '{{search_range: {{z: [-0.9, -0.6]}}}}'",
        recording[0],
    )
    assert finished.returncode == 0
    record = caplog.records[0]
    assert record.levelname == "WARNING"
    assert "no camera looks toward the middle of the search range" in record.getMessage()
    assert all("does not see the recognized pose" in r.getMessage() for r in caplog.records[1:])


def test_without_any_keys_the_target_is_found_anywhere_in_view(recording, quickly, tmp_path):
    finished = quickly(
        f"{SEARCH} {FOLDERS} --motion rec/motion.tum --out {tmp_path}",
        recording[0],
    )
    assert finished.returncode == 0, finished.stderr
    assert "refined, give or take" in finished.stdout
    relied = sum(column(tmp_path, "is_tracking"))
    assert f"Relied on (is_tracking) in {relied:.0f} of 10 frames." in finished.stdout
    assert max(position_errors(recording, tmp_path)) < 0.005
    assert column(tmp_path, "is_tracking")[-1] == 1.0


def test_a_camera_that_is_placed_wrongly_is_warned_of(recording, quickly, tmp_path, caplog):
    """Turned the other way around, it does not see where the other one sees the target."""
    rig = yaml.safe_load((recording[0] / "rec/rig.yaml").read_text())
    rig["cameras"]["left"]["X_CK"]["rotation"] = {"_tag": "!Rpy", "deg": [0.0, 70.0, 0.0]}
    text = yaml.safe_dump(rig).replace("_tag: '!Rpy'", "").replace("rotation:", "rotation: !Rpy")
    (tmp_path / "rig.yaml").write_text(text)
    finished = quickly(
        f"{TRACK} {FOLDERS} --motion rec/motion.tum --rig {tmp_path}/rig.yaml --out {tmp_path}",
        recording[0],
    )
    assert finished.returncode == 0, finished.stderr
    assert "' does not see the recognized pose in " in caplog.text  # whichever it goes by
    assert "X_CK" in caplog.text


def test_why_a_pose_is_not_refined_is_told(recording, quickly, tmp_path):
    rig = yaml.safe_load((recording[0] / "rec/rig.yaml").read_text())
    for camera in rig["cameras"].values():
        camera["calibration_error"] = 3.0
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    track = f"{TRACK} {FOLDERS} --motion rec/motion.tum --out {tmp_path}"
    for options, words in (
        (f"--rig {tmp_path}/rig.yaml", ["too uncertain; the cameras may be off by 3 px"]),
        ("--recognizer '{refinement: none}'", ["is_tracking tells of a high fitness alone"]),
    ):
        finished = quickly(f"{track} {options}", recording[0])
        assert finished.returncode == 0, finished.stderr
        for word in ["not refined: ", *words]:
            assert word in finished.stdout


def test_a_search_that_has_not_converged_says_so(recording, quickly, tmp_path):
    finished = quickly(
        f"{SEARCH} {FOLDERS} --generations 3 --out {tmp_path}",
        recording[0],
    )
    assert finished.returncode == 0, finished.stderr
    assert "3 generations in 1 rounds, not converged: more --generations" in finished.stdout


# A recording over another


def test_a_shorter_recording_replaces_a_longer_one_wholly(quickly, make_recording, tmp_path):
    for duration, count in ((0.2, 7), (0.1, 4)):
        text = f"{{camera: {{width: 160, height: 120}}, duration: {duration}}}"
        command = make_recording(tmp_path, text=text, run=quickly)
        images = [len(list((tmp_path / "rec/images" / s).iterdir())) for s in ("right", "left")]
        assert images == [count, count]
    finished = quickly(command.removeprefix("mffdrake "), tmp_path)
    assert finished.returncode == 0, finished.stderr
    assert len(rows(tmp_path / "rec/tracked")) == 4


# What cannot be used


def assert_one_line(finished, *words):
    """Status 2 and one line that says what is wrong."""
    assert finished.returncode == 2, finished.stderr
    (line,) = finished.stderr.splitlines()
    assert line.startswith("mffdrake")
    for word in words:
        assert word in line, line


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (f"{FOLDERS} right=rec/images/right", ["--images right=", "camera 'right' stands there"]),
        (
            f"{FOLDERS} --recognizer keys.yaml",
            ["--recognizer keys.yaml: no such file, and no YAML"],
        ),
        (f"{FOLDERS} --recognizer '{{refinement: x}}'", ["recognizer.refinement must be one of"]),
        (f"{FOLDERS} --recognizer '{{bits: [}}'", ["not YAML"]),
        (f"{FOLDERS} --generations 5", ["--generations searches from nothing: leave --start out"]),
        (
            f"{FOLDERS} --recognizer '{{search_range: {{z: [0.1, 0.2]}}}}'",
            ["--start rec/start.tum: z = ", "outside the search range [0.1, 0.2]; widen it"],
        ),
        (f"{FOLDERS} --generations -1", ["--generations", "positive whole number, not '-1'"]),
        (f"{FOLDERS} --rate nan", ["--rate", "positive number, not 'nan'"]),
        (f"{FOLDERS} --seed -1", ["--seed", "from 0 on, not '-1'"]),
        (f"{FOLDERS} --out rec/rig.yaml", ["rec/rig.yaml", "is a file, not a directory"]),
        ("--images 'right=rec/*.png' left=rec/images/left", ["rec/*.png: no such folder"]),
        ("--images right=rec/rig.yaml left=rec/rig.yaml", ["rec/rig.yaml: not an image"]),
    ],
)
def test_options_that_cannot_be_used_are_named(recording, quickly, tmp_path, options, words):
    finished = quickly(f"{TRACK} --out {tmp_path / 'out'} {options}", recording[0])
    assert_one_line(finished, *words)
    assert not (tmp_path / "out" / "poses.csv").exists()


MESHES = {
    "garbage.obj": bytes(range(256)),
    "garbage.stl": bytes(range(256)),
    "garbage.gltf": b"hello",
    "garbage.zip": b"hello",
    "a.txt": b"hello",
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "number.obj": b"v a b c\nf 1 2 3\n",
    "bare.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
}


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_that_cannot_be_read_is_named(recording, quickly, tmp_path, name):
    (tmp_path / name).write_bytes(MESHES[name])
    options = f"--rig rec/rig.yaml --target {tmp_path / name} {FOLDERS}"
    finished = quickly(f"track {options} --out {tmp_path / 'out'}", recording[0])
    assert_one_line(finished, f"{tmp_path / name}: ")


def test_a_mesh_that_is_not_there_is_named(recording, quickly, tmp_path):
    for target in ("none.obj", "rec"):
        options = f"--rig rec/rig.yaml --target {target} {FOLDERS} --out {tmp_path}"
        assert_one_line(quickly(f"track {options}", recording[0]), target, "no such mesh file")


CALIBRATION = {
    "image_width": 320, "image_height": 240,
    "K": [290.0, 0.0, 159.5, 0.0, 290.0, 119.5, 0.0, 0.0, 1.0], "D": [0.0, 0.0, 0.0, 0.0, 0.0],
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"K": [290.0, 0.0, 159.5]}, ["calibration.yaml: K must be", "not 3"]),
        ({"D": [0.0, 0.0, 0.0]}, ["calibration.yaml: D must be 0 or 4 or 5 or 8", "not 3"]),
        ({"image_width": 640}, ["camera 'only'", "(240, 640, 3 or 4)", "(240, 320, 3)"]),
    ],
    ids=["3 numbers in K", "3 coefficients", "another size"],
)
def test_a_calibration_that_does_not_fit_is_named(recording, quickly, tmp_path, change, words):
    (tmp_path / "rig.yaml").write_text("cameras: {only: {calibration: calibration.yaml}}")
    for changes, status in (({}, 0), (change, 2)):
        (tmp_path / "calibration.yaml").write_text(yaml.safe_dump(CALIBRATION | changes))
        finished = quickly(
            f"track --rig {tmp_path / 'rig.yaml'} --target rec/target.obj "
            f"--images only=rec/images/right --out {tmp_path / 'out'}",
            recording[0],
        )
        assert finished.returncode == status, finished.stderr
    assert_one_line(finished, *words)


@pytest.mark.parametrize("option", ["--rig", "--colors", "--motion", "--start", "--recognizer"])
def test_a_file_that_is_no_text_is_named(recording, quickly, tmp_path, option):
    (tmp_path / "binary").write_bytes(b"\x89PNG\xff")
    words = [*shlex.split(TRACK + FOLDERS), option, str(tmp_path / "binary")]
    finished = quickly(shlex.join([*words, "--out", str(tmp_path / "out")]), recording[0])
    assert_one_line(finished, f"{tmp_path / 'binary'}: not a text file in UTF-8")


def test_a_file_of_keys_that_is_wrong_is_named_with_the_key(recording, quickly, tmp_path):
    (tmp_path / "keys.yaml").write_text("refinment: borders")
    options = f"{FOLDERS} --recognizer {tmp_path / 'keys.yaml'} --out {tmp_path / 'out'}"
    finished = quickly(f"{TRACK} {options}", recording[0])
    assert_one_line(finished, "keys.yaml: unknown key 'refinment'", "did you mean 'refinement'")


def test_a_video_that_ends_too_early_keeps_what_was_tracked(recording, quickly, tmp_path):
    """With a video of the overlay, which is whole or not there."""
    video = cv2.VideoWriter(
        str(tmp_path / "left.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (320, 240)
    )
    for k in range(3):
        video.write(cv2.imread(str(recording[0] / f"rec/images/left/{k:06d}.png")))
    video.release()
    images = f"--images right=rec/images/right left={tmp_path / 'left.avi'}"
    finished = quickly(f"{TRACK} {images} --overlay video --out {tmp_path / 'out'}", recording[0])
    assert_one_line(finished, "frame 3: no image of camera 'left'; its images end before")
    assert column(tmp_path / "out", "frame") == [0.0, 1.0, 2.0]
    assert len(LoadTrajectory(tmp_path / "out/poses.tum")) == 3
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"poses.csv", "poses.tum", "poses.png", "last_frame.png", "track.json"}


def test_the_status_and_the_line_of_a_real_process(recording, mffdrake, tmp_path):
    options = f"{FOLDERS} --motion none.tum --out {tmp_path / 'out'}"
    finished = mffdrake(f"{TRACK} {options}", recording[0])
    assert_one_line(finished, "cannot use none.tum: No such file or directory")
    assert finished.stdout == ""
