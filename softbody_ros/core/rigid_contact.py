# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact of rigid bodies with obstacles: the least impulses that keep them out, and friction."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from softbody_ros.core import rigid_motion
from softbody_ros.core.contact import Contacts
from softbody_ros.core.gains import Gains
from softbody_ros.core.rest_shape import RestShape

FRICTION_ROUNDS, FRICTION_SWEEPS = 4, 8
MOST_SUPPORTS = 24
"""Touching particles that the impulse on a rigid body takes into account, worst first."""


def collide(
    x: np.ndarray,
    v: np.ndarray,
    contacts: Contacts,
    rest: RestShape,
    gravity: np.ndarray,
    gains: Gains,
    slow: float,
    h: float,
) -> None:
    """
    Give rigid bodies the impulses that keep their touching particles out, in place.

    Parameters
    ----------
    x, v : (B, 3, n) float
        m, m/s, of rigid motions
    contacts : Contacts
    rest : RestShape
    gravity : (3,) float
        m/s²
    gains : Gains
    slow : float
        speed up to which nothing bounces, m/s
    h : float
        s

    """
    for body in np.unique(contacts.body):
        own = contacts.where(contacts.body == body)
        positions, velocities = x[body : body + 1], v[body : body + 1]
        centre = (positions @ rest.weights).astype(np.float64)
        spin, tensor = rigid_motion.angular_momentum_and_inertia(
            positions, velocities, centre, rest
        )
        mobility = np.eye(6)
        mobility[3:, 3:] = rigid_motion.inverse_inertia(tensor, rest)[0]
        omega = mobility[3:, 3:] @ spin[0]
        linear = velocities[0] @ rest.weights
        arms = x[body, :, own.particle] - centre[0]

        before = np.concatenate([linear, omega])
        motion, bounced = _impulses(before, mobility, arms, own, gravity, gains, slow)

        # a load acts all through the tick, a bounce happens at the surface: see push_out
        change = np.zeros(6) if bounced else 0.5 * h * (motion - before)
        offsets = Rotation.from_rotvec(change[3:]).apply((x[body] - centre[0][:, None]).T).T
        x[body] = offsets + (centre[0] + change[:3])[:, None]
        v[body] = motion[:3, None] + np.cross(motion[3:], offsets, axisb=0, axisc=0)


def _impulses(
    motion: np.ndarray,
    mobility: np.ndarray,
    arms: np.ndarray,
    contacts: Contacts,
    gravity: np.ndarray,
    gains: Gains,
    slow: float,
) -> tuple[np.ndarray, bool]:
    """Return the motion (linear, angular) of a body after its impulses, and whether it bounced."""
    body = contacts.body[0]
    normals = np.hstack([contacts.normal, np.cross(arms, contacts.normal)])
    speed = normals @ motion - np.einsum('ij,ij->i', contacts.normal, contacts.surface_velocity)
    # what gravity has added since the deepest particle touched must not bounce
    fallen = np.max(-2.0 * (contacts.normal @ gravity) * contacts.depth)
    impact = np.sqrt(np.maximum(speed**2 - fallen, 0.0))
    wanted = np.where(speed < -slow, gains.elasticity[body] * impact, 0.0)
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
    rows = np.stack(
        [
            plane @ np.hstack([np.eye(3), np.cross(arm, np.eye(3))])
            for plane, arm in zip(planes, arms, strict=True)
        ]
    )
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
    row = np.hstack([np.eye(3), np.cross(share @ arms, np.eye(3))])
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
        solution = nnls(system, np.eye(7)[6])[0]
        slack = 1.0 - needed[active] @ solution
        if slack < 1e-12:  # no motion satisfies all: the body is wedged
            break
        impulse[:] = 0.0
        impulse[active] = solution / slack
    return impulse * largest


def push_out(x: np.ndarray, contacts: Contacts) -> None:
    """Move rigid bodies by their deepest particle's depth, in place."""
    deepest_first = np.argsort(-contacts.depth, kind='stable')
    bodies, index = np.unique(contacts.body[deepest_first], return_index=True)
    deepest = deepest_first[index]
    x[bodies] += (contacts.depth[deepest, None] * contacts.normal[deepest])[..., None]
