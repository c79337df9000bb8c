# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The broad phase, against comparing everything with everything."""

import itertools

import numpy as np
import pytest

from softbody_ros.core.body import BODY
from softbody_ros.core.geometry.bounding_boxes import bound_bodies, overlapping

pytestmark = pytest.mark.oldest


def random_boxes(kind, count):
    """Return corners (N, 3) of boxes, many of them equal or flush with others."""
    random = np.random.default_rng(count)
    middle = {
        'pile': random.uniform(0.0, count ** (1 / 3), size=(count, 3)),
        'grid': random.integers(0, 4, size=(count, 3)).astype(float),
        'row': random.uniform(0.0, count, size=(count, 1)) * [0.1, 0.2, 1.0],
        'one place': np.zeros((count, 3)),
    }[kind]
    size = random.choice([0.25, 0.5, 0.75], size=(count, 3))
    return middle - size, middle + size


@pytest.mark.parametrize('count', [0, 1, 2, 9, 64, 120])
@pytest.mark.parametrize('kind', ['pile', 'grid', 'row', 'one place'])
def test_the_pairs_are_those_that_overlap_in_order(kind, count):
    low, high = random_boxes(kind, count)
    expected = [
        (one, two)
        for one, two in itertools.combinations(range(count), 2)
        if np.all(low[one] < high[two]) and np.all(low[two] < high[one])
    ]
    assert list(zip(*overlapping(low, high), strict=True)) == expected


@pytest.mark.parametrize('ahead', [0, 1])
def test_boxes_around_bodies_are_least_and_largest_values_and_a_margin(ahead):
    bodies = np.zeros(4, BODY)
    bodies['count'] = bodies['surface'] = (1, 2, 7, 700)
    bodies['first'] = np.cumsum(bodies['count']) - bodies['count']
    bodies['now'] = (0, 1, 1, 0)
    x = np.random.default_rng(0).normal(size=(2, 3, bodies['count'].sum()))
    chosen, margin = np.array([0, 2, 3]), np.array([0.0, 0.1, 0.2])
    low, high = np.empty((3, 3)), np.empty((3, 3))
    bound_bodies(bodies, chosen, x, ahead, margin, low, high)
    for place, index in enumerate(chosen):
        body = bodies[index]
        own = x[body['now'] ^ ahead][:, body['first'] :][:, : body['count']]
        assert np.array_equal(low[place], own.min(axis=1) - margin[place])
        assert np.array_equal(high[place], own.max(axis=1) + margin[place])
