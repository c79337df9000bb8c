# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pins: particles with prescribed positions, fixed, moving with a velocity or with an obstacle.

Constraining the few pinned particles alone would not hold the body, which is much heavier. So in
the match, and only there, the pins have many times the weight of the body, in its centre, its
moments and its inverse Gram matrix alike: a least squares fit that passes through the pins. Free
particles are pulled to that goal with their own masses, as to any other, so the pull remains
conservative, and the body is suspended with its own weight. (Large weights in the centre of mass
alone, a common error, rotate and stretch the shape about a wrong point.)

Pins that are attached to an obstacle keep their offsets in its frame: they are put there at the
start of a tick too, so they follow an obstacle that is placed elsewhere, and do not drift.

What a body is free to do as a whole is to turn about its only pin, or about the line of its pins,
see `allowed_axes`; otherwise it moves as these.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
import dataclasses
from dataclasses import dataclass

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.config import BodyConfig, ConfigError, in_brackets
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    NO_MATRIX,
    ZERO,
    Matrix,
    Vector,
    added,
    applied,
    column_of,
    combined,
    cross,
    matrix_of,
    minus,
    norm,
    outer,
    plus,
    product,
    put_column,
    put_vector,
    scaled,
    times,
    vector_of,
)
from softbody_ros.core.shape_matching.polar_decomposition import (
    orthogonal_columns,
    rotation_by_vector,
)
from softbody_ros.core.shape_matching.regions import Regions, make_regions
from softbody_ros.core.shape_matching.rest_shape import RestShape, make_rest_shape
from softbody_ros.core.shape_matching.rigid_motion import inertia_of, inverse_inertia_of

COUPLING = 100.0
"""Weight of all pins in the match, in body masses."""
THIN = 1e-2
"""Inertia about an axis, per mass and squared RMS radius, below which a body turns about it
particle by particle, not as a whole: a rod that is bent a little would turn by any angle."""
SPREAD = 1e-10
"""Squared extent of the pins, relative to the RMS radius, below which they are a point or line."""


@dataclass(frozen=True, eq=False)
class Pins:
    """
    The pins of one body.

    Attributes
    ----------
    particle : (m,) int
    linear, angular : (3,) float
        prescribed velocity of their centre, m/s, and angular velocity about it, rad/s
    rest : RestShape
        that of the body, with the weights of the match
    regions : Regions or None
        those of the body, with these weights
    offset : (m, 3) float or None
        where they are in the frame of an obstacle that they are attached to, m; then it moves
        them, and the velocities are 0
    holder : hashable
        the key of that obstacle, see `World.obstacle_keys`

    """

    particle: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    rest: RestShape
    regions: Regions | None
    offset: np.ndarray | None = None
    holder: Hashable = None

    @property
    def moves(self) -> bool:
        """Whether the prescribed velocity is not zero."""
        return bool(self.linear.any() or self.angular.any())


def make_pins(body: BodyConfig, rest: RestShape, before: Pins | None = None) -> Pins | None:
    """
    Return the pins of a body, or None if it has none.

    Parameters
    ----------
    body : BodyConfig
    rest : RestShape
    before : Pins, optional
        the previous pins, reused if the same particles are pinned

    Raises
    ------
    ConfigError
        if a pinned vertex does not exist.

    """
    particle = pinned_particles(body, rest)
    if not len(particle):
        return None
    linear, angular = np.array(body.pins_velocity_linear), np.array(body.pins_velocity_angular)
    if before is None or not np.array_equal(before.particle, particle):
        before = _holding(particle, body, rest)
    return dataclasses.replace(before, linear=linear, angular=angular, offset=None, holder=None)


def attached_pins(
    particle: np.ndarray, holder: Hashable, offset: np.ndarray, body: BodyConfig, rest: RestShape
) -> Pins:
    """Return pins that move with an obstacle, see `Pins`."""
    return dataclasses.replace(_holding(particle, body, rest), holder=holder, offset=offset)


def _holding(particle: np.ndarray, body: BodyConfig, rest: RestShape) -> Pins:
    """Return fixed pins with the weights of the match."""
    weights = rest.weights.copy()
    pinned_weights = np.maximum(weights[particle], 1e-12)
    weights[particle] += COUPLING * pinned_weights / pinned_weights.sum()
    weights /= weights.sum()
    regions = None
    if body.regions_count:
        regions = make_regions(rest, body.regions_count, body.regions_overlap, weights)
    matched, still = make_rest_shape(rest.surface, weights, rest.inner), np.zeros(3)
    return Pins(particle, still, still, matched, regions)


def pinned_particles(body: BodyConfig, rest: RestShape) -> np.ndarray:
    """
    Return the indices of the particles that a body's `pins` name, in order.

    Raises
    ------
    ConfigError
        if there is no such vertex.

    """
    return particles_of(f'{body.prefix}pins', body.pins_indices, body.pins_box, rest)


def particles_of(
    prefix: str, indices: Sequence[int], box: Sequence[float], rest: RestShape
) -> np.ndarray:
    """Return the indices of particles that are named, or in a box of the mesh, in order."""
    count, named = rest.surface_count, np.array(indices, dtype=np.int64)
    if (named >= count).any():
        raise ConfigError(
            f'{prefix}.indices has {named[named >= count][0]}: the mesh has the vertices 0 to '
            f'{count - 1}'
        )
    chosen = np.zeros(count, dtype=bool)
    chosen[named] = True
    if any(box):
        corners = np.reshape(box, (2, 3))
        vertices = rest.surface.vertices
        inside = (corners.min(axis=0) <= vertices) & (vertices <= corners.max(axis=0))
        inside = inside.all(axis=1)
        chosen |= inside
        if not inside.any():
            low, high = in_brackets(vertices.min(axis=0)), in_brackets(vertices.max(axis=0))
            raise ConfigError(
                f'{prefix}.box is {list(box)}: no vertex is inside, the mesh reaches from {low} '
                f'to {high} m'
            )
    return np.flatnonzero(chosen)


@helper
def centre_of(particle: np.ndarray, x: np.ndarray) -> Vector:
    """Return the mean position of particles, m."""
    total = ZERO
    for k in range(len(particle)):
        total = plus(total, column_of(x, particle[k]))
    return scaled(1.0 / len(particle), total)


@helper
def allowed_axes(particle: np.ndarray, x: np.ndarray, scale: float) -> tuple[Vector, Matrix]:
    """
    Return the centre of the pins, m, and the projector on the axes about which they let turn.

    That is the identity for pins in one point, k kᵀ for those on a line along k, or else 0.

    Parameters
    ----------
    particle : (m,) int
        pinned particles, as columns of x
    x : (3, N) float
        m
    scale : float
        RMS radius of the body, m

    """
    centre, spread = centre_of(particle, x), NO_MATRIX
    for k in range(len(particle)):
        arm = scaled(1.0 / scale, minus(column_of(x, particle[k]), centre))
        spread = added(spread, outer(arm, arm))
    columns, axes = orthogonal_columns(spread)
    largest, others = 0, 0.0
    for k in range(3):
        if norm(columns[k]) > norm(columns[largest]):
            largest = k
    for k in range(3):
        if k != largest:
            others = max(others, norm(columns[k]))
    if norm(columns[largest]) <= SPREAD:
        return centre, IDENTITY
    if others <= SPREAD:
        return centre, outer(axes[largest], axes[largest])
    return centre, NO_MATRIX


@helper
def inverse_about(allowed: Matrix, gram: Matrix, scale: float, cut: float) -> Matrix:
    """
    Return the inverse inertia for rotations about allowed axes only, 1/m².

    Parameters
    ----------
    allowed : matrix
        projector on the axes, see `allowed_axes`
    gram : matrix
        second moments about the pins, m²
    scale : float
        RMS radius of the body, m
    cut : float
        principal inertia, in squares of that, below which it does not turn

    """
    least = cut * scale * scale
    if allowed[0][0] + allowed[1][1] + allowed[2][2] > 2.0:
        columns, axes = orthogonal_columns(inertia_of(gram))
        result, turns = NO_MATRIX, 0
        for k in range(3):
            inertia = norm(columns[k])
            if inertia > least:
                result = combined(1.0, result, 1.0 / inertia, outer(axes[k], axes[k]))
                turns += 1
        # the inverse is more precise than the sum over axes
        return inverse_inertia_of(gram, scale) if turns == 3 else result
    about = product(allowed, inertia_of(gram))
    inertia = about[0][0] + about[1][1] + about[2][2]
    return times(1.0 / inertia if inertia > least else 0.0, allowed)


@kernel
def follow_obstacles(
    bodies: np.ndarray,
    pinned: np.ndarray,
    particle: np.ndarray,
    offset: np.ndarray,
    obstacles: np.ndarray,
    x: np.ndarray,
    h: float,
) -> None:
    """
    Let pins that are attached to obstacles begin a tick where these are, and move with them.

    Parameters
    ----------
    bodies : (B,) BODY
        what pins prescribe in the tick is written
    pinned : (k,) int
        bodies with pins
    particle : (m,) int
        pinned particles of all bodies, as particles of the world
    offset : (3, m) float
        in the frames of obstacles, m
    obstacles : (O,) OBSTACLE
    x : (2, 3, N) float
        m; the half that has the state is changed
    h : float
        s

    """
    for index in range(len(pinned)):
        body = bodies[pinned[index]]
        if body['holder'] < 0:
            continue
        obstacle, first = obstacles[body['holder']], body['first_pin']
        origin, rotation = vector_of(obstacle['position']), matrix_of(obstacle['rotation'])
        origin_before = vector_of(obstacle['position_before'])
        rotation_before, middle = matrix_of(obstacle['rotation_before']), ZERO
        for k in range(first, first + body['pins']):
            own = column_of(offset, k)
            middle = plus(middle, own)
            put_column(
                x[body['now']], particle[k], plus(origin_before, applied(rotation_before, own))
            )
        middle = scaled(1.0 / body['pins'], middle)
        arm, arm_before = applied(rotation, middle), applied(rotation_before, middle)
        linear, angular = obstacle_twist(obstacle)
        start = plus(linear, cross(angular, arm_before))
        put_vector(body['pins_linear'], start)
        put_vector(body['pins_angular'], angular)
        put_vector(body['pins_shift'], plus(minus(origin, origin_before), minus(arm, arm_before)))
        end = plus(linear, cross(angular, arm))
        put_vector(body['pins_acceleration'], scaled(1.0 / h, minus(end, start)))


@helper
def obstacle_twist(obstacle: np.void) -> tuple[Vector, Vector]:
    """Return the velocity of the origin of an OBSTACLE, m/s, and its angular velocity, rad/s."""
    if obstacle['moves']:
        return vector_of(obstacle['linear']), vector_of(obstacle['angular'])
    return ZERO, ZERO


@kernel
def hold(
    bodies: np.ndarray,
    pinned: np.ndarray,
    particle: np.ndarray,
    offset: np.ndarray,
    obstacles: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    h: float,
) -> None:
    """
    Set pinned particles to their prescribed positions and velocities.

    Parameters
    ----------
    bodies, pinned, particle, offset, obstacles, h
        see `follow_obstacles`
    x, v : (2, 3, N) float
        m, m/s; the half that is being computed is changed

    """
    for index in range(len(pinned)):
        body = bodies[pinned[index]]
        now, first, last = body['now'], body['first_pin'], body['first_pin'] + body['pins']
        if body['holder'] < 0:
            move_pinned(
                particle[first:last], x[now], vector_of(body['pins_linear']),
                vector_of(body['pins_angular']), h, x[1 - now], v[1 - now],
            )  # fmt: skip
            continue
        obstacle = obstacles[body['holder']]
        origin, rotation = vector_of(obstacle['position']), matrix_of(obstacle['rotation'])
        linear, angular = obstacle_twist(obstacle)
        for k in range(first, last):
            arm = applied(rotation, column_of(offset, k))
            put_column(x[1 - now], particle[k], plus(origin, arm))
            put_column(v[1 - now], particle[k], plus(linear, cross(angular, arm)))


@helper
def move_pinned(
    particle: np.ndarray,
    start: np.ndarray,
    linear: Vector,
    angular: Vector,
    h: float,
    x: np.ndarray,
    v: np.ndarray,
) -> None:
    """Write the prescribed positions and velocities of pinned particles after a tick."""
    if linear == ZERO and angular == ZERO:
        for k in range(len(particle)):
            put_column(x, particle[k], column_of(start, particle[k]))
            put_column(v, particle[k], ZERO)
        return
    centre = centre_of(particle, start)
    rotation, new_centre = rotation_by_vector(scaled(h, angular)), plus(centre, scaled(h, linear))
    for k in range(len(particle)):
        arm = applied(rotation, minus(column_of(start, particle[k]), centre))
        put_column(x, particle[k], plus(new_centre, arm))
        put_column(v, particle[k], plus(linear, cross(angular, arm)))
