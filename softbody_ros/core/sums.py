# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sums over particles and maps of them, with the same rounding whatever the number of threads."""

from __future__ import annotations

import numpy as np

BLOCK = 8192
"""Numbers that are multiplied at once: BLAS may split larger products among threads."""


def sums(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """
    Return Σ aᵢ bⱼ over the particles: a product of very flat matrices.

    As one product of a vector with a matrix for each row of `a` and block of particles, which
    takes half the time of a product of two matrices.

    Parameters
    ----------
    a : (…, i, n) float
    b : (…, j, n) or (j, n) float

    Returns
    -------
    (…, i, j) float64

    """
    block = max(BLOCK // b.shape[-2], 1)
    whole = a.shape[-1] // block * block
    total = _in_blocks(a[..., whole:], b[..., whole:], a.shape[-1] - whole)
    return total + _in_blocks(a[..., :whole], b[..., :whole], block) if whole else total


def weighted(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the sums (…) float64 of values (…, n) times weights (n,)."""
    return sums(values, weights[None])[..., 0]


def mapped(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """
    Return a @ b for few rows and many particles.

    Parameters
    ----------
    a : (…, i, j) float
    b : (…, j, n) or (j, n) float

    Returns
    -------
    (…, i, n) float

    """
    count = b.shape[-1]
    if count <= BLOCK:
        return np.matmul(a, b)
    shape = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
    result = np.empty((*shape, a.shape[-2], count), np.result_type(a, b))
    for start in range(0, count, BLOCK):
        block = slice(start, start + BLOCK)
        np.matmul(a, b[..., block], out=result[..., block])
    return result


def _in_blocks(a: np.ndarray, b: np.ndarray, block: int) -> np.ndarray:
    count = a.shape[-1] // block if block else 1
    rows = a.reshape(*a.shape[:-1], count, 1, block)
    # (…, j, n) → (…, 1, count, block, j)
    columns = np.moveaxis(b.reshape(*b.shape[:-1], count, block), -3, -1)[..., None, :, :, :]
    products = np.matmul(rows, columns)[..., 0, :]
    return products.sum(axis=-2, dtype=np.float64)
