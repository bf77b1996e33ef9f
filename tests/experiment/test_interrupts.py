"""Ctrl-C, SIGTERM and SIGHUP: when they interrupt, and what a command does then."""

import fcntl
import importlib
import os
import pty
import re
import signal
import subprocess
import sys
import termios
from pathlib import Path

import llvmlite.binding as llvm
import pytest
from worker_functions import wait_for

from mffdrake.experiment.interrupts import CollectInterrupts, Interrupted, SignalsInterrupt
from mffdrake.experiment.simulation.simulation import SimulationResult

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
named = pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)


@named
def test_a_signal_interrupts_and_has_a_shells_status(number):
    with pytest.raises(KeyboardInterrupt) as end, SignalsInterrupt() as received:
        signal.raise_signal(number)
    assert isinstance(end.value, Interrupted)
    assert (end.value.number, end.value.status, received) == (number, 128 + number, [number])


@named
def test_handlers_are_as_before_afterwards(number):
    before = signal.getsignal(number), signal.getsignal(signal.SIGALRM)
    with pytest.raises(Interrupted), SignalsInterrupt():
        signal.raise_signal(number)
    with SignalsInterrupt(), CollectInterrupts():
        pass
    assert (signal.getsignal(number), signal.getsignal(signal.SIGALRM)) == before


@named
def test_a_signal_that_is_ignored_stays_so(number):
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with SignalsInterrupt(), CollectInterrupts() as received:
            signal.raise_signal(number)
        assert received == []
    finally:
        signal.signal(number, before)


@named
def test_where_the_first_is_collected_the_second_interrupts(number):
    with SignalsInterrupt():
        with pytest.raises(Interrupted), CollectInterrupts() as received:
            signal.raise_signal(number)
            assert received == [number]
            signal.raise_signal(number)
        assert received == [number]


def code_machine():
    """A function for LLVM to make machine code of, as numba does."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly("define i32 @seven() {\n  ret i32 7\n}")
    machine = llvm.Target.from_default_triple().create_target_machine()
    return llvm.create_mcjit_compiler(module, machine)


def test_while_llvm_calls_back_a_signal_waits(capfd):
    """C++ drops exceptions of the function that it calls; numba then fails in odd ways."""
    done = []

    def notify(module, code):
        signal.raise_signal(signal.SIGINT)
        done.append(code)

    engine = code_machine()
    engine.set_object_cache(notify)
    with pytest.raises(Interrupted), SignalsInterrupt():
        engine.finalize_object()
        while True:  # It comes soon.
            pass
    assert len(done) == 1
    assert capfd.readouterr().err == ""


def test_a_signal_waits_for_the_end_of_a_finalizer(capfd):
    """Python drops its exceptions, too."""

    class Owner:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(Interrupted), SignalsInterrupt():
        Owner()
        while True:
            pass
    assert capfd.readouterr().err == ""


def test_a_signal_waits_for_the_end_of_an_import(tmp_path, monkeypatch):
    """Libraries that do without another one swallow whatever its import ends with."""
    (tmp_path / "does_without.py").write_text(
        "import signal\ntry:\n    signal.raise_signal(signal.SIGINT)\n    whole = True\n"
        "except BaseException:\n    whole = False\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    whole = None
    with pytest.raises(Interrupted), SignalsInterrupt():
        whole = importlib.import_module("does_without").whole
        while True:
            pass
    assert whole is True


EVERYWHERE = """
import sys
from mffdrake.recognition import CameraRig, PoseTracker
from synthetic import paper_box, pose, render

rig, box = CameraRig.stereo(width=160, height=120), paper_box()
images = render(box, pose([-0.08, 0.0, 0.6], [0.2, -0.3, 0.4]), rig)
interrupted = 0


def interrupt(count):
    def on_event(frame, event, arg):
        nonlocal count
        if event == "call":
            count -= 1
            if count == 0:
                raise KeyboardInterrupt
    return on_event


def is_told(error):
    while not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
        if error is None:
            return False
    return True


tracker = PoseTracker.of(rig, box, channel_order="rgb")
calls = [tracker.start, tracker.track]
for call in calls:
    call(images)  # compiles
for call in calls:
    count, ended = 1, False
    while not ended:
        sys.setprofile(interrupt(count))
        try:
            call(images)
            ended = True
        except BaseException as error:
            sys.setprofile(None)
            assert is_told(error), repr(error)
            interrupted += 1
        finally:
            sys.setprofile(None)
        count += 1 + count // 300
print(interrupted)
"""


def test_an_interrupt_ends_no_process_wherever_python_is_called_while_it_tracks():
    """Also from compiled functions, by numba, which looks at no errors there."""
    folder = Path(__file__).parents[1] / "recognition"
    finished = subprocess.run(
        [sys.executable, "-c", EVERYWHERE], env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert finished.returncode == 0, finished.stderr
    assert int(finished.stdout) > 300


# The command line.

LONG = ["--duration", "600", "--renderer", "flat", "--scenario-text",
        "camera: {width: 64, height: 48}"]  # fmt: skip


def start(command, folder, **streams):
    """A long simulation, which has begun."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mffdrake", command, *LONG, "--video", "video.mp4"],
        cwd=folder, env=os.environ | {"TQDM_DISABLE": "1"}, **streams,
    )  # fmt: skip

    def begun():
        assert process.poll() is None
        return list(folder.glob(".*.mp4"))  # Its frames are added as they come.

    wait_for(begun, "the video's first frame")
    return process


@pytest.mark.parametrize(("command", "number"), [("run", SIGNALS[1]), ("servo", SIGNALS[2])])
def test_sigterm_and_sighup_keep_the_first_frames(command, number, tmp_path):
    with start(
        command, tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        process.send_signal(number)
        errors = process.stderr.read()
    assert process.returncode == 128 + number
    (line,) = errors.splitlines()
    found = re.search(rf"interrupted by {number.name}: these are the first (\d+) frames", line)
    result = SimulationResult.Load(tmp_path / "out" / "result.npz")
    assert len(result.time) == int(found[1]) < 600 / 0.033
    assert (tmp_path / "video.mp4").exists()


def test_a_terminal_that_is_closed_keeps_the_first_frames_too(tmp_path):
    master, terminal = pty.openpty()
    process = start(
        "run", tmp_path, stdin=terminal, stdout=terminal, stderr=terminal, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )  # fmt: skip
    os.close(terminal)
    os.close(master)
    assert process.wait() == 128 + signal.SIGHUP
    assert len(SimulationResult.Load(tmp_path / "out" / "result.npz").time) > 0
