# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of bodies with obstacles, points and each other: one problem for all of an island.

In two stages, `positions` and `velocities`, with the same `solver`. What comes of them is written
to the particles.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.energy import (
    GAIN,
    any_driven,
    any_inside,
    are_passive,
    keep_energy,
    keep_motion,
    kinetic_energy,
    largest_energy,
    work_of_loads,
)
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.island import (
    UNSOLVED,
    Island,
    first_rows,
    is_unsolved,
    make_island,
    touched_particles,
)
from softbody_ros.core.contact.members import (
    change_map,
    end_centre,
    put_rotation,
    start_velocities,
)
from softbody_ros.core.contact.overlaps import remember_overlaps
from softbody_ros.core.contact.positions import (
    add_corners,
    brake,
    separate,
    solve_positions,
    yield_to_obstacles,
)
from softbody_ros.core.contact.rows import MEMORY, in_world, share_of, side_of
from softbody_ros.core.contact.velocities import (
    begin_velocities,
    change_velocities,
    solve_velocities,
)
from softbody_ros.core.contact.working_set import (
    SPARE,
    Flight,
    find_working_set,
    sort_into_islands,
)
from softbody_ros.core.contact.workspace import Workspace, for_islands
from softbody_ros.core.geometry.bounding_boxes import sort_indices
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.vectors import (
    ZERO,
    along,
    applied,
    column_of,
    cross,
    dot,
    matrix_of,
    minus,
    plus,
    put_column,
    put_vector,
    vector_of,
)
from softbody_ros.core.lanes import LANES, put_vectors, vectors_at
from softbody_ros.core.shape_matching.flight_map import write
from softbody_ros.core.shape_matching.rigid_motion import put_motion

RELEASED = 1e-12
"""Force, relative to that of the positions, that is rounding: the contact has ended."""


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
    arrays: tuple[Any, ...],
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
    arrays : tuple
        those of the workspace

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
    remembered = np.empty(SPARE * left + len(rows), MEMORY)
    kept = remember_overlaps(bodies, members, rows, remembered)
    workspace = for_islands(Workspace(*arrays), left)
    island, own, waiting = np.empty(count, np.int64), workspace.own, workspace.waiting
    first_body, first_row = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    inside, local = np.empty(count, members.dtype), np.empty(count, np.int64)
    working, first_waiting = np.zeros(count, np.int64), np.zeros(count + 1, np.int64)
    sort_into_islands(
        members, rows, status, island, first_body, first_row, inside, local, own, working,
        first_waiting, waiting,
    )  # fmt: skip
    flight = Flight(bodies, shapes, weights, q, v, flown, is_pinned, place_of)
    is_far = False
    for root in range(count):
        first, last = first_row[root], first_row[root]
        together = inside[first_body[root] : first_body[root + 1]]
        particles, meets = workspace.particles[:0], first < first_row[root + 1]
        if meets:
            whole = make_island(
                together, own[first : first_row[root + 1]], rows,
                waiting[first_waiting[root] : first_waiting[root + 1]], flight, obstacles, trees,
                h, workspace,
            )  # fmt: skip
            acting, touched = resolve_island(whole, working[root])
            for which in range(3):
                work[which] += whole.work[which]
            last, particles = first + acting, workspace.particles[:touched]
        for k in range(first, last):
            row = own[k]
            if row['key'] >= 0:
                remembered[kept]['key'] = row['key']
                put_vector(remembered[kept]['force'], in_world(row, row['positional']))
                remembered[kept]['tolerated'] = row['tolerated']
                remembered[kept]['gap'] = row['gap']
                remembered[kept]['depth'] = row['tolerated'] + max(-row['end_gap'], 0.0)
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
def resolve_island(island: Island, working: int) -> tuple[int, int]:
    """
    Resolve the contacts of one island: positions, then velocities.

    Parameters
    ----------
    island : Island
        members, particles and rows are written
    working : int
        number of contacts that take part at first

    Returns
    -------
    acting, touched : int
        number of contacts that act, the first ones then; and of particles

    """
    members, h = island.members, island.h
    energy = kinetic_energy(members)
    problem, has_room = solve_positions(island, working)
    if has_room:
        if island.is_soft:
            problem = add_corners(island, problem)
    else:
        yield_to_obstacles(island, problem)
    keep_motion(members)
    brake(island, problem)
    if has_room:
        separate(island, problem)
    rows, particles = problem.rows, touched_particles(island, problem)
    # lifted to where it touched, a body has less than after its flight
    kept = max(energy + work_of_loads(members), 0.0)
    change_velocities(members, rows, particles, h)
    start_velocities(members, particles, problem.modes[0], h)
    put_rotation(members, particles)
    acting = begin_velocities(island, problem)
    if acting > 0:
        solve_velocities(island, first_rows(problem, acting, len(particles)), kept)
    share, unsolved = 1.0, island.work[UNSOLVED] > 0
    if island.is_soft:
        # deformable bodies may rebound
        may_gain = is_unsolved(island) and are_passive(members, rows)
    else:
        may_gain = not any_driven(members) or unsolved or any_inside(members, rows)
    if may_gain:
        most = largest_energy(members, rows[:acting], kept, h)
        if kinetic_energy(members) > (1.0 + GAIN) * most:
            share = keep_energy(members, rows, most)
    put_rotation(members, particles)
    put_forces(rows[:acting], share, h)
    return acting, len(particles)


@helper
def put_forces(rows: np.ndarray, share: float, h: float) -> None:
    """Write the forces of both stages together; of the impulses a share."""
    for row in rows:
        for axis in range(3):
            row['force'][axis] = share * (row['positional'][axis] + row['force'][axis] / h)
        if not row['force'][0] > RELEASED * row['positional'][0]:
            put_vector(row['force'], ZERO)


# ----------------------------------------------------------------------------------------- results
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
