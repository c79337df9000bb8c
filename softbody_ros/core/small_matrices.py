# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Closed formulas for stacks of 3 × 3 matrices, with as few calls as possible.

LAPACK works on one matrix after the other. Here each entry is a row of a long array, (3, 3, N)
`entries`, so that a formula takes the same few calls for 1 matrix and for 100, all of them element
by element: no result depends on what else is in the stack.
"""

from __future__ import annotations

import numpy as np

CYCLE = np.array([0, 1, 2, 0, 1])
REPEATED = (3 * CYCLE[:, None] + CYCLE).ravel()
"""Of nine entries: those of the matrix continued by its first two rows and columns."""
LEAST_DETERMINANT = 1e-4
"""Of a symmetric matrix of trace 1, (1/3)³ at most: below it its eigenvalues tell what to do."""


def entries(matrices: np.ndarray) -> np.ndarray:
    """Return matrices (…, 3, 3) as contiguous entries (3, 3, N)."""
    count = matrices.size // 9
    return np.ascontiguousarray(matrices.reshape(count, 9).T).reshape(3, 3, count)


def stacked(rows: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return entries (3, 3, N) as contiguous matrices of a shape (…, 3, 3)."""
    return np.ascontiguousarray(rows.reshape(9, -1).T).reshape(shape)


def cofactors(rows: np.ndarray) -> np.ndarray:
    """
    Return the cofactor matrices, entries (3, 3, N): the transposed adjugates, det(M) M⁻ᵀ.

    With indices taken modulo 3 no sign is left: Cᵢⱼ = Mᵢ₊₁ⱼ₊₁ Mᵢ₊₂ⱼ₊₂ − Mᵢ₊₁ⱼ₊₂ Mᵢ₊₂ⱼ₊₁.
    """
    m = rows.reshape(9, -1).take(REPEATED, axis=0).reshape(5, 5, -1)
    return m[1:4, 1:4] * m[2:5, 2:5] - m[1:4, 2:5] * m[2:5, 1:4]


def expanded(rows: np.ndarray, cofactor: np.ndarray) -> np.ndarray:
    """Return the determinants (N,) of entries with known cofactors (Laplace's expansion)."""
    return (rows[0] * cofactor[0]).sum(axis=0)


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the matrix products of entries (3, 3, N) with others."""
    return (a[:, :, None] * b).sum(axis=1)


def symmetric_inverse(matrices: np.ndarray, cut: float, least: float) -> np.ndarray:
    """
    Return the pseudo-inverses of positive semidefinite matrices.

    By the adjugate where no eigenvalue is near zero, which is to the same rounding as
    `numpy.linalg.inv`; by eigenvectors for the others.

    Parameters
    ----------
    matrices : (N, 3, 3) float
    cut : float
        eigenvalues up to this fraction of the largest one count as zero; less than
        `LEAST_DETERMINANT`
    least : float
        a largest eigenvalue below it counts as this large; positive

    Returns
    -------
    (N, 3, 3) float

    """
    rows = entries(matrices)
    cofactor = cofactors(rows)
    volume = expanded(rows, cofactor)
    trace = rows[0, 0] + rows[1, 1] + rows[2, 2]
    regular = (volume > LEAST_DETERMINANT * trace**3) & (trace > 3.0 * least)
    if regular.all():
        return stacked(cofactor / volume, matrices.shape)
    result = stacked(cofactor / np.where(regular, volume, 1.0), matrices.shape)
    result[~regular] = _pseudo_inverse(matrices[~regular], cut, least)
    return result


def _pseudo_inverse(matrices: np.ndarray, cut: float, least: float) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrices)
    limit = cut * np.maximum(values[:, -1:], least)
    inverse = np.where(values > limit, 1.0 / np.maximum(values, limit), 0.0)
    return np.matmul(vectors * inverse[:, None, :], vectors.swapaxes(1, 2))
