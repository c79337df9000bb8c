# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The world: repeatable to the bit, saved, restored, reset, reconfigured, queried; without ROS."""

from collections import Counter
import dataclasses
import itertools
import os
from pathlib import Path
import subprocess
import sys

from core_helpers import (
    angular_momentum,
    assert_goes_on_bit_by_bit,
    body,
    bytes_of,
    cad_mesh,
    centre,
    floating,
    momentum,
    random_rotation,
    sheared_box,
    sheet,
)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import softbody_ros
from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    SimulationError,
    World,
    WorldConfig,
)
from softbody_ros.core.body import IDENTITIES, identities

MODES = ('rigid', 'linear', 'quadratic')


def busy_config(**values):
    """Return several bodies of several shapes among moving obstacles."""
    bodies = (
        BodyConfig(name='a', subdivisions=1, position=(0.0, 0.0, 0.7)),
        BodyConfig(name='b', subdivisions=1, position=(2.0, 0.0, 0.6), mode='linear'),
        BodyConfig(
            name='c',
            mesh='box',
            subdivisions=1,
            position=(-2.0, 0.0, 0.9),
            friction_model='viscous',
            initial_velocity_angular=(1.0, 2.0, 3.0),
        ),
        BodyConfig(name='d', mesh='box', subdivisions=1, position=(4.0, 0.0, 0.9), mode='rigid'),
    )
    obstacles = (
        ObstacleConfig(name='ground', velocity_linear=(0.3, 0.0, 0.1)),
        ObstacleConfig(
            name='bar',
            type='capsule',
            size=(0.3, 0.3, 1.0),
            velocity_angular=(0.1, 2.0, 0.3),
        ),
    )
    return WorldConfig(**{'bodies': bodies, 'obstacles': obstacles} | values)


def whole_state(world):
    """Return tick, bodies and obstacles as something that equals only itself."""
    poses = b''.join(o.position.tobytes() + o.rotation.tobytes() for o in world.obstacles)
    return world.tick, bytes_of(world), poses


def changed(world, name, **values):
    """Return the world's config with some fields of one body or obstacle replaced."""

    def replaced(parts):
        return tuple(
            dataclasses.replace(part, **values) if part.name == name else part for part in parts
        )

    config = world.config
    return dataclasses.replace(
        config, bodies=replaced(config.bodies), obstacles=replaced(config.obstacles)
    )


# ------------------------------------------------------------------------------------ determinism
def test_the_same_config_gives_the_same_bits():
    first, second = World(busy_config()), World(busy_config())
    for world in (first, second):
        world.step(150)
    assert whole_state(first) == whole_state(second)


def test_many_ticks_at_once_are_single_ticks():
    at_once, one_by_one = World(busy_config()), World(busy_config())
    at_once.step(240)
    for _ in range(240):
        one_by_one.step()
    assert whole_state(at_once) == whole_state(one_by_one)
    assert at_once.tick == 240
    assert at_once.time == pytest.approx(1.0)


def test_no_ticks_change_nothing():
    world = World(busy_config())
    before = whole_state(world)
    world.step(0)
    assert whole_state(world) == before


@pytest.mark.oldest
def test_a_restored_snapshot_continues_bit_by_bit():
    world = World(busy_config())
    world.step(60)
    assert_goes_on_bit_by_bit(world, 100, state=whole_state)


def test_a_snapshot_does_not_change_while_the_world_goes_on():
    world = World(busy_config())
    snapshot = world.snapshot()
    copies = [array.copy() for state in snapshot.states for array in (state.x, state.v)]
    world.step(50)
    world.restore(snapshot)
    world.step(50)
    kept = [array for state in snapshot.states for array in (state.x, state.v)]
    assert all(map(np.array_equal, kept, copies))


def test_reset_is_a_fresh_start():
    world, fresh = World(busy_config()), World(busy_config())
    beginning = whole_state(fresh)
    world.step(100)
    world.reset()
    assert whole_state(world) == beginning
    for each in (world, fresh):
        each.step(100)
    assert whole_state(world) == whole_state(fresh)


@pytest.mark.oldest
def test_queries_hand_out_copies():
    world = World(busy_config())
    before = whole_state(world)
    world.positions('a')[:] = 0.0
    world.velocities('a')[:] = 0.0
    world.rigid_fit('a').position[:] = 0.0
    world.step()
    other = World(busy_config())
    assert whole_state(other) == before
    other.step()
    assert whole_state(world) == whole_state(other)


# ------------------------------------------------------------------------------------- velocities
@pytest.mark.oldest
@pytest.mark.parametrize('mode', MODES)
def test_applying_the_initial_velocity_keeps_the_shape(mode):
    linear, angular = np.array([1.0, -2.0, 3.0]), np.array([0.5, 4.0, -1.0])
    world = World(
        WorldConfig(
            bodies=(
                BodyConfig(
                    name='body',
                    mesh=sheared_box(),
                    mode=mode,
                    initial_velocity_linear=linear,
                    initial_velocity_angular=angular,
                ),
            )
        )
    )
    world.step(150)
    x, tick = world.positions('body'), world.tick
    world.apply_initial_velocity()
    assert np.array_equal(world.positions('body'), x)
    assert world.tick == tick
    expected = linear + np.cross(angular, x - centre(world))
    assert world.velocities('body') == pytest.approx(expected, abs=1e-12)
    assert momentum(world) == pytest.approx(linear, abs=1e-12)
    assert world.rigid_fit('body').angular_velocity == pytest.approx(angular, abs=1e-9)


@pytest.mark.oldest
def test_bodies_start_with_their_initial_velocity():
    world = World(busy_config())
    assert world.rigid_fit('c').angular_velocity == pytest.approx([1.0, 2.0, 3.0])
    assert np.all(world.velocities('a') == 0.0)


# -------------------------------------------------------------------------------------- configure
@pytest.mark.oldest
@pytest.mark.parametrize(
    'values',
    [
        {'mode': 'linear'},
        {'mode': 'rigid'},
        {'stiffness': 0.9, 'bounciness': 0.1, 'deformation': 0.9},
        {'mass': 50.0},
        {'volume_conservation': 0.0},
        {'position': (9.0, 9.0, 9.0), 'orientation': (1.0, 0.0, 0.0, 0.0)},
        {'initial_velocity_linear': (5.0, 0.0, 0.0)},
        {'friction': 5.0, 'friction_model': 'coulomb', 'elasticity': 1.0, 'thickness': 0.1},
    ],
)
def test_a_change_of_parameters_moves_nothing(values):
    world = World(busy_config(obstacles=()))
    world.step(60)
    before = whole_state(world)
    linear, angular = momentum(world, 'a'), angular_momentum(world, 'a')
    world.configure(changed(world, 'a', **values))
    assert whole_state(world) == before
    assert world.body_config('a') == changed(world, 'a', **values).bodies[0]
    world.step()
    fall = world.config.gravity * world.config.time_step
    assert momentum(world, 'a') == pytest.approx(linear + fall, abs=1e-12)
    assert angular_momentum(world, 'a') == pytest.approx(angular, abs=1e-12)


def test_a_new_start_pose_counts_from_the_next_reset():
    world = World(busy_config())
    world.configure(changed(world, 'a', position=(7.0, 8.0, 9.0)))
    world.reset()
    assert centre(world, 'a') == pytest.approx([7.0, 8.0, 9.0])


def test_a_new_initial_velocity_counts_when_it_is_applied():
    world = World(busy_config())
    world.configure(changed(world, 'a', initial_velocity_linear=(7.0, 8.0, 9.0)))
    assert momentum(world, 'a') == pytest.approx([0.0, 0.0, 0.0])
    world.apply_initial_velocity()
    assert momentum(world, 'a') == pytest.approx([7.0, 8.0, 9.0])


def test_gravity_can_turn():
    world = floating(body(), gravity=1.0)
    world.configure(dataclasses.replace(world.config, gravity_direction=(0.0, 2.0, 0.0)))
    world.step(120)
    assert momentum(world) == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


def test_an_obstacle_goes_where_it_is_put_and_otherwise_stays_on_its_way():
    world = World(busy_config())
    world.step(60)
    ground, bar = world.obstacles
    world.configure(changed(world, 'a', stiffness=0.2))
    assert np.array_equal(world.obstacles[1].rotation, bar.rotation)
    world.configure(changed(world, 'bar', position=(1.0, 2.0, 3.0)))
    assert np.array_equal(world.obstacles[1].position, (1.0, 2.0, 3.0))
    assert np.array_equal(world.obstacles[0].position, ground.position)
    world.configure(changed(world, 'bar', velocity_angular=(0.0, 0.0, 0.0)))
    still = world.obstacles[1].rotation
    world.step(10)
    assert np.array_equal(world.obstacles[1].rotation, still)


def read_only_changes():
    config = busy_config()
    box = dataclasses.replace(config.bodies[0], mesh='box')
    return {
        'a.mesh': dataclasses.replace(config, bodies=(box, *config.bodies[1:])),
        'a.size': dataclasses.replace(
            config, bodies=(dataclasses.replace(config.bodies[0], size=0.6), *config.bodies[1:])
        ),
        'bar.type': dataclasses.replace(
            config,
            obstacles=(
                config.obstacles[0],
                dataclasses.replace(config.obstacles[1], type='box'),
            ),
        ),
        'time_step': dataclasses.replace(config, time_step=0.01),
        'reference_step': dataclasses.replace(config, reference_step=0.01),
        'added and removed': dataclasses.replace(config, bodies=config.bodies[:-1]),
        'bodies': dataclasses.replace(config, bodies=config.bodies[::-1]),
        'obstacles': dataclasses.replace(config, obstacles=config.obstacles[:1]),
    }


@pytest.mark.parametrize('what', read_only_changes())
def test_a_change_of_the_structure_is_refused_without_effect(what):
    world, other = World(busy_config()), World(busy_config())
    with pytest.raises(ConfigError, match='World') as caught:
        world.configure(read_only_changes()[what])
    assert what in str(caught.value)
    assert world.config == other.config
    for each in (world, other):
        each.step(50)
    assert whole_state(world) == whole_state(other)


def test_the_snapshot_of_an_obstacle_does_not_undo_a_later_change_of_its_parameters():
    world = World(busy_config())
    snapshot = world.snapshot()
    world.configure(changed(world, 'ground', velocity_linear=(0.0, 0.0, 0.0)))
    world.restore(snapshot)
    assert world.obstacles[0].config == world.config.obstacles[0]


# ---------------------------------------------------------------------------------------- queries
@pytest.mark.oldest
def test_a_misspelt_body_is_answered_with_the_nearest_name():
    world = World(WorldConfig())
    for query in (world.positions, world.velocities, world.rigid_fit, world.body_config):
        with pytest.raises(ConfigError, match=r"no body 'bal'.*did you mean ball\?"):
            query('bal')
    with pytest.raises(ConfigError, match=r'known are ball'):
        world.positions('zzz')


@pytest.mark.oldest
@pytest.mark.parametrize(
    'mesh', [sheared_box(), cad_mesh('power_connector'), 'capsule'], ids=['box', 'CAD', 'capsule']
)
def test_the_fit_at_the_start_is_the_pose_of_the_config(mesh):
    turn = Rotation.from_matrix(random_rotation(3))
    config = body(mesh, position=(1.0, 2.0, 3.0), orientation=0.5 * turn.as_quat())
    world = floating(config)
    fit = world.rigid_fit('body')
    if not isinstance(mesh, str) or mesh != 'capsule':
        assert np.linalg.norm(world.rest_shape('body').centre) > 1e-3
    assert fit.position == pytest.approx([1.0, 2.0, 3.0])
    assert fit.rotation == pytest.approx(turn.as_matrix())
    assert fit.displacement.max() < 1e-12
    vertices = world.rest_shape('body').surface.vertices
    expected = vertices @ turn.as_matrix().T + [[1.0, 2.0, 3.0]]
    assert world.positions('body') == pytest.approx(expected)


@pytest.mark.oldest
def test_the_fitted_twist_is_that_of_the_origin_of_a_spinning_body():
    spin, linear = np.array([0.0, 0.0, 2.0]), np.array([1.0, 0.0, 0.0])
    world = floating(
        body(
            sheared_box(),
            mode='rigid',
            initial_velocity_linear=linear,
            initial_velocity_angular=spin,
        ),
        h=1 / 2000,
    )
    fit = world.rigid_fit('body')
    assert fit.angular_velocity == pytest.approx(spin, abs=1e-9)
    arm = fit.position - centre(world)
    assert np.linalg.norm(arm[:2]) > 0.05
    assert fit.linear_velocity == pytest.approx(linear + np.cross(spin, arm), abs=1e-9)
    world.step()
    moved = (world.rigid_fit('body').position - fit.position) * 2000
    assert moved == pytest.approx(fit.linear_velocity, abs=2e-3)


@pytest.mark.oldest
def test_the_fitted_angular_velocity_of_flat_bodies_is_finite():
    world = floating(body(sheet(), initial_velocity_angular=(1.0, 2.0, 3.0)))
    assert world.rigid_fit('body').angular_velocity == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.oldest
def test_displacement_is_the_distance_from_the_fitted_pose():
    world = World(busy_config())
    world.step(90)
    fit = world.rigid_fit('a')
    posed = world.rest_shape('a').surface.vertices @ fit.rotation.T + fit.position
    distance = np.linalg.norm(world.positions('a') - posed, axis=1)
    assert fit.displacement == pytest.approx(distance, abs=1e-12)
    assert distance.max() > 1e-3


def test_names_are_in_the_order_of_the_config():
    assert World(busy_config()).names == ('a', 'b', 'c', 'd')


# ----------------------------------------------------------------------------- non-finite numbers
@pytest.mark.parametrize('bad', [1e300, -1e300, np.nan, np.inf])
@pytest.mark.parametrize('what', ['positions', 'velocities'])
@pytest.mark.parametrize('mode', MODES)
def test_a_step_out_of_the_finite_numbers_raises_and_keeps_the_last_good_state(mode, what, bad):
    world = World(changed(World(busy_config()), 'b', mode=mode))
    world.step(20)
    # as a tick might compute it: `set_state` refuses what is not finite
    getattr(world._state, what)(world.names.index('b'))[1, 3] = bad
    before = whole_state(world)
    with pytest.raises(SimulationError, match=r'tick 21 of b .* state stays at tick 20'):
        world.step(5)
    assert whole_state(world) == before
    world.reset()
    world.step(50)
    assert np.isfinite(world.positions('b')).all()


def test_a_failing_batch_does_not_let_the_others_go_on():
    world = World(busy_config())
    values = world.velocities('d')
    values[:] = 1e300
    world.set_state('d', velocities=values)
    before = world.positions('a')
    with pytest.raises(SimulationError):
        world.step()
    assert np.array_equal(world.positions('a'), before)


@pytest.mark.oldest
@pytest.mark.parametrize('exponent', range(10, 300, 10))
def test_no_speed_however_large_leaves_a_number_that_is_not_finite(exponent):
    world = World(WorldConfig(bodies=(BodyConfig(name='a', mesh='box', subdivisions=0),)))
    random = np.random.default_rng(exponent)
    with np.errstate(over='ignore'):
        world.set_state('a', velocities=10.0**exponent * random.normal(size=(8, 3)))
    try:
        world.step(20)
    except SimulationError:
        return
    for values in (world.positions('a'), world.velocities('a')):
        assert np.isfinite(values).all()


# ------------------------------------------------------------------------------------ without ROS
def run_python(code):
    """Run code in a new interpreter that finds the package and return what it prints."""
    root = Path(softbody_ros.__file__).parents[1]
    environment = os.environ | {'PYTHONPATH': str(root), 'PYTHONHASHSEED': 'random'}
    done = subprocess.run(
        [sys.executable, '-c', code],
        capture_output=True,
        text=True,
        env=environment,
        cwd=root,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.oldest
def test_the_core_imports_and_runs_without_ros():
    code = """
import importlib.abc, sys

def of_ros(name):
    root = name.partition('.')[0]
    return root.startswith(('rclpy', 'rosidl', 'ament', 'rpyutils')) or root.endswith(
        ('_msgs', '_srvs', '_interfaces'))

class NoRos(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if of_ros(name):
            raise ImportError(f'{name} is not wanted here')

sys.meta_path.insert(0, NoRos())
from softbody_ros.core import World, WorldConfig
world = World(WorldConfig())
world.step(3)
print(world.positions('ball').shape, [name for name in sys.modules if of_ros(name)])
"""
    assert run_python(code).strip() == '(642, 3) []'


@pytest.mark.slow  # in test_determinism they are compared in every tick, of more
def test_another_process_computes_the_same_bits():
    code = """
import hashlib
from softbody_ros.core import World, WorldConfig
world = World(WorldConfig())
world.step(200)
print(hashlib.sha256(world.positions('ball').tobytes()).hexdigest())
"""
    assert len(Counter(run_python(code) for _ in range(2))) == 1


def test_loading_kernels_changes_no_bit():
    world, untouched = World(busy_config()), World(busy_config())
    world.load_kernels()
    assert whole_state(world) == whole_state(untouched)
    for each in (world, untouched):
        each.step(50)
    assert whole_state(world) == whole_state(untouched)


def test_loaded_kernels_are_all_that_bodies_need_to_meet_to_rest_and_to_sleep():
    code = """
from softbody_ros.core import BodyConfig, ObstacleConfig, World, WorldConfig
from softbody_ros.core.compiled import kernels
def loaded():
    return {name for name, kernel in kernels.items() if getattr(kernel, 'overloads', None)}
ground = ObstacleConfig(name='ground')
finger = ObstacleConfig(name='finger', type='sphere', position=(9.0, 0.0, 0.0))
box = BodyConfig(name='box', mesh='box', mode='rigid')
falling = [
    BodyConfig(
        name=f'body{number}', mesh='box', mode='rigid' if number % 2 else 'linear',
        position=(0.0, 0.01 * number, 0.5 + 2.0 * number),
        initial_velocity_linear=(0.0, 0.0, -10.0),
    )
    for number in range(5)
]
for bodies, ticks in (((box,), 500), (falling, 300)):
    world = World(WorldConfig(bodies=tuple(bodies), obstacles=(ground, finger)))
    world.load_kernels()
    before = loaded()
    world.step(ticks)
    world.move_obstacle('finger', (9.0, 0.0, 0.0), linear=(0.0, 0.0, 0.1))
    world.step(ticks)
    print(sorted(loaded() - before))
"""
    assert run_python(code).split() == ['[]', '[]']


# ----------------------------------------------------------------------------------- identities
@pytest.mark.oldest
def test_no_two_names_have_the_same_number_in_any_order():
    numbers = {}
    while True:  # of half a million numbers, two of a thousand names or so coincide
        name = f'body {len(numbers)}'
        (number,) = identities([name])
        if number in numbers:
            break
        numbers[number] = name
    names = [name, numbers[number], 'other']
    given = dict(zip(names, identities(names), strict=True))
    assert len(set(given.values())) == 3
    assert all(0 <= each < IDENTITIES for each in given.values())
    for order in itertools.permutations(names):
        assert identities(order) == [given[each] for each in order]
