# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fine surfaces that coarse, simulated ones carry: visual_mesh and simplify_to."""

import dataclasses
import importlib.util
import subprocess
import sys

from core_helpers import cad_mesh, cloud, sheet
from geometry_msgs.msg import Point
import numpy as np
from pxr import Usd, UsdGeom
import pygltflib
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import ColorRGBA
from std_srvs.srv import SetBool
import trimesh
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.bake.gltf import GltfWriter
from softbody_ros.bake.npz import NpzWriter
from softbody_ros.bake.usd import UsdWriter
from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    Embedding,
    MeshError,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.geometry.simplification import COUNT_TOLERANCE, simplified
from softbody_ros.ensemble.film import Film
from softbody_ros.ros import messages
from softbody_ros.scene import parameters
from softbody_ros.viewer import decoding

pytestmark = pytest.mark.oldest

COARSE, FINE = make_surface('icosphere', 0.5, 3), make_surface('icosphere', 0.5, 5)
PAIRS = {
    'ball': (COARSE, FINE),
    'larger': (COARSE, Surface(1.3 * FINE.vertices, FINE.faces)),
    'torus on a ball': (make_surface('icosphere', 0.5, 1), make_surface('torus', 0.5, 2)),
    'box': (make_surface('box', 0.5, 0), make_surface('box', 0.55, 4)),
    'CAD': (make_surface('capsule', 0.5, 1), make_surface(cad_mesh('power_connector'), 0.5, 0)),
    'ball on a sheet': (sheet(), make_surface('icosphere', 0.3, 2)),
}


def moved(vertices, matrix, offset=(3.0, -2.0, 1.0)):
    return vertices @ np.asarray(matrix).T + offset


def world_of(**settings):
    return World(WorldConfig(bodies=(BodyConfig(name='ball', **settings),)))


@pytest.fixture
def scan(tmp_path):
    """Return the path of a closed mesh with bumps, 2562 vertices, as a scanner would write it."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    waves = np.prod(np.sin(9.0 * ball.vertices), axis=1)
    path = tmp_path / 'scan.stl'
    bumpy = trimesh.Trimesh(ball.vertices * (1.0 + 0.05 * waves)[:, None], ball.faces)
    bumpy.export(path)
    return str(path)


# ---------------------------------------------------------------------------------------- geometry
@pytest.mark.parametrize('pair', PAIRS)
def test_a_rigid_motion_is_carried_exactly(pair):
    simulated, visual = PAIRS[pair]
    embedding = Embedding(simulated, visual)
    np.testing.assert_allclose(
        embedding.positions(simulated.vertices), visual.vertices, rtol=0.0, atol=1e-14
    )
    for seed in range(3):
        rotation = Rotation.random(random_state=seed).as_matrix()
        carried = embedding.positions(moved(simulated.vertices, rotation))
        assert abs(carried - moved(visual.vertices, rotation)).max() < 1e-13


@pytest.mark.parametrize('pair', [name for name in PAIRS if 'sheet' not in name])
@pytest.mark.parametrize('handedness', [1.0, -1.0])
def test_an_affine_deformation_is_carried_exactly(pair, handedness):
    simulated, visual = PAIRS[pair]
    matrix = np.array([[1.5, 0.4, -0.2], [0.0, 0.6, 0.3], [0.1, 0.0, 1.1]])
    matrix = handedness * Rotation.random(random_state=1).as_matrix() @ matrix
    carried = Embedding(simulated, visual).positions(moved(simulated.vertices, matrix))
    assert abs(carried - moved(visual.vertices, matrix)).max() < 1e-12


def test_a_sheet_keeps_the_thickness_of_what_it_carries_where_it_is_bent():
    plane, ball = PAIRS['ball on a sheet']

    def bent(points, radius=0.5):
        angle = points[:, 0] / radius
        distance = radius + points[:, 2]
        return np.stack([distance * np.sin(angle), points[:, 1], distance * np.cos(angle)], axis=1)

    # of 5 x 5 particles, bent by 115°
    carried = Embedding(plane, ball).positions(bent(plane.vertices))
    assert abs(carried - bent(ball.vertices)).max() < 0.06
    spread = np.linalg.norm(carried[:, [0, 2]], axis=1) - 0.5
    np.testing.assert_allclose(spread, ball.vertices[:, 2], atol=0.04)


def test_quadratic_deformations_are_carried_to_third_order():
    """The error falls by nearly 8 where edges are half as long: without the factor ½ by 4."""

    def twisted(points):
        x, y, z = points.T
        return np.stack([x + 0.4 * z * z, y * (1.0 + 0.4 * x), z - 0.5 * x * x], axis=1)

    means = []
    for level in (1, 2, 3, 4):
        simulated = make_surface('icosphere', 0.5, level)
        carried = Embedding(simulated, FINE).positions(twisted(simulated.vertices))
        error = np.linalg.norm(carried - twisted(FINE.vertices), axis=1)
        means.append(error.mean())
    ratios = np.array(means[:-1]) / means[1:]
    assert ratios.min() > 6.0
    assert error.max() < 1e-4 * 0.5


@pytest.mark.parametrize('pair', ['ball', 'larger'])
def test_neighbours_stay_neighbours_whatever_the_simulated_vertices_do(pair):
    """Along a line across many triangles steps are small: nothing jumps at an edge."""
    simulated, _ = PAIRS[pair]
    random = np.random.default_rng(7)
    deformed = simulated.vertices + random.normal(size=simulated.vertices.shape, scale=0.02)
    radius = 0.5 if pair == 'ball' else 0.65
    largest = []
    for count in (20_001, 40_001):
        angle = np.linspace(0.0, 2.0, count)
        line = radius * np.stack([np.cos(angle), np.sin(angle), 0.3 * angle], axis=1)
        line *= radius / np.linalg.norm(line, axis=1, keepdims=True)
        places = Embedding(
            simulated, Surface(line, np.array([(0, 1, 2)]))
        ).positions(deformed)  # fmt: skip
        largest.append(np.linalg.norm(np.diff(places, axis=0), axis=1).max())
    assert largest[1] < 0.55 * largest[0]


def test_coincident_vertices_stay_coincident():
    """Seams are two vertices at one place."""
    twice = Surface(np.tile(FINE.vertices, (2, 1)), FINE.faces)
    random = np.random.default_rng(3)
    deformed = COARSE.vertices + random.normal(size=COARSE.vertices.shape, scale=0.1)
    one, other = np.split(Embedding(COARSE, twice).positions(deformed), 2)
    np.testing.assert_array_equal(one, other)


def test_vertices_that_are_simulated_are_where_these_are():
    random = np.random.default_rng(3)
    deformed = COARSE.vertices + random.normal(size=COARSE.vertices.shape, scale=0.05)
    np.testing.assert_allclose(
        Embedding(COARSE, COARSE).positions(deformed), deformed, rtol=0.0, atol=1e-14
    )


def test_values_are_interpolated():
    embedding = Embedding(COARSE, FINE)
    np.testing.assert_allclose(embedding.weights.sum(axis=1), 1.0, rtol=1e-15)
    assert embedding.weights.min() >= 0.0
    height = embedding.values(COARSE.vertices[:, 2])
    np.testing.assert_allclose(height, FINE.vertices[:, 2], atol=0.01)


@pytest.mark.parametrize('flat', [0.0, 1e-9])
def test_crushed_states_stay_finite(flat):
    """All in a plane, on a line, in one point: no NaN may come from normals without a length."""
    embedding = Embedding(COARSE, FINE)
    for axes in ((1.0, 1.0, flat), (1.0, flat, flat), (flat, flat, flat)):
        carried = embedding.positions(COARSE.vertices * axes)
        assert np.isfinite(carried).all()
        assert abs(carried).max() < 1.0


def test_slivers_and_open_surfaces_carry_too():
    thin = Surface(
        np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 1e-9, 0.0), (1.0, 1.0, 0.0)]),
        np.array([(0, 1, 2), (0, 2, 3)]),
    )
    visual = Surface(thin.vertices + (0.1, 0.2, 0.3), thin.faces)
    turn = Rotation.random(random_state=2).as_matrix()
    carried = Embedding(thin, visual).positions(moved(thin.vertices, turn))
    np.testing.assert_allclose(carried, moved(visual.vertices, turn), atol=1e-12)


# --------------------------------------------------------------------------------------- the drop
def test_in_the_default_drop_the_carried_ball_is_that_of_fine_particles_within_2_percent():
    fine = world_of(subdivisions=5)
    coarse = world_of(subdivisions=3, visual_mesh=FINE)
    assert len(coarse.positions('ball')) == 642
    worst = squashed = 0.0
    for _ in range(240):  # to the ground, and up again
        fine.step(), coarse.step()
        squashed = max(squashed, float(fine.rigid_fit('ball').displacement.max()))
        away = coarse.visual_positions('ball') - fine.positions('ball')
        worst = max(worst, float(np.linalg.norm(away, axis=1).max()))
    assert squashed > 0.1
    assert worst < 0.02 * 0.5


def test_the_simulation_does_not_notice_what_it_carries(scan):
    plain, carrying = world_of(subdivisions=2), world_of(subdivisions=2, visual_mesh=scan)
    for world in (plain, carrying):
        world.step(150)
    np.testing.assert_array_equal(plain.positions('ball'), carrying.positions('ball'))
    assert plain.visual_surface('ball') is plain.rest_shape('ball').surface
    np.testing.assert_array_equal(plain.visual_positions('ball'), plain.positions('ball'))
    given = 2.0 * plain.positions('ball')
    assert plain.visual_positions('ball', given) is given
    assert carrying.visual_positions('ball').shape == (2562, 3)


def test_dents_regions_snapshots_and_removal(scan):
    """What is shown is a function of the positions: it comes back with them."""
    world = world_of(
        mesh=scan, simplify_to=200, regions_count=8, plasticity_creep=20.0, plasticity_yield=0.01
    )
    world.step(60)
    before, shown = world.snapshot(), world.visual_positions('ball')
    world.step(120)
    assert abs(world.visual_positions('ball') - shown).max() > 0.1
    world.remove('ball')
    world.restore(before)
    np.testing.assert_array_equal(world.visual_positions('ball'), shown)
    world.reset()
    np.testing.assert_allclose(
        world.visual_positions('ball'), world.visual_start_positions('ball'), atol=1e-14
    )


def test_bodies_of_the_same_files_share_what_is_computed_once(scan):
    settings = {'mesh': scan, 'simplify_to': 200}
    bodies = [BodyConfig(name=name, **settings) for name in 'ab']
    bodies.append(BodyConfig(name='c', **settings, visual_mesh='torus'))
    world = World(WorldConfig(bodies=tuple(bodies)))
    assert world.embedding('a') is world.embedding('b') is not world.embedding('c')
    assert world.visual_surface('c').vertices.shape == make_surface('torus', 0.5, 3).vertices.shape
    known = world.embedding('a')
    config = dataclasses.replace(world.config, bodies=(*bodies, BodyConfig(name='d', **settings)))
    world.adopt(world.prepare(config))
    assert world.embedding('d') is known
    other = BodyConfig(name='e', **settings | {'simplify_to': 100})
    world.adopt(world.prepare(dataclasses.replace(config, bodies=(*config.bodies, other))))
    assert len(world.positions('e')) == 100 and len(world.positions('d')) == 200


# ---------------------------------------------------------------------------------- simplification
@pytest.mark.parametrize('count', [60, 300, 1000])
@pytest.mark.parametrize('kind', ['icosphere', 'torus', 'capsule', 'cylinder', 'box'])
def test_simplified_surfaces_are_closed_and_have_about_as_many_vertices(kind, count):
    fine = make_surface(kind, 0.5, 4)
    coarse = simplified(fine, count)
    assert abs(len(coarse.vertices) - count) <= COUNT_TOLERANCE * count
    assert coarse.closed and fine.closed
    assert len(np.unique(coarse.faces)) == len(coarse.vertices)
    again = simplified(Surface(fine.vertices.copy(), fine.faces.copy()), count)
    np.testing.assert_array_equal(again.vertices, coarse.vertices)
    np.testing.assert_array_equal(again.faces, coarse.faces)


def test_an_open_surface_stays_open_and_enough_vertices_change_nothing():
    open_ball = Surface(FINE.vertices, FINE.faces[FINE.vertices[FINE.faces, 2].min(axis=1) > -0.3])
    coarse = simplified(open_ball, 500)
    assert not coarse.closed and abs(len(coarse.vertices) - 500) <= 50
    assert simplified(FINE, len(FINE.vertices)) is FINE
    world = world_of(mesh='icosphere', subdivisions=2, simplify_to=5000)
    assert world.embedding('ball') is None
    assert len(world.positions('ball')) == 162


def test_simplification_gives_the_same_bits_in_every_process():
    program = (
        'import hashlib; from softbody_ros.core import make_surface\n'
        'from softbody_ros.core.geometry.simplification import simplified\n'
        f'surface = simplified(make_surface({cad_mesh("qdd100_stator")!r}, 0.5, 0), 400)\n'
        'print(hashlib.sha256(surface.vertices.tobytes() + surface.faces.tobytes()).hexdigest())'
    )
    runs = [
        subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert runs[0].stdout == runs[1].stdout != ''


def test_a_simplified_file_is_shown_as_it_is(scan):
    world = world_of(mesh=scan, simplify_to=300)
    assert len(world.positions('ball')) == 300
    assert len(world.visual_surface('ball').faces) == 5120
    file = make_surface(scan, 0.5, 3)
    np.testing.assert_array_equal(world.visual_surface('ball').vertices, file.vertices)
    other = world_of(mesh=scan, simplify_to=300, visual_mesh='box', subdivisions=1)
    assert len(other.positions('ball')) == 300
    assert len(other.visual_surface('ball').vertices) == 26


# --------------------------------------------------------------------------------------- refusals
@pytest.mark.parametrize(
    ('settings', 'error', 'sentence'),
    [
        ({'visual_mesh': '/no/such.stl'}, MeshError, 'ball.visual_mesh file /no/such.stl does'),
        ({'visual_mesh': 'cube'}, MeshError, "ball.visual_mesh 'cube' is neither a primitive"),
        ({'visual_mesh': 3}, ConfigError, 'ball.visual_mesh is 3: it must be a text'),
        (
            {'mesh': cloud(np.eye(3)), 'visual_mesh': 'box'}, MeshError,
            'ball.visual_mesh cannot be carried: the simulated one is a cloud',
        ),
        (
            {'visual_mesh': cloud(np.eye(3))}, MeshError,
            'ball.visual_mesh is a cloud of points: give triangles',
        ),
        ({'simplify_to': 7}, ConfigError, 'ball.simplify_to is 7: it must be at least 8'),
        ({'simplify_to': -1}, ConfigError, 'ball.simplify_to is -1: it must be from 0 to'),
        ({'simplify_to': 1.5}, ConfigError, 'ball.simplify_to is 1.5: it must be a whole number'),
        (
            {'mesh': cloud(np.random.default_rng(0).normal(size=(99, 3))), 'simplify_to': 20},
            MeshError, 'ball.simplify_to is 20, but the mesh has no triangles',
        ),
        (
            {'mesh': cad_mesh('knee_bumper'), 'simplify_to': 100}, MeshError,
            'ball.simplify_to is 100, to which this mesh of 4950 vertices cannot be simplified',
        ),
    ],
)  # fmt: skip
def test_wrong_inputs_are_one_sentence(settings, error, sentence):
    with pytest.raises(error) as refusal:
        world_of(**settings)
    assert str(refusal.value).startswith(sentence)
    assert '\n' not in str(refusal.value)


def test_without_its_package_simplification_says_what_to_install(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec',
        lambda name, *more: None if name == 'fast_simplification' else find(name, *more),
    )  # fmt: skip
    with pytest.raises(MeshError) as refusal:
        world_of(simplify_to=100)
    assert str(refusal.value) == (
        'ball.simplify_to is 100, which needs fast-simplification, which is not installed: '
        'pip install fast-simplification'
    )
    assert world_of(subdivisions=1, simplify_to=42).embedding('ball') is None  # not needed


def test_both_are_read_only():
    world = world_of(subdivisions=2)
    for change in ({'visual_mesh': 'box'}, {'simplify_to': 100}):
        body = dataclasses.replace(world.config.bodies[0], **change)
        with pytest.raises(ConfigError, match=r'ball\.(visual_mesh|simplify_to) is .* cannot'):
            world.configure(dataclasses.replace(world.config, bodies=(body,)))


# ------------------------------------------------------------------------------- films, the viewer
def test_films_show_the_fine_surface_and_archives_have_the_particles(scan, tmp_path):
    values = {'ball.mesh': scan, 'ball.simplify_to': 200, 'ball.position': [0.0, 0.0, 0.6]}
    film = Film(parameters.make_scene(values), 0.5, 4.0)
    kinds = {'glb': GltfWriter, 'npz': NpzWriter, 'usdc': UsdWriter}
    writers = [kind(tmp_path / f'film.{suffix}', film) for suffix, kind in kinds.items()]
    frames = list(film.frames())
    for writer in writers:
        for frame in frames:
            writer.add(frame)
        writer.finish()

    gltf = pygltflib.GLTF2().load(str(tmp_path / 'film.glb'))
    mesh = next(mesh for mesh in gltf.meshes if mesh.name == 'ball')
    assert gltf.accessors[mesh.primitives[0].indices].count == 3 * 5120
    assert gltf.accessors[mesh.primitives[0].attributes.POSITION].count >= 2562
    stage = Usd.Stage.Open(str(tmp_path / 'film.usdc'))
    points = UsdGeom.Mesh.Get(stage, '/scene/bodies/ball').GetPointsAttr().Get(2)
    np.testing.assert_array_equal(points, film.world.visual_positions('ball').astype(np.float32))
    archive = np.load(tmp_path / 'film.npz')
    assert archive['ball.positions'].shape == (3, 200, 3)
    assert len(archive['ball.faces']) == 396
    np.testing.assert_array_equal(
        film.world.visual_positions('ball', archive['ball.positions'][1]),
        frames[1].pictures['ball'],
    )


def test_a_path_may_be_a_uri():
    uri = 'package://softbody_ros/config/duck.obj'
    scene = parameters.make_scene({'ball.visual_mesh': uri})
    assert scene.world.bodies[0].visual_mesh == parameters.mesh_path(uri)
    assert parameters.make_scene({}).world.bodies[0].visual_mesh == ''


def test_the_viewer_draws_the_surface_that_each_body_carries():
    bodies = (
        BodyConfig(name='a', subdivisions=1),
        BodyConfig(name='b', subdivisions=1, visual_mesh=PAIRS['larger'][1], position=(2, 0, 1)),
        BodyConfig(name='c', mesh='box', subdivisions=1, position=(4.0, 0.0, 1.0)),
    )
    world = World(WorldConfig(bodies=bodies))
    numbers = {'a': 0, 'b': 5, 'c': 2}
    simulated, count = [], 0
    for name in world.names:
        simulated.append(
            (world.start_positions(name), world.rest_shape(name).surface.faces + count)
        )
        count += len(simulated[-1][0])
    vertices, faces = (np.concatenate(each) for each in zip(*simulated, strict=True))
    rest = decoding.surface(messages.serialized_mesh(vertices, faces))
    shown = world.visual_surface('b')
    corners = world.visual_start_positions('b')[shown.faces.ravel()]
    data = messages.serialized_surfaces(
        1, 'world', [messages.ShownSurface('b', numbers['b'], (1.0, 0.0, 0.0, 1.0), corners)]
    )
    visuals = decoding.visuals(data)
    assert list(visuals) == [5] and len(visuals[5].vertices) == len(shown.vertices)

    world.step(120)
    positions = np.concatenate([world.positions(name) for name in world.names])
    body = np.concatenate([np.full(len(world.positions(n)), numbers[n]) for n in world.names])
    fields = positions[:, 0], positions[:, 2], positions[:, 1]
    frame = decoding.Frame('world', positions, *fields, body)
    picture = decoding.Picture(rest, body, visuals)
    drawn = picture.of(frame)
    assert picture.surface.fits(drawn)
    assert len(picture.surface.faces) == 80 + 48 + len(shown.faces)
    of_b = picture.surface.faces[picture.body[picture.surface.faces[:, 0]] == 5]
    wanted = world.visual_positions('b')[shown.faces]
    np.testing.assert_allclose(drawn.positions[of_b], wanted, atol=1e-6)
    for name in 'ac':
        mine = drawn.positions[picture.body == numbers[name]]
        np.testing.assert_array_equal(mine, world.positions(name))
        np.testing.assert_array_equal(
            drawn.displacement[picture.body == numbers[name]], mine[:, 0]
        )
    assert abs(drawn.displacement[picture.body == 5] - 2.0).max() < 0.6  # its x, interpolated

    plain = decoding.Picture(rest, body, {})
    assert plain.surface is rest and plain.of(frame) is frame


def test_markers_of_anybody_are_read_or_refused():
    points = [Point(), Point(x=1.0), Point(y=1.0)]
    full = Marker(
        ns='some/thing', id=7, points=points, colors=[ColorRGBA()] * 3, text='ß',
        mesh_resource='m', texture_resource='t',
    )  # fmt: skip
    full.texture.format, full.texture.data = 'png', b'12345'
    full.mesh_file.filename, full.mesh_file.data = 'f', b'123'
    gone = Marker(id=8, action=Marker.DELETE, points=points)
    data = serialize_message(MarkerArray(markers=[full, gone, Marker(id=9, points=points)]))
    visuals = decoding.visuals(data)
    assert sorted(visuals) == [7, 9]
    np.testing.assert_array_equal(
        np.sort(visuals[7].vertices, axis=0), np.sort([[0, 0, 0], [1, 0, 0], [0, 1, 0]], axis=0)
    )
    for length in range(len(data)):
        with pytest.raises(decoding.FrameError):
            decoding.visuals(data[:length])
    points[0].x = np.inf
    with pytest.raises(decoding.FrameError, match='not finite'):
        decoding.visuals(serialize_message(MarkerArray(markers=[Marker(points=points)])))
    assert decoding.visuals(serialize_message(MarkerArray())) == {}


# --------------------------------------------------------------------------------------- the node
def test_the_node_publishes_the_fine_surface_and_the_simulated_particles(graph, scan):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    sim = graph.sim_node(
        bodies=['ball', 'cube'], ball__mesh=scan, ball__simplify_to=200, cube__mesh='box',
        cube__subdivisions=0, cube__position=[3.0, 0.0, 1.0],
    )  # fmt: skip
    assert graph.call(SetBool, '/softbody_sim/pause', data=True).success
    markers = graph.collect(Marker, '/softbody_sim/mesh')
    clouds = graph.collect(PointCloud2, '/softbody_sim/points')
    meshes = graph.collect(Mesh, '/softbody_sim/rest_mesh', latched)
    visuals = graph.collect(MarkerArray, '/softbody_sim/visual_mesh', latched)

    def shown_bodies():
        return {marker.ns: marker for marker in markers}

    graph.spin_until(lambda: len(shown_bodies()) == 2 and clouds and meshes and visuals)
    ball, cube = shown_bodies()['ball'], shown_bodies()['cube']
    assert (len(ball.points), len(cube.points)) == (3 * 5120, 3 * 12)
    assert (clouds[-1].width, len(meshes[-1].vertices)) == (208, 208)
    corners = np.array([[p.x, p.y, p.z] for p in ball.points]).reshape(-1, 3, 3)
    faces = sim._world.visual_surface('ball').faces
    np.testing.assert_array_equal(corners, sim._world.visual_positions('ball')[faces])
    clear, shown = visuals[-1].markers
    assert (clear.action, shown.action) == (Marker.DELETEALL, Marker.ADD)
    assert (shown.ns, shown.id, len(shown.points)) == ('ball', 0, 3 * 5120)

    assert graph.set_parameter('/softbody_sim', 'bodies', ['cube']).successful
    assert graph.call(SetBool, '/softbody_sim/pause', data=False).success
    graph.spin_until(lambda: len(visuals[-1].markers) == 1)
    assert graph.set_parameter('/softbody_sim', 'fine.visual_mesh', scan).successful
    assert graph.set_parameter('/softbody_sim', 'bodies', ['cube', 'fine']).successful
    graph.spin_until(lambda: len(visuals[-1].markers) == 2)
    assert visuals[-1].markers[1].ns == 'fine'
    assert 'read-only' in graph.set_parameter('/softbody_sim', 'fine.visual_mesh', 'box').reason
