# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which contacts take part in the contact problem of which island.

Of hundreds of contacts about a patch of a deformable body few act. So most wait, and take part
only if the solution without them would close them (constraint generation).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.body import QUADRATIC_FEATURES
from softbody_ros.core.collision.shapes import MESH
from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.members import put_fit_of_features, put_particle
from softbody_ros.core.contact.rows import copy_record, share_of, side_of
from softbody_ros.core.geometry.union_find import root_of, unite
from softbody_ros.core.geometry.vectors import (
    Vector,
    along,
    applied,
    applied_transposed,
    column_of,
    dot,
    matrix_of,
    minus,
    plus,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.shape_matching.flight_map import products_at

SOFT_MARGIN = 0.001
"""Distance, in RMS radii, within which contacts of deformable bodies take part that are not made
yet; more are kept the more others change (`LEVER`)."""
LEVER = 2.0
"""Displacement of particles by contacts at others, relative to that at these, at most."""
SPARE = 2
"""Room for rows, relative to those found after the flight."""
ABSENT, WAITS, WORKS = 0, 1, 2
"""Whether a contact cannot act, takes part once it would be closed, or does from the start."""

OPEN = np.dtype(
    [
        ('row', np.int64),  # of all rows, or −1 if it takes part by now
        ('sides', np.int64, (2,)),  # members of the island, or −1
        ('carrier', np.int64),  # the one with which the normal turns, or −1
        ('gap', np.float64),  # after the flight, m
        ('normal', np.float64, (3,)),  # after the flight
        ('arms', np.float64, (2, 3)),  # of both sides after the flight, from the centres, m
        ('columns', np.int64, (4,)),
        ('shares', np.float64, (4,)),
    ],
    align=True,
)
"""A contact that waits: what it takes to see whether it is closed. There are many, and each is
looked at several times in a tick, for which rows are too long."""


class Flight(NamedTuple):
    """Bodies after their flight: arrays of all of the world, see `resolve`."""

    bodies: np.ndarray
    shapes: np.ndarray
    weights: np.ndarray
    q: np.ndarray
    v: np.ndarray
    flown: np.ndarray
    is_pinned: np.ndarray
    place_of: np.ndarray


@helper
def change_of(row: np.void) -> float:
    """Return the change of the flight at a contact from the tick before, m."""
    if row['is_new']:
        return -max(row['gap'], row['coasting'])
    return abs(row['gap'] - row['gap_before'])


@helper
def is_calm(row: np.void, member: np.void) -> bool:
    """Return whether the flight of a body at a contact is about that of the tick before."""
    return change_of(row) <= SOFT_MARGIN * member['scale']


@helper
def find_working_set(
    members: np.ndarray, rows: np.ndarray, obstacles: np.ndarray, status: np.ndarray
) -> int:
    """
    Choose the contacts that may act, and return their number.

    Those that are neither known nor closed wait: of hundreds about a patch few are ever needed,
    and they join when the solution without them would close them.

    Not those of deformable start shapes that are none after the flight, unless forces at others
    may close them. Forces at contacts that persist keep up what there was: with them, sides go on
    with their speed. By more than that they displace where a contact is deeper after the flight
    than it was after that of the tick before.

    A new contact of a body that is steady acts only if it is closed with that speed. So the
    surface around a patch, which springs out in the flight, needs no contacts.

    Parameters
    ----------
    members, rows : (m,) MEMBER, (k,) ROW
    obstacles : (O,) OBSTACLE
    status : (k,) int
        written: ABSENT, WAITS or WORKS

    """
    deepest, changes, count = np.zeros(len(members)), np.zeros(len(members)), 0
    for row in rows:
        depth, change = min(row['gap_before'], 0.0) - row['gap'], change_of(row)
        for side in range(2):
            index, _ = side_of(row, side)
            if index >= 0:
                deepest[index] = max(deepest[index], depth)
                changes[index] = max(changes[index], change)
    for k in range(len(rows)):
        row, nearby, deformable, steady = rows[k], 0.0, False, True
        for side in range(2):
            index, _ = side_of(row, side)
            if index >= 0:
                deformable = deformable or members[index]['is_soft']
                steady = steady and members[index]['steady']
        gap, displaced = min(row['gap'], row['coasting']), deepest
        if steady:
            gap, displaced = row['coasting'], changes
        for side in range(2):
            index, _ = side_of(row, side)
            if index >= 0:
                nearby += members[index]['nearby'] + LEVER * displaced[index]
        status[k] = WORKS
        if deformable and row['is_new'] and gap > nearby:
            status[k] = ABSENT
            continue
        count += 1
        is_closed = (row['coasting'] if steady else row['gap']) <= 0.0
        if deformable and row['is_new'] and not is_closed and may_wait(row, obstacles):
            status[k] = WAITS
    return count


@helper
def may_wait(row: np.void, obstacles: np.ndarray) -> bool:
    """
    Return whether a contact needs no part as long as its own gap is open.

    Viscous friction is that of all of a patch; and of a mesh, particles may meet another side.
    """
    which = row['obstacle']
    is_mesh = 0 <= which < len(obstacles) and obstacles[which]['kind'] == MESH
    return row['viscosity'] < 0.0 and not is_mesh


@helper
def sort_into_islands(
    members: np.ndarray,
    rows: np.ndarray,
    status: np.ndarray,
    island: np.ndarray,
    first_body: np.ndarray,
    first_row: np.ndarray,
    inside: np.ndarray,
    local: np.ndarray,
    own: np.ndarray,
    working: np.ndarray,
    first_waiting: np.ndarray,
    waiting: np.ndarray,
) -> None:
    """
    Copy bodies and contacts, island by island; contacts refer to bodies within their island.

    Parameters
    ----------
    members, rows : (m,) MEMBER, (k,) ROW
        rows that take part, or wait, refer to bodies within their island after that
    status : (k,) int
        see `find_working_set`
    island, local : (m,) int
        written: least member of the island, and number within it
    first_body, first_row : (m + 1,) int
        written: where in the copies the island of each least member begins
    inside, own : (m,) MEMBER, (SPARE k,) ROW
        written; each island has room for more contacts than those that take part
    working : (m,) int
        zeros; written: number of contacts of the island of each least member that take part
    first_waiting, waiting : (m + 1,) int, (k,) OPEN
        zeros, and anything; written: those that wait, and where they begin

    """
    count = len(members)
    for number in range(count):
        island[number] = number
    for k in range(len(rows)):
        row = rows[k]
        if status[k] != ABSENT and row['two'] >= 0:
            unite(island, row['one'], row['two'])
    for number in range(count):
        island[number] = root_of(island, number)
        first_body[island[number] + 1] += 1
    for k in range(len(rows)):
        if status[k] != ABSENT:
            first_row[island[rows[k]['one']] + 1] += SPARE
        if status[k] == WAITS:
            first_waiting[island[rows[k]['one']] + 1] += 1
    for number in range(count):
        first_body[number + 1] += first_body[number]
        first_row[number + 1] += first_row[number]
        first_waiting[number + 1] += first_waiting[number]
    filled = np.zeros(count, np.int64)
    for number in range(count):
        root = island[number]
        local[number] = filled[root]
        copy_record(inside, first_body[root] + filled[root], members, number)
        filled[root] += 1
    for number in range(count):
        filled[number] = 0
    for k in range(len(rows)):
        row = rows[k]
        if status[k] == ABSENT:
            continue
        root = island[row['one']]
        if status[k] == WAITS:
            put_open(waiting[first_waiting[root] + filled[root]], k, row, members, local)
            filled[root] += 1
        row['one'] = local[row['one']]
        if row['two'] >= 0:
            row['two'] = local[row['two']]
        if status[k] == WORKS:
            copy_record(own, first_row[root] + working[root], rows, k)
            working[root] += 1


@helper
def put_open(
    contact: np.void, k: int, row: np.void, members: np.ndarray, local: np.ndarray
) -> None:
    """Write what is needed of row k while it waits, with members by their local numbers."""
    contact['row'], contact['gap'], contact['carrier'] = k, row['gap'], -1
    put_vector(contact['normal'], vector_of(row['normal']))
    for side in range(2):
        index, _ = side_of(row, side)
        contact['sides'][side] = -1
        if index >= 0:
            contact['sides'][side] = local[index]
            if side == 1 or row['of_face']:
                contact['carrier'] = local[index]
            arm = plus(vector_of(row['point']), vector_of(row['offsets'][side]))
            put_vector(contact['arms'][side], minus(arm, vector_of(members[index]['centre'])))
    for corner in range(4):
        contact['shares'][corner] = row['shares'][corner]
        contact['columns'][corner] = row['columns'][corner]


@helper
def number_particles(
    members: np.ndarray, rows: np.ndarray, flight: Flight, particles: np.ndarray, count: int
) -> int:
    """Write the particles of deformable bodies at contacts after the `count` known ones."""
    place_of = flight.place_of
    for row in rows:
        for corner in range(4):
            if row['shares'][corner] == 0.0:
                continue
            column = row['columns'][corner]
            if place_of[column] < 0:
                number = row['one'] if row['shares'][corner] > 0.0 else row['two']
                member = members[number]
                body = flight.bodies[member['body']]
                shape = flight.shapes[body['shape']]
                weight = flight.weights[shape['first'] + column - body['first']]
                put_particle(
                    particles[count], column, number, member, body, shape, weight, flight.q,
                    flight.flown, flight.v[1 - body['now']], flight.is_pinned[column],
                )  # fmt: skip
                place_of[column] = count
                count += 1
            row['particles'][corner] = place_of[column]
            particles[place_of[column]]['rows'] += 1
    return count


@helper
def take_closed(
    members: np.ndarray,
    particles: np.ndarray,
    rows: np.ndarray,
    waiting: np.ndarray,
    flight: Flight,
    room: np.ndarray,
    working: int,
) -> int:
    """
    Append those contacts that wait, but would be closed; return the number of rows.

    All in one loop: arrays would be counted (an atomic operation of the processor) each time that
    they are passed on.
    """
    if len(waiting) == 0:
        return working
    bodies, shapes, q, place_of = flight.bodies, flight.shapes, flight.q, flight.place_of
    fits = np.empty((3, len(members) * QUADRATIC_FEATURES))
    for number in range(len(members)):
        member = members[number]
        if member['features'] > 0:
            body = bodies[member['body']]
            put_fit_of_features(
                body, shapes[body['shape']], member, fits, QUADRATIC_FEATURES * number
            )
    for number in range(len(waiting)):
        contact = waiting[number]
        if contact['row'] < 0:
            continue
        normal, gap, carrier = vector_of(contact['normal']), contact['gap'], contact['carrier']
        if carrier >= 0:
            normal = applied(matrix_of(members[carrier]['rotation']), normal)
        for side in range(2):
            index, sign = contact['sides'][side], 1.0 if side == 0 else -1.0
            if index < 0:
                continue
            member, arm = members[index], vector_of(contact['arms'][side])
            local = applied_transposed(matrix_of(member['rotation']), normal)
            moved_along = dot(normal, vector_of(member['shift'])) + dot(minus(local, normal), arm)
            for corner in range(4):
                share = share_of(contact, side, corner)
                if not share > 0.0:
                    continue
                column = contact['columns'][corner]
                if place_of[column] >= 0:
                    shift = vector_of(particles[place_of[column]]['shift'])
                    moved_along += share * dot(normal, shift)
                if member['features'] > 0:
                    body, first = bodies[member['body']], QUADRATIC_FEATURES * index
                    shape = shapes[body['shape']]
                    rest_q = column_of(q, shape['first'] + column - body['first'])
                    deformed = combined_columns(fits, first, rest_q)
                    if member['features'] > 3:
                        square, mixed = products_at(shape, rest_q)
                        deformed = plus(deformed, combined_columns(fits, first + 3, square))
                        deformed = plus(deformed, combined_columns(fits, first + 6, mixed))
                    moved_along += share * dot(local, deformed)
            gap += sign * moved_along
        if gap < 0.0:
            copy_record(room, working, rows, contact['row'])
            contact['row'] = -1
            working += 1
    return working


@helper
def combined_columns(field: np.ndarray, first: int, shares: Vector) -> Vector:
    """Return Σ s a of three columns a of a field (3, n), from the given one on."""
    result = scaled(shares[0], column_of(field, first))
    result = along(result, shares[1], column_of(field, first + 1))
    return along(result, shares[2], column_of(field, first + 2))
