# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of particles with obstacles, and of deformable bodies by way of their particles.

A deformable body meets an obstacle particle by particle, with friction. That alone would let it
sink in until enough light particles touch; so the obstacle also *carries its weight* as a whole,
but no more than its weight: at rest the body keeps its shape, and an impact, whose forces are many
times the weight, squashes it all the same. Restitution, too, is that of the body as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softbody_ros.core import boxes, rigid_motion
from softbody_ros.core.columns import summed
from softbody_ros.core.goals import Match
from softbody_ros.core.obstacles import Obstacle
from softbody_ros.core.rest_shape import RestShape
from softbody_ros.core.rigid_motion import RigidMotion
from softbody_ros.core.sweep import first_touch
from softbody_ros.core.tick import Particles, Tick

SINKAGE = 0.01
"""Depth, in RMS radii, at which 63 % of a resting body's weight is carried as a whole."""
WALLS = 3
"""Walls of one obstacle that a fast particle can meet in a tick: in a corner there are three."""
ROUNDING = 1e-6
"""Depth, in RMS radii, of particles on the surface."""
SETTLED = 0.1
"""Speed, in those of a body that falls by `SINKAGE`, up to which a body does not rebound."""


@dataclass(frozen=True)
class Contacts:
    """
    The k particles of a batch that touch one obstacle.

    Attributes
    ----------
    body, particle : (k,) int
    normal : (k, 3) float
        out of the obstacle
    depth : (k,) float
        m, with the body's thickness
    surface_velocity : (k, 3) float
        of the obstacle at the particle, m/s
    swept : (k,) bool
        where the obstacle counts as the half space that a fast particle has entered

    """

    body: np.ndarray
    particle: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    surface_velocity: np.ndarray
    swept: np.ndarray

    def __len__(self) -> int:
        return len(self.body)

    def where(self, selected: np.ndarray) -> Contacts:
        """Return some of the contacts, given as a mask or as indices."""
        if selected.dtype == bool and selected.all():
            return self
        columns = (getattr(self, item.name) for item in dataclasses.fields(self))
        return Contacts(*(column[selected] for column in columns))

    def after(self, shift: np.ndarray) -> Contacts:
        """Return the contacts after particles have been shifted by a (B, 3, n) field, m."""
        outwards = np.einsum('ij,ij->i', shift[self.body, :, self.particle], self.normal)
        return dataclasses.replace(self, depth=np.maximum(self.depth - outwards, 0.0))


NO_CONTACTS = Contacts(
    np.zeros(0, dtype=np.int64),
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros(0, dtype=bool),
)


# -------------------------------------------------------------------------------------- detection
def find(
    x: np.ndarray,
    obstacle: Obstacle,
    thickness: np.ndarray,
    start: np.ndarray | None = None,
    bodies: np.ndarray | None = None,
) -> Contacts:
    """
    Return the particles that are nearer to an obstacle than their body's thickness.

    They are to leave it by its closest point. Where a particle is so fast that this may be on the
    far side, it is to return to the side from which it has come.

    Parameters
    ----------
    x : (B, 3, n) float
        m
    obstacle : Obstacle
    thickness : (B,) float
        m
    start : (B, 3, n) float, optional
        positions at the tick before, m; without them nothing is fast
    bodies : (b,) int, optional
        those that may touch, by default all

    """
    if obstacle.config.type == 'plane':
        start = None
    if bodies is not None and not len(bodies):
        return NO_CONTACTS
    if bodies is not None and len(bodies) < len(x):
        part = find(
            x[bodies], obstacle, thickness[bodies], None if start is None else start[bodies]
        )
        return dataclasses.replace(part, body=bodies[part.body])
    body, particle = _candidates(x, obstacle, thickness, start)
    if not len(body):
        return NO_CONTACTS
    points = x[body, :, particle]
    depth, normal = _closest(points, obstacle, thickness[body])
    swept = np.zeros(len(body), dtype=bool)
    if start is not None:
        _sweep(points, start[body, :, particle], obstacle, thickness[body], depth, normal, swept)
    velocity = obstacle.surface_velocity(points)
    return Contacts(body, particle, normal, depth, velocity, swept).where(depth > 0.0)


def _closest(
    points: np.ndarray, obstacle: Obstacle, thickness: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return depths (k,), m, and normals (k, 3) of points (k, 3) with thickness (k,)."""
    local = (points - obstacle.position) @ obstacle.rotation
    if obstacle.faces is None:
        distance, normal = obstacle.distance(local)
        return thickness - distance, normal @ obstacle.rotation.T
    depth, normal = np.full(len(points), -np.inf), np.zeros(points.shape)
    close = ~obstacle.is_clear(local, thickness)
    distance, normal[close] = obstacle.distance(local[close])
    depth[close] = thickness[close] - distance
    return depth, normal @ obstacle.rotation.T


def _sweep(
    points: np.ndarray,
    start: np.ndarray,
    obstacle: Obstacle,
    thickness: np.ndarray,
    depth: np.ndarray,
    normal: np.ndarray,
    swept: np.ndarray,
) -> None:
    """Let fast particles leave on the side on which they came: change the others, in place."""
    before = obstacle.before or (obstacle.position, obstacle.rotation)
    start = (start - before[0]) @ before[1]
    end = (points - obstacle.position) @ obstacle.rotation
    length = np.linalg.norm(end - start, axis=1)
    fast = np.flatnonzero(length > obstacle.slow)
    fast = fast[~obstacle.is_clear(start[fast], thickness[fast] + length[fast])]
    if not len(fast):
        return
    touched, distance, way_out = first_touch(obstacle, start[fast], end[fast], thickness[fast])
    way_out = way_out @ obstacle.rotation.T
    entered = thickness[fast] - distance
    same_side = np.einsum('ij,ij->i', way_out, normal[fast]) > 0.5
    wrong = touched & (entered > 0.0) & ~(same_side & (depth[fast] > 0.5 * entered))
    fast = fast[wrong]
    depth[fast], normal[fast], swept[fast] = entered[wrong], way_out[wrong], True


def _candidates(
    x: np.ndarray, obstacle: Obstacle, thickness: np.ndarray, start: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return body and particle indices of those that may touch: a cheap test for all."""
    if obstacle.config.type == 'plane':
        normal = obstacle.rotation[:, 2]
        height = np.matmul(normal.astype(x.dtype), x)
        limit = obstacle.position @ normal + thickness
        return _indices(height < limit.astype(x.dtype)[:, None])
    low = high = _in_frame(x, obstacle.position, obstacle.rotation)
    if start is not None:
        before = _in_frame(start, *(obstacle.before or (obstacle.position, obstacle.rotation)))
        if np.abs(before - low).max() > obstacle.slow / 3**0.5:
            low, high = np.minimum(low, before), np.maximum(high, before)
    # a little more, for the rounding of single precision
    limit = (1.01 * obstacle.half_extents + thickness[:, None]).astype(x.dtype)[..., None]
    return _indices(((low < limit) & (high > -limit)).all(axis=1))


def _in_frame(x: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return positions (B, 3, n) in the frame of an obstacle at a pose."""
    return np.matmul(rotation.T.astype(x.dtype), x - position.astype(x.dtype)[:, None])


def _indices(selected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what `numpy.nonzero` returns, several times faster for large bodies."""
    body, particle = np.divmod(np.flatnonzero(selected), selected.shape[1])
    return body, particle


def nearby(
    particles: Particles, obstacles: Sequence[Obstacle], thickness: np.ndarray
) -> list[np.ndarray]:
    """
    Return for each obstacle which bodies, (b,) int, may have come to touch it in this tick.

    Parameters
    ----------
    particles : Particles
    obstacles : sequence of Obstacle
    thickness : (B,) float
        m

    """
    if all(obstacle.config.type == 'plane' for obstacle in obstacles):
        return [np.arange(len(thickness))] * len(obstacles)
    low = np.minimum(particles.x.min(axis=2), particles.start.min(axis=2))
    high = np.maximum(particles.x.max(axis=2), particles.start.max(axis=2))
    position = np.array([obstacle.position for obstacle in obstacles])
    reach = np.array([obstacle.radius for obstacle in obstacles])
    distance = boxes.distances(low, high, position[:, None])
    for index, obstacle in enumerate(obstacles):
        if obstacle.before is not None:
            centre, rotation = obstacle.before
            turn = np.linalg.norm(obstacle.rotation - rotation)
            travel = np.linalg.norm(obstacle.position - centre)
            # seen from an obstacle that turns, what is far away is fast
            far = np.linalg.norm(np.maximum(np.abs(low - centre), np.abs(high - centre)), axis=1)
            distance[index] -= travel + turn * far
    return [np.flatnonzero(near) for near in distance <= reach[:, None] + thickness]


# -------------------------------------------------------------------------------------- deformable
def meet(
    particles: Particles,
    match: Match,
    motion: RigidMotion,
    obstacles: Sequence[Obstacle],
    tick: Tick,
) -> None:
    """
    Let deformable bodies meet the obstacles, one after the other.

    Parameters
    ----------
    particles : Particles
        changed in place
    match : Match
        where the particles want to be
    motion : RigidMotion
        of the bodies before
    obstacles : sequence of Obstacle
    tick : Tick

    """
    if tick.gains.rigid.all():
        return
    changed = False
    thickness = tick.gains.thickness
    near = nearby(particles, obstacles, thickness)
    for index, obstacle in enumerate(obstacles):
        for wall in range(WALLS):
            contacts = find(particles.x, obstacle, thickness, particles.start, near[index])
            contacts = contacts.where(~tick.gains.rigid[contacts.body])
            if wall > 0:
                # the particles that have just been put onto the surface are no contacts
                contacts = contacts.where(contacts.depth > ROUNDING * tick.rest.scale)
            if not len(contacts):
                break
            if changed:
                motion = rigid_motion.rigid_motion(
                    particles.x, particles.v, motion.centre, tick.rest
                )
            patch = make_patch(particles.x, contacts, motion, tick.rest)
            sunk = depth_of_goals(particles.x, contacts, obstacle, match, tick)
            _respond(particles, patch, sunk, tick)
            near, changed = nearby(particles, obstacles, thickness), True
            if not contacts.swept.any():
                break


def _respond(particles: Particles, patch: Patch, sunk: np.ndarray, tick: Tick) -> None:
    """Let bodies meet an obstacle: as wholes, by their particles, and as wholes again."""
    x, v, contacts = particles.x, particles.v, patch.contacts
    carried = carried_weight(patch, sunk, tick.gravity + particles.pressed, tick)
    if carried.any():
        lift = patch.motion_by(carried, x)
        v += lift
        lift *= 0.5 * tick.h
        x += lift
        contacts = contacts.after(lift)
    push, change = collide(particles, contacts, carried / patch.weight, tick)
    absorbed = absorbed_rebound(patch, push, tick)
    if absorbed.any():
        v += patch.motion_by(absorbed, x)
    as_whole = (carried + absorbed)[:, None] * contacts.normal
    particles.received[:] += patch.momentum_of(as_whole + patch.weight[:, None] * change)


@dataclass(frozen=True)
class Patch:
    """
    Where bodies touch an obstacle, seen as rigid bodies of their present shape.

    Attributes
    ----------
    contacts : Contacts
    motion : RigidMotion
    weight : (k,) float
        share of the body's mass that each touching particle has
    share : (k,) float
        share of the touching mass
    arms : (k, 3) float
        from the centre of mass, m

    """

    contacts: Contacts
    motion: RigidMotion
    weight: np.ndarray
    share: np.ndarray
    arms: np.ndarray

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (B,) of values (k,) over the patches."""
        return _per_body(self.share * values, self.contacts.body, len(self.motion.centre))

    @cached_property
    def levers(self) -> np.ndarray:
        """(k, 3) float: arm × normal, m: what a turn of the body does along the normal."""
        return rigid_motion.cross(self.arms, self.contacts.normal)

    @cached_property
    def speed(self) -> np.ndarray:
        """(B,) float: of the patch, along the normal away from the obstacle, m/s."""
        body, motion = self.contacts.body, self.motion
        velocity = motion.velocity[body] - self.contacts.surface_velocity
        speeds = np.einsum('ij,ij->i', velocity, self.contacts.normal)
        speeds += np.einsum('ij,ij->i', motion.angular_velocity[body], self.levers)
        return self.mean(speeds)

    def momentum_of(self, impulse: np.ndarray) -> np.ndarray:
        """Return (B, 2, 3): the sums of impulses (k, 3), and of what they turn."""
        body, bodies = self.contacts.body, len(self.motion.centre)
        turning = rigid_motion.cross(self.arms, impulse)
        return np.stack(
            [_per_body(impulse, body, bodies), _per_body(turning, body, bodies)], axis=1
        )

    def motion_by(self, impulse: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the rigid motions (B, 3, n) that impulses (k,) along the normals cause, m/s."""
        body = self.contacts.body
        velocity = _per_body(impulse[:, None] * self.contacts.normal, body, len(x))
        spin = _per_body(impulse[:, None] * self.levers, body, len(x))
        angular_velocity = rigid_motion.applied(self.motion.inverse_inertia, spin)
        return rigid_motion.field(x, self.motion.centre, velocity, angular_velocity)


def make_patch(x: np.ndarray, contacts: Contacts, motion: RigidMotion, rest: RestShape) -> Patch:
    """Return where bodies at x (B, 3, n), m, touch an obstacle."""
    body, particle = contacts.body, contacts.particle
    # a particle without area has no weight: it must not divide by zero
    weight = np.maximum(rest.weights[particle].astype(np.float64), 1e-300)
    share = weight / _per_body(weight, body, len(x))[body]
    arms = x[body, :, particle] - motion.centre[body]
    return Patch(contacts, motion, weight, share, arms)


def depth_of_goals(
    x: np.ndarray, contacts: Contacts, obstacle: Obstacle, match: Match, tick: Tick
) -> np.ndarray:
    """Return (k,): how deep the goals of touching particles lie in the obstacle, m, or 0."""
    body, particle = contacts.body, contacts.particle
    goal = match.goals_of(body, particle)
    distance, normal = obstacle.distance((goal - obstacle.position) @ obstacle.rotation)
    depth = tick.gains.thickness[body] - distance
    # behind a thin wall goals are as deep as if it were thick
    normal = normal @ obstacle.rotation.T
    beyond = contacts.swept | (np.einsum('ij,ij->i', normal, contacts.normal) < 0.0)
    offset = goal - x[body, :, particle]
    below = contacts.depth - np.einsum('ij,ij->i', offset, contacts.normal)
    return np.maximum(np.where(beyond, below, depth), 0.0)


def carried_weight(patch: Patch, sunk: np.ndarray, weight: np.ndarray, tick: Tick) -> np.ndarray:
    """
    Return the impulses by which the obstacle carries the weight of bodies that sink into it.

    A critically damped spring between goal shape and obstacle, soft enough for the step, pushes
    the body as a whole, with at most its weight: so it takes little part in an impact, cannot
    throw a body up, and does nothing without gravity.

    Parameters
    ----------
    patch : Patch
    sunk : (k,) float
        depth of each touching particle's goal, m, not negative
    weight : (B, 3) float
        of the bodies and of what lies on them, m/s²
    tick : Tick

    Returns
    -------
    (k,) float
        per mass, along the normals, m/s

    """
    body, h = patch.contacts.body, tick.h
    depth = patch.mean(sunk)
    heaviness = -np.einsum('ij,ij->i', patch.contacts.normal, weight[body])
    load = patch.mean(np.maximum(heaviness, 0.0))
    spring, damping = support(load, depth, tick.rest.scale, h)
    # implicit: the damper sees the speed after the push, which at rest is zero
    force = (spring - damping * patch.speed) / (1.0 + damping * h)
    push = h * np.minimum(np.maximum(force, 0.0), load)
    pressure = sunk / np.where(depth > 0.0, depth, 1.0)[body]
    return push[body] * patch.share * pressure


def support(
    load: np.ndarray, depth: np.ndarray, scale: float | np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the spring, m/s², and the damping, 1/s, that carry loads, m/s², at depths, m.

    The spring gives at most the load; the damping is critical.
    """
    softness = np.maximum(SINKAGE * scale, 4.0 * load * h**2)
    return load * -np.expm1(-depth / softness), 2.0 * np.sqrt(load / softness)


def settling_speed(gravity: np.ndarray, scale: float | np.ndarray) -> float | np.ndarray:
    """Return the speed, m/s, of bodies that settle under a gravity (3,): a fall by `SINKAGE`."""
    return np.sqrt(max(float(np.linalg.norm(gravity)), 1e-300) * SINKAGE * scale)


def absorbed_rebound(patch: Patch, push: np.ndarray, tick: Tick) -> np.ndarray:
    """
    Return the impulses that a body of little elasticity does not get back when it rebounds.

    It is the shape that throws a deformable body back. So while the patch moves away from the
    obstacle, the share (1 − ε) / 2 of what the obstacle gives is taken from the body as a whole
    (Poisson's view of restitution). It only ever takes energy.

    Parameters
    ----------
    patch : Patch
    push : (k,) float
        speeds that touching particles have got from the obstacle, m/s
    tick : Tick

    Returns
    -------
    (k,) float
        per mass, along the normals, not positive, m/s

    """
    # fades out at the speeds of a body that settles, whose weight must be carried in full
    settling = settling_speed(tick.gravity, tick.rest.scale)
    # the speed halfway through the push, so that the turn of the motion is found at any step
    given = _per_body(patch.weight * push, patch.contacts.body, len(patch.speed))
    leaving = np.clip((patch.speed + 0.5 * given) / settling - SETTLED, 0.0, 1.0)
    lost = 0.5 * (1.0 - tick.gains.elasticity) * leaving
    return -lost[patch.contacts.body] * patch.weight * push


def collide(
    particles: Particles, contacts: Contacts, carried: np.ndarray, tick: Tick
) -> tuple[np.ndarray, np.ndarray]:
    """
    Project particles out of an obstacle and stop their approach, in place.

    Particles do not bounce by themselves: restitution of so small a share of the mass throws it
    against the shape's pull again and again, and the pull, which points into the obstacle, would
    be reflected with it and pump energy. What bounces is the body, see `absorbed_rebound`.
    Friction takes back the same share of the sliding distance as of the sliding speed, so that
    what sticks does not creep.

    Parameters
    ----------
    particles : Particles
    contacts : Contacts
    carried : (k,) float
        load that is carried besides, as speed, m/s: friction may count on it
    tick : Tick

    Returns
    -------
    push : (k,) float
        speeds that the particles have got along the normals, m/s
    change : (k, 3) float
        all that has changed of their velocities, m/s

    """
    x, v, gains = particles.x, particles.v, tick.gains
    body, particle, normal = contacts.body, contacts.particle, contacts.normal
    points = x[body, :, particle]
    relative = v[body, :, particle] - contacts.surface_velocity
    normal_speed = np.einsum('ij,ij->i', relative, normal)
    push = np.maximum(-normal_speed, 0.0)

    tangential = relative - normal_speed[:, None] * normal
    friction = gains.friction[body]
    kept = 1.0 - friction
    if gains.coulomb.any():
        sliding_speed = np.linalg.norm(tangential, axis=1)
        stopped = friction * (push + carried) / np.where(sliding_speed > 0.0, sliding_speed, 1.0)
        kept = np.where(gains.coulomb[body], 1.0 - np.minimum(stopped, 1.0), kept)
    kept = kept[:, None]

    slid = points - particles.start[body, :, particle] - tick.h * contacts.surface_velocity
    slid -= np.einsum('ij,ij->i', slid, normal)[:, None] * normal
    x[body, :, particle] = points + contacts.depth[:, None] * normal - (1.0 - kept) * slid
    v[body, :, particle] = (
        contacts.surface_velocity + (normal_speed + push)[:, None] * normal + kept * tangential
    )
    return push, push[:, None] * normal - (1.0 - kept) * tangential


def _per_body(values: np.ndarray, body: np.ndarray, bodies: int) -> np.ndarray:
    """Return the sums over each body's contacts, (B,) or (B, 3), in a fixed order."""
    if bodies == 1:
        return values.sum(axis=0, keepdims=True)
    if values.ndim == 1:
        return np.bincount(body, values, bodies)
    return summed(values, body, bodies)
