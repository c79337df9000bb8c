# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pins: held and moved particles, bodies that hang and swing on them, changes at run time."""

import dataclasses
import math

from core_helpers import (
    body,
    bytes_of,
    centre,
    floating,
    momentum,
    put,
    rank_deficient_shapes,
    rms_displacement,
    sheared_box,
)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    Surface,
    World,
    WorldConfig,
    make_surface,
)

MODES = ('rigid', 'linear', 'quadratic')
SOFT = ('linear', 'quadratic')
GRAVITY = 9.81
BALL = make_surface('icosphere', 0.5, 2)
TOP = int(np.argmax(BALL.vertices[:, 2]))
CAP = tuple(np.flatnonzero(BALL.vertices[:, 2] > 0.3).tolist())
FREE = np.setdiff1d(np.arange(len(BALL.vertices)), CAP)
CAP_BOX = (-1.0, -1.0, 0.3, 1.0, 1.0, 1.0)
TURNING = {'pins_velocity_linear': (0.3, -0.2, 0.1), 'pins_velocity_angular': (0.5, 1.0, -2.0)}


def hanging(mesh=BALL, indices=(TOP,), h=1 / 240, dtype=float, **values):
    """Return a world without ground whose body is pinned at some vertices."""
    config = body(mesh, pins_indices=indices, **values)
    return floating(config, h=h, gravity=GRAVITY, dtype=dtype)


def configured(world, name=None, **values):
    """Change parameters of a body, or of all bodies, of a running world."""
    bodies = tuple(
        dataclasses.replace(config, **values) if name in (None, config.name) else config
        for config in world.config.bodies
    )
    world.configure(dataclasses.replace(world.config, bodies=bodies))


def kinetic_energy(world, name='body'):
    """Return Σ w v² / 2, m²/s²."""
    return world.rest_shape(name).weights @ np.sum(world.velocities(name) ** 2, axis=1) / 2


def energy(world, name='body'):
    """Return the kinetic energy and that of the height, m²/s²."""
    return kinetic_energy(world, name) + GRAVITY * centre(world, name)[2]


# ------------------------------------------------------------------------------------------- held
@pytest.mark.parametrize('indices', [(TOP,), (0, 1), CAP])
@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', MODES)
def test_pinned_particles_stay_where_they_are(mode, count, indices):
    world = hanging(indices=indices, mode=mode, regions_count=count)
    start = world.positions('body')[list(indices)]
    for _ in range(30):
        world.step(11)
        now = world.positions('body')[list(indices)]
        if mode == 'rigid':
            assert np.abs(now - start).max() < 1e-12
        else:
            assert np.array_equal(now, start)
            assert not world.velocities('body')[list(indices)].any()


@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', MODES)
def test_a_ball_hangs_below_its_pin_with_its_shape(mode, count):
    world = hanging(mode=mode, regions_count=count)
    for _ in range(50):
        world.step(24)
        assert rms_displacement(world) <= 0.03
    assert centre(world) == pytest.approx(BALL.vertices[TOP] - (0.0, 0.0, 0.5), abs=0.05 * 0.5)
    # it hangs by its pin, not in the air
    if mode != 'rigid':
        assert rms_displacement(world) > 0.001
    configured(world, pins_indices=())
    world.step(240)
    assert centre(world)[2] < -4.0


@pytest.mark.parametrize('gravity', [0.0, GRAVITY])
@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', MODES)
def test_the_rest_of_a_body_that_is_held_by_a_cap_keeps_its_shape(mode, count, gravity):
    config = body(BALL, mode=mode, pins_indices=CAP, regions_count=count)
    world = floating(config, h=1 / 240, gravity=gravity)
    start = world.positions('body')
    for _ in range(20):
        world.step(24)
        assert rms_displacement(world) < (0.005 if gravity else 1e-13)
        moved = np.abs(world.positions('body') - start)[FREE]
        assert moved.max() < (0.005 if gravity else 1e-13)


@pytest.mark.parametrize('mode', MODES)
def test_a_body_whose_particles_are_all_pinned_does_not_move(mode):
    surface = sheared_box()
    world = hanging(surface, tuple(range(len(surface.vertices))), mode=mode)
    start = world.positions('body')
    world.step(300)
    assert world.positions('body') == pytest.approx(start, abs=1e-12)
    assert np.abs(world.velocities('body')).max() < 1e-12
    configured(world, **TURNING)
    world.step(480)
    assert world.positions('body') == pytest.approx(carried(start, 2.0), abs=1e-10)


AWKWARD = rank_deficient_shapes() | {
    'loose vertex': Surface(np.vstack([BALL.vertices, [(0.0, 0.0, 0.6)]]), BALL.faces)
}


@pytest.mark.parametrize('name', AWKWARD)
@pytest.mark.parametrize('mode', MODES)
def test_shapes_that_span_little_hang_on_one_vertex(mode, name):
    surface = AWKWARD[name]
    last = len(surface.vertices) - 1
    for count in (0, len(surface.vertices)):
        world = hanging(surface, (last,), h=1 / 120, mode=mode, regions_count=count)
        start, most = world.positions('body')[last], energy(world)
        arm = np.linalg.norm(centre(world) - start)
        for _ in range(20):
            world.step(15)
            assert np.isfinite(world.positions('body')).all()
            assert world.positions('body')[last] == pytest.approx(start, abs=1e-12)
            assert np.linalg.norm(centre(world) - start) < 1.3 * arm + 1e-12
            assert energy(world) <= most + 0.01 * GRAVITY * arm


def test_single_precision_holds_exactly_too():
    world = hanging(mode='quadratic', dtype=np.float32)
    start = world.positions('body')[TOP]
    world.step(600)
    assert world.positions('body').dtype == np.float32
    assert np.array_equal(world.positions('body')[TOP], start)
    assert centre(world) == pytest.approx([0.0, 0.0, 0.0], abs=0.025)


# -------------------------------------------------------------------------------------- swinging
def swing(h, angle, seconds, **values):
    """
    Return the angles of a ball that is let go turned about its pin, and the world.

    Returns
    -------
    angles : (k,) float
    period : float
        in theory, of a physical pendulum of any amplitude, s
    world : World

    """
    world = hanging(h=h, **values)
    weights, pin = world.rest_shape('body').weights, BALL.vertices[TOP]
    arms = world.positions('body') - pin
    turn = Rotation.from_rotvec((0.0, -angle, 0.0)).as_matrix()
    put(world, 'body', arms @ turn.T + pin)
    inertia = weights @ (arms[:, 0] ** 2 + arms[:, 2] ** 2)
    length = -(weights @ arms)[2]
    slow = math.sqrt(inertia / (GRAVITY * length))
    angles = []
    for _ in range(round(seconds / h)):
        world.step()
        x, _, z = centre(world) - pin
        angles.append(math.atan2(x, -z))
    return np.array(angles), 4.0 * slow * ellipk(math.sin(angle / 2.0) ** 2), world


def periods(angles, h):
    """Return the times between passages through 0 in the same direction, s."""
    before = np.flatnonzero((angles[:-1] < 0.0) & (angles[1:] >= 0.0))
    passages = before - angles[before] / (angles[before + 1] - angles[before])
    return h * np.diff(passages)


@pytest.mark.parametrize('angle', [0.1, 1.0, 2.5])
@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
def test_a_rigid_body_swings_as_a_physical_pendulum_and_swings_on(h, angle):
    angles, period, _ = swing(h, angle, 6.5, mode='rigid')
    assert periods(angles, h)[0] == pytest.approx(period, rel=0.005)
    once = round(period / h)
    assert np.abs(angles[:once]).max() == pytest.approx(angle, rel=0.01)
    assert np.abs(angles[-once:]).max() == pytest.approx(angle, rel=0.01)


@pytest.mark.parametrize('angle', [0.1, 1.0])
@pytest.mark.parametrize('mode', SOFT)
def test_a_deformable_body_swings_nearly_so(mode, angle):
    angles, period, world = swing(1 / 240, angle, 4.5, mode=mode)
    # it hangs a little longer than it is
    assert periods(angles, 1 / 240)[0] == pytest.approx(period, rel=0.03)
    assert np.abs(angles[-480:]).max() == pytest.approx(angle, rel=0.02)
    assert rms_displacement(world) < 0.03


def test_the_rigid_pendulum_of_an_edge_is_that_of_an_axis():
    surface = make_surface('box', 0.5, 1)
    x, _, z = surface.vertices.T
    edge = tuple(np.flatnonzero((x > 0.49) & (z > 0.49)).tolist())
    world = hanging(surface, edge, mode='rigid')
    start = world.positions('body')[list(edge)]
    for _ in range(100):
        world.step(7)
        assert np.abs(world.positions('body')[list(edge)] - start).max() < 1e-12
        assert energy(world) == pytest.approx(0.0, abs=0.01)
        assert abs(centre(world)[1]) < 1e-12


@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize('indices', [(TOP,), (0, 1, 2, 3), CAP])
@pytest.mark.parametrize(
    'count',
    [
        0,
        pytest.param(
            12,
            marks=pytest.mark.xfail(
                reason='pins and regions do not commute: undamped, they pump energy', strict=True
            ),
        ),
    ],
)
def test_an_undamped_pinned_body_gains_no_energy(mode, indices, count):
    config = body(BALL, mode=mode, bounciness=1.0, pins_indices=indices, regions_count=count)
    world = floating(config, h=1 / 120)
    put(world, 'body', velocities=0.3 * np.random.default_rng(1).normal(size=BALL.vertices.shape))

    def mean_kinetic_energy():
        energies = []
        for _ in range(40):
            world.step(3)
            energies.append(kinetic_energy(world))
        return np.mean(energies)

    first = mean_kinetic_energy()
    world.step(8 * 120)
    assert first > 0.03
    assert mean_kinetic_energy() <= 1.1 * first


@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize('indices', [(TOP,), (0, 1, 2, 3), CAP])
def test_a_kicked_pinned_body_comes_to_rest(mode, indices, count):
    config = body(BALL, mode=mode, pins_indices=indices, regions_count=count)
    world = floating(config, h=1 / 120)
    put(world, 'body', velocities=0.3 * np.random.default_rng(1).normal(size=BALL.vertices.shape))
    world.step(480)
    assert rms_displacement(world) < 1e-3
    # on one pin it turns on for ever
    assert kinetic_energy(world) < (0.01 if indices == (TOP,) else 1e-6)


def test_a_rigid_body_that_is_caught_turns_on_with_its_angular_momentum_about_the_pin():
    surface = sheared_box()
    world = floating(body(surface, mode='rigid'), h=1 / 960)
    put(world, 'body', velocities=np.tile((1.0, -2.0, 0.5), (len(surface.vertices), 1)))
    world.step(5)
    arms = world.positions('body') - world.positions('body')[3]
    weights = world.rest_shape('body').weights

    def spin_about_the_pin():
        offsets = world.positions('body') - world.positions('body')[3]
        return weights @ np.cross(offsets, world.velocities('body'))

    before = spin_about_the_pin()
    configured(world, pins_indices=(3,))
    world.step()
    assert np.linalg.norm(weights @ arms) > 0.3
    assert np.linalg.norm(before) > 0.3
    assert spin_about_the_pin() == pytest.approx(before, abs=0.01 * np.linalg.norm(before))


# ----------------------------------------------------------------------------------------- moved
def carried(points, seconds, pinned=None):
    """Return points (n, 3) after the motion of `TURNING`, about the centre of the pinned ones."""
    linear, angular = TURNING['pins_velocity_linear'], TURNING['pins_velocity_angular']
    middle = (points if pinned is None else pinned).mean(axis=0)
    turn = Rotation.from_rotvec(seconds * np.array(angular)).as_matrix()
    return middle + seconds * np.array(linear) + (points - middle) @ turn.T


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
@pytest.mark.parametrize('indices', [(TOP,), (0, 5), CAP])
@pytest.mark.parametrize('mode', MODES)
def test_moved_pins_follow_their_motion_exactly(mode, indices, h):
    config = body(BALL, mode=mode, pins_indices=indices, **TURNING)
    world = floating(config, h=h, gravity=GRAVITY)
    start = world.positions('body')[list(indices)]
    world.step(round(2.0 / h))
    now = world.positions('body')[list(indices)]
    assert now == pytest.approx(carried(start, 2.0), abs=1e-10)
    expected = np.cross(TURNING['pins_velocity_angular'], now - now.mean(axis=0))
    expected += TURNING['pins_velocity_linear']
    assert world.velocities('body')[list(indices)] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', MODES)
def test_a_body_follows_its_moved_pins(mode, count):
    config = body(BALL, mode=mode, pins_indices=CAP, regions_count=count, **TURNING)
    world = floating(config, h=1 / 240)
    start = world.positions('body')
    world.step(480)
    expected = carried(start, 2.0, start[list(CAP)])
    tolerance = 1e-10 if mode == 'rigid' else 0.005
    assert world.positions('body') == pytest.approx(expected, abs=tolerance)
    assert rms_displacement(world) < 0.001
    configured(world, pins_velocity_linear=(0.0,) * 3, pins_velocity_angular=(0.0,) * 3)
    held = world.positions('body')
    world.step(480)
    assert world.positions('body') == pytest.approx(held, abs=2.0 * tolerance)
    assert np.abs(world.velocities('body')).max() < 1e-6


def test_a_body_with_moved_pins_is_saved_and_restored_bit_by_bit():
    world = hanging(indices=CAP, **TURNING)
    world.step(100)
    saved = world.snapshot()
    world.step(100)
    expected = bytes_of(world)
    world.restore(saved)
    world.step(100)
    assert bytes_of(world) == expected
    world.reset()
    world.step(200)
    assert bytes_of(world) == expected


# ------------------------------------------------------------------------------------ at run time
@pytest.mark.parametrize('mode', MODES)
def test_a_released_body_falls(mode):
    world = hanging(mode=mode)
    world.step(1200)
    height, upwards = centre(world)[2], momentum(world)[2]
    before = bytes_of(world)
    configured(world, pins_indices=())
    assert bytes_of(world) == before
    world.step(240)
    assert centre(world)[2] == pytest.approx(height + upwards - GRAVITY / 2, abs=1e-9)


@pytest.mark.parametrize('mode', MODES)
def test_a_body_that_is_pinned_while_it_moves_stops_there_without_a_jump(mode):
    config = body(BALL, mode=mode, initial_velocity_linear=(1.0, 0.0, 0.0),
                  initial_velocity_angular=(0.0, 1.0, 2.0))  # fmt: skip
    world = floating(config, h=1 / 240, gravity=GRAVITY)
    world.step(50)
    before, place = bytes_of(world), world.positions('body')
    most = kinetic_energy(world)
    configured(world, pins_indices=CAP)
    assert bytes_of(world) == before
    world.step()
    now = world.positions('body')
    if mode == 'rigid':
        # its shape is not quite that which the pins remember
        assert now[list(CAP)] == pytest.approx(place[list(CAP)], abs=1e-9)
    else:
        assert np.array_equal(now[list(CAP)], place[list(CAP)])
    assert np.abs(now - place).max() < 0.02
    for _ in range(50):
        world.step(10)
        assert kinetic_energy(world) < most
    assert np.abs(world.positions('body') - place).max() < 0.02
    assert rms_displacement(world) < 0.005


@pytest.mark.parametrize('mode', MODES)
def test_a_body_that_hangs_still_falls_asleep_and_wakes_when_its_pins_change(mode):
    world = hanging(mode=mode)
    world.step(1200)
    assert world.is_asleep('body')
    assert not world.velocities('body').any()
    asleep = world.positions('body')
    world.step(240)
    assert np.array_equal(world.positions('body'), asleep)
    configured(world, pins_velocity_linear=(0.0, 0.0, 0.2))
    assert not world.is_asleep('body')
    world.step(1200)
    assert not world.is_asleep('body')
    assert world.positions('body')[TOP] == pytest.approx(asleep[TOP] + (0.0, 0.0, 1.0), abs=1e-10)
    configured(world, pins_velocity_linear=(0.0, 0.0, 0.0))
    world.step(1440)
    assert world.is_asleep('body')
    configured(world, pins_indices=())
    assert not world.is_asleep('body')
    height = centre(world)[2]
    world.step(240)
    assert centre(world)[2] < height - 4.0


def test_a_swinging_body_does_not_fall_asleep():
    world = hanging(indices=(0,), mode='rigid')
    world.step(1440)
    assert not world.is_asleep('body')


# ------------------------------------------------------------------------------------ which ones
def pinned_of(world, name='body'):
    """Return the indices of the pinned particles of a body."""
    batch, row = world._place[name]
    pins = world._pinned[batch].get(row)
    return () if pins is None else tuple(pins.particle.tolist())


@pytest.mark.parametrize(
    'box',
    [
        (-1.0, -1.0, 0.3, 1.0, 1.0, 1.0),
        (1.0, 1.0, 1.0, -1.0, -1.0, 0.3),
        (1.0, -1.0, 1.0, -1.0, 1.0, 0.3),
        (-1.0, 1.0, 0.3, 1.0, -1.0, 1.0),
    ],
)
def test_a_box_may_be_given_by_any_two_opposite_corners(box):
    assert pinned_of(floating(body(BALL, pins_box=box))) == CAP


def test_a_box_is_in_the_axes_of_the_mesh():
    turned = body(BALL, pins_box=CAP_BOX, position=(5.0, 6.0, 7.0),
                  orientation=(1.0, 0.0, 0.0, 0.0))  # fmt: skip
    assert pinned_of(floating(turned)) == CAP


def test_box_and_indices_pin_together():
    low = int(np.argmin(BALL.vertices[:, 2]))
    world = floating(body(BALL, pins_box=CAP_BOX, pins_indices=(low, TOP, low)))
    assert pinned_of(world) == tuple(sorted({*CAP, low}))


def test_no_pins_are_an_empty_list_or_minus_one_and_a_box_of_zeros():
    assert pinned_of(floating(body(BALL))) == ()
    assert pinned_of(floating(body(BALL, pins_indices=(-1,), pins_box=(0.0,) * 6))) == ()


WRONG = [
    (
        {'pins_indices': (3, 162)},
        'ball.pins.indices has 162: the mesh has the vertices 0 to 161',
    ),
    (
        {'pins_box': (2.0, 2.0, 2.0, 3.0, 3.0, 3.0)},
        'ball.pins.box is [2.0, 2.0, 2.0, 3.0, 3.0, 3.0]: no vertex is inside, the mesh reaches '
        'from [-0.5, -0.5, -0.5] to [0.5, 0.5, 0.5] m',
    ),
]


@pytest.mark.parametrize(('values', 'sentence'), WRONG)
def test_pins_that_do_not_exist_are_refused(values, sentence):
    with pytest.raises(ConfigError) as caught:
        floating(body(BALL, name='ball', **values))
    assert str(caught.value) == sentence


@pytest.mark.parametrize(('values', 'sentence'), WRONG)
def test_pins_that_do_not_exist_change_nothing_at_run_time(values, sentence):
    ground = ObstacleConfig(position=(0.0, 0.0, -3.0))
    config = WorldConfig(
        bodies=(body(BALL, name='ball', pins_indices=(0,)), body(BALL, name='b')),
        obstacles=(ground,),
    )
    world, untouched = World(config), World(config)
    for each in (world, untouched):
        each.step(50)
    ball = dataclasses.replace(config.bodies[0], stiffness=0.1, **values)
    other = dataclasses.replace(config.bodies[1], stiffness=0.1, pins_indices=(1,))
    wrong = dataclasses.replace(
        config,
        gravity_magnitude=1.0,
        bodies=(ball, other),
        obstacles=(dataclasses.replace(ground, position=(0.0, 0.0, 1.0)),),
    )
    with pytest.raises(ConfigError) as caught:
        world.configure(wrong)
    assert str(caught.value) == sentence
    assert world.config is config
    for each in (world, untouched):
        each.step(50)
    assert bytes_of(world) == bytes_of(untouched)


# ------------------------------------------------------------------------------- other company
@pytest.mark.parametrize('neighbour', [{}, {'mode': 'rigid'}, {'pins_indices': (5,)}])
@pytest.mark.parametrize('mode', MODES)
def test_the_pins_of_one_body_do_not_change_another_of_its_batch(mode, neighbour):
    bodies = (
        BodyConfig(name='a', mesh=BALL, mode=mode, pins_indices=(3, 4), **TURNING),
        BodyConfig(name='b', mesh=BALL, **{'position': (3.0, 0.0, 0.6)} | neighbour),
        BodyConfig(name='c', mesh=BALL, mode=mode, position=(6.0, 0.0, 2.0), pins_indices=(7,)),
    )
    together = World(WorldConfig(bodies=bodies))
    assert len(together._batches) == 1
    together.step(120)
    for config in bodies:
        alone = World(WorldConfig(bodies=(config,)))
        alone.step(120)
        assert together.positions(config.name) == pytest.approx(
            alone.positions(config.name), abs=1e-12
        )


def test_a_pinned_body_is_held_while_another_of_its_batch_sleeps():
    """The rows of the bodies that are computed are others than those of the batch."""
    box = make_surface('box', 0.5, 1)
    bodies = (
        BodyConfig(name='sleeper', mesh=box, position=(3.0, 0.0, 0.5)),
        BodyConfig(name='swings', mesh=box, position=(0.0, 0.0, 3.0), pins_indices=(0,)),
    )
    world = World(WorldConfig(bodies=bodies))
    start = world.positions('swings')[0]
    world.step(600)
    assert world.is_asleep('sleeper')
    assert not world.is_asleep('swings')
    assert np.array_equal(world.positions('swings')[0], start)


@pytest.mark.parametrize('height', [0.45, 0.5, 0.6])
@pytest.mark.parametrize('indices', [(TOP,), CAP])
@pytest.mark.parametrize('mode', SOFT)
def test_a_pinned_body_stays_above_the_ground(mode, indices, height):
    config = body(BALL, mode=mode, position=(0.0, 0.0, height), pins_indices=indices)
    world = World(WorldConfig(bodies=(config,)))
    start = world.positions('body')[list(indices)]
    world.step()
    for _ in range(40):
        world.step(12)
        assert world.positions('body')[:, 2].min() > -0.001
        assert np.array_equal(world.positions('body')[list(indices)], start)
    assert rms_displacement(world) < 0.03


@pytest.mark.parametrize('mode', MODES)
def test_an_obstacle_that_pushes_does_not_move_pinned_particles(mode):
    ram = ObstacleConfig(name='ram', position=(0.0, 0.0, -0.6), velocity_linear=(0.0, 0.0, 0.2))
    config = body(BALL, mode=mode, pins_indices=CAP)
    world = World(WorldConfig(bodies=(config,), obstacles=(ram,)))
    start = world.positions('body')[list(CAP)]
    world.step(360)
    assert world.positions('body')[list(CAP)] == pytest.approx(start, abs=1e-12)
    assert np.isfinite(world.positions('body')).all()
    if mode != 'rigid':
        # pressed between its pins and the ram
        assert world.positions('body')[:, 2].min() > -0.31
        assert 0.05 < rms_displacement(world) < 0.3


@pytest.mark.parametrize('mode', SOFT)
def test_a_hanging_body_that_flows_keeps_within_its_bounds(mode):
    world = hanging(mode=mode, plasticity_creep=10.0, plasticity_yield=0.01, stiffness=0.3)
    world.step(1200)
    assert 0.05 < world.permanent_strain('body') <= 0.3 + 1e-12
    assert np.array_equal(world.positions('body')[TOP], BALL.vertices[TOP])
