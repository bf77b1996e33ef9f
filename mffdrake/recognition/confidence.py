"""How likely a pose is right, from what the images say of it."""

from __future__ import annotations

import math
from typing import NamedTuple

from mffdrake.recognition.refinement import Refinement

__all__ = ["Evidence", "confidence"]


class Evidence(NamedTuple):
    explained: float
    fitness: float
    residual: float
    trusted: float
    std_position: float
    std_rotation: float
    surprise: float

    @classmethod
    def of(cls, refined: Refinement, explained: float, surprise: float) -> Evidence:
        import numpy as np

        C = refined.covariance
        return cls(
            explained,
            refined.fitness,
            refined.residual / refined.expected_residual,
            refined.trusted,
            math.sqrt(np.trace(C[:3, :3])),
            math.sqrt(np.trace(C[3:, 3:])),
            surprise,
        )


def confidence(evidence: Evidence) -> float:
    return evidence.explained
