"""Files appear whole or not at all, and trouble shows before any long work."""

import os
import subprocess
import sys

import pytest

from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile


def content(folder):
    """Every file in a folder by name, hidden ones too."""
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_a_file_is_there_when_all_of_it_is_written(tmp_path):
    with WholeFile(tmp_path / "a.txt") as part:
        part.write_text("first ")
        assert not (tmp_path / "a.txt").exists()
        with part.open("a") as file:
            file.write("second")
    assert content(tmp_path) == {"a.txt": "first second"}


def test_an_old_file_stays_until_the_new_one_is_whole(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with WholeFile(tmp_path / "a.txt") as part:
        part.write_text("new")
        assert (tmp_path / "a.txt").read_text() == "old"
    assert content(tmp_path) == {"a.txt": "new"}


@pytest.mark.parametrize("trouble", [ValueError, OSError, KeyboardInterrupt, SystemExit])
def test_after_trouble_the_old_file_is_as_it_was_and_nothing_else_is_left(tmp_path, trouble):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(trouble), WholeFile(tmp_path / "a.txt") as part:
        part.write_text("half of the n")
        raise trouble
    assert content(tmp_path) == {"a.txt": "old"}


def test_after_trouble_with_a_new_file_nothing_is_left(tmp_path):
    with pytest.raises(ZeroDivisionError), WholeFile(tmp_path / "a.txt") as part:
        part.write_text("half")
        raise ZeroDivisionError
    assert content(tmp_path) == {}


def test_the_temporary_name_has_the_same_suffix_in_the_same_folder_and_is_hidden(tmp_path):
    with WholeFile(tmp_path / "picture.svg") as part:
        assert part.suffix == ".svg"  # Writers choose the format by it.
        assert part.parent == tmp_path  # A file moves at once only within a file system.
        assert part.name.startswith(".")


def test_two_writers_of_one_file_do_not_mix(tmp_path):
    with WholeFile(tmp_path / "a.txt") as first, WholeFile(tmp_path / "a.txt") as second:
        first.write_text("1")
        second.write_text("2")
    assert content(tmp_path) == {"a.txt": "1"}  # The one that ended last.


@pytest.mark.parametrize("umask", [0o022, 0o027, 0o077])
def test_permissions_follow_the_umask(tmp_path, umask):
    before = os.umask(umask)
    try:
        with WholeFile(tmp_path / "a.txt") as part:
            part.write_text("a")
        (tmp_path / "usual.txt").write_text("b")
    finally:
        after = os.umask(before)
    assert after == umask
    usual = (tmp_path / "usual.txt").stat().st_mode
    assert (tmp_path / "a.txt").stat().st_mode == usual


@pytest.mark.parametrize("path", ["missing/a.txt", "file/a.txt"])
def test_a_folder_that_is_missing_or_a_file_is_an_error(tmp_path, path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(OSError) as error, WholeFile(tmp_path / path) as part:
        part.write_text("never")
    assert str((tmp_path / path).parent) in str(error.value)
    assert content(tmp_path) == {"file": "not a folder"}


def test_a_folder_in_the_files_place_is_an_error_and_stays(tmp_path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(OSError), WholeFile(tmp_path / "a.txt") as part:
        part.write_text("a")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_an_output_folder_is_made_with_its_parents_and_left_empty(tmp_path):
    folder = MakeOutputFolder(tmp_path / "a" / "b")
    assert folder == tmp_path / "a" / "b"
    assert list(folder.iterdir()) == []


def test_an_output_folder_that_is_there_keeps_what_it_has(tmp_path):
    (tmp_path / "a.txt").write_text("a")
    assert MakeOutputFolder(str(tmp_path)) == tmp_path
    assert content(tmp_path) == {"a.txt": "a"}


@pytest.mark.parametrize("path", ["file", "file/below"])
def test_an_output_folder_that_is_a_file_is_an_error_that_names_it(tmp_path, path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(OSError) as error:
        MakeOutputFolder(tmp_path / path)
    assert str(tmp_path / "file") in str(error.value)
    assert content(tmp_path) == {"file": "not a folder"}


def test_an_output_folder_where_nobody_can_write_is_an_error():
    with pytest.raises(OSError):
        MakeOutputFolder("/proc/mffdrake")  # Not even root can.
    with pytest.raises(OSError):
        MakeOutputFolder("/proc")


WRITES = """
import sys, time
from mffdrake.recognition.recordings.files import WholeFile
with WholeFile(sys.argv[1]) as part:
    part.write_text("half")
    print("begun", flush=True)
    time.sleep(1000)
"""


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_writes_is_not(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / ".hidden").write_text("somebody's")
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", WRITES, tmp_path / name], stdout=subprocess.PIPE, text=True
        )
        for name in ("a.txt", "inside/b.npz", "c.txt")
    ]
    try:
        for process in processes:
            assert process.stdout.readline() == "begun\n"
        for process in processes[:2]:
            process.kill()
            process.wait()
        assert len([*tmp_path.rglob(".*.part.*")]) == 3
        MakeOutputFolder(tmp_path)
        (living,) = tmp_path.rglob(".*.part.*")
        assert living.name.startswith(".c-") and living.read_text() == "half"
        assert (tmp_path / ".hidden").exists()
    finally:
        for process in processes:
            process.kill()
            process.communicate()
