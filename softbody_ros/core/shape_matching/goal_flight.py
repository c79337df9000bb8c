# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Unconstrained motion in a tick of a body with regions or pins: each particle swings about its goal.

Müller, Heidelberger, Teschner, Gross: Meshless Deformations Based on Shape Matching, SIGGRAPH
2005, with regions (section 4.4). Such a body is no simple system of modes: its goals follow bends
of regions, and where pins hold it, these. So the goals g are taken as constant in the tick, and
each particle turns about its own with the frequency ω of α_s. With offsets r from the centre of
mass, the angular velocity Ω and velocities of deformation u = v − V − Ω × r

    u ← δ u + (1 − δ) u_g
    x' = c' + E [g + cos φ (r − g) + sin φ / ω u + Γ₁ b]
    v' = V' + E [−ω sin φ (r − g) + cos φ u + Γ₂ b] + Ω' × (x' − c').

E is the rotation of the free rigid body by the implicit midpoint rule; Ω' restores the angular
momentum; b is the centrifugal acceleration, less the angular one that it causes. Damping takes a
share of the velocity relative to the goals, u_g = (g(r + τ u) − g(r)) / τ; φ is such that
what the goal of the whole body follows has the exact frequency, and, at the reference step, what
no goal follows (`gains.turn_about_goal`).

The goals are those of the shape r + τ u with τ = tan(φ / 2) / ω: without damping that is to drift
for τ, to be pulled, and to drift for τ, so that no energy is lost, and a deformation of which they
follow the share f turns by φ' with cos φ' = f + (1 − f) cos φ. At the reference step this is the
published scheme, but with velocities at the tick: r + τ u is what that predicts. It is stable at
any step.

Pins. In the match, and only there, pinned particles have many times the weight of the body (see
`pins`), so the goals are where the pins hold them. The centre is then that of the pins, and moves
as prescribed, and so does the body but for a rotation about it, if there is one pin, or about
their axis, if they lie on a line: Ω' restores the angular momentum about these only. Gravity is
part of b, less the acceleration of the pins and the angular one that it causes: so a body that
hangs is in rest exactly where r − g = b / ω².

The result is linear in r, v, g and u_g, which take the place of the features in `map`.
"""

from __future__ import annotations

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
    put_column,
    put_matrix,
    put_vector,
    scaled,
    times,
    transposed,
    vector_of,
)
from softbody_ros.core.lanes import (
    LANES,
    LaneVector,
    lanes_of,
    no_vectors,
    put_vectors,
    total,
    totals,
    vectors_at,
    weights_at,
)
from softbody_ros.core.shape_matching.flight_map import (
    put_map,
    put_turned,
    write,
)
from softbody_ros.core.shape_matching.free_rotation import (
    rotate,
    rotation_by,
    turned,
    wrench_in,
)
from softbody_ros.core.shape_matching.gains import REGULAR, RESIDUAL, TOUCHING
from softbody_ros.core.shape_matching.goals import find_goal, match_regions
from softbody_ros.core.shape_matching.matching import (
    LINEAR,
    fill,
    linear_block,
    mixed_products,
    scale_transform,
    squares,
)
from softbody_ros.core.shape_matching.modal_flight import (
    blended_response,
    centrifugal_field,
    put_region_matches,
)
from softbody_ros.core.shape_matching.moments import (
    TILE,
    Tile,
    add_moments,
    is_finite,
    subtract_means,
    symmetric,
)
from softbody_ros.core.shape_matching.pins import THIN, allowed_axes, inverse_about
from softbody_ros.core.shape_matching.polar_decomposition import rotation_of
from softbody_ros.core.shape_matching.rigid_motion import (
    INERTIA_CUT,
    inertia_of,
    measure_about,
    put_motion,
)


class Motion(NamedTuple):
    """The rigid motion of a body at the start of a tick, and what the pins allow of it."""

    pivot: Vector  # centre of mass, or of the pins, m
    velocity: Vector  # of it, m/s
    carried: Vector  # angular velocity that pins prescribe, rad/s
    allowed: Matrix  # projector on the axes of free rotations
    mass_offset: Vector  # centre of mass from the pivot, m
    gram: Matrix  # second moments about the pivot, m²
    spin: Vector  # angular momentum about it, beside that of `carried`, per mass, m²/s
    inverse: Matrix  # inverse inertia about the free axes, 1/m²
    rate: Vector  # angular velocity, rad/s


class Deviations(NamedTuple):
    """Moments of the offsets p and velocities s after the tick, in axes that turn."""

    mean_p: Vector  # m
    mean_s: Vector  # m/s
    pp: Matrix  # Σ w p pᵀ, m²
    pxs: Vector  # Σ w p × s, m²/s


class Linear(NamedTuple):
    """A linear combination of r, v − V, g and u_g."""

    constant: Vector
    r: Matrix
    u: float
    g: float
    u_g: float


class Field(NamedTuple):
    """An acceleration a + F r of particles at offsets r."""

    constant: Vector  # m/s²
    of_offset: Matrix  # 1/s²


@kernel
def fly_to_goals(
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
    features: np.ndarray,
    weighted_features: np.ndarray,
    pinned: np.ndarray,
    gravity: np.ndarray,
    h: float,
) -> int:
    """
    Move bodies without contacts about their goals, from the half `now` of `x`, `v` to the other.

    Parameters
    ----------
    bodies : (B,) BODY
        results of the tick are written into them
    awake : (A,) int
        bodies to move
    shapes : (R,) SHAPE
    weights, q : (M,), (3, M + G) float
        of all rest shapes; the goals are written behind these
    x, v : (2, 3, N) float
        m, m/s
    stretch : (2, S, 3, 3) float
        plastic states of all matches
    match_centre, match_posture : (S, 3), (S, 3, 3) float
        written: centres, m, and linear maps of offsets, of the matched shapes x̂
    regions : (Q,) REGION
    region_members, features, weighted_features : (m,) int, (4, m), (4, m) float
        members of all regions, see `Regions`
    pinned : (m,) int
        pinned particles of all bodies
    gravity : (3,) float
        m/s²
    h : float
        s

    Returns
    -------
    int
        0, or 1 + the index of a body with positions or velocities that are not finite

    """
    linear, quadratic = np.empty((7, 3, 3)), np.empty((7, 9, 3))
    g = vector_of(gravity)
    for index in range(len(awake)):
        body = bodies[awake[index]]
        shape, matched, now = shapes[body['shape']], shapes[body['matched']], body['now']
        body['flowed'], body['flattened'][1 - now] = False, 0.0
        x0, v0 = x[now], v[now]
        motion = motion_of_body(body, shape, weights, pinned, x0, v0)
        if not is_finite_motion(motion):
            return 1 + awake[index]
        put_vector(body['origin'], motion.pivot)
        put_vector(body['start_centre'], motion.pivot)
        if body['mode'] == RIGID:
            posture = rigid_posture(body, shape, weights, q, x0, motion.pivot)
            put_matrix(match_posture[body['first_match']], posture)
            put_vector(match_centre[body['first_match']], motion.mass_offset)
        else:
            scratch = quadratic if body['mode'] == QUADRATIC_MODE else linear
            posture = find_goals(
                body, matched, weights, q, x0, v0, motion, regions, region_members, features,
                weighted_features, stretch, match_centre, match_posture, scratch,
            )  # fmt: skip
        advance(body, shape, weights, q, x0, v0, motion, posture, pinned, g, h)
        if not is_finite(vector_of(body['map'][1, 0]), body['map'][0]):
            return 1 + awake[index]
        write(x0, v0, body, shape, q, x[1 - now], v[1 - now])
        for row in range(body['first_match'], body['first_match'] + 1 + body['regions']):
            turn, centre = matrix_of(body['turn']), vector_of(match_centre[row])
            put_vector(match_centre[row], plus(vector_of(body['centre']), applied(turn, centre)))
            put_matrix(match_posture[row], product(turn, matrix_of(match_posture[row])))
            if body['mode'] == RIGID:
                put_region_matches(
                    body, shape, q, regions, region_members, weighted_features, match_centre,
                    match_posture,
                )  # fmt: skip
                break
        for row in range(2):
            put_vector(body['received'][row], ZERO)
    return 0


# ---------------------------------------------------------------------------------- rigid motion
@helper
def motion_of_body(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    pinned: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
) -> Motion:
    """Return the rigid motion of a body at the start of a tick, within its pins."""
    own = weights[shape['first'] : shape['first'] + shape['count']]
    first, carried, allowed, offset = body['first'], ZERO, IDENTITY, ZERO
    centre = ZERO
    for i in range(len(own)):
        centre = along(centre, own[i], column_of(x, first + i))
    pivot = centre
    if body['pins'] > 0:
        particles = pinned[body['first_pin'] : body['first_pin'] + body['pins']]
        pivot, allowed = allowed_axes(particles, x, shape['scale'])
        offset = minus(centre, pivot)
        if allowed[0][0] + allowed[1][1] + allowed[2][2] < 2.0:
            carried = vector_of(body['pins_angular'])
    velocity, spin, gram = measure_about(x, v, first, own, pivot)
    if body['pins'] > 0:
        velocity = vector_of(body['pins_linear'])
        spin = minus(spin, cross(offset, velocity))
        spin = minus(spin, applied(inertia_of(gram), carried))
    inverse = inverse_about(allowed, gram, shape['scale'], THIN)
    rate = plus(carried, applied(inverse, spin))
    return Motion(pivot, velocity, carried, allowed, offset, gram, spin, inverse, rate)


@helper
def is_finite_motion(motion: Motion) -> bool:
    """Return whether all positions and velocities are finite, from moments, sums over all."""
    moments = np.empty((5, 3))
    put_matrix(moments[:3], motion.gram)
    put_vector(moments[3], motion.spin)
    put_vector(moments[4], motion.velocity)
    return is_finite(motion.pivot, moments)


@helper
def rigid_posture(
    body: np.void, shape: np.void, weights: np.ndarray, q: np.ndarray, x: np.ndarray, pivot: Vector
) -> Matrix:
    """Return the rotation R of a rigid body from rest (eq. 7)."""
    moment, rest = NO_MATRIX, shape['first']
    for i in range(body['count']):
        arm = scaled(weights[rest + i], minus(column_of(x, body['first'] + i), pivot))
        moment = added(moment, outer(arm, column_of(q, rest + i)))
    return rotation_of(moment)


# ----------------------------------------------------------------------------------------- goals
@helper
def find_goals(
    body: np.void,
    matched: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    motion: Motion,
    regions: np.ndarray,
    region_members: np.ndarray,
    features: np.ndarray,
    weighted_features: np.ndarray,
    stretch: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    scratch: np.ndarray,
) -> Matrix:
    """
    Write goals of all particles and their velocities; return the rotation of the whole body.

    Parameters
    ----------
    body, matched : BODY, SHAPE
        the shape with the weights of the match
    x, v : (3, N) float
        m, m/s
    motion : Motion
    match_centre : (S, 3) float
        written: centres, m from the pivot
    scratch : (7, F, 3) float
    weights, q, regions, region_members, features, weighted_features, stretch, match_posture
        see `fly_to_goals`

    """
    first, count, goal, damping_goal = body['first_goal'], body['count'], scratch[5], scratch[6]
    state = TOUCHING if body['touches'][body['now']] > 0 else REGULAR
    time, rotation = body['look_ahead'][state], IDENTITY
    is_damped = body['responses'][state, RESIDUAL, 6] < 1.0 and time > 0.0
    for i in range(first + count, first + 2 * count):
        put_column(q, i, ZERO)
    for ahead in range(2):
        if ahead == 0 and not is_damped:
            continue
        look_ahead(body, x, v, motion, ahead * time, q)
        centre = match_moments(body, matched, weights, q, scratch[0])
        rotation, body['flowed'] = rotation_of(linear_block(scratch[0])), False
        degeneracy = find_goal(body, matched, stretch, match_posture, scratch, goal, damping_goal)
        body['degeneracy'] = degeneracy
        put_vector(match_centre[body['first_match']], centre)
        match_regions(
            body, matched, regions, region_members, features, weighted_features, q, stretch,
            match_centre, match_posture, degeneracy,
        )  # fmt: skip
        if is_damped:
            # the difference of both, by the time between them
            share = (1.0 if ahead else -1.0) / time
            add_goals(body, matched, q, centre, damping_goal, share, first + count)
    add_goals(body, matched, q, centre, goal, 1.0, first)
    return rotation


@helper
def look_ahead(
    body: np.void,
    x: np.ndarray,
    v: np.ndarray,
    motion: Motion,
    time: float,
    q: np.ndarray,
) -> None:
    """Write offsets r + τ u from the pivot in the place of the goals, m."""
    time *= body['kept_velocity']
    first, to_goal = body['first'], body['first_goal'] - body['first']
    end, turning = body['first'] + body['count'], times(-1.0, cross_matrix(motion.rate))
    for i in range(first, end, LANES):
        left = end - i
        r, u = deformation_at(x, v, motion, turning, i, left)
        put_vectors(q, to_goal + i, left, along(r, time, u))


@helper
def deformation_at(
    x: np.ndarray, v: np.ndarray, motion: Motion, turning: Matrix, i: int, left: int
) -> tuple[LaneVector, LaneVector]:
    """Return r and u = v − V − Ω × r of particles i … i + 3, given the matrix of − Ω × r."""
    r = minus(vectors_at(x, i, left), motion.pivot)
    return r, plus(minus(vectors_at(v, i, left), motion.velocity), applied(turning, r))


@helper
def match_moments(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    y: np.ndarray,
    moment: np.ndarray,
) -> Vector:
    """
    Return the mean of positions in the place of the goals, m, and write Σ w f y (F, 3).

    With the weights of the match. The mean is not subtracted: that of the features is 0.
    """
    mean, end = ZERO, body['first'] + body['count']
    rest, to_y = shape['first'] - body['first'], body['first_goal'] - body['first']
    fill(moment, 0.0)
    for start in range(body['first'], end, TILE):
        tile, of_tile = Tile(start, min(start + TILE, end), rest), no_vectors()
        for i in range(tile.start, tile.stop, LANES):
            left = tile.stop - i
            w = weights_at(weights, rest + i, left)
            of_tile = along(of_tile, w, vectors_at(y, to_y + i, left))
        mean = plus(mean, totals(of_tile))
        add_moments(tile, y, to_y, weights, y, moment)
    subtract_means(moment, shape, mean)
    return mean


@helper
def add_goals(
    body: np.void,
    shape: np.void,
    q: np.ndarray,
    centre: Vector,
    transform: np.ndarray,
    factor: float,
    column: int,
) -> None:
    """
    Add a multiple of the goals to columns of `q`, or write them in the place of those by regions.

    Parameters
    ----------
    body, shape : BODY, SHAPE
        the shape with the weights of the match
    q : (3, M + G) float
        with the goals by regions
    centre : vector
        m from the pivot
    transform : (F, 3) float
        of the whole body, dimensionless; changed
    factor : float
    column : int
        of the first particle

    """
    share, first = body['whole_body_weight'], body['first_goal']
    scale_transform(transform, factor * share * shape['scale'])
    shift, of_q = scaled(factor * share, centre), linear_block(transform)
    of_squares = of_products = NO_MATRIX
    is_quadratic, adds = len(transform) > LINEAR, column != first
    if is_quadratic:
        of_squares, of_products = linear_block(transform[3:]), linear_block(transform[6:])
    for f in range(LINEAR, len(transform)):
        shift = along(shift, -shape['feature_means'][f], vector_of(transform[f]))
    for k in range(0, body['count'], LANES):
        left = body['count'] - k
        point, of_regions = vectors_at(q, shape['first'] + k, left), vectors_at(q, first + k, left)
        place = plus(shift, applied(of_q, point))
        place = along(place, factor * (1.0 - share), of_regions)
        if is_quadratic:
            place = plus(place, applied(of_squares, squares(point)))
            place = plus(place, applied(of_products, mixed_products(point)))
        if adds:
            place = plus(place, vectors_at(q, column + k, left))
        put_vectors(q, column + k, left, place)


# --------------------------------------------------------------------------------------- advance
@helper
def advance(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    motion: Motion,
    posture: Matrix,
    pinned: np.ndarray,
    gravity: Vector,
    h: float,
) -> None:
    """
    Compute the flight of a body about its goals, and write its map and its response.

    Parameters
    ----------
    body : BODY
        written: rigid motion after the tick, `map`, and what responses to forces need
    shape : SHAPE
    motion : Motion
    posture : matrix
        R of the whole body
    gravity : vector
        m/s²
    weights, q, x, v, pinned, h
        see `fly_to_goals`

    """
    scale, is_soft = shape['scale'], body['mode'] != RIGID
    # the wrench in the axes at the start, per mass
    force, torque = ZERO, ZERO
    if body['has_wrench']:
        force, torque = wrench_in(body, posture)
    put_vector(body['applied'][0], plus(gravity, force))
    put_vector(body['applied'][1], torque)
    # in the frame of the pins
    gravity = minus(gravity, vector_of(body['pins_acceleration']))
    field = acceleration_field(body, motion, plus(gravity, force), torque, scale)
    to_p, to_s = deformation(body, shape, weights, q, x, v, motion, field)
    moments = Deviations(motion.mass_offset, ZERO, motion.gram, ZERO)
    if is_soft:
        moments = deviations(body, shape, weights, q, x, v, motion, to_p, to_s, pinned)
        if body['pins'] == 0:
            # rounding, and particles without mass, which regions give a little
            start = minus(to_p.constant, moments.mean_p)
            start_speed = minus(to_s.constant, moments.mean_s)
            to_p = Linear(start, to_p.r, to_p.u, to_p.g, to_p.u_g)
            to_s = Linear(start_speed, to_s.r, to_s.u, to_s.g, to_s.u_g)
    pp, internal = moments.pp, moments.pxs

    middle = inverse_about(motion.allowed, combined(0.5, motion.gram, 0.5, pp), scale, THIN)
    arm = scaled(0.5, plus(motion.mass_offset, moments.mean_p))
    if body['pins'] == 0:
        arm = ZERO
    turn, acceleration, moment = rotate(body, posture, middle, motion.spin, arm, gravity, h)
    # pins take what they must: without them, angular momentum is kept about any axis
    cut = THIN if body['pins'] > 0 else INERTIA_CUT
    after = inverse_about(motion.allowed, pp, scale, cut)
    spin = applied_transposed(turn, along(motion.spin, h, moment))
    rate = applied(after, minus(spin, internal))
    if body['pins'] == 0:
        spin = plus(applied(inertia_of(pp), rate), internal)
    # where pins carry it
    carry = rotation_by(scaled(h, motion.carried))
    turn = product(carry, turn)
    rate = plus(applied_transposed(turn, motion.carried), rate)
    if body['pins'] > 0:
        centre = plus(motion.pivot, vector_of(body['pins_shift']))
        velocity = along(motion.velocity, h, vector_of(body['pins_acceleration']))
    else:
        centre = along(motion.pivot, h, motion.velocity)
        centre = along(centre, 0.5 * h * h, acceleration)
        velocity = along(motion.velocity, h, acceleration)

    put_motion(body, centre, velocity, applied(turn, spin), turned(turn, after))
    put_turned(body, turn, motion.inverse, pp, internal, rate)
    put_vector(body['carried'], motion.carried)
    put_matrix(body['allowed'], turned(carry, motion.allowed))
    of_goal, speed_of_goal = times(to_p.g, IDENTITY), times(to_s.g, IDENTITY)
    if not is_soft:
        rest = vector_of_pins(body, shape, q, pinned)
        of_goal, speed_of_goal = times(scale, posture), NO_MATRIX
        start = applied(of_goal, scaled(-1.0, rest))
        to_p = Linear(start, NO_MATRIX, to_p.u, to_p.g, to_p.u_g)
        to_s = Linear(ZERO, NO_MATRIX, to_s.u, to_s.g, to_s.u_g)
    put_maps(
        body, to_p, to_s, of_goal, speed_of_goal, turn, rate, centre, velocity, motion.velocity
    )


@helper
def deformation(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    motion: Motion,
    field: Field,
) -> tuple[Linear, Linear]:
    """Return p and s after the tick as linear combinations, see `advance`."""
    a, b, c, d, given, given_v, left = blended_response(body, RESIDUAL)
    kept, by_goal, by_goal_v = body['kept_velocity'], 0.0, 0.0
    if body['mode'] != RIGID and left < 1.0:
        share = followed_share(body, shape, weights, q, x, v, motion) * (1.0 - left)
        by_goal, by_goal_v = b * share, d * share
    b, d = b * left, d * left
    turning = cross_matrix(motion.rate)
    of_r = combined(a, IDENTITY, -b * kept, turning)
    of_r = combined(1.0, of_r, given, field.of_offset)
    speed_of_r = combined(c, IDENTITY, -d * kept, turning)
    speed_of_r = combined(1.0, speed_of_r, given_v, field.of_offset)
    start, start_speed = scaled(given, field.constant), scaled(given_v, field.constant)
    return (
        Linear(start, of_r, b * kept, 1.0 - a, by_goal),
        Linear(start_speed, speed_of_r, d * kept, -c, by_goal_v),
    )


@helper
def put_maps(
    body: np.void,
    to_p: Linear,
    to_s: Linear,
    of_goal: Matrix,
    speed_of_goal: Matrix,
    turn: Matrix,
    rate: Vector,
    centre: Vector,
    velocity: Vector,
    velocity_before: Vector,
) -> None:
    """
    Write p and s + Ω' × p as linear maps of positions, velocities and goals, see `put_map`.

    Parameters
    ----------
    body : BODY
    to_p, to_s : Linear
    of_goal, speed_of_goal : matrix
        maps of the goal, in place of the factors in `to_p` and `to_s`; those of rigid bodies are
        rotations
    turn, rate
        rotation in the tick; Ω', rad/s
    centre, velocity
        of the pivot after the tick, m, m/s
    velocity_before
        V, m/s

    """
    rotating = cross_matrix(rate)
    put_map(
        body['map'][0],
        product(turn, to_p.r),
        times(to_p.u, turn),
        plus(centre, applied(turn, to_p.constant)),
        ZERO,
        velocity_before,
    )
    put_map(
        body['map'][1],
        product(turn, added(to_s.r, product(rotating, to_p.r))),
        product(turn, combined(to_s.u, IDENTITY, to_p.u, rotating)),
        plus(velocity, applied(turn, plus(to_s.constant, applied(rotating, to_p.constant)))),
        ZERO,
        velocity_before,
    )
    speed_of_goal = added(speed_of_goal, product(rotating, of_goal))
    speed_of_motion = combined(to_s.u_g, IDENTITY, to_p.u_g, rotating)
    put_matrix(body['map'][0, 10:13], transposed(times(to_p.u_g, turn)))
    put_matrix(body['map'][1, 10:13], transposed(product(turn, speed_of_motion)))
    put_matrix(body['map'][0, 7:10], transposed(product(turn, of_goal)))
    put_matrix(body['map'][1, 7:10], transposed(product(turn, speed_of_goal)))


@helper
def followed_share(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    motion: Motion,
) -> float:
    """
    Return the share of the velocities of goals with which damping takes energy, at most 1.

    It is 1 if goals follow by shares from 0 to 1. A goal that jumps, as a rotation can that is not
    unique, has a velocity that could give energy: with Σ w u_g² ≤ Σ w u · u_g it does not.
    """
    both = square = lanes_of(0.0)
    kept, turning = body['kept_velocity'], times(-1.0, cross_matrix(motion.rate))
    end, rest = body['first'] + body['count'], shape['first'] - body['first']
    to_motion = body['first_goal'] + body['count'] - body['first']
    for i in range(body['first'], end, LANES):
        left = end - i
        w, u_g = weights_at(weights, rest + i, left), vectors_at(q, to_motion + i, left)
        _, u = deformation_at(x, v, motion, turning, i, left)
        both, square = both + w * dot(u, u_g), square + w * dot(u_g, u_g)
    follows, size = kept * total(both), total(square)
    if follows >= size:
        return 1.0
    return max(follows / size, 0.0)


@helper
def vector_of_pins(body: np.void, shape: np.void, q: np.ndarray, pinned: np.ndarray) -> Vector:
    """Return the centre of the pins at rest, in units of the scale."""
    centre = ZERO
    for k in range(body['first_pin'], body['first_pin'] + body['pins']):
        centre = plus(centre, column_of(q, shape['first'] + pinned[k] - body['first']))
    return scaled(1.0 / body['pins'], centre)


@helper
def acceleration_field(
    body: np.void, motion: Motion, uniform: Vector, torque: Vector, scale: float
) -> Field:
    """Return the acceleration of deformation, b: centrifugal, and what pins withstand."""
    of_offset, constant = NO_MATRIX, ZERO
    if body['mode'] != RIGID:
        of_offset = centrifugal_field(body, motion.rate)
    moment = axial(product(motion.gram, transposed(of_offset)))
    if body['pins'] > 0:
        # gravity and a wrench, of which the torque is about the centre of mass
        offset = motion.mass_offset
        own = combined(1.0, motion.gram, -1.0, outer(offset, offset))
        angular = applied(inverse_about(IDENTITY, own, scale, THIN), torque)
        constant = minus(uniform, cross(angular, offset))
        of_offset = added(of_offset, cross_matrix(angular))
        moment = plus(moment, plus(torque, cross(offset, uniform)))
    angular = applied(motion.inverse, moment)
    return Field(constant, combined(1.0, of_offset, -1.0, cross_matrix(angular)))


@helper
def deviations(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    motion: Motion,
    to_p: Linear,
    to_s: Linear,
    pinned: np.ndarray,
) -> Deviations:
    """Return the moments of p and s, see `advance`."""
    mean_p = mean_s = upper = lower = angular = no_vectors()
    end, rest = body['first'] + body['count'], shape['first'] - body['first']
    to_goal = body['first_goal'] - body['first']
    for i in range(body['first'], end, LANES):
        left = end - i
        r = minus(vectors_at(x, i, left), motion.pivot)
        u, g = minus(vectors_at(v, i, left), motion.velocity), vectors_at(q, to_goal + i, left)
        u_g = vectors_at(q, to_goal + body['count'] + i, left)
        p, s = combination(to_p, r, u, g, u_g), combination(to_s, r, u, g, u_g)
        w = weights_at(weights, rest + i, left)
        weighted = scaled(w, p)
        mean_p, mean_s = plus(mean_p, weighted), along(mean_s, w, s)
        upper = along(upper, weighted[0], p)
        lower = plus(lower, (weighted[1] * p[1], weighted[1] * p[2], weighted[2] * p[2]))
        angular = plus(angular, cross(weighted, s))
    mean, speed = totals(mean_p), totals(mean_s)
    pp, pxs = symmetric(totals(upper), totals(lower)), totals(angular)
    if body['pins'] == 0:
        pp = combined(1.0, pp, -1.0, outer(mean, mean))
        return Deviations(mean, speed, pp, minus(pxs, cross(mean, speed)))
    # pinned particles stay where they are
    for k in range(body['first_pin'], body['first_pin'] + body['pins']):
        i = pinned[k]
        w, g = weights[rest + i], column_of(q, to_goal + i)
        r, u = minus(column_of(x, i), motion.pivot), minus(column_of(v, i), motion.velocity)
        u_g = column_of(q, to_goal + body['count'] + i)
        p, s = combination(to_p, r, u, g, u_g), combination(to_s, r, u, g, u_g)
        mean = along(mean, w, minus(r, p))
        pp = combined(1.0, pp, w, combined(1.0, outer(r, r), -1.0, outer(p, p)))
        pxs = along(pxs, -w, cross(p, s))
    return Deviations(mean, speed, pp, pxs)


@helper
def combination(of: Linear, r, u, g, u_g):  # type: ignore[no-untyped-def]
    """Return the combination of the vectors of a particle, or of lanes."""
    result = along(plus(of.constant, applied(of.r, r)), of.u, u)
    return along(along(result, of.g, g), of.u_g, u_g)
