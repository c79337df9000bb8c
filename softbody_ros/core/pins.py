# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pins: particles that are held, or moved with a velocity, whatever pulls at them.

Making pinned particles heavy would move the centre of mass into them, and the rest of the shape
would turn and stretch about the wrong point. Here a pin is a constraint on the body: of all
motions that its shape can follow (rigid, or affine) the body gets the one of least kinetic energy
that brings the pinned particles to where they are held (Gauss's principle of least constraint).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core import rigid_motion
from softbody_ros.core.config import BodyConfig, ConfigError
from softbody_ros.core.rest_shape import LINEAR, RestShape, pseudo_inverse
from softbody_ros.core.tick import Particles, Tick

COMPLIANCE = 0.01
"""
Kinetic energy that an affine motion may cost, against the misfit of the pins that it removes: so
that pins close to each other do not turn their small differences into large motions.
"""
RIGID_COMPLIANCE = 1e-8
"""The same for rigid motions: only what no pin says is left to it."""
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
    reach : (m, 4) float
        misfits (3, m) @ reach are the affine motion, as coefficients of 1 and q

    """

    particle: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    reach: np.ndarray

    @property
    def moves(self) -> bool:
        """Whether the pins are moved."""
        return bool(self.linear.any() or self.angular.any())


def make_pins(bodies: Sequence[BodyConfig], rest: RestShape) -> dict[int, Pins]:
    """
    Return the pins of those bodies that have some, by their row in the batch.

    Raises
    ------
    ConfigError
        if a pinned vertex does not exist.

    """
    pinned = {row: pinned_particles(body, rest) for row, body in enumerate(bodies)}
    return {
        row: Pins(
            particle,
            np.array(bodies[row].pins_velocity_linear),
            np.array(bodies[row].pins_velocity_angular),
            _reach(particle, rest),
        )
        for row, particle in pinned.items()
        if len(particle)
    }


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
        inside = (corners.min(axis=0) <= rest.surface.vertices) & (
            rest.surface.vertices <= corners.max(axis=0)
        )
        chosen |= inside.all(axis=1)
        if not chosen.any():
            raise ConfigError(
                f'{body.prefix}pins.box is {list(body.pins_box)}: no vertex is inside, the mesh '
                f'reaches from {_point(rest.surface.vertices.min(axis=0))} to '
                f'{_point(rest.surface.vertices.max(axis=0))} m'
            )
    return np.flatnonzero(chosen)


def _point(values: np.ndarray) -> str:
    return '[' + ', '.join(f'{value:g}' for value in values) + ']'


def _reach(particle: np.ndarray, rest: RestShape) -> np.ndarray:
    affine = rest.features[: 1 + LINEAR].astype(np.float64)
    energy = (affine * rest.weights) @ affine.T
    held = affine[:, particle]
    inverse, _ = pseudo_inverse(held @ held.T / len(particle) + COMPLIANCE * energy)
    return held.T @ inverse / len(particle)


def hold(particles: Particles, pinned: Mapping[int, Pins], tick: Tick) -> None:
    """
    Bring pinned particles to where they are held, and their bodies after them.

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
            _hold_deformable(particles, row, pin, place, velocity, tick)


def _carried(start: np.ndarray, pin: Pins, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where pinned particles (3, m) are after a tick, and their velocities."""
    if not pin.moves:
        return start, np.zeros_like(start)
    centre = start.mean(axis=1, keepdims=True)
    turned = Rotation.from_rotvec(h * pin.angular).as_matrix() @ (start - centre)
    spin = np.cross(pin.angular, turned, axisb=0, axisc=0)
    step = pin.linear[:, None]
    return centre + turned + h * step, step + spin


def _hold_deformable(
    particles: Particles, row: int, pin: Pins, place: np.ndarray, velocity: np.ndarray, tick: Tick
) -> None:
    affine = tick.rest.features[: 1 + LINEAR]
    for values, held in ((particles.x[row], place), (particles.v[row], velocity)):
        motion = (held - values[:, pin.particle]) @ pin.reach
        values += motion.astype(values.dtype) @ affine
        values[:, pin.particle] = held


def _hold_rigid(
    particles: Particles, row: int, pin: Pins, place: np.ndarray, velocity: np.ndarray, tick: Tick
) -> None:
    x, v, rest = particles.x[row], particles.v[row], tick.rest
    for _ in range(RIGID_ROUNDS):
        centre = (x @ rest.weights).astype(np.float64)
        move, turn = _least_motion(x, centre, place - x[:, pin.particle], pin, rest)
        offsets = Rotation.from_rotvec(turn).as_matrix() @ (x - centre[:, None])
        x[:] = offsets + (centre + move)[:, None]
    centre = (x @ rest.weights).astype(np.float64)
    push, spin = _least_motion(x, centre, velocity - v[:, pin.particle], pin, rest)
    v += push[:, None] + np.cross(spin, x - centre[:, None], axisb=0, axisc=0)


def _least_motion(
    x: np.ndarray, centre: np.ndarray, misfit: np.ndarray, pin: Pins, rest: RestShape
) -> tuple[np.ndarray, np.ndarray]:
    """Return the translation and rotation vector that take away the misfit (3, m) of the pins."""
    # a turn is counted in the way of a particle at the RMS radius: a length, too
    arms = (x[:, pin.particle].T - centre) / rest.scale
    turns = np.cross(np.eye(3), arms[:, None, :]).transpose(0, 2, 1)
    moves = np.broadcast_to(np.eye(3), turns.shape)
    jacobian = np.concatenate([moves, turns], axis=2).reshape(-1, 6)
    energy = np.eye(6)
    energy[3:, 3:] = rigid_motion.inertia(x[None], centre[None], rest)[0] / rest.scale**2
    inverse, _ = pseudo_inverse(jacobian.T @ jacobian / len(arms) + RIGID_COMPLIANCE * energy)
    motion = inverse @ (jacobian.T @ misfit.T.ravel()) / len(arms)
    return motion[:3], motion[3:] / rest.scale
