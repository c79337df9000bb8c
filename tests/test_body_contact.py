# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies meet each other without gravity: what is conserved, what rebounds, what cannot fail."""

import dataclasses
import itertools

from core_helpers import (
    assert_goes_on_bit_by_bit,
    assert_kept,
    body,
    bytes_of,
    centre,
    cloud,
    floating,
    momentum,
    random_rotation,
    sheet,
    sizes,
    thin_bin,
    totals,
)
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import BodyConfig, ObstacleConfig, Surface, World, WorldConfig, make_surface
from softbody_ros.core.warm_up import everything

MODES = ('rigid', 'linear', 'quadratic')
H = 1 / 240
GAIN = 1.0 + 1e-12, 1.05
"""Of kinetic energy at most. Pushing thin walls out of each other stretches them a little."""


# --------------------------------------------------------------------------------- measurements
def gap_speed(world):
    """Return how fast the two bodies of a world part along the line between them, m/s."""
    way = centre(world, 'two') - centre(world, 'one')
    speed = momentum(world, 'two') - momentum(world, 'one')
    return speed @ way / np.linalg.norm(way)


def values_of(**values):
    return values


def changed(config, **values):
    """Return a config with other values."""
    return dataclasses.replace(config, **values)


def shared(**values):
    """Return two equal bodies that fly against each other: the one turned by 180° is the other."""
    values = {'mesh': 'icosphere', 'offset': 0.0, 'speed': 2.0, 'gap': 0.55} | values
    offset, speed, gap = (values.pop(name) for name in ('offset', 'speed', 'gap'))
    turn = Rotation.from_rotvec((0.3, 0.7, 0.2)) if values.pop('turned', False) else None
    turn = turn or Rotation.identity()
    return [
        body(
            name=name,
            position=(-sign * gap, sign * offset, 0.0),
            orientation=(Rotation.from_rotvec((0.0, 0.0, angle)) * turn).as_quat(),
            initial_velocity_linear=(sign * speed, 0.0, 0.0),
            **values,
        )
        for name, sign, angle in (('one', 1.0, 0.0), ('two', -1.0, np.pi))
    ]


# ------------------------------------------------------------------------------- two equal bodies
MESHES = {
    'ball': 'icosphere',
    'box': 'box',
    'cylinder': 'cylinder',
    'torus': 'torus',
    'bin': thin_bin(wall=0.2, sections=8),
}


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('mesh', MESHES)
def test_equal_bodies_rebound_alike_and_keep_what_is_to_be_kept(mesh, mode):
    # so far apart that no deformable pair separates with friction that has two solutions: of these
    # the order of contacts chooses one
    gap = 1.28 if mesh == 'bin' else 0.88
    # turned, so that no corner meets an edge: there rounding chooses the face; viscous, for of
    # several solutions with Coulomb friction the order of contacts chooses one
    bodies = shared(mesh=MESHES[mesh], mode=mode, turned=True, gap=gap, offset=0.1,
                    friction_model='viscous', friction=0.2)  # fmt: skip
    world = floating(*bodies, h=H)
    before, scale = totals(world), sizes(world)
    half_turn = np.array([-1.0, -1.0, 1.0])
    most = GAIN[mesh == 'bin']
    met = False
    for _ in range(150):
        world.step()
        after = totals(world)
        assert np.linalg.norm(after[0]) <= 1e-12 * scale[0]
        assert np.linalg.norm(after[1] - before[1]) <= 1e-11 * scale[1]
        assert after[2] <= before[2] * most
        # contacts of edges: those of one and two are solved in another order, to 1e-10 a tick
        assert world.positions('two') == pytest.approx(
            world.positions('one') * half_turn, abs=1e-9 if mode == 'rigid' else 5e-8
        )
        met |= after[2] < 0.99 * before[2]
    assert met
    assert gap_speed(world) > 0.0


@pytest.mark.parametrize('mode', MODES)
def test_bodies_of_more_elasticity_part_faster(mode):
    speeds = []
    for elasticity in (0.0, 0.5, 1.0):
        world = floating(*shared(mode=mode, elasticity=elasticity, subdivisions=2), h=H)
        world.step(120)
        speeds.append(gap_speed(world) / 4.0)
    assert -0.02 <= speeds[0] < speeds[1] - 0.03 < speeds[2] - 0.06
    assert speeds[2] < 1.0 + 1e-9


@pytest.mark.parametrize('ratio', [1.0, 3.0])
@pytest.mark.parametrize('elasticity', [0.0, 0.3, 1.0])
@pytest.mark.parametrize('mesh', ['box', 'icosphere'])
def test_rigid_bodies_have_their_elasticity_as_restitution(mesh, elasticity, ratio):
    # a fine ball: from a coarse one others rebound sideways
    fine = values_of() if mesh == 'box' else values_of(subdivisions=4, turned=True)
    bodies = shared(mesh=mesh, mode='rigid', elasticity=elasticity, friction=0.0, **fine)
    world = floating(bodies[0], changed(bodies[1], mass=ratio), h=H)
    before = totals(world)[2]
    world.step(30)
    # as points on a line: the centre of mass goes on, the difference turns by −ε
    mean = 2.0 * (1.0 - ratio) / (1.0 + ratio)
    expected = [mean - elasticity * (2.0 - mean), mean + elasticity * (2.0 + mean)]
    got = [momentum(world, name)[0] for name in ('one', 'two')]
    # where corners meet corners, rounding decides which of them touch
    assert got == pytest.approx(expected, abs=0.03)
    if elasticity == 1.0:
        assert totals(world)[2] == pytest.approx(before, rel=0.02)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('speed', [1.0, 5.0, 20.0])
def test_bodies_do_not_pass_through_each_other(mode, speed):
    for ratio in (1.0, 1000.0):
        one, two = shared(mode=mode, speed=speed, gap=0.6)
        world = floating(one, changed(two, mass=ratio), h=H)
        for _ in range(70):
            world.step()
            assert centre(world, 'one')[0] < centre(world, 'two')[0]
        assert gap_speed(world) > 0.0


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('speed', [5.0, 20.0])
def test_a_fast_ball_does_not_pass_through_a_thin_plate(speed, mode, h):
    # at 20 m/s and 1/60 s by 17 times its thickness in a tick, and by more than all of the ball
    cube = make_surface('box', 1.0, 0)
    plate = Surface(cube.vertices * (0.5, 0.5, 0.01), cube.faces)
    ball = body(name='ball', size=0.05, mode=mode, mass=0.1, subdivisions=2,
                position=(0.1, 0.03, 0.403), elasticity=0.5,
                initial_velocity_linear=(0.0, 0.0, -speed))  # fmt: skip
    plate = body(name='plate', mesh=plate, mesh_scale=1.0, mode='rigid', mass=5.0, elasticity=0.5)
    for bodies in ((plate, ball), (ball, plate)):
        world = floating(*bodies, h=h)
        before, scale = totals(world), sizes(world)
        world.step(round(0.6 / (speed * h)) + 2)
        assert_kept(world, before, scale)
        assert totals(world)[2] <= before[2] * (1.0 + 1e-9)
        assert centre(world, 'ball')[2] > centre(world, 'plate')[2]


# -------------------------------------------------------------------------------- unequal bodies
UNEQUAL = {
    'masses': (values_of(mass=0.01), values_of(mass=10.0)),
    'sizes': (values_of(size=0.15), values_of(subdivisions=2)),
    'fine and coarse': (values_of(subdivisions=0), values_of(subdivisions=3)),
    'rigid on soft': (values_of(mode='rigid'), values_of(mode='quadratic')),
    'linear on quadratic': (values_of(mode='linear', stiffness=0.1), values_of()),
    'rigid on linear': (values_of(mode='rigid', mass=20.0), values_of(mode='linear')),
    'box on cylinder': (values_of(mesh='box'), values_of(mesh='cylinder', mode='rigid')),
    'torus on capsule': (values_of(mesh='torus'), values_of(mesh='capsule', mode='linear')),
    'bin on ball': (values_of(mesh=MESHES['bin'], mode='linear'), values_of()),
    'regions': (values_of(subdivisions=2, regions_count=12), values_of(mesh='box')),
    'regions on regions': (values_of(regions_count=6), values_of(regions_count=6)),
    'rigid and regions': (values_of(mode='rigid', regions_count=6), values_of(regions_count=12)),
    'dents': (values_of(plasticity_creep=30.0, plasticity_yield=0.02), values_of(mode='rigid')),
    'thick': (values_of(thickness=0.05), values_of(thickness=0.02, mode='linear')),
    'bouncy': (values_of(bounciness=1.0, elasticity=1.0), values_of(bounciness=0.9)),
    'stiff and damped': (values_of(stiffness=1.0, damping=0.3), values_of(stiffness=0.05)),
    'sheet': (values_of(mesh=sheet()), values_of()),
    'cloud': (values_of(mesh=cloud(make_surface('box', 0.4, 1).vertices)), values_of()),
}


def unequal(name, friction):
    """Return bodies that meet off centre, spinning."""
    one, two = UNEQUAL[name]
    start = values_of(
        position=(-1.2, 0.15, -0.1), orientation=(0.1, 0.5, 0.2, 0.8),
        initial_velocity_linear=(3.0, 0.0, 0.3), initial_velocity_angular=(1.0, -3.0, 2.0),
    )  # fmt: skip
    return [
        body(**{**start, 'name': 'one', **friction, **one}),
        body(**{'name': 'two', 'initial_velocity_angular': (2.0, 0.5, 0.0), **friction, **two}),
    ]


FRICTIONS = {
    'viscous': values_of(friction=0.4, friction_model='viscous'),
    'coulomb': values_of(friction=0.6, friction_model='coulomb'),
}


@pytest.mark.parametrize(
    ('name', 'friction'), list(zip(UNEQUAL, itertools.cycle(FRICTIONS), strict=False))
)
def test_what_one_body_gets_the_other_one_gives(name, friction):
    world = floating(*unequal(name, FRICTIONS[friction]), h=H)
    before, scale = totals(world), sizes(world)
    speed = momentum(world, 'two')
    for _ in range(16):
        world.step(6)
        assert_kept(world, before, scale)
        assert totals(world)[2] <= before[2] * (1.0 + 1e-9)
    assert np.linalg.norm(momentum(world, 'two') - speed) > 1e-3  # they have met


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('model', ['viscous', 'coulomb'])
def test_friction_makes_a_grazing_ball_spin_and_without_friction_it_does_not(model, mode):
    spins = []
    for friction in (0.0, 0.5):
        bodies = shared(
            mode=mode, subdivisions=3, gap=0.6, offset=0.35, friction=friction,
            friction_model=model,
        )  # fmt: skip
        world = floating(*bodies, h=H)
        world.step(80)
        spins.append(world.rigid_fit('one').angular_velocity)
    # both turn about z as the lower side of the upper one is held back
    # rigid ones spin a little without friction, too: they meet at the corners of their faces
    assert abs(spins[0][2]) < 0.5 * abs(spins[1][2])
    assert spins[1][2] - spins[0][2] < -0.3
    assert np.abs(spins[1][:2]).max() < 0.4 * abs(spins[1][2])


@pytest.mark.parametrize('mode', MODES)
def test_a_pinned_body_throws_back_what_hits_it_and_stays(mode):
    one, two = shared(mode=mode, subdivisions=2, elasticity=0.8)
    pins = np.flatnonzero(make_surface('icosphere', 0.5, 2).vertices[:, 0] < -0.2)  # the far side
    two = changed(two, pins_indices=pins, initial_velocity_linear=(0.0, 0.0, 0.0))
    world = floating(one, two, h=H)
    place = world.positions('two')[pins]
    world.step(120)
    assert world.positions('two')[pins] == pytest.approx(place, abs=1e-12)
    assert momentum(world, 'one')[0] < -0.1
    assert np.abs(world.positions('two') - world.positions('two')[0]).max() < 1.2


# ------------------------------------------------------------------------------------ many bodies
def crowded(seed, count=12):
    """Return bodies of mixed shapes and kinds that fly towards a common middle, spinning."""
    random = np.random.default_rng(seed)
    meshes = itertools.cycle(['icosphere', 'box', 'cylinder', 'torus', MESHES['bin'], 'capsule'])
    bodies = []
    for i, mesh in zip(range(count), meshes, strict=False):
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        bodies.append(
            body(
                mesh,
                name=f'b{i}',
                size=random.uniform(0.3, 0.6),
                mass=10.0 ** random.uniform(-1.0, 1.0),
                mode=MODES[i % 3],
                regions_count=6 * (i % 4 == 3),
                friction_model=('viscous', 'coulomb')[i % 2],
                position=(1.5 + 0.1 * i) * direction,
                orientation=Rotation.from_matrix(random_rotation(i)).as_quat(),
                initial_velocity_linear=-3.0 * direction + 0.5 * random.normal(size=3),
                initial_velocity_angular=random.normal(size=3),
            )
        )
    return floating(*bodies, h=1 / 120)


def test_a_crowd_keeps_its_momentum_and_angular_momentum():
    world = crowded(1)
    before, scale = totals(world), sizes(world)
    velocities = {name: momentum(world, name) for name in world.names}
    for _ in range(20):
        world.step(10)
        assert_kept(world, before, scale)
    changed = [np.linalg.norm(momentum(world, n) - v) > 0.1 for n, v in velocities.items()]
    assert sum(changed) > 8


def row_of_balls(gap, h, mode='rigid'):
    """Return a world of four balls of 5 cm along x with gaps, the first one of 5 m/s."""
    radius = 0.05
    places = [-0.3, *((2.0 * radius + gap) * number for number in range(3))]
    balls = [
        body(name=f'ball{number}', mode=mode, size=radius, subdivisions=2, mass=0.2,
             position=(x, 0.0, 0.0), initial_velocity_linear=(5.0 * (number == 0), 0.0, 0.0))
        for number, x in enumerate(places)
    ]  # fmt: skip
    return floating(*balls, h=h)


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
@pytest.mark.parametrize('gap', [0.002, 0.01])
def test_a_body_that_is_struck_gets_into_no_third_one(gap, h):
    """It is displaced much farther than a body at rest looks for others."""
    world = row_of_balls(gap, h)
    before, scale = totals(world), sizes(world)
    start = {name: momentum(world, name) for name in world.names}
    for _ in range(round(0.12 / h)):
        world.step()
        centres = np.array([centre(world, name) for name in world.names])
        assert np.linalg.norm(np.diff(centres, axis=0), axis=1).min() > 0.98 * 0.1
        assert_kept(world, before, scale)
    assert momentum(world, world.names[-1])[0] > 1.0
    for name in world.names:  # what was computed in vain counts for nothing
        given = 0.2 * (momentum(world, name) - start[name])
        assert world.contact_impulse(name).impulse == pytest.approx(given, abs=1e-9)


def test_a_flight_that_is_computed_once_more_is_the_same():
    world = everything()  # rigid, with regions, pins, plasticity, …
    world.step(20)
    state, integrator = world._state, world._integrator

    def flight():
        integrator.fly(np.arange(len(world.names)), world.gravity, world.config.time_step)
        arrays = (state.x, state.v, state.stretch, state.match_centre, state.match_posture)
        return [each.tobytes() for each in (state.bodies, *arrays)]

    once = flight()
    assert flight() == once
    world.step()  # the other half of `x` holds contacts, too
    assert flight() != once


@pytest.mark.parametrize('mode', MODES)
def test_a_row_that_is_saved_and_restored_goes_on_bit_by_bit(mode):
    world = row_of_balls(0.002, 1 / 60, mode)
    world.step(2)
    assert_goes_on_bit_by_bit(world, 6)


def test_a_crowd_that_is_saved_and_restored_goes_on_bit_by_bit():
    world = crowded(3, count=7)
    world.step(50)
    assert_goes_on_bit_by_bit(world, 20)
    fresh = crowded(3, count=7)
    fresh.step(70)
    assert bytes_of(fresh) == bytes_of(world)


def test_bodies_that_do_not_meet_move_as_if_alone():
    meeting = shared()
    alone = body('torus', name='alone', position=(5.0, 0.0, 0.0), stiffness=0.1,
                 initial_velocity_angular=(5.0, 0.0, 1.0))  # fmt: skip
    other = body(name='other', position=(-5.0, 0.0, 0.0))
    together = floating(*meeting, alone, other, h=H)
    separate = floating(alone, other, h=H)
    for world in (together, separate):
        world.step(100)
    for name in ('alone', 'other'):
        assert together.positions(name) == pytest.approx(separate.positions(name), abs=1e-12)
        assert together.velocities(name) == pytest.approx(separate.velocities(name), abs=1e-11)


# ------------------------------------------------------------------------------ without an inside
OPEN = {
    'sheet': sheet(),
    'cloud': cloud(make_surface('box', 0.5, 1).vertices),
    'bowl': Surface(
        make_surface('icosphere', 0.5, 2).vertices, make_surface('icosphere', 0.5, 2).faces[:200]
    ),
}


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('shape', OPEN)
def test_the_vertices_of_what_has_no_inside_are_kept_out_of_closed_bodies(shape, mode):
    one = body(
        OPEN[shape], name='one', mode=mode, position=(0.0, 0.0, 1.2),
        initial_velocity_linear=(0.0, 0.0, -2.0),
    )  # fmt: skip
    world = floating(one, body('box', name='two', subdivisions=2, mode='rigid', mass=5.0), h=H)
    world.step(150)
    assert momentum(world, 'one')[2] > -0.5
    assert momentum(world, 'two')[2] < -0.1


def test_two_clouds_pass_through_each_other():
    one, two = shared(mesh=OPEN['cloud'])
    world = floating(one, two, h=H)
    world.step(240)
    assert [momentum(world, name)[0] for name in ('one', 'two')] == pytest.approx([2.0, -2.0])


# --------------------------------------------------------------------------------- its own regions
def bar(sections=40, radius=0.1):
    """Return a round bar of length 4 along x."""
    rings = np.linspace(-2.0, 2.0, sections + 1)
    angles = np.arange(8) * np.pi / 4
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = [np.column_stack([np.full(8, x), ring]) for x in rings]
    ends = np.array([(rings[0], 0.0, 0.0), (rings[-1], 0.0, 0.0)])
    last = 8 * sections
    faces = []
    for i in range(8):
        j = (i + 1) % 8
        for k in range(sections):
            a, b, c, d = 8 * k + i, 8 * k + j, 8 * k + 8 + i, 8 * k + 8 + j
            faces += [(a, d, c), (a, b, d)]
        first, second = last + 8, last + 9
        faces += [(first, j, i), (second, last + i, last + j)]
    faces = np.array(faces)
    points = np.vstack([*vertices, ends])
    if np.einsum('ij,ij->', np.cross(points[faces[:, 0]], points[faces[:, 1]]),
                 points[faces[:, 2]]) < 0.0:  # fmt: skip
        faces = faces[:, ::-1]
    return Surface(points, faces)


def wound(vertices, turns, gap):
    """Return the bar's vertices wound to a ring whose ends lie a gap above each other."""
    x, y, z = vertices.T
    radius = 4.0 / (2.0 * np.pi) + y
    angle = 2.0 * np.pi * turns * x / 4.0
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z + gap * x / 4.0], axis=1)


@pytest.mark.parametrize('mode', ['linear', 'quadratic'])
@pytest.mark.parametrize('speed', [0.5, 1.0])
def test_the_ends_of_a_bent_bar_do_not_pass_through_each_other(speed, mode):
    surface = bar()
    world = floating(
        body(
            surface, name='bar', mode=mode, regions_count=16, regions_whole_body_weight=0.0,
            stiffness=0.3, friction=0.0,
        ),
        h=1 / 120,
    )  # fmt: skip
    left, right = surface.vertices[:, 0] < -1.5, surface.vertices[:, 0] > 1.5
    velocities = np.zeros_like(surface.vertices)
    velocities[left, 2], velocities[right, 2] = speed, -speed
    world.set_state('bar', wound(surface.vertices, turns=1.1, gap=0.3), velocities)
    before, scale = totals(world), sizes(world)
    heights = []
    for _ in range(60):
        world.step()
        x = world.positions('bar')
        heights.append(x[right, 2].mean() - x[left, 2].mean())
        assert_kept(world, before, scale)
    # two radii are 0.2: pressed together, and thrown back
    assert 0.05 < min(heights) < 0.2
    assert heights[-1] > min(heights)


@pytest.mark.parametrize(('count', 'overlap'), [(6, 1), (12, 3), (42, 1), (42, 3)])
@pytest.mark.parametrize('mesh', ['icosphere', 'box', 'torus', 'cylinder'])
def test_parts_of_a_body_at_rest_do_not_touch_each_other(mesh, count, overlap):
    surface = make_surface(mesh, 0.5, 1)
    config = body(
        surface, regions_count=min(count, len(surface.vertices)), regions_overlap=overlap
    )
    world = floating(config, h=H)
    before = world.positions('body')
    world.step(20)
    assert world.positions('body') == pytest.approx(before, abs=1e-12)


# ------------------------------------------------------------------------------ overlapping starts
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize(
    ('other', 'distance'),
    [
        ('icosphere', 0.0), ('icosphere', 0.2), ('icosphere', 0.6), ('box', 0.0), ('box', 0.6),
        ('torus', 1e-9), ('torus', 0.2),
    ],
)  # fmt: skip
def test_bodies_put_into_each_other_stay_slow_and_finite(mode, other, distance):
    world = floating(
        body(name='one', mode=mode),
        body(other, name='two', mode=mode, position=(distance, 0.0, 0.0)),
        h=H,
    )
    before = centre(world, 'two') - centre(world, 'one')
    for _ in range(12):
        world.step(4)
        for name in world.names:
            assert np.abs(world.velocities(name)).max() < 40.0
            assert np.abs(world.positions(name)).max() < 20.0
        assert np.linalg.norm(totals(world)[0]) < 1e-12
        assert np.linalg.norm(totals(world)[1]) < 1e-9
    after = centre(world, 'two') - centre(world, 'one')
    if distance > 0.5:
        assert np.linalg.norm(after) >= np.linalg.norm(before)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('distance', [0.1, 0.2, 0.4])
def test_balls_put_deep_into_each_other_come_apart(mode, distance):
    one, two = body(name='one', mode=mode), body(name='two', mode=mode)
    world = floating(one, changed(two, position=(distance, 0.0, 0.0)), h=1 / 240)
    world.step(240)
    assert centre(world, 'two')[0] - centre(world, 'one')[0] > 0.9


def test_elasticity_of_two_is_the_geometric_mean():
    one, two = shared(mesh='box', mode='rigid', friction=0.0)
    world = floating(changed(one, elasticity=0.25), changed(two, elasticity=1.0), h=H)
    before = momentum(world, 'one')[0]
    world.step(30)
    assert momentum(world, 'one')[0] == pytest.approx(-0.5 * before, abs=0.03)


# ------------------------------------------------------------------------------------------ fuzz
SURFACES = {**OPEN, 'bin': MESHES['bin']}
logarithms = st.floats(-1.5, 1.5).map(lambda exponent: 10.0**exponent)
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
fuzz_bodies = st.fixed_dictionaries(
    {
        'mesh': st.sampled_from(['icosphere', 'box', 'cylinder', 'torus', 'capsule', *SURFACES]),
        'subdivisions': st.integers(0, 2),
        'mode': st.sampled_from(MODES),
        'size': st.sampled_from([0.1, 0.5, 1.0, 2.0]),
        'mass': logarithms,
        'position': vectors.map(lambda place: 2.0 * place),
        'orientation': st.integers(0, 99).map(
            lambda seed: Rotation.from_matrix(random_rotation(seed)).as_quat()
        ),
        'initial_velocity_linear': vectors.map(lambda velocity: 11.5 * velocity),
        'initial_velocity_angular': vectors.map(lambda velocity: 10.0 * velocity),
        'thickness': st.sampled_from([0.0, 0.0, 0.02]),
        'stiffness': st.sampled_from([0.05, 0.5, 1.0]),
        'bounciness': st.sampled_from([0.0, 0.5, 1.0]),
        'elasticity': st.sampled_from([0.0, 0.5, 1.0]),
        'friction': st.sampled_from([0.0, 0.3, 1.0]),
        'friction_model': st.sampled_from(['viscous', 'coulomb']),
        'regions_count': st.sampled_from([0, 0, 5]),
        'plasticity_creep': st.sampled_from([0.0, 0.0, 30.0]),
    }
)


@settings(max_examples=10)
@given(
    st.lists(fuzz_bodies, min_size=2, max_size=6), st.booleans(), st.sampled_from([60, 240]),
)  # fmt: skip
def test_any_scene_goes_on_and_keeps_its_momentum(bodies, ground, rate):
    bodies = tuple(
        BodyConfig(**{**values, 'name': f'b{i}', 'mesh': SURFACES.get(mesh, mesh)})
        for i, values in enumerate(bodies)
        for mesh in [values['mesh']]
    )
    config = WorldConfig(
        time_step=1 / rate,
        bodies=bodies,
        gravity_magnitude=9.81 if ground else 0.0,
        obstacles=(ObstacleConfig(position=(0.0, 0.0, -1.5)),) if ground else (),
    )
    world = World(config)
    before, scale = totals(world), sizes(world)
    tolerance = 1e-9
    for _ in range(6):
        world.step(10)
        for name in world.names:
            assert np.isfinite(world.positions(name)).all()
            assert np.abs(world.velocities(name)).max() < 1000.0
        if not ground:
            far = max(np.abs(world.positions(name)).max() for name in world.names)
            assert_kept(world, before, (scale[0], scale[1] + far * scale[0]), tolerance)
