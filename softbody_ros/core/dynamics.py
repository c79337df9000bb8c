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

from softbody_ros.core import contact, goals, matching, pins, rigid_contact, rigid_motion
from softbody_ros.core.gains import Gains
from softbody_ros.core.goals import Match
from softbody_ros.core.obstacles import Obstacle
from softbody_ros.core.pins import Pins
from softbody_ros.core.regions import Regions
from softbody_ros.core.rest_shape import LINEAR, RestShape
from softbody_ros.core.rigid_motion import RigidMotion
from softbody_ros.core.tick import Particles, Tick


@dataclass
class Batch:
    """
    State of B bodies that share a rest shape.

    Attributes
    ----------
    rest : RestShape
    regions : Regions or None
        K regions, none for bodies that are matched as wholes
    x, v : (B, 3, n) float
        positions, m, and velocities, m/s
    plastic : (B, 1 + K, 3, 3) float or None
        permanent stretches, None where nothing has ever become permanent
    push : (B, 2, 2, 3) float or None
        what acts on bodies from outside: in world axes and in body axes, force and torque, both
        per mass, m/s² and m²/s²
    reaction : (B, 2, 3) float
        force, m/s², and torque about the centre of mass, m²/s², of all contacts, per mass
    next_x, next_v, next_plastic, next_reaction
        where a tick is computed; `World` swaps them in once all batches have succeeded

    """

    rest: RestShape
    regions: Regions | None
    x: np.ndarray
    v: np.ndarray
    plastic: np.ndarray | None = None
    push: np.ndarray | None = None
    reaction: np.ndarray = field(init=False)
    next_x: np.ndarray = field(init=False)
    next_v: np.ndarray = field(init=False)
    next_plastic: np.ndarray | None = field(init=False, default=None)
    next_reaction: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.next_x, self.next_v = np.empty_like(self.x), np.empty_like(self.v)
        self.reaction = self.next_reaction = np.zeros((len(self.x), 2, 3))

    def part(self, rows: np.ndarray) -> Batch:
        """Return copies of some of the bodies, given as indices."""
        plastic = None if self.plastic is None else self.plastic[rows]
        push = None if self.push is None else self.push[rows]
        return Batch(self.rest, self.regions, self.x[rows], self.v[rows], plastic, push)

    def take(self, part: Batch, rows: np.ndarray) -> None:
        """Let the computed tick be that of a part for its rows, and no change for the others."""
        self.next_x[:], self.next_v[:] = self.x, self.v
        self.next_x[rows], self.next_v[rows] = part.next_x, part.next_v
        self.next_reaction = self.reaction.copy()
        self.next_reaction[rows] = part.next_reaction
        self.next_plastic = self.plastic
        if part.next_plastic is not None:
            before = self.plastic
            self.next_plastic = (
                goals.intact(len(self.x), self.regions) if before is None else before.copy()
            )
            self.next_plastic[rows] = part.next_plastic

    def swap(self) -> None:
        """Make the computed tick the current one."""
        self.x, self.next_x = self.next_x, self.x
        self.v, self.next_v = self.next_v, self.v
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
        its `next_x` and `next_v` are changed
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
    particles = predict(batch, tick)
    match = goals.find(particles, pinned, tick)
    damp(particles, match.centre, tick)
    momentum = rigid_motion.momentum(particles.x, particles.v, match.centre, tick.rest)
    pull(particles, match, tick)
    motion = restore_momentum(particles, match.centre, momentum, pinned, tick)
    return Flight(batch, particles, match, motion, pinned, tick)


def land(flight: Flight, obstacles: Sequence[Obstacle]) -> None:
    """Let bodies meet the obstacles and their pins: that completes their tick."""
    particles, tick = flight.particles, flight.tick
    contact.meet(particles, flight.match.goals[1], flight.motion, obstacles, tick)
    rigid_contact.meet(particles, obstacles, tick)
    pins.hold(particles, flight.pinned, tick)
    flight.batch.next_plastic = flight.match.plastic
    flight.batch.next_reaction = particles.received / tick.h


def predict(batch: Batch, tick: Tick) -> Particles:
    """Return the particles as they are without their bodies: x + h v + h² a / 2, v + h a."""
    x, v, h = batch.next_x, batch.next_v, tick.h
    np.multiply(batch.v, h, out=x)
    x += batch.x
    x += (0.5 * h**2 * tick.gravity).astype(x.dtype)[:, None]
    np.add(batch.v, (h * tick.gravity).astype(v.dtype)[:, None], out=v)
    if batch.push is not None:
        acceleration = pushed(batch, batch.push, tick)
        v += h * acceleration
        acceleration *= 0.5 * h**2
        x += acceleration
    return Particles(x, v, start=batch.x, plastic=batch.plastic)


def pushed(batch: Batch, push: np.ndarray, tick: Tick) -> np.ndarray:
    """
    Return the accelerations (B, 3, n) of bodies that are pushed and turned as wholes, m/s².

    Taken where the particles are halfway through the tick: then the angular momentum that they get
    is h times the torque, exactly.
    """
    halfway = batch.x + 0.5 * tick.h * batch.v
    centre, moment = matching.moments(halfway, batch.rest, LINEAR)
    rotation = matching.rotation(moment)
    in_world, in_body = push[:, 0], push[:, 1]
    both = in_world + np.matmul(in_body, rotation.swapaxes(-1, -2))
    motion = rigid_motion.rigid_motion(halfway, batch.v, centre, batch.rest)
    turn = rigid_motion.applied(motion.inverse_inertia, both[:, 1])
    return rigid_motion.field(halfway, centre, both[:, 0], turn)


def damp(particles: Particles, centre: np.ndarray, tick: Tick) -> None:
    """Take a share of the velocity of deformation, which is all but the rigid motion."""
    x, v, kept = particles.x, particles.v, tick.gains.kept_velocity
    if (kept >= 1.0).all():
        return
    motion = rigid_motion.rigid_motion(x, v, centre, tick.rest)
    rigid = rigid_motion.field(x, centre, motion.velocity, motion.angular_velocity)
    v -= rigid
    v *= kept.astype(v.dtype)[:, None, None]
    v += rigid


def pull(particles: Particles, match: Match, tick: Tick) -> None:
    """
    Move positions and velocities towards their goals: x += s (g − x), v += k (g − x) / h.

    What has strayed is critically damped, so that it does not swing from one such state to
    another.
    """
    x, v, gains = particles.x, particles.v, tick.gains
    for_positions, for_velocities = match.goals
    position = gains.position + match.strayed * (gains.critical[0] - gains.position)
    velocity = gains.velocity + match.strayed * (gains.critical[1] - gains.velocity)
    change = for_velocities - x
    change *= (velocity / tick.h).astype(x.dtype)[:, None, None]
    v += change
    np.subtract(for_positions, x, out=change)
    change *= position.astype(x.dtype)[:, None, None]
    x += change
    if gains.rigid.any():
        # nothing deforms: no velocity but what the momentum will add
        v[gains.rigid] = 0.0


def restore_momentum(
    particles: Particles,
    centre: np.ndarray,
    momentum: tuple[np.ndarray, np.ndarray],
    pinned: Mapping[int, Pins],
    tick: Tick,
) -> RigidMotion:
    """
    Add the rigid motion that brings momentum and angular momentum back, and return the whole.

    The pull conserves angular momentum to first order only: moving the particles by s (g − x)
    changes the inertia under their velocities. Pins, which push back, are to change both.
    """
    x, v, (velocity, spin) = particles.x, particles.v, momentum
    present = rigid_motion.rigid_motion(x, v, centre, tick.rest)
    for row in pinned:
        if not tick.gains.rigid[row]:
            velocity[row], spin[row] = present.velocity[row], present.spin[row]
    v += rigid_motion.correction(x, present, velocity, spin)
    return RigidMotion(centre, velocity, spin, present.inverse_inertia)
