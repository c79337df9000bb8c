# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sums over particles and maps of them, with the same rounding whatever the number of threads."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

CACHED = 32768
"""Particles that are passed over several times while they are in the cache."""
BLOCK = 8192
"""Numbers of a matrix that a vector is multiplied with: BLAS may split more among threads."""
PRODUCTS = 1 << 18
"""The same for the multiplications in a product of two matrices."""


def blocks(count: int) -> Iterator[slice]:
    """Yield slices of so many particles that stay in the cache, all in all of `count`."""
    for start in range(0, count, CACHED):
        yield slice(start, min(start + CACHED, count))


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
    count = a.shape[-1] // block
    if not count:
        return _sums(a, b)
    whole = count * block
    parts = a[..., :whole].reshape(*a.shape[:-1], count, block)
    # (…, j, count, block) → (…, count, j, block), and the blocks of `a` come before its rows, too
    others = b[..., :whole].reshape(*b.shape[:-1], count, block).swapaxes(-3, -2)
    total = _sums(parts.swapaxes(-3, -2), others).sum(axis=-3)
    return total + _sums(a[..., whole:], b[..., whole:]) if whole < a.shape[-1] else total


def weighted(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the sums (…) float64 of values (…, n) times weights (n,)."""
    return sums(values, weights[None])[..., 0]


def mapped(a: np.ndarray, b: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """
    Return a @ b for few rows and many particles.

    Parameters
    ----------
    a : (…, i, j) float
    b : (…, j, n) or (j, n) float
    out : (…, i, n) float, optional
        where to write it

    Returns
    -------
    (…, i, n) float

    """
    rows, columns = a.shape[-2:]
    count, block = b.shape[-1], PRODUCTS // (rows * columns)
    if count <= block:
        return np.matmul(a, b, out=out)
    if out is None:
        shape = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
        out = np.empty((*shape, rows, count), np.result_type(a, b))
    for start in range(0, count, block):
        part = slice(start, start + block)
        np.matmul(a, b[..., part], out=out[..., part])
    return out


def _sums(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    columns = b.swapaxes(-1, -2)
    if b.ndim > 2:
        columns = columns[..., None, :, :]
    return np.matmul(a[..., :, None, :], columns)[..., 0, :].astype(np.float64, copy=False)
