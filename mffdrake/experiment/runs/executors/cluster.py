"""Runs on a Dask cluster that is there already."""

from __future__ import annotations

import asyncio
import functools
import logging
import queue
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from mffdrake.experiment.runs.executors.executors import Outcome, WorkerDiedError
from mffdrake.recognition.parameters import InputError

if TYPE_CHECKING:
    import distributed
    from distributed import Client

__all__ = ["ClusterError", "DaskCluster"]

_log = logging.getLogger(__name__)
_PATIENCE = 10.0  # s; how long a scheduler may take to answer
_AHEAD = 1000  # how many runs to have there at a time; more than a cluster has workers
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
        for name in ("distributed", "distributed.client", "distributed.core"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        try:
            self._RequireScheduler()
            self._client = Client(self._address, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError, NotImplementedError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise ClusterError(
                f"no Dask scheduler at '{self._address}': {reason}; an address is such as "
                "tcp://127.0.0.1:8786, and 'dask scheduler' starts one"
            ) from error
        return self

    def _RequireScheduler(self) -> None:
        """Finds out soon who listens; the client would go on trying, or believe anything."""
        from distributed.comm.addressing import get_address_host_port

        with socket.create_connection(get_address_host_port(self._address), timeout=_PATIENCE):
            pass
        answered: Future[str] = Future()
        # A thread, as this one may have a loop that runs (a notebook's); it is not waited for.
        threading.Thread(target=_AskKind, args=(self._address, answered), daemon=True).start()
        try:
            kind = answered.result()
        except (ValueError, TypeError):  # of the address or the certificates
            raise
        except TimeoutError as error:
            raise OSError(
                f"something listens there, but has not answered within {_PATIENCE:g} s"
            ) from error
        except Exception as error:
            raise OSError("something else answers there") from error
        if kind != "Scheduler":
            raise OSError(f"a Dask {kind.lower()} answers there")

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
        ended: queue.SimpleQueue[distributed.Future] = queue.SimpleQueue()
        pending: dict[str, int] = {}
        told, submitted = "", 0
        while pending or submitted < len(arguments):
            # All of thousands at once would be a large message.
            if len(pending) <= _AHEAD // 2 and submitted < len(arguments):
                part = arguments[submitted : submitted + _AHEAD - len(pending)]
                futures = self._client.map(
                    functools.partial(_InOneThread, function), list(part), pure=False
                )
                pending |= {future.key: submitted + k for k, future in enumerate(futures)}
                submitted += len(part)
                while futures:  # The cluster forgets a run whose future is gone.
                    futures.pop().add_done_callback(ended.put)
            try:
                future = ended.get(timeout=_CHECK_PERIOD)
            except queue.Empty:
                self._RequireConnection()
                told = self._TellTrouble(told)
                continue
            if future.status in ("cancelled", "lost"):
                self._RequireConnection()
            yield _OutcomeOf(future, pending.pop(future.key))

    def _TellTrouble(self, told: str) -> str:
        """Says once, each time that it happens, why nothing goes on; returns why."""
        client, trouble = self._client, ""
        assert client is not None
        try:
            if not client.sync(client.scheduler.ncores, callback_timeout=_PATIENCE):
                trouble = (
                    f"has no workers; waiting for some to join ('dask worker {self._address}' "
                    "starts one)"
                )
        except TimeoutError:
            trouble = f"has not answered for {_PATIENCE:g} s; waiting for it"
        if trouble not in ("", told):
            _log.warning("the Dask scheduler at '%s' %s", self._address, trouble)
        return trouble

    def _RequireConnection(self) -> None:
        if self._client is None or self._client.status != "running":
            raise ClusterError(
                f"the Dask scheduler at '{self._address}' is gone; when it is there again, the "
                "same command goes on from here"
            )


def _AskKind(address: str, answered: Future[str]) -> None:
    """Finds out what is at an address."""
    from distributed.core import connect
    from distributed.security import Security

    async def Ask() -> str:
        secrets = Security().get_connection_args("client")
        connection = await connect(address, timeout=_PATIENCE, **secrets)
        try:
            await connection.write({"op": "identity", "reply": True})
            return str((await connection.read())["type"])
        finally:
            connection.abort()

    try:
        answered.set_result(asyncio.run(asyncio.wait_for(Ask(), _PATIENCE)))
    except BaseException as error:
        answered.set_exception(error)


def _OutcomeOf(future: distributed.Future, index: int) -> Outcome:
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
