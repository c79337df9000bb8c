# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Positive definite linear systems of blocks: Cholesky factorisation of sparse ones.

A sum of products waits for each addition in turn: so three go side by side, each in its order.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper


@helper
def factorise(counts: np.ndarray, h: np.ndarray, filled: np.ndarray) -> None:
    """
    Factorise a positive definite matrix in place: L of the Cholesky factorisation.

    Golub and Van Loan, Matrix Computations, section 4.2.

    Parameters
    ----------
    counts : (m,) int
        unknowns of each block, multiples of 3
    h : (m, m, M, M) float
        blocks; the lower ones are read and written
    filled : (m, m) bool
        which of them are not zero; what fills in is added. The others may hold anything

    """
    members = len(counts)
    for c in range(members):
        factorise_block(counts[c], h[c, c])
        for r in range(c + 1, members):
            if filled[r, c]:
                divide_block(counts[r], counts[c], h[r, c], h[c, c])
        for r in range(c + 1, members):
            if not filled[r, c]:
                continue
            for s in range(c + 1, r + 1):
                if filled[s, c]:
                    if not filled[r, s]:
                        fill(r, s, counts, h, filled)
                    subtract_product(counts[r], counts[s], counts[c], h[r, s], h[r, c], h[s, c])


@helper
def fill(r: int, c: int, counts: np.ndarray, h: np.ndarray, filled: np.ndarray) -> None:
    """Make a block one that may not be zero; so far it is."""
    filled[r, c] = True
    for i in range(counts[r]):
        for j in range(counts[c]):
            h[r, c, i, j] = 0.0


@helper
def factorise_block(count: int, block: np.ndarray) -> None:
    """Write L of a diagonal block."""
    for i in range(count):
        for j in range(i + 1):
            total = block[i, j]
            for k in range(j):
                total -= block[i, k] * block[j, k]
            block[i, j] = math.sqrt(total) if i == j else total / block[j, j]


@helper
def divide_block(rows: int, columns: int, block: np.ndarray, diagonal: np.ndarray) -> None:
    """Write B L⁻ᵀ."""
    for i in range(0, rows, 3):
        for j in range(columns):
            one, two, three = block[i, j], block[i + 1, j], block[i + 2, j]
            for k in range(j):
                factor = diagonal[j, k]
                one -= block[i, k] * factor
                two -= block[i + 1, k] * factor
                three -= block[i + 2, k] * factor
            divisor = diagonal[j, j]
            block[i, j], block[i + 1, j] = one / divisor, two / divisor
            block[i + 2, j] = three / divisor


@helper
def subtract_product(
    rows: int, columns: int, inner: int, block: np.ndarray, left: np.ndarray, right: np.ndarray
) -> None:
    """Write B − A₁ A₂ᵀ."""
    for i in range(rows):
        for j in range(0, columns, 3):
            one, two, three = block[i, j], block[i, j + 1], block[i, j + 2]
            for k in range(inner):
                factor = left[i, k]
                one -= factor * right[j, k]
                two -= factor * right[j + 1, k]
                three -= factor * right[j + 2, k]
            block[i, j], block[i, j + 1], block[i, j + 2] = one, two, three


@helper
def substitute(counts: np.ndarray, h: np.ndarray, filled: np.ndarray, x: np.ndarray) -> None:
    """
    Solve L Lᵀ x = b in place.

    Parameters
    ----------
    counts, h, filled
        see `factorise`
    x : (m, M) float
        b, and the result

    """
    members = len(counts)
    for r in range(members):
        for c in range(r):
            if filled[r, c]:
                for i in range(0, counts[r], 3):
                    one, two, three = x[r, i], x[r, i + 1], x[r, i + 2]
                    for j in range(counts[c]):
                        factor = x[c, j]
                        one -= h[r, c, i, j] * factor
                        two -= h[r, c, i + 1, j] * factor
                        three -= h[r, c, i + 2, j] * factor
                    x[r, i], x[r, i + 1], x[r, i + 2] = one, two, three
        for i in range(counts[r]):
            total = x[r, i]
            for j in range(i):
                total -= h[r, r, i, j] * x[r, j]
            x[r, i] = total / h[r, r, i, i]
    for r in range(members - 1, -1, -1):
        for c in range(r + 1, members):
            if filled[c, r]:
                for i in range(counts[c]):
                    for j in range(counts[r]):
                        x[r, j] -= h[c, r, i, j] * x[c, i]
        for i in range(counts[r] - 1, -1, -1):
            total = x[r, i]
            for j in range(i + 1, counts[r]):
                total -= h[r, r, j, i] * x[r, j]
            x[r, i] = total / h[r, r, i, i]
