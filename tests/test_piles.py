# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies lie on each other and on points: piles stand, weigh what they weigh, sleep and wake."""

from core_helpers import (
    apart,
    assert_goes_on_bit_by_bit,
    body,
    bytes_of,
    centre,
    momentum,
    rms_displacement,
)
import numpy as np
import pytest

from softbody_ros.core import ObstacleConfig, World, WorldConfig
from softbody_ros.core.collision.point_obstacles import PointObstacles

MODES = ('rigid', 'linear', 'quadratic')
G = 9.81
H = 1 / 120


def on_the_ground(*bodies, h=H, obstacles=None):
    """Return a world of bodies on the ground."""
    ground = (ObstacleConfig(),) if obstacles is None else obstacles
    return World(WorldConfig(time_step=h, bodies=bodies, obstacles=ground))


def mean_force(world, name, ticks=36, wake=True):
    """Return the mean force of all contacts of a body, (3,), N: of sleepers it would be known."""
    forces = []
    if wake:
        for each in world.names:
            world.set_state(each)
        world.step(12)
        assert not world.is_asleep(name)
    for _ in range(ticks):
        world.step()
        forces.append(world.contact_wrench(name)[0])
    return np.mean(forces, axis=0)


def asleep(world, seconds=20.0):
    """Step until all bodies sleep; return whether they do."""
    for _ in range(round(seconds / 0.5)):
        world.step(round(0.5 / world.config.time_step))
        if all(world.is_asleep(name) for name in world.names):
            return True
    return False


# ------------------------------------------------------------------------------------------ piles
def heap(subdivisions, mode='quadratic'):
    """Return 27 balls that fall into a heap."""
    return on_the_ground(
        *(
            body(
                name=f'b{i}', mode=mode, subdivisions=subdivisions, stiffness=0.8,
                bounciness=0.3, size=0.1, mass=0.1,
                position=(
                    0.22 * (i % 3) + 0.02 * (i // 9), 0.22 * (i // 3 % 3) - 0.03 * (i // 9),
                    0.12 + 0.23 * (i // 9),
                ),
            )
            for i in range(27)
        ),
        h=1 / 60,
    )  # fmt: skip


def nearest_centres(world):
    """Return the smallest distance of two centres, m."""
    centres = np.array([centre(world, name) for name in world.names])
    distance = np.linalg.norm(centres[:, None] - centres, axis=2)
    return distance[np.triu_indices(len(centres), 1)].min()


@pytest.mark.parametrize(
    ('subdivisions', 'mode'),
    [
        (1, 'quadratic'),
        pytest.param(2, 'quadratic', marks=pytest.mark.slow),
        (1, 'linear'),
        (1, 'rigid'),
    ],
)
def test_the_balls_of_a_heap_keep_apart(subdivisions, mode):
    world = heap(subdivisions, mode)
    diameter = 0.2
    nearest = np.inf
    for _ in range(120):
        world.step()
        nearest = min(nearest, nearest_centres(world))
        for name in world.names:
            assert world.positions(name)[:, 2].min() > -1e-4 * diameter
    assert nearest >= 0.65 * diameter
    assert nearest_centres(world) >= 0.8 * diameter
    assert max(np.linalg.norm(momentum(world, name)) for name in world.names) < 1.0


def test_a_heap_that_is_saved_and_restored_goes_on_bit_by_bit():
    world = heap(1)
    world.step(40)
    assert_goes_on_bit_by_bit(world, 40)
    fresh = heap(1)
    fresh.step(80)
    assert bytes_of(fresh) == bytes_of(world)


def stack(mode, masses=(1.0, 1.0), h=H, **values):
    """Return boxes that stand on each other."""
    return on_the_ground(
        *(
            body('box', name=f'b{i}', mode=mode, mass=mass, position=(0.0, 0.0, 0.51 + 1.02 * i),
                 **values)
            for i, mass in enumerate(masses)
        ),
        h=h,
    )  # fmt: skip


# what is heavy on what is light needs small steps
@pytest.mark.parametrize(
    ('masses', 'h'), [((1.0, 1.0), H), ((1.0, 5.0), 1 / 240), ((5.0, 1.0), H)]
)
@pytest.mark.parametrize('mode', MODES)
def test_stacked_boxes_stand_and_feel_their_own_weight(mode, masses, h):
    world = stack(mode, masses, h=h, stiffness=0.8)
    world.step(round(2.0 / h))
    for i in range(2):
        assert centre(world, f'b{i}') == pytest.approx([0.0, 0.0, 0.5 + i], abs=0.05)
    for i, mass in enumerate(masses):
        force = mean_force(world, f'b{i}')
        assert force == pytest.approx([0.0, 0.0, mass * G], abs=0.02 * mass * G)
    if masses == (1.0, 5.0):
        return  # it sways for long
    assert asleep(world, 10.0)
    for i, mass in enumerate(masses):
        name = f'b{i}'
        assert world.contact_wrench(name)[0] == pytest.approx([0.0, 0.0, mass * G])
        assert rms_displacement(world, name) < 0.03


@pytest.mark.parametrize('mass', [0.3, 1.0])
@pytest.mark.parametrize('mode', MODES)
def test_a_box_rests_on_a_pinned_shelf(mode, mass):
    shelf = body(
        'box', name='shelf', mode=mode, mass=mass, stiffness=0.8,
        pins_box=(-1.0, -1.0, -1.0, 1.0, 1.0, 0.1),
    )  # fmt: skip
    load = body('box', name='load', mode=mode, mass=1.0, position=(0.0, 0.0, 1.02), stiffness=0.8)
    world = on_the_ground(shelf, load, obstacles=())
    world.step(240)
    assert centre(world, 'load') == pytest.approx([0.0, 0.0, 1.0], abs=0.1)
    assert mean_force(world, 'load', 120) == pytest.approx([0.0, 0.0, G], abs=0.05 * G)


@pytest.mark.parametrize('mode', MODES)
def test_bodies_keep_the_distance_of_both_their_thicknesses(mode):
    low, high = (
        body('box', name=name, mode=mode, position=(0.0, 0.0, z), stiffness=0.8, thickness=t)
        for name, z, t in (('low', 0.53, 0.02), ('high', 1.6, 0.03))
    )
    world = on_the_ground(low, high)
    assert asleep(world, 10.0)
    x = {name: world.positions(name)[:, 2] for name in world.names}
    assert x['low'].min() == pytest.approx(0.02, abs=2e-3)
    assert x['high'].min() - x['low'].max() == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize('mode', ['linear', 'quadratic'])
def test_the_ground_carries_what_lies_on_a_body_too(mode):
    """Each is squeezed by what lies on it, and half by its own weight."""
    # in proportion where faces are free to widen
    world = stack(mode, (1.0, 1.0, 1.0), h=1 / 240, stiffness=0.5, friction=0.0)
    world.step(480)
    lowest, middle, highest = (rms_displacement(world, f'b{i}') for i in range(3))
    assert lowest < 0.02
    assert lowest / highest == pytest.approx(2.5 / 0.5, rel=0.25)
    assert middle / highest == pytest.approx(1.5 / 0.5, rel=0.25)


# ---------------------------------------------------------------------------------------- wrenches
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('mesh', ['icosphere', 'box', 'cylinder', 'torus'])
def test_a_body_at_rest_feels_its_weight_awake_and_asleep(mesh, mode):
    config = body(
        mesh, mode=mode, mass=3.0, stiffness=0.8, position=(0.0, 0.0, 0.51), elasticity=0.0
    )
    world = on_the_ground(config, h=1 / 240)
    awake = None
    for _ in range(100):
        force = mean_force(world, 'body', 24, wake=False)
        if world.is_asleep('body'):
            break
        awake = force
    assert awake == pytest.approx([0.0, 0.0, 3.0 * G], abs=0.02 * 3.0 * G)
    assert world.is_asleep('body')
    force, torque = world.contact_wrench('body')
    assert force == pytest.approx([0.0, 0.0, 3.0 * G])
    assert torque == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize('mode', MODES)
def test_nothing_is_felt_in_flight(mode):
    world = on_the_ground(*apart([body(name='a', mode=mode, position=(0.0, 0.0, 9.0))]))
    world.step(30)
    assert not world.contact_wrench('a')[0].any()
    assert not world.contact_wrench('a')[1].any()


@pytest.mark.parametrize('mode', MODES)
def test_a_ball_in_a_corner_is_pushed_by_both_walls(mode):
    """Two planes at 45° hold it: each pushes by its weight / √2, together straight up."""
    turn = (0.0, np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8))
    back = (0.0, -np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8))
    walls = (
        ObstacleConfig(name='left', orientation=turn),
        ObstacleConfig(name='right', orientation=back),
    )
    config = body(
        mode=mode, subdivisions=3, stiffness=0.8, friction=0.0, position=(0.0, 0.0, 0.72)
    )
    world = on_the_ground(config, obstacles=walls)
    world.step(600)
    assert mean_force(world, 'body') == pytest.approx([0.0, 0.0, G], abs=0.02 * G)


@pytest.mark.parametrize('mode', MODES)
def test_a_ball_on_a_slope_without_friction_is_pushed_along_the_normal(mode):
    angle = np.radians(20.0)
    slope = ObstacleConfig(orientation=(0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)))
    config = body(
        mode=mode, subdivisions=3, stiffness=0.8, friction=0.0, elasticity=0.0,
        position=(0.0, 0.0, 0.505 / np.cos(angle)),
    )  # fmt: skip
    world = on_the_ground(config, obstacles=(slope,))
    world.step(120)
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    force = mean_force(world, 'body', 120)
    assert force == pytest.approx(G * np.cos(angle) * normal, abs=0.05 * G)


# ------------------------------------------------------------------------------------------- sleep
def two_stacks():
    """Return a world of a sleeping stack of two boxes and a third sleeper far away."""
    stacked = [
        body('box', name=name, position=(0.0, 0.0, z), stiffness=0.8)
        for name, z in (('low', 0.51), ('high', 1.53))
    ]
    far = body('box', name='far', position=(9.0, 0.0, 0.51), stiffness=0.8)
    ball = body(name='ball', position=(-3.0, 0.0, 0.5), stiffness=0.8)
    world = on_the_ground(*stacked, far, ball)
    assert asleep(world)
    return world


def test_a_stack_sleeps_and_wakes_together():
    world = two_stacks()
    before = bytes_of(world)
    world.step(50)
    assert bytes_of(world) == before
    world.apply_wrench('high', (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.01)
    world.step(2)
    awake = {name for name in world.names if not world.is_asleep(name)}
    assert awake == {'low', 'high'}
    assert asleep(world)


def test_a_flying_body_wakes_whom_it_comes_near_to_and_moves_whom_it_hits():
    world = two_stacks()
    rotation = world.rigid_fit('ball').rotation
    world.place('ball', np.array([-3.0, 0.0, 0.6]), rotation)
    world.set_twist('ball', np.array([6.0, 0.0, 1.5]), np.zeros(3))
    start = centre(world, 'low')
    world.step(1)
    assert world.is_asleep('low')
    world.step(60)
    assert not world.is_asleep('low')
    assert not world.is_asleep('high')
    assert world.is_asleep('far')
    assert centre(world, 'low')[0] > start[0] + 0.01
    assert asleep(world)


def test_nobody_sleeps_on_what_moves():
    world = on_the_ground(
        body('box', name='low', position=(0.0, 0.0, 0.51)),
        body(name='high', position=(0.0, 0.0, 1.51), initial_velocity_angular=(0.0, 0.0, 20.0),
             friction=0.0),
    )  # fmt: skip
    world.step(240)
    assert not world.is_asleep('high')
    assert not world.is_asleep('low')


def test_a_body_without_support_does_not_sleep_with_the_others():
    """Its support is taken away: whoever lay on it falls."""
    world = two_stacks()
    world.place('low', np.array([20.0, 0.0, 0.5]), world.rigid_fit('low').rotation)
    world.step(120)
    assert centre(world, 'high')[2] < 1.0


# ------------------------------------------------------------------------------------------ points
def bed(spacing=0.15, height=0.0):
    """Return points on a grid, as a camera sees the ground."""
    x, y = np.meshgrid(np.arange(-1.5, 1.5, spacing), np.arange(-1.5, 1.5, spacing))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('mesh', ['box', 'icosphere'])
def test_points_carry_a_body_as_an_obstacle_does(mesh, mode):
    config = body(mesh, mode=mode, subdivisions=2, mass=2.0, stiffness=0.8,
                  position=(0.0, 0.0, 0.62), friction=0.5)  # fmt: skip
    world = on_the_ground(config, obstacles=())
    world.set_points(PointObstacles(bed(), 0.05))
    world.step(200)
    force = mean_force(world, 'body')
    assert force[2] == pytest.approx(2.0 * G, rel=0.03)
    # a ball sinks in between four points, and rocks on them
    assert np.abs(force[:2]).max() < (0.02 if mesh == 'box' else 0.2) * 2.0 * G
    low = 0.02 if mesh == 'box' else 0.05
    assert world.positions('body')[:, 2].min() == pytest.approx(0.05, abs=low)
    if mesh == 'box':
        assert asleep(world)
        assert world.contact_wrench('body')[0] == pytest.approx([0.0, 0.0, 2.0 * G])


@pytest.mark.parametrize('mode', MODES)
def test_a_point_between_the_vertices_of_a_coarse_ball_is_not_passed_through(mode):
    config = body(mode=mode, position=(0.0, 0.0, 0.8), stiffness=0.8)
    world = on_the_ground(config, obstacles=())
    vertices = world.positions('body') - (0.0, 0.0, 0.8)
    faces = world.rest_shape('body').surface.faces
    lowest = vertices[faces].mean(axis=1)
    middle = lowest[np.argmin(lowest[:, 2])]
    world.set_points(PointObstacles(np.array([(middle[0], middle[1], 0.0)]), 0.02))
    fastest, heights = 0.0, []
    for _ in range(60):
        world.step()
        heights.append(centre(world)[2])
        fastest = max(fastest, np.abs(world.velocities('body')).max())
    assert min(heights) > 0.1  # it rolls off at last, but does not fall through
    assert fastest < 10.0


@pytest.mark.parametrize('mode', MODES)
def test_points_that_appear_inside_a_body_push_it_out_gently(mode):
    random = np.random.default_rng(3)
    # with more friction of either law, what is in contradiction gets out somewhat faster
    config = body(mode=mode, stiffness=0.5, friction_model='viscous', friction=0.2)
    world = World(WorldConfig(time_step=1 / 120, gravity_magnitude=0.0, bodies=(config,),
                              obstacles=()))  # fmt: skip
    for count in (1, 5, 40):
        world.reset()
        world.set_points(PointObstacles(0.15 * random.normal(size=(count, 3)), 0.01))
        for _ in range(20):
            world.step(6)
            assert np.isfinite(world.positions('body')).all()
            assert np.abs(world.velocities('body')).max() < 30.0
            assert np.abs(world.positions('body')).max() < 20.0


def test_points_that_go_let_fall():
    config = body('box', mass=2.0, stiffness=0.8, position=(0.0, 0.0, 0.56))
    world = on_the_ground(config, obstacles=())
    world.set_points(PointObstacles(bed(), 0.05))
    assert asleep(world)
    world.set_points(PointObstacles(np.zeros((0, 3)), 0.05))
    world.step(120)
    assert centre(world)[2] == pytest.approx(0.55 - G / 2, abs=0.1)


@pytest.mark.parametrize('mode', MODES)
def test_a_stack_on_points_stands(mode):
    boxes = [
        body('box', name=f'b{i}', mode=mode, stiffness=0.8, position=(0.0, 0.0, 0.56 + 1.01 * i))
        for i in range(2)
    ]
    world = on_the_ground(*boxes, obstacles=())
    world.set_points(PointObstacles(bed(), 0.05))
    world.step(480)
    for i in range(2):
        assert centre(world, f'b{i}') == pytest.approx([0.0, 0.0, 0.55 + i], abs=0.06)
        assert mean_force(world, f'b{i}') == pytest.approx([0.0, 0.0, G], abs=0.03 * G)
