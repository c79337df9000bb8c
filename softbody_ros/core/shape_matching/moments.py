# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sums over the particles of a body: moments of positions and velocities with the features.

Particles go through in tiles, which stay in the first cache, and in a fixed order. The predicted
positions are not stored: they are computed anew where they are read.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    NO_MATRIX,
    ZERO,
    Matrix,
    Vector,
    added,
    along,
    column_of,
    combined,
    cross,
    minus,
    outer,
    plus,
    scaled,
)
from softbody_ros.core.lanes import LANES, Lanes, Rows, lanes_at, lanes_of, total
from softbody_ros.core.shape_matching.matching import LINEAR, fill

TILE = 512
"""Particles per block, for several passes within the L1 cache."""
SAMPLES = 100
"""Approximate number of particles in the mean that serves as origin of a body."""
LARGEST_MOMENT = 1e100
"""Moment above which squares may overflow."""
FIRST_FACTOR, SECOND_FACTOR = (0, 1, 2, 0, 1, 2), (0, 1, 2, 1, 2, 0)
"""The features after q are products of two coordinates."""


class Sums(NamedTuple):
    """Sums over particles, with weights w: of predicted positions y and velocities v."""

    y: Vector
    v: Vector
    yy: Matrix  # Σ w y yᵀ
    yxv: Vector  # Σ w y × v


class RegionSums(NamedTuple):
    """The same of the goals by regions p, with y̅ the offset of y from its mean."""

    p: Vector
    pp: Matrix  # Σ w p̅ p̅ᵀ
    py: Matrix  # Σ w p̅ y̅ᵀ
    pxv: Vector  # Σ w p̅ × v


@helper
def rows(field: np.ndarray, start: int, stop: int) -> Rows:
    """Return a slice of a field (3, n) as contiguous rows, for which LLVM vectorises loops."""
    return field[0, start:stop], field[1, start:stop], field[2, start:stop]


@helper
def sample_mean(x: np.ndarray, body: np.void) -> Vector:
    """Return an approximate centre of a body, m, as the origin of sums, for precision."""
    total, count = ZERO, 0
    for i in range(body['first'], body['first'] + body['count'], body['count'] // SAMPLES + 1):
        total = plus(total, column_of(x, i))
        count += 1
    return scaled(1.0 / count, total)


@helper
def predict_row(x: np.ndarray, v: np.ndarray, offset: float, h: float, y: np.ndarray) -> None:
    """Write y = x + offset + h v."""
    for i in range(len(x)):
        y[i] = x[i] + offset + h * v[i]


@helper
def predict(x: Rows, v: Rows, offset: Vector, h: float, y: Rows) -> None:
    """Write the predicted positions x + h v + h² g / 2, relative to a point."""
    predict_row(x[0], v[0], offset[0], h, y[0])
    predict_row(x[1], v[1], offset[1], h, y[1])
    predict_row(x[2], v[2], offset[2], h, y[2])


@helper
def store_predicted(
    x: np.ndarray, v: np.ndarray, body: np.void, offset: Vector, h: float, y: np.ndarray
) -> None:
    """Write the predicted positions of a whole body."""
    first, last = body['first'], body['first'] + body['count']
    predict(rows(x, first, last), rows(v, first, last), offset, h, rows(y, first, last))


@helper
def feature_row(q: Rows, f: int, scratch: np.ndarray) -> np.ndarray:
    """Return coordinate f of the rest shape, or write a product of two; means not subtracted."""
    if f == 0:
        return q[0]
    if f == 1:
        return q[1]
    if f == 2:
        return q[2]
    a, b = q[FIRST_FACTOR[f - 3]], q[SECOND_FACTOR[f - 3]]
    for i in range(len(a)):
        scratch[i] = a[i] * b[i]
    return scratch


@helper
def vectors_at(
    x: np.ndarray, y: np.ndarray, z: np.ndarray, i: int, count: int
) -> tuple[Lanes, Lanes, Lanes]:
    """Return the vectors of particles i … i + 3, zero from `count` on."""
    return lanes_at(x, i, count), lanes_at(y, i, count), lanes_at(z, i, count)


@helper
def no_lanes() -> tuple[Lanes, Lanes, Lanes]:
    """Return where a sum of vectors begins."""
    return lanes_of(0.0), lanes_of(0.0), lanes_of(0.0)


@helper
def totals(sums: tuple[Lanes, Lanes, Lanes]) -> Vector:
    """Return the sum of the vectors of all lanes."""
    return total(sums[0]), total(sums[1]), total(sums[2])


@helper
def sums_of_tile(y: Rows, v: Rows, w: np.ndarray) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """Return Σ w y, Σ w v, the upper half of Σ w y yᵀ, and Σ w y × v."""
    of_y = of_v = upper = lower = angular = no_lanes()
    (y0, y1, y2), (v0, v1, v2), count = y, v, len(w)
    for i in range(0, count, LANES):
        m = lanes_at(w, i, count)
        p, u = vectors_at(y0, y1, y2, i, count), vectors_at(v0, v1, v2, i, count)
        weighted = scaled(m, p)
        of_y, of_v = plus(of_y, weighted), along(of_v, m, u)
        upper = along(upper, weighted[0], p)
        lower = plus(lower, (weighted[1] * p[1], weighted[1] * p[2], weighted[2] * p[2]))
        angular = plus(angular, cross(weighted, u))
    return totals(of_y), totals(of_v), totals(upper), totals(lower), totals(angular)


@helper
def moments_of_tile(y: Rows, v: Rows, w: np.ndarray, f: np.ndarray) -> tuple[Vector, Vector]:
    """Return Σ w f y and Σ w f v of one feature."""
    of_y = of_v = no_lanes()
    (y0, y1, y2), (v0, v1, v2), count = y, v, len(w)
    for i in range(0, count, LANES):
        m = lanes_at(w, i, count) * lanes_at(f, i, count)
        of_y = along(of_y, m, vectors_at(y0, y1, y2, i, count))
        of_v = along(of_v, m, vectors_at(v0, v1, v2, i, count))
    return totals(of_y), totals(of_v)


@helper
def add_row(transform: np.ndarray, f: int, a: Vector) -> None:
    """Add to one row of a transform (F, 3)."""
    transform[f, 0] += a[0]
    transform[f, 1] += a[1]
    transform[f, 2] += a[2]


@helper
def subtract_means(transform: np.ndarray, shape: np.void, mean: Vector) -> None:
    """Complete Σ w f a (F, 3) of products f: features are products minus their means."""
    for f in range(LINEAR, len(transform)):
        add_row(transform, f, scaled(-shape['feature_means'][f], mean))


@helper
def symmetric(upper: Vector, lower: Vector) -> Matrix:
    """Return the matrix of its elements 00, 01, 02 and 11, 12, 22."""
    return (
        (upper[0], upper[1], upper[2]),
        (upper[1], lower[0], lower[1]),
        (upper[2], lower[1], lower[2]),
    )


@helper
def particle_sums(
    x: np.ndarray,
    v: np.ndarray,
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    offset: Vector,
    h: float,
    yf: np.ndarray,
    vf: np.ndarray,
    tile: np.ndarray,
) -> Sums:
    """
    Return the sums over all particles, at y = x + offset + h v, tile by tile in a fixed order.

    Σ w f y and Σ w f v are written as yf and vf (F, 3).
    """
    mean_y, mean_v, yxv, upper, lower = ZERO, ZERO, ZERO, ZERO, ZERO
    fill(yf, 0.0)
    fill(vf, 0.0)
    rest = shape['first'] - body['first']
    end = body['first'] + body['count']
    for start in range(body['first'], end, TILE):
        stop = min(start + TILE, end)
        u, y = rows(v, start, stop), rows(tile, 0, stop - start)
        w, rest_q = weights[rest + start : rest + stop], rows(q, rest + start, rest + stop)
        predict(rows(x, start, stop), u, offset, h, y)
        of_y, of_v, first_half, second_half, angular = sums_of_tile(y, u, w)
        mean_y, mean_v, yxv = plus(mean_y, of_y), plus(mean_v, of_v), plus(yxv, angular)
        upper, lower = plus(upper, first_half), plus(lower, second_half)
        for f in range(len(yf)):
            of_y, of_v = moments_of_tile(y, u, w, feature_row(rest_q, f, tile[3, : stop - start]))
            add_row(yf, f, of_y)
            add_row(vf, f, of_v)
    subtract_means(yf, shape, mean_y)
    subtract_means(vf, shape, mean_v)
    return Sums(mean_y, mean_v, symmetric(upper, lower), yxv)


@helper
def is_finite(centre: Vector, moments: np.ndarray) -> bool:
    """Return whether all positions and velocities are finite, from moments, sums over all."""
    largest = abs(centre[0]) + abs(centre[1]) + abs(centre[2])
    for f in range(len(moments)):
        largest += abs(moments[f, 0]) + abs(moments[f, 1]) + abs(moments[f, 2])
    return largest < LARGEST_MOMENT


@helper
def region_sums(
    x: np.ndarray,
    v: np.ndarray,
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    q: np.ndarray,
    offset: Vector,
    h: float,
    region_goals: np.ndarray,
    pf: np.ndarray,
    tile: np.ndarray,
) -> RegionSums:
    """Return the sums with the goals by regions; Σ w f p is written as pf (F, 3)."""
    mean, pxv = ZERO, ZERO
    pp, py = NO_MATRIX, NO_MATRIX
    velocity, y_mean = ZERO, ZERO
    rest = shape['first'] - body['first']
    end = body['first'] + body['count']
    for start in range(body['first'], end, TILE):
        stop = min(start + TILE, end)
        u, y, p = (
            rows(v, start, stop),
            rows(tile, 0, stop - start),
            rows(region_goals, start, stop),
        )
        w, rest_q = weights[rest + start : rest + stop], rows(q, rest + start, rest + stop)
        predict(rows(x, start, stop), u, offset, h, y)
        of_p, of_v, upper, lower, angular = sums_of_tile(p, u, w)
        mean, velocity, pxv = plus(mean, of_p), plus(velocity, of_v), plus(pxv, angular)
        pp = added(pp, symmetric(upper, lower))
        mixed, of_y = products_of_tile(p, y, w)
        py, y_mean = added(py, mixed), plus(y_mean, of_y)
        for f in range(len(pf)):
            of_p, _ = moments_of_tile(p, u, w, feature_row(rest_q, f, tile[3, : stop - start]))
            add_row(pf, f, of_p)
    subtract_means(pf, shape, mean)
    pp = combined(1.0, pp, -1.0, outer(mean, mean))
    py = combined(1.0, py, -1.0, outer(mean, y_mean))
    return RegionSums(mean, pp, py, minus(pxv, cross(mean, velocity)))


@helper
def products_of_tile(p: Rows, y: Rows, w: np.ndarray) -> tuple[Matrix, Vector]:
    """Return Σ w p yᵀ and Σ w y."""
    first = second = third = of_y = no_lanes()
    (p0, p1, p2), (y0, y1, y2), count = p, y, len(w)
    for i in range(0, count, LANES):
        goal = vectors_at(p0, p1, p2, i, count)
        weighted = scaled(lanes_at(w, i, count), vectors_at(y0, y1, y2, i, count))
        of_y = plus(of_y, weighted)
        first = along(first, goal[0], weighted)
        second = along(second, goal[1], weighted)
        third = along(third, goal[2], weighted)
    return (totals(first), totals(second), totals(third)), totals(of_y)
