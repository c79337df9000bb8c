# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sums over the particles of a body: moments of positions and velocities with the features.

Particles go through in tiles, which stay in the first cache, and in a fixed order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Matrix,
    Vector,
    along,
    column_of,
    cross,
    plus,
    scaled,
)
from softbody_ros.core.lanes import (
    LANES,
    LaneVector,
    no_vectors,
    put_vectors,
    totals,
    vectors_at,
    weights_at,
)
from softbody_ros.core.shape_matching.matching import LINEAR, fill, mixed_products, squares

TILE = 512
"""Particles per block, for several passes within the L1 cache."""
SAMPLES = 100
"""Approximate number of particles in the mean that serves as origin of a body."""
LARGEST_MOMENT = 1e100
"""Moment above which squares may overflow."""
SQUARES, MIXED = 1, 2
"""Blocks of three features, after that of q, see `squares` and `mixed_products`."""


class Tile(NamedTuple):
    """Particles start … stop − 1 of the world, those from rest + start on of the rest shapes."""

    start: int
    stop: int
    rest: int


class Sums(NamedTuple):
    """Sums over particles, with weights w: of positions y and velocities v."""

    y: Vector
    v: Vector
    yy: Matrix  # Σ w y yᵀ
    yxv: Vector  # Σ w y × v


@helper
def sample_mean(x: np.ndarray, body: np.void) -> Vector:
    """Return an approximate centre of a body, m, as the origin of sums, for precision."""
    total, count = ZERO, 0
    for i in range(body['first'], body['first'] + body['count'], body['count'] // SAMPLES + 1):
        total = plus(total, column_of(x, i))
        count += 1
    return scaled(1.0 / count, total)


@helper
def store_offsets(
    x: np.ndarray, start: int, stop: int, offset: Vector, y: np.ndarray, y_start: int
) -> None:
    """Write positions of particles, plus an offset, to columns of y that begin elsewhere."""
    for i in range(start, stop, LANES):
        left = stop - i
        put_vectors(y, y_start - start + i, left, plus(vectors_at(x, i, left), offset))


@helper
def sums_of_tile(
    tile: Tile, y: np.ndarray, to_y: int, v: np.ndarray, w: np.ndarray
) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """Return Σ w y, Σ w v, the upper half of Σ w y yᵀ, and Σ w y × v."""
    of_y = of_v = upper = lower = angular = no_vectors()
    for i in range(tile.start, tile.stop, LANES):
        left = tile.stop - i
        m = weights_at(w, tile.rest + i, left)
        p, u = vectors_at(y, to_y + i, left), vectors_at(v, i, left)
        weighted = scaled(m, p)
        of_y, of_v = plus(of_y, weighted), along(of_v, m, u)
        upper = along(upper, weighted[0], p)
        lower = plus(lower, (weighted[1] * p[1], weighted[1] * p[2], weighted[2] * p[2]))
        angular = plus(angular, cross(weighted, u))
    return totals(of_y), totals(of_v), totals(upper), totals(lower), totals(angular)


@helper
def features_at(q: np.ndarray, block: int, i: int, left: int) -> LaneVector:
    """Return q, its squares or its mixed products, of which no means are subtracted."""
    f = vectors_at(q, i, left)
    if block == SQUARES:
        return squares(f)
    if block == MIXED:
        return mixed_products(f)
    return f


@helper
def moments_of_tile(
    tile: Tile, a: np.ndarray, to_a: int, w: np.ndarray, q: np.ndarray, block: int
) -> Matrix:
    """Return Σ w f aᵀ of three features f and a field a."""
    first = second = third = no_vectors()
    for i in range(tile.start, tile.stop, LANES):
        left = tile.stop - i
        m, f = weights_at(w, tile.rest + i, left), features_at(q, block, tile.rest + i, left)
        weighted = scaled(m, vectors_at(a, to_a + i, left))
        first = along(first, f[0], weighted)
        second = along(second, f[1], weighted)
        third = along(third, f[2], weighted)
    return totals(first), totals(second), totals(third)


@helper
def add_moments(
    tile: Tile, a: np.ndarray, to_a: int, w: np.ndarray, q: np.ndarray, moments: np.ndarray
) -> None:
    """Add the moments Σ w f a of a tile to those of all features (F, 3)."""
    for block in range(len(moments) // 3):
        of_block = moments_of_tile(tile, a, to_a, w, q, block)
        for k in range(3):
            add_row(moments, 3 * block + k, of_block[k])


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
    yf: np.ndarray,
    vf: np.ndarray,
    y: np.ndarray,
) -> Sums:
    """
    Return the sums over all particles, at y = x + offset, tile by tile in a fixed order.

    Σ w f y and Σ w f v are written as yf and vf (F, 3).
    """
    mean_y, mean_v, yxv, upper, lower = ZERO, ZERO, ZERO, ZERO, ZERO
    fill(yf, 0.0)
    fill(vf, 0.0)
    end = body['first'] + body['count']
    for start in range(body['first'], end, TILE):
        tile = Tile(start, min(start + TILE, end), shape['first'] - body['first'])
        store_offsets(x, start, tile.stop, offset, y, 0)
        of_y, of_v, first_half, second_half, angular = sums_of_tile(tile, y, -start, v, weights)
        mean_y, mean_v, yxv = plus(mean_y, of_y), plus(mean_v, of_v), plus(yxv, angular)
        upper, lower = plus(upper, first_half), plus(lower, second_half)
        add_moments(tile, y, -start, weights, q, yf)
        add_moments(tile, v, 0, weights, q, vf)
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
