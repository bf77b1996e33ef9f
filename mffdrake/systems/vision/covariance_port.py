"""How ports and states, which are vectors, tell that a pose has no covariance: by NaN."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["FromVector", "ToVector"]

Array = NDArray[np.float64]


def ToVector(covariance: Array | None) -> Array:
    """The numbers of a pose vector's covariance.

    Args:
        covariance: Shape (6, 6); None where it is not known.

    Returns:
        Row by row, shape (36,); NaN where it is not known.

    Example:
        >>> np.isnan(ToVector(None)).all()
        np.True_
    """
    return np.full(36, math.nan) if covariance is None else covariance.reshape(36)


def FromVector(numbers: Array) -> Array | None:
    """The inverse of `ToVector`.

    Args:
        numbers: Shape (36,).

    Example:
        >>> FromVector(ToVector(np.eye(6)))[0]
        array([1., 0., 0., 0., 0., 0.])
    """
    return None if math.isnan(numbers[0]) else numbers.reshape(6, 6)
