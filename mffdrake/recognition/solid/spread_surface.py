"""A surface as many points, by which turns are found that bring it onto itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.poses.pose import rotation_matrix
from mffdrake.recognition.poses.pose_motion import rotate_by
from mffdrake.recognition.solid import surface
from mffdrake.recognition.solid.solid_model import SolidModel

Array = NDArray[np.float64]

_SPREAD = 12000  # points over a surface, so dense that no gap is as wide as ...
_APART = 0.04  # ... that share of its size: what is nearer coincides
_TESTED = 150  # of them, ...
_AT_ONCE = 15  # ... so many at once: most turns fail with the first
_FOLDS = (2, 3, 4, 5, 6, 8)


@dataclass(frozen=True, eq=False)
class Surface:
    """Points spread over a solid's surface.

    Attributes:
        points: The points [m], shape (N, 3).
        hues: Numbers of their colors, shape (N,).
        center: Their mean [m], shape (3,).
        limit: Points no farther apart than that coincide [m].
        directions: Unit vectors along axes about which it may turn onto itself, shape (K, 3).
    """

    points: Array
    hues: NDArray[np.int64]
    center: Array
    limit: float
    directions: Array

    @classmethod
    def of(cls, solid: SolidModel) -> Surface:
        """The surface of a solid."""
        rng = np.random.default_rng(0)  # The same solid has the same points.
        points, chosen = surface.spread(solid.triangles, _SPREAD, rng)
        areas = surface.areas(solid.triangles)
        hues = np.unique(solid.hues.round(3), return_inverse=True)[1].reshape(-1)
        # Of the triangles themselves, lest the center is off by chance
        center = (areas[:, None] * solid.triangles.mean(axis=1)).sum(axis=0) / areas.sum()
        arms = solid.triangles.mean(axis=1) - center
        _, principal = np.linalg.eigh((areas[:, None] * arms).T @ arms)
        large = solid.normals[solid.areas > 0.05 * solid.areas.sum()]
        directions: list[Array] = []
        for d in (*principal.T, *large):
            if all(abs(d @ other) < 0.9999 for other in directions):
                directions.append(d)
        return cls(
            points, hues[solid.triangle_faces[chosen]], center, _APART * solid.size,
            np.array(directions),
        )  # fmt: skip

    @cached_property
    def _arms(self) -> Array:
        """The points, seen from the center [m], shape (N, 3)."""
        return self.points - self.center

    @cached_property
    def _squared(self) -> Array:
        """Squares of their lengths [m^2], shape (N,)."""
        return np.asarray(np.einsum("nk,nk->n", self._arms, self._arms))

    def turns(self, *, by_color: bool) -> Array:
        """Fractions of turns that bring the surface onto itself, shape (K, 3, 3)."""
        found: list[Array] = []
        for direction in self.directions:
            for fold in _FOLDS:
                for step in range(1, fold):
                    if math.gcd(step, fold) > 1:
                        continue
                    angle = math.remainder(2.0 * math.pi * step / fold, 2.0 * math.pi)
                    R = rotation_matrix(rotate_by(angle * direction))
                    known = any(np.trace(R @ S.T) > 2.99 for S in found)
                    if not known and self.coincides(R, by_color=by_color):
                        found.append(R)
        return np.array(found).reshape(-1, 3, 3)

    def coincides(self, R: Array, *, by_color: bool) -> bool:
        """Whether a rotation about the center brings the surface onto itself."""
        arms = self._arms
        for start in range(0, _TESTED, _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            products = np.einsum("ak,nk->an", arms[some] @ R.T, arms)
            squared = self._squared[some, None] + self._squared - 2.0 * products
            if by_color:
                squared[self.hues[some, None] != self.hues] = np.inf
            if squared.min(axis=1).max() > self.limit**2:
                return False
        return True
