# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Small matrices, systems of a few unknowns and searches in lists, against NumPy and SciPy."""

from kernels import (
    cube_roots,
    least_rotation,
    orthogonal_columns,
    rotation_by_vector,
)
import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from softbody_ros.core import ObstacleConfig, make_surface, sleeping
from softbody_ros.core.collision.obstacles import made
from softbody_ros.core.collision.point_obstacles import NO_POINTS, PointObstacles

pytestmark = [pytest.mark.oldest, pytest.mark.plain]


# --------------------------------------------------------------------------------------- numbers
def test_cube_roots_are_as_precise_as_those_of_numpy():
    random = np.random.default_rng(0)
    exponents = random.uniform(-300, 300, size=200)
    values = np.concatenate([10.0**exponents, random.uniform(0.1, 10.0, size=200), [1.0, 8.0]])
    found = np.empty_like(values)
    cube_roots(values, found)
    assert found == pytest.approx(np.cbrt(values), rel=1e-15, abs=0.0)


# --------------------------------------------------------------------------------------- rotations
def unit_vectors(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def assert_rotations(found):
    assert np.abs(found @ found.swapaxes(1, 2) - np.eye(3)).max() < 1e-15 * 10
    assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-14)


def test_the_least_rotation_takes_one_vector_to_the_other_by_the_angle_between_them():
    a, b = unit_vectors(50, 1), unit_vectors(50, 2)
    a[0], b[0] = (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    a[1], b[1] = (0.0, 0.6, 0.8), (0.0, -0.6, -0.8)  # any half turn about an axis at right angles
    a[2], b[2] = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
    b[3] = -a[3]
    found = least_rotation(a, b)
    assert_rotations(found)
    assert np.einsum('kij,kj->ki', found, a) == pytest.approx(b, abs=1e-14)
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum('ki,ki->k', a, b))
    assert Rotation.from_matrix(found).magnitude() == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize('angle', [0.0, 1e-200, 1e-9, 0.99e-8, 1.01e-8, 1e-4, 1.0, np.pi, 20.0])
def test_the_rotation_by_a_vector_is_that_of_scipy(angle):
    vectors = angle * unit_vectors(20, 3)
    found = rotation_by_vector(vectors)
    assert_rotations(found)
    assert found == pytest.approx(Rotation.from_rotvec(vectors).as_matrix(), abs=1e-14)


@pytest.mark.parametrize('size', [1e-100, 1.0, 1e100])
@pytest.mark.parametrize(
    'values',
    [(1.0, 0.5, 0.2), (1.0, 1.0, 1.0), (1.0, 1.0, 1e-3), (1.0, 1e-3, 1e-6), (1.0, 0.5, 0.0),
     (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)],
)  # fmt: skip
def test_orthogonal_columns_have_the_singular_values_as_lengths(values, size):
    left, right = (Rotation.random(10, random_state=seed).as_matrix() for seed in (4, 5))
    matrices = size * (left * values) @ right
    columns, v = orthogonal_columns(matrices)
    assert_rotations(v)
    assert columns == pytest.approx(matrices @ v, abs=1e-15 * size * 10)
    lengths = np.sort(np.linalg.norm(columns, axis=1), axis=1)[:, ::-1]
    expected = np.linalg.svd(matrices, compute_uv=False)
    assert lengths == pytest.approx(expected, abs=1e-14 * size)
    gram = columns.swapaxes(1, 2) @ columns / size / size
    assert np.abs(gram - gram * np.eye(3)).max() < 1e-14


# ------------------------------------------------------------------------------- points and boxes
@pytest.mark.parametrize('radius', [0.0, 0.1])
def test_boxes_that_points_touch_are_found(radius):
    random = np.random.default_rng(10)
    low = random.uniform(-1.0, 1.0, size=(60, 3))
    high = low + random.uniform(0.0, 0.3, size=(60, 3))
    for count in (0, 1, 2, 200):
        points = random.uniform(-1.2, 1.2, size=(count, 3))
        points[::2, 0] = points[:1, 0]  # many at the same x
        inside = (points >= low[:, None] - radius) & (points <= high[:, None] + radius)
        found = PointObstacles(points, radius).touched(low, high)
        assert found.tolist() == inside.all(axis=2).any(axis=1).tolist()
    assert NO_POINTS.touched(low[:0], high[:0]).shape == (0,)


def test_a_point_on_the_edge_of_a_box_touches_it():
    corner = np.array([[1.0, 2.0, 3.0]])
    low, high = np.array([[1.0, 2.0, 3.0]]), np.array([[2.0, 3.0, 4.0]])
    assert PointObstacles(corner, 0.0).touched(low, high).all()
    assert not PointObstacles(corner - 1e-12, 0.0).touched(low, high).any()
    assert PointObstacles(corner - 0.5, 0.5).touched(low, high).all()


# ------------------------------------------------------------------------------------------ sleep
def islands_of_scipy(count, one, two):
    graph = csr_array((np.ones(len(one)), (one, two)), (count, count))
    return connected_components(graph, directed=False)[1]


@pytest.mark.parametrize('pairs', [0, 1, 5, 20, 60])
def test_islands_are_connected_components(pairs):
    for seed in range(10):
        random = np.random.default_rng(seed)
        one, two = random.integers(40, size=(2, pairs))
        found = sleeping.islands(40, one, two)
        expected = islands_of_scipy(40, one, two)
        # the same bodies belong together, and islands are numbered without gaps
        assert len(set(zip(found.tolist(), expected.tolist(), strict=True))) == found.max() + 1
        assert set(found.tolist()) == set(range(found.max() + 1))
        assert found.max() == expected.max()


def test_a_long_chain_in_any_order_is_one_island():
    for order in (np.arange(99), np.arange(99)[::-1], np.random.default_rng(0).permutation(99)):
        assert not sleeping.islands(100, order, order + 1).any()
        assert not sleeping.islands(100, order + 1, order).any()
    assert sleeping.islands(0, np.zeros(0, int), np.zeros(0, int)).shape == (0,)


def obstacle(kind, seed):
    random = np.random.default_rng(seed)
    return made(
        ObstacleConfig(
            type=kind,
            mesh=make_surface('icosphere', 0.7, 1) if kind == 'mesh' else '',
            position=random.normal(size=3),
            orientation=Rotation.random(random_state=seed).as_quat(),
            size=random.uniform(0.4, 0.9, size=3),
        )
    )


def boxes(count, seed, about):
    random = np.random.default_rng(seed)
    low = about + random.uniform(-2.0, 2.0, size=(count, 3))
    return low, low + random.uniform(0.0, 0.5, size=(count, 3))


@pytest.mark.parametrize('seed', [1, 2, 3])
@pytest.mark.parametrize('kind', ['box', 'sphere', 'capsule', 'cylinder', 'mesh'])
def test_boxes_near_an_obstacle_are_those_near_its_own_box(kind, seed):
    """What comes near is found; what is not near the box around the obstacle is not."""
    item = obstacle(kind, seed)
    low, high = boxes(120, seed, item.position)
    reach = np.random.default_rng(seed).uniform(0.0, 0.3, size=120)
    near = sleeping.near_obstacle((low, high), item, reach)
    # in each box some points, one of them the nearest to the obstacle's centre
    share = np.random.default_rng(0).uniform(size=(8, 1, 3))
    points = np.concatenate([low + share * (high - low), np.clip(item.position, low, high)[None]])
    distance = item.closest(points.reshape(-1, 3))[0].reshape(9, 120).min(axis=0)
    assert near[distance <= reach].all()
    assert 0 < np.count_nonzero(distance <= reach) < 120
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * item.half_extents
    corners = item.position + corners @ item.rotation.T
    gap = np.maximum(low - corners.max(axis=0), corners.min(axis=0) - high).max(axis=1)
    assert near.tolist() == (gap <= reach).tolist()


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_boxes_near_a_plane_are_those_with_a_corner_near_it(seed):
    item = obstacle('plane', seed)
    low, high = boxes(300, seed, item.position)
    choice = np.array(np.meshgrid(*[[0.0, 1.0]] * 3)).reshape(3, -1).T[:, None]
    corners = low + choice * (high - low)
    height = ((corners - item.position) @ item.rotation[:, 2]).min(axis=0)
    for reach in (0.0, 0.4, np.linspace(0.0, 0.5, 300)):
        found = sleeping.near_obstacle((low, high), item, reach)
        assert found.tolist() == (height <= reach).tolist()
        assert 0 < np.count_nonzero(found) < 300
