# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `bake`: its films are those of the core, in every format, or are not there."""

import importlib.util
import json
import os
import pathlib
import resource
import signal
import struct
import subprocess
import sys
import time

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade
import pygltflib
import pytest
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.bake import __main__ as command
from softbody_ros.bake.writing import linear
from softbody_ros.core import MeshError, MeshFrame, World, make_surface
from softbody_ros.core.geometry.shading import shading
from softbody_ros.ensemble.film import Film
from softbody_ros.scene import parameters
from softbody_ros.scene.scene_file import read_scene
from softbody_ros.whole_file import whole_file

pytestmark = [pytest.mark.oldest, pytest.mark.usefixtures('compiled_ahead')]
ROOT = pathlib.Path(__file__).parent.parent
CONFIG = ROOT / 'config'
SHEET = 'v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n'
SCENE = """
softbody_sim:
  ros__parameters:
    bodies: [ball, sheet, brick]
    obstacles: [ground, paddle, pole, post, stone, ring]
    points_rate: 1
    ball: {subdivisions: 2, size: 3e-1, color: [0.2, 0.5, 1.0, 0.5], position: [0, 0, 1]}
    sheet: {mesh: SHEET, position: [2.0, 0.0, 1.0], orientation: [0.1, 0.0, 0.0, 1.0]}
    brick: {mesh: box, mode: rigid, size: 0.2, position: [-1.0, 0.0, 0.5]}
    ground: {orientation: [0.05, 0.0, 0.0, 1.0]}
    paddle:
      type: box
      size: [0.5, 0.1, 0.2]
      position: [0.8, 0.0, 0.2]
      velocity: {linear: [-1.0, 0.0, 0.0], angular: [0.0, 0.0, 9.0]}
    pole: {type: cylinder, size: [0.1, 1.0, 0.4], position: [3.0, 0.0, 0.4]}
    post: {type: capsule, size: [0.1, 1.0, 0.4], position: [3.0, 1.0, 0.4]}
    stone: {type: sphere, size: [0.3, 1.0, 1.0], position: [3.0, 2.0, 0.3]}
    ring: {type: mesh, mesh: torus, subdivisions: 0, position: [0.0, 3.0, 0.5]}
"""
FPS, FRAMES = 24, 25
SOME = (0, 13, 24)
WITHOUT_ROS = """
import runpy, sys

class NoRos:
    def find_spec(self, name, *_):
        first = name.split('.')[0]
        if first.startswith(('rclpy', 'ament', 'rpy')) or first.endswith(
            ('_msgs', '_srvs', 'interfaces')
        ):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, NoRos())
runpy.run_module('softbody_ros.bake', run_name='__main__', alter_sys=True)
"""


@pytest.fixture(scope='module')
def scene_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp('scene')
    (folder / 'sheet.obj').write_text(SHEET)
    path = folder / 'scene.yaml'
    path.write_text(SCENE.replace('SHEET', str(folder / 'sheet.obj')))
    return path


@pytest.fixture(scope='module')
def scene(scene_file):
    return parameters.make_scene(parameters.known_values(read_scene(str(scene_file)))[0])


@pytest.fixture(scope='module')
def core(scene):
    """Positions of the bodies and obstacles at each frame: 24 divides 240."""
    world, frames = World(scene.world), []
    for _ in range(FRAMES):
        positions = {name: world.positions(name) for name in world.names}
        frames.append((positions, {item.config.name: item for item in world.obstacles}))
        world.step(10)
    return frames


@pytest.fixture(scope='module')
def baked(scene_file):
    """Bake all formats in a process that finds no ROS; return the folder."""
    outputs = [str(scene_file.parent / f'film{suffix}') for suffix in command.FORMATS]
    run = subprocess.run(
        [sys.executable, '-c', WITHOUT_ROS, str(scene_file), '--seconds', '1', '--fps', str(FPS)]
        + [part for output in outputs for part in ('-o', output)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    said = f'bake: sheet.mesh {scene_file.parent / "sheet.obj"} is not closed (4 edges with one'
    assert run.returncode == 0
    assert run.stderr.startswith(said) and run.stderr.count('\n') == 1
    *lines, last = run.stdout.splitlines()
    starts = [f'{output}: {FRAMES} frames, 1 s at 24 fps, ' for output in outputs]
    assert all(line.startswith(start) for line, start in zip(lines, starts, strict=True))
    assert '× real time' in last
    return scene_file.parent


@pytest.fixture
def run_main(monkeypatch, tmp_path):
    """Run the command in this process and an empty folder; leave the signals as they were."""
    monkeypatch.chdir(tmp_path)
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    yield lambda *arguments: command.main([str(each) for each in arguments])
    for number, handler in before:
        signal.signal(number, handler)


def expected_normals(surface, positions):
    """Return the normals (m, 3, 3) of corners, face by face: a brick has sides, else all meet."""
    a, b, c = positions[surface.faces.T]
    areas = np.cross(b - a, c - a)
    a, b, c = surface.vertices[surface.faces.T]
    rest = np.cross(b - a, c - a)
    rest /= np.linalg.norm(rest, axis=1, keepdims=True)
    beside = rest @ rest.T > 0.5
    result = np.empty((len(areas), 3, 3))
    for corner in range(3):
        meet = (surface.faces[:, corner, None, None] == surface.faces[None]).any(axis=2)
        sums = (meet & beside) @ areas
        result[:, corner] = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    return result


# ---------------------------------------------------------------------------------------- formats
def test_npz_is_the_core_to_the_last_bit(baked, scene, core):
    film = np.load(baked / 'film.npz', allow_pickle=False)
    assert film['fps'] == FPS and film['time_step'] == 1 / 240
    assert np.array_equal(film['ticks'], np.arange(0, 241, 10))
    assert np.array_equal(film['times'], np.arange(25) / 24)
    assert film['bodies'].tolist() == ['ball', 'sheet', 'brick']
    assert film['obstacles'].tolist() == ['ground', 'paddle', 'pole', 'post', 'stone', 'ring']
    world = World(scene.world)
    for name in world.names:
        expected = np.array([positions[name] for positions, _ in core])
        assert film[f'{name}.positions'].dtype == np.float64
        assert np.array_equal(film[f'{name}.positions'], expected)
        assert np.ptp(expected, axis=0).max() > 0.2, 'it moves'
        assert np.array_equal(film[f'{name}.faces'], world.rest_shape(name).surface.faces)
    assert film['ball.color'].tolist() == [0.2, 0.5, 1.0, 0.5]
    assert (film['paddle.type'], film['paddle.size'].tolist()) == ('box', [0.5, 0.1, 0.2])
    for index, (_, obstacles) in enumerate(core):
        for name, obstacle in obstacles.items():
            assert np.array_equal(film[f'{name}.position'][index], obstacle.position)
            assert np.array_equal(film[f'{name}.rotation'][index], obstacle.rotation)


@pytest.mark.parametrize('suffix', ['usdc', 'usda', 'usd'])
def test_usd_has_the_bodies_of_the_core(baked, scene, core, suffix):
    stage = Usd.Stage.Open(str(baked / f'film.{suffix}'))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == FPS
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, FRAMES - 1)
    assert stage.GetDefaultPrim().GetPath() == '/scene'
    world = World(scene.world)
    bodies = stage.GetPrimAtPath('/scene/bodies').GetChildren()
    assert [prim.GetName() for prim in bodies] == list(world.names)
    for mesh in map(UsdGeom.Mesh, bodies):
        name = mesh.GetPrim().GetName()
        surface = world.rest_shape(name).surface
        faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        assert np.array_equal(faces, surface.faces)
        assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
        assert mesh.GetSubdivisionSchemeAttr().Get() == 'none'
        assert mesh.GetOrientationAttr().Get() == 'rightHanded'
        assert mesh.GetDoubleSidedAttr().Get() == (name == 'sheet')
        assert mesh.GetPointsAttr().GetTimeSamples() == list(range(FRAMES))
        for index, (positions, _) in enumerate(core):
            points = np.array(mesh.GetPointsAttr().Get(index))
            assert np.array_equal(points, positions[name].astype(np.float32))
            extent = np.array(mesh.GetExtentAttr().Get(index))
            assert np.array_equal(extent, [points.min(axis=0), points.max(axis=0)])


@pytest.mark.parametrize('name', ['ball', 'sheet', 'brick'])
def test_usd_normals_are_those_of_smooth_and_creased_surfaces(baked, scene, core, name):
    stage = Usd.Stage.Open(str(baked / 'film.usdc'))
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(f'/scene/bodies/{name}'))
    normals = primvar.GetPrimvar('normals')
    surface = World(scene.world).rest_shape(name).surface
    # what is smooth has one for each vertex, which every reader takes
    assert normals.GetInterpolation() == ('faceVarying' if name == 'brick' else 'vertex')
    assert normals.GetTimeSamples() == list(range(FRAMES))
    for index in SOME:
        shown = np.array(normals.ComputeFlattened(index))
        shown = shown.reshape(-1, 3, 3) if name == 'brick' else shown[surface.faces]
        assert np.abs(shown - expected_normals(surface, core[index][0][name])).max() < 1e-6


def test_edges_are_creases_by_their_angle_at_rest():
    # a roof of two triangles, whose ridge turns by the angle
    def roof(angle):
        angle = np.radians(angle)
        wing = [0.5, -np.cos(angle), -np.sin(angle)]
        return np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0], wing])

    faces = np.array([[0, 1, 2], [1, 0, 3]])
    flat, sharp = shading(roof(45.0), faces), shading(roof(60.0), faces)
    assert flat.origin.tolist() == [0, 1, 2, 3]
    assert sharp.origin.tolist() == [0, 0, 1, 1, 2, 3]
    assert flat.normals(roof(90.0))[0] == pytest.approx([0.0, -(0.5**0.5), 0.5**0.5])
    at_ridge = sharp.normals(roof(90.0))[:2].tolist()
    assert sorted(at_ridge) == pytest.approx(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]))
    # without an area there is no direction, but a reader wants one
    assert np.array_equal(flat.normals(np.zeros((4, 3))), [[0.0, 0.0, 1.0]] * 4)


def test_usd_colors_are_linear_and_shown_with_and_without_materials(baked):
    stage = Usd.Stage.Open(str(baked / 'film.usdc'))
    ball = UsdGeom.Mesh(stage.GetPrimAtPath('/scene/bodies/ball'))
    # of 0.2, 0.5, 1.0 in sRGB
    expected = pytest.approx([0.0331, 0.2140, 1.0], abs=1e-4)
    assert list(ball.GetDisplayColorAttr().Get()[0]) == expected
    assert list(ball.GetDisplayOpacityAttr().Get()) == [0.5]
    material, _ = UsdShade.MaterialBindingAPI(ball).ComputeBoundMaterial()
    shader, *_ = material.ComputeSurfaceSource()
    assert shader.GetShaderId() == 'UsdPreviewSurface'
    assert list(shader.GetInput('diffuseColor').Get()) == expected
    assert shader.GetInput('opacity').Get() == 0.5


def test_usd_obstacles_are_where_those_of_the_core_are(baked, scene, core):
    stage = Usd.Stage.Open(str(baked / 'film.usdc'))
    for config in scene.world.obstacles:
        prim = stage.GetPrimAtPath(f'/scene/obstacles/{config.name}')
        placed = UsdGeom.Mesh(prim)
        for index, (_, obstacles) in enumerate(core):
            obstacle, matrix = obstacles[config.name], np.eye(4)
            matrix[:3, :3] = obstacle.rotation.T  # USD has row vectors
            matrix[3, :3] = obstacle.position
            local = np.array(placed.ComputeLocalToWorldTransform(index))
            assert np.abs(local - matrix).max() < 1e-12
        low, high = np.array(placed.GetExtentAttr().Get())
        points = np.array(placed.GetPointsAttr().Get())
        assert np.array_equal([low, high], [points.min(axis=0), points.max(axis=0)])
        half = {'paddle': (0.5, 0.1, 0.2), 'pole': (0.1, 0.1, 0.4), 'post': (0.1, 0.1, 0.4)}
        half |= {'stone': (0.3, 0.3, 0.3), 'ring': (1, 1, 1 / 3), 'ground': (7, 7, 0)}
        assert high == pytest.approx(half[config.name], abs=1e-3)
        assert low == pytest.approx(-high, abs=1e-6)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        assert material.GetPath() == '/scene/materials/_obstacles'


def test_usd_passes_its_own_validation(baked, tmp_path):
    validation = pytest.importorskip('pxr.UsdValidation')
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    context = validation.ValidationContext(validators)
    stage = Usd.Stage.Open(str(baked / 'film.usdc'))
    assert [error.GetMessage() for error in context.Validate(stage)] == []
    assert context.Validate(Usd.Stage.CreateInMemory()), 'it can fail'


def test_binary_usd_that_grows_is_the_same(monkeypatch, scene_file, run_main):
    from softbody_ros.bake import usd

    assert run_main(scene_file, '--seconds', '0.2', '-o', 'at_once.usdc') == 0
    monkeypatch.setattr(usd, 'SAVED_AT_ONCE', 5000)
    assert run_main(scene_file, '--seconds', '0.2', '-o', 'in_parts.usdc') == 0
    layers = [Sdf.Layer.FindOrOpen(name) for name in ('at_once.usdc', 'in_parts.usdc')]
    assert layers[0].ExportToString() == layers[1].ExportToString()


# -------------------------------------------------------------------------------------------- glb
class Glb:
    """A .glb read by hand, by the specification."""

    def __init__(self, path):
        data = path.read_bytes()
        magic, version, length, json_length = struct.unpack_from('<4sIII', data)
        assert (magic, version, length) == (b'glTF', 2, len(data))
        self.json = json.loads(data[20 : 20 + json_length])
        self.blob = data[28 + json_length :]

    def array(self, index):
        accessor = self.json['accessors'][index]
        view = self.json['bufferViews'][accessor['bufferView']]
        dtype = {5126: '<f4', 5125: '<u4'}[accessor['componentType']]
        width = {'SCALAR': 1, 'VEC3': 3, 'VEC4': 4}[accessor['type']]
        start = view.get('byteOffset', 0) + accessor.get('byteOffset', 0)
        flat = np.frombuffer(self.blob, dtype, accessor['count'] * width, start)
        return flat.reshape(-1, width) if width > 1 else flat

    def node(self, name):
        return next(i for i, each in enumerate(self.json['nodes']) if each['name'] == name)

    def channels(self, node):
        """Return what is animated of a node: {path: (times, values)}."""
        [animation] = self.json['animations']
        result = {}
        for channel in animation['channels']:
            sampler = animation['samplers'][channel['sampler']]
            assert sampler['interpolation'] == 'LINEAR'
            if channel['target']['node'] == node:
                values = self.array(sampler['output'])
                result[channel['target']['path']] = (self.array(sampler['input']), values)
        return result


def test_glb_morphs_from_frame_to_frame(baked, scene, core):
    glb = Glb(baked / 'film.glb')
    world = World(scene.world)
    for name in world.names:
        node = glb.node(name)
        mesh = glb.json['meshes'][glb.json['nodes'][node]['mesh']]
        [primitive] = mesh['primitives']
        faces = glb.array(primitive['indices']).reshape(-1, 3)
        times, weights = glb.channels(node)['weights']
        assert np.array_equal(times, (np.arange(FRAMES) / FPS).astype(np.float32))

        def corners(attribute, weights=weights, primitive=primitive, faces=faces):
            first = glb.array(primitive['attributes'][attribute])
            targets = np.array([glb.array(target[attribute]) for target in primitive['targets']])
            return (first + np.tensordot(weights.reshape(FRAMES, -1), targets, axes=1))[:, faces]

        surface = world.rest_shape(name).surface
        expected = np.array([positions[name][surface.faces] for positions, _ in core])
        shown = corners('POSITION')
        assert np.array_equal(shown[0], expected[0].astype(np.float32))
        assert np.abs(shown - expected).max() < 1e-6
        normals = corners('NORMAL')
        for index in SOME:
            expected = expected_normals(surface, core[index][0][name])
            assert np.abs(normals[index] - expected).max() < 1e-5
        material = glb.json['materials'][primitive['material']]
        assert material['doubleSided'] == (name == 'sheet')
        color = material['pbrMetallicRoughness']['baseColorFactor']
        assert color == pytest.approx(linear(scene.appearances[name].color))
    assert glb.json['materials'][0]['alphaMode'] == 'BLEND'


def test_glb_obstacles_move(baked, core):
    glb = Glb(baked / 'film.glb')
    for name in core[0][1]:
        moving = glb.channels(glb.node(name))
        assert set(moving) == ({'translation', 'rotation'} if name == 'paddle' else set())
    moving = glb.channels(glb.node('paddle'))
    for index, (_, obstacles) in enumerate(core):
        paddle = obstacles['paddle']
        assert np.abs(moving['translation'][1][index] - paddle.position).max() < 1e-6
        matrix = Rotation.from_quat(moving['rotation'][1][index]).as_matrix()
        assert np.abs(matrix - paddle.rotation).max() < 1e-6


def test_glb_opens_in_other_readers_y_up(baked, core):
    shown = trimesh.load(baked / 'film.glb')
    expected = {'ball', 'sheet', 'brick', *core[0][1]}
    assert set(shown.geometry) == expected
    x, y, z = core[0][0]['ball'].T
    matrix, geometry = shown.graph['ball']
    vertices = trimesh.transform_points(shown.geometry[geometry].vertices, matrix)
    assert np.abs(np.array(vertices) - np.array([x, z, -y]).T).max() < 1e-6
    capsule = shown.geometry['post'].bounds
    assert shown.geometry['ground'].extents.tolist() == [14.0, 14.0, 0.0]
    assert capsule == pytest.approx(np.array([[-0.1, -0.1, -0.4], [0.1, 0.1, 0.4]]), abs=1e-3)
    assert pygltflib.GLTF2().load(str(baked / 'film.glb')).asset.version == '2.0'


def test_a_film_that_is_loaded_as_a_mesh_stands_upright_without_its_obstacles(baked, core):
    path = baked / 'film.glb'
    surface = make_surface(str(path), 0.5, 0, MeshFrame(1.0, 'file'))
    bodies = np.concatenate(list(core[0][0].values()))
    assert surface.vertices.min(axis=0) == pytest.approx(bodies.min(axis=0), abs=1e-6)
    assert surface.vertices.max(axis=0) == pytest.approx(bodies.max(axis=0), abs=1e-6)
    first, *_ = surface.notes
    assert first == (
        f'mesh {path} is a film of this simulator: its obstacles (ground, paddle, pole, post, '
        'stone and 1 more) are left out'
    )


def test_a_film_of_a_ball_is_a_ball_again(run_main):
    assert run_main(CONFIG / 'default.yaml', '--seconds', '0.5', '-o', 'ball.glb') == 0
    ball = make_surface('icosphere', 0.5, 3)
    again = make_surface('ball.glb', 0.5, 0)
    assert again.closed
    assert again.faces.shape == ball.faces.shape
    assert np.ptp(again.vertices, axis=0) == pytest.approx(np.ptp(ball.vertices, axis=0), rel=1e-3)


def test_a_film_without_bodies_is_refused_as_a_mesh(run_main):
    options = ('-p', 'bodies:=[]', '--seconds', '0', '-o', 'empty.glb')
    assert run_main(CONFIG / 'default.yaml', *options) == 0
    with pytest.raises(MeshError, match='is a film of this simulator without any body in it'):
        make_surface('empty.glb', 0.5, 0)


def test_a_film_of_one_frame(scene_file, run_main):
    outputs = ['-o', 'one.usdc', '-o', 'one.glb', '-o', 'one.npz']
    assert run_main(scene_file, '--seconds', '0', *outputs) == 0
    assert np.load('one.npz')['ticks'].tolist() == [0]
    assert 'animations' not in json.loads(pygltflib.GLTF2().load('one.glb').to_json())
    assert Usd.Stage.Open('one.usdc').GetEndTimeCode() == 0


# ----------------------------------------------------------------------------------------- frames
@pytest.mark.parametrize(
    ('seconds', 'fps', 'ticks'),
    [
        (1.0, 240.0, list(range(241))),
        (0.1, 50.0, [0, 5, 10, 14, 19, 24]),
        (0.1, 29.97, [0, 8, 16, 24]),
        (0.5, 1.0, [0]),
    ],
)
def test_frames_show_the_nearest_ticks(seconds, fps, ticks):
    assert Film(parameters.make_scene({}), seconds, fps).ticks.tolist() == ticks


# --------------------------------------------------------------------------------------- refusals
@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['no.yaml'], 'bake: scene no.yaml cannot be read: No such file or directory'),
        ([CONFIG / 'default.yaml', '-o', 'a.abc'], 'a.abc has an unknown suffix: end it with one'),
        ([CONFIG / 'default.yaml', '-o', 'no/a.npz'], 'no/a.npz does not exist: create no'),
        ([CONFIG / 'default.yaml', '-o', 'folder.npz'], 'folder.npz is a folder'),
        ([CONFIG / 'default.yaml', '-o', 'a.npz', '-o', './a.npz'], 'a.npz is given twice'),
        (['.'], 'scene . cannot be read: Is a directory'),
        ([''], "scene '' cannot be read: No such file or directory"),
        ([CONFIG / 'default.yaml', '--seconds', '-1'], 'seconds is -1: it must be from 0 to'),
        ([CONFIG / 'default.yaml', '--seconds', 'nan'], 'seconds is nan: it must be from 0 to'),
        ([CONFIG / 'default.yaml', '--fps', '0'], 'fps is 0: it must be above 0 and at most 240'),
        ([CONFIG / 'default.yaml', '--fps', '241'], 'at most 240, the ticks of the scene'),
        ([CONFIG / 'default.yaml', '-p', 'ball.mass'], '-p ball.mass is not NAME:=VALUE'),
        ([CONFIG / 'default.yaml', '-p', 'ball.mass:=0'], 'ball.mass is 0.0: it must be from'),
        ([CONFIG / 'default.yaml', '-p', 'ball.mas:=1'], 'did you mean ball.mass?'),
        ([CONFIG / 'default.yaml', '-p', 'ball.mesh:=a.stl'], 'a.stl does not exist'),
        (
            [CONFIG / 'default.yaml', '--seconds', '86400', '-o', 'a.glb'],
            'more than the format can hold',
        ),
    ],
)
def test_refusals_are_one_sentence_and_leave_nothing(
    run_main, capsys, tmp_path, arguments, sentence
):
    (tmp_path / 'folder.npz').mkdir()
    assert run_main(*arguments) == 1
    said = capsys.readouterr()
    # what a refused film would be like is said before
    [*_, last] = said.err.splitlines()
    assert last.startswith('bake: ') and sentence in last
    assert said.out == ''
    assert os.listdir(tmp_path) == ['folder.npz']


@pytest.mark.parametrize(('suffix', 'package'), [('.usdc', 'usd-core'), ('.glb', 'pygltflib')])
def test_without_an_optional_package_it_says_how_to_get_it(
    run_main, capsys, monkeypatch, suffix, package
):
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: name == 'numpy' or None)
    assert run_main(CONFIG / 'default.yaml', '-o', f'film{suffix}') == 1
    said = capsys.readouterr().err
    assert f'{package}, which is not installed: pip install {package} (or' in said
    assert run_main(CONFIG / 'default.yaml', '--seconds', '0.1') == 0
    assert os.listdir() == ['default.npz']


def test_unknown_parameters_are_ignored_with_a_warning(run_main, capsys):
    assert run_main(CONFIG / 'default.yaml', '--seconds', '0', '-p', 'time_stepp:=1.0') == 0
    warning = 'bake: parameter time_stepp is unknown and ignored: did you mean time_step?\n'
    assert capsys.readouterr().err == warning
    assert os.listdir() == ['default.usdc']


def test_a_file_for_another_node_is_the_default_scene_with_a_warning(run_main, capsys, tmp_path):
    (tmp_path / 'other.yaml').write_text('other: {ros__parameters: {bodies: [a, b]}}')
    assert run_main('other.yaml', '--seconds', '0', '-p', 'ball.mass:=2', '-o', 'a.npz') == 0
    warning = 'bake: scene other.yaml has no parameters for /softbody_sim: the default scene is'
    assert capsys.readouterr().err == f'{warning} baked\n'
    assert np.load('a.npz')['bodies'].tolist() == ['ball']


def test_a_scene_may_come_through_a_pipe_which_is_read_once(run_main, capsys):
    reading, writing = os.pipe()
    os.write(writing, b'/**: {ros__parameters: {bodies: [a, b]}}')
    os.close(writing)
    try:
        assert run_main(f'/dev/fd/{reading}', '--seconds', '0', '-o', 'a.npz') == 0
    finally:
        os.close(reading)
    assert capsys.readouterr().err == ''
    assert np.load('a.npz')['bodies'].tolist() == ['a', 'b']


@pytest.mark.parametrize('obstacles', ['[]', '[ground]'])
def test_a_scene_without_bodies_is_a_film(run_main, tmp_path, obstacles):
    scene = tmp_path / 'empty.yaml'
    scene.write_text(f'/**: {{ros__parameters: {{bodies: [], obstacles: {obstacles}}}}}')
    outputs = [str(tmp_path / f'empty.{suffix}') for suffix in ('npz', 'usdc', 'glb')]
    arguments = [part for output in outputs for part in ('-o', output)]
    assert run_main(str(scene), '--seconds', '0.1', *arguments) == 0
    film = np.load(outputs[0])
    assert film['bodies'].tolist() == [] and len(film['times']) == 7
    assert trimesh.load(outputs[2], force='scene').geometry.keys() <= {'ground'}


def test_a_tilde_that_the_shell_left_is_home(run_main, monkeypatch, tmp_path):
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    (tmp_path / 'home').mkdir()
    assert run_main(CONFIG / 'default.yaml', '--seconds', '0', '--output=~/a.npz') == 0
    assert os.listdir(tmp_path / 'home') == ['a.npz']


# ------------------------------------------------------------------------------------- whole files
def test_a_file_is_replaced_when_the_new_one_is_whole(tmp_path):
    path = tmp_path / 'film.npz'
    path.write_text('older')
    with pytest.raises(IsADirectoryError), whole_file(path) as unfinished:
        unfinished.mkdir() or unfinished.write_text('half')
    assert path.read_text() == 'older'
    with whole_file(path) as unfinished:
        unfinished.write_text('whole')
        assert path.read_text() == 'older'
    assert path.read_text() == 'whole'
    assert os.listdir(tmp_path) == ['film.npz']


@pytest.mark.parametrize(
    'number', [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_signal_leaves_no_half_file(tmp_path, number):
    older = tmp_path / 'film.usdc'
    older.write_text('older')
    process = subprocess.Popen(
        [sys.executable, '-m', 'softbody_ros.bake', str(CONFIG / 'default.yaml')]
        + ['--seconds', '3000', '--output', str(older), '--output', str(tmp_path / 'new.usda')],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 30.0
    try:
        while not list(tmp_path.glob('.unfinished-*/new.usda')) and time.monotonic() < deadline:
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        process.send_signal(number)
        out, err = process.communicate(timeout=30.0)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (128 + number, '', '')
    assert os.listdir(tmp_path) == ['film.usdc']
    assert older.read_text() == 'older'


@pytest.mark.parametrize(
    ('suffix', 'free'), [*((suffix, 20_000) for suffix in command.FORMATS), ('.usdc', 0)]
)
def test_a_full_disk_is_one_sentence_and_no_half_file(run_main, capsys, suffix, free):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (free, limits[1]))
    try:
        code = run_main(CONFIG / 'default.yaml', '--seconds', '1', '-o', f'film{suffix}')
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert code == 1
    said = capsys.readouterr().err
    assert said.startswith('bake: the film cannot be written: ') and 'File too large\n' in said
    assert len(said) < 120
    assert os.listdir() == []


def test_a_tick_that_cannot_be_computed_leaves_no_half_file(run_main, capsys, monkeypatch):
    from softbody_ros.core import SimulationError

    step = World.step

    def failing(world, ticks=1):
        if world.tick > 100:
            raise SimulationError('tick 101 cannot be computed')
        step(world, ticks)

    monkeypatch.setattr(World, 'step', failing)
    assert run_main(CONFIG / 'default.yaml', '-o', 'a.npz', '-o', 'a.usdc') == 1
    assert capsys.readouterr().err == 'bake: tick 101 cannot be computed\n'
    assert os.listdir() == []
