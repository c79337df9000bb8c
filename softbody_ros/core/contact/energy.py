# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What energy contacts give to bodies, and its bounds.

Contacts give none but by the motion of what is touched. Four things could: simultaneous rebounds
with friction, wedges that push out what is inside them, forces that are no solution, since none
was found in time, and those on what is so thin that they turn it by more than a small angle in a
tick, as a rod about its axis. Then the energy is bounded by a share of the rebounds, or of all
forces or impulses, in which it is quadratic.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.members import add_impulses
from softbody_ros.core.contact.problem import Problem, sum_forces
from softbody_ros.core.contact.rows import LINEARISED, RECOVERY, copy_record, side_of
from softbody_ros.core.geometry.vectors import (
    ZERO,
    along,
    applied,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
    transposed,
    vector_of,
)

GAIN = 1e-10
"""Relative gain of energy that is rounding."""


@helper
def kinetic_energy(members: np.ndarray) -> float:
    """Return the kinetic energy of bodies, J."""
    total = 0.0
    for number in range(len(members)):
        member = members[number]
        velocity, momentum = vector_of(member['velocity']), vector_of(member['angular_momentum'])
        local = applied(transposed(matrix_of(member['rotation'])), momentum)
        turning = dot(local, applied(matrix_of(member['inverse_inertia']), local))
        total += 0.5 * member['mass'] * (dot(velocity, velocity) + turning)
    return total


@helper
def work_of_loads(members: np.ndarray) -> float:
    """Return the work of gravity and applied forces along what contacts displace bodies by, J."""
    total = 0.0
    for number in range(len(members)):
        member = members[number]
        displaced = plus(vector_of(member['shift']), vector_of(member['residual_shift']))
        total += member['mass'] * dot(vector_of(member['acceleration']), displaced)
    return total


@helper
def energy_after(members: np.ndarray, rows: np.ndarray) -> float:
    """Return the kinetic energy with the impulses at the end of the tick, J."""
    after = np.empty(len(members), members.dtype)
    for number in range(len(members)):
        copy_record(after, number, members, number)
    add_impulses(after, rows)
    return kinetic_energy(after)


@helper
def all_still(members: np.ndarray, rows: np.ndarray) -> bool:
    """Return whether nothing that moves by itself, and so can give energy, is touched."""
    if any_driven(members):
        return False
    for k in range(len(rows)):
        if vector_of(rows[k]['other_velocity']) != ZERO:
            return False
    return True


@helper
def any_driven(members: np.ndarray) -> bool:
    """Return whether pins move a body: its own energy does not bound what it can give."""
    for number in range(len(members)):
        member = members[number]
        moves = vector_of(member['carried']) != ZERO or vector_of(member['velocity']) != ZERO
        if member['has_pins'] and moves:
            return True
    return False


@helper
def any_impact(rows: np.ndarray) -> bool:
    """Return whether a contact rebounds."""
    for k in range(len(rows)):
        if rows[k]['elasticity'] * rows[k]['approach'] < 0.0:
            return True
    return False


@helper
def rebound(rows: np.ndarray, change: float) -> None:
    """Add a multiple of the speeds of rebound to the problem."""
    for k in range(len(rows)):
        rows[k]['bias'][0] += change * rows[k]['elasticity'] * rows[k]['approach']


@helper
def keep_motion(members: np.ndarray) -> None:
    """Keep the momenta before the contacts."""
    for number in range(len(members)):
        member = members[number]
        put_vector(member['momenta'][0], vector_of(member['velocity']))
        put_vector(member['momenta'][1], vector_of(member['angular_momentum']))


@helper
def any_inside(members: np.ndarray, rows: np.ndarray) -> bool:
    """Return whether something was inside something, where it was found or pressed."""
    for k in range(len(rows)):
        row = rows[k]
        motion = minus(vector_of(row['motion']), vector_of(row['other_motion']))
        before = row['gap'] - dot(vector_of(row['normal']), motion)
        if row['tolerated'] > 0.0 or before < -LINEARISED * members[row['one']]['scale']:
            return True
    return False


@helper
def are_passive(members: np.ndarray, rows: np.ndarray) -> bool:
    """
    Return whether contacts give no energy but by the motion of what is touched.

    What pins hold, or was put somewhere, may be anywhere at once, whatever that takes.
    """
    for k in range(len(rows)):
        if rows[k]['is_placed']:
            return False
        for side in range(2):
            index, _ = side_of(rows[k], side)
            if index >= 0 and members[index]['has_pins']:
                return False
    return True


@helper
def touches_obstacle(rows: np.ndarray) -> bool:
    """Return whether any contact is with an obstacle."""
    for k in range(len(rows)):
        if rows[k]['two'] < 0:
            return True
    return False


@helper
def any_tolerated(rows: np.ndarray) -> bool:
    """Return whether something was found inside something, and gets out."""
    for k in range(len(rows)):
        if rows[k]['tolerated'] > 0.0:
            return True
    return False


@helper
def parting_work(member: np.void) -> float:
    """Return the work that gets a body out of what it is inside, in one tick, J."""
    speed = RECOVERY * member['scale']
    return 2.0 * member['mass'] * speed * speed


@helper
def share_for(a: float, b: float, most: float) -> float:
    """Return the share s from 0 to 1 for which a s + b s² is at most so much; b ≥ 0."""
    if a + b <= most:
        return 1.0
    share, root = 0.0, math.sqrt(max(a * a + 4.0 * b * most, 0.0))
    if a > 0.0:
        share = 2.0 * most / (a + root)
    elif b > 0.0:
        share = 0.5 * (root - a) / b
    return min(max(share, 0.0), 1.0)


@helper
def scale_forces(problem: Problem, share: float) -> None:
    """Take a share of all forces."""
    for k in range(len(problem.rows)):
        force = problem.rows[k]['force']
        put_vector(force, scaled(share, vector_of(force)))
    sum_forces(problem)


@helper
def largest_energy(members: np.ndarray, rows: np.ndarray, energy: float, h: float) -> float:
    """
    Return the energy, J, with which bodies can leave obstacles: at twice their speed faster.

    What is inside something leaves it with a speed of its own, but no faster than it is already;
    and next to no speed, as of what is held without room, is tolerated.
    """
    fastest = parting = mass = 0.0
    for k in range(len(rows)):
        row = rows[k]
        fastest = max(fastest, LINEARISED * members[row['one']]['scale'] / h)
        fastest = max(fastest, norm(vector_of(row['other_velocity'])))
        if row['tolerated'] > 0.0:
            parting = max(parting, 0.5 * RECOVERY * members[row['one']]['scale'])
    for number in range(len(members)):
        mass += members[number]['mass']
    root = max(math.sqrt(energy), math.sqrt(2.0 * mass) * parting)
    root += math.sqrt(2.0 * mass) * fastest
    return root * root


@helper
def keep_energy(members: np.ndarray, rows: np.ndarray, most: float) -> float:
    """
    Take the share of all impulses after which there is not more energy, and return it.

    Impulses that are no solution, since none was found in time, could gain some; and so could
    those that get something out of the narrow, as a wedge does.
    """
    after, is_free = kinetic_energy(members), not touches_obstacle(rows)
    # with none, there need not be what was before: see `take_share`
    none = energy_of_share(members, 0.0, is_free)
    half = energy_of_share(members, 0.5, is_free)
    # none + a s + b s²
    b = 2.0 * (after + none - 2.0 * half)
    a = after - none - b
    share = share_for(a, b, most - none) if b > 0.0 else 0.0
    for number in range(len(members)):
        take_share(members[number], share, is_free)
    return share


@helper
def energy_of_share(members: np.ndarray, share: float, is_free: bool) -> float:
    """Return the kinetic energy with a share of all impulses, J."""
    shared = np.empty(len(members), members.dtype)
    for number in range(len(members)):
        copy_record(shared, number, members, number)
        take_share(shared[number], share, is_free)
    return kinetic_energy(shared)


@helper
def take_share(member: np.void, share: float, is_free: bool) -> None:
    """
    Take back all but a share of the impulses on a body; its displacement stays.

    Without obstacles the moment of that displacement with the velocity that is left is taken
    back, too, lest the angular momentum of all bodies changes. With them it changes anyway, and
    what was before turns with the body: otherwise a rod would get energy by its displacement.
    """
    before, angular_before = vector_of(member['momenta'][0]), vector_of(member['momenta'][1])
    after, angular = vector_of(member['velocity']), vector_of(member['angular_momentum'])
    put_vector(member['velocity'], along(before, share, minus(after, before)))
    if not is_free:
        angular_before = applied(matrix_of(member['rotation']), angular_before)
    angular = along(angular_before, share, minus(angular, angular_before))
    if is_free:
        displaced = cross(vector_of(member['shift']), before)
        angular = along(angular, share - 1.0, displaced)
    put_vector(member['angular_momentum'], angular)
