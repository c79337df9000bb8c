# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pins: held and moved particles, bodies that hang and swing on them, changes at run time."""

import dataclasses
import itertools
import math

from core_helpers import (
    apart,
    assert_as_if_alone,
    assert_goes_on_bit_by_bit,
    body,
    bytes_of,
    centre,
    floating,
    momentum,
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
from softbody_ros.core.shape_matching.pins import pinned_particles

MODES = ('rigid', 'linear', 'quadratic')
SOFT = ('linear', 'quadratic')
GRAVITY = 9.81
BALL = make_surface('icosphere', 0.5, 2)
TOP = int(np.argmax(BALL.vertices[:, 2]))
CAP = tuple(np.flatnonzero(BALL.vertices[:, 2] > 0.3).tolist())
FREE = np.setdiff1d(np.arange(len(BALL.vertices)), CAP)
CAP_BOX = (-1.0, -1.0, 0.3, 1.0, 1.0, 1.0)
TURNING = {'pins_velocity_linear': (0.3, -0.2, 0.1), 'pins_velocity_angular': (0.5, 1.0, -2.0)}


def hanging(mesh=BALL, indices=(TOP,), h=1 / 240, **values):
    """Return a world without ground whose body is pinned at some vertices."""
    config = body(mesh, pins_indices=indices, **values)
    return floating(config, h=h, gravity=GRAVITY)


def configured(world, name=None, **values):
    """Change parameters of a body, or of all bodies, of a running world."""
    bodies = tuple(
        dataclasses.replace(config, **values) if name in (None, config.name) else config
        for config in world.config.bodies
    )
    world.configure(dataclasses.replace(world.config, bodies=bodies))


def of_each_kind(modes=MODES, **values):
    """Return balls that are pinned at one vertex, at two and at a cap, in each of the modes."""
    places = {'one': (TOP,), 'two': (0, 5), 'cap': CAP}
    return apart(
        body(BALL, name=f'{mode}_{place}', mode=mode, pins_indices=indices, **values)
        for mode in modes
        for place, indices in places.items()
    )


def pinned_of(world, name='body'):
    """Return the indices of the pinned particles of a body."""
    pinned = pinned_particles(world.body_config(name), world.rest_shape(name))
    return tuple(pinned.tolist())


def pinned_positions(world, name):
    """Return (m, 3): where the pinned particles of a body are."""
    return world.positions(name)[list(pinned_of(world, name))]


def kinetic_energy(world, name='body'):
    """Return Σ w v² / 2, m²/s²."""
    return world.rest_shape(name).weights @ np.sum(world.velocities(name) ** 2, axis=1) / 2


def energy(world, name='body'):
    """Return the kinetic energy and that of the height, m²/s²."""
    return kinetic_energy(world, name) + GRAVITY * centre(world, name)[2]


# ------------------------------------------------------------------------------------------- held
@pytest.mark.parametrize('count', [0, 12])
def test_pinned_particles_stay_where_they_are(count):
    world = floating(*of_each_kind(MODES, regions_count=count), h=1 / 240, gravity=GRAVITY)
    start = {name: pinned_positions(world, name) for name in world.names}
    for _ in range(20):
        world.step(7)
        for name, place in start.items():
            now = pinned_positions(world, name)
            if name.startswith('rigid'):
                assert np.abs(now - place).max() < 1e-12
            else:
                assert np.array_equal(now, place)
                assert not world.velocities(name)[list(pinned_of(world, name))].any()


@pytest.mark.parametrize('count', [0, 12])
def test_balls_hang_below_their_pins_with_their_shape(count):
    bodies = [
        body(BALL, name=mode, mode=mode, pins_indices=(TOP,), regions_count=count)
        for mode in MODES
    ]
    world = floating(*apart(bodies), h=1 / 240, gravity=GRAVITY)
    for _ in range(30):
        world.step(24)
        assert max(rms_displacement(world, mode) for mode in MODES) <= 0.03
    below = BALL.vertices[TOP] - (0.0, 0.0, 0.5)
    for mode in MODES:
        place = world.body_config(mode).position
        assert centre(world, mode) == pytest.approx(place + below, abs=0.05 * 0.5)
    # they hang by their pins, not in the air
    assert min(rms_displacement(world, mode) for mode in SOFT) > 0.0005
    configured(world, pins_indices=())
    world.step(240)
    for mode in MODES:
        assert centre(world, mode)[2] < -4.0


@pytest.mark.parametrize('gravity', [0.0, GRAVITY])
@pytest.mark.parametrize('count', [0, 12])
def test_the_rest_of_a_body_that_is_held_by_a_cap_keeps_its_shape(count, gravity):
    bodies = [
        body(BALL, name=mode, mode=mode, pins_indices=CAP, regions_count=count) for mode in MODES
    ]
    world = floating(*apart(bodies), h=1 / 240, gravity=gravity)
    start = {mode: world.positions(mode) for mode in MODES}
    for _ in range(20):
        world.step(20)
        for mode in MODES:
            assert rms_displacement(world, mode) < (0.01 if gravity else 1e-12)
            moved = np.abs(world.positions(mode) - start[mode])[FREE]
            assert moved.max() < (0.015 if gravity else 1e-12)


def test_bodies_whose_particles_are_all_pinned_do_not_move():
    surface = sheared_box()
    every = tuple(range(len(surface.vertices)))
    bodies = [body(surface, name=mode, mode=mode, pins_indices=every) for mode in MODES]
    world = floating(*apart(bodies), h=1 / 120, gravity=GRAVITY)
    start = {mode: world.positions(mode) for mode in MODES}
    world.step(200)
    for mode in MODES:
        assert world.positions(mode) == pytest.approx(start[mode], abs=1e-12)
        assert np.abs(world.velocities(mode)).max() < 1e-12
    configured(world, **TURNING)
    world.step(240)
    for mode in MODES:
        assert world.positions(mode) == pytest.approx(carried(start[mode], 2.0), abs=1e-10)


AWKWARD = rank_deficient_shapes() | {
    'loose vertex': Surface(np.vstack([BALL.vertices, [(0.0, 0.0, 0.6)]]), BALL.faces)
}


@pytest.mark.parametrize('name', AWKWARD)
def test_shapes_that_span_little_hang_on_one_vertex(name):
    surface = AWKWARD[name]
    last = len(surface.vertices) - 1
    bodies = [
        body(surface, name=f'{mode}{count}', mode=mode, pins_indices=(last,), regions_count=count)
        for mode in MODES
        for count in (0, last + 1)
        if mode != 'rigid' or not count
    ]
    world = floating(*apart(bodies), h=1 / 60, gravity=GRAVITY)
    start = {name: world.positions(name)[last] for name in world.names}
    most = energy(world, 'rigid0')
    arm = np.linalg.norm(centre(world, 'rigid0') - start['rigid0'])
    for _ in range(20):
        world.step(6)
        for each in world.names:
            assert np.isfinite(world.positions(each)).all()
            assert world.positions(each)[last] == pytest.approx(start[each], abs=1e-12)
            assert np.linalg.norm(centre(world, each) - start[each]) < 1.3 * arm + 1e-12
            assert energy(world, each) <= most + 0.01 * GRAVITY * arm


# -------------------------------------------------------------------------------------- swinging
def swing(h, angle, **values):
    """
    Let a ball go that is turned about its pin, for 1.4 periods.

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
    world.set_state('body', arms @ turn.T + pin)
    inertia = weights @ (arms[:, 0] ** 2 + arms[:, 2] ** 2)
    length = -(weights @ arms)[2]
    slow = math.sqrt(inertia / (GRAVITY * length))
    period = 4.0 * slow * ellipk(math.sin(angle / 2.0) ** 2)
    angles = []
    for _ in range(round(1.4 * period / h)):
        world.step()
        x, _, z = centre(world) - pin
        angles.append(math.atan2(x, -z))
    return np.array(angles), period, world


def period_of(angles, h):
    """Return the time from the first passage through 0 to the third, s."""
    before = np.flatnonzero(angles[:-1] * angles[1:] < 0.0)
    passages = before + angles[before] / (angles[before] - angles[before + 1])
    return h * (passages[2] - passages[0])


@pytest.mark.parametrize(
    ('h', 'angle'), [(1 / 60, 0.1), (1 / 60, 1.0), (1 / 60, 2.5), (1 / 240, 1.0)]
)
def test_a_rigid_body_swings_as_a_physical_pendulum_and_swings_on(h, angle):
    angles, period, world = swing(h, angle, mode='rigid')
    assert period_of(angles, h) == pytest.approx(period, rel=0.005)
    # back after one period
    assert angles[round(period / h) - 5 :].max() == pytest.approx(angle, rel=0.01)
    assert rms_displacement(world) < 1e-12


@pytest.mark.parametrize('angle', [0.1, 1.0])
@pytest.mark.parametrize('mode', SOFT)
def test_an_undamped_deformable_body_swings_nearly_so_and_swings_on(mode, angle):
    angles, period, world = swing(1 / 240, angle, mode=mode, bounciness=1.0)
    # it hangs a little longer than it is
    assert period_of(angles, 1 / 240) == pytest.approx(period, rel=0.01)
    assert angles[round(period * 240) - 5 :].max() == pytest.approx(angle, rel=0.01)
    assert rms_displacement(world) < 0.03


@pytest.mark.parametrize('mode', SOFT)
def test_a_body_that_bounces_less_swings_less_and_less_the_same_at_any_step(mode):
    kept = []
    for hertz in (60, 240):
        angles, period, _ = swing(1 / hertz, 0.5, mode=mode)
        assert period_of(angles, 1 / hertz) == pytest.approx(period, rel=0.03)
        kept.append(angles[round(period * hertz) - 5 :].max() / 0.5)
    assert 0.85 < min(kept) < max(kept) < 1.0
    assert kept[0] == pytest.approx(kept[1], rel=0.02)


def test_the_rigid_pendulum_of_an_edge_is_that_of_an_axis():
    surface = make_surface('box', 0.5, 1)
    x, _, z = surface.vertices.T
    edge = tuple(np.flatnonzero((x > 0.49) & (z > 0.49)).tolist())
    world = hanging(surface, edge, mode='rigid')
    start = world.positions('body')[list(edge)]
    for _ in range(50):
        world.step(7)
        assert np.abs(world.positions('body')[list(edge)] - start).max() < 1e-12
        assert energy(world) == pytest.approx(0.0, abs=0.01)
        assert abs(centre(world)[1]) < 1e-12


def kicked(**values):
    """Return a world without gravity of pinned bodies whose particles have been kicked."""
    world = floating(*of_each_kind(SOFT, **values), h=1 / 120)
    kick = 0.3 * np.random.default_rng(1).normal(size=BALL.vertices.shape)
    for name in world.names:
        world.set_state(name, velocities=kick)
    return world


@pytest.mark.parametrize('count', [0, 12])
def test_undamped_pinned_bodies_gain_no_energy(count):
    world = kicked(bounciness=1.0, regions_count=count)

    def mean_kinetic_energies():
        energies = []
        for _ in range(40):
            world.step(3)
            energies.append([kinetic_energy(world, name) for name in world.names])
        return np.mean(energies, axis=0)

    first = mean_kinetic_energies()
    world.step(8 * 120)
    assert first.min() > 0.03
    assert np.all(mean_kinetic_energies() <= 1.05 * first)


@pytest.mark.parametrize('count', [0, 12])
def test_kicked_pinned_bodies_come_to_rest(count):
    world = kicked(regions_count=count)
    world.step(480)
    for name in world.names:
        assert rms_displacement(world, name) < 1e-3
        # on one pin or two they turn on for ever
        assert kinetic_energy(world, name) < (1e-6 if name.endswith('cap') else 0.01)


def test_a_rigid_body_that_is_caught_turns_on_with_its_angular_momentum_about_the_pin():
    surface = sheared_box()
    world = floating(body(surface, mode='rigid'), h=1 / 960)
    world.set_state('body', velocities=np.tile((1.0, -2.0, 0.5), (len(surface.vertices), 1)))
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
def test_moved_pins_follow_their_motion_exactly(h):
    world = floating(*of_each_kind(MODES, **TURNING), h=h, gravity=GRAVITY)
    start = {name: pinned_positions(world, name) for name in world.names}
    world.step(round(2.0 / h))
    for name, place in start.items():
        now = pinned_positions(world, name)
        assert now == pytest.approx(carried(place, 2.0), abs=1e-10)
        expected = np.cross(TURNING['pins_velocity_angular'], now - now.mean(axis=0))
        expected += TURNING['pins_velocity_linear']
        velocities = world.velocities(name)[list(pinned_of(world, name))]
        assert velocities == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize('count', [0, 12])
def test_bodies_follow_their_moved_pins(count):
    bodies = [
        body(BALL, name=mode, mode=mode, pins_indices=CAP, regions_count=count, **TURNING)
        for mode in MODES
    ]
    world = floating(*apart(bodies), h=1 / 240)
    start = {mode: world.positions(mode) for mode in MODES}
    expected = {mode: carried(x, 2.0, x[list(CAP)]) for mode, x in start.items()}
    tolerance = {'rigid': 1e-10, 'linear': 0.005, 'quadratic': 0.005}
    world.step(480)
    for mode in MODES:
        assert world.positions(mode) == pytest.approx(expected[mode], abs=tolerance[mode])
        assert rms_displacement(world, mode) < 0.002
    configured(world, pins_velocity_linear=(0.0,) * 3, pins_velocity_angular=(0.0,) * 3)
    # bends of regions are slow to come to rest
    world.step(1200)
    for mode in MODES:
        assert world.positions(mode) == pytest.approx(expected[mode], abs=2.0 * tolerance[mode])
        assert np.abs(world.velocities(mode)).max() < 1e-6


def test_a_body_with_moved_pins_is_saved_and_restored_bit_by_bit():
    world = hanging(indices=CAP, **TURNING)
    world.step(100)
    assert_goes_on_bit_by_bit(world, 100)
    expected = bytes_of(world)
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
def test_pins_that_are_changed_are_as_if_they_had_always_been_so(mode):
    changed, fresh = (
        hanging(indices=indices, mode=mode, regions_count=12) for indices in ((TOP,), CAP)
    )
    changed.step(30)
    configured(changed, pins_indices=CAP)
    fresh.restore(changed.snapshot())
    for world in (changed, fresh):
        world.step(30)
    assert bytes_of(changed) == bytes_of(fresh)


@pytest.mark.parametrize('mode', MODES)
def test_a_body_that_hangs_still_falls_asleep_and_wakes_when_its_pins_change(mode):
    world = hanging(mode=mode)
    world.step(600)
    assert world.is_asleep('body')
    assert not world.velocities('body').any()
    asleep = world.positions('body')
    world.step(240)
    assert np.array_equal(world.positions('body'), asleep)
    configured(world, pins_velocity_linear=(0.0, 0.0, 0.2))
    assert not world.is_asleep('body')
    world.step(480)
    assert not world.is_asleep('body')
    assert world.positions('body')[TOP] == pytest.approx(asleep[TOP] + (0.0, 0.0, 0.4), abs=1e-10)
    configured(world, pins_velocity_linear=(0.0, 0.0, 0.0))
    world.step(720)
    assert world.is_asleep('body')
    configured(world, pins_indices=())
    assert not world.is_asleep('body')
    height = centre(world)[2]
    world.step(240)
    assert centre(world)[2] < height - 4.0


def test_pins_that_are_moved_slowly_keep_a_body_awake():
    config = body(BALL, pins_indices=(TOP,), pins_velocity_linear=(1e-4, 0.0, 0.0))
    world = floating(config, h=1 / 60)
    world.step(480)
    assert not world.is_asleep('body')
    assert world.positions('body')[TOP] == pytest.approx(BALL.vertices[TOP] + (8e-4, 0.0, 0.0))


def test_a_swinging_body_does_not_fall_asleep():
    world = hanging(indices=(0,), mode='rigid')
    world.step(480)
    assert not world.is_asleep('body')


# ------------------------------------------------------------------------------------ which ones
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
        bodies=(
            body(BALL, name='ball', pins_indices=(0,)),
            body(BALL, name='b', position=(5.0, 0.0, 0.0)),
        ),
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
    assert_as_if_alone(bodies, 60)


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


def test_pinned_bodies_stay_above_the_ground_but_for_their_pins():
    bottom = int(np.argmin(BALL.vertices[:, 2]))
    bodies = [
        body(
            BALL,
            name=f'b{i}',
            mode=mode,
            position=(3.0 * i, 0.0, height),
            pins_indices=indices,
        )
        for i, (height, indices, mode) in enumerate(
            itertools.product((0.45, 0.5, 0.6), ((TOP,), CAP, (bottom,)), SOFT)
        )
    ]
    world = World(WorldConfig(bodies=tuple(bodies)))
    start = {name: pinned_positions(world, name) for name in world.names}
    for _ in range(40):
        world.step(12)
        for name, place in start.items():
            free = np.setdiff1d(np.arange(len(BALL.vertices)), pinned_of(world, name))
            assert world.positions(name)[free, 2].min() > -1e-9
            assert np.array_equal(pinned_positions(world, name), place)
    assert max(rms_displacement(world, name) for name in world.names) < 0.03


@pytest.mark.parametrize('thickness', [0.0, 0.02, 0.1])
def test_a_box_that_is_held_on_the_floor_keeps_its_shape(thickness):
    bodies = [
        body('box', name=mode, mode=mode, subdivisions=2, position=(3.0 * i, 0.0, 0.5),
             thickness=thickness, pins_box=(-1.0, -1.0, -0.6, 1.0, 1.0, -0.4))
        for i, mode in enumerate(MODES)
    ]  # fmt: skip
    world = World(WorldConfig(bodies=tuple(bodies)))
    start = {mode: pinned_positions(world, mode) for mode in MODES}
    world.step(480)
    for mode in MODES:
        assert pinned_positions(world, mode) == pytest.approx(start[mode], abs=1e-12)
        assert rms_displacement(world, mode) < 0.005


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
    world = hanging(mode=mode, plasticity_creep=10.0, plasticity_yield=0.005, stiffness=0.05)
    world.step(1200)
    assert 0.05 < world.permanent_strain('body') <= 0.3 + 1e-12
    assert np.array_equal(world.positions('body')[TOP], BALL.vertices[TOP])


# -------------------------------------------------------------------- no way out for what is held
@pytest.mark.parametrize('friction', [0.0, 0.5])
@pytest.mark.parametrize('mode', ['linear', 'quadratic'])
@pytest.mark.parametrize('angle', [0.55, 0.7, 0.8])
def test_what_is_pushed_into_the_border_of_a_pinned_cap_throws_nothing(mode, angle, friction):
    """There, faces have pinned corners: a free one with a small share cannot make up for them."""
    towards = np.array([np.sin(angle), 0.0, np.cos(angle)])
    finger = ObstacleConfig(
        name='finger', type='sphere', size=(0.1,) * 3, position=tuple(0.61 * towards),
        velocity_linear=tuple(-0.1 * towards),
    )  # fmt: skip
    ball = body(
        'icosphere', subdivisions=2, mode=mode, friction=friction,
        pins_box=(-1.0, -1.0, 0.4, 1.0, 1.0, 1.0),
    )  # fmt: skip
    world = floating(ball, h=1 / 240, reference_step=1 / 240, gravity=9.81)
    world.add(finger)
    for tick in range(480):
        if tick == 192:  # 7 cm deep
            world.move_obstacle('finger', world.obstacles[0].position)
        world.step()
        assert np.abs(world.velocities('body')).max() < 1.0
    assert np.abs(world.velocities('body')).max() < 1e-3
    if angle > 0.6:  # else all that it touches is pinned
        assert np.linalg.norm(world.obstacle_wrench('finger')[0]) > 0.1
