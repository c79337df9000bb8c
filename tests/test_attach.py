# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies attached to obstacles: how they move with them, and the forces that hold them."""

import dataclasses

from core_helpers import assert_goes_on_bit_by_bit, body, bytes_of, centre, floating
import numpy as np
import pytest
from scene_files import ROOT
from scipy.spatial.transform import Rotation

from softbody_ros.core import (
    ConfigError,
    MeanWrenches,
    ObstacleConfig,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.external_inputs import ObstacleRemoval, ObstacleUpdate
from softbody_ros.scene.robot import RobotState, move_robot, read_robot
from softbody_ros.timeline.stepper import Stepper

MODES = ('rigid', 'linear', 'quadratic')
SOFT = ('linear', 'quadratic')
GRAVITY = 9.81
RADIUS, MASS = 0.1, 0.2
BALL = make_surface('icosphere', RADIUS, 2)
TOP = int(np.argmax(BALL.vertices[:, 2]))
CUP = ObstacleConfig(
    name='cup', type='box', size=(0.05, 0.05, 0.05), position=(0.0, 0.0, 0.15)
)  # fmt: skip
REACH = {'attach_to': 'cup', 'attach_radius': 0.02}


def attached(mode='linear', cup=CUP, gravity=GRAVITY, h=1 / 240, **values):
    """Return a world of a ball at the origin, of which a cup holds what is within its reach."""
    config = body(BALL, mode=mode, mass=MASS, **(REACH | values))
    return World(
        WorldConfig(time_step=h, gravity_magnitude=gravity, bodies=(config,), obstacles=(cup,))
    )


def configured(world, **values):
    """Change parameters of the body."""
    (config,) = world.config.bodies
    changed = dataclasses.replace(config, **values)
    world.configure(dataclasses.replace(world.config, bodies=(changed,)))


def held(world):
    """Return the indices of the attached particles."""
    pins = world._bodies[0].pins
    return [] if pins is None else pins.particle.tolist()


def in_frame(world, particles):
    """Return where particles are in the frame of the cup, m."""
    cup = world.obstacles[0]
    return (world.positions('body')[particles] - cup.position) @ cup.rotation


def momentum(world):
    return MASS * world.rest_shape('body').weights @ world.velocities('body')


# --------------------------------------------------------------------------------------- motion
def test_what_is_within_the_radius_is_held_and_keeps_its_place_on_a_moving_obstacle():
    for mode in MODES:
        world = attached(mode)
        inside = np.flatnonzero(
            np.linalg.norm(np.maximum(np.abs(BALL.vertices - CUP.position) - 0.05, 0.0), axis=1)
            <= 0.02
        )
        assert held(world) == inside.tolist()
        assert 5 < len(inside) < 50
        place = in_frame(world, inside)
        world.move_obstacle('cup', CUP.position, None, (0.3, 0.0, 0.1), (0.5, -1.0, 2.0))
        for _ in range(10):
            world.step(24)
            assert in_frame(world, inside) == pytest.approx(place, abs=1e-14)
            cup = world.obstacles[0]
            moving = cup.velocity_at(world.positions('body')[inside])
            assert world.velocities('body')[inside] == pytest.approx(moving, abs=1e-13)
        # and the rest with them
        assert np.linalg.norm(centre(world) - cup.position) == pytest.approx(0.15, abs=0.03)


@pytest.mark.parametrize('how', [{'attach_indices': (3, 5)}, {'attach_box': (-1, -1, 0, 1, 1, 1)}])
def test_vertices_can_be_named_at_any_distance(how):
    world = attached(attach_radius=0.0, cup=dataclasses.replace(CUP, position=(2, 0, 0)), **how)
    expected = [3, 5]
    if 'attach_box' in how:
        expected = np.flatnonzero(BALL.vertices[:, 2] >= 0.0).tolist()
    assert held(world) == expected


@pytest.mark.parametrize('mode', MODES)
def test_it_is_let_go_with_the_velocity_that_it_had(mode):
    world = attached(mode, gravity=0.0)
    world.move_obstacle('cup', CUP.position, None, (0.3, 0.0, 0.1), (0.0, 1.0, 0.0))
    world.step(60)
    before, x = momentum(world), world.positions('body')
    configured(world, attach_to='')
    assert held(world) == []
    assert np.array_equal(momentum(world), before)
    world.move_obstacle('cup', (5.0, 0.0, 0.0))
    world.step(60)
    assert momentum(world) == pytest.approx(before, abs=1e-14)
    assert centre(world) == pytest.approx(
        world.rest_shape('body').weights @ x + 60 / 240 * before / MASS, abs=1e-13
    )
    assert not world.pin_wrench('body')[0].any()
    assert not world.obstacle_wrench('cup')[0].any()


@pytest.mark.parametrize('mode', MODES)
def test_a_small_jump_of_the_obstacle_is_followed_and_a_large_one_places_the_body(mode):
    for step, carried in ((0.01, False), (3.0, True)):
        world = attached(mode, gravity=0.0)
        particles, x = held(world), world.positions('body')
        place = in_frame(world, particles)
        turn = Rotation.from_rotvec((0.0, 0.0, step))
        world.move_obstacle('cup', np.array(CUP.position) + (step, 0.0, 0.0), turn.as_quat())
        expected = turn.apply(x - CUP.position) + CUP.position + (step, 0.0, 0.0)
        moved = np.abs(world.positions('body') - expected).max() < 1e-14
        assert moved == (carried or mode == 'rigid')
        for _ in range(240):
            world.step()
            assert in_frame(world, particles) == pytest.approx(place, abs=1e-14)
            # nothing is flung about
            assert np.abs(world.positions('body') - expected).max() < 0.025
        if carried or mode == 'rigid':
            assert np.abs(world.positions('body') - expected).max() < 1e-13


@pytest.mark.parametrize('mode', SOFT)
def test_a_body_lags_behind_a_hand_that_accelerates_by_as_much_as_it_sags(mode):
    # an accelerated frame is one with another gravity
    sagging, lagging = attached(mode), attached(mode, gravity=0.0)
    h, speed = 1 / 240, 0.0
    for _ in range(960):
        position = lagging.obstacles[0].position
        # what the kernels get is a velocity for each tick
        lagging.move_obstacle('cup', position, None, (0.0, 0.0, speed))
        lagging.step()
        sagging.step()
        speed += GRAVITY * h
    particles = np.arange(len(BALL.vertices))
    difference = in_frame(lagging, particles) - in_frame(sagging, particles)
    sag = np.abs(in_frame(sagging, particles) - (BALL.vertices - CUP.position)).max()
    assert sag > 1e-3
    # it is accelerated at the start of each tick, gravity acts all the time
    assert np.abs(difference).max() < 0.51 * GRAVITY * h**2 + 0.02 * sag


# --------------------------------------------------------------------------------------- forces
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('side', [False, True])
def test_in_rest_the_obstacle_carries_the_weight_and_its_moment(mode, side):
    # held at its top, or from one side like a cantilever
    cup = dataclasses.replace(CUP, position=(0.15, 0.0, 0.0)) if side else CUP
    world = attached(mode, cup, stiffness=1.0)
    world.step(1200)
    assert world.is_asleep('body')
    force, torque = world.pin_wrench('body')
    assert force == pytest.approx((0.0, 0.0, MASS * GRAVITY), abs=1e-12)
    assert torque == pytest.approx(np.zeros(3), abs=1e-12)
    force, torque = world.obstacle_wrench('cup')
    weight = np.array([0.0, 0.0, -MASS * GRAVITY])
    assert force == pytest.approx(weight, abs=1e-12)
    arm = centre(world) - cup.position
    assert torque == pytest.approx(np.cross(arm, weight), abs=1e-12)
    if side:
        assert abs(torque[1]) > 0.14 * MASS * GRAVITY
    assert not world.contact_wrench('body')[0].any()


def test_what_cannot_yield_to_what_it_is_held_in_feels_nothing_of_it():
    # edges of a box are in a rigid ball that a hand holds: there is no force that parts them
    wedge = ObstacleConfig(
        name='wedge', type='box', size=(0.1, 0.1, 0.05), position=(0.0, 0.05, -0.12)
    )
    config = body(BALL, mode='rigid', mass=MASS, **REACH)
    world = World(WorldConfig(bodies=(config,), obstacles=(CUP, wedge)))
    assert wedge.position[2] + wedge.size[2] > -RADIUS
    world.step(240)
    assert world.obstacle_wrench('cup')[0] == pytest.approx((0, 0, -MASS * GRAVITY), abs=1e-12)
    assert not world.obstacle_wrench('wedge')[0].any()


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('h', [1 / 60, 1 / 240, 1 / 1000])
def test_all_that_acts_on_a_body_is_the_change_of_its_momenta(mode, h):
    # over a while in which a hand throws it about; ball and box touch as well
    world = attached(mode, h=h)
    means = MeanWrenches(world)
    start, seconds = momentum(world), 0.0
    for linear, angular in (
        ((0.3, 0.0, 0.5), (2.0, 0.0, 0.0)),
        ((0.0, -0.4, 0.0), (0.0, 3.0, 1.0)),
    ):
        cup = world.obstacles[0]
        turn = Rotation.from_matrix(cup.rotation).as_quat()
        world.move_obstacle('cup', cup.position, turn, linear, angular)
        world.apply_wrench('body', (0.1, 0.2, 0.3), (0.01, 0.0, 0.02), 0.1)
        world.step(round(0.25 / h))
        seconds += 0.25
    by_gravity = seconds * MASS * GRAVITY * np.array([0.0, 0.0, -1.0])
    applied = 0.2 * np.array([0.1, 0.2, 0.3])
    change = momentum(world) - start
    pins, contacts = world.pin_impulse('body'), world.contact_impulse('body')
    assert pins.impulse + contacts.impulse + by_gravity + applied == pytest.approx(
        change, abs=1e-12
    )
    # action = reaction, of means over all these ticks, too
    on_cup = world.obstacle_impulse('cup')
    assert on_cup.impulse == pytest.approx(-pins.impulse - contacts.impulse, abs=1e-12)
    force, _ = means.obstacle_wrench('cup')
    assert force == pytest.approx(on_cup.impulse / seconds, abs=1e-9)
    assert np.linalg.norm(pins.impulse) > 0.1


@pytest.mark.parametrize('mode', MODES)
def test_on_a_circle_the_hand_feels_the_centripetal_force(mode):
    rate, arm = 4.0, 0.3
    cup = dataclasses.replace(CUP, position=(0.0, 0.0, 0.0), size=(0.01, 0.01, 0.01))
    config = body(
        BALL, mode=mode, mass=MASS, position=(arm, 0.0, 0.0), stiffness=1.0, attach_to='cup',
        attach_indices=tuple(range(0, len(BALL.vertices), 3)),
    )  # fmt: skip
    world = World(WorldConfig(gravity_magnitude=0.0, bodies=(config,), obstacles=(cup,)))
    world.move_obstacle('cup', (0.0, 0.0, 0.0), None, (0.0, 0.0, 0.0), (0.0, 0.0, rate))
    world.apply_initial_velocity()
    world.set_state(
        'body', velocities=np.cross((0.0, 0.0, rate), world.positions('body'))
    )  # fmt: skip
    forces = []
    for _ in range(480):
        world.step()
        force, torque = world.obstacle_wrench('cup')
        outwards = centre(world) / np.linalg.norm(centre(world))
        forces.append((force @ outwards, np.linalg.norm(force), np.linalg.norm(torque)))
    expected = MASS * rate**2 * np.linalg.norm(centre(world))
    outwards, size, torque = np.mean(forces[240:], axis=0)
    assert outwards == pytest.approx(expected, rel=1e-3)
    assert size == pytest.approx(expected, rel=1e-3)
    assert torque < 0.01 * expected * arm


# ------------------------------------------------------------------------------- change and state
def test_nothing_in_reach_is_one_sentence_and_nothing_has_changed():
    world = attached(attach_to='', cup=dataclasses.replace(CUP, position=(0.0, 0.0, 0.4)))
    world.step(3)
    before = bytes_of(world)
    for values, sentence in (
        ({'attach_to': 'cup'}, r'body.attach.radius is 0.02: no vertex is so near to cup, .* 0.2'),
        (
            {'attach_to': 'cap'},
            r"attach.to is 'cap', but there is no such obstacle: did you mean cup",
        ),
        ({'attach_to': 'cup', 'attach_radius': 0.0}, 'no vertex is named: set attach.radius'),
        ({'attach_to': 'cup', 'pins_indices': (1,)}, 'pins hold this body: clear pins.indices'),
        ({'attach_to': 'cup', 'attach_indices': (999,)}, 'attach.indices has 999: the mesh has'),
        ({'attach_to': 'cup', 'attach_box': (5, 5, 5, 6, 6, 6)}, 'attach.box is .* no vertex is'),
    ):
        with pytest.raises(ConfigError, match=sentence):
            configured(world, **values)
    assert bytes_of(world) == before
    # at the start, too
    with pytest.raises(ConfigError, match='no vertex is so near to cup'):
        attached(cup=dataclasses.replace(CUP, position=(0.0, 0.0, 0.4)))


def test_it_takes_hold_at_the_moment_when_it_is_told_to():
    world = attached(attach_to='')
    world.step(24)
    assert held(world) == []
    place = world.positions('body')
    world.move_obstacle('cup', centre(world) + (0.0, 0.0, 0.15))
    configured(world, attach_to='cup')
    particles = held(world)
    assert particles
    # other parameters do not change what is held
    configured(world, friction=0.1, stiffness=0.9)
    world.step(24)
    assert held(world) == particles
    assert world.positions('body')[particles] == pytest.approx(place[particles], abs=1e-15)


def test_a_reset_holds_what_is_in_reach_at_the_start():
    world = attached()
    before, particles = world.positions('body'), held(world)
    configured(world, attach_to='')
    world.step(100)
    configured(world, attach_to='')
    world.reset()
    assert held(world) == []
    configured(world, attach_to='cup')
    assert held(world) == particles
    world.move_obstacle('cup', CUP.position, None, (0.0, 0.0, 1.0))
    world.step(100)
    world.reset()
    assert held(world) == particles
    assert np.array_equal(world.positions('body'), before)


def test_an_obstacle_that_is_removed_lets_go():
    world = attached()
    world.step(10)
    world.remove('cup')
    assert held(world) == []
    speed = momentum(world)
    world.step(24)
    assert momentum(world) == pytest.approx(
        speed + 0.1 * MASS * GRAVITY * np.array([0, 0, -1]), abs=1e-12
    )


def test_received_obstacles_hold_by_namespace_and_id_and_move_it():
    world = attached(attach_to='', cup=dataclasses.replace(CUP, position=(9.0, 0.0, 0.0)))
    config = ObstacleConfig(name='marker', type='box', size=CUP.size, position=CUP.position)
    world.change_obstacles([ObstacleUpdate(('hand', 3), config, stamp=10**9)])
    configured(world, attach_to='hand/3')
    particles = held(world)
    place = world.positions('body')[particles]
    assert particles
    moved = config.moved(position=(0.0, 0.0, 0.16))
    world.change_obstacles([ObstacleUpdate(('hand', 3), moved, stamp=10**9 + 10**8)])
    world.step(12)  # 0.05 s, at 0.1 m/s
    assert world.positions('body')[particles] == pytest.approx(place + (0, 0, 0.015), abs=1e-12)
    world.change_obstacles([ObstacleRemoval('hand', 3)])
    assert held(world) == []


@pytest.mark.parametrize('mode', MODES)
def test_a_link_of_a_robot_holds_with_all_its_shapes(mode):
    robot, _ = read_robot((ROOT / 'config' / 'gripper.urdf').read_text(), ['left_finger', 'palm'])
    config = body(BALL, name='ball', mode=mode, mass=MASS, position=(0.0, 0.0, 0.0))
    world = World(WorldConfig(bodies=(config,), obstacles=()))

    def move(hoist, speed):
        values = {'hoist': (hoist, speed), 'grip': (0.11, 0.0)}
        q, v = np.array([values[name] for name in robot.joints]).T
        state = RobotState(q, v, approach=0.0)
        move_robot(world, robot, {robot.root: state}, 10.0)

    move(0.0, 0.0)
    world.configure(
        dataclasses.replace(
            world.config,
            bodies=(dataclasses.replace(config, attach_to='left_finger', attach_radius=0.06),),
        )
    )
    finger = [item for item in world.obstacles if item.config.name == 'left_finger']
    assert len(finger) > 1
    distance = np.min([item.closest(world.positions('ball'))[0] for item in finger], axis=0)
    assert held(world) == np.flatnonzero(distance <= 0.06).tolist()
    place = world.positions('ball')[held(world)]
    move(0.0, 0.1)
    world.step(480)
    assert world.positions('ball')[held(world)] == pytest.approx(place + (0.0, 0.0, 0.2), abs=1e-9)
    move(0.2, 0.0)
    world.step(960)
    link = next(link for link in robot.links if link.name == 'left_finger')
    present = world.external_inputs.dynamic_obstacles
    force, _ = link.wrench(present, world.obstacle_wrench)
    assert force == pytest.approx((0.0, 0.0, -MASS * GRAVITY), abs=1e-3)


@pytest.mark.parametrize('mode', MODES)
def test_a_snapshot_goes_on_bit_by_bit_with_what_was_held_then(mode):
    world = attached(mode, attach_to='')
    world.step(5)
    free = world.snapshot()
    world.move_obstacle('cup', centre(world) + (0.0, 0.0, 0.15), None, (0.1, 0.0, 0.2))
    configured(world, attach_to='cup')
    world.step(20)
    config, (state,) = world.config, world.snapshot().states
    for now, then in zip(world.pin_wrench('body'), state.holding, strict=True):
        assert np.array_equal(now, MASS * then)

    def let_go(world):
        world.restore(free)  # keeps the parameters: so it takes hold of what is in reach there
        configured(world, attach_to='')
        world.step(50)
        assert held(world) == []
        world.configure(config, lenient=True)

    assert_goes_on_bit_by_bit(
        world, 30, let_go,
        lambda world: (bytes_of(world), held(world), np.array(world.pin_wrench('body')).tobytes()),
    )  # fmt: skip


def test_a_body_can_be_added_with_what_holds_it():
    world = World(WorldConfig(bodies=(), obstacles=()))
    stepper = Stepper(world, {})
    far = body(BALL, name='far', position=(0.0, 0.0, 3.0), **REACH)
    near = body(BALL, name='near', **REACH)
    with pytest.raises(ConfigError, match=r'far\.attach\.radius is 0\.02: no vertex is so near'):
        stepper.configure(dataclasses.replace(world.config, bodies=(far,), obstacles=(CUP,)))
    with pytest.raises(ConfigError, match='there is no such obstacle'):
        stepper.configure(dataclasses.replace(world.config, bodies=(near,)))
    assert world.names == ()
    stepper.configure(dataclasses.replace(world.config, bodies=(near,), obstacles=(CUP,)))
    assert held(world)
    world.step(240)
    assert abs(centre(world, 'near')[2]) < 0.05
    with pytest.raises(ConfigError, match=r'far\.attach\.radius is 0\.02: no vertex is so near'):
        world.add(far)
    assert world.names == ('near',)


def test_a_clock_that_goes_back_lets_go_and_takes_hold_again_bit_by_bit():
    world = attached(attach_to='')
    free = world.config
    stepper = Stepper(world, {})
    tick = round(1e9 / 240)

    def run_to(ticks):
        while world.tick < ticks:
            list(stepper.advance(round(ticks * 1e9 / 240) + 1, drop_overload=False))

    stepper.reanchor(0)
    run_to(10)
    stepper.act(
        lambda world: world.move_obstacle(
            'cup', (0.0, 0.0, 0.15 - 0.5 * GRAVITY / 576), None, (0.0, 0.0, 0.1)
        )
    )
    (config,) = free.bodies
    grasping = dataclasses.replace(
        world.config, bodies=(dataclasses.replace(config, attach_to='cup'),)
    )
    stepper.configure(grasping)
    particles = held(world)
    assert particles
    run_to(100)
    states = {}
    for ticks in range(101, 161):
        run_to(ticks)
        states[ticks] = bytes_of(world)
    stepper.rewind(130 * tick)
    while stepper.replaying:
        run_to(130)
    assert held(world) == particles
    for ticks in range(131, 161):
        run_to(ticks)
        assert bytes_of(world) == states[ticks]
    # before it took hold: it does again, of what is in reach, as the parameters say now
    stepper.rewind(5 * tick)
    run_to(6)
    assert np.isfinite(world.positions('body')).all()


def test_a_body_asleep_wakes_when_its_hand_moves():
    world = attached('linear', attach_radius=0.0, attach_indices=tuple(range(0, 160, 4)))
    world.step(1200)
    assert world.is_asleep('body')
    total = world.obstacle_impulse('cup').impulse
    world.step(24)  # it goes on to weigh
    assert world.obstacle_impulse('cup').impulse - total == pytest.approx(
        (0.0, 0.0, -0.1 * MASS * GRAVITY), abs=1e-12
    )
    world.move_obstacle('cup', CUP.position, None, (0.0, 0.0, 0.1))
    world.step()
    assert not world.is_asleep('body')
    world.step(239)
    assert centre(world)[2] == pytest.approx(0.1, abs=0.01)
    assert not world.is_asleep('body')


@pytest.mark.parametrize('is_received', [False, True])
def test_a_body_asleep_falls_when_its_hand_is_gone(is_received):
    far = dataclasses.replace(CUP, position=(3.0, 0.0, 3.0))
    hold = {'attach_radius': 0.0, 'attach_indices': (TOP,)}
    world = World(WorldConfig(bodies=(body(BALL, mass=MASS, damping=1.0),), obstacles=(far,)))
    if is_received:
        world.change_obstacles([ObstacleUpdate(('hand', 1), far)])
    configured(world, attach_to='hand/1' if is_received else 'cup', **hold)
    for _ in range(100):
        world.step(48)
        if world.is_asleep('body'):
            break
    assert world.is_asleep('body')
    before = centre(world)[2]
    if is_received:
        world.change_obstacles([ObstacleRemoval('hand', 1)])
    else:
        world.remove('cup')
    assert held(world) == []
    world.step(60)
    assert centre(world)[2] < before - 0.1


def test_pins_report_what_they_carry():
    world = floating(
        body(BALL, name='one', mass=MASS, pins_indices=(TOP,), position=(0.0, 0.0, 0.0)),
        body(BALL, name='two', mass=2.0, pins_box=(-1, -1, 0, 1, 1, 1), position=(3.0, 0.0, 0.0)),
        body(BALL, name='free', position=(6.0, 0.0, 0.0)),
        h=1 / 240,
        gravity=GRAVITY,
    )
    world.step(4800)
    for name, mass in (('one', MASS), ('two', 2.0)):
        force, torque = world.pin_wrench(name)
        assert force == pytest.approx((0.0, 0.0, mass * GRAVITY), abs=1e-3 * mass)
        assert torque == pytest.approx(np.zeros(3), abs=1e-4)
    assert not np.any(world.pin_wrench('free'))


def test_the_config_of_a_world_says_what_is_held():
    config = body(BALL, attach_to='cup', attach_radius=0.02, attach_indices=[4, -1])
    assert config.attach_indices == (4,)
    with pytest.raises(ConfigError, match=r'attach\.radius is -1\.0: it must be from 0'):
        body(BALL, attach_radius=-1.0)
    with pytest.raises(ConfigError, match='no such obstacle: there are none'):
        World(WorldConfig(bodies=(config,), obstacles=()))
