# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Small symmetric linear systems, and least-distance programming."""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper

SWEEPS = 30
"""Sweeps of Jacobi's method, at most; a few are enough."""
ACTIVE = 6
"""Most active constraints, with 6 unknowns."""
MOST_CHANGES = 200
"""Changes of the active set, at most; the length of the vector increases with each."""
DEPENDENT = 1e-11
"""Squared relative distance from the span of active constraints up to which it depends on them."""


@helper
def eigen(a: np.ndarray, vectors: np.ndarray) -> None:
    """
    Diagonalise a symmetric matrix (n, n) in place; its eigenvectors become rows of `vectors`.

    Cyclic Jacobi method: Golub and Van Loan, Matrix Computations, section 8.5.
    """
    n = len(a)
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        off = size = 0.0
        for i in range(n):
            size += a[i, i] * a[i, i]
            for j in range(i):
                off += a[i, j] * a[i, j]
        if off <= 1e-32 * size:
            return
        for i in range(n):
            for j in range(i + 1, n):
                if a[i, j] != 0.0:
                    rotate(a, vectors, i, j)


@helper
def rotate(a: np.ndarray, vectors: np.ndarray, i: int, j: int) -> None:
    """Eliminate one off-diagonal entry of a symmetric matrix by a Jacobi rotation."""
    theta = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    if abs(theta) > 1e150:
        t = 0.5 / theta
    else:
        t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(1.0 + theta * theta))
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = t * c
    for k in range(len(a)):
        p, q = a[k, i], a[k, j]
        a[k, i], a[k, j] = c * p - s * q, s * p + c * q
    for k in range(len(a)):
        p, q = a[i, k], a[j, k]
        a[i, k], a[j, k] = c * p - s * q, s * p + c * q
        p, q = vectors[i, k], vectors[j, k]
        vectors[i, k], vectors[j, k] = c * p - s * q, s * p + c * q


@helper
def product_of_rows(a: np.ndarray, i: int, b: np.ndarray, j: int) -> float:
    """Return the scalar product of row i of one array with row j of another."""
    total = 0.0
    for k in range(a.shape[1]):
        total += a[i, k] * b[j, k]
    return total


@helper
def solve(a: np.ndarray, b: np.ndarray, n: int) -> None:
    """Solve a positive definite system of the first n unknowns in place (Cholesky)."""
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i == j:
                a[i, i] = math.sqrt(max(total, 1e-300))
            else:
                a[i, j] = total / a[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]


@helper
def least_vector(rows: np.ndarray, needed: np.ndarray, met: float, impulse: np.ndarray) -> None:
    """
    Write λ ≥ 0 such that u = Σ λᵢ rowᵢ is the shortest vector with rowᵢ · u ≥ neededᵢ for all i.

    The dual active set method of Goldfarb and Idnani, Mathematical Programming 27, 1983: the most
    violated constraint enters first. If no vector satisfies all, the last iterate is returned.

    Parameters
    ----------
    rows : (k, 6) float
    needed : (k,) float
    met : float
        tolerance of the constraints
    impulse : (k,) float
        λ

    """
    u, z = np.zeros((1, 6)), np.empty((1, 6))
    active, lagrange = np.empty(ACTIVE + 1, np.int64), np.empty(ACTIVE + 1)
    gram, r = np.empty((ACTIVE + 1, ACTIVE + 1)), np.empty(ACTIVE + 1)
    count, entering, of_entering = 0, -1, 0.0
    for _ in range(MOST_CHANGES):
        if entering < 0:
            most = met
            for i in range(len(rows)):
                missing = needed[i] - product_of_rows(rows, i, u, 0)
                if missing > most:
                    entering, most = i, missing
            if entering < 0:
                break
            of_entering = 0.0
            for k in range(count):
                if active[k] == entering:
                    entering = -1  # violated by rounding only
            if entering < 0:
                break
        for k in range(count):
            r[k] = product_of_rows(rows, active[k], rows, entering)
            for m in range(count):
                gram[k, m] = product_of_rows(rows, active[k], rows, active[m])
        solve(gram, r, count)
        for axis in range(6):
            z[0, axis] = rows[entering, axis]
            for k in range(count):
                z[0, axis] -= r[k] * rows[active[k], axis]
        # step until an active constraint leaves, and until the new one is satisfied
        leaving, until_leaving = -1, math.inf
        for k in range(count):
            if r[k] > 0.0 and lagrange[k] < until_leaving * r[k]:
                leaving, until_leaving = k, lagrange[k] / r[k]
        slope = product_of_rows(z, 0, rows, entering)
        own = product_of_rows(rows, entering, rows, entering)
        until_met = math.inf
        if slope > DEPENDENT * own and count < ACTIVE:
            until_met = (needed[entering] - product_of_rows(rows, entering, u, 0)) / slope
        step = min(until_leaving, until_met)
        if step == math.inf:
            break
        if until_met < math.inf:
            for axis in range(6):
                u[0, axis] += step * z[0, axis]
        for k in range(count):
            lagrange[k] -= step * r[k]
        of_entering += step
        if until_met <= until_leaving:
            active[count], lagrange[count] = entering, of_entering
            count, entering = count + 1, -1
        else:
            count -= 1
            for k in range(leaving, count):
                active[k], lagrange[k] = active[k + 1], lagrange[k + 1]
    for i in range(len(impulse)):
        impulse[i] = 0.0
    for k in range(count):
        impulse[active[k]] = max(lagrange[k], 0.0)
