"""Looking on: live in Meshcat, in a replay, and in a video."""

import csv
import re
import shlex

import cv2
import numpy as np
import pytest
from pydrake.geometry import Meshcat

from mffdrake.experiment.commands.main import main
from mffdrake.experiment.commands.one import SimulateOne
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult

TEXT = "{duration: 0.4, renderer: flat, camera: {width: 160, height: 120}}"
ARRAYS = ("time", "true_pose", "recognized_pose", "fitness", "joint_positions", "confidence")


def read_video(path):
    video, frames = cv2.VideoCapture(str(path)), []
    while (read := video.read())[0]:
        frames.append(read[1])
    return frames, video.get(cv2.CAP_PROP_FPS)


def assert_same(one, other):
    for name in ARRAYS:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@pytest.fixture(scope="module")
def alone():
    return Simulate(LoadScenario(text=TEXT))


def test_a_run_that_is_shown_recorded_and_filmed_is_the_same_to_the_last_bit(tmp_path, alone):
    meshcat = Meshcat()
    one = SimulateOne(
        LoadScenario(text=TEXT), meshcat=meshcat,
        replay=str(tmp_path / "a.html"), video=str(tmp_path / "a.mp4"),
    )  # fmt: skip
    assert_same(one.result, alone)
    assert meshcat.HasPath("hypotheses/0") and meshcat.HasPath("cameras/left")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<html" in page[:500]
    assert meshcat.GetSliderValue("= fitness") == pytest.approx(alone.fitness[-1], abs=1e-3)


@pytest.mark.parametrize("command", ["run", "servo"])
def test_the_video_has_every_frame_with_a_strip_below(tmp_path, command):
    path = tmp_path / "film" / "a.mp4"
    status = main(
        [command, "--scenario-text", TEXT, "--out", str(tmp_path / "out"), "--video", str(path)]
    )
    assert status == 0
    result = SimulationResult.Load(tmp_path / "out" / "result.npz")
    frames, rate = read_video(path)
    assert len(frames) == len(result.time) == 13
    assert rate == pytest.approx(1.0 / 0.033, abs=0.01)
    assert {frame.shape for frame in frames} == {(128, 320, 3)}
    assert all(np.ptp(frame[122:, 40:]) > 50 for frame in frames)  # what is written there
    assert np.abs(frames[0].astype(float) - frames[-1]).max() > 50  # It moves.
    picture = cv2.imread(str(tmp_path / "out" / "camera.png"))  # The last frame, as it is.
    assert np.abs(frames[-1].astype(float) - picture).mean() < 8.0


@pytest.mark.parametrize("name", ["a.avi", "mp4"])
def test_a_video_of_another_kind_is_an_error_before_any_work(tmp_path, capsys, name):
    path = tmp_path / name
    assert main(["run", "--video", str(path), "--out", str(tmp_path / "out")]) == 2
    assert f"--video {path}: the file must end in .mp4" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


class VisitedPage(Meshcat):
    """A page on which somebody clicks reset after the fifth frame."""

    told = 0

    def SetSliderValue(self, name, value):
        super().SetSliderValue(name, value)
        self.told += name == "= fitness"
        if self.told == 5 and name == "= fitness":
            self._InjectWebsocketMessage(b"\x82\xa4type\xa6button\xa4name\xa5reset")


def test_reset_begins_anew_and_the_record_is_that_of_a_whole_run(tmp_path, alone):
    page = VisitedPage()
    video = tmp_path / "a.mp4"
    one = SimulateOne(LoadScenario(text=TEXT), meshcat=page, video=str(video))
    assert page.told == 5 + len(alone.time)
    assert page.GetButtonClicks("reset") == 0
    assert_same(one.result, alone)
    assert len(read_video(video)[0]) == len(alone.time)


def test_run_says_where_the_page_is(tmp_path, capsys):
    arguments = ["run", "--meshcat", "--scenario-text", TEXT, "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert re.search(r"^Meshcat: http://localhost:\d+$", capsys.readouterr().out, re.MULTILINE)


def test_track_is_shown_and_finds_the_same(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["record", "--scenario-text", TEXT, "--out", "rec"]) == 0
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.startswith("mffdrake track")]
    command = shlex.split(line)[1:]
    found = {}
    for name, more in (("alone", []), ("shown", ["--meshcat"])):
        assert main([*command, *more, "--out", name]) == 0
        assert ("Meshcat: http://" in capsys.readouterr().out) == bool(more)
        with (tmp_path / name / "poses.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        found[name] = [{k: v for k, v in row.items() if k != "ms"} for row in rows]
    assert found["alone"] == found["shown"] and len(found["alone"]) == 13
