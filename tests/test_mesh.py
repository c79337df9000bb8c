# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Primitives and mesh files: what comes out, and what is refused with which sentence."""

from core_helpers import cad_mesh, enclosed_volume, random_rotation
import numpy as np
import pytest
import trimesh

from softbody_ros.core import (
    BodyConfig,
    MeshError,
    MeshFrame,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.geometry import mesh_files, surface
from softbody_ros.core.geometry.mesh import PRIMITIVES
from softbody_ros.core.geometry.mesh_files import FILE_TYPES

pytestmark = pytest.mark.oldest

# A tetrahedron, whose corners no symmetry exchanges.
CORNERS = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 1.5, 0.0), (0.3, 0.2, 1.0)])
TRIANGLES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


def volume(surface):
    return enclosed_volume(surface.vertices, surface.faces)


def half_extents(surface):
    assert surface.vertices.max(axis=0) == pytest.approx(-surface.vertices.min(axis=0))
    return surface.vertices.max(axis=0)


def soup(vertices, faces):
    """Return the triangles with corners of their own, as an STL file has them."""
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


def stl_bytes(vertices, faces):
    """Return a binary STL file, unchecked."""
    records = np.zeros(
        len(faces), dtype=[('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('extra', '<u2')]
    )
    records['corners'] = vertices[faces]
    return b'\0' * 80 + np.uint32(len(faces)).tobytes() + records.tobytes()


def obj_text(vertices, faces):
    lines = [f'v {x} {y} {z}' for x, y, z in vertices]
    return '\n'.join(lines + ['f ' + ' '.join(str(i + 1) for i in face) for face in faces])


def refusal(path):
    """Return the one sentence with which a file is refused."""
    with pytest.raises(MeshError) as caught:
        make_surface(str(path), 0.5, 3)
    message = str(caught.value)
    assert str(path) in message
    assert '\n' not in message
    return message


# ----------------------------------------------------------------------------------- primitives
@pytest.mark.parametrize('subdivisions', [0, 1, 3])
@pytest.mark.parametrize('kind', PRIMITIVES)
def test_a_primitive_is_closed_and_just_fits_its_cube(kind, subdivisions):
    surface = make_surface(kind, 0.7, subdivisions)
    assert surface.closed
    assert half_extents(surface).max() == pytest.approx(0.7, rel=1e-12)
    assert volume(surface) > 0.0


@pytest.mark.parametrize(
    ('kind', 'expected'),
    [
        ('icosphere', 4 / 3 * np.pi),
        ('box', 8.0),
        ('cylinder', 2 * np.pi),
        ('capsule', np.pi / 4 + 4 / 3 * np.pi / 8),
        ('torus', 2 * np.pi**2 * 2 / 3 / 9),
    ],
)
def test_the_volume_of_a_fine_primitive_is_that_of_the_solid(kind, expected):
    assert volume(make_surface(kind, 1.0, 3)) == pytest.approx(expected, rel=0.03)
    assert volume(make_surface(kind, 0.1, 3)) == pytest.approx(expected * 1e-3, rel=0.03)


@pytest.mark.parametrize('kind', PRIMITIVES)
def test_subdivisions_make_a_primitive_finer(kind):
    counts = [len(make_surface(kind, 1.0, level).faces) for level in range(4)]
    assert np.all(np.diff(counts) > 0)


# ---------------------------------------------------------------------------------------- files
@pytest.mark.parametrize('name', ['power_connector', 'qdd100_stator', 'knee_bumper'])
def test_a_cad_part_is_welded_scaled_and_centred(name):
    path = cad_mesh(name)
    raw = trimesh.load(path, process=False)
    surface = make_surface(path, 0.5, 3)
    assert len(surface.vertices) == len(np.unique(raw.vertices, axis=0))
    assert len(surface.faces) == len(raw.faces)
    assert surface.closed
    assert half_extents(surface) == pytest.approx(0.5 * raw.extents / raw.extents.max())
    assert volume(surface) == pytest.approx(raw.volume / raw.extents.max() ** 3, rel=1e-6)


@pytest.mark.parametrize('extension', FILE_TYPES)
def test_every_format_gives_the_same_shape(tmp_path, extension):
    source = trimesh.creation.icosphere(subdivisions=2)
    source.apply_scale((2.0, 1.0, 0.5))
    path = tmp_path / f'shape.{extension.upper()}'
    source.export(path, file_type=extension)
    surface = make_surface(str(path), 1.0, 0, MeshFrame(up='z'))
    assert surface.closed
    assert surface.faces.shape == source.faces.shape
    assert half_extents(surface) == pytest.approx([1.0, 0.5, 0.25], rel=1e-6)
    distance = np.linalg.norm(
        surface.vertices[:, None] - source.vertices[None] / source.extents.max() * 2, axis=2
    )
    assert len(surface.vertices) == len(source.vertices)
    assert distance.min(axis=1).max() < 1e-6


def test_vertices_split_along_texture_seams_are_welded(tmp_path):
    path = tmp_path / 'seams.obj'
    lines = [f'v {x} {y} {z}' for x, y, z in CORNERS]
    lines += [f'vt {i / 12} {j / 3}' for i in range(4) for j in range(3)]
    for i, face in enumerate(TRIANGLES):
        lines.append('f ' + ' '.join(f'{v + 1}/{3 * i + j + 1}' for j, v in enumerate(face)))
    path.write_text('\n'.join(lines))
    assert len(trimesh.load(path, process=False, force='mesh').vertices) == 12
    surface = make_surface(str(path), 1.0, 0)
    assert surface.vertices.shape == (4, 3)
    assert surface.closed


def test_vertices_that_rounding_has_moved_apart_are_welded(tmp_path):
    sphere = trimesh.creation.icosphere(subdivisions=3)
    vertices, faces = soup(sphere.vertices @ random_rotation(1), sphere.faces)
    noise = np.random.default_rng(1).uniform(-1e-9, 1e-9, vertices.shape)
    path = tmp_path / 'rounded.obj'
    path.write_text(obj_text(vertices + noise, faces))
    surface = make_surface(str(path), 1.0, 0)
    assert len(surface.vertices) == len(sphere.vertices)
    assert surface.closed


def test_details_larger_than_rounding_are_kept():
    surface = make_surface(cad_mesh('knee_bumper'), 1.0, 0)
    edges = surface.vertices[surface.faces] - np.roll(surface.vertices[surface.faces], 1, axis=1)
    assert np.linalg.norm(edges, axis=2).min() > 0.0


@pytest.mark.parametrize('extension', ['stl', 'ply'])
def test_an_inside_out_file_is_turned_round(tmp_path, extension):
    source = trimesh.Trimesh(CORNERS, TRIANGLES[:, ::-1], process=False)
    assert source.volume < 0
    path = tmp_path / f'inside_out.{extension}'
    source.export(path)
    assert volume(make_surface(str(path), 1.0, 0)) > 0.0


def test_an_open_surface_is_kept_as_it_is(tmp_path):
    path = tmp_path / 'open.off'
    trimesh.Trimesh(CORNERS, TRIANGLES[:3], process=False).export(path)
    surface = make_surface(str(path), 1.0, 0)
    assert not surface.closed
    assert surface.faces.shape == (3, 3)


def test_the_parts_of_a_scene_become_one_mesh_where_the_scene_has_them(tmp_path):
    scene = trimesh.Scene()
    for i, offset in enumerate((-3.0, 3.0)):
        placed = trimesh.transformations.translation_matrix((offset, 0.0, 0.0))
        scene.add_geometry(trimesh.creation.box((2.0, 2.0, 2.0)), f'part{i}', transform=placed)
    path = tmp_path / 'scene.glb'
    scene.export(path)
    surface = make_surface(str(path), 4.0, 0)
    assert surface.vertices.shape == (16, 3)
    assert half_extents(surface) == pytest.approx([4.0, 1.0, 1.0])
    assert volume(surface) == pytest.approx(16.0)


def test_polygons_are_split_into_triangles(tmp_path):
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    corners = [(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]
    path = tmp_path / 'quads.obj'
    path.write_text(obj_text(corners, quads))
    surface = make_surface(str(path), 1.0, 0)
    assert surface.faces.shape == (12, 3)
    assert surface.closed
    assert volume(surface) == pytest.approx(8.0)


def test_vertices_that_no_triangle_uses_do_not_count(tmp_path):
    path = tmp_path / 'stray.obj'
    path.write_text(obj_text(np.vstack([CORNERS, [(900.0, 0.0, 0.0)]]), TRIANGLES))
    surface = make_surface(str(path), 1.0, 0)
    assert surface.vertices.shape == (4, 3)
    assert half_extents(surface).max() == pytest.approx(1.0)


def test_triangles_without_area_are_dropped(tmp_path):
    path = tmp_path / 'sliver.obj'
    path.write_text(obj_text(CORNERS, [*TRIANGLES, (0, 0, 1)]))
    assert make_surface(str(path), 1.0, 0).faces.shape == (4, 3)


# ------------------------------------------------------------------------------------- refusals
def test_a_missing_file_is_refused(tmp_path):
    assert 'does not exist' in refusal(tmp_path / 'nothing.stl')


def test_a_folder_is_refused(tmp_path):
    (tmp_path / 'folder.stl').mkdir()
    refusal(tmp_path / 'folder.stl')


@pytest.mark.parametrize('name', ['ball.fbx', 'ball', 'icospher'])
def test_an_unknown_kind_of_mesh_is_refused_with_those_that_are_known(tmp_path, name):
    message = refusal(name)
    assert all(kind in message for kind in (*PRIMITIVES, *FILE_TYPES))


@pytest.mark.parametrize('extension', FILE_TYPES)
def test_an_empty_file_is_refused(tmp_path, extension):
    path = tmp_path / f'empty.{extension}'
    path.write_bytes(b'')
    refusal(path)


@pytest.mark.parametrize('extension', FILE_TYPES)
def test_a_file_of_garbage_is_refused(tmp_path, extension):
    path = tmp_path / f'garbage.{extension}'
    for seed in range(5):
        path.write_bytes(np.random.default_rng(seed).bytes(2000))
        refusal(path)


@pytest.mark.parametrize('share', [0.05, 0.4, 0.8, 0.98])
@pytest.mark.parametrize('extension', ['stl', 'ply', 'glb'])
def test_a_truncated_file_is_refused(tmp_path, extension, share):
    path = tmp_path / f'truncated.{extension}'
    trimesh.creation.icosphere(subdivisions=2).export(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refusal(path)


@pytest.mark.parametrize('number', [np.nan, np.inf, 3e38])
def test_vertices_that_are_not_finite_are_refused(tmp_path, number):
    corners = CORNERS.copy()
    corners[2, 1] = number
    corners[3, 1] = -number
    path = tmp_path / 'bad.stl'
    path.write_bytes(stl_bytes(corners, TRIANGLES))
    if np.isfinite(number):
        assert np.isfinite(make_surface(str(path), 1.0, 0).vertices).all()
    else:
        assert 'not finite' in refusal(path)


def test_vertices_so_far_apart_that_their_distance_overflows_are_refused(tmp_path):
    path = tmp_path / 'far.obj'
    path.write_text(obj_text((CORNERS - 1.0) * 1.7e308, TRIANGLES))
    assert 'export it again' in refusal(path)


def test_a_cloud_of_points_in_a_file_is_refused(tmp_path):
    for extension in ('ply', 'obj', 'glb'):
        path = tmp_path / f'points.{extension}'
        if extension == 'obj':
            path.write_text(obj_text(CORNERS, []))
        else:
            trimesh.PointCloud(CORNERS).export(path)
        assert 'triangles' in refusal(path)


def test_a_mesh_without_extent_is_refused(tmp_path):
    path = tmp_path / 'point.stl'
    path.write_bytes(stl_bytes(np.full((4, 3), 0.25), TRIANGLES))
    assert 'measures 0 across' in refusal(path)


def test_triangles_without_area_alone_are_refused(tmp_path):
    path = tmp_path / 'line.obj'
    path.write_text(obj_text(CORNERS, [(0, 0, 1), (2, 2, 1)]))
    assert 'without area' in refusal(path)


@pytest.mark.parametrize('extension', ['obj', 'ply', 'off'])
def test_a_file_whose_triangles_refer_to_missing_vertices_is_refused(tmp_path, extension):
    path = tmp_path / f'missing.{extension}'
    corners = '\n'.join(' '.join(map(str, corner)) for corner in CORNERS)
    if extension == 'obj':
        path.write_text(obj_text(CORNERS, [(0, 1, 2), (0, 1, 9)]))
    elif extension == 'off':
        path.write_text(f'OFF\n4 2 0\n{corners}\n3 0 1 2\n3 0 1 9\n')
    else:
        head = (
            'ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n'
            'property float z\nelement face 2\n'
            'property list uchar int vertex_indices\nend_header\n'
        )
        path.write_text(f'{head}{corners}\n3 0 1 2\n3 0 1 9\n')
    refusal(path)


def test_a_mesh_of_too_many_vertices_is_refused(tmp_path, monkeypatch):
    path = tmp_path / 'large.stl'
    trimesh.creation.icosphere(subdivisions=2).export(path)
    monkeypatch.setattr(surface, 'LARGEST_MESH', 100)
    message = refusal(path)
    assert 'more than 100' in message
    assert 'simplify' in message


def test_a_file_too_large_to_read_is_refused(tmp_path, monkeypatch):
    path = tmp_path / 'large.stl'
    trimesh.creation.icosphere(subdivisions=2).export(path)
    monkeypatch.setattr(mesh_files, 'LARGEST_FILE', 1000)
    assert 'simplify' in refusal(path)


def test_the_world_names_the_body_whose_mesh_is_refused():
    config = WorldConfig(bodies=(BodyConfig(name='duck', mesh='duck.stl'),))
    with pytest.raises(MeshError, match=r'^duck\.mesh.*duck\.stl does not exist'):
        World(config)


# -------------------------------------------------------------------------------------- Surface
@pytest.mark.parametrize(
    ('vertices', 'faces', 'reason'),
    [
        (CORNERS, [(0, 1, 4)], r'outside 0 … 3'),
        (CORNERS, [(0, 1, -1)], r'outside 0 … 3'),
        (CORNERS, [(0, 1, 2, 3)], r'triangles, \(m, 3\)'),
        (CORNERS, [0, 1, 2], r'triangles, \(m, 3\)'),
        (CORNERS[:, :2], TRIANGLES, r'\(n, 3\)'),
        (np.empty((0, 3)), TRIANGLES, 'n > 0'),
        (np.full((4, 3), np.nan), TRIANGLES, 'not finite'),
    ],
)
def test_a_surface_that_cannot_be_is_refused(vertices, faces, reason):
    with pytest.raises(MeshError, match=reason):
        Surface(np.array(vertices), np.array(faces))


def test_faces_that_are_not_integers_are_refused():
    with pytest.raises(MeshError):
        Surface(CORNERS, TRIANGLES + 0.5)


def test_a_surface_does_not_change_with_the_arrays_it_was_made_from():
    vertices = CORNERS.copy()
    surface = Surface(vertices, TRIANGLES)
    vertices[:] = 0.0
    assert np.array_equal(surface.vertices, CORNERS)
    with pytest.raises(ValueError, match='read-only'):
        surface.vertices[0, 0] = 1.0


def test_closed_needs_every_edge_twice_in_opposite_directions():
    assert Surface(CORNERS, TRIANGLES).closed
    assert not Surface(CORNERS, TRIANGLES[:3]).closed
    flipped = TRIANGLES.copy()
    flipped[0] = flipped[0, ::-1]
    assert not Surface(CORNERS, flipped).closed
    assert not Surface(CORNERS, np.empty((0, 3), dtype=int)).closed


def test_the_pose_of_a_file_does_not_change_its_size_or_volume(tmp_path):
    part = trimesh.load(cad_mesh('power_connector'))
    part.apply_transform(np.block([[random_rotation(2), np.ones((3, 1))], [0, 0, 0, 1]]))
    path = tmp_path / 'turned.ply'
    part.export(path)
    surface = make_surface(str(path), 0.5, 0)
    assert volume(surface) == pytest.approx(part.volume / part.extents.max() ** 3, rel=1e-5)
