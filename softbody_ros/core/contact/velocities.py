# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The second stage of contact: velocities.

Impulses p at the end of the tick, such that contacts separate with ε times the speed of approach,
and stick or slide within the cone of all of the tick's impulse, h f + p. In rest p = 0, and f is
the weight.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.body import QUADRATIC_FEATURES
from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.energy import (
    GAIN,
    all_still,
    any_impact,
    any_tolerated,
    are_passive,
    energy_after,
    parting_work,
    rebound,
    scale_forces,
    share_for,
)
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.impacts import pass_on_impacts
from softbody_ros.core.contact.island import (
    Island,
    is_large,
    is_unsolved,
    solved,
    touched_particles,
)
from softbody_ros.core.contact.members import (
    add_impulses,
    add_momenta,
    add_velocities,
    begin_impulses,
    end_centre,
    end_velocity,
)
from softbody_ros.core.contact.positions import (
    PROXIMAL,
    compliance_of_pins,
    is_shared,
    moved,
    put_jacobian,
    start_of,
    tolerance_of,
)
from softbody_ros.core.contact.problem import (
    Problem,
    any_mobile,
    line_of,
    own_mobility,
    response_of,
    width_of,
)
from softbody_ros.core.contact.rows import LINEARISED, copy_record, in_world, share_of, side_of
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    along,
    applied,
    axial,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
    vector_of,
)

VELOCITY_COMPLIANCE = 1e-4
"""Compliance of contacts for velocities, relative to the inverse mass."""
LARGEST_TWIST = 0.01
"""Rotation by moments that J does not contain, rad, at most."""
ROUNDING = 1e-12
"""Displacement of a body by the force of a contact, in RMS radii, up to which it is rounding."""
SLOW_IMPACT = 1e-3
"""Way in a tick, in RMS radii, of impacts that are too slow to go on from body to body."""
SOFT_VELOCITY_COMPLIANCE = 0.01
"""Compliance of contacts of deformable bodies that share no particles, for velocities, relative to
the response of their particles."""


@helper
def solve_velocities(island: Island, problem: Problem, kept: float) -> None:
    """
    Find the impulses at the end of the tick, and change velocities by them.

    Parameters
    ----------
    island : Island
    problem : Problem
        of the contacts that act, see `begin_velocities`
    kept : float
        kinetic energy that impacts may leave, J

    """
    members, rows, tolerance = island.members, problem.rows, tolerance_of(island) / island.h
    impact = any_impact(rows) and all_still(members, rows)
    if impact and passes_on(island, rows):
        pass_on_impacts(island, problem, SLOW_IMPACT * island.scale / island.h, tolerance)
    solved(problem, tolerance, island, False)
    most = energy_after(members, rows) if impact else 0.0
    if most > (1.0 + GAIN) * kept:
        # simultaneous rebounds with friction could gain energy: it is convex in their share
        rebound(rows, -1.0)
        solved(problem, tolerance, island, False)
        least = energy_after(members, rows)
        rebound(rows, min(max((kept - least) / (most - least), 0.0), 1.0))
        solved(problem, tolerance, island, False)
    if (is_unsolved(island) or any_tolerated(rows)) and are_passive(members, rows):
        brake_impulses(members, problem)
    add_impulses(members, rows)
    particles = touched_particles(island, problem)
    add_velocities(members, particles, problem.modes[0], problem.shifts[0])


@helper
def passes_on(island: Island, rows: np.ndarray) -> bool:
    """Return whether impacts of an island go on from body to body: not in heaps or tangles."""
    return not (island.is_soft or is_large(island) or is_unsolved(island) or any_tolerated(rows))


@helper
def brake_impulses(members: np.ndarray, problem: Problem) -> None:
    """Take a share of the impulses at the end of the tick that gives bodies little energy."""
    rows, is_mobile = problem.rows, any_mobile(problem)
    most = driven = by_speed = by_response = 0.0
    for k in range(len(rows)):
        row, force = rows[k], vector_of(rows[k]['force'])
        driven = max(driven, norm(vector_of(row['other_velocity'])))
        by_response += 0.5 * dot(force, response_of(problem, k, is_mobile))
        by_speed += force[0] * (row['bias'][0] - row['elasticity'] * row['approach'])
        by_speed += force[1] * row['free'][0] + force[2] * row['free'][1]
    for number in range(len(members)):
        member = members[number]
        most += parting_work(member) + 2.0 * member['mass'] * driven * driven
    share = share_for(by_speed, by_response, most)
    if share < 1.0:
        scale_forces(problem, share)


@helper
def change_velocities(
    members: np.ndarray, rows: np.ndarray, particles: np.ndarray, h: float
) -> None:
    """
    Write forces, and change velocities by them.

    The moment is that of the midpoint of the path of the point of contact about that of the path
    of the centre without contacts: exact for a force constant over the tick, and equal on both
    sides, so that angular momentum is conserved.

    J has the moments of the start shapes. The difference is small, but where obstacles squeeze a
    body with much force, and displace its particles far within the tick: it would make the body
    spin, which the contacts did not see. So between an obstacle and a body it is bounded.
    """
    begin_impulses(members)
    twists = np.zeros((len(members), 3))
    for k in range(len(rows)):
        row = rows[k]
        impulse = scaled(2.0 / h, in_world(row, row['force']))
        start, end = path_of(row, members, particles)
        middle = scaled(0.5, plus(start, end))
        for side in range(2):
            index, sign = side_of(row, side)
            if index >= 0:
                member = members[index]
                centre, velocity = vector_of(member['centre']), vector_of(member['velocity'])
                arm = minus(middle, along(centre, -0.5 * h, velocity))
                if row['two'] < 0:
                    expected = minus(vector_of(row['point']), centre)
                    twist = cross(minus(arm, expected), impulse)
                    put_vector(twists[index], plus(vector_of(twists[index]), twist))
                    arm = expected
                add_wrench_about(member['impulse'], ZERO, sign, arm, impulse, ZERO)
        for axis in range(3):
            row['positional'][axis] = row['force'][axis] * 2.0 / (h * h)
        put_vector(row['end_point'], end)
    for number in range(len(members)):
        member, twist = members[number], vector_of(twists[number])
        rate = applied(matrix_of(member['inverse_inertia']), twist)
        angle = 0.5 * h * norm(rate) / member['mass']
        share = min(LARGEST_TWIST / angle, 1.0) if angle > 0.0 else 1.0
        total = member['impulse'][1]
        put_vector(total, along(vector_of(total), share, twist))
    add_momenta(members)


@helper
def path_of(row: np.void, members: np.ndarray, particles: np.ndarray) -> tuple[Vector, Vector]:
    """
    Return where a contact was before the tick, and is after it, m.

    On the first side, which has the particle; of two edges midway between both sides.
    """
    start, end = start_of(row), moved(row, 0, members[row['one']], particles)
    if not row['of_edges']:
        return start, end
    other_end = moved(row, 1, members[row['two']], particles)
    other_start = plus(vector_of(row['point']), vector_of(row['offsets'][1]))
    other_start = minus(other_start, vector_of(row['other_motion']))
    return scaled(0.5, plus(start, other_start)), scaled(0.5, plus(end, other_end))


@helper
def begin_velocities(island: Island, problem: Problem) -> int:
    """
    Write the problem of velocities; its unknowns are the impulses p.

    Contacts without force take no part: those with come first, and their number is returned.
    """
    rows, jacobian, acting = problem.rows, problem.jacobian, 0
    members, particles, h = island.members, touched_particles(island, problem), island.h
    features = np.empty(QUADRATIC_FEATURES)
    for k in range(len(rows)):
        if not rows[k]['positional'][0] > 0.0 or touches_next(rows[k], island):
            continue
        if acting != k:
            copy_record(rows, acting, rows, k)
        row = rows[acting]
        if has_moved(row, members):
            end = vector_of(row['end_point'])
            put_jacobian(row, jacobian, acting, members, particles, end, True, features)
        elif acting != k:
            copy_jacobian(row, jacobian, acting, k, problem.counts)
        velocity = side_velocity(row, 0, members[row['one']], particles)
        if row['two'] >= 0:
            other = side_velocity(row, 1, members[row['two']], particles)
            velocity = minus(velocity, other)
        else:
            velocity = minus(velocity, vector_of(row['other_velocity']))
        normal, yielding = vector_of(row['normal']), 0.0
        mobility = own_mobility(row, problem.mobility)
        if mobility == 0.0 and not row['is_new']:
            # while the compliance yields, or recovers, the sides go on to approach, or to part
            before = 0.5 * h * h * max(dot(vector_of(row['remembered']), normal), 0.0)
            yielding = row['compliance'][0] * (row['force'][0] - before) / h
            least, most = min(row['closing'], 0.0), max(row['closing'], 0.0)
            yielding = min(max(yielding, least), most)
        row['bias'][0] = dot(normal, velocity) + row['elasticity'] * row['approach'] + yielding
        compliance = VELOCITY_COMPLIANCE * row['inverse_mass']
        share = PROXIMAL if is_shared(row, particles) else SOFT_VELOCITY_COMPLIANCE
        compliance += share * mobility
        if mobility > 0.0 or dot(normal, velocity) < 0.0:
            # not where the force of the positions is to be taken back
            compliance += compliance_of_pins(
                row, members, problem.mobility, jacobian, acting, problem.counts
            )
        row['compliance'][0] = row['compliance'][1] = compliance
        for axis in range(2):
            tangent = vector_of(row['tangents'][axis])
            row['free'][axis] = dot(tangent, velocity)
            row['bias'][1 + axis] = row['free'][axis]
        for axis in range(3):
            row['base'][axis] = h * row['positional'][axis]
            row['force'][axis] = 0.0
        acting += 1
    return acting


@helper
def touches_next(row: np.void, island: Island) -> bool:
    """
    Return whether a contact touches by no more than rounding what it will run into.

    Where two fingers meet a body at once, just at the end of a tick, one must not brake it then
    and the other one in the next.
    """
    if not row['is_new']:
        return False
    least = ROUNDING * island.scale
    displacement = row['force'][0] / island.members[row['one']]['mass']
    return displacement <= least and row['approach'] * island.h < -least


@helper
def side_velocity(row: np.void, side: int, member: np.void, particles: np.ndarray) -> Vector:
    """Return the velocity of one side of a contact after the tick, m/s."""
    if not member['is_soft']:
        arm = minus(vector_of(row['end_point']), end_centre(member))
        turning = cross(vector_of(member['end_angular_velocity']), arm)
        return plus(vector_of(member['velocity']), turning)
    result = ZERO
    for corner in range(4):
        share = share_of(row, side, corner)
        if share > 0.0:
            velocity = end_velocity(member, particles[row['particles'][corner]])
            result = along(result, share, velocity)
    return result


@helper
def has_moved(row: np.void, members: np.ndarray) -> bool:
    """
    Return whether forces have turned a side of a contact, or moved the contact on it.

    If not, as in rest, J is that of the positions.
    """
    for side in range(2):
        index, _ = side_of(row, side)
        if index >= 0:
            member = members[index]
            before = minus(vector_of(row['point']), vector_of(member['centre']))
            change = minus(minus(vector_of(row['end_point']), end_centre(member)), before)
            sine, scale = scaled(0.5, axial(matrix_of(member['rotation']))), member['scale']
            most = LINEARISED * LINEARISED
            if dot(change, change) > most * scale * scale or dot(sine, sine) > most:
                return True
    return False


@helper
def copy_jacobian(
    row: np.void, jacobian: np.ndarray, to: int, source: int, counts: np.ndarray
) -> None:
    """Copy J of one row to that of another one."""
    for side in range(2):
        index, _ = side_of(row, side)
        if index >= 0:
            for axis in range(3):
                line, other = line_of(to, side) + axis, line_of(source, side) + axis
                for mode in range(width_of(counts[index]) + 1):
                    jacobian[line, mode] = jacobian[other, mode]
