# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What cannot get out of the way: obstacles that drive over pins, hinges, bodies without room."""

from core_helpers import assert_kept, floating, many_points, random_rotation, sizes, totals
from kernels import kept, shares_for
import numpy as np
import pytest

from softbody_ros.core import (
    BodyConfig,
    ObstacleConfig,
    ObstacleUpdate,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.contact.members import MEMBER
from softbody_ros.core.contact.rows import ROW


def fastest(world):
    """Return the largest speed of a particle of a body, m/s."""
    return max(np.linalg.norm(world.velocities(name), axis=1).max() for name in world.names)


def drive(world, fingers, ticks):
    """
    Move obstacles through a world; return the largest speed, and the work of the hardest tick.

    Parameters
    ----------
    fingers : sequence of (start (3,), velocity (3,), type, size)

    """
    h, most, work = world.config.time_step, 0.0, np.zeros(3, int)
    for tick in range(ticks):
        changes = []
        for number, (start, velocity, shape, size) in enumerate(fingers):
            place = tuple(np.asarray(start + velocity * h * tick).tolist())
            config = ObstacleConfig(name='finger', type=shape, size=(size,) * 3, position=place)
            twist = tuple(np.asarray(velocity).tolist()), (0.0, 0.0, 0.0)
            changes.append(ObstacleUpdate(('finger', number), config, twist=twist))
        world.change_obstacles(changes)
        before = np.array(world.solver_work)
        world.step()
        most, work = max(most, fastest(world)), np.maximum(work, world.solver_work - before)
    return most, work


def put_away(world, count):
    """Put the fingers far away."""
    far = ObstacleConfig(name='finger', type='sphere', size=(0.1,) * 3, position=(99.0, 0.0, 0.0))
    world.change_obstacles([ObstacleUpdate(('finger', k), far) for k in range(count)])


# ------------------------------------------------------------------------------- over pinned parts
DRIVES = {
    'half a ball is pinned': (
        1 / 60, 'quadratic', 0, 3, (-0.7672, -0.5578, -0.3166), 0.0901, 0.26444, 0.5, 0.0,
        'viscous', (-0.30782101, -0.39192152, -0.04054315), (0.0070182, 0.90878817, 0.41719875),
    ),
    'a cap, from the side': (
        1 / 60, 'quadratic', 0, 3, (-0.9773, 0.1785, -0.1139), 0.3027, 0.28203, 0.5, 0.5,
        'viscous', (-0.34153764, 0.2420811, 0.14335239), (0.36730417, -0.55454976, -0.74670089),
    ),
    'a belt': (
        1 / 240, 'quadratic', 0, 3, 'belt', 0.12, 0.269, 2.0, 0.0, 'coulomb',
        (-0.06582769, -0.1791144, 0.4621523), (-0.40126435, 0.86791293, -0.29276967),
    ),
    'single vertices of a body with regions': (
        1 / 60, 'linear', 8, 2, (87, 11, 160, 21), 0.0, 0.14225, 1.0, 0.5, 'viscous',
        (-0.47552826, 0.13143278, 0.08122992), (-0.22246763, -0.61755453, 0.75441007),
    ),
    'the same at another rate': (
        1 / 240, 'linear', 8, 2, (7, 80, 37), 0.0, 0.18135, 0.2, 1.0, 'coulomb',
        (0.0, 0.26286556, -0.4253254), (-0.65407902, 0.64345458, 0.3976768),
    ),
}  # fmt: skip


@many_points
@pytest.mark.parametrize('name', DRIVES)
def test_an_obstacle_that_drives_over_pinned_particles_throws_nothing(name):
    """Inside of the body then, it presses faces outwards that it would have to leave by."""
    h, mode, regions, level, pins, limit, size, speed, friction, law, place, way = DRIVES[name]
    ball = make_surface('icosphere', 0.5, level)
    indices = pins
    if pins == 'belt':
        indices = np.flatnonzero(np.abs(ball.vertices[:, 0]) < limit).tolist()
    elif limit:
        indices = np.flatnonzero(ball.vertices @ pins > limit).tolist()
    config = BodyConfig(
        name='ball', mesh=ball, mode=mode, regions_count=regions, position=(0.0, 0.0, 2.0),
        pins_indices=tuple(indices), friction=friction, friction_model=law,
    )  # fmt: skip
    world = World(WorldConfig(time_step=h, bodies=(config,), obstacles=()))
    world.step(int(0.3 / h))
    place, way = np.array(place) + (0.0, 0.0, 2.0), np.array(way)
    ticks = int(1.6 / speed / h)
    most, _ = drive(world, [(place - 0.9 * way, speed * way, 'sphere', size)], ticks)
    assert most < 20.0 * speed
    put_away(world, 1)
    world.step(int(3.0 / h))
    assert fastest(world) < 1e-3


# ------------------------------------------------------------------------------------------ hinges
def hinged(seed):
    """
    Return a world with a rigid box on two pins and a free soft body by it, and random fingers.

    Returns
    -------
    world : World
    fingers
        see `drive`

    """
    random = np.random.default_rng(seed)
    h, shape = float(random.choice([1 / 60, 1 / 240])), str(random.choice(['box', 'icosphere']))
    surface = make_surface(shape, 0.5, int(random.choice([0, 1, 2])))
    pins = random.choice(len(surface.vertices), 2, replace=False)
    door = BodyConfig(
        name='door', mesh=surface, mode='rigid', position=(0.0, 0.0, 2.0),
        pins_indices=tuple(pins.tolist()), mass=float(random.choice([1.0, 10.0])),
    )  # fmt: skip
    towards = random.normal(size=3)
    towards /= np.linalg.norm(towards)
    kind = {
        'mode': str(random.choice(['rigid', 'linear', 'quadratic'])),
        'mesh': str(random.choice(['icosphere', 'box'])),
        'subdivisions': int(random.choice([0, 1, 2])),
    }
    place = (0.0, 0.0, 2.0) + towards * random.uniform(0.75, 1.0)
    free = BodyConfig(name='free', size=0.3, position=tuple(place.tolist()), **kind)
    gravity = float(random.choice([0.0, 9.81]))
    ground = ()
    if random.random() < 0.5:
        ground = (ObstacleConfig(position=(0.0, 0.0, float(random.uniform(0.9, 1.4)))),)
    config = WorldConfig(
        time_step=h, bodies=(door, free), gravity_magnitude=gravity, obstacles=ground
    )
    fingers = []
    for _ in range(int(random.integers(1, 4))):
        way = random.normal(size=3)
        way /= np.linalg.norm(way)
        target = (0.0, 0.0, 2.0) + random.uniform(-0.4, 0.4, 3)
        speed = float(random.choice([0.2, 0.5, 1.0, 2.0]))
        kind = str(random.choice(['sphere', 'box', 'capsule']))
        fingers.append((target - way, way * speed, kind, float(random.uniform(0.05, 0.3))))
    return World(config), fingers


@pytest.mark.parametrize('seed', [24, 30, 35])
def test_a_hinged_body_between_obstacles_throws_nothing(seed):
    world, fingers = hinged(seed)
    most, work = drive(world, fingers, int(1.2 / world.config.time_step))
    assert most < 40.0
    assert work[1] < 8 * 1600


# ---------------------------------------------------------------------------------------- no room
def wedged(seed):
    """Return a world with two rigid boxes of 8 vertices within obstacles and each other."""
    random = np.random.default_rng(seed)
    h, bodies, obstacles = float(random.choice([1 / 60, 1 / 240])), [], []
    for number in range(2):
        turned = random.normal(size=4)
        turned /= np.linalg.norm(turned)
        place = (0.35 * number, 0.0, 1.0) + random.uniform(-0.05, 0.05, 3)
        bodies.append(
            BodyConfig(
                name=f'box{number}', mesh='box', subdivisions=0, mode='rigid', size=0.2,
                position=tuple(place.tolist()), orientation=tuple(turned.tolist()),
            )
        )  # fmt: skip
    for number in range(int(random.integers(3, 7))):
        towards = random.normal(size=3)
        towards /= np.linalg.norm(towards)
        centre = np.array((0.35 * random.integers(0, 2), 0.0, 1.0))
        turned = random.normal(size=4)
        turned /= np.linalg.norm(turned)
        shape = str(random.choice(['box', 'sphere', 'capsule', 'plane']))
        if shape == 'plane':
            # it faces the boxes
            turned = np.array((towards[1], -towards[0], 0.0, 1.0 - towards[2]))
            turned /= np.linalg.norm(turned)
            place = centre + towards * random.uniform(0.12, 0.25)
        else:
            place = centre + towards * random.uniform(0.25, 0.4)
        obstacles.append(
            ObstacleConfig(
                name=f'obstacle{number}', type=shape, position=tuple(place.tolist()),
                size=(0.1, 0.1, 0.3) if shape == 'capsule' else (0.2, 0.2, 0.2),
                orientation=tuple(turned.tolist()),
            )
        )  # fmt: skip
    return World(WorldConfig(time_step=h, bodies=tuple(bodies), obstacles=tuple(obstacles)))


@pytest.mark.parametrize(
    'seed', [24, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (37, 38))]
)
def test_the_work_of_a_tick_without_room_is_bounded(seed):
    world, most = wedged(seed), 0
    for _ in range(120):
        before = world.solver_work.newton_steps
        world.step()
        most = max(most, world.solver_work.newton_steps - before)
        assert fastest(world) < 25.0
    assert 400 < most < 1600


# ------------------------------------------------------------------------------------- in a tangle
def tangle(seed, h, count, among_obstacles):
    """Return a world of coarse boxes inside each other, and among obstacles, or without any."""
    random = np.random.default_rng(seed)
    bodies, obstacles = [], [ObstacleConfig(name='ground')]
    for number in range(count):
        turned = random.normal(size=4)
        place = (0.0, 0.0, 0.3) + 0.15 * random.normal(size=3)
        box = make_surface('box', 0.25, 0)
        vertices = box.vertices * random.choice([0.3, 0.6, 1.0], 3)
        bodies.append(
            BodyConfig(
                name=f'b{number}', mesh=Surface(vertices, box.faces), mesh_scale=1.0,
                mode=str(random.choice(['rigid', 'linear', 'quadratic'])),
                position=tuple(place.tolist()),
                orientation=tuple((turned / np.linalg.norm(turned)).tolist()),
                friction=float(random.choice([0.0, 0.5])), friction_model='coulomb',
            )
        )  # fmt: skip
    for number in range(2):
        place = (0.0, 0.0, 0.3) + 0.3 * random.normal(size=3)
        shape = str(random.choice(['box', 'sphere']))
        obstacles.append(
            ObstacleConfig(
                name=f'o{number}', type=shape, size=(0.15,) * 3, position=tuple(place.tolist())
            )
        )  # fmt: skip
    if not among_obstacles:
        return floating(*bodies, h=h)
    return World(WorldConfig(time_step=h, bodies=tuple(bodies), obstacles=tuple(obstacles)))


@pytest.mark.parametrize(
    ('h', 'seed'),
    [(1 / 10, 29), (1 / 10, 40), (1 / 30, 25), (1 / 30, 56), (1 / 60, 10), (1 / 240, 25)],
)
def test_bodies_in_a_tangle_among_obstacles_are_not_thrown(h, seed):
    """They would have 4 000 … 10¹⁵ m/s, if what meets another side got out of it in a tick."""
    world, most = tangle(seed, h, 3, True), 0.0
    for _ in range(round(1.0 / h)):
        world.step()
        most = max(most, fastest(world))
    # a fall through 1 m makes 4.4 m/s
    assert most < 15.0


def test_an_obstacle_that_is_put_into_a_body_presses_at_once_and_is_replayed():
    """What is put somewhere may have any energy; what has met another side has not."""
    cube = BodyConfig(name='cube', mesh='box', size=0.05, position=(0, 0, 0), young_modulus=1e5)
    plates = [
        ObstacleConfig(name=name, type='box', size=(0.2, 0.2, 0.05), position=(0, 0, z))
        for name, z in (('lower', -0.1), ('upper', 0.1))
    ]
    world = World(
        WorldConfig(
            time_step=1 / 240, gravity_magnitude=0.0, bodies=(cube,), obstacles=tuple(plates)
        )
    )
    world.move_obstacle('upper', (0, 0, 0.099))
    world.step(24)
    world.move_obstacle('upper', (0, 0, 0.084))
    saved = world.snapshot()
    for _ in range(2):
        world.restore(saved)
        world.step()
        # by 15 mm; what is inside gets out by 0.6 mm in a tick
        assert world.positions('cube')[:, 2].max() == pytest.approx(0.034, abs=1e-5)
    first = world.positions('cube').copy()
    world.restore(saved)
    world.step()
    assert np.array_equal(world.positions('cube'), first)


def test_the_share_of_forces_is_the_largest_that_does_no_more_work():
    random, count = np.random.default_rng(0), 2000
    a, b = random.normal(size=count), random.choice([0.0, 1e-9, 1.0, 1e3], count)
    most = random.choice([-0.1, 0.0, 1e-12, 0.1, 1.0], count)
    share = shares_for(a, b, most)
    assert (share >= 0.0).all() and (share <= 1.0).all()
    grid = np.linspace(0.0, 1.0, 1001)[:, None]
    work = a * grid + b * grid**2
    allowed = work <= most
    possible = allowed.any(axis=0)
    assert (~possible).sum() > 200 and 300 < (share == 1.0).sum() < possible.sum() - 300
    done = (a * share + b * share**2)[possible]
    assert (done <= most[possible] + 1e-12 * (np.abs(a) + b)[possible]).all()
    largest = np.where(allowed, grid, 0.0).max(axis=0)
    assert (share >= largest - 1e-9)[possible].all()


@pytest.mark.parametrize('is_free', [True, False])
def test_the_largest_share_of_impulses_is_kept_that_leaves_no_more_energy(is_free):
    random, taken = np.random.default_rng(1), []
    rows = np.zeros(0 if is_free else 1, ROW)
    rows['two'] = -1
    for seed in range(200):
        members = np.zeros(2, MEMBER)
        members['mass'] = random.uniform(0.5, 2.0, 2)
        members['inverse_inertia'] = np.eye(3) * random.uniform(1.0, 30.0, (2, 3, 1))
        for number, member in enumerate(members):
            member['rotation'] = random_rotation(2 * seed + number)
        for name in ('velocity', 'angular_momentum', 'shift'):
            members[name] = random.normal(size=(2, 3))
        members['momenta'] = random.normal(size=(2, 2, 3))
        mass, turned = members['mass'], members['rotation']
        before, spin = members['momenta'][:, 0], members['momenta'][:, 1]
        if is_free:
            spin = spin - np.cross(members['shift'], before)
        else:
            spin = np.einsum('mij,mj->mi', turned, spin)
        shares = np.linspace(0.0, 1.0, 1001)[:, None, None]
        velocity = before + shares * (members['velocity'] - before)
        spin = spin + shares * (members['angular_momentum'] - spin)
        local = np.einsum('mji,smj->smi', turned, spin)
        turning = np.einsum('smi,mij,smj->sm', local, members['inverse_inertia'], local)
        energies = 0.5 * (mass * ((velocity**2).sum(axis=2) + turning)).sum(axis=1)
        most = random.choice([0.3, 0.9, 1.0, 1.5]) * energies[0]
        share, all_of_it, left = kept(members, rows, most)
        assert all_of_it == pytest.approx(energies[-1])
        allowed = energies <= most
        best = np.flatnonzero(allowed).max() if allowed.any() else energies.argmin()
        assert share == pytest.approx(best / 1000, abs=1.1e-3)
        assert left <= (most if allowed.any() else energies.min()) * (1.0 + 1e-9)
        taken.append(share)
    assert np.ptp(taken) == 1.0 and np.sum(np.array(taken) % 1.0 > 0.0) > 20


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_momenta_of_a_tangle_are_kept_whatever_share_of_forces_acts(seed):
    world = tangle(seed, 1 / 10, 5, False)
    before = totals(world)
    for _ in range(10):
        world.step()
        assert_kept(world, before, sizes(world), 1e-11)
