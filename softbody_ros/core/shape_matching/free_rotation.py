# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Rotation of the free rigid body in a tick, by the implicit midpoint rule.

By more than a third of a radian in a tick it would be inaccurate, and of what spins fast, or is
thin, as a rod, its equations are not solved by a few iterations: then exact rotations about the
principal axes take turns.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    ZERO,
    Matrix,
    Vector,
    along,
    applied,
    applied_transposed,
    cross,
    dot,
    minus,
    norm,
    plus,
    product,
    scaled,
    transposed,
    vector_of,
)
from softbody_ros.core.shape_matching.polar_decomposition import orthogonal_columns

TURN_STEPS, TURN_CONVERGED = 40, 1e-13
"""Most fixed-point iterations of the midpoint rule for rotation, and the relative change of the
angular velocity that ends them: unsolved, the rule loses energy of rotation."""
LARGEST_ANGLE = 0.3
"""Rotation in a tick, rad, up to which the midpoint rule is accurate: it errs by a twelfth of the
square."""
LARGEST_PART, MOST_PARTS = 0.05, 256
"""Angle, rad, of the parts into which a tick is split where the rule is not used, or not solved;
their number at most."""
OUTER = 1.0 / (2.0 - 2.0 ** (1.0 / 3.0))
"""Steps of a part into which it is divided, OUTER, 1 − 2 OUTER, OUTER: then errors are of fourth
order (Yoshida)."""
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
    Return the rotation of the free rigid body in the tick.

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
    rate = applied(inverse, spin)
    iterations = TURN_STEPS if h * norm(rate) <= LARGEST_ANGLE else 0
    for _ in range(iterations):
        turn = rotation_by(scaled(0.5 * h, rate))
        acceleration, moment = loads(body, posture, turn, arm, gravity)
        before = rate
        rate = applied_transposed(turn, along(spin, 0.5 * h, moment))
        rate = applied(turn, applied(inverse, rate))
        change = minus(rate, before)
        if dot(change, change) <= TURN_CONVERGED * TURN_CONVERGED * dot(rate, rate):
            return rotation_by(scaled(h, rate)), acceleration, moment
    turn = split_rotation(inverse, spin, 0.5 * h)
    acceleration, moment = loads(body, posture, turn, arm, gravity)
    return split_rotation(inverse, along(spin, 0.5 * h, moment), h), acceleration, moment


@helper
def loads(
    body: np.void, posture: Matrix, turn: Matrix, arm: Vector, gravity: Vector
) -> tuple[Vector, Vector]:
    """Return acceleration, m/s², and torque, m²/s², of a body that has turned, see `rotate`."""
    acceleration, torque = gravity, ZERO
    if body['has_wrench']:
        force, torque = wrench_in(body, product(turn, posture))
        acceleration = plus(gravity, force)
    return acceleration, plus(torque, cross(applied(turn, arm), acceleration))


@helper
def split_rotation(inverse: Matrix, spin: Vector, h: float) -> Matrix:
    """
    Return the rotation of a free rigid body in a time h, s, of any angle.

    The energy is that of a symmetric top, the motion of which is known, and small parts of single
    axes, which are rotations about these; their motions take turns (Strang), so that angular
    momentum is exact, in steps that make the error one of fourth order: of a rod there is none.
    Dullweber, Leimkuhler, McLachlan: Symplectic splitting methods for rigid body molecular
    dynamics, J. Chem. Phys. 107, 1997. Yoshida: Construction of higher order symplectic
    integrators, Phys. Lett. A 150, 1990.

    Parameters
    ----------
    inverse : matrix
        inverse inertia, 1/m²
    spin : vector
        angular momentum, per mass, m²/s
    h : float

    """
    columns, axes = orthogonal_columns(inverse)
    rates = (norm(columns[0]), norm(columns[1]), norm(columns[2]))
    lone = 0
    for k in range(1, 3):
        others = abs(rates[(k + 1) % 3] - rates[(k + 2) % 3])
        if others < abs(rates[(lone + 1) % 3] - rates[(lone + 2) % 3]):
            lone = k
    one, two = (lone + 1) % 3, (lone + 2) % 3
    mean, uneven = 0.5 * (rates[one] + rates[two]), 0.5 * (rates[one] - rates[two])
    more = rates[lone] - mean
    # the spin about that axis, and what may come to it
    size = norm(spin)
    most = abs(dot(spin, axes[lone])) + h * abs(uneven) * size * size
    angle = h * (abs(more) * most + abs(uneven) * size)
    parts = 1
    while parts < MOST_PARTS and angle > LARGEST_PART * parts:
        parts *= 2
    turn = IDENTITY
    for step in range(3 * parts):
        part = h / parts * (OUTER if step % 3 != 1 else 1.0 - 2.0 * OUTER)
        about_spin = rotation_by(scaled(0.5 * part * mean, spin))
        turn = product(about_spin, turned_about(axes[lone], spin, 0.5 * part * more, turn))
        turn = turned_about(axes[one], spin, 0.5 * part * uneven, turn)
        turn = turned_about(axes[two], spin, -part * uneven, turn)
        turn = turned_about(axes[one], spin, 0.5 * part * uneven, turn)
        turn = product(about_spin, turned_about(axes[lone], spin, 0.5 * part * more, turn))
    return turn


@helper
def turned_about(axis: Vector, spin: Vector, factor: float, turn: Matrix) -> Matrix:
    """Return a rotation, and one about an axis of the body by a multiple of the spin along it."""
    direction = applied(turn, axis)
    angle = factor * dot(spin, direction)
    return product(rotation_by(scaled(angle, direction)), turn)


@helper
def turned(turn: Matrix, tensor: Matrix) -> Matrix:
    """Return E A Eᵀ."""
    return product(product(turn, tensor), transposed(turn))
