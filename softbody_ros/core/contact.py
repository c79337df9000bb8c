# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of particles with obstacles, and of deformable bodies by way of their particles.

A deformable body meets an obstacle particle by particle, with restitution and friction. That
alone would let it sink in until enough light particles touch; so the obstacle also *carries its
weight* as a whole, but no more than its weight: at rest the body keeps its shape, and an impact,
whose forces are many times the weight, squashes it all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass

import numpy as np

from softbody_ros.core import rigid_motion
from softbody_ros.core.gains import Gains
from softbody_ros.core.obstacles import SIGNED_DISTANCE, Obstacle
from softbody_ros.core.rest_shape import RestShape

SINKAGE = 0.01
"""Depth, in RMS radii, at which 63 % of a resting body's weight is carried as a whole."""
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

    """

    body: np.ndarray
    particle: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    surface_velocity: np.ndarray

    def __len__(self) -> int:
        return len(self.body)

    def where(self, selected: np.ndarray) -> Contacts:
        """Return some of the contacts."""
        return Contacts(
            self.body[selected],
            self.particle[selected],
            self.normal[selected],
            self.depth[selected],
            self.surface_velocity[selected],
        )

    def after(self, shift: np.ndarray) -> Contacts:
        """Return the contacts after particles have been shifted by a (B, 3, n) field, m."""
        outwards = np.einsum('ij,ij->i', shift[self.body, :, self.particle], self.normal)
        return dataclasses.replace(self, depth=np.maximum(self.depth - outwards, 0.0))

    def along_normal(self, field: np.ndarray) -> np.ndarray:
        """Return (k,): the normal components of a (B, 3, n) field, relative to the obstacle."""
        relative = field[self.body, :, self.particle] - self.surface_velocity
        return np.einsum('ij,ij->i', relative, self.normal)


# -------------------------------------------------------------------------------------- detection
def find(x: np.ndarray, obstacle: Obstacle, thickness: np.ndarray) -> Contacts:
    """
    Return the particles that are nearer to an obstacle than their body's thickness.

    Parameters
    ----------
    x : (B, 3, n) float
        m
    obstacle : Obstacle
    thickness : (B,) float
        m

    """
    body, particle = _candidates(x, obstacle, thickness)
    distance, normal = _distance(x[body, :, particle], obstacle)
    depth = thickness[body] - distance
    touching = depth > 0.0
    body, particle = body[touching], particle[touching]
    offsets = x[body, :, particle] - obstacle.position
    config = obstacle.config
    surface_velocity = np.array(config.velocity_linear) + np.cross(
        config.velocity_angular, offsets
    )
    return Contacts(body, particle, normal[touching], depth[touching], surface_velocity)


def joined(parts: Sequence[Contacts]) -> Contacts:
    """Return the contacts with several obstacles as one."""
    columns = zip(*(dataclasses.astuple(part) for part in parts), strict=True)
    return Contacts(*(np.concatenate(column) for column in columns))


def depth_of_goals(
    contacts: Contacts,
    obstacle: Obstacle,
    centre: np.ndarray,
    goal: np.ndarray,
    rest: RestShape,
    gains: Gains,
) -> np.ndarray:
    """
    Return (k,): how deep the goals of touching particles lie in the obstacle, m.

    Parameters
    ----------
    contacts : Contacts
    obstacle : Obstacle
    centre : (B, 3) float
        m
    goal : (B, 3, F) float
        goal transforms
    rest : RestShape
    gains : Gains

    """
    body, count = contacts.body, goal.shape[-1]
    features = rest.features[1 : 1 + count, contacts.particle]
    points = centre[body] + rest.scale * np.einsum('kif,fk->ki', goal[body], features)
    distance, _ = _distance(points, obstacle)
    return np.maximum(gains.thickness[body] - distance, 0.0)


def _distance(points: np.ndarray, obstacle: Obstacle) -> tuple[np.ndarray, np.ndarray]:
    """Return signed distances (k,) and outward normals (k, 3) of points (k, 3), all in m."""
    local = (points - obstacle.position) @ obstacle.rotation
    signed_distance = SIGNED_DISTANCE[obstacle.config.type]
    distance, normal = signed_distance(local, np.array(obstacle.config.size))
    return distance, normal @ obstacle.rotation.T


def _candidates(
    x: np.ndarray, obstacle: Obstacle, thickness: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return body and particle indices of those that may touch: a cheap test for all."""
    if obstacle.config.type == 'plane':
        normal = obstacle.rotation[:, 2]
        height = np.matmul(normal.astype(x.dtype), x)
        limit = obstacle.position @ normal + thickness
        body, particle = np.nonzero(height < limit.astype(x.dtype)[:, None])
        return body, particle
    reach = np.linalg.norm(obstacle.config.size)
    offsets = x - obstacle.position.astype(x.dtype)[:, None]
    square = np.einsum('bij,bij->bj', offsets, offsets)
    body, particle = np.nonzero(square < ((reach + thickness) ** 2)[:, None])
    return body, particle


# -------------------------------------------------------------------------------------- deformable
@dataclass(frozen=True)
class Patch:
    """
    Where bodies touch an obstacle, seen as rigid bodies of their present shape.

    Attributes
    ----------
    contacts : Contacts
    weight : (k,) float
        share of the body's mass that each touching particle has
    share : (k,) float
        share of the touching mass
    arms : (k, 3) float
        from the centre of mass, m
    speed : (B,) float
        of the patch, along the normal away from the obstacle, m/s
    centre : (B, 3) float
        m
    inverse_inertia : (B, 3, 3) float
        per mass, 1/m²

    """

    contacts: Contacts
    weight: np.ndarray
    share: np.ndarray
    arms: np.ndarray
    speed: np.ndarray
    centre: np.ndarray
    inverse_inertia: np.ndarray

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (B,) of values (k,) over the patches."""
        return _per_body(self.share * values, self.contacts.body, len(self.centre))

    def motion_by(self, impulse: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the rigid motions (B, 3, n) that impulses (k,) along the normals cause, m/s."""
        impulses = impulse[:, None] * self.contacts.normal
        linear = _per_body(impulses, self.contacts.body, len(x))
        spin = _per_body(np.cross(self.arms, impulses), self.contacts.body, len(x))
        angular = rigid_motion.applied(self.inverse_inertia, spin)
        return rigid_motion.field(x, self.centre, linear, angular)


def patch_of(
    x: np.ndarray,
    contacts: Contacts,
    centre: np.ndarray,
    drift: np.ndarray,
    spin: np.ndarray,
    inverse_inertia: np.ndarray,
    rest: RestShape,
) -> Patch:
    """
    Return where bodies touch an obstacle.

    Parameters
    ----------
    x : (B, 3, n) float
        m
    contacts : Contacts
    centre, drift, spin : (B, 3) float
        centre of mass, m, momentum, m/s, and angular momentum, m²/s, per mass
    inverse_inertia : (B, 3, 3) float
        1/m²
    rest : RestShape

    """
    body, particle = contacts.body, contacts.particle
    # a particle without area has no weight: it must not divide by zero
    weight = np.maximum(rest.weights[particle].astype(np.float64), 1e-300)
    share = weight / _per_body(weight, body, len(x))[body]
    angular = rigid_motion.applied(inverse_inertia, spin)
    arms = x[body, :, particle] - centre[body]
    motion = drift[body] + np.cross(angular[body], arms) - contacts.surface_velocity
    normal_speed = np.einsum('ij,ij->i', motion, contacts.normal)
    speed = _per_body(share * normal_speed, body, len(x))
    return Patch(contacts, weight, share, arms, speed, centre, inverse_inertia)


def carried_weight(
    patch: Patch, sunk: np.ndarray, gravity: np.ndarray, rest: RestShape, h: float
) -> np.ndarray:
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
    gravity : (3,) float
        m/s²
    rest : RestShape
    h : float
        s

    Returns
    -------
    (k,) float
        per mass, along the normals, m/s

    """
    depth = patch.mean(sunk)
    load = patch.mean(np.maximum(-patch.contacts.normal @ gravity, 0.0))
    softness = np.maximum(SINKAGE * rest.scale, 4.0 * load * h**2)
    spring = load * -np.expm1(-depth / softness)
    damper = 2.0 * np.sqrt(load / softness) * patch.speed
    push = h * np.clip(spring - damper, 0.0, load)
    pressure = sunk / np.where(depth > 0.0, depth, 1.0)[patch.contacts.body]
    return push[patch.contacts.body] * patch.share * pressure


def absorbed_rebound(
    patch: Patch, push: np.ndarray, gains: Gains, gravity: float, rest: RestShape
) -> np.ndarray:
    """
    Return the impulses that a body of little elasticity does not get back when it rebounds.

    Restitution of particles alone has next to no effect on the body, even the wrong one: it is the
    shape that throws it back. So while the patch moves away from the obstacle, the share
    (1 − ε) / 2 of what the obstacle gives is taken from the body as a whole (Poisson's view of
    restitution). It only ever takes energy.

    Parameters
    ----------
    patch : Patch
    push : (k,) float
        speeds that touching particles have got from the obstacle, m/s
    gains : Gains
    gravity : float
        m/s²
    rest : RestShape

    Returns
    -------
    (k,) float
        per mass, along the normals, not positive, m/s

    """
    # fades out at the speeds of a body that settles, whose weight must be carried in full
    settling = np.sqrt(max(gravity, 1e-300) * SINKAGE * rest.scale)
    leaving = np.clip(patch.speed / settling - SETTLED, 0.0, 1.0)
    lost = 0.5 * (1.0 - gains.elasticity) * leaving
    return -lost[patch.contacts.body] * patch.weight * push


def collide(
    x: np.ndarray,
    v: np.ndarray,
    approach: np.ndarray,
    start: np.ndarray,
    contacts: Contacts,
    carried: np.ndarray,
    gains: Gains,
    slow: float,
    h: float,
) -> np.ndarray:
    """
    Project particles out of an obstacle and change their velocities, in place.

    The normal impulse is computed from the velocity before matching: after it, the velocity holds
    the pull towards a goal that may lie inside the obstacle, and resting contacts would chatter.

    Parameters
    ----------
    x, v : (B, 3, n) float
        m, m/s
    approach : (B, 3, n) float
        velocities before matching, m/s
    start : (B, 3, n) float
        positions at the last tick, m: what does not slide returns there
    contacts : Contacts
    carried : (k,) float
        load that is carried besides, as speed, m/s
    gains : Gains
    slow : float
        speed up to which nothing bounces, m/s
    h : float
        s

    Returns
    -------
    (k,) float
        speeds that the particles have got along the normals, m/s

    """
    body, particle, normal = contacts.body, contacts.particle, contacts.normal
    points = x[body, :, particle]
    relative = v[body, :, particle] - contacts.surface_velocity
    normal_speed = np.einsum('ij,ij->i', relative, normal)
    approach_speed = contacts.along_normal(approach)
    bounce = np.where(approach_speed < -slow, -gains.elasticity[body] * approach_speed, 0.0)
    push = np.maximum(bounce - normal_speed, 0.0)

    tangential = relative - normal_speed[:, None] * normal
    sliding_speed = np.linalg.norm(tangential, axis=1)
    friction = gains.friction[body]
    bound = friction * (push + carried)
    coulomb_kept = 1.0 - np.minimum(bound / np.where(sliding_speed > 0.0, sliding_speed, 1.0), 1.0)
    kept = np.where(gains.coulomb[body], coulomb_kept, 1.0 - friction)

    slid = points - start[body, :, particle] - h * contacts.surface_velocity
    slid -= np.einsum('ij,ij->i', slid, normal)[:, None] * normal
    depth = contacts.depth[:, None]
    x[body, :, particle] = points + depth * normal - (1.0 - kept)[:, None] * slid
    v[body, :, particle] = (
        contacts.surface_velocity
        + (normal_speed + push)[:, None] * normal
        + kept[:, None] * tangential
    )
    return push


def _per_body(values: np.ndarray, body: np.ndarray, bodies: int) -> np.ndarray:
    """Return the sums over each body's contacts, (B,) or (B, 3), in a fixed order."""
    if values.ndim == 1:
        return np.bincount(body, values, bodies)
    columns = [np.bincount(body, column, bodies) for column in values.T]
    return np.stack(columns, axis=-1)
