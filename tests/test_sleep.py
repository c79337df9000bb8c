# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies fall asleep when they lie still, cost nothing then, and wake for what matters to them."""

import dataclasses
import itertools

from core_helpers import assert_goes_on_bit_by_bit, body, bytes_of, centre, floating
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import (
    ObstacleConfig,
    ObstacleRemoval,
    ObstacleUpdate,
    PointObstacles,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.shape_matching import modal_flight
from softbody_ros.core.sleeping import BodyBoxes

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
    original = modal_flight.fly
    counted = lambda *of: computed.append(len(of[1])) or original(*of)  # noqa: E731
    monkeypatch.setattr(modal_flight, 'fly', counted)
    world.step(10)
    assert not any(computed)


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
    assert_goes_on_bit_by_bit(fresh, 200)


# ------------------------------------------------------------------------------- waking is local
GROUND = ObstacleConfig(name='ground')
BESIDE = {'a': (-0.705, 0.0, 0.3), 'b': (2.295, 0.0, 0.3), 'c': (5.295, 0.0, 0.3)}
"""Where a post of half extent 0.2 is 5 mm away from each of three boxes, and touches none."""
FAR = (-20.0, 0.0, 0.3)
POST = ObstacleConfig(name='post', type='box', size=(0.2,) * 3, position=BESIDE['a'])


def box(name, x, **values):
    position = (x, 0.0, 0.5)
    return body('box', **{'name': name, 'subdivisions': 0, 'position': position} | values)


def awake(world):
    return ''.join(name for name in world.names if not world.is_asleep(name))


def asleep(*bodies, obstacles=(GROUND, POST), prepare=None):
    """Return a function that returns a world of bodies that have fallen asleep."""
    config = WorldConfig(bodies=bodies, obstacles=obstacles)
    world = World(config)
    if prepare:
        prepare(world)
    for _ in range(60):
        world.step(48)
        if not awake(world):
            break
    assert not awake(world)
    snapshot = world.snapshot()

    def made():
        other = World(config)
        other.restore(snapshot)
        return other

    return made


@pytest.fixture(scope='module')
def three():
    """Return a maker of worlds of three boxes asleep in a row, a post beside the first."""
    return asleep(
        box('a', 0.0, mode='rigid'), box('b', 3.0), box('c', 6.0, mode='linear', pins_indices=(0,))
    )


def guest(position, size=0.2):
    config = ObstacleConfig(name='guest', type='sphere', size=(size,) * 3, position=position)
    return ObstacleUpdate(('arm', 0), config)


def configured(world, name, **values):
    """Give a body or an obstacle other parameters."""

    def changed(parts):
        return tuple(
            dataclasses.replace(each, **values) if each.name == name else each for each in parts
        )

    config = world.config
    world.configure(
        dataclasses.replace(
            config, bodies=changed(config.bodies), obstacles=changed(config.obstacles)
        )
    )


def points_at(*places):
    return PointObstacles(np.array([BESIDE[place] for place in places] + [FAR]), 0.21)


LOCAL = {
    'an obstacle moves from one to another': (
        lambda world: world.move_obstacle('post', BESIDE['c']), 'ac',
    ),
    'an obstacle moves away': (lambda world: world.move_obstacle('post', FAR), 'a'),
    'an obstacle turns': (
        lambda world: world.move_obstacle('post', BESIDE['a'], (0.0, 0.1, 0.0, 1.0)), 'a',
    ),
    'an obstacle is put where it is': (
        lambda world: world.move_obstacle('post', BESIDE['a']), '',
    ),
    'an obstacle begins to move': (
        lambda world: world.move_obstacle('post', BESIDE['a'], linear=(0.0, 1.0, 0.0)), 'a',
    ),
    'an obstacle is configured': (
        lambda world: configured(world, 'post', position=BESIDE['b']), 'ab',
    ),
    'an obstacle grows': (lambda world: configured(world, 'post', size=(0.3, 0.2, 0.2)), 'a'),
    'an obstacle grows far': (
        lambda world: configured(world, 'post', size=(4.0, 0.01, 0.2)), 'ab',
    ),
    'nothing is configured': (lambda world: world.configure(world.config), ''),
    'the ground moves': (lambda world: configured(world, 'ground', position=(0, 0, -1)), 'abc'),
    'an obstacle is added': (
        lambda world: world.add(dataclasses.replace(POST, name='new', position=BESIDE['b'])), 'b',
    ),
    'an obstacle is added far away': (
        lambda world: world.add(dataclasses.replace(POST, name='new', position=FAR)), '',
    ),
    'an obstacle is removed': (lambda world: world.remove('post'), 'a'),
    'the ground is removed': (lambda world: world.remove('ground'), 'abc'),
    'a guest comes': (lambda world: world.change_obstacles([guest(BESIDE['b'])]), 'b'),
    'points come': (lambda world: world.set_points(points_at('b', 'c')), 'bc'),
    'points come far away': (lambda world: world.set_points(points_at()), ''),
    'a body is stiffer': (lambda world: configured(world, 'b', stiffness=0.3), 'b'),
    'a body is thicker': (lambda world: configured(world, 'a', thickness=0.01), 'a'),
    'pins let go': (lambda world: configured(world, 'c', pins_indices=()), 'c'),
    'pins move': (lambda world: world.move_pins('c', (0.0, 0.1, 0.0)), 'c'),
    'pins are not moved': (lambda world: world.move_pins('c', (0.0, 0.0, 0.0)), ''),
    'a body is put': (lambda world: world.set_state('b', world.positions('b')), 'b'),
    'a body is pushed': (
        lambda world: world.apply_wrench('b', (1.0, 0.0, 0.0), (0.0,) * 3, 0.1), 'b',
    ),
    'a body comes': (lambda world: world.add(box('d', 9.0)), 'd'),
    'a body comes near': (lambda world: world.add(box('d', 7.0, position=(7, 0, 0.9))), 'cd'),
    'a body goes': (lambda world: world.remove('b'), ''),
    'gravity changes': (
        lambda world: world.configure(dataclasses.replace(world.config, gravity_magnitude=5.0)),
        'abc',
    ),
}  # fmt: skip


@pytest.mark.parametrize('what', LOCAL)
def test_what_changes_wakes_those_near_it_and_nobody_else(three, what):
    act, expected = LOCAL[what]
    world = three()
    before = {name: world.positions(name) for name in world.names}
    act(world)
    world.step()
    assert awake(world) == expected
    for name in set(world.names) - set(expected):
        assert np.array_equal(world.positions(name), before[name])
        assert not world.velocities(name).any()


@pytest.mark.parametrize(
    ('change', 'expected'),
    [
        ([guest(BESIDE['b'])], ''),
        ([guest(BESIDE['c'])], 'bc'),
        ([guest(FAR)], 'b'),
        ([guest(BESIDE['b'], size=0.19)], 'b'),
        ([ObstacleRemoval()], 'b'),
        ([ObstacleRemoval('leg')], ''),
    ],
)
def test_guests_wake_those_near_where_they_were_and_where_they_are(three, change, expected):
    world = three()
    world.change_obstacles([guest(BESIDE['b'])])
    world.step(480)
    assert not awake(world)
    world.change_obstacles(change)
    world.step()
    assert awake(world) == expected


# --------------------------------------------------------------------------------- many sleepers
UPDATES = {
    'move_obstacle': lambda world, at: world.move_obstacle('post', at, linear=(0.1, 0.0, 0.0)),
    'configure': lambda world, at: configured(world, 'post', position=at),
    'change_obstacles': lambda world, at: world.change_obstacles([guest(at)]),
    'set_points': lambda world, at: world.set_points(PointObstacles(np.array([at]), 0.21)),
    'add and remove': lambda world, at: (
        world.remove('post'), world.add(dataclasses.replace(POST, position=at)),
    ),
}  # fmt: skip


@pytest.fixture(scope='module')
def many():
    """Return a maker of worlds of thirty boxes asleep side by side, and a post far from them."""
    return asleep(
        *(
            box(f'b{i}', 0.0, position=(1.2 * (i % 6), 1.2 * (i // 6), 0.5), friction=0.5)
            for i in range(30)
        ),
        obstacles=(GROUND, dataclasses.replace(POST, position=FAR)),
    )


@pytest.mark.parametrize('how', UPDATES)
def test_what_moves_every_tick_far_from_sleepers_wakes_none_of_them(many, how, monkeypatch):
    world, computed, fly = many(), [], modal_flight.fly
    before = bytes_of(world)
    counted = lambda *of: computed.append(len(of[1])) or fly(*of)  # noqa: E731
    monkeypatch.setattr(modal_flight, 'fly', counted)
    for tick in range(60):
        UPDATES[how](world, (FAR[0], 0.1 * tick, 0.3))
        world.step()
    assert len(world.names) == 30 and not awake(world)
    assert bytes_of(world) == before
    assert not any(computed)
    # and who is near one of them wakes that one
    UPDATES[how](world, (-0.705, 0.0, 0.3))
    world.step()
    assert awake(world) == 'b0'


# ------------------------------------------------------------------------------ what lies on what
TABLE = ObstacleConfig(name='table', type='box', size=(1.0, 1.0, 0.5), position=(0.0, 0.0, 1.0))
GRID = np.stack(np.meshgrid(*[np.linspace(-1.2, 1.2, 13)] * 2, [1.3]), axis=-1).reshape(-1, 3)
SUPPORTS = {
    'removed': ((GROUND, TABLE), None, lambda world: world.remove('table')),
    'moved': (
        (GROUND, TABLE), None, lambda world: world.move_obstacle('table', (0.0, 0.0, -9.0)),
    ),
    'shrunk': (
        (GROUND, TABLE), None, lambda world: configured(world, 'table', size=(1.0, 1.0, 0.3)),
    ),
    'a guest that leaves': (
        (GROUND,),
        lambda world: world.change_obstacles([ObstacleUpdate(('arm', 0), TABLE)]),
        lambda world: world.change_obstacles([ObstacleRemoval()]),
    ),
    'points that vanish': (
        (GROUND,),
        lambda world: world.set_points(PointObstacles(GRID, 0.2)),
        lambda world: world.set_points(PointObstacles(GRID[:0], 0.2)),
    ),
}  # fmt: skip


@pytest.mark.parametrize('how', SUPPORTS)
@pytest.mark.parametrize('mode', MODES)
def test_who_loses_what_it_lies_on_wakes_and_falls(mode, how):
    obstacles, prepare, act = SUPPORTS[how]
    world = asleep(
        box('high', 0.0, position=(0.0, 0.0, 2.01), mode=mode),
        box('low', 5.0, mode=mode),
        obstacles=obstacles,
        prepare=prepare,
    )()
    height = centre(world, 'high')[2]
    act(world)
    assert awake(world) == 'high'
    world.step(30)
    assert height - centre(world, 'high')[2] > 0.05
    assert awake(world) == 'high'


def stack():
    """Return three boxes on each other; those of 8 vertices do not carry each other."""
    values = {'subdivisions': 1, 'friction': 0.5}
    return [box('abc'[i], 0.0, position=(0.0, 0.0, 0.5 + 1.01 * i), **values) for i in range(3)]


def test_an_island_wakes_as_a_whole_when_something_reaches_one_of_it():
    """Three on each other; the post is beside the lowest."""
    made = asleep(*stack(), box('d', 5.0))
    for act, at_once in (
        (lambda world: world.move_obstacle('post', FAR), 'a'),
        (lambda world: configured(world, 'c', friction=0.1), 'c'),
        (
            lambda world: world.add(
                dataclasses.replace(POST, name='new', position=(0, 0.705, 1.5))
            ),
            'b',
        ),
    ):
        world = made()
        act(world)
        assert awake(world) == at_once
        world.step()
        assert awake(world) == 'abc'


def test_who_lay_on_a_body_that_is_removed_falls():
    world = asleep(*stack(), box('d', 5.0))()
    world.remove('a')
    world.step(60)
    assert awake(world) == 'bc'
    assert centre(world, 'b')[2] < 1.4 and centre(world, 'c')[2] < 2.4


def test_the_boxes_that_are_kept_of_sleepers_are_those_that_they_have():
    config = body('box', position=(0.0, 0.0, 0.5))
    others = (dataclasses.replace(config, name='two', position=(3.0, 0.0, 0.5)),)
    world = World(WorldConfig(bodies=(config, *others)))

    def assert_boxes_are_right():
        kept, measured = world._boxes(), BodyBoxes(world._state).measured()
        np.testing.assert_array_equal(kept, measured)

    def slept():
        for _ in range(60):
            world.step(30)
            assert_boxes_are_right()
        assert world.is_asleep('body') and world.is_asleep('two')

    slept()
    saved = world.snapshot()
    changes = [
        lambda: world.set_state('body', world.positions('body') + (0.0, 0.5, 0.2)),
        lambda: world.place('two', np.array([2.0, 0.0, 1.0]), np.eye(3)),
        lambda: world.poke(world.positions('two')[0], 1.0, 0.5),
        lambda: world.restore(saved),
        lambda: world.move_obstacle('ground', (0.0, 0.0, -0.1)),
        lambda: world.add(dataclasses.replace(config, name='new', position=(6.0, 0.0, 0.7))),
        lambda: world.remove('new'),
        world.reset,
    ]
    for change in changes:
        change()
        assert_boxes_are_right()
        slept()


# ------------------------------------------------------------------------- it does not cheat
def balanced(degrees, size, mode):
    """Return a world with a box on an edge, turned by an angle from its balance."""
    turn = Rotation.from_euler('y', 45.0 + degrees, degrees=True)
    corners = turn.apply(size * np.array(list(itertools.product((-1, 1), repeat=3))))
    config = body(
        'box', size=size, mode=mode, natural_frequency=20.0 / size, subdivisions=1,
        position=(0.0, 0.0, -corners[:, 2].min()), orientation=tuple(turn.as_quat()),
    )  # fmt: skip
    return World(WorldConfig(bodies=(config,)))


@pytest.mark.parametrize('mode', ['rigid', 'quadratic'])
@pytest.mark.parametrize(('degrees', 'size'), [(0.05, 0.02), (0.05, 2.0), (0.005, 2.0)])
def test_a_box_that_is_nearly_balanced_on_an_edge_falls_over(degrees, size, mode):
    world = balanced(degrees, size, mode)
    for _ in range(200):
        world.step(24)
        if world.is_asleep('body'):
            break
    assert world.is_asleep('body')
    axes = np.abs(world.rigid_fit('body').rotation)
    assert axes.max(axis=0) == pytest.approx(1.0, abs=1e-3), 'it lies flat'


@pytest.mark.parametrize('friction', [0.9, 0.999, 0.9999])
def test_a_creep_by_viscous_friction_goes_on(friction):
    box = body('box', mode='rigid', size=0.2, position=(0.0, 0.0, 0.2), friction=friction,
               friction_model='viscous')  # fmt: skip
    world = World(WorldConfig(bodies=(box,), gravity_direction=(0.3, 0.0, -1.0)))
    world.step(20 * 240)
    assert not world.is_asleep('body')
    before = centre(world)[0]
    world.step(240)
    assert centre(world)[0] - before > 5e-5


def test_what_sleeps_after_a_restored_snapshot_sleeps_at_the_same_tick():
    world = World(WorldConfig(bodies=(body('box', position=(0.0, 0.0, 0.52)),)))
    world.step(60)
    saved, ticks = world.snapshot(), []
    for _ in range(2):
        world.restore(saved)
        while not world.is_asleep('body'):
            world.step()
        ticks.append(world.tick)
        world.step(300)
    assert ticks[0] == ticks[1]


# ------------------------------------------------------------------- what turns, what is restored
STAND = ObstacleConfig(name='stand', type='box', size=(0.2, 0.2, 0.5), position=(1.0, 0, 0.5))


def swept(angular, sleeps):
    """Return how far a bat that turns about the z axis knocks a ball off its table, m."""
    bat = ObstacleConfig(
        name='bat', type='box', size=(1.0, 0.02, 0.02), position=(0.0, 0.0, 1.045),
        orientation=(0.0, 0.0, np.sin(0.69), np.cos(0.69)),
    )  # fmt: skip
    ball = body('icosphere', size=0.04, mode='rigid', position=(0.99, 0.0, 1.04))
    world = World(WorldConfig(time_step=1 / 60, bodies=(ball,), obstacles=(STAND, bat)))
    world.step(240 if sleeps else 10)
    assert world.is_asleep('body') == sleeps
    before = centre(world)
    world.move_obstacle('bat', bat.position, None, angular=(0.0, 0.0, -angular))
    world.step(10)
    return np.linalg.norm(centre(world) - before)


@pytest.mark.parametrize('angular', [18.0, 20.0])
def test_a_bat_that_turns_hits_who_sleeps_as_who_is_awake(angular):
    awake, asleep = (swept(angular, sleeps) for sleeps in (False, True))
    assert asleep == pytest.approx(awake, rel=0.2)
    assert asleep > 0.1


def test_a_plane_that_turns_wakes_all_it_may_reach():
    ball = body('icosphere', size=0.04, mode='rigid', position=(0.99, 0.0, 1.04))
    ground = ObstacleConfig(name='ground', position=(0.0, 0.0, -1.0))
    world = World(WorldConfig(bodies=(ball,), obstacles=(STAND, ground)))
    world.step(960)
    assert world.is_asleep('body')
    world.move_obstacle('ground', ground.position, None, angular=(0.0, 30.0, 0.0))
    world.step()
    assert not world.is_asleep('body')


def test_what_turns_beside_a_sleeper_and_cannot_reach_it_lets_it_sleep():
    fan = ObstacleConfig(
        name='fan', type='box', size=(0.5, 0.05, 0.05), position=(1.1, 0.0, 0.5),
        velocity_angular=(0.0, 0.0, 30.0),
    )  # fmt: skip
    world = World(
        WorldConfig(
            bodies=(body('box', position=(0.0, 0.0, 0.52)),),
            obstacles=(ObstacleConfig(name='ground'), fan),
        )
    )
    world.step(960)
    assert world.is_asleep('body')


@pytest.mark.parametrize(
    'change',
    [
        {'gravity_direction': (0.0, 1.0, -0.2)},
        {'obstacles': (ObstacleConfig(name='ground', position=(0.0, 0.0, -0.5)),)},
        {'bodies': {'pins_indices': ()}},
    ],
)
def test_what_slept_under_other_parameters_is_awake_when_it_is_restored(change):
    """A snapshot keeps the state; what is present keeps the parameters that it has now."""
    pinned = body('box', position=(0.0, 0.0, 0.502), pins_indices=(0, 1, 2))
    world = World(WorldConfig(bodies=(pinned,)))
    while not world.is_asleep('body'):
        world.step(24)
    saved = world.snapshot()
    world.restore(saved)
    assert world.is_asleep('body')
    if 'bodies' in change:
        change = {'bodies': (dataclasses.replace(pinned, **change['bodies']),)}
    world.configure(dataclasses.replace(world.config, **change))
    world.restore(saved)
    assert not world.is_asleep('body')


def test_what_slept_with_another_start_state_sleeps_when_it_is_restored():
    world = lying()
    saved = world.snapshot()
    moved = dataclasses.replace(world.config.bodies[0], position=(1.0, 2.0, 3.0))
    world.configure(dataclasses.replace(world.config, bodies=(moved,)))
    world.restore(saved)
    assert world.is_asleep('body')


# ------------------------------------------------------------------------------ who is taken away
def bridge():
    """Return a world of a plank asleep on two boxes."""
    piers = [
        body('box', name=name, size=0.2, mode='rigid', friction=0.5, position=(x, 0.0, 0.2))
        for name, x in (('left', -0.5), ('right', 0.5))
    ]
    wide = make_surface('box', 0.05, 1)
    plank = body(
        Surface(wide.vertices * (16.0, 6.0, 1.0), wide.faces), name='plank', mode='rigid',
        friction=0.5, position=(0.0, 0.0, 0.451),
    )  # fmt: skip
    world = World(WorldConfig(bodies=(*piers, plank)))
    for _ in range(40):
        world.step(48)
        if not awake(world):
            return world
    raise AssertionError('the bridge does not fall asleep')


AWAY = {
    'place': lambda world: world.place('left', np.array((0.0, 5.0, 0.2)), np.eye(3)),
    'set_state': lambda world: world.set_state('left', world.positions('left') + (0.0, 5.0, 0.0)),
    'place and remove': lambda world: (
        world.place('left', np.array((0.0, 5.0, 0.2)), np.eye(3)), world.remove('left'),
    ),
}  # fmt: skip


@pytest.mark.parametrize('how', AWAY)
def test_who_lay_on_what_is_put_elsewhere_falls(how):
    world = bridge()
    lowest = world.positions('plank')[:, 2].min()
    AWAY[how](world)
    world.step(120)
    assert world.positions('plank')[:, 2].min() < lowest - 0.1


def test_who_lay_on_what_goes_with_an_obstacle_falls():
    world = bridge()
    crane = ObstacleConfig(name='crane', type='sphere', size=(0.1,) * 3, position=(-0.5, 1.0, 1.0))
    world.add(crane)
    held = dataclasses.replace(
        world.body_config('left'), attach_to='crane', attach_indices=tuple(range(8))
    )
    bodies = (held, *world.config.bodies[1:])
    world.configure(dataclasses.replace(world.config, bodies=bodies))
    for _ in range(40):
        world.step(48)
        if not awake(world):
            break
    assert not awake(world)
    lowest = world.positions('plank')[:, 2].min()
    world.move_obstacle('crane', (-0.5, 9.0, 1.0))
    world.step(120)
    assert world.positions('plank')[:, 2].min() < lowest - 0.1
