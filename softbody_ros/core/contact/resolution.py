# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of bodies with obstacles, points and each other: one problem for all of an island.

Two stages, both solved by `solver`. First positions: the forces f, constant over the tick, such
that nothing penetrates at its end and nothing slides that friction holds. With λ = h² f / 2 they
displace a rigid body by λ / M, and change its velocity by 2 λ / (h M); deformable ones, see
`members`. Then velocities: impulses p at
the end of the tick, such that contacts separate with ε times the speed of approach, and stick or
slide within the cone of all of the tick's impulse, h f + p. In rest p = 0, and f is the weight.

Contacts of rigid bodies have a compliance, 1 / (M ω²): it distributes forces over the particles of
a face, and bounds them where obstacles leave a body no room. Those of deformable ones have one for
the changes of their forces only, so that the problem is well conditioned where rows share
particles.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.body import QUADRATIC_FEATURES
from softbody_ros.core.collision.obstacle_contacts import (
    distance_on_side_of_entry,
)
from softbody_ros.core.collision.shapes import MESH, PLANE
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.energy import (
    GAIN,
    all_still,
    any_driven,
    any_impact,
    any_inside,
    energy_after,
    keep_energy,
    keep_motion,
    kinetic_energy,
    largest_energy,
    rebound,
    work_of_loads,
)
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.members import (
    RIGID_MODES,
    add_impulses,
    add_momenta,
    add_to_mean,
    add_velocities,
    begin_impulses,
    change_map,
    combination,
    end_base,
    end_centre,
    end_velocity,
    place,
    place_particles,
    put_modes,
    put_rotation,
    start_velocities,
)
from softbody_ros.core.contact.problem import (
    Problem,
    line_of,
    mode_response,
    own_mobility,
    particle_response,
    width_of,
)
from softbody_ros.core.contact.rows import (
    CONTACT_FREQUENCY,
    LINEARISED,
    MEMORY,
    copy_record,
    end_normal,
    flown,
    in_world,
    put_other_side,
    share_of,
    side_of,
)
from softbody_ros.core.contact.solver import LARGEST_ISLAND, solve
from softbody_ros.core.contact.working_set import (
    SPARE,
    Flight,
    find_working_set,
    number_particles,
    sort_into_islands,
    take_closed,
)
from softbody_ros.core.contact.workspace import Workspace, for_islands, jacobian_of
from softbody_ros.core.geometry.bounding_boxes import sort_indices
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    ZERO,
    Vector,
    along,
    applied,
    axial,
    column_of,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_column,
    put_matrix,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.lanes import LANES, put_vectors, vectors_at
from softbody_ros.core.shape_matching.flight_map import (
    write,
)
from softbody_ros.core.shape_matching.rigid_motion import put_motion

VELOCITY_COMPLIANCE = 1e-4
"""Compliance of contacts for velocities, relative to the inverse mass."""
RELEASED = 1e-12
"""Force, relative to that of the positions, that is rounding: the contact has ended."""
REMEMBERED = 0.95
"""Share of the force of the tick before to which the compliance of a rigid body has yielded
already: in rest the problem is solved as it is, and pressure becomes even in 20 ticks."""
ROUNDS, LARGE_ROUNDS, SELECTIONS = 4, 2, 4
"""Linearisations of the positions, at most, and of islands too large for Newton's method; and how
many more while contacts that had been left out join."""
LARGEST_TWIST = 0.01
"""Rotation by moments that J does not contain, rad, at most."""
SHIFTS, LARGEST_SHIFT, CORNER_SHIFT = 3, 1e-3, 0.05
"""Passes in which bodies are shifted out of obstacles in the end, and how far, in RMS radii: at
most, and particles at another side than that of their contact."""
CORNERS = 2
"""Searches for contacts of particles with another side."""
SAME_SIDE, OTHER_SIDE = 0.5, 0.5
"""Cosine between normals of the same side of an obstacle; and ratio of the depths of a particle
below the side of its contact and below the nearest one, up to which they differ."""
TOLERANCE, SOFT_TOLERANCE, SINGLE_TOLERANCE = 1e-11, 1e-10, 1e-8
"""Of displacements, in RMS radii; of velocities the same over the tick. The second one of islands
with deformable bodies, the third one of a deformable body alone: where there is no other, the
result need not be the same for any order of bodies."""
PROXIMAL, SOFT_VELOCITY_COMPLIANCE = 0.1, 0.01
"""Compliance of contacts of deformable bodies, relative to the response of their particles: of
those that share particles, for changes of forces and for velocities, and of others for
velocities."""


@kernel
def resolve(
    bodies: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    flown: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    h: float,
    members: np.ndarray,
    rows: np.ndarray,
    place_of: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
    work: np.ndarray,
    is_pinned: np.ndarray,
    workspace: Workspace,
) -> tuple[np.ndarray, bool]:
    """
    Move bodies by the forces of their contacts, from the flight to the end of the tick.

    Parameters
    ----------
    bodies, shapes, weights, x, v, flown, obstacles, trees, h, members
        see `detection.find_rows`
    q : (3, M) float
        rest positions of the particles of all rest shapes, and goals, see `State`
    rows : (k,) ROW
        all contacts
    place_of : (N,) int
        scratch of −1, and so again after that
    obstacle_impulse, normal_impulse
        results, see `exchange`
    work : (3,) int
        added to: Gauss–Seidel sweeps, Newton steps, problems that are not solved to tolerance
    is_pinned : (N,) bool
        see `find_rows`
    workspace : Workspace

    Returns
    -------
    memory : (r,) MEMORY
        forces to remember, in order of their keys
    is_far : bool
        whether contacts with other bodies have displaced some body farther than it has looked for
        others: as said in its record

    """
    count, status = len(members), np.empty(len(rows), np.int64)
    left = find_working_set(members, rows, obstacles, status)
    workspace = for_islands(workspace, left)
    island, own, waiting = np.empty(count, np.int64), workspace.own, workspace.waiting
    first_body, first_row = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    inside, local = np.empty(count, members.dtype), np.empty(count, np.int64)
    working, first_waiting = np.zeros(count, np.int64), np.zeros(count + 1, np.int64)
    sort_into_islands(
        members, rows, status, island, first_body, first_row, inside, local, own, working,
        first_waiting, waiting,
    )  # fmt: skip
    remembered = np.empty(SPARE * left, MEMORY)
    flight = Flight(bodies, shapes, weights, q, v, flown, is_pinned, place_of)
    kept, is_far = 0, False
    for root in range(count):
        first, last = first_row[root], first_row[root]
        together = inside[first_body[root] : first_body[root + 1]]
        particles, meets = workspace.particles[:0], first < first_row[root + 1]
        if meets:
            acting, touched = resolve_island(
                together, own[first : first_row[root + 1]], working[root], rows,
                waiting[first_waiting[root] : first_waiting[root + 1]], flight, obstacles,
                trees, h, work, workspace,
            )  # fmt: skip
            last, particles = first + acting, workspace.particles[:touched]
        for k in range(first, last):
            row = own[k]
            if row['key'] >= 0:
                remembered[kept]['key'] = row['key']
                put_vector(remembered[kept]['force'], in_world(row, row['positional']))
                remembered[kept]['tolerated'] = row['tolerated']
                remembered[kept]['gap'] = row['gap']
                kept += 1
            receive(together, row, h)
            number = together[row['one']]['body']
            exchange(row, bodies[number], number, obstacles, h, obstacle_impulse, normal_impulse)
            if row['two'] >= 0:
                press(row, 1, bodies[together[row['two']]['body']], h, normal_impulse)
        for k in range(len(together)):
            member = together[k]
            body = bodies[member['body']]
            if member['is_soft']:
                if member['starts']:
                    shape = shapes[body['shape']]
                    write_soft_body(body, shape, member, q, x, v, meets)
            elif meets:
                if len(together) > 1:
                    put_flown(body, x[1 - body['now']], flown)
                write_body(body, member, x, v)
        for particle in particles:
            write_particle(particle, together, bodies, x, v)
            place_of[particle['column']] = -1
        if meets and len(together) > 1:
            for member in together:
                body = bodies[member['body']]
                way = displacement(body, x[1 - body['now']], flown)
                if way > member['nearby']:
                    body['displaced'], is_far = way, True
    return in_order(remembered[:kept]), is_far


@helper
def put_flown(body: np.void, x: np.ndarray, flown: np.ndarray) -> None:
    """Keep the positions (3, N) of the surface of a rigid body after its flight."""
    for axis in range(3):
        for i in range(body['first'], body['first'] + body['surface']):
            flown[axis, i] = x[axis, i]


@helper
def displacement(body: np.void, x: np.ndarray, flown: np.ndarray) -> float:
    """Return how far contacts have displaced the surface of a body from its flight, m."""
    square = 0.0
    for i in range(body['first'], body['first'] + body['surface']):
        way = minus(column_of(x, i), column_of(flown, i))
        square = max(square, dot(way, way))
    return math.sqrt(square)


@helper
def in_order(remembered: np.ndarray) -> np.ndarray:
    """Return MEMORYs in order of their keys."""
    keys, order = np.empty(len(remembered), np.int64), np.empty(len(remembered), np.int64)
    for k in range(len(remembered)):
        keys[k] = remembered[k]['key']
    sort_indices(keys, order)
    memory = np.empty_like(remembered)
    for k in range(len(memory)):
        memory[k] = remembered[order[k]]
    return memory


@helper
def write_soft_body(
    body: np.void,
    shape: np.void,
    member: np.void,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    touched: bool,
) -> None:
    """Write the particles of a deformable body after the tick, but for residuals."""
    now = body['now']
    if touched:
        change_map(body, shape, member)
        put_end(body, member)
    write(x[now], v[now], body, shape, q, x[1 - now], v[1 - now])


@helper
def write_particle(
    particle: np.void,
    members: np.ndarray,
    bodies: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
) -> None:
    """Add what a particle at a contact does by itself."""
    member, column = members[particle['member']], particle['column']
    half = 1 - bodies[member['body']]['now']
    shift, rate = vector_of(particle['shift']), vector_of(member['end_angular_velocity'])
    velocity = plus(vector_of(particle['velocity']), cross(rate, shift))
    put_column(x[half], column, plus(column_of(x[half], column), shift))
    put_column(v[half], column, plus(column_of(v[half], column), velocity))


@helper
def receive(members: np.ndarray, row: np.void, h: float) -> None:
    """Add the impulse of a contact, and its moment about the centres after the tick."""
    point, force = vector_of(row['end_point']), in_world(row, row['force'])
    for side in range(2):
        index, sign = side_of(row, side)
        if index >= 0:
            member = members[index]
            centre = end_centre(member)
            add_wrench_about(member['received'], centre, sign * h, point, force, ZERO)


@helper
def exchange(
    row: np.void,
    body: np.void,
    number: int,
    obstacles: np.ndarray,
    h: float,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """Add what a contact exchanges in the tick, see `contact.exchange`."""
    half, which = 1 - body['now'], row['obstacle']
    press(row, 0, body, h, normal_impulse)
    if which >= 0:
        # points, the last row, have no origin of their own
        origin = vector_of(obstacles[which]['position']) if which < len(obstacles) else ZERO
        add_wrench_about(
            obstacle_impulse[number, half, which], origin, -h, vector_of(row['end_point']),
            in_world(row, row['force']), ZERO,
        )  # fmt: skip


@helper
def press(row: np.void, side: int, body: np.void, h: float, normal_impulse: np.ndarray) -> None:
    """Mark that a contact acts on the body of one side, and add its normal impulse there."""
    half, force = 1 - body['now'], row['force'][0]
    body['touches'][half] = 1
    if side == 0 and row['column'] >= 0:
        normal_impulse[half, row['column']] += h * force
    else:
        for corner in range(4):
            share = share_of(row, side, corner)
            if share > 0.0:
                normal_impulse[half, row['columns'][corner]] += share * h * force


@helper
def resolve_island(
    members: np.ndarray,
    room: np.ndarray,
    working: int,
    rows: np.ndarray,
    waiting: np.ndarray,
    flight: Flight,
    obstacles: np.ndarray,
    trees: Trees,
    h: float,
    work: np.ndarray,
    workspace: Workspace,
) -> tuple[int, int]:
    """
    Resolve the contacts of one island: positions, then velocities.

    Parameters
    ----------
    members : (m,) MEMBER
    room : (r,) ROW
        the contacts that take part, and room for more
    working : int
        number of contacts that take part
    rows, waiting : (k,) ROW, (w,) OPEN
        all contacts, and those that wait: written
    flight, obstacles, trees, h, work, workspace
        see `resolve`

    Returns
    -------
    acting, touched : int
        number of contacts that act, the first ones then; and of particles

    """
    scale, mass, is_soft = members[0]['scale'], members[0]['mass'], False
    for member in members:
        scale, mass = min(scale, member['scale']), min(mass, member['mass'])
        is_soft = is_soft or member['is_soft']
        put_vector(member['shift'], ZERO)
        put_matrix(member['rotation'], IDENTITY)
        put_vector(member['received'][0], ZERO)
        put_vector(member['received'][1], ZERO)
    tolerance = TOLERANCE * scale
    if is_soft:
        tolerance = (SOFT_TOLERANCE if len(members) > 1 else SINGLE_TOLERANCE) * scale
    linearised = LINEARISED * scale
    all_particles, whole = workspace.particles, new_problem(members, room, workspace)
    problem = begin_positions(members, all_particles, flight, whole, 0, 0, working, h)
    particles = all_particles[: len(problem.mobility)]
    last, has_room, unsolved = math.inf, True, work[2]
    energy = kinetic_energy(members)
    is_large = len(whole.filled) < len(members)
    rounds, selections = LARGE_ROUNDS if is_large else ROUNDS, SELECTIONS
    while rounds > 0:
        residual, sweeps, steps = solve(problem, tolerance, mass)
        work[0], work[1] = work[0] + sweeps, work[1] + steps
        work[2] += residual > tolerance
        place_all(members, particles, problem)
        before = working
        working = take_closed(members, particles, rows, waiting, flight, room, working)
        joins = working > before
        if joins:
            problem = begin_positions(
                members, all_particles, flight, whole, len(particles), before, working, h
            )
            particles = all_particles[: len(problem.mobility)]
        error, overlap = linearise(members, particles, problem)
        shrinks = overlap <= max(0.5 * last, linearised)
        has_room = last == math.inf or joins or shrinks or residual > tolerance
        if (error <= linearised and not joins) or not has_room:
            break
        last = overlap
        if joins and selections > 0:
            selections -= 1
        else:
            rounds -= 1
    if has_room and is_soft:
        for _ in range(CORNERS):
            found = find_corners(members, particles, room, working, obstacles, trees, scale)
            if found == working:
                break
            problem = begin_positions(
                members, all_particles, flight, whole, len(particles), working, found, h
            )
            working = found
            linearise(members, particles, problem)
            for _ in range(2):
                solve(problem, tolerance, mass)
                place_all(members, particles, problem)
                linearise(members, particles, problem)
    own = problem.rows
    if has_room:
        separate(members, own, particles, obstacles, trees, scale)
    else:
        # the forces of the compliance
        for row in own:
            row['bias'][0] = row['linear_gap']
        solve(problem, tolerance, mass)
        place_all(members, particles, problem)
    # lifted to where it touched, a body has less than after its flight
    kept = max(energy + work_of_loads(members), 0.0)
    keep_motion(members)
    change_velocities(members, own, particles, h)
    start_velocities(members, particles, problem.modes[0], h)
    put_rotation(members, particles)
    acting = begin_velocities(members, particles, problem, h)
    if acting > 0:
        impulses = first_rows(problem, acting, len(particles))
        residual, sweeps, steps = solve(impulses, tolerance / h, mass)
        impact = any_impact(impulses.rows) and all_still(members, impulses.rows)
        most = energy_after(members, impulses.rows) if impact else 0.0
        if most > (1.0 + GAIN) * kept:
            # simultaneous rebounds with friction could gain energy: it is convex in their share
            rebound(impulses.rows, -1.0)
            solve(impulses, tolerance / h, mass)
            least = energy_after(members, impulses.rows)
            share = min(max((kept - least) / (most - least), 0.0), 1.0)
            rebound(impulses.rows, share)
            residual, sweeps, steps = solve(impulses, tolerance / h, mass)
        work[0], work[1] = work[0] + sweeps, work[1] + steps
        work[2] += residual > tolerance / h
        add_impulses(members, impulses.rows)
        add_velocities(members, particles, problem.modes[0], problem.shifts[0])
    share = 1.0
    if not is_soft and (not any_driven(members) or work[2] > unsolved or any_inside(members, own)):
        most = largest_energy(members, own[:acting], kept, h)
        if kinetic_energy(members) > (1.0 + GAIN) * most:
            share = keep_energy(members, own, energy, most)
    put_rotation(members, particles)
    for k in range(acting):
        row = own[k]
        for axis in range(3):
            row['force'][axis] = share * (row['positional'][axis] + row['force'][axis] / h)
        if not row['force'][0] > RELEASED * row['positional'][0]:
            put_vector(row['force'], ZERO)
    return acting, len(particles)


@helper
def start_of(row: np.void) -> Vector:
    """Return where the first side of a contact was before the tick, m."""
    return minus(flown(row), vector_of(row['motion']))


@helper
def find_corners(
    members: np.ndarray,
    particles: np.ndarray,
    room: np.ndarray,
    working: int,
    obstacles: np.ndarray,
    trees: Trees,
    scale: float,
) -> int:
    """
    Append contacts of particles that end up inside an obstacle, at another side of it.

    In the corner of a bin, a particle touches both walls. Returned is the number of rows.
    """
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
            obstacle, trees, start_of(row), end, row['thickness']
        )
        gap = distance - row['thickness'] + row['tolerated']
        if gap > -LINEARISED * scale or end_gap(row, members, particles) < OTHER_SIDE * gap:
            continue
        copy_record(room, found, room, k)
        put_other_side(room[found], outwards, gap, end)
        found += 1
    return found


@helper
def is_beyond_convex(obstacle: np.void, gap: float, limit: float) -> bool:
    """
    Return whether the distance from an obstacle is over a limit for certain, m.

    From one that is convex, it is at least the gap from the plane of a contact with it.
    """
    return obstacle['kind'] != MESH and gap > limit


@helper
def new_problem(members: np.ndarray, rows: np.ndarray, workspace: Workspace) -> Problem:
    """Return room for the contact problem of an island."""
    count, most_touched = len(members), 4 * len(rows)
    counts, most, total_modes = np.empty(count, np.int64), RIGID_MODES, 0
    for number in range(count):
        counts[number] = RIGID_MODES + 3 * members[number]['features']
        most, total_modes = max(most, counts[number]), total_modes + counts[number]
    factorised = count if total_modes <= LARGEST_ISLAND else 0
    return Problem(
        rows,
        jacobian_of(workspace, 6 * len(rows), width_of(most) + 1),
        counts,
        np.empty(most_touched),
        np.zeros((3, count, width_of(most) + 1)),
        np.empty((2, 3, most_touched)),
        np.empty((factorised, factorised, most, most)),
        np.empty((factorised, factorised), np.bool_),
    )


@helper
def first_rows(problem: Problem, count: int, touched: int) -> Problem:
    """Return the problem of the first rows and particles."""
    return Problem(
        problem.rows[:count],
        problem.jacobian[: 6 * count],
        problem.counts,
        problem.mobility[:touched],
        problem.modes,
        problem.shifts,
        problem.hessian,
        problem.filled,
    )


# --------------------------------------------------------------------------------------- positions
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
def begin_positions(
    members: np.ndarray,
    particles: np.ndarray,
    flight: Flight,
    whole: Problem,
    known: int,
    first: int,
    working: int,
    h: float,
) -> Problem:
    """
    Write rows of the problem of positions; its unknowns are λ = h² f / 2.

    Parameters
    ----------
    members, particles : (m,) MEMBER, (p,) PARTICLE
        particles are written
    flight
        see `resolve`
    whole : Problem
        with room for all rows
    known, first, working : int
        number of particles before, and of rows before and now
    h : float
        s

    Returns
    -------
    Problem
        that of the rows that take part

    """
    rows, jacobian, features = whole.rows, whole.jacobian, np.empty(QUADRATIC_FEATURES)
    touched = number_particles(members, rows[first:working], flight, particles, known)
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
        compliance = row['softness'] * row['inverse_mass'] * 2.0
        compliance /= h * h * CONTACT_FREQUENCY * CONTACT_FREQUENCY
        row['shares_particles'] = is_shared(row, particles)
        if row['shares_particles']:
            compliance += PROXIMAL * mobility
        row['compliance'][0] = row['compliance'][1] = compliance
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
def is_shared(row: np.void, particles: np.ndarray) -> bool:
    """Return whether other contacts act on a particle of a contact, too."""
    for corner in range(4):
        if row['shares'][corner] != 0.0 and particles[row['particles'][corner]]['rows'] > 1:
            return True
    return False


@helper
def place_all(members: np.ndarray, particles: np.ndarray, problem: Problem) -> None:
    """Write the displacements of bodies, and of particles, by λ."""
    place(members, problem.modes[0])
    place_particles(members, particles, problem.shifts[0])


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
    jacobian, counts = problem.jacobian, problem.counts
    y, shifts = problem.modes[0], problem.shifts[0]
    error = overlap = 0.0
    for k in range(len(problem.rows)):
        row = problem.rows[k]
        gap = end_gap(row, members, particles)
        motion = mode_response(row, jacobian, k, counts, y)
        if len(problem.mobility) > 0:
            motion = plus(motion, particle_response(row, jacobian, k, counts, y, shifts))
        if row['force'][0] > 0.0 or gap < 0.0:
            error = max(error, abs(row['linear_gap'] + motion[0] - gap), -gap)
            if row['two'] < 0 and row['inverse_mass'] > 0.0:
                overlap = max(overlap, -gap)
        row['end_gap'], row['linear_gap'] = gap, gap - motion[0]
        row['bias'][0] = row['linear_gap'] - row['compliance'][0] * row['force'][0]
    return error, overlap


@helper
def separate(
    members: np.ndarray,
    rows: np.ndarray,
    particles: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    scale: float,
) -> None:
    """
    Shift bodies, or single particles, out of obstacles by what is left of overlaps.

    That is next to nothing, but where a particle has met another side of an obstacle, as in the
    corner of a bin.
    """
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


# -------------------------------------------------------------------------------------- velocities
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
        end = moved(row, 0, members[row['one']], particles)
        middle = scaled(0.5, plus(start_of(row), end))
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
def begin_velocities(
    members: np.ndarray, particles: np.ndarray, problem: Problem, h: float
) -> int:
    """
    Write the problem of velocities; its unknowns are the impulses p.

    Contacts without force take no part: those with come first, and their number is returned.
    """
    rows, jacobian, acting = problem.rows, problem.jacobian, 0
    features = np.empty(QUADRATIC_FEATURES)
    for k in range(len(rows)):
        if not rows[k]['positional'][0] > 0.0:
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


@helper
def write_body(body: np.void, member: np.void, x: np.ndarray, v: np.ndarray) -> None:
    """Write the particles and the rigid motion of a body after the tick."""
    x1, v1 = x[1 - body['now']], v[1 - body['now']]
    old, rotation = vector_of(member['centre']), matrix_of(member['rotation'])
    centre, velocity = plus(old, vector_of(member['shift'])), vector_of(member['velocity'])
    angular = vector_of(member['end_angular_velocity'])
    for i in range(body['first'], body['first'] + body['count'], LANES):
        left = body['first'] + body['count'] - i
        arm = applied(rotation, minus(vectors_at(x1, i, left), old))
        put_vectors(x1, i, left, plus(centre, arm))
        put_vectors(v1, i, left, plus(velocity, cross(angular, arm)))
    put_end(body, member)


@helper
def put_end(body: np.void, member: np.void) -> None:
    """Write the rigid motion of a body after the tick, and what its contacts gave it, per mass."""
    put_motion(
        body, end_centre(member), vector_of(member['velocity']),
        vector_of(member['angular_momentum']), matrix_of(member['end_inverse_inertia']),
    )  # fmt: skip
    share = 1.0 / member['mass']
    for row in range(2):
        given = vector_of(member['received'][row])
        put_vector(body['received'][row], along(vector_of(body['received'][row]), share, given))
