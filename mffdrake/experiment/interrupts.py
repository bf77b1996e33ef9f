"""Ctrl-C and its like: what asks a command to end, and when it may."""

from __future__ import annotations

import os
import signal
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

__all__ = ["CollectInterrupts", "Interrupted", "SignalsInterrupt"]

# A person, a batch system, and a terminal or connection that is closed.
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Where C++ calls Python back, or may find half of a thing, when numba compiles or loads a function,
# or makes Python's objects of what one returns, and where modules are imported: exceptions are
# swallowed there, and what follows is another error or a crash.
_UNSAFE = (
    "llvmlite.binding.", "numba.core.codegen.", "numba.core.serialize.", "importlib._bootstrap.",
)  # fmt: skip
_AGAIN = 0.005  # s; how soon to look whether that is over


class Interrupted(KeyboardInterrupt):
    """A signal asks for the end.

    Attributes:
        number: Which one.

    Example:
        >>> Interrupted(signal.SIGTERM).status
        143
    """

    def __init__(self, number: int = signal.SIGINT) -> None:
        super().__init__()
        self.number = number

    def __str__(self) -> str:
        """Says how, where it was not Ctrl-C."""
        by = "" if self.number == signal.SIGINT else f" by {signal.Signals(self.number).name}"
        return f"interrupted{by}"

    @property
    def status(self) -> int:
        """What the process's exit status is to be, as a shell would show it."""
        return 128 + self.number


@contextmanager
def SignalsInterrupt() -> Iterator[list[int]]:
    """Lets SIGINT, SIGTERM and SIGHUP raise `Interrupted` in the body, as soon as that is safe.

    A signal that is ignored, as SIGHUP below ``nohup``, stays so.

    Yields:
        The signals that have raised, so far.

    Example:
        >>> with SignalsInterrupt() as received:
        ...     try:
        ...         signal.raise_signal(signal.SIGTERM)
        ...     except KeyboardInterrupt as end:
        ...         print(end)
        interrupted by SIGTERM
    """
    waiting: list[int] = []
    raised: list[int] = []

    def OnSignal(number: int, frame: FrameType | None) -> None:
        _LeaveTerminal()
        waiting.append(number)
        End(number, frame)

    def End(_: int, frame: FrameType | None) -> None:
        if not waiting:
            return
        if _IsUnsafe(frame):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)
            return
        raised.append(waiting[0])
        waiting.clear()
        raise Interrupted(raised[-1])

    handlers = {number: OnSignal for number in _Heeded()} | {signal.SIGALRM: End}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield raised
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def CollectInterrupts() -> Iterator[list[int]]:
    """Lets the first such signal in the body interrupt nothing; a second one works as ever.

    Yields:
        A list that has the signal when it has come.

    Example:
        >>> with CollectInterrupts() as received:
        ...     signal.raise_signal(signal.SIGINT)
        >>> received == [signal.SIGINT]
        True
    """
    received: list[int] = []

    def OnSignal(number: int, frame: FrameType | None) -> None:
        _LeaveTerminal()
        received.append(number)
        Restore()

    def Restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    before = {number: signal.getsignal(number) for number in _Heeded()}
    for number in before:
        signal.signal(number, OnSignal)
    try:
        yield received
    finally:
        Restore()


def _Heeded() -> list[int]:
    """The signals that are not ignored; handlers from outside of Python read as None."""
    return [n for n in _SIGNALS if signal.getsignal(n) not in (signal.SIG_IGN, None)]


def _LeaveTerminal() -> None:
    """Lets nothing be written to a terminal that is closed, as that would be an error."""
    for stream in (1, 2):
        with suppress(OSError):
            if stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream):
                nothing = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nothing, stream)
                os.close(nothing)


def _IsUnsafe(frame: FrameType | None) -> bool:
    """Whether an exception would be swallowed, or break something."""
    while frame is not None:
        name = frame.f_globals.get("__name__") or ""
        if frame.f_code.co_name == "__del__" or f"{name}.".startswith(_UNSAFE):
            return True
        frame = frame.f_back
    return False
