# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The broad phase, against comparing everything with everything."""

import itertools

import numpy as np
import pytest

from softbody_ros.core.geometry.bounding_boxes import FEW, bounds, overlapping


def random_boxes(kind, count):
    """Return corners (N, 3) of boxes, many of them equal or flush with others."""
    random = np.random.default_rng(count)
    middle = {
        'heap': random.uniform(0.0, count ** (1 / 3), size=(count, 3)),
        'grid': random.integers(0, 4, size=(count, 3)).astype(float),
        'row': random.uniform(0.0, count, size=(count, 1)) * [0.1, 0.2, 1.0],
        'one place': np.zeros((count, 3)),
    }[kind]
    size = random.choice([0.25, 0.5, 0.75], size=(count, 3))
    return middle - size, middle + size


@pytest.mark.parametrize('count', [0, 1, 2, 9, FEW, FEW + 1, 120])
@pytest.mark.parametrize('kind', ['heap', 'grid', 'row', 'one place'])
def test_the_pairs_are_those_that_overlap_in_order(kind, count):
    low, high = random_boxes(kind, count)
    expected = [
        (one, two)
        for one, two in itertools.combinations(range(count), 2)
        if np.all(low[one] < high[two]) and np.all(low[two] < high[one])
    ]
    assert list(zip(*overlapping(low, high), strict=True)) == expected


@pytest.mark.parametrize('shape', [(1, 3, 1), (1, 3, 700), (5, 3, 12)])
def test_bounds_are_least_and_largest_values(shape):
    x = np.random.default_rng(0).normal(size=shape)
    low, high = bounds(x)
    assert np.array_equal(low, x.min(axis=-1))
    assert np.array_equal(high, x.max(axis=-1))
    assert np.array_equal(bounds(x[::-1, :, ::2])[0], x[::-1, :, ::2].min(axis=-1))
