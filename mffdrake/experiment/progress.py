"""Progress of long work: a bar for those who watch, a line now and then for a log."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from mffdrake.experiment.runs.engine import EndedRun, PlannedRun

__all__ = ["ProgressBar", "RunBar", "TellCompiling", "TimeBar"]

_INTERVAL = 15.0  # s from line to line
_COMPILING = "mffdrake: compiling once for this machine, which takes a minute or two ..."
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


@contextmanager
def TellCompiling() -> Iterator[None]:
    """Says so on a terminal when numba compiles a function: the first frame then takes its time.

    Example:
        >>> with TellCompiling():
        ...     pass
    """
    from numba.core import event  # slow to import

    class Teller(event.Listener):
        def __init__(self) -> None:
            self.told = False

        def on_start(self, event: object) -> None:
            if not self.told and sys.stderr.isatty():
                tqdm.write(_COMPILING, file=sys.stderr)
                self.told = True

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", Teller()):
        yield


@contextmanager
def RunBar(plan: Sequence[PlannedRun]) -> Iterator[Callable[[EndedRun], None]]:
    """A bar over the work of a plan that is done, as runs differ much.

    Args:
        plan: What is run; equal runs are run once.

    Yields:
        What to call for each that has ended.

    Example:
        >>> from mffdrake.experiment.runs.store import Record
        >>> from mffdrake.experiment.scenario.scenario import Scenario
        >>> run = PlannedRun(scenario=Scenario())
        >>> with RunBar([run]) as on_run:
        ...     on_run(EndedRun(run=run, record=Record(row={})))
    """
    work = {run.scenario.fingerprint: run.work for run in plan}
    form = "{desc}: {percentage:3.0f}%|{bar}| {unit} [{elapsed}<{remaining}]{postfix}"
    with ProgressBar(total=sum(work.values()), desc="simulations", bar_format=form) as bar:
        ended, failed, bar.unit = 0, 0, f"0/{len(work)} runs"

        def OnRun(run: EndedRun) -> None:
            nonlocal ended, failed
            ended, failed = ended + 1, failed + (run.status == "failed")
            bar.unit = f"{ended}/{len(work)} runs"
            if failed:
                bar.set_postfix_str(f"{failed} failed", refresh=False)
            if run.was_kept and not bar.disable:  # It tells nothing of the speed.
                bar.initial += run.run.work
            bar.update(run.run.work)

        yield OnRun


@contextmanager
def TimeBar(duration: float) -> Iterator[Callable[[float, float], None]]:
    """A bar over simulated time, with the speed.

    Args:
        duration: Simulated time in the end [s].

    Yields:
        What to call after every frame, see `Simulate`.
    """
    form = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s{postfix}"
    with TellCompiling(), ProgressBar(total=duration, desc="simulated", bar_format=form) as bar:

        def OnFrame(simulated: float, wall: float) -> None:
            bar.set_postfix_str(f"{simulated / max(wall, 1e-9):.2f} x real time", refresh=False)
            bar.update(simulated - bar.n)

        yield OnFrame
