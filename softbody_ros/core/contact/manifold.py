# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pairs of bodies in contact: combined properties, and the loads that gravity causes."""

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
from softbody_ros.core.contact.support import support
from softbody_ros.core.geometry.bounding_boxes import sort_indices
from softbody_ros.core.geometry.vectors import ZERO, dot, minus, norm, plus, scaled, vector_of

LEAST_INVERSE_MASS = 1e-6
"""Lower bound of the inverse mass of a fully pinned pair, relative to an unpinned body."""
LEAST_SUPPORT = 0.1
"""Sum of squared cosines of supports below which the transmitted load is reduced."""


@kernel
def prepare_contacts(
    contacts: np.ndarray,
    pairs: np.ndarray,
    members: np.ndarray,
    goals: np.ndarray,
    inverse_mass: np.ndarray,
) -> None:
    """Complete contacts, pairs and members in place with what is independent of velocities."""
    for pair in pairs:
        one, two = members[pair['one']], members[pair['two']]
        least = LEAST_INVERSE_MASS / min(one['mass'], two['mass'])
        pair['reduced_mass'] = 1.0 / max(one['inverse_mass'] + two['inverse_mass'], least)
        pair['scale'] = min(one['scale'], two['scale'])
        pair['elasticity'] = geometric_mean(one['elasticity'], two['elasticity'])
        pair['bounciness'] = geometric_mean(one['bounciness'], two['bounciness'])
        own = contacts[pair['first'] : pair['first'] + pair['count']]
        total = 0.0
        for contact in own:
            # for immovable points the effective mass is that of the face
            inverse = inverse_mass[contact['particles'][0]]
            if inverse == 0.0:
                for corner in range(1, 4):
                    corner_inverse = inverse_mass[contact['particles'][corner]]
                    inverse -= contact['coefficients'][corner] * corner_inverse
            contact['share'], contact['body_impulse'] = 1.0 / inverse, 0.0
            total += contact['share']
            gap = dot(difference(contact, goals), vector_of(contact['normal']))
            contact['goal_depth'] = max(contact['thickness'] - gap, 0.0)
            members[contact['body']]['contact_count'] += 1
            members[contact['other']]['contact_count'] += 1
        pair['depth'] = pair['load'] = 0.0
        for contact in own:
            contact['share'] /= total
            pair['depth'] += contact['share'] * contact['goal_depth']


@helper
def geometric_mean(one: float, two: float) -> float:
    """Return the geometric mean of a property of two bodies; NaN means it is undefined."""
    if math.isnan(one):
        return two
    if math.isnan(two):
        return one
    return math.sqrt(one * two)


@helper
def relative_speed(contact, pair, members, twists):  # type: ignore[no-untyped-def]
    """
    Return the separation speed of two members at a contact, for their rigid motions, m/s.

    Parameters
    ----------
    contact : CONTACT
    pair : PAIR
    members : (C,) MEMBER
    twists : (C, 6) float
        of the members, m/s and rad/s

    """
    point, one, two = vector_of(contact['point']), pair['one'], pair['two']
    velocity = velocity_at(members[one], twists[one], point)
    velocity = minus(velocity, velocity_at(members[two], twists[two], point))
    return contact['sign'] * dot(velocity, vector_of(contact['normal']))


# ------------------------------------------------------------------------------------- loads
@kernel
def carry_weight(
    contacts: np.ndarray,
    pairs: np.ndarray,
    members: np.ndarray,
    gravity: np.ndarray,
    h: float,
    twists: np.ndarray,
) -> None:
    """
    Compute the impulses by which bodies support the weight of bodies on top of them.

    By the same spring and damper as between bodies and obstacles, for the load of each pair.

    Parameters
    ----------
    contacts, pairs, members
        their `load_impulse`, `load` and `load_twist` are written
    gravity : (3,) float
        m/s²
    h : float
        s
    twists : (C, 6) float
        written: of the members, including `load_twist`, m/s and rad/s

    """
    for number in range(len(members)):
        for axis in range(3):
            twists[number, axis] = members[number]['velocity'][axis]
            twists[number, 3 + axis] = members[number]['angular_velocity'][axis]
    find_loads(contacts, pairs, members, gravity)
    wrenches = np.zeros((len(members), 6))
    for pair in pairs:
        reduced_mass, depth = pair['reduced_mass'], pair['depth']
        load = pair['load'] / reduced_mass
        spring, damping = support(load, depth, pair['scale'], h)
        own = contacts[pair['first'] : pair['first'] + pair['count']]
        total = 0.0
        for contact in own:
            pressure = contact['goal_depth'] / (depth if depth > 0.0 else 1.0)
            # a damper at each contact also damps rocking
            force = spring * pressure - damping * relative_speed(contact, pair, members, twists)
            contact['load_impulse'] = max(force, 0.0) / (1.0 + damping * h)
            total += contact['share'] * contact['load_impulse']
        within = min(load / (total if total > 0.0 else 1.0), 1.0)
        for contact in own:
            contact['load_impulse'] *= h * reduced_mass * within * contact['share']
            add_impulse(contact, pair, members, contact['load_impulse'], wrenches)
    for number in range(len(members)):
        member = members[number]
        apply_mobility(member, wrenches[number], member['load_twist'])
        for axis in range(6):
            twists[number, axis] += member['load_twist'][axis]


@helper
def add_impulse(contact, pair, members, impulse, wrenches):  # type: ignore[no-untyped-def]
    """Add an impulse along the normal of a contact, N s, to the wrenches (C, 6) of its bodies."""
    one, two = pair['one'], pair['two']
    along_normal = scaled(contact['sign'] * impulse, vector_of(contact['normal']))
    add_impulse_at(members, one, two, vector_of(contact['point']), along_normal, wrenches)


@helper
def add_impulse_at(members, one, two, point, impulse, wrenches):  # type: ignore[no-untyped-def]
    """Add an impulse at a point between two members to wrenches (C, 6)."""
    add_wrench(members[one], wrenches[one], 1.0, point, impulse)
    add_wrench(members[two], wrenches[two], -1.0, point, impulse)


@helper
def find_loads(contacts, pairs, members, gravity):  # type: ignore[no-untyped-def]
    """
    Write the forces between the bodies of a pile due to their weight, N.

    From top to bottom: the weight of each body and of those on top of it is distributed to the
    bodies below it, in proportion to the cosine between normal and gravity.
    """
    magnitude = norm(vector_of(gravity))
    if magnitude == 0.0:
        return
    down = scaled(1.0 / magnitude, vector_of(gravity))
    upper, lower = np.empty(len(pairs), np.int64), np.empty(len(pairs), np.int64)
    transmitted, height = np.zeros(len(pairs)), np.empty(len(pairs))
    square, force = np.zeros(len(members)), np.zeros(len(members))
    for number in range(len(members)):
        member = members[number]
        # the weight of pinned bodies is supported by the pins
        if member['body'] >= 0 and not member['pinned']:
            force[number] = magnitude * member['mass']
    for number in range(len(pairs)):
        pair, normal = pairs[number], ZERO
        for contact in contacts[pair['first'] : pair['first'] + pair['count']]:
            factor = contact['share'] * contact['sign']
            normal = plus(normal, scaled(factor, vector_of(contact['normal'])))
        length = norm(normal)
        cosine = -dot(normal, down) / (length if length > 0.0 else 1.0)
        one, two = pair['one'], pair['two']
        upper[number], lower[number] = (one, two) if cosine > 0.0 else (two, one)
        above, below = members[upper[number]], members[lower[number]]
        height[number] = dot(vector_of(above['centre']), down)
        if one != two and force[upper[number]] > 0.0 and not below['edge']:
            transmitted[number] = abs(cosine)
            square[upper[number]] += cosine * cosine
    order = np.empty(len(pairs), np.int64)
    sort_indices(height, order)
    for place in range(len(order)):
        pair, cosine = pairs[order[place]], transmitted[order[place]]
        top, bottom = upper[order[place]], lower[order[place]]
        pair['load'] = force[top] * cosine / max(square[top], LEAST_SUPPORT)
        force[bottom] += pair['load'] * cosine
