# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies fall asleep when they lie still, cost nothing then, and wake for what matters to them."""

import dataclasses

from core_helpers import body, bytes_of, centre, floating
import numpy as np
import pytest

from softbody_ros.core import ObstacleConfig, World, WorldConfig
from softbody_ros.core.shape_matching import dynamics

MODES = ('rigid', 'linear', 'quadratic')


def lying(**values):
    """Return a world whose box has fallen asleep on the ground."""
    config = body('box', position=(0.0, 0.0, 0.52), **values)
    world = World(WorldConfig(bodies=(config,)))
    for _ in range(40):
        world.step(60)
        if world.is_asleep('body'):
            return world
    raise AssertionError('the box does not fall asleep')


@pytest.mark.parametrize('mode', MODES)
def test_a_body_left_alone_falls_asleep_and_does_not_move_any_more(mode):
    world = lying(mode=mode)
    before = bytes_of(world)
    world.step(1000)
    assert bytes_of(world) == before
    assert not world.velocities('body').any()


def test_sleepers_are_not_computed(monkeypatch):
    world = lying()
    computed = []
    original = dynamics.fly
    monkeypatch.setattr(dynamics, 'fly', lambda batch, *rest: computed.append(len(batch.x)))
    world.step(10)
    assert not computed
    monkeypatch.setattr(dynamics, 'fly', original)


def test_a_body_that_is_awake_beside_a_sleeper_moves_as_if_alone():
    high = body('box', name='high', position=(5.0, 0.0, 9.0))
    low = body('box', name='low', position=(0.0, 0.0, 0.52))
    both, alone = (World(WorldConfig(bodies=bodies)) for bodies in ((low, high), (high,)))
    for world in (both, alone):
        world.step(290)
    assert both.is_asleep('low')
    assert not both.is_asleep('high')
    np.testing.assert_allclose(both.positions('high'), alone.positions('high'), atol=1e-12)


def test_nothing_falls_asleep_at_the_top_of_its_flight_or_drifting_slowly():
    drifting = floating(body(initial_velocity_linear=(1e-5, 0.0, 0.0)))
    drifting.step(1000)
    assert centre(drifting)[0] == pytest.approx(1e-5 * 1000 / 120)
    thrown = World(WorldConfig(bodies=(body(initial_velocity_linear=(0.0, 0.0, 9.81)),)))
    thrown.step(240)
    assert not thrown.is_asleep('body')


@pytest.mark.parametrize(
    'change',
    [
        {'gravity_magnitude': 5.0},
        {'gravity_direction': (0.0, 1.0, 0.0)},
        {'obstacles': (ObstacleConfig(position=(0.0, 0.0, -1.0)),)},
        {'bodies': {'stiffness': 0.1}},
        {'bodies': {'thickness': 0.1}},
    ],
)
def test_a_change_that_matters_wakes(change):
    world = lying()
    before = world.positions('body')
    if 'bodies' in change:
        ball = dataclasses.replace(world.config.bodies[0], **change['bodies'])
        change = {'bodies': (ball,)}
    world.configure(dataclasses.replace(world.config, **change))
    assert not world.is_asleep('body')
    world.step(60)
    assert np.abs(world.positions('body') - before).max() > 1e-6


def test_a_change_of_the_start_state_lets_sleep():
    world = lying()
    moved = dataclasses.replace(world.config.bodies[0], position=(1.0, 2.0, 3.0))
    world.configure(dataclasses.replace(world.config, bodies=(moved,)))
    assert world.is_asleep('body')


def test_services_wake():
    world = lying(initial_velocity_linear=(0.0, 0.0, 0.5))
    world.apply_initial_velocity()
    world.step(10)
    assert centre(world)[2] > 0.5
    world = lying()
    world.reset()
    assert not world.is_asleep('body')


def test_a_moving_obstacle_keeps_awake_and_carries_along():
    world = lying(friction=0.5)
    belt = ObstacleConfig(velocity_linear=(0.3, 0.0, 0.0))
    world.configure(dataclasses.replace(world.config, obstacles=(belt,)))
    before = centre(world)[0]
    world.step(480)
    assert centre(world)[0] - before > 0.3


@pytest.mark.parametrize('speed', [0.5, 20.0])
def test_a_moving_obstacle_wakes_only_what_it_comes_to(speed):
    finger = ObstacleConfig(
        name='finger',
        type='sphere',
        size=(0.05,) * 3,
        position=(-0.6 - 3.8 * speed, 0.0, 0.5),
        velocity_linear=(speed, 0.0, 0.0),
    )
    near = body('box', name='near', position=(0.0, 0.0, 0.52))
    far = body('box', name='far', position=(0.0, 9.0, 0.52))
    world = World(
        WorldConfig(bodies=(near, far), obstacles=(ObstacleConfig(name='ground'), finger))
    )
    world.step(round(3.5 * 240))
    assert world.is_asleep('near') and world.is_asleep('far')
    world.step(240)
    assert not world.is_asleep('near')
    assert centre(world, 'near')[0] > 0.05
    assert world.is_asleep('far')


def test_bodies_on_each_other_fall_asleep_together_and_wake_each_other():
    low = body('box', name='low', position=(0.0, 0.0, 0.52), friction=0.5)
    high = body('box', name='high', position=(0.0, 0.0, 1.55), friction=0.5)
    world = World(WorldConfig(bodies=(low, high)))
    slept = []
    for _ in range(200):
        world.step(24)
        slept.append((world.is_asleep('low'), world.is_asleep('high')))
        if slept[-1][1]:
            break
    assert set(slept[:-1]) == {(False, False)} and slept[-1] == (True, True)
    kicked = dataclasses.replace(high, initial_velocity_linear=(0.0, 0.0, 1.0), stiffness=0.4)
    world.configure(dataclasses.replace(world.config, bodies=(low, kicked)))
    world.step()
    assert not world.is_asleep('low') and not world.is_asleep('high')


def test_sleep_is_part_of_a_snapshot():
    world = lying()
    world.step(7)
    asleep = world.snapshot()
    world.apply_initial_velocity()
    world.restore(asleep)
    assert world.is_asleep('body')
    fresh = World(world.config)
    fresh.step(100)
    halfway = fresh.snapshot()
    fresh.step(200)
    expected = bytes_of(fresh)
    fresh.restore(halfway)
    fresh.step(200)
    assert bytes_of(fresh) == expected
