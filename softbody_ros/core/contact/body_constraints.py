# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Rigid-level constraints that bound interpenetration in a pile.

The particles in contact are light: between heavy or fast bodies, impulses on them alone could not
prevent the bodies from passing through each other. Impulses between whole bodies, solved for all
bodies in contact together, do.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.contact_state import add_wrench, apply_mobility
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.manifold import relative_speed
from softbody_ros.core.contact.support import SETTLED, TINY, settling_speed
from softbody_ros.core.geometry.vectors import ZERO, dot, norm, vector_of

DEEPEST = 0.1
"""Penetration of goals, in RMS radii, at which constraints between bodies become active."""
POSITION_CORRECTION = 0.2
"""Share of deeper penetration that is corrected per tick."""
ROUNDS = 20
LEAST_MOBILITY = 0.01
"""Least mobility along the mean normal of its contacts, relative to that of the body."""

CONSTRAINT = np.dtype(
    [
        ('one', np.int64),  # members; both are the same one for a body on an obstacle
        ('two', np.int64),
        # from twists to speed along the mean normal, and from an impulse along it to twists
        ('jacobian_one', np.float64, (6,)),
        ('jacobian_two', np.float64, (6,)),
        ('response_one', np.float64, (6,)),
        ('response_two', np.float64, (6,)),
        ('clearance', np.float64),  # remaining admissible penetration, m
        ('surface_speed', np.float64),  # of the obstacle along the normal, m/s
        ('weight', np.float64),  # share of the mass of the body in contact with an obstacle
        ('effective_mass', np.float64),  # with mass splitting, kg
        ('impulse', np.float64),  # result, N s
    ],
    align=True,
)
"""A non-penetration constraint between two bodies, or a body and an obstacle."""

ObstacleContacts = Callable[[np.ndarray], np.ndarray]
"""
Function from bodies (c,) int of the world to their contacts with obstacles, sorted by obstacle,
then body: an array with the fields body, obstacle, particle, point, normal, surface_velocity,
origin of the obstacle, and goal_depth, the penetration of the particle's goal, m, or 0.
"""


def solve_body_constraints(
    state: Any,
    members: np.ndarray,
    contacts: np.ndarray,
    pairs: np.ndarray,
    twists: np.ndarray,
    gravity: np.ndarray,
    h: float,
    obstacle_contacts: ObstacleContacts,
) -> None:
    """
    Solve the constraints that limit penetration of bodies to `DEEPEST`, with restitution.

    Obstacles, which particles cannot penetrate, are included as supports, so that impulses
    propagate through a pile in one tick.

    Parameters
    ----------
    state : State
        what obstacles and particles feel is added
    members, contacts, pairs : (C,) MEMBER, (k,) CONTACT, (p,) PAIR
        written: `constraint_twist`, `correction` and `received` of the members, `body_impulse` of
        the contacts
    twists : (C, 6) float
        of the members, m/s and rad/s
    gravity : (3,) float
        m/s²
    h : float
        s
    obstacle_contacts : callable
        see `ObstacleContacts`

    """
    if stay_apart(contacts, pairs, members, twists, h):
        return
    standing = obstacle_contacts(members['body'][members['body'] >= 0])
    constraints = np.zeros(len(pairs) + len(standing), CONSTRAINT)
    count = connect_pairs(contacts, pairs, members, constraints)
    count = connect_obstacles(
        standing, state.bodies, state.shapes, state.weights, members, constraints, count
    )
    solve_constraints(constraints[:count], contacts, pairs, members, twists, gravity, h)
    give_to_obstacles(
        standing, state.bodies, state.shapes, state.weights, constraints[len(pairs) : count],
        state.obstacle_impulse, state.normal_impulse,
    )  # fmt: skip


@kernel
def stay_apart(
    contacts: np.ndarray, pairs: np.ndarray, members: np.ndarray, twists: np.ndarray, h: float
) -> bool:
    """Return whether no constraint would be violated at the end of the tick."""
    for pair in pairs:
        if pair['one'] == pair['two']:
            continue
        speed = 0.0
        for contact in contacts[pair['first'] : pair['first'] + pair['count']]:
            speed += contact['share'] * relative_speed(contact, pair, members, twists)
        if not speed >= -(DEEPEST * pair['scale'] - pair['depth']) / h:
            return False
    return True


@kernel
def connect_pairs(
    contacts: np.ndarray, pairs: np.ndarray, members: np.ndarray, constraints: np.ndarray
) -> int:
    """Write the constraints between bodies, one per pair; return their number."""
    for number in range(len(pairs)):
        pair, constraint = pairs[number], constraints[number]
        one, two = pair['one'], pair['two']
        constraint['one'], constraint['two'] = one, two
        constraint['clearance'] = DEEPEST * pair['scale'] - pair['depth']
        if one == two:
            continue
        for contact in contacts[pair['first'] : pair['first'] + pair['count']]:
            factor = contact['share'] * contact['sign']
            normal, point = vector_of(contact['normal']), vector_of(contact['point'])
            add_wrench(members[one], constraint['jacobian_one'], factor, point, normal)
            add_wrench(members[two], constraint['jacobian_two'], factor, point, normal)
    return len(pairs)


@kernel
def connect_obstacles(
    standing: np.ndarray,
    bodies: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    members: np.ndarray,
    constraints: np.ndarray,
    count: int,
) -> int:
    """Append the constraints of bodies on obstacles to `count` others; return the total."""
    start = 0
    while start < len(standing):
        body, obstacle = standing[start]['body'], standing[start]['obstacle']
        number = 0
        while members[number]['body'] != body:
            number += 1
        member, shape = members[number], shapes[bodies[body]['shape']]
        constraint = constraints[count]
        constraint['one'] = constraint['two'] = number
        total = depth = speed = 0.0
        stop = start
        while stop < len(standing):
            contact = standing[stop]
            if contact['body'] != body or contact['obstacle'] != obstacle:
                break
            # a particle without area has no weight: it must not divide by zero
            weight = max(weights[shape['first'] + contact['particle']], TINY)
            normal, point = vector_of(contact['normal']), vector_of(contact['point'])
            add_wrench(member, constraint['jacobian_one'], weight, point, normal)
            total += weight
            depth += weight * contact['goal_depth']
            speed += weight * dot(vector_of(contact['surface_velocity']), normal)
            stop += 1
        for axis in range(6):
            constraint['jacobian_one'][axis] /= total
        constraint['weight'] = total
        constraint['clearance'] = DEEPEST * member['scale'] - depth / total
        constraint['surface_speed'] = speed / total
        start, count = stop, count + 1
    return count


@kernel
def give_to_obstacles(
    standing: np.ndarray,
    bodies: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    constraints: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """Add the impulses of constraints with obstacles to the results, see `exchange`."""
    number = -1
    for k in range(len(standing)):
        contact, last = standing[k], standing[max(k - 1, 0)]
        if k == 0 or contact['body'] != last['body'] or contact['obstacle'] != last['obstacle']:
            number += 1
        body, constraint = bodies[contact['body']], constraints[number]
        first, half = shapes[body['shape']]['first'], 1 - body['now']
        weight = max(weights[first + contact['particle']], TINY)
        size = constraint['impulse'] * weight / constraint['weight']
        normal_impulse[half, body['first'] + contact['particle']] += size
        add_wrench_about(
            obstacle_impulse[contact['body'], half, contact['obstacle']],
            vector_of(contact['origin']), -size, vector_of(contact['point']),
            vector_of(contact['normal']), ZERO,
        )  # fmt: skip
        body['touches'][half] = 1


@kernel
def solve_constraints(
    constraints: np.ndarray,
    contacts: np.ndarray,
    pairs: np.ndarray,
    members: np.ndarray,
    twists: np.ndarray,
    gravity: np.ndarray,
    h: float,
) -> None:
    """Compute the impulses, see `solve_body_constraints`; constraints are completed in place."""
    find_effective_masses(constraints, len(pairs), members)
    count = len(constraints)
    approach, least, clearance = np.empty(count), np.empty(count), np.empty(count)
    rebound_speed, position_impulse = np.zeros(count), np.zeros(count)
    needed, impulse, rebound = np.empty(count), np.zeros(count), np.zeros(count)
    scratch = np.empty((len(members), 6))
    for k in range(count):
        constraint = constraints[k]
        approach[k] = constraint_speed(constraint, twists) - constraint['surface_speed']
        clearance[k] = max(constraint['clearance'], 0.0)
        least[k] = -clearance[k] / h
        needed[k] = POSITION_CORRECTION * max(-constraint['clearance'], 0.0)
    solve(constraints, needed, position_impulse, scratch)
    for k in range(count):
        needed[k] = least[k] - approach[k]
    solve(constraints, needed, impulse, scratch)

    rebounds = False
    magnitude = norm(vector_of(gravity))
    for k in range(len(pairs)):
        pair = pairs[k]
        settling = settling_speed(magnitude, pair['scale'])
        ramp = min(max(-approach[k] / settling - SETTLED, 0.0), 1.0)
        rebound_speed[k] = -restitution(pair) * ramp * approach[k]
        if impulse[k] > 0.0 and rebound_speed[k] > 0.0:
            rebounds = True
            needed[k] = rebound_speed[k] - approach[k]
    if rebounds:
        solve(constraints, needed, rebound, scratch)
        impulse_response(constraints, rebound, scratch)
        gained = 0.0
        for k in range(count):
            gained += rebound[k] * (approach[k] + 0.5 * constraint_speed(constraints[k], scratch))
        # simultaneous rebounds in a pile could add energy
        if gained <= 0.0:
            for k in range(count):
                if impulse[k] > 0.0 and rebound_speed[k] > 0.0:
                    # the reversal is within the tick, at the deepest penetration
                    position_impulse[k] -= constraints[k]['effective_mass'] * clearance[k]
            impulse = rebound

    impulse_response(constraints, impulse, scratch)
    for number in range(len(members)):
        for axis in range(6):
            members[number]['constraint_twist'][axis] = scratch[number, axis]
    impulse_response(constraints, position_impulse, scratch)
    for number in range(len(members)):
        for axis in range(6):
            members[number]['correction'][axis] = scratch[number, axis]
    for k in range(len(pairs)):
        for contact in contacts[pairs[k]['first'] : pairs[k]['first'] + pairs[k]['count']]:
            contact['body_impulse'] = impulse[k] * contact['share']
    for k in range(len(pairs), count):
        constraints[k]['impulse'] = impulse[k]
        member = members[constraints[k]['one']]
        for axis in range(6):
            member['received'][axis] += impulse[k] * constraints[k]['jacobian_one'][axis]


@helper
def restitution(pair):  # type: ignore[no-untyped-def]
    """
    Return the coefficient of restitution of a pair.

    The energy stored in the deformation of the first half of a swing is returned in the second,
    reduced by bounciness; elasticity absorbs as in `add_impulses`.
    """
    return 0.5 * (1.0 + pair['elasticity']) * math.sqrt(pair['bounciness'])


@helper
def find_effective_masses(constraints, pairs, members):  # type: ignore[no-untyped-def]
    """Write the responses of twists to impulses, and effective masses with mass splitting."""
    contact_count = np.zeros(len(members), np.int64)
    for k in range(len(constraints)):
        constraint = constraints[k]
        contact_count[constraint['one']] += 1
        if k < pairs:
            contact_count[constraint['two']] += 1
    for k in range(len(constraints)):
        constraint = constraints[k]
        one, two = constraint['one'], constraint['two']
        apply_mobility(members[one], constraint['jacobian_one'], constraint['response_one'])
        apply_mobility(members[two], constraint['jacobian_two'], constraint['response_two'])
        along_one = along_two = 0.0
        for axis in range(6):
            along_one += constraint['jacobian_one'][axis] * constraint['response_one'][axis]
            along_two += constraint['jacobian_two'][axis] * constraint['response_two'][axis]
        # mass splitting: the mass of each body is divided among its contacts
        mobility = along_one * contact_count[one] + along_two * contact_count[two]
        # normals in all directions have no mean along which the bodies could separate
        least_one = LEAST_MOBILITY * members[one]['inverse_mass'] * contact_count[one]
        least_two = LEAST_MOBILITY * members[two]['inverse_mass'] * contact_count[two]
        constraint['effective_mass'] = 0.0
        if mobility > max(least_one, least_two):
            constraint['effective_mass'] = 1.0 / mobility


@helper
def constraint_speed(constraint, twists):  # type: ignore[no-untyped-def]
    """Return the separation speed at a constraint for twists (C, 6) of members, m/s."""
    one, two = twists[constraint['one']], twists[constraint['two']]
    speed = 0.0
    for axis in range(6):
        speed += constraint['jacobian_one'][axis] * one[axis]
        speed -= constraint['jacobian_two'][axis] * two[axis]
    return speed


@helper
def impulse_response(constraints, impulse, twists):  # type: ignore[no-untyped-def]
    """Write the changes of twists (C, 6) by impulses (q,)."""
    for number in range(len(twists)):
        for axis in range(6):
            twists[number, axis] = 0.0
    for k in range(len(constraints)):
        constraint = constraints[k]
        one, two = twists[constraint['one']], twists[constraint['two']]
        for axis in range(6):
            one[axis] += impulse[k] * constraint['response_one'][axis]
            two[axis] -= impulse[k] * constraint['response_two'][axis]


@helper
def solve(constraints, needed, impulse, twists):  # type: ignore[no-untyped-def]
    """Write impulses (q,) ≥ 0 that add at least the needed speeds (projected Jacobi)."""
    for _ in range(ROUNDS):
        impulse_response(constraints, impulse, twists)
        for k in range(len(constraints)):
            constraint = constraints[k]
            remaining = needed[k] - constraint_speed(constraint, twists)
            impulse[k] = max(impulse[k] + constraint['effective_mass'] * remaining, 0.0)
