# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Unconstrained motion in a tick: predict, match, pull to the goal, restore the momentum.

Müller, Heidelberger, Teschner, Gross: Meshless Deformations Based on Shape Matching, SIGGRAPH
2005. Free fall is a parabola at any step, and momentum and angular momentum are kept to rounding.

The new position and velocity of a particle are linear combinations, with coefficients common to
all particles of its body, of its predicted position, its velocity, the features of the rest shape,
and its goal by the regions. So a tick reads the particles once, for sums of products of these;
computes the coefficients from the sums, exactly as from the particles; and reads the particles
once more to write the result.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.body import RIGID
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
    axial,
    column_of,
    combined,
    cross,
    cross_matrix,
    minus,
    outer,
    plus,
    product,
    put_column,
    put_vector,
    scaled,
    times,
    transposed,
    vector_of,
)
from softbody_ros.core.lanes import LANES, put_vectors, vectors_at
from softbody_ros.core.shape_matching.goals import (
    find_goal,
    match_regions,
    put_goal,
)
from softbody_ros.core.shape_matching.matching import (
    LINEAR,
    copy,
    fill,
    linear_block,
    mixed_products,
    multiply,
    squares,
)
from softbody_ros.core.shape_matching.moments import (
    TILE,
    RegionSums,
    Sums,
    add_row,
    is_finite,
    particle_sums,
    predict,
    region_sums,
    sample_mean,
    store_predicted,
)
from softbody_ros.core.shape_matching.polar_decomposition import rotation_of
from softbody_ros.core.shape_matching.rigid_motion import (
    inverse_inertia_of,
    measure,
    put_motion,
)


class Pull(NamedTuple):
    """Gains of a tick: x += s (g − x), v += k (g − v), and the velocity that damping keeps."""

    s: float
    k: float
    kept_velocity: float


class ParticleMap(NamedTuple):
    """
    The result of a tick: x' = shift + a y + T f + c p, v' = drift + M y + b v + G f + E p.

    T and G are separate arrays (F, 3).
    """

    shift: Vector
    a: float
    c: float
    drift: Vector
    m: Matrix
    b: float
    e: Matrix


@kernel
def predict_and_match(
    bodies: np.ndarray,
    awake: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    q: np.ndarray,
    regions: np.ndarray,
    member: np.ndarray,
    features: np.ndarray,
    weighted_features: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    region_goals: np.ndarray,
    stretch: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    gravity: np.ndarray,
    h: float,
) -> int:
    """
    Move bodies without contacts, from the half `now` of `x` and `v` to the other one.

    Parameters
    ----------
    bodies : (B,) BODY
        results of the tick are written into them
    awake : (A,) int
        bodies to move
    shapes : (R,) SHAPE
    weights, q : (M,), (3, M) float
        of all rest shapes
    regions : (Q,) REGION
    member, features, weighted_features : (m,), (4, m), (4, m)
        members of all regions, see `Regions`
    x, v : (2, 3, N) float
        m, m/s
    region_goals : (3, N) float
        written: goals by regions, m from the origin; not used without regions
    stretch : (2, S, 3, 3) float
        plastic states of all matches
    match_centre, match_posture : (S, 3), (S, 3, 3) float
        written: centres, m, and linear maps of offsets, of the matched shapes
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
        shape, matched = shapes[body['shape']], shapes[body['matched']]
        now = body['now']
        body['flowed'], body['flattened'][1 - now] = False, 0.0
        x0, v0, x1, v1 = x[now], v[now], x[1 - now], v[1 - now]
        if body['has_wrench']:
            apply_wrench(body, shape, weights, q, x0, v0, x1, v1, h)
            x0, v0 = x1, v1
        transforms = quadratic if body['mode'] > 1 else linear
        goal_x, goal_v = transforms[0], transforms[1]
        yf, vf, pf, scratch = transforms[2], transforms[3], transforms[4], transforms[5:]
        origin = sample_mean(x0, body)
        offset = minus(scaled(0.5 * h * h, g), origin)
        total = particle_sums(x0, v0, body, shape, weights, q, offset, h, yf, vf, tile)
        if not is_finite(total.y, yf):
            return 1 + awake[index]
        centre = total.y
        if body['matched'] == body['shape']:
            copy(yf, scratch[0])
        else:
            own = particle_sums(x0, v0, body, matched, weights, q, offset, h, scratch[0], pf, tile)
            centre = own.y
        degeneracy = find_goal(body, matched, stretch, match_posture, scratch, goal_x, goal_v)
        put_vector(match_centre[body['first_match']], plus(origin, centre))
        share, of_regions = 1.0, RegionSums(ZERO, NO_MATRIX, NO_MATRIX, ZERO)
        fill(pf, 0.0)
        if body['regions']:
            share = body['whole_body_weight']
            first, end = body['first'], body['first'] + body['count']
            store_predicted(x0, v0, first, end, offset, h, region_goals, first)
            match_regions(
                body, matched, regions, member, features, weighted_features, region_goals, stretch,
                match_centre, match_posture, origin, degeneracy,
            )  # fmt: skip
            of_regions = region_sums(
                x0, v0, body, shape, weights, q, offset, h, region_goals, pf, tile
            )
        put_goal(body, origin, centre, matched, share, goal_v)
        gain = blended_gains(body, degeneracy)
        if body['matched'] == body['shape']:
            mapping = solve(
                body, shape, origin, scaled(h, g), total, yf, vf, of_regions, pf, share, gain,
                goal_x, goal_v, scratch[0],
            )  # fmt: skip
        else:
            mapping = solve_pinned(
                body, shape, origin, scaled(h, g), total, centre, share, gain, goal_x, goal_v
            )
        write(x0, v0, body, matched, q, offset, h, mapping, goal_x, goal_v, region_goals, x1, v1)
        if body['matched'] != body['shape']:
            measure_motion(body, shape, weights, x1, v1)
        for row in range(2):
            put_vector(body['received'][row], ZERO)
        put_vector(body['load'], ZERO)
    return 0


@helper
def blended_gains(body: np.void, degeneracy: float) -> Pull:
    """Return the gains of a body, blended towards critical damping in degenerate states."""
    body['degeneracy'] = degeneracy
    pull, critical = body['pull'], body['critical_pull']
    s = pull[0] + degeneracy * (critical[0] - pull[0])
    k = pull[1] + degeneracy * (critical[1] - pull[1])
    return Pull(s, k, body['kept_velocity'])


@helper
def summed_outer(a: np.ndarray, b: np.ndarray) -> Matrix:
    """Return Σ_f a_f b_fᵀ of two transforms."""
    total = NO_MATRIX
    for f in range(len(a)):
        total = added(total, outer(vector_of(a[f]), vector_of(b[f])))
    return total


@helper
def summed_cross(a: np.ndarray, b: np.ndarray) -> Vector:
    """Return Σ_f a_f × b_f of two transforms."""
    total = ZERO
    for f in range(len(a)):
        total = plus(total, cross(vector_of(a[f]), vector_of(b[f])))
    return total


@helper
def scale_transform(transform: np.ndarray, factor: float) -> None:
    """Multiply a transform by a number."""
    for f in range(len(transform)):
        for axis in range(3):
            transform[f, axis] *= factor


@helper
def damping_field(body: np.void, shape: np.void, yy: Matrix, yxv: Vector, kept: float) -> Matrix:
    """
    Return D: damping scales all velocities by `kept`, and adds D y̅ to preserve the rotation.

    So it acts on the velocity of deformation only, which is all but the rigid motion.
    """
    if kept >= 1.0:
        return NO_MATRIX
    angular_velocity = applied(inverse_inertia_of(yy, shape['scale']), yxv)
    return times(1.0 - kept, cross_matrix(angular_velocity))


@helper
def solve(
    body: np.void,
    shape: np.void,
    origin: Vector,
    gravity_step: Vector,
    total: Sums,
    yf: np.ndarray,
    vf: np.ndarray,
    regions: RegionSums,
    pf: np.ndarray,
    share: float,
    gain: Pull,
    t: np.ndarray,
    g: np.ndarray,
    gram_t: np.ndarray,
) -> ParticleMap:
    """
    Return the result of a tick: damping, pull (eq. 9, 10), restored momentum.

    The pull keeps angular momentum to first order only: moving the particles by s (g − x) changes
    the inertia at fixed velocities. With y̅ = y − c, v̅ = v − V the pull gives
    x̅ = a y̅ + T f + c p̅ and v' = b v̅ + D y̅ + G f + e p̅, whose moments are products of the sums;
    the difference in rigid motion is added.

    Parameters
    ----------
    body : BODY
        its rigid motion is written
    shape : SHAPE
    origin, gravity_step : vector
        of positions, m; h g, m/s
    total, yf, vf
        sums, Σ w f y and Σ w f v
    regions, pf
        sums with the goals by regions, Σ w f p
    share : float
        weight of the whole body in the goal; the regions have the rest
    gain : Pull
    t, g : (F, 3) float
        the transforms of the goals for positions and velocities; then T, m, and G, m/s
    gram_t : (F, 3) float
        scratch

    """
    scale = shape['scale']
    velocity = plus(total.v, gravity_step)
    yy = combined(1.0, total.yy, -1.0, outer(total.y, total.y))
    yxv = minus(total.yxv, cross(total.y, total.v))
    a, b, k = 1.0 - gain.s, gain.kept_velocity, gain.k
    d = damping_field(body, shape, yy, yxv, b)
    if body['mode'] == RIGID:
        # no deformation: all velocity comes from the momentum, below
        b, k, d = 0.0, 0.0, NO_MATRIX
    d = combined(1.0, d, -k, IDENTITY)
    scale_transform(t, gain.s * share * scale)
    scale_transform(g, k * share * scale)
    c, e = gain.s * (1.0 - share), k * (1.0 - share)

    if len(t) == LINEAR:
        multiply(shape['gram'][:LINEAR, :LINEAR], t, gram_t)
    else:
        multiply(shape['gram'], t, gram_t)
    ty, tp = summed_outer(t, yf), summed_outer(t, pf)
    xy = combined(a, yy, 1.0, ty)  # Σ w x̅ y̅ᵀ
    xx = combined(a * a, yy, a, added(ty, transposed(ty)))
    xx = added(xx, summed_outer(gram_t, t))
    angular_momentum = plus(scaled(a * b, yxv), scaled(b, summed_cross(t, vf)))
    angular_momentum = along(angular_momentum, a, summed_cross(yf, g))
    angular_momentum = plus(angular_momentum, summed_cross(gram_t, g))
    if body['regions']:
        xy = combined(1.0, xy, c, regions.py)
        xx = combined(1.0, xx, a * c, added(regions.py, transposed(regions.py)))
        xx = combined(1.0, xx, c, added(tp, transposed(tp)))
        xx = combined(1.0, xx, c * c, regions.pp)
        angular_momentum = along(angular_momentum, b * c, regions.pxv)
        angular_momentum = along(angular_momentum, c, summed_cross(pf, g))
        angular_momentum = along(angular_momentum, -a * e, axial(regions.py))
        angular_momentum = along(angular_momentum, e, summed_cross(t, pf))
    angular_momentum = plus(angular_momentum, axial(product(xy, transposed(d))))

    inverse = inverse_inertia_of(xx, scale)
    omega = applied(inverse, minus(yxv, angular_momentum))
    for f in range(len(t)):
        add_row(g, f, cross(omega, vector_of(t[f])))
    m = combined(1.0, d, a, cross_matrix(omega))
    of_regions = combined(e, IDENTITY, c, cross_matrix(omega))
    centre = scaled(a + gain.s * share, total.y)
    # relative to y itself, as it was summed: y minus its mean would be rounded differently
    shift, drift = scaled(gain.s * share, total.y), along(velocity, -b, total.v)
    drift = minus(drift, applied(m, total.y))
    if body['regions']:
        centre = along(centre, c, regions.p)
        drift = minus(drift, applied(of_regions, regions.p))
    put_motion(body, plus(origin, centre), velocity, yxv, inverse)
    return ParticleMap(plus(origin, shift), a, c, drift, m, b, of_regions)


@helper
def solve_pinned(
    body: np.void,
    shape: np.void,
    origin: Vector,
    gravity_step: Vector,
    total: Sums,
    centre: Vector,
    share: float,
    gain: Pull,
    t: np.ndarray,
    g: np.ndarray,
) -> ParticleMap:
    """Return the result of a tick of a body with pins, which change its momentum."""
    scale = shape['scale']
    yy = combined(1.0, total.yy, -1.0, outer(total.y, total.y))
    yxv = minus(total.yxv, cross(total.y, total.v))
    a, b, k = 1.0 - gain.s, gain.kept_velocity, gain.k
    d = damping_field(body, shape, yy, yxv, b)
    scale_transform(t, gain.s * share * scale)
    scale_transform(g, k * share * scale)
    c, e = gain.s * (1.0 - share), k * (1.0 - share)
    shift = along(origin, gain.s * share, centre)
    drift = along(along(plus(total.v, gravity_step), -b, total.v), k * share, centre)
    drift = minus(drift, applied(d, total.y))
    return ParticleMap(
        shift, a, c, drift, combined(1.0, d, -k, IDENTITY), b, combined(e, IDENTITY, 0.0, IDENTITY)
    )


@helper
def measure_motion(
    body: np.void, shape: np.void, weights: np.ndarray, x: np.ndarray, v: np.ndarray
) -> None:
    """Write the rigid motion of a body, computed from its particles."""
    own = weights[shape['first'] : shape['first'] + shape['count']]
    centre, velocity, angular_momentum, gram = measure(x, v, body['first'], own)
    inverse = inverse_inertia_of(gram, shape['scale'])
    put_motion(body, centre, velocity, angular_momentum, inverse)


@helper
def write(
    x: np.ndarray,
    v: np.ndarray,
    body: np.void,
    shape: np.void,
    q: np.ndarray,
    offset: Vector,
    h: float,
    mapping: ParticleMap,
    t: np.ndarray,
    g: np.ndarray,
    region_goals: np.ndarray,
    new_x: np.ndarray,
    new_v: np.ndarray,
) -> None:
    """Write the particles after the tick; possibly in place."""
    shift, drift, a, b, m = mapping.shift, mapping.drift, mapping.a, mapping.b, mapping.m
    linear_t, linear_g = linear_block(t), linear_block(g)
    square_t = mixed_t = square_g = mixed_g = NO_MATRIX
    is_quadratic, has_regions = len(t) > LINEAR, body['regions'] > 0
    if is_quadratic:
        square_t, mixed_t = linear_block(t[3:]), linear_block(t[6:])
        square_g, mixed_g = linear_block(g[3:]), linear_block(g[6:])
    for f in range(LINEAR, len(t)):
        shift = along(shift, -shape['feature_means'][f], vector_of(t[f]))
        drift = along(drift, -shape['feature_means'][f], vector_of(g[f]))
    first, rest = body['first'], shape['first'] - body['first']
    end = first + body['count']
    for i in range(first, end, LANES):
        left = end - i
        u, point = vectors_at(v, i, left), vectors_at(q, rest + i, left)
        y = predict(x, v, i, left, offset, h)
        to_x = plus(along(shift, a, y), applied(linear_t, point))
        to_v = plus(along(plus(drift, applied(m, y)), b, u), applied(linear_g, point))
        if is_quadratic:
            square, mixed = squares(point), mixed_products(point)
            to_x = plus(to_x, plus(applied(square_t, square), applied(mixed_t, mixed)))
            to_v = plus(to_v, plus(applied(square_g, square), applied(mixed_g, mixed)))
        if has_regions:
            p = vectors_at(region_goals, i, left)
            to_x, to_v = along(to_x, mapping.c, p), plus(to_v, applied(mapping.e, p))
        put_vectors(new_x, i, left, to_x)
        put_vectors(new_v, i, left, to_v)


@helper
def apply_wrench(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    new_x: np.ndarray,
    new_v: np.ndarray,
    h: float,
) -> None:
    """
    Accelerate a body by its wrench: a rigid acceleration field on its particles, like gravity.

    Evaluated at the midpoint of the tick, so that the change of angular momentum is exactly h
    times the torque. Written are velocities v + h a and positions x − h² a / 2, from which the
    prediction gives x + h v + h² a / 2.
    """
    first, last = body['first'], body['first'] + body['count']
    rest = shape['first'] - first
    own = weights[shape['first'] : shape['first'] + shape['count']]
    for i in range(first, last):
        put_column(new_x, i, along(column_of(x, i), 0.5 * h, column_of(v, i)))
    centre, _, _, gram = measure(new_x, v, first, own)
    moment = NO_MATRIX
    for i in range(first, last):
        arm = scaled(weights[rest + i], minus(column_of(new_x, i), centre))
        moment = added(moment, outer(arm, column_of(q, rest + i)))
    rotation = rotation_of(moment)
    wrench = body['wrench']
    force = plus(vector_of(wrench[0, 0]), applied(rotation, vector_of(wrench[1, 0])))
    torque = plus(vector_of(wrench[0, 1]), applied(rotation, vector_of(wrench[1, 1])))
    omega = applied(inverse_inertia_of(gram, shape['scale']), torque)
    for i in range(first, last):
        acceleration = plus(force, cross(omega, minus(column_of(new_x, i), centre)))
        put_column(new_x, i, along(column_of(x, i), -0.5 * h * h, acceleration))
        put_column(new_v, i, along(column_of(v, i), h, acceleration))
