# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact between bodies, between regions of one body, and with points.

As with obstacles: approach of particles is stopped, with friction; loads act on whole bodies;
restitution is a property of whole bodies. Impulses act on both bodies in opposite directions along
the same line, so momentum and angular momentum are conserved; normal impulses never add energy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from softbody_ros.core.collision.body_contacts import find_body_contacts, find_candidates
from softbody_ros.core.collision.collision_surface import CollisionSurfaces
from softbody_ros.core.compiled import kernel
from softbody_ros.core.contact.body_constraints import ObstacleContacts, solve_body_constraints
from softbody_ros.core.contact.contact_state import (
    FixedPoints,
    add_wrench,
    make_contact_state,
    move,
    write_back,
)
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.manifold import carry_weight, prepare_contacts, relative_speed
from softbody_ros.core.contact.particle_solver import solve_contacts
from softbody_ros.core.contact.support import SETTLED, settling_speed
from softbody_ros.core.geometry.vectors import ZERO, along, norm, scaled, vector_of


def resolve_body_contacts(
    state: Any,
    awake: np.ndarray,
    surfaces: CollisionSurfaces,
    fixed: Sequence[FixedPoints],
    obstacle_contacts: ObstacleContacts,
    gravity: np.ndarray,
    h: float,
) -> None:
    """
    Resolve contacts of bodies with each other and with immovable points, in place.

    Parameters
    ----------
    state : State
        with positions and velocities after `flight.predict_and_match`
    awake : (A,) int
        awake bodies, in order
    surfaces : CollisionSurfaces
        one for each row of the rest shapes
    fixed : sequence of FixedPoints
        point obstacles, and edge points of obstacles: particles alone would let corners and thin
        obstacles pass between them
    obstacle_contacts : callable
        contacts of the bodies with obstacles, see `ObstacleContacts`
    gravity : (3,) float
        m/s²
    h : float
        s

    """
    found = detect(state, awake, surfaces, fixed)
    if found is None:
        return
    touching, contacts, pairs = found
    state.fill_goals(touching)
    contact = make_contact_state(state, touching, fixed, contacts, h)
    members = contact.members
    prepare_contacts(contacts, pairs, members, contact.goals, contact.inverse_mass)
    twists, shift = np.empty((len(members), 6)), np.zeros_like(contact.x)
    carry_weight(contacts, pairs, members, gravity, h, twists)
    solve_body_constraints(state, members, contacts, pairs, twists, gravity, h, obstacle_contacts)
    move(members, h, contact.x, contact.v, shift)
    solve_contacts(
        contacts, members, contact.inverse_mass, contact.start, shift, gravity, h, contact.x,
        contact.v,
    )  # fmt: skip
    add_impulses(
        contacts, pairs, members, twists, gravity, state.bodies, state.obstacle_impulse,
        state.normal_impulse,
    )  # fmt: skip
    write_back(
        state.bodies, state.shapes, state.weights, state.x, state.v, members, contact.x, contact.v,
        h,
    )  # fmt: skip


def detect(
    state: Any, awake: np.ndarray, surfaces: CollisionSurfaces, fixed: Sequence[FixedPoints]
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """
    Return the bodies involved (c,), contacts (k,) and pairs (p,), or None.

    Members of the contact state are these bodies, in order, followed by the sets of points.
    """
    candidates = find_candidates(state, state.bodies, awake, surfaces, fixed)
    if candidates is None:
        return None
    count, bodies, indices = len(awake), state.bodies, np.flatnonzero(candidates[1])
    touching = awake[indices]
    numbers = np.full(count + len(fixed), -1)
    numbers[indices] = np.arange(len(indices))
    numbers[count:] = len(indices) + np.arange(len(fixed))
    first = np.concatenate([[0], np.cumsum(bodies['count'][touching])])
    contacts, pairs = find_body_contacts(
        state, bodies, awake, surfaces, candidates[0], numbers, first
    )
    return (touching, contacts, pairs) if len(contacts) else None


@kernel
def add_impulses(
    contacts: np.ndarray,
    pairs: np.ndarray,
    members: np.ndarray,
    twists: np.ndarray,
    gravity: np.ndarray,
    bodies: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """
    Sum the impulses of all contacts of each member, less those absorbed by inelasticity.

    Deformable bodies rebound by recovering their shape. So while a pair separates, the share
    (1 − ε) / 2 of the contact impulses is absorbed, as an impulse between the whole bodies
    (Poisson's hypothesis of restitution). It never adds energy.

    Parameters
    ----------
    contacts, pairs : (k,) CONTACT, (p,) PAIR
    members : (C,) MEMBER
        `received` is written
    twists : (C, 6) float
        of the members before the impulses, m/s and rad/s
    gravity : (3,) float
        m/s²
    bodies : (B,) BODY
    obstacle_impulse, normal_impulse
        results, see `exchange`

    """
    magnitude = norm(vector_of(gravity))
    for pair in pairs:
        one, two = members[pair['one']], members[pair['two']]
        own = contacts[pair['first'] : pair['first'] + pair['count']]
        absorbed = 0.0
        # rigid bodies rebound within the tick
        if pair['one'] != pair['two'] and not (one['rigid'] and two['rigid']):
            total_impulse = speed = 0.0
            for contact in own:
                total_impulse += contact['impulse']
                speed += contact['share'] * relative_speed(contact, pair, members, twists)
            # the mean of the speeds before and after
            speed += 0.5 * total_impulse / pair['reduced_mass']
            separation = speed / settling_speed(magnitude, pair['scale']) - SETTLED
            absorbed = 0.5 * (1.0 - pair['elasticity']) * min(max(separation, 0.0), 1.0)
        for contact in own:
            amount = (
                contact['load_impulse']
                + contact['body_impulse']
                + (1.0 - absorbed) * contact['impulse']
            )
            impulse = scaled(contact['sign'], vector_of(contact['friction']))
            normal = vector_of(contact['normal'])
            impulse = along(impulse, contact['sign'] * amount, normal)
            point = vector_of(contact['point'])
            add_wrench(one, one['received'], 1.0, point, impulse)
            add_wrench(two, two['received'], -1.0, point, impulse)
            if one['body'] < 0:
                half = 1 - bodies[two['body']]['now']
                row = obstacle_impulse[two['body'], half, one['obstacle']]
                add_wrench_about(row, vector_of(one['centre']), 1.0, point, impulse, ZERO)
            if two['body'] < 0:
                half = 1 - bodies[one['body']]['now']
                row = obstacle_impulse[one['body'], half, two['obstacle']]
                add_wrench_about(row, vector_of(two['centre']), -1.0, point, impulse, ZERO)
            for corner in range(4):
                member = members[contact['body'] if corner == 0 else contact['other']]
                if member['body'] >= 0:
                    body = bodies[member['body']]
                    particle = body['first'] + contact['particles'][corner] - member['first']
                    share = abs(contact['coefficients'][corner])
                    normal_impulse[1 - body['now'], particle] += share * amount
                    body['touches'][1 - body['now']] = 1
