# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sums over particles: fast, and with the same rounding whatever the number of threads."""

from __future__ import annotations

import numpy as np

BLOCK = 8192
"""Particles that are summed at once: longer sums may be split among threads by BLAS."""


def sums(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """
    Return Σ aᵢ bⱼ over the particles: a product of very flat matrices.

    As one product of a vector with a matrix for each row of `a`, which takes half the time of a
    product of two matrices.

    Parameters
    ----------
    a : (…, i, n) float
    b : (…, j, n) or (j, n) float

    Returns
    -------
    (…, i, j) float64

    """
    total = _sums(a[..., :BLOCK], b[..., :BLOCK])
    for start in range(BLOCK, a.shape[-1], BLOCK):
        block = slice(start, start + BLOCK)
        total += _sums(a[..., block], b[..., block])
    return total


def weighted(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the sums (…) float64 of values (…, n) times weights (n,)."""
    return sums(values, weights[None])[..., 0]


def _sums(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    columns = b.swapaxes(-1, -2)
    if b.ndim > 2:
        columns = columns[..., None, :, :]
    return np.matmul(a[..., :, None, :], columns)[..., 0, :].astype(np.float64, copy=False)
