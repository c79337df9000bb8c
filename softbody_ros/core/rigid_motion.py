# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rigid part of the motion of a cloud of particles: momentum, inertia, angular velocity.

Everything is per mass and for a stack of B bodies: positions x and velocities v are (B, 3, n).
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.rest_shape import RestShape

INERTIA_CUT = 1e-12
"""Principal inertias below this fraction of the largest count as zero."""


def angular_momentum(
    x: np.ndarray, v: np.ndarray, centre: np.ndarray, rest: RestShape
) -> np.ndarray:
    """Return (B, 3): Σ w (x − centre) × v, m²/s."""
    arms = x - centre.astype(x.dtype)[..., None]
    arms *= rest.weights
    return _spin(arms, v)


def angular_momentum_and_inertia(
    x: np.ndarray, v: np.ndarray, centre: np.ndarray, rest: RestShape
) -> tuple[np.ndarray, np.ndarray]:
    """Return (B, 3) as above, and (B, 3, 3): the inertia tensor about the centre of mass, m²."""
    arms = x - centre.astype(x.dtype)[..., None]
    weighted = arms * rest.weights
    gram = np.matmul(weighted, arms.transpose(0, 2, 1)).astype(np.float64, copy=False)
    trace = np.einsum('bii->b', gram)
    return _spin(weighted, v), trace[:, None, None] * np.eye(3) - gram


def _spin(weighted_arms: np.ndarray, v: np.ndarray) -> np.ndarray:
    product = np.matmul(weighted_arms, v.transpose(0, 2, 1)).astype(np.float64, copy=False)
    spin = product[:, [1, 2, 0], [2, 0, 1]]
    spin -= product[:, [2, 0, 1], [1, 2, 0]]
    return spin


def inverse_inertia(tensor: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return (B, 3, 3): the pseudo-inverse, 1/m²; a rod has no inertia about its axis."""
    values, vectors = np.linalg.eigh(tensor)
    cut = INERTIA_CUT * np.maximum(values[:, -1], rest.scale**2 * INERTIA_CUT)
    inverse = np.where(values > cut[:, None], 1.0 / np.maximum(values, cut[:, None]), 0.0)
    return np.matmul(vectors * inverse[:, None, :], vectors.transpose(0, 2, 1))


def applied(tensor: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the products (B, 3) of tensors (B, 3, 3) with vectors (B, 3)."""
    return np.matmul(tensor, vectors[..., None])[..., 0]


def field(
    x: np.ndarray, centre: np.ndarray, linear: np.ndarray, angular: np.ndarray
) -> np.ndarray:
    """
    Return the velocities of a rigid motion: linear + angular × (x − centre).

    Parameters
    ----------
    x : (B, 3, n) float
        m
    centre, linear, angular : (B, 3) float
        m, m/s, rad/s

    Returns
    -------
    (B, 3, n) float
        m/s

    """
    cross = np.zeros((len(angular), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]] = angular
    cross[:, [1, 2, 0], [2, 0, 1]] = -angular
    velocity = np.matmul(cross.astype(x.dtype, copy=False), x)
    velocity += (linear - applied(cross, centre)).astype(x.dtype)[..., None]
    return velocity
