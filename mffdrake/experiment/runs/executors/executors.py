"""Runs a function many times, somewhere, and tells what became of each run.

`local_processes` and `cluster` beside it have more places.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol

__all__ = ["Executor", "InProcess", "Outcome", "WorkerDiedError"]


class WorkerDiedError(RuntimeError):
    """The process that worked on a run ended before the run did, at every attempt.

    Example:
        >>> import os
        >>> from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
        >>> with LocalProcesses(1) as place:
        ...     (outcome,) = place.Run(os._exit, [(1,)])
        >>> type(outcome.exception).__name__, outcome.attempts
        ('WorkerDiedError', 3)
    """


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one run.

    Attributes:
        index: Which of the arguments it is of.
        value: What the function returned; None where it failed.
        exception: Why it failed; None where it did not.
        attempts: How often it was begun, as far as the executor knows.

    Example:
        >>> Outcome(index=3, exception=ValueError("too  fast")).error
        'ValueError: too fast'
    """

    index: int
    value: Any = None
    exception: BaseException | None = None
    attempts: int = 1

    @property
    def error(self) -> str | None:
        """Why it failed, in one line; None where it did not."""
        if self.exception is None:
            return None
        text = " ".join(str(self.exception).split())
        return f"{type(self.exception).__name__}: {text}" if text else type(self.exception).__name__


class Executor(Protocol):
    """Runs a function many times. It is entered (``with executor:``) before its first run."""

    def __enter__(self) -> Executor:
        """Makes ready for runs."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Ends the runs that are going on, and what was made ready."""
        ...

    def Run(
        self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Outcome]:
        """Calls the function with each of the arguments.

        Args:
            function: A function of a module, so that it can be pickled.
            arguments: Its arguments, one tuple a run.

        Yields:
            The outcomes, as they come. A run that raises is an outcome too.
        """
        ...


class InProcess:
    """Runs one after the other, in this process.

    Example:
        >>> with InProcess() as executor:
        ...     [outcome.value for outcome in executor.Run(divmod, [(7, 2), (9, 4)])]
        [(3, 1), (2, 1)]
    """

    def __enter__(self) -> InProcess:
        """There is nothing to make ready."""
        return self

    def __exit__(self, *reason: object) -> None:
        """There is nothing to end."""

    def Run(
        self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Outcome]:
        """See `Executor`."""
        for index, values in enumerate(arguments):
            try:
                value = function(*values)
            except Exception as error:
                yield Outcome(index=index, exception=error)
            else:
                yield Outcome(index=index, value=value)
