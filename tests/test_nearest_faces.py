# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The grid of nearest faces: distances as from all faces, sides as by the winding number."""

from core_helpers import cad_mesh, sheet, thin_bin
import numpy as np
import pytest
import trimesh

from softbody_ros.core import MeshError, Surface, make_surface
from softbody_ros.core.geometry.face_table import make_face_table
from softbody_ros.core.geometry.nearest_faces import nearest_faces


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


@pytest.mark.parametrize('name', SHAPES)
def test_the_distance_is_that_of_the_nearest_of_all_faces(name):
    surface = SHAPES[name]
    grid = nearest_faces(surface)
    points = points_around(surface)
    distance, normal = grid.distance(points)
    expected = distance_from_all(surface, points)
    close = expected <= grid.exact_to
    assert close.sum() > 200
    assert np.abs(distance[close]) == pytest.approx(expected[close], abs=1e-12)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    feet = points[close] - distance[close, None] * normal[close]
    assert np.abs(grid.distance(feet)[0]).max() < 1e-12


@pytest.mark.parametrize('name', SHAPES)
def test_the_sign_is_that_of_the_winding_number(name):
    surface = SHAPES[name]
    points = points_around(surface)
    distance, _ = nearest_faces(surface).distance(points)
    assert np.array_equal(distance < 0.0, winding_number(surface, points) > 0.5)


@pytest.mark.parametrize('name', SHAPES)
def test_bounds_of_distances_hold(name):
    surface = SHAPES[name]
    grid = nearest_faces(surface)
    points = points_around(surface)
    distance, _ = grid.distance(points)
    true = np.copysign(distance_from_all(surface, points), distance)
    cells = grid.grid
    low, high = cells.origin + cells.cell, cells.origin + cells.cell * (cells.shape - 1)
    within = np.all((low <= points) & (points <= high), axis=1)
    assert np.all(np.abs(distance[within]) >= np.abs(true[within]) - 1e-12)
    assert np.all(np.abs(distance[within]) <= np.abs(true[within]) + grid.diagonal)
    assert np.all(grid.at_least(distance) <= true + 1e-12)
    assert np.all(distance[~within] <= true[~within] + 1e-12)
    limit = np.full(len(points), 0.5 * grid.grid.cell)
    clear = grid.is_clear(points, limit)
    assert clear.any()
    assert np.all(true[clear] > 0.5 * grid.grid.cell)


@pytest.mark.parametrize('name', ['torus', 'needles', 'CAD'])
def test_a_table_has_the_face_that_is_about_nearest(name):
    surface = SHAPES[name]
    table = make_face_table(surface)
    points = points_around(surface)
    face = table.nearest(points)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    known = np.all((low <= points) & (points <= high), axis=1)
    square = nearest_faces(surface).triangles.closest(points[known].T, face[known])[0]
    # the centre of a cell is half a diagonal away, and has the face of a sample near to it
    slack = (3**0.5 + 0.5) * table.grid.cell
    assert np.all(np.sqrt(square) <= distance_from_all(surface, points[known]) + slack)


def test_a_table_has_faces_of_its_border_for_what_is_far_away():
    surface = SHAPES['torus']
    face = make_face_table(surface).nearest(np.array([(5.0, 0.0, 0.0), (-1e6, 0.0, 0.0)]))
    assert np.sign(surface.vertices[surface.faces[face], 0].mean(axis=1)).tolist() == [1.0, -1.0]


def test_outside_of_the_grid_the_distance_is_that_of_the_box():
    grid = nearest_faces(SHAPES['torus'])
    points = np.array([(5.0, 0.0, 0.0), (-1e6, 0.0, 0.0), (2.0, 2.0, 1e9)])
    distance, normal = grid.distance(points)
    assert distance[:2] == pytest.approx([4.0, 1e6 - 1.0])
    assert normal[:2] == pytest.approx(np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]))


def test_the_thinnest_wall_is_found_where_there_is_one():
    for wall in (0.1, 0.02, 0.001):
        half = nearest_faces(thin_bin(wall)).half_thickness
        assert wall / 8 <= half <= wall / 2
    solid = nearest_faces(SHAPES['icosphere'])
    assert solid.half_thickness == solid.exact_to


def test_the_same_content_has_the_same_grid():
    surface = SHAPES['icosphere']
    same = nearest_faces(Surface(surface.vertices.copy(), surface.faces.copy()))
    assert same is nearest_faces(surface)
    other = nearest_faces(Surface(surface.vertices * 1.001, surface.faces))
    turned = nearest_faces(Surface(surface.vertices, np.roll(surface.faces, 1, axis=1)))
    assert other is not same and turned is not same


def test_a_surface_that_is_not_closed_is_refused():
    ball = SHAPES['icosphere']
    for surface in (sheet(), Surface(ball.vertices, ball.faces[1:])):
        with pytest.raises(MeshError, match=r'mesh is not closed.*fill its holes') as refusal:
            nearest_faces(surface)
        assert '\n' not in str(refusal.value)
