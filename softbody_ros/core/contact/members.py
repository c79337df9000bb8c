# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The bodies of a contact problem, and how they move by the forces of contacts.

A force f that is constant over the tick h, in the form λ = h² f / 2, acts on the start shape x̂,
which the flight has moved as the rigid body is (`flight_map.put_start_shape`). With
r = x̂ − c, the whitened features ψ, D = Σ w r ψᵀ, and ρ = 2 Γ₁ / h² of a kind of modes, it
displaces particles of a body of mass M by

    (1 − ρʳ) (λ + I⁻¹ (r × λ) × r') / M      as the rigid body,
    N (ρᶠ − ρʳ) (ψ · ψ') λ / M               by the modes that the goal follows,
    ρʳ λ / (w M)                             the particle itself: what no goal follows.

N removes the rotation that features contain. ρ is 1 of a rigid mode, and 0 of one that is much
faster than the tick: so soft bodies yield particle by particle, stiff ones as wholes, and rigid
ones, of which ρʳ = ρᶠ = 0, not at all. Along the direction in which the volume changes, ρ is
another one, which may be less than ρʳ. The velocity changes by the same with Γ₂.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.body import LINEAR_MODE, QUADRATIC_FEATURES, QUADRATIC_MODE, RIGID
from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.exchange import add_wrench_about
from softbody_ros.core.contact.problem import RIGID_MODES, width_of
from softbody_ros.core.contact.rows import in_world, side_of
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    ZERO,
    Matrix,
    Vector,
    added,
    along,
    applied,
    applied_transposed,
    column_of,
    combined,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    outer,
    plus,
    product,
    put_column,
    put_matrix,
    put_vector,
    scaled,
    transposed,
    vector_of,
)
from softbody_ros.core.shape_matching.flight_map import whiten, whitened_features
from softbody_ros.core.shape_matching.gains import BREATHING, FOLLOWED, RESIDUAL
from softbody_ros.core.shape_matching.pins import THIN, inverse_about
from softbody_ros.core.shape_matching.polar_decomposition import (
    orthogonal_columns,
    rotation_by_vector,
)
from softbody_ros.core.shape_matching.rigid_motion import INERTIA_CUT

SMALL_RESPONSE = 1e-12
"""Of deformation, relative to that of a rigid body: below it there is none."""

LEAST_SHARE = 1e-3
"""Mass of a particle, relative to the mean, that it yields with at least: some have none."""

MEMBER = np.dtype(
    [
        ('body', np.int64),
        ('features', np.int64),  # F: whitened features of its modes; 0 of a rigid body
        ('is_soft', np.bool_),
        ('has_pins', np.bool_),  # then the centre is theirs, and moves by no force
        ('starts', np.bool_),  # whether the start shape is in the place of the result
        ('mass', np.float64),  # kg
        ('scale', np.float64),  # RMS radius, m
        ('steady', np.bool_),  # whether its contacts are those of the tick before, as they were
        ('margin', np.float64),  # distance from others within which they are contacts, m
        ('widest', np.float64),  # the same if it is not steady, m
        ('nearby', np.float64),  # the same after the flight, m
        # after the flight
        ('centre', np.float64, (3,)),  # m
        ('velocity', np.float64, (3,)),  # m/s
        ('angular_momentum', np.float64, (3,)),  # per mass, m²/s
        ('acceleration', np.float64, (3,)),  # by gravity and applied forces, m/s²; 0 with pins
        ('angular_velocity', np.float64, (3,)),  # rad/s
        ('carried', np.float64, (3,)),  # angular velocity that pins prescribe, rad/s
        ('allowed', np.float64, (3, 3)),  # projector on axes about which they let it turn
        ('inverse_inertia', np.float64, (3, 3)),  # of the start shape, per mass, 1/m²
        ('root', np.float64, (3, 3)),  # L, with I⁻¹ = L Lᵀ
        # √ρ of rigid motion, of followed modes, and of change of volume, less that of residuals,
        # or of residuals less that of change of volume
        ('response', np.float64, (4,)),
        ('mobility', np.float64),  # ρ of residuals
        ('lasting', np.float64),  # share of the velocity of deformation that is left after a tick
        # changes of velocity per displacement, times h / 2: of the last three, and of residuals
        ('velocity_response', np.float64, (4,)),
        # moments with the whitened features, see `modal_flight`
        ('shape', np.float64, (QUADRATIC_FEATURES, 3)),  # D, m
        ('volume', np.float64, (QUADRATIC_FEATURES, 3)),  # A, of size 1
        ('volume_turning', np.float64, (3,)),  # Σ D × A, m
        ('offset', np.float64, (QUADRATIC_FEATURES, 3)),  # Σ w ψ pᵀ, m
        ('speed', np.float64, (QUADRATIC_FEATURES, 3)),  # Σ w ψ sᵀ, m/s
        ('second_moments', np.float64, (3, 3)),  # Σ w p pᵀ, m²
        ('inner_momentum', np.float64, (3,)),  # Σ w p × s, m²/s
        # by the contact forces
        ('shift', np.float64, (3,)),  # of the centre, but for residuals, m
        ('rotation', np.float64, (3, 3)),
        ('fit', np.float64, (QUADRATIC_FEATURES, 3)),  # T, m
        ('fit_velocity', np.float64, (QUADRATIC_FEATURES, 3)),  # of it, m/s
        ('residual_shift', np.float64, (3,)),  # mean of those of particles, m
        ('residual_velocity', np.float64, (3,)),  # m/s
        ('impulse', np.float64, (2, 3)),  # of one stage, N s, and about the centre, N m s
        ('momenta', np.float64, (2, 3)),  # velocity and angular momentum before the contacts
        ('end_inverse_inertia', np.float64, (3, 3)),  # per mass, 1/m²
        ('end_angular_velocity', np.float64, (3,)),  # rad/s
        # of the whole tick: N s, and N m s about the centre at its end
        ('received', np.float64, (2, 3)),
    ],
    align=True,
)
"""A body that may be in contact."""

PARTICLE = np.dtype(
    [
        ('column', np.int64),  # of the world
        ('member', np.int64),
        ('rows', np.int64),  # number of contacts that act on it
        ('weight', np.float64),  # mass share
        ('borrowed', np.float64),  # what it yields with beyond that, at the cost of its body
        ('mobility', np.float64),  # ρʳ / (w M), 1/kg
        ('features', np.float64, (QUADRATIC_FEATURES,)),  # ψ
        ('offset', np.float64, (3,)),  # p from the centre after the flight, m
        ('speed', np.float64, (3,)),  # velocity of deformation s then, m/s
        ('end_offset', np.float64, (3,)),  # R (p + T ψ), after the tick, m
        ('end_speed', np.float64, (3,)),  # R (s + T' ψ), m/s
        ('shift', np.float64, (3,)),  # by contacts, of the residual, m
        ('velocity', np.float64, (3,)),  # of it, m/s
    ],
    align=True,
)
"""A particle of a deformable body at a contact."""


@helper
def put_member(member: np.void, body: np.void, shape: np.void, number: int, h: float) -> None:
    """Write the member of a body after its flight, but for its margins."""
    scale = shape['scale']
    member['body'], member['mass'] = number, body['mass']
    member['is_soft'], member['has_pins'] = body['mode'] != RIGID, body['pins'] > 0
    member['features'] = 0
    if member['is_soft'] and not body['follows_goals']:
        member['features'] = 3 if body['mode'] == LINEAR_MODE else QUADRATIC_FEATURES
    member['starts'] = member['steady'] = False
    member['scale'] = scale
    put_vector(member['centre'], vector_of(body['centre']))
    put_vector(member['velocity'], vector_of(body['velocity']))
    put_vector(member['angular_momentum'], vector_of(body['angular_momentum']))
    put_vector(member['acceleration'], ZERO)
    if not member['has_pins']:
        # as of a flight under a constant force
        flown = minus(vector_of(body['centre']), vector_of(body['start_centre']))
        per_step = along(vector_of(body['velocity']), -1.0 / h, flown)
        put_vector(member['acceleration'], scaled(2.0 / h, per_step))
    put_vector(member['angular_velocity'], vector_of(body['angular_velocity']))
    put_vector(member['carried'], vector_of(body['carried']) if member['has_pins'] else ZERO)
    put_matrix(member['allowed'], matrix_of(body['allowed']) if member['has_pins'] else IDENTITY)
    inverse = matrix_of(body['start_inverse_inertia'])
    put_matrix(member['inverse_inertia'], inverse)
    columns, axes = orthogonal_columns(inverse)
    for axis in range(3):
        size = math.sqrt(norm(columns[axis]))
        for row in range(3):
            member['root'][row, axis] = size * axes[axis][row]
    put_matrix(member['second_moments'], matrix_of(body['second_moments']))
    put_vector(member['inner_momentum'], vector_of(body['inner_momentum']))
    put_vector(member['residual_shift'], ZERO)
    put_vector(member['residual_velocity'], ZERO)
    put_response(member, body, h)
    member['lasting'] = body['lasting']
    if member['features'] > 0:
        whiten(body, shape, body['shape_moment'], member['shape'])
        whiten(body, shape, body['volume_moment'], member['volume'])
        whiten(body, shape, body['offset_moment'], member['offset'])
        whiten(body, shape, body['velocity_moment'], member['speed'])
    turning = ZERO
    for k in range(member['features']):
        own = cross(vector_of(member['shape'][k]), vector_of(member['volume'][k]))
        turning = plus(turning, own)
    put_vector(member['volume_turning'], turning)


@helper
def put_response(member: np.void, body: np.void, h: float) -> None:
    """Write the responses of the kinds of modes, relative to those of a rigid one."""
    response, rate, gains = member['response'], member['velocity_response'], body['response']
    for k in range(4):
        response[k] = rate[k] = 0.0
    response[0], member['mobility'] = 1.0, 0.0
    if not member['is_soft']:
        return
    position, velocity = 2.0 / (h * h), 1.0 / h
    own, own_rate = position * gains[RESIDUAL, 0], velocity * gains[RESIDUAL, 1]
    member['mobility'] = own
    response[0] = math.sqrt(max(1.0 - own, 0.0))
    rate[3] = own_rate / own if own > SMALL_RESPONSE else 0.0
    if body['follows_goals']:
        # these do not yield within a tick
        return
    for row in range(3):
        kind = FOLLOWED if row == 0 else BREATHING
        sign = -1.0 if row == 2 else 1.0
        more = sign * (position * gains[kind, 0] - own)
        if more > SMALL_RESPONSE:
            response[1 + row] = math.sqrt(more)
            rate[row] = sign * (velocity * gains[kind, 1] - own_rate) / more


@helper
def put_particle(
    particle: np.void,
    column: int,
    number: int,
    member: np.void,
    body: np.void,
    shape: np.void,
    weight: float,
    q: np.ndarray,
    flown: np.ndarray,
    v: np.ndarray,
    is_pinned: bool,
) -> None:
    """Write a particle at a contact, with positions and velocities (3, N) after the flight."""
    particle['column'], particle['member'], particle['weight'] = column, number, weight
    particle['rows'] = 0
    inertia = max(weight, LEAST_SHARE / (body['surface']))
    particle['borrowed'] = inertia - weight
    particle['mobility'] = 0.0 if is_pinned else member['mobility'] / (inertia * member['mass'])
    if member['features'] > 0:
        whitened_features(body, shape, q, column, particle['features'])
    offset = minus(column_of(flown, column), vector_of(member['centre']))
    speed = minus(column_of(v, column), vector_of(member['velocity']))
    put_vector(particle['offset'], offset)
    speed = minus(speed, cross(vector_of(member['angular_velocity']), offset))
    put_vector(particle['speed'], speed)
    put_vector(particle['shift'], ZERO)
    put_vector(particle['velocity'], ZERO)


# --------------------------------------------------------------------------------------- response
@helper
def put_modes(
    jacobian: np.ndarray,
    line: int,
    member: np.void,
    sign: float,
    arm: Vector,
    features: np.ndarray,
    row: np.void,
    at_end: bool,
) -> None:
    """
    Write the responses of the modes of a body to unit forces along normal and tangents.

    In units in which the energy of a displacement by a force is half the squared amplitudes.

    Parameters
    ----------
    jacobian : (6 k, width of M + 1) float
        written: three lines
    line : int
        the first of them
    member : MEMBER
    sign : float
        of the force
    arm : vector
        where it acts, from the centre, m
    features : (9,) float
        ψ there
    row : ROW
        the contact
    at_end : bool
        whether arm and directions are those after the tick, instead of after the flight

    """
    size, root = sign / math.sqrt(member['mass']), matrix_of(member['root'])
    rigid, count = size * member['response'][0], member['features']
    shifting = 0.0 if member['has_pins'] else rigid
    shape, volume, response = member['shape'], member['volume'], member['response']
    rotation, volume_feature = matrix_of(member['rotation']), ZERO
    for k in range(count):
        volume_feature = along(volume_feature, features[k], vector_of(volume[k]))
    modes = RIGID_MODES + 3 * count
    last = width_of(modes)
    for axis in range(3):
        direction = vector_of(row['normal'])
        if axis > 0:
            direction = vector_of(row['tangents'][axis - 1])
        moment = cross(arm, direction)
        if at_end:
            moment = applied_transposed(rotation, moment)
            direction = applied_transposed(rotation, direction)
        local = applied_transposed(root, moment)
        for each in range(3):
            jacobian[line + axis, each] = shifting * direction[each]
            jacobian[line + axis, 3 + each] = rigid * local[each]
        for mode in range(modes, last + 1):
            jacobian[line + axis, mode] = 0.0
        if count == 0:
            continue
        angle, followed = applied(root, local), scaled(size * response[1], direction)
        along_volume = dot(direction, volume_feature)
        along_volume -= dot(angle, vector_of(member['volume_turning']))
        angle = scaled(size * response[1], angle)
        more = size * (response[2] - response[1]) * along_volume
        for k in range(count):
            own = minus(scaled(features[k], followed), cross(angle, vector_of(shape[k])))
            own = along(own, more, vector_of(volume[k]))
            first = RIGID_MODES + 3 * k
            jacobian[line + axis, first] = own[0]
            jacobian[line + axis, first + 1] = own[1]
            jacobian[line + axis, first + 2] = own[2]
        jacobian[line + axis, last] = size * response[3] * along_volume


@helper
def put_fit(
    member: np.void, y: np.ndarray, factor: float, of_velocity: bool, fit: np.ndarray
) -> None:
    """
    Write the displacement of the features, or its velocity, by amplitudes of modes.

    Parameters
    ----------
    member : MEMBER
    y : (width of M + 1,) float
        amplitudes of its modes, and of what is stiffer than residuals
    factor : float
    of_velocity : bool
        whether to write the change of velocity by a force that is constant over the tick
    fit : (9, 3) float
        written

    """
    size, along_volume = factor / math.sqrt(member['mass']), 0.0
    volume, response, rate = member['volume'], member['response'], member['velocity_response']
    followed, breathing, stiffer = response[1], response[2], response[3]
    if of_velocity:
        followed, breathing, stiffer = followed * rate[0], breathing * rate[1], stiffer * rate[2]
    for k in range(member['features']):
        for axis in range(3):
            amplitude = size * y[RIGID_MODES + 3 * k + axis]
            along_volume += volume[k, axis] * amplitude
            fit[k, axis] = followed * amplitude
    more = (breathing - followed) * along_volume
    more -= stiffer * size * y[width_of(RIGID_MODES + 3 * member['features'])]
    for k in range(member['features']):
        for axis in range(3):
            fit[k, axis] += more * volume[k, axis]


@helper
def place(members: np.ndarray, y: np.ndarray) -> None:
    """Write the displacements of bodies by the amplitudes of their modes (m, M)."""
    for number in range(len(members)):
        member, own = members[number], y[number]
        size = member['response'][0] / math.sqrt(member['mass'])
        put_vector(member['shift'], scaled(size, (own[0], own[1], own[2])))
        if member['is_soft']:
            put_fit(member, own, 1.0, False, member['fit'])
        put_matrix(member['rotation'], rotation_by_vector(angle_of(member, own)))


@helper
def angle_of(member: np.void, y: np.ndarray) -> Vector:
    """Return the vector by which a body turns by the amplitudes of its modes and its fit, rad."""
    size = member['response'][0] / math.sqrt(member['mass'])
    angle = applied(matrix_of(member['root']), scaled(size, (y[3], y[4], y[5])))
    if member['is_soft']:
        turning = ZERO
        for k in range(member['features']):
            contained = cross(vector_of(member['shape'][k]), vector_of(member['fit'][k]))
            turning = plus(turning, contained)
        angle = minus(angle, applied(matrix_of(member['inverse_inertia']), turning))
    return angle


@helper
def place_particles(members: np.ndarray, particles: np.ndarray, shifts: np.ndarray) -> None:
    """Write the displacements (3, p) of particles by themselves."""
    for number in range(len(members)):
        put_vector(members[number]['residual_shift'], ZERO)
    for k in range(len(particles)):
        particle, shift = particles[k], (shifts[0, k], shifts[1, k], shifts[2, k])
        put_vector(particle['shift'], shift)
        member = members[particle['member']]
        add_to_mean(member, 0, particle['weight'], shift)
        if particle['borrowed'] > 0.0 and not member['has_pins']:
            # so that the centre moves as the force says
            moved = along(vector_of(member['shift']), particle['borrowed'], shift)
            put_vector(member['shift'], moved)


@helper
def start_velocities(members: np.ndarray, particles: np.ndarray, y: np.ndarray, h: float) -> None:
    """Write the velocities of deformation by forces that are constant over the tick."""
    for number in range(len(members)):
        member = members[number]
        put_vector(member['residual_velocity'], ZERO)
        if not member['is_soft']:
            continue
        put_fit(member, y[number], 2.0 / h, True, member['fit_velocity'])
    for k in range(len(particles)):
        particle = particles[k]
        member = members[particle['member']]
        velocity = scaled(2.0 / h * member['velocity_response'][3], vector_of(particle['shift']))
        if member['lasting'] < 1.0:
            # what is lost before the next tick should not push the body
            own = applied(matrix_of(member['rotation']), vector_of(particle['speed']))
            velocity = along(scaled(member['lasting'], velocity), member['lasting'] - 1.0, own)
        put_vector(particle['velocity'], velocity)
        add_to_mean(member, 1, particle['weight'], velocity)


@helper
def add_to_mean(member: np.void, which: int, weight: float, change: Vector) -> None:
    """Add to the mean of shifts (0) or velocities (1) of particles, where they move the centre."""
    if not member['has_pins']:
        mean = member['residual_shift'] if which == 0 else member['residual_velocity']
        put_vector(mean, along(vector_of(mean), weight, change))


@helper
def begin_impulses(members: np.ndarray) -> None:
    """Begin to add up the impulses of one stage."""
    for number in range(len(members)):
        put_vector(members[number]['impulse'][0], ZERO)
        put_vector(members[number]['impulse'][1], ZERO)


@helper
def add_momenta(members: np.ndarray) -> None:
    """Change velocities by the impulses of a stage."""
    for number in range(len(members)):
        member = members[number]
        share = 1.0 / member['mass']
        velocity, momentum = vector_of(member['velocity']), vector_of(member['angular_momentum'])
        if not member['has_pins']:
            put_vector(member['velocity'], along(velocity, share, vector_of(member['impulse'][0])))
        momentum = along(momentum, share, vector_of(member['impulse'][1]))
        put_vector(member['angular_momentum'], momentum)


@helper
def add_impulses(members: np.ndarray, rows: np.ndarray) -> None:
    """Change momenta by the impulses at the end of the tick."""
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
def add_velocities(
    members: np.ndarray, particles: np.ndarray, y: np.ndarray, shifts: np.ndarray
) -> None:
    """Add the velocities of deformation by impulses at the end of the tick."""
    change = np.empty((QUADRATIC_FEATURES, 3))
    for number in range(len(members)):
        member = members[number]
        if member['is_soft']:
            put_fit(member, y[number], 1.0, False, change)
            for k in range(member['features']):
                for axis in range(3):
                    member['fit_velocity'][k, axis] += change[k, axis]
    for k in range(len(particles)):
        particle, velocity = particles[k], column_of(shifts, k)
        put_vector(particle['velocity'], plus(vector_of(particle['velocity']), velocity))
        add_to_mean(members[particle['member']], 1, particle['weight'], velocity)


# -------------------------------------------------------------------------------- after the tick
@helper
def end_base(member: np.void) -> Vector:
    """Return where the flight's centre has been shifted to, m: the centre, but for residuals."""
    return plus(vector_of(member['centre']), vector_of(member['shift']))


@helper
def end_centre(member: np.void) -> Vector:
    """Return the centre of mass after the tick, m."""
    return plus(end_base(member), vector_of(member['residual_shift']))


@helper
def base_velocity(member: np.void) -> Vector:
    """Return the velocity of the centre after the tick, but for residuals, m/s."""
    return minus(vector_of(member['velocity']), vector_of(member['residual_velocity']))


@helper
def combination(fit: np.ndarray, features: np.ndarray, count: int) -> Vector:
    """Return T ψ."""
    result = ZERO
    for k in range(count):
        result = along(result, features[k], vector_of(fit[k]))
    return result


@helper
def put_rotation(members: np.ndarray, particles: np.ndarray) -> None:
    """
    Write inertia and angular velocity after the tick, for the angular momentum then.

    The second moments and the momentum of deformation are those of r = R (p + T ψ) + u and
    d = R (s + T' ψ) + u', products of sums; residuals u are those of few particles.
    """
    for number in range(len(members)):
        member, rotation = members[number], matrix_of(members[number]['rotation'])
        if not member['is_soft']:
            inverse = product(rotation, matrix_of(member['inverse_inertia']))
            inverse = product(inverse, transposed(rotation))
            put_matrix(member['end_inverse_inertia'], inverse)
            rate = applied(inverse, vector_of(member['angular_momentum']))
            put_vector(member['end_angular_velocity'], plus(vector_of(member['carried']), rate))
            continue
        second, inner = matrix_of(member['second_moments']), vector_of(member['inner_momentum'])
        for k in range(member['features']):
            fit, speed = vector_of(member['fit'][k]), vector_of(member['fit_velocity'][k])
            mixed = outer(plus(vector_of(member['offset'][k]), scaled(0.5, fit)), fit)
            second = added(second, added(mixed, transposed(mixed)))
            inner = plus(inner, cross(vector_of(member['offset'][k]), speed))
            inner = plus(inner, cross(fit, plus(vector_of(member['speed'][k]), speed)))
        second = product(product(rotation, second), transposed(rotation))
        put_matrix(member['end_inverse_inertia'], second)
        put_vector(member['end_angular_velocity'], applied(rotation, inner))
    for k in range(len(particles)):
        particle = particles[k]
        member, weight = members[particle['member']], particle['weight']
        put_end_of_particle(particle, member)
        offset, speed = vector_of(particle['end_offset']), vector_of(particle['end_speed'])
        shift, velocity = vector_of(particle['shift']), vector_of(particle['velocity'])
        mixed = outer(plus(offset, scaled(0.5, shift)), shift)
        second = added(mixed, transposed(mixed))
        second = combined(1.0, matrix_of(member['end_inverse_inertia']), weight, second)
        put_matrix(member['end_inverse_inertia'], second)
        inner = plus(cross(offset, velocity), cross(shift, plus(speed, velocity)))
        inner = along(vector_of(member['end_angular_velocity']), weight, inner)
        put_vector(member['end_angular_velocity'], inner)
    for number in range(len(members)):
        member = members[number]
        if not member['is_soft']:
            continue
        shift = vector_of(member['residual_shift'])
        velocity = vector_of(member['residual_velocity'])
        second = combined(1.0, matrix_of(member['end_inverse_inertia']), -1.0, outer(shift, shift))
        inner = minus(vector_of(member['end_angular_velocity']), cross(shift, velocity))
        cut = THIN if member['has_pins'] else INERTIA_CUT
        inverse = inverse_about(matrix_of(member['allowed']), second, member['scale'], cut)
        put_matrix(member['end_inverse_inertia'], inverse)
        momentum = minus(vector_of(member['angular_momentum']), inner)
        rate = plus(vector_of(member['carried']), applied(inverse, momentum))
        put_vector(member['end_angular_velocity'], rate)


@helper
def put_end_of_particle(particle: np.void, member: np.void) -> None:
    """Write where deformation has moved a particle, and how fast, but for its residual."""
    rotation, count = matrix_of(member['rotation']), member['features']
    moved, changed = ZERO, ZERO
    for k in range(count):
        psi = particle['features'][k]
        moved = along(moved, psi, vector_of(member['fit'][k]))
        changed = along(changed, psi, vector_of(member['fit_velocity'][k]))
    offset = applied(rotation, plus(vector_of(particle['offset']), moved))
    put_vector(particle['end_offset'], offset)
    speed = applied(rotation, plus(vector_of(particle['speed']), changed))
    put_vector(particle['end_speed'], speed)


@helper
def end_velocity(member: np.void, particle: np.void) -> Vector:
    """Return the velocity of a particle after the tick, m/s; after `put_rotation`."""
    arm = plus(vector_of(particle['end_offset']), vector_of(particle['shift']))
    arm = minus(plus(end_base(member), arm), end_centre(member))
    result = plus(base_velocity(member), cross(vector_of(member['end_angular_velocity']), arm))
    return plus(plus(result, vector_of(particle['end_speed'])), vector_of(particle['velocity']))


@helper
def change_map(body: np.void, shape: np.void, member: np.void) -> None:
    """Change the map of a body from its flight to the end of the tick, but for residuals."""
    flight, drift = body['map'][0], body['map'][1]
    rotation, rate = matrix_of(member['rotation']), vector_of(member['end_angular_velocity'])
    old_rate = vector_of(member['angular_velocity'])
    centre, velocity = vector_of(member['centre']), vector_of(body['velocity'])
    base, end = end_base(member), end_centre(member)
    columns = 6 if body['follows_goals'] else member['features']
    for row in range(7 + columns):
        to_x, to_v = vector_of(flight[row]), vector_of(drift[row])
        if row == 0:
            to_x, to_v = minus(to_x, centre), minus(to_v, velocity)
        elif row < 7:
            continue
        to_v = minus(to_v, cross(old_rate, to_x))
        if row >= 7:
            for k in range(member['features']):
                share = whitening_at(body, shape, k, row - 7)
                to_x = along(to_x, share, vector_of(member['fit'][k]))
                to_v = along(to_v, share, vector_of(member['fit_velocity'][k]))
        to_x, to_v = applied(rotation, to_x), applied(rotation, to_v)
        if row == 0:
            to_v = plus(to_v, base_velocity(member))
            to_v = plus(to_v, cross(rate, plus(minus(base, end), to_x)))
            to_x = plus(to_x, base)
        else:
            to_v = plus(to_v, cross(rate, to_x))
        put_vector(flight[row], to_x)
        put_vector(drift[row], to_v)
    for first in range(1, 7, 3):
        to_x, to_v = matrix_of(flight[first : first + 3]), matrix_of(drift[first : first + 3])
        to_v = combined(1.0, to_v, -1.0, turned_columns(old_rate, to_x))
        to_x, to_v = product(rotation, to_x), product(rotation, to_v)
        put_matrix(flight[first : first + 3], to_x)
        put_matrix(drift[first : first + 3], added(to_v, turned_columns(rate, to_x)))


@helper
def turned_columns(rate: Vector, columns: Matrix) -> Matrix:
    """Return Ω × A, column by column."""
    result = transposed(columns)
    result = (cross(rate, result[0]), cross(rate, result[1]), cross(rate, result[2]))
    return transposed(result)


@helper
def put_fit_of_features(
    body: np.void, shape: np.void, member: np.void, fits: np.ndarray, first: int
) -> None:
    """Write T W, by which T ψ = T W f of features f that are not whitened, from a column on."""
    for f in range(member['features']):
        column = ZERO
        for k in range(member['features']):
            share = whitening_at(body, shape, k, f)
            column = along(column, share, vector_of(member['fit'][k]))
        put_column(fits, first + f, column)


@helper
def whitening_at(body: np.void, shape: np.void, k: int, f: int) -> float:
    """Return an element of the matrix of ψ = W f."""
    if body['mode'] == QUADRATIC_MODE:
        return shape['whitening_quadratic'][k, f]
    return shape['whitening_linear'][k, f]
