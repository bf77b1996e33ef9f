"""The weights that fit frames best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from confidence.frames import Array, Frames, logistic
from mffdrake.recognition.tracking.confidence import WEIGHTS

RIDGE, STEPS = 0.01, 100
LIMITS = np.array([np.inf] + (len(WEIGHTS) - 1) * [0.0])


def fit(frames: Sequence[Frames]) -> Array:
    """Weights of the greatest likelihood under a ridge penalty, none but the first positive.

    Newton steps among the weights that are free: at 0, one is not that would turn positive.
    """
    X = np.concatenate([some.features for some in frames])
    y = np.concatenate([some.right for some in frames])
    ridge = np.where(np.isinf(LIMITS), 0.0, RIDGE)

    def loss(weights: Array) -> float:
        score = X @ weights
        return float(np.sum(np.logaddexp(0.0, score) - y * score) + 0.5 * ridge @ weights**2)

    weights = np.zeros(X.shape[1])
    for _ in range(STEPS):
        p = logistic(X, weights)
        slope = X.T @ (p - y) + ridge * weights
        free = (weights < LIMITS) | (slope > 0.0)
        if np.abs(slope[free]).max() < 1e-6 * len(y):
            break
        A = X[:, free]
        curve = (A * (p * (1.0 - p))[:, None]).T @ A + np.diag(ridge[free] + 1e-9)
        step = np.zeros_like(weights)
        step[free] = -np.linalg.solve(curve, slope[free])
        trials = (np.minimum(weights + size * step, LIMITS) for size in 0.5 ** np.arange(20))
        weights = next((trial for trial in trials if loss(trial) < loss(weights)), weights)
    else:
        raise RuntimeError(f"the fit has not settled after {STEPS} steps")
    return weights
