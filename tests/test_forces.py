# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Forces of contacts on bodies, obstacles, points and particles: of a tick, and means."""

from core_helpers import assert_goes_on_bit_by_bit, body, bytes_of, centre, momentum
import numpy as np
import pytest

from softbody_ros.core import (
    ConfigError,
    MeanWrenches,
    ObstacleConfig,
    ObstacleRemoval,
    ObstacleUpdate,
    PointObstacles,
    World,
    WorldConfig,
)

G = 9.81
GROUND = ObstacleConfig(name='ground')
MODES = ('rigid', 'linear', 'quadratic')
STEPS = (1 / 60, 1 / 240, 1 / 1000)
every_mode = pytest.mark.parametrize('mode', MODES)
every_step = pytest.mark.parametrize('h', STEPS, ids=lambda h: f'{1 / h:.0f}Hz')


def world_of(*bodies, h=1 / 240, obstacles=(GROUND,), **values):
    return World(WorldConfig(time_step=h, bodies=bodies, obstacles=obstacles, **values))


def box(name='body', **values):
    """Return a body that lies still soon: a box of 98 particles, of 2 kg."""
    values = {'subdivisions': 2, 'size': 0.2, 'mass': 2.0, 'position': (0.0, 0.0, 0.3)} | values
    return body('box', name=name, **values)


def about_world(wrench, origin):
    """Return a wrench about the origin of the world, (2, 3)."""
    force, torque = wrench
    return np.array([force, torque + np.cross(origin, force)])


def on_bodies(world):
    """Return the wrenches of all bodies about the origin of the world, (B, 2, 3)."""
    return np.array(
        [about_world(world.contact_wrench(name), centre(world, name)) for name in world.names]
    )


def on_obstacles(world):
    """Return the wrenches of all obstacles, and of the points, about the origin of the world."""
    origins = [*(obstacle.position for obstacle in world.obstacles), np.zeros(3)]
    return np.array(
        [
            about_world(world.obstacle_wrench(key), origin)
            for key, origin in zip(world.obstacle_keys, origins, strict=True)
        ]
    )


def assert_balanced(world):
    """Check that action is reaction, and return the largest force or torque."""
    actions, reactions = on_bodies(world), on_obstacles(world)
    largest = max(abs(actions).max(), abs(reactions).max())
    assert actions.sum(axis=0) + reactions.sum(axis=0) == pytest.approx(
        np.zeros((2, 3)), abs=1e-9 * largest
    )
    return largest


# --------------------------------------------------------------------------------- equal, opposite
OBSTACLES = (
    GROUND,
    ObstacleConfig(name='box', type='box', size=(0.3, 0.3, 0.3), position=(1.0, 0.0, 0.3)),
    ObstacleConfig(
        name='mesh', type='mesh', mesh='box', subdivisions=0, size=(0.3, 0.3, 0.3),
        position=(2.0, 0.0, 0.3), velocity_angular=(0.0, 0.0, 0.5),
    ),
    ObstacleConfig(
        name='sphere', type='sphere', size=(0.3, 0.3, 0.3), position=(3.0, 0.0, 0.3),
        velocity_linear=(0.1, 0.0, 0.2),
    ),
    ObstacleConfig(
        name='rod', type='capsule', size=(0.05, 0.05, 0.3), position=(4.0, 0.0, 0.3),
        orientation=(0.0, 0.6, 0.0, 0.8),
    ),
)  # fmt: skip


@every_mode
@pytest.mark.parametrize(
    'h', [1 / 60, *(pytest.param(h, marks=pytest.mark.slow) for h in (1 / 240, 1 / 1000))]
)
@pytest.mark.parametrize('friction_model', ['viscous', 'coulomb'])
def test_action_is_reaction_in_every_tick(mode, h, friction_model):
    bodies = [
        body(
            'box' if column % 2 else 'icosphere', name=f'at{column}{row}', mode=mode, size=0.17,
            mass=1.0 + 20.0 * row, friction_model=friction_model,
            position=(column + 0.1, 0.05, 0.8 + 0.35 * row),
            initial_velocity_linear=(0.0, 0.0, -2.0),
        )
        for column in range(6)
        for row in range(2)
    ]  # fmt: skip
    bodies.append(
        body(name='pinned', mode=mode, size=0.2, position=(2.45, 0.0, 0.4), pins_indices=(0,))
    )
    world = world_of(*bodies, h=h, obstacles=OBSTACLES)
    world.set_points(PointObstacles(np.array([(0.5, 0.0, 0.2), (5.1, 0.0, 0.3)]), 0.05))
    felt = np.zeros(len(OBSTACLES) + 1)
    largest = 0.0
    for _ in range(round(0.6 / h)):
        world.step()
        largest = max(largest, assert_balanced(world))
        felt = np.maximum(felt, np.linalg.norm(on_obstacles(world)[:, 0], axis=1))
        for name in world.names:
            # rounding: the share that is absorbed is subtracted
            assert world.normal_forces(name).min() >= -1e-12 * largest
    assert (felt > 1.0).all()


@every_mode
def test_bodies_push_each_other_equally_and_opposite(mode):
    first = body(name='a', mode=mode, mass=2.0, initial_velocity_linear=(2.0, 0.0, 0.0))
    world = world_of(
        first,
        body(name='b', mode=mode, position=(1.2, 0.3, 0.1)),
        gravity_magnitude=0.0,
        obstacles=(),
    )
    largest = 0.0
    for _ in range(120):
        world.step()
        one, two = on_bodies(world)
        largest = max(largest, abs(one).max())
        assert one + two == pytest.approx(np.zeros((2, 3)), abs=1e-9 * max(abs(one).max(), 1e-9))
        assert world.normal_forces('a').any() == bool(one.any())
    assert largest > 10.0
    assert not on_obstacles(world).any()


# ------------------------------------------------------------------------------------------ weight
@every_mode
@every_step
def test_a_body_at_rest_weighs_on_what_it_lies_on(mode, h):
    world = world_of(box(mode=mode), h=h)
    world.step(round(1.0 / h))
    means = MeanWrenches(world)
    world.step(round(0.25 / h))
    weight = [0.0, 0.0, 2.0 * G]
    for force in (world.contact_wrench('body')[0], means.contact_wrench('body')[0]):
        assert force == pytest.approx(weight, abs=1e-3 * 2.0 * G)
    for force in (world.obstacle_wrench('ground')[0], means.obstacle_wrench('ground')[0]):
        assert -force == pytest.approx(weight, abs=1e-3 * 2.0 * G)
    assert world.normal_forces('body').sum() == pytest.approx(2.0 * G, rel=1e-3)


@every_mode
def test_only_particles_in_contact_feel_a_normal_force(mode):
    world = world_of(box(mode=mode))
    world.step(100)
    forces, heights = world.normal_forces('body'), world.positions('body')[:, 2]
    assert forces.shape == (len(heights),)
    assert (forces >= 0.0).all()
    assert forces.any()
    assert not forces[heights > 0.1].any()


@every_mode
@every_step
def test_the_torque_is_that_of_the_weight_on_its_lever(mode, h):
    table = ObstacleConfig(
        name='table', type='box', size=(0.5, 0.5, 0.1), position=(1.0, 2.0, 0.0)
    )
    world = world_of(box(mode=mode, mass=3.0, position=(1.2, 1.9, 0.31)), h=h, obstacles=(table,))
    world.step(round(1.0 / h))
    means = MeanWrenches(world)
    world.step(round(0.5 / h))
    arm = centre(world) - (1.0, 2.0, 0.0)
    assert arm[:2] == pytest.approx([0.2, -0.1], abs=0.01)
    force, torque = means.obstacle_wrench('table')
    assert force == pytest.approx([0.0, 0.0, -3.0 * G], abs=3e-3 * G)
    assert torque == pytest.approx(np.cross(arm, (0.0, 0.0, -3.0 * G)), abs=0.01)


# ------------------------------------------------------------------------------------------ impact
@every_mode
@every_step
@pytest.mark.parametrize('every', [1, 7, 10_000])
def test_no_reader_loses_any_of_an_impact(mode, h, every):
    thrown = body(
        'box', name='body', mode=mode, mass=2.0, size=0.25, subdivisions=2,
        position=(0.0, 0.0, 0.6),
        initial_velocity_linear=(1.0, 0.0, -2.0), initial_velocity_angular=(1.0, 3.0, 0.5),
    )  # fmt: skip
    world = world_of(thrown, h=h)
    means, before = MeanWrenches(world), 2.0 * momentum(world)
    impulse, reaction, left = np.zeros(3), np.zeros(3), round(0.7 / h)
    seconds = left * h
    while left:
        ticks = min(every, left)
        world.step(ticks)
        left -= ticks
        impulse += ticks * h * means.contact_wrench('body')[0]
        reaction += ticks * h * means.obstacle_wrench('ground')[0]
    change = 2.0 * momentum(world) - before - 2.0 * seconds * world.gravity
    assert np.linalg.norm(change) > 5.0
    assert impulse == pytest.approx(change, abs=1e-6)
    assert reaction == pytest.approx(-change, abs=1e-6)
    assert world.contact_impulse('body').impulse == pytest.approx(change, abs=1e-6)
    assert world.obstacle_impulse('ground').impulse == pytest.approx(-change, abs=1e-6)


@every_mode
def test_readers_do_not_see_each_other_and_leave_no_trace(mode):
    def thrown():
        return world_of(box(mode=mode, initial_velocity_linear=(1.0, 0.0, -2.0)))

    world, silent = thrown(), thrown()
    often, seldom, total = MeanWrenches(world), MeanWrenches(world), np.zeros(3)
    for _ in range(60):
        world.step()
        silent.step()
        total += often.contact_wrench('body')[0]
        world.normal_forces('body'), world.obstacle_impulse('ground')
    assert seldom.contact_wrench('body')[0] == pytest.approx(total / 60)
    assert bytes_of(world) == bytes_of(silent)
    assert exchanged(world) == exchanged(silent)


def test_asked_twice_in_a_tick_a_reader_gets_that_of_the_tick():
    world = world_of(box())
    world.step(30)
    means = MeanWrenches(world)
    world.step(7)
    mean, again = means.obstacle_wrench('ground'), means.obstacle_wrench('ground')
    assert mean[0][2] != again[0][2]
    assert np.array_equal(again, world.obstacle_wrench('ground'))
    world.step()
    one = means.obstacle_wrench('ground')
    assert np.array(one) == pytest.approx(np.array(world.obstacle_wrench('ground')), rel=1e-9)


def test_the_mean_torque_is_that_about_the_moving_origin():
    # a box lies at the same place of a lift, far from the origin of the world
    lift = ObstacleConfig(
        name='lift', type='box', size=(0.5, 0.5, 0.1), velocity_linear=(0.0, 0.0, 0.5)
    )
    world = world_of(
        box(mass=1.0, position=(0.3, 0.0, 0.301), initial_velocity_linear=(0.0, 0.0, 0.5)),
        obstacles=(lift,),
    )
    world.step(120)
    means, torques = MeanWrenches(world), []
    for _ in range(240):
        world.step()
        torques.append(world.obstacle_wrench('lift')[1])
    torque = means.obstacle_wrench('lift')[1]
    assert torque == pytest.approx(np.mean(torques, axis=0), abs=1e-9)
    arm = centre(world) - world.obstacles[0].position
    assert arm[0] > 0.25
    assert torque == pytest.approx(np.cross(arm, (0.0, 0.0, -G)), abs=0.03)


# ------------------------------------------------------------------------------------------ asleep
@every_mode
def test_a_body_asleep_goes_on_to_weigh_on_the_ground(mode):
    world = world_of(box(mode=mode), box('next', mode=mode, mass=3.0, position=(2.0, 0.0, 0.3)))
    world.step(1500)
    assert all(map(world.is_asleep, world.names))
    for name, mass in (('body', 2.0), ('next', 3.0)):
        assert world.contact_wrench(name)[0] == pytest.approx([0.0, 0.0, mass * G])
    assert world.obstacle_wrench('ground')[0] == pytest.approx([0.0, 0.0, -5.0 * G], rel=1e-9)
    assert_balanced(world)
    means = MeanWrenches(world)
    world.step(100)
    assert all(map(world.is_asleep, world.names))
    assert means.obstacle_wrench('ground')[0] == pytest.approx([0.0, 0.0, -5.0 * G], rel=1e-9)
    assert means.contact_wrench('next')[0] == pytest.approx([0.0, 0.0, 3.0 * G], rel=1e-9)
    assert world.normal_forces('body').sum() == pytest.approx(2.0 * G, rel=1e-3)

    # one of them leaves, the other goes on
    world.set_state('body', velocities=np.tile((0.0, 0.0, 2.0), (len(world.positions('body')), 1)))
    world.step(10)
    assert world.is_asleep('next')
    assert world.obstacle_wrench('ground')[0] == pytest.approx([0.0, 0.0, -3.0 * G], rel=1e-9)
    assert not world.normal_forces('body').any()


@every_mode
def test_a_pile_asleep_weighs_on_the_ground(mode):
    pile = [
        box(f'level{level}', mode=mode, mass=1.0 + level, position=(0.0, 0.0, 0.21 + 0.41 * level))
        for level in range(3)
    ]
    world = world_of(*pile)
    while not all(map(world.is_asleep, world.names)) and world.time < 10.0:
        world.step(60)
    assert world.obstacle_wrench('ground')[0] == pytest.approx([0.0, 0.0, -6.0 * G], abs=1e-9)
    assert_balanced(world)


# -------------------------------------------------------------------------------- what is asked of
def test_edges_of_an_obstacle_count_for_it():
    # a ball rests on a thin wall, between its particles
    wall = ObstacleConfig(name='wall', type='box', size=(0.002, 1.0, 0.5))
    ball = body(name='body', mode='rigid', mass=1.0, position=(0.01, 0.0, 1.05), subdivisions=1)
    world = world_of(ball, obstacles=(wall,))
    world.step(60)
    assert_balanced(world)
    assert world.obstacle_impulse('wall').impulse[2] < -1.0


def test_points_are_asked_for_together():
    points = PointObstacles(np.array([(0.1, 0.0, 0.0), (-0.1, 0.1, 0.0), (-0.1, -0.1, 0.0)]), 0.09)
    world = world_of(box(mode='rigid', position=(0.0, 0.0, 0.31)), obstacles=())
    world.set_points(points)
    world.step(480)
    means = MeanWrenches(world)
    world.step(60)
    assert means.obstacle_wrench(None)[0] == pytest.approx([0.0, 0.0, -2.0 * G], abs=0.02)
    assert_balanced(world)


def test_obstacles_come_and_go():
    world = world_of(box())
    world.step(100)
    means = MeanWrenches(world)
    before = world.obstacle_impulse('ground').impulse
    stool = ObstacleConfig(name='stool', type='box', size=(0.3,) * 3, position=(2.0, 0.0, 0.3))
    world.add(stool)
    marker = ObstacleConfig(name='marker', type='sphere', position=(5.0, 0.0, 0.0))
    world.change_obstacles([ObstacleUpdate(('ns', 7), marker), ObstacleUpdate(('ns', 8), marker)])
    assert world.obstacle_keys == ('ground', 'stool', ('ns', 7), ('ns', 8), None)
    assert np.array_equal(world.obstacle_impulse('ground').impulse, before)
    world.add(box('late', mass=1.0, position=(2.0, 0.0, 0.9)))
    world.add(box('last', mass=1.0, position=(5.0, 0.0, 1.5)))
    world.step(240)
    force, _ = means.obstacle_wrench('stool')
    assert force == pytest.approx(world.obstacle_impulse('stool').impulse, rel=1e-9)  # in 1 s
    assert force[2] == pytest.approx(-G, abs=3.0)
    assert world.obstacle_key('marker') == ('ns', 7)
    assert world.obstacle_impulse(('ns', 7)).impulse[2] < -0.5
    assert_balanced(world)

    world.remove('ground')
    world.change_obstacles([ObstacleRemoval('ns', 7)])
    assert world.obstacle_keys == ('stool', ('ns', 8), None)
    assert world.obstacle_wrench('stool')[0][2] == pytest.approx(-G, rel=0.01)
    for name in ('ground', ('ns', 7), 'nothing'):
        with pytest.raises(ConfigError, match='there is no obstacle'):
            world.obstacle_wrench(name)
    # one of the same name later is another one
    world.add(GROUND)
    assert world.obstacle_impulse('ground').start == world.time
    world.step(24)
    mean = means.obstacle_wrench('ground')[0]
    assert mean == pytest.approx(world.obstacle_impulse('ground').impulse / 0.1)


def test_what_obstacles_felt_until_they_went_is_not_lost():
    """Also of those that came and went in between, of one key."""
    falls = box(mode='rigid', elasticity=1.0)
    world = world_of(falls, obstacles=(), gravity_magnitude=0.0)
    means = MeanWrenches(world)
    means.begin_period()
    begin, impulse, change = 0.0, np.zeros(3), np.zeros(3)

    def visit():
        """Let the body fall on a plate that comes, and jump."""
        nonlocal change
        world.set_twist('body', (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
        height = world.positions('body')[:, 2].min() - 0.001
        plate = ObstacleConfig(type='box', size=(1, 1, 0.1), position=(0, 0, height - 0.1))
        world.change_obstacles([ObstacleUpdate(('plate', 0), plate)])
        before = momentum(world)
        world.step(10)
        change = change + 2.0 * (momentum(world) - before)

    def go():
        world.change_obstacles([ObstacleRemoval('plate', 0)])

    def ask():
        nonlocal begin, impulse
        departed = means.departed()
        assert all(each.key == ('plate', 0) for each, _ in departed)
        wrenches = [wrench for _, wrench in departed]
        wrenches += [means.obstacle_wrench(key) for key in world.obstacle_keys]
        impulse = impulse + (world.time - begin) * sum(force for force, _ in wrenches)
        begin = world.time
        means.begin_period()
        return len(departed)

    visit(), go(), world.step(7)
    assert ask() == 1
    visit(), go(), visit(), go(), world.step(3)
    assert ask() == 2
    visit()
    assert ask() == 0
    go(), world.step()
    assert ask() == 1  # nothing more
    assert set(means._obstacles) == {None}
    assert change[2] == pytest.approx(4 * 2.0 * 2.0, rel=1e-3)
    assert impulse == pytest.approx(-change, abs=1e-9)
    visit(), go()
    world.reset()
    assert not means.departed()


# -------------------------------------------------------------------------------------------- time
def exchanged(world):
    """Return all that contacts have exchanged as something to compare."""
    of_bodies = [(world.contact_impulse(name), world.contact_wrench(name)) for name in world.names]
    of_obstacles = [
        (world.obstacle_impulse(key), world.obstacle_wrench(key)) for key in world.obstacle_keys
    ]
    return [
        (
            integral.impulse.tobytes(),
            integral.angular_impulse.tobytes(),
            integral.start,
            integral.end,
            np.array(wrench).tobytes(),
        )
        for integral, wrench in of_bodies + of_obstacles
    ] + [world.normal_forces(name).tobytes() for name in world.names]


@every_mode
@pytest.mark.parametrize('at', [20, 60, 1500], ids=('falling', 'landing', 'asleep'))
def test_a_snapshot_brings_back_what_was_exchanged(mode, at):
    world = world_of(box(mode=mode), box('next', mode=mode, position=(2.0, 0.0, 0.5)))
    world.step(at)

    def changed(world):
        world.add(ObstacleConfig(name='new', type='box', position=(9.0, 0.0, 0.0)))
        world.remove('next')
        world.step(30)

    assert_goes_on_bit_by_bit(world, 50, changed, exchanged)


def test_where_time_jumps_means_begin_anew():
    world = world_of(box(), box('next', position=(2.0, 0.0, 0.5)))
    means = MeanWrenches(world)
    world.step(100)
    saved = world.snapshot()
    world.step(100)
    means.obstacle_wrench('ground')
    world.restore(saved)
    world.step(150)
    # not a difference of integrals of two courses of events
    assert np.array_equal(means.contact_wrench('body'), world.contact_wrench('body'))
    before = world.contact_impulse('next')
    world.step(10)
    mean = world.contact_impulse('next').mean_since(before)
    assert np.array_equal(means.contact_wrench('next'), mean)

    world.reset()
    assert not world.contact_impulse('body').impulse.any()
    assert not world.obstacle_impulse('ground').impulse.any()
    assert not world.normal_forces('body').any()
    assert not means.obstacle_wrench('ground')[0].any()
    fresh = world_of(*world.config.bodies)
    for each in (world, fresh):
        each.step(100)
    assert exchanged(world) == exchanged(fresh)
