# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Trees of boxes: distances as from all faces, sides as by the winding number."""

from core_helpers import cad_mesh, many_points, sheet, thin_bin
import numpy as np
import pytest
import trimesh

from softbody_ros.core import MeshError, Surface, make_surface
from softbody_ros.core.compiled import kernel
from softbody_ros.core.geometry import bvh
from softbody_ros.core.geometry.bvh import closed_tree, make_tree, pack

pytestmark = pytest.mark.plain


def thin_plate():
    return welded(trimesh.creation.box((1.0, 1.0, 0.02)))


def welded(mesh):
    mesh.merge_vertices()
    return Surface(mesh.vertices, mesh.faces)


def l_shape():
    """Return a solid with a reentrant edge: a turned profile of two arms."""
    profile = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.2), (0.2, 0.2), (0.2, 1.0), (0.0, 1.0)]
    return welded(trimesh.creation.revolve(profile, sections=5))


def needles():
    """Return two closed parts with very acute corners, one of them mirrored."""
    tip = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.07, 0), (0.02, 0.02, 1.5)], dtype=float)
    faces = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
    vertices = np.vstack([tip, tip * (1, 1, -1) - (0.3, 0.2, 0.1)])
    return Surface(vertices, np.vstack([faces, faces[:, ::-1] + 4]))


SHAPES = {
    'box of 12 triangles': make_surface('box', 1.0, 0),
    'thin plate': thin_plate(),
    'bin': thin_bin(),
    'cup': thin_bin(sections=16),
    'L': l_shape(),
    'needles': needles(),
    'torus': make_surface('torus', 1.0, 2),
    'capsule': make_surface('capsule', 1.0, 2),
    'icosphere': make_surface('icosphere', 1.0, 2),
    'CAD': make_surface(cad_mesh('power_connector'), 1.0, 0),
}


def points_around(surface, count=300, seed=0):
    """Return points about the surface, close to it, and exactly opposite edges and vertices."""
    random = np.random.default_rng(seed)
    corners = surface.vertices[surface.faces]
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    anywhere = random.uniform(low - 0.3, high + 0.3, (count, 3))
    face = random.integers(len(corners), size=count)
    # weights of exactly 0 put a third of the points onto edges, and some onto vertices
    weights = random.dirichlet(np.ones(3), count) * (random.uniform(size=(count, 3)) > 0.3)
    weights[weights.sum(axis=1) == 0.0, 0] = 1.0
    weights /= weights.sum(axis=1, keepdims=True)
    on_it = np.einsum('kc,kci->ki', weights, corners[face])
    offsets = random.normal(size=(count, 3)) * 10.0 ** random.uniform(-5, -1, (count, 1))
    return np.vstack([anywhere, on_it + offsets])


def distance_from_all(surface, points):
    """Return the distances (k,) from all faces, by an independent closest-point routine."""
    corners = surface.vertices[surface.faces]
    pairs = [np.broadcast_to(point, (len(corners), 3)) for point in points]
    closest = [trimesh.triangles.closest_point(corners, pair) for pair in pairs]
    return np.array(
        [
            np.linalg.norm(feet - point, axis=1).min()
            for feet, point in zip(closest, points, strict=True)
        ]
    )


def winding_number(surface, points):
    """Return the generalised winding numbers (k,): solid angles over 4 π."""
    a, b, c = (surface.vertices[surface.faces[:, i]] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(arm, axis=2) for arm in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=2)
    cosine = la * lb * lc + np.sum(a * b, axis=2) * lc
    cosine += np.sum(b * c, axis=2) * la + np.sum(c * a, axis=2) * lb
    return np.arctan2(volume, cosine).sum(axis=1) / (2.0 * np.pi)


@kernel
def nearest_faces(trees, tree, points, result):
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        result[i] = bvh.nearest_face(trees, tree, point)


@kernel
def closest_within(trees, tree, points, reach, result):
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        face, square, _, _ = bvh.closest_face(trees, tree, point, reach)
        result[i] = square if face >= 0 else -1.0


def nearest_of(trees, tree, points):
    result = np.zeros(len(points), dtype=np.int64)
    nearest_faces(trees, tree, points, result)
    return result


@pytest.mark.parametrize('name', SHAPES)
def test_the_distance_is_that_of_the_nearest_of_all_faces(name):
    surface = SHAPES[name]
    tree = closed_tree(surface)
    points = points_around(surface)
    distance, normal = tree.distance(points)
    assert np.abs(distance) == pytest.approx(distance_from_all(surface, points), abs=1e-12)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    feet = points - distance[:, None] * normal
    assert np.abs(tree.distance(feet)[0]).max() < 1e-12


@pytest.mark.parametrize('name', SHAPES)
def test_the_sign_is_that_of_the_winding_number(name):
    surface = SHAPES[name]
    points = points_around(surface)
    distance, _ = closed_tree(surface).distance(points)
    assert np.array_equal(distance < 0.0, winding_number(surface, points) > 0.5)


@pytest.mark.parametrize('name', SHAPES)
def test_the_nearest_face_is_as_far_away_as_the_surface(name):
    surface = SHAPES[name]
    points = points_around(surface)
    face = nearest_of(make_tree(surface).arrays, 0, points)
    foot = trimesh.triangles.closest_point(surface.vertices[surface.faces[face]], points)
    expected = distance_from_all(surface, points)
    assert np.linalg.norm(foot - points, axis=1) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize('seed', range(4))
def test_a_surface_need_not_be_closed_for_its_nearest_faces(seed):
    random = np.random.default_rng(seed)
    # of a few and of many faces, of which some have no area
    vertices = random.normal(size=(30, 3))
    faces = random.integers(0, 30, (10**seed, 3))
    soup = Surface(vertices, faces[(np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)])
    points = random.normal(size=(100, 3))
    face = nearest_of(make_tree(soup).arrays, 0, points)
    foot = trimesh.triangles.closest_point(vertices[soup.faces[face]], points)
    expected = distance_from_all(soup, points)
    assert np.linalg.norm(foot - points, axis=1) == pytest.approx(expected, abs=1e-12)


def test_faces_without_area_are_lines():
    line = Surface(np.array([(0, 0, 0), (1, 0, 0), (3, 0, 0)]), np.array([(0, 1, 2), (2, 1, 0)]))
    points = np.array([(2.0, 1.0, 0.0), (-3.0, 0.0, 4.0), (0.5, 0.0, -2.0)])
    square = np.zeros(3)
    closest_within(make_tree(line).arrays, 0, points, np.inf, square)
    assert square == pytest.approx([1.0, 25.0, 4.0])


def test_only_what_is_within_reach_is_found():
    surface = SHAPES['torus']
    points = points_around(surface)
    expected = distance_from_all(surface, points)
    square = np.zeros(len(points))
    closest_within(make_tree(surface).arrays, 0, points, 0.1**2, square)
    near = expected < 0.1
    assert 100 < near.sum() < len(points) - 100
    assert np.sqrt(square[near]) == pytest.approx(expected[near], abs=1e-12)
    assert (square[~near] == -1.0).all()


def test_packed_trees_answer_as_each_does_alone_bit_by_bit():
    surfaces = [SHAPES[name] for name in ('needles', 'box of 12 triangles', 'torus')]
    trees = [make_tree(surface) for surface in surfaces]
    packed = pack(trees)
    points = points_around(SHAPES['torus'])
    for index, tree in enumerate(trees):
        distance, normal = np.zeros(len(points)), np.zeros((len(points), 3))
        bvh.signed_distances(packed, index, points, distance, normal)
        alone = tree.distance(points)
        assert np.array_equal(distance, alone[0]) and np.array_equal(normal, alone[1])
        assert np.array_equal(
            nearest_of(packed, index, points), nearest_of(tree.arrays, 0, points)
        )
    assert [len(array) for array in pack(())] == [0, 0, 0]


def test_far_away_the_distance_is_exact_too():
    tree = closed_tree(SHAPES['torus'])
    points = np.array([(5.0, 0.0, 0.0), (-1e6, 0.0, 0.0)])
    distance, normal = tree.distance(points)
    assert distance == pytest.approx([4.0, 1e6 - 1.0])
    assert normal == pytest.approx(np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]))


def test_what_is_no_number_has_no_distance():
    points = np.array([(np.nan, 0.0, 0.0), (0.0, 0.0, np.nan)])
    distance, normal = closed_tree(SHAPES['torus']).distance(points)
    assert np.isnan(distance).all() and np.isnan(normal).all()


def test_corners_and_edges_are_sharp_and_what_is_smooth_is_not():
    box = closed_tree(SHAPES['box of 12 triangles'])
    assert np.array_equal(np.abs(box.sharp_vertices), np.ones((8, 3)))
    assert (box.low == -1.0).all() and (box.high == 1.0).all()
    assert not len(closed_tree(SHAPES['icosphere']).sharp_vertices)


@many_points
def test_the_thinnest_wall_is_found_where_there_is_one():
    for wall in (0.1, 0.02, 0.001):
        half = closed_tree(thin_bin(wall)).half_thickness
        assert wall / 8 <= half <= wall / 2
    solid = closed_tree(SHAPES['icosphere'])
    assert solid.half_thickness == 0.5 * 3**0.5 * solid.resolution


def test_the_same_content_has_the_same_tree():
    surface = SHAPES['icosphere']
    same = closed_tree(Surface(surface.vertices.copy(), surface.faces.copy()))
    assert same is closed_tree(surface)
    other = closed_tree(Surface(surface.vertices * 1.001, surface.faces))
    turned = closed_tree(Surface(surface.vertices, np.roll(surface.faces, 1, axis=1)))
    assert other is not same and turned is not same


def test_a_surface_that_is_not_closed_is_refused():
    ball = SHAPES['icosphere']
    for surface in (sheet(), Surface(ball.vertices, ball.faces[1:])):
        with pytest.raises(MeshError, match=r'mesh is not closed.*fill its holes') as refusal:
            closed_tree(surface)
        assert '\n' not in str(refusal.value)


def test_of_faces_that_share_the_closest_point_the_one_that_faces_the_point_most_is_nearest():
    surface = make_surface('box', 1.0, 0)
    tree = make_tree(surface)
    random = np.random.default_rng(3)
    # closest to an edge along z, or to a corner
    points = 1.0 + random.uniform(0.01, 1.0, size=(200, 3))
    points[:100, 2] = random.uniform(-0.9, 0.9, size=100)
    points *= random.choice([-1.0, 1.0], size=points.shape)
    found = np.empty(len(points), np.int64)
    nearest_faces(tree.arrays, 0, points, found)
    a, b, c = surface.vertices[surface.faces[found].T]
    normals = np.cross(b - a, c - a)
    assert np.array_equal(np.abs(normals).argmax(axis=1), np.abs(points).argmax(axis=1))
    assert ((points - a) * normals).sum(axis=1).min() > 0.0
