# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact of rigid bodies: stacks, slopes, grips, squeezes and impacts with known outcomes."""

import dataclasses
import itertools
import math

from core_helpers import angular_momentum, centre, floating, momentum
from core_helpers import body as body_config
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import BodyConfig, ObstacleConfig, Surface, World, WorldConfig, step
from softbody_ros.core.contact.detection import find_rows
from softbody_ros.core.contact.workspace import Workspace

G = 9.81
STEPS = (1 / 60, 1 / 240, 1 / 1000)


def block(name='block', **values):
    facts = {
        'mesh': 'box', 'mode': 'rigid', 'size': 0.2, 'subdivisions': 1, 'friction': 0.5,
        'friction_model': 'coulomb', 'elasticity': 0.0,
    } | values  # fmt: skip
    return BodyConfig(name=name, **facts)


def on_ground(*bodies, h=1 / 240, obstacles=(), **values):
    ground = ObstacleConfig(name='ground', **values)
    return World(WorldConfig(time_step=h, bodies=bodies, obstacles=(ground, *obstacles)))


def tilt(world, name):
    """Angle between the z axis of a body and the vertical, degrees."""
    return math.degrees(math.acos(min(world.rigid_fit(name).rotation[2, 2], 1.0)))


# --------------------------------------------------------------------------------------- stacks
@pytest.mark.parametrize('offset', [0.0, 0.05])
@pytest.mark.parametrize('ratio', [1.0, 100.0])
@pytest.mark.parametrize('h', STEPS)
def test_a_heavy_box_stands_on_a_light_one(ratio, offset, h):
    lower = block('lower', position=(0.0, 0.0, 0.2))
    upper = block('upper', position=(offset, 0.0, 0.6), mass=ratio)
    world = on_ground(lower, upper, h=h)
    world.step(round(1.0 / h))
    force = world.contact_wrench('upper')[0]
    assert force == pytest.approx((0.0, 0.0, ratio * G), abs=1e-3 * ratio * G)
    carried = world.obstacle_wrench('ground')[0]
    assert carried == pytest.approx((0.0, 0.0, -(1.0 + ratio) * G), abs=1e-3 * (1 + ratio) * G)
    for name, height in (('lower', 0.2), ('upper', 0.6)):
        assert tilt(world, name) < 0.01
        assert centre(world, name)[2] == pytest.approx(height, abs=1e-4)
    world.step(round(1.0 / h))
    assert world.is_asleep('lower')
    assert world.is_asleep('upper')


def test_a_tower_of_ten_cubes_stands():
    world = on_ground(*(block(f'cube{i}', position=(0.0, 0.0, 0.2 + 0.4 * i)) for i in range(10)))
    world.step(480)
    for i in range(10):
        assert centre(world, f'cube{i}') == pytest.approx((0.0, 0.0, 0.2 + 0.4 * i), abs=1e-3)
    assert all(world.is_asleep(name) for name in world.names)


# ------------------------------------------------------------------------------------- friction
def on_slope(degrees, friction, h, mesh='box'):
    """Return a world with a box, or ball, on a slope about y, and the direction downhill."""
    turn = Rotation.from_euler('y', degrees, degrees=True)
    size = {'size': 0.2, 'position': tuple(turn.apply((0.0, 0.0, 0.2)))}
    facts = {'orientation': tuple(turn.as_quat())}
    world = on_ground(block(mesh=mesh, friction=friction, **size, **facts), h=h, **facts)
    return world, turn.apply((1.0, 0.0, 0.0))


@pytest.mark.parametrize('h', STEPS)
@pytest.mark.parametrize('friction', [0.2, 0.5, 0.8])
def test_a_box_sticks_or_slides_on_a_slope_as_coulomb_says(friction, h):
    limit = math.degrees(math.atan(friction))
    world, downhill = on_slope(limit - 0.5, friction, h)
    world.step(round(0.5 / h))
    before = centre(world, 'block')
    world.step(round(1.0 / h))
    assert np.linalg.norm(centre(world, 'block') - before) < 1e-9  # no creep
    world, downhill = on_slope(limit + 2.0, friction, h)
    world.step(round(0.5 / h))
    before = momentum(world, 'block') @ downhill
    world.step(round(0.5 / h))
    angle = math.radians(limit + 2.0)
    expected = G * (math.sin(angle) - friction * math.cos(angle))
    ticks = round(0.5 / h) * h
    assert (momentum(world, 'block') @ downhill - before) / ticks == pytest.approx(
        expected, rel=1e-4
    )


def test_a_disc_is_stopped_by_friction_as_under_even_pressure():
    speed, friction, radius = 10.0, 0.3, 0.2
    disc = block(mesh='cylinder', size=radius, subdivisions=2, friction=friction)
    world = on_ground(disc)
    surface = world.rest_shape('block').surface
    flat = surface.vertices * (1.0, 1.0, 0.1)
    disc = block(
        mesh=type(surface)(flat, surface.faces), friction=friction,
        position=(0.0, 0.0, 0.1 * radius), initial_velocity_angular=(0.0, 0.0, speed),
    )  # fmt: skip
    world = on_ground(disc)
    rest = world.rest_shape('block')
    inertia = rest.weights @ (flat[:, :2] ** 2).sum(axis=1)
    expected = inertia * speed / (friction * G * 2.0 / 3.0 * radius)
    ticks = 0
    while world.rigid_fit('block').angular_velocity[2] > 0.02 * speed:
        world.step()
        ticks += 1
        assert ticks < 2000
    assert ticks / 240 == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize('h', STEPS)
def test_a_belt_takes_a_box_along_with_mu_g(h):
    belt = {'type': 'box', 'size': (5.0, 5.0, 0.1), 'position': (0.0, 0.0, -0.1)}
    world = on_ground(block(position=(0.0, 0.0, 0.2)), h=h, **belt)
    world.step(round(0.1 / h))
    world.move_obstacle('ground', belt['position'], linear=(1.0, 0.0, 0.0))
    ticks = round(0.1 / h)
    world.step(ticks)
    assert momentum(world, 'block')[0] == pytest.approx(0.5 * G * ticks * h, rel=0.01)
    world.step(round(0.4 / h))
    assert momentum(world, 'block')[0] == pytest.approx(1.0, rel=1e-3)


# ------------------------------------------------------------------------------ fingers, plates
def fingers(gap):
    return [
        ObstacleConfig(name=name, type='box', size=(0.02, 0.1, 0.1),
                       position=(sign * (gap + 0.02), 0.0, 1.0))
        for name, sign in (('left', -1.0), ('right', 1.0))
    ]  # fmt: skip


def move(world, speed, lift=0.0):
    for name, sign in (('left', 1.0), ('right', -1.0)):
        now = next(each for each in world.obstacles if each.config.name == name)
        world.move_obstacle(name, now.position, linear=(sign * speed, 0.0, lift))


@pytest.mark.parametrize('h', STEPS)
@pytest.mark.parametrize('depth', [0.001, 0.01])
@pytest.mark.parametrize('subdivisions', [2, pytest.param(3, marks=pytest.mark.slow)])
def test_fingers_squeeze_a_rigid_ball_symmetrically_lift_and_release_it(subdivisions, depth, h):
    ball = block(mesh='icosphere', size=0.05, subdivisions=subdivisions, mass=0.2,
                 friction=0.8, position=(0.0, 0.0, 1.0))  # fmt: skip
    obstacles = (ObstacleConfig(name='table', type='box', size=(0.2, 0.2, 0.1),
                                position=(0.0, 0.0, 0.85)), *fingers(0.051))  # fmt: skip
    world = World(WorldConfig(time_step=h, bodies=(ball,), obstacles=obstacles))
    ticks = round(0.2 / h)
    move(world, (0.001 + depth) / (ticks * h))
    world.step(ticks)
    move(world, 0.0)
    world.step(round(0.2 / h))
    # what has no room is neither thrown nor are forces without bound
    assert np.linalg.norm(centre(world, 'block') - (0.0, 0.0, 1.0)) < 1e-4
    forces = [world.obstacle_wrench(name)[0][0] for name in ('left', 'right')]
    assert forces[0] == pytest.approx(-forces[1], rel=1e-4)
    assert 100.0 < forces[1] < 1e7
    move(world, 0.0, lift=0.1)
    world.step(round(0.5 / h))
    move(world, 0.0)
    lifted = centre(world, 'block')
    world.step(round(0.5 / h))
    assert lifted == pytest.approx((0.0, 0.0, 1.0 + 0.1 * round(0.5 / h) * h), abs=1e-4)
    assert np.linalg.norm(centre(world, 'block') - lifted) < 1e-8  # no slip
    move(world, -0.1)
    world.step(round(0.2 / h))
    assert np.abs(momentum(world, 'block')[:2]).max() < 1e-3
    assert centre(world, 'block')[2] < lifted[2] - 0.04


@pytest.mark.parametrize('mode', ['rigid', 'linear', 'quadratic'])
def test_what_two_fingers_meet_at_once_at_the_end_of_a_tick_stays_between_them(mode):
    # by rounding, one of them is a tick later, and must not find a ball that moves already
    ball = block(mesh='icosphere', size=0.05, subdivisions=2, mass=0.2, mode=mode,
                 position=(0.0, 0.0, 0.0))  # fmt: skip
    values = {'time_step': 0.001, 'gravity_magnitude': 0.0}
    world = World(WorldConfig(bodies=(ball,), obstacles=fingers(0.052), **values))
    for tick in range(60):
        gap = 0.002 - 0.05 * tick * 0.001
        for name, sign in (('left', -1.0), ('right', 1.0)):
            place = sign * (0.05 + gap + 0.02) - 1e-15, 0.0, 0.0
            world.move_obstacle(name, place, linear=(-0.05 * sign, 0.0, 0.0))
        world.step()
        left, right = (world.obstacle_wrench(name)[0][0] for name in ('left', 'right'))
        assert left == pytest.approx(-right, rel=1e-7, abs=1e-9)
    assert left < 0.0


COMPLIANT = 2e-4
"""Speed, m/s, that the compliance of contacts for velocities takes from 1 m/s at most."""


def row_of_cubes(gap, h, velocities, masses=None, elasticity=1.0):
    """Return a world of cubes of 20 cm along x, without gravity and friction."""
    cubes = [
        block(f'cube{i}', size=0.1, position=((0.2 + gap) * i, 0.0, 0.0), friction=0.0,
              elasticity=elasticity, mass=masses[i] if masses else 1.0,
              initial_velocity_linear=(float(velocity), 0.0, 0.0))
        for i, velocity in enumerate(velocities)
    ]  # fmt: skip
    return floating(*cubes, h=h)


def speeds_along(world):
    return [momentum(world, name)[0] for name in world.names]


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
@pytest.mark.parametrize('gap', [0.0, 1e-3])
@pytest.mark.parametrize('coming', [1, 2, 3])
def test_as_many_cubes_leave_a_row_as_come(coming, gap, h):
    # Newton's cradle, of shapes that meet exactly along their row
    world = row_of_cubes(gap, h, [1.0] * coming + [0.0] * 4)
    world.step(round(0.2 / h))
    assert speeds_along(world) == pytest.approx([0.0] * 4 + [1.0] * coming, abs=COMPLIANT)


@pytest.mark.parametrize('elasticity', [0.6, 0.8, 1.0])
def test_impacts_that_go_on_lose_what_single_ones_do(elasticity):
    # those of pairs, one after the other, as each cube is slower than the next one after that
    masses, speed, h = [1.0, 0.5, 0.25, 0.125], 1.0, 1 / 240
    world = row_of_cubes(0.0, h, [speed, 0.0, 0.0, 0.0], masses, elasticity)
    world.step(round(0.1 / h))
    expected = []
    for one, two in itertools.pairwise(masses):
        total = one + two
        expected.append(speed * (one - elasticity * two) / total)
        speed *= (1.0 + elasticity) * one / total
    expected.append(speed)
    assert expected == sorted(expected)
    assert speeds_along(world) == pytest.approx(expected, abs=COMPLIANT)


@pytest.mark.parametrize('elasticity', [0.4, 1.0])
def test_impacts_from_both_sides_go_on_alike(elasticity):
    world = row_of_cubes(0.0, 1 / 240, [1.0, 0.0, 0.0, 0.0, -1.0], elasticity=elasticity)
    world.step(40)
    found = np.array(speeds_along(world))
    assert found == pytest.approx(-found[::-1], abs=1e-9)
    energy = (found**2).sum() / 2.0
    assert energy <= 1.0 + 1e-12
    assert (energy > 1.0 - 4.0 * COMPLIANT) == (elasticity == 1.0)


@pytest.mark.parametrize('speed', [5.0, 20.0])
@pytest.mark.parametrize('h', [1 / 240, 1 / 1000])
def test_no_particle_is_left_in_a_wall_by_an_impact(h, speed):
    # many particles of a facet are about to touch at once, and the ball hardly turns by any
    wall = ObstacleConfig(name='wall', type='box', size=(0.01, 1.0, 1.0), position=(0.01, 0, 0))
    ball = block(mesh='icosphere', size=0.05, subdivisions=3, position=(-0.3, 0.013, 0.007),
                 initial_velocity_linear=(speed, 0.0, 0.0))  # fmt: skip
    world = World(
        WorldConfig(time_step=h, gravity_magnitude=0.0, bodies=(ball,), obstacles=(wall,))
    )
    foremost = -math.inf
    while world.time < 0.3 / speed + 0.02:
        world.step()
        foremost = max(foremost, world.positions('block')[:, 0].max())
    assert -0.05 < foremost < 1e-4 * 0.05


@pytest.mark.parametrize('margin', [0.95, 1.05])
def test_a_grip_holds_exactly_when_friction_carries_the_weight(margin):
    # a heavy slider on a horizontal rail of gravity presses on the ball: a known normal force
    friction, mass = 0.5, 1.0
    wall = ObstacleConfig(name='wall', type='box', size=(0.1, 1.0, 1.0), position=(-0.3, 0.0, 0.0))
    push = margin * mass * G / friction
    world = World(
        WorldConfig(bodies=(block(friction=friction, mass=mass, position=(0.0, 0.0, 0.0)),),
                    obstacles=(wall,))
    )  # fmt: skip
    world.apply_wrench('block', (-push, 0.0, 0.0), (0.0, 0.0, 0.0), 10.0)
    world.step(120)
    fallen = -centre(world, 'block')[2]
    if margin > 1.0:
        assert fallen < 1e-6
    else:
        assert fallen == pytest.approx(0.5 * G * (1.0 - margin) * 0.25, rel=0.02)


def test_a_box_between_planes_that_close_stays_where_it_is():
    planes = [
        ObstacleConfig(name=name, orientation=tuple(Rotation.from_euler('y', angle).as_quat()),
                       position=(-sign * 0.21, 0.0, 0.0), velocity_linear=(sign * 0.05, 0.0, 0.0))
        for name, sign, angle in (('left', 1.0, np.pi / 2), ('right', -1.0, -np.pi / 2))
    ]  # fmt: skip
    world = World(WorldConfig(gravity_magnitude=0.0, bodies=(block(position=(0.0, 0.0, 0.0)),),
                              obstacles=tuple(planes)))  # fmt: skip
    forces = []
    for _ in range(100):
        world.step()
        forces.append(np.linalg.norm(world.obstacle_wrench('left')[0]))
        assert np.abs(centre(world, 'block')).max() < 1e-9
    forces = np.array(forces[60:])
    assert (np.diff(forces) > 0.0).all()  # growing …
    assert np.abs(np.diff(forces, 2)).max() < 0.01 * forces.max()  # … smoothly


@pytest.mark.parametrize('h', STEPS)
def test_the_force_on_what_is_held_without_room_is_steady(h):
    """Without gravity nothing moves at all: energies are those of rounding."""
    ball = block(mesh='icosphere', size=0.05, subdivisions=3, mass=0.2, position=(0.0, 0.0, 1.0))
    world = World(
        WorldConfig(time_step=h, gravity_magnitude=0.0, bodies=(ball,), obstacles=fingers(0.051))
    )
    move(world, 0.1)
    world.step(round(0.02 / h))
    move(world, 0.0)
    world.step(20)
    forces = []
    for _ in range(20):
        world.step()
        forces.append(np.linalg.norm(world.obstacle_wrench('left')[0]))
    assert forces == pytest.approx(np.full(20, forces[-1]), rel=1e-6)
    assert forces[-1] > 100.0


# -------------------------------------------------------------------------------------- impacts
@pytest.mark.parametrize('mesh', ['icosphere', 'box'])
@pytest.mark.parametrize('elasticity', [0.0, 0.5, 0.8, 1.0])
@pytest.mark.parametrize('h', [1 / 60, 1 / 240, 1 / 960])
def test_a_bounce_returns_the_square_of_the_elasticity_at_any_step(mesh, elasticity, h):
    ball = block(mesh=mesh, elasticity=elasticity, friction=0.0, position=(0.0, 0.0, 1.2))
    world = on_ground(ball, h=h)
    world.step(round(math.sqrt(2.0 / G) / h) + 2)
    highest = centre(world, 'block')[2]
    for _ in range(round(math.sqrt(2.0 / G) * elasticity / h) + 2):
        world.step()
        highest = max(highest, centre(world, 'block')[2])
        assert world.positions('block')[:, 2].min() > -1e-4 * 0.2
    assert highest - 0.2 == pytest.approx(elasticity**2, abs=0.005)


@pytest.mark.parametrize('elasticity', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_an_oblique_collision_keeps_momenta_and_never_gains_energy(elasticity, friction):
    bodies = [
        body_config(
            'box', name=name, mode='rigid', size=0.2, subdivisions=1, elasticity=elasticity,
            friction=friction, friction_model='coulomb', position=(sign * 0.5, sign * 0.12, 0.0),
            orientation=tuple(Rotation.from_rotvec((0.3 * sign, 0.5, 0.2)).as_quat()),
            initial_velocity_linear=(-3.0 * sign, 0.0, 0.0), mass=mass,
        )
        for name, sign, mass in (('one', 1.0, 1.0), ('two', -1.0, 3.0))
    ]  # fmt: skip
    world = floating(*bodies, h=1 / 240)

    def totals():
        linear, angular, energy = np.zeros(3), np.zeros(3), 0.0
        for config in world.config.bodies:
            mass = config.mass * world.rest_shape(config.name).weights[:, None]
            x, v = world.positions(config.name), world.velocities(config.name)
            linear += (mass * v).sum(axis=0)
            angular += (mass * np.cross(x, v)).sum(axis=0)
            energy += (mass * v**2).sum() / 2.0
        return linear, angular, energy

    before = totals()
    collided = False
    for _ in range(120):
        world.step()
        after = totals()
        collided |= np.linalg.norm(world.contact_wrench('one')[0]) > 0.0
        assert after[0] == pytest.approx(before[0], abs=1e-12)
        assert after[1] == pytest.approx(before[1], abs=1e-12)
        assert after[2] <= before[2] * (1.0 + 1e-9)
    assert collided


@pytest.mark.parametrize('mode', ['rigid', 'linear'])
@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
def test_a_box_on_a_turntable_is_carried_and_does_not_drift(h, mode):
    rate = 2.0
    table = ObstacleConfig(
        name='table', type='cylinder', size=(1.0, 1.0, 0.1), position=(0.0, 0.0, -0.1),
        velocity_angular=(0.0, 0.0, rate),
    )  # fmt: skip
    box = block(
        size=0.1, mode=mode, position=(0.5, 0.0, 0.1), initial_velocity_linear=(0.0, 1.0, 0.0),
        initial_velocity_angular=(0.0, 0.0, rate),
    )  # fmt: skip
    world = World(WorldConfig(time_step=h, bodies=(box,), obstacles=(table,)))

    def place():
        return Rotation.from_euler('z', -rate * world.time).apply(centre(world, 'block'))

    world.step(round(1.0 / h))
    start = place()
    world.step(round(4.0 / h))
    assert place() == pytest.approx(start, abs=5e-4)


def energy(world, name='body'):
    """Return the kinetic and potential energy of a body of 1 kg, J."""
    weights, v = world.rest_shape(name).weights, world.velocities(name)
    return 0.5 * weights @ (v**2).sum(axis=1) + G * centre(world, name)[2]


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('friction', [0.0, 0.5])
@pytest.mark.parametrize('mesh', ['box', 'icosphere', 'cylinder'])
@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
def test_what_bounces_and_tumbles_without_loss_gains_no_energy(h, mesh, friction, seed):
    random = np.random.default_rng(seed)
    tumbling = body_config(
        mesh, mode='rigid', size=0.1, position=(0.0, 0.0, 0.6), elasticity=1.0, friction=friction,
        friction_model='coulomb', orientation=tuple(Rotation.random(random_state=seed).as_quat()),
        initial_velocity_angular=tuple(3.0 * random.normal(size=3)),
        initial_velocity_linear=(1.0, 0.0, 0.0),
    )  # fmt: skip
    world = on_ground(tumbling, h=h)
    start = energy(world)
    energies = []
    for _ in range(round(3.0 / h)):
        world.step()
        energies.append(energy(world))
    assert max(energies) <= start * (1.0 + 1e-9)
    assert world.contact_impulse('body').impulse[2] > 0.0


def rod(length, width, height, seed, **values):
    """Return a rigid rod with a random pose."""
    box = trimesh.creation.box(extents=(length, width, height))
    return body_config(
        Surface(box.vertices, box.faces), mode='rigid', elasticity=0.3, friction=0.5,
        friction_model='coulomb', orientation=tuple(Rotation.random(random_state=seed).as_quat()),
        **values,
    )  # fmt: skip


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize(
    ('width', 'height', 'h'),
    [(0.01, 0.01, 1 / 60), (0.002, 0.001, 1 / 60), (0.002, 0.001, 1 / 240)],
)
def test_a_rod_that_falls_comes_to_rest(width, height, h, seed):
    """A contact turns it about its axis by many radians in a tick."""
    random = np.random.default_rng(seed)
    turning = tuple(2.0 * random.normal(size=3))
    world = on_ground(
        rod(1.0, width, height, seed, position=(0.0, 0.0, 0.8), initial_velocity_angular=turning),
        h=h,
    )
    start, most = energy(world), 0.0
    for _ in range(round(6.0 / h)):
        world.step()
        most = max(most, energy(world))
    assert most <= start * 1.001
    assert energy(world) < 0.02 * start
    assert world.positions('body')[:, 2].min() > -1e-4


@pytest.mark.parametrize('spin', [3.0, 100.0, 3000.0])
def test_a_rod_in_flight_keeps_its_energy_and_momentum(spin):
    config = rod(1.0, 0.004, 0.002, 1, position=(0.0, 0.0, 0.0))
    turn = Rotation.from_quat(config.orientation)
    turning = tuple(turn.apply((spin, 5.0, 2.0)))
    world = floating(dataclasses.replace(config, initial_velocity_angular=turning), h=1 / 60)
    before, momentum_before = energy(world), angular_momentum(world, 'body')
    for _ in range(60):
        world.step()
        assert energy(world) == pytest.approx(before, rel=1e-6)
        assert angular_momentum(world, 'body') == pytest.approx(momentum_before, abs=1e-8)


# ------------------------------------------------------------------------------------ same bits
def test_nothing_depends_on_what_was_in_memory_before(monkeypatch):
    bodies = [
        block(f'block{i}', position=(0.03 * i, 0.02 * i, 0.25 + 0.45 * i), mesh=mesh, friction=0.8)
        for i, mesh in enumerate(['box', 'icosphere', 'cylinder', 'box', 'box'])
    ]
    clean, other = on_ground(*bodies), on_ground(*bodies)
    random = np.random.default_rng(1)
    fields = 'force', 'radius', 'disc_change', 'target', 'bias', 'free', 'positional'

    def with_forces_of_another_scene(*arguments):
        found, more, met = find_rows(*arguments)
        for rows in (Workspace(*arguments[-1]).found[:found], more):
            for field in fields:
                rows[field] = random.normal(size=rows[field].shape)
        return found, more, met

    for _ in range(150):
        clean.step()
        with monkeypatch.context() as patch:
            patch.setattr(step, 'find_rows', with_forces_of_another_scene)
            other.step()
        for name in clean.names:
            assert (clean.positions(name) == other.positions(name)).all()
            assert (clean.velocities(name) == other.velocities(name)).all()
