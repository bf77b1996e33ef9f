"""Compiled choice of poses that differ from each other (numba). Import only where it runs."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.acquisition.proposing import Sources
from mffdrake.recognition.fitness.structs import Scene, new_placed, place
from mffdrake.recognition.genetic.random_numbers import generator_at
from mffdrake.recognition.poses.rotations import rotation, scalar_part
from mffdrake.recognition.solid.solid_model import Facets
from mffdrake.recognition.visibility.drawing import facing

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def pick_distinct(
    poses: Array,
    scores: Array,
    origins: IntArray,
    sources: Sources,
    numbers: tuple[int, int],
    apart: tuple[float, float],
    address: int,
) -> IntArray:
    """The best poses that differ from each other, and of them the last each of a random source.

    ``numbers`` tells how many there are, and how many of a random source. Poses differ when they
    are so far ``apart`` [m], or turned by more than what half has this cosine. ``address``:
    see `address_of`.
    """
    rng = generator_at(address)
    count, num_drawn = numbers
    distance, cosine = apart
    free = np.ones(len(poses), dtype=np.bool_)
    closed = np.zeros(len(sources), dtype=np.bool_)
    picked = np.empty(count, dtype=np.int64)
    found = 0
    for _ in range(4 * count):
        if found == count:
            break
        niche = -1
        if found >= count - num_drawn:
            total = 0.0
            for n in range(len(sources)):
                if not closed[n]:
                    total += sources[n].weight
            left = rng.random() * total
            for n in range(len(sources)):
                if not closed[n]:
                    niche = n
                    left -= sources[n].weight
                    if left <= 0.0:
                        break
            if niche >= 0:
                closed[niche] = True
        best = -1
        for i in range(len(poses)):
            allowed = free[i] and (niche < 0 or origins[i] == niche)
            if allowed and scores[i] > (scores[best] if best >= 0 else 0.0):
                best = i
        if best < 0:
            if niche < 0:
                break
            continue
        picked[found] = best
        found += 1
        for i in range(len(poses)):
            near = 0.0
            for k in range(3):
                near += (poses[i, k] - poses[best, k]) ** 2
            if near < distance * distance and _half_cosine(poses[i], poses[best]) > cosine:
                free[i] = False
        free[best] = False
    return picked[:found]


@njit(cache=True, error_model="numpy")
def silhouette_areas(poses: Array, scene: Scene, facets: Facets) -> Array:
    """Solid angle of the solid at poses, summed over the cameras, shape (N,) [sr].

    Each facet counts as if it was small and far away.
    """
    normals, centers, areas = facets
    placed = new_placed()
    seen = np.zeros(len(poses))
    for view in scene.views:
        for i in range(len(poses)):
            place(rotation(poses[i, 3:]), poses[i, :3], view.eye, placed)
            for k in range(len(areas)):
                toward, squared = facing(normals, centers, k, placed.p_MK)
                if toward > 0.0:
                    seen[i] += areas[k] * toward / squared**1.5
    return seen


@njit(cache=True, error_model="numpy")
def _half_cosine(a: Array, b: Array) -> float:
    """Cosine of half the angle between two orientations."""
    dot = scalar_part(a[3], a[4], a[5]) * scalar_part(b[3], b[4], b[5])
    for k in range(3, 6):
        dot += a[k] * b[k]
    return abs(dot)  # type: ignore[no-any-return]
