# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of deformable bodies with obstacles.

Each particle in contact is projected out of the obstacle, with friction. That alone would let a
body sink in until enough light particles are in contact; so the obstacle also supports the weight
of the whole body, but no more than the weight: at rest the body keeps its shape, and an impact,
with forces of many times the weight, still deforms it. Restitution is also that of the whole body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.body import RIGID
from softbody_ros.core.collision.obstacle_contacts import bounds_of, find_contacts, may_touch
from softbody_ros.core.collision.obstacles import distance_from
from softbody_ros.core.collision.shapes import PLANE
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.support import SETTLED, TINY, settling_speed, support
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    along,
    applied,
    column_of,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_column,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.shape_matching.goals import goal_of
from softbody_ros.core.shape_matching.rigid_motion import (
    add_rigid_displacement,
    inverse_inertia_of,
    measure_about,
)

WALLS = 3
"""Walls of one obstacle that a fast particle can hit in a tick: three in a corner."""
SQUARE = 1e-6
"""Cosine, up to rounding, of the normals of faces at right angles."""
ROUNDING = 1e-6
"""Depth, in RMS radii, of particles on the surface."""


class Patch(NamedTuple):
    """
    Contact of a body with an obstacle, as that of a rigid body of its present shape.

    Attributes
    ----------
    mass : float
        share of the body's mass in contact
    speed : float
        mean of the patch, along the normals away from the obstacle, m/s
    load : float
        mean acceleration that presses it onto the obstacle, m/s²
    pressure : float
        Σ w d over the particles in contact, d the depths of their goals, m
    force, torque : vector
        Σ w d n, and Σ w d r × n: the wrench of the pressure

    """

    mass: float
    speed: float
    load: float
    pressure: float
    force: Vector
    torque: Vector


@kernel
def resolve(
    bodies: np.ndarray,
    awake: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    region_goals: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    gravity: np.ndarray,
    h: float,
    contacts: np.ndarray,
    scratch: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """
    Resolve contacts of deformable bodies with obstacles, one after the other.

    Parameters
    ----------
    bodies, awake, shapes, weights, q, x, v, places, gravity, h
        see `flight.predict_and_match`; the half of `x` and `v` being computed is changed
    obstacles : (O,) OBSTACLE
    trees : Trees
        of the meshes of obstacles
    contacts : (C,) CONTACT
        scratch for the particles of any one body
    scratch : (7, C) float
        the same
    obstacle_impulse, normal_impulse
        results, see `exchange`

    """
    planes = True
    for index in range(len(obstacles)):
        planes = planes and obstacles[index]['kind'] == PLANE
    for index in range(len(awake)):
        body = bodies[awake[index]]
        if body['mode'] == RIGID:
            continue
        shape, matched = shapes[body['shape']], shapes[body['matched']]
        now, first, count = body['now'], body['first'], body['count']
        start, x1, v1 = x[now], x[1 - now], v[1 - now]
        low, high = ZERO, ZERO
        low_before, high_before = ZERO, ZERO
        if not planes:
            low_before, high_before = bounds_of(start, first, count)
            low, high = bounds_of(x1, first, count)
        changed, offset = False, ZERO
        for number in range(len(obstacles)):
            obstacle = obstacles[number]
            for wall in range(WALLS):
                if not planes and not may_touch(
                    obstacle, low, high, low_before, high_before, body['thickness']
                ):
                    break
                found = find_contacts(
                    obstacle, trees, x1, start, first, count, body['thickness'], True, contacts, 0
                )
                if wall > 0:
                    # exclude particles that have just been projected onto the surface
                    found = deeper_than(contacts, found, ROUNDING * shape['scale'])
                if found == 0:
                    break
                if changed:
                    update_motion(body, shape, weights, x1, v1)
                swept, offset = respond(
                    body, shape, matched, weights, q, region_goals, start, x1, v1, offset,
                    obstacle, trees, vector_of(gravity), h, contacts[:found], scratch,
                    obstacle_impulse[awake[index], 1 - now, number], normal_impulse[1 - now],
                )  # fmt: skip
                changed = True
                if not planes:
                    low, high = bounds_of(x1, first, count)
                if not swept:
                    break


STANDING = np.dtype(
    [
        ('body', np.int64),  # in the world
        ('obstacle', np.int64),
        ('particle', np.int64),  # within the body
        ('point', np.float64, (3,)),  # m
        ('normal', np.float64, (3,)),
        ('surface_velocity', np.float64, (3,)),  # m/s
        ('origin', np.float64, (3,)),  # of the obstacle, m
        ('goal_depth', np.float64),  # of the particle's goal in the obstacle, m, or 0
    ],
    align=True,
)
"""A contact of a body with a supporting obstacle."""


@kernel
def find_standing(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    region_goals: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    contacts: np.ndarray,
    standing: np.ndarray,
) -> int:
    """
    Write the present contacts of bodies with obstacles, sorted by obstacle.

    Parameters
    ----------
    chosen : (c,) int
        bodies
    contacts : (C,) CONTACT
        scratch for the particles of any one body
    standing : (s,) STANDING
        written, up to its capacity
    bodies, shapes, q, x, places, obstacles, trees
        see `resolve`

    Returns
    -------
    int
        number of contacts, even beyond the capacity

    """
    total = 0
    for number in range(len(obstacles)):
        obstacle = obstacles[number]
        for index in range(len(chosen)):
            body = bodies[chosen[index]]
            x1, first, count = x[1 - body['now']], body['first'], body['count']
            found = find_contacts(
                obstacle, trees, x1, x1, first, count, body['thickness'], False, contacts, 0
            )
            for k in range(found):
                if total < len(standing):
                    put_standing(
                        standing[total], contacts[k], chosen[index], number, body,
                        shapes[body['matched']], q, region_goals, obstacle, trees,
                    )  # fmt: skip
                total += 1
    return total


@helper
def put_standing(
    standing: np.void,
    contact: np.void,
    index: int,
    number: int,
    body: np.void,
    matched: np.void,
    q: np.ndarray,
    region_goals: np.ndarray,
    obstacle: np.void,
    trees: Trees,
) -> None:
    """Write one contact of a body with a supporting obstacle."""
    standing['body'], standing['obstacle'] = index, number
    standing['particle'] = contact['particle']
    put_vector(standing['point'], vector_of(contact['point']))
    put_vector(standing['normal'], vector_of(contact['normal']))
    put_vector(standing['surface_velocity'], vector_of(contact['surface_velocity']))
    put_vector(standing['origin'], vector_of(obstacle['position']))
    goal = goal_of(body, matched, q, region_goals, body['first'] + contact['particle'])
    standing['goal_depth'] = goal_depth(contact, obstacle, trees, goal, body['thickness'])


@helper
def deeper_than(contacts: np.ndarray, found: int, least: float) -> int:
    """Keep the contacts deeper than `least`, and return their number."""
    kept = 0
    for k in range(found):
        if contacts[k]['depth'] > least:
            contacts[kept] = contacts[k]
            kept += 1
    return kept


@helper
def update_motion(
    body: np.void, shape: np.void, weights: np.ndarray, x: np.ndarray, v: np.ndarray
) -> None:
    """Recompute the rigid motion of a body, about the centre of mass of its record."""
    own = weights[shape['first'] : shape['first'] + shape['count']]
    centre = vector_of(body['centre'])
    velocity, angular_momentum, gram = measure_about(x, v, body['first'], own, centre)
    put_vector(body['velocity'], velocity)
    put_vector(body['angular_momentum'], angular_momentum)
    inverse = inverse_inertia_of(gram, shape['scale'])
    for axis in range(3):
        put_vector(body['inverse_inertia'][axis], inverse[axis])


@helper
def respond(
    body: np.void,
    shape: np.void,
    matched: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    region_goals: np.ndarray,
    start: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    offset: Vector,
    obstacle: np.void,
    trees: Trees,
    gravity: Vector,
    h: float,
    contacts: np.ndarray,
    scratch: np.ndarray,
    given_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> tuple[bool, Vector]:
    """
    Resolve the contact of a body with an obstacle: support, particles, then restitution.

    What the body gives to the obstacle is added to `given_impulse` (2, 3), see `exchange`. With
    `offset` its centre of mass is away from that of its record, m, by position correction: so
    rotations about the latter change its momentum.

    Returns
    -------
    swept : bool
        whether some contacts were swept, so that their particles may have hit another wall
    offset : vector

    """
    first, last = body['first'], body['first'] + body['count']
    weight, pressure, normal_change = scratch[0], scratch[1], scratch[2]
    centre, inverse = vector_of(body['centre']), matrix_of(body['inverse_inertia'])
    patch = measure_patch(
        body, shape, matched, weights, q, region_goals, obstacle, trees,
        plus(gravity, vector_of(body['load'])), contacts, weight, pressure,
    )  # fmt: skip
    carried = carried_weight(patch, shape['scale'], h)
    per_pressure = carried / max(patch.pressure, TINY)
    impulse, moment = ZERO, ZERO
    if carried > 0.0:
        linear = scaled(per_pressure, patch.force)
        angular = applied(inverse, scaled(per_pressure, patch.torque))
        add_rigid_displacement(x, v, first, last, centre, linear, angular, 0.5 * h)
        impulse = cross(angular, offset)
        offset = along(offset, 0.5 * h, plus(linear, impulse))
    swept, mean_change = False, 0.0
    for k in range(len(contacts)):
        contact = contacts[k]
        swept = swept or contact['swept']
        arm = minus(vector_of(contact['point']), centre)
        contact_support = per_pressure * pressure[k]
        column = first + contact['particle']
        point = column_of(x, column)
        normal_change[k], change = collide(
            body, contact, start, x, v, column, contact_support / weight[k], h
        )
        offset = along(offset, weight[k], minus(column_of(x, column), point))
        mean_change += weight[k] * normal_change[k]
        normal_impulse[column] += body['mass'] * (contact_support + weight[k] * normal_change[k])
        change = along(scaled(weight[k], change), contact_support, vector_of(contact['normal']))
        impulse, moment = plus(impulse, change), plus(moment, cross(arm, change))
    absorbed = absorbed_share(body, shape, patch.speed + 0.5 * mean_change, gravity)
    if absorbed > 0.0:
        force, torque = ZERO, ZERO
        for k in range(len(contacts)):
            taken = absorbed * weight[k] * normal_change[k]
            normal_impulse[first + contacts[k]['particle']] -= body['mass'] * taken
            given = scaled(-taken, vector_of(contacts[k]['normal']))
            arm = minus(vector_of(contacts[k]['point']), centre)
            force, torque = plus(force, given), plus(torque, cross(arm, given))
        angular = applied(inverse, torque)
        add_rigid_displacement(x, v, first, last, centre, force, angular, 0.0)
        impulse, moment = plus(impulse, plus(force, cross(angular, offset))), plus(moment, torque)
    received = body['received']
    put_vector(received[0], plus(vector_of(received[0]), impulse))
    put_vector(received[1], plus(vector_of(received[1]), moment))
    origin = vector_of(obstacle['position'])
    add_wrench_about(given_impulse, origin, -body['mass'], centre, impulse, moment)
    body['touches'][1 - body['now']] = 1
    return swept, offset


@helper
def measure_patch(
    body: np.void,
    shape: np.void,
    matched: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    region_goals: np.ndarray,
    obstacle: np.void,
    trees: Trees,
    acceleration: Vector,
    contacts: np.ndarray,
    weight: np.ndarray,
    pressure: np.ndarray,
) -> Patch:
    """
    Return the contact patch of a body on an obstacle.

    Parameters
    ----------
    body, shape, matched, weights, q, places, obstacle, trees
        see `resolve`
    acceleration : vector
        gravity, and the load of bodies on top, m/s²
    contacts : (k,) CONTACT
    weight, pressure : (k,) float
        written: w, and w d with the depth d of the goal of each particle in contact, m

    """
    centre, velocity = vector_of(body['centre']), vector_of(body['velocity'])
    angular = applied(matrix_of(body['inverse_inertia']), vector_of(body['angular_momentum']))
    mass = speed = load = total = 0.0
    force, torque = ZERO, ZERO
    for k in range(len(contacts)):
        contact = contacts[k]
        i, normal = body['first'] + contact['particle'], vector_of(contact['normal'])
        # a particle without area has no weight: it must not divide by zero
        w = max(weights[shape['first'] + contact['particle']], TINY)
        arm = minus(vector_of(contact['point']), centre)
        goal = goal_of(body, matched, q, region_goals, i)
        depth = goal_depth(contact, obstacle, trees, goal, body['thickness'])
        weight[k], pressure[k] = w, w * depth
        moving = minus(plus(velocity, cross(angular, arm)), vector_of(contact['surface_velocity']))
        mass += w
        speed += w * dot(normal, moving)
        load += w * max(-dot(normal, acceleration), 0.0)
        total += w * depth
        force = along(force, w * depth, normal)
        torque = along(torque, w * depth, cross(arm, normal))
    mass = max(mass, TINY)
    return Patch(mass, speed / mass, load / mass, total, force, torque)


@helper
def goal_depth(
    contact: np.void, obstacle: np.void, trees: Trees, goal: Vector, thickness: float
) -> float:
    """Return the depth of the goal of a particle in contact in the obstacle, m, or 0."""
    distance, normal = distance_from(obstacle, trees, goal)
    depth = thickness - distance
    if obstacle['kind'] != PLANE:
        outwards = vector_of(contact['normal'])
        if contact['swept'] or dot(normal, outwards) < -SQUARE:
            # beyond a thin wall the depth is that in a half space
            depth = contact['depth'] - dot(minus(goal, vector_of(contact['point'])), outwards)
    return max(depth, 0.0)


@helper
def carried_weight(patch: Patch, scale: float, h: float) -> float:
    """
    Return the impulse by which an obstacle supports the weight of a body.

    A critically damped spring between goal shape and obstacle, soft enough for the step, acts on
    the whole body with at most its weight: so its effect on impacts is small, it cannot launch a
    body, and it vanishes without gravity.

    Returns
    -------
    float
        per mass, m/s; distributed on the particles in contact in proportion to their pressure

    """
    spring, damping = support(patch.load, patch.pressure / patch.mass, scale, h)
    # implicit: the damper acts on the speed after the impulse, which at rest is zero
    force = (spring - damping * patch.speed) / (1.0 + damping * h)
    return h * min(max(force, 0.0), patch.load) if patch.pressure > 0.0 else 0.0


@helper
def absorbed_share(body: np.void, shape: np.void, speed: float, gravity: Vector) -> float:
    """
    Return the share of contact impulses that inelasticity absorbs on rebound.

    A deformable body rebounds by recovering its shape. So while the patch moves away from the
    obstacle, the share (1 − ε) / 2 of the impulses is absorbed, as an impulse on the whole body
    (Poisson's hypothesis of restitution). It never adds energy.

    Parameters
    ----------
    body : BODY
    shape : SHAPE
    speed : float
        of the patch, mean of before and after the impulse, so that its reversal is independent of
        the step, m/s
    gravity : vector
        m/s²

    """
    # vanishes at settling speeds, where the weight must be supported in full
    separation = speed / settling_speed(norm(gravity), shape['scale']) - SETTLED
    return 0.5 * (1.0 - body['elasticity']) * min(max(separation, 0.0), 1.0)


@helper
def collide(
    body: np.void,
    contact: np.void,
    start: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    i: int,
    carried: float,
    h: float,
) -> tuple[float, Vector]:
    """
    Project a particle out of an obstacle and stop its approach, in place.

    There is no restitution of single particles: they would bounce repeatedly against the pull of
    the goal, which points into the obstacle, and its reflection would add energy. Restitution is
    that of the body, see `absorbed_share`. Friction removes the same share of the sliding distance
    as of the sliding speed, so that sticking contacts do not creep.

    Parameters
    ----------
    body : BODY
    contact : CONTACT
    start, x, v : (3, N) float
        positions at the tick before, positions, m, and velocities, m/s
    i : int
        the particle, in the world
    carried : float
        impulse of the support, as speed, m/s: part of the normal force for friction
    h : float
        s

    Returns
    -------
    normal_change : float
        change of speed along the normal, m/s
    change : vector
        total change of velocity, m/s

    """
    normal, surface = vector_of(contact['normal']), vector_of(contact['surface_velocity'])
    point, velocity = column_of(x, i), column_of(v, i)
    # the support has displaced the particle, too
    depth = contact['depth'] - dot(minus(point, vector_of(contact['point'])), normal)
    relative = minus(velocity, surface)
    normal_speed = dot(relative, normal)
    normal_change = max(-normal_speed, 0.0)
    tangential = along(relative, -normal_speed, normal)
    sliding_distance = along(minus(point, column_of(start, i)), -h, surface)
    sliding_distance = along(sliding_distance, -dot(sliding_distance, normal), normal)
    friction_share = body['friction']
    if body['coulomb']:
        speed = norm(tangential)
        friction_share = min(
            friction_share * (normal_change + carried) / (speed if speed > 0.0 else 1.0), 1.0
        )
    change = along(scaled(normal_change, normal), -friction_share, tangential)
    put_column(
        x,
        i,
        plus(point, along(scaled(max(depth, 0.0), normal), -friction_share, sliding_distance)),
    )
    put_column(v, i, plus(velocity, change))
    return normal_change, change
