"""Which images of several cameras were taken together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["half_frame", "match_stamps"]

Stamps = NDArray[np.int64]


def half_frame(stamps: Stamps, rate: float) -> int:
    """Half of the time from frame to frame [ns].

    Args:
        stamps: Of one camera's images [ns], shape (K,).
        rate: Frames a second, where there is but one image.

    Example:
        >>> half_frame(np.array([0, 20, 60, 80]), 30.0)
        10
    """
    period = float(np.median(np.diff(np.sort(stamps)))) if len(stamps) > 1 else 1e9 / rate
    return round(0.5 * period)


def match_stamps(stamps: Sequence[Stamps], tolerance: int) -> NDArray[np.int64]:
    """Puts images together: those taken at one time or, else, the nearest ones.

    Args:
        stamps: Each camera's, in any order [ns]; the first one's are the frames.
        tolerance: Images that are further apart [ns] are no partners.

    Returns:
        A row a frame in the order of time, a column a camera: indices into its stamps, shape
        (frames, cameras). A frame without a partner of every camera is left out; no image is in
        two frames.

    Example:
        >>> match_stamps([np.array([0, 10, 20]), np.array([1, 12, 21])], 1).tolist()
        [[0, 0], [2, 2]]
    """
    order = np.argsort(stamps[0], kind="stable")
    columns = [order]
    complete = np.ones(len(order), dtype=bool)
    frames = stamps[0][order]
    for other in stamps[1:]:
        if not len(other) or not len(frames):
            return np.empty((0, len(stamps)), dtype=np.int64)
        ranks = np.argsort(other, kind="stable")
        there = _nearest(other[ranks], frames)
        back = _nearest(frames, other[ranks])
        # Partners are each other's nearest.
        mutual = back[there] == np.arange(len(frames))
        complete &= mutual & (np.abs(other[ranks][there] - frames) <= tolerance)
        columns.append(ranks[there])
    return np.column_stack(columns)[complete]


def _nearest(ascending: Stamps, wanted: Stamps) -> NDArray[np.int64]:
    """Index of the nearest of some ascending times to each wanted one."""
    above = np.clip(np.searchsorted(ascending, wanted), 0, len(ascending) - 1)
    below = np.maximum(above - 1, 0)
    closer = np.abs(ascending[below] - wanted) < np.abs(ascending[above] - wanted)
    return np.where(closer, below, above)
