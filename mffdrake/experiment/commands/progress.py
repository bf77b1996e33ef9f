"""Progress of long work: a bar for those who watch, a line now and then for a log."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from mffdrake.experiment.runs.store import Record

__all__ = ["Advance", "ProgressBar", "RunBar"]

_INTERVAL = 15.0  # s from line to line
_LINE = "mffdrake: {desc}: {percentage:.0f} % after {elapsed}{postfix}"


class _Lines:
    """Writes what a bar would overwrite as lines of their own."""

    def write(self, text: str) -> None:
        """Writes a line; blanks, by which a bar is wiped out, are none."""
        line = text.strip()
        if line:
            sys.stderr.write(f"{line}\n")

    def flush(self) -> None:
        """Writes at once."""
        sys.stderr.flush()


def ProgressBar(*, interval: float = _INTERVAL, **options: Any) -> tqdm[Any]:
    """A progress bar on stderr; where that is no terminal, a line now and then.

    Work that takes less than the interval leaves no line.

    Args:
        interval: Least time from line to line [s].
        options: Of tqdm.

    Returns:
        The bar, a context manager.

    Example:
        >>> with ProgressBar(total=3, desc="runs") as bar:
        ...     _ = bar.update(1)
    """
    if sys.stderr.isatty():
        return tqdm(**options)
    plain = options | {"bar_format": _LINE, "leave": False}
    return tqdm(
        file=_Lines(),
        delay=interval,
        mininterval=interval,
        maxinterval=interval,
        miniters=0,
        **plain,
    )


def Advance(bar: tqdm[Any], amount: float = 1, *, kept: bool) -> None:
    """Counts work that has ended.

    Args:
        bar: The bar.
        amount: How much, in the unit of the bar's total.
        kept: Whether it was there before: then it tells nothing of the speed.
    """
    if kept and not bar.disable:
        bar.initial += amount
    bar.update(amount)


@contextmanager
def RunBar(count: int, desc: str = "simulations") -> Iterator[Callable[[Record, bool], None]]:
    """A bar over the runs of sweeps that have ended, and how many of them failed.

    Args:
        count: How many runs there are.
        desc: What they are.

    Yields:
        What to call for each, see `Sweep`'s ``on_run``.

    Example:
        >>> with RunBar(1) as on_run:
        ...     on_run(Record(row={}), False)
    """
    with ProgressBar(total=count, desc=desc, unit="run") as bar:
        failed = 0

        def OnRun(record: Record, kept: bool) -> None:
            nonlocal failed
            failed += record.status == "failed"
            if failed:
                bar.set_postfix_str(f"{failed} failed", refresh=False)
            Advance(bar, kept=kept)

        yield OnRun
