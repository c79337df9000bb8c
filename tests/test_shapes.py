# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Shapes of obstacles: complete, and as far away as they look."""

from core_helpers import many_points
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import ObstacleConfig, Surface
from softbody_ros.core.collision import obstacles, shapes
from softbody_ros.core.collision.obstacles import OBSTACLE, ObstacleTable, made, moved, placed
from softbody_ros.core.compiled import kernel
from softbody_ros.core.config import OBSTACLE_TYPES
from softbody_ros.core.geometry.bvh import pack

pytestmark = [pytest.mark.oldest, pytest.mark.plain]

SOLIDS = tuple(kind for kind in OBSTACLE_TYPES if kind != 'plane')
SIZE = (0.5, 0.6, 0.8)


def obstacle_of(kind, size=SIZE, **values):
    mesh = {'mesh': 'torus', 'subdivisions': 1} if kind == 'mesh' else {}
    return made(ObstacleConfig(name='it', type=kind, size=size, **mesh, **values))


@kernel
def distances_from(records, trees, points, distance, normal):
    """Write what `distance_from` returns of world points, for the first obstacle."""
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        distance[i], direction = obstacles.distance_from(records[0], trees, point)
        normal[i, 0], normal[i, 1], normal[i, 2] = direction


def test_every_type_of_obstacle_has_a_shape_of_its_own():
    assert tuple(shapes.SHAPES) == OBSTACLE_TYPES
    kinds = [shape.kind for shape in shapes.SHAPES.values()]
    assert kinds == list(range(len(OBSTACLE_TYPES)))


@pytest.mark.parametrize('kind', OBSTACLE_TYPES)
def test_every_shape_is_complete(kind):
    obstacle = obstacle_of(kind)
    shape = obstacle.shape
    assert type(shape) is shapes.SHAPES[kind]
    assert len(shape.half_extents) == 3
    assert shape.bounding_radius >= max(shape.half_extents)
    assert shape.ccd_threshold > 0.0
    assert shape.edge_points[0].shape[1] == 3
    assert shape.surface.faces.shape[1] == 3
    distance, normal = obstacle.distance(np.array([(0.1, 0.2, 0.3)]))
    assert np.isfinite(distance).all()
    assert np.linalg.norm(normal) == pytest.approx(1.0)


def test_a_shape_that_lacks_something_cannot_be_made():
    class Torus(shapes.Shape):
        kind = 6
        half_extents = (1.0, 1.0, 0.3)

    with pytest.raises(TypeError, match=r'edge_points.*surface'):
        Torus(SIZE)


def test_what_is_no_shape_has_no_distance():
    record = np.zeros(1, OBSTACLE)
    record['kind'], record['rotation'] = len(OBSTACLE_TYPES), np.eye(3)
    distance, normal = np.zeros(1), np.zeros((1, 3))
    distances_from(record, pack(()), np.ones((1, 3)), distance, normal)
    assert np.isnan(distance).all() and np.isnan(normal).all()


@pytest.mark.parametrize('kind', SOLIDS)
def test_the_closest_point_is_on_the_surface(kind):
    obstacle = obstacle_of(kind)
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (300, 3))
    distance, normal = obstacle.distance(points)
    assert (distance < 0.0).sum() > 5 and (distance > 0.0).sum() > 20
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    feet = points - distance[:, None] * normal
    assert np.abs(obstacle.distance(feet)[0]).max() < 1e-12
    # and none is nearer: two distances differ by no more than the points are apart
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    assert (np.abs(distance[:, None] - distance) <= apart + 1e-12).all()


@pytest.mark.parametrize('kind', SOLIDS)
def test_what_shows_a_shape_lies_on_it_and_within_its_extents(kind):
    obstacle = obstacle_of(kind)
    shape, corners = obstacle.shape, obstacle.triangles
    assert np.abs(obstacle.distance(corners)[0]).max() < 1e-9
    assert np.abs(corners).max(axis=0) == pytest.approx(shape.half_extents, abs=1e-3)
    assert np.linalg.norm(corners, axis=1).max() <= shape.bounding_radius + 1e-9


@pytest.mark.parametrize('kind', SOLIDS)
def test_balls_about_edge_points_touch_the_surface_from_inside(kind):
    obstacle = obstacle_of(kind)
    points, radius = obstacle.shape.edge_points
    assert obstacle.distance(points)[0] == pytest.approx(-radius, abs=1e-12)
    assert len(points) > 0


@many_points
@pytest.mark.parametrize(
    ('kind', 'height', 'mesh'),
    [
        ('box', 2 * SIZE[2], trimesh.creation.box(2 * np.array(SIZE))),
        ('cylinder', 2 * SIZE[2], trimesh.creation.cylinder(SIZE[0], 2 * SIZE[2], sections=64)),
        ('sphere', 2 * SIZE[0], trimesh.creation.icosphere(4, SIZE[0])),
    ],
)
def test_a_primitive_is_as_far_away_as_its_fine_mesh(kind, height, mesh):
    of_mesh = made(ObstacleConfig(type='mesh', mesh=Surface(mesh.vertices, mesh.faces)))
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    expected, mesh_normal = of_mesh.distance(points)
    distance, normal = obstacle_of(kind).distance(points)
    fineness = 1e-12 if kind == 'box' else 1e-3
    assert distance == pytest.approx(expected, abs=fineness)
    # inside, near the diagonals, it may be either of two
    same = np.einsum('ij,ij->i', normal, mesh_normal)[expected > 0.01]
    assert same == pytest.approx(1.0, abs=1e-2)
    assert of_mesh.shape.half_extents[2] == pytest.approx(height / 2)


def test_on_the_axis_and_in_the_middle_there_is_a_way_out():
    for kind in ('sphere', 'capsule', 'cylinder'):
        distance, normal = obstacle_of(kind).distance(np.zeros((1, 3)))
        assert distance == pytest.approx(-SIZE[0])
        assert normal[0] == pytest.approx([1.0, 0.0, 0.0])
    capsule = obstacle_of('capsule', size=(0.5, 1.0, 0.1))  # shorter than wide: a ball
    distance, _ = capsule.distance(np.array([(0.0, 0.0, 0.7), (0.9, 0.0, 0.0)]))
    assert distance == pytest.approx([0.2, 0.4])


@pytest.mark.parametrize('kind', OBSTACLE_TYPES)
def test_kernels_and_python_see_the_same_obstacle_in_the_world(kind):
    turn = Rotation.from_rotvec((0.3, -0.8, 0.5))
    obstacle = obstacle_of(kind, position=(0.2, 0.1, -0.3), orientation=turn.as_quat())
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3))
    distance, normal = np.zeros(50), np.zeros((50, 3))
    distances_from(*ObstacleTable().refresh((obstacle,)), points, distance, normal)
    expected, expected_normal = obstacle.closest(points)
    assert distance == pytest.approx(expected, abs=1e-12)
    assert normal == pytest.approx(expected_normal, abs=1e-12)
    if kind == 'plane':
        assert normal == pytest.approx(np.tile(turn.as_matrix()[:, 2], (50, 1)))
        assert distance == pytest.approx((points - obstacle.position) @ turn.as_matrix()[:, 2])


# ----------------------------------------------------------------------------------------- records
def test_the_table_writes_what_has_changed_and_keeps_the_rest():
    table = ObstacleTable()
    still, ball = obstacle_of('mesh'), obstacle_of('sphere', velocity_linear=(1.0, 0.0, 0.0))
    records, trees = table.refresh((still, ball))
    assert len(trees[0]) == 1 and records['tree'].tolist() == [0, -1]
    for age in (1, 2, 2):
        before, ball = ball, moved(ball, 0.1)
        known, still = still, moved(still, 0.1)
        assert (still is known) == (known.age == 2) and still.age == age
        again, same_trees = table.refresh((still, ball))
        assert again is records and same_trees is trees
        assert records['moved'].tolist() == [False, True]
        assert records['is_placed'].tolist() == [age < 2] * 2
        assert np.array_equal(records['position'][1], ball.position)
        assert np.array_equal(records['position_before'][1], before.position)
    larger = placed(ObstacleConfig(name='it', type='sphere', size=(0.9, 1, 1)))
    table.refresh((still, larger))
    assert records['bounding_radius'][1] == 0.9
    assert not records['moves'][1] and not records['moved'][1] and records['is_placed'][1]


def test_a_table_with_other_obstacles_is_as_a_new_one():
    table = ObstacleTable()
    mesh, other = obstacle_of('mesh'), made(ObstacleConfig(type='mesh', mesh='box'))
    sets = [(mesh,), (), (mesh,), (other, mesh), (obstacle_of('plane'), other), (mesh, mesh)]
    for each in sets:
        records, trees = table.refresh(each)
        fresh, fresh_trees = ObstacleTable().refresh(each)
        assert np.array_equal(records, fresh)
        assert [len(array) for array in trees] == [len(array) for array in fresh_trees]
        assert all(map(np.array_equal, trees, fresh_trees))


@pytest.mark.parametrize('kind', SOLIDS)
def test_the_box_of_a_record_is_around_the_obstacle_however_it_lies(kind):
    for seed in range(5):
        turn = Rotation.random(random_state=seed).as_quat()
        obstacle = obstacle_of(kind, position=(0.2, 0.1, -0.3), orientation=turn)
        record = ObstacleTable().refresh((obstacle,))[0][0]
        corners = obstacle.triangles @ obstacle.rotation.T
        assert (np.abs(corners) <= record['half_box'] + 1e-12).all()
