# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of rigid bodies with obstacles, points and each other: one problem for all of an island.

Two stages, both solved by `solver`. First positions: the forces f, constant over the tick, such
that nothing penetrates at its end and nothing slides that friction holds. With λ = h² f / 2 they
displace a body by λ / M, and change its velocity by 2 λ / (h M). Then velocities: impulses p at
the end of the tick, such that contacts separate with ε times the speed of approach, and stick or
slide within the cone of all of the tick's impulse, h f + p. In rest p = 0, and f is the weight.

Contacts have a compliance, 1 / (M ω²): it distributes forces over the particles of a face, and
bounds them where obstacles leave a body no room.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.collision.obstacle_contacts import bounds_of, find_contacts, may_touch
from softbody_ros.core.collision.obstacles import distance_from
from softbody_ros.core.collision.shapes import PLANE
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.rows import (
    CONTACT_FREQUENCY,
    MODES,
    complete_row,
    in_world,
    put_face_row,
    put_jacobian,
    put_member,
    put_obstacle_row,
)
from softbody_ros.core.contact.solver import response, solve
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.union_find import root_of, unite
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    ZERO,
    Vector,
    along,
    applied,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    product,
    put_matrix,
    put_vector,
    scaled,
    transposed,
    vector_of,
)
from softbody_ros.core.lanes import LANES, put_vectors, vectors_at
from softbody_ros.core.shape_matching.polar_decomposition import rotation_by_vector

VELOCITY_COMPLIANCE = 1e-4
"""Compliance of contacts for velocities, relative to the inverse mass."""
MARGIN = 0.01
"""Distance, in RMS radii, within which contacts take part that are not made yet."""
GAIN = 1e-10
"""Relative gain of energy that is rounding."""
ROUNDS = 4
"""Linearisations of the positions, at most."""
SHIFTS, LARGEST_SHIFT = 3, 1e-3
"""Passes in which bodies are shifted out of obstacles in the end, and how far, in RMS radii."""
LINEARISED = 5e-6
"""Overlap, or error of gaps by linearisation, in RMS radii, that is tolerated."""
TOLERANCE = 1e-11
"""Of displacements, in RMS radii; of velocities the same over the tick."""


@kernel
def find_obstacle_rows(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    h: float,
    memory: np.ndarray,
    members: np.ndarray,
    contacts: np.ndarray,
    rows: np.ndarray,
) -> int:
    """
    Write the members, and the rows of their contacts with obstacles.

    Parameters
    ----------
    bodies : (B,) BODY
    chosen : (m,) int
        rigid bodies
    shapes : (R,) SHAPE
    weights : (M,) float
        mass shares of the particles of all rest shapes
    x, v : (2, 3, N) float
        m, m/s
    obstacles : (O,) OBSTACLE
    trees : Trees
        of the meshes of obstacles
    h : float
        s
    memory : (r,) MEMORY
        of the tick before, in order of its keys
    members : (m,) MEMBER
        written
    contacts : (c,) CONTACT
        scratch for the contacts of one body with one obstacle
    rows : (k,) ROW

    Returns
    -------
    int
        number of rows, even beyond the capacity

    """
    found = 0
    for number in range(len(chosen)):
        body = bodies[chosen[number]]
        first, count, now = body['first'], body['count'], body['now']
        scale = shapes[body['shape']]['scale']
        x0, x1 = x[now], x[1 - now]
        put_member(members[number], body, chosen[number], scale, MARGIN * scale)
        member = members[number]
        speed = norm(vector_of(member['velocity'])) + scale * norm(
            applied(matrix_of(member['inverse_inertia']), vector_of(member['angular_momentum']))
        )
        member['margin'] += h * speed
        reach = body['thickness'] + member['margin']
        low, high, low_before, high_before = ZERO, ZERO, ZERO, ZERO
        bounded = False
        for which in range(len(obstacles)):
            obstacle = obstacles[which]
            if obstacle['kind'] != PLANE:
                if not bounded:
                    low, high = bounds_of(x1, first, count)
                    low_before, high_before = bounds_of(x0, first, count)
                    bounded = True
                if not may_touch(obstacle, low, high, low_before, high_before, reach):
                    continue
            near = find_contacts(obstacle, trees, x1, x0, first, count, reach, True, contacts, 0)
            for k in range(near):
                if found < len(rows):
                    weight = weights[shapes[body['shape']]['first'] + contacts[k]['particle']]
                    velocity = put_obstacle_row(
                        rows[found], contacts[k], number, body, reach, weight, obstacle, which, x,
                        v,
                    )  # fmt: skip
                    complete_row(rows[found], members, memory, velocity, h)
                found += 1
    return found


@kernel
def find_face_rows(
    bodies: np.ndarray,
    contacts: np.ndarray,
    sets: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    h: float,
    memory: np.ndarray,
    members: np.ndarray,
    rows: np.ndarray,
    found: int,
) -> int:
    """
    Append the rows of contacts between bodies, and of points with faces of bodies.

    Parameters
    ----------
    contacts : (c,) CONTACT
        of the narrow phase, with columns of `x` as particles
    sets : (s,) POINT_SET
    found : int
        number of rows before
    bodies, shapes, weights, x, v, h, memory, members, rows
        see `find_obstacle_rows`

    Returns
    -------
    int
        number of rows, even beyond the capacity

    """
    for contact in contacts:
        if found < len(rows):
            velocity = put_face_row(
                rows[found], contact, bodies, members, sets, shapes, weights, x, v, h
            )
            complete_row(rows[found], members, memory, velocity, h)
        found += 1
    return found


@kernel
def resolve(
    bodies: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    h: float,
    members: np.ndarray,
    rows: np.ndarray,
    remembered: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
    work: np.ndarray,
) -> int:
    """
    Move bodies by the forces of their contacts, from the flight to the end of the tick.

    Parameters
    ----------
    bodies, x, v, obstacles, trees, h, members
        see `find_obstacle_rows`
    rows : (k,) ROW
        all contacts
    remembered : (k,) MEMORY
        written, not in order
    obstacle_impulse, normal_impulse
        results, see `exchange`
    work : (3,) int
        added to: Gauss–Seidel sweeps, Newton steps, problems that are not solved to tolerance

    Returns
    -------
    int
        number of forces to remember

    """
    count = len(members)
    island, own = np.empty(count, np.int64), np.empty(len(rows), rows.dtype)
    first_body, first_row = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    inside, local = np.empty(count, members.dtype), np.empty(count, np.int64)
    sort_into_islands(members, rows, island, first_body, first_row, inside, local, own)
    jacobian = np.zeros((len(rows), 2, 3, MODES))
    kept = 0
    for root in range(count):
        first, last = first_row[root], first_row[root + 1]
        if first == last:
            continue
        together = inside[first_body[root] : first_body[root + 1]]
        resolve_island(together, own[first:last], jacobian[first:last], obstacles, trees, h, work)
        for k in range(first, last):
            row = own[k]
            if row['positional'][0] > 0.0:
                remembered[kept]['key'] = row['key']
                put_vector(remembered[kept]['force'], in_world(row, row['positional']))
                remembered[kept]['tolerated'] = row['tolerated']
                kept += 1
            receive(together, row, h)
            number = together[row['one']]['body']
            exchange(row, bodies[number], number, obstacles, h, obstacle_impulse, normal_impulse)
        for k in range(len(together)):
            write_body(bodies[together[k]['body']], together[k], x, v)
    return kept


@helper
def sort_into_islands(
    members: np.ndarray,
    rows: np.ndarray,
    island: np.ndarray,
    first_body: np.ndarray,
    first_row: np.ndarray,
    inside: np.ndarray,
    local: np.ndarray,
    own: np.ndarray,
) -> None:
    """
    Copy bodies and contacts, island by island; contacts refer to bodies within their island.

    Parameters
    ----------
    members, rows : (m,) MEMBER, (k,) ROW
    island, local : (m,) int
        written: least member of the island, and number within it
    first_body, first_row : (m + 1,) int
        written: where in the copies the island of each least member begins
    inside, own : (m,) MEMBER, (k,) ROW
        written

    """
    count = len(members)
    for number in range(count):
        island[number] = number
    for row in rows:
        if row['two'] >= 0:
            unite(island, row['one'], row['two'])
    for number in range(count):
        island[number] = root_of(island, number)
        first_body[island[number] + 1] += 1
    for row in rows:
        first_row[island[row['one']] + 1] += 1
    for number in range(count):
        first_body[number + 1] += first_body[number]
        first_row[number + 1] += first_row[number]
    filled, placed = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for number in range(count):
        root = island[number]
        local[number] = filled[root]
        inside[first_body[root] + filled[root]] = members[number]
        filled[root] += 1
    for k in range(len(rows)):
        root = island[rows[k]['one']]
        place_in = first_row[root] + placed[root]
        own[place_in] = rows[k]
        row = own[place_in]
        row['one'] = local[row['one']]
        if row['two'] >= 0:
            row['two'] = local[row['two']]
        placed[root] += 1


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
def side_of(row: np.void, side: int) -> tuple[int, float]:
    """Return the member of one side of a contact, or −1, and the sign of the force on it."""
    if side == 0:
        return row['one'], 1.0
    return row['two'], -1.0


@helper
def end_centre(member: np.void) -> Vector:
    """Return the centre after the tick, m."""
    return plus(vector_of(member['centre']), vector_of(member['shift']))


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
    half = 1 - body['now']
    if row['column'] >= 0:
        normal_impulse[half, row['column']] += h * row['force'][0]
    body['touches'][half] = 1
    which = row['obstacle']
    if which >= 0:
        # points, the last row, have no origin of their own
        origin = vector_of(obstacles[which]['position']) if which < len(obstacles) else ZERO
        add_wrench_about(
            obstacle_impulse[number, half, which], origin, -h, vector_of(row['end_point']),
            in_world(row, row['force']), ZERO,
        )  # fmt: skip


@helper
def resolve_island(
    members: np.ndarray,
    rows: np.ndarray,
    jacobian: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    h: float,
    work: np.ndarray,
) -> None:
    """Resolve the contacts of one island: positions, then velocities."""
    count = len(members)
    modes = np.empty((3, count, MODES))
    scale, mass = members[0]['scale'], members[0]['mass']
    for number in range(count):
        scale = min(scale, members[number]['scale'])
        mass = min(mass, members[number]['mass'])
        put_vector(members[number]['shift'], ZERO)
        put_matrix(members[number]['rotation'], IDENTITY)
        put_vector(members[number]['received'][0], ZERO)
        put_vector(members[number]['received'][1], ZERO)
    begin_positions(members, rows, jacobian, h)
    last, has_room, unsolved = math.inf, True, work[2]
    energy = kinetic_energy(members)
    for number in range(ROUNDS):
        residual, sweeps, steps = solve(rows, jacobian, count, TOLERANCE * scale, mass, modes)
        work[0], work[1] = work[0] + sweeps, work[1] + steps
        work[2] += residual > TOLERANCE * scale
        place(members, rows)
        error, overlap = linearise(members, rows, jacobian, modes[0])
        solved = residual <= TOLERANCE * scale
        shrinks = overlap <= max(0.5 * last, LINEARISED * scale)
        has_room = number == 0 or shrinks or not solved
        if error <= LINEARISED * scale or not has_room:
            break
        last = overlap
    if has_room:
        separate(members, rows, obstacles, trees, LARGEST_SHIFT * scale)
    else:
        # the forces of the compliance
        for k in range(len(rows)):
            rows[k]['bias'][0] = rows[k]['linear_gap']
        solve(rows, jacobian, count, TOLERANCE * scale, mass, modes)
        place(members, rows)
    keep_motion(members)
    change_velocities(members, rows, h)
    acting = begin_velocities(members, rows, jacobian, h)
    if acting > 0:
        residual, sweeps, steps = solve(
            rows[:acting], jacobian[:acting], count, TOLERANCE * scale / h, mass, modes
        )
        impact = any_impact(rows[:acting]) and all_still(rows[:acting])
        most = energy_after(members, rows[:acting]) if impact else 0.0
        if most > (1.0 + GAIN) * energy:
            # simultaneous rebounds with friction could gain energy: it is convex in their share
            rebound(rows[:acting], -1.0)
            solve(rows[:acting], jacobian[:acting], count, TOLERANCE * scale / h, mass, modes)
            least = energy_after(members, rows[:acting])
            share = min(max((energy - least) / (most - least), 0.0), 1.0)
            rebound(rows[:acting], share)
            residual, sweeps, steps = solve(
                rows[:acting], jacobian[:acting], count, TOLERANCE * scale / h, mass, modes
            )
        work[0], work[1] = work[0] + sweeps, work[1] + steps
        work[2] += residual > TOLERANCE * scale / h
        add_impulses(members, rows[:acting])
    share = 1.0
    if work[2] > unsolved:
        most = largest_energy(members, rows, energy)
        if kinetic_energy(members) > (1.0 + GAIN) * most:
            share = keep_energy(members, energy, most)
    for k in range(len(rows)):
        row = rows[k]
        for axis in range(3):
            impulse = row['force'][axis] if k < acting else 0.0
            row['force'][axis] = share * (row['positional'][axis] + impulse / h)


# --------------------------------------------------------------------------------------- positions
@helper
def begin_positions(members: np.ndarray, rows: np.ndarray, jacobian: np.ndarray, h: float) -> None:
    """Write the problem of positions; its unknowns are λ = h² f / 2."""
    for k in range(len(rows)):
        row = rows[k]
        put_jacobian(row, jacobian[k], members, vector_of(row['point']), False)
        compliance = row['softness'] * row['inverse_mass'] * 2.0
        compliance /= h * h * CONTACT_FREQUENCY * CONTACT_FREQUENCY
        row['compliance'][0] = row['compliance'][1] = compliance
        start = scaled(0.5 * h * h, vector_of(row['remembered']))
        row['bias'][0] = row['linear_gap'] = row['gap']
        row['force'][0] = max(dot(start, vector_of(row['normal'])), 0.0)
        for axis in range(2):
            along_tangent = dot(start, vector_of(row['tangents'][axis]))
            row['force'][1 + axis] = along_tangent
            # the compliance has yielded already
            row['bias'][1 + axis] = row['slip'][axis] - compliance * along_tangent
            row['free'][axis] = row['slip'][axis]
        for axis in range(3):
            row['base'][axis] = 0.0


@helper
def place(members: np.ndarray, rows: np.ndarray) -> None:
    """Write the displacements of bodies by λ."""
    begin_impulses(members)
    for k in range(len(rows)):
        row = rows[k]
        point, force = vector_of(row['point']), in_world(row, row['force'])
        for side in range(2):
            index, sign = side_of(row, side)
            if index >= 0:
                centre = vector_of(members[index]['centre'])
                add_wrench_about(members[index]['impulse'], centre, sign, point, force, ZERO)
    for number in range(len(members)):
        member = members[number]
        share = 1.0 / member['mass']
        put_vector(member['shift'], scaled(share, vector_of(member['impulse'][0])))
        inverse = matrix_of(member['inverse_inertia'])
        angle = applied(inverse, scaled(share, vector_of(member['impulse'][1])))
        put_matrix(member['rotation'], rotation_by_vector(angle))


@helper
def begin_impulses(members: np.ndarray) -> None:
    """Begin to add up the impulses of one stage."""
    for number in range(len(members)):
        put_vector(members[number]['impulse'][0], ZERO)
        put_vector(members[number]['impulse'][1], ZERO)


@helper
def moved(member: np.void, point: Vector) -> Vector:
    """Return where the contact forces of the tick displace a point of a body to, m."""
    arm = minus(point, vector_of(member['centre']))
    return plus(end_centre(member), applied(matrix_of(member['rotation']), arm))


@helper
def linearise(
    members: np.ndarray, rows: np.ndarray, jacobian: np.ndarray, y: np.ndarray
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
        largest one with obstacles, m

    """
    error = overlap = 0.0
    for k in range(len(rows)):
        row = rows[k]
        point, normal = vector_of(row['point']), vector_of(row['normal'])
        apart = minus(moved(members[row['one']], point), point)
        if row['two'] >= 0:
            two = members[row['two']]
            apart = minus(apart, minus(moved(two, point), point))
            normal = applied(matrix_of(two['rotation']), normal)
        elif row['of_face']:
            normal = applied(matrix_of(members[row['one']]['rotation']), normal)
        gap = row['gap'] + dot(normal, apart)
        n, _, _ = response(row, jacobian[k], y)
        if row['force'][0] > 0.0 or gap < 0.0:
            error = max(error, abs(row['linear_gap'] + n - gap), -gap)
            if row['two'] < 0:
                overlap = max(overlap, -gap)
        row['linear_gap'] = gap - n
        row['bias'][0] = row['linear_gap'] - row['compliance'][0] * row['force'][0]
    return error, overlap


@helper
def separate(
    members: np.ndarray, rows: np.ndarray, obstacles: np.ndarray, trees: Trees, most: float
) -> None:
    """Shift bodies out of obstacles by what is left of overlaps: next to nothing."""
    for _ in range(SHIFTS):
        shifted = False
        for k in range(len(rows)):
            row = rows[k]
            if row['two'] >= 0:
                continue
            member = members[row['one']]
            point, normal = vector_of(row['point']), vector_of(row['normal'])
            if row['of_face']:
                normal = applied(matrix_of(member['rotation']), normal)
            place_now = moved(member, point)
            gap = row['gap'] + dot(normal, minus(place_now, point))
            if row['column'] >= 0 and obstacles[row['obstacle']]['kind'] != PLANE:
                # it may be round
                distance, outwards = distance_from(obstacles[row['obstacle']], trees, place_now)
                if dot(outwards, normal) > 0.5:
                    gap = distance - row['thickness'] + row['tolerated']
                    normal = outwards
            if -most < gap < 0.0:
                put_vector(member['shift'], along(vector_of(member['shift']), -gap, normal))
                shifted = True
        if not shifted:
            break


# -------------------------------------------------------------------------------------- velocities
@helper
def change_velocities(members: np.ndarray, rows: np.ndarray, h: float) -> None:
    """
    Write forces, and change velocities by them.

    The moment is that of the midpoint of the path of the point of contact about that of the path
    of the centre without contacts: exact for a force constant over the tick, and equal on both
    sides, so that angular momentum is conserved.
    """
    begin_impulses(members)
    for k in range(len(rows)):
        row = rows[k]
        impulse = scaled(2.0 / h, in_world(row, row['force']))
        end = moved(members[row['one']], vector_of(row['point']))
        start = minus(vector_of(row['point']), vector_of(row['motion']))
        middle = scaled(0.5, plus(start, end))
        for side in range(2):
            index, sign = side_of(row, side)
            if index >= 0:
                member = members[index]
                centre, velocity = vector_of(member['centre']), vector_of(member['velocity'])
                centre = along(centre, -0.5 * h, velocity)
                add_wrench_about(member['impulse'], centre, sign, middle, impulse, ZERO)
        for axis in range(3):
            row['positional'][axis] = row['force'][axis] * 2.0 / (h * h)
        put_vector(row['end_point'], end)
    add_momenta(members)


@helper
def add_momenta(members: np.ndarray) -> None:
    """Change velocities by the impulses of a stage."""
    for number in range(len(members)):
        member = members[number]
        share = 1.0 / member['mass']
        velocity, momentum = vector_of(member['velocity']), vector_of(member['angular_momentum'])
        put_vector(member['velocity'], along(velocity, share, vector_of(member['impulse'][0])))
        momentum = along(momentum, share, vector_of(member['impulse'][1]))
        put_vector(member['angular_momentum'], momentum)


@helper
def angular_velocity_of(member: np.void) -> Vector:
    """Return the angular velocity after the tick, rad/s."""
    rotation = matrix_of(member['rotation'])
    local = applied(transposed(rotation), vector_of(member['angular_momentum']))
    return applied(rotation, applied(matrix_of(member['inverse_inertia']), local))


@helper
def velocity_of(member: np.void, point: Vector) -> Vector:
    """Return the velocity at a point after the tick, m/s."""
    turning = cross(angular_velocity_of(member), minus(point, end_centre(member)))
    return plus(vector_of(member['velocity']), turning)


@helper
def begin_velocities(members: np.ndarray, rows: np.ndarray, jacobian: np.ndarray, h: float) -> int:
    """
    Write the problem of velocities; its unknowns are the impulses p.

    Contacts without force take no part: those with come first, and their number is returned.
    """
    acting = 0
    for k in range(len(rows)):
        if not rows[k]['positional'][0] > 0.0:
            continue
        if acting != k:
            swap(rows, acting, k)
        row = rows[acting]
        point = vector_of(row['end_point'])
        put_jacobian(row, jacobian[acting], members, point, True)
        velocity = velocity_of(members[row['one']], point)
        if row['two'] >= 0:
            velocity = minus(velocity, velocity_of(members[row['two']], point))
        else:
            velocity = minus(velocity, vector_of(row['other_velocity']))
        normal, yielding = vector_of(row['normal']), 0.0
        if not row['is_new']:
            # while the compliance yields, or recovers, the sides go on to approach, or to part
            before = 0.5 * h * h * max(dot(vector_of(row['remembered']), normal), 0.0)
            yielding = row['compliance'][0] * (row['force'][0] - before) / h
            least, most = min(row['closing'], 0.0), max(row['closing'], 0.0)
            yielding = min(max(yielding, least), most)
        row['bias'][0] = dot(normal, velocity) + row['elasticity'] * row['approach'] + yielding
        row['compliance'][0] = row['compliance'][1] = VELOCITY_COMPLIANCE * row['inverse_mass']
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
def all_still(rows: np.ndarray) -> bool:
    """Return whether nothing that moves by itself, and so can give energy, is touched."""
    for k in range(len(rows)):
        if vector_of(rows[k]['other_velocity']) != ZERO:
            return False
    return True


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
def keep_motion(members: np.ndarray) -> None:
    """Keep the momenta before the contacts."""
    for number in range(len(members)):
        member = members[number]
        put_vector(member['momenta'][0], vector_of(member['velocity']))
        put_vector(member['momenta'][1], vector_of(member['angular_momentum']))


@helper
def largest_energy(members: np.ndarray, rows: np.ndarray, energy: float) -> float:
    """Return the energy, J, with which bodies can leave obstacles: at twice their speed faster."""
    fastest = mass = 0.0
    for k in range(len(rows)):
        fastest = max(fastest, norm(vector_of(rows[k]['other_velocity'])))
    for number in range(len(members)):
        mass += members[number]['mass']
    root = math.sqrt(energy) + math.sqrt(2.0 * mass) * fastest
    return root * root


@helper
def keep_energy(members: np.ndarray, energy: float, most: float) -> float:
    """
    Take the share of all impulses after which there is not more energy, and return it.

    Impulses that are no solution, since none was found in time, could gain some.
    """
    after = kinetic_energy(members)
    middle = np.empty(len(members), members.dtype)
    for number in range(len(members)):
        middle[number] = members[number]
        take_share(middle[number], 0.5)
    # energy + a s + b s²
    b = 2.0 * (after + energy - 2.0 * kinetic_energy(middle))
    a = after - energy - b
    root = math.sqrt(max(a * a + 4.0 * b * (most - energy), 0.0))
    share = min(max(0.5 * (root - a) / b, 0.0), 1.0) if b > 0.0 else 0.0
    for number in range(len(members)):
        take_share(members[number], share)
    return share


@helper
def take_share(member: np.void, share: float) -> None:
    """Take back all but a share of the impulses on a body; its displacement stays."""
    before, angular_before = vector_of(member['momenta'][0]), vector_of(member['momenta'][1])
    after, angular = vector_of(member['velocity']), vector_of(member['angular_momentum'])
    put_vector(member['velocity'], along(before, share, minus(after, before)))
    angular = along(angular_before, share, minus(angular, angular_before))
    # of the displacement with the velocity that is left, lest angular momentum changes
    displaced = cross(vector_of(member['shift']), before)
    put_vector(member['angular_momentum'], along(angular, share - 1.0, displaced))


@helper
def energy_after(members: np.ndarray, rows: np.ndarray) -> float:
    """Return the kinetic energy with the impulses at the end of the tick, J."""
    after = np.empty(len(members), members.dtype)
    for number in range(len(members)):
        after[number] = members[number]
    add_impulses(after, rows)
    return kinetic_energy(after)


@helper
def swap(rows: np.ndarray, one: int, two: int) -> None:
    """Exchange two rows."""
    kept = np.empty(1, rows.dtype)
    kept[0] = rows[one]
    rows[one] = rows[two]
    rows[two] = kept[0]


@helper
def add_impulses(members: np.ndarray, rows: np.ndarray) -> None:
    """Change velocities by the impulses at the end of the tick."""
    begin_impulses(members)
    for k in range(len(rows)):
        row = rows[k]
        point, impulse = vector_of(row['end_point']), in_world(row, row['force'])
        for side in range(2):
            index, sign = side_of(row, side)
            if index >= 0:
                centre = end_centre(members[index])
                add_wrench_about(members[index]['impulse'], centre, sign, point, impulse, ZERO)
    add_momenta(members)


@helper
def write_body(body: np.void, member: np.void, x: np.ndarray, v: np.ndarray) -> None:
    """Write the particles and the rigid motion of a body after the tick."""
    x1, v1 = x[1 - body['now']], v[1 - body['now']]
    old, rotation = vector_of(member['centre']), matrix_of(member['rotation'])
    centre, velocity = plus(old, vector_of(member['shift'])), vector_of(member['velocity'])
    angular = angular_velocity_of(member)
    for i in range(body['first'], body['first'] + body['count'], LANES):
        left = body['first'] + body['count'] - i
        arm = applied(rotation, minus(vectors_at(x1, i, left), old))
        put_vectors(x1, i, left, plus(centre, arm))
        put_vectors(v1, i, left, plus(velocity, cross(angular, arm)))
    put_vector(body['centre'], centre)
    put_vector(body['velocity'], velocity)
    put_vector(body['angular_momentum'], vector_of(member['angular_momentum']))
    inverse = product(
        product(rotation, matrix_of(member['inverse_inertia'])), transposed(rotation)
    )
    put_matrix(body['inverse_inertia'], inverse)
    share = 1.0 / member['mass']
    for row in range(2):
        given = vector_of(member['received'][row])
        put_vector(body['received'][row], along(vector_of(body['received'][row]), share, given))
