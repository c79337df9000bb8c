# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The first stage of contact: positions.

The forces f, constant over the tick, such that nothing penetrates at its end and nothing slides
that friction holds. With λ = h² f / 2 they displace a rigid body by λ / M, and change its velocity
by 2 λ / (h M); deformable ones, see `members`.

Contacts of rigid bodies have a compliance, 1 / (M ω²): it distributes forces over the particles of
a face, and bounds them where obstacles leave a body no room. Those of deformable ones have one for
the changes of their forces only, so that the problem is well conditioned where rows share
particles.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.body import QUADRATIC_FEATURES
from softbody_ros.core.collision.obstacle_contacts import SAME_SIDE, distance_on_side_of_entry
from softbody_ros.core.collision.shapes import MESH, PLANE
from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.energy import (
    any_tolerated,
    are_passive,
    parting_work,
    scale_forces,
    share_for,
    touches_obstacle,
)
from softbody_ros.core.contact.island import (
    Island,
    first_rows,
    is_large,
    is_unsolved,
    solved,
    touched_particles,
)
from softbody_ros.core.contact.members import (
    add_to_mean,
    angle_of,
    combination,
    end_base,
    end_centre,
    place,
    place_particles,
    put_modes,
)
from softbody_ros.core.contact.problem import (
    Problem,
    any_mobile,
    line_of,
    own_mobility,
    response_of,
)
from softbody_ros.core.contact.rows import (
    CONTACT_FREQUENCY,
    LINEARISED,
    copy_record,
    end_normal,
    flown,
    in_world,
    put_other_side,
    share_of,
    side_of,
)
from softbody_ros.core.contact.working_set import number_particles, take_closed
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    along,
    applied,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
    vector_of,
)

REMEMBERED = 0.95
"""Share of the force of the tick before to which the compliance of a rigid body has yielded
already: in rest the problem is solved as it is, and pressure becomes even in 20 ticks."""
ROUNDS, LARGE_ROUNDS, SELECTIONS = 4, 2, 4
"""Linearisations of the positions, at most, and of islands too large for Newton's method; and how
many more while contacts that had been left out join."""
SHRINKING, SMALL = 0.9, 0.2
"""Ratio of overlaps with obstacles, from one linearisation to the next, up to which there is room:
where there is none they are as large, or spread out over both sides. And their ratio to errors
between bodies, up to which these may be what makes them grow."""
STIFFER = 0.125
"""Ratio of the compliances of contacts of rigid bodies with obstacles, from one linearisation to
the next: so overlaps vanish soon, those too that only a rotation with little leverage takes away.
Not of bodies with each other, which may have been put into each other."""
SHIFTS, LARGEST_SHIFT, CORNER_SHIFT = 3, 1e-3, 0.05
"""Passes in which bodies are shifted out of obstacles in the end, and how far, in RMS radii: at
most, and particles at another side than that of their contact."""
CORNER_PASSES = 2
"""Searches for contacts of particles with another side."""
OTHER_SIDE = 0.5
"""Ratio of the depths of a particle below the side of its contact and below the nearest one, up to
which they differ."""
LARGEST_TURN = 0.5
"""Angle, rad, by which contacts turn bodies in a tick, where they may do any work."""
WILD = 0.5
"""Error by linearisation, in RMS radii, above which the positions are not linearised again; and
displacement of a body that is not small."""
TOLERANCE, SOFT_TOLERANCE, SINGLE_TOLERANCE = 1e-11, 1e-10, 1e-8
"""Of displacements, in RMS radii; of velocities the same over the tick. The second one of islands
with deformable bodies, the third one of a deformable body alone: where there is no other, the
result need not be the same for any order of bodies."""
LEAST_MOBILITY = 0.25
"""Of a contact with pins below which it fades: relative to that of its free particle that yields
most; of a rigid body along the normal, relative to that in all directions."""
LEAST_LEVER = 0.2
"""Of a contact of a rigid body about the axis of its pins, in RMS radii, below which it fades."""
PROXIMAL = 0.1
"""Compliance of contacts of deformable bodies that share particles, for changes of forces and for
velocities, relative to the response of their particles."""


@helper
def solve_positions(island: Island, working: int) -> tuple[Problem, bool]:
    """
    Find the forces, constant over the tick, by which nothing penetrates at its end.

    The problem is linearised anew where contacts have turned, and contacts that had waited join
    where they are closed.

    Parameters
    ----------
    island : Island
        displacements are written
    working : int
        number of contacts that take part at first

    Returns
    -------
    problem : Problem
        of the contacts that take part in the end, solved
    has_room : bool
        whether overlaps of rigid bodies with obstacles shrink from round to round

    """
    members, rows, linearised = island.members, island.problem.rows, LINEARISED * island.scale
    tolerance, is_rough = tolerance_of(island), may_be_rough(island)
    problem = begin_positions(island, 0, 0, working)
    last, has_room = math.inf, True
    rounds, selections = LARGE_ROUNDS if is_large(island) else ROUNDS, SELECTIONS
    while rounds > 0:
        residual = solved(problem, tolerance, island, is_rough)
        particles = touched_particles(island, problem)
        place_all(members, particles, problem)
        before = working
        working = take_closed(
            members, particles, island.rows, island.waiting, island.flight, rows, working
        )
        joins = working > before
        if joins:
            problem = begin_positions(island, len(particles), before, working)
            particles = touched_particles(island, problem)
        error, overlap = linearise(members, particles, problem)
        shrinks = overlap <= max(SHRINKING * last, SMALL * error, linearised)
        # but for pins they may be left since no solution was found in time
        is_late = not island.is_held and residual > tolerance
        has_room = last == math.inf or joins or shrinks or is_late
        is_linear = error <= linearised and not joins
        if is_linear and is_rough and residual > tolerance:
            is_rough = False
            continue
        if is_linear or not has_room:
            break
        if error > WILD * island.scale:
            # linearised so far away, the next solution would be farther away
            break
        stiffen(problem)
        last = overlap
        if joins and selections > 0:
            selections -= 1
        else:
            rounds -= 1
        is_rough = is_rough and rounds > 1
    return problem, has_room


@helper
def tolerance_of(island: Island) -> float:
    """Return the tolerance of displacements, m; divided by the tick it is that of velocities."""
    if not island.is_soft:
        return TOLERANCE * island.scale
    return (SOFT_TOLERANCE if len(island.members) > 1 else SINGLE_TOLERANCE) * island.scale


@helper
def may_be_rough(island: Island) -> bool:
    """
    Return whether what is solved again may be solved roughly before.

    Only in islands that are not solved to tolerance anyway: linearised at a rough solution, the
    result of others would depend on the order of bodies by more than that.
    """
    return island.is_soft and is_large(island)


@helper
def add_corners(island: Island, problem: Problem) -> Problem:
    """Let contacts of particles with another side of an obstacle join, see `find_corners`."""
    members = island.members
    for _ in range(CORNER_PASSES):
        working, found = len(problem.rows), find_corners(island, problem)
        if found == working:
            break
        problem = begin_positions(island, len(problem.mobility), working, found)
        particles = touched_particles(island, problem)
        linearise(members, particles, problem)
        for turn in range(2):
            solved(problem, tolerance_of(island), island, turn == 0 and may_be_rough(island))
            place_all(members, particles, problem)
            linearise(members, particles, problem)
    return problem


@helper
def yield_to_obstacles(island: Island, problem: Problem) -> None:
    """Leave overlaps as they are, of bodies without room, with the forces of their compliance."""
    for row in problem.rows:
        if is_of_rigid_body_and_obstacle(row, problem):
            row['compliance'][0] = compliance_of(row, island.h) + row['lasting']
        row['bias'][0] = row['linear_gap']
    solved(problem, tolerance_of(island), island, False)
    place_all(island.members, touched_particles(island, problem), problem)


@helper
def brake(island: Island, problem: Problem) -> None:
    """
    Take a share of the forces that does bounded work, where they may do any.

    Forces are no solution where none was found in time; and those that move bodies by more than is
    small do another work than J says, as on what is inside something. Any share of them keeps
    momentum and angular momentum, and what is not kept apart gets out later.
    """
    members, rows, y = island.members, problem.rows, problem.modes[0]
    turn, is_far, most = 0.0, False, 0.0
    for number in range(len(members)):
        member = members[number]
        turn = max(turn, norm(angle_of(member, y[number])))
        is_far = is_far or norm(vector_of(member['shift'])) > WILD * member['scale']
        most += parting_work(member)
    tangled = is_unsolved(island) or any_tolerated(rows)
    if not (tangled or is_far or turn > LARGEST_TURN) or not are_passive(members, rows):
        return
    share = LARGEST_TURN / turn if tangled and turn > LARGEST_TURN else 1.0
    by_flight, by_speed, by_response = work_of(island, problem)
    share = min(share, share_for(by_flight, by_response, most))
    share = min(share, share_for(by_speed, by_response, most))
    if share < 1.0:
        scale_forces(problem, share)
        particles = touched_particles(island, problem)
        place_all(members, particles, problem)
        linearise(members, particles, problem)
    if tangled and (turn > LARGEST_TURN or share < 1.0) and touches_obstacle(rows):
        # angular momentum is not kept anyway; and what is thin would get energy as it turns
        for number in range(len(members)):
            momentum = members[number]['angular_momentum']
            turned = applied(matrix_of(members[number]['rotation']), vector_of(momentum))
            put_vector(momentum, turned)


@helper
def work_of(island: Island, problem: Problem) -> tuple[float, float, float]:
    """
    Return the work of contacts, as far as the response is linear, J.

    Along the displacements of the flight, along them as they would be at its last speed, and along
    the response.
    """
    h = island.h
    rows, is_mobile = problem.rows, any_mobile(problem)
    by_flight = by_speed = by_response = 0.0
    for k in range(len(rows)):
        row, response = rows[k], response_of(problem, k, is_mobile)
        force = vector_of(row['force'])
        motion = minus(vector_of(row['motion']), vector_of(row['other_motion']))
        along_flight = dot(in_world(row, force), motion)
        by_flight += along_flight
        # normal speeds are known; tangential ones are the mean ones
        along_flight -= force[0] * dot(vector_of(row['normal']), motion)
        by_speed += along_flight - force[0] * h * row['closing']
        by_response += dot(force, response)
    factor = 2.0 / (h * h)
    return factor * by_flight, factor * by_speed, factor * by_response


# ----------------------------------------------------------------------------------- linearisation
@helper
def begin_positions(island: Island, known: int, first: int, working: int) -> Problem:
    """
    Write rows of the problem of positions; its unknowns are λ = h² f / 2.

    Parameters
    ----------
    island : Island
        particles are written
    known, first, working : int
        number of particles before, and of rows before and now

    Returns
    -------
    Problem
        that of the rows that take part

    """
    members, particles, whole, h = island.members, island.particles, island.problem, island.h
    rows, jacobian, features = whole.rows, whole.jacobian, np.empty(QUADRATIC_FEATURES)
    touched = number_particles(members, rows[first:working], island.flight, particles, known)
    for k in range(known, touched):
        whole.mobility[k] = particles[k]['mobility']
        for axis in range(3):
            whole.shifts[0, axis, k] = 0.0
    for k in range(first):
        row = rows[k]
        if not row['shares_particles'] and is_shared(row, particles):
            # for changes from here on only
            added = PROXIMAL * own_mobility(row, whole.mobility)
            row['shares_particles'] = True
            for axis in range(3):
                row['bias'][axis] -= added * row['force'][axis]
            for which in range(2):
                row['compliance'][which] += added
    for k in range(first, working):
        row, point = rows[k], vector_of(rows[k]['point'])
        put_jacobian(row, jacobian, k, members, particles, point, False, features)
        mobility = own_mobility(row, whole.mobility)
        if mobility == 0.0 and row['inverse_mass'] == 0.0:
            # between pinned particles
            row['inverse_mass'] = 1.0 / members[row['one']]['mass']
        compliance = compliance_of(row, h)
        row['shares_particles'] = is_shared(row, particles)
        if row['shares_particles']:
            compliance += PROXIMAL * mobility
        row['lasting'] = compliance_of_pins(
            row, members, whole.mobility, jacobian, k, whole.counts
        )
        row['compliance'][0] = row['compliance'][1] = compliance + row['lasting']
        start = scaled(0.5 * h * h, vector_of(row['remembered']))
        row['bias'][0] = row['linear_gap'] = row['gap']
        row['force'][0] = max(dot(start, vector_of(row['normal'])), 0.0)
        # for changes of the force only, but that pressure becomes even in time
        share = 1.0 if mobility > 0.0 else REMEMBERED
        row['bias'][0] -= share * compliance * row['force'][0]
        for axis in range(2):
            along_tangent = dot(start, vector_of(row['tangents'][axis]))
            row['force'][1 + axis] = along_tangent
            # the compliance has yielded already
            row['bias'][1 + axis] = row['slip'][axis] - compliance * along_tangent
            row['free'][axis] = row['slip'][axis]
        for axis in range(3):
            row['base'][axis] = 0.0
    return first_rows(whole, working, touched)


@helper
def compliance_of(row: np.void, h: float) -> float:
    """Return the compliance of a contact of rigid bodies, 1 / (M ω²), to λ = h² f / 2."""
    return (
        row['softness'] * row['inverse_mass'] * 2.0
        / (h * h * CONTACT_FREQUENCY * CONTACT_FREQUENCY)
    )  # fmt: skip


@helper
def is_of_rigid_body_and_obstacle(row: np.void, problem: Problem) -> bool:
    """Return whether a contact is one whose compliance is lessened, see STIFFER."""
    return row['two'] < 0 and own_mobility(row, problem.mobility) == 0.0


@helper
def stiffen(problem: Problem) -> None:
    """Lessen the compliances of contacts of rigid bodies with obstacles, see STIFFER."""
    for row in problem.rows:
        if is_of_rigid_body_and_obstacle(row, problem):
            row['compliance'][0] = STIFFER * (row['compliance'][0] - row['lasting'])
            row['bias'][0] = row['linear_gap'] - row['compliance'][0] * row['force'][0]
            row['compliance'][0] += row['lasting']


@helper
def put_jacobian(
    row: np.void,
    jacobian: np.ndarray,
    k: int,
    members: np.ndarray,
    particles: np.ndarray,
    point: Vector,
    at_end: bool,
    features: np.ndarray,
) -> None:
    """
    Write J of row k: responses of the modes to unit forces along normal and tangents.

    Parameters
    ----------
    row : ROW
    jacobian : (6 k, width of M + 1) float
        written: its lines
    k : int
    members, particles : (m,) MEMBER, (p,) PARTICLE
    point : vector
        m
    at_end : bool
        whether at the pose after the tick, instead of after the flight
    features : (9,) float
        scratch

    """
    for side in range(2):
        index, sign = side_of(row, side)
        if index < 0:
            continue
        member = members[index]
        if member['is_soft']:
            put_features(row, side, particles, features)
        arm = minus(point, end_centre(member) if at_end else vector_of(member['centre']))
        put_modes(jacobian, line_of(k, side), member, sign, arm, features, row, at_end)
    if row['one'] == row['two']:
        # self-collision: both sides are the same modes
        for axis in range(3):
            line, other = line_of(k, 0) + axis, line_of(k, 1) + axis
            for mode in range(jacobian.shape[1]):
                jacobian[line, mode] += jacobian[other, mode]
                jacobian[other, mode] = 0.0


@helper
def put_features(row: np.void, side: int, particles: np.ndarray, features: np.ndarray) -> None:
    """Write the features at one side of a contact."""
    for k in range(len(features)):
        features[k] = 0.0
    for corner in range(4):
        share = share_of(row, side, corner)
        if share > 0.0:
            own = particles[row['particles'][corner]]['features']
            for k in range(len(features)):
                features[k] += share * own[k]


@helper
def is_shared(row: np.void, particles: np.ndarray) -> bool:
    """Return whether other contacts act on a particle of a contact, too."""
    for corner in range(4):
        if row['shares'][corner] != 0.0 and particles[row['particles'][corner]]['rows'] > 1:
            return True
    return False


@helper
def compliance_of_pins(
    row: np.void,
    members: np.ndarray,
    mobility: np.ndarray,
    jacobian: np.ndarray,
    k: int,
    counts: np.ndarray,
) -> float:
    """
    Return a compliance of a contact where pins leave its sides next to no way out.

    By itself, a free corner of a face with a small share would have to move as many times as far
    as the face overlaps, if what touches cannot get out of the way: an obstacle, or a body with
    pins, too. So would a rigid body that pins let turn only, if the normal all but points to its
    axis, or the contact is next to that. So a contact fades whose free corner has less than half
    of it, so that none moves more than twice as far as it overlaps, or whose normal is more than
    60° off the way that the point can go. Where nothing can move there is no contact.
    """
    for side in range(2):
        index, _ = side_of(row, side)
        if index >= 0 and not members[index]['has_pins']:
            return 0.0
    largest, is_pinned, is_rigid = 0.0, False, True
    for corner in range(4):
        if row['shares'][corner] != 0.0:
            own = mobility[row['particles'][corner]]
            largest, is_pinned = max(largest, own), is_pinned or own == 0.0
            is_rigid = False
    if not (is_pinned or is_rigid):
        return 0.0
    own = own_mobility(row, mobility)
    least = LEAST_MOBILITY * largest
    if is_rigid:
        own, one, two = own_response(row, jacobian, k, counts)
        least = LEAST_MOBILITY * (own + one + two)
        for side in range(2):
            index, _ = side_of(row, side)
            if index >= 0:
                least = max(least, LEAST_LEVER * LEAST_LEVER * turning_response(members[index]))
    return (least - own) * least / own if 0.0 < own < least else 0.0


@helper
def turning_response(member: np.void) -> float:
    """Return the response of a body that only turns, one RMS radius from its axis, 1/kg."""
    inverse = member['inverse_inertia']
    squared = inverse[0, 0] + inverse[1, 1] + inverse[2, 2]
    return squared * member['scale'] * member['scale'] / member['mass']


@helper
def own_response(row: np.void, jacobian: np.ndarray, k: int, counts: np.ndarray) -> Vector:
    """Return the responses of the modes to a force of one row, along normal and tangents."""
    response = ZERO
    for side in range(2):
        index, _ = side_of(row, side)
        if index >= 0:
            line = line_of(k, side)
            for mode in range(counts[index]):
                n, one = jacobian[line, mode], jacobian[line + 1, mode]
                two = jacobian[line + 2, mode]
                response = plus(response, (n * n, one * one, two * two))
    return response


@helper
def place_all(members: np.ndarray, particles: np.ndarray, problem: Problem) -> None:
    """Write the displacements of bodies, and of particles, by λ."""
    place(members, problem.modes[0])
    place_particles(members, particles, problem.shifts[0])


@helper
def linearise(
    members: np.ndarray,
    particles: np.ndarray,
    problem: Problem,
) -> tuple[float, float]:
    """
    Correct the problem by what is not linear, and by overlaps.

    The compliance acts on the change of the force from then on, so that overlaps vanish round by
    round, unless obstacles leave no room: that bounds the forces all the same.

    Returns
    -------
    error : float
        largest of overlaps and of errors by linearisation, m
    overlap : float
        largest one of rigid bodies with obstacles, m

    """
    is_mobile, error, overlap = any_mobile(problem), 0.0, 0.0
    for k in range(len(problem.rows)):
        row, motion = problem.rows[k], response_of(problem, k, is_mobile)
        gap = end_gap(row, members, particles)
        if row['force'][0] > 0.0 or gap < 0.0:
            error = max(error, abs(row['linear_gap'] + motion[0] - gap), -gap)
            if row['two'] < 0 and row['inverse_mass'] > 0.0:
                overlap = max(overlap, -gap)
        row['end_gap'], row['linear_gap'] = gap, gap - motion[0]
        changes = row['compliance'][0] - row['lasting']
        row['bias'][0] = row['linear_gap'] - changes * row['force'][0]
    return error, overlap


@helper
def end_gap(row: np.void, members: np.ndarray, particles: np.ndarray) -> float:
    """Return the gap of a contact after the tick, m."""
    point = vector_of(row['point'])
    apart = minus(moved(row, 0, members[row['one']], particles), point)
    apart = minus(apart, vector_of(row['offsets'][0]))
    if row['two'] >= 0:
        two = members[row['two']]
        apart = minus(apart, minus(moved(row, 1, two, particles), point))
        apart = plus(apart, vector_of(row['offsets'][1]))
    return row['gap'] + dot(end_normal(row, members), apart)


@helper
def moved(row: np.void, side: int, member: np.void, particles: np.ndarray) -> Vector:
    """Return where the point of a contact is after the tick, as part of one side, m."""
    point = vector_of(row['point'])
    arm, own = minus(point, vector_of(member['centre'])), ZERO
    if member['is_soft']:
        arm = plus(arm, vector_of(row['offsets'][side]))
        for corner in range(4):
            share = share_of(row, side, corner)
            if share > 0.0:
                particle = particles[row['particles'][corner]]
                deformed = combination(member['fit'], particle['features'], member['features'])
                arm = along(arm, share, deformed)
                own = along(own, share, vector_of(particle['shift']))
    return plus(plus(end_base(member), applied(matrix_of(member['rotation']), arm)), own)


# ------------------------------------------------------------------------ other sides of obstacles
@helper
def find_corners(island: Island, problem: Problem) -> int:
    """
    Append contacts of particles that end up inside an obstacle, at another side of it.

    In the corner of a bin, a particle touches both walls. Returned is the number of rows.
    """
    members, particles = island.members, touched_particles(island, problem)
    room, obstacles, scale = island.problem.rows, island.obstacles, island.scale
    working = len(problem.rows)
    found = working
    for k in range(working):
        row = room[k]
        if row['two'] >= 0 or row['column'] < 0 or not members[row['one']]['is_soft']:
            continue
        obstacle = obstacles[row['obstacle']]
        if obstacle['kind'] == PLANE or found == len(room):
            continue
        if is_beyond_convex(obstacle, row['end_gap'], -LINEARISED * scale):
            continue
        end = moved(row, 0, members[row['one']], particles)
        distance, outwards = distance_on_side_of_entry(
            obstacle, island.trees, start_of(row), end, row['thickness']
        )
        gap = distance - row['thickness'] + row['tolerated']
        if gap > -LINEARISED * scale or end_gap(row, members, particles) < OTHER_SIDE * gap:
            continue
        copy_record(room, found, room, k)
        put_other_side(room[found], outwards, gap, end)
        found += 1
    return found


@helper
def separate(island: Island, problem: Problem) -> None:
    """
    Shift bodies, or single particles, out of obstacles by what is left of overlaps.

    That is next to nothing, but where a particle has met another side of an obstacle, as in the
    corner of a bin.
    """
    members, particles, rows = island.members, touched_particles(island, problem), problem.rows
    obstacles, trees, scale = island.obstacles, island.trees, island.scale
    moved_on = False
    for _ in range(SHIFTS):
        shifted = False
        for k in range(len(rows)):
            row = rows[k]
            if row['two'] >= 0:
                continue
            member = members[row['one']]
            most = (CORNER_SHIFT if member['is_soft'] else LARGEST_SHIFT) * scale
            normal, gap = vector_of(row['normal']), row['end_gap']
            if moved_on:
                gap = end_gap(row, members, particles)
            if row['of_face']:
                normal = applied(matrix_of(member['rotation']), normal)
            if row['column'] >= 0 and obstacles[row['obstacle']]['kind'] != PLANE:
                if is_beyond_convex(obstacles[row['obstacle']], gap, 0.0):
                    continue
                # it may be round
                place_now = moved(row, 0, member, particles)
                distance, outwards = distance_on_side_of_entry(
                    obstacles[row['obstacle']], trees, start_of(row), place_now, row['thickness']
                )
                nearest = distance - row['thickness'] + row['tolerated']
                if (member['is_soft'] and nearest < OTHER_SIDE * gap) or dot(
                    outwards, normal
                ) > SAME_SIDE:
                    gap, normal = nearest, outwards
            if -most < gap < 0.0:
                if member['is_soft'] and row['column'] >= 0:
                    particle = particles[row['particles'][0]]
                    # one that no other contact acts on changes no other gap
                    shifted = shifted or particle['rows'] > 1
                    if particle['mobility'] > 0.0:
                        move = scaled(-gap, normal)
                        add_to_mean(member, 0, particle['weight'], move)
                        put_vector(particle['shift'], plus(vector_of(particle['shift']), move))
                elif not member['has_pins']:
                    add_shift(member['shift'], -gap, normal)
                    shifted = True
                moved_on = moved_on or shifted
        if not shifted:
            break


@helper
def add_shift(shift: np.ndarray, distance: float, direction: Vector) -> None:
    """Add a distance in a direction, m."""
    put_vector(shift, along(vector_of(shift), distance, direction))


@helper
def is_beyond_convex(obstacle: np.void, gap: float, limit: float) -> bool:
    """
    Return whether the distance from an obstacle is over a limit for certain, m.

    From one that is convex, it is at least the gap from the plane of a contact with it.
    """
    return obstacle['kind'] != MESH and gap > limit


@helper
def start_of(row: np.void) -> Vector:
    """Return where the first side of a contact was before the tick, m."""
    return minus(flown(row), vector_of(row['motion']))
