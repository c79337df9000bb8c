# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies whose contacts are as they were: they look for others nearby only, until that changes."""

import sys

from core_helpers import body
import numpy as np
import pytest

from softbody_ros.core import BodyConfig, ObstacleConfig, World, WorldConfig, step
from softbody_ros.core.contact import workspace
from softbody_ros.core.contact.rows import MEMORY

H = 1 / 240
GROUND = ObstacleConfig(name='ground')
FINGER = ObstacleConfig(name='finger', type='box', size=(0.1, 0.1, 0.1), position=(3.0, 0.0, 0.5))


def resting(mode, *obstacles, **values):
    """Return a world with a ball that has come to rest on the ground, awake."""
    ball = body(mode=mode, subdivisions=3, **values)
    world = World(WorldConfig(time_step=H, bodies=(ball,), obstacles=(GROUND, *obstacles)))
    settle(world)
    assert members(world)[0]['steady'].all()
    return world


def settle(world):
    """Let bodies come to rest, but not fall asleep: then they have no contacts."""
    for _ in range(120):
        world._state.still_samples[:] = 0
        world.step(12)


def members(world):
    """Return the bodies in the next tick as contact has them, and the contacts found."""
    world._find_awake()
    environment = world._environment_of(world.obstacles, world._inputs)
    world._integrator.fly(world._awake, environment.gravity, H)
    members, rows, _ = world._integrator.find_rows(world._awake, environment, H)
    return members, rows


@pytest.mark.parametrize('mode', ['linear', 'quadratic'])
def test_a_body_at_rest_finds_little_but_the_contacts_that_carry_it(mode):
    world = resting(mode)
    (ball,), rows = members(world)
    carrying = np.count_nonzero(world.normal_forces('body'))
    assert ball['steady']
    assert ball['margin'] < 0.5 * ball['widest']
    assert 0 < carrying <= len(rows) < 1.5 * carrying


@pytest.mark.parametrize('mode', ['linear', 'quadratic'])
def test_a_body_that_loses_its_contacts_looks_as_far_as_it_may_get(mode):
    world = resting(mode)
    world.move_obstacle('ground', (0.0, 0.0, -0.02))
    (ball,), _ = members(world)
    assert not ball['steady']
    assert ball['margin'] == ball['widest']


@pytest.mark.parametrize('mode', ['linear', 'quadratic'])
def test_a_body_that_is_met_anew_does_so_too(mode):
    world = resting(mode, FINGER)
    top = world.positions('body')[:, 2].max()
    world.move_obstacle('finger', (0.0, 0.0, top + 0.1 - 0.02))  # 2 cm deep, at once
    (ball,), _ = members(world)
    assert not ball['steady']
    assert ball['margin'] == ball['widest']
    world.step(240)
    inside = np.abs(world.positions('body') - (0.0, 0.0, top + 0.08)).max(axis=1) < 0.1 - 1e-6
    assert not inside.any()


def test_of_two_bodies_the_one_at_rest_is_steady_while_the_other_falls():
    still = body(name='still', mode='linear', subdivisions=2)
    other = body(name='other', mode='linear', subdivisions=2, position=(5.0, 0.0, 200.0))
    world = World(WorldConfig(time_step=H, bodies=(still, other), obstacles=(GROUND,)))
    settle(world)
    both, _ = members(world)
    assert both['steady'].tolist() == [True, False]
    assert both[0]['margin'] < both[0]['widest']


def test_a_steady_body_meets_what_comes_fast():
    world = resting('quadratic', FINGER)
    height = float(world.positions('body')[:, 2].mean())
    world.move_obstacle('finger', (1.5, 0.0, height), linear=(-5.0, 0.0, 0.0))
    deepest = []
    for _ in range(120):
        world.step()
        finger = world.obstacles[1]
        apart = np.abs((world.positions('body') - finger.position) @ finger.rotation) - 0.1
        deepest.append(apart.max(axis=1).min())
    assert min(deepest) > -1e-4 * 0.5
    assert min(deepest) < 1e-3  # they have met


def test_memory_for_contacts_is_that_of_the_tick_before():
    world = resting('linear')
    before = world._integrator._workspace
    _, rows = members(world)
    assert np.shares_memory(rows, before.found)
    world._state.still_samples[:] = 0
    world.step(12)
    assert world._integrator._workspace is before


def test_a_tick_is_the_same_however_much_room_there_was_for_its_contacts(monkeypatch):
    find_rows, contacts = step.find_rows, []

    def counted(*arguments):
        found = find_rows(*arguments)
        contacts.append(found[0])
        return found

    monkeypatch.setattr(step, 'find_rows', counted)
    turns = np.random.default_rng(1).normal(size=(4, 4))
    boxes = [
        BodyConfig(
            name=f'box{i}', mesh='box', subdivisions=0, size=0.2,
            orientation=turn / np.linalg.norm(turn), position=(0.05 * i, 0.03 * i, 0.3 + 0.2 * i),
        )
        for i, turn in enumerate(turns)
    ]  # fmt: skip
    config = WorldConfig(time_step=1 / 60, bodies=tuple(boxes), obstacles=(GROUND,))
    world, other = World(config), World(config)
    for _ in range(40):
        world.step()
        # just enough for those that are left: of bodies inside each other some are left out
        monkeypatch.setattr(workspace, 'AT_FIRST', (1, contacts[-1], 0, 0, 0, 0, 1))
        other._integrator._workspace = workspace.new_workspace()
        other.step()
        for name in world.names:
            assert (world.positions(name) == other.positions(name)).all()


def test_kernels_are_given_the_very_dtypes_of_their_records(monkeypatch):
    # equal ones are compared at each call, field by field
    given = []

    def noted(arguments):
        for argument in arguments:
            if isinstance(argument, tuple):
                noted(argument)
            elif isinstance(argument, np.ndarray) and argument.dtype.names:
                given.append(argument.dtype)

    def watch(name):
        kernel = getattr(step, name)

        def watched(*arguments):
            noted(arguments)
            return kernel(*arguments)

        monkeypatch.setattr(step, name, watched)

    for name in ('find_rows', 'resolve', 'accept'):
        watch(name)
    obstacle = ObstacleConfig(name='wall', type='mesh', mesh='box', position=(0.0, 0.0, -0.5))
    other = BodyConfig(name='other', mode='rigid', position=(0.0, 0.0, 2.0))
    world = World(WorldConfig(bodies=(body(), other), obstacles=(obstacle,)))
    world.step(60)
    records = {
        id(value)
        for module in tuple(sys.modules.values())
        if getattr(module, '__name__', '').startswith('softbody_ros.')
        for value in vars(module).values()
        if isinstance(value, np.dtype)
    }
    assert {kind.names for kind in given if id(kind) not in records} <= {MEMORY.names}
