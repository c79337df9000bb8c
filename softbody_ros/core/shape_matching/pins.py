# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pins: particles that are held, or moved with a velocity, whatever pulls at them.

A pinned particle alone is a light one: the body would fall past it. So in the match, and only
there, the pins weigh many times the body, in its centre, its moments and its inverse Gram matrix
alike: a least squares fit that passes through the pins. Free particles are pulled to that goal
with their own masses, as to any other, so the pull keeps its potential and the body hangs on the
pins with its own weight. (Heavy weights in the centre of mass alone, which is the known mistake,
turn and stretch the rest of the shape about the wrong point.)

Rigid bodies get the least motion that brings them to their pins.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.config import BodyConfig, ConfigError, in_brackets
from softbody_ros.core.particles import Particles
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.shape_matching.regions import Regions, make_regions
from softbody_ros.core.shape_matching.rest_shape import (
    RANK_CUT,
    RestShape,
    features_by_others,
    make_rest_shape,
    pseudo_inverse,
)
from softbody_ros.core.sums import weighted
from softbody_ros.core.tick import Tick

COUPLING = 100.0
"""What the pins weigh in the match, in body masses."""
RIGID_ROUNDS = 3
"""A rigid body is turned to its pins so many times; each squares the error."""


@dataclass(frozen=True, eq=False)
class Pins:
    """
    The pins of one body.

    Attributes
    ----------
    particle : (m,) int
    linear, angular : (3,) float
        velocity with which they are moved, about their centre, m/s and rad/s
    rest : RestShape
        the body's, with the weights that the particles have in the match
    regions : Regions or None
        the body's, with those weights
    features : (10, 10) float
        its features, as combinations of those of the body

    """

    particle: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    rest: RestShape
    regions: Regions | None
    features: np.ndarray

    @property
    def moves(self) -> bool:
        """Whether the pins are moved."""
        return bool(self.linear.any() or self.angular.any())

    def left_free(self, mobility: np.ndarray, arms: np.ndarray) -> np.ndarray:
        """
        Return what pins leave of the mobility of a body as a whole.

        Parameters
        ----------
        mobility : (6, 6) float
            of the free body: from impulses to its twist
        arms : (m, 3) float
            of the pinned particles from its centre of mass, m

        Returns
        -------
        (6, 6) float

        """
        values, vectors = np.linalg.eigh(mobility)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        felt = rigid_motion.jacobian(arms).reshape(-1, 6) @ root
        _, free = pseudo_inverse(felt.T @ felt)
        return root @ free @ root.T


def make_pins(body: BodyConfig, rest: RestShape, before: Pins | None = None) -> Pins | None:
    """
    Return the pins of a body, or None if it has none.

    Parameters
    ----------
    body : BodyConfig
    rest : RestShape
    before : Pins, optional
        the pins that the body had: what depends on the same particles is taken from them

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
    weights = rest.weights.astype(np.float64)
    held = np.maximum(weights[particle], 1e-12)
    weights[particle] += COUPLING * held / held.sum()
    weights /= weights.sum()
    regions = None
    if body.regions_count:
        regions = make_regions(rest, body.regions_count, body.regions_overlap, weights)
    matched = make_rest_shape(rest.surface, rest.features.dtype.type, weights)
    features = features_by_others(matched, rest)
    return Pins(particle, linear, angular, matched, regions, features)


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


def hold(particles: Particles, pinned: Mapping[int, Pins], tick: Tick) -> None:
    """
    Bring pinned particles to where they are held, and rigid bodies after them.

    Parameters
    ----------
    particles : Particles
        changed in place
    pinned : mapping of int to Pins
        by row of the batch
    tick : Tick

    """
    for row, pin in pinned.items():
        start = particles.start[row][:, pin.particle].astype(np.float64)
        place, velocity = _carried(start, pin, tick.h)
        if tick.gains.rigid[row]:
            _hold_rigid(particles, row, pin, place, velocity, tick)
        else:
            particles.x[row][:, pin.particle] = place
            particles.v[row][:, pin.particle] = velocity


def _carried(start: np.ndarray, pin: Pins, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where pinned particles (3, m) are after a tick, and their velocities."""
    if not pin.moves:
        return start, np.zeros_like(start)
    centre = start.mean(axis=1, keepdims=True)
    turned = Rotation.from_rotvec(h * pin.angular).as_matrix() @ (start - centre)
    spin = np.cross(pin.angular, turned, axisb=0, axisc=0)
    step = pin.linear[:, None]
    return centre + turned + h * step, step + spin


def _hold_rigid(
    particles: Particles, row: int, pin: Pins, place: np.ndarray, velocity: np.ndarray, tick: Tick
) -> None:
    x, v, rest = particles.x[row], particles.v[row], tick.rest
    # half of the impulse where the tick begins, the rest where it ends: a pendulum swings on
    start = particles.start[row]
    centre = weighted(start, rest.weights)
    push, spin = _least_motion(start, centre, velocity - v[:, pin.particle], pin, rest)
    v += 0.5 * (push[:, None] + np.cross(spin, start - centre[:, None], axisb=0, axisc=0))
    for _ in range(RIGID_ROUNDS):
        centre = weighted(x, rest.weights)
        move, turn = _least_motion(x, centre, place - x[:, pin.particle], pin, rest)
        offsets = Rotation.from_rotvec(turn).as_matrix() @ (x - centre[:, None])
        x[:] = offsets + (centre + move)[:, None]
    centre = weighted(x, rest.weights)
    push, spin = _least_motion(x, centre, velocity - v[:, pin.particle], pin, rest)
    v += push[:, None] + np.cross(spin, x - centre[:, None], axisb=0, axisc=0)


def _least_motion(
    x: np.ndarray, centre: np.ndarray, misfit: np.ndarray, pin: Pins, rest: RestShape
) -> tuple[np.ndarray, np.ndarray]:
    """Return the translation and rotation vector that take away the misfit (3, m) of the pins."""
    # a turn is counted in the way of a particle at the RMS radius: a length, too
    arms = (x[:, pin.particle].T - centre) / rest.scale
    energy = np.eye(6)
    energy[3:, 3:] = rigid_motion.inertia(x[None], centre[None], rest)[0] / rest.scale**2
    # motions of kinetic energy 1: of those that the pins leave free, none
    values, vectors = np.linalg.eigh(energy)
    turning = values > RANK_CUT  # a rod does not turn about itself
    motions = vectors[:, turning] / np.sqrt(values[turning])
    felt = rigid_motion.jacobian(arms).reshape(-1, 6) @ motions
    inverse, _ = pseudo_inverse(felt.T @ felt)
    motion = motions @ (inverse @ (felt.T @ misfit.T.ravel()))
    return motion[:3], motion[3:] / rest.scale
