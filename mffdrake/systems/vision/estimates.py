"""What a pose estimator says of itself and returns, checked, and its covariance in ports.

Ports and states are vectors: NaN tells there that a pose has no covariance.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition import Generation, Tracker

__all__ = ["CheckGeneration", "CheckTracker", "CovarianceFromVector", "CovarianceToVector"]

Array = NDArray[np.float64]


def CheckTracker(tracker: Tracker) -> None:
    """Checks what a tracker says of itself."""
    name, pose = type(tracker).__name__, np.asarray(tracker.initial_pose)
    if tracker.num_hypotheses < 1:
        raise ValueError(f"{name}: num_hypotheses must be at least 1, not {tracker.num_hypotheses}")
    if pose.shape != (6,) or not np.isfinite(pose).all():
        raise ValueError(
            f"{name}: initial_pose must be a pose vector of 6 finite numbers, not {pose.tolist()}"
        )


def CheckGeneration(generation: Generation, tracker: Tracker, method: str) -> None:
    """Checks what a tracker returned: the state takes numbers of these shapes alone."""
    n = tracker.num_hypotheses
    where = f"{type(tracker).__name__}.{method}"
    shapes = {"poses": (n, 6), "fitness": (n,), "gains": (3,)}
    if generation.covariance is not None:
        shapes["covariance"] = (6, 6)
    for name, expected in shapes.items():
        shape = np.shape(getattr(generation, name))
        if shape != expected:
            raise ValueError(
                f"{where} returned {name} of shape {shape}; with num_hypotheses {n} it must be "
                f"of shape {expected}"
            )
    if not (np.isfinite(generation.poses).all() and np.isfinite(generation.fitness).all()):
        raise ValueError(
            f"{where} returned poses or fitness that are not finite; where nothing is found, "
            "return the carried poses with fitness 0"
        )


def CovarianceToVector(covariance: Array | None) -> Array:
    """The numbers of a pose vector's covariance.

    Args:
        covariance: Shape (6, 6); None where it is not known.

    Returns:
        Row by row, shape (36,); NaN where it is not known.

    Example:
        >>> np.isnan(CovarianceToVector(None)).all()
        np.True_
    """
    return np.full(36, math.nan) if covariance is None else covariance.reshape(36)


def CovarianceFromVector(numbers: Array) -> Array | None:
    """The inverse of `CovarianceToVector`.

    Args:
        numbers: Shape (36,).

    Example:
        >>> CovarianceFromVector(CovarianceToVector(np.eye(6)))[0]
        array([1., 0., 0., 0., 0., 0.])
    """
    return None if math.isnan(numbers[0]) else numbers.reshape(6, 6)
