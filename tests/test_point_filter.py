# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Noise of points that a camera sees: what trembles stays, what moves is followed."""

import numpy as np
import pytest

from softbody_ros.core import BodyConfig, PointObstacles, World, WorldConfig
from softbody_ros.core.collision.point_filter import steadied

RADIUS, NOISE = 0.02, 0.002
LOW, HIGH = np.full((1, 3), -0.3), np.full((1, 3), 0.3)


def floor(count=2000, side=1.0, seed=0):
    """Return points (count, 3) of a square at random."""
    plane = side * (np.random.default_rng(seed).random((count, 2)) - 0.5)
    return np.column_stack([plane, np.zeros(count)])


def images(still, count, seed=1):
    """Return what a camera sees of points, with noise."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        yield PointObstacles(still + NOISE * random.standard_normal(still.shape), RADIUS)


def filtered(clouds, before, boxes=(LOW, HIGH)):
    for cloud in clouds:
        before = steadied(cloud, before, NOISE, *boxes)
    return before


def inside(cloud, shrink=0.02):
    return cloud.within(LOW[0] + RADIUS + shrink, HIGH[0] - RADIUS - shrink)


@pytest.mark.parametrize('count', [300, 3000])
def test_points_that_tremble_stay_exactly_where_they_were(count):
    first, *others = images(floor(count), 200)
    cloud, left = first, 0
    for other in others:
        before, cloud = cloud, steadied(other, cloud, NOISE, LOW, HIGH)
        left += not np.array_equal(inside(before), inside(cloud))
    assert left <= 1
    # but those that no body is near to are as they are seen
    assert not np.isin(cloud.points[:, 0], first.points[:, 0]).all()
    assert len(cloud) == pytest.approx(count, rel=0.05)


@pytest.mark.parametrize('shift', [(0.0, 0.0, 0.004), (0.003, 0.0, 0.0), (0.0, 0.0, -0.05)])
def test_what_moves_together_is_followed_at_once(shift):
    still = floor()
    (first,), (second,) = images(still, 1), images(still + shift, 1, seed=7)
    cloud = steadied(second, first, NOISE, LOW, HIGH)
    assert sorted(cloud.points.tolist()) == sorted(second.points.tolist())


def test_a_thing_that_moves_over_a_floor_is_followed():
    ground, things = floor(), 0.05 * np.random.default_rng(5).random((150, 3)) + (0, 0, 0.1)
    (cloud,) = images(np.concatenate([ground, things]), 1)
    for number in range(1, 60):
        moved = things + (0.006 * number - 0.2, 0.0, 0.0)  # 0.2 m/s at 30 Hz
        (seen,) = images(np.concatenate([ground, moved]), 1, seed=number)
        cloud = steadied(seen, cloud, NOISE, LOW, HIGH)
        high = cloud.points[cloud.points[:, 2] > 0.05]
        assert abs(high.mean(axis=0) - moved.mean(axis=0)).max() < 10 * NOISE
        assert 25 < len(high) < 250  # those nearer than 8 times the noise are one


def test_what_is_not_seen_any_more_is_gone_and_what_appears_is_there():
    still = floor()
    (first,) = images(still, 1)
    half = still[still[:, 0] > 0.0]
    (second,) = images(half, 1, seed=3)
    cloud = steadied(second, first, NOISE, LOW, HIGH)
    assert cloud.points[:, 0].min() > -0.017
    cloud = steadied(next(images(still, 1, seed=4)), cloud, NOISE, LOW, HIGH)
    assert (inside(cloud)[:, 0] < -0.05).sum() > 0.9 * (
        (still[:, 0] < -0.05) & (np.abs(still) < 0.26).all(axis=1)
    ).sum()


def test_first_and_last_clouds_and_other_radii_are_taken_as_they_are():
    first, second = images(floor(), 2)
    nothing, other = PointObstacles(np.zeros((0, 3)), RADIUS), PointObstacles(floor(), 0.01)
    nowhere = np.zeros((0, 3)), np.zeros((0, 3))
    assert steadied(first, nothing, NOISE, LOW, HIGH) is first
    assert steadied(nothing, first, NOISE, LOW, HIGH) is nothing
    assert steadied(other, first, NOISE, LOW, HIGH) is other
    assert steadied(second, first, NOISE, *nowhere) is second


@pytest.mark.parametrize('mode', ['rigid', 'linear', 'quadratic'])
def test_a_body_sleeps_on_the_noise_of_a_camera(mode):
    box = BodyConfig(
        name='box', mesh='box', size=0.1, subdivisions=2, mode=mode, position=(0.0, 0.0, 0.125)
    )  # fmt: skip
    world = World(WorldConfig(bodies=(box,), obstacles=()))
    still = floor()
    for cloud in images(still, 150):  # 5 s at 30 Hz
        world.set_points(cloud, 0.5 * RADIUS, NOISE)
        world.step(8)
    assert world.is_asleep('box')
    place = world.positions('box')
    for cloud in images(still, 60, seed=9):
        world.set_points(cloud, 0.5 * RADIUS, NOISE)
        world.step(8)
    assert np.array_equal(world.positions('box'), place)
    # without the filter it is shaken
    for cloud in images(still, 60, seed=9):
        world.set_points(cloud, 0.5 * RADIUS)
        world.step(8)
    assert np.abs(world.positions('box') - place).max() > 1e-4
