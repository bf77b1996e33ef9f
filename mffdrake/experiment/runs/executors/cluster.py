"""Runs on a Dask cluster that is there already."""

from __future__ import annotations

import functools
import logging
import queue
import socket
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from mffdrake.experiment.runs.executors.executors import Outcome, WorkerDiedError
from mffdrake.recognition.parameters import InputError

if TYPE_CHECKING:
    from distributed import Client, Future

__all__ = ["ClusterError", "DaskCluster"]

_log = logging.getLogger(__name__)
_PATIENCE = 10.0  # s; how long a scheduler may take to answer
_CHECK_PERIOD = 1.0  # s; how often to look whether the scheduler is still there

# The one thread of a worker that simulates: graphics contexts belong to a thread. It starts when
# it is first used.
_SIMULATION_THREAD = ThreadPoolExecutor(1, thread_name_prefix="simulation")


class ClusterError(InputError, RuntimeError):
    """A cluster cannot be used (any more); the message says what helps.

    Example:
        >>> try:
        ...     with DaskCluster("tcp://127.0.0.1:1"):
        ...         pass
        ... except ClusterError as error:
        ...     print(str(error)[:41])
        no Dask scheduler at 'tcp://127.0.0.1:1':
    """


class DaskCluster:
    """Runs on the workers of a Dask scheduler.

    The scheduler begins a run again when its worker dies, as often as its setting
    ``allowed-failures`` says. Workers need this very version of mffdrake; they run one simulation
    at a time each, however many threads they have.

    Args:
        address: The scheduler's, such as ``tcp://127.0.0.1:8786``.

    Example:
        >>> try:
        ...     with DaskCluster("nowhere"):
        ...         pass
        ... except ClusterError as error:
        ...     print(str(error)[:31])
        no Dask scheduler at 'nowhere':
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._client: Client | None = None

    def __enter__(self) -> DaskCluster:
        """Connects.

        Raises:
            ClusterError: When the package is missing or nobody answers.
        """
        try:
            from distributed import Client
        except ImportError as error:
            raise ClusterError(
                "a Dask cluster needs the package distributed; run: pip install 'mffdrake[cluster]'"
            ) from error
        # What it has to say about lost connections is said below, in one line.
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        try:
            self._RequireListener()
            self._client = Client(self._address, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError, NotImplementedError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise ClusterError(
                f"no Dask scheduler at '{self._address}': {reason}; an address is such as "
                "tcp://127.0.0.1:8786, and 'dask scheduler' starts one"
            ) from error
        return self

    def _RequireListener(self) -> None:
        """Finds out at once whether nobody listens; the client would go on trying."""
        from distributed.comm.addressing import get_address_host_port

        with socket.create_connection(get_address_host_port(self._address), timeout=_PATIENCE):
            pass

    def __exit__(self, *reason: object) -> None:
        """Disconnects; the cluster forgets the runs that have not ended."""
        if self._client is not None:
            self._client.close(timeout=2.0)
            self._client = None

    def Run(
        self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Outcome]:
        """See `Executor`."""
        assert self._client is not None, "DaskCluster: enter it before its first run"
        ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
        futures = self._client.map(
            functools.partial(_InOneThread, function), list(arguments), pure=False
        )
        pending = {future.key: index for index, future in enumerate(futures)}
        while futures:  # The cluster forgets a run whose future is gone.
            futures.pop().add_done_callback(ended.put)
        lonely = False
        while pending:
            try:
                future = ended.get(timeout=_CHECK_PERIOD)
            except queue.Empty:
                self._RequireScheduler()
                lonely = self._WarnWithoutWorkers(lonely)
                continue
            if future.status in ("cancelled", "lost"):
                self._RequireScheduler()
            yield _OutcomeOf(future, pending.pop(future.key))

    def _WarnWithoutWorkers(self, warned: bool) -> bool:
        """Says once, each time that it happens, why nothing goes on; returns whether it has."""
        assert self._client is not None
        lonely = not self._client.nthreads()
        if lonely and not warned:
            _log.warning(
                "the Dask scheduler at '%s' has no workers; waiting for some to join ('dask worker "
                "%s' starts one)", self._address, self._address,
            )  # fmt: skip
        return lonely

    def _RequireScheduler(self) -> None:
        if self._client is None or self._client.status != "running":
            raise ClusterError(
                f"the Dask scheduler at '{self._address}' is gone; when it is there again, the "
                "same command goes on from here"
            )


def _OutcomeOf(future: Future, index: int) -> Outcome:
    from distributed import KilledWorker

    if future.status == "finished":
        return Outcome(index=index, value=future.result())
    error = future.exception()
    if isinstance(error, KilledWorker):
        attempts = error.allowed_failures + 1
        died = WorkerDiedError(f"the worker process died at each of {attempts} attempts")
        return Outcome(index=index, exception=died, attempts=attempts)
    return Outcome(index=index, exception=error)


def _InOneThread(function: Callable[..., Any], values: tuple[Any, ...]) -> Any:
    return _SIMULATION_THREAD.submit(function, *values).result()
