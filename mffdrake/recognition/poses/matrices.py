"""Compiled products, and Cholesky factors of 6 x 6 matrices (numba). Import only where it runs."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def factor(N: Array, L: Array) -> bool:
    """Cholesky factor L of a symmetric matrix, from its lower half; false if it is singular."""
    for i in range(6):
        for j in range(i + 1):
            total = N[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = total / L[j, j]
            elif total > 1e-9 * N[i, i]:
                L[i, i] = math.sqrt(total)
            else:
                return False
    return True


@njit(cache=True, error_model="numpy")
def solve(L: Array, b: Array) -> Array:
    """Solution x of L L^T x = b."""
    x = b.copy()
    for i in range(6):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
    return x


@njit(cache=True, error_model="numpy")
def invert(L: Array) -> Array:
    """Inverse of L L^T, shape (6, 6)."""
    inverse, unit = np.empty((6, 6)), np.zeros(6)
    for i in range(6):
        unit[:] = 0.0
        unit[i] = 1.0
        inverse[:, i] = solve(L, unit)
    return inverse


@njit(cache=True, error_model="numpy")
def product(A: Array, B: Array) -> Array:
    """A B (numba's own needs SciPy)."""
    rows, inner, columns = A.shape[0], A.shape[1], B.shape[1]
    C = np.zeros((rows, columns))
    for i in range(rows):
        for k in range(inner):
            a = A[i, k]
            if a != 0.0:
                for j in range(columns):
                    C[i, j] += a * B[k, j]
    return C
