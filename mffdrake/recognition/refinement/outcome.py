"""How a refinement may end: codes for the compiled functions, with what they mean in words."""

from __future__ import annotations

import enum

__all__ = ["Outcome"]


class Outcome(enum.IntEnum):
    """Whether a pose is refined, or why not.

    Attributes:
        message: The reason, for people; empty for `CONVERGED`.

    Example:
        >>> Outcome.TOO_FEW_BORDERS, Outcome.TOO_FEW_BORDERS.message
        (<Outcome.TOO_FEW_BORDERS: 1>, 'too few borders')
    """

    message: str

    # What the compiled steps end with:
    CONVERGED = 0, ""
    TOO_FEW_BORDERS = 1, "too few borders"
    SINGULAR = 2, "the borders leave a motion free"
    NOT_CONVERGED = 3, "not converged"
    # Why a pose that they ended at is rejected:
    TOO_FEW_INLIERS = 4, "the borders contradict each other"
    LARGE_RESIDUAL = 5, "the borders lie too far from the edges"
    UNCERTAIN = 6, "too uncertain"
    TOO_FAR = 7, "too far from the given pose"
    LESS_FIT = 8, "less fit"
    UNFIT = 9, "not fit"
    # Where none was tried:
    OFF = 10, "off"

    def __new__(cls, code: int, message: str = "") -> Outcome:
        """A code that knows its message; made from its code alone later on."""
        outcome = int.__new__(cls, code)
        outcome._value_ = code
        outcome.message = message
        return outcome
