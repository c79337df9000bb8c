# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""One tick of a batch of bodies, as a list of stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from softbody_ros.core import contact, matching, rigid_contact, rigid_motion
from softbody_ros.core.gains import Gains
from softbody_ros.core.obstacles import Obstacle
from softbody_ros.core.rest_shape import LINEAR, RestShape

LARGEST_MOMENT = 1e100
PUSH_OUT_ROUNDS = 3
SLOW_TICKS = 2.0
"""What gravity adds in so many ticks is too slow to bounce, so that bodies come to rest."""


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


def step(
    batch: Batch, gains: Gains, gravity: np.ndarray, obstacles: Sequence[Obstacle], h: float
) -> None:
    """
    Compute the next tick of a batch into `next_x` and `next_v`.

    Predict, match, correct, collide. Free flight is exact: a parabola at any step, with momentum
    and angular momentum conserved to rounding.

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
    rest, x, v = batch.rest, batch.next_x, batch.next_v
    predict(batch.x, batch.v, gravity, h, out=x)
    accelerate(batch.v, gravity, h, out=v)
    approach = v.copy() if obstacles else v

    centre, moment = matching.moments(x, rest, gains.features)
    require_finite(moment)
    rotations = matching.rotation(moment)
    fits = fit_of_each_mode(moment, rotations, rest, gains)
    drift, spin = v @ rest.weights, rigid_motion.angular_momentum(x, v, centre, rest)

    goal = pull(x, v, centre, fits, rotations, rest, gains, h)
    restore_momentum(v, drift, rest)
    inverse = restore_angular_momentum(x, v, centre, spin, rest)

    for obstacle in obstacles:
        contacts = contact.find(x, obstacle, gains.thickness)
        contacts = contacts.where(~gains.rigid[contacts.body])
        if len(contacts):
            sunk = contact.depth_of_goals(contacts, obstacle, centre, goal, rest, gains)
            patch = contact.patch_of(x, contacts, centre, drift, spin, inverse, rest)
            meet_obstacle(x, v, approach, batch.x, patch, sunk, rest, gravity, gains, h)
            if obstacle is not obstacles[-1]:
                drift = v @ rest.weights
                spin = rigid_motion.angular_momentum(x, v, centre, rest)
    if obstacles and gains.rigid.any():
        rigid_bodies_meet_obstacles(x, v, obstacles, rest, gravity, gains, h)


def predict(x: np.ndarray, v: np.ndarray, gravity: np.ndarray, h: float, out: np.ndarray) -> None:
    """Write x + h v + h² g / 2, where a free particle will be."""
    np.multiply(v, h, out=out)
    out += x
    out += (0.5 * h**2 * gravity).astype(x.dtype)[:, None]


def accelerate(v: np.ndarray, gravity: np.ndarray, h: float, out: np.ndarray) -> None:
    """Write v + h g."""
    np.add(v, (h * gravity).astype(v.dtype)[:, None], out=out)


def require_finite(moment: np.ndarray) -> None:
    """Raise if any position or velocity was not finite: the moments are sums over all of them."""
    if not np.abs(moment).max() < LARGEST_MOMENT:
        raise SimulationError('a position or velocity is not finite any more')


def fit_of_each_mode(
    moment: np.ndarray, rotations: np.ndarray, rest: RestShape, gains: Gains
) -> np.ndarray:
    """Return (B, 3, F): the quadratic fit of quadratic bodies, the linear fit of the others."""
    if not gains.quadratic.any():
        return matching.fit(moment, rotations, rest)
    fits = matching.fit(moment, rotations, rest)
    if not gains.quadratic.all():
        linear = matching.padded(matching.fit(moment[..., :LINEAR], rotations, rest))
        fits = np.where(gains.quadratic[:, None, None], fits, linear)
    return fits


def pull(
    x: np.ndarray,
    v: np.ndarray,
    centre: np.ndarray,
    fits: np.ndarray,
    rotations: np.ndarray,
    rest: RestShape,
    gains: Gains,
    h: float,
) -> np.ndarray:
    """
    Move positions and velocities towards their goals: x += s (g − x), v += k (g − x) / h.

    Returns
    -------
    (B, 3, F) float
        the transform of the velocities' goals

    """
    transforms = matching.blended(fits, rotations, gains.deformation)
    transforms = matching.with_volume(transforms, rest, gains.volume_conservation)
    position_change, velocity_change = matching.goals(centre, transforms, rest)
    position_change -= x
    position_change *= gains.position.astype(x.dtype)[:, None, None]
    velocity_change -= x
    velocity_change *= (gains.velocity / h).astype(x.dtype)[:, None, None]
    v += velocity_change
    x += position_change
    if gains.rigid.any():
        # nothing deforms: the mean velocity, to which the angular momentum adds the rotation
        v[gains.rigid] = (v[gains.rigid] @ rest.weights)[..., None]
    return transforms[1]


def restore_momentum(v: np.ndarray, drift: np.ndarray, rest: RestShape) -> None:
    """Bring the mean velocity back to `drift`: rounded positions divided by h have moved it."""
    v += (drift - v @ rest.weights)[..., None]


def restore_angular_momentum(
    x: np.ndarray, v: np.ndarray, centre: np.ndarray, spin: np.ndarray, rest: RestShape
) -> np.ndarray:
    """
    Add the rigid rotation that brings the angular momentum back to `spin`.

    The pull conserves it to first order only: moving the particles by s (g − x) changes the
    inertia under their velocities, and clamped goals exert a torque.

    Returns
    -------
    (B, 3, 3) float
        inverse inertia per mass, 1/m²

    """
    present, tensor = rigid_motion.angular_momentum_and_inertia(x, v, centre, rest)
    inverse = rigid_motion.inverse_inertia(tensor, rest)
    omega = rigid_motion.applied(inverse, spin - present)
    v += rigid_motion.field(x, centre, np.zeros_like(omega), omega)
    return inverse


def meet_obstacle(
    x: np.ndarray,
    v: np.ndarray,
    approach: np.ndarray,
    start: np.ndarray,
    patch: contact.Patch,
    sunk: np.ndarray,
    rest: RestShape,
    gravity: np.ndarray,
    gains: Gains,
    h: float,
) -> None:
    """Let deformable bodies meet an obstacle: as wholes, by their particles, as wholes again."""
    strength = float(np.linalg.norm(gravity))
    contacts, slow = patch.contacts, SLOW_TICKS * h * strength
    carried = contact.carried_weight(patch, sunk, gravity, rest, h)
    if carried.any():
        lift = patch.motion_by(carried, x)
        v += lift
        lift *= 0.5 * h
        x += lift
        contacts = contacts.after(lift)
    load = carried / patch.weight
    push = contact.collide(x, v, approach, start, contacts, load, gains, slow, h)
    absorbed = contact.absorbed_rebound(patch, push, gains, strength, rest)
    if absorbed.any():
        v += patch.motion_by(absorbed, x)


def rigid_bodies_meet_obstacles(
    x: np.ndarray,
    v: np.ndarray,
    obstacles: Sequence[Obstacle],
    rest: RestShape,
    gravity: np.ndarray,
    gains: Gains,
    h: float,
) -> None:
    """Let rigid bodies meet all obstacles at once, then move them out of each."""

    def touching(obstacle: Obstacle) -> contact.Contacts:
        contacts = contact.find(x, obstacle, gains.thickness)
        return contacts.where(gains.rigid[contacts.body])

    contacts = contact.joined([touching(obstacle) for obstacle in obstacles])
    if len(contacts):
        slow = SLOW_TICKS * h * float(np.linalg.norm(gravity))
        rigid_contact.collide(x, v, contacts, rest, gravity, gains, slow, h)
        for _ in range(PUSH_OUT_ROUNDS):
            for obstacle in obstacles:
                rigid_contact.push_out(x, touching(obstacle))
