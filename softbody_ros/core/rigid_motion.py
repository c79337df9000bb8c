# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rigid part of the motion of a cloud of particles: momentum, inertia, angular velocity.

Everything is per mass and for a stack of B bodies: positions x and velocities v are (B, 3, n).
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.rest_shape import RestShape

INERTIA_FLOOR = 1e-13
"""Share of its own size added to an inertia tensor: a rod has none about its axis."""


def angular_momentum(
    x: np.ndarray, v: np.ndarray, centre: np.ndarray, rest: RestShape
) -> np.ndarray:
    """Return (B, 3): Σ w (x − centre) × v, m²/s."""
    arms = (x - centre.astype(x.dtype)[..., None]) * rest.weights
    product = np.matmul(arms, v.transpose(0, 2, 1)).astype(np.float64, copy=False)
    return np.stack(
        [
            product[:, 1, 2] - product[:, 2, 1],
            product[:, 2, 0] - product[:, 0, 2],
            product[:, 0, 1] - product[:, 1, 0],
        ],
        axis=-1,
    )


def inertia(x: np.ndarray, centre: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return (B, 3, 3): the inertia tensor about the centre of mass, m²."""
    offsets = x - centre.astype(x.dtype)[..., None]
    gram = np.matmul(offsets * rest.weights, offsets.transpose(0, 2, 1)).astype(np.float64)
    trace = np.trace(gram, axis1=1, axis2=2)
    return trace[:, None, None] * np.eye(3) - gram


def angular_velocity(spin: np.ndarray, tensor: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return (B, 3): the ω of a rigid body with this angular momentum and inertia, rad/s."""
    floor = INERTIA_FLOOR * (np.trace(tensor, axis1=1, axis2=2) + rest.scale**2)
    raised = tensor + floor[:, None, None] * np.eye(3)
    omega = np.linalg.solve(raised, spin[..., None])
    # one refinement takes the floor's own error away
    omega += np.linalg.solve(raised, spin[..., None] - tensor @ omega)
    return omega[..., 0]


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
    velocity = np.matmul(cross.astype(x.dtype), x - centre.astype(x.dtype)[..., None])
    velocity += linear.astype(x.dtype)[..., None]
    return velocity
