# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts as rows of the contact problem."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from softbody_ros.core.body import IDENTITIES, RIGID
from softbody_ros.core.collision.obstacles import velocity_at
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.surface import LARGEST_MESH
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Matrix,
    Vector,
    along,
    applied,
    applied_transposed,
    column_of,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
    tangents_of,
    vector_of,
)

CONTACT_FREQUENCY = 3e3
"""ω, rad/s, of a rigid body on a contact: its compliance 1 / (M ω²) bounds the forces of obstacles
that a body cannot obey."""
LARGEST_SOFTNESS = 10.0
"""Ratio of compliances between particles of a body, at most."""
RECOVERY = 2.0
"""Speed, in RMS radii per second, at which what is found inside something gets out."""
SUDDEN = 0.2
"""Depth before the tick, in RMS radii, beyond that after the last one, which nothing explains but
that a particle has met another side."""
TOUCHING = 1e-9
"""Gap before the tick, in RMS radii, up to which a contact existed."""
LINEARISED = 5e-6
"""Overlap, or error of gaps by linearisation, in RMS radii, that is tolerated."""

ROW = np.dtype(
    [
        # the contact problem, see `problem`: components are along the normal and two tangents
        ('one', np.int64),  # member that f acts on
        ('two', np.int64),  # member that −f acts on, or −1
        ('bias', np.float64, (3,)),  # b
        ('compliance', np.float64, (2,)),  # c of the normal, and of the tangents
        ('lasting', np.float64),  # of these, what yields to all of the force, not to changes only
        ('friction', np.float64),  # μ
        ('base', np.float64, (3,)),  # f⁰
        ('force', np.float64, (3,)),  # f
        ('diagonal', np.float64, (2,)),  # of c + J Jᵀ: normal, and the larger tangent
        ('normal', np.float64, (3,)),  # from the second side to the first
        ('tangents', np.float64, (2, 3)),
        # of deformable bodies: the shares of f on particles, numbered within the island
        ('shares', np.float64, (4,)),
        ('particles', np.int64, (4,)),
        ('shares_particles', np.bool_),  # whether other contacts act on these, too
        ('rubs', np.bool_),  # with viscous friction whether it presses or not
        # of Newton's method, see `newton`
        ('target', np.float64, (3,)),  # what f approaches
        ('best', np.float64, (3,)),  # of all that f has been, nearest to a solution
        ('radius', np.float64),  # of the friction disc
        ('disc_change', np.float64),  # its last change
        ('model_bias', np.float64, (3,)),  # if R is taken as diagonal
        ('model_compliance', np.float64, (2,)),
        ('stiffness', np.float64, (4,)),  # G: normal, and 11, 12, 22 of the tangents
        ('face', np.float64, (4,)),  # projector on forces that may change, the same components
        ('curvature', np.float64),  # of the disc's edge, times the force that presses against it
        # the contact, as it is found: see `detection`
        ('key', np.int64),  # identifies it from tick to tick
        # what all contacts are looked through for
        ('obstacle', np.int64),  # second side, or −1
        ('gap', np.float64),  # after the flight, m
        ('gap_before', np.float64),  # after the flight of the tick before; 0 if it is new, m
        ('depth_before', np.float64),  # after the tick before; infinite if it is new, m
        ('coasting', np.float64),  # gap if both sides went on with their speed before, m
        ('known', np.int64),  # where it is in what is remembered, or −1
        ('is_placed', np.bool_),  # whether it was made, and then the second side was put elsewhere
        ('is_new', np.bool_),  # not made at the tick before
        ('viscosity', np.float64),  # share of the sliding that viscous friction removes, or −1
        ('column', np.int64),  # particle of the world, or −1
        ('columns', np.int64, (4,)),  # of deformable bodies: the particles, of the world
        ('offsets', np.float64, (2, 3)),  # of both sides in the flight from the start shape, m
        ('point', np.float64, (3,)),  # of both sides, of the start shapes, m
        ('thickness', np.float64),  # distance kept, m
        ('motion', np.float64, (3,)),  # displacement of the first side in the flight, m
        ('other_motion', np.float64, (3,)),  # of the second side, m
        ('other_velocity', np.float64, (3,)),  # of the second side if it is no member, m/s
        ('slip', np.float64, (2,)),  # along the tangents from touching to the end, m
        ('approach', np.float64),  # normal speed at touching; negative, m/s
        ('closing', np.float64),  # normal speed of approach at the end of the flight, m/s
        ('remembered', np.float64, (3,)),  # force of the tick before
        # depth at the end, m: what is found deep inside gets out slowly
        ('tolerated', np.float64),
        ('inverse_mass', np.float64),  # sum of both sides, 1/kg
        ('softness', np.float64),  # of its compliance, relative to the mean: few on little area
        ('elasticity', np.float64),
        ('overlaps', np.bool_),  # whether its bodies are inside each other, see `overlaps`
        ('of_face', np.bool_),  # whether the normal is that of a face of the first side
        ('of_edges', np.bool_),  # whether it is that of an edge of each side
        # of its solution, see `positions` and `velocities`
        ('positional', np.float64, (3,)),  # force that is constant over the tick, N
        ('free', np.float64, (2,)),  # slip, or its speed, that viscous friction reduces
        ('end_point', np.float64, (3,)),  # after the tick, m
        ('linear_gap', np.float64),  # at the end if no force acts, for the last linearisation, m
        ('end_gap', np.float64),  # at the end, as linearised last, m
    ],
    align=True,
)
"""A contact."""

MEMORY = np.dtype(
    [
        ('key', np.int64),
        ('force', np.float64, (3,)),  # N
        ('tolerated', np.float64),  # depth, m
        ('gap', np.float64),  # after the flight, m
        ('depth', np.float64),  # at the end, m
    ],
    align=True,
)
"""A contact at the last tick."""
NO_MEMORY = np.zeros(0, MEMORY)
OWNER, PARTNER = 1 << 23, 1 << 42
"""Factors of their `id` in the key of a contact, beyond the numbers of particles and of owners."""
EDGES = OWNER - LARGEST_MESH
"""Pairs of edges of two bodies that keys tell apart: all, of up to 2000 sharp ones of each."""
OF_BODIES, OF_POINTS, OF_OVERLAPS = 1 << 61, 2 << 61, 3 << 61
"""Kinds of contacts in their keys; those with obstacles have none. And that of a pair of bodies
that are inside each other, which is remembered like a contact."""


class Tick(NamedTuple):
    """Bodies after their flight, and obstacles: arrays of all of the world, see `find_rows`."""

    bodies: np.ndarray
    shapes: np.ndarray
    weights: np.ndarray
    x: np.ndarray
    v: np.ndarray
    flown: np.ndarray
    obstacles: np.ndarray
    trees: Trees
    h: float
    memory: np.ndarray
    is_pinned: np.ndarray


@helper
def key_of(kind: int, partner: int, owner: int, particle: int) -> int:
    """
    Return the key of a contact, from tick to tick.

    Parameters
    ----------
    kind : int
    partner, owner : int
        `id` of the obstacle or body, and of the body that has the particle
    particle : int
        of that body, or from `LARGEST_MESH` on a pair of its edges and those of the partner

    """
    return kind + partner * PARTNER + owner * OWNER + particle


@helper
def key_of_pair(one: int, two: int) -> int:
    """Return the key of a pair of bodies that are inside each other, by their `id`."""
    return key_of(OF_OVERLAPS, max(one, two), min(one, two), 0)


@helper
def concerns(key: int, number: int) -> bool:
    """Return whether a key is that of a contact of a body, or on it, by its `id`."""
    partner, owner = key // PARTNER % IDENTITIES, key // OWNER % IDENTITIES
    return owner == number or (partner == number and OF_BODIES <= key < OF_POINTS)


def without(memory: np.ndarray, bodies: np.ndarray, obstacles: np.ndarray) -> np.ndarray:
    """Return MEMORY without contacts of bodies and obstacles that are removed, by their `id`."""
    key = memory['key']
    partner, owner = key // PARTNER % IDENTITIES, key // OWNER % IDENTITIES
    of_bodies = ((key >= OF_BODIES) & (key < OF_POINTS)) | (key >= OF_OVERLAPS)
    gone = np.isin(owner, bodies) | (np.isin(partner, bodies) & of_bodies)
    gone |= np.isin(partner, obstacles) & (key < OF_BODIES)
    return memory[~gone]


@helper
def complete_row(row: np.void, members: np.ndarray, velocity: Vector, h: float) -> None:
    """
    Write what follows from the geometry of a contact.

    Parameters
    ----------
    row : ROW
        with sides, point, normal, motions, gap after the flight, and what is remembered
    members : (m,) MEMBER
    velocity : vector
        of the first side relative to the second, before the tick, m/s
    h : float
        s

    """
    one, normal = members[row['one']], vector_of(row['normal'])
    row['inverse_mass'] = 0.0 if one['is_soft'] else 1.0 / one['mass']
    if row['two'] >= 0 and not members[row['two']]['is_soft']:
        row['inverse_mass'] += 1.0 / members[row['two']]['mass']
    motion = minus(vector_of(row['motion']), vector_of(row['other_motion']))
    before = row['gap'] - dot(normal, motion)
    recovered = RECOVERY * one['scale'] * h
    if one['has_pins'] or (row['two'] >= 0 and members[row['two']]['has_pins']):
        # what pins hold may not have got out of the way
        row['tolerated'] = math.inf
    row['is_placed'] = row['is_placed'] and not row['is_new']
    if not row['is_placed'] and -before > row['depth_before'] + SUDDEN * one['scale']:
        # another side: as if it were found there
        row['tolerated'] = math.inf
    row['tolerated'] = max(min(row['tolerated'], -before) - recovered, 0.0)
    row['gap'] += row['tolerated']
    touching, approach = touch(
        row['gap'] - dot(normal, motion), row['gap'], dot(normal, velocity), h,
        TOUCHING * one['scale'], row['is_new'],
    )  # fmt: skip
    row['approach'] = approach
    row['coasting'] = row['gap'] - dot(normal, motion) + h * dot(normal, velocity)
    speed = 2.0 * dot(normal, motion) / h - dot(normal, velocity)
    row['closing'] = -speed
    put_slip(row, along(motion, -touching, velocity))


@helper
def put_slip(row: np.void, slip: Vector) -> None:
    """Write the tangents of a contact, and its slip along them."""
    first, second = tangents_of(vector_of(row['normal']))
    put_vector(row['tangents'][0], first)
    put_vector(row['tangents'][1], second)
    row['slip'][0], row['slip'][1] = dot(first, slip), dot(second, slip)


@helper
def touch(
    before: float, after: float, speed: float, h: float, touching: float, is_new: bool
) -> tuple[float, float]:
    """
    Return when a contact is made within a tick, s, and the normal speed then, at most 0.

    The gap is a parabola with the given values before and after the tick, m, and the given speed
    before, m/s: so the speed at an impact, and the height of a bounce, do not depend on the step.
    """
    if before > touching:
        acceleration = 2.0 * (after - before - speed * h) / (h * h)
        if after >= 0.0:
            return h, min(speed + acceleration * h, 0.0)
        root = math.sqrt(max(speed * speed - 2.0 * acceleration * before, 0.0))
        return min(2.0 * before / max(root - speed, 2.0 * before / h), h), -root
    if not is_new:
        return 0.0, 0.0
    return 0.0, -abs(speed) if after < 0.0 else 0.0


@helper
def carried(
    point: Vector, position: Vector, rotation: Matrix, to_position: Vector, to_rotation: Matrix
) -> Vector:
    """Return where a point of something rigid gets with it from one pose to another, m."""
    local = applied_transposed(rotation, minus(point, position))
    return plus(to_position, applied(to_rotation, local))


@helper
def motion_with(obstacle: np.void, point: Vector) -> Vector:
    """Return the displacement in the tick of the point of an obstacle that is at `point`, m."""
    if not obstacle['moved']:
        return ZERO
    before = carried(
        point, vector_of(obstacle['position']), matrix_of(obstacle['rotation']),
        vector_of(obstacle['position_before']), matrix_of(obstacle['rotation_before']),
    )  # fmt: skip
    return minus(point, before)


@helper
def motion_from(obstacle: np.void, point: Vector) -> Vector:
    """Return the displacement in the tick of the point of an obstacle that was at `point`, m."""
    if not obstacle['moved']:
        return ZERO
    after = carried(
        point, vector_of(obstacle['position_before']), matrix_of(obstacle['rotation_before']),
        vector_of(obstacle['position']), matrix_of(obstacle['rotation']),
    )  # fmt: skip
    return minus(after, point)


@helper
def put_obstacle_row(
    row: np.void,
    contact: np.void,
    tick: Tick,
    number: int,
    body: np.void,
    which: int,
    reach: float,
) -> Vector:
    """
    Write the row of a contact of a particle with an obstacle.

    Parameters
    ----------
    row : ROW
    contact : CONTACT
        of `obstacle_contacts`
    tick : Tick
    number : int
        of the member
    body : BODY
        that it is
    which : int
        of the obstacles
    reach : float
        that depths are measured from, m

    Returns
    -------
    vector
        velocity of the particle relative to the obstacle, before the tick, m/s

    """
    obstacle, particle = tick.obstacles[which], contact['particle']
    column, point = body['first'] + particle, vector_of(contact['point'])
    row['one'], row['two'], row['obstacle'] = number, -1, which
    row['column'] = column
    row['key'] = key_of(0, obstacle['id'], body['id'], particle)
    recall(row, tick.memory)
    put_vector(row['point'], point)
    put_vector(row['normal'], vector_of(contact['normal']))
    row['thickness'] = body['thickness']
    row['gap'] = reach - contact['depth'] - body['thickness']
    begin_sides(row)
    add_side(row, 0, 0, 1.0, column, point, body, tick)
    row['gap'] += dot(vector_of(row['normal']), vector_of(row['offsets'][0]))
    belt = applied(matrix_of(obstacle['rotation']), vector_of(obstacle['surface_velocity']))
    belt = along_surface(belt, vector_of(row['normal']))
    if row['is_new']:
        touched, moved = point, motion_with(obstacle, point)
    else:
        # where it lies, not where it would get without friction: on a table that turns it would
        # go outwards
        start = column_of(tick.x[body['now']], column)
        moved = motion_from(obstacle, start)
        touched = plus(start, moved)
    put_vector(row['other_motion'], along(moved, tick.h, belt))
    surface = plus(velocity_at(obstacle, touched), belt)
    put_vector(row['other_velocity'], surface)
    put_laws(row, body, obstacle['friction'], obstacle['elasticity'])
    row['of_face'] = row['of_edges'] = False
    row['is_placed'] = obstacle['is_placed']
    row['softness'] = softness_of(weight_of(particle, body, tick), body['surface'])
    return minus(column_of(tick.v[body['now']], column), surface)


@helper
def weight_of(particle: int, body: np.void, tick: Tick) -> float:
    """Return the share of a body's mass of one of its particles."""
    return tick.weights[tick.shapes[body['shape']]['first'] + particle]


@helper
def put_other_side(row: np.void, normal: Vector, gap: float, end: Vector) -> None:
    """
    Change the copy of a row of a particle to its contact with another side of the obstacle.

    Parameters
    ----------
    row : ROW
    normal : vector
        of the other side
    gap : float
        from it after the tick, m
    end : vector
        position of the particle then, m

    """
    row['key'] = -1 - row['key']
    put_vector(row['normal'], normal)
    row['gap'] = gap - dot(normal, minus(end, flown(row)))
    put_slip(row, minus(vector_of(row['motion']), vector_of(row['other_motion'])))
    row['approach'] = row['closing'] = 0.0
    row['is_new'] = True
    put_vector(row['remembered'], ZERO)


@helper
def flown(row: np.void) -> Vector:
    """Return where the first side of a contact is after the flight, m."""
    return plus(vector_of(row['point']), vector_of(row['offsets'][0]))


@helper
def end_normal(row: np.void, members: np.ndarray) -> Vector:
    """Return the normal of a contact after the tick: that of a face turns with its body."""
    normal = vector_of(row['normal'])
    if row['two'] >= 0:
        turned = applied(matrix_of(members[row['two']]['rotation']), normal)
        if row['of_edges']:
            turned = plus(turned, applied(matrix_of(members[row['one']]['rotation']), normal))
            turned = scaled(1.0 / norm(turned), turned)
        return turned
    if row['of_face']:
        return applied(matrix_of(members[row['one']]['rotation']), normal)
    return normal


@helper
def is_of_pair(row: np.void) -> bool:
    """Return whether a contact is between two bodies."""
    return row['two'] >= 0 and row['one'] != row['two']


@helper
def side_of(row: np.void, side: int) -> tuple[int, float]:
    """Return the member of one side of a contact, or −1, and the sign of the force on it."""
    if side == 0:
        return row['one'], 1.0
    return row['two'], -1.0


@helper
def share_of(row: np.void, side: int, corner: int) -> float:
    """Return the share of f on a particle of one side of a contact; 0 if it is none of it."""
    share = row['shares'][corner]
    return max(share if side == 0 else -share, 0.0)


@helper
def begin_sides(row: np.void) -> None:
    """Begin to add up what the particles of both sides do."""
    for corner in range(4):
        row['shares'][corner], row['particles'][corner] = 0.0, -1
    for side in range(2):
        put_vector(row['offsets'][side], ZERO)
    put_vector(row['motion'], ZERO)
    put_vector(row['other_motion'], ZERO)


@helper
def add_side(
    row: np.void,
    side: int,
    corner: int,
    share: float,
    column: int,
    start: Vector,
    body: np.void,
    tick: Tick,
) -> None:
    """
    Add a particle with its share to one side of a contact.

    Parameters
    ----------
    row : ROW
    side, corner : int
        where in the row
    share : float
    column : int
        particle of the world
    start : vector
        where it is in the start shape, m
    body : BODY
    tick : Tick

    """
    end = start
    if body['mode'] != RIGID:
        end = column_of(tick.flown, column)
        row['columns'][corner] = column
        row['shares'][corner] = share if side == 0 else -share
    offset = along(vector_of(row['offsets'][side]), share, minus(end, start))
    put_vector(row['offsets'][side], offset)
    moved = row['motion'] if side == 0 else row['other_motion']
    motion = minus(end, column_of(tick.x[body['now']], column))
    put_vector(moved, along(vector_of(moved), share, motion))


@helper
def softness_of(weight: float, count: int) -> float:
    """Return the compliance at a particle relative to the mean, from its mass share: its area."""
    return min(max(1.0 / (count * max(weight, 1e-12)), 1.0 / LARGEST_SOFTNESS), LARGEST_SOFTNESS)


@helper
def along_surface(velocity: Vector, normal: Vector) -> Vector:
    """Return the part of a velocity along a surface."""
    return along(velocity, -dot(velocity, normal), normal)


@helper
def put_laws(row: np.void, body: np.void, friction: float, elasticity: float) -> None:
    """Write friction and ε of a contact of a body with an obstacle, with values of its own."""
    own, rebound = body['friction'], body['elasticity']
    if friction >= 0.0:
        own = math.sqrt(own * friction)
        if not body['coulomb']:
            own = min(own, 1.0)
    if elasticity >= 0.0 and body['mode'] == RIGID:
        rebound = math.sqrt(rebound * elasticity)
    put_friction(row, body['coulomb'], own)
    row['elasticity'] = rebound


@helper
def put_friction(row: np.void, coulomb: bool, friction: float) -> None:
    """Write the law of friction: the coefficient, or the share that viscous friction removes."""
    row['friction'] = friction if coulomb else math.inf
    row['viscosity'] = -1.0 if coulomb else friction
    row['rubs'] = False


@helper
def copy_record(target: np.ndarray, to: int, source: np.ndarray, index: int) -> None:
    """
    Copy a record of 8-byte words to an array of the same type.

    Word by word: an assignment would be unrolled by the compiler, which takes it a second.
    """
    words, of_source = target.view(np.float64), source.view(np.float64)
    size = target.itemsize // 8
    for k in range(size):
        words[to * size + k] = of_source[index * size + k]


@helper
def in_world(row, components):  # type: ignore[no-untyped-def]
    """Return the vector of its components along normal and tangents of a contact."""
    result = scaled(components[0], vector_of(row['normal']))
    result = along(result, components[1], vector_of(row['tangents'][0]))
    return along(result, components[2], vector_of(row['tangents'][1]))


@helper
def recall(row: np.void, memory: np.ndarray) -> None:
    """Write the force of a contact at the last tick; zero if it was not made."""
    known = place_of_key(row['key'], memory)
    row['is_new'], row['known'], row['overlaps'] = known < 0, known, False
    put_vector(row['remembered'], ZERO)
    row['tolerated'], row['gap_before'], row['depth_before'] = math.inf, 0.0, math.inf
    if not row['is_new']:
        put_vector(row['remembered'], vector_of(memory[known]['force']))
        row['tolerated'], row['gap_before'] = memory[known]['tolerated'], memory[known]['gap']
        row['depth_before'] = memory[known]['depth']


@helper
def place_of_key(key: int, memory: np.ndarray) -> int:
    """Return where a key is in MEMORYs in their order, or −1."""
    low, high = 0, len(memory)
    while low < high:
        middle = (low + high) // 2
        if memory[middle]['key'] < key:
            low = middle + 1
        else:
            high = middle
    return low if low < len(memory) and memory[low]['key'] == key else -1


@helper
def put_face_row(
    row: np.void,
    contact: np.void,
    tick: Tick,
    members: np.ndarray,
    sets: np.ndarray,
) -> Vector:
    """
    Write the row of a contact of a particle, or a point, with a face of a body, or of two edges.

    Returns
    -------
    vector
        velocity of the first side relative to the second, before the tick, m/s

    """
    owner, other, bodies = contact['body'], contact['other'], tick.bodies
    body = bodies[members[other]['body']]
    begin_sides(row)
    if owner < len(members):
        one = bodies[members[owner]['body']]
        is_face = contact['edges'] < 0
        own = 1 if is_face else 2
        velocity = put_corners(row, 0, contact, 0, own, one, tick)
        other_velocity = put_corners(row, 1, contact, own, 4, body, tick)
        row['one'], row['two'], row['obstacle'], row['of_face'] = owner, other, -1, False
        row['of_edges'], row['is_placed'] = not is_face, False
        nearest = 1 if contact['coefficients'][1] > 0.5 else 0
        column = contact['particles'][nearest]
        number = column - one['first'] if is_face else LARGEST_MESH + contact['edges'] % EDGES
        row['key'] = key_of(OF_BODIES, body['id'], one['id'], number)
        recall(row, tick.memory)
        # forces on edges of deformable bodies are those on both of their ends
        row['column'] = column if is_face or one['mode'] == RIGID else -1
        weight = weight_of(column - one['first'], one, tick)
        row['softness'] = softness_of(weight, one['surface'])
        if not is_face:
            nearest = 3 if contact['coefficients'][3] < -0.5 else 2
            weight = weight_of(contact['particles'][nearest] - body['first'], body, tick)
            row['softness'] = 0.5 * (row['softness'] + softness_of(weight, body['surface']))
        row['gap'] = members[owner]['margin'] + members[other]['margin'] - contact['depth']
        put_body_row(row, contact, one, body)
        return minus(velocity, other_velocity)
    velocity = put_corners(row, 0, contact, 1, 4, body, tick)
    number = owner - len(members)
    row['one'], row['two'], row['obstacle'], row['of_face'] = (
        other, -1, sets[number]['obstacle'], True,
    )  # fmt: skip
    row['of_edges'], row['is_placed'] = False, sets[number]['is_placed']
    row['key'] = key_of(OF_POINTS, number, body['id'], contact['particles'][0])
    recall(row, tick.memory)
    row['column'], row['softness'] = -1, 1.0
    row['gap'] = members[other]['margin'] - contact['depth']
    put_point_row(row, contact, sets[number], body, tick.h)
    return minus(velocity, vector_of(row['other_velocity']))


@helper
def put_corners(
    row: np.void,
    side: int,
    contact: np.void,
    first: int,
    last: int,
    body: np.void,
    tick: Tick,
) -> Vector:
    """Write the corners of one side of a contact; return its velocity, m/s."""
    start, velocities, velocity = tick.x[1 - body['now']], tick.v[body['now']], ZERO
    for corner in range(first, last):
        column, share = contact['particles'][corner], abs(contact['coefficients'][corner])
        velocity = along(velocity, share, column_of(velocities, column))
        at = column_of(start, column)
        add_side(row, side, corner, share, column, at, body, tick)
    put_vector(row['point'], vector_of(contact['point']))
    return velocity


@helper
def put_body_row(row: np.void, contact: np.void, one: np.void, two: np.void) -> None:
    """Write the normal and the gap between two bodies, and the laws of both materials."""
    normal = vector_of(contact['normal'])
    put_vector(row['normal'], normal)
    put_vector(row['other_velocity'], ZERO)
    offset = minus(vector_of(row['offsets'][0]), vector_of(row['offsets'][1]))
    row['gap'] += dot(normal, offset)
    coulomb = one['coulomb'] or two['coulomb']
    friction = math.sqrt(one['friction'] * two['friction'])
    if one['coulomb'] != two['coulomb']:
        friction = one['friction'] if one['coulomb'] else two['friction']
    put_friction(row, coulomb, friction)
    row['elasticity'] = math.sqrt(one['elasticity'] * two['elasticity'])


@helper
def put_point_row(
    row: np.void, contact: np.void, point_set: np.void, body: np.void, h: float
) -> None:
    """Write the side of a point that touches a face, and its motion."""
    normal = vector_of(contact['normal'])
    put_vector(row['normal'], scaled(-1.0, normal))
    arm = minus(vector_of(contact['point']), vector_of(point_set['centre']))
    velocity = plus(vector_of(point_set['linear']), cross(vector_of(point_set['angular']), arm))
    belt = along_surface(vector_of(point_set['surface_velocity']), normal)
    velocity = plus(velocity, belt)
    row['gap'] += dot(vector_of(row['normal']), vector_of(row['offsets'][0]))
    put_vector(row['other_motion'], scaled(h, velocity))
    put_vector(row['other_velocity'], velocity)
    put_laws(row, body, point_set['friction'], point_set['elasticity'])
