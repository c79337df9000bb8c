# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Find the contacts of bodies with obstacles, points and each other, as rows of the contact problem.

They are found at the start shapes, see `members`, within a reach as wide as bodies and obstacles
may get nearer in the tick. Bodies that are steady have the contacts that they had, and so look
for others nearby only.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softbody_ros.core.collision.body_contacts import (
    bound_all,
    code_of_pair,
    find_body_contacts,
    find_contacts_of_pairs,
)
from softbody_ros.core.collision.colliders import Colliders
from softbody_ros.core.collision.collision_surface import SurfaceArrays
from softbody_ros.core.collision.fixed_points import POINT_SET
from softbody_ros.core.collision.narrow_phase import CONTACT as FACE_CONTACT
from softbody_ros.core.collision.obstacle_contacts import (
    CONTACT,
    find_contacts,
    may_touch,
)
from softbody_ros.core.collision.obstacles import velocity_at
from softbody_ros.core.collision.shapes import PLANE
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.members import MEMBER, put_member
from softbody_ros.core.contact.overlaps import part_overlaps
from softbody_ros.core.contact.rows import (
    ROW,
    Tick,
    complete_row,
    concerns,
    copy_record,
    put_face_row,
    put_obstacle_row,
    side_of,
)
from softbody_ros.core.contact.working_set import LEVER, SOFT_MARGIN, is_calm
from softbody_ros.core.contact.workspace import CANDIDATES, FOUND, Workspace
from softbody_ros.core.geometry.bounding_boxes import box_around, overlapping_codes
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.vectors import (
    ZERO,
    applied,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    vector_of,
)
from softbody_ros.core.shape_matching.flight_map import put_start_shape

PASSES = 3
"""Searches: once for those that are steady, and again where others are not; then all have their
widest margins."""
TOLERATED = 1e-5
"""Depth in a body that was not met before, in RMS radii, up to which the next tick mends it."""
MARGIN = 0.01
"""Distance, in RMS radii, within which contacts of rigid bodies are rows that are not made yet."""
CALM = 0.01
"""Displacement by its acceleration in a tick, relative to `SOFT_MARGIN`, up to which it is worth
while to look whether a body is steady."""


@kernel
def find_rows(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    flown: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    surfaces: tuple[Any, ...],
    points: np.ndarray,
    sets: np.ndarray,
    h: float,
    others: bool,
    memory: np.ndarray,
    reaction: np.ndarray,
    is_pinned: np.ndarray,
    arrays: tuple[Any, ...],
) -> tuple[int, np.ndarray, np.ndarray]:
    """
    Find all contacts of bodies after their flight, and write them to the workspace.

    Parameters
    ----------
    bodies : (B,) BODY
    chosen : (m,) int
        which of them
    shapes : (R,) SHAPE
    weights : (M,) float
        mass shares of the particles of all rest shapes
    q : (3, M) float
        rest positions of the particles of all rest shapes, and goals, see `State`
    x, v : (2, 3, N) float
        m, m/s
    flown : (3, N) float
        written: positions after the flight of deformable bodies that may touch something, m
    match_centre, match_posture
        see `Colliders`
    obstacles : (O,) OBSTACLE
    trees : Trees
        of the meshes of obstacles
    surfaces : tuple
        SURFACEs and what belongs to them: the arrays of `SurfaceArrays`
    points, sets : (k, 3) float, (s,) POINT_SET
        points that no force moves, see `FixedPoints`
    h : float
        s
    others : bool
        whether there is something else than obstacles that bodies may touch
    memory : (r,) MEMORY
        of the tick before, in order of its keys
    reaction : (B, 2, 3) float
        what contacts exerted on bodies at the tick before, see `State`
    is_pinned : (N,) bool
        particles that pins hold against any force: they touch no obstacles
    arrays : tuple
        those of the workspace: `members` and `found` are written

    Returns
    -------
    found : int
        number of contacts
    more : (k,) ROW
        all of these if there was no room for them in the workspace, or none
    met : (p,) int
        pairs of members that have contacts, as increasing codes: m times one plus another

    """
    tick = Tick(bodies, shapes, weights, x, v, flown, obstacles, trees, h, memory, is_pinned)
    workspace = Workspace(*arrays)
    members, most = workspace.members[: len(chosen)], 0
    begin_members(tick, chosen, others, reaction, members)
    for number in chosen:
        most = max(most, bodies[number]['count'])
    near, rows, more = np.empty(most, CONTACT), workspace.found, np.empty(0, ROW)
    colliders = Colliders(
        bodies, chosen, shapes, q, x, match_centre, match_posture, SurfaceArrays(*surfaces)
    )
    contacts, found, searches = np.empty(0, FACE_CONTACT), 0, 0
    needed = workspace.needed
    while searches < PASSES:
        found = find_obstacle_rows(tick, members, near, rows)
        if others:
            for number in range(len(chosen)):
                body = bodies[chosen[number]]
                body['reach'] = body['thickness'] + members[number]['margin']
            contacts, candidates = find_body_contacts(colliders, points, sets, needed[CANDIDATES])
            needed[CANDIDATES] = max(needed[CANDIDATES], candidates)
            found = find_face_rows(tick, contacts, sets, members, rows, found)
        if found > len(rows):
            needed[FOUND] = 2 * found
            rows = more = np.empty(needed[FOUND], ROW)
            continue
        found = part_overlaps(bodies, members, rows[:found], memory, h)
        searches += 1
        if not confirm_steady(bodies, members, rows[:found], memory, searches > 1):
            break
    return found, more[:found], pairs_of(contacts, len(members))


@helper
def pairs_of(contacts: np.ndarray, count: int) -> np.ndarray:
    """Return the pairs of bodies of contacts, in their order."""
    codes, found = np.empty(len(contacts), np.int64), 0
    for contact in contacts:
        code = code_of_pair(contact, count)
        if contact['body'] < count and (found == 0 or code != codes[found - 1]):
            codes[found] = code
            found += 1
    return codes[:found]


@kernel
def find_missed(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    surfaces: tuple[Any, ...],
    met: np.ndarray,
    needed: np.ndarray,
) -> bool:
    """
    Return whether bodies that were displaced are within others that they had not met before.

    Such pairs will look for contacts as far as that, when the tick is computed once more.

    Parameters
    ----------
    bodies, chosen, shapes, q, x, match_centre, match_posture, surfaces, met
        see `find_rows`; positions at the end of the tick
    needed : (7,) int
        of the workspace

    """
    for number in chosen:
        bodies[number]['reach'] = bodies[number]['thickness']
    bounds = bound_all(bodies, chosen, shapes, x)
    codes, left, known = overlapping_codes(bounds.low, bounds.high), 0, 0
    for code in codes:
        while known < len(met) and met[known] < code:
            known += 1
        one, two = bodies[chosen[code // len(chosen)]], bodies[chosen[code % len(chosen)]]
        is_new = known == len(met) or met[known] != code
        if is_new and max(one['displaced'], two['displaced']) > 0.0:
            codes[left] = code
            left += 1
    colliders = Colliders(
        bodies, chosen, shapes, q, x, match_centre, match_posture, SurfaceArrays(*surfaces)
    )
    contacts, _ = find_contacts_of_pairs(
        colliders, codes[:left], bounds, np.empty((0, 3)), np.empty(0, POINT_SET),
        needed[CANDIDATES],
    )  # fmt: skip
    misses = False
    for contact in contacts:
        one, two = bodies[chosen[contact['body']]], bodies[chosen[contact['other']]]
        scale = min(shapes[one['shape']]['scale'], shapes[two['shape']]['scale'])
        if contact['depth'] > TOLERATED * scale:
            misses = True
            way = max(one['displaced'], two['displaced'])
            one['pushed'], two['pushed'] = max(one['pushed'], way), max(two['pushed'], way)
    return misses


@helper
def begin_members(
    tick: Tick, chosen: np.ndarray, others: bool, reaction: np.ndarray, members: np.ndarray
) -> None:
    """
    Write the members, after their flight.

    Deformable bodies that may touch something get their start shape in the place of the result.
    Their flights may be far from there: these margins are taken only if `confirm_steady` finds
    that they need to be.

    Parameters
    ----------
    tick : Tick
    members : (m,) MEMBER
        written
    chosen, others, reaction
        see `find_rows`

    """
    x, v, h, nothing = tick.x, tick.v, tick.h, np.zeros(1, MEMBER)
    for number in range(len(chosen)):
        body, member = tick.bodies[chosen[number]], members[number]
        copy_record(members, number, nothing, 0)
        shape, now = tick.shapes[body['shape']], body['now']
        scale = shape['scale']
        put_member(member, body, shape, chosen[number], h)
        member['margin'] = (SOFT_MARGIN if member['is_soft'] else MARGIN) * scale
        rate = applied(matrix_of(member['inverse_inertia']), vector_of(member['angular_momentum']))
        turning = norm(rate) + norm(vector_of(member['carried']))
        member['margin'] += h * scale * turning
        speed = norm(vector_of(member['velocity']))
        near, change = find_near_obstacles(body, member, h * speed, tick.obstacles, x)
        # so much its velocity may change, if what it meets stops it or takes it along
        member['margin'] += h * (max(speed, change) if others else change) + body['pushed']
        body['displaced'] = 0.0
        member['nearby'] = member['widest'] = member['margin']
        if member['is_soft'] and (others or near):
            distance, coasting = put_start_shape(body, x[now], v[now], x[1 - now], tick.flown, h)
            member['starts'], member['widest'] = True, member['nearby'] + distance
            # a contact acts up to so far from where it would be with the velocities
            member['margin'] = member['nearby'] + LEVER * SOFT_MARGIN * scale + coasting
        # steady is only what does not accelerate
        force = plus(vector_of(member['acceleration']), vector_of(reaction[chosen[number], 0]))
        may_be_steady = len(tick.memory) > 0 and h * h * norm(force) <= CALM * SOFT_MARGIN * scale
        if not may_be_steady or member['margin'] > member['widest']:
            member['margin'] = member['widest']


@helper
def find_obstacle_rows(
    tick: Tick, members: np.ndarray, contacts: np.ndarray, rows: np.ndarray
) -> int:
    """
    Write the rows of contacts with obstacles, at the start shapes.

    Parameters
    ----------
    tick : Tick
    members : (m,) MEMBER
    contacts : (c,) CONTACT
        scratch for the contacts of one body with one obstacle
    rows : (k,) ROW
        written

    Returns
    -------
    int
        number of rows, even beyond the capacity

    """
    found = 0
    for number in range(len(members)):
        member = members[number]
        if is_held(member) or (member['is_soft'] and not member['starts']):
            continue
        end, is_done = found, False
        while not is_done:
            end, is_done = find_rows_of_body(tick, members, contacts, rows, number, found)
            if not is_done:
                # it is not steady: begin again with the wider margin, which is wide enough
                member['margin'] = member['widest']
        found = end
    return found


@helper
def find_rows_of_body(
    tick: Tick,
    members: np.ndarray,
    contacts: np.ndarray,
    rows: np.ndarray,
    number: int,
    found: int,
) -> tuple[int, bool]:
    """
    Write the rows of one body, up to the first contact that is too wild for its narrow margin.

    Parameters
    ----------
    number : int
        of the member
    found : int
        number of rows before
    others
        see `find_obstacle_rows`

    Returns
    -------
    found : int
        number of rows, even beyond the capacity
    is_calm : bool
        whether there is no such contact

    """
    x, member, obstacles = tick.x, members[number], tick.obstacles
    body = tick.bodies[member['body']]
    first, count = body['first'], body['surface']
    start, end, reach = x[body['now']], x[1 - body['now']], body['thickness'] + member['margin']
    low, high, low_before, high_before, is_bounded = ZERO, ZERO, ZERO, ZERO, False
    for which in range(len(obstacles)):
        obstacle = obstacles[which]
        if obstacle['kind'] != PLANE:
            if not is_bounded:
                low, high = box_around(end, first, count)
                low_before, high_before = box_around(start, first, count)
                is_bounded = True
            if not may_touch(obstacle, low, high, low_before, high_before, reach):
                continue
        near = find_contacts(
            obstacle, tick.trees, end, start, first, count, reach, True, contacts, 0
        )
        for k in range(near):
            if tick.is_pinned[first + contacts[k]['particle']]:
                continue
            if found < len(rows):
                velocity = put_obstacle_row(
                    rows[found], contacts[k], tick, number, body, which, reach
                )
                complete_row(rows[found], members, velocity, tick.h)
                if member['margin'] < member['widest'] and not is_calm(rows[found], member):
                    return found, False
            found += 1
    return found, True


@helper
def may_yield(contact: np.void, members: np.ndarray, is_pinned: np.ndarray) -> bool:
    """Return whether one side of a contact is not held by pins where it is touched."""
    owner, particles = contact['body'], contact['particles']
    own = 1 if contact['edges'] < 0 else 2
    if owner < len(members) and not is_held(members[owner]):
        for corner in range(own):
            if not is_pinned[particles[corner]]:
                return True
    if is_held(members[contact['other']]):
        return False
    for corner in range(own, 4):
        if contact['coefficients'][corner] != 0.0 and not is_pinned[particles[corner]]:
            return True
    return False


@helper
def is_held(member: np.void) -> bool:
    """Return whether pins hold all of a body."""
    return member['has_pins'] and not member['is_soft'] and is_fixed(member)


@helper
def is_fixed(member: np.void) -> bool:
    """Return whether pins let a body not even turn."""
    allowed = member['allowed']
    return allowed[0, 0] + allowed[1, 1] + allowed[2, 2] == 0.0


@helper
def find_near_obstacles(
    body: np.void, member: np.void, way: float, obstacles: np.ndarray, x: np.ndarray
) -> tuple[bool, float]:
    """
    Return whether a body may touch obstacles in this tick, and its speed relative to these, m/s.

    That of the fastest; `way`, m, is how far from its flight the body might stay.
    """
    x0, x1 = x[body['now']], x[1 - body['now']]
    low, high = box_around(x1, body['first'], body['surface'])
    low_before, high_before = box_around(x0, body['first'], body['surface'])
    reach, found, speed = body['thickness'] + member['margin'] + way, False, 0.0
    reach += MARGIN * member['scale']
    for which in range(len(obstacles)):
        obstacle = obstacles[which]
        near = False
        if obstacle['kind'] == PLANE:
            rotation = matrix_of(obstacle['rotation'])
            normal = (rotation[0][2], rotation[1][2], rotation[2][2])
            nearest = -dot(vector_of(obstacle['position']), normal)
            for axis in range(3):
                one = min(low[axis], low_before[axis]) * normal[axis]
                two = max(high[axis], high_before[axis]) * normal[axis]
                nearest += min(one, two)
            near = nearest <= reach
        else:
            near = may_touch(obstacle, low, high, low_before, high_before, reach)
        if near:
            found = True
            velocity = velocity_at(obstacle, vector_of(member['centre']))
            speed = max(speed, norm(minus(velocity, vector_of(member['velocity']))))
    return found, speed


@helper
def confirm_steady(
    bodies: np.ndarray, members: np.ndarray, rows: np.ndarray, memory: np.ndarray, at_once: bool
) -> bool:
    """
    Find which bodies are steady, and return whether others need wider margins.

    Where all contacts of a body that press persist and their flights are those of the tick before,
    the body is steady.

    Parameters
    ----------
    at_once : bool
        whether all bodies get wider margins if one needs them
    bodies, members, rows, memory
        see `find_rows`

    """
    persists, seen = np.zeros(len(members), np.bool_), np.zeros(len(memory), np.bool_)
    for member in members:
        member['steady'] = True
    for row in rows:
        if not row['is_new']:
            seen[row['known']] = True
        for side in range(2):
            index, _ = side_of(row, side)
            if index >= 0:
                persists[index] = persists[index] or not row['is_new']
                if not is_calm(row, members[index]):
                    members[index]['steady'] = False
    candidates, count = np.empty(len(members), np.int64), 0
    for number in range(len(members)):
        members[number]['steady'] = members[number]['steady'] and persists[number]
        if members[number]['steady']:
            candidates[count] = number
            count += 1
    for k in range(len(memory)):
        if not seen[k] and norm(vector_of(memory[k]['force'])) > 0.0:
            for number in candidates[:count]:
                member = members[number]
                if concerns(memory[k]['key'], bodies[member['body']]['id']):
                    member['steady'] = False
    too_narrow = False
    for member in members:
        too_narrow = too_narrow or (not member['steady'] and member['margin'] < member['widest'])
    for member in members:
        if too_narrow and (at_once or not member['steady']):
            member['margin'] = member['widest']
    return too_narrow


@helper
def find_face_rows(
    tick: Tick,
    contacts: np.ndarray,
    sets: np.ndarray,
    members: np.ndarray,
    rows: np.ndarray,
    found: int,
) -> int:
    """
    Append the rows of contacts between bodies, and of points with faces of bodies.

    What pins hold on both sides cannot yield, and its force would be any.

    Parameters
    ----------
    tick : Tick
    contacts : (c,) CONTACT
        of the narrow phase
    sets : (s,) POINT_SET
    members : (m,) MEMBER
    rows : (k,) ROW
        written
    found : int
        number of rows before

    Returns
    -------
    int
        number of rows, even beyond the capacity

    """
    first = found
    for contact in contacts:
        if not may_yield(contact, members, tick.is_pinned):
            continue
        if found < len(rows):
            velocity = put_face_row(rows[found], contact, tick, members, sets)
            complete_row(rows[found], members, velocity, tick.h)
            is_held_somewhere = rows[found]['of_face'] and members[contact['other']]['has_pins']
            if is_held_somewhere and contradicts(rows[found], contact, rows[:first]):
                continue
        found += 1
    return found


@helper
def contradicts(row: np.void, contact: np.void, rows: np.ndarray) -> bool:
    """
    Return whether a face is to leave an obstacle by a side by which its corners cannot.

    An obstacle that is within a body, as where it has passed pinned particles, presses the
    corners of a face outwards, and so cannot get out through that face: particles would be moved
    any distance for it.

    Parameters
    ----------
    row : ROW
        of a point of the obstacle with the face
    contact : CONTACT
        the same, of the narrow phase
    rows : (k,) ROW
        of all particles with obstacles

    """
    normal, particles = vector_of(row['normal']), contact['particles']
    for other in rows:
        if other['obstacle'] != row['obstacle'] or other['one'] != row['one']:
            continue
        column = other['column']
        is_corner = column == particles[1] or column == particles[2] or column == particles[3]
        if is_corner and dot(vector_of(other['normal']), normal) < 0.0:
            return True
    return False
