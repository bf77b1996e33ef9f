"""A disk without room, for which a limit of the files' size stands in: what is said, and left."""

import resource
from contextlib import contextmanager

import numpy as np
import pytest

from mffdrake.experiment.commands.main import main
from mffdrake.experiment.runs.store import Record, RunStore, StoreError
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.recordings.overlay import MakeVideo


@contextmanager
def room_for(size):
    """Files cannot get larger than this [bytes]; Python ignores the signal that tells so."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_the_error_names_the_file_that_is_wanted_and_nothing_is_left(tmp_path):
    with room_for(1000), pytest.raises(OSError) as error, WholeFile(tmp_path / "a.txt") as part:
        part.write_bytes(b"a" * 10_000)
    assert error.value.filename == str(tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == []


def test_a_video_is_whole_or_an_error(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (20, 48, 64, 3), dtype=np.uint8)
    message = "cannot write a video to .*v.mp4: it is cut short; is the disk full?"
    with (
        room_for(1000),
        pytest.raises(OSError, match=message),
        MakeVideo(tmp_path / "v.mp4", 30.0) as add,
    ):
        for image in noise:
            add(image)
    assert list(tmp_path.iterdir()) == []


def test_a_store_without_room_keeps_what_it_has_and_says_why(tmp_path):
    store = RunStore(tmp_path / "runs.sqlite")
    store.Put("first", "", "", Record(row={"frames": 1}))
    size = (tmp_path / "runs.sqlite").stat().st_size
    message = r"runs.sqlite: cannot be used \((?!cannot rollback)"
    with room_for(size), pytest.raises(StoreError, match=message):
        store.Put("second", "", "", Record(row={"text": "long" * 100_000}))
    assert {key: one.row for key, one in store.Get(["first", "second"]).items()} == {
        "first": {"frames": 1}
    }
    store.Put("second", "", "", Record(row={"frames": 2}))
    assert len(store.Get(["first", "second"])) == 2


def test_a_command_without_room_ends_with_one_line_and_status_2(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    text = "camera: {width: 64, height: 48}"
    words = ["run", "--duration", "0.1", "--renderer", "flat", "--scenario-text", text]
    assert main([*words, "--out", "whole"]) == 0  # What is compiled is kept, which needs room.
    capfd.readouterr()
    with room_for(1000):
        assert main(words) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line == "mffdrake: error: cannot use out/result.npz: File too large"
    assert list((tmp_path / "out").iterdir()) == []
