# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of particles with obstacles, and of deformable bodies by way of their particles.

A deformable body meets an obstacle particle by particle, with friction. That alone would let it
sink in until enough light particles touch; so the obstacle also *carries its weight* as a whole,
but no more than its weight: at rest the body keeps its shape, and an impact, whose forces are many
times the weight, squashes it all the same. Restitution, too, is that of the body as a whole.

Few particles touch, so what a NumPy call costs by itself counts. Arrays (k, 3) of contacts are
therefore views of arrays (3, k): NumPy then runs along the contacts, not along the three axes.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.swept_contact import first_touch
from softbody_ros.core.columns import at
from softbody_ros.core.geometry import bounding_boxes
from softbody_ros.core.particles import Particles, picked, put
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.shape_matching.goals import Match
from softbody_ros.core.shape_matching.rest_shape import RestShape
from softbody_ros.core.shape_matching.rigid_motion import RigidMotion
from softbody_ros.core.sums import mapped
from softbody_ros.core.tick import Tick

SINKAGE = 0.01
"""Depth, in RMS radii, at which 63 % of a resting body's weight is carried as a whole."""
WALLS = 3
"""Walls of one obstacle that a fast particle can meet in a tick: in a corner there are three."""
SQUARE = 1e-6
"""Cosine, up to rounding, of the normals of faces at right angles."""
ROUNDING = 1e-6
"""Depth, in RMS radii, of particles on the surface."""
SETTLED = 0.1
"""Speed, in those of a body that falls by `SINKAGE`, up to which a body does not rebound."""
TINY = 1e-300


@dataclass(frozen=True)
class Contacts:
    """
    The k particles of a batch that touch one obstacle, one body after the other.

    Attributes
    ----------
    body, particle : (k,) int
    point : (k, 3) float
        where the particle is, m
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
    point: np.ndarray
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
        columns = (getattr(self, item.name).T for item in dataclasses.fields(self))
        return Contacts(*(column[..., selected].T for column in columns))

    def of(self, field: np.ndarray) -> np.ndarray:
        """Return what a (B, 3, n) field is at the touching particles, (k, 3)."""
        return picked(field, self.body, self.particle)

    def put(self, field: np.ndarray, values: np.ndarray) -> None:
        """Write what `of` returns."""
        put(field, self.body, self.particle, values)

    def shift(self, way: np.ndarray) -> None:
        """Let the particles be less deep, in place: they have gone a way (k, 3), m."""
        outwards = rigid_motion.dot(way, self.normal)
        np.maximum(self.depth - outwards, 0.0, out=self.depth)


NO_CONTACTS = Contacts(
    np.zeros(0, dtype=np.int64),
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 3)),
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
    if bodies is not None and len(bodies) < len(x):
        if not len(bodies):
            return NO_CONTACTS
        before = None if start is None else start[bodies]
        part = find(x[bodies], obstacle, thickness[bodies], before)
        return dataclasses.replace(part, body=bodies[part.body])
    if obstacle.config.type == 'plane':
        body, particle = _below(
            np.matmul(obstacle.half_space[0].astype(x.dtype), x), obstacle, thickness
        )
        return _contacts(picked(x, body, particle), body, particle, obstacle, thickness)
    way = np.zeros((len(x), 3)) if start is None else _way(x, start, obstacle)
    body, particle = _within(x, obstacle, thickness[:, None] + way)
    before = picked(start, body, particle) if start is not None and way.any() else None
    return _contacts(picked(x, body, particle), body, particle, obstacle, thickness, before)


def find_among(
    particles: Particles, obstacle: Obstacle, thickness: np.ndarray, bodies: np.ndarray
) -> Contacts:
    """Return what `find` does; to see who is below a plane, particles need not be written."""
    if obstacle.config.type != 'plane':
        return find(particles.x, obstacle, thickness, particles.start, bodies)
    if len(bodies) < len(thickness):
        others = np.setdiff1d(np.arange(len(thickness)), bodies)
        thickness = thickness.copy()
        thickness[others] = -np.inf
    body, particle = _below(particles.heights(obstacle.half_space[0]), obstacle, thickness)
    return _contacts(particles.places(body, particle), body, particle, obstacle, thickness)


def _contacts(
    points: np.ndarray,
    body: np.ndarray,
    particle: np.ndarray,
    obstacle: Obstacle,
    thickness: np.ndarray,
    before: np.ndarray | None = None,
) -> Contacts:
    """Return the contacts of those particles at points (k, 3), before at others, that touch."""
    if not len(body):
        return NO_CONTACTS
    gap = thickness.take(body)
    depth, normal = _closest(points, obstacle, gap)
    swept = np.zeros(len(body), dtype=bool)
    if before is not None:
        _sweep(points, before, obstacle, gap, depth, normal, swept)
    velocity = obstacle.surface_velocity(points)
    return Contacts(body, particle, points, normal, depth, velocity, swept).where(depth > 0.0)


def _closest(
    points: np.ndarray, obstacle: Obstacle, thickness: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return depths (k,), m, and normals (k, 3) of points (k, 3) with thickness (k,)."""
    if obstacle.faces is None:
        distance, normal = obstacle.closest(points)
        return thickness - distance, normal
    local = obstacle.local(points)
    depth, normal = np.full(len(points), -np.inf), np.zeros(points.shape)
    close = ~obstacle.is_clear(local, thickness)
    distance, normal[close] = obstacle.distance(local[close])
    depth[close] = thickness[close] - distance
    return depth, obstacle.to_world(normal)


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
    end = obstacle.local(points)
    length = np.linalg.norm(end - start, axis=1)
    fast = np.flatnonzero(length > obstacle.slow)
    fast = fast[~obstacle.is_clear(start[fast], thickness[fast] + length[fast])]
    if not len(fast):
        return
    touched, distance, way_out = first_touch(obstacle, start[fast], end[fast], thickness[fast])
    way_out = obstacle.to_world(way_out)
    entered = thickness[fast] - distance
    same_side = np.einsum('ij,ij->i', way_out, normal[fast]) > 0.5
    wrong = touched & (entered > 0.0) & ~(same_side & (depth[fast] > 0.5 * entered))
    fast = fast[wrong]
    depth[fast], normal[fast], swept[fast] = entered[wrong], way_out[wrong], True


def _below(
    heights: np.ndarray, plane: Obstacle, thickness: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return body and particle indices of heights (B, n) below a plane's, with thickness (B,)."""
    limit = (plane.half_space[1] + thickness).astype(heights.dtype, copy=False)
    return _indices(heights < limit[:, None])


def _within(x: np.ndarray, obstacle: Obstacle, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return body and particle indices of those in the box of an obstacle, and a reach (B, 3)."""
    # a little more, for the rounding of single precision
    half = 1.01 * np.abs(obstacle.rotation) @ obstacle.half_extents + reach
    low = (obstacle.position - half).astype(x.dtype, copy=False)[..., None]
    high = (obstacle.position + half).astype(x.dtype, copy=False)[..., None]
    return _indices(((x > low) & (x < high)).all(axis=1))


def _way(x: np.ndarray, start: np.ndarray, obstacle: Obstacle) -> np.ndarray:
    """Return (B, 3): how far bodies come along each axis, seen from an obstacle, 0 if slow, m."""
    if obstacle.before is not None:
        position, rotation = obstacle.before
        turn = (obstacle.rotation @ rotation.T).astype(x.dtype, copy=False)
        shift = (obstacle.position - turn @ position).astype(x.dtype, copy=False)
        come = x - mapped(turn, start)
        come -= shift[:, None]
    else:
        come = x - start
    way = np.abs(come, out=come).max(axis=2)
    way[way.max(axis=1) <= obstacle.slow / 3**0.5] = 0.0
    return way


def _indices(selected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what `numpy.nonzero` returns, several times faster for large bodies."""
    place = np.flatnonzero(selected)
    body = place // selected.shape[1]
    return body, place - selected.shape[1] * body


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
    (low, high), before = (
        bounding_boxes.bounds(particles.x),
        bounding_boxes.bounds(particles.start),
    )
    low, high = np.minimum(low, before[0]), np.maximum(high, before[1])
    position = np.array([obstacle.position for obstacle in obstacles])
    reach = np.array([obstacle.radius for obstacle in obstacles])
    distance = bounding_boxes.distances(low, high, position[:, None])
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
    if tick.gains.all_rigid:
        return
    thickness = tick.gains.thickness
    near, changed = None, False
    for index, obstacle in enumerate(obstacles):
        for wall in range(WALLS):
            if near is None:
                near = _deformable(nearby(particles, obstacles, thickness), tick)
            contacts = find_among(particles, obstacle, thickness, near[index])
            if wall > 0:
                # the particles that have just been put onto the surface are no contacts
                contacts = contacts.where(contacts.depth > ROUNDING * tick.rest.scale)
            if not len(contacts):
                break
            if changed:
                motion = rigid_motion.rigid_motion(
                    particles.x, particles.v, motion.centre, tick.rest
                )
            patch = make_patch(contacts, motion, tick.rest)
            goals = match.goals_of(contacts.body, contacts.particle)
            sunk = depth_of_goals(contacts, obstacle, goals, tick)
            _respond(particles, patch, sunk, tick)
            near, changed = None, True
            if not contacts.swept.any():
                break


def _deformable(near: list[np.ndarray], tick: Tick) -> list[np.ndarray]:
    """Return for each obstacle those of the bodies near it that are not rigid."""
    rigid = tick.gains.rigid
    return [bodies[~rigid[bodies]] for bodies in near] if tick.gains.any_rigid else near


def _respond(particles: Particles, patch: Patch, sunk: np.ndarray, tick: Tick) -> None:
    """Let bodies meet an obstacle: as wholes, by their particles, and as wholes again."""
    contacts = patch.contacts
    carried = carried_weight(patch, sunk, tick.gravity + particles.pressed, tick)
    if carried.any():
        lift = patch.motion_by(carried)
        particles.move(patch.bodies, patch.motion.centre, *lift, 0.5 * tick.h)
    contacts.shift(contacts.of(particles.x) - contacts.point)
    push, change = collide(particles, contacts, carried / patch.weight, tick)
    absorbed = absorbed_rebound(patch, push, tick)
    if absorbed.any():
        particles.move(patch.bodies, patch.motion.centre, *patch.motion_by(absorbed), 0.0)
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
    arms : (k, 3) float
        from the centre of mass, m
    rows : (k, 6) float
        normal, and arm × normal, m: impulses along the normals times them are wrenches
    first : (b,) int
        where the contacts of each of the b bodies that touch begin
    bodies : (b,) int
        which bodies touch

    """

    contacts: Contacts
    motion: RigidMotion
    weight: np.ndarray
    arms: np.ndarray
    rows: np.ndarray
    first: np.ndarray
    bodies: np.ndarray

    @cached_property
    def mass(self) -> np.ndarray:
        """(B,) float: share of the body's mass that touches."""
        return np.maximum(self.sum(self.weight), TINY)

    @property
    def share(self) -> np.ndarray:
        """(k,) float: of the touching mass."""
        return self.weight / self.mass.take(self.contacts.body)

    @property
    def levers(self) -> np.ndarray:
        """(k, 3) float: arm × normal, m: what a turn of the body does along the normal."""
        return self.rows[:, 3:]

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Return the sums (B, …) of values (k, …) over the patches."""
        sums = np.add.reduceat(values.T, self.first, axis=-1).T
        if len(sums) == len(self.motion.centre):
            return sums
        every = np.zeros((len(self.motion.centre), *values.shape[1:]))
        every[self.bodies] = sums
        return every

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (B,) of values (k,) over the patches."""
        return self.sum(self.weight * values) / self.mass

    @cached_property
    def speed(self) -> np.ndarray:
        """(B,) float: of the patch, along the normal away from the obstacle, m/s."""
        contacts, motion = self.contacts, self.motion
        twist = np.concatenate([motion.velocity, motion.angular_velocity], axis=1)
        speed = rigid_motion.dot(self.wrench(self.weight), twist) / self.mass
        if contacts.surface_velocity.any():
            speed -= self.mean(rigid_motion.dot(contacts.surface_velocity, contacts.normal))
        return speed

    def wrench(self, impulse: np.ndarray) -> np.ndarray:
        """Return (B, 6): the sums of impulses (k,) along the normals, and of what they turn."""
        return self.sum(impulse[:, None] * self.rows)

    def momentum_of(self, impulse: np.ndarray) -> np.ndarray:
        """Return (B, 2, 3): the sums of impulses (k, 3), and of what they turn."""
        return self.sum(rigid_motion.with_moment(impulse, self.arms)).reshape(-1, 2, 3)

    def motion_by(self, impulse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the velocities, m/s, rad/s, (B, 3), by impulses (k,) along the normals."""
        wrench = self.wrench(impulse)
        return wrench[:, :3], rigid_motion.applied(self.motion.inverse_inertia, wrench[:, 3:])


def make_patch(contacts: Contacts, motion: RigidMotion, rest: RestShape) -> Patch:
    """Return where bodies touch an obstacle."""
    body = contacts.body
    # a particle without area has no weight: it must not divide by zero
    weight = np.maximum(rest.weights.take(contacts.particle).astype(np.float64, copy=False), TINY)
    arms = contacts.point - at(motion.centre, body)
    bodies = np.flatnonzero(np.bincount(body))
    first = np.searchsorted(body, bodies)
    return Patch(
        contacts,
        motion,
        weight,
        arms,
        rigid_motion.with_moment(contacts.normal, arms),
        first,
        bodies,
    )


def depth_of_goals(
    contacts: Contacts, obstacle: Obstacle, goals: np.ndarray, tick: Tick
) -> np.ndarray:
    """Return (k,): how deep goals (k, 3) of touching particles lie in the obstacle, m, or 0."""
    distance, normal = obstacle.closest(goals)
    depth = tick.gains.thickness.take(contacts.body) - distance
    if obstacle.config.type != 'plane':
        # behind a thin wall goals are as deep as if it were thick
        beyond = contacts.swept | (rigid_motion.dot(normal, contacts.normal) < -SQUARE)
        below = contacts.depth - rigid_motion.dot(goals - contacts.point, contacts.normal)
        depth = np.where(beyond, below, depth)
    return np.maximum(depth, 0.0)


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
    pressure = patch.weight * sunk
    pressed = patch.sum(pressure)
    heaviness = -rigid_motion.dot(patch.contacts.normal, at(weight, body))
    load, depth = patch.mean(np.maximum(heaviness, 0.0)), pressed / patch.mass
    spring, damping = support(load, depth, tick.rest.scale, h)
    # implicit: the damper sees the speed after the push, which at rest is zero
    force = (spring - damping * patch.speed) / (1.0 + damping * h)
    push = h * np.minimum(np.maximum(force, 0.0), load)
    return push.take(body) * pressure / np.maximum(pressed, TINY).take(body)


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
    return np.sqrt(max(math.hypot(*gravity), TINY) * SINKAGE * scale)


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
    impulse = patch.weight * push
    leaving = (patch.speed + 0.5 * patch.sum(impulse)) / settling - SETTLED
    if leaving.max() <= 0.0:
        return np.zeros(len(push))
    lost = 0.5 * (1.0 - tick.gains.elasticity) * np.clip(leaving, 0.0, 1.0)
    return -lost.take(patch.contacts.body) * impulse


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
    normal = contacts.normal
    points, velocity = contacts.of(particles.x), contacts.of(particles.v)
    relative = velocity - contacts.surface_velocity
    normal_speed = rigid_motion.dot(relative, normal)
    push = np.maximum(-normal_speed, 0.0)
    tangential = relative - normal_speed[:, None] * normal
    slid = points - contacts.of(particles.start) - tick.h * contacts.surface_velocity
    slid -= rigid_motion.dot(slid, normal)[:, None] * normal
    rubbed = _rubbed(contacts.body, tangential, push + carried, tick)[:, None]

    change = push[:, None] * normal - rubbed * tangential
    retreat = contacts.depth[:, None] * normal - rubbed * slid
    contacts.put(particles.x, points + retreat)
    contacts.put(particles.v, velocity + change)
    return push, change


def _rubbed(body: np.ndarray, sliding: np.ndarray, pressed: np.ndarray, tick: Tick) -> np.ndarray:
    """Return the share (k,) of the sliding (k, 3), m/s, that friction takes under a load, m/s."""
    gains = tick.gains
    friction = gains.friction.take(body)
    if not gains.any_coulomb:
        return friction
    speed = np.linalg.norm(sliding, axis=1)
    bound = np.minimum(friction * pressed / np.where(speed > 0.0, speed, 1.0), 1.0)
    return np.where(gains.coulomb.take(body), bound, friction)
