"""What the tests of recordings share: the command line as a real process, and a small recording."""

import os
import shlex
import subprocess
import sys
from typing import NamedTuple

import pytest

from mffdrake.experiment.commands.main import main
from mffdrake.experiment.progress import ProgressBar

NO_PROGRESS = {"TQDM_DISABLE": "1"}  # A busy machine would bring a line of it.


def run(command, cwd):
    """Runs a command of mffdrake with nobody watching; a text or a list of words."""
    words = shlex.split(command) if isinstance(command, str) else [str(word) for word in command]
    if words[0] == "mffdrake":
        words = words[1:]
    return subprocess.run(
        [sys.executable, "-m", "mffdrake", *words],
        cwd=cwd, env=os.environ | NO_PROGRESS, stdin=subprocess.DEVNULL, capture_output=True,
        text=True, check=False,
    )  # fmt: skip


@pytest.fixture(scope="session")
def mffdrake():
    return run


def record(folder, *options, text="{}", run=run):
    """Records a small scenario; returns the command that tracks it."""
    words = ["record", "--renderer", "flat", "--scenario-text", text, *options, "--out", "rec"]
    finished = run(shlex.join(map(str, words)), folder)
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr == ""
    return finished.stdout.splitlines()[1]


class Finished(NamedTuple):
    """How a command ended."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def quickly(monkeypatch, capfd):
    """Runs a command in this process, which spares the loading of Drake."""

    def run_here(command, cwd):
        monkeypatch.chdir(cwd)
        # Kernels that are compiled take time, and would bring a line of progress.
        monkeypatch.setitem(ProgressBar.__kwdefaults__, "interval", 3600.0)
        capfd.readouterr()
        try:
            status = main(shlex.split(command))
        except SystemExit as end:
            status = end.code
        return Finished(status, *capfd.readouterr())

    return run_here


@pytest.fixture(scope="session")
def make_recording():
    return record


@pytest.fixture(scope="session")
def recording(tmp_path_factory):
    """A short recording and the command that tracks it: (folder, command)."""
    folder = tmp_path_factory.mktemp("recording")
    text = (
        "{camera: {width: 320, height: 240}, duration: 0.3, seed: 3, hand_path: {omega: 0.314}, "
        "recognizer: {start: near_target, refinement: borders}}"
    )
    return folder, record(folder, text=text)
