# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact of rigid bodies with obstacles: least impulses for non-penetration, and friction."""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.body import RIGID
from softbody_ros.core.collision.obstacle_contacts import bounds_of, find_contacts, may_touch
from softbody_ros.core.collision.shapes import PLANE
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.support import SLOW_TICKS, TINY
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.small_systems import eigen, least_vector, product_of_rows
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Matrix,
    Vector,
    along,
    applied,
    column_of,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_column,
    put_vector,
    scaled,
    tangents_of,
    vector_of,
)
from softbody_ros.core.shape_matching.polar_decomposition import (
    orthogonal_columns,
    rotation_by_vector,
)

CORRECTION_ROUNDS = 3
"""Passes of position correction over all obstacles."""
FRICTION_ROUNDS, FRICTION_SWEEPS = 4, 8
TOLERANCE = 1e-9
"""Relative tolerance of the normal-velocity constraints."""
SAME = 1e-13
"""Relative change of the needed speeds that is rounding."""
RANK = 1e-12
"""Eigenvalue, relative to the largest, below which friction has no effect."""

Twist = tuple[Vector, Vector]
"""Velocity of the centre of mass, m/s, and angular velocity, rad/s; or a wrench, per mass."""
STILL = (ZERO, ZERO)


@kernel
def resolve(
    bodies: np.ndarray,
    awake: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    gravity: np.ndarray,
    h: float,
    contacts: np.ndarray,
    scratch: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """
    Resolve contacts of rigid bodies with all obstacles at once, then correct positions.

    Parameters
    ----------
    bodies, awake, x, v, gravity, h
        see `flight.predict_and_match`; the half of `x` and `v` being computed is changed
    obstacles : (O,) OBSTACLE
    trees : Trees
        of the meshes of obstacles
    contacts : (C,) CONTACT
        scratch for the contacts of a body with all obstacles
    scratch : (7, C) float
        the same
    obstacle_impulse, normal_impulse
        results, see `exchange`

    """
    for index in range(len(awake)):
        body = bodies[awake[index]]
        if body['mode'] != RIGID:
            continue
        start, x1, v1 = x[body['now']], x[1 - body['now']], v[1 - body['now']]
        found = find_all(body, start, x1, obstacles, trees, contacts)
        if found > 0:
            collide(body, x1, v1, vector_of(gravity), h, contacts[:found], scratch)
            give(
                body, obstacles, contacts[:found], scratch,
                obstacle_impulse[awake[index], 1 - body['now']], normal_impulse[1 - body['now']],
            )  # fmt: skip
            correct_position(body, start, x1, obstacles, trees, contacts)


@helper
def find_all(
    body: np.void,
    start: np.ndarray,
    x: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    contacts: np.ndarray,
) -> int:
    """Write the contacts of a body with all obstacles, and return their number."""
    found = 0
    for number in range(len(obstacles)):
        found = find_with(body, start, x, obstacles, number, trees, contacts, found)
    return min(found, len(contacts))


@helper
def find_with(
    body: np.void,
    start: np.ndarray,
    x: np.ndarray,
    obstacles: np.ndarray,
    number: int,
    trees: Trees,
    contacts: np.ndarray,
    found: int,
) -> int:
    """Append the contacts of a body with one obstacle, and return the number of all."""
    obstacle = obstacles[number]
    if not is_near(body, start, x, obstacle):
        return found
    total = find_contacts(
        obstacle, trees, x, start, body['first'], body['count'], body['thickness'], True,
        contacts, found,
    )  # fmt: skip
    for k in range(found, min(total, len(contacts))):
        contacts[k]['obstacle'] = number
    return total


@helper
def is_near(body: np.void, start: np.ndarray, x: np.ndarray, obstacle: np.void) -> bool:
    """Return whether a body may touch an obstacle in this tick."""
    if obstacle['kind'] == PLANE:
        return True
    low, high = bounds_of(x, body['first'], body['count'])
    low_before, high_before = bounds_of(start, body['first'], body['count'])
    return may_touch(obstacle, low, high, low_before, high_before, body['thickness'])


@helper
def collide(
    body: np.void,
    x: np.ndarray,
    v: np.ndarray,
    gravity: Vector,
    h: float,
    contacts: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """
    Apply contact impulses and friction to a rigid body, in place.

    They depend on each other, and are computed in alternation. The normal impulses are left in
    `scratch[3]`, those of friction in `scratch[4:]`, per mass.
    """
    centre, inverse = vector_of(body['centre']), matrix_of(body['inverse_inertia'])
    angular = applied(inverse, vector_of(body['angular_momentum']))
    before = (vector_of(body['velocity']), angular)
    acceleration = plus(gravity, vector_of(body['load']))
    target, speed, needed, impulse = (
        scratch[0],
        scratch[1],
        scratch[2],
        scratch[3, : len(contacts)],
    )
    fastest = find_rebound(body, before, centre, acceleration, h, contacts, target, speed)
    for k in range(len(contacts)):
        needed[k] = target[k] - speed[k]
    pressure, friction, shares = STILL, STILL, scratch[4:]
    for _ in range(FRICTION_ROUNDS):
        find_supports(centre, inverse, contacts, needed[: len(contacts)], impulse)
        pressure, largest = STILL, 0.0
        for k in range(len(contacts)):
            pressure = added(pressure, impulse[k], normal_wrench(contacts[k], centre))
            largest = max(largest, impulse[k])
        twist = added(before, 1.0, response(inverse, pressure))
        friction = find_friction(body, twist, centre, inverse, contacts, impulse, shares)
        given, change, size = response(inverse, friction), 0.0, 0.0
        for k in range(len(contacts)):
            last = needed[k]
            needed[k] = target[k] - speed[k] - speed_along(contacts[k], centre, given)
            change, size = max(change, abs(needed[k] - last)), max(size, abs(last))
        # if friction has lifted a body off its contacts, do not alternate without end
        if not (change > SAME * size and largest > 0.0):
            break
    wrench = added(pressure, 1.0, friction)
    put_vector(body['received'][0], plus(vector_of(body['received'][0]), wrench[0]))
    put_vector(body['received'][1], plus(vector_of(body['received'][1]), wrench[1]))
    change_twist = response(inverse, wrench)
    after = added(before, 1.0, change_twist)
    # loads act throughout the tick, impacts at the surface
    time = 0.0 if fastest > 0.0 else 0.5 * h
    place_rigidly(body, x, v, centre, scaled(time, change_twist[0]),
                  scaled(time, change_twist[1]), after)  # fmt: skip


@helper
def give(
    body: np.void,
    obstacles: np.ndarray,
    contacts: np.ndarray,
    scratch: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """Add what `collide` has left in `scratch` to what obstacles (O, 2, 3) and particles feel."""
    mass = body['mass']
    for k in range(len(contacts)):
        contact, size = contacts[k], scratch[3, k]
        normal_impulse[body['first'] + contact['particle']] += mass * size
        impulse = along(column_of(scratch[4:], k), size, vector_of(contact['normal']))
        origin = vector_of(obstacles[contact['obstacle']]['position'])
        add_wrench_about(
            obstacle_impulse[contact['obstacle']], origin, -mass, vector_of(contact['point']),
            impulse, ZERO,
        )  # fmt: skip
    body['touches'][1 - body['now']] = 1


@helper
def place_rigidly(
    body: np.void,
    x: np.ndarray,
    v: np.ndarray,
    centre: Vector,
    shift: Vector,
    angle: Vector,
    twist: Twist,
) -> None:
    """Move a body by a translation, m, and a rotation vector, and set its twist."""
    rotation, to = rotation_by_vector(angle), plus(centre, shift)
    for i in range(body['first'], body['first'] + body['count']):
        arm = applied(rotation, minus(column_of(x, i), centre))
        put_column(x, i, plus(to, arm))
        put_column(v, i, plus(twist[0], cross(twist[1], arm)))


# ----------------------------------------------------------------------------- twists and wrenches
@helper
def added(a: Twist, factor: float, b: Twist) -> Twist:
    """Return a + factor · b."""
    return along(a[0], factor, b[0]), along(a[1], factor, b[1])


@helper
def response(inverse: Matrix, wrench: Twist) -> Twist:
    """Return the change of twist by an impulsive wrench, per mass."""
    return wrench[0], applied(inverse, wrench[1])


@helper
def normal_wrench(contact: np.void, centre: Vector) -> Twist:
    """Return the wrench of a unit impulse along the normal of a contact."""
    normal = vector_of(contact['normal'])
    return normal, cross(minus(vector_of(contact['point']), centre), normal)


@helper
def speed_along(contact: np.void, centre: Vector, twist: Twist) -> float:
    """Return the normal speed at a contact for a twist, m/s."""
    wrench = normal_wrench(contact, centre)
    return dot(wrench[0], twist[0]) + dot(wrench[1], twist[1])


# ---------------------------------------------------------------------------------------- supports
@helper
def find_rebound(
    body: np.void,
    before: Twist,
    centre: Vector,
    acceleration: Vector,
    h: float,
    contacts: np.ndarray,
    target: np.ndarray,
    speed: np.ndarray,
) -> float:
    """
    Write target and present normal speeds of contacts, m/s.

    Returns
    -------
    float
        the largest target speed

    """
    slow, gained, bounces = SLOW_TICKS * h * norm(acceleration), -math.inf, False
    for k in range(len(contacts)):
        contact = contacts[k]
        normal = vector_of(contact['normal'])
        speed[k] = speed_along(contact, centre, before)
        speed[k] -= dot(normal, vector_of(contact['surface_velocity']))
        bounces = bounces or speed[k] < -slow
        gained = max(gained, -2.0 * dot(normal, acceleration) * contact['depth'])
    fastest = 0.0
    for k in range(len(contacts)):
        target[k] = 0.0
        if bounces and speed[k] < -slow:
            # without the speed gained by gravity since first contact
            impact = math.sqrt(max(speed[k] * speed[k] - gained, 0.0))
            target[k] = body['elasticity'] * impact
            fastest = max(fastest, target[k])
    return fastest


@helper
def find_supports(
    centre: Vector, inverse: Matrix, contacts: np.ndarray, needed: np.ndarray, impulse: np.ndarray
) -> None:
    """
    Write the impulses λ ≥ 0 of least kinetic energy that add at least the needed speeds.

    Parameters
    ----------
    centre : vector
        m
    inverse : matrix
        of the inertia, 1/m²
    contacts : (k,) CONTACT
    needed : (k,) float
        m/s
    impulse : (k,) float
        per mass, along the normals, m/s

    """
    worst = 0
    for k in range(len(contacts)):
        impulse[k] = 0.0
        if needed[k] > needed[worst]:
            worst = k
    largest = needed[worst]
    if not largest > 0.0:
        return
    # often the constraint with the largest needed speed satisfies all others
    unit_wrench = normal_wrench(contacts[worst], centre)
    change = response(inverse, unit_wrench)
    single = largest / (dot(unit_wrench[0], change[0]) + dot(unit_wrench[1], change[1]))
    enough = True
    for k in range(len(contacts)):
        missing = needed[k] - single * speed_along(contacts[k], centre, change)
        enough = enough and missing <= TOLERANCE * largest
    if enough:
        impulse[worst] = single
        return
    # in coordinates in which kinetic energy is half the squared norm
    columns, axes = orthogonal_columns(inverse)
    rows, scaled_needed = np.empty((len(contacts), 6)), np.empty(len(contacts))
    for k in range(len(contacts)):
        wrench = normal_wrench(contacts[k], centre)
        scaled_needed[k] = needed[k] / largest
        for axis in range(3):
            rows[k, axis] = wrench[0][axis]
            root = math.sqrt(norm(columns[axis]))
            rows[k, 3 + axis] = root * dot(axes[axis], wrench[1])
    least_vector(rows, scaled_needed, TOLERANCE, impulse)
    for k in range(len(contacts)):
        impulse[k] *= largest


# ---------------------------------------------------------------------------------------- friction
@helper
def find_friction(
    body: np.void,
    twist: Twist,
    centre: Vector,
    inverse: Matrix,
    contacts: np.ndarray,
    impulse: np.ndarray,
    shares: np.ndarray,
) -> Twist:
    """
    Return the wrench of friction, per mass, for given normal impulses.

    The impulses (3, k) of the contacts are written to `shares`.
    """
    loaded, total = 0, 0.0
    for k in range(len(contacts)):
        put_column(shares, k, ZERO)
        total += impulse[k]
        loaded += impulse[k] > 0.0
    if loaded == 0:
        return STILL
    if body['coulomb']:
        return coulomb(body['friction'], twist, centre, inverse, contacts, impulse, loaded, shares)
    return viscous(body['friction'], twist, centre, inverse, contacts, impulse, total, shares)


@helper
def viscous(
    friction: float,
    twist: Twist,
    centre: Vector,
    inverse: Matrix,
    contacts: np.ndarray,
    impulse: np.ndarray,
    total: float,
    shares: np.ndarray,
) -> Twist:
    """Return the wrench that removes a share of the sliding at the centre of pressure."""
    normal, arm, surface = ZERO, ZERO, ZERO
    for k in range(len(contacts)):
        share, contact = impulse[k] / total, contacts[k]
        normal = along(normal, share, vector_of(contact['normal']))
        arm = along(arm, share, minus(vector_of(contact['point']), centre))
        surface = along(surface, share, vector_of(contact['surface_velocity']))
    velocity = minus(plus(twist[0], cross(twist[1], arm)), surface)
    velocity = along(velocity, -dot(velocity, normal), normal)
    speed = norm(velocity)
    direction = scaled(1.0 / max(speed, TINY), velocity)
    wrench = (direction, cross(arm, direction))
    change = response(inverse, wrench)
    mobility = max(dot(wrench[0], change[0]) + dot(wrench[1], change[1]), TINY)
    amount = -friction * speed / mobility
    for k in range(len(contacts)):
        put_column(shares, k, scaled(amount * impulse[k] / total, direction))
    return added(STILL, amount, wrench)


@helper
def coulomb(
    friction: float,
    twist: Twist,
    centre: Vector,
    inverse: Matrix,
    contacts: np.ndarray,
    impulse: np.ndarray,
    loaded: int,
    shares: np.ndarray,
) -> Twist:
    """Return the wrench of Coulomb friction: impulses of at most μ λ at each contact."""
    # wrenches of unit impulses along two tangents per contact, as rows; their changes of the twist
    rows, mobile, sliding = (
        np.empty((2 * loaded, 6)),
        np.empty((2 * loaded, 6)),
        np.empty(2 * loaded),
    )
    bound, given, total = np.empty(loaded), np.zeros(2 * loaded), np.zeros(6)
    p = 0
    for k in range(len(contacts)):
        if not impulse[k] > 0.0:
            continue
        contact, bound[p] = contacts[k], friction * impulse[k]
        arm, one, two = minus(vector_of(contact['point']), centre), ZERO, ZERO
        one, two = tangents_of(vector_of(contact['normal']))
        put_tangent(rows, mobile, sliding, 2 * p, one, arm, inverse, contact, twist)
        put_tangent(rows, mobile, sliding, 2 * p + 1, two, arm, inverse, contact, twist)
        p += 1
    stop_sliding(rows, inverse, sliding, given)
    sticks = True
    for k in range(loaded):
        size = math.sqrt(given[2 * k] * given[2 * k] + given[2 * k + 1] * given[2 * k + 1])
        sticks = sticks and size <= bound[k]
    if not sticks:
        slide(rows, mobile, sliding, bound, given)
    for k in range(2 * loaded):
        for axis in range(6):
            total[axis] += given[k] * rows[k, axis]
    p = 0
    for k in range(len(contacts)):
        if impulse[k] > 0.0:
            for axis in range(3):
                shares[axis, k] = given[2 * p] * rows[2 * p, axis]
                shares[axis, k] += given[2 * p + 1] * rows[2 * p + 1, axis]
            p += 1
    return (total[0], total[1], total[2]), (total[3], total[4], total[5])


@helper
def put_tangent(
    rows: np.ndarray,
    mobile: np.ndarray,
    sliding: np.ndarray,
    row: int,
    tangent: Vector,
    arm: Vector,
    inverse: Matrix,
    contact: np.void,
    twist: Twist,
) -> None:
    """Write one row of friction, and minus the sliding speed along it, m/s."""
    moment = cross(arm, tangent)
    angular = applied(inverse, moment)
    for axis in range(3):
        rows[row, axis], rows[row, 3 + axis] = tangent[axis], moment[axis]
        mobile[row, axis], mobile[row, 3 + axis] = tangent[axis], angular[axis]
    sliding[row] = dot(tangent, vector_of(contact['surface_velocity']))
    sliding[row] -= dot(tangent, twist[0]) + dot(moment, twist[1])


@helper
def stop_sliding(
    rows: np.ndarray, inverse: Matrix, sliding: np.ndarray, given: np.ndarray
) -> None:
    """
    Write the least-squares impulses that stop sliding, of minimal norm.

    With B = rows · root of the mobility, the Delassus operator is B Bᵀ; its pseudo-inverse is
    B (BᵀB)⁻² Bᵀ, with 6 unknowns whatever the number of contacts.
    """
    columns, axes = orthogonal_columns(inverse)
    b = np.empty((len(rows), 6))
    for k in range(len(rows)):
        moment = (rows[k, 3], rows[k, 4], rows[k, 5])
        for axis in range(3):
            b[k, axis] = rows[k, axis]
            b[k, 3 + axis] = math.sqrt(norm(columns[axis])) * dot(axes[axis], moment)
    gram, vectors, target = np.zeros((6, 6)), np.empty((6, 6)), np.zeros((1, 6))
    for k in range(len(rows)):
        for i in range(6):
            target[0, i] += b[k, i] * sliding[k]
            for j in range(6):
                gram[i, j] += b[k, i] * b[k, j]
    eigen(gram, vectors)
    largest = 0.0
    for i in range(6):
        largest = max(largest, gram[i, i])
    result = np.zeros((1, 6))
    for i in range(6):
        if gram[i, i] > RANK * largest:
            amount = product_of_rows(vectors, i, target, 0) / (gram[i, i] * gram[i, i])
            for axis in range(6):
                result[0, axis] += amount * vectors[i, axis]
    for k in range(len(rows)):
        given[k] = product_of_rows(b, k, result, 0)


@helper
def slide(
    rows: np.ndarray, mobile: np.ndarray, sliding: np.ndarray, bound: np.ndarray, given: np.ndarray
) -> None:
    """
    Write friction impulses (2 p,) of at most `bound` (p,), m/s, at p contacts.

    Projected Gauss–Seidel, contact by contact.
    """
    for k in range(len(given)):
        given[k] = 0.0
    change = np.zeros((1, 6))
    for _ in range(FRICTION_SWEEPS):
        for k in range(len(bound)):
            i, j = 2 * k, 2 * k + 1
            a, b = product_of_rows(rows, i, mobile, i), product_of_rows(rows, j, mobile, j)
            c = product_of_rows(rows, i, mobile, j)
            softest = 0.5 * (a + b) + math.sqrt(0.25 * (a - b) * (a - b) + c * c)
            one = given[i] + (sliding[i] - product_of_rows(rows, i, change, 0)) / softest
            two = given[j] + (sliding[j] - product_of_rows(rows, j, change, 0)) / softest
            size = math.sqrt(one * one + two * two)
            if size > bound[k]:
                one, two = one * bound[k] / size, two * bound[k] / size
            for axis in range(6):
                change[0, axis] += (one - given[i]) * mobile[i, axis]
                change[0, axis] += (two - given[j]) * mobile[j, axis]
            given[i], given[j] = one, two


# --------------------------------------------------------------------------------------- positions
@helper
def correct_position(
    body: np.void,
    start: np.ndarray,
    x: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    contacts: np.ndarray,
) -> None:
    """Move a body out of each obstacle by the depth of its deepest contact, in place."""
    first, count = body['first'], body['count']
    for _ in range(CORRECTION_ROUNDS):
        touched = False
        for number in range(len(obstacles)):
            found = find_with(body, start, x, obstacles, number, trees, contacts, 0)
            if found == 0:
                continue
            touched, deepest = True, 0
            for k in range(found):
                if contacts[k]['depth'] > contacts[deepest]['depth']:
                    deepest = k
            shift = scaled(contacts[deepest]['depth'], vector_of(contacts[deepest]['normal']))
            for i in range(first, first + count):
                put_column(x, i, plus(column_of(x, i), shift))
        if not touched:
            break
