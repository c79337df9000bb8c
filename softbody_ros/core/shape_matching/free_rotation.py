# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rotation of the free rigid body in a tick, by the implicit midpoint rule."""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Matrix,
    Vector,
    along,
    applied,
    applied_transposed,
    cross,
    dot,
    minus,
    plus,
    product,
    scaled,
    transposed,
    vector_of,
)

TURN_STEPS, TURN_CONVERGED = 12, 1e-13
"""Most fixed-point iterations of the midpoint rule for rotation, and the relative change of the
angular velocity that ends them: unsolved, the rule loses energy of rotation."""
LARGEST_TURN = 1e4
"""Angle of rotation in one tick beyond which it has no meaning, rad."""
SERIES = tuple((1 / (2 * k * (2 * k + 1)), 1 / (2 * k * (2 * k - 1))) for k in range(8, 0, -1))
"""Ratios of successive terms of the power series of sine and cosine, from the last one on."""


@helper
def rotation_by(a: Vector) -> Matrix:
    """
    Return the rotation about a by |a| radians, by operations with the same rounding everywhere.

    A unit quaternion, by power series of the sine and cosine of an angle that is halved until it
    is small, and then doubled.
    """
    size = dot(a, a)
    if size > LARGEST_TURN * LARGEST_TURN:
        factor = LARGEST_TURN / math.sqrt(size)
        a, size = scaled(factor, a), LARGEST_TURN * LARGEST_TURN
    z, halvings = 0.25 * size, 0
    while z > 0.25 and halvings < 32:
        z *= 0.25
        halvings += 1
    sine = cosine = 1.0
    for k in range(len(SERIES)):
        sine = 1.0 - z * SERIES[k][0] * sine
        cosine = 1.0 - z * SERIES[k][1] * cosine
    for _ in range(halvings):
        # of the double angle: sin 2φ / 2φ and cos 2φ
        sine, cosine = sine * cosine, 1.0 - 2.0 * z * sine * sine
        z *= 4.0
    x, y, w = 0.5 * sine * a[0], 0.5 * sine * a[1], cosine
    s = 0.5 * sine * a[2]
    factor = 2.0 / (w * w + x * x + y * y + s * s)
    return (
        (1.0 - factor * (y * y + s * s), factor * (x * y - w * s), factor * (x * s + w * y)),
        (factor * (x * y + w * s), 1.0 - factor * (x * x + s * s), factor * (y * s - w * x)),
        (factor * (x * s - w * y), factor * (y * s + w * x), 1.0 - factor * (x * x + y * y)),
    )


@helper
def wrench_in(body: np.void, axes: Matrix) -> tuple[Vector, Vector]:
    """Return force, m/s², and torque, m²/s², on a body with given axes, per mass."""
    wrench = body['wrench']
    force = plus(vector_of(wrench[0, 0]), applied(axes, vector_of(wrench[1, 0])))
    return force, plus(vector_of(wrench[0, 1]), applied(axes, vector_of(wrench[1, 1])))


@helper
def rotate(
    body: np.void,
    posture: Matrix,
    inverse: Matrix,
    spin: Vector,
    arm: Vector,
    gravity: Vector,
    h: float,
) -> tuple[Matrix, Vector, Vector]:
    """
    Return the rotation of the free rigid body in the tick by the midpoint rule.

    Parameters
    ----------
    body : BODY
    posture : matrix
        its axes at the start
    inverse : matrix
        inverse inertia at the middle, in axes that turn, 1/m²
    spin : vector
        angular momentum, which is constant but for the torque, per mass, m²/s
    arm : vector
        from what the body turns about to the centre of mass, m
    gravity : vector
        m/s²

    Returns
    -------
    turn : matrix
    acceleration, torque : vector
        by gravity and the wrench, m/s² and, about what it turns about, m²/s²

    """
    rate, acceleration, torque = applied(inverse, spin), gravity, ZERO
    for _ in range(TURN_STEPS):
        turn = rotation_by(scaled(0.5 * h, rate))
        if body['has_wrench']:
            force, torque = wrench_in(body, product(turn, posture))
            acceleration = plus(gravity, force)
        moment = plus(torque, cross(applied(turn, arm), acceleration))
        before = rate
        rate = applied_transposed(turn, along(spin, 0.5 * h, moment))
        rate = applied(turn, applied(inverse, rate))
        change = minus(rate, before)
        if dot(change, change) <= TURN_CONVERGED * TURN_CONVERGED * dot(rate, rate):
            break
    return rotation_by(scaled(h, rate)), acceleration, moment


@helper
def turned(turn: Matrix, tensor: Matrix) -> Matrix:
    """Return E A Eᵀ."""
    return product(product(turn, tensor), transposed(turn))
