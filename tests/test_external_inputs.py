# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What others do to a world: obstacles, points, wrenches, pokes and gravity; without ROS."""

import dataclasses

from core_helpers import (
    angular_momentum,
    assert_goes_on_bit_by_bit,
    body,
    bytes_of,
    centre,
    cloud,
    disturbed,
    floating,
    momentum,
    random_rotation,
    rms_displacement,
    sheet,
)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import BodyConfig, ConfigError, ObstacleConfig, Surface, World, WorldConfig
from softbody_ros.core.collision.point_obstacles import (
    MOST_POINTS,
    NO_POINTS,
    PointObstacles,
    thinned,
)
from softbody_ros.core.external_inputs import (
    MOST_DYNAMIC_OBSTACLES,
    ExternalInputs,
    ObstacleRemoval,
    ObstacleUpdate,
)

MODES = ('rigid', 'linear', 'quadratic')
SECOND = 1_000_000_000
KEY = ('arm', 0)


def box(position=(0.0, 0.0, -5.0), turn=(0.0, 0.0, 0.0), size=(1.0, 1.0, 1.0)):
    orientation = tuple(Rotation.from_rotvec(turn).as_quat().tolist())
    return ObstacleConfig(
        name='marker', type='box', position=position, orientation=orientation, size=size
    )


def placement(seconds=0.0, lifetime=0, key=KEY, **pose):
    return ObstacleUpdate(key, box(**pose), round(seconds * SECOND), lifetime=lifetime)


def resting():
    """Return a world whose ball has fallen asleep on the ground."""
    ball = BodyConfig(
        name='body', subdivisions=1, stiffness=1.0, bounciness=0.0, position=(0.0, 0.0, 0.5)
    )
    world = World(WorldConfig(bodies=(ball,)))
    world.step(480)
    assert world.is_asleep('body')
    return world


def guest(world, key=KEY):
    return world.external_inputs.dynamic_obstacles[key].obstacle


# --------------------------------------------------------------------------------------- obstacles
def test_an_obstacle_that_is_put_there_is_in_the_way():
    world = World(WorldConfig(bodies=(body(position=(0.0, 0.0, 3.0)),)))
    world.change_obstacles([placement(position=(0.0, 0.0, 1.0))])
    world.step(480)
    assert world.positions('body')[:, 2].min() > 1.9
    world.change_obstacles([ObstacleRemoval('arm', 0)])
    world.step(480)
    assert world.positions('body')[:, 2].min() < 0.1


def test_removals_take_what_they_name():
    world = floating(body())
    keys = [('a', 0), ('a', 1), ('b', 0), ('', 0)]
    for removal, left in (
        (ObstacleRemoval('a', 1), [('a', 0), ('b', 0), ('', 0)]),
        (ObstacleRemoval('a', 7), keys),
        (ObstacleRemoval('a'), [('b', 0), ('', 0)]),
        (ObstacleRemoval('', 0), keys[:3]),
        (ObstacleRemoval(), []),
    ):
        world.change_obstacles([ObstacleRemoval(), *(placement(key=key) for key in keys), removal])
        assert list(world.external_inputs.dynamic_obstacles) == left


def test_two_poses_make_a_velocity_that_goes_on_until_the_timeout():
    world = floating(body(), h=1 / 240)
    world.change_obstacles([placement(10.0)])
    assert not guest(world).moves
    world.step(24)
    world.change_obstacles(
        [placement(10.1, position=(0.2, 0.0, -5.0), turn=(0.0, 0.0, 0.3))], longest_gap=0.5
    )
    assert guest(world).config.velocity_linear == pytest.approx((2.0, 0.0, 0.0))
    assert guest(world).config.velocity_angular == pytest.approx((0.0, 0.0, 3.0))
    assert guest(world).position == pytest.approx((0.2, 0.0, -5.0))
    world.step(60)
    assert guest(world).position == pytest.approx((0.2 + 0.25 * 2.0, 0.0, -5.0))
    turned = Rotation.from_matrix(guest(world).rotation).as_rotvec()
    assert turned == pytest.approx((0.0, 0.0, 0.3 + 0.25 * 3.0))
    world.step(59)
    assert guest(world).moves
    world.step(1)
    assert not guest(world).moves
    world.step(100)
    assert guest(world).position == pytest.approx((0.2 + 0.5 * 2.0, 0.0, -5.0))
    assert (guest(world).velocity_at(np.ones((2, 3))) == 0.0).all()


@pytest.mark.parametrize(
    ('first', 'second'), [(10.0, 10.0), (10.0, 9.9), (0.0, 0.1), (10.0, 10.6), (10.0, 0.0)]
)
def test_stamps_that_say_nothing_make_no_velocity(first, second):
    world = floating(body())
    world.change_obstacles([placement(first)])
    world.change_obstacles([placement(second, position=(0.2, 0.0, -5.0))], longest_gap=0.5)
    assert not guest(world).moves
    assert guest(world).position == pytest.approx((0.2, 0.0, -5.0))


def test_a_leap_is_no_velocity():
    world = floating(body())
    world.change_obstacles([placement(1.0)])
    world.change_obstacles([placement(1.0 + 1e-6, position=(1.0, 0.0, -5.0))])
    assert not guest(world).moves


def test_stamps_of_a_slower_world():
    world = floating(body())
    world.change_obstacles([placement(1.0)])
    moved = placement(1.2, position=(0.2, 0.0, -5.0))
    world.change_obstacles([dataclasses.replace(moved, pace=0.5)])
    assert guest(world).config.velocity_linear == pytest.approx((2.0, 0.0, 0.0))
    world.change_obstacles([dataclasses.replace(moved, pace=0.0, stamp=2 * SECOND)])
    assert not guest(world).moves


def test_a_lifetime_ends_and_begins_anew():
    world = floating(body())
    world.change_obstacles([placement(lifetime=10), placement(key=('b', 1), lifetime=20)])
    world.step(9)
    assert len(world.obstacles) == 2
    world.step(1)
    assert list(world.external_inputs.dynamic_obstacles) == [('b', 1)]
    world.change_obstacles([placement(key=('b', 1))])
    world.step(100)
    assert len(world.obstacles) == 1


def test_there_is_a_most():
    world = floating(body())
    world.change_obstacles([placement(key=('a', i)) for i in range(MOST_DYNAMIC_OBSTACLES + 5)])
    assert len(world.obstacles) == MOST_DYNAMIC_OBSTACLES
    world.change_obstacles(
        [placement(key=('a', 3), position=(7.0, 0.0, 0.0)), ObstacleRemoval('a', 4)]
    )
    assert guest(world, ('a', 3)).position[0] == 7.0
    world.change_obstacles([placement(key=('new', 0))])
    assert ('new', 0) in world.external_inputs.dynamic_obstacles


BESIDE = (1.505, 0.0, 0.0)
"""Where a box of half extent 1 is 5 mm from the resting ball."""


def test_obstacles_far_from_a_sleeper_do_not_wake_it():
    world = resting()
    for x in (5.0, 5.1, 2.0):
        world.change_obstacles([placement(position=(x, 0.0, 0.0))])
        world.step(10)
        assert world.is_asleep('body')
    world.change_obstacles([ObstacleRemoval()])
    assert world.is_asleep('body')


def test_an_obstacle_wakes_where_it_was_and_where_it_is():
    world = resting()
    for x in (BESIDE[0], 5.0, BESIDE[0]):
        world.change_obstacles([placement(position=(x, 0.0, 0.0))])
        assert not world.is_asleep('body')
        world.step(240)
        assert world.is_asleep('body')
    world.change_obstacles([ObstacleRemoval()])
    assert not world.is_asleep('body')


def test_only_what_is_noticed_wakes():
    world = resting()
    here = placement(1.0, lifetime=240, position=BESIDE)
    world.change_obstacles([here])
    assert not world.is_asleep('body')
    world.step(240 - 1)
    assert world.is_asleep('body')
    asleep = bytes_of(world)
    for stamp in (1.1, 1.2, 9.0, 0.0):  # sent again, unchanged
        world.change_obstacles([dataclasses.replace(here, stamp=round(stamp * SECOND))])
        world.step(100)
        assert world.is_asleep('body')
    assert bytes_of(world) == asleep
    world.step(140)  # its lifetime is over
    assert not world.external_inputs.dynamic_obstacles
    assert not world.is_asleep('body')


def test_another_shape_beside_a_sleeper_wakes():
    world = resting()
    for size in (1.0, 1.5):
        beside = (0.505 + size, 0.0, 0.0)
        world.change_obstacles([placement(position=beside, size=(size, 1.0, 1.0))])
        assert not world.is_asleep('body')
        world.step(240)
        assert world.is_asleep('body')


def test_an_obstacle_that_was_ahead_of_its_message_goes_back():
    world = floating(body())
    world.change_obstacles([placement(1.0)])
    there = placement(1.1, position=(0.2, 0.0, -5.0))
    world.change_obstacles([there])
    world.step(10)
    assert guest(world).position[0] > 0.3
    world.change_obstacles([dataclasses.replace(there, stamp=round(1.2 * SECOND))])
    assert guest(world).position[0] == 0.2
    assert not guest(world).moves


# ------------------------------------------------------------------------------------------ points
def test_points_that_matter_wake_a_body():
    world = resting()
    far = PointObstacles(np.array([[9.0, 0.0, 0.0], [0.0, 9.0, 0.0]]), 0.02)
    world.set_points(far)
    assert world.is_asleep('body')
    near = PointObstacles(np.array([[9.0, 0.0, 0.0], [0.0, 0.5, 0.9]]), 0.02)
    world.set_points(near)
    assert not world.is_asleep('body')
    world.step(240)
    assert world.is_asleep('body')
    world.set_points(PointObstacles(near.points[::-1] + [[0, 0, 0], [1e-3, 0, 0]], 0.02))
    assert world.is_asleep('body')  # the far point has moved
    world.set_points(NO_POINTS)
    assert not world.is_asleep('body')


@pytest.mark.parametrize(('height', 'asleep'), [(1.01, False), (1.05, True)])
def test_points_reach_as_far_as_their_radius(height, asleep):
    world = resting()
    world.set_points(PointObstacles(np.array([[0.0, 0.0, height]]), 0.02))
    assert world.is_asleep('body') == asleep


def test_a_camera_that_sees_a_body_does_not_push_it():
    """Noisy points of the upper half and of the table around: of these alone it knows."""
    world, seen = resting(), resting()
    random = np.random.default_rng(0)
    above = random.normal(size=(2000, 3)) * (1.0, 1.0, 0.0) + (0.0, 0.0, 1.0)
    directions = random.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions[:, 2] = np.abs(directions[:, 2])
    x = seen.positions('body')
    middle, size = x.mean(axis=0), np.ptp(x, axis=0) / 2.0
    skin = middle + directions * size + random.normal(scale=0.002, size=(2000, 3))
    table = above[np.linalg.norm(above[:, :2], axis=1) > 0.9] * (1.0, 1.0, 0.0)
    cloud = PointObstacles(np.concatenate([skin, table]), 0.1)
    seen.set_points(cloud, 0.05)
    assert seen.point_obstacles.ignored == len(skin)
    np.testing.assert_array_equal(seen.point_obstacles.points, table)
    assert seen.is_asleep('body')
    world.set_points(cloud)
    assert world.point_obstacles.ignored == 0 and not world.is_asleep('body')


def test_points_below_a_body_are_no_part_of_it():
    """It lies on spheres of their radius: farther away than the filter reaches."""
    grid = np.stack(np.meshgrid(*[np.arange(-0.6, 0.61, 0.04)] * 2), -1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(len(grid))])
    shape = BodyConfig(name='body', mode='rigid', position=(0.0, 0.0, 0.53), subdivisions=3)
    world = World(WorldConfig(bodies=(shape,), obstacles=()))
    for seed in range(60):
        noise = np.random.default_rng(seed).normal(scale=0.002, size=points.shape)
        world.set_points(PointObstacles(points + noise, 0.02), 0.01)
        assert world.point_obstacles.ignored == 0
        world.step(8)
    assert world.positions('body')[:, 2].min() > 0.01


def test_few_points_stay_as_they_are():
    points = np.random.default_rng(0).normal(size=(MOST_POINTS, 3))
    assert thinned(points, 10.0) is points


@pytest.mark.parametrize('far', [0.0, 1e6])
def test_of_many_points_the_first_in_each_cube_stays(far):
    random = np.random.default_rng(1)
    points = random.uniform(-1.0, 1.0, size=(50_000, 3))
    points[7] = far
    kept = thinned(points, 0.1)
    cubes = np.floor(points / 0.1).astype(int)
    _, first = np.unique(cubes, axis=0, return_index=True)
    assert len(kept) == len(first) < MOST_POINTS
    np.testing.assert_array_equal(kept, points[np.sort(first)])
    np.testing.assert_array_equal(thinned(points.copy(), 0.1), kept)


def test_of_far_too_many_points_evenly_many_stay():
    points = np.random.default_rng(1).uniform(-9.0, 9.0, size=(100_000, 3))
    kept = thinned(points, 1e-3)
    assert len(kept) == MOST_POINTS
    rows = {tuple(point): row for row, point in enumerate(points.tolist())}
    steps = np.diff([rows[tuple(point)] for point in kept.tolist()])
    assert steps.min() >= 4 and steps.max() <= 6


# ---------------------------------------------------------------------------------------- wrenches
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
def test_a_constant_force_makes_an_exact_parabola(mode, h):
    world = floating(body(mode=mode, mass=2.0, initial_velocity_linear=(1.0, 0.0, 0.0)), h=h)
    world.apply_wrench('body', (0.0, 3.0, -4.0), (0.0, 0.0, 0.0), 1.0)
    world.step(round(1 / h))
    np.testing.assert_allclose(centre(world), [1.0, 0.75, -1.0], atol=1e-12)
    np.testing.assert_allclose(momentum(world), [1.0, 1.5, -2.0], atol=1e-12)
    assert rms_displacement(world) < 1e-12
    world.step(10)  # it is over
    np.testing.assert_allclose(momentum(world), [1.0, 1.5, -2.0], atol=1e-12)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
def test_a_torque_gives_exactly_its_angular_momentum(mode, h):
    world = floating(body(mode=mode, mass=2.0), h=h)
    if mode != 'rigid':
        disturbed(world, seed=3)
    before, linear = angular_momentum(world), momentum(world)
    torque = np.array([0.1, -0.2, 0.3])
    world.apply_wrench('body', (0.0, 0.0, 0.0), torque, 0.5)
    world.step(round(1 / h))
    np.testing.assert_allclose(angular_momentum(world), before + 0.5 * torque / 2.0, atol=1e-12)
    np.testing.assert_allclose(momentum(world), linear, atol=1e-12)


@pytest.mark.parametrize('mode', MODES)
def test_a_wrench_in_body_axes_turns_with_the_body(mode):
    spin, force, mass, h, seconds = 2.0, 3.0, 2.0, 1 / 480, 1.0
    shape = body('box', mode=mode, mass=mass, initial_velocity_angular=(0.0, 0.0, spin))
    world = floating(dataclasses.replace(shape, stiffness=1.0), h=h)
    world.apply_wrench('body', (force, 0.0, 0.0), (0.0, 0.0, 0.0), seconds, in_body_axes=True)
    world.step(round(seconds / h))
    angle = spin * seconds
    expected = force / (mass * spin) * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
    np.testing.assert_allclose(momentum(world), expected, atol=0.01 if mode != 'rigid' else 1e-5)


def test_a_torque_in_body_axes():
    turned = random_rotation(2)
    quaternion = tuple(Rotation.from_matrix(turned).as_quat().tolist())
    world = floating(body(mode='rigid', orientation=quaternion))
    world.apply_wrench('body', (0.0,) * 3, (0.01, 0.0, 0.0), 0.5, in_body_axes=True)
    world.step(60)
    np.testing.assert_allclose(angular_momentum(world), turned @ [0.005, 0.0, 0.0], atol=1e-12)


def test_wrenches_add_up_and_replace_each_other():
    one, other = body(name='one', mass=2.0), body(name='other', mass=4.0, position=(9.0, 0, 0))
    world = floating(one, other)
    zero = (0.0, 0.0, 0.0)
    world.apply_wrench(None, (0.0, 0.0, 4.0), zero, 1.0)
    world.apply_wrench('one', (8.0, 0.0, 0.0), zero, 1.0)
    world.apply_wrench('one', (0.0, 2.0, 0.0), zero, 1.0)
    world.step(60)
    np.testing.assert_allclose(momentum(world, 'one'), [0.0, 0.5, 1.0], atol=1e-12)
    np.testing.assert_allclose(momentum(world, 'other'), [0.0, 0.0, 0.5], atol=1e-12)
    world.apply_wrench(None, zero, zero, 1.0)
    world.apply_wrench('one', zero, zero, 1.0)
    assert not world.external_inputs.wrenches
    world.step(60)
    np.testing.assert_allclose(momentum(world, 'one'), [0.0, 0.5, 1.0], atol=1e-12)


def test_whoever_is_pushed_is_awake_and_nobody_else():
    still = {'stiffness': 1.0, 'bounciness': 0.0}
    one = body(name='one', position=(0.0, 0.0, 0.5), **still)
    other = body(name='other', position=(5.0, 0.0, 0.5), **still)
    world = World(WorldConfig(bodies=(one, other)))
    world.step(480)
    asleep = bytes_of(world)
    assert world.is_asleep('one') and world.is_asleep('other')
    world.apply_wrench('other', (0.0, 0.0, -0.1), (0.0,) * 3, 2.0)
    world.step(479)
    assert not world.is_asleep('other') and world.is_asleep('one')
    world.step(480)
    assert world.is_asleep('other')
    world.apply_wrench('other', (0.0, 0.0, 40.0), (0.0,) * 3, 0.1)
    before = world.contact_impulse('other').impulse
    world.step(24)
    # the ground pushes, too, as long as the body, which its weight has pressed, recovers
    ground = world.contact_impulse('other').impulse - before
    assert 0.0 < ground[2] < 0.05
    np.testing.assert_allclose(
        momentum(world, 'other'), [0.0, 0.0, 4.0 - 0.981] + ground, atol=1e-12
    )
    assert bytes_of(world) != asleep


def test_an_unknown_body_is_refused():
    world = floating(body())
    with pytest.raises(ConfigError, match="no body 'boby': did you mean body"):
        world.apply_wrench('boby', (1.0, 0.0, 0.0), (0.0,) * 3, 1.0)
    assert not world.external_inputs.wrenches


def test_shapes_without_inertia_can_be_turned_where_they_can():
    rod = floating(body(cloud(np.linspace((-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), 9))))
    rod.apply_wrench('body', (1.0, 0.0, 0.0), (12.0, 1.2, 0.0), 1 / 120)
    rod.step()
    # all but what would turn it about itself, as it lies after the tick
    x = rod.positions('body')
    axis = (x[-1] - x[0]) / np.linalg.norm(x[-1] - x[0])
    given = np.array([0.1, 0.01, 0.0])
    np.testing.assert_allclose(angular_momentum(rod), given - given @ axis * axis, atol=1e-12)
    np.testing.assert_allclose(angular_momentum(rod), [0.0, 0.01, 0.0], atol=5e-5)
    rod.step(60)
    assert np.isfinite(rod.positions('body')).all()


# ------------------------------------------------------------------------------------------- pokes
@pytest.mark.parametrize('mode', MODES)
def test_a_poke_gives_exactly_its_momentum_inwards(mode):
    world = floating(body(mode=mode, mass=2.0, subdivisions=3))
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    assert world.poke(0.5 * direction, 1.5, 0.15) == 'body'
    given = 2.0 * momentum(world)
    assert np.linalg.norm(given) == pytest.approx(1.5, rel=1e-12)
    np.testing.assert_allclose(given, -1.5 * direction, atol=0.1)
    world.step(30)
    np.testing.assert_allclose(2.0 * momentum(world), given, atol=1e-12)
    assert rms_displacement(world) < 0.1


def test_a_poke_beside_the_middle_turns_the_body():
    world = floating(body('box', mode='rigid'))
    point = np.array([0.35, 0.1, 0.501])
    world.poke(point, 1.0, 0.45)
    kick = momentum(world)
    spots = world.positions('body')
    share = np.maximum(1 - ((spots - point) ** 2).sum(axis=1) / 0.45**2, 0.0) ** 2
    share *= world.rest_shape('body').weights
    lever = (share / share.sum()) @ spots
    assert np.linalg.norm(np.cross(lever, kick)) > 0.02
    np.testing.assert_allclose(angular_momentum(world), np.cross(lever, kick), atol=1e-12)


def test_a_soft_poke_dents_where_it_pokes():
    world = floating(body(subdivisions=3))
    point = np.array([0.0, 0.0, 0.5])
    world.poke(point, 1.5, 0.2)
    deepest = 0.0
    for _ in range(20):
        world.step()
        fit = world.rigid_fit('body')
        assert fit.displacement.max() < 0.2
        if fit.displacement.max() > deepest:
            deepest, where = fit.displacement.max(), int(fit.displacement.argmax())
    assert deepest > 0.03
    rest = world.rest_shape('body').surface.vertices
    assert np.linalg.norm(rest[where] - point) < 0.2


def test_only_the_nearest_body_is_poked_and_nothing_out_of_reach():
    world = floating(body(name='one'), body(name='other', position=(1.1, 0.0, 0.0)))
    assert world.poke((0.57, 0.0, 0.0), 1.0, 0.3) == 'other'
    assert momentum(world, 'one') @ [1, 1, 1] == 0.0
    assert momentum(world, 'other')[0] > 0.9
    before = bytes_of(world)
    assert world.poke((0.0, 0.0, 0.9), 1.0, 0.3) == ''
    assert bytes_of(world) == before
    name, distance = world.nearest((0.0, 0.0, 0.9))
    assert (name, distance) == ('one', pytest.approx(0.4, abs=0.05))


def test_the_other_side_of_a_thin_body_does_not_pull():
    top = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)]
    below = [(0.03, 0.0, -0.01), (0.0, 2.0, -0.01), (2.0, 0.0, -0.01), (0.0, 0.03, -0.01)]
    world = floating(
        body(Surface(np.array(top + below), np.array([(0, 1, 2), (3, 4, 5), (6, 4, 5)])))
    )
    world.poke((0.0, 0.0, 0.02), 1.0, 0.15)
    np.testing.assert_allclose(momentum(world), [0.0, 0.0, -1.0], atol=1e-9)


@pytest.mark.parametrize('surface', [sheet(), cloud([(0.0, 0.0, 0.0)] + [(1.0, 0.5, 0.0)])])
def test_pokes_of_odd_shapes_stay_finite(surface):
    world = floating(body(surface))
    world.poke(world.positions('body')[0], 1.0, 0.1)
    assert np.linalg.norm(momentum(world)) == pytest.approx(1.0)
    world.step(60)
    assert np.isfinite(world.positions('body')).all()


# ----------------------------------------------------------------------------------------- gravity
def test_another_gravity_acts_for_its_time_exactly():
    world = floating(body(), gravity=10.0)
    world.override_gravity((2.0, 0.0, 0.0), 0.5)
    world.step(60)
    np.testing.assert_allclose(momentum(world), [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(world.gravity, [0.0, 0.0, -10.0])
    world.step(60)
    np.testing.assert_allclose(momentum(world), [1.0, 0.0, -5.0], atol=1e-12)


def test_gravity_that_is_sent_again_goes_on():
    world = floating(body(), gravity=10.0)
    for _ in range(10):
        world.override_gravity((0.0, 0.0, 0.0), 0.5)
        world.step(50)
    np.testing.assert_allclose(momentum(world), [0.0, 0.0, 0.0], atol=1e-12)


def test_only_a_gravity_that_differs_wakes():
    world = resting()
    for _ in range(3):
        world.override_gravity(world.config.gravity, 0.1)
        world.step(10)
        assert world.is_asleep('body')
    world.step(240)  # back to the parameters, which say the same
    assert world.external_inputs.gravity is None
    assert world.is_asleep('body')
    world.override_gravity((0.0, 0.0, -9.0), 1.0)
    assert not world.is_asleep('body')
    world.step(239)
    assert world.is_asleep('body')
    world.step(1)
    assert not world.is_asleep('body')


# ---------------------------------------------------------------------- snapshots, resets, history
def everything(world):
    """Let everything act at once."""
    world.change_obstacles([placement(1.0, position=(0.4, 0.0, 0.0), lifetime=200)])
    world.step(20)
    world.change_obstacles([placement(1.1, position=(0.5, 0.1, 0.0), turn=(0.1, 0.0, 0.2))])
    world.change_obstacles([placement(lifetime=100, key=('short', 1))])
    world.set_points(PointObstacles(np.random.default_rng(0).normal(size=(50, 3)), 0.05))
    world.apply_wrench('body', (1.0, 0.0, 0.0), (0.0, 0.1, 0.0), 0.6, in_body_axes=True)
    world.override_gravity((0.0, 1.0, -3.0), 0.4)
    world.poke(world.positions('body')[5], 1.0, 0.2)


def state(world):
    guests = {
        key: (item.obstacle.position.tobytes(), item.obstacle.rotation.tobytes(), item.stops_at)
        for key, item in world.external_inputs.dynamic_obstacles.items()
    }
    points = world.point_obstacles.points.tobytes()
    return world.tick, bytes_of(world), guests, points, world.gravity.tolist()


def test_a_snapshot_has_what_others_do():
    world = World(WorldConfig(bodies=(body(position=(0.0, 0.0, 1.0)),)))
    everything(world)
    world.step(30)
    snapshot = world.snapshot()
    without = dataclasses.replace(snapshot, inputs=ExternalInputs())
    assert snapshot.nbytes - without.nbytes > world.point_obstacles.points.nbytes

    def changed(world):
        world.change_obstacles([ObstacleRemoval()])
        world.set_points(NO_POINTS)
        world.override_gravity((0.0, 0.0, 5.0), 9.0)
        world.apply_wrench(None, (9.0, 0.0, 0.0), (0.0,) * 3, 9.0)
        world.step(10)

    assert ('short', 1) in state(world)[2]
    for _ in range(10):
        assert_goes_on_bit_by_bit(world, 20, changed, state)
    assert ('short', 1) not in state(world)[2]


def test_reset_keeps_what_is_in_the_way_and_ends_forces():
    world = World(WorldConfig(bodies=(body(position=(0.0, 0.0, 1.0)),)))
    everything(world)
    world.step(10)
    there = world.external_inputs.dynamic_obstacles[KEY].obstacle.position.copy()
    world.reset()
    assert (world.tick, world.external_inputs.wrenches, world.external_inputs.gravity) == (
        0,
        {},
        None,
    )
    assert len(world.point_obstacles) == 50
    assert guest(world).position == pytest.approx(there)
    world.step(89)  # of the 100 ticks of its life 10 were over
    assert ('short', 1) in world.external_inputs.dynamic_obstacles
    world.step(1)
    assert ('short', 1) not in world.external_inputs.dynamic_obstacles
    world.step(60)
    assert not guest(world).moves


def test_reset_of_a_world_that_is_left_alone_is_a_fresh_start():
    world = World(WorldConfig(bodies=(body(position=(0.0, 0.0, 1.0)),)))
    everything(world)
    world.step(10)
    world.change_obstacles([ObstacleRemoval()])
    world.set_points(NO_POINTS)
    world.reset()
    fresh = World(world.config)
    for each in (world, fresh):
        each.step(240)
    assert bytes_of(world) == bytes_of(fresh)


@pytest.mark.parametrize('friction', [0.0, 0.5])
@pytest.mark.parametrize('count', [5, 20])
def test_points_that_appear_inside_a_rigid_body_do_not_throw_it(count, friction):
    ball = BodyConfig(name='body', mode='rigid', friction=friction, friction_model='coulomb')
    for seed in range(6):
        random, world = np.random.default_rng(seed), floating(ball)
        directions = random.normal(size=(count, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        distances = random.uniform(0.0, 0.45, (count, 1))
        world.set_points(PointObstacles(centre(world) + distances * directions, 0.01))
        for _ in range(240):
            world.step()
            # it gets out at 2 RMS radii a second, 1 m/s, and as from between wedges; the
            # compliance of the contacts alone would throw it at 100 m/s
            assert np.abs(world.velocities('body')).max() < 6.0


# ------------------------------------------------------------------------------------- bad numbers
BAD = {
    'place': lambda world: world.place('body', (0.0, np.nan, 0.0), np.eye(3)),
    'place, rotation': lambda world: world.place('body', (0.0, 0.0, 0.0), np.full((3, 3), np.inf)),
    'place, shape': lambda world: world.place('body', (0.0, 0.0, 0.0), np.eye(2)),
    'set_twist': lambda world: world.set_twist('body', (0.0, 0.0, np.inf), np.zeros(3)),
    'set_twist, shape': lambda world: world.set_twist('body', np.zeros(3), 1.0),
    'apply_wrench': lambda world: world.apply_wrench('body', (np.nan, 0, 0), (0, 0, 0), 1.0),
    'apply_wrench, shape': lambda world: world.apply_wrench(None, (1, 0), (0, 0, 0), 1.0),
    'apply_wrench, seconds': lambda world: world.apply_wrench(
        'body', (1, 0, 0), (0, 0, 0), np.inf
    ),
    'override_gravity': lambda world: world.override_gravity((0.0, 0.0, np.nan), 1.0),
    'override_gravity, shape': lambda world: world.override_gravity(9.81, 1.0),
    'override_gravity, seconds': lambda world: world.override_gravity((0.0, 0.0, 1.0), np.nan),
    'poke': lambda world: world.poke((np.nan, 0.0, 0.0), 1.0, 1.0),
    'poke, impulse': lambda world: world.poke((0.0, 0.0, 0.5), np.nan, 10.0),
    'poke, radius': lambda world: world.poke((0.0, 0.0, 0.5), 1.0, np.nan),
    'apply_wrench, ages': lambda world: world.apply_wrench('body', (1, 0, 0), (0, 0, 0), 1e308),
    'override_gravity, ages': lambda world: world.override_gravity((0.0, 0.0, 1.0), 1e308),
    'poke, far': lambda world: world.poke((1e308, 0.0, 0.0), 1.0, 1.0),
    'poke, wide': lambda world: world.poke((0.0, 0.0, 0.5), 1.0, 1e308),
    'poke, hard': lambda world: world.poke((0.0, 0.0, 0.5), 1e308, 10.0),
    'poke, text': lambda world: world.poke('here', 1.0, 1.0),
}


@pytest.mark.parametrize('call', BAD)
def test_numbers_that_are_none_are_refused_without_effect(call):
    world = resting()
    before, inputs = bytes_of(world), world.external_inputs
    with pytest.raises(ConfigError, match='must be'):
        BAD[call](world)
    assert bytes_of(world) == before
    assert world.external_inputs is inputs
    assert world.is_asleep('body')
    world.step(10)


def test_contacts_with_obstacles_of_one_name_are_known_again_one_by_one():
    """A box in a corner of two received boxes, which have one name, as all markers have."""

    def pushed(names):
        floor, wall = (
            ObstacleConfig(name=name, type='box', size=(1.0, 1.0, 0.1), **pose)
            for name, pose in zip(
                names,
                ({'position': (0, 0, -0.1)}, {'position': (0.3, 0, 0), 'orientation': TURNED}),
                strict=True,
            )
        )
        crate = body('box', size=0.2, mode='rigid', friction=0.5, position=(0.0, 0.0, 0.2))
        world = floating(crate, gravity=9.81)
        world.change_obstacles([ObstacleUpdate(('a', 0), floor), ObstacleUpdate(('a', 1), wall)])
        world.apply_wrench('body', (30.0, 0.0, 0.0), (0.0, 0.0, 0.0), 10.0)
        world.step(80)
        force = world.contact_wrench('body')[0]
        assert force == pytest.approx((-30.0, 0.0, 9.81), abs=0.5)
        return bytes_of(world), world.solver_work

    assert pushed(('marker', 'marker')) == pushed(('floor', 'wall'))


TURNED = (0.0, float(np.sin(np.pi / 4)), 0.0, float(np.cos(np.pi / 4)))
