# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What others send: it becomes what the core wants, or one sentence that says why not."""

import itertools
import math
import re
import sys

from geometry_msgs.msg import PointStamped, Vector3Stamped, WrenchStamped
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from pages import everything
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray
import yaml

from softbody_ros.core import World, WorldConfig
from softbody_ros.core.collision.point_obstacles import MOST_POINTS, PointObstacles
from softbody_ros.core.external_inputs import ObstacleRemoval, ObstacleUpdate
from softbody_ros.ros import message_parsing, messages
from softbody_ros.ros.message_parsing import MOST_MARKERS, SHAPES, InputError

pytestmark = pytest.mark.oldest

H = 1 / 240
HUGE = sys.float_info.max
NOT_FINITE = [math.nan, math.inf, -math.inf]


def marker(kind=Marker.CUBE, position=(1.0, 2.0, 3.0), scale=(1.0, 1.0, 1.0), **values):
    result = Marker(ns='arm', id=3, type=kind)
    result.header.frame_id = 'world'
    result.header.stamp.sec, result.header.stamp.nanosec = 5, 250_000_000
    fill(result.pose.position, 'xyz', position)
    result.pose.orientation.w = 1.0
    fill(result.scale, 'xyz', scale)
    for name, value in values.items():
        if name == 'orientation':
            fill(result.pose.orientation, 'xyzw', value)
        elif name == 'frame_id':
            result.header.frame_id = value
        else:
            setattr(result, name, value)
    return result


def fill(target, names, values):
    for name, value in zip(names, values, strict=True):
        setattr(target, name, value)


def changes_of(*markers, **values):
    return message_parsing.obstacle_changes(
        MarkerArray(markers=list(markers)), 'world', H, **values
    )


# --------------------------------------------------------------------------------------- obstacles
@pytest.mark.parametrize(
    ('kind', 'scale', 'size'),
    [
        (Marker.CUBE, (1.0, 2.0, 3.0), (0.5, 1.0, 1.5)),
        (Marker.SPHERE, (0.4, 0.4, 0.4), (0.2, 0.2, 0.2)),
        (Marker.CYLINDER, (0.4, 0.4, 3.0), (0.2, 0.2, 1.5)),
    ],
)
def test_scales_are_full_lengths(kind, scale, size):
    (change,), problems = changes_of(marker(kind, scale=scale), pace=0.5)
    assert not problems
    assert isinstance(change, ObstacleUpdate)
    assert change.config.type == SHAPES[kind]
    assert change.config.size == pytest.approx(size)
    assert change.config.position == (1.0, 2.0, 3.0)
    assert (change.key, change.stamp, change.pace) == (('arm', 3), 5_250_000_000, 0.5)
    assert change.lifetime == 0


def test_orientations_are_made_unit_length():
    (change,), _ = changes_of(marker(orientation=(0.0, 0.0, 3.0, 4.0)))
    assert change.config.orientation == pytest.approx((0.0, 0.0, 0.6, 0.8))


@pytest.mark.parametrize(('seconds', 'ticks'), [(0, 0), (0.5, 120), (1e-9, 1), (-3, 0), (7, 1680)])
def test_lifetimes_are_ticks(seconds, ticks):
    one = marker()
    one.lifetime.sec = math.floor(seconds)
    one.lifetime.nanosec = round((seconds % 1) * 1e9)
    (change,), _ = changes_of(one)
    assert change.lifetime == ticks


def test_removals():
    delete = marker(action=Marker.DELETE, frame_id='', scale=(0.0, 0.0, 0.0))
    clear = Marker(action=Marker.DELETEALL)
    clear_arm = Marker(action=Marker.DELETEALL, ns='arm')
    changes, problems = changes_of(delete, clear, clear_arm)
    assert not problems
    assert changes == [ObstacleRemoval('arm', 3), ObstacleRemoval(), ObstacleRemoval('arm')]


BAD_MARKERS = [
    ({'frame_id': 'map'}, "frame_id is 'map': it must be 'world'; transform"),
    ({'frame_id': ''}, "frame_id is '': it must be 'world'; transform"),
    ({'kind': Marker.ARROW}, 'type is 0: obstacles are CUBE (1), SPHERE (2) or CYLINDER (3)'),
    ({'kind': Marker.MESH_RESOURCE}, 'type is 10'),
    ({'action': 1}, 'action is 1: use ADD (0), DELETE (2) or DELETEALL (3)'),
    ({'action': -7}, 'action is -7'),
    ({'position': (math.nan, 0.0, 0.0)}, 'position is [nan, 0, 0]: it must be within ±1e+06 m'),
    ({'position': (0.0, math.inf, 0.0)}, 'position is [0, inf, 0]'),
    ({'position': (0.0, 0.0, -HUGE)}, 'position is [0, 0, -1.79769e+308]'),
    ({'orientation': (0.0, 0.0, 0.0, 0.0)}, 'orientation is [0, 0, 0, 0]: give a quaternion'),
    ({'orientation': (math.nan, 0.0, 0.0, 1.0)}, 'orientation is [nan, 0, 0, 1]'),
    ({'orientation': (HUGE, HUGE, HUGE, HUGE)}, 'orientation is'),
    ({'scale': (1.0, 0.0, 1.0)}, 'scale is [1, 0, 1]: these are full lengths, each must be from'),
    ({'scale': (1.0, 1.0, -1.0)}, 'scale is [1, 1, -1]'),
    ({'scale': (math.nan, 1.0, 1.0)}, 'scale is [nan, 1, 1]'),
    ({'scale': (1.0, 1.0, 1e5)}, 'each must be from 0.0002 to 20000 m'),
    ({'kind': Marker.SPHERE, 'scale': (1.0, 1.0, 2.0)}, 'its x y z are diameters and must be'),
    ({'kind': Marker.CYLINDER, 'scale': (1.0, 2.0, 2.0)}, 'its x y are diameters and must be'),
]


@pytest.mark.parametrize(('values', 'sentence'), BAD_MARKERS)
def test_a_bad_marker_is_named_and_the_others_are_used(values, sentence):
    changes, (problem,) = changes_of(marker(), marker(**values), marker())
    assert len(changes) == 2
    assert problem.startswith("marker 'arm'/3 is ignored: ")
    assert sentence in problem
    assert '\n' not in problem


def test_a_huge_array_is_cut():
    one = Marker(action=Marker.DELETE)
    changes, (problem,) = changes_of(*[one] * (MOST_MARKERS + 1))
    assert len(changes) == MOST_MARKERS
    assert f'has {MOST_MARKERS + 1} markers: only the first {MOST_MARKERS} are used' in problem


# ------------------------------------------------------------------------------------------ points
def cloud_of(points, layout=None, rows=1, padding=0, big=False, **values):
    """Return a cloud of points (k, 3) in some layout: name, kind and offset of each field."""
    layout = layout or [('x', 'f4', 0), ('y', 'f4', 4), ('z', 'f4', 8)]
    order = '>' if big else '<'
    step = values.pop('step', max(offset + int(kind[1]) for _, kind, offset in layout))
    names, kinds, offsets = zip(*layout, strict=True)
    dtype = np.dtype({'names': names, 'formats': [order + kind for kind in kinds],
                      'offsets': offsets, 'itemsize': step})  # fmt: skip
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    width = len(points) // rows
    raw = np.full((rows, width * step + padding), 0x7F, np.uint8)
    records = np.ndarray((rows, width), dtype, raw.data, 0, (raw.shape[1], step))
    for axis, name in enumerate('xyz'):
        if name in names:
            records[name] = points[:, axis].reshape(rows, width)
    types = {'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64, 'i4': PointField.INT32}
    message = PointCloud2(
        height=rows, width=width, point_step=step, row_step=raw.shape[1], is_bigendian=big
    )
    message.header.frame_id = 'world'
    message.fields = [
        PointField(name=name, datatype=types[kind], offset=offset, count=1)
        for name, kind, offset in layout
    ]
    message.data.frombytes(raw.tobytes())
    for name, value in values.items():
        setattr(message, name, value)
    return message


def points_of(message, radius=0.02):
    return message_parsing.point_obstacles(message, 'world', radius)


POINTS = np.arange(36.0).reshape(12, 3) / 8.0
LAYOUTS = [
    None,
    [('x', 'f8', 0), ('y', 'f8', 8), ('z', 'f8', 16)],
    [('intensity', 'f4', 0), ('z', 'f8', 5), ('x', 'f4', 17), ('rgb', 'i4', 13), ('y', 'f4', 30)],
    [('x', 'f8', 1), ('y', 'f4', 9), ('z', 'f4', 13)],
]


@pytest.mark.parametrize('layout', LAYOUTS)
@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize(('rows', 'padding'), [(1, 0), (1, 5), (3, 0), (4, 7)])
def test_any_layout_is_read(layout, big, rows, padding):
    message = cloud_of(POINTS, layout, rows, padding, big)
    message = deserialize_message(serialize_message(message), PointCloud2)
    points, seen = points_of(message, 0.5)
    np.testing.assert_array_equal(points.points, POINTS)
    assert points.points.dtype == np.float64
    assert (points.radius, seen) == (0.5, 12)


def test_padding_of_points_and_a_last_row_without_its_own():
    message = cloud_of(POINTS, rows=3, padding=9, step=23)
    del message.data[-9:]
    np.testing.assert_array_equal(points_of(message)[0].points, POINTS)


def test_a_row_step_that_is_not_needed_is_not_used():
    np.testing.assert_array_equal(points_of(cloud_of(POINTS, row_step=0))[0].points, POINTS)


def test_what_is_not_finite_or_too_far_is_left_out():
    points = POINTS.copy()
    points[1, 0], points[4, 2], points[5, 1], points[7, 1] = math.nan, math.inf, -math.inf, 2e6
    kept, seen = points_of(cloud_of(points, LAYOUTS[1]))
    np.testing.assert_array_equal(kept.points, np.delete(POINTS, [1, 4, 5, 7], axis=0))
    assert seen == 8


@pytest.mark.parametrize(
    'message',
    [
        cloud_of([]),
        PointCloud2(header=cloud_of([]).header),
        cloud_of(POINTS, width=0),
        cloud_of(POINTS, height=0),
        cloud_of(np.full((5, 3), math.nan)),
    ],
)
def test_an_empty_cloud_is_no_points(message):
    points, seen = points_of(message)
    assert (len(points), seen) == (0, 0)


def test_another_nodes_points_are_read():
    bodies = [(POINTS[:5], *np.ones((3, 5))), (POINTS[5:], *np.ones((3, 7)))]
    data = messages.serialized_cloud(1, 'world', messages.points_array(bodies))
    points, _ = points_of(deserialize_message(data, PointCloud2))
    np.testing.assert_array_equal(points.points, POINTS)


def test_a_huge_cloud_is_thinned():
    many = np.random.default_rng(0).uniform(-5, 5, size=(100_000, 3))
    points, seen = points_of(cloud_of(many))
    assert (len(points), seen) == (MOST_POINTS, 100_000)


BAD_CLOUDS = [
    ({'header': Marker().header}, "frame_id is '': it must be 'world'; transform"),
    ({'fields': []}, "fields are nothing: there must be one 'x', of FLOAT32 (7)"),
    ({'layout': [('x', 'f4', 0), ('y', 'f4', 4)]}, "there must be one 'z'"),
    (
        {'layout': [('x', 'f4', 0), ('y', 'i4', 4), ('z', 'f4', 8)]},
        "datatype of 'y' is 5",
    ),
    ({'layout': [('x', 'f4', 0), ('y', 'f4', 2), ('z', 'f4', 8)]}, '[0, 2, 8]: they overlap'),
    ({'point_step': 0}, 'point_step is 0: x, y and z reach to byte 12 of a point'),
    ({'point_step': 11}, 'point_step is 11'),
    ({'point_step': 2**32 - 1}, 'point_step is 4294967295'),
    ({'width': 13}, 'data has 144 bytes: 1 × 13 points of 12 bytes need 156'),
    ({'width': 2**32 - 1, 'height': 1}, 'data has 144 bytes'),
    ({'height': 2**32 - 1}, 'data has 144 bytes'),
    ({'rows': 3, 'row_step': 47}, 'row_step is 47: a row of 4 points of 12 bytes needs 48'),
    ({'rows': 3, 'row_step': 0}, 'row_step is 0'),
    ({'rows': 3, 'row_step': 2**32 - 1}, 'data has 144 bytes'),
]


@pytest.mark.parametrize(('values', 'sentence'), BAD_CLOUDS)
def test_a_bad_cloud_is_refused(values, sentence):
    with pytest.raises(InputError) as refusal:
        points_of(cloud_of(POINTS, **values))
    assert sentence in str(refusal.value)


@pytest.mark.parametrize(
    ('field', 'values', 'sentence'),
    [
        (1, {'count': 3}, "count of 'y' is 3: it must be 1"),
        (1, {'count': 0}, "count of 'y' is 0"),
        (2, {'offset': 9}, 'point_step is 12: x, y and z reach to byte 13'),
        (2, {'offset': 2**32 - 1}, 'reach to byte 4294967299'),
        (2, {'name': 'x'}, "there must be one 'x'"),
        (0, {'datatype': 0}, "datatype of 'x' is 0"),
    ],
)
def test_a_bad_field_is_refused(field, values, sentence):
    message = cloud_of(POINTS)
    for name, value in values.items():
        setattr(message.fields[field], name, value)
    with pytest.raises(InputError) as refusal:
        points_of(message)
    assert sentence in str(refusal.value)


# ------------------------------------------------------------------------------------------ forces
def wrench_of(frame_id='ball', force=(1.0, 2.0, 3.0), torque=(4.0, 5.0, 6.0)):
    message = WrenchStamped()
    message.header.frame_id = frame_id
    fill(message.wrench.force, 'xyz', force)
    fill(message.wrench.torque, 'xyz', torque)
    return message


@pytest.mark.parametrize(('frame_id', 'name'), [('ball', 'ball'), ('world', None)])
def test_a_wrench_is_on_one_body_or_on_all(frame_id, name):
    wrench = message_parsing.wrench(wrench_of(frame_id), 'world', ('ball', 'cube'))
    assert (wrench.name, wrench.force, wrench.torque) == (name, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'frame_id': 'bal'}, "'bal': give the name of a body, or 'world' for all; did you mean"),
        ({'frame_id': ''}, 'known are ball, cube, world'),
        ({'frame_id': 'x' * 9999}, '…'),
        ({'force': (math.nan, 0.0, 0.0)}, 'force is [nan, 0, 0]: each must be within ±1e+09 N'),
        ({'force': (0.0, -HUGE, 0.0)}, 'force is'),
        ({'torque': (0.0, 0.0, math.inf)}, 'torque is [0, 0, inf]: each must be within'),
    ],
)
def test_a_bad_wrench_is_refused(values, sentence):
    with pytest.raises(InputError) as refusal:
        message_parsing.wrench(wrench_of(**values), 'world', ('ball', 'cube'))
    assert sentence in str(refusal.value)
    assert len(str(refusal.value)) < 200


def test_points_to_poke():
    message = PointStamped()
    message.header.frame_id = 'world'
    message.point.y = 2.0
    assert message_parsing.poked_point(message, 'world') == (0.0, 2.0, 0.0)
    for bad in (*NOT_FINITE, 1e7):
        message.point.z = bad
        with pytest.raises(InputError, match=r'point is .* each must be within'):
            message_parsing.poked_point(message, 'world')
    with pytest.raises(InputError, match="frame_id is 'world': it must be 'map'; transform"):
        message_parsing.poked_point(message, 'map')


def test_gravities():
    message = Vector3Stamped()
    message.header.frame_id = 'world'
    assert message_parsing.gravity(message, 'world') == (0.0, 0.0, 0.0)
    message.vector.x = -1e4
    assert message_parsing.gravity(message, 'world') == (-1e4, 0.0, 0.0)
    message.vector.y = 1e4
    with pytest.raises(InputError, match=r'its length must be at most 10000 m/s²'):
        message_parsing.gravity(message, 'world')
    for bad in NOT_FINITE:
        message.vector.y = bad
        with pytest.raises(InputError, match='vector is'):
            message_parsing.gravity(message, 'world')
    with pytest.raises(InputError, match='frame'):
        message_parsing.gravity(message, 'map')


# ------------------------------------------------------------------------------- whatever is sent
FLOATS = st.floats(width=64) | st.sampled_from([0.0, 1.0, 0.5, HUGE, -HUGE, 5e-324, 1e6])
TEXTS = st.sampled_from(['world', 'ball', '']) | st.text(max_size=5)
UINT32 = st.sampled_from([0, 1, 2, 4, 8, 12, 16, 2**31, 2**32 - 1]) | st.integers(0, 40)
INT32 = st.sampled_from([0, 1, 2, 3, -1, 2**31 - 1, -(2**31)])


@st.composite
def any_marker(draw):
    values = [draw(FLOATS) for _ in range(10)]
    result = marker(draw(INT32), values[:3], values[3:6], orientation=values[6:])
    result.header.frame_id = draw(st.sampled_from(['world', 'world', 'world', 'map']))
    result.ns, result.id, result.action = draw(TEXTS), draw(INT32), draw(INT32)
    result.header.stamp.sec, result.lifetime.sec = draw(INT32), draw(INT32)
    result.header.stamp.nanosec = result.lifetime.nanosec = draw(UINT32)
    return result


@st.composite
def any_cloud(draw):
    message = PointCloud2(
        width=draw(UINT32), height=draw(UINT32), point_step=draw(UINT32), row_step=draw(UINT32),
        is_bigendian=draw(st.booleans()),
    )  # fmt: skip
    message.header.frame_id = draw(st.sampled_from(['world', 'world', 'map']))
    names = draw(st.permutations(['x', 'y', 'z', 'w']) | st.lists(TEXTS, max_size=4))
    message.fields = [
        PointField(
            name=name, offset=draw(UINT32), count=draw(st.sampled_from([1, 1, 1, 0, 2**32 - 1])),
            datatype=draw(st.sampled_from([7, 7, 8, 8, 1, 0, 255])),
        )
        for name in names
    ]  # fmt: skip
    message.data.frombytes(draw(st.binary(max_size=200)))
    return message


def assert_sentence(error):
    assert '\n' not in str(error)


@settings(max_examples=300)
@given(st.lists(any_marker(), max_size=4))
def test_any_markers_leave_a_world_that_goes_on(markers):
    changes, problems = changes_of(*markers)
    assert len(changes) + len(problems) == len(markers)
    world = World(WorldConfig(bodies=()))
    for change in itertools.chain(changes, changes):
        world.change_obstacles([change])
        world.step(2)
    for obstacle in world.obstacles:
        assert np.isfinite(obstacle.position).all() and np.isfinite(obstacle.rotation).all()


@settings(max_examples=500)
@given(any_cloud())
def test_any_cloud_is_read_or_refused(message):
    try:
        points, seen = points_of(message)
    except InputError as error:
        assert_sentence(error)
        return
    assert isinstance(points, PointObstacles)
    assert np.isfinite(points.points).all()
    assert points.points.shape == (seen, 3)


@settings(max_examples=200)
@given(TEXTS, st.tuples(*[FLOATS] * 6))
def test_any_force_is_read_or_refused(frame_id, numbers):
    message = wrench_of(frame_id, numbers[:3], numbers[3:])
    point, vector = PointStamped(header=message.header), Vector3Stamped(header=message.header)
    fill(point.point, 'xyz', numbers[:3])
    fill(vector.vector, 'xyz', numbers[:3])
    for read, arguments in (
        (message_parsing.wrench, (message, 'world', ('ball',))),
        (message_parsing.poked_point, (point, 'world')),
        (message_parsing.gravity, (vector, 'world')),
    ):
        try:
            read(*arguments)
        except InputError as error:
            assert_sentence(error)
            continue
        assert np.isfinite(numbers[:3]).all()


# ------------------------------------------------------------------------------------------- pages
def from_yaml(message, values):
    """Fill a message as `ros2 topic pub` does."""
    for name, value in values.items():
        part = getattr(message, name)
        if isinstance(value, dict):
            from_yaml(part, value)
        elif isinstance(value, list):
            setattr(message, name, [from_yaml(Marker(), item) for item in value])
        else:
            setattr(message, name, type(part)(value))
    return message


def test_what_the_pages_send_is_understood():
    line = r"^ros2 topic pub .*/softbody_sim/(\w+) \w+/msg/(\w+) '(.*)'"
    sent = re.findall(line, everything(), re.M)
    assert [topic for topic, _, _ in sent] == [
        'obstacles', 'obstacles', 'wrench', 'poke', 'gravity',
    ]  # fmt: skip
    kinds = (MarkerArray, WrenchStamped, PointStamped, Vector3Stamped)
    read = []
    for _, name, text in sent:
        kind = next(kind for kind in kinds if kind.__name__ == name)
        read.append(from_yaml(kind(), yaml.safe_load(text)))
    (box,), problems = message_parsing.obstacle_changes(read[0], 'world', H)
    assert (box.config.type, box.config.size, problems) == ('box', (0.2, 0.2, 0.2), [])
    (removal,), problems = message_parsing.obstacle_changes(read[1], 'world', H)
    assert removal.removes(box.key) and not problems
    assert message_parsing.wrench(read[2], 'world', ('ball',)).name == 'ball'
    point = message_parsing.poked_point(read[3], 'world')
    assert message_parsing.gravity(read[4], 'world') == (3.0, 0.0, -9.0)

    world = World(WorldConfig())
    world.step(480)
    assert world.poke(point, 1.5, 0.15) == 'ball'
