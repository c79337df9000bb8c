# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The broad phase, against comparing everything with everything."""

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from softbody_ros.core import make_surface
from softbody_ros.core.body import BODY
from softbody_ros.core.collision.body_contacts import bound_all
from softbody_ros.core.collision.broad_phase import (
    CANDIDATE,
    NORMALS,
    discard_distant,
    put_extents,
)
from softbody_ros.core.compiled import kernel
from softbody_ros.core.geometry.bounding_boxes import bound_bodies, bounds_of, overlapping
from softbody_ros.core.shape_matching.rest_shape import SHAPE


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


@kernel
def bound(bodies, chosen, shapes, x):
    """Return what `bound_all` does, of the positions being computed in the tick."""
    return bound_all(bodies, chosen, shapes, x)


@pytest.mark.parametrize('ahead', [0, 1])
def test_boxes_around_bodies_are_least_and_largest_values_and_a_margin(ahead):
    bodies = np.zeros(4, BODY)
    bodies['count'] = bodies['surface'] = (1, 2, 7, 700)
    bodies['first'] = np.cumsum(bodies['count']) - bodies['count']
    bodies['now'] = (0, 1, 1, 0)
    x = np.random.default_rng(0).normal(size=(2, 3, bodies['count'].sum()))
    chosen, margin = np.array([0, 2, 3]), np.array([0.0, 0.1, 0.2])
    low, high = np.empty((3, 3)), np.empty((3, 3))
    if ahead:
        bodies['reach'][chosen] = margin
        low, high, _ = bound(bodies, chosen, np.zeros(1, SHAPE), x)
    else:
        bound_bodies(bodies, chosen, x, margin, low, high)
    for place, index in enumerate(chosen):
        body = bodies[index]
        own = x[body['now'] ^ ahead][:, body['first'] :][:, : body['count']]
        assert np.array_equal(low[place], own.min(axis=1) - margin[place])
        assert np.array_equal(high[place], own.max(axis=1) + margin[place])


@kernel
def discard(bodies, chosen, shapes, x, first_point, found, candidates):
    """Discard as `discard_distant` does."""
    return discard_distant(bodies, chosen, shapes, x, first_point, found, candidates)


REACH, TOLERATED, PARTICLES = 0.03, 0.01, 3


def points_near_two_bodies(count):
    """Return bodies, shapes, positions and candidates: particles, then points of either body."""
    random = np.random.default_rng(5)
    ball = make_surface('icosphere', 1.0, 3).vertices.T
    box = make_surface('box', 0.5, 2).vertices.T
    maps = np.eye(3) + 0.3 * random.normal(size=(2, 3, 3))
    stretched = maps[0] @ ball, maps[1] @ box + 3.0
    bodies, shapes = np.zeros(2, BODY), np.zeros(1, SHAPE)
    bodies['surface'] = bodies['count'] = [each.shape[1] for each in stretched]
    bodies['first'], bodies['reach'] = (0, stretched[0].shape[1]), REACH / 2
    shapes['scale'] = 2.0
    x = np.zeros((2, 3, bodies['count'].sum()))
    x[1] = np.concatenate(stretched, axis=1)
    candidates = np.zeros(PARTICLES + 2 * count, CANDIDATE)
    candidates['other'][PARTICLES + count :] = 1
    candidates['reach'], candidates['particle'] = REACH / 2, np.arange(len(candidates))
    candidates['allowance'][::2] = TOLERATED / 2.0
    for each, points in zip(
        (candidates[PARTICLES:][:count], candidates[PARTICLES:][count:]), stretched, strict=True
    ):
        low, high = points.min(axis=1), points.max(axis=1)
        each['point'] = random.uniform(low, high, size=(count, 3))
    candidates['point'][:PARTICLES] = 100.0
    return bodies, shapes, x, candidates, stretched


def test_no_point_near_the_hull_of_a_body_is_discarded_and_few_others_are_left():
    bodies, shapes, x, candidates, stretched = points_near_two_bodies(400)
    everything = candidates.copy()
    found = discard(bodies, np.arange(2), shapes, x, PARTICLES, len(candidates), candidates)
    left = candidates[:found]['particle']
    assert np.array_equal(left[:PARTICLES], np.arange(PARTICLES))  # particles stay
    assert np.array_equal(candidates[:found], everything[left])  # in order
    for number, points in enumerate(stretched):
        planes = ConvexHull(points.T).equations
        own = np.flatnonzero(everything['other'] == number)
        own = own[own >= PARTICLES]
        beyond = (everything['point'][own] @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        beyond += everything['allowance'][own] * shapes['scale'][0]
        assert 50 < np.sum(beyond <= REACH) < 350
        assert np.isin(own[beyond <= REACH], left).all()
        size = np.ptp(points, axis=1).max()
        assert not np.isin(own[beyond > REACH + 0.1 * size], left).any()
        assert np.isin(own[beyond > REACH], left).sum() < 0.2 * np.sum(beyond > REACH)


def test_for_few_points_the_particles_of_a_body_are_not_read():
    bodies, shapes, x, candidates, _ = points_near_two_bodies(1)
    everything, x[:] = candidates.copy(), np.nan
    assert discard(bodies, np.arange(2), shapes, x, PARTICLES, len(candidates), candidates) == len(
        everything
    )
    assert np.array_equal(candidates, everything)


@kernel
def extents(x, chosen, low, high):
    """Bound the particles from one to another as `put_extents` does."""
    put_extents(x, chosen[0], chosen[1], low, high)


@pytest.mark.parametrize('count', [*range(1, 10), 101])
def test_the_polytope_bounds_each_particle_of_a_body_and_no_other(count):
    random, low, high = np.random.default_rng(count), *np.empty((2, NORMALS.shape[1]))
    x = random.normal(size=(3, count + 5))
    x[:, :2] = x[:, 2 + count :] = 100.0
    own = x[:, 2 : 2 + count]
    for place in range(count):
        own[:, place] *= 10.0  # each of them in turn
        extents(x, np.array([2, 2 + count]), low, high)
        heights = NORMALS.T @ own
        np.testing.assert_allclose(low, heights.min(axis=1), rtol=0, atol=1e-13)
        np.testing.assert_allclose(high, heights.max(axis=1), rtol=0, atol=1e-13)


@kernel
def bounds(row, result):
    result[0], result[1] = bounds_of(row)


@pytest.mark.parametrize('count', [*range(1, 20), 100])
def test_bounds_are_the_least_and_the_largest_number(count):
    random, result = np.random.default_rng(count), np.empty(2)
    row = random.normal(size=count)
    for place in range(count):
        # each of them in turn
        row[place] *= 10.0
        bounds(row, result)
        assert tuple(result) == (row.min(), row.max())


def test_what_is_not_a_number_is_no_bound():
    row, result = np.arange(20.0), np.empty(2)
    row[[3, 12, 18]] = np.nan
    bounds(row, result)
    assert tuple(result) == (0.0, 19.0)
