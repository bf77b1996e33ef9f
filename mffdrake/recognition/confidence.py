"""How likely a pose is right, from what the images say of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.refinement import Refinement

__all__ = ["Evidence", "confidence", "probability_within"]

Array = NDArray[np.float64]

RIGHT_POSITION, RIGHT_ROTATION = 0.005, math.radians(1.0)
"""A pose no farther off than this [m], [rad] is right."""


class Evidence(NamedTuple):
    """What is known of a refined pose.

    Attributes:
        explained: Share of its borders that the images show (0 to 1).
        fitness: Its fitness (0 to 1).
        residual: How far borders lie from edges, in units of what is expected.
        disagreement: How far one camera's borders alone would move it [m].
        trusted: Mean robust weight of the borders (0 to 1).
        within: Probability that it is right by its covariance.
        surprise: How far it is from where it was expected, see `PoseFilter`.
    """

    explained: float
    fitness: float
    residual: float
    disagreement: float
    trusted: float
    within: float
    surprise: float

    @classmethod
    def of(
        cls, refined: Refinement, covariance: ArrayLike, explained: float, surprise: float
    ) -> Evidence:
        """Of a refinement."""
        return cls(
            explained,
            refined.fitness,
            refined.residual / refined.expected_residual,
            refined.disagreement,
            refined.trusted,
            probability_within(covariance),
            surprise,
        )


def confidence(evidence: Evidence) -> float:
    """Probability that a pose is right to 5 mm and 1 deg."""
    return 1.0


def probability_within(covariance: ArrayLike) -> float:
    """Probability that an error of this covariance is at most 5 mm and 1 deg.

    As if it was the same along all axes, and position and orientation independent.

    Args:
        covariance: Of position [m] and rotation vector [rad], shape (6, 6).
    """
    variances = np.diag(np.asarray(covariance, dtype=float))
    product = 1.0
    for limit, variance in (
        (RIGHT_POSITION, variances[:3].mean()),
        (RIGHT_ROTATION, variances[3:].mean()),
    ):
        x = limit / math.sqrt(max(variance, 1e-18))  # Maxwell's distribution
        tail = math.sqrt(2.0 / math.pi) * x * math.exp(-0.5 * x * x)
        product *= math.erf(x / math.sqrt(2.0)) - tail
    return product
