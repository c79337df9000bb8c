# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies with mass inside: they move as solids do, and what is inside stays hidden."""

import dataclasses
import math

from core_helpers import (
    assert_goes_on_bit_by_bit,
    body,
    disturbed,
    floating,
    random_rotation,
    sheet,
)
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from solids import box, cone, hull, l_shape, moved, of_the_solid

from softbody_ros.core import ConfigError, MeshError, ObstacleConfig, World, WorldConfig
from softbody_ros.ensemble.film import Film
from softbody_ros.scene.parameters import make_scene

GRAVITY = 9.81
MODES = ('rigid', 'linear', 'quadratic')


def solid(mesh='icosphere', **values):
    """Return a solid body at the origin."""
    return body(mesh, **{'name': 'body', 'mass_distribution': 'volume'} | values)


def on_slope(each, degrees, h=1 / 240, **values):
    """Return a world of a body and a plane that descends along x, and its normal and downhill."""
    angle = math.radians(degrees)
    orientation = (0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2))
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    each = dataclasses.replace(
        each, orientation=orientation, position=tuple(each.position[2] * normal)
    )
    slope = ObstacleConfig(name='slope', orientation=orientation)
    world = World(WorldConfig(time_step=h, bodies=(each,), obstacles=(slope,), **values))
    return world, normal, np.array([math.cos(angle), 0.0, -math.sin(angle)])


def all_particles(world, name='body'):
    """Return weights (N,), positions and velocities (3, N), with inner particles."""
    state = world.snapshot().states[world.names.index(name)]
    return world.rest_shape(name).weights, state.x, state.v


def momenta(world, name='body'):
    """Return momentum and angular momentum about the origin, per mass, (6,)."""
    w, x, v = all_particles(world, name)
    return np.concatenate([v @ w, np.cross(x, v, axis=0) @ w])


def assert_same_bits(one, other):
    for name in one.names:
        for a, b in zip(all_particles(one, name)[1:], all_particles(other, name)[1:], strict=True):
            assert a.tobytes() == b.tobytes()


# ----------------------------------------------------------------------------- they move as solids
@pytest.mark.parametrize(
    ('distribution', 'below', 'above'), [('volume', 62.9, 63.9), ('surface', 64.7, 65.8)]
)
@pytest.mark.parametrize('mode', ['rigid', 'linear'])
def test_a_cone_tips_where_its_centre_of_mass_says(mode, distribution, below, above):
    """
    Atan (4 R / h) = 63.4° of a solid one, 65.3° of its surface.

    The soft one is stiff, 200 Hz: softer ones lean over the edge first.
    """
    mesh = cone() if mode == 'rigid' else cone(divisions=3)
    for degrees, tips in ((below, False), (above, True)):
        each = body(
            mesh, name='body', mode=mode, mass_distribution=distribution, friction=5.0,
            stiffness=1.0, deformation=0.0,
        )  # fmt: skip
        world, normal, _ = on_slope(each, degrees, reference_step=1 / 1200)
        world.step(480)
        tilt = math.degrees(math.acos(min(normal @ world.rigid_fit('body').rotation[:, 2], 1.0)))
        assert tilt > 10.0 if tips else tilt < 0.5


@pytest.mark.parametrize(('distribution', 'share'), [('volume', 5 / 7), ('surface', 3 / 5)])
def test_a_ball_rolls_down_a_slope(distribution, share):
    """With that share of g sin θ; facets take the rest."""
    ball = body(
        subdivisions=6, name='body', size=0.2, mode='rigid', friction=0.8,
        mass_distribution=distribution, position=(0.0, 0.0, 0.2),
    )  # fmt: skip
    world, _, downhill = on_slope(ball, 30.0, h=1 / 480)
    places = [world.centre_of_mass('body')]
    for _ in range(2):
        world.step(240)
        places.append(world.centre_of_mass('body'))
    acceleration = (places[2] - 2 * places[1] + places[0]) @ downhill / 0.5**2
    assert acceleration == pytest.approx(share * GRAVITY / 2.0, rel=0.015)


def test_it_tumbles_with_the_inertia_of_the_solid():
    """About the middle axis, which is unstable: by Euler's equations."""
    surface = box((1.0, 1.6, 2.6), 1)
    _, _, inertia = of_the_solid(surface)
    start, seconds = np.array([0.05, 3.0, 0.02]), 3.0

    def change(time, state):
        rotation, rate = Rotation.from_quat(state[:4]), state[4:]
        spin = np.linalg.solve(inertia, -np.cross(rate, inertia @ rate))
        turn = 0.5 * (Rotation.from_quat([*rate, 0.0]).as_quat() * np.linalg.norm(rate))
        x, y, z, w = rotation.as_quat()
        a, b, c, d = turn
        return [
            w * a + x * d + y * c - z * b, w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d, w * d - x * a - y * b - z * c, *spin,
        ]  # fmt: skip

    exact = solve_ivp(change, (0, seconds), [0, 0, 0, 1, *start], rtol=1e-10, atol=1e-10)
    expected = Rotation.from_quat(exact.y[:4, -1]).as_matrix()
    errors = {}
    for distribution in ('volume', 'surface'):
        each = solid(
            surface, mode='rigid', initial_velocity_angular=tuple(start),
            mass_distribution=distribution,
        )  # fmt: skip
        world = floating(each, h=1 / 960)
        world.step(round(seconds * 960))
        errors[distribution] = np.abs(world.rigid_fit('body').rotation - expected).max()
    assert errors['volume'] < 1e-3
    assert errors['surface'] > 0.1


@pytest.mark.parametrize('regions', [0, 6])
@pytest.mark.parametrize('mode', MODES)
def test_free_flight_keeps_momentum_and_angular_momentum(mode, regions):
    world = floating(solid(hull(1), mode=mode, regions_count=regions))
    if mode == 'rigid':
        config = dataclasses.replace(
            world.config.bodies[0], initial_velocity_angular=(1.0, 2.0, 3.0)
        )
        world = floating(dataclasses.replace(config, initial_velocity_linear=(1.0, 0.0, -1.0)))
    else:
        disturbed(world)
    before = momenta(world)
    world.step(500)
    assert momenta(world) == pytest.approx(before, abs=1e-11)


@pytest.mark.parametrize('mode', MODES)
def test_it_rests_with_its_weight_and_falls_asleep(mode):
    each = solid('box', subdivisions=2, mode=mode, mass=3.0, position=(0.0, 0.0, 0.55))
    world = World(WorldConfig(bodies=(each,)))
    for _ in range(20):
        world.step(60)
        if world.is_asleep('body'):
            break
    assert world.is_asleep('body')
    assert world.contact_wrench('body')[0] == pytest.approx([0.0, 0.0, 3.0 * GRAVITY], rel=1e-6)
    assert world.normal_forces('body').sum() == pytest.approx(3.0 * GRAVITY, rel=0.01)
    assert world.centre_of_mass('body')[2] == pytest.approx(0.5, abs=0.05)
    world.apply_wrench('body', (0.0, 0.0, 60.0), (0.0, 0.0, 0.0), 0.1)
    world.step()
    assert not world.is_asleep('body')


@pytest.mark.parametrize(
    ('mode', 'drift', 'yaw'),
    [('rigid', 1e-8, 1e-6), ('linear', 1e-3, 0.05), ('quadratic', 3e-3, 0.2)],
)
def test_an_l_lands_without_drift(mode, drift, yaw):
    """It is 30 cm long; a soft one hops a little to the side of its angle. In m and degrees."""
    each = solid(moved(l_shape(2), 0.1), mode=mode, position=(0.0, 0.0, 0.1))
    world = World(WorldConfig(bodies=(each,)))
    start = world.centre_of_mass('body')
    world.step(480)
    turned = world.rigid_fit('body').rotation
    assert np.linalg.norm((world.centre_of_mass('body') - start)[:2]) < drift
    assert abs(math.degrees(math.atan2(turned[1, 0], turned[0, 0]))) < yaw


@pytest.mark.parametrize('mode', MODES)
def test_bodies_that_collide_keep_momentum(mode):
    left = solid('icosphere', name='left', mode=mode, initial_velocity_linear=(2.0, 0.0, 0.0))
    right = solid('box', name='right', mode=mode, subdivisions=2, position=(1.3, 0.1, 0.2))
    world = floating(left, right)
    before = momenta(world, 'left') + momenta(world, 'right')
    world.step(120)
    assert momenta(world, 'right')[0] > 0.1
    assert momenta(world, 'left') + momenta(world, 'right') == pytest.approx(before, abs=1e-9)


def test_what_is_inside_touches_nothing():
    """A small sphere about the inner particle in the centre of a ball."""
    ball = solid('icosphere', subdivisions=3, mode='rigid')
    core = ObstacleConfig(name='core', type='sphere', size=(0.2, 0.2, 0.2))
    world = World(WorldConfig(gravity_magnitude=0.0, bodies=(ball,), obstacles=(core,)))
    world.step(10)
    assert not world.contact_wrench('body')[0].any()
    assert not world.normal_forces('body').any()


# ------------------------------------------------------------------------------- what is published
@pytest.mark.parametrize('regions', [0, 6])
def test_inner_particles_are_not_published(regions):
    world = World(WorldConfig(bodies=(solid(subdivisions=2, regions_count=regions),)))
    world.step(10)
    count = 162
    assert world.positions('body').shape == (count, 3)
    assert world.velocities('body').shape == (count, 3)
    assert world.start_positions('body').shape == (count, 3)
    assert world.normal_forces('body').shape == (count,)
    assert world.pressure('body').shape == (count,)
    assert world.rigid_fit('body').displacement.shape == (count,)
    assert world.rest_shape('body').surface_count == count
    assert world.nearest((0.0, 0.0, 0.0))[1] > 0.4
    x = all_particles(world)[1]
    assert x.shape == (3, world.rest_shape('body').particle_count)
    assert x[:, :count].T.tobytes() == world.positions('body').tobytes()


def test_a_film_shows_vertices_only():
    scene = make_scene({'ball.subdivisions': 2, 'ball.mass_distribution': 'volume'})
    film = Film(scene, 0.1, 20.0)
    assert film.world.rest_shape('ball').particle_count == 163
    for frame in film.frames():
        assert frame.positions['ball'].shape == film.surface('ball').vertices.shape == (162, 3)


def test_its_pose_is_that_of_the_solid():
    surface = moved(cone(), 0.5, (0.1, 0.2, 0.3))
    turn = Rotation.from_matrix(random_rotation(1))
    place = np.array([1.0, 2.0, 3.0])
    world = floating(solid(surface, position=tuple(place), orientation=tuple(turn.as_quat())))
    _, centre, _ = of_the_solid(surface)
    assert world.centre_of_mass('body') == pytest.approx(turn.apply(centre) + place, abs=1e-12)
    fit = world.rigid_fit('body')
    assert fit.position == pytest.approx(place, abs=1e-12)
    assert fit.rotation == pytest.approx(turn.as_matrix(), abs=1e-12)
    assert fit.displacement == pytest.approx(0.0, abs=1e-12)
    world.place('body', np.zeros(3), np.eye(3))
    assert world.centre_of_mass('body') == pytest.approx(centre, abs=1e-12)


def test_open_surfaces_are_refused():
    with pytest.raises(MeshError, match=r'^body\.mass_distribution is volume, but .* open'):
        World(WorldConfig(bodies=(solid(sheet()),)))


def test_it_cannot_change_while_it_runs():
    world = floating(solid())
    other = dataclasses.replace(world.config.bodies[0], mass_distribution='surface')
    config = dataclasses.replace(world.config, bodies=(other,))
    with pytest.raises(ConfigError, match="mass_distribution is 'volume' and cannot change"):
        world.configure(config)


def test_shapes_are_shared_by_bodies_with_the_same_distribution_only():
    world = floating(
        solid(name='one'), solid(name='two', position=(3.0, 0.0, 0.0)),
        solid(name='shell', position=(6.0, 0.0, 0.0), mass_distribution='surface'),
    )  # fmt: skip
    assert world.rest_shape('one') is world.rest_shape('two')
    assert world.rest_shape('shell').particle_count == 42
    assert world.rest_shape('one').particle_count == 43
    world.remove('shell')
    late = solid(name='shell', position=(6.0, 0.0, 0.0))
    prepared = world.prepare(
        dataclasses.replace(world.config, bodies=(*world.config.bodies, late))
    )
    world.adopt(prepared)
    assert world.rest_shape('shell').particle_count == 43


# ----------------------------------------------------------------------------- what sets its state
@pytest.mark.parametrize('regions', [0, 6])
def test_a_snapshot_goes_on_bit_by_bit(regions):
    bodies = [
        solid('icosphere', name='left', subdivisions=2, regions_count=regions,
              position=(0.0, 0.0, 0.8), plasticity_creep=20.0, plasticity_yield=0.01),
        solid('box', name='right', subdivisions=1, position=(0.3, 0.0, 1.9)),
    ]  # fmt: skip
    world = World(WorldConfig(bodies=tuple(bodies)))
    world.step(60)
    assert_goes_on_bit_by_bit(world, 60)
    other = World(WorldConfig(bodies=tuple(bodies)))
    other.step(120)
    assert_same_bits(world, other)
    assert world.permanent_strain('left') > 0.0


def test_a_state_set_to_what_it_is_keeps_all_bits():
    world = floating(solid(hull(1)))
    disturbed(world)
    world.step(7)
    before = all_particles(world)
    world.set_state('body', world.positions('body'), world.velocities('body'))
    for a, b in zip(before, all_particles(world), strict=True):
        assert a.tobytes() == b.tobytes()


def test_a_state_set_elsewhere_takes_along_what_is_inside():
    world = floating(solid(cone(), mode='rigid'))
    rest, turn = world.rest_shape('body'), random_rotation(3)
    shift, spin = np.array([1.0, -2.0, 3.0]), np.array([0.5, 1.0, -1.0])
    surface = rest.surface.vertices @ turn.T + shift
    world.set_state('body', surface, np.cross(spin, surface))
    _, x, v = all_particles(world)
    expected = rest.particles @ turn.T + shift
    places, velocities = x.T, v.T
    assert places == pytest.approx(expected, abs=1e-12)
    assert velocities == pytest.approx(np.cross(spin, expected), abs=1e-12)
    assert world.rigid_fit('body').displacement == pytest.approx(0.0, abs=1e-12)


def test_a_spoilt_state_can_be_set_right():
    world = floating(solid())
    good = world.positions('body')
    world.set_state('body', np.full_like(good, 1e300))
    world.set_state('body', good)
    assert np.isfinite(all_particles(world)[1]).all()


@pytest.mark.parametrize('mode', ['rigid', 'quadratic'])
def test_a_poke_keeps_momentum(mode):
    world = floating(solid(subdivisions=3, mode=mode, mass=2.0))
    assert world.poke((0.5, 0.0, 0.0), 3.0, 0.7) == 'body'
    assert momenta(world)[:3] == pytest.approx([-1.5, 0.0, 0.0], abs=1e-3)
    world.step(5)
    assert momenta(world)[:3] == pytest.approx([-1.5, 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize('regions', [0, 6])
@pytest.mark.parametrize('mode', MODES)
def test_pins_hold_vertices_only(mode, regions):
    world = World(
        WorldConfig(
            bodies=(
                solid('capsule', mode=mode, pins_box=(-1.0, -1.0, 0.3, 1.0, 1.0, 1.0),
                      position=(0.0, 0.0, 3.0), mass=2.0, regions_count=regions),
            ),
        )
    )  # fmt: skip
    start = world.positions('body')
    world.step(1200)
    held = start[:, 2] > 3.3
    assert held.any()
    assert np.array_equal(world.positions('body')[held], start[held])
    assert world.pin_wrench('body')[0] == pytest.approx([0.0, 0.0, 2.0 * GRAVITY], rel=1e-3)
    assert world.is_asleep('body')
    with pytest.raises(ConfigError, match='the mesh has the vertices 0 to 41'):
        floating(solid(pins_indices=(42,)))


def test_what_is_attached_are_vertices():
    hand = ObstacleConfig(name='hand', type='sphere', size=(0.1, 0.1, 0.1))
    ball = solid(subdivisions=2, attach_to='hand', attach_radius=0.3)
    # the hand is in the ball, nearer to what is inside than to any vertex
    with pytest.raises(ConfigError, match=r'the nearest one is 0\.4 m away'):
        World(WorldConfig(bodies=(ball,), obstacles=(hand,)))
    ball = dataclasses.replace(ball, position=(0.0, 0.0, -0.55))
    world = World(WorldConfig(bodies=(ball,), obstacles=(hand,)))
    world.step(1200)
    assert world.pin_wrench('body')[0] == pytest.approx([0.0, 0.0, GRAVITY], rel=1e-3)
