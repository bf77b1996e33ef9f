"""How likely a pose is right, from what the images say of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.acquisition.acquisition import Explained
from mffdrake.recognition.refinement.refinement import Refinement

__all__ = [
    "RIGHT_POSITION",
    "RIGHT_ROTATION",
    "WEIGHTS",
    "Evidence",
    "confidence",
    "features",
    "probability_within",
]

Array = NDArray[np.float64]

RIGHT_POSITION, RIGHT_ROTATION = 0.005, math.radians(1.0)
"""A pose no farther off than this [m], [rad] is right."""


WEIGHTS = np.array([7.19, -7.76, -4.70, -5.17, 0.00, -6.61, -0.19, -1.73, -4.43])
"""Of the `features`."""


class Evidence(NamedTuple):
    """What is known of a refined pose.

    Attributes:
        explained: Share of its borders that the images show (0 to 1).
        uneven: How much larger that share is in one camera's image than in another's (0 to 1).
        fitness: Its fitness (0 to 1).
        residual: How far borders lie from edges, in units of what is expected.
        disagreement: How far one camera's borders alone would move it [m].
        inlier_ratio: Mean robust weight of the borders (0 to 1).
        within: Probability that it is right by its covariance.
        nis: How far it is from where it was expected, see `PoseFilter`.
    """

    explained: float
    uneven: float
    fitness: float
    residual: float
    disagreement: float
    inlier_ratio: float
    within: float
    nis: float

    @classmethod
    def of(
        cls, refined: Refinement, covariance: ArrayLike, explained: Explained, nis: float
    ) -> Evidence:
        """The evidence for a refined pose.

        Args:
            refined: Its refinement, which converged.
            covariance: Of its position [m] and rotation vector [rad], shape (6, 6).
            explained: Its borders that the images show.
            nis: See `PoseFilter`.
        """
        return cls(
            explained.share,
            explained.uneven,
            refined.fitness,
            refined.residual / refined.expected_residual,
            refined.disagreement,
            refined.inlier_ratio,
            probability_within(covariance),
            nis,
        )


def features(evidence: Evidence) -> Array:
    """What speaks against a pose, all at least 0 and 0 where nothing does, after a 1, shape (9,).

    Args:
        evidence: What is known of it.

    Example:
        >>> clear = Evidence(explained=1.0, uneven=0.0, fitness=1.0, residual=1.0, inlier_ratio=1.0,
        ...                  disagreement=0.0, within=1.0, nis=0.0)
        >>> features(clear)
        array([1., 0., 0., 0., 0., 0., 0., 0., 0.])
    """
    e = evidence
    # A tenth more than what is expected is nothing yet.
    rough = max(0.0, math.log(max(e.residual, 1e-9) / 1.1))
    # What is hidden in part is unfit, too, but what of it shows lies where it should.
    unfit = 1.0 - e.fitness
    return np.array([
        1.0, (1.0 - e.explained) * unfit, e.uneven, rough, unfit * rough, 1.0 - e.inlier_ratio,
        math.log1p(e.nis), 1.0 - e.within, math.log1p(1e3 * max(0.0, e.disagreement)),
    ])  # fmt: skip


def confidence(evidence: Evidence) -> float:
    """Probability that a pose is right to 5 mm and 1 deg: a logistic function of the `features`.

    Its weights are fitted to runs with all kinds of disturbances (``benchmarks/confidence``).

    Args:
        evidence: What is known of the pose.

    Example:
        >>> clear = Evidence(explained=0.98, uneven=0.02, fitness=1.0, residual=1.0, within=1.0,
        ...                  inlier_ratio=0.95, disagreement=0.0, nis=0.5)
        >>> doubtful = clear._replace(explained=0.4, uneven=0.3, fitness=0.4, residual=3.0)
        >>> confidence(clear) > 0.99, confidence(doubtful) < 0.5
        (True, True)
    """
    score = float(WEIGHTS @ features(evidence))
    return 1.0 / (1.0 + math.exp(-score)) if score > -700.0 else 0.0


def probability_within(covariance: ArrayLike) -> float:
    """Probability that an error of this covariance is at most 5 mm and 1 deg.

    As if it was the same along all axes, and position and orientation independent.

    Args:
        covariance: Of position [m] and rotation vector [rad], shape (6, 6).

    Example:
        >>> round(probability_within(np.diag(3 * [0.001**2] + 3 * [0.002**2])), 6)
        0.999985
    """
    variances = np.diag(np.asarray(covariance, dtype=float)).tolist()
    product = 1.0
    for limit, variance in (
        (RIGHT_POSITION, sum(variances[:3]) / 3.0),
        (RIGHT_ROTATION, sum(variances[3:]) / 3.0),
    ):
        x = limit / math.sqrt(max(variance, 1e-18))  # Maxwell's distribution
        tail = math.sqrt(2.0 / math.pi) * x * math.exp(-0.5 * x * x)
        product *= math.erf(x / math.sqrt(2.0)) - tail
    return product
