"""Runs a function many times on processes of this machine, which may die.

This module needs the standard library alone, so that the workers can be started while the rest is
still loading.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import multiprocessing.forkserver
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any

from mffdrake.experiment.runs.executors.executors import Outcome, WorkerDiedError

__all__ = ["MAX_ATTEMPTS", "LocalProcesses", "PrepareWorkers", "UsableCores"]

MAX_ATTEMPTS = 3
"""How often a run is begun at most, when its worker dies again and again."""

_NO_START = (
    "the worker processes end as soon as they start; in a script, what starts them must stand "
    "below: if __name__ == '__main__':"
)
_NO_SERVER = (
    "the process that starts the workers dies again and again, for lack of memory perhaps; what "
    "has ended is kept"
)
# s; how long to wait for its end, which takes a moment, before another is started
_PAUSES = (0.1, 0.4, 1.6, 6.4)
_STARTED = b"started"
_PRELOADED = [
    "mffdrake.experiment.simulation.simulation",
    "mffdrake.experiment.simulation.evaluation",
]
# Several workers are the parallelism: threads of each would only take turns on the same cores.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "LP_NUM_THREADS")


class LocalProcesses:
    """Runs on processes of this machine.

    A worker may die, of a signal or for lack of memory: its run is begun again by a new worker, up
    to `MAX_ATTEMPTS` times, and the other workers do not notice; so may the server that starts
    them, which costs each of them its run. Workers end with this process, however that ends.

    Args:
        workers: Number of processes; the number of usable cores by default.

    Raises:
        ValueError: When ``workers`` is not positive.

    Example:
        >>> with LocalProcesses(2) as executor:
        ...     sorted(outcome.value for outcome in executor.Run(divmod, [(7, 2), (9, 4)]))
        [(2, 1), (3, 1)]
    """

    def __init__(self, workers: int | None = None) -> None:
        self._count = UsableCores() if workers is None else workers
        if self._count < 1:
            raise ValueError(f"LocalProcesses: workers must be at least 1, not {workers}")
        self._workers: list[_Worker] = []

    def __enter__(self) -> LocalProcesses:
        """Workers start with their first run."""
        PrepareWorkers()
        self._workers = [_Worker(one_thread=self._count > 1) for _ in range(self._count)]
        return self

    def __exit__(self, *reason: object) -> None:
        """Ends the workers, whatever they do."""
        for worker in self._workers:
            worker.CutLifeline()
        for worker in self._workers:
            worker.Shutdown()
        self._workers = []

    def Run(
        self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Outcome]:
        """See `Executor`."""
        waiting = deque((index, 1) for index in range(len(arguments)))
        idle = self._workers[::-1]
        running: dict[Future[Any], tuple[_Worker, int, int]] = {}
        failed_starts = 0
        while waiting or running:
            while waiting and idle:
                worker, (index, attempt) = idle.pop(), waiting.popleft()
                running[worker.Submit(function, arguments[index])] = (worker, index, attempt)
            finished = []
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                worker, index, attempt = running.pop(future)
                idle.append(worker)
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    failed_starts = 0 if worker.started else failed_starts + 1
                    if failed_starts == MAX_ATTEMPTS:
                        raise WorkerDiedError(_NO_START) from error
                    if attempt < MAX_ATTEMPTS:
                        waiting.appendleft((index, attempt + 1))
                        continue
                    error = WorkerDiedError(
                        f"the worker process died at each of {attempt} attempts, for lack of "
                        "memory perhaps; try again with fewer workers"
                    )
                value = None if error else future.result()
                finished.append(
                    Outcome(index=index, value=value, exception=error, attempts=attempt)
                )
            yield from finished


def UsableCores() -> int:
    """Number of cores that this process may use.

    Example:
        >>> UsableCores() >= 1
        True
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def PrepareWorkers() -> None:
    """Starts what workers are made from, in the background; again, it does nothing.

    On Linux that is a server process which loads the simulation once, without rendering anything,
    and of which workers are forked in no time. (A fork of a process that has rendered would share
    its graphics state.) Elsewhere each worker is a process of its own from the start.

    Example:
        >>> PrepareWorkers()
    """
    if _StartMethod() == "forkserver":
        # Its libraries start no threads, as a fork takes none along.
        with _Environment(_ONE_THREAD[:2]), _InterruptsBlocked():
            multiprocessing.get_context("forkserver").set_forkserver_preload(_PRELOADED)
            multiprocessing.forkserver.ensure_running()


def _StartMethod() -> str:
    return "forkserver" if sys.platform == "linux" else "spawn"


@contextlib.contextmanager
def _Environment(names: Sequence[str]) -> Iterator[None]:
    """Asks libraries in processes that start meanwhile for one thread, unless the user has."""
    added = [name for name in names if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


@contextlib.contextmanager
def _InterruptsBlocked() -> Iterator[None]:
    """Ctrl-C is for this process alone: processes that start meanwhile never get it.

    Neither do they get the end of the terminal.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Worker:
    """A pool of one process, so that a death leaves no doubt about whose run it was.

    (A pool of several is broken as a whole by the death of one process.)
    """

    def __init__(self, *, one_thread: bool) -> None:
        self._one_thread = one_thread
        self._pool: ProcessPoolExecutor | None = None
        self._lifeline: Connection | None = None

    def Submit(self, function: Callable[..., Any], values: tuple[Any, ...]) -> Future[Any]:
        """Hands a run to the process, which is started where there is none (any more)."""
        with _InterruptsBlocked():
            if self._pool is not None:
                try:
                    return self._pool.submit(function, *values)
                except BrokenProcessPool:  # It died when it had nothing to do.
                    pass
            for pause in _PAUSES:
                with contextlib.suppress(EOFError, ConnectionError):  # The server has died.
                    return self._Start().submit(function, *values)
                time.sleep(pause)
        raise WorkerDiedError(_NO_SERVER)

    def _Start(self) -> ProcessPoolExecutor:
        """A new pool, whose process starts with its first run."""
        self.CutLifeline()
        self.Shutdown()
        PrepareWorkers()  # again where the server has died
        context: BaseContext = multiprocessing.get_context(_StartMethod())
        end, self._lifeline = context.Pipe()
        level = logging.getLogger("mffdrake").getEffectiveLevel()
        self._pool = ProcessPoolExecutor(
            1,
            mp_context=context,
            initializer=_StartWorker,
            initargs=(end, level, self._one_thread),
        )
        return self._pool

    @property
    def started(self) -> bool:
        """Whether the process got as far as to wait for work."""
        # What the process sent can be read after its end too.
        if self._lifeline is None:
            return False
        with contextlib.suppress(EOFError, OSError):
            return self._lifeline.poll() and self._lifeline.recv_bytes() == _STARTED
        return False

    def CutLifeline(self) -> None:
        """Ends the process, whatever it does."""
        if self._lifeline is not None:
            self._lifeline.close()
            self._lifeline = None

    def Shutdown(self) -> None:
        """Waits for the process's end."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def _StartWorker(lifeline: Connection, log_level: int, one_thread: bool) -> None:
    """Logs like the parent, ends with the parent, and leaves Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if one_thread:
        for name in _ONE_THREAD:
            os.environ.setdefault(name, "1")
    logging.getLogger("mffdrake").setLevel(log_level)
    try:
        lifeline.send_bytes(_STARTED)
    except OSError:  # The parent has ended meanwhile.
        os._exit(1)
    threading.Thread(target=_EndWithParent, args=(lifeline,), daemon=True).start()


def _EndWithParent(lifeline: Connection) -> None:
    """Waits until the other end of the pipe is closed, by the parent or by its death."""
    try:
        lifeline.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)
