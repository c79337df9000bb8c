# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rigid component of the motion of particles: momentum, inertia, angular velocity.

Everything is per mass, about the centre of mass.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.vectors import (
    NO_MATRIX,
    ZERO,
    Matrix,
    Vector,
    added,
    along,
    column_of,
    cross,
    minus,
    outer,
    plus,
    put_matrix,
    put_vector,
    scaled,
)
from softbody_ros.core.shape_matching.polar_decomposition import symmetric_inverse

INERTIA_CUT = 1e-12
"""Principal inertias below this fraction of the largest count as zero."""


@helper
def inertia_of(gram: Matrix) -> Matrix:
    """Return the inertia tensor tr(G) 1 − G of the second moments G = Σ w r rᵀ."""
    trace = gram[0][0] + gram[1][1] + gram[2][2]
    return (
        (trace - gram[0][0], -gram[0][1], -gram[0][2]),
        (-gram[1][0], trace - gram[1][1], -gram[1][2]),
        (-gram[2][0], -gram[2][1], trace - gram[2][2]),
    )


@helper
def inverse_inertia_of(gram: Matrix, scale: float) -> Matrix:
    """Return the pseudo-inverse of the inertia, 1/m²: zero about the axis of a rod."""
    return symmetric_inverse(inertia_of(gram), INERTIA_CUT, INERTIA_CUT * scale * scale)


@helper
def measure(
    x: np.ndarray, v: np.ndarray, first: int, weights: np.ndarray
) -> tuple[Vector, Vector, Vector, Matrix]:
    """
    Return centre, velocity, angular momentum and second moments of a body.

    Parameters
    ----------
    x, v : (3, N) float
        m, m/s
    first : int
        its first particle
    weights : (n,) float
        mass shares of its particles

    """
    centre = ZERO
    for i in range(len(weights)):
        centre = along(centre, weights[i], column_of(x, first + i))
    velocity, angular_momentum, gram = measure_about(x, v, first, weights, centre)
    return centre, velocity, angular_momentum, gram


@helper
def measure_about(
    x: np.ndarray, v: np.ndarray, first: int, weights: np.ndarray, centre: Vector
) -> tuple[Vector, Vector, Matrix]:
    """Return velocity, angular momentum and second moments about a known centre of mass."""
    velocity, angular_momentum, gram = ZERO, ZERO, NO_MATRIX
    for i in range(len(weights)):
        arm = minus(column_of(x, first + i), centre)
        weighted_arm, velocity_i = scaled(weights[i], arm), column_of(v, first + i)
        velocity = along(velocity, weights[i], velocity_i)
        angular_momentum = plus(angular_momentum, cross(weighted_arm, velocity_i))
        gram = added(gram, outer(weighted_arm, arm))
    return velocity, angular_momentum, gram


@helper
def put_motion(
    body: np.void, centre: Vector, velocity: Vector, angular_momentum: Vector, inverse: Matrix
) -> None:
    """Write the rigid motion of a body into its record."""
    put_vector(body['centre'], centre)
    put_vector(body['velocity'], velocity)
    put_vector(body['angular_momentum'], angular_momentum)
    put_matrix(body['inverse_inertia'], inverse)


@kernel
def motion_of(
    x: np.ndarray, v: np.ndarray, weights: np.ndarray, scale: float, result: np.ndarray
) -> None:
    """
    Write the rigid component of the motion of one body.

    Parameters
    ----------
    x, v : (3, n) float
        m, m/s
    weights : (n,) float
        mass shares
    scale : float
        RMS radius, m
    result : (6, 3) float
        centre, m; velocity, m/s; angular momentum, m²/s; inverse inertia (3 rows), 1/m²

    """
    centre, velocity, angular_momentum, gram = measure(x, v, 0, weights)
    put_vector(result[0], centre)
    put_vector(result[1], velocity)
    put_vector(result[2], angular_momentum)
    put_matrix(result[3:], inverse_inertia_of(gram, scale))
