# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Concatenated state of all bodies in contact.

Each set of immovable points is a member, too, without mobility, and the points are its particles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softbody_ros.core.body import RIGID
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.vectors import (
    NO_MATRIX,
    ZERO,
    Vector,
    added,
    applied,
    axial,
    cross,
    matrix_of,
    minus,
    outer,
    plus,
    put_matrix,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.shape_matching.pins import jacobian
from softbody_ros.core.shape_matching.polar_decomposition import symmetric_inverse
from softbody_ros.core.shape_matching.rest_shape import pseudo_inverse

LEAST_WEIGHT = 1e-12
"""Least mass share of a particle in contact: of one without area."""
INERTIA_CUT = 1e-12
"""Principal inertias below this fraction of the largest count as zero."""

MEMBER = np.dtype(
    [
        ('body', np.int64),  # of the world; −1 for immovable points
        ('obstacle', np.int64),  # row of its impulses for immovable points, see `exchange`
        ('first', np.int64),  # its first particle in the contact state
        ('count', np.int64),
        ('rigid', np.bool_),
        ('pinned', np.bool_),
        ('edge', np.bool_),  # edge points of an obstacle, whose surface supports the weight
        ('coulomb', np.bool_),
        ('elasticity', np.float64),  # NaN for immovable points, as the next two
        ('bounciness', np.float64),
        ('friction', np.float64),
        ('mass', np.float64),  # kg; infinite for immovable points
        ('scale', np.float64),  # RMS radius, m; infinite for points
        ('centre', np.float64, (3,)),  # of mass, m
        ('velocity', np.float64, (3,)),  # of the centre, m/s
        ('angular_velocity', np.float64, (3,)),  # rad/s
        # from impulses and their moments to twists, within the constraints of pins, 1/kg …
        ('mobility', np.float64, (6, 6)),
        ('inverse_mass', np.float64),  # for impulses through the centre, mean of directions, 1/kg
        ('contact_count', np.int64),  # number of its contacts
        # changes of the twist by loads and by constraints between bodies, m/s and rad/s, and the
        # position correction as a small rigid motion, m and rad
        ('load_twist', np.float64, (6,)),
        ('constraint_twist', np.float64, (6,)),
        ('correction', np.float64, (6,)),
        # impulse, N s, and its moment about the centre of mass, N m s
        ('received', np.float64, (6,)),
    ],
    align=True,
)
"""A body in contact, or a set of immovable points."""


@dataclass(frozen=True)
class FixedPoints:
    """
    Immovable points: point obstacles, or edge points of an obstacle.

    Attributes
    ----------
    points : (k, 3) float
        sorted along x, m
    radius : float
        of balls about them, m
    centre, velocity, angular_velocity : (3,) float
        m; m/s of the centre; rad/s
    is_edge : bool
        whether they are edge points of an obstacle, whose surface supports the weight
    obstacle : int
        row of the impulses on them, see `exchange`

    """

    points: np.ndarray
    radius: float
    centre: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    is_edge: bool
    obstacle: int


@dataclass(frozen=True)
class ContactState:
    """
    C members with N particles in total; the last members are immovable points.

    Attributes
    ----------
    members : (C,) MEMBER
    x, v : (N, 3) float
        positions, m, and velocities, m/s, changed in place by the stages
    start, goals : (N, 3) float
        positions at the tick before, and goals for velocities, m
    inverse_mass : (N,) float
        of the particles, 1/kg

    """

    members: np.ndarray
    x: np.ndarray
    v: np.ndarray
    start: np.ndarray
    goals: np.ndarray
    inverse_mass: np.ndarray


def make_contact_state(
    state: Any, touching: np.ndarray, fixed: Sequence[FixedPoints], contacts: np.ndarray, h: float
) -> ContactState:
    """
    Return the contact state of bodies and immovable points, as copies.

    Parameters
    ----------
    state : State
    touching : (c,) int
        the bodies
    fixed : sequence of FixedPoints
        the last members
    contacts : (k,) CONTACT
    h : float
        s

    """
    members = np.zeros(len(touching) + len(fixed), MEMBER)
    for member, each in zip(members[len(touching) :], fixed, strict=True):
        member['body'], member['rigid'], member['edge'] = -1, True, each.is_edge
        member['obstacle'] = each.obstacle
        member['mass'] = member['scale'] = np.inf
        member['elasticity'] = member['bounciness'] = member['friction'] = np.nan
        member['centre'], member['velocity'] = each.centre, each.velocity
        member['angular_velocity'] = each.angular_velocity
    particles = int(state.bodies['count'][touching].sum())
    count = particles + int((contacts['particles'][:, 0] >= particles).sum())
    x, v, start, goals = (np.empty((count, 3)) for _ in range(4))
    inverse_mass = np.zeros(count)
    gather(
        state.bodies, touching, state.shapes, state.weights, state.x, state.v, state.goals,
        members, x, v, start, goals, inverse_mass,
    )  # fmt: skip
    place_points(contacts, members, particles, h, x, v, start, goals)
    for number in np.flatnonzero(members['pinned']):
        member = members[number]
        body = state.bodies[member['body']]
        pins = state.pinned[body['first_pin'] :][: body['pins']] - body['first']
        arms = x[member['first'] + pins] - member['centre']
        member['mobility'] = free_mobility(member['mobility'], arms)
        member['inverse_mass'] = np.trace(member['mobility'][:3, :3]) / 3.0
    return ContactState(members, x, v, start, goals, inverse_mass)


def free_mobility(mobility: np.ndarray, arms: np.ndarray) -> np.ndarray:
    """
    Return the mobility of a body as a whole within the constraints of its pins.

    Parameters
    ----------
    mobility : (6, 6) float
        of the body without pins: from impulses to its twist
    arms : (m, 3) float
        of the pinned particles from its centre of mass, m

    Returns
    -------
    (6, 6) float

    """
    values, vectors = np.linalg.eigh(mobility)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    response = jacobian(arms).reshape(-1, 6) @ root
    _, free = pseudo_inverse(response.T @ response)
    return np.asarray(root @ free @ root.T)


@kernel
def gather(
    bodies: np.ndarray,
    touching: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    world_x: np.ndarray,
    world_v: np.ndarray,
    world_goals: np.ndarray,
    members: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    start: np.ndarray,
    goals: np.ndarray,
    inverse_mass: np.ndarray,
) -> None:
    """Write the members of bodies and their particles, see `ContactState`."""
    particle = 0
    for number in range(len(touching)):
        body, member = bodies[touching[number]], members[number]
        shape = shapes[body['shape']]
        mass, now = body['mass'], body['now']
        member['body'], member['first'], member['count'] = (
            touching[number],
            particle,
            body['count'],
        )
        member['rigid'], member['pinned'] = body['mode'] == RIGID, body['pins'] > 0
        member['coulomb'], member['elasticity'] = body['coulomb'], body['elasticity']
        member['bounciness'], member['friction'] = body['bounciness'], body['friction']
        member['mass'], member['scale'] = mass, shape['scale']
        inverse_inertia = matrix_of(body['inverse_inertia'])
        momentum = vector_of(body['angular_momentum'])
        put_vector(member['centre'], vector_of(body['centre']))
        put_vector(member['velocity'], vector_of(body['velocity']))
        put_vector(member['angular_velocity'], applied(inverse_inertia, momentum))
        for row in range(3):
            member['mobility'][row, row] = 1.0 / mass
            for column in range(3):
                member['mobility'][3 + row, 3 + column] = inverse_inertia[row][column] / mass
        member['inverse_mass'] = 1.0 / mass
        for i in range(body['count']):
            column = body['first'] + i
            for axis in range(3):
                x[particle, axis] = world_x[1 - now, axis, column]
                v[particle, axis] = world_v[1 - now, axis, column]
                start[particle, axis] = world_x[now, axis, column]
                goals[particle, axis] = world_goals[axis, column]
            weight = max(weights[shape['first'] + i], LEAST_WEIGHT)
            inverse_mass[particle] = 1.0 / (mass * weight)
            particle += 1


@kernel
def place_points(
    contacts: np.ndarray,
    members: np.ndarray,
    particles: int,
    h: float,
    x: np.ndarray,
    v: np.ndarray,
    start: np.ndarray,
    goals: np.ndarray,
) -> None:
    """Write the immovable points after the particles of bodies."""
    for contact in contacts:
        particle = contact['particles'][0]
        if particle < particles:
            continue
        member, point = members[contact['body']], vector_of(contact['point'])
        arm = minus(point, vector_of(member['centre']))
        turning = cross(vector_of(member['angular_velocity']), arm)
        velocity = plus(vector_of(member['velocity']), turning)
        put_vector(x[particle], point)
        put_vector(goals[particle], point)
        put_vector(v[particle], velocity)
        put_vector(start[particle], minus(point, scaled(h, velocity)))


# ------------------------------------------------------------------------------------- helpers
@helper
def difference(contact, field) -> Vector:  # type: ignore[no-untyped-def]
    """Return the difference of a field (N, 3) between particle and face of a contact."""
    total = ZERO
    for corner in range(4):
        value = vector_of(field[contact['particles'][corner]])
        total = plus(total, scaled(contact['coefficients'][corner], value))
    return total


@helper
def velocity_at(member, twist, point: Vector) -> Vector:  # type: ignore[no-untyped-def]
    """Return the velocity at a point of a member with a twist (6,) about its centre."""
    arm = minus(point, vector_of(member['centre']))
    return plus(vector_of(twist[:3]), cross(vector_of(twist[3:]), arm))


@helper
def add_wrench(member, wrench, sign: float, point: Vector, impulse: Vector):  # type: ignore
    """Add an impulse at a point to a wrench (6,) about the centre of a member."""
    moment = cross(minus(point, vector_of(member['centre'])), impulse)
    for axis in range(3):
        wrench[axis] += sign * impulse[axis]
        wrench[3 + axis] += sign * moment[axis]


@helper
def apply_mobility(member, wrench, twist):  # type: ignore[no-untyped-def]
    """Write the change of twist (6,) of a member by an impulsive wrench (6,)."""
    for row in range(6):
        total = 0.0
        for column in range(6):
            total += member['mobility'][row, column] * wrench[column]
        twist[row] = total


# ---------------------------------------------------------------------------------- rigid motions
@kernel
def move(members: np.ndarray, h: float, x: np.ndarray, v: np.ndarray, shift: np.ndarray) -> None:
    """
    Apply rigid motions to members: by loads, and by the constraints between bodies.

    Loads act throughout the tick, hence displace by half of h times the change of velocity.

    Parameters
    ----------
    members : (C,) MEMBER
    h : float
        s
    x, v : (N, 3) float
        changed in place, m, m/s
    shift : (N, 3) float
        written: displacement of x, m

    """
    change, motion = np.empty(6), np.empty(6)
    for member in members:
        for axis in range(6):
            change[axis] = member['load_twist'][axis] + member['constraint_twist'][axis]
            motion[axis] = 0.5 * h * member['load_twist'][axis] + member['correction'][axis]
        for i in range(member['first'], member['first'] + member['count']):
            point = vector_of(x[i])
            put_vector(v[i], plus(vector_of(v[i]), velocity_at(member, change, point)))
            displacement = velocity_at(member, motion, point)
            put_vector(shift[i], displacement)
            put_vector(x[i], plus(point, displacement))


@kernel
def write_back(
    bodies: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    world_x: np.ndarray,
    world_v: np.ndarray,
    members: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    h: float,
) -> None:
    """
    Write the members back; restore linear and angular momentum to those after the impulses.

    Position correction alone would change the angular momentum.
    """
    for member in members:
        if member['body'] < 0:
            continue
        body = bodies[member['body']]
        shape = shapes[body['shape']]
        half, begin, first = 1 - body['now'], body['first'], member['first']
        impulse = scaled(1.0 / member['mass'], vector_of(member['received'][:3]))
        moment = scaled(1.0 / member['mass'], vector_of(member['received'][3:]))
        centre, velocity = ZERO, ZERO
        for i in range(member['count']):
            weight = weights[shape['first'] + i]
            centre = plus(centre, scaled(weight, vector_of(x[first + i])))
            velocity = plus(velocity, scaled(weight, vector_of(v[first + i])))
        gram, product = NO_MATRIX, NO_MATRIX
        for i in range(member['count']):
            arm = minus(vector_of(x[first + i]), centre)
            heavy_arm = scaled(weights[shape['first'] + i], arm)
            gram = added(gram, outer(heavy_arm, arm))
            product = added(product, outer(heavy_arm, vector_of(v[first + i])))
        trace = gram[0][0] + gram[1][1] + gram[2][2]
        inertia = (
            (trace - gram[0][0], -gram[0][1], -gram[0][2]),
            (-gram[1][0], trace - gram[1][1], -gram[1][2]),
            (-gram[2][0], -gram[2][1], trace - gram[2][2]),
        )
        least = INERTIA_CUT * shape['scale'] * shape['scale']
        inverse_inertia = symmetric_inverse(inertia, INERTIA_CUT, least)
        current = axial(product)
        # about the old centre of mass, then about the new one
        displacement = minus(centre, vector_of(body['centre']))
        target, momentum = velocity, current
        # pins do not conserve momentum
        if not member['pinned']:
            target = plus(vector_of(body['velocity']), impulse)
            momentum = plus(vector_of(body['angular_momentum']), moment)
            momentum = minus(momentum, cross(displacement, target))
        velocity_change, angular_velocity = (
            minus(target, velocity),
            applied(inverse_inertia, minus(momentum, current)),
        )
        for i in range(member['count']):
            column, point = begin + i, vector_of(x[first + i])
            new = plus(vector_of(v[first + i]), velocity_change)
            new = plus(new, cross(angular_velocity, minus(point, centre)))
            for axis in range(3):
                world_x[half, axis, column] = point[axis]
                world_v[half, axis, column] = new[axis]
        put_vector(body['centre'], centre)
        put_vector(body['velocity'], target)
        put_vector(body['angular_momentum'], momentum)
        put_matrix(body['inverse_inertia'], inverse_inertia)
        moment = minus(moment, cross(displacement, impulse))
        for axis in range(3):
            body['received'][0, axis] += impulse[axis]
            body['received'][1, axis] += moment[axis]
            body['load'][axis] += member['load_twist'][axis] / h
