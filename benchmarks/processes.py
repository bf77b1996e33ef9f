"""Many calls of a function, in several processes, with a bar."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from mffdrake.experiment.progress import ProgressBar
from mffdrake.experiment.runs.executors.local_processes import LocalProcesses

T = TypeVar("T")


def call_all(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    names: Sequence[object],
    title: str,
    workers: int | None = None,
) -> list[T]:
    """What a function returns for all arguments, in their order, whichever ended first.

    Raises:
        RuntimeError: When a call fails; it names the task.
    """
    found: dict[int, T] = {}
    with LocalProcesses(workers) as executor, ProgressBar(total=len(tasks), desc=title) as bar:
        for outcome in executor.Run(function, tasks):
            if outcome.exception is not None:
                raise RuntimeError(names[outcome.index]) from outcome.exception
            found[outcome.index] = outcome.value
            bar.update(1)
    return [found[k] for k in range(len(tasks))]
