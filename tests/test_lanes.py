# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes, against floats that are added one by one: the same bits, compiled and in plain Python."""

import numpy as np
import pytest

from softbody_ros.core.compiled import kernel
from softbody_ros.core.lanes import LANES, lanes_of, put_vectors, total, vectors_at, weights_at
from softbody_ros.core.shape_matching import moments

pytestmark = [pytest.mark.oldest, pytest.mark.plain]


@kernel
def sum_of(values, start, stop):
    result = lanes_of(0.0)
    for i in range(start, stop, LANES):
        result = result + weights_at(values, i, stop - i)
    return total(result)


@kernel
def arithmetic(x, y, factor, stop, result):
    for i in range(0, stop, LANES):
        a, b = vectors_at(x, i, stop - i), vectors_at(y, i, stop - i)
        mixed = (factor - a[0] * b[0], b[1] * factor + a[1], (a[2] - b[2]) - (1.0 + a[2]))
        put_vectors(result, i, stop - i, mixed)


@kernel
def move_columns(x, start, stop, to, result):
    for i in range(start, stop, LANES):
        put_vectors(result, to + i - start, stop - i, vectors_at(x, i, stop - i))


@kernel
def moments_of(x, start, stop, rest, weights, q, block, result):
    tile = moments.Tile(start, stop, rest)
    found = moments.moments_of_tile(tile, x, -start, weights, q, block)
    for row in range(3):
        for column in range(3):
            result[row, column] = found[row][column]


def random_numbers(*shape):
    """Return numbers of very different sizes, in whose sums the order shows."""
    random = np.random.default_rng(0)
    return random.normal(size=shape) * 10.0 ** random.integers(-8, 8, size=shape)


def added_up(values):
    """Return the sum of floats in the order of the lanes."""
    lanes = [0.0] * LANES
    for i, value in enumerate(values.tolist()):
        lanes[i % LANES] += value
    return (lanes[0] + lanes[2]) + (lanes[1] + lanes[3])


@pytest.mark.parametrize('count', range(14))
@pytest.mark.parametrize('start', [0, 3])
def test_a_sum_of_lanes_is_four_sums_side_by_side(start, count):
    values = random_numbers(start + count + 5)
    assert sum_of(values, start, start + count) == added_up(values[start : start + count])


def test_the_order_shows():
    """The test before can fail: one sum after the other has other bits."""
    values = random_numbers(100)
    one_after_the_other = 0.0  # sum() compensates for rounding, from Python 3.12 on
    for value in values.tolist():
        one_after_the_other += value
    assert sum_of(values, 0, 100) == added_up(values) != one_after_the_other


@pytest.mark.parametrize('stop', range(10))
def test_lanes_compute_as_floats_do(stop):
    x, y = random_numbers(2, 3, 9)
    result = np.full((3, 9), np.nan)
    arithmetic(x, y, 0.3, stop, result)
    expected = np.stack([0.3 - x[0] * y[0], y[1] * 0.3 + x[1], (x[2] - y[2]) - (1.0 + x[2])])
    np.testing.assert_array_equal(result[:, :stop], expected[:, :stop])
    assert np.isnan(result[:, stop:]).all()


@pytest.mark.parametrize('count', range(10))
def test_nothing_beyond_the_end_is_written(count):
    x, result = random_numbers(3, 13), np.zeros((3, 14))
    move_columns(x, 2, 2 + count, 1, result)
    expected = np.zeros((3, 14))
    expected[:, 1 : 1 + count] = x[:, 2 : 2 + count]
    np.testing.assert_array_equal(result, expected)


def test_what_is_not_read_may_be_anything():
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0, np.nan, np.inf, np.nan])
    assert sum_of(values, 0, 5) == 15.0


@pytest.mark.parametrize('count', [1, 4, 7, 42])
@pytest.mark.parametrize('block', range(3))
def test_the_moments_of_a_tile_have_the_bits_of_floats_added_in_that_order(block, count):
    start, rest = 5, 2
    x, q = random_numbers(3, count), random_numbers(3, start + rest + count)
    weights, result = random_numbers(start + rest + count), np.empty((3, 3))
    moments_of(x, start, start + count, rest, weights, q, block, result)
    q, weights = q[:, start + rest :], weights[start + rest :]
    features = [q, q * q, q * q[[1, 2, 0]]][block]
    expected = [[added_up(f * (weights * row)) for row in x] for f in features]
    assert result.tolist() == expected
