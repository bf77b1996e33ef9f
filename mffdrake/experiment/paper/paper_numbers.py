"""The paper's own numbers, and what to say of ours beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = [
    "CELLS",
    "PAPER",
    "InvarianceRatio",
    "ReachesPaper",
    "Verdict",
]

_FIG_8 = {
    ("ga", 0.105): (0.8026, 3.1742, 3.5439, 14.9828, 0.0188, 0.0203, 0.0053),
    ("ga", 0.157): (0.7371, 3.4841, 4.4271, 17.1283, 0.0251, 0.0323, 0.0072),
    ("ga", 0.314): (0.6280, 7.6398, 21.7151, 33.8106, 0.0494, 0.0656, 0.0091),
    ("mff", 0.105): (0.9806, 0.6235, 1.16, 2.8536, 0.0075, 0.0091, 0.0022),
    ("mff", 0.157): (0.9764, 1.49, 1.712, 5.5322, 0.008, 0.0092, 0.002),
    ("mff", 0.314): (0.9733, 1.5601, 1.7493, 5.281, 0.0086, 0.0098, 0.0029),
}

CELLS = ("mean_fitness", "x_mm", "y_mm", "z_mm", "eps1", "eps2", "eps3")
"""The rows of the paper's Fig. 8: mean fitness and root-mean-square errors [mm, -]."""


def _WithNorms(values: Sequence[float]) -> dict[str, float]:
    """The cells of a column, with the distance and the angle that follow from them."""
    cells = dict(zip(CELLS, values, strict=True))
    cells["position_mm"] = math.hypot(*values[1:4])
    cells["rotation_deg"] = math.degrees(2.0 * math.asin(math.hypot(*values[4:7])))
    return cells


PAPER = {column: _WithNorms(values) for column, values in _FIG_8.items()}
"""The paper's Fig. 8 by (method, omega [rad/s]): its `CELLS`, over 0-40 s, of one run each.

``position_mm`` and ``rotation_deg`` are not in the paper; they follow from the others.
"""


def ReachesPaper(cell: str, ours: float, paper: float) -> bool:
    """Whether a number is at least as good as the paper's.

    Args:
        cell: One of `CELLS`, or another error.
        ours: Our number.
        paper: The paper's.

    Returns:
        Whether an error is at or below the paper's, the fitness at or above.

    Example:
        >>> ReachesPaper("z_mm", 1.5, 2.85), ReachesPaper("mean_fitness", 0.9, 0.98)
        (True, False)
    """
    return ours >= paper if cell == "mean_fitness" else ours <= paper


def Verdict(cell: str, ours: float | None, paper: float) -> str:
    """How a number compares with the paper's, in short.

    Args:
        cell: One of `CELLS`, or another error.
        ours: Our number; None where there is none.
        paper: The paper's, positive.

    Returns:
        "ok" where it is at least as good, otherwise the factor of an error and the difference of
        the fitness; "-" where there is no number.

    Example:
        >>> Verdict("z_mm", 1.5, 2.85), Verdict("z_mm", 5.7, 2.85)
        ('ok', 'x2.0')
        >>> Verdict("mean_fitness", 0.99, 0.98), Verdict("mean_fitness", 0.95, 0.98)
        ('ok', '-0.030')
    """
    if ours is None:
        return "-"
    if ReachesPaper(cell, ours, paper):
        return "ok"
    if cell == "mean_fitness":
        return f"-{paper - ours:.3f}"
    ratio = ours / paper
    return f"x{ratio:.1f}" if ratio >= 1.05 else f"x{ratio:.3f}"


def InvarianceRatio(slow: float | None, fast: float | None) -> float | None:
    """The paper's claim as a number: how much the error grows with the hand's speed.

    Args:
        slow: Position error at the lowest speed; None where there is none.
        fast: At the highest.

    Returns:
        Their ratio, 1 where the speed does not matter; None where it cannot be told.

    Example:
        >>> InvarianceRatio(2.0, 3.0)
        1.5
        >>> round(InvarianceRatio(*(PAPER["mff", w]["position_mm"] for w in (0.105, 0.314))), 2)
        1.84
    """
    if slow is None or fast is None or slow <= 0:
        return None
    return fast / slow
