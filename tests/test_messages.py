# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The serialized messages are, byte for meaningful byte, what rclpy makes of message objects."""

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Vector3
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from softbody_ros.core import RigidFit
from softbody_ros.ros import messages
from softbody_ros.scene import parameters

pytestmark = pytest.mark.oldest

STAMP = 1_700_000_001_123_456_789
COLOR = (0.25, 0.5, 0.75, 1.0)
# lengths that leave every remainder modulo 8 before what follows the string
NAMES = ['', 'a', 'ab', 'abc', 'map', 'world', 'wörld', 'a_long_frame', 'x' * 255]


def marker_object(frame_id, namespace, corners):
    marker = Marker(ns=namespace, type=Marker.TRIANGLE_LIST, action=Marker.ADD)
    marker.header.frame_id = frame_id
    marker.header.stamp = messages.time_message(STAMP)
    marker.pose.orientation.w = 1.0
    marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
    marker.color = ColorRGBA(r=COLOR[0], g=COLOR[1], b=COLOR[2], a=COLOR[3])
    marker.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in corners]
    return marker


@pytest.mark.parametrize('frame_id', NAMES)
@pytest.mark.parametrize('namespace', NAMES)
@pytest.mark.parametrize('triangles', [0, 1, 7])
def test_marker_equals_the_object_path(frame_id, namespace, triangles):
    corners = np.random.default_rng(triangles).normal(size=(3 * triangles, 3))
    data = messages.serialized_marker(STAMP, frame_id, namespace, COLOR, corners)
    expected = marker_object(frame_id, namespace, corners)
    assert deserialize_message(data, Marker) == expected
    assert len(data) == len(serialize_message(expected))


def test_marker_takes_any_layout_of_corners():
    corners = np.asfortranarray(np.random.default_rng(1).normal(size=(6, 3)).astype(np.float32))
    data = messages.serialized_marker(STAMP, 'world', 'ball', COLOR, corners)
    assert deserialize_message(data, Marker) == marker_object('world', 'ball', corners)


@pytest.mark.parametrize('frame_id', NAMES)
def test_cloud_equals_the_object_path(frame_id):
    rng = np.random.default_rng(0)
    bodies = [(rng.normal(size=(n, 3)), *rng.random((3, n))) for n in (5, 3)]
    records = messages.points_array(bodies)
    data = messages.serialized_cloud(STAMP, frame_id, records)

    expected = PointCloud2(height=1, width=8, point_step=28, row_step=224, is_dense=True)
    expected.header.frame_id = frame_id
    expected.header.stamp = messages.time_message(STAMP)
    for offset, name in enumerate(['x', 'y', 'z', 'displacement']):
        field = PointField(name=name, offset=4 * offset, datatype=PointField.FLOAT32, count=1)
        expected.fields.append(field)
    expected.fields += [
        PointField(name='body', offset=16, datatype=PointField.UINT32, count=1),
        PointField(name='pressure', offset=20, datatype=PointField.FLOAT32, count=1),
        PointField(name='permanent_strain', offset=24, datatype=PointField.FLOAT32, count=1),
    ]
    expected.data.frombytes(records.tobytes())
    assert deserialize_message(data, PointCloud2) == expected
    assert len(data) == len(serialize_message(expected))

    np.testing.assert_array_equal(records['body'], [0] * 5 + [1] * 3)
    np.testing.assert_array_equal(records['y'][5:], bodies[1][0][:, 1].astype(np.float32))
    np.testing.assert_array_equal(records['displacement'][:5], bodies[0][1].astype(np.float32))
    np.testing.assert_array_equal(records['pressure'][5:], bodies[1][2].astype(np.float32))
    strain = bodies[0][3].astype(np.float32)
    np.testing.assert_array_equal(records['permanent_strain'][:5], strain)


@pytest.mark.parametrize(('vertex_count', 'face_count'), [(4, 4), (5, 3), (3, 0)])
def test_rest_mesh_equals_the_object_path(vertex_count, face_count):
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(vertex_count, 3))
    faces = rng.integers(0, vertex_count, size=(face_count, 3), dtype=np.int32)
    expected = Mesh(
        triangles=[MeshTriangle(vertex_indices=face.astype(np.uint32)) for face in faces],
        vertices=[Point(x=x, y=y, z=z) for x, y, z in vertices.tolist()],
    )
    data = messages.serialized_mesh(vertices, faces)
    assert deserialize_message(data, Mesh) == expected
    assert len(data) == len(serialize_message(expected))


def test_odometry_has_the_twist_in_the_body_frame():
    rotation = Rotation.from_euler('z', 90, degrees=True)
    fit = RigidFit(
        position=np.array([1.0, 2.0, 3.0]),
        rotation=rotation.as_matrix(),
        linear_velocity=np.array([0.0, 1.0, 0.0]),
        angular_velocity=np.array([1.0, 0.0, 2.0]),
        displacement=np.zeros(1),
    )
    message = messages.odometry(STAMP, 'world', 'ball', fit)
    assert (message.header.frame_id, message.child_frame_id) == ('world', 'ball')
    pose, twist = message.pose.pose, message.twist.twist
    assert (pose.position.x, pose.position.y, pose.position.z) == (1.0, 2.0, 3.0)
    orientation = [getattr(pose.orientation, axis) for axis in 'xyzw']
    assert Rotation.from_quat(orientation).approx_equal(rotation, atol=1e-12)
    linear = [getattr(twist.linear, axis) for axis in 'xyz']
    angular = [getattr(twist.angular, axis) for axis in 'xyz']
    np.testing.assert_allclose(linear, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(angular, [0.0, -1.0, 2.0], atol=1e-12)
    decoded = deserialize_message(serialize_message(message), type(message))
    assert decoded == message


def test_diagnostics_survive_serialization():
    message = messages.diagnostics(STAMP, 'sim', DiagnosticStatus.WARN, 'slow', {'tick': '3'})
    decoded = deserialize_message(serialize_message(message), type(message))
    assert decoded == message
    assert decoded.status[0].values[0].value == '3'


@pytest.mark.parametrize('stamp', [0, 999_999_999, 1_000_000_000, STAMP])
def test_stamp_is_split_into_seconds_and_nanoseconds(stamp):
    message = messages.time_message(stamp)
    assert message.sec * 1_000_000_000 + message.nanosec == stamp


def test_descriptors_carry_ranges_units_and_choices():
    table = parameters.table(parameters.SceneLists())
    mass = messages.descriptor(table['ball.mass'])
    assert '[kg]' in mass.description
    assert (mass.floating_point_range[0].from_value, mass.read_only) == (1e-6, False)
    assert messages.descriptor(table['step_count']).integer_range[0].from_value == 1
    assert messages.descriptor(table['ball.mesh']).read_only
    mode = messages.descriptor(table['ball.mode'])
    assert mode.additional_constraints == 'rigid | linear | quadratic'
