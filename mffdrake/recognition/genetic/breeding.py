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
from mffdrake.recognition.poses.rotations import cross_product, scalar_part

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


@njit(cache=True, error_model="numpy")
def _turned(
    eta: float, e1: float, e2: float, e3: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """A vector (x, y, z), rotated by the unit quaternion (eta, e)."""
    tx, ty, tz = cross_product(e1, e2, e3, x, y, z)
    tx, ty, tz = 2.0 * tx, 2.0 * ty, 2.0 * tz
    sx, sy, sz = cross_product(e1, e2, e3, tx, ty, tz)
    return x + eta * tx + sx, y + eta * ty + sy, z + eta * tz + sz


@njit(cache=True, error_model="numpy")
def draw_local_moves(pose: Array, count: int, moves: Moves, address: int) -> Array:
    """Poses around one, see `LocalMoves`."""
    # All in single numbers: each small array would be memory of its own.
    rng, poses, step = generator_at(address), np.empty((count, 6)), np.empty(7)
    x, y, z, e1, e2, e3 = pose
    eta = scalar_part(e1, e2, e3)
    sx, sy, sz = x - moves.middle[0], y - moves.middle[1], z - moves.middle[2]
    distance = math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx / distance, sy / distance, sz / distance
    half, depth, shift = 0.5 * moves.rotation, moves.depth, moves.shift
    for n in range(count):
        size = 10.0 ** (-moves.decades * rng.random())
        for i in range(7):
            number = size * rng.standard_normal()
            step[i] = number if rng.random() >= moves.sparsity else 0.0
        # A rotation vector's half is the quaternion's vector part, to first order.
        t1, t2, t3 = half * step[0], half * step[1], half * step[2]
        length = max(1.0, math.sqrt(t1 * t1 + t2 * t2 + t3 * t3))
        t1, t2, t3 = t1 / length, t2 / length, t3 / length
        t0 = scalar_part(t1, t2, t3)
        pivot = moves.pivots[rng.integers(0, len(moves.pivots))]
        ax, ay, az = _turned(eta, e1, e2, e3, pivot[0], pivot[1], pivot[2])
        bx, by, bz = _turned(t0, t1, t2, t3, ax, ay, az)
        nearer = depth * step[3]
        poses[n, 0] = x + ax - bx + nearer * sx + shift * step[4]
        poses[n, 1] = y + ay - by + nearer * sy + shift * step[5]
        poses[n, 2] = z + az - bz + nearer * sz + shift * step[6]
        # Product of the two quaternions, with the sign that makes the scalar part positive
        sign = -1.0 if t0 * eta - (t1 * e1 + t2 * e2 + t3 * e3) < 0.0 else 1.0
        c1, c2, c3 = cross_product(t1, t2, t3, e1, e2, e3)
        poses[n, 3] = sign * (t0 * e1 + eta * t1 + c1)
        poses[n, 4] = sign * (t0 * e2 + eta * t2 + c2)
        poses[n, 5] = sign * (t0 * e3 + eta * t3 + c3)
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
