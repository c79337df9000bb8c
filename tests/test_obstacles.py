# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Obstacles of any shape, moving ones, many of them, and what is too fast for thin ones."""

import dataclasses

from core_helpers import (
    assert_goes_on_bit_by_bit,
    body,
    centre,
    momentum,
    random_rotation,
    sheet,
    thin_bin,
)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    MeshError,
    ObstacleConfig,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.collision import obstacles
from softbody_ros.core.collision.shapes import Box, Mesh

MODES = ('rigid', 'linear', 'quadratic')
THIN = 0.01
"""Half the thickness of the plates."""


def box(half_extents):
    """Return a box of 12 triangles."""
    mesh = trimesh.creation.box(2.0 * np.array(half_extents))
    return Surface(mesh.vertices, mesh.faces)


def plate(kind, extent=4.0, **values):
    """Return a thin plate of 2 cm across z: box, cylinder or mesh."""
    shape = {'mesh': box((extent, extent, THIN))} if kind == 'mesh' else {}
    return ObstacleConfig(
        name='plate', type=kind, **{'size': (extent, extent, THIN)} | shape | values
    )


def world_of(bodies, *obstacle_configs, gravity=9.81, h=1 / 240):
    return World(
        WorldConfig(
            time_step=h, gravity_magnitude=gravity, bodies=bodies, obstacles=obstacle_configs
        )
    )


def in_frame(world, index=0):
    """Return the positions (n, 3) of the body in the frame of an obstacle."""
    obstacle = world.obstacles[index]
    return (world.positions('body') - obstacle.position) @ obstacle.rotation


# ----------------------------------------------------------------------------------------- shapes
def test_the_size_of_a_mesh_is_half_of_its_longest_side_and_may_change_while_it_runs():
    config = ObstacleConfig(name='wall', type='mesh', mesh='box', size=(0.7, 1.0, 1.0))
    world = world_of((body(),), config)
    point = np.array([(1.0, 0.0, 0.0)])
    assert world.obstacles[0].distance(point)[0] == pytest.approx(0.3)
    tree = world.obstacles[0].tree
    larger = dataclasses.replace(config, size=(0.9, 1.0, 1.0))
    world.configure(dataclasses.replace(world.config, obstacles=(larger,)))
    assert world.obstacles[0].distance(point)[0] == pytest.approx(0.1)
    assert world.obstacles[0].tree is tree
    assert world.obstacles[0].half_extents == pytest.approx([0.9, 0.9, 0.9])


def test_a_surface_is_taken_as_it_is():
    shifted = box((0.2, 0.3, 0.4))
    shifted = Surface(shifted.vertices + (1.0, 0.0, 0.0), shifted.faces)
    obstacle = obstacles.made(ObstacleConfig(type='mesh', mesh=shifted, size=(5.0, 5.0, 5.0)))
    assert obstacle.distance(np.array([(1.3, 0.0, 0.0)]))[0] == pytest.approx(0.1)
    assert obstacle.half_extents == pytest.approx([1.2, 0.3, 0.4])


def test_the_tree_is_made_once():
    config = ObstacleConfig(name='wall', type='mesh', mesh='torus', position=(0.0, 0.0, -3.0))
    world = world_of((body(),), config)
    tree = world.obstacles[0].tree
    snapshot = world.snapshot()
    world.step(3)
    world.reset()
    world.restore(snapshot)
    elsewhere = dataclasses.replace(config, position=(0.0, 0.0, -2.0))
    world.configure(dataclasses.replace(world.config, obstacles=(elsewhere,)))
    world.step(3)
    assert world.obstacles[0].tree is tree
    assert world_of((body(),), elsewhere).obstacles[0].tree is tree


@pytest.mark.parametrize(
    ('values', 'error', 'sentence'),
    [
        ({}, ConfigError, r"wall\.mesh is '': type mesh needs a primitive \(icosphere, .* a file"),
        ({'mesh': sheet()}, MeshError, r'wall\.mesh is not closed.*: fill its holes'),
        ({'mesh': '/no/such.stl'}, MeshError, r'wall\.mesh file /no/such\.stl does not exist'),
        ({'mesh': 'cube'}, MeshError, r"wall\.mesh 'cube' is neither a primitive"),
    ],
)
def test_refusals_name_the_obstacle(values, error, sentence):
    with pytest.raises(error, match=sentence) as refusal:
        world_of((body(),), ObstacleConfig(name='wall', type='mesh', **values))
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('mode', MODES)
def test_a_box_of_triangles_is_a_box(mode, monkeypatch):
    # the points along their edges differ
    for kind in (Box, Mesh):
        monkeypatch.setattr(kind, 'edge_points', (np.zeros((0, 3)), 0.0))
    turn = Rotation.from_matrix(random_rotation(1)).as_quat()
    place = {'position': (0.0, 0.0, -1.0), 'orientation': turn}
    as_box = ObstacleConfig(name='wall', type='box', size=(0.8, 0.8, 0.8), **place)
    as_mesh = ObstacleConfig(name='wall', type='mesh', mesh='box', size=(0.8, 1.0, 1.0), **place)
    dropped = body(mode=mode, position=(0.1, 0.0, 1.2), subdivisions=2)
    worlds = [world_of((dropped,), config) for config in (as_box, as_mesh)]
    for _ in range(12):
        for world in worlds:
            world.step(20)
        assert centre(worlds[1]) == pytest.approx(centre(worlds[0]), abs=1e-9)


# ------------------------------------------------------------------------------- moving, and many
@pytest.mark.parametrize('mode', MODES)
def test_a_moving_mesh_carries_a_body(mode):
    carried = body('box', mode=mode, size=0.2, position=(1.0, 0.0, 0.2), friction=0.5)
    velocity, turn = np.array([0.4, 0.0, 0.1]), np.array([0.0, 0.0, 0.8])
    table = ObstacleConfig(
        name='table',
        type='mesh',
        mesh=box((3.0, 3.0, 0.1)),
        position=(0.0, 0.0, -0.1),
        velocity_linear=velocity,
        velocity_angular=turn,
    )
    world = world_of((carried,), table)
    world.step(240)
    arm = centre(world) - world.obstacles[0].position
    assert momentum(world) == pytest.approx(velocity + np.cross(turn, arm), abs=0.03)
    assert in_frame(world)[:, 2].min() >= 0.1 - 1e-9


def test_a_ball_lies_on_several_obstacles_at_once_and_in_none():
    around = (
        ObstacleConfig(name='a', type='mesh', mesh='icosphere', position=(0.6, 0.0, 0.0)),
        ObstacleConfig(name='b', type='cylinder', size=(0.5, 1, 1), position=(-0.6, 0.5, 0.0)),
        ObstacleConfig(name='c', type='box', size=(0.4, 0.4, 0.9), position=(-0.6, -0.6, 0.0)),
    )
    around = tuple(
        dataclasses.replace(item, size=(0.5, 1.0, 1.0)) if item.name == 'a' else item
        for item in around
    )
    for mode in MODES:
        ball = body(mode=mode, position=(-0.2, 0.0, 2.0), subdivisions=3, elasticity=0.0)
        world = world_of((ball,), *around)
        touched = np.zeros(3, dtype=bool)
        for _ in range(300):
            world.step()
            for index, obstacle in enumerate(world.obstacles):
                distance = obstacle.distance(in_frame(world, index))[0].min()
                # a body that is moved out of one may be moved into another, for a tick
                assert distance > -0.02
                touched[index] |= distance < 1e-3
        assert touched.sum() >= 2


# --------------------------------------------------------------------------------------- the swept
@pytest.mark.parametrize('h', [1 / 240, 1 / 60])
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('kind', ['box', 'cylinder', 'mesh'])
@pytest.mark.parametrize('case', ['thrown', 'thrown at an angle', 'hit', 'hit by a turning plate'])
def test_nothing_gets_through_a_thin_plate(case, kind, mode, h):
    tilt = Rotation.from_rotvec((0.3, 0.2, 0.1)) if 'angle' in case else Rotation.identity()
    normal = tilt.apply((0.0, 0.0, 1.0))
    flight = -20.0 * normal if case.startswith('thrown') else np.zeros(3)
    ball = body(
        mode=mode,
        subdivisions=2,
        position=tuple(0.63 * normal),
        initial_velocity_linear=tuple(flight),
    )
    motion = {}
    if case.startswith('hit'):
        motion = {'velocity_linear': (0.0, 0.0, 20.0)}
    if 'turning' in case:
        motion['velocity_angular'] = (3.0, 1.0, 2.0)
    wall = plate(kind, orientation=tuple(tilt.as_quat()), **motion)
    gravity = 0.0 if case.startswith('hit') else 9.81
    world = world_of((ball,), wall, gravity=gravity, h=h)
    for _ in range(round(0.15 / h)):
        world.step()
        assert in_frame(world)[:, 2].min() > THIN - 1e-9


def test_a_ball_of_default_material_thrown_at_a_plate_comes_back():
    ball = BodyConfig(name='body', position=(0, 0, 1.0), initial_velocity_linear=(0, 0, -20.0))
    for kind in ('box', 'mesh'):
        world = world_of((ball,), plate(kind, extent=1.0))
        before = in_frame(world)
        for _ in range(60):
            world.step()
            after = in_frame(world)
            through = before[:, 2] * after[:, 2] < 0.0
            way = before[through, 2] / (before[through, 2] - after[through, 2])
            at = before[through] + way[:, None] * (after[through] - before[through])
            assert np.all(np.abs(at[:, :2]).max(axis=1) > 0.98)
            before = after
        assert momentum(world)[2] > 0.0 and centre(world)[2] > 0.4


@pytest.mark.parametrize('h', [1 / 240, 1 / 60])
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('sections', [4, 16])
def test_a_ball_thrown_at_the_corner_of_a_thin_bin_stays_in_it(sections, mode, h):
    ball = body(
        mode=mode,
        size=0.3,
        subdivisions=2,
        position=(0.0, 0.0, 0.5),
        initial_velocity_linear=(20.0, 3.0, -2.0),
    )
    hull = thin_bin(sections=sections)
    world = world_of((ball,), ObstacleConfig(name='bin', type='mesh', mesh=hull), h=h)
    sides = np.cross(*np.diff(hull.vertices[hull.faces], axis=1).swapaxes(0, 1))
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    heights = np.einsum('ij,ij->i', sides, hull.vertices[hull.faces[:, 0]])
    outer = heights > 0.9 * np.cos(np.pi / sections)
    for _ in range(round(0.5 / h)):
        world.step()
        x = world.positions('body')
        below_rim = x[x[:, 2] < 1.0]
        assert (below_rim @ sides[outer].T < heights[outer] + 1e-9).all()
        assert x[:, 2].min() > 0.01


def test_a_world_with_a_fast_plate_goes_on_bit_by_bit_after_a_restore():
    wall = plate('mesh', velocity_linear=(0, 0, 20.0), velocity_angular=(0, 3.0, 0))
    world = world_of((body(position=(0, 0, 1.0)),), wall)
    world.step(8)
    assert_goes_on_bit_by_bit(world, 10)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('kind', ['sphere', 'capsule', 'cylinder', 'box', 'mesh'])
def test_a_finger_pushes_a_coarse_ball_and_does_not_get_in_between_its_vertices(kind, mode):
    size = (0.02, 0.02, 0.02) if kind in ('sphere', 'box', 'mesh') else (0.02, 0.02, 0.1)
    mesh = 'box' if kind == 'mesh' else ''
    # towards the middle of a face
    surface = make_surface('icosphere', 0.5, 1)
    middle = surface.vertices[surface.faces].mean(axis=1)
    out = middle[np.argmin(middle[:, 0])] / np.linalg.norm(middle[np.argmin(middle[:, 0])])
    finger = ObstacleConfig(
        name='finger',
        type=kind,
        mesh=mesh,
        subdivisions=0,
        size=size,
        position=0.7 * out,
        velocity_linear=-0.5 * out,
    )
    world = world_of((body(mode=mode, friction=0.5),), finger, gravity=0.0, h=1 / 120)
    deepest = 0.0
    for _ in range(120):
        world.step()
        fit, place = world.rigid_fit('body'), world.obstacles[0].position
        deepest = max(deepest, 0.5 - np.linalg.norm(place - fit.position))
    assert centre(world) @ -out > 0.1
    assert deepest < 0.2
