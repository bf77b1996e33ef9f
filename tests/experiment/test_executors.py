"""Many runs of a function: in this process, on local processes, on a Dask cluster."""

import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest
import worker_functions as work

from mffdrake.experiment.runs.executors.cluster import ClusterError, DaskCluster
from mffdrake.experiment.runs.executors.executors import InProcess, Outcome, WorkerDiedError
from mffdrake.experiment.runs.executors.local_processes import MAX_ATTEMPTS, LocalProcesses


@pytest.fixture(params=["in_process", "one_process", "two_processes", "dask"])
def executor(request):
    if request.param == "dask":
        cluster = request.getfixturevalue("cluster")
        cluster.add_worker()
        cluster.add_worker(threads=2)
        return DaskCluster(cluster.address)
    return {
        "in_process": InProcess(),
        "one_process": LocalProcesses(1),
        "two_processes": LocalProcesses(2),
    }[request.param]


def run(executor, function, arguments):
    """All outcomes, in the order of the arguments."""
    with executor:
        outcomes = list(executor.Run(function, arguments))
    assert sorted(outcome.index for outcome in outcomes) == list(range(len(arguments)))
    return sorted(outcomes, key=lambda outcome: outcome.index)


# Every executor.


def test_every_run_has_its_outcome(executor):
    outcomes = run(executor, work.square, [(k,) for k in range(7)])
    assert [outcome.value for outcome in outcomes] == [0, 1, 4, 9, 16, 25, 36]
    assert all(outcome.error is None and outcome.attempts == 1 for outcome in outcomes)


def test_a_run_that_raises_is_an_outcome_and_the_others_go_on(executor):
    outcomes = run(executor, work.fail_at, [(k, 1) for k in range(3)])
    assert [outcome.value for outcome in outcomes] == [0, None, 2]
    assert outcomes[1].error == "ValueError: 1 is bad"
    assert isinstance(outcomes[1].exception, ValueError)
    assert str(outcomes[1].exception) == "1 is\nbad"


def test_no_arguments_make_no_outcomes(executor):
    assert run(executor, work.square, []) == []


def test_an_executor_can_be_used_again(executor):
    for _ in range(2):
        assert [o.value for o in run(executor, work.square, [(2,), (3,)])] == [4, 9]


# Local processes.


def test_an_outcomes_error_is_one_line_with_the_kind():
    assert Outcome(index=0, exception=KeyError()).error == "KeyError"
    assert Outcome(index=0, exception=OSError("no\n  room")).error == "OSError: no room"


@pytest.mark.parametrize("workers", [0, -1])
def test_the_number_of_workers_must_be_positive(workers):
    with pytest.raises(ValueError, match=f"workers must be at least 1, not {workers}"):
        LocalProcesses(workers)


def test_runs_are_spread_over_the_workers(tmp_path):
    """Each run waits until both have begun."""

    def let_go():
        work.wait_for(lambda: work.begun(tmp_path, "a") and work.begun(tmp_path, "b"), "both")
        (tmp_path / "go").touch()

    with threads(let_go):
        run(LocalProcesses(2), work.begin_and_wait, [(tmp_path, "a"), (tmp_path, "b")])
    pids = {*work.begun(tmp_path, "a"), *work.begun(tmp_path, "b")}
    assert len(pids) == 2 and os.getpid() not in pids


class threads:
    """Runs functions beside the body of a with statement, and passes their errors on."""

    def __init__(self, *functions):
        self._errors = []
        self._threads = [threading.Thread(target=self._run, args=(f,)) for f in functions]

    def _run(self, function):
        try:
            function()
        except BaseException as error:
            self._errors.append(error)

    def __enter__(self):
        for thread in self._threads:
            thread.start()

    def __exit__(self, *_):
        for thread in self._threads:
            thread.join()
        assert self._errors == []


def kill_first_then_let_go(folder, name):
    """Kills the process that begins a run, and lets all runs end when it has begun again."""

    def kill():
        (pid,) = work.wait_for(lambda: work.begun(folder, name), f"{name} to begin")
        os.kill(pid, signal.SIGKILL)
        work.wait_for(lambda: len(work.begun(folder, name)) == 2, f"{name} to begin again")
        (folder / "go").touch()

    return kill


def test_the_run_of_a_killed_worker_is_begun_again_and_the_others_do_not_notice(tmp_path):
    arguments = [(tmp_path, "a"), (tmp_path, "b"), (tmp_path, "c"), (tmp_path, "d")]
    with threads(kill_first_then_let_go(tmp_path, "a")):
        outcomes = run(LocalProcesses(2), work.begin_and_wait, arguments)
    assert [outcome.value for outcome in outcomes] == ["a", "b", "c", "d"]
    assert [outcome.attempts for outcome in outcomes] == [2, 1, 1, 1]
    for name in "bcd":
        assert len(work.begun(tmp_path, name)) == 1


def test_a_run_whose_worker_dies_every_time_fails_and_the_others_do_not():
    outcomes = run(LocalProcesses(2), work.die_at, [(k, 1) for k in range(4)])
    assert [outcome.value for outcome in outcomes] == [0, None, 2, 3]
    assert [outcome.attempts for outcome in outcomes] == [1, MAX_ATTEMPTS, 1, 1]
    assert isinstance(outcomes[1].exception, WorkerDiedError)
    assert "died at each of 3 attempts" in outcomes[1].error


def test_a_worker_that_dies_between_two_runs_costs_none():
    executor = LocalProcesses(1)
    with executor:
        (first,) = executor.Run(work.process_id, [(0,)])
        os.kill(first.value, signal.SIGKILL)
        work.wait_for(lambda: not psutil.pid_exists(first.value), "its end")
        (second,) = executor.Run(work.process_id, [(0,)])
    assert second.value != first.value
    assert second.error is None


@pytest.mark.skipif(sys.platform != "linux", reason="has no server that starts workers elsewhere")
def test_when_the_server_that_starts_workers_dies_another_is_started():
    with LocalProcesses(1) as executor:
        (first,) = executor.Run(work.process_id, [(0,)])
        server = psutil.Process(first.value).parent()
        assert server.ppid() == os.getpid()
        server.kill()  # It may not have ended yet when the next workers are asked for.
        outcomes = list(executor.Run(work.process_id, [(0,)]))
        with LocalProcesses(1) as another:
            outcomes += another.Run(work.process_id, [(0,)])
    assert [outcome.error for outcome in outcomes] == [None, None]
    assert outcomes[-1].value != first.value


def test_no_process_is_left_when_the_runs_are_not_waited_for(tmp_path):
    executor = LocalProcesses(2)
    with executor:
        runs = executor.Run(work.begin_and_wait, [(tmp_path, "a"), (tmp_path, "b")])
        with threads(lambda: next(runs)):
            work.wait_for(lambda: work.begun(tmp_path, "b"), "b to begin")
            pids = [*work.begun(tmp_path, "a"), *work.begun(tmp_path, "b")]
            (tmp_path / "go").touch()
    assert multiprocessing.active_children() == []
    assert pids and not any(psutil.pid_exists(pid) for pid in pids)


SCRIPT = """
import sys
from pathlib import Path
sys.path.append({folder!r})
import worker_functions as work
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses

if {guard}:
    try:
        with LocalProcesses(2) as executor:
            for outcome in executor.Run(work.begin_and_wait, [({tmp!r}, "a"), ({tmp!r}, "b")]):
                print(outcome)
    except KeyboardInterrupt:
        sys.exit(130)
"""


def script(tmp_path, guard="__name__ == '__main__'"):
    path = tmp_path / "script.py"
    folder = str(Path(work.__file__).parent)
    path.write_text(SCRIPT.format(folder=folder, tmp=str(tmp_path), guard=guard))
    return [sys.executable, str(path)]


@pytest.mark.parametrize(("number", "status"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_workers_end_with_the_process_that_started_them(number, status, tmp_path):
    with subprocess.Popen(script(tmp_path), stderr=subprocess.PIPE, text=True) as process:
        pids = [work.wait_for(lambda n=n: work.begun(tmp_path, n), n)[0] for n in "ab"]
        process.send_signal(number)
        assert process.wait() == status
        work.wait_for(lambda: not any(psutil.pid_exists(pid) for pid in pids), "their end")
        assert "Traceback" not in process.stderr.read()


INTERRUPTED_EARLY = """
import os, signal, threading, time
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses

def interrupt_after(seconds):
    # From a thread that does not get it itself: so it is for the main one.
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    timer.start()
    signal.pthread_sigmask(signal.SIG_SETMASK, before)

if __name__ == "__main__":
    with LocalProcesses(1) as executor:  # starts the server
        list(executor.Run(divmod, [(7, 2)]))
    for ms in range(1, 31, 2):
        try:
            with LocalProcesses(2) as executor:
                interrupt_after(1e-3 * ms)
                list(executor.Run(time.sleep, [(20,), (20,)]))
        except KeyboardInterrupt:
            pass
"""


def test_workers_that_are_ended_before_they_have_begun_say_nothing(tmp_path):
    path = tmp_path / "script.py"
    path.write_text(INTERRUPTED_EARLY)
    finished = subprocess.run([sys.executable, str(path)], capture_output=True, text=True)
    assert (finished.returncode, finished.stderr) == (0, "")


def test_ctrl_c_on_a_terminal_is_for_the_parent_alone(tmp_path):
    """A terminal sends it to all processes of the group."""
    with subprocess.Popen(
        script(tmp_path), stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        for name in "ab":
            work.wait_for(lambda n=name: work.begun(tmp_path, n), name)
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait() == 130
        assert process.stderr.read() == ""


def test_a_script_without_a_guard_is_told_so(tmp_path):
    finished = subprocess.run(script(tmp_path, guard="True"), capture_output=True, text=True)
    assert finished.returncode == 1
    assert "must stand below: if __name__ == '__main__':" in finished.stderr.splitlines()[-1]


def test_several_workers_ask_libraries_for_one_thread_each(monkeypatch):
    for name in ("LP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    names = [("LP_NUM_THREADS",), ("NUMBA_NUM_THREADS",)]
    assert [o.value for o in run(LocalProcesses(2), work.environment, names)] == ["1", "1"]
    assert [o.value for o in run(LocalProcesses(1), work.environment, names)] == [None, None]


def test_workers_log_like_the_parent():
    logger = logging.getLogger("mffdrake")
    before = logger.level
    try:
        for level in (logging.ERROR, logging.DEBUG):
            logger.setLevel(level)
            (outcome,) = run(LocalProcesses(1), work.log_level, [()])
            assert outcome.value == level
    finally:
        logger.setLevel(before)


# A Dask cluster.


def test_the_run_of_a_killed_dask_worker_is_begun_again(cluster, tmp_path):
    for _ in range(3):  # One ends, one waits for the others, one takes over.
        cluster.add_worker()
    with threads(kill_first_then_let_go(tmp_path, "a")):
        outcomes = run(
            DaskCluster(cluster.address), work.begin_and_wait, [(tmp_path, "a"), (tmp_path, "b")]
        )
    assert [outcome.value for outcome in outcomes] == ["a", "b"]


def test_a_run_whose_dask_worker_dies_every_time_fails(cluster):
    for _ in range(3):
        cluster.add_worker()
    outcomes = run(DaskCluster(cluster.address), work.die_at, [(k, 0) for k in range(3)])
    assert isinstance(outcomes[0].exception, WorkerDiedError)
    assert outcomes[0].attempts == 2  # The fixture's scheduler allows one failure.
    assert "died at each of 2 attempts" in outcomes[0].error


def test_thousands_of_runs_come_back_from_a_cluster(cluster):
    """They are sent in several portions."""
    cluster.add_worker()
    outcomes = run(DaskCluster(cluster.address), divmod, [(k, 7) for k in range(2600)])
    assert sorted(outcome.index for outcome in outcomes) == list(range(2600))
    assert all(outcome.value == divmod(outcome.index, 7) for outcome in outcomes)


def test_a_cluster_without_workers_says_so_and_goes_on_when_some_join(cluster, caplog):
    def join():
        work.wait_for(lambda: "has no workers" in caplog.text, "the warning")
        cluster.add_worker()

    with threads(join):
        outcomes = run(DaskCluster(cluster.address), divmod, [(7, 2)])
    assert [outcome.value for outcome in outcomes] == [(3, 1)]
    assert caplog.text.count("has no workers") == 1
    assert f"dask worker {cluster.address}" in caplog.text


def test_a_scheduler_that_goes_away_is_an_error(cluster, tmp_path):
    cluster.add_worker()

    def kill():
        work.wait_for(lambda: work.begun(tmp_path, "a"), "a to begin")
        cluster.scheduler.kill()

    with threads(kill), pytest.raises(ClusterError, match=f"{cluster.address}' is gone"):
        run(DaskCluster(cluster.address), work.begin_and_wait, [(tmp_path, "a")])


def test_a_wrong_address_is_an_error_that_shows_a_right_one():
    with pytest.raises(ClusterError, match="'xyz://1.2.3.4'.*such as tcp://127.0.0.1:8786"):
        DaskCluster("xyz://1.2.3.4").__enter__()


def test_without_the_package_the_error_has_the_command_that_helps(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"pip install 'mffdrake\[cluster\]'"):
        DaskCluster("tcp://127.0.0.1:1").__enter__()
