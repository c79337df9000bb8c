# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Unconstrained motion in a tick of a body as a modal system.

Müller, Heidelberger, Teschner, Gross: Meshless Deformations Based on Shape Matching, SIGGRAPH
2005, is a model of modes: rigid ones, which are free; those that the goal follows, with the
stiffness (1 − β) α_s; and the residual of each particle, which no goal follows. Each moves as the
exact oscillator of its frequency, at any step (`gains.oscillator_response`). Velocities are those
at the tick, v = dx/dt, not staggered ones.

With offsets r from the centre of mass, the angular velocity Ω = I⁻¹ L, velocities of deformation
u = v − V − Ω × r, the undeformed transform P (R, or R S_p) and the fits T of r and U of u, the
residuals are y = r − T f and z = u − U f, and the flight is

    x' = c' + E [P f + (Φ₁₁ (T − P) + Φ₁₂ U) f + Φ₁₁ʳ y + Φ₁₂ʳ z]
    v' = V' + E [(Φ₂₁ (T − P) + Φ₂₂ U) f + Φ₂₁ʳ y + Φ₂₂ʳ z] + Ω' × (x' − c').

E is the rotation of the free rigid body by the implicit midpoint rule, Ω' restores the angular
momentum. Along one direction of transforms, the gradient of the enclosed volume, the stiffness is
another one, and the equilibrium lies between P and the nearest fit of the rest volume. The
centrifugal acceleration drives T, as the exact response to one that changes linearly in the tick;
that of Coriolis is left out: it does no work, and the angular momentum is exact without it.

During a tick, P and the plane of the rest volume are constant. P is a nearest point, so that the
potential with P constant is at least the true one, and equal to it at the start: damping it damps
the true one, at any step. The rest volume is no plane but curved; what that adds to the energy is
of third order in the step.

x' and v' are linear in r, v and the features: a tick reads the particles for sums, computes the
coefficients from the sums, and reads the particles again to write the result.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from softbody_ros.core.body import QUADRATIC_MODE, RIGID
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    NO_MATRIX,
    ZERO,
    Matrix,
    Vector,
    added,
    along,
    applied,
    applied_transposed,
    axial,
    column_of,
    combined,
    cross,
    cross_matrix,
    dot,
    matrix_of,
    minus,
    outer,
    plus,
    product,
    put_matrix,
    put_vector,
    scaled,
    times,
    transposed,
    vector_of,
)
from softbody_ros.core.lanes import (
    LANES,
    no_vectors,
    totals,
    vectors_at,
    weights_at,
)
from softbody_ros.core.shape_matching.flight_map import keep_mean, put_map, put_turned, write
from softbody_ros.core.shape_matching.free_rotation import rotate, rotation_by, turned
from softbody_ros.core.shape_matching.gains import (
    BREATHING,
    DEGENERATE,
    FOLLOWED,
    REGULAR,
    RESIDUAL,
    TOUCHING,
)
from softbody_ros.core.shape_matching.goals import flow
from softbody_ros.core.shape_matching.matching import (
    LEAST_SLOPE,
    LINEAR,
    copy,
    degeneracy_of,
    fill,
    fit,
    linear_block,
    move_to_rest_volume,
    multiply_gram,
    multiply_inverse_gram,
    relative_volume,
    scalar_product,
    scale_transform,
    summed_cross,
    summed_outer,
)
from softbody_ros.core.shape_matching.moments import (
    TILE,
    is_finite,
    particle_sums,
    sample_mean,
    symmetric,
)
from softbody_ros.core.shape_matching.plasticity import elastic_of, undeformed_of
from softbody_ros.core.shape_matching.polar_decomposition import rotation_of
from softbody_ros.core.shape_matching.rigid_motion import (
    inertia_of,
    inverse_inertia_of,
    put_motion,
)

SLOW_TURN = 1e-6
"""Square of the angular velocity, relative to the stiffness of followed modes, up to which the
centrifugal acceleration is taken as constant in a tick."""
MOST_FLATTENED = 0.5
"""Largest share of the rest volume for which the fit makes up."""
OF_R, OF_V, FITTED, VOLUME_FIT, GRADIENT, DIRECTION, FITTED_U, DUAL, DRIVEN, CHANGE = range(10)
"""Places of transforms in the scratch of a flight: moments Σ w f r and Σ w f v; the fit, that of
the rest volume, the gradient of volume, the direction between both fits, the fit of velocities,
the dual of the direction; acceleration, and its change."""
OF_X, OF_S, GRAM_X, GRAM_S = VOLUME_FIT, GRADIENT, DRIVEN, CHANGE
"""What replaces four of these: transforms after the tick, of positions and of velocities, and
these times the Gram matrix."""
Response = tuple[float, float, float, float, float, float, float]
"""Φ₁₁, Φ₁₂, Φ₂₁, Φ₂₂, Γ₁, Γ₂, Γ₃ of `gains.oscillator_response`."""


class Second(NamedTuple):
    """Second moments Σ w a bᵀ of offsets r and velocities v from their means."""

    rr: Matrix
    rv: Matrix
    vv: Matrix


@kernel
def fly(
    bodies: np.ndarray,
    awake: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    stretch: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    regions: np.ndarray,
    region_members: np.ndarray,
    weighted_features: np.ndarray,
    faces: np.ndarray,
    gravity: np.ndarray,
    h: float,
) -> int:
    """
    Move bodies without contacts, regions and pins, from the half `now` of `x`, `v` to the other.

    Parameters
    ----------
    bodies : (B,) BODY
        results of the tick are written into them
    awake : (A,) int
        bodies to move
    shapes : (R,) SHAPE
    weights, q : (M,), (3, M) float
        of all rest shapes
    x, v : (2, 3, N) float
        m, m/s
    stretch : (2, S, 3, 3) float
        plastic states of all matches
    match_centre, match_posture : (S, 3), (S, 3, 3) float
        written: centres, m, and linear maps of offsets, of the matched shapes x̂
    regions, region_members, weighted_features, faces
        regions, for the places of those of rigid bodies, and faces, see `ShapeTable`
    gravity : (3,) float
        m/s²
    h : float
        s

    Returns
    -------
    int
        0, or 1 + the index of a body with positions or velocities that are not finite

    """
    linear, quadratic, tile = np.empty((10, 3, 3)), np.empty((10, 9, 3)), np.empty((3, TILE))
    g = vector_of(gravity)
    for index in range(len(awake)):
        body = bodies[awake[index]]
        shape, now = shapes[body['shape']], body['now']
        body['flowed'] = False
        x0, v0 = x[now], v[now]
        scratch = quadratic if body['mode'] == QUADRATIC_MODE else linear
        moment, of_v = scratch[OF_R], scratch[OF_V]
        origin = sample_mean(x0, body)
        offset = scaled(-1.0, origin)
        total = particle_sums(x0, v0, body, shape, weights, q, offset, moment, of_v, tile)
        if not (is_finite(total.y, moment) and is_finite(total.v, of_v)):
            return 1 + awake[index]
        centre = plus(origin, total.y)
        rr = combined(1.0, total.yy, -1.0, outer(total.y, total.y))
        second = Second(rr, NO_MATRIX, NO_MATRIX)
        spin = minus(total.yxv, cross(total.y, total.v))
        if body['mode'] != RIGID:
            second = second_moments(x0, v0, body, shape, weights, centre, total.v, rr)
            spin = axial(second.rv)
        put_vector(body['origin'], origin)
        put_vector(body['start_centre'], centre)
        undeformed = match(body, shape, stretch, match_posture, scratch)
        flattened = flattened_volume(body, shape, x0, centre, faces, scratch)
        body['flattened'][1 - now] = flattened
        find_rest_volume(body, shape, stretch, match_posture, flattened, scratch)
        drift = solve(
            body, shape, origin, total.y, total.v, second, spin, undeformed, g, scratch, h
        )
        if not is_finite(drift, scratch[OF_R]):
            return 1 + awake[index]
        write(x0, v0, body, shape, q, x[1 - now], v[1 - now])
        row = body['first_match']
        put_vector(match_centre[row], vector_of(body['centre']))
        posture = product(matrix_of(body['turn']), matrix_of(match_posture[row]))
        put_matrix(match_posture[row], posture)
        put_region_matches(
            body, shape, q, regions, region_members, weighted_features, match_centre,
            match_posture,
        )  # fmt: skip
        for row in range(2):
            put_vector(body['received'][row], ZERO)
    return 0


@helper
def put_region_matches(
    body: np.void,
    shape: np.void,
    q: np.ndarray,
    regions: np.ndarray,
    region_members: np.ndarray,
    weighted_features: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
) -> None:
    """Write the matches of the regions of a rigid body, from that of the whole."""
    row = body['first_match']
    posture = matrix_of(match_posture[row])
    for k in range(body['regions']):
        region = regions[shape['first_region'] + k]
        mean = mean_of(region, shape, q, region_members, weighted_features)
        place = plus(vector_of(match_centre[row]), applied(posture, mean))
        put_vector(match_centre[row + 1 + k], place)
        put_matrix(match_posture[row + 1 + k], posture)


@helper
def mean_of(
    region: np.void,
    shape: np.void,
    q: np.ndarray,
    region_members: np.ndarray,
    weighted_features: np.ndarray,
) -> Vector:
    """Return the mean rest position of the particles of a region, m."""
    total = ZERO
    for k in range(region['first'], region['first'] + region['count']):
        rest = column_of(q, shape['first'] + region_members[k])
        total = along(total, weighted_features[0, k], rest)
    return scaled(shape['scale'] / region['mass'], total)


# ------------------------------------------------------------------------------------------- sums
@helper
def second_moments(
    x: np.ndarray,
    v: np.ndarray,
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    centre: Vector,
    velocity: Vector,
    rr: Matrix,
) -> Second:
    """Return the second moments of a body, in a fixed order."""
    first = second = third = upper = lower = no_vectors()
    begin, rest = body['first'], shape['first'] - body['first']
    end = begin + body['count']
    for i in range(begin, end, LANES):
        left = end - i
        w = weights_at(weights, rest + i, left)
        weighted = scaled(w, minus(vectors_at(x, i, left), centre))
        u = minus(vectors_at(v, i, left), velocity)
        first = along(first, weighted[0], u)
        second = along(second, weighted[1], u)
        third = along(third, weighted[2], u)
        weighted = scaled(w, u)
        upper = along(upper, weighted[0], u)
        lower = plus(lower, (weighted[1] * u[1], weighted[1] * u[2], weighted[2] * u[2]))
    return Second(
        rr,
        (totals(first), totals(second), totals(third)),
        symmetric(totals(upper), totals(lower)),
    )


# ------------------------------------------------------------------------------------------ match
@helper
def match(
    body: np.void,
    shape: np.void,
    stretch: np.ndarray,
    posture: np.ndarray,
    scratch: np.ndarray,
) -> Matrix:
    """
    Fit the whole body at the start of the tick, and return its undeformed transform.

    Parameters
    ----------
    body : BODY
    shape : SHAPE
    stretch : (2, S, 3, 3) float
    posture : (S, 3, 3) float
        see `fly`
    scratch : (10, F, 3) float
        with `OF_R`, m; `FITTED` is written, dimensionless

    """
    row, now, is_plastic = body['first_match'], body['now'], body['is_plastic']
    moment, fitted = scratch[GRADIENT], scratch[FITTED]
    for f in range(len(moment)):
        for axis in range(3):
            moment[f, axis] = scratch[OF_R, f, axis] / shape['scale']
    plastic = matrix_of(stretch[now, row])
    undeformed = undeformed_of(linear_block(moment), plastic, is_plastic)
    if body['mode'] == RIGID:
        # no deformation to follow
        fill(fitted, 0.0)
    else:
        fit(moment, undeformed, shape, fitted)
    put_matrix(posture[row], undeformed)
    return undeformed


@helper
def flattened_volume(
    body: np.void,
    shape: np.void,
    x: np.ndarray,
    centre: Vector,
    faces: np.ndarray,
    scratch: np.ndarray,
) -> float:
    """
    Return by how much less than at rest the volume of the fit is to be, relative to that.

    While a body touches something, the volume that it encloses is to be that at rest; residuals of
    particles in contact change it, and forces compress it. An integral control: at once, patches
    and the volume would excite each other. Of compressible bodies it makes up only for what
    residuals change.

    Parameters
    ----------
    body, shape : BODY, SHAPE
    x : (3, N) float
        m
    centre : vector
        of mass, m
    faces : (f, 3) int
        see `ShapeTable`
    scratch : (10, F, 3) float
        after `match`; `DIRECTION` is written

    """
    now = body['now']
    flattened, lacking = body['flattened'][now], 0.0
    if body['touches'][now] > 0 and shape['enclosed'] > 0.0 and body['mode'] != RIGID:
        lacking = enclosed_volume(body, shape, x, centre, faces) - 1.0
        fitted = relative_volume(scratch[FITTED], shape, scratch[DIRECTION])
        lacking += body['compressible'] * (1.0 - fitted - flattened)
    else:
        lacking = -flattened
    flattened += body['relaxation'] * lacking
    return min(max(flattened, -MOST_FLATTENED), MOST_FLATTENED)


@helper
def enclosed_volume(
    body: np.void, shape: np.void, x: np.ndarray, centre: Vector, faces: np.ndarray
) -> float:
    """
    Return the volume that a body with a closed surface encloses, relative to that at rest.

    Parameters
    ----------
    body, shape : BODY, SHAPE
    x : (3, N) float
        m
    centre : vector
        of mass, m
    faces : (f, 3) int
        see `ShapeTable`

    """
    total, first = 0.0, body['first']
    for face in range(shape['first_face'], shape['first_face'] + shape['faces']):
        a = minus(column_of(x, first + faces[face, 0]), centre)
        b = minus(column_of(x, first + faces[face, 1]), centre)
        c = minus(column_of(x, first + faces[face, 2]), centre)
        total += dot(a, cross(b, c))
    return total / (6.0 * shape['enclosed'] * shape['scale'] * shape['scale'] * shape['scale'])


@helper
def find_rest_volume(
    body: np.void,
    shape: np.void,
    stretch: np.ndarray,
    posture: np.ndarray,
    flattened: float,
    scratch: np.ndarray,
) -> None:
    """
    Find how the volume of the fit deviates from that at rest.

    Parameters
    ----------
    body : BODY
        its degeneracy is written
    shape : SHAPE
    stretch : (2, S, 3, 3) float
    posture : (S, 3, 3) float
        see `fly`
    flattened : float
        see `flattened_volume`
    scratch : (10, F, 3) float
        after `match`; written: `VOLUME_FIT` is the nearest fit of the rest volume, `DIRECTION`
        that to it, a, with Σ w |a f|² = 1, `DUAL` Σ w f (a f)ᵀ, dimensionless

    """
    row, now, is_plastic = body['first_match'], body['now'], body['is_plastic']
    fitted, volume_fit = scratch[FITTED], scratch[VOLUME_FIT]
    gradient, direction, dual = scratch[GRADIENT], scratch[DIRECTION], scratch[DUAL]
    body['degeneracy'] = 0.0
    if body['mode'] == RIGID:
        for k in range(VOLUME_FIT, DRIVEN):
            fill(scratch[k], 0.0)
        return
    fill(gradient, 0.0)
    fill(direction, 0.0)
    volume = move_to_rest_volume(fitted, shape, volume_fit, gradient, direction, 1.0 - flattened)
    elastic = elastic_of(linear_block(fitted), matrix_of(stretch[now, row]), is_plastic)
    degeneracy = degeneracy_of(fitted, elastic, volume, shape['bend_gram'])
    body['degeneracy'] = degeneracy
    slope = max(scalar_product(gradient, direction), LEAST_SLOPE)
    scale_transform(direction, 1.0 / math.sqrt(slope))
    if len(fitted) > LINEAR and shape['spanned_quadratic']:
        # the gradient itself
        copy(gradient, dual)
        scale_transform(dual, 1.0 / math.sqrt(slope))
    else:
        multiply_gram(shape, direction, dual)
    if degeneracy == 0.0:
        put_matrix(posture[row], linear_block(fitted))
    flow(body, stretch, row, elastic, degeneracy)


@helper
def blended_response(body: np.void, kind: int) -> Response:
    """Return the response of modes, blended towards critical damping in degenerate states."""
    touches = body['touches'][body['now']] > 0
    regular = body['responses'][TOUCHING if touches else REGULAR, kind]
    degenerate = body['responses'][DEGENERATE, kind]
    d = body['degeneracy']
    put_response = body['response'][kind]
    put_response[0] = regular[4] + d * (degenerate[4] - regular[4])
    put_response[1] = regular[5] + d * (degenerate[5] - regular[5])
    return (
        regular[0] + d * (degenerate[0] - regular[0]),
        regular[1] + d * (degenerate[1] - regular[1]),
        regular[2] + d * (degenerate[2] - regular[2]),
        regular[3] + d * (degenerate[3] - regular[3]),
        put_response[0],
        put_response[1],
        regular[6] + d * (degenerate[6] - regular[6]),
    )


# ------------------------------------------------------------------------------------------ solve
@helper
def solve(
    body: np.void,
    shape: np.void,
    origin: Vector,
    mean: Vector,
    velocity: Vector,
    second: Second,
    spin: Vector,
    undeformed: Matrix,
    gravity: Vector,
    scratch: np.ndarray,
    h: float,
) -> Vector:
    """
    Compute the flight of a body from its sums and its match, and write its map and its response.

    In axes that turn with the body, offsets of particles after the tick are
    p = Φ₁₁ʳ r + Φ₁₂ʳ u + X f, and velocities of deformation s = Φ₂₁ʳ r + Φ₂₂ʳ u + G f, whose
    moments are products of the sums.

    Parameters
    ----------
    body : BODY
        written: rigid motion after the tick, `map`, and what responses to forces need
    shape : SHAPE
    origin, mean : vector
        point from which positions are counted, m, and the centre of mass from there
    velocity, second, spin
        of the centre of mass, m/s; second moments; angular momentum per mass, m²/s
    undeformed : matrix
        R, or R S_p
    gravity : vector
        m/s²
    scratch : (10, F, 3) float
        see `find_rest_volume`, with Σ w f v, m/s. Written: `OF_R` is the image of the features
        in v', m/s
    h : float
        s

    Returns
    -------
    vector
        constant term of v', m/s

    """
    scale, kept = shape['scale'], body['kept_velocity']
    inverse = inverse_inertia_of(second.rr, scale)
    omega = applied(inverse, spin)
    subtract_rotation(omega, kept, scratch)
    advance_fit(body, shape, times(scale, undeformed), omega, spin, second.rr, inverse, scratch, h)
    residual = blended_response(body, RESIDUAL)
    add_residual(residual, scratch)
    multiply_gram(shape, scratch[OF_X], scratch[GRAM_X])
    multiply_gram(shape, scratch[OF_S], scratch[GRAM_S])
    pp, internal = moments_after(second, omega, kept, residual, scratch)

    middle = inverse_inertia_of(combined(0.5, second.rr, 0.5, pp), scale)
    posture = rotation_of(undeformed) if body['has_wrench'] else IDENTITY
    turn, acceleration, torque = rotate(body, posture, middle, spin, ZERO, gravity, h)
    after = inverse_inertia_of(pp, scale)
    spin = applied_transposed(turn, along(spin, h, torque))
    rate = applied(after, minus(spin, internal))
    spin = applied(turn, plus(applied(inertia_of(pp), rate), internal))
    start = plus(origin, mean)
    centre = along(along(start, h, velocity), 0.5 * h * h, acceleration)
    end_velocity = along(velocity, h, acceleration)
    put_motion(body, centre, end_velocity, spin, turned(turn, after))
    put_turned(body, turn, inverse, pp, internal, rate)
    put_maps(body, residual, turn, rate, omega, centre, end_velocity, mean, velocity)
    put_transforms(body, residual, turn, rate, scratch)
    features = len(scratch[OF_X])
    keep_mean(body['map'][0], shape, features)
    keep_mean(body['map'][1], shape, features)
    for f in range(features):
        put_vector(scratch[OF_R, f], vector_of(body['map'][1, 7 + f]))
    return vector_of(body['map'][1, 0])


@helper
def subtract_rotation(omega: Vector, kept: float, scratch: np.ndarray) -> None:
    """Write Σ w f u in the place of Σ w f v: u is what is kept of velocities of deformation."""
    of_r, of_u = scratch[OF_R], scratch[OF_V]
    for f in range(len(of_r)):
        rigid = cross(omega, vector_of(of_r[f]))
        put_vector(of_u[f], scaled(kept, minus(vector_of(of_u[f]), rigid)))


@helper
def add_residual(residual: Response, scratch: np.ndarray) -> None:
    """Subtract from the transforms what the gains of residuals do to all of r and u."""
    a, b, c, d = residual[0], residual[1], residual[2], residual[3]
    of_x, of_s = scratch[OF_X], scratch[OF_S]
    for f in range(len(of_x)):
        t, fitted_u = vector_of(scratch[FITTED, f]), vector_of(scratch[FITTED_U, f])
        put_vector(of_x[f], along(along(vector_of(of_x[f]), -a, t), -b, fitted_u))
        put_vector(of_s[f], along(along(vector_of(of_s[f]), -c, t), -d, fitted_u))


@helper
def moments_after(
    second: Second, omega: Vector, kept: float, residual: Response, scratch: np.ndarray
) -> tuple[Matrix, Vector]:
    """Return the moments Σ w p pᵀ, m², and Σ w p × s, m²/s, after the tick."""
    a, b, c, d = residual[0], residual[1], residual[2], residual[3]
    turning = cross_matrix(omega)
    ru = combined(kept, second.rv, -kept, product(second.rr, transposed(turning)))
    uu = product(transposed(second.rv), transposed(turning))
    uu = combined(kept * kept, second.vv, -kept * kept, added(uu, transposed(uu)))
    uu = combined(1.0, uu, kept * kept, product(product(turning, second.rr), transposed(turning)))

    of_r, of_u, of_x, of_s = scratch[OF_R], scratch[OF_V], scratch[OF_X], scratch[OF_S]
    half = combined(a * b, ru, a, summed_outer(of_x, of_r))
    half = combined(1.0, half, b, summed_outer(of_x, of_u))
    pp = combined(a * a, second.rr, b * b, uu)
    pp = added(pp, added(half, transposed(half)))
    pp = added(pp, summed_outer(scratch[GRAM_X], of_x))
    internal = scaled(a * d - b * c, axial(ru))
    internal = along(internal, a, summed_cross(of_r, of_s))
    internal = along(internal, b, summed_cross(of_u, of_s))
    internal = along(internal, c, summed_cross(of_x, of_r))
    internal = along(internal, d, summed_cross(of_x, of_u))
    internal = plus(internal, summed_cross(scratch[GRAM_X], of_s))
    return pp, internal


@helper
def put_maps(
    body: np.void,
    residual: Response,
    turn: Matrix,
    rate: Vector,
    omega: Vector,
    centre: Vector,
    end_velocity: Vector,
    mean: Vector,
    velocity: Vector,
) -> None:
    """
    Write p and s + ω' × p as linear maps of y = x − origin and v, see `put_map`.

    Parameters
    ----------
    body : BODY
    residual
        gains
    turn, rate
        rotation in the tick; ω', rad/s
    omega
        angular velocity before it, rad/s
    centre, end_velocity
        of mass after the tick, m, m/s
    mean, velocity
        see `solve`

    """
    a, b, c, d = residual[0], residual[1], residual[2], residual[3]
    kept, turning, rotating = body['kept_velocity'], cross_matrix(omega), cross_matrix(rate)
    of_offset = combined(a, IDENTITY, -b * kept, turning)
    put_map(
        body['map'][0], product(turn, of_offset), times(b * kept, turn), centre, mean, velocity
    )
    of_deformation = combined(d, IDENTITY, b, rotating)
    of_offset = combined(c, IDENTITY, a, rotating)
    of_offset = combined(1.0, of_offset, -kept, product(of_deformation, turning))
    put_map(
        body['map'][1],
        product(turn, of_offset),
        times(kept, product(turn, of_deformation)),
        end_velocity,
        mean,
        velocity,
    )


@helper
def put_transforms(
    body: np.void, residual: Response, turn: Matrix, rate: Vector, scratch: np.ndarray
) -> None:
    """Write the maps of features, and their moments with p, s, r and the gradient of volume."""
    a, b, c, d = residual[0], residual[1], residual[2], residual[3]
    for f in range(len(scratch[OF_X])):
        of_r, of_u = vector_of(scratch[OF_R, f]), vector_of(scratch[OF_V, f])
        image = vector_of(scratch[OF_X, f])
        put_vector(body['map'][0, 7 + f], applied(turn, image))
        image = applied(turn, plus(vector_of(scratch[OF_S, f]), cross(rate, image)))
        put_vector(body['map'][1, 7 + f], image)
        weighted = along(along(vector_of(scratch[GRAM_X, f]), a, of_r), b, of_u)
        put_vector(body['offset_moment'][f], applied(turn, weighted))
        weighted = along(along(vector_of(scratch[GRAM_S, f]), c, of_r), d, of_u)
        put_vector(body['velocity_moment'][f], applied(turn, weighted))
        put_vector(body['shape_moment'][f], applied(turn, of_r))
        put_vector(body['volume_moment'][f], applied(turn, vector_of(scratch[DUAL, f])))


@helper
def centrifugal_field(body: np.void, omega: Vector) -> Matrix:
    """
    Return the matrix of the centrifugal acceleration, −Ω × (Ω × r); 1/s².

    It takes from the energy of deformation what the energy of rotation gains when a body
    contracts. Limited to half the stiffness of the followed modes: with more a body has no
    equilibrium, and any state is to come back.
    """
    size = dot(omega, omega)
    factor = min(1.0, 0.5 * body['stiffnesses'][FOLLOWED] / max(size, 1e-300))
    return combined(factor * size, IDENTITY, -factor, outer(omega, omega))


@helper
def advance_fit(
    body: np.void,
    shape: np.void,
    undeformed: Matrix,
    omega: Vector,
    spin: Vector,
    rr: Matrix,
    inverse: Matrix,
    scratch: np.ndarray,
    h: float,
) -> None:
    """
    Move the modes of the transform, under the centrifugal acceleration.

    Parameters
    ----------
    body : BODY
    shape : SHAPE
    undeformed : matrix
        P, m
    omega, spin, rr, inverse
        angular velocity, rad/s; angular momentum, m²/s; second moments, m²; inverse inertia, 1/m²
    scratch : (10, F, 3) float
        with Σ w f u in the place of Σ w f v. Written: `OF_X`, m; `OF_S`, of velocities of
        deformation, m/s; `FITTED_U`, m/s

    """
    of_r, fitted, fitted_u = scratch[OF_R], scratch[FITTED], scratch[FITTED_U]
    of_x, dual = scratch[OF_X], scratch[DUAL]
    driven, change = scratch[DRIVEN], scratch[CHANGE]
    scale_transform(fitted, shape['scale'])
    if body['mode'] == RIGID:
        fill(fitted_u, 0.0)
    else:
        multiply_inverse_gram(shape, scratch[OF_V], fitted_u)
    target = shape['scale'] * scalar_product(dual, of_x)
    field = centrifugal_field(body, omega)
    for f in range(len(fitted)):
        put_vector(driven[f], applied(field, vector_of(fitted[f])))
        put_vector(change[f], ZERO)
    turn_off(driven, fitted, applied(inverse, summed_cross(of_r, driven)))
    move_modes(body, undeformed, target, scratch)
    if dot(omega, omega) > SLOW_TURN * body['stiffnesses'][FOLLOWED]:
        # again, with its change: constant, it would act half a tick too late. Of the second
        # moments those with q, beside which the others are small
        moved, torque = rr, ZERO
        for f in range(LINEAR):
            weighted = ZERO
            for k in range(len(fitted)):
                weighted = along(weighted, shape['gram'][f, k], vector_of(of_x[k]))
            put_vector(change[f], weighted)
            moved = added(moved, outer(weighted, vector_of(of_x[f])))
            moved = combined(1.0, moved, -1.0, outer(vector_of(of_r[f]), vector_of(fitted[f])))
        moved = combined(0.5, moved, 0.5, transposed(moved))
        after = inverse_inertia_of(moved, shape['scale'])
        # in axes that turn with the body
        spin = applied_transposed(rotation_by(scaled(h, omega)), spin)
        field = centrifugal_field(body, applied(after, spin))
        for f in range(len(fitted)):
            weighted, at_end = vector_of(change[f]), applied(field, vector_of(of_x[f]))
            if f < LINEAR:
                torque = plus(torque, cross(weighted, at_end))
            put_vector(change[f], at_end)
        turn_off(change, of_x, applied(after, torque))
        for f in range(len(fitted)):
            at_end = minus(vector_of(change[f]), vector_of(driven[f]))
            put_vector(change[f], scaled(1.0 / h, at_end))
        move_modes(body, undeformed, target, scratch)


@helper
def turn_off(driven: np.ndarray, fitted: np.ndarray, angular_acceleration: Vector) -> None:
    """Subtract from the acceleration of a transform what turns it: that is a rigid motion."""
    for f in range(len(driven)):
        rigid = cross(angular_acceleration, vector_of(fitted[f]))
        put_vector(driven[f], minus(vector_of(driven[f]), rigid))


@helper
def move_modes(body: np.void, undeformed: Matrix, target: float, scratch: np.ndarray) -> None:
    """
    Move the modes of the transform under an acceleration that changes linearly.

    Parameters
    ----------
    body : BODY
    undeformed : matrix
        P, m
    target : float
        component of the nearest fit of the rest volume along the gradient of volume, m
    scratch : (10, F, 3) float
        see `advance_fit`; `DRIVEN` is the acceleration at the start, m/s², `CHANGE` m/s³

    """
    fitted, fitted_u = scratch[FITTED], scratch[FITTED_U]
    of_x, of_s = scratch[OF_X], scratch[OF_S]
    direction, dual = scratch[DIRECTION], scratch[DUAL]
    driven, change = scratch[DRIVEN], scratch[CHANGE]
    followed, breathing = blended_response(body, FOLLOWED), blended_response(body, BREATHING)
    columns = transposed(undeformed)
    # along the volume gradient: start, equilibria, and what differs from the other directions
    at, speed = scalar_product(dual, fitted), scalar_product(dual, fitted_u)
    driving, growth = scalar_product(dual, driven), scalar_product(dual, change)
    rest = dot(vector_of(dual[0]), columns[0])
    rest += dot(vector_of(dual[1]), columns[1]) + dot(vector_of(dual[2]), columns[2])
    lacking = (1.0 - body['degeneracy']) * body['volume_share'] * (target - rest)
    more_x = lacking + breathing[0] * (at - rest - lacking) - followed[0] * (at - rest)
    more_x += (breathing[1] - followed[1]) * speed + (breathing[4] - followed[4]) * driving
    more_x += (breathing[6] - followed[6]) * growth
    more_v = breathing[2] * (at - rest - lacking) - followed[2] * (at - rest)
    more_v += (breathing[3] - followed[3]) * speed + (breathing[5] - followed[5]) * driving
    more_v += (breathing[4] - followed[4]) * growth

    for f in range(len(fitted)):
        p = columns[f] if f < LINEAR else ZERO
        u, k, rate = vector_of(fitted_u[f]), vector_of(driven[f]), vector_of(change[f])
        deviation, along_gradient = minus(vector_of(fitted[f]), p), vector_of(direction[f])
        moved = along(along(p, followed[0], deviation), followed[1], u)
        moved = along(along(moved, followed[4], k), followed[6], rate)
        put_vector(of_x[f], along(moved, more_x, along_gradient))
        moved = along(scaled(followed[2], deviation), followed[3], u)
        moved = along(along(moved, followed[5], k), followed[4], rate)
        put_vector(of_s[f], along(moved, more_v, along_gradient))
