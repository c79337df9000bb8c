# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Solver of vertex-face contacts: normal impulses, friction, position correction.

Jacobi iterations over all contacts: each impulse acts on a particle, and in reverse on the corners
of a face. The mass of particles and rigid bodies is split among their contacts, so that
simultaneous impulses do not overshoot (Tonge, Benevolenski, Voroshilov 2012, Mass splitting for
jitter-free parallel rigid body simulation). Impulses on rigid bodies change their twists.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.contact_state import (
    add_wrench,
    apply_mobility,
    difference,
    velocity_at,
)
from softbody_ros.core.contact.manifold import geometric_mean
from softbody_ros.core.contact.support import SLOW_TICKS, TINY
from softbody_ros.core.geometry.vectors import (
    Vector,
    along,
    dot,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
    vector_of,
)

SOFT_ROUNDS, RIGID_ROUNDS, FRICTION_ROUNDS, CORRECTION_ROUNDS = 4, 16, 4, 4
LARGEST_CORRECTION = 0.2
"""Largest position correction in a tick, in RMS radii."""
STICKING = 0.5
"""Share of sliding displacement that full friction undoes per tick; 1 makes piles sway."""


@kernel
def solve_contacts(
    contacts: np.ndarray,
    members: np.ndarray,
    inverse_mass: np.ndarray,
    start: np.ndarray,
    shift: np.ndarray,
    gravity: np.ndarray,
    h: float,
    x: np.ndarray,
    v: np.ndarray,
) -> None:
    """
    Apply impulses, friction and position correction to particles and faces, in place.

    Parameters
    ----------
    contacts : (k,) CONTACT
        `impulse` and `friction` are written; the normal force for friction includes `load_impulse`
    members : (C,) MEMBER
    inverse_mass : (N,) float
        1/kg; that of particles of rigid bodies is set to 0
    start : (N, 3) float
        positions at the tick before, m
    shift : (N, 3) float
        displacement of the particles since contact detection, m
    gravity : (3,) float
        m/s²
    h : float
        s
    x, v : (N, 3) float
        m, m/s

    """
    count = len(contacts)
    diagonal, diagonal_bound = np.empty(count), np.empty(count)
    rigid = find_delassus_diagonal(contacts, members, inverse_mass, diagonal, diagonal_bound)
    impulse, change = np.zeros((count, 3)), np.zeros((count, 3))
    field, wrenches = np.zeros((len(inverse_mass), 3)), np.zeros((len(members), 6))
    before, target_sliding = np.empty((count, 3)), np.empty((count, 3))
    normal_impulse, friction_share = np.zeros(count), np.empty(count)
    for k in range(count):
        put_vector(before[k], difference(contacts[k], v))
    slow = SLOW_TICKS * h * norm(vector_of(gravity))
    stop_approach(
        contacts, members, inverse_mass, rigid, slow, diagonal, before, normal_impulse, impulse,
        change, field, wrenches,
    )  # fmt: skip

    any_friction = False
    for k in range(count):
        contact = contacts[k]
        normal, load_impulse = vector_of(contact['normal']), contact['load_impulse']
        put_vector(before[k], plus(vector_of(before[k]), vector_of(change[k])))
        sliding = tangential(normal, vector_of(before[k]))
        contact['impulse'] = normal_impulse[k]
        normal_speed = (normal_impulse[k] + load_impulse) * diagonal[k]
        friction_share[k] = friction_share_of(members, contact, norm(sliding), normal_speed)
        if friction_share[k] != 0.0:
            any_friction = True
        put_vector(target_sliding[k], scaled(1.0 - friction_share[k], sliding))
        for axis in range(3):
            impulse[k, axis] = change[k, axis] = 0.0
    for _ in range(FRICTION_ROUNDS if any_friction else 0):
        for k in range(count):
            velocity = plus(vector_of(before[k]), vector_of(change[k]))
            now = tangential(vector_of(contacts[k]['normal']), velocity)
            missing = minus(vector_of(target_sliding[k]), now)
            now = along(vector_of(impulse[k]), 1.0 / diagonal_bound[k], missing)
            put_vector(impulse[k], now)
        velocity_changes(contacts, members, inverse_mass, rigid, impulse, change, field, wrenches)
    for k in range(count):
        contact = contacts[k]
        friction = vector_of(impulse[k])
        put_vector(contact['friction'], friction)
        put_vector(impulse[k], along(friction, normal_impulse[k], vector_of(contact['normal'])))
    # positions and velocities are corrected independently
    apply_impulses(contacts, members, inverse_mass, rigid, impulse, x, v, wrenches)
    correct_positions(
        contacts, members, inverse_mass, rigid, diagonal, diagonal_bound, friction_share, start,
        shift, x, before, target_sliding, normal_impulse, impulse, change, field, wrenches,
    )  # fmt: skip
    apply_impulses(contacts, members, inverse_mass, rigid, impulse, x, x, wrenches)


@helper
def stop_approach(  # type: ignore[no-untyped-def]
    contacts, members, inverse_mass, rigid, slow, diagonal, before, normal_impulse, impulse,
    change, field, wrenches,
):  # fmt: skip
    """
    Write the normal impulses (k,) that stop approach, or reflect it between rigid bodies.

    Also written are the impulse vectors, and their changes of the relative velocities, (k, 3).
    """
    count = len(contacts)
    speed, target_speed = np.empty(count), np.zeros(count)
    bounces = False
    for k in range(count):
        contact = contacts[k]
        body, other = members[contact['body']], members[contact['other']]
        speed[k] = dot(vector_of(before[k]), vector_of(contact['normal']))
        if body['rigid'] and other['rigid'] and speed[k] < -slow:
            bounces = True
            target_speed[k] = -geometric_mean(body['elasticity'], other['elasticity']) * speed[k]
    for _ in range(RIGID_ROUNDS if rigid else SOFT_ROUNDS):
        for k in range(count):
            normal = vector_of(contacts[k]['normal'])
            missing = target_speed[k] - speed[k] - dot(vector_of(change[k]), normal)
            normal_impulse[k] = max(normal_impulse[k] + missing / diagonal[k], 0.0)
            put_vector(impulse[k], scaled(normal_impulse[k], normal))
        velocity_changes(contacts, members, inverse_mass, rigid, impulse, change, field, wrenches)
    if not bounces:
        return
    first = second = 0.0
    for k in range(count):
        first += normal_impulse[k] * speed[k]
        second += normal_impulse[k] * dot(vector_of(change[k]), vector_of(contacts[k]['normal']))
    if first + 0.5 * second > 0.0:
        # simultaneous rebounds could add energy: scale them to conserve it
        factor = -2.0 * first / second
        for k in range(count):
            normal_impulse[k] *= factor
            put_vector(change[k], scaled(factor, vector_of(change[k])))


@helper
def friction_share_of(members, contact, sliding, normal_speed):  # type: ignore[no-untyped-def]
    """
    Return the share of the sliding speed, m/s, that friction removes.

    Coulomb's law applies if one of the bodies has it; `normal_speed` is the normal impulse as a
    speed, m/s.
    """
    body, other = members[contact['body']], members[contact['other']]
    if not (body['coulomb'] or other['coulomb']):
        return geometric_mean(body['friction'], other['friction'])
    coefficient = geometric_mean(
        body['friction'] if body['coulomb'] else math.nan,
        other['friction'] if other['coulomb'] else math.nan,
    )
    return min(coefficient * normal_speed / (sliding if sliding > 0.0 else 1.0), 1.0)


@helper
def correct_positions(  # type: ignore[no-untyped-def]
    contacts, members, inverse_mass, rigid, diagonal, diagonal_bound, friction_share, start, shift,
    x, travel, target_sliding, normal_impulse, impulse, correction, field, wrenches,
):  # fmt: skip
    """
    Write the position correction as pseudo-impulses (k, 3).

    Friction also undoes part of the tangential displacement, to reduce creep of sticking contacts.
    """
    count = len(contacts)
    depth, tangential_impulse = np.empty(count), np.zeros((count, 3))
    for k in range(count):
        contact = contacts[k]
        normal = vector_of(contact['normal'])
        scale = min(members[contact['body']]['scale'], members[contact['other']]['scale'])
        remaining = contact['depth'] - dot(difference(contact, shift), normal)
        depth[k] = min(remaining, LARGEST_CORRECTION * scale)
        put_vector(travel[k], minus(difference(contact, x), difference(contact, start)))
        sliding = tangential(normal, vector_of(travel[k]))
        put_vector(target_sliding[k], scaled(1.0 - STICKING * friction_share[k], sliding))
        normal_impulse[k] = 0.0
        for axis in range(3):
            correction[k, axis] = 0.0
    for _ in range(CORRECTION_ROUNDS):
        for k in range(count):
            normal, displacement = vector_of(contacts[k]['normal']), vector_of(correction[k])
            sliding = tangential(normal, plus(vector_of(travel[k]), displacement))
            missing = minus(vector_of(target_sliding[k]), sliding)
            tangent = along(vector_of(tangential_impulse[k]), 1.0 / diagonal_bound[k], missing)
            put_vector(tangential_impulse[k], tangent)
            remaining = depth[k] - dot(displacement, normal)
            normal_impulse[k] = max(normal_impulse[k] + remaining / diagonal[k], 0.0)
            put_vector(impulse[k], along(tangent, normal_impulse[k], normal))
        velocity_changes(
            contacts, members, inverse_mass, rigid, impulse, correction, field, wrenches
        )


@helper
def tangential(normal: Vector, a: Vector) -> Vector:
    """Return the tangential component of a vector."""
    return along(a, -dot(a, normal), normal)


# ------------------------------------------------------------------------------ contact operator
@helper
def find_delassus_diagonal(contacts, members, inverse_mass, diagonal, diagonal_bound):  # type: ignore
    """
    Write the diagonal of the Delassus operator, from impulses to relative velocities, 1/kg.

    Along the normals (k,), and upper bounds for any direction (k,), with mass splitting. Return
    whether any of the bodies is rigid.
    """
    rigid = False
    touched = np.zeros(len(inverse_mass))
    row, response = np.empty(6), np.empty(6)
    for contact in contacts:
        for corner in range(4):
            particle = contact['particles'][corner]
            touched[particle] += 1.0
            if members[contact['body'] if corner == 0 else contact['other']]['rigid']:
                rigid = True
                inverse_mass[particle] = 0.0
    for k in range(len(contacts)):
        contact = contacts[k]
        total = 0.0
        for corner in range(4):
            particle, coefficient = contact['particles'][corner], contact['coefficients'][corner]
            total += coefficient * coefficient * (inverse_mass[particle] * touched[particle])
        diagonal[k] = diagonal_bound[k] = total
        if not rigid:
            continue
        point, normal = vector_of(contact['point']), vector_of(contact['normal'])
        for side in range(2):
            member = members[contact['body'] if side == 0 else contact['other']]
            if not member['rigid']:
                continue
            for axis in range(6):
                row[axis] = 0.0
            add_wrench(member, row, 1.0, point, normal)
            apply_mobility(member, row, response)
            translation = rotation = 0.0
            for axis in range(6):
                diagonal[k] += member['contact_count'] * row[axis] * response[axis]
            for axis in range(3):
                translation += member['mobility'][axis, axis]
                rotation += member['mobility'][3 + axis, 3 + axis]
            arm = minus(point, vector_of(member['centre']))
            diagonal_bound[k] += member['contact_count'] * (translation + rotation * dot(arm, arm))
        diagonal[k], diagonal_bound[k] = max(diagonal[k], TINY), max(diagonal_bound[k], TINY)
    return rigid


@helper
def find_twists(contacts, members, impulse, twists):  # type: ignore[no-untyped-def]
    """Write the twists (C, 6) of rigid bodies by impulses (k, 3) at contacts."""
    wrench = np.empty(6)
    for number in range(len(members)):
        for axis in range(6):
            twists[number, axis] = 0.0
    for k in range(len(contacts)):
        contact = contacts[k]
        body, other = contact['body'], contact['other']
        point, contact_impulse = vector_of(contact['point']), vector_of(impulse[k])
        add_wrench(members[body], twists[body], 1.0, point, contact_impulse)
        add_wrench(members[other], twists[other], -1.0, point, contact_impulse)
    for number in range(len(members)):
        for axis in range(6):
            wrench[axis] = twists[number, axis] if members[number]['rigid'] else 0.0
        apply_mobility(members[number], wrench, twists[number])


@helper
def add_to_particles(contacts, inverse_mass, impulse, field):  # type: ignore[no-untyped-def]
    """Add the changes of a field (N, 3) of deformable bodies by impulses (k, 3) at contacts."""
    for k in range(len(contacts)):
        contact = contacts[k]
        for corner in range(4):
            particle = contact['particles'][corner]
            factor = contact['coefficients'][corner] * inverse_mass[particle]
            for axis in range(3):
                field[particle, axis] += factor * impulse[k, axis]


@helper
def velocity_changes(contacts, members, inverse_mass, rigid, impulse, change, field, twists):  # type: ignore
    """
    Write the changes (k, 3) of relative velocities by impulses (k, 3): the Delassus operator.

    `field` (N, 3) and `twists` (C, 6) are overwritten.
    """
    for contact in contacts:
        for corner in range(4):
            for axis in range(3):
                field[contact['particles'][corner], axis] = 0.0
    add_to_particles(contacts, inverse_mass, impulse, field)
    if rigid:
        find_twists(contacts, members, impulse, twists)
    for k in range(len(contacts)):
        contact = contacts[k]
        velocity = difference(contact, field)
        if rigid:
            body, other = contact['body'], contact['other']
            point = vector_of(contact['point'])
            velocity = plus(velocity, velocity_at(members[body], twists[body], point))
            velocity = minus(velocity, velocity_at(members[other], twists[other], point))
        put_vector(change[k], velocity)


@helper
def apply_impulses(contacts, members, inverse_mass, rigid, impulse, x, field, twists):  # type: ignore
    """Apply impulses (k, 3) at contacts to a field (N, 3) of particles at x, in place."""
    add_to_particles(contacts, inverse_mass, impulse, field)
    if not rigid:
        return
    find_twists(contacts, members, impulse, twists)
    for number in range(len(members)):
        member = members[number]
        if not member['rigid']:
            continue
        for i in range(member['first'], member['first'] + member['count']):
            translation = velocity_at(member, twists[number], vector_of(x[i]))
            put_vector(field[i], plus(vector_of(field[i]), translation))
