# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What changes in a world while it runs: bodies and obstacles come and go, states are written."""

import dataclasses
import gc
import tracemalloc

from core_helpers import assert_goes_on_bit_by_bit, body, centre, momentum, sheared_box, sheet
import numpy as np
import pytest
import trimesh

from softbody_ros.core import (
    ConfigError,
    MeshError,
    ObstacleConfig,
    ObstacleUpdate,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.timeline.history import History
from softbody_ros.timeline.stepper import Stepper

GROUND = ObstacleConfig(name='ground')
SECOND = 1_000_000_000


def ball(name, x=0.0, **values):
    return body(**{'name': name, 'position': (x, 0.0, 0.6)} | values)


def few(**values):
    """Return a world in which a ball, a bag and a rigid box fall, far from each other."""
    bodies = (
        ball('soft', 0.0, plasticity_yield=0.01, plasticity_creep=30.0),
        ball('bag', 4.0, regions_count=5, mode='linear'),
        ball('box', 8.0, mesh='box', mode='rigid', friction_model='viscous'),
    )
    bar = ObstacleConfig(
        name='bar', type='capsule', position=(4.0, 0.0, -0.1), size=(0.2, 0.2, 0.4),
        orientation=(0.0, 0.6, 0.0, 0.8), velocity_linear=(0.1, 0.0, 0.0),
    )  # fmt: skip
    return World(WorldConfig(**{'bodies': bodies, 'obstacles': (GROUND, bar)} | values))


def bits_of(world, *names):
    """Return the whole state of some bodies, by default of all, as something to compare."""
    return {
        name: (
            world.positions(name).tobytes(),
            world.velocities(name).tobytes(),
            world.permanent_strain(name),
            world.is_asleep(name),
            [each.tobytes() for each in world.contact_wrench(name)],
        )
        for name in names or world.names
    }


def everything(world):
    """Return what there is, where, and how it goes on."""
    poses = [(item.position.tobytes(), item.rotation.tobytes()) for item in world.obstacles]
    return world.tick, world.names, world.config, poses, bits_of(world)


ADDED = {
    'ball': ball('new', -6.0),
    'rigid': ball('new', -6.0, mode='rigid'),
    'regions': ball('new', -6.0, regions_count=4),
    'pinned': ball('new', -6.0, pins_indices=(0, 1)),
    'sheet': ball('new', -6.0, mesh=sheet()),
    'large': ball('new', -6.0, subdivisions=3),
    'plane': ObstacleConfig(name='new', position=(0.0, 0.0, -50.0)),
    'mesh': ObstacleConfig(
        name='new', type='mesh', mesh='torus', position=(-9.0, 0.0, 0.0), size=(0.5,) * 3
    ),
    'moving': ObstacleConfig(
        name='new', type='box', position=(-9.0, 0.0, 0.0), velocity_angular=(0.0, 1.0, 0.0)
    ),
}


# ------------------------------------------------------------------------------- adding, removing
@pytest.mark.parametrize('what', ADDED)
def test_what_is_added_far_away_changes_no_bit_of_the_others(what):
    world, other = few(), few()
    for each in (world, other):
        each.step(40)
    world.add(ADDED[what])
    assert bits_of(world, *other.names) == bits_of(other)
    for _ in range(3):
        for each in (world, other):
            each.step(30)
        assert bits_of(world, *other.names) == bits_of(other)


@pytest.mark.parametrize('what', ADDED)
def test_what_is_removed_far_away_and_added_again_changes_no_bit_of_the_others(what):
    world, other = few(), few()
    world.add(ADDED[what])
    for each in (world, other):
        each.step(40)
    world.remove('new')
    assert everything(world) == everything(other)
    for each in (world, other):
        each.step(30)
    assert everything(world) == everything(other)
    world.add(ADDED[what])
    for each in (world, other):
        each.step(30)
    assert bits_of(world, *other.names) == bits_of(other)


def test_a_body_in_the_middle_can_be_removed():
    world, other = few(), few()
    for each in (world, other):
        each.step(40)
    world.remove('bag')
    for each in (world, other):
        each.step(80)
    assert world.names == ('soft', 'box')
    assert bits_of(world) == bits_of(other, 'soft', 'box')
    assert world.permanent_strain('soft') > 0.0


@pytest.mark.parametrize('what', ADDED)
def test_what_is_added_at_the_beginning_has_always_been_there(what):
    config = few().config
    world = few()
    world.add(ADDED[what])
    field = 'bodies' if isinstance(ADDED[what], type(config.bodies[0])) else 'obstacles'
    whole = {field: (*getattr(config, field), ADDED[what])}
    fresh = World(dataclasses.replace(config, **whole))
    for _ in range(2):
        assert everything(world) == everything(fresh)
        for each in (world, fresh):
            each.step(60)
    for each in (world, fresh):
        each.reset()
    assert everything(world) == everything(fresh)


def test_names_and_config_follow():
    world = few()
    world.add(ball('late', -6.0))
    world.add(ObstacleConfig(name='wall', type='box', position=(-9.0, 0.0, 0.0)))
    assert world.names == ('soft', 'bag', 'box', 'late')
    assert world.config.bodies[-1] == world.body_config('late') == ball('late', -6.0)
    assert [item.name for item in world.config.obstacles] == ['ground', 'bar', 'wall']
    assert [item.config.name for item in world.obstacles] == ['ground', 'bar', 'wall']
    world.remove('soft')
    world.remove('ground')
    assert world.names == ('bag', 'box', 'late')
    assert [each.name for each in world.config.bodies] == ['bag', 'box', 'late']
    assert [item.config.name for item in world.obstacles] == ['bar', 'wall']
    with pytest.raises(ConfigError, match='no body'):
        world.positions('soft')
    world.configure(dataclasses.replace(world.config, gravity_magnitude=1.0))


def test_a_body_that_is_added_starts_from_its_start_pose_with_its_velocity():
    world = few()
    world.step(50)
    late = ball('late', -6.0, initial_velocity_linear=(0.0, 1.0, 2.0))
    world.add(late)
    assert world.tick == 50
    assert centre(world, 'late') == pytest.approx(late.position)
    assert momentum(world, 'late') == pytest.approx([0.0, 1.0, 2.0])
    assert not world.is_asleep('late')
    world.step(10)
    fallen = 2.0 * 10 / 240 - 9.81 / 2 * (10 / 240) ** 2
    assert centre(world, 'late')[2] == pytest.approx(late.position[2] + fallen)


def test_bodies_that_are_added_meet_those_that_are_there():
    world = World(WorldConfig(bodies=(ball('low'),)))
    world.step(60)
    world.add(ball('high', position=(0.0, 0.0, 1.9)))
    world.step(120)
    assert centre(world, 'high')[2] - centre(world, 'low')[2] > 0.5
    world.remove('low')
    world.step(480)
    assert centre(world, 'high')[2] < 0.6


def wrong_additions():
    box = make_surface('box', 0.5, 1)
    return [
        (ball('soft'), ConfigError, 'the name soft is used twice'),
        (ball('ground'), ConfigError, 'the name ground is used twice'),
        (ObstacleConfig(name='bag'), ConfigError, 'the name bag is used twice'),
        (ball('new', mesh='/nowhere.stl'), MeshError, r'new\.mesh file /nowhere.stl does not'),
        (ball('new', regions_count=100), ConfigError, r'new\.regions\.count is 100'),
        (ball('new', pins_indices=(100,)), ConfigError, r'new\.pins\.indices has 100'),
        (ball('new', mesh=box, pins_box=(9.0,) * 6), ConfigError, r'new\.pins\.box'),
        (ObstacleConfig(name='new', type='mesh'), ConfigError, r"new\.mesh is ''"),
        (ObstacleConfig(name='new', type='mesh', mesh='/nowhere.stl'), MeshError, r'new\.mesh'),
        (ObstacleConfig(name='new', type='mesh', mesh=sheet()), MeshError, 'is not closed'),
    ]


@pytest.mark.parametrize(('config', 'error', 'sentence'), wrong_additions())
def test_what_cannot_be_added_is_refused_in_a_sentence_without_effect(config, error, sentence):
    world, other = few(), few()
    for each in (world, other):
        each.step(20)
    with pytest.raises(error, match=sentence):
        world.add(config)
    for each in (world, other):
        each.step(30)
    assert everything(world) == everything(other)
    world.add(ADDED['ball'])


@pytest.mark.parametrize(
    ('name', 'sentence'),
    [
        ('sotf', r"no body or obstacle 'sotf': did you mean soft\?"),
        ('grund', r'did you mean ground\?'),
        ('', 'known are soft, bag, box, ground, bar'),
    ],
)
def test_what_is_not_there_cannot_be_removed(name, sentence):
    world, other = few(), few()
    with pytest.raises(ConfigError, match=sentence):
        world.remove(name)
    for each in (world, other):
        each.step(30)
    assert everything(world) == everything(other)


def test_a_world_can_be_empty_and_filled_again():
    world = World(WorldConfig(bodies=(ball('only'),)))
    world.step(20)
    full = world.snapshot()
    world.remove('only')
    world.remove('ground')
    world.step(30)
    assert (world.names, world.obstacles, world.tick) == ((), (), 50)
    assert world.nearest((0.0, 0.0, 0.0)) == ('', np.inf)
    assert world.poke((0.0, 0.0, 0.0), 1.0, 9.0) == ''
    with pytest.raises(ConfigError, match=r"no body 'only': there are none"):
        world.positions('only')
    empty = world.snapshot()
    world.reset()
    world.add(ball('only'))
    world.add(GROUND)
    fresh = World(WorldConfig(bodies=(ball('only'),)))
    for each in (world, fresh):
        each.step(60)
    assert everything(world) == everything(fresh)
    world.restore(empty)
    assert (world.names, world.obstacles, world.tick) == ((), (), 50)
    world.restore(full)
    assert world.names == ('only',)


def test_what_was_applied_to_a_body_that_is_removed_is_gone():
    world = few()
    world.apply_wrench('soft', (100.0, 0.0, 0.0), (0.0, 0.0, 0.0), 9.0)
    world.step()
    assert momentum(world, 'soft')[0] > 0.1
    world.remove('soft')
    world.add(ball('soft'))
    world.step()
    assert momentum(world, 'soft')[0] == pytest.approx(0.0, abs=1e-12)


# -------------------------------------------------------------------------------- another config
def other_config(config, remove=(), add=(), **values):
    """Return a config with other bodies and obstacles, those that stay in reverse order."""
    bodies = [each for each in config.bodies[::-1] if each.name not in remove]
    standing = [each for each in config.obstacles[::-1] if each.name not in remove]
    for item in add:
        (standing if isinstance(item, ObstacleConfig) else bodies).insert(0, item)
    return dataclasses.replace(config, bodies=tuple(bodies), obstacles=tuple(standing), **values)


@pytest.mark.parametrize('what', ADDED)
def test_adopting_a_config_is_to_remove_and_to_add(what):
    world, other = few(), few()
    for each in (world, other):
        each.step(40)
    config = other_config(world.config, ['bag', 'bar'], [ADDED[what]], gravity_magnitude=5.0)
    world.adopt(world.prepare(config))
    other.remove('bag')
    other.remove('bar')
    other.add(ADDED[what])
    other.configure(dataclasses.replace(other.config, gravity_magnitude=5.0))
    for _ in range(3):
        assert everything(world) == everything(other)
        for each in (world, other):
            each.step(30)


def test_adopting_a_config_of_the_same_structure_is_to_configure():
    world, other = few(), few()
    for each in (world, other):
        each.step(40)
    rebuilds = world.rebuilds
    soft = dataclasses.replace(world.config.bodies[0], stiffness=0.9)
    world.adopt(world.prepare(other_config(world.config, ['soft'], [soft])))
    other.configure(dataclasses.replace(other.config, bodies=(soft, *other.config.bodies[1:])))
    for each in (world, other):
        each.step(30)
    assert everything(world) == everything(other)
    assert world.rebuilds == rebuilds


@pytest.mark.parametrize('gone', [['soft', 'box'], ['ground'], ['soft', 'box', 'ground']])
def test_what_is_new_begins_anew_although_something_of_its_name_was_there(gone):
    """Nothing of the old one is remembered, not even the forces that held it."""
    slope = ObstacleConfig(name='ground', orientation=(0.0, 0.05, 0.0, 0.99875))
    bodies = tuple(
        ball(name, x, mesh='box', size=0.3, mode=mode, initial_velocity_linear=(0.0, 0.0, -0.3))
        for name, x, mode in (('soft', 0.0, 'quadratic'), ('box', 2.0, 'rigid'))
    )
    low = [
        dataclasses.replace(each, position=(each.position[0], 0.0, 0.3 - 0.1 * each.position[0]))
        for each in bodies
    ]
    config = WorldConfig(bodies=tuple(low), obstacles=(slope,))
    world, fresh = World(config), World(config)
    world.step(40)
    assert len(world.snapshot().contact_memory)
    for name in gone:
        world.remove(name)
    kept = world.snapshot().contact_memory
    assert not len(kept)
    for name in gone:
        world.add(next(item for item in config.items if item.name == name))
    if gone == ['ground']:
        return
    for each in (world, fresh):
        each.step(100)
    for name in fresh.names:
        assert np.array_equal(world.positions(name), fresh.positions(name)), name


@pytest.mark.parametrize(('config', 'error', 'sentence'), wrong_additions())
def test_preparing_what_cannot_be_added_is_refused_without_effect(config, error, sentence):
    world, other = few(), few()
    with pytest.raises(error, match=sentence):
        world.prepare(other_config(world.config, (), [config]))
    bag = dataclasses.replace(world.config.bodies[1], size=0.6)
    resized = other_config(world.config, ['bag'], [bag])
    with pytest.raises(ConfigError, match=r'bag\.size is 0\.5 and cannot change'):
        world.prepare(resized)
    for each in (world, other):
        each.step(30)
    assert everything(world) == everything(other)


def test_what_is_prepared_can_be_adopted_many_times():
    """An action of a history is repeated, also after its mesh file has changed or gone."""
    world, other = few(), few()
    prepared = world.prepare(other_config(world.config, ['soft'], [ADDED['regions']]))
    without = world.prepare(other_config(prepared.config, ['new']), prepared.config)
    for _ in range(3):
        world.adopt(prepared)
        world.step(20)
        world.adopt(without)
    other.adopt(other.prepare(prepared.config))
    world.reset()
    world.adopt(prepared)
    for each in (world, other):
        each.step(30)
    assert bits_of(world) == bits_of(other)


def test_the_shape_of_a_file_is_that_of_its_last_version(tmp_path):
    file = tmp_path / 'thing.stl'
    trimesh.creation.box().export(file)
    thing = ball('thing', 9.0, mesh=str(file))
    world = few()
    one = world.prepare(other_config(world.config, (), [thing]))
    world.adopt(one)
    before, history = everything(world), world.snapshot()
    world.adopt(world.prepare(few().config))
    again = world.prepare(other_config(world.config, (), [thing]))
    assert again.shapes['thing'][0] is one.shapes['thing'][0]  # loaded once
    trimesh.creation.icosphere(1).export(file)
    world.adopt(world.prepare(other_config(world.config, (), [thing])))
    assert world.rest_shape('thing').particle_count == 42
    world.restore(history)
    assert everything(world) == before
    assert world.rest_shape('thing').particle_count == 8


def test_parameters_of_a_body_can_change_when_its_file_is_gone(tmp_path):
    file = tmp_path / 'thing.stl'
    trimesh.creation.box().export(file)
    thing = ball('thing', 9.0, mesh=str(file))
    stepper = Stepper(few(), {})
    stepper.configure(other_config(stepper.config, (), [thing]))
    file.unlink()
    pinned = dataclasses.replace(thing, pins_indices=(7,))
    stepper.configure(other_config(stepper.config, ['thing'], [pinned]))
    assert stepper.world.body_config('thing') == pinned
    wrong = dataclasses.replace(thing, pins_indices=(8,))
    with pytest.raises(ConfigError, match=r'the vertices 0 to 7'):
        stepper.configure(other_config(stepper.config, ['thing'], [wrong]))


def test_what_comes_and_goes_many_times_leaves_no_bit_and_no_memory_behind():
    world, other = few(), few()
    for each in (world, other):
        each.step(40)
    mesh = dataclasses.replace(ADDED['mesh'], name='mesh')
    configs = [other_config(world.config, (), [ADDED['regions'], mesh]), world.config]

    def cycles(count):
        for _ in range(count):
            for config in configs:
                world.adopt(world.prepare(config))
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before = cycles(10)
        assert cycles(40) - before < 40_000  # less than a BodyConfig for each
    finally:
        tracemalloc.stop()
    for each in (world, other):
        each.step(60)
    assert everything(world) == everything(other)


# ------------------------------------------------------------------------------------ rest shapes
def test_bodies_that_share_a_mesh_share_a_rest_shape():
    surface = sheared_box()
    same = {'mesh': surface, 'regions_count': 3}
    bodies = (
        ball('a', 0.0),
        ball('b', 4.0, mode='rigid', mass=9.0),
        ball('c', 8.0, size=0.4),
        ball('d', 12.0, **same),
    )
    world = World(WorldConfig(bodies=bodies))
    rest = {name: world.rest_shape(name) for name in world.names}
    assert rest['a'] is rest['b']
    assert rest['c'] is not rest['a']
    world.add(ball('e', 16.0, pins_indices=(1,)))
    world.add(ball('f', 20.0, mesh=surface, regions_count=3))
    world.add(ball('g', 24.0, mesh=sheared_box(), regions_count=3))
    assert world.rest_shape('e') is rest['a']
    assert world.rest_shape('f') is rest['d']
    assert world.rest_shape('g') is not rest['d']
    world.step(10)
    world.remove('a')
    world.add(ball('a', 0.0))
    assert world.rest_shape('a') is rest['b']
    assert {name: world.rest_shape(name) for name in 'bcd'} == {name: rest[name] for name in 'bcd'}


def test_snapshots_bring_back_rest_shapes_that_are_shared():
    world = World(WorldConfig(bodies=(ball('a'), ball('b', 4.0))))
    before, rest = world.snapshot(), world.rest_shape('a')
    world.remove('a')
    world.remove('b')
    world.add(ball('c', 8.0))
    assert world.rest_shape('c') is not rest  # nobody had it any more
    world.restore(before)
    world.add(ball('c', 8.0))
    assert world.rest_shape('a') is world.rest_shape('b') is world.rest_shape('c') is rest


# -------------------------------------------------------------------------------------- snapshots
def changes():
    """Return named changes of the structure of `few()`."""
    wall = ObstacleConfig(name='wall', type='box', position=(0.5, 0.0, 0.2), size=(0.2,) * 3)

    def exchange(world):
        for name in ('soft', 'bar'):
            world.remove(name)
        world.add(ball('soft', mesh='box', subdivisions=0, mode='rigid'))
        mesh = {'type': 'mesh', 'mesh': 'icosphere', 'position': (9.0, 0.0, 0.0)}
        world.add(ObstacleConfig(name='bar', **mesh))

    def swap(world):
        for name in ('soft', 'bar'):
            world.remove(name)
        world.add(ObstacleConfig(name='soft', type='sphere', position=(8.0, 0.0, 0.0)))
        world.add(ball('bar'))

    def again(world):
        configs = {each.name: each for each in (*world.config.bodies, *world.config.obstacles)}
        for name in ('soft', 'ground'):
            world.remove(name)
            world.add(configs[name])

    def clear(world):
        for name in (*world.names, 'ground', 'bar'):
            world.remove(name)

    return {
        'body added': lambda world: world.add(ball('new', 0.5, regions_count=3)),
        'body removed': lambda world: world.remove('bag'),
        'obstacle added': lambda world: world.add(wall),
        'obstacle removed': lambda world: world.remove('ground'),
        'same names, other things': exchange,
        'body and obstacle swap names': swap,
        'removed and added again': again,
        'everything removed': clear,
    }


CHANGES = changes()


@pytest.mark.parametrize('ticks', [0, 17])
@pytest.mark.parametrize('what', CHANGES)
def test_a_snapshot_of_before_continues_bit_by_bit(what, ticks):
    world = few()
    world.step(40)

    def changed(world):
        then = everything(world)
        CHANGES[what](world)
        world.step(ticks)
        assert everything(world) != then

    assert_goes_on_bit_by_bit(world, 60, changed, everything)


@pytest.mark.parametrize('what', CHANGES)
def test_a_snapshot_of_after_continues_bit_by_bit_in_a_world_that_has_not_changed(what):
    world, other = few(), few()
    world.step(40)
    CHANGES[what](world)
    world.step(20)
    after, then = world.snapshot(), everything(world)
    world.step(40)
    other.restore(after)
    assert everything(other) == then
    other.step(40)
    assert everything(other) == everything(world)


def test_what_is_still_there_keeps_its_present_parameters():
    world = few()
    before = world.snapshot()
    bodies = [dataclasses.replace(each, stiffness=0.123) for each in world.config.bodies]
    ground = dataclasses.replace(world.config.obstacles[0], velocity_linear=(0.0, 0.3, 0.0))
    obstacles = (ground, world.config.obstacles[1])
    world.configure(
        dataclasses.replace(world.config, bodies=tuple(bodies), obstacles=tuple(obstacles))
    )
    world.remove('bag')
    world.remove('bar')
    world.restore(before)
    stiffness = [each.stiffness for each in world.config.bodies]
    assert stiffness == [0.123, 0.5, 0.123]
    assert world.config.obstacles == obstacles
    assert world.obstacles[0].config == ground
    fresh = few()
    fresh.configure(world.config)
    for each in (world, fresh):
        each.step(50)
    assert bits_of(world) == bits_of(fresh)


def test_a_sleeper_and_its_dent_outlast_what_comes_and_goes():
    world = World(
        WorldConfig(
            bodies=(
                ball('a', stiffness=1.0, bounciness=0.0),
                # its yield strain is above the strain of its own weight: else it would creep on
                ball('b', 4.0, plasticity_yield=0.02, plasticity_creep=60.0, bounciness=0.0),
            )
        )
    )
    world.step(700)
    assert world.is_asleep('a') and world.is_asleep('b') and world.permanent_strain('b') > 0.01
    before = bits_of(world)
    world.add(ball('c', -4.0, regions_count=3))
    world.step(20)
    world.remove('a')
    world.step(20)
    assert bits_of(world, 'b') == {'b': before['b']}


# ---------------------------------------------------------------------------------------- history
def acted(world, history, ticks, actions):
    """Step a world with actions at some ticks, and return what it was at each."""
    log = {}
    for _ in range(ticks):
        log[world.tick] = everything(world)
        if world.tick in actions:
            actions[world.tick](world)
            history.log(world.tick, actions[world.tick])
        world.step()
        history.record(world)
    return log


def replayed(world, history, tick):
    """Go back to a tick as `Stepper` does."""
    actions = history.rewind(world, tick)
    while world.tick < tick:
        while actions and actions[0].tick == world.tick:
            actions.popleft().action(world)
        world.step()
    return everything(world)


def test_history_goes_back_through_changes_of_the_structure():
    world = few()
    history = History(world, 2.0**24)
    log = acted(
        world, history, 320,
        {
            70: CHANGES['body added'],
            110: CHANGES['obstacle removed'],
            150: CHANGES['same names, other things'],
            200: lambda world: world.add(GROUND),
            250: CHANGES['body removed'],
        },
    )  # fmt: skip
    for tick in (300, 240, 239, 190, 151, 150, 149, 111, 80, 70, 69, 3, 0):
        assert replayed(world, history, tick) == log[tick], tick


def stepped_to(stepper, seconds):
    now = round(seconds * SECOND)
    stepper.rewind(now)
    for _ in range(10_000):
        list(stepper.advance(now, drop_overload=False))
        if stepper.lag(now) < stepper.world.config.time_step and not stepper.replaying:
            return everything(stepper.world)
    raise AssertionError('the world does not arrive')


def test_a_clock_that_goes_back_undoes_changes_of_the_structure_and_no_parameters():
    stepper = Stepper(few(), {'points': 60.0}, stopwatch=lambda: 0.0)
    stepped_to(stepper, 0.0)
    log = {0.2: stepped_to(stepper, 0.2)}
    stepper.act(CHANGES['same names, other things'])
    stepper.act(CHANGES['body added'])
    for seconds in (0.4, 0.5):
        log[seconds] = stepped_to(stepper, seconds)
    for seconds in (0.4, 0.2, 0.3):
        again = stepped_to(stepper, seconds)
        assert seconds == 0.3 or again == log[seconds]
    stepper.act(CHANGES['body removed'])
    config = stepper.world.config
    soft = dataclasses.replace(config.bodies[0], stiffness=0.123)
    stepper.configure(dataclasses.replace(config, bodies=(soft, *config.bodies[1:])))
    stepped_to(stepper, 0.25)
    assert [each.stiffness for each in stepper.world.config.bodies] == [0.123, 0.5, 0.5]
    stepper.act(CHANGES['body removed'])
    stepper.reset(SECOND)
    assert stepper.world.names == ('soft', 'box')
    assert stepper.world.tick == 0


# ----------------------------------------------------------------------------- states are written
def test_a_state_that_is_written_is_there_and_goes_on():
    world, other = few(), few()
    for each in (world, other):
        each.step(20)
    x, v = world.positions('bag') + (0.0, 1.0, 0.5), world.velocities('bag') + (0.0, 2.0, 0.0)
    world.set_state('bag', x.tolist(), v)
    assert np.array_equal(world.positions('bag'), x)
    assert np.array_equal(world.velocities('bag'), v)
    assert bits_of(world, 'soft', 'box') == bits_of(other, 'soft', 'box')
    world.set_state('bag')
    assert np.array_equal(world.positions('bag'), x)
    world.set_state('bag', velocities=0.0 * v)
    assert np.array_equal(world.positions('bag'), x)
    assert not world.velocities('bag').any()
    for each in (world, other):
        each.step(20)
    assert bits_of(world, 'soft', 'box') == bits_of(other, 'soft', 'box')
    x[:] = 0.0
    assert world.positions('bag').any()


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        (np.zeros((41, 3)), r'its shape is \(41, 3\), it must be \(42, 3\)'),
        (np.zeros((3, 42)), r'its shape is \(3, 42\), it must be \(42, 3\), x, y, z of'),
        (1.0, r'its shape is \(\), it must be'),
        ([[1.0, 2.0], [3.0]], r'it is no array of numbers, it must be x, y, z of each vertex'),
        ('here', 'it is no array of numbers'),
        (np.full((42, 3), np.nan), 'a number of it is nan, all must be finite'),
    ],
)
def test_a_state_of_another_shape_is_refused_without_effect(values, sentence):
    world, good = few(), np.ones((42, 3))
    before = everything(world)
    with pytest.raises(ConfigError, match='positions of bag: ' + sentence):
        world.set_state('bag', values, good)
    with pytest.raises(ConfigError, match='velocities of bag: ' + sentence):
        world.set_state('bag', good, values)
    with pytest.raises(ConfigError, match=r"no body 'bga': did you mean bag\?"):
        world.set_state('bga', good)
    assert everything(world) == before


# ----------------------------------------------------------------------- obstacles and pins move
POSE = {'position': (4.2, 0.1, 0.05), 'orientation': (0.0, 0.0, 0.6, 0.8)}
TWIST = {'velocity_linear': (0.0, 0.5, 0.1), 'velocity_angular': (1.0, 0.0, 2.0)}


def configured(world, name, **values):
    obstacles = tuple(
        dataclasses.replace(each, **values) if each.name == name else each
        for each in world.config.obstacles
    )
    world.configure(dataclasses.replace(world.config, obstacles=obstacles))


def test_moving_an_obstacle_is_configuring_it():
    moved, other = few(), few()
    for each in (moved, other):
        each.step(30)
    moved.move_obstacle('bar', *POSE.values(), *TWIST.values())
    configured(other, 'bar', **POSE, **TWIST)
    assert everything(moved) == everything(other)
    for each in (moved, other):
        each.step(40)
    assert everything(moved) == everything(other)
    # without an orientation it keeps the one of its config; without a twist it stands still
    moved.move_obstacle('bar', np.array([4.0, 0.0, 0.0]))
    still = {'velocity_linear': (0.0,) * 3, 'velocity_angular': (0.0,) * 3}
    configured(other, 'bar', **POSE | {'position': (4.0, 0.0, 0.0)}, **still)
    for _ in range(2):
        assert everything(moved) == everything(other)
        for each in (moved, other):
            each.step(40)


def test_an_obstacle_that_has_moved_on_goes_where_it_is_put_even_if_it_was_put_there_before():
    world = few()
    for _ in range(2):
        world.move_obstacle('bar', (4.0, 0.0, -0.1), linear=(0.2, 0.0, 0.0))
        assert world.obstacles[1].position == pytest.approx([4.0, 0.0, -0.1])
        world.step(24)
        assert world.obstacles[1].position == pytest.approx([4.02, 0.0, -0.1])


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (('bra', (0, 0, 0)), r"no obstacle 'bra': did you mean bar\?"),
        (('soft', (0, 0, 0)), r"no obstacle 'soft'"),
        (('bar', 1.0), r'bar\.position is 1\.0: it must be 3 numbers'),
        (('bar', 'there'), r"bar\.position is 'there': it must be 3 numbers"),
        (('bar', (1.0, 2.0)), 'it must be 3 numbers'),
        (('bar', (0.0, np.nan, 0.0)), r'bar\.position is \[0\.0, nan, 0\.0\]: each element'),
        (('bar', (0, 0, 0), (0, 0, 0, 0)), r'bar\.orientation .* length must not be zero'),
        (('bar', (0, 0, 0), None, (1e9, 0, 0)), r'bar\.velocity\.linear'),
        (('bar', (0, 0, 0), None, (0, 0, 0), (0, 0)), r'bar\.velocity\.angular'),
    ],
)
def test_an_obstacle_cannot_be_moved_to_nowhere(arguments, sentence):
    world = few()
    before = everything(world)
    with pytest.raises(ConfigError, match=sentence):
        world.move_obstacle(*arguments)
    assert everything(world) == before


def test_moving_pins_is_configuring_them():
    config = few().config
    held = dataclasses.replace(config.bodies[1], pins_indices=(0, 1, 2))
    moved, other = (
        World(dataclasses.replace(config, bodies=(config.bodies[0], held))) for _ in range(2)
    )
    for each in (moved, other):
        each.step(20)
    moved.move_pins('bag', (0.5, 0.0, 0.2), np.array([0.0, 0.0, 1.0]))
    velocities = {
        'pins_velocity_linear': (0.5, 0.0, 0.2),
        'pins_velocity_angular': (0.0, 0.0, 1.0),
    }
    bodies = (config.bodies[0], dataclasses.replace(held, **velocities))
    other.configure(dataclasses.replace(other.config, bodies=bodies))
    before = moved.positions('bag')[[0, 1, 2]].mean(axis=0)
    for each in (moved, other):
        each.step(48)
    assert everything(moved) == everything(other)
    after = moved.positions('bag')[[0, 1, 2]].mean(axis=0)
    assert after - before == pytest.approx([0.1, 0.0, 0.04], abs=1e-9)
    moved.move_pins('bag', (0.0, 0.0, 0.0))
    moved.step(10)
    assert np.array_equal(moved.positions('bag')[[0, 1, 2]].mean(axis=0), after)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (('bagg', (0, 0, 0)), r"no body 'bagg': did you mean bag\?"),
        (('bag', 3.0), r'bag\.pins\.velocity\.linear is 3\.0: it must be 3 numbers'),
        (('bag', (0, 0, 0), (0, np.inf, 0)), r'bag\.pins\.velocity\.angular'),
    ],
)
def test_pins_cannot_be_moved_by_what_is_no_velocity(arguments, sentence):
    world = few()
    before = everything(world)
    with pytest.raises(ConfigError, match=sentence):
        world.move_pins(*arguments)
    assert everything(world) == before


def test_obstacles_that_others_put_there_stay_when_the_structure_changes():
    world, other = few(), few()
    box = ObstacleConfig(name='marker', type='box', position=(0.3, 0.0, 0.0), size=(0.3,) * 3)
    for each in (world, other):
        each.change_obstacles([ObstacleUpdate(('arm', 0), box)])
        each.step(20)
    world.add(ADDED['ball'])
    world.remove('box')
    for each in (world, other):
        each.step(60)
    assert bits_of(world, 'soft', 'bag') == bits_of(other, 'soft', 'bag')
