# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Going back in time: the same bits at the same ticks, with what had happened until then."""

import dataclasses
import random

from core_helpers import bytes_of
import numpy as np
import pytest
import trimesh

from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    ObstacleRemoval,
    ObstacleUpdate,
    World,
    WorldConfig,
)
from softbody_ros.timeline.history import INTERVAL, LEAST_ACTION_BYTES, MOST_ACTIONS, History
from softbody_ros.timeline.stepper import MEBIBYTE, SLICE, Stepper

START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
SECONDS = 3
DENSE = round(INTERVAL * 240)


def ball(name='ball', **values):
    return BodyConfig(**{'name': name, 'subdivisions': 1, 'position': (0.0, 0.0, 0.8)} | values)


EVERYTHING = WorldConfig(
    bodies=(
        ball('linear', mode='linear'),
        # these two meet
        ball('quadratic', bounciness=0.9, position=(0.9, 0.0, 1.2)),
        ball(
            'rigid',
            mode='rigid',
            initial_velocity_angular=(1.0, 2.0, 3.0),
            position=(-3.0, 0.0, 0.8),
        ),
        ball('regions', subdivisions=2, regions_count=8, position=(-3.0, 3.0, 0.8)),
        ball('dented', plasticity_creep=20.0, plasticity_yield=0.03, position=(6.0, -3.0, 0.8)),
        ball(
            'pinned',
            pins_indices=(0, 1),
            pins_velocity_linear=(0.1, 0.0, 0.0),
            position=(-6.0, 0.0, 0.8),
        ),
        ball('sleeper', stiffness=1.0, bounciness=0.0, position=(9.0, 0.0, 0.5)),
        ball('box', mesh='box', position=(0.0, 5.0, 1.0), friction_model='viscous'),
    ),
    obstacles=(
        ObstacleConfig(name='ground'),
        ObstacleConfig(name='slope', orientation=(0.0, 0.1, 0.0, 0.995), position=(2.0, 0.0, 0.0)),
    ),
)


class Watch:
    """Time that passes only when told."""

    def __init__(self, per_look=0.0):
        self.seconds, self.per_look = 0.0, per_look

    def __call__(self):
        self.seconds += self.per_look
        return self.seconds


def stepper_of(config=None, memory=1024.0, per_look=0.0):
    world = World(config or WorldConfig(bodies=(ball(),)))
    stepper = Stepper(world, {'points': 60.0}, Watch(per_look))
    stepper.history.memory = memory * MEBIBYTE
    list(stepper.advance(START, drop_overload=False))
    return stepper


def go_to(stepper, seconds):
    """Let the clock show a time, backwards or forwards, and wait for the world."""
    now = START + round(seconds * SECOND)
    stepper.rewind(now)
    shown = []
    for _ in range(100_000):
        shown += [(stepper.world.tick, due) for due in stepper.advance(now, drop_overload=False)]
        if stepper.lag(now) < stepper.world.config.time_step and not stepper.replaying:
            return shown
    raise AssertionError('the world does not arrive')


def state(stepper):
    world = stepper.world
    strains = [world.permanent_strain(name) for name in world.names]
    asleep = [world.is_asleep(name) for name in world.names]
    obstacles = [item.position.tobytes() + item.rotation.tobytes() for item in world.obstacles]
    return bytes_of(world), strains, asleep, obstacles


@pytest.fixture(scope='module')
def states():
    """Return the state at each tick of a world that is simulated straight through."""
    stepper, log = stepper_of(EVERYTHING), []
    for _ in range(SECONDS * 240 + 1):
        log.append(state(stepper))
        stepper.world.step()
    assert any(asleep for _, _, asleep, _ in log for asleep in asleep)
    assert max(max(strains) for _, strains, _, _ in log) > 0.0
    return log


def test_moving_obstacles_go_back_too():
    turning = ObstacleConfig(
        name='table', type='box', position=(0.0, 0.0, -0.2), velocity_angular=(0.0, 0.0, 2.0),
        velocity_linear=(0.0, 0.1, 0.05),
    )  # fmt: skip
    stepper = stepper_of(WorldConfig(bodies=(ball(),), obstacles=(turning,)))
    log = {}
    for tick in (100, 333, 480):
        go_to(stepper, tick / 240)
        log[tick] = state(stepper)
    for tick in (333, 100, 480):
        go_to(stepper, tick / 240)
        assert state(stepper) == log[tick]


@pytest.mark.parametrize('memory', [1024.0, 1.0, 0.0])
def test_every_tick_has_the_same_bits_however_the_clock_gets_there(states, memory):
    stepper = stepper_of(EVERYTHING, memory)
    random = np.random.default_rng(1)
    for _ in range(10 if memory else 3):
        go_to(stepper, random.uniform(0, SECONDS))
        assert state(stepper) == states[stepper.world.tick], stepper.world.tick


def test_a_jump_back_costs_at_most_one_interval_while_the_past_is_dense():
    stepper = stepper_of()
    go_to(stepper, 6.0)
    for seconds in (5.9, 5.26, 3.1, 3.0, 0.2):
        stepper.rewind(START + round(seconds * SECOND))
        target = int(seconds * 240 + 1e-6)
        assert target - DENSE < stepper.world.tick <= target
        go_to(stepper, seconds)


def test_memory_stays_in_its_bounds_and_the_past_thins_out_with_age():
    stepper = stepper_of(memory=0.1)
    go_to(stepper, 60.0)
    history = stepper.history
    assert history.nbytes <= 0.1 * MEBIBYTE
    ticks = np.array(history.ticks)
    assert ticks[0] == 0
    gaps = np.diff(ticks)
    assert gaps[-1] == DENSE
    assert gaps[: len(gaps) // 2].mean() > 3 * gaps[len(gaps) // 2 :].mean()
    go_to(stepper, 30.0)
    assert stepper.history.ticks[-1] <= 30 * 240


def test_without_memory_only_the_beginning_is_kept():
    stepper = stepper_of(memory=0.0)
    go_to(stepper, 2.0)
    assert stepper.history.ticks == [0]


def test_only_the_state_that_is_arrived_at_is_shown():
    stepper = stepper_of()
    go_to(stepper, 2.0)
    assert go_to(stepper, 1.1) == [(264, {'points'})]


def test_a_long_way_back_is_gone_in_slices_that_show_progress():
    stepper = stepper_of(memory=0.0, per_look=SLICE / 30)
    go_to(stepper, 3.0)
    shown = [tick for tick, _ in go_to(stepper, 2.0)]
    assert shown == sorted(shown)
    assert len(shown) > 4
    assert shown[-1] == 480


# -------------------------------------------------------------------------- what acts on the world
def softened(world):
    body = dataclasses.replace(world.config.bodies[0], stiffness=0.1)
    return dataclasses.replace(world.config, bodies=(body,))


def pushed(**velocity):
    return WorldConfig(bodies=(ball(**velocity),))


def test_what_had_happened_until_then_happens_again():
    stepper = stepper_of(pushed(initial_velocity_linear=(0.3, 0.0, 1.0)))
    log = {}
    for seconds, act in (
        (0.5, lambda: stepper.configure(softened(stepper.world))),
        (0.55, lambda: stepper.act(World.apply_initial_velocity)),
        (0.6, lambda: None),
        (1.2, lambda: None),
    ):
        go_to(stepper, seconds)
        log[seconds] = state(stepper)
        act()
    for seconds in (0.6, 1.2, 0.55, 0.5):
        if seconds == 1.2:  # nothing has acted between
            go_to(stepper, seconds)
            assert state(stepper) == log[seconds]
    for seconds in (1.2, 0.6, 0.55, 0.5):
        go_to(stepper, seconds)
        assert state(stepper) == log[seconds], seconds


def test_what_had_happened_later_is_undone_but_present_parameters_hold():
    stepper = stepper_of(pushed(initial_velocity_linear=(0.0, 0.0, 2.0)))
    go_to(stepper, 1.0)
    stepper.act(World.apply_initial_velocity)
    stepper.configure(softened(stepper.world))
    go_to(stepper, 0.4)
    assert stepper.world.config.bodies[0].stiffness == 0.1

    fresh = World(pushed(initial_velocity_linear=(0.0, 0.0, 2.0)))
    fresh.step(96)
    assert bytes_of(stepper.world) == bytes_of(fresh)
    fresh.configure(softened(fresh))
    fresh.step(240)
    go_to(stepper, 1.4)
    assert bytes_of(stepper.world) == bytes_of(fresh)


def test_what_is_asked_for_on_the_way_back_waits_for_the_arrival():
    stepper = stepper_of(pushed(initial_velocity_linear=(0.0, 0.0, 3.0)), 0.0, SLICE / 10)
    go_to(stepper, 1.0)
    now = START + SECOND // 2
    stepper.rewind(now)
    list(stepper.advance(now, drop_overload=False))
    assert stepper.replaying
    stepper.configure(softened(stepper.world))
    stepper.act(World.apply_initial_velocity)
    assert stepper.world.config.bodies[0].stiffness == 0.5
    go_to(stepper, 0.5)

    fresh = World(pushed(initial_velocity_linear=(0.0, 0.0, 3.0)))
    fresh.step(120)
    fresh.configure(softened(fresh))
    fresh.apply_initial_velocity()
    assert bytes_of(stepper.world) == bytes_of(fresh)


# ------------------------------------------------------------------------- what comes and goes
CUBE = ball('cube', mesh='box', subdivisions=0, position=(3.0, 0.0, 0.6), regions_count=2)
POST = ObstacleConfig(name='post', type='box', position=(0.3, 0.0, 0.1), size=(0.2, 0.2, 0.2))


def with_items(stepper, *items, without=()):
    """Let a stepper use a config with other bodies and obstacles."""
    config = stepper.config
    kept = [item for item in config.items if item.name not in without]
    chosen = [*kept, *items]
    bodies = tuple(item for item in chosen if isinstance(item, BodyConfig))
    obstacles = tuple(item for item in chosen if isinstance(item, ObstacleConfig))
    stepper.configure(dataclasses.replace(config, bodies=bodies, obstacles=obstacles))


def named(stepper):
    world = stepper.world
    assert [item.name for item in world.config.items] == [
        *world.names, *(item.config.name for item in world.obstacles)
    ]  # fmt: skip
    return [item.name for item in world.config.items], state(stepper)


@pytest.mark.parametrize('memory', [1024.0, 0.0])
def test_what_is_added_is_gone_before_that_and_what_is_removed_is_there(memory):
    stepper = stepper_of(memory=memory)
    log = {}

    def through(*times):
        for seconds in times:
            go_to(stepper, seconds)
            log[seconds] = named(stepper)

    through(0.1, 0.3)
    with_items(stepper, CUBE)
    through(0.4, 0.6)
    with_items(stepper, POST, without=['ball'])
    through(0.7, 1.0)
    with_items(stepper, ball('ball', mode='rigid', position=(-3.0, 0.0, 1.0)), without=['cube'])
    through(1.1, 1.5)
    assert log[1.0][0] == ['cube', 'ground', 'post']
    assert log[1.1][0] == ['ball', 'ground', 'post']
    for seconds in (1.1, 0.7, 0.6, 0.4, 0.3, 0.1):
        go_to(stepper, seconds)
        assert named(stepper) == log[seconds], seconds
        assert stepper.config == stepper.world.config
    # what was done later is undone, for ever
    go_to(stepper, 1.5)
    assert named(stepper)[0] == ['ball', 'ground']


def test_the_config_is_that_of_the_arrival_as_soon_as_the_clock_goes_back():
    stepper = stepper_of(memory=0.0, per_look=SLICE)
    go_to(stepper, 0.4)
    with_items(stepper, CUBE)
    go_to(stepper, 0.6)
    with_items(stepper, POST)
    go_to(stepper, 0.8)
    stepper.rewind(START + round(0.5 * SECOND))
    assert stepper.replaying
    assert [item.name for item in stepper.config.items] == ['ball', 'cube', 'ground']
    assert [item.name for item in stepper.world.config.items] == ['ball', 'ground']
    stepper.rewind(START + round(0.3 * SECOND))
    assert [item.name for item in stepper.config.items] == ['ball', 'ground']


def test_what_comes_and_goes_on_the_way_back_waits_for_the_arrival():
    stepper = stepper_of(memory=0.0, per_look=SLICE)
    go_to(stepper, 0.5)
    log = named(stepper)
    go_to(stepper, 0.8)
    stepper.rewind(START + round(0.5 * SECOND))
    with_items(stepper, CUBE)
    with_items(stepper, POST, without=['ball'])
    softer = dataclasses.replace(CUBE, stiffness=0.125)
    with_items(stepper, softer, without=['cube'])
    stepper.act(lambda world: world.apply_wrench('cube', (9.0, 0.0, 0.0), (0.0,) * 3, 1.0))
    stepper.act(lambda world: world.apply_wrench('ball', (9.0, 0.0, 0.0), (0.0,) * 3, 1.0))
    assert stepper.replaying
    assert named(stepper)[0] == ['ball', 'ground']
    go_to(stepper, 0.5)
    assert named(stepper)[0] == ['cube', 'ground', 'post']
    assert stepper.config == stepper.world.config
    assert stepper.world.body_config('cube') == softer
    assert list(stepper.world.external_inputs.wrenches) == ['cube']
    centre = stepper.world.positions('cube').mean(axis=0)
    np.testing.assert_allclose(centre, CUBE.position, atol=1e-12)
    # and it is part of the past from then on
    go_to(stepper, 0.7)
    there = named(stepper)
    go_to(stepper, 0.6)
    go_to(stepper, 0.7)
    assert named(stepper) == there
    stepper.rewind(START + round(0.5 * SECOND) - 1)
    go_to(stepper, 0.5 - 1e-9)
    assert named(stepper)[0] == log[0]


@pytest.mark.parametrize('is_file', [False, True])
def test_parameters_that_do_not_fit_what_comes_on_the_way_back_do_no_harm(tmp_path, is_file):
    file = tmp_path / 'cube.stl'
    trimesh.creation.box().export(file)
    cube = dataclasses.replace(CUBE, mesh=str(file)) if is_file else CUBE
    stepper = stepper_of(memory=0.0, per_look=SLICE)
    go_to(stepper, 0.3)
    with_items(stepper, cube)
    go_to(stepper, 0.8)
    stepper.rewind(START + round(0.5 * SECOND))
    assert stepper.world.names == ('ball',)
    wrong = dataclasses.replace(cube, pins_indices=(8,))
    if is_file:  # it cannot be known any more what is in it
        file.unlink()
        with_items(stepper, wrong, without=['cube'])
    else:
        with pytest.raises(ConfigError, match='the vertices 0 to 7'):
            with_items(stepper, wrong, without=['cube'])
    go_to(stepper, 0.5)
    assert stepper.config == stepper.world.config
    assert stepper.world.body_config('cube') == cube
    go_to(stepper, 0.6)


def test_what_is_added_on_the_way_back_is_gone_further_back():
    stepper = stepper_of(memory=0.0, per_look=SLICE)
    go_to(stepper, 0.8)
    stepper.rewind(START + round(0.5 * SECOND))
    with_items(stepper, CUBE, without=['ball'])
    assert stepper.replaying
    stepper.rewind(START + round(0.4 * SECOND))
    assert [item.name for item in stepper.config.items] == ['ball', 'ground']
    go_to(stepper, 0.6)
    assert named(stepper)[0] == ['ball', 'ground']


def test_a_reset_on_the_way_back_has_what_was_asked_for():
    stepper = stepper_of(memory=0.0, per_look=SLICE)
    go_to(stepper, 0.3)
    with_items(stepper, CUBE)
    go_to(stepper, 0.8)
    stepper.rewind(START + round(0.5 * SECOND))
    with_items(stepper, POST)
    assert stepper.replaying
    stepper.reset(START + SECOND)
    assert named(stepper)[0] == ['ball', 'cube', 'ground', 'post']
    assert stepper.config == stepper.world.config
    assert stepper.world.tick == 0


def test_forgotten_additions_do_no_harm():
    """Actions about bodies that are not there any more are left out."""
    stepper = stepper_of(memory=0.0)
    go_to(stepper, 0.2)
    with_items(stepper, CUBE)
    stepper.act(lambda world: world.apply_wrench('cube', (9.0, 0.0, 0.0), (0.0,) * 3, 9.0))
    go_to(stepper, 0.4)
    stepper.history._actions.popleft()
    go_to(stepper, 0.3)
    assert named(stepper)[0] == ['ball', 'ground']
    assert stepper.config == stepper.world.config


ITEMS = (
    ball('a', position=(0.0, 0.0, 0.6)),
    ball('b', mode='rigid', position=(0.7, 0.0, 0.9)),
    ball('c', mesh='box', subdivisions=0, position=(0.2, 0.3, 1.6), regions_count=2),
    ball('d', position=(2.0, 0.0, 0.5), plasticity_creep=20.0, plasticity_yield=0.03),
    ball('e', pins_indices=(0, 1), position=(-2.0, 0.0, 1.0)),
    ObstacleConfig(name='ground'),
    POST,
    ObstacleConfig(
        name='bar', type='capsule', position=(0.0, 0.0, 0.2), size=(0.1, 0.1, 0.5),
        velocity_linear=(0.1, 0.0, 0.0),
    ),
    ObstacleConfig(
        name='torus', type='mesh', mesh='torus', position=(0.0, 1.0, 0.2), size=(0.3, 0.3, 0.3)
    ),
)  # fmt: skip


@pytest.mark.parametrize(
    'seed', [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 20))]
)
def test_whatever_comes_and_goes_the_past_is_what_it_was(seed):
    """Additions, removals and jumps at random, also on the way back: the bits of a fresh world."""
    choose = random.Random(seed)
    begin = WorldConfig(bodies=ITEMS[:1], obstacles=ITEMS[5:6])
    memory, per_look = choose.choice([1024.0, 1.0, 0.0]), choose.choice([0.0, SLICE / 3.0])
    stepper = stepper_of(begin, memory, per_look)
    changes, now = [], 0
    for _ in range(20):
        kind = choose.random()
        if kind < 0.45:
            some = [item for item in ITEMS if choose.random() < 0.5]
            with_items(stepper, *choose.sample(some, len(some)), without=[i.name for i in ITEMS])
            tick = stepper._replay_end if stepper.replaying else stepper.world.tick
            changes.append((tick, stepper.config))
        elif kind < 0.8:
            now += choose.randint(1, 80)
            go_to(stepper, now / 240)
        else:
            before = max(stepper.world.tick, stepper._replay_end)
            now = max(now - choose.randint(1, 150), 0)
            if now < before:
                changes = [change for change in changes if change[0] < now]
            arrive = go_to if choose.random() < 0.5 else set_off
            arrive(stepper, now / 240)
        if not stepper.replaying:
            fresh = World(begin)
            for tick, config in changes:
                fresh.step(tick - fresh.tick)
                fresh.adopt(fresh.prepare(config))
            fresh.step(stepper.world.tick - fresh.tick)
            assert fresh.config == stepper.world.config == stepper.config
            assert bytes_of(fresh) == bytes_of(stepper.world)


def set_off(stepper, seconds):
    stepper.rewind(START + round(seconds * SECOND))


def test_parameters_that_change_often_share_the_memory_of_the_others():
    stepper = stepper_of(EVERYTHING)
    for index in range(100):
        bodies = [dataclasses.replace(each) for each in stepper.config.bodies]
        bodies[2] = dataclasses.replace(bodies[2], stiffness=0.5 + 0.001 * index)
        before = stepper.config.bodies
        stepper.configure(dataclasses.replace(stepper.config, bodies=tuple(bodies)))
        shared = [now is old for now, old in zip(stepper.config.bodies, before, strict=True)]
        assert (shared.count(False) <= 1 and not shared[2]) or index == 0
    assert 100_000 < stepper.history.nbytes - stepper.history.beginning.snapshot.nbytes < 300_000


def test_rest_shapes_count_once_in_the_memory_of_the_history():
    stepper = stepper_of()
    large = ball('large', subdivisions=5, position=(9.0, 0.0, 2.0))
    begin = stepper.history.nbytes
    with_items(stepper, large)
    first = stepper.history.nbytes - begin
    assert first > 1_000_000
    for _ in range(10):
        with_items(stepper, without=['large'])
        with_items(stepper, large)
    assert stepper.history.nbytes - begin < 1.1 * first


def test_two_jumps_in_a_row_lead_to_the_last_one(states):
    stepper = stepper_of(EVERYTHING, 0.0, SLICE / 10)
    go_to(stepper, 1.0)
    for seconds in (0.8, 0.3):
        now = START + round(seconds * SECOND)
        stepper.rewind(now)
        list(stepper.advance(now, drop_overload=False))
    assert stepper.replaying
    go_to(stepper, 0.3)
    assert state(stepper) == states[72]


def test_a_reset_is_a_new_beginning():
    stepper = stepper_of()
    go_to(stepper, 1.0)
    stepper.configure(softened(stepper.world))
    stepper.reset(START + SECOND)
    assert stepper.history.ticks == [0]
    fresh = World(softened(stepper.world))
    assert bytes_of(stepper.world) == bytes_of(fresh)
    go_to(stepper, 2.0)
    go_to(stepper, 0.5)  # before the new beginning
    assert bytes_of(stepper.world) == bytes_of(fresh)
    fresh.step(120)
    go_to(stepper, 1.5)
    assert bytes_of(stepper.world) == bytes_of(fresh)


def test_a_reset_on_the_way_back_ends_the_way():
    stepper = stepper_of(memory=0.0, per_look=SLICE / 10)
    go_to(stepper, 1.0)
    now = START + SECOND // 2
    stepper.rewind(now)
    list(stepper.advance(now, drop_overload=False))
    stepper.reset(now)
    assert (stepper.world.tick, stepper.replaying) == (0, False)


# ------------------------------------------------------------------------------ the time of a tick
def test_a_pause_is_part_of_the_past():
    stepper = stepper_of()
    go_to(stepper, 1.0)
    stepper.pause(True, START + SECOND)
    stepper.pause(False, START + 3 * SECOND)
    go_to(stepper, 4.0)
    assert stepper.world.tick == 480
    for seconds, tick in ((3.5, 360), (2.0, 240), (0.5, 120)):
        go_to(stepper, seconds)
        assert stepper.world.tick == tick


def test_another_speed_is_part_of_the_past():
    stepper = stepper_of()
    go_to(stepper, 1.0)
    stepper.set_time_scale(0.5, START + SECOND)
    go_to(stepper, 3.0)
    assert stepper.world.tick == 480
    for seconds, tick in ((2.0, 360), (0.5, 120)):
        go_to(stepper, seconds)
        assert stepper.world.tick == tick
    go_to(stepper, 1.5)  # the present speed holds from the jump on
    assert stepper.world.tick == 240


def test_while_paused_a_clock_that_goes_back_moves_nothing():
    stepper = stepper_of()
    go_to(stepper, 1.0)
    stepper.pause(True, START + SECOND)
    before = state(stepper)
    now = START + SECOND // 2
    stepper.rewind(now)
    assert list(stepper.advance(now, drop_overload=False))
    assert state(stepper) == before
    stepper.pause(False, now)
    go_to(stepper, 0.75)
    assert stepper.world.tick == 300


def test_too_many_actions_forget_the_oldest():
    world = World(WorldConfig(bodies=(ball(),)))
    history = History(world, MEBIBYTE)
    for tick in range(MOST_ACTIONS + 10):
        history.log(tick, lambda world: None)
    assert len(history.rewind(world, MOST_ACTIONS + 10)) == MOST_ACTIONS


def test_large_actions_are_forgotten_before_the_memory_is_full():
    world = World(WorldConfig(bodies=(ball(),)))
    history = History(world, 40 * MEBIBYTE)
    for tick in range(1000):
        history.log(tick, lambda world: None, 2**20)
    assert len(history.rewind(world, 1000)) == 20
    assert history.nbytes < 21 * MEBIBYTE
    history.rewind(world, 990)
    assert history.nbytes < 11 * MEBIBYTE
    history.begin(world)
    assert history.nbytes < MEBIBYTE


def with_pins(stepper, random):
    body = stepper.config.bodies[0]
    count = stepper.world.rest_shape(body.name).surface_count
    pins = random.permutation(count)[: count // 2]
    other = dataclasses.replace(body, pins_indices=pins)
    stepper.configure(dataclasses.replace(stepper.config, bodies=(other,)))
    return pins


def test_long_lists_of_parameters_count_in_the_memory():
    random = np.random.default_rng(1)
    stepper = stepper_of(WorldConfig(bodies=(ball(subdivisions=3),)), memory=0.0)
    for _ in range(750):
        pins = with_pins(stepper, random)
    config = stepper.config.bodies[0]
    assert config.pins_indices == tuple(pins)
    kept = stepper.history.rewind(stepper.world, 10)
    each = 36 * len(pins)  # bytes of integers in a tuple
    assert 100 < len(kept) < LEAST_ACTION_BYTES / each < 750
    doubled = dataclasses.replace(config, pins_indices=(*pins, *pins, -1))
    assert doubled == config  # each once


def test_pins_count_in_the_memory_of_the_snapshots_that_have_them():
    random = np.random.default_rng(1)
    stepper = stepper_of(WorldConfig(bodies=(ball(subdivisions=3),)), memory=2.0)
    for tick in range(60, 60 * 200, 60):
        with_pins(stepper, random)
        go_to(stepper, tick / 240)
    snapshots = [checkpoint.snapshot for checkpoint in stepper.history._checkpoints]
    pins = {id(snapshot.bodies[0].pins) for snapshot in snapshots[1:]}
    assert len(pins) == len(snapshots) - 1 > 3
    rest = snapshots[-1].bodies[0].pins.rest
    arrays = [rest.weights, rest.q, rest.areas]
    states = len(snapshots) * snapshots[-1].nbytes
    assert states + len(pins) * sum(array.nbytes for array in arrays) < 2.0 * MEBIBYTE


def test_pins_that_stay_count_once():
    random, stepper = np.random.default_rng(1), stepper_of(memory=1024.0)
    with_pins(stepper, random)
    go_to(stepper, 1.0)
    begin = stepper.history.nbytes
    go_to(stepper, 6.0)
    added = [checkpoint.snapshot for checkpoint in stepper.history._checkpoints[-20:]]
    assert stepper.history.nbytes - begin == sum(snapshot.nbytes for snapshot in added)


def test_small_actions_are_remembered_without_memory():
    world = World(WorldConfig(bodies=(ball(),)))
    history = History(world, 0.0)
    for tick in range(1000):
        history.log(tick, lambda world: None, 1000)
    assert len(history.rewind(world, 1000)) == 1000
    for tick in range(1000, 1100):
        history.log(tick, lambda world: None, 2**20)
    assert history.nbytes - world.snapshot().nbytes <= LEAST_ACTION_BYTES


def test_large_actions_leave_half_of_the_memory_to_snapshots():
    stepper = stepper_of(memory=0.2)
    for tick in range(0, 6000, 60):
        stepper.act(lambda world: None, 2**18)
        go_to(stepper, tick / 240)
    assert len(stepper.history.ticks) > 5
    snapshot = stepper.world.snapshot().nbytes
    assert len(stepper.history.ticks) * snapshot <= 0.1 * MEBIBYTE


def test_what_waits_for_the_end_of_a_way_back_is_bounded():
    stepper = stepper_of(memory=0.0, per_look=SLICE / 10)
    go_to(stepper, 1.0)
    now = START + SECOND // 2
    stepper.rewind(now)
    list(stepper.advance(now, drop_overload=False))
    assert stepper.replaying
    done = []
    with_items(stepper, CUBE)
    for index in range(20):
        stepper.act(lambda world, index=index: done.append(index), 2**20)
    go_to(stepper, 0.5)
    assert done == list(range(13, 20))
    assert stepper.world.names == ('ball', 'cube')  # what is asked for is not forgotten


# ---------------------------------------------------------------------- what others put in the way
def put(key, seconds, x):
    """Return an action that puts a box beside the ball."""
    box = ObstacleConfig(name='marker', type='box', position=(x, 0.0, 0.5), size=(0.2, 0.2, 0.2))
    placement = ObstacleUpdate((key, 0), box, round(seconds * SECOND))
    return lambda world: world.change_obstacles([placement])


def test_what_a_bag_sends_again_has_the_same_velocity():
    stepper = stepper_of()
    go_to(stepper, 0.1)
    stepper.act(put('box', 0.1, 0.7))
    go_to(stepper, 0.2)
    stepper.act(put('box', 0.2, 0.6))
    go_to(stepper, 0.5)
    assert stepper.world.obstacles[1].position[0] == pytest.approx(0.3)
    first = state(stepper)
    go_to(stepper, 0.15)
    assert stepper.world.obstacles[1].position[0] == 0.7
    go_to(stepper, 0.2)
    stepper.act(put('box', 0.2, 0.6))
    go_to(stepper, 0.5)
    assert state(stepper) == first


def test_obstacles_are_where_they_were_then():
    stepper, log = stepper_of(), {}
    for tick, action in {
        50: put('one', 0.0, 2.0),
        100: put('two', 0.0, 3.0),
        150: put('one', 0.0, 4.0),
        200: lambda world: world.change_obstacles([ObstacleRemoval('two', 0)]),
    }.items():
        go_to(stepper, tick / 240)
        log[tick] = [list(item.position) for item in stepper.world.obstacles[1:]]
        stepper.act(action)
    assert log == {50: [], 100: [[2, 0, 0.5]], 150: [[2, 0, 0.5], [3, 0, 0.5]],
                   200: [[4, 0, 0.5], [3, 0, 0.5]]}  # fmt: skip
    for tick in (300, 200, 150, 100, 50):
        go_to(stepper, tick / 240)
        assert (
            tick == 300
            or [list(item.position) for item in stepper.world.obstacles[1:]] == log[tick]
        )


def test_a_reset_on_the_way_back_keeps_what_is_in_the_way():
    stepper = stepper_of(memory=0.0, per_look=SLICE / 10)
    go_to(stepper, 0.4)
    stepper.act(put('before', 0.0, 2.0))
    go_to(stepper, 1.0)
    stepper.act(put('undone', 0.0, 2.0))
    now = START + SECOND // 2
    stepper.rewind(now)
    list(stepper.advance(now, drop_overload=False))
    assert stepper.replaying and not stepper.world.external_inputs.dynamic_obstacles
    stepper.act(put('meanwhile', 0.0, 2.0))
    stepper.reset(now)
    assert list(stepper.world.external_inputs.dynamic_obstacles) == [
        ('before', 0),
        ('meanwhile', 0),
    ]
    assert stepper.world.tick == 0
