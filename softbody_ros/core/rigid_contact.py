# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact of rigid bodies with obstacles: the least impulses that keep them out, and friction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from softbody_ros.core import rigid_motion
from softbody_ros.core.columns import joined
from softbody_ros.core.contact import Contacts, find, nearby
from softbody_ros.core.obstacles import Obstacle
from softbody_ros.core.particles import Particles
from softbody_ros.core.sums import weighted
from softbody_ros.core.tick import Tick

PUSH_OUT_ROUNDS = 3
"""A body between several obstacles is moved out of each so many times."""
FRICTION_ROUNDS, FRICTION_SWEEPS = 4, 8
MOST_SUPPORTS = 24
"""Touching particles that the impulse on a rigid body takes into account, worst first."""


def meet(particles: Particles, obstacles: Sequence[Obstacle], tick: Tick) -> None:
    """
    Let rigid bodies meet all obstacles at once, then move them out of each.

    Parameters
    ----------
    particles : Particles
        changed in place
    obstacles : sequence of Obstacle
    tick : Tick

    """
    if not obstacles or not tick.gains.any_rigid:
        return

    def touching() -> Iterator[Contacts]:
        near = nearby(particles, obstacles, tick.gains.thickness)
        for obstacle, bodies in zip(obstacles, near, strict=True):
            rigid = bodies[tick.gains.rigid[bodies]]
            yield find(particles.x, obstacle, tick.gains.thickness, particles.start, rigid)

    contacts = joined([*touching()])
    if not len(contacts):
        return
    for body in np.unique(contacts.body):
        collide(particles, int(body), contacts.where(contacts.body == body), tick)
    for _ in range(PUSH_OUT_ROUNDS):
        for contacts in touching():
            _push_out(particles.x, contacts)


def collide(particles: Particles, body: int, contacts: Contacts, tick: Tick) -> None:
    """Give a rigid body the impulses that keep its touching particles out, in place."""
    x, v = particles.x[body], particles.v[body]
    centre = weighted(x, tick.rest.weights)
    rigid = rigid_motion.rigid_motion(x[None], v[None], centre[None], tick.rest)
    mobility = np.eye(6)
    mobility[3:, 3:] = rigid.inverse_inertia[0]
    arms = x[:, contacts.particle].T - centre

    before = np.concatenate([rigid.velocity[0], rigid.angular_velocity[0]])
    weight = tick.gravity + particles.pressed[body]
    motion, bounced = _impulses(before, mobility, arms, contacts, weight, tick)

    # a load acts all through the tick, a bounce happens at the surface
    change = np.zeros(6) if bounced else 0.5 * tick.h * (motion - before)
    particles.received[body, 0] += motion[:3] - before[:3]
    particles.received[body, 1] += np.linalg.pinv(mobility[3:, 3:]) @ (motion - before)[3:]
    offsets = Rotation.from_rotvec(change[3:]).apply((x - centre[:, None]).T).T
    x[:] = offsets + (centre + change[:3])[:, None]
    v[:] = motion[:3, None] + np.cross(motion[3:], offsets, axisb=0, axisc=0)


def _impulses(
    motion: np.ndarray,
    mobility: np.ndarray,
    arms: np.ndarray,
    contacts: Contacts,
    weight: np.ndarray,
    tick: Tick,
) -> tuple[np.ndarray, bool]:
    """
    Return the motion (linear, angular) of a body after its impulses, and whether it bounced.

    `weight` (3,) is what has accelerated it in the tick, m/s²: gravity, and what lies on it.
    """
    gains = tick.gains
    body = contacts.body[0]
    normals = np.hstack([contacts.normal, np.cross(arms, contacts.normal)])
    speed = normals @ motion - np.einsum('ij,ij->i', contacts.normal, contacts.surface_velocity)
    # what gravity has added since the deepest particle touched must not bounce
    fallen = np.max(-2.0 * (contacts.normal @ weight) * contacts.depth)
    impact = np.sqrt(np.maximum(speed**2 - fallen, 0.0))
    wanted = np.where(speed < -tick.slow(weight), gains.elasticity[body] * impact, 0.0)
    rubbed = _coulomb if gains.coulomb[body] else _viscous
    friction = np.zeros(6)
    # friction tips a body over its contacts and the contacts carry the friction: take turns
    for _ in range(FRICTION_ROUNDS):
        impulse = _least_impulses(normals, mobility, wanted - speed - normals @ friction)
        pushed = np.flatnonzero(impulse)
        pressed = motion + mobility @ (normals[pushed].T @ impulse[pushed])
        if not len(pushed):
            friction[:] = 0.0
            break
        at_contacts = (arms[pushed], contacts.where(pushed), impulse[pushed])
        friction = rubbed(pressed, mobility, *at_contacts, gains.friction[body]) - pressed
    return pressed + friction, bool(wanted.any())


def _coulomb(
    motion: np.ndarray,
    mobility: np.ndarray,
    arms: np.ndarray,
    contacts: Contacts,
    impulse: np.ndarray,
    friction: float,
) -> np.ndarray:
    """Return the motion after friction impulses of at most μ λ at each particle."""
    planes = [np.linalg.svd(normal[None])[2][1:] for normal in contacts.normal]
    rows = np.stack(planes) @ rigid_motion.jacobian(arms)
    surface = np.einsum('kij,kj->ki', np.stack(planes), contacts.surface_velocity)
    bound = friction * impulse
    # does it stick?
    flat = rows.reshape(-1, 6)
    holding = np.linalg.lstsq(
        flat @ mobility @ flat.T, (surface - rows @ motion).ravel(), rcond=None
    )[0]
    if (np.linalg.norm(holding.reshape(-1, 2), axis=1) <= bound).all():
        return motion + mobility @ (flat.T @ holding)
    given = np.zeros((len(arms), 2))
    softest = [np.linalg.eigvalsh(row @ mobility @ row.T)[-1] for row in rows]
    for _ in range(FRICTION_SWEEPS):
        for index, row in enumerate(rows):
            total = given[index] + (surface[index] - row @ motion) / softest[index]
            size = np.linalg.norm(total)
            total *= min(1.0, bound[index] / size) if size > 0.0 else 0.0
            motion = motion + mobility @ (row.T @ (total - given[index]))
            given[index] = total
    return motion


def _viscous(
    motion: np.ndarray,
    mobility: np.ndarray,
    arms: np.ndarray,
    contacts: Contacts,
    impulse: np.ndarray,
    friction: float,
) -> np.ndarray:
    """Return the motion without its share of the sliding velocity at the centre of pressure."""
    share = impulse / max(impulse.sum(), 1e-300)
    normal = share @ contacts.normal
    row = rigid_motion.jacobian(share @ arms)
    velocity = row @ motion - share @ contacts.surface_velocity
    velocity -= (velocity @ normal) * normal
    speed = np.linalg.norm(velocity)
    if speed == 0.0:
        return motion
    along = velocity / speed @ row
    return motion - friction * speed / (along @ mobility @ along) * (mobility @ along)


def _least_impulses(rows: np.ndarray, mobility: np.ndarray, needed: np.ndarray) -> np.ndarray:
    """
    Return the smallest impulses λ ≥ 0 (k,) after which rows · motion has changed by `needed`.

    Smallest in kinetic energy: least distance programming, solved as non-negative least squares
    (Lawson and Hanson, Solving Least Squares Problems, chapter 23). Constraints enter one at a
    time, the most violated first.
    """
    impulse = np.zeros(len(rows))
    largest = needed.max()
    if largest <= 0.0:
        return impulse
    needed = needed / largest
    values, vectors = np.linalg.eigh(mobility)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    scaled = rows @ root
    active: list[int] = []
    for _ in range(MOST_SUPPORTS):
        missing = needed - scaled @ (scaled.T @ impulse)
        worst = int(missing.argmax())
        if missing[worst] < 1e-9 or worst in active:
            break
        active.append(worst)
        system = np.vstack([scaled[active].T, needed[active]])
        try:
            solution = nnls(system, np.eye(7)[6])[0]
        except RuntimeError:  # it does not converge where supports nearly repeat each other
            break
        slack = 1.0 - needed[active] @ solution
        if slack < 1e-12:  # no motion satisfies all: the body is wedged
            break
        impulse[:] = 0.0
        impulse[active] = solution / slack
    return impulse * largest


def _push_out(x: np.ndarray, contacts: Contacts) -> None:
    """Move rigid bodies by their deepest particle's depth, in place."""
    deepest_first = np.argsort(-contacts.depth, kind='stable')
    bodies, index = np.unique(contacts.body[deepest_first], return_index=True)
    deepest = deepest_first[index]
    x[bodies] += (contacts.depth[deepest, None] * contacts.normal[deepest])[..., None]
