# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the viewer makes of messages and descriptors, without a browser."""

import io

from geometry_msgs.msg import Point
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle
import trimesh

from softbody_ros.core import make_surface
from softbody_ros.ros import messages
from softbody_ros.scene import parameters
from softbody_ros.scene.resources import ResourceError
from softbody_ros.scene.scene_file import scene_of
from softbody_ros.viewer import decoding, glb, mesh_drop, scene_requests, server, widgets

pytestmark = pytest.mark.oldest

BALL = make_surface('icosphere', 0.5, 3)


def cloud(*bodies, frame_id='world'):
    records = messages.points_array(bodies)
    return deserialize_message(messages.serialized_cloud(1, frame_id, records), PointCloud2)


def surface(vertices=BALL.vertices, faces=BALL.faces):
    return decoding.Surface(np.asarray(vertices, np.float32), np.asarray(faces, np.uint32))


# ----------------------------------------------------------------------------------------- frames
def test_a_frame_is_what_was_packed():
    random = np.random.default_rng(0)
    bodies = [(random.normal(size=(n, 3)), *random.uniform(size=(3, n))) for n in (5, 7)]
    frame = decoding.frame(cloud(*bodies, frame_id='map'))
    assert frame.frame_id == 'map'
    np.testing.assert_array_equal(
        frame.positions, np.concatenate([x for x, *_ in bodies]).astype(np.float32)
    )
    np.testing.assert_array_equal(
        frame.displacement, np.concatenate([d for _, d, *_ in bodies]).astype(np.float32)
    )
    np.testing.assert_array_equal(
        frame.pressure, np.concatenate([p for _, _, p, _ in bodies]).astype(np.float32)
    )
    np.testing.assert_array_equal(
        frame.permanent_strain, np.concatenate([s for *_, s in bodies]).astype(np.float32)
    )
    assert frame.body.tolist() == [0] * 5 + [1] * 7


def test_a_frame_has_any_layout():
    """A bag may hold clouds that somebody has packed in another way."""
    kinds = {'body': PointField.UINT32}
    order = ('body', 'intensity', 'displacement', 'z', 'y', 'x')
    message = PointCloud2(height=2, width=3, point_step=32, row_step=96)
    message.fields = [
        PointField(name=name, offset=4 + 4 * index, count=1, datatype=kinds.get(name, 7))
        for index, name in enumerate(order)
    ]
    data = np.zeros((6, 8), np.float32)
    data[:, 1:7] = np.arange(36).reshape(6, 6)
    data[:, 1] = np.arange(6, dtype=np.uint32).view(np.float32)
    message.data = data.tobytes()
    frame = decoding.frame(message)
    assert frame.body.tolist() == [0, 1, 2, 3, 4, 5]
    assert frame.positions[1].tolist() == [11.0, 10.0, 9.0]
    # one of release 0.1.0
    assert frame.pressure.tolist() == frame.permanent_strain.tolist() == [0.0] * 6


def test_numbers_of_bodies_have_gaps_where_some_were_removed():
    one = np.zeros((1, 3)), *np.zeros((3, 1))
    records = messages.points_array([one, one], [3, 4_000_000_000])
    message = deserialize_message(messages.serialized_cloud(1, 'world', records), PointCloud2)
    assert decoding.frame(message).body.tolist() == [3, 4_000_000_000]
    report = {'tick': '7', 'a number in ~/points': '3', 'b number in ~/points': '12', 'a': 'b'}
    assert decoding.numbers_of_bodies(report) == {3: 'a', 12: 'b'}
    assert decoding.numbers_of_bodies({'a number in ~/points': '-1'}) == {}


def test_clouds_of_others_are_refused():
    bodies = (np.zeros((2, 3)), *np.zeros((3, 2)))
    message = cloud(bodies)
    message.fields = message.fields[:3]
    with pytest.raises(decoding.FrameError, match='it lacks displacement, body'):
        decoding.frame(message)
    message = cloud(bodies)
    message.width = 3
    with pytest.raises(decoding.FrameError, match='cut off: 56 bytes for 3 points'):
        decoding.frame(message)
    for step in (0, 20, 2**31):
        message.point_step = step
        with pytest.raises(
            decoding.FrameError, match=f'no room for its fields: point_step {step}'
        ):
            decoding.frame(message)
    message.is_bigendian = True
    with pytest.raises(decoding.FrameError, match='big-endian'):
        decoding.frame(message)


@pytest.mark.parametrize('triangles', [0, 1, 2, len(BALL.faces)])
def test_a_surface_is_what_was_packed(triangles):
    data = messages.serialized_mesh(BALL.vertices, BALL.faces[:triangles])
    read = decoding.surface(data)
    np.testing.assert_array_equal(read.vertices, BALL.vertices)
    np.testing.assert_array_equal(read.faces, BALL.faces[:triangles])
    # as rclpy packs it
    again = decoding.surface(serialize_message(deserialize_message(data, Mesh)))
    np.testing.assert_array_equal(again.vertices, read.vertices)
    np.testing.assert_array_equal(again.faces, read.faces)


def test_broken_surfaces_are_refused():
    broken = Mesh(vertices=[Point()], triangles=[MeshTriangle(vertex_indices=[0, 1, 0])])
    with pytest.raises(decoding.FrameError, match='1 vertices, but not number 1'):
        decoding.surface(serialize_message(broken))
    data = serialize_message(broken)
    for length in range(len(data)):
        with pytest.raises(decoding.FrameError):
            decoding.surface(data[:length])
    assert decoding.surface(serialize_message(Mesh())).vertices.shape == (0, 3)
    for nowhere in (np.nan, -np.inf, 1e308):
        with pytest.raises(decoding.FrameError, match='not finite'):
            decoding.surface(serialize_message(Mesh(vertices=[Point(x=nowhere)])))


def test_another_scene_is_elsewhere_the_same_one_finer_is_not():
    ball, finer = surface(), surface(make_surface('icosphere', 0.5, 4).vertices)
    assert finer.is_where(ball)
    assert not surface(BALL.vertices + [0.0, 0.0, 1.0]).is_where(ball)
    assert not surface(3.0 * BALL.vertices).is_where(ball)
    assert not ball.is_where(None)


def test_colours_beyond_the_range_are_cut():
    assert decoding.to_bytes([np.nan, -1.0, 0.5, np.inf]) == (0, 0, 128, 255)


def test_parts_are_the_colours_however_many_bodies():
    vertices = np.concatenate([BALL.vertices + [3.0 * index, 0, 0] for index in range(5)])
    n = len(BALL.vertices)
    faces = np.concatenate([BALL.faces + n * index for index in range(5)])
    red, blue = (255, 0, 0, 255), (0, 0, 255, 128)
    parts = decoding.parts(
        surface(vertices, faces),
        np.repeat([0, 7, 2, 3, 4_000_000_000], n),  # numbers of those that are there
        {0: red, 7: blue, 2: red, 3: red, 4_000_000_000: blue},
    )
    assert [part.color for part in parts] == [red, blue]
    # the same corners as before, each face once
    corners = [vertices[part.particles][part.faces] for part in parts]
    assert [len(part.faces) for part in parts] == [3 * len(BALL.faces), 2 * len(BALL.faces)]
    np.testing.assert_array_equal(corners[1], vertices[faces[np.repeat([1, 4], len(BALL.faces))
        * len(BALL.faces) + np.tile(np.arange(len(BALL.faces)), 2)]])  # fmt: skip


def test_normals_of_a_ball_point_outwards():
    ball = surface()
    assert len(ball.shading.origin) == len(ball.vertices)
    np.testing.assert_allclose(ball.shading.normals(ball.vertices), 2 * ball.vertices, atol=0.02)


@pytest.mark.parametrize('subdivisions', [0, 3])
def test_edges_of_a_cube_stay_sharp_however_it_is_dented(subdivisions):
    made = make_surface('box', 0.5, subdivisions)
    cube = surface(made.vertices, made.faces)
    (part,) = decoding.parts(cube, np.zeros(len(cube.vertices), np.uint32), {0: (9, 9, 9, 255)})
    # each of its sides has its own vertices, as the page is smooth across shared ones
    corners = cube.vertices[part.particles][part.faces]
    np.testing.assert_array_equal(corners, cube.vertices[cube.faces])
    per_side = (2**subdivisions + 1) ** 2
    assert len(part.particles) == 6 * per_side
    np.testing.assert_allclose(np.abs(cube.shading.normals(cube.vertices)).max(axis=1), 1.0)
    # by their angles at rest, not of now
    flat = cube.vertices * [1.0, 1.0, 1e-3]
    assert len(cube.shading.normals(flat)) == 6 * per_side


def test_the_coloured_file_is_replaced_in_place():
    ball = surface()
    file = glb.ColoredFile(ball.vertices, ball.faces)
    random = np.random.default_rng(0)
    for _ in range(2):
        moved = random.normal(size=ball.vertices.shape).astype(np.float32)
        colors = random.integers(0, 256, (len(moved), 4), np.uint8)
        data = file.filled(moved, ball.shading.normals(moved), colors)
        (read,) = trimesh.load(io.BytesIO(data), file_type='glb', process=False).geometry.values()
        np.testing.assert_array_equal(read.vertices, moved)
        np.testing.assert_array_equal(read.faces, ball.faces)
        np.testing.assert_array_equal(read.visual.vertex_colors, colors)
        np.testing.assert_allclose(read.vertex_normals, ball.shading.normals(moved), atol=1e-6)


def test_heat_runs_from_the_first_colour_to_the_last():
    colors = decoding.heat(np.array([-1.0, 0.0, 0.5, 1.0, 9.0]), 1.0).astype(float)
    srgb = 255.0 * (1.055 * (colors[:, :3] / 255.0) ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(srgb[[0, 1]], decoding.COLORS[[0, 0]], atol=2)
    np.testing.assert_allclose(srgb[2], decoding.COLORS[4], atol=3)
    np.testing.assert_allclose(srgb[[3, 4]], decoding.COLORS[[-1, -1]], atol=2)


@pytest.mark.parametrize(
    ('value', 'rounded'), [(0.0010001, 0.002), (0.3, 0.5), (1.0, 1.0), (9.81, 10.0), (2e6, 2e6)]
)
def test_round_up(value, rounded):
    assert decoding.round_up(value) == rounded


def test_a_ray_meets_the_near_side_first():
    ball = surface()
    hit = decoding.first_hit(
        np.array([0.1, -5.0, 0.2]), np.array([0.0, 2.0, 0.0]), ball.vertices, ball.faces
    )
    np.testing.assert_allclose(hit, [0.1, -np.sqrt(0.25 - 0.05), 0.2], atol=5e-3)
    away = np.array([0.0, -1.0, 0.0])
    assert decoding.first_hit(np.array([0.1, -5.0, 0.2]), away, ball.vertices, ball.faces) is None
    past = np.array([1.0, 0.0, 0.0])
    assert decoding.first_hit(np.array([-5.0, 0.6, 0.0]), past, ball.vertices, ball.faces) is None


# ----------------------------------------------------------------------------------------- fields
def described():
    """Return the fields of the default scene and their values."""
    result = {}
    for name, facts in parameters.table(parameters.SceneLists()).items():
        descriptor = messages.descriptor(facts)
        value = parameters.as_parameter(facts.default, facts)
        descriptor.name, descriptor.type = name, fields_type(value)
        if not facts.read_only:
            result[name] = widgets.field(descriptor, value), value
    return result


def fields_type(value):
    from rclpy.parameter import Parameter

    return Parameter('p', value=value).type_.value


def test_every_parameter_has_a_widget_that_gives_its_value_back():
    kinds = {}
    for field, value in described().values():
        back = widgets.from_widget(field, widgets.to_widget(field, value))
        assert back == pytest.approx(value, abs=2e-3) if field.kind == 'color' else back == value
        assert type(back) is type(value)
        kinds.setdefault(field.kind, field.name)
    assert set(kinds) == {'slider', 'number', 'switch', 'choice', 'vector', 'color', 'text'}


def test_a_field_says_what_the_descriptor_says():
    field, _ = described()['ball.mass']
    assert (field.kind, field.unit, field.minimum, field.maximum) == ('slider', 'kg', 1e-6, 1e6)
    assert field.hint == f'{parameters.BODY_TABLE["mass"].description} (1e-06 … 1e+06 kg)'
    assert described()['ball.mode'][0].choices == ('rigid', 'linear', 'quadratic')


@pytest.mark.parametrize('value', [1e-6, 0.003, 0.5, 1.0, 9.81, 123.0, 1e6])
def test_a_slider_shows_its_value_and_stays_within_the_range(value):
    for field, _ in described().values():
        if field.kind == 'slider' and field.minimum <= value <= field.maximum:
            low, high, step = widgets.slider_range(field, value)
            assert field.minimum <= low <= value <= high <= field.maximum, field
            assert step <= (high - low) / 100.0


def test_narrow_ranges_are_shown_whole():
    assert widgets.slider_range(described()['ball.stiffness'][0], 0.1)[:2] == (0.0, 1.0)


@pytest.mark.parametrize(
    ('name', 'good', 'bad'),
    [
        ('ball.stiffness', 0.5, np.nan),
        ('ball.mode', 'rigid', 'stiff'),
        ('gravity.direction', [0.0, 0.0, 1.0], [0.0, np.inf, 0.0]),
        ('gravity.direction', [0.0, 0.0, 1.0], [0.0, 1.0]),
        ('ball.color', [0.0, 0.0, 1.0, 1.0], [0.0, 1.0, 0.0]),
    ],
)
def test_what_a_widget_cannot_show_is_told(name, good, bad):
    field, _ = described()[name]
    assert widgets.can_show(field, good)
    assert not widgets.can_show(field, bad)


def test_lists_are_typed_with_commas():
    field, _ = described()['ball.pins.indices']
    assert widgets.from_widget(field, ' [1, 2  3,4]') == [1, 2, 3, 4]
    assert widgets.from_widget(field, '') == []
    with pytest.raises(widgets.FieldError, match="'1, b' is no list of whole numbers"):
        widgets.from_widget(field, '1, b')


def test_sections_are_grouped_as_in_the_original_and_hold_every_parameter_once():
    names = list(described())
    (gravity, rest), bodies, obstacles = widgets.sections(names, ['ball'], ['ground'])
    assert gravity.names == ('gravity.magnitude', 'gravity.direction')
    main, velocity, more = bodies['ball']
    assert [name.removeprefix('ball.') for name in main.names] == [
        'mass', 'stiffness', 'bounciness', 'friction', 'deformation', 'elasticity', 'mode',
    ]  # fmt: skip
    assert velocity.names == ('ball.initial_velocity.linear', 'ball.initial_velocity.angular')
    for section, first in [(main, 'mass [kg]'), (velocity, 'linear [m∕s]')]:
        assert widgets.label(described()[section.names[0]][0], section) == first
    assert widgets.label(described()['poke.radius'][0], rest) == 'poke radius [m]'
    everything = [gravity, rest, main, velocity, more, *obstacles['ground']]
    assert sorted(sum((section.names for section in everything), ())) == sorted(names)


# ----------------------------------------------------------------------------------------- scenes
def test_a_scene_file_says_the_values_as_rcl_reads_them():
    values = {name: value for name, (_, value) in described().items()}
    # texts that rcl, or YAML, would take for something else
    values |= {'a.b': '1e-3', 'a.c': ['on', '', '~', '0x1'], 'a.d': "it's: # a\ntext"}
    values |= {'a.e.f': 1e-5, 'a.e.g': -1e22, 'a.e.h': [0.1 + 0.2, 5e-324], 'a.i': True, 'a.j': 7}
    read = scene_of(scene_requests.scene_yaml(values, ['a comment']), 'a text')
    assert read == values
    assert {name: type(value) for name, value in read.items()} == {
        name: type(value) for name, value in values.items()
    }


def test_what_becomes_something_else_is_removed_first():
    present = {name: value for name, (_, value) in described().items()}
    given = {'bodies': ['ball'], 'obstacles': ['ground'], 'ball.stiffness': 0.25}
    request = scene_requests.scene_request(given, present)
    assert not request.from_nothing
    assert request.values['ball.stiffness'] == 0.25
    swapped = {'bodies': ['ground'], 'obstacles': ['ball'], 'ball.type': 'sphere'}
    assert scene_requests.scene_request(swapped, present).from_nothing
    finer = scene_requests.scene_request({'ball.subdivisions': 4}, {'ball.subdivisions': 3})
    assert finer.from_nothing
    assert finer.values['ball.subdivisions'] == 4


def test_a_new_body_fits_those_that_are_there():
    small, large = BALL.vertices, 3.0 * BALL.vertices + [10.0, 0.0, 2.0]
    body = np.repeat([0, 4], len(BALL.vertices))
    size, above = scene_requests.fitted(np.concatenate([small, large]), body)
    assert size == 1.0  # of 0.5 m and 1.5 m
    np.testing.assert_allclose(above, [5.5, 0.0, 3.5], atol=0.02)
    assert scene_requests.fitted(np.zeros((0, 3)), np.zeros(0))[0] == scene_requests.USUAL_SIZE


# ----------------------------------------------------------------------------------------- server
@pytest.mark.parametrize(
    ('origin', 'host', 'is_own', 'is_own_elsewhere'),
    [
        ('http://127.0.0.1:8080', '127.0.0.1:8080', True, True),
        ('http://localhost:9000', 'localhost:9000', True, True),
        ('http://[::1]:8080', '[::1]:8080', True, True),
        ('http://127.0.0.1:3000', '127.0.0.1:8080', False, False),
        ('http://evil.example', '127.0.0.1:8080', False, False),
        ('null', '127.0.0.1:8080', False, False),
        # a name that somebody has had resolved to this machine; for others it may be its name
        ('http://robot.example:8080', 'robot.example:8080', False, True),
        (None, '127.0.0.1:8080', True, True),
    ],
)
def test_only_the_page_of_the_server_is_its_own(origin, host, is_own, is_own_elsewhere):
    headers = {'Host': host} | ({} if origin is None else {'Origin': origin})
    assert server.is_own_page(headers, is_local=True) == is_own
    assert server.is_own_page(headers, is_local=False) == is_own_elsewhere


def test_a_file_that_is_refused_takes_no_room(monkeypatch):
    monkeypatch.setattr(mesh_drop, 'MOST_BYTES', 10)
    dropped = mesh_drop.DroppedMeshes()
    try:
        with pytest.raises(ResourceError, match='the files that were dropped have more than'):
            dropped.keep('large.stl', bytes(11))
        assert dropped.keep('small.stl', bytes(10)).read_bytes() == bytes(10)
    finally:
        dropped.close()
