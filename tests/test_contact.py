# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact: distances to obstacles, restitution, both laws of friction, moving obstacles."""

from core_helpers import (
    body,
    bytes_of,
    centre,
    enclosed_volume,
    momentum,
    random_rotation,
    rms_displacement,
    sheet,
)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import BodyConfig, ObstacleConfig, Surface, World, WorldConfig
from softbody_ros.core.collision import obstacles
from softbody_ros.core.contact.workspace import Workspace, enlarged

H = 1 / 240
G = 9.81
MODES = ('rigid', 'linear', 'quadratic')


# -------------------------------------------------------------------------------------- distances
def distances(kind, points, size):
    """Return signed distances (k,) and normals (k, 3) of points in the frame of a shape."""
    return obstacles.placed(ObstacleConfig(type=kind, size=tuple(size))).distance(points)


SIZES = {
    'sphere': (0.7, 1.0, 1.0),
    'capsule': (0.3, 1.0, 0.9),
    'box': (0.5, 0.8, 0.3),
    'cylinder': (0.5, 1.0, 0.6),
    'plane': (1.0, 1.0, 1.0),
}


def on_the_surface(kind, size, count=50_000):
    """Return points spread over the surface of a shape, (k, 3)."""
    random = np.random.default_rng(0)
    size = np.array(size)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    if kind == 'plane':
        return random.uniform(-4.0, 4.0, (count, 3)) * (1.0, 1.0, 0.0)
    if kind == 'sphere':
        return size[0] * directions
    if kind == 'capsule':
        straight = size[2] - size[0]
        ends = size[0] * directions
        ends[:, 2] += np.copysign(straight, ends[:, 2])
        side = directions * (1.0, 1.0, 0.0)
        side *= size[0] / np.linalg.norm(side, axis=1)[:, None]
        side[:, 2] = random.uniform(-straight, straight, count)
        return np.vstack([ends, side])
    if kind == 'cylinder':
        wall = directions * (1.0, 1.0, 0.0)
        wall *= size[0] / np.linalg.norm(wall, axis=1)[:, None]
        lids = wall * np.sqrt(random.uniform(size=(count, 1)))
        wall[:, 2] = random.uniform(-size[2], size[2], count)
        lids[:, 2] = random.choice([-size[2], size[2]], count)
        return np.vstack([wall, lids])
    points = random.uniform(-size, size, (count, 3))
    face = random.integers(3, size=count)
    row = np.arange(count)
    points[row, face] = np.copysign(size[face], points[row, face])
    return points


def is_inside(kind, size, points):
    x, y, z = points.T
    if kind == 'plane':
        return z < 0
    if kind == 'sphere':
        return x**2 + y**2 + z**2 < size[0] ** 2
    if kind == 'box':
        return np.all(np.abs(points) < size, axis=1)
    if kind == 'cylinder':
        return (x**2 + y**2 < size[0] ** 2) & (np.abs(z) < size[2])
    above = np.maximum(np.abs(z) - (size[2] - size[0]), 0.0)
    return x**2 + y**2 + above**2 < size[0] ** 2


@pytest.mark.parametrize('kind', SIZES)
def test_the_distance_is_that_of_the_nearest_point_of_the_surface(kind):
    size = np.array(SIZES[kind])
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (200, 3))
    distance, normal = distances(kind, points, size)
    samples = on_the_surface(kind, size)
    nearest = np.array([np.linalg.norm(samples - point, axis=1).min() for point in points])
    assert np.abs(distance) == pytest.approx(nearest, abs=0.04)
    assert np.all(np.abs(distance) <= nearest + 1e-12)
    assert np.array_equal(distance < 0, is_inside(kind, size, points))
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    feet = points - distance[:, None] * normal
    assert distances(kind, feet, size)[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize('kind', SIZES)
def test_special_points_have_a_way_out_too(kind):
    size = np.array(SIZES[kind])
    special = np.array(
        [
            (0.0, 0.0, 0.0),
            (size[0], 0.0, 0.0),
            (0.0, 0.0, size[2]),
            (0.0, 0.0, -size[2] - 1.0),
            size,
            -size,
        ]
    )
    distance, normal = distances(kind, special, size)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    feet = special - distance[:, None] * normal
    assert distances(kind, feet, size)[0] == pytest.approx(0.0, abs=1e-12)


def test_a_capsule_shorter_than_its_radius_is_a_sphere():
    points = np.random.default_rng(2).normal(size=(50, 3))
    short = distances('capsule', points, np.array([0.5, 0.5, 0.2]))
    ball = distances('sphere', points, np.array([0.5, 0.5, 0.5]))
    assert short[0] == pytest.approx(ball[0])
    assert short[1] == pytest.approx(ball[1])


# --------------------------------------------------------------------------------- one particle
CORNERS = np.array([(2.0, 0.0, 0.0), (-1.0, 3.0**0.5, 0.0), (-1.0, -(3.0**0.5), 0.0)])
POINT = Surface(1e-6 * CORNERS, np.array([(0, 1, 2)]))


def collided(velocity, obstacle=None, position=(0.0, 0.0, -0.01), h=H, **values):
    """Return position and velocity of a particle that contact keeps from getting to a position."""
    start = np.subtract(position, h * np.array(velocity))
    config = BodyConfig(name='point', mesh=POINT, position=tuple(start), **values)
    world = World(
        WorldConfig(
            time_step=h,
            gravity_magnitude=0.0,
            bodies=(config,),
            obstacles=(obstacle or ObstacleConfig(),),
        )
    )
    world.set_state('point', velocities=np.tile(velocity, (3, 1)))
    world.step()
    return world.positions('point').mean(axis=0), world.velocities('point').mean(axis=0)


# contacts of deformable bodies have a little compliance for velocities
STOPS = 5e-3


@pytest.mark.parametrize('elasticity', [0.0, 1.0])
def test_a_particle_stops_at_the_surface_whatever_the_elasticity_of_its_body(elasticity):
    x, v = collided((0.0, 0.0, -3.0), elasticity=elasticity)
    assert x == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert v == pytest.approx([0.0, 0.0, 0.0], abs=3.0 * STOPS)


def test_a_particle_that_leaves_is_not_held_back():
    _, v = collided((0.0, 0.0, 4.0))
    assert v[2] == pytest.approx(4.0, rel=1e-12)


def test_a_particle_outside_feels_nothing():
    for position in ((0.0, 0.0, 0.01), (0.0, 0.0, 5.0)):
        x, v = collided((1.0, 0.0, -3.0), position=position)
        assert x == pytest.approx(position, abs=1e-12)
        assert v == pytest.approx((1.0, 0.0, -3.0), rel=1e-12)


def test_coulomb_friction_is_bounded_by_the_normal_impulse():
    for speed, expected in ((5.0, 5.0 - 0.4 * 3.0), (0.7, 0.0)):
        _, v = collided((speed, 0.0, -3.0), friction=0.4, friction_model='coulomb')
        assert v == pytest.approx([expected, 0.0, 0.0], abs=3.0 * STOPS)


def test_without_friction_the_sliding_velocity_stays():
    for model in ('viscous', 'coulomb'):
        _, v = collided((2.0, 1.0, -3.0), friction=0.0, friction_model=model)
        assert v[:2] == pytest.approx([2.0, 1.0])


def test_contact_and_friction_are_relative_to_the_obstacle():
    belt = ObstacleConfig(velocity_linear=(1.0, 0.0, 2.0))
    _, v = collided((1.0, 3.0, -3.0), belt, friction=1.0, friction_model='coulomb')
    assert v == pytest.approx([1.0, 0.0, 2.0], abs=5.0 * STOPS)


def test_a_turning_obstacle_drags_by_its_speed_at_the_contact():
    table = ObstacleConfig(position=(1.0, 0.0, 0.0), velocity_angular=(0.0, 0.0, 2.0))
    _, v = collided((0.0, 0.0, -3.0), table, (1.5, 0.5, -0.01), friction=1.0,
                    friction_model='coulomb')  # fmt: skip
    assert v == pytest.approx([-1.0, 1.0, 0.0], abs=3.0 * STOPS)


def test_thickness_keeps_the_distance():
    x, v = collided((0.0, 0.0, -3.0), position=(0.0, 0.0, 0.095), thickness=0.1)
    assert x[2] == pytest.approx(0.1, abs=1e-12)
    assert abs(v[2]) < 3.0 * STOPS


@pytest.mark.parametrize('kind', SIZES)
def test_a_particle_is_brought_to_the_surface_of_a_turned_obstacle(kind):
    turn = Rotation.from_matrix(random_rotation(4))
    obstacle = ObstacleConfig(
        type=kind, size=SIZES[kind], position=(1.0, 2.0, 3.0), orientation=turn.as_quat()
    )
    local = np.array([0.02, 0.05, 0.25]) if kind != 'plane' else np.array([0.3, 0.4, -0.2])
    distance, normal = distances(kind, local[None], np.array(SIZES[kind]))
    assert distance[0] < 0
    # from as far outside as it would get inside
    velocity = turn.apply(2.0 * distance[0] / H * normal[0])
    x, v = collided(velocity, obstacle, np.add(turn.apply(local), obstacle.position))
    expected = local - distance[0] * normal[0]
    assert turn.inv().apply(x - obstacle.position) == pytest.approx(expected, abs=1e-5)
    assert np.abs(v).max() < STOPS * np.linalg.norm(velocity)


# --------------------------------------------------------------------------------------- bodies
def on_ground(config, ground=None, h=H, **values):
    """Return the world of one body on the ground."""
    return World(
        WorldConfig(
            time_step=h,
            gravity_magnitude=G,
            bodies=(config,),
            obstacles=(ground or ObstacleConfig(),),
            **values,
        )
    )


def test_nothing_is_ever_inside_an_obstacle_after_a_tick():
    tilt = Rotation.from_euler('xyz', (10, 20, 0), degrees=True).as_quat()
    for kind in SIZES:
        ground = ObstacleConfig(
            type=kind, size=(2.0, 2.0, 2.0), position=(0.1, 0.0, -2.0), orientation=tilt
        )
        for mode in MODES:
            config = body(mode=mode, position=(0.0, 0.0, 1.0), thickness=0.02)
            world = World(WorldConfig(bodies=(config,), obstacles=(ground,)))
            touched = False
            for _ in range(240):
                world.step()
                local = (world.positions('body') - ground.position) @ world.obstacles[0].rotation
                distance = distances(kind, local, np.array(ground.size))[0]
                assert distance.min() >= 0.02 - 1e-12
                # a round obstacle touches faces before it touches vertices
                touched |= distance.min() < (
                    0.05 if kind in ('sphere', 'capsule') else 0.02 + 1e-12
                )
            assert touched


@pytest.mark.parametrize('mode', MODES)
def test_a_body_at_rest_keeps_its_thickness_from_the_ground(mode):
    world = on_ground(
        body('box', mode=mode, position=(0.0, 0.0, 0.6), thickness=0.05, stiffness=0.9)
    )
    world.step(1000)
    assert world.positions('body')[:, 2].min() == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
@pytest.mark.parametrize('mode', MODES)
def test_viscous_friction_slows_a_sliding_sheet_alike_at_any_step(mode, h):
    world = on_ground(
        body(
            sheet(), mode=mode, friction=0.05, friction_model='viscous',
            initial_velocity_linear=(2.0, 1.0, 0.0),
        ),
        h=h,
    )  # fmt: skip
    world.step(round(0.5 / h))
    expected = np.array([2.0, 1.0]) * 0.95 ** (0.5 * 120)
    assert momentum(world)[:2] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('shape', ['sheet', 'box'])
def test_coulomb_friction_slows_a_sliding_body_by_mu_g_until_it_stops(mode, shape):
    mesh, height = (sheet(), 0.0) if shape == 'sheet' else ('box', 0.5)
    world = on_ground(
        body(
            mesh,
            mode=mode,
            position=(0.0, 0.0, height),
            friction=0.2,
            friction_model='coulomb',
            stiffness=0.9,
            elasticity=0.0,
            initial_velocity_linear=(2.0, 0.0, 0.0),
        )
    )
    world.step(48)
    fast = momentum(world)[0]
    world.step(96)
    assert (fast - momentum(world)[0]) / 0.4 == pytest.approx(0.2 * G, rel=0.05)
    world.step(240)
    stopped = centre(world)
    world.step(240)
    assert centre(world) == pytest.approx(stopped, abs=1e-3)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('shape', ['sheet', 'box'])
def test_a_body_stays_on_an_incline_of_slope_less_than_mu_and_slides_on_a_steeper(shape, mode):
    mesh, height = (sheet(), 0.0) if shape == 'sheet' else ('box', 0.5)
    angle = np.radians(10.0)
    tilt = Rotation.from_euler('y', angle)
    downhill = tilt.apply((1.0, 0.0, 0.0))
    for friction, pull in ((0.4, 0.0), (0.05, G * (np.sin(angle) - 0.05 * np.cos(angle)))):
        world = on_ground(
            body(
                mesh,
                mode=mode,
                position=tilt.apply((0.0, 0.0, height)),
                orientation=tilt.as_quat(),
                friction=friction,
                friction_model='coulomb',
                stiffness=0.9,
            ),
            ObstacleConfig(orientation=tilt.as_quat()),
        )
        world.step(240)
        first = centre(world) @ downhill
        assert first == pytest.approx(pull / 2, rel=0.02, abs=0.005)
        world.step(240)
        assert centre(world) @ downhill - first == pytest.approx(1.5 * pull, rel=0.02, abs=0.001)


@pytest.mark.parametrize('model', ['viscous', 'coulomb'])
@pytest.mark.parametrize('mode', MODES)
def test_a_conveyor_belt_carries_a_body_along(mode, model):
    belt = ObstacleConfig(velocity_linear=(0.8, 0.0, 0.0))
    world = on_ground(body('box', mode=mode, position=(0, 0, 0.5), friction_model=model), belt)
    world.step(480)
    before = centre(world)
    world.step(240)
    assert (centre(world) - before)[0] == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize('mode', MODES)
def test_a_rising_plane_lifts_a_body(mode):
    lift = ObstacleConfig(velocity_linear=(0.0, 0.0, 0.5))
    world = on_ground(body('box', mode=mode, position=(0.0, 0.0, 0.5)), lift)
    world.step(480)
    before = centre(world)
    world.step(240)
    assert world.obstacles[0].position == pytest.approx([0.0, 0.0, 0.5 * 3.0])
    assert (centre(world) - before)[2] == pytest.approx(0.5, rel=0.02)
    assert world.positions('body')[:, 2].min() >= 1.5 - 1e-12


# -------------------------------------------------------------------------- surfaces of obstacles
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize(('width', 'subdivisions'), [(2.0, 1), (0.6, 0)])
def test_a_belt_carries_a_body_along_and_stays(mode, width, subdivisions):
    """Also one that is narrower than the body, which lies on its edge points only."""
    quarter = Rotation.from_euler('z', np.pi / 2)
    belt = ObstacleConfig(
        name='belt', type='box', size=(1.5, width, 0.1), position=(0.0, 0.0, -0.1),
        orientation=quarter.as_quat(), surface_velocity=(0.8, 0.0, 0.0),
    )  # fmt: skip
    box = body(
        'box', mode=mode, subdivisions=subdivisions, size=0.75, position=(0.0, -0.6, 0.75),
        stiffness=0.9, friction=0.8,
    )  # fmt: skip
    world = on_ground(box, belt)
    world.step(180)
    before = centre(world)
    world.step(60)
    assert centre(world) - before == pytest.approx([0.0, 0.2, 0.0], abs=0.004)
    assert not world.is_asleep('body')
    assert world.obstacles[0].position == pytest.approx([0.0, 0.0, -0.1], abs=0.0)


def test_a_belt_does_not_push_where_its_end_is():
    """The velocity is that along the surface: at the end of the belt there is none of it."""
    belt = ObstacleConfig(
        name='belt', type='box', size=(1.0, 1.0, 1.0), surface_velocity=(5.0, 0.0, 0.0)
    )
    world = World(
        WorldConfig(
            time_step=H, gravity_magnitude=0.0, obstacles=(belt,),
            bodies=(body('box', mode='rigid', size=0.5, position=(1.49, 0.0, 0.0), friction=0.0,
                         elasticity=0.0),),
        )
    )  # fmt: skip
    world.step(120)
    assert np.abs(world.velocities('body')).max() < 0.05  # it was 1 cm inside, no more


def test_what_a_belt_gives_is_felt_by_it():
    belt = ObstacleConfig(name='belt', type='plane', surface_velocity=(3.0, 0.0, 0.0))
    world = on_ground(
        body('box', mode='rigid', mass=2.0, position=(0, 0, 0.5), friction=0.25), belt
    )
    world.step(24)
    force, _ = world.obstacle_wrench('belt')
    assert force == pytest.approx([-0.25 * 2.0 * G, 0.0, -2.0 * G], rel=1e-4, abs=1e-3)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize(
    ('own', 'of_obstacle', 'both'), [(0.1, 0.4, 0.2), (0.1, -1.0, 0.1), (0.1, 0, 0)]
)
def test_friction_of_body_and_obstacle_have_a_geometric_mean(mode, own, of_obstacle, both):
    sliding = body(
        'box', mode=mode, position=(0.0, 0.0, 0.5), stiffness=0.9, friction=own,
        initial_velocity_linear=(3.0, 0.0, 0.0),
    )  # fmt: skip
    world = on_ground(sliding, ObstacleConfig(friction=of_obstacle))
    world.step(60)
    before = world.rigid_fit('body').linear_velocity[0]
    world.step(60)
    loss = before - world.rigid_fit('body').linear_velocity[0]
    assert loss == pytest.approx(both * G * 60 * H, rel=0.02, abs=1e-9)


def test_viscous_friction_of_both_removes_no_more_than_all():
    sliding = body(
        'box', mode='rigid', position=(0.0, 0.0, 0.5), friction_model='viscous', friction=1.0,
        initial_velocity_linear=(1.0, 0.0, 0.0),
    )  # fmt: skip
    worlds = [on_ground(sliding, ObstacleConfig(friction=friction)) for friction in (-1.0, 10.0)]
    for world in worlds:
        world.step(30)
    assert bytes_of(worlds[0]) == bytes_of(worlds[1])


@pytest.mark.parametrize(
    ('own', 'of_obstacle', 'both'), [(0.8, 0.2, 0.4), (0.4, -1.0, 0.4), (1.0, 0, 0)]
)
def test_restitution_of_body_and_obstacle_have_a_geometric_mean(own, of_obstacle, both):
    falling = body(mode='rigid', subdivisions=2, position=(0.0, 0.0, 1.5), elasticity=own)
    world = on_ground(falling, ObstacleConfig(elasticity=of_obstacle))
    world.step(110)
    highest = 0.0
    for _ in range(150):
        world.step()
        highest = max(highest, centre(world)[2] - 0.5)
    assert highest == pytest.approx(both**2, rel=0.02, abs=0.001)


def test_an_obstacle_turns_at_its_angular_velocity():
    spin = ObstacleConfig(type='box', velocity_angular=(0.0, 0.0, np.pi / 2))
    world = on_ground(body(position=(9.0, 0.0, 0.0)), spin)
    world.step(240)
    assert world.obstacles[0].rotation[:, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)


def test_a_body_comes_to_rest_on_a_box_obstacle_and_falls_beside_it():
    table = ObstacleConfig(type='box', size=(1.0, 1.0, 0.5))
    for x, rests in ((0.0, True), (3.0, False)):
        world = on_ground(body('box', position=(x, 0.0, 1.1), stiffness=0.9), table)
        world.step(480)
        assert (centre(world)[2] > 0.9) == rests


# ----------------------------------------------------------------------------- bounce, as a whole
def rebound(**values):
    """Return how high a ball bounces after a fall of 1 m, and the world a second later."""
    world = on_ground(body(subdivisions=2, position=(0.0, 0.0, 1.5), **values))
    height = []
    for _ in range(288):
        world.step()
        height.append(centre(world)[2])
    low = int(np.argmin(height[:150]))
    return max(height[low:]) - 0.5, world


@pytest.mark.parametrize('mode', MODES)
def test_a_ball_of_more_elasticity_bounces_higher(mode):
    heights = [rebound(mode=mode, elasticity=elasticity)[0] for elasticity in (0.0, 0.4, 0.8)]
    assert heights[0] < heights[1] < heights[2] < 1.0


def test_a_rigid_ball_rests_on_the_ground_and_not_in_it():
    _, world = rebound(mode='rigid', elasticity=0.0)
    world.step(480)
    fit = world.rigid_fit('body')
    assert rms_displacement(world) < 0.005
    assert fit.position[2] == pytest.approx(0.5, abs=0.01)
    assert fit.linear_velocity == pytest.approx(np.zeros(3), abs=1e-3)


@pytest.mark.parametrize('mode', MODES)
def test_the_fitted_velocity_of_a_body_at_rest_is_zero(mode):
    world = on_ground(body('box', mode=mode, position=(0.0, 0.0, 0.5)))
    world.step(1200)
    before = centre(world)
    world.step(240)
    assert centre(world) == pytest.approx(before, abs=1e-4)
    assert world.rigid_fit('body').linear_velocity == pytest.approx(np.zeros(3), abs=1e-3)


# ---------------------------------------------------------------------------------------- squeezes
def closed_on(depth, seconds=0.2, hold=0.6, reference_step=1 / 120, **values):
    """Return the world of a ball of 5 cm between two plates that have closed on it, and how."""
    sides = {'left': -1.0, 'right': 1.0}
    plates = [
        ObstacleConfig(
            name=name, type='box', size=(0.01, 0.2, 0.2), position=(side * 0.06, 0.0, 0.0)
        )
        for name, side in sides.items()
    ]
    ball = BodyConfig(
        size=0.05, mass=0.2, subdivisions=3, position=(0.0, 0.0, 0.0),
        friction_model='coulomb', friction=0.5, **values,
    )  # fmt: skip
    world = World(
        WorldConfig(
            time_step=H, reference_step=reference_step, gravity_magnitude=0.0,
            bodies=(ball,), obstacles=tuple(plates),
        )
    )  # fmt: skip

    def move(start, end, seconds):
        ticks = round(seconds / H)
        for tick in range(ticks):
            gap = start + (end - start) * tick / ticks
            for name, side in sides.items():
                rate = (side * (end - start) / seconds, 0.0, 0.0)
                world.move_obstacle(name, (side * (0.06 + gap), 0.0, 0.0), linear=rate)
            world.step()
        for name, side in sides.items():
            world.move_obstacle(name, (side * (0.06 + end), 0.0, 0.0))

    move(0.0, -0.05 * depth, seconds)
    world.step(round(hold / H))
    return world, move


def relative_volume(world):
    """Return the volume that a body encloses, relative to that at rest."""
    surface = world.rest_shape('body').surface
    return enclosed_volume(world.positions('body'), surface.faces) / enclosed_volume(
        surface.vertices, surface.faces
    )


@pytest.mark.parametrize('hertz', [20, 300])
@pytest.mark.parametrize('mode', MODES[1:])
def test_a_squeezed_ball_bulges_and_keeps_its_volume_exactly(mode, hertz):
    reference = np.arccos(0.75) / (2.0 * np.pi * hertz)
    world, move = closed_on(0.5, mode=mode, stiffness=0.5, reference_step=reference)
    assert relative_volume(world) == pytest.approx(1.0, abs=1e-3)
    across = np.ptp(world.positions('body')[:, 1:], axis=0)
    assert across.min() > 1.2 * 0.1
    # it is the same as before when they have gone
    move(-0.025, 0.01, 0.2)
    world.step(240)
    assert rms_displacement(world) < 1e-3
    assert relative_volume(world) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize('mode', MODES)
def test_fingers_hold_and_lift_what_has_default_friction(mode):
    """Whoever tries a gripper first has not chosen a law of friction."""
    ball = BodyConfig(mode=mode, subdivisions=2, position=(0.0, 0.0, 0.5))
    sides, begin, depth, rise = {'left': -1.0, 'right': 1.0}, 0.6, 0.15, 0.2  # m
    fingers = [
        ObstacleConfig(
            name=name, type='box', size=(0.1, 0.3, 0.3), position=(side * begin, 0.0, 0.5)
        )
        for name, side in sides.items()
    ]
    world = World(WorldConfig(time_step=H, bodies=(ball,), obstacles=(ObstacleConfig(), *fingers)))

    def move(x, z, seconds=1.0, inwards=0.0, upwards=0.0):
        for name, side in sides.items():
            velocity = (-side * inwards, 0.0, upwards)
            world.move_obstacle(name, (side * x, 0.0, z), linear=velocity)
        world.step(round(seconds / H))
        return centre(world)[2]

    move(begin, 0.5, inwards=depth)
    low = move(begin - depth, 0.5)
    move(begin - depth, 0.5, upwards=rise)
    lifted = move(begin - depth, 0.5 + rise)
    assert lifted - low == pytest.approx(rise, abs=0.05)  # it shears, and rolls a little
    assert move(begin - depth, 0.5 + rise, seconds=2.0) == pytest.approx(lifted, abs=1e-4)


def test_a_ball_of_less_volume_conservation_loses_more_volume():
    volumes = [
        relative_volume(closed_on(0.5, mode='quadratic', volume_conservation=share)[0])
        for share in (0.0, 0.5, 0.9, 1.0)
    ]
    assert volumes == sorted(volumes)
    assert volumes[1] < 0.8 < volumes[2] < 0.95 and volumes[3] > 0.999


def test_a_squeeze_that_flattens_all_particles_ends_as_it_began():
    world, move = closed_on(0.97, mode='quadratic')
    assert np.isfinite(world.positions('body')).all()
    move(-0.0485, 0.01, 0.2)
    world.step(480)
    assert rms_displacement(world) < 1e-3


def test_what_the_solution_takes_is_counted():
    world = on_ground(body(position=(0.0, 0.0, 0.6)))
    world.step(10)
    assert world.solver_work == (0, 0, 0)
    world.step(120)
    assert world.solver_work.sweeps > 0
    assert world.solver_work.unsolved == 0


def test_nothing_depends_on_the_room_that_there_was_for_contacts():
    config = body(position=(0.0, 0.0, 0.6), initial_velocity_angular=(1.0, 2.0, 3.0))
    finger = ObstacleConfig(name='finger', type='box', size=(0.1, 0.1, 0.1))
    scene = WorldConfig(time_step=H, bodies=(config,), obstacles=(ObstacleConfig(), finger))
    worlds = [World(scene) for _ in range(3)]
    for world, room in zip(worlds, (64, 1, 5000), strict=True):
        integrator = world._integrator
        empty = (array[:0] for array in integrator._workspace[1:])
        integrator._workspace = enlarged(Workspace(np.full(7, room), *empty))
        world.step(100)
        assert (integrator._workspace.needed >= room).all()
        assert bytes_of(world) == bytes_of(worlds[0])
    assert (worlds[1]._integrator._workspace.needed[1:] > 1).all()  # there is one body


@pytest.mark.parametrize(
    ('mode', 'hertz', 'regions', 'model'),
    [
        ('linear', 90, 8, 'viscous'),
        ('linear', 300, 0, 'viscous'),
        ('quadratic', 300, 8, 'viscous'),
        ('quadratic', 300, 8, 'coulomb'),
    ],
)
def test_what_swings_more_than_once_in_a_tick_is_not_thrown(mode, hertz, regions, model):
    h = 1 / 60
    ball = BodyConfig(
        mode=mode, size=0.05, mass=0.2, subdivisions=2, position=(0.0, 0.0, 0.2),
        regions_count=regions, friction_model=model, friction=0.4,
    )  # fmt: skip
    fingers = [
        ObstacleConfig(name=name, type='box', size=(0.01, 0.02, 0.03), position=(x, 0.0, 0.2))
        for name, x in (('left', -0.06), ('right', 0.06))
    ]
    wall = ObstacleConfig(
        name='wall', type='box', size=(0.3, 0.05, 0.3), position=(0.0, 0.22, 0.3)
    )
    world = World(
        WorldConfig(
            time_step=h, reference_step=np.arccos(1 - ball.stiffness / 2) / (2 * np.pi * hertz),
            bodies=(ball,), obstacles=(ObstacleConfig(name='ground'), wall, *fingers),
        )
    )  # fmt: skip
    x, y, z, fastest = 0.06, 0.0, 0.2, 0.0
    # squeezed, then pressed on the ground, then dragged to the wall
    for ticks, closing, along, up in ((12, 0.05, 0, 0), (12, 0, 0, -0.8), (12, 0, 0.6, 0)):
        for _ in range(ticks):
            for name, sign in (('left', -1), ('right', 1)):
                world.move_obstacle(name, (sign * x, y, z), linear=(-sign * closing, along, up))
            world.step()
            x, y, z = x - h * closing, y + h * along, z + h * up
            fastest = max(fastest, np.abs(world.velocities(ball.name)).max())
    assert fastest < 12.0  # that is 15 times as fast as the fingers; it was 1e16, or not finite
    assert np.abs(centre(world) - (0.0, y, z)).max() < 0.1  # viscous friction slips
