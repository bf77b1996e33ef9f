"""How a recognition lost the target and found it again."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.systems.clutter.occluder import Occluder
from mffdrake.systems.disturbances.missing_images import Black, Frozen

__all__ = ["RECOVERY", "CalcRecovery", "OutageEnd"]

RECOVERY: dict[str, type] = {
    "first_right": int, "longest_wrong": int, "after_outage": int, "recovered": bool,
}  # fmt: skip
"""Names and types of the figures of `CalcRecovery`."""


def OutageEnd(scenario: Scenario) -> float | None:
    """When the last outage of a scenario ends.

    Outages are images that are frozen or black, and a plate that passes by once.

    Args:
        scenario: The scenario.

    Returns:
        The time [s]; None where there is no outage.

    Example:
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> OutageEnd(LoadScenario(text="disturbances: [!Black {starts: [1, 2], duration: 0.5}]"))
        2.5
    """
    ends = []
    for disturbance in scenario.disturbances:
        if isinstance(disturbance, Frozen):
            ends.append(disturbance.start + disturbance.duration)
        elif isinstance(disturbance, Black):
            ends += [start + disturbance.duration for start in disturbance.starts]
    for clutter in scenario.clutter:
        if isinstance(clutter, Occluder) and clutter.duration is not None:
            ends.append(clutter.start + clutter.duration)
    return max(ends, default=None)


def CalcRecovery(
    time: NDArray[np.float64], right: NDArray[np.bool_], outage_end: float | None
) -> dict[str, Any]:
    """Counts the frames that it took to find the target, and to find it again.

    Args:
        time: Times of the frames [s], shape (K,).
        right: Which frames' poses are right, shape (K,).
        outage_end: See `OutageEnd`.

    Returns:
        ``first_right``, the number of frames before the first right one; ``longest_wrong``, the
        longest stretch of frames after it that are not right; both None where no frame is right.
        ``after_outage``, the number of frames from the end of the outage to the first right one,
        and ``recovered``, whether there is one; both None where no frame comes after an outage,
        the former also where there is no right one.

    Example:
        >>> CalcRecovery(np.arange(6.0), np.array([0, 1, 0, 0, 0, 1], dtype=bool), 3.0)
        {'first_right': 1, 'longest_wrong': 3, 'after_outage': 2, 'recovered': True}
    """
    after = np.zeros(len(time), dtype=bool)
    if outage_end is not None:
        after = time >= outage_end - 1e-9  # A rounding error must not move the end past a frame.
    hits, again = np.flatnonzero(right), np.flatnonzero(right[after])
    gaps = np.diff([*hits, len(right)]) - 1
    return {
        "first_right": int(hits[0]) if len(hits) else None,
        "longest_wrong": int(gaps.max()) if len(hits) else None,
        "after_outage": int(again[0]) if len(again) else None,
        "recovered": bool(len(again)) if after.any() else None,
    }
