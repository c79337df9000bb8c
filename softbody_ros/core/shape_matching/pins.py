# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pins: particles with prescribed positions, fixed or moving with a velocity.

Constraining the few pinned particles alone would not hold the body, which is much heavier. So in
the match, and only there, the pins have many times the weight of the body, in its centre, its
moments and its inverse Gram matrix alike: a least squares fit that passes through the pins. Free
particles are pulled to that goal with their own masses, as to any other, so the pull remains
conservative, and the body is suspended with its own weight. (Large weights in the centre of mass
alone, a common error, rotate and stretch the shape about a wrong point.)

Rigid bodies are moved to their pins by the least motion that does so.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.config import BodyConfig, ConfigError, in_brackets
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    applied,
    column_of,
    cross,
    minus,
    plus,
    put_column,
    scaled,
    vector_of,
)
from softbody_ros.core.shape_matching.polar_decomposition import rotation_by_vector
from softbody_ros.core.shape_matching.regions import Regions, make_regions
from softbody_ros.core.shape_matching.rest_shape import (
    RANK_CUT,
    RestShape,
    make_rest_shape,
    pseudo_inverse,
    weighted_mean,
)

COUPLING = 100.0
"""Weight of all pins in the match, in body masses."""
RIGID_ROUNDS = 3
"""Newton steps by which a rigid body is moved to its pins; each squares the error."""


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

    """

    particle: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    rest: RestShape
    regions: Regions | None

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
    if before is not None and np.array_equal(before.particle, particle):
        return dataclasses.replace(before, linear=linear, angular=angular)
    weights = rest.weights.copy()
    pinned_weights = np.maximum(weights[particle], 1e-12)
    weights[particle] += COUPLING * pinned_weights / pinned_weights.sum()
    weights /= weights.sum()
    regions = None
    if body.regions_count:
        regions = make_regions(rest, body.regions_count, body.regions_overlap, weights)
    matched = make_rest_shape(rest.surface, weights)
    return Pins(particle, linear, angular, matched, regions)


def pinned_particles(body: BodyConfig, rest: RestShape) -> np.ndarray:
    """
    Return the indices of the particles that a body's `pins` name, in order.

    Raises
    ------
    ConfigError
        if there is no such vertex.

    """
    beyond = [index for index in body.pins_indices if index >= rest.particle_count]
    if beyond:
        raise ConfigError(
            f'{body.prefix}pins.indices has {beyond[0]}: the mesh has the vertices 0 to '
            f'{rest.particle_count - 1}'
        )
    chosen = np.zeros(rest.particle_count, dtype=bool)
    chosen[list(body.pins_indices)] = True
    if any(body.pins_box):
        corners = np.reshape(body.pins_box, (2, 3))
        vertices = rest.surface.vertices
        inside = (corners.min(axis=0) <= vertices) & (vertices <= corners.max(axis=0))
        inside = inside.all(axis=1)
        chosen |= inside
        if not inside.any():
            low, high = in_brackets(vertices.min(axis=0)), in_brackets(vertices.max(axis=0))
            raise ConfigError(
                f'{body.prefix}pins.box is {list(body.pins_box)}: no vertex is inside, the mesh '
                f'reaches from {low} to {high} m'
            )
    return np.flatnonzero(chosen)


@kernel
def hold(
    bodies: np.ndarray,
    pinned: np.ndarray,
    particle: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    h: float,
) -> None:
    """
    Set pinned particles of deformable bodies to their prescribed positions and velocities.

    Parameters
    ----------
    bodies : (B,) BODY
    pinned : (k,) int
        bodies with pins
    particle : (m,) int
        pinned particles of all bodies, as particles of the world
    x, v : (2, 3, N) float
        m, m/s; the half that is being computed is changed
    h : float
        s

    """  # fmt: skip
    for index in range(len(pinned)):
        body = bodies[pinned[index]]
        now, own = body['now'], particle[body['first_pin'] : body['first_pin'] + body['pins']]
        move_pinned(
            own, x[now], vector_of(body['pins_linear']), vector_of(body['pins_angular']), h,
            x[1 - now], v[1 - now],
        )  # fmt: skip


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
    centre = ZERO
    for k in range(len(particle)):
        centre = plus(centre, column_of(start, particle[k]))
    centre = scaled(1.0 / len(particle), centre)
    rotation, new_centre = rotation_by_vector(scaled(h, angular)), plus(centre, scaled(h, linear))
    for k in range(len(particle)):
        arm = applied(rotation, minus(column_of(start, particle[k]), centre))
        put_column(x, particle[k], plus(new_centre, arm))
        put_column(v, particle[k], plus(linear, cross(angular, arm)))


def hold_rigid_body(
    start: np.ndarray, x: np.ndarray, v: np.ndarray, pins: Pins, rest: RestShape, h: float
) -> None:
    """
    Move a rigid body by the least motion that brings its pins to their prescribed positions.

    Parameters
    ----------
    start : (3, n) float
        positions at the tick before, m
    x, v : (3, n) float
        m, m/s: changed in place
    pins : Pins
    rest : RestShape
    h : float
        s

    """
    target, velocity = np.empty_like(start), np.empty_like(start)
    move_pinned_particles(pins.particle, start, pins.linear, pins.angular, h, target, velocity)
    target, velocity = target[:, pins.particle], velocity[:, pins.particle]
    # half of the impulse at the start of the tick, the rest at its end, conserves the energy of
    # a pendulum
    centre = weighted_mean(start.T, rest.weights)
    linear, angular = _minimal_motion(start, centre, velocity - v[:, pins.particle], pins, rest)
    v += 0.5 * _rigid_field(start, centre, linear, angular)
    for _ in range(RIGID_ROUNDS):
        centre = weighted_mean(x.T, rest.weights)
        shift, angle = _minimal_motion(x, centre, target - x[:, pins.particle], pins, rest)
        offsets = Rotation.from_rotvec(angle).as_matrix() @ (x - centre[:, None])
        x[:] = offsets + (centre + shift)[:, None]
    centre = weighted_mean(x.T, rest.weights)
    linear, angular = _minimal_motion(x, centre, velocity - v[:, pins.particle], pins, rest)
    v += _rigid_field(x, centre, linear, angular)


@kernel
def move_pinned_particles(
    particle: np.ndarray,
    start: np.ndarray,
    linear: np.ndarray,
    angular: np.ndarray,
    h: float,
    x: np.ndarray,
    v: np.ndarray,
) -> None:
    """Write the prescribed positions and velocities of the pins of one body after a tick."""
    move_pinned(particle, start, vector_of(linear), vector_of(angular), h, x, v)


def jacobian(arms: np.ndarray) -> np.ndarray:
    """
    Return the matrices (…, 3, 6) from twists to velocities at arms (…, 3) from the centre.

    A twist is the velocity v of the centre and the angular velocity ω; the result is v + ω × arm.
    """
    result = np.zeros((*arms.shape, 6))
    result[..., [0, 1, 2], [0, 1, 2]] = 1.0
    result[..., [0, 1, 2], [4, 5, 3]] = arms[..., [2, 0, 1]]
    result[..., [0, 1, 2], [5, 3, 4]] = -arms[..., [1, 2, 0]]
    return result


def _rigid_field(
    x: np.ndarray, centre: np.ndarray, linear: np.ndarray, angular: np.ndarray
) -> np.ndarray:
    """Return the velocities (3, n) of a rigid motion at x (3, n)."""
    return linear[:, None] + np.cross(angular, x - centre[:, None], axisb=0, axisc=0)


def _minimal_motion(
    x: np.ndarray, centre: np.ndarray, misfit: np.ndarray, pins: Pins, rest: RestShape
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least translation and rotation vector that remove the misfit (3, m) of pins."""
    # rotations are measured by the displacement at the RMS radius: also a length
    arms = (x[:, pins.particle].T - centre) / rest.scale
    energy = np.eye(6)
    energy[3:, 3:] = _inertia((x - centre[:, None]) / rest.scale, rest.weights)
    # in a basis of motions of kinetic energy 1 the pseudo-inverse gives the least motion
    values, vectors = np.linalg.eigh(energy)
    rotatable = values > RANK_CUT  # a rod has no rotation about its axis
    motions = vectors[:, rotatable] / np.sqrt(values[rotatable])
    response = jacobian(arms).reshape(-1, 6) @ motions
    inverse, _ = pseudo_inverse(response.T @ response)
    motion = motions @ (inverse @ (response.T @ misfit.T.ravel()))
    return motion[:3], motion[3:] / rest.scale


def _inertia(arms: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the inertia tensor (3, 3) of arms (3, n) with mass shares (n,)."""
    weighted = arms * weights
    gram = np.array([[(a * b).sum() for b in arms] for a in weighted])
    return np.trace(gram) * np.eye(3) - gram
