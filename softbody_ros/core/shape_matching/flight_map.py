# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The result of a flight as a linear map, from the start of the tick, of all particles of a body.

Positions and velocities after the flight are linear in positions y, velocities v and features of
the rest shape, with coefficients common to all particles: `map` of the record of a body. With
regions or pins, the goals of particles and the velocities of these take the place of the features
(see `goal_flight`). So what contact does to a body as a whole is a change of the map.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.body import LINEAR_MODE, QUADRATIC_MODE, RIGID
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    Matrix,
    Vector,
    along,
    applied,
    column_of,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    put_column,
    put_matrix,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.lanes import LANES, lanes_of, put_vectors, total, vectors_at
from softbody_ros.core.shape_matching.free_rotation import turned
from softbody_ros.core.shape_matching.matching import (
    LINEAR,
    linear_block,
    mixed_products,
    multiply,
    squares,
)


@helper
def put_map(
    rows_of_map: np.ndarray,
    of_r: Matrix,
    of_v: Matrix,
    constant: Vector,
    mean: Vector,
    velocity: Vector,
) -> None:
    """Write constant + A (y − mean) + B (v − V) as shift + A y + B v."""
    shift = minus(minus(constant, applied(of_r, mean)), applied(of_v, velocity))
    put_vector(rows_of_map[0], shift)
    put_matrix(rows_of_map[1:4], of_r)
    put_matrix(rows_of_map[4:7], of_v)


@helper
def keep_mean(rows_of_map: np.ndarray, shape: np.void, features: int) -> None:
    """
    Subtract from the constant of a map what rounding of the rest shape adds to the mean.

    Means of features are not quite 0 and the sum of the weights not quite 1: as these are the same
    in each tick, momentum would change steadily.
    """
    constant = vector_of(rows_of_map[0])
    constant = along(constant, -shape['weight_rounding'], constant)
    for f in range(features):
        constant = along(constant, -shape['feature_rounding'][f], vector_of(rows_of_map[7 + f]))
    put_vector(rows_of_map[0], constant)


@helper
def put_turned(
    body: np.void, turn: Matrix, inverse: Matrix, pp: Matrix, internal: Vector, rate: Vector
) -> None:
    """Write what contact needs of a flight, from axes that turn with the body."""
    put_matrix(body['turn'], turn)
    put_matrix(body['start_inverse_inertia'], turned(turn, inverse))
    put_matrix(body['second_moments'], turned(turn, pp))
    put_vector(body['inner_momentum'], applied(turn, internal))
    put_vector(body['angular_velocity'], applied(turn, rate))


@helper
def write(
    x: np.ndarray,
    v: np.ndarray,
    body: np.void,
    shape: np.void,
    q: np.ndarray,
    new_x: np.ndarray,
    new_v: np.ndarray,
) -> None:
    """Write the particles after the tick by the map of a body."""
    of_x, of_v = body['map'][0], body['map'][1]
    shift, drift = vector_of(of_x[0]), vector_of(of_v[0])
    x_of_y, x_of_u, x_of_q = matrix_of(of_x[1:4]), matrix_of(of_x[4:7]), linear_block(of_x[7:])
    v_of_y, v_of_u, v_of_q = matrix_of(of_v[1:4]), matrix_of(of_v[4:7]), linear_block(of_v[7:])
    square_x, square_v = linear_block(of_x[10:]), linear_block(of_v[10:])
    mixed_x, mixed_v = linear_block(of_x[13:]), linear_block(of_v[13:])
    is_soft, is_quadratic = body['mode'] != RIGID, has_products(body)
    if is_quadratic:
        for f in range(LINEAR, 9):
            shift = along(shift, -shape['feature_means'][f], vector_of(of_x[7 + f]))
            drift = along(drift, -shape['feature_means'][f], vector_of(of_v[7 + f]))
    first, rest = body['first'], first_feature(body, shape) - body['first']
    end, origin = first + body['count'], vector_of(body['origin'])
    follows_goals, to_motion = body['follows_goals'], rest + body['count']
    for i in range(first, end, LANES):
        left = end - i
        point = vectors_at(q, rest + i, left)
        to_x, to_v = plus(shift, applied(x_of_q, point)), plus(drift, applied(v_of_q, point))
        if is_soft:
            y, u = minus(vectors_at(x, i, left), origin), vectors_at(v, i, left)
            to_x = plus(to_x, plus(applied(x_of_y, y), applied(x_of_u, u)))
            to_v = plus(to_v, plus(applied(v_of_y, y), applied(v_of_u, u)))
        if is_quadratic:
            square, mixed = squares(point), mixed_products(point)
            to_x = plus(to_x, plus(applied(square_x, square), applied(mixed_x, mixed)))
            to_v = plus(to_v, plus(applied(square_v, square), applied(mixed_v, mixed)))
        elif follows_goals:
            motion = vectors_at(q, to_motion + i, left)
            to_x, to_v = (
                plus(to_x, applied(square_x, motion)),
                plus(to_v, applied(square_v, motion)),
            )
        put_vectors(new_x, i, left, to_x)
        put_vectors(new_v, i, left, to_v)


@helper
def put_start_shape(
    body: np.void,
    start: np.ndarray,
    v: np.ndarray,
    result: np.ndarray,
    flown: np.ndarray,
    h: float,
) -> tuple[float, float]:
    """
    Write the start shape x̂ = c' + E (x − c) in the place of the shape after the flight; keep that.

    A force that is constant over the tick acts on this shape: in rest it is the one at the end.

    Parameters
    ----------
    body : BODY
        after `fly`
    start, v : (3, N) float
        positions and velocities before the flight, m and m/s
    result : (3, N) float
        positions after it, m
    flown : (3, N) float
        written: positions after the flight, m
    h : float
        s

    Returns
    -------
    flown : float
        bound of the distance of a particle after the flight from where it is here, m: the norm of
        order 8
    coasting : float
        the same if particles went on with their velocities, m

    """
    turn, centre = matrix_of(body['turn']), vector_of(body['centre'])
    shift = minus(centre, applied(turn, vector_of(body['start_centre'])))
    # of the centre, from where it would get with its velocity to where its acceleration takes it
    fall = minus(scaled(h, vector_of(body['velocity'])), centre)
    fall = plus(fall, vector_of(body['start_centre']))
    first, end, last, last_coasting = body['first'], body['first'] + body['count'], 0.0, 0.0
    powers = powers_coasting = lanes_of(0.0)
    whole = end - body['count'] % LANES
    for i in range(first, whole, LANES):
        before = vectors_at(start, i, LANES)
        turned = plus(shift, applied(turn, before))
        after = vectors_at(result, i, LANES)
        coasted = plus(along(before, h, vectors_at(v, i, LANES)), fall)
        powers = powers + eighth_power(minus(after, turned))
        powers_coasting = powers_coasting + eighth_power(minus(coasted, turned))
        put_vectors(flown, i, LANES, after)
        put_vectors(result, i, LANES, turned)
    for i in range(whole, end):
        start_place, after = column_of(start, i), column_of(result, i)
        place = plus(shift, applied(turn, start_place))
        coasted = plus(along(start_place, h, column_of(v, i)), fall)
        last += eighth_power(minus(after, place))
        last_coasting += eighth_power(minus(coasted, place))
        put_column(flown, i, after)
        put_column(result, i, place)
    coasting = eighth_root(total(powers_coasting) + last_coasting) + norm(fall)
    return eighth_root(total(powers) + last), coasting


@helper
def eighth_power(a):  # type: ignore[no-untyped-def]
    """Return |a|⁸ of a vector, or of lanes."""
    square = dot(a, a)
    square = square * square
    return square * square


@helper
def eighth_root(value: float) -> float:
    """Return the root of order 8."""
    return math.sqrt(math.sqrt(math.sqrt(value)))


@helper
def first_feature(body: np.void, shape: np.void) -> int:
    """Return the column of `q` with the features, or the goal, of the first particle."""
    return body['first_goal'] if body['follows_goals'] else shape['first']


@helper
def has_products(body: np.void) -> bool:
    """Return whether products of features, too, are in the map of a body."""
    return body['mode'] == QUADRATIC_MODE and not body['follows_goals']


# ------------------------------------------------------------------------------- whitened features
@helper
def products_at(shape: np.void, rest_q: Vector) -> tuple[Vector, Vector]:
    """Return the quadratic features at a rest position: squares and mixed products."""
    means = shape['feature_means']
    square = minus(squares(rest_q), vector_of(means[3:]))
    return square, minus(mixed_products(rest_q), vector_of(means[6:]))


@helper
def whiten(body: np.void, shape: np.void, moments: np.ndarray, result: np.ndarray) -> None:
    """
    Write moments Σ w ψ aᵀ with whitened features of moments Σ w f aᵀ.

    Parameters
    ----------
    body : BODY
    shape : SHAPE
    moments, result : (9, 3) float
        the moments of a BODY record: 3 rows are used in mode linear, all in mode quadratic

    """
    if body['mode'] == QUADRATIC_MODE:
        multiply(shape['whitening_quadratic'], moments, result)
    else:
        multiply(shape['whitening_linear'], moments[:LINEAR], result[:LINEAR])


@helper
def whitened_features(
    body: np.void, shape: np.void, q: np.ndarray, i: int, psi: np.ndarray
) -> int:
    """
    Write the features ψ of particle i of the world with Σ w ψ ψᵀ = 1, and return their number.

    Those in place of combinations of features that the shape does not span are 0.

    Parameters
    ----------
    body : BODY
    shape : SHAPE
    q : (3, M) float
        of all rest shapes
    i : int
    psi : (9,) float

    """
    rest_q = column_of(q, shape['first'] + i - body['first'])
    if body['mode'] == RIGID:
        return 0
    if body['mode'] == LINEAR_MODE:
        for k in range(LINEAR):
            psi[k] = dot(vector_of(shape['whitening_linear'][k]), rest_q)
        return LINEAR
    square, mixed = products_at(shape, rest_q)
    for k in range(9):
        row = shape['whitening_quadratic'][k]
        psi[k] = dot(vector_of(row), rest_q) + dot(vector_of(row[3:]), square)
        psi[k] += dot(vector_of(row[6:]), mixed)
    return 9
