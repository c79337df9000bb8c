# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
One tick of a batch of bodies, as a list of stages.

First the bodies fly, each by itself; then they meet each other, see `body_contact`, which may
involve several batches; then what is in the way and what holds them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softbody_ros.core.basis import (
    PARTICLE,
    POSITION,
    VELOCITY,
    Basis,
    gram_matrix,
    products,
    room,
    row_of_one,
)
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.contact import rigid_obstacle, soft_obstacle
from softbody_ros.core.particles import Particles
from softbody_ros.core.shape_matching import (
    goals,
    matching,
    pins,
    polar_decomposition,
    rigid_motion,
)
from softbody_ros.core.shape_matching.gains import Gains
from softbody_ros.core.shape_matching.goals import Match
from softbody_ros.core.shape_matching.pins import Pins
from softbody_ros.core.shape_matching.regions import Regions
from softbody_ros.core.shape_matching.rest_shape import LINEAR, RestShape
from softbody_ros.core.shape_matching.rigid_motion import RigidMotion
from softbody_ros.core.sums import blocks
from softbody_ros.core.tick import Tick

LANDMARKS = 100
"""Particles, about, of which the mean is taken to know where a body is."""


@dataclass
class Batch:
    """
    State of B bodies that share a rest shape.

    Attributes
    ----------
    rest : RestShape
    regions : Regions or None
        K regions, none for bodies that are matched as wholes
    particles : (B, 6, n) float
        positions, m, and velocities, m/s
    plastic : (B, 1 + K, 3, 3) float or None
        permanent stretches, None where nothing has ever become permanent
    push : (B, 2, 2, 3) float or None
        what acts on bodies from outside: in world axes and in body axes, force and torque, both
        per mass, m/s² and m²/s²
    reaction : (B, 2, 3) float
        force, m/s², and torque about the centre of mass, m²/s², of all contacts, per mass
    next_particles, next_plastic, next_reaction
        where a tick is computed; `World` swaps them in once all batches have succeeded
    functions : (B, C, n) float
        room for the functions of a `Basis`

    """

    rest: RestShape
    regions: Regions | None
    particles: np.ndarray
    plastic: np.ndarray | None = None
    push: np.ndarray | None = None
    reaction: np.ndarray = field(init=False)
    next_particles: np.ndarray = field(init=False)
    next_plastic: np.ndarray | None = field(init=False, default=None)
    next_reaction: np.ndarray = field(init=False)
    functions: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.next_particles = np.empty_like(self.particles)
        self.reaction = self.next_reaction = np.zeros((len(self.particles), 2, 3))
        self.functions = np.empty((0, 0, 0))

    def __len__(self) -> int:
        return len(self.particles)

    @property
    def x(self) -> np.ndarray:
        """(B, 3, n) float: positions, m."""
        return self.particles[:, POSITION]

    @property
    def v(self) -> np.ndarray:
        """(B, 3, n) float: velocities, m/s."""
        return self.particles[:, VELOCITY]

    def part(self, rows: np.ndarray) -> Batch:
        """Return copies of some of the bodies, given as indices."""
        plastic = None if self.plastic is None else self.plastic[rows]
        push = None if self.push is None else self.push[rows]
        return Batch(self.rest, self.regions, self.particles[rows], plastic, push)

    def take(self, part: Batch, rows: np.ndarray) -> None:
        """Let the computed tick be that of a part for its rows, and no change for the others."""
        self.next_particles[:] = self.particles
        self.next_particles[rows] = part.next_particles
        self.next_reaction = self.reaction.copy()
        self.next_reaction[rows] = part.next_reaction
        self.next_plastic = self.plastic
        if part.next_plastic is not None:
            before = self.plastic
            self.next_plastic = (
                goals.intact(len(self), self.regions) if before is None else before.copy()
            )
            self.next_plastic[rows] = part.next_plastic

    def swap(self) -> None:
        """Make the computed tick the current one."""
        self.particles, self.next_particles = self.next_particles, self.particles
        self.plastic, self.reaction = self.next_plastic, self.next_reaction


@dataclass(frozen=True)
class Flight:
    """
    Bodies of a batch in the middle of a tick: moved by themselves, not yet by what they touch.

    Attributes
    ----------
    batch : Batch
        all bodies, or copies of those that are awake
    particles : Particles
    match : Match
    motion : RigidMotion
        of the particles
    pinned : mapping of int to Pins
        by row
    tick : Tick

    """

    batch: Batch
    particles: Particles
    match: Match
    motion: RigidMotion
    pinned: Mapping[int, Pins]
    tick: Tick


def fly(
    batch: Batch, gains: Gains, pinned: Mapping[int, Pins], gravity: np.ndarray, h: float
) -> Flight:
    """
    Move bodies as if nothing were in their way.

    Free flight is exact: a parabola at any step, with momentum and angular momentum kept to
    rounding.

    Parameters
    ----------
    batch : Batch
        its `functions` are changed, and `next_particles` when the particles are written
    gains : Gains
    pinned : mapping of int to Pins
        by row of the batch
    gravity : (3,) float
        m/s²
    h : float
        s

    Raises
    ------
    SimulationError
        if a number would not be finite.

    """
    tick = Tick(batch.rest, batch.regions, gains, gravity, h)
    basis = predict(batch, tick)
    match = goals.find(basis, batch.plastic, pinned, tick)
    coefficients = damp(basis, basis.particles, tick)
    momentum = rigid_motion.momentum(basis, coefficients)
    coefficients = pull(coefficients, match, tick)
    coefficients, motion = restore_momentum(basis, coefficients, momentum, pinned, tick)
    particles = Particles(batch.next_particles, batch.x, (basis, coefficients))
    return Flight(batch, particles, match, motion, pinned, tick)


def land(flight: Flight, obstacles: Sequence[Obstacle]) -> None:
    """Let bodies meet the obstacles and their pins: that completes their tick."""
    particles, tick = flight.particles, flight.tick
    soft_obstacle.meet(particles, flight.match, flight.motion, obstacles, tick)
    rigid_obstacle.meet(particles, flight.motion, obstacles, tick)
    pins.hold(particles, flight.pinned, tick)
    particles.write()
    flight.batch.next_plastic = flight.match.plastic
    flight.batch.next_reaction = particles.received / tick.h


def predict(batch: Batch, tick: Tick) -> Basis:
    """Move particles as if they had no bodies: x + h v + h² a / 2, v + h a."""
    rest, h, features = tick.rest, tick.h, tick.gains.features
    one = row_of_one(tick.regions is not None)
    if batch.functions.shape[:2] != (len(batch), one + 1 + features):
        batch.functions = room(len(batch), rest, features, one)
    functions, origin = batch.functions, middle(batch.x)
    shift = (0.5 * h**2 * tick.gravity - origin)[..., None].astype(functions.dtype)
    kick = (h * tick.gravity)[:, None].astype(functions.dtype)
    push = None if batch.push is None else pushed(batch, batch.push, tick)
    total = np.zeros((len(batch), PARTICLE.stop, functions.shape[1]))
    for part in blocks(rest.particle_count):
        x, v = functions[:, POSITION, part], functions[:, VELOCITY, part]
        np.multiply(batch.v[..., part], h, out=x)
        x += batch.x[..., part]
        x += shift
        np.add(batch.v[..., part], kick, out=v)
        if push is not None:
            x += 0.5 * h**2 * push[..., part]
            v += h * push[..., part]
        total += products(functions, rest, one, part)
    return Basis(rest, origin, functions, one, gram_matrix(total, rest, one))


def middle(x: np.ndarray) -> np.ndarray:
    """Return about where bodies at x (B, 3, n) are: means (B, 3) of some of their particles."""
    some = x[..., :: x.shape[-1] // LANDMARKS + 1]
    mean = np.add.reduce(some, axis=-1, dtype=np.float64) / some.shape[-1]
    # a number that positions can have: what is taken away from them is what is added again
    return mean.astype(x.dtype).astype(np.float64, copy=False)


def pushed(batch: Batch, push: np.ndarray, tick: Tick) -> np.ndarray:
    """
    Return the accelerations (B, 3, n) of bodies that are pushed and turned as wholes, m/s².

    Taken where the particles are halfway through the tick: then the angular momentum that they get
    is h times the torque, exactly.
    """
    halfway = batch.x + 0.5 * tick.h * batch.v
    centre, moment = matching.moments(halfway, batch.rest, LINEAR)
    rotation = polar_decomposition.rotation(moment)
    in_world, in_body = push[:, 0], push[:, 1]
    both = in_world + np.matmul(in_body, rotation.swapaxes(-1, -2))
    motion = rigid_motion.rigid_motion(halfway, batch.v, centre, batch.rest)
    turn = rigid_motion.applied(motion.inverse_inertia, both[:, 1])
    return rigid_motion.field(halfway, centre, both[:, 0], turn)


def damp(basis: Basis, particles: np.ndarray, tick: Tick) -> np.ndarray:
    """
    Take a share of the velocity of deformation, which is all but the rigid motion.

    Here and below particles are given by their coefficients (B, 6, C) in the basis.
    """
    kept = tick.gains.kept_velocity
    if not tick.gains.damps:
        return particles
    motion = rigid_motion.of_particles(basis, particles)
    rigid = rigid_motion.combination(
        basis, particles, motion.centre, motion.velocity, motion.angular_velocity
    )
    damped = rigid + kept[:, None, None] * (particles[:, VELOCITY] - rigid)
    return np.concatenate([particles[:, POSITION], damped], axis=1)


def pull(particles: np.ndarray, match: Match, tick: Tick) -> np.ndarray:
    """
    Move positions and velocities towards their goals: x += s (g − x), v += k (g − x) / h.

    What has strayed is critically damped, so that it does not swing from one such state to
    another.
    """
    gains, bodies = tick.gains, len(particles)
    gain = gains.pull + match.strayed * (gains.critical - gains.pull)
    both = particles.reshape(bodies, 2, 3, -1)
    both = both + gain.T[:, :, None, None] * (match.coefficients - both[:, :1])
    if gains.any_rigid:
        # nothing deforms: no velocity but what the momentum will add
        both[gains.rigid, 1] = 0.0
    return both.reshape(particles.shape)


def restore_momentum(
    basis: Basis,
    particles: np.ndarray,
    momentum: tuple[np.ndarray, np.ndarray],
    pinned: Mapping[int, Pins],
    tick: Tick,
) -> tuple[np.ndarray, RigidMotion]:
    """
    Add the rigid motion that brings momentum and angular momentum back, and return the whole.

    The pull conserves angular momentum to first order only: moving the particles by s (g − x)
    changes the inertia under their velocities. Pins, which push back, are to change both.
    """
    present, (velocity, spin) = rigid_motion.of_particles(basis, particles), momentum
    for row in pinned:
        if not tick.gains.rigid[row]:
            velocity[row], spin[row] = present.velocity[row], present.spin[row]
    turn = rigid_motion.applied(present.inverse_inertia, spin - present.spin)
    particles[:, VELOCITY] += rigid_motion.combination(
        basis, particles, present.centre, velocity - present.velocity, turn
    )
    centre = basis.origin + present.centre
    return particles, RigidMotion(centre, velocity, spin, present.inverse_inertia)
