"""Compiled genes and breeding (numba). Import only where it runs: numba takes time to load.

`GeneticAlgorithm` says what a generation is; here is how it is computed, child by child.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mffdrake.recognition.genetic.random_numbers import generator_at

Array = NDArray[np.float64]
Genes = NDArray[np.int64]


class Coding(NamedTuple):
    """The genes, see `GeneCoding`; ``top`` is the greatest value of one."""

    lower: Array
    upper: Array
    bits: int
    top: int
    gray: bool


class Moves(NamedTuple):
    """Small motions, see `LocalMoves`; ``rotation`` in rad."""

    pivots: Array
    middle: Array
    depth: float
    shift: float
    rotation: float
    decades: float
    sparsity: float


class Parents(NamedTuple):
    """A scored population, and a better center of shape (1, 6), or (0, 6) where there is none."""

    poses: Array
    fitness: Array
    center: Array


class Shares(NamedTuple):
    """What the next generation is made of, see `GeneticParameters`."""

    average_best: bool
    num_survivors: int
    num_local: int
    num_newcomers: int
    num_crossed: int
    mutation_probability: float


@njit(cache=True, error_model="numpy")
def encode(poses: Array, coding: Coding) -> Genes:
    """Genes of pose vectors, as whole numbers, shape (N, 6)."""
    lower, upper, top, gray = coding.lower, coding.upper, coding.top, coding.gray
    genes = np.empty((len(poses), 6), dtype=np.int64)
    for n in range(len(poses)):
        for i in range(6):
            share = (poses[n, i] - lower[i]) / (upper[i] - lower[i])
            share = min(share, 1.0) if share > 0.0 else 0.0  # NaN has the lowest gene
            value = np.int64(np.rint(share * top))
            genes[n, i] = value ^ (value >> 1) if gray else value
    return genes


@njit(cache=True, error_model="numpy")
def decode(genes: Genes, coding: Coding) -> Array:
    """Pose vectors of genes, shape (N, 6)."""
    lower, upper, top, gray = coding.lower, coding.upper, coding.top, coding.gray
    poses = np.empty((len(genes), 6))
    for n in range(len(genes)):
        for i in range(6):
            value = genes[n, i]
            if gray:  # Every bit is the sum, modulo 2, of those from the highest down to it.
                for shift in (1, 2, 4, 8, 16):
                    value ^= value >> shift
            poses[n, i] = lower[i] + value * ((upper[i] - lower[i]) / top)
        # A wide search range has corners beyond the unit sphere, where there are no rotations.
        norm = math.sqrt(poses[n, 3] ** 2 + poses[n, 4] ** 2 + poses[n, 5] ** 2)
        if norm > 1.0:
            poses[n, 3:] /= norm
    return poses


@njit(cache=True)
def draw_genes(count: int, top: int, address: int) -> Genes:
    """Genes drawn evenly, shape (count, 6); ``address``: the random numbers' `address_of`."""
    rng = generator_at(address)
    genes = np.empty((count, 6), dtype=np.int64)
    for n in range(count):
        for i in range(6):
            genes[n, i] = rng.integers(0, top + 1)
    return genes


@njit(cache=True)
def cross_and_mutate(
    parents: Genes, count: int, bits: int, mutation_probability: float, address: int
) -> Genes:
    """Two-point crossover of random parents, then mutation of single bits, Eq. (27)."""
    rng = generator_at(address)
    children = np.empty((count, 6), dtype=np.int64)
    for n in range(count):
        mother = parents[rng.integers(0, len(parents))]
        father = parents[rng.integers(0, len(parents))]
        # Cuts lie between the bits of the whole string, the most significant bit of x first.
        one, other = rng.integers(0, 6 * bits + 1), rng.integers(0, 6 * bits + 1)
        first, last = min(one, other), max(one, other)
        for i in range(6):
            from_father, flipped = 0, 0
            for position in range(i * bits, (i + 1) * bits):
                from_father = (from_father << 1) | int(first <= position < last)
                flipped = (flipped << 1) | int(rng.random() < mutation_probability)
            children[n, i] = ((mother[i] & ~from_father) | (father[i] & from_father)) ^ flipped
    return children


@njit(cache=True)
def _dot(a: Array, b: Array) -> float:
    """Scalar product; numba's own needs SciPy."""
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@njit(cache=True)
def _rotate(eta: float, e: Array, v: Array) -> Array:
    """A vector rotated by the unit quaternion (eta, e)."""
    t = 2.0 * np.cross(e, v)
    return v + eta * t + np.cross(e, t)


@njit(cache=True, error_model="numpy")
def draw_local_moves(pose: Array, count: int, moves: Moves, address: int) -> Array:
    """Poses around one, see `LocalMoves`."""
    rng = generator_at(address)
    poses = np.empty((count, 6))
    step = np.empty(7)
    r, eps = pose[:3], pose[3:]
    eta = math.sqrt(max(0.0, 1.0 - _dot(eps, eps)))
    sight = r - moves.middle
    sight = sight / math.sqrt(_dot(sight, sight))
    for n in range(count):
        size = 10.0 ** (-moves.decades * rng.random())
        for i in range(7):
            number = size * rng.standard_normal()
            step[i] = number if rng.random() >= moves.sparsity else 0.0
        # A rotation vector's half is the quaternion's vector part, to first order.
        turning, depth, shift = step[:3], step[3], step[4:]
        turn = 0.5 * moves.rotation * turning
        turn = turn / max(1.0, math.sqrt(_dot(turn, turn)))
        turn_eta = math.sqrt(max(0.0, 1.0 - _dot(turn, turn)))
        arm = _rotate(eta, eps, moves.pivots[rng.integers(0, len(moves.pivots))])
        turned = r + arm - _rotate(turn_eta, turn, arm)
        poses[n, :3] = turned + moves.depth * depth * sight + moves.shift * shift
        # Product of the two quaternions, with the sign that makes the scalar part positive
        scalar = turn_eta * eta - _dot(turn, eps)
        vector = turn_eta * eps + eta * turn + np.cross(turn, eps)
        poses[n, 3:] = -vector if scalar < 0.0 else vector
    return poses


@njit(cache=True)
def breed(parents: Parents, shares: Shares, coding: Coding, moves: Moves, address: int) -> Array:
    """The next generation, Eq. (27), see `GeneticAlgorithm.breed`."""
    poses, fitness, given_center = parents
    order = np.argsort(-fitness, kind="mergesort")  # stable
    center = poses[order[:1]]
    if shares.average_best:
        equals = 0
        center[:] = 0.0
        for n in range(len(poses)):
            if fitness[n] == fitness[order[0]]:
                center[0] += poses[n]
                equals += 1
        center /= equals
    if len(given_center) > 0:
        center = given_center
    survivors = encode(poses[order[: shares.num_survivors]], coding)
    local = draw_local_moves(center[0], shares.num_local, moves, address)
    genes = np.empty((len(poses), 6), dtype=np.int64)
    start = 0
    for part in (
        encode(center[: int(shares.average_best)], coding),
        encode(local, coding),
        draw_genes(shares.num_newcomers, coding.top, address),
        cross_and_mutate(
            survivors, shares.num_crossed, coding.bits, shares.mutation_probability, address
        ),
        survivors,
    ):
        genes[start : start + len(part)] = part
        start += len(part)
    next_poses: Array = decode(genes, coding)
    if len(given_center) > 0:
        next_poses[0] = given_center[0]  # not rounded to genes
    return next_poses
