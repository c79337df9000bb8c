# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Mesh files as they come: where they are, what is repaired and said, and what is refused."""

import gzip
import itertools
import json
import logging
import warnings

from core_helpers import enclosed_volume
import numpy as np
import pytest
import trimesh

from softbody_ros.core import (
    BodyConfig,
    MeshError,
    MeshFrame,
    ObstacleConfig,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.geometry.bvh import closed_tree
from softbody_ros.core.geometry.glb import CHUNK_HEADER, GLB_HEADER
from softbody_ros.core.geometry.mesh_edges import edges_of
from softbody_ros.core.geometry.mesh_files import FILE_TYPES

pytestmark = pytest.mark.oldest

BOX = trimesh.creation.box((1.0, 1.0, 1.0))


def saved(folder, vertices, faces, name='part.obj'):
    """Write an OBJ file, triangle by triangle as it is given."""
    lines = ['v ' + ' '.join(map(repr, map(float, vertex))) for vertex in vertices]
    lines += ['f ' + ' '.join(str(corner + 1) for corner in face) for face in faces]
    path = folder / name
    path.write_text('\n'.join(lines) + '\n')
    return str(path)


def joined(*meshes):
    """Return vertices and faces of several meshes, next to each other."""
    both = trimesh.util.concatenate(list(meshes))
    return np.asarray(both.vertices), np.asarray(both.faces)


def box(extents=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.box(extents)
    mesh.apply_translation(at)
    return mesh


def inverted(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def volume(surface):
    return enclosed_volume(surface.vertices, surface.faces)


def distances(surface, *points):
    return closed_tree(surface).distance(np.array(points, float))[0]


def natural(path, origin='file', **frame):
    """Return a mesh in its own units, where it is."""
    return make_surface(str(path), 0.5, 3, MeshFrame(1.0, origin, **frame))


def glb_of(document, rest=b''):
    text = json.dumps(document).encode()
    text += b' ' * (-len(text) % 4)
    head = GLB_HEADER.pack(b'glTF', 2, GLB_HEADER.size + CHUNK_HEADER.size + len(text) + len(rest))
    return head + CHUNK_HEADER.pack(len(text), b'JSON') + text + rest


def parts_of_glb(content):
    size, _ = CHUNK_HEADER.unpack_from(content, GLB_HEADER.size)
    start = GLB_HEADER.size + CHUNK_HEADER.size
    return json.loads(content[start : start + size]), content[start + size :]


@pytest.fixture(autouse=True)
def quiet(caplog, capfd):
    """Nothing but sentences: no line of a library in the log or on the terminal, no warning."""
    with warnings.catch_warnings(), caplog.at_level(logging.INFO):
        warnings.simplefilter('error')
        yield
    assert not caplog.records
    assert capfd.readouterr() == ('', '')


# ------------------------------------------------------------------------- scale, origin and axes
FINGER = box((120.0, 40.0, 30.0), at=(50.0, 0.0, 5.0))  # mm, from its joint


def test_a_file_in_millimetres_keeps_its_size_and_its_origin(tmp_path):
    path = tmp_path / 'finger.stl'
    FINGER.export(path)
    surface = make_surface(str(path), 0.5, 3, MeshFrame(0.001, 'file'))
    assert surface.vertices.min(axis=0) == pytest.approx([-0.01, -0.02, -0.01], abs=1e-9)
    assert surface.vertices.max(axis=0) == pytest.approx([0.11, 0.02, 0.02], abs=1e-9)
    assert not surface.notes


def test_two_files_of_one_assembly_stay_where_they_are(tmp_path):
    lower, upper = box((2.0, 2.0, 1.0), at=(3.0, 1.0, 0.5)), box(at=(3.5, 1.0, 1.5))
    bodies = []
    for name, part in (('lower', lower), ('upper', upper)):
        part.export(tmp_path / f'{name}.stl')
        bodies.append(
            BodyConfig(
                name=name, mesh=str(tmp_path / f'{name}.stl'), mesh_scale=0.01,
                mesh_origin='file', position=(0.0, 0.0, 0.2),
            )
        )  # fmt: skip
    world = World(WorldConfig(bodies=tuple(bodies), obstacles=()))
    for body, part in (('lower', lower), ('upper', upper)):
        x = world.positions(body)
        assert x.min(axis=0) == pytest.approx(0.01 * part.bounds[0] + (0.0, 0.0, 0.2))
        assert x.max(axis=0) == pytest.approx(0.01 * part.bounds[1] + (0.0, 0.0, 0.2))


@pytest.mark.parametrize('scale', [0.0, 0.25])
def test_the_origin_is_that_of_the_file_the_centre_of_its_box_or_of_its_mass(tmp_path, scale):
    cone = trimesh.creation.cone(1.0, 4.0, sections=64)
    cone.apply_translation((10.0, 0.0, 0.0))
    path = tmp_path / 'cone.ply'
    cone.export(path)
    factor = scale or 0.5 / 2.0  # half of its height is 2
    low = {
        origin: make_surface(str(path), 0.5, 3, MeshFrame(scale, origin)).vertices.min(axis=0)
        for origin in ('file', 'box_centre', 'centre_of_mass')
    }
    assert low['file'] == pytest.approx(factor * cone.bounds[0], rel=1e-6)
    assert low['box_centre'] == pytest.approx(-0.5 * factor * cone.extents, rel=1e-6)
    # of a solid cone at a quarter of its height
    assert low['centre_of_mass'][2] == pytest.approx(-factor, rel=1e-6)
    assert low['centre_of_mass'][0] == pytest.approx(-factor, rel=1e-3)


def test_the_centre_of_mass_of_an_open_mesh_is_that_of_its_area(tmp_path):
    triangle = Surface(np.array([(0, 0, 0), (3, 0, 0), (0, 3, 0)]), np.array([(0, 1, 2)]))
    path = saved(tmp_path, triangle.vertices, triangle.faces)
    surface = natural(path, 'centre_of_mass')
    assert surface.vertices.min(axis=0) == pytest.approx([-1.0, -1.0, 0.0])


def test_the_centre_of_mass_of_a_line_is_that_of_its_vertices(tmp_path):
    path = saved(tmp_path, [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)])
    surface = natural(path, 'centre_of_mass')
    assert surface.vertices[:, 0] == pytest.approx([-1.0, 0.0, 1.0])


@pytest.mark.parametrize('extension', FILE_TYPES)
def test_a_cone_stands_whatever_file_it_is_in(tmp_path, extension):
    cone = trimesh.creation.cone(0.5, 2.0)
    if extension in ('glb', 'dae'):  # of which y is up
        cone.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    path = tmp_path / f'cone.{extension}'
    cone.export(path)
    surface = make_surface(str(path), 1.0, 0)
    x = surface.vertices
    assert np.ptp(x, axis=0) == pytest.approx([1.0, 1.0, 2.0], abs=1e-6)
    tip = x[x[:, 2].argmax()]
    assert tip == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)  # and not its base
    assert (x[:, 2] > 0.99).sum() == 1
    assert surface.closed and volume(surface) > 0.0
    other = 'z' if extension in ('glb', 'dae') else 'y'
    lying = make_surface(str(path), 1.0, 0, MeshFrame(up=other)).vertices
    assert np.ptp(lying, axis=0) == pytest.approx([1.0, 2.0, 1.0], abs=1e-6)


@pytest.mark.parametrize(
    ('asset', 'expected'),
    [
        ('<unit name="mm" meter="0.001"/><up_axis>Z_UP</up_axis>', (1.0, 2.0, 3.0)),
        ('<unit name="mm" meter="0.001"/><up_axis>Y_UP</up_axis>', (1.0, 3.0, 2.0)),
        ('<unit name="mm" meter="0.001"/><up_axis>X_UP</up_axis>', (2.0, 3.0, 1.0)),
        ('<unit name="mm" meter="0.001"/>', (1.0, 3.0, 2.0)),
    ],
)
def test_a_collada_file_says_its_unit_and_what_is_up(tmp_path, asset, expected):
    text = trimesh.exchange.dae.export_collada(box((1.0, 2.0, 3.0), (5.0, 5.0, 5.0))).decode()
    start, end = text.index('</created>') + 10, text.index('</modified>') + 11
    assert '<up_axis>' in text[end:]
    rest = text[end:].partition('<up_axis>')[2].partition('</up_axis>')[2]
    path = tmp_path / 'box.dae'
    path.write_text(text[:start] + text[start:end] + asset + rest)
    surface = natural(path)
    assert np.ptp(surface.vertices, axis=0) == pytest.approx(1e-3 * np.array(expected))


def test_x_up_turns_right_handed(tmp_path):
    # COLLADA 1.4.1: of X_UP negative y is right, x up, z inwards, to whoever looks
    mesh = box((1.0, 1.0, 1.0), (1.0, 0.0, 0.0))
    text = trimesh.exchange.dae.export_collada(mesh).decode()
    path = tmp_path / 'box.dae'
    path.write_text(text.replace('Y_UP', 'X_UP'))
    surface = natural(path)
    assert surface.vertices.mean(axis=0) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert volume(surface) == pytest.approx(1.0)


def test_the_transforms_of_a_scene_are_applied_before_it_is_turned(tmp_path):
    scene = trimesh.Scene()
    turned = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 0, 1), (0, 0, 0))
    turned[:3, 3] = (0.0, 5.0, 0.0)
    scene.add_geometry(box((2.0, 1.0, 1.0)), transform=turned)
    path = tmp_path / 'scene.glb'
    scene.export(path)
    surface = natural(path)
    assert surface.vertices.min(axis=0) == pytest.approx([-0.5, -0.5, 4.0])
    assert surface.vertices.max(axis=0) == pytest.approx([0.5, 0.5, 6.0])


@pytest.mark.parametrize('scale', [1e-6, 1e5])
def test_a_scale_that_makes_a_mesh_uselessly_small_or_large_is_refused(tmp_path, scale):
    path = tmp_path / 'box.stl'
    BOX.export(path)
    with pytest.raises(MeshError, match=r'measures .* m across with mesh_scale .*: it must be'):
        make_surface(str(path), 0.5, 0, MeshFrame(scale))


def test_a_mesh_that_is_far_from_its_origin_cannot_keep_it(tmp_path):
    path = saved(tmp_path, BOX.vertices + (2e6, 0.0, 0.0), BOX.faces)
    with pytest.raises(MeshError) as caught:
        natural(path)
    assert str(caught.value) == (
        f'mesh {path} is 2e+06 times its size away from its origin: move it there, or set '
        'mesh_origin to box_centre'
    )
    assert natural(path, 'box_centre').closed


def test_an_obstacle_has_the_scale_of_its_mesh_whatever_its_size_is(tmp_path):
    path = tmp_path / 'finger.stl'
    FINGER.export(path)
    given = {'type': 'mesh', 'mesh': str(path), 'mesh_scale': 0.001, 'mesh_origin': 'file'}
    config = ObstacleConfig(name='finger', position=(0.0, 0.0, 1.0), **given)
    (obstacle,) = World(WorldConfig(bodies=(), obstacles=(config,))).obstacles
    ends = np.array([(0.11, 0.0, 1.005), (-0.01, 0.0, 1.005), (0.12, 0.0, 1.005)])
    distance, _ = obstacle.closest(ends)
    assert distance == pytest.approx([0.0, 0.0, 0.01], abs=1e-9)
    assert obstacle.half_extents == pytest.approx([0.11, 0.02, 0.02])
    assert np.ptp(obstacle.triangles, axis=0) == pytest.approx([0.12, 0.04, 0.03])


def test_primitives_have_no_scale_no_origin_and_no_other_axis():
    plain = make_surface('cylinder', 0.5, 1)
    other = make_surface('cylinder', 0.5, 1, MeshFrame(0.001, 'file', 'y'))
    np.testing.assert_array_equal(other.vertices, plain.vertices)


def test_bodies_of_one_file_in_two_frames_are_two_shapes(tmp_path):
    path = str(tmp_path / 'box.stl')
    box((1.0, 1.0, 2.0)).export(path)
    bodies = [
        BodyConfig(name=f'b{number}', mesh=path, **frame)
        for number, frame in enumerate(
            ({}, {'mesh_scale': 0.1}, {'mesh_up': 'y'}, {'mesh_origin': 'file'})
        )
    ]
    world = World(WorldConfig(bodies=tuple(bodies[:3]), obstacles=()))
    extents = [np.ptp(world.positions(name), axis=0)[2] for name in world.names]
    assert extents == pytest.approx([1.0, 0.2, 0.5])
    for config in (bodies[3], BodyConfig(name='b4', mesh=path, mesh_scale=0.3)):
        world.adopt(world.prepare(WorldConfig(bodies=(*world.config.bodies, config))))
    assert np.ptp(world.positions('b4'), axis=0)[2] == pytest.approx(0.6)


# ----------------------------------------------------------------------------- parts and winding
def test_one_of_two_cubes_that_is_inside_out_is_turned_and_keeps_a_ball_out(tmp_path):
    path = saved(tmp_path, *joined(box(), inverted(box(at=(3.0, 0.0, 0.0)))))
    surface = natural(path)
    assert surface.closed
    assert volume(surface) == pytest.approx(2.0)
    assert distances(surface, (0, 0, 0), (3, 0, 0), (1.5, 0, 0)) == pytest.approx([-0.5, -0.5, 1])
    assert surface.notes == (f'mesh {path} has 1 of its 2 parts inside out: it is turned',)
    config = ObstacleConfig(type='mesh', mesh=path, mesh_scale=1.0, mesh_origin='file')
    ball = BodyConfig(name='ball', size=0.2, position=(3.0, 0.0, 0.8), mode='rigid')
    world = World(WorldConfig(bodies=(ball,), obstacles=(config,)))
    world.step(240)
    assert world.positions('ball')[:, 2].min() == pytest.approx(0.5, abs=0.01)


def test_a_cavity_stays_inside_and_what_is_in_it_is_solid(tmp_path):
    solid, room, pip = box((3.0, 3.0, 3.0)), box((2.0, 2.0, 2.0)), box()
    right = (solid, inverted(room), pip)
    path = saved(tmp_path, *joined(*right))
    surface = natural(path)
    assert not surface.notes
    points = (0, 0, 0), (0.75, 0, 0), (1.25, 0, 0), (2, 0, 0)
    assert np.sign(distances(surface, *points)).tolist() == [-1, 1, -1, 1]
    assert volume(surface) == pytest.approx(27 - 8 + 1)
    for wrong in ((solid, room, pip), tuple(map(inverted, right)), (inverted(solid), room, pip)):
        path = saved(tmp_path, *joined(*wrong))
        other = natural(path)
        assert volume(other) == pytest.approx(20)
        assert np.sign(distances(other, *points)).tolist() == [-1, 1, -1, 1]
        assert other.notes


def test_parts_that_overlap_are_no_cavities(tmp_path):
    # the box of the small one is in that of the large one, most of its corners are inside
    ball = trimesh.creation.icosphere(3)
    small = box((0.8, 0.4, 0.4), at=(0.55, 0.55, 0.0))
    surface = natural(saved(tmp_path, *joined(ball, small)))
    assert not surface.notes
    assert volume(surface) == pytest.approx(ball.volume + small.volume)


def test_a_part_beside_another_in_its_box_is_not_inside_it(tmp_path):
    ring = trimesh.creation.torus(2.0, 0.5, 32, 16)
    path = saved(tmp_path, *joined(ring, box((0.5, 0.5, 0.5))))
    surface = natural(path)
    assert not surface.notes
    assert volume(surface) == pytest.approx(ring.volume + 0.125)


def test_a_flipped_triangle_is_turned(tmp_path):
    ball = trimesh.creation.icosphere(2)
    faces = ball.faces.copy()
    faces[17] = faces[17, ::-1]
    path = saved(tmp_path, ball.vertices, faces)
    surface = natural(path)
    assert surface.closed
    np.testing.assert_array_equal(surface.faces, ball.faces)
    assert volume(surface) == pytest.approx(ball.volume)
    assert surface.notes == (f'mesh {path} has 1 triangle wound against the others: it is turned',)


def test_triangles_that_are_wound_at_random_are_all_turned(tmp_path):
    part = trimesh.util.concatenate([trimesh.creation.torus(2.0, 0.5), box(at=(0, 0, 9))])
    turn = np.random.default_rng(3).random(len(part.faces)) < 0.5
    faces = np.where(turn[:, None], part.faces[:, ::-1], part.faces)
    surface = natural(saved(tmp_path, part.vertices, faces))
    assert surface.closed
    assert volume(surface) == pytest.approx(part.volume)


def test_a_moebius_strip_has_no_winding_and_is_left_as_it_is(tmp_path):
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    side = [
        np.stack([(2 + w * np.cos(angle / 2)) * np.cos(angle),
                  (2 + w * np.cos(angle / 2)) * np.sin(angle), w * np.sin(angle / 2)], axis=1)
        for w in (-0.5, 0.5)
    ]  # fmt: skip
    faces = []
    for i in range(24):
        a, b, j = i, i + 24, (i + 1) % 24
        c, d = (j, j + 24) if j else (j + 24, j)
        faces += [(a, c, b), (b, c, d)]
    surface = natural(saved(tmp_path, np.concatenate(side), faces))
    assert surface.openness[0] == (
        '48 edges with one triangle only and 1 edge between triangles of opposite winding'
    )


# ------------------------------------------------------------------- triangles that do not belong
def notes_of(surface):
    return [note.partition('.obj ')[2] for note in surface.notes]


def test_doubled_triangles_are_left_out(tmp_path):
    path = saved(tmp_path, BOX.vertices, np.concatenate([BOX.faces, BOX.faces[3:6]]))
    surface = natural(path)
    assert surface.closed and volume(surface) == pytest.approx(1.0)
    assert notes_of(surface) == ['has 3 triangles twice: one of each is left out']
    both = np.concatenate([BOX.faces, BOX.faces[:, ::-1]])
    surface = natural(saved(tmp_path, BOX.vertices, both))
    assert surface.closed and volume(surface) == pytest.approx(1.0)
    assert notes_of(surface) == ['has 12 triangles twice: one of each is left out']


def test_a_wall_between_cells_is_left_out(tmp_path):
    cells = joined(*(box(at=(float(i), float(j), 0.0)) for i in range(3) for j in range(2)))
    surface = natural(saved(tmp_path, *cells))
    assert surface.closed
    assert volume(surface) == pytest.approx(6.0)
    assert distances(surface, (0.5, 0.0, 0.0), (1.0, 0.5, 0.0)) == pytest.approx([-0.5, -0.5])
    assert notes_of(surface) == [
        'has 14 triangles of walls inside it, back to back with others: both sides are left out'
    ]


def test_a_sheet_that_is_seen_from_both_sides_is_one_sheet(tmp_path):
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    faces = [(0, 1, 2), (0, 2, 3), (2, 1, 0), (3, 2, 0)]
    surface = natural(saved(tmp_path, corners, faces))
    assert surface.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_cubes_that_share_an_edge_are_two_solids(tmp_path):
    path = saved(tmp_path, *joined(box(), box(at=(1.0, 1.0, 0.0))))
    surface = natural(path)
    assert surface.closed
    assert len(surface.vertices) == 16
    assert volume(surface) == pytest.approx(2.0)
    points = (0, 0, 0), (1, 1, 0), (1, 0, 0), (0.4, 0.4, 0), (0.6, 0.6, 0), (0.45, 0.55, 0.0)
    assert np.sign(distances(surface, *points)).tolist() == [-1, -1, 1, -1, -1, 1]
    assert notes_of(surface) == ['touches itself along 1 edge: its parts are separate there']


def test_a_solid_that_touches_itself_along_edges_is_closed(tmp_path):
    # cells around a vertical hole that is closed by two cells that meet in an edge
    cells = [(0, 0), (1, 0), (2, 0), (0, 1), (2, 1), (1, 2), (2, 2)]
    mesh = trimesh.util.concatenate([box(at=(i, j, 0)) for i, j in cells])
    surface = natural(saved(tmp_path, mesh.vertices, mesh.faces))
    assert surface.closed
    assert volume(surface) == pytest.approx(7.0)
    assert np.sign(distances(surface, (1, 1, 0), (0, 2, 0), (0.3, 1.3, 0))).tolist() == [1, 1, -1]


def test_triangles_without_area_go_and_the_mesh_stays_closed(tmp_path):
    # the diagonal of a side of the box is split by two triangles on a line, as CAD exporters do
    vertices, faces = BOX.vertices, BOX.faces.tolist()
    a, b, c = faces[0]
    middle = len(vertices)
    faces[0] = [a, b, middle]
    faces += [[b, c, middle], [a, middle, c], [a, a, b]]
    points = np.vstack([vertices, [(vertices[a] + vertices[c]) / 2]])
    surface = natural(saved(tmp_path, points, faces))
    assert surface.closed
    assert len(surface.vertices) == 9
    corners = surface.vertices[surface.faces]
    area = np.linalg.norm(np.cross(*(corners[:, 1:] - corners[:, :1]).swapaxes(0, 1)), axis=1)
    assert area.min() > 0.1 and area.sum() == pytest.approx(12.0)
    assert notes_of(surface) == [
        'has 1 triangle without area: it is left out',
        'has 1 triangle whose corners are on a line: what is next to them takes their place',
    ]


def test_vertices_that_no_triangle_uses_are_left_out_and_said(tmp_path):
    points = np.vstack([BOX.vertices, [(9.0, 9.0, 9.0), (np.nan, 0.0, 0.0)]])
    trimesh.Trimesh(points, BOX.faces, process=False).export(tmp_path / 'part.ply')
    surface = natural(tmp_path / 'part.ply')
    assert len(surface.vertices) == 8
    assert surface.notes == (
        f'mesh {tmp_path / "part.ply"} has 2 vertices that no triangle uses, 1 of them not '
        'finite: they are left out',
    )


def test_what_is_left_out_does_not_count_in_the_size(tmp_path):
    points = np.vstack([BOX.vertices, [(9.0, 9.0, 9.0)]])
    surface = make_surface(saved(tmp_path, points, [*BOX.faces, (8, 8, 8)]), 0.5, 0)
    assert np.ptp(surface.vertices, axis=0) == pytest.approx([1.0, 1.0, 1.0])
    # beside a long box, what is left out moves only the centre
    bar = box((4.0, 1.0, 1.0))
    points = np.vstack([bar.vertices, [(0.0, 1.0, 0.0), (0.0, 1.0, 0.0)]])
    surface = make_surface(saved(tmp_path, points, [*bar.faces, (8, 9, 8)]), 0.5, 0)
    assert surface.vertices.max(axis=0) == pytest.approx([0.5, 0.125, 0.125])


def partition(at, axis=0, size=1.0):
    """Return a wall across a box, of the corners that its sides have there."""
    corners = size * np.array([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)]) - (0.0, 0.5, 0.5)
    corners[:, 0] = at
    return trimesh.Trimesh(np.roll(corners, axis, axis=1), [(0, 1, 2), (0, 2, 3)], process=False)


def tube(*places):
    """Return the sides and both ends of a box that have corners at so many places along x."""
    cells = [
        box((high - low, 1, 1), ((low + high) / 2, 0, 0))
        for low, high in itertools.pairwise(places)
    ]
    sides = trimesh.util.concatenate(cells)
    x = sides.triangles_center[:, 0]
    ends = np.isclose(np.ptp(sides.triangles[:, :, 0], axis=1), 0.0)
    sides.update_faces(~ends | np.isclose(x, places[0]) | np.isclose(x, places[-1]))
    return sides


@pytest.mark.parametrize('walls', [(1.0,), (1.0, 1.5)])
def test_walls_inside_a_solid_are_left_out(tmp_path, walls):
    mesh = joined(tube(0.0, *walls, 3.0), *map(partition, walls))
    surface = natural(saved(tmp_path, *mesh))
    assert surface.closed
    assert volume(surface) == pytest.approx(3.0)
    assert distances(surface, (1.0, 0.0, 0.3)) == pytest.approx([-0.2])
    assert notes_of(surface) == [f'has {2 * len(walls)} triangles of walls inside it, left out']


def test_a_wall_outside_is_none_inside(tmp_path):
    # a bridge between two towers on a base: without it they are closed, but it is not in them
    corners = np.array([(0, -0.5, 0.5), (3, -0.5, 0.5), (1.5, -0.5, 2.0)])
    bridge = trimesh.Trimesh(corners, [(0, 1, 2)], process=False)
    path = saved(tmp_path, *joined(tube(0.0, 1.0, 3.0), bridge))
    assert not natural(path).closed
    assert not natural(path).notes


FAULTY = {
    'shared edge': joined(box(), box(at=(-1.0, -1.0, 0.0))),
    'doubled': (BOX.vertices, np.concatenate([BOX.faces, BOX.faces])),
    'flipped': (BOX.vertices, np.concatenate([BOX.faces[:11], BOX.faces[11:, ::-1]])),
    'inner wall': joined(tube(-1.0, -0.4, 0.5), partition(-0.4)),
    'inside out': joined(inverted(box()), box(at=(-3.0, 0.0, 0.0))),
    'cells': joined(box(), box(at=(-1.0, 0.0, 0.0))),
}


@pytest.mark.parametrize('kind', FAULTY)
def test_a_fast_ball_bounces_off_a_body_that_was_repaired(tmp_path, kind):
    slab = BodyConfig(
        name='slab', mesh=saved(tmp_path, *FAULTY[kind]), mesh_scale=1.0, mesh_origin='file',
        position=(0.0, 0.0, 0.0), mode='rigid', mass=1e3,
    )  # fmt: skip
    ball = BodyConfig(
        name='ball', size=0.1, mass=0.1, position=(0.1, 0.25, 1.0), subdivisions=1, mode='rigid',
        initial_velocity_linear=(0.0, 0.0, -2.0),
    )  # fmt: skip
    world = World(WorldConfig(bodies=(slab, ball), obstacles=(), gravity_magnitude=0.0))
    assert len(world.notes) == 1 and ' not closed ' not in world.notes[0]
    world.step(240)
    assert world.positions('ball')[:, 2].min() > 0.5
    assert world.velocities('ball')[:, 2].mean() > 0.0


# ---------------------------------------------------------------------------- what is not a solid
HOLED = (BOX.vertices, BOX.faces[1:])
FIN = [(0.5, -0.5, -0.5), (0.5, -0.5, 0.5), (1.5, 0.0, 0.0)]
FINNED = joined(BOX, trimesh.Trimesh(FIN, [(0, 1, 2)], process=False))
OPEN = {
    'hole': (HOLED, '3 edges with one triangle only', 'fill its holes'),
    'fin': (
        FINNED,
        '2 edges with one triangle only and 1 edge with more than two triangles',
        'fill its holes and remove its inner walls and part what touches along edges',
    ),
}


@pytest.mark.parametrize('kind', OPEN)
def test_an_obstacle_that_is_not_closed_is_refused_by_its_own_fault(tmp_path, kind):
    mesh, defects, remedy = OPEN[kind]
    path = saved(tmp_path, *mesh)
    assert natural(path).openness == (defects, remedy)
    with pytest.raises(MeshError) as caught:
        World(WorldConfig(obstacles=(ObstacleConfig(name='wall', type='mesh', mesh=path),)))
    sentence = f'mesh {path} is not closed, so that it has no inside ({defects}): {remedy}'
    assert str(caught.value) == f'wall.{sentence}'


@pytest.mark.parametrize('kind', OPEN)
def test_of_a_body_that_is_not_closed_it_is_said_what_does_not_work(tmp_path, kind):
    mesh, defects, remedy = OPEN[kind]
    path = saved(tmp_path, *mesh)
    slab = BodyConfig(name='slab', mesh=path, position=(0.0, 0.0, 0.0), mode='rigid')
    slab_of = {'bodies': (slab,), 'obstacles': (), 'gravity_magnitude': 0.0}
    world = World(WorldConfig(**slab_of))
    (note,) = world.notes
    assert note.startswith(
        f'slab.mesh {path} is not closed ({defects}): it has no inside, so that'
    )
    assert note.endswith(f'; {remedy}')
    # and this is so: a fast ball that meets no vertex of it passes
    ball = BodyConfig(
        name='ball', size=0.1, mass=0.1, position=(0.1, 0.25, 1.0), subdivisions=1,
        initial_velocity_linear=(0.0, 0.0, -2.0), mode='rigid',
    )  # fmt: skip
    world.add(ball)
    world.step(240)
    assert world.positions('ball')[:, 2].max() < -0.5
    closed = closed_like(slab)
    world = World(WorldConfig(bodies=(closed, ball), obstacles=(), gravity_magnitude=0.0))
    assert not world.notes
    world.step(240)
    assert world.positions('ball')[:, 2].min() > 0.3


def closed_like(config):
    return BodyConfig(
        name=config.name, mesh='box', subdivisions=0, mode='rigid', position=config.position
    )


def test_notes_are_those_of_what_is_there(tmp_path):
    double = saved(tmp_path, BOX.vertices, np.concatenate([BOX.faces, BOX.faces[:1]]), 'two.obj')
    other = saved(tmp_path, *joined(BOX, inverted(box(at=(2, 0, 0)))), 'three.obj')
    obstacle = ObstacleConfig(name='wall', type='mesh', mesh=double)
    world = World(WorldConfig(bodies=(), obstacles=(obstacle,)))
    said = f'mesh {double} has 1 triangle twice: one of each is left out'
    assert world.notes == (f'wall.{said}',)
    world.add(BodyConfig(name='body', mesh=double))
    world.add(ObstacleConfig(name='more', type='mesh', mesh=other))
    assert world.notes == (
        f'body.{said}',
        f'wall.{said}',
        f'more.mesh {other} has 1 of its 2 parts inside out: it is turned',
    )
    world.remove('wall')
    world.remove('more')
    assert world.notes == (f'body.{said}',)


def test_the_edges_of_a_mesh_without_triangles_are_none():
    assert edges_of(np.zeros((0, 3), int)).defects() == []


# ------------------------------------------------------------------------------- what is no mesh
def refusal(path):
    with pytest.raises(MeshError) as caught:
        make_surface(str(path), 0.5, 3)
    message = str(caught.value)
    assert message.startswith(f'mesh file {path} ')
    assert '\n' not in message
    return message.removeprefix(f'mesh file {path} ')


LFS = b'version https://git-lfs.github.com/spec/v1\noid sha256:1234\nsize 12345\n'
CONTENTS = {
    'a pointer': (LFS, 'is a Git LFS pointer, not the mesh: fetch it with git lfs pull'),
    'a web page': (b'\n<!DOCTYPE html>\n<html lang="en">', 'is a web page, not the mesh: '),
    'an old web page': (b'<HTML><head>', 'is a web page, not the mesh: '),
    'gzip': (gzip.compress(b'solid'), 'is compressed by gzip: unpack it with gunzip'),
    'ZIP': (b'PK\x03\x04' + bytes(100), 'is a ZIP archive'),
    'FBX': (b'Kaydara FBX Binary  \0\x1a\0', 'is FBX: export it as GLB'),
    'STEP': (b'ISO-10303-21;\nHEADER;', 'is STEP: export it as STL'),
    'PNG': (b'\x89PNG\r\n\x1a\n' + bytes(50), 'is a PNG image'),
    'SVG': (b'<?xml version="1.0"?><svg xmlns="x"/>', 'is XML of <svg>: export it as GLB'),
    'glTF with files': (b'{"asset": {"version": "2.0"}}', 'is glTF with files of its own (.gltf)'),
    'zeros': (bytes(500), 'holds nothing but zeros and blanks'),
    'nothing': (b'', 'is empty'),
}


@pytest.mark.parametrize('extension', FILE_TYPES)
@pytest.mark.parametrize('kind', CONTENTS)
def test_what_is_no_mesh_is_refused_by_what_it_is(tmp_path, kind, extension):
    content, sentence = CONTENTS[kind]
    path = tmp_path / f'thing.{extension}'
    path.write_bytes(content)
    assert refusal(path).startswith(sentence)


@pytest.mark.parametrize('named', FILE_TYPES)
@pytest.mark.parametrize('held', FILE_TYPES)
def test_a_file_of_another_format_is_refused_with_its_right_name(tmp_path, held, named):
    if held == named:
        return
    path = tmp_path / f'ball.{named}'
    trimesh.creation.icosphere(1).export(path, file_type=held)
    sentence = f'is not {named.upper()}, but {held.upper()}: rename it to ball.{held}'
    assert refusal(path) == sentence


TETRAHEDRON = ['0 0 0', '1 0 0', '0 1 0', '0 0 1']
FACES = ['3 0 2 1', '3 0 1 3', '3 1 2 3', '3 0 3 2']
TEXTS = {
    'ply': [
        'ply', 'format ascii 1.0', 'element vertex 4', 'property float x', 'property float y',
        'property float z', 'element face 4', 'property list uchar int vertex_indices',
        'end_header', *TETRAHEDRON, *FACES,
    ],
    'off': ['OFF', '# a comment', '4 4 0', *TETRAHEDRON, '', *FACES],
    'obj': [*(f'v {each}' for each in TETRAHEDRON), 'f 1 3 2', 'f 1 2 4', 'f 2 3 4', 'f 1 4 3'],
    'stl': trimesh.creation.box().export(file_type='stl_ascii').splitlines(),
}  # fmt: skip
"""Lines of closed meshes."""


def written(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize('extension', ['ply', 'off'])
@pytest.mark.parametrize(('missing', 'left'), [(2, 2), (6, 0)])
def test_a_text_that_is_cut_off_is_refused_with_what_is_left_of_it(
    tmp_path, extension, missing, left
):
    lines = TEXTS[extension]
    path = written(tmp_path / f'part.{extension}', '\n'.join(lines) + '\n\n')
    assert make_surface(str(path), 0.5, 0).closed
    sentence = f'is cut off, with {left} of 4 faces: export or copy it again'
    assert refusal(written(path, '\n'.join(lines[:-missing]))) == sentence
    if left:  # also in the middle of a line
        assert refusal(written(path, '\n'.join([*lines[:-missing], '3 1 2']))) == sentence


def test_numbers_before_the_corners_of_a_face_are_not_taken_for_them(tmp_path):
    text = '\n'.join(TEXTS['ply']).replace('property list', 'property int id\nproperty list')
    for face in FACES:
        text = text.replace(face, f'99 {face}')
    path = written(tmp_path / 'part.ply', text)
    assert make_surface(str(path), 0.5, 0).closed


def test_more_faces_than_there_can_be_are_refused(tmp_path):
    text = '\n'.join(TEXTS['off']).replace('4 4 0', '4 10000000000 0')
    assert refusal(written(tmp_path / 'part.off', text)).startswith('is cut off, with 4 of 10000')


@pytest.mark.parametrize('also', ['', '\nendsolid\nsolid'])
def test_a_text_stl_that_is_cut_off_is_refused(tmp_path, also):
    lines = TEXTS['stl']
    text = '\n'.join([*lines[:22], *also.split('\n'), *lines[22:30]])
    path = written(tmp_path / 'part.stl', text)
    assert refusal(path) == 'is cut off, without its endsolid: export or copy it again'


def test_a_text_stl_in_capitals_and_one_with_a_long_name_are_read(tmp_path):
    text = '\n'.join(TEXTS['stl'])
    for changed in (text.upper(), text.replace('solid ', f'solid {"x" * 70_000} ', 1)):
        path = written(tmp_path / 'part.stl', changed)
        assert make_surface(str(path), 0.5, 0).closed


@pytest.mark.parametrize('extension', TEXTS)
def test_a_byte_order_mark_is_not_a_part_of_the_first_line(tmp_path, extension):
    text = '\n'.join(TEXTS[extension])
    plain, marked = (
        make_surface(str(written(tmp_path / f'{name}.{extension}', mark + text.encode())), 0.5, 0)
        for name, mark in (('plain', b''), ('marked', b'\xef\xbb\xbf'))
    )
    np.testing.assert_array_equal(marked.vertices, plain.vertices)
    np.testing.assert_array_equal(marked.faces, plain.faces)


@pytest.mark.parametrize(
    ('extension', 'text'),
    [
        ('glb', b'{"a":' + b'[' * 100_000 + b']' * 100_000 + b'}'),
        ('dae', b'<COLLADA>' + b'<a>' * 20_000 + b'</a>' * 20_000 + b'</COLLADA>'),
    ],
)
def test_what_is_nested_without_end_is_refused(tmp_path, extension, text):
    if extension == 'glb':
        size = GLB_HEADER.size + CHUNK_HEADER.size + len(text)
        text = GLB_HEADER.pack(b'glTF', 2, size) + CHUNK_HEADER.pack(len(text), b'JSON') + text
    path = written(tmp_path / f'part.{extension}', text)
    assert refusal(path) == 'is nested too deeply: export it again'


def test_a_text_stl_and_a_binary_one_that_begins_like_one_are_read(tmp_path):
    trimesh.creation.icosphere(1).export(tmp_path / 'text.stl', file_type='stl_ascii')
    assert make_surface(str(tmp_path / 'text.stl'), 0.5, 0).closed
    trimesh.creation.icosphere(1).export(tmp_path / 'binary.stl')
    content = bytearray((tmp_path / 'binary.stl').read_bytes())
    for begin in (b'solid facet endsolid ', b'\x1f\x8b', b'v 1 2 3\n'):
        content[: len(begin)] = begin
        (tmp_path / 'binary.stl').write_bytes(content)
        assert make_surface(str(tmp_path / 'binary.stl'), 0.5, 0).closed


def test_a_binary_stl_that_is_cut_off_and_one_that_goes_on(tmp_path):
    content = BOX.export(file_type='stl')
    path = tmp_path / 'part.stl'
    path.write_bytes(content[:500])
    assert refusal(path) == (
        'is cut off, or no STL: it has 500 bytes, and 12 triangles would take 684'
    )
    path.write_bytes(content + b'COLOR')
    surface = make_surface(str(path), 0.5, 0)
    assert surface.closed
    assert surface.notes == (f'mesh {path} has 5 bytes after its triangles, left out',)


@pytest.mark.parametrize('end', ['\n', '\r\n', '\r'])
def test_lines_of_an_obj_may_end_in_any_way(tmp_path, end):
    path = tmp_path / 'part.obj'
    path.write_bytes(BOX.export(file_type='obj').replace('\n', end).encode())
    assert make_surface(str(path), 0.5, 0).closed


def test_a_folder_is_a_folder(tmp_path):
    (tmp_path / 'folder.stl').mkdir()
    assert refusal(tmp_path / 'folder.stl') == 'is a folder: give a file in it'


@pytest.mark.parametrize(
    ('extension', 'sentence'),
    [
        ('KHR_draco_mesh_compression', 'is compressed by Draco: decode it with gltf-transform cp'),
        ('EXT_meshopt_compression', 'is compressed by meshopt: decode it with gltf-transform cp'),
        ('EXT_mesh_gpu_instancing', 'needs the glTF extension EXT_mesh_gpu_instancing, which'),
    ],
)
def test_a_glb_that_needs_an_extension_is_refused_with_the_cure(tmp_path, extension, sentence):
    path = tmp_path / 'part.glb'
    BOX.export(path)
    document, rest = parts_of_glb(path.read_bytes())
    document |= {'extensionsUsed': [extension], 'extensionsRequired': [extension]}
    path.write_bytes(glb_of(document, rest))
    assert refusal(path).startswith(sentence)


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        (b'glTF\2\0', 'is cut off: export or copy it again'),
        (GLB_HEADER.pack(b'glTF', 1, 20) + bytes(8), 'is glTF of version 1: export it as glTF 2'),
        (glb_of({})[:-1] + b'[', 'cannot be read as GLB (its JSON is damaged): export it again'),
        (glb_of([]), 'cannot be read as GLB (its JSON is damaged): export it again'),
    ],
)
def test_a_damaged_glb_is_refused_by_what_is_wrong(tmp_path, content, sentence):
    path = tmp_path / 'thing.glb'
    path.write_bytes(content)
    assert refusal(path).startswith(sentence)


def test_a_glb_is_read_without_the_textures_that_cannot_be(tmp_path):
    path = tmp_path / 'part.glb'
    BOX.export(path)
    document, rest = parts_of_glb(path.read_bytes())
    extension = 'KHR_texture_basisu'
    document |= {
        'extensionsUsed': [extension], 'extensionsRequired': [extension],
        'images': [{'uri': 'missing.ktx2'}], 'textures': [{'extensions': {extension: {}}}],
        'materials': [{'pbrMetallicRoughness': {'baseColorTexture': {'index': 0}}}],
    }  # fmt: skip
    path.write_bytes(glb_of(document, rest))
    assert make_surface(str(path), 0.5, 0).closed


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'normalized': True, 'componentType': 5122}, 'has quantized coordinates: decode it with'),
        ({'sparse': {'count': 1}}, 'has sparse accessors'),
    ],
)
def test_coordinates_that_would_be_read_wrongly_are_refused(tmp_path, change, sentence):
    path = tmp_path / 'part.glb'
    BOX.export(path)
    document, rest = parts_of_glb(path.read_bytes())
    position = document['meshes'][0]['primitives'][0]['attributes']['POSITION']
    document['accessors'][position] |= change
    path.write_bytes(glb_of(document, rest))
    assert refusal(path).startswith(sentence)


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'mode': 6}, 'has triangle fans, which cannot be read: export it as triangles'),
        ({'uri': 'a.bin'}, 'keeps its data in another file, a.bin: export it as one GLB'),
    ],
)
def test_a_glb_of_which_a_part_would_be_lost_is_refused(tmp_path, change, sentence):
    path = tmp_path / 'part.glb'
    BOX.export(path)
    document, rest = parts_of_glb(path.read_bytes())
    target = document['buffers'][0] if 'uri' in change else document['meshes'][0]['primitives'][0]
    target |= change
    path.write_bytes(glb_of(document, rest))
    assert refusal(path) == sentence


@pytest.mark.parametrize('document', [{'meshes': [1]}, {'nodes': 3}, {'meshes': {'a': 'b'}}, []])
def test_a_glb_of_nonsense_is_refused(tmp_path, document):
    path = tmp_path / 'part.glb'
    path.write_bytes(glb_of(document))
    assert 'cannot be read as GLB' in refusal(path)


def test_collada_needs_pycollada_and_that_is_said(tmp_path, monkeypatch):
    path = tmp_path / 'part.dae'
    BOX.export(path)
    monkeypatch.setattr('importlib.util.find_spec', lambda name: None)
    assert refusal(path) == (
        "is COLLADA, which needs pycollada: pip install pycollada (or, in the clone, '.[dae]')"
    )


def test_materials_that_are_broken_lose_no_triangles_of_collada(tmp_path):
    text = trimesh.exchange.dae.export_collada(BOX).decode()
    path = tmp_path / 'part.dae'
    path.write_text(text.replace('target="#', 'target="#not_'))
    assert make_surface(str(path), 0.5, 0).closed


def test_strips_of_ply_are_said_to_be_strips(tmp_path):
    path = tmp_path / 'part.ply'
    path.write_text(
        'ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n'
        'property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n'
        '0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n'
    )
    with pytest.raises(MeshError, match='no triangles but strips of them'):
        make_surface(str(path), 0.5, 0)
