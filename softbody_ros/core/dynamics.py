# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""One tick of a batch of bodies, as a list of stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from softbody_ros.core import contact, matching, rigid_contact, rigid_motion
from softbody_ros.core.gains import Gains
from softbody_ros.core.matching import Match
from softbody_ros.core.obstacles import Obstacle
from softbody_ros.core.rest_shape import LINEAR, RestShape
from softbody_ros.core.rigid_motion import RigidMotion
from softbody_ros.core.tick import Particles, Tick

LARGEST_MOMENT = 1e100
"""Beyond it squares leave the finite numbers."""


class SimulationError(ArithmeticError):
    """A step that would leave the finite numbers; the state before it is kept."""


@dataclass
class Batch:
    """
    State of B bodies that share a rest shape.

    Attributes
    ----------
    rest : RestShape
    x, v : (B, 3, n) float
        positions, m, and velocities, m/s
    next_x, next_v : (B, 3, n) float
        where a tick is computed; `World` swaps them in once all batches have succeeded

    """

    rest: RestShape
    x: np.ndarray
    v: np.ndarray
    next_x: np.ndarray = field(init=False)
    next_v: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.next_x, self.next_v = np.empty_like(self.x), np.empty_like(self.v)

    def swap(self) -> None:
        """Make the computed tick the current one."""
        self.x, self.next_x = self.next_x, self.x
        self.v, self.next_v = self.next_v, self.v


def step_awake(
    batch: Batch,
    awake: np.ndarray,
    gains: Gains,
    gravity: np.ndarray,
    obstacles: Sequence[Obstacle],
    h: float,
) -> None:
    """Compute the next tick of the bodies of a batch that are awake, (B,) bool; see `step`."""
    if awake.all():
        step(batch, gains, gravity, obstacles, h)
        return
    part = Batch(batch.rest, batch.x[awake], batch.v[awake])
    step(part, gains.of(awake), gravity, obstacles, h)
    batch.next_x[:], batch.next_v[:] = batch.x, batch.v
    batch.next_x[awake], batch.next_v[awake] = part.next_x, part.next_v


def step(
    batch: Batch, gains: Gains, gravity: np.ndarray, obstacles: Sequence[Obstacle], h: float
) -> None:
    """
    Compute the next tick of a batch into `next_x` and `next_v`.

    Free flight is exact: a parabola at any step, with momentum and angular momentum kept to
    rounding.

    Parameters
    ----------
    batch : Batch
    gains : Gains
    gravity : (3,) float
        m/s²
    obstacles : sequence of Obstacle
    h : float
        s

    Raises
    ------
    SimulationError
        if a number would not be finite.

    """
    tick = Tick(batch.rest, gains, gravity, h)
    particles = predict(batch, tick)
    match = find_goals(particles.x, tick)
    momentum = rigid_motion.momentum(particles.x, particles.v, match.centre, tick.rest)
    pull(particles, match, tick)
    motion = restore_momentum(particles, match, momentum, tick)
    contact.meet(particles, match, motion, obstacles, tick)
    rigid_contact.meet(particles, obstacles, tick)


def predict(batch: Batch, tick: Tick) -> Particles:
    """Return the particles as they are without their bodies: x + h v + h² g / 2, v + h g."""
    x, v, h = batch.next_x, batch.next_v, tick.h
    np.multiply(batch.v, h, out=x)
    x += batch.x
    x += (0.5 * h**2 * tick.gravity).astype(x.dtype)[:, None]
    np.add(batch.v, (h * tick.gravity).astype(v.dtype)[:, None], out=v)
    return Particles(x, v, start=batch.x)


def find_goals(x: np.ndarray, tick: Tick) -> Match:
    """Match the rest shape with positions (B, 3, n): where each body wants to be."""
    rest, gains = tick.rest, tick.gains
    centre, moment = matching.moments(x, rest, gains.features)
    require_finite(moment)
    rotations = matching.rotation(moment)
    fits = fit_of_each_mode(moment, rotations, rest, gains)
    transforms = matching.blended(fits, rotations, gains.deformation)
    return Match(centre, matching.with_volume(transforms, rest, gains.volume_conservation))


def require_finite(moment: np.ndarray) -> None:
    """Raise if any position or velocity was not finite: the moments are sums over all of them."""
    if not np.abs(moment).max() < LARGEST_MOMENT:
        raise SimulationError('a position or velocity is not finite any more')


def fit_of_each_mode(
    moment: np.ndarray, rotations: np.ndarray, rest: RestShape, gains: Gains
) -> np.ndarray:
    """Return (B, 3, F): the quadratic fit of quadratic bodies, the linear fit of the others."""
    fits = matching.fit(moment, rotations, rest)
    if gains.features == LINEAR or gains.quadratic.all():
        return fits
    linear = matching.padded(matching.fit(moment[..., :LINEAR], rotations, rest))
    return np.where(gains.quadratic[:, None, None], fits, linear)


def pull(particles: Particles, match: Match, tick: Tick) -> None:
    """Move positions and velocities towards their goals: x += s (g − x), v += k (g − x) / h."""
    x, v, gains = particles.x, particles.v, tick.gains
    position_change, velocity_change = matching.goals(match.centre, match.transforms, tick.rest)
    position_change -= x
    position_change *= gains.position.astype(x.dtype)[:, None, None]
    velocity_change -= x
    velocity_change *= (gains.velocity / tick.h).astype(x.dtype)[:, None, None]
    x += position_change
    v += velocity_change
    if gains.rigid.any():
        # nothing deforms: no velocity but what the momentum will add
        v[gains.rigid] = 0.0


def restore_momentum(
    particles: Particles, match: Match, momentum: tuple[np.ndarray, np.ndarray], tick: Tick
) -> RigidMotion:
    """
    Add the rigid motion that brings momentum and angular momentum back, and return the whole.

    The pull conserves angular momentum to first order only: moving the particles by s (g − x)
    changes the inertia under their velocities, and clamped goals exert a torque.
    """
    x, v, centre, (velocity, spin) = particles.x, particles.v, match.centre, momentum
    present = rigid_motion.rigid_motion(x, v, centre, tick.rest)
    angular_velocity = rigid_motion.applied(present.inverse_inertia, spin - present.spin)
    v += rigid_motion.field(x, centre, velocity - present.velocity, angular_velocity)
    return RigidMotion(centre, velocity, spin, present.inverse_inertia)
