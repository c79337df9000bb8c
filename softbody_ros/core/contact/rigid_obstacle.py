# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of rigid bodies with obstacles: the least impulses that keep them out, and friction.

All bodies that touch are treated at once. Where one support keeps all of a body out, as under a
ball, that takes a few operations on arrays. Only bodies that need several supports, or have
Coulomb's friction, are looked at one after the other.

As in `contact`, arrays (k, …) of contacts are views of arrays (…, k).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.columns import at, joined
from softbody_ros.core.contact.soft_obstacle import Contacts, find, nearby
from softbody_ros.core.particles import Particles
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.shape_matching.rigid_motion import RigidMotion
from softbody_ros.core.sums import mapped
from softbody_ros.core.tick import Tick

PUSH_OUT_ROUNDS = 3
"""A body between several obstacles is moved out of each so many times."""
FRICTION_ROUNDS, FRICTION_SWEEPS = 4, 8
MOST_SUPPORTS = 24
"""Touching particles that the impulse on a rigid body takes into account, worst first."""
MET = 1e-9
"""Share of the largest speed that supports have to give up to which the others may lack some."""
SAME = 1e-13
"""Relative change of what supports have to give that is rounding."""
TINY = 1e-300
DISTANCE = np.eye(7)[6]
"""Right-hand side by which non-negative least squares solve for the least distance."""


@dataclass(frozen=True)
class Touch:
    """
    Where b rigid bodies touch obstacles: k contacts, one body after the other.

    Twists are velocities of the centre and angular velocities; wrenches are impulses and turning
    impulses about the centre, per mass.

    Attributes
    ----------
    contacts : Contacts
    bodies : (b,) int
        which bodies touch
    row : (k,) int
        which of the b bodies each contact belongs to
    first : (b,) int
        where the contacts of each body begin
    arms : (k, 3) float
        from the centre of mass, m
    normals : (k, 6) float
        normal, and arm × normal, m: impulses along the normals times them are wrenches
    inverse_inertia : (b, 3, 3) float
        1/m²

    """

    contacts: Contacts
    bodies: np.ndarray
    row: np.ndarray
    first: np.ndarray
    arms: np.ndarray
    normals: np.ndarray
    inverse_inertia: np.ndarray

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Return the sums (b, …) of values (k, …) over the contacts of each body."""
        return np.add.reduceat(values.T, self.first, axis=-1).T

    def largest(self, values: np.ndarray) -> np.ndarray:
        """Return the largest (b,) of values (k,) at each body."""
        return np.maximum.reduceat(values, self.first)

    def worst(self, values: np.ndarray) -> np.ndarray:
        """Return at which contact, (b,) int, the value (k,) is the largest of its body."""
        return np.lexsort((-values, self.row))[self.first]

    def of(self, index: int) -> slice:
        """Return which contacts are those of one of the b bodies."""
        return slice(self.first[index], self.last[index])

    @cached_property
    def last(self) -> np.ndarray:
        """(b,) int: where the contacts of each body end."""
        return np.append(self.first[1:], len(self.row))

    @cached_property
    def root(self) -> np.ndarray:
        """(b, 3, 3) float: matrices that times their transposes are `inverse_inertia`, 1/m."""
        values, vectors = np.linalg.eigh(self.inverse_inertia)
        return vectors * np.sqrt(np.maximum(values, 0.0))[:, None]

    def wrench(self, impulse: np.ndarray) -> np.ndarray:
        """Return the wrenches (b, 6) of impulses (k,) along the normals."""
        return self.sum(impulse[:, None] * self.normals)

    def change(self, wrench: np.ndarray) -> np.ndarray:
        """Return by how much wrenches (b, 6) change the twists (b, 6)."""
        turned = rigid_motion.applied(self.inverse_inertia, wrench[:, 3:])
        return np.concatenate([wrench[:, :3], turned], axis=1)

    def speed(self, twist: np.ndarray) -> np.ndarray:
        """Return the speeds (k,) along the normals of bodies with twists (b, 6), m/s."""
        return rigid_motion.dot(self.normals, at(twist, self.row))


def meet(
    particles: Particles, motion: RigidMotion, obstacles: Sequence[Obstacle], tick: Tick
) -> None:
    """
    Let rigid bodies meet all obstacles at once, then move them out of each.

    Parameters
    ----------
    particles : Particles
        changed in place
    motion : RigidMotion
        of the rigid bodies before
    obstacles : sequence of Obstacle
    tick : Tick

    """
    gains = tick.gains
    if not obstacles or not gains.any_rigid:
        return
    found = [
        contacts
        for contacts in _touching(particles, obstacles, gains.thickness, gains.rigid)
        if len(contacts)
    ]
    if not found:
        return
    touch = make_touch(particles.x, joined(found), motion)
    collide(particles, touch, motion, tick)
    _push_out(particles, touch.bodies, obstacles, gains.thickness)


def make_touch(x: np.ndarray, contacts: Contacts, motion: RigidMotion) -> Touch:
    """Return where bodies at x (B, 3, n), m, touch obstacles, for contacts in any order."""
    if (np.diff(contacts.body) < 0).any():
        contacts = contacts.where(np.argsort(contacts.body, kind='stable'))
    body = contacts.body
    bodies = np.flatnonzero(np.bincount(body))
    arms = (x[body, :, contacts.particle].T - at(motion.centre, body).T).T
    return Touch(
        contacts,
        bodies,
        row=np.searchsorted(bodies, body),
        first=np.searchsorted(body, bodies),
        arms=arms,
        normals=rigid_motion.with_moment(contacts.normal, arms),
        inverse_inertia=motion.inverse_inertia[bodies],
    )


def collide(particles: Particles, touch: Touch, motion: RigidMotion, tick: Tick) -> None:
    """Give rigid bodies the impulses that keep their touching particles out, in place."""
    bodies = touch.bodies
    centre = motion.centre[bodies]
    before = np.concatenate([motion.velocity[bodies], motion.angular_velocity[bodies]], axis=1)
    weight = tick.gravity + particles.pressed[bodies]
    wrench, bounced = _wrench(touch, before, weight, tick)
    particles.received[bodies] += wrench.reshape(-1, 2, 3)

    change = touch.change(wrench)
    after = before + change
    # a load acts all through the tick, a bounce happens at the surface
    moved = np.where(bounced[:, None], 0.0, 0.5 * tick.h * change)
    turn = Rotation.from_rotvec(moved[:, 3:]).as_matrix()
    rows = _rows(bodies, particles)
    offsets = mapped(turn, particles.x[rows] - centre[..., None])
    particles.x[rows] = offsets + (centre + moved[:, :3])[..., None]
    turning = mapped(rigid_motion.cross_matrix(after[:, 3:]), offsets)
    particles.v[rows] = turning + after[:, :3, None]


# --------------------------------------------------------------------------------------- impulses
def _wrench(
    touch: Touch, before: np.ndarray, weight: np.ndarray, tick: Tick
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return what bodies get from the obstacles, (b, 6), and which of them have bounced, (b,) bool.

    Parameters
    ----------
    touch : Touch
    before : (b, 6) float
        twists before
    weight : (b, 3) float
        what has accelerated the bodies in the tick, m/s²: gravity, and what lies on them
    tick : Tick

    """
    wanted, speed = _rebound(touch, before, weight, tick)
    pending, needed = np.ones(len(before), dtype=bool), wanted - speed
    impulse, friction = np.zeros(len(needed)), np.zeros(before.shape)
    # friction tips a body over its contacts and the contacts carry the friction: take turns
    for _ in range(FRICTION_ROUNDS):
        _support(touch, needed, pending, impulse)
        pressure = touch.wrench(impulse)
        _rub(touch, before + touch.change(pressure), impulse, pending, friction, tick)
        last, needed = needed, wanted - speed - touch.speed(touch.change(friction))
        changed = touch.largest(np.abs(needed - last)) > SAME * touch.largest(np.abs(last))
        # friction that has lifted a body off its contacts must not drop it again
        pending &= changed & (touch.largest(impulse) > 0.0)
        if not pending.any():
            break
    return pressure + friction, touch.largest(wanted) > 0.0


def _rebound(
    touch: Touch, before: np.ndarray, weight: np.ndarray, tick: Tick
) -> tuple[np.ndarray, np.ndarray]:
    """Return the speeds out of the obstacle that contacts are to have, and have: (k,), m/s."""
    contacts, row = touch.contacts, touch.row
    speed = touch.speed(before) - rigid_motion.dot(contacts.normal, contacts.surface_velocity)
    bounces = speed < -tick.slow(weight)[row]
    if not bounces.any():
        return np.zeros(len(speed)), speed
    # what gravity has added since the deepest particle touched must not bounce
    fallen = touch.largest(
        -2.0 * rigid_motion.dot(contacts.normal, at(weight, row)) * contacts.depth
    )
    impact = np.sqrt(np.maximum(speed**2 - fallen[row], 0.0))
    return np.where(bounces, tick.gains.elasticity[contacts.body] * impact, 0.0), speed


def _support(touch: Touch, needed: np.ndarray, pending: np.ndarray, impulse: np.ndarray) -> None:
    """
    Set the smallest impulses λ ≥ 0 (k,) that change the speeds by what is `needed` (k,), in place.

    Smallest in kinetic energy; only of the bodies that are pending, (b,) bool.
    """
    # one support, the one that needs most, is often enough for the others
    worst = touch.worst(needed)
    largest = np.maximum(needed[worst], 0.0)
    push = touch.normals[worst]
    change = touch.change(push)
    single = largest / rigid_motion.dot(push, change)
    missing = needed - touch.speed(single[:, None] * change)
    enough = touch.largest(missing) <= MET * largest
    impulse[pending[touch.row]] = 0.0
    impulse[worst[pending]] = single[pending]
    for index in np.flatnonzero(pending & ~enough & (largest > 0.0)).tolist():
        own = touch.of(index)
        normal, lever = touch.normals[own].T[:3], touch.normals[own].T[3:]
        scaled = np.concatenate([normal, mapped(touch.root[index].T, lever)]).T
        impulse[own] = _least_impulses(scaled, needed[own] / largest[index]) * largest[index]


def _least_impulses(scaled: np.ndarray, needed: np.ndarray) -> np.ndarray:
    """
    Return the impulses λ ≥ 0 (k,) of least |scaledᵀ λ| with scaled · scaledᵀ λ ≥ `needed`.

    Least distance programming, solved as non-negative least squares (Lawson and Hanson, Solving
    Least Squares Problems, chapter 23). Constraints enter one at a time, the most violated first.

    Parameters
    ----------
    scaled : (k, 6) float
        normals, in coordinates in which the kinetic energy of a motion is half its square
    needed : (k,) float
        changes of the speeds along them, of which the largest is 1

    """
    active = [int(needed.argmax())]
    impulses = 1.0 / rigid_motion.dot(scaled[active], scaled[active])
    system = np.vstack([scaled.T, needed])
    while len(active) < MOST_SUPPORTS:
        # no product of long arrays: BLAS might share it out among threads
        missing = needed - rigid_motion.dot(scaled, impulses @ scaled[active])
        worst = int(missing.argmax())
        if missing[worst] < MET or worst in active:
            break
        following = [*active, worst]
        try:
            solution = nnls(system[:, following], DISTANCE)[0]
        except RuntimeError:  # it does not converge where supports nearly repeat each other
            break
        slack = 1.0 - needed[following] @ solution
        if slack < 1e-12:  # no motion satisfies all: the body is wedged
            break
        active, impulses = following, solution / slack
    result = np.zeros(len(needed))
    result[active] = impulses
    return result


# --------------------------------------------------------------------------------------- friction
def _rub(
    touch: Touch,
    twist: np.ndarray,
    impulse: np.ndarray,
    pending: np.ndarray,
    friction: np.ndarray,
    tick: Tick,
) -> None:
    """
    Set the friction, (b, 6) wrenches, that goes with impulses (k,) along the normals, in place.

    Only of the bodies that are pending, (b,) bool; their twists (b, 6) are those it acts on.
    """
    coulomb = tick.gains.coulomb[touch.bodies]
    if not coulomb.all():
        viscous = pending & ~coulomb
        friction[viscous] = _viscous(touch, twist, impulse, tick)[viscous]
    for index in np.flatnonzero(pending & coulomb).tolist():
        own = touch.of(index)
        pushed = own.start + np.flatnonzero(impulse[own])
        friction[index] = _coulomb(touch, index, pushed, twist[index], impulse[pushed], tick)


def _viscous(touch: Touch, twist: np.ndarray, impulse: np.ndarray, tick: Tick) -> np.ndarray:
    """Return the wrenches (b, 6) that take a share of the sliding at the centres of pressure."""
    contacts = touch.contacts
    share = impulse / np.maximum(touch.sum(impulse), TINY)[touch.row]
    everything = np.concatenate([contacts.normal.T, touch.arms.T, contacts.surface_velocity.T]).T
    normal, arm, surface = touch.sum(share[:, None] * everything).reshape(-1, 3, 3).swapaxes(0, 1)
    velocity = twist[:, :3] + rigid_motion.cross(twist[:, 3:], arm) - surface
    velocity -= rigid_motion.dot(velocity, normal)[:, None] * normal
    speed = np.sqrt(rigid_motion.dot(velocity, velocity))
    along = rigid_motion.with_moment(velocity / np.maximum(speed, TINY)[:, None], arm)
    mobility = np.maximum(rigid_motion.dot(along, touch.change(along)), TINY)
    taken = tick.gains.friction[touch.bodies] * speed / mobility
    # without pressure nothing rubs
    return np.where(touch.sum(impulse) > 0.0, -taken, 0.0)[:, None] * along


def _coulomb(
    touch: Touch,
    index: int,
    pushed: np.ndarray,
    twist: np.ndarray,
    impulse: np.ndarray,
    tick: Tick,
) -> np.ndarray:
    """Return the wrench (6,) on one body, with twist (6,), of impulses ≤ μ λ at each contact."""
    if not len(pushed):
        return np.zeros(6)
    planes = np.linalg.svd(touch.contacts.normal[pushed, None])[2][:, 1:]
    rows = (planes @ rigid_motion.jacobian(touch.arms[pushed])).reshape(-1, 6)
    surface = rigid_motion.applied(planes, touch.contacts.surface_velocity[pushed]).ravel()
    mobile = np.hstack([rows[:, :3], rows[:, 3:] @ touch.inverse_inertia[index]])
    response, sliding = rows @ mobile.T, surface - rows @ twist
    bound = tick.gains.friction[touch.bodies[index]] * impulse
    # does it stick?
    holding = np.linalg.lstsq(response, sliding, rcond=None)[0].reshape(-1, 2)
    if not (np.linalg.norm(holding, axis=1) <= bound).all():
        holding = _sliding(response, sliding, bound)
    return holding.ravel() @ rows


def _sliding(response: np.ndarray, sliding: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """
    Return impulses (p, 2) of at most `bound` (p,) that slow p contacts down.

    Projected Gauss-Seidel, contact by contact.

    Parameters
    ----------
    response : (2 p, 2 p) float
        what impulses change of the velocities
    sliding : (2 p,) float
        what is missing of them, m/s
    bound : (p,) float
        m/s

    """
    sliding, given = sliding.copy(), np.zeros((len(bound), 2))
    own = [slice(2 * index, 2 * index + 2) for index in range(len(bound))]
    softest = np.linalg.eigvalsh(np.stack([response[part, part] for part in own]))[:, -1]
    for _ in range(FRICTION_SWEEPS):
        for index, part in enumerate(own):
            total = given[index] + sliding[part] / softest[index]
            size = math.hypot(*total)
            if size > bound[index]:
                total *= bound[index] / size
            sliding -= response[:, part] @ (total - given[index])
            given[index] = total
    return given


# --------------------------------------------------------------------------------------- positions
def _touching(
    particles: Particles,
    obstacles: Sequence[Obstacle],
    thickness: np.ndarray,
    rigid: np.ndarray,
) -> Iterator[Contacts]:
    """Yield the contacts of rigid bodies, (B,) bool, with one obstacle after the other."""
    for obstacle, near in zip(obstacles, nearby(particles, obstacles, thickness), strict=True):
        yield find(particles.x, obstacle, thickness, particles.start, near[rigid[near]])


def _push_out(
    particles: Particles, bodies: np.ndarray, obstacles: Sequence[Obstacle], thickness: np.ndarray
) -> None:
    """Move bodies that have touched, (b,) int, out of the obstacles, in place."""
    rows = _rows(bodies, particles)
    particles.write()
    part = Particles(particles.room[rows], particles.start[rows])
    for _ in range(PUSH_OUT_ROUNDS):
        touched = False
        for contacts in _touching(part, obstacles, thickness[rows], np.ones(len(bodies), bool)):
            if len(contacts):
                _move_out(part.x, contacts)
                touched = True
        if not touched:
            break
    particles.x[rows] = part.x


def _move_out(x: np.ndarray, contacts: Contacts) -> None:
    """Move bodies by their deepest particle's depth, in place."""
    deepest_first = np.lexsort((-contacts.depth, contacts.body))
    deepest = deepest_first[np.flatnonzero(np.diff(contacts.body, prepend=-1))]
    way = contacts.depth[deepest, None] * contacts.normal[deepest]
    x[contacts.body[deepest]] += way[..., None]


def _rows(bodies: np.ndarray, particles: Particles) -> np.ndarray | slice:
    """Return an index of bodies (b,) that makes no copy where they are all."""
    return bodies if len(bodies) < len(particles.x) else slice(None)
