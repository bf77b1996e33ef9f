"""What a tracker says of its own pose."""

from __future__ import annotations

import enum

__all__ = ["TrackingState"]


class TrackingState(enum.IntEnum):
    """Whether a pose may be relied on.

    Example:
        >>> TrackingState.TRACKING.name, int(TrackingState.TRACKING)
        ('TRACKING', 1)
    """

    SEARCHING = 0
    """The target has not been found yet."""
    TRACKING = 1
    """The images show the target at the pose."""
    PREDICTED = 2
    """They do not, for the moment: the pose is carried along by what is known of the motion."""
    LOST = 3
    """They have not for so long that the pose says little; the target is searched for."""
    AMBIGUOUS = 4
    """They show it, but at another pose just as well."""
