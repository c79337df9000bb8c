# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
NumPy to messages, pure functions.

The bulk messages come as serialized bytes, which `Publisher.publish` takes too: turning arrays
into lists of message objects is a thousand times slower. Small ones come as objects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import struct
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointField
from visualization_msgs.msg import Marker

from softbody_ros.cdr import ENCAPSULATION, CdrWriter
from softbody_ros.core import RigidFit
from softbody_ros.core.config import Setting

POINT_FIELDS = (
    ('x', PointField.FLOAT32),
    ('y', PointField.FLOAT32),
    ('z', PointField.FLOAT32),
    ('displacement', PointField.FLOAT32),
    ('body', PointField.UINT32),
)
POINT_TYPE = np.dtype([(name, '<f4' if kind == PointField.FLOAT32 else '<u4')
                       for name, kind in POINT_FIELDS])  # fmt: skip


def time_message(nanoseconds: int) -> Time:
    """Return a time as a message."""
    seconds, rest = divmod(int(nanoseconds), 1_000_000_000)
    return Time(sec=seconds, nanosec=rest)


def _stamped(stamp: int, rest: bytes) -> bytes:
    """Return the begin of a message with a header: the stamp, and what follows it."""
    return ENCAPSULATION + struct.pack('<iI', *divmod(stamp, 1_000_000_000)) + rest


def _raw(array: np.ndarray) -> memoryview:
    """Return the bytes of a contiguous array without a copy."""
    return array.reshape(-1).view(np.uint8).data


def points_array(bodies: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """
    Return the particles of all bodies, in order, as records of `POINT_TYPE`.

    Parameters
    ----------
    bodies : sequence of ((n, 3) float, (n,) float)
        positions and displacements, m

    """
    records = np.empty(sum(len(positions) for positions, _ in bodies), POINT_TYPE)
    start = 0
    for index, (positions, displacement) in enumerate(bodies):
        part = records[start : start + len(positions)]
        part['x'], part['y'], part['z'] = positions.T
        part['displacement'], part['body'] = displacement, index
        start += len(positions)
    return records


def serialized_cloud(stamp: int, frame_id: str, records: np.ndarray) -> bytes:
    """
    Return a serialized sensor_msgs/PointCloud2.

    Parameters
    ----------
    stamp : int
        ns
    frame_id : str
    records : (n,) of `POINT_TYPE`

    """
    writer = CdrWriter(offset=8).string(frame_id)
    writer.primitives('II', 1, len(records))
    writer.sequence(len(POINT_FIELDS), 4)
    for name, kind in POINT_FIELDS:
        writer.string(name).primitives('IBI', POINT_TYPE.fields[name][1], kind, 1)  # type: ignore
    writer.primitives('?II', False, POINT_TYPE.itemsize, records.nbytes)
    writer.sequence(records.nbytes, 1)
    return b''.join([_stamped(stamp, writer.take()), _raw(records), b'\x01'])


def serialized_marker(
    stamp: int, frame_id: str, namespace: str, color: Sequence[float], corners: np.ndarray
) -> bytes:
    """
    Return a serialized visualization_msgs/Marker: a TRIANGLE_LIST of one colour.

    Parameters
    ----------
    stamp : int
        ns
    frame_id, namespace : str
    color : (4,) float
        red green blue alpha
    corners : (3 m, 3) float64
        three corners per triangle, m

    """
    head = CdrWriter(offset=8).string(frame_id).string(namespace)
    head.primitives('iii', 0, Marker.TRIANGLE_LIST, Marker.ADD)
    head.primitives('ddddddd', 0, 0, 0, 0, 0, 0, 1)  # pose
    head.primitives('ddd', 1, 1, 1)  # scale
    head.primitives('ffff', *color)
    head.primitives('iI?', 0, 0, False)  # lifetime, frame_locked
    head.sequence(len(corners), 8)
    # after the points the offset is a multiple of 8 again, unless there are none
    tail = CdrWriter(offset=0 if len(corners) else 8 + len(head.take()))
    tail.sequence(0, 4).string('')  # colors, texture_resource
    tail.primitives('iI', 0, 0).string('').string('').sequence(0, 1)  # texture
    tail.sequence(0, 4).string('').string('')  # uv_coordinates, text, mesh_resource
    tail.string('').sequence(0, 1).primitives('?', False)  # mesh_file, embedded materials
    points = np.ascontiguousarray(corners, dtype='<f8')
    return b''.join([_stamped(stamp, head.take()), _raw(points), tail.take()])


def serialized_mesh(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """
    Return a serialized shape_msgs/Mesh.

    Parameters
    ----------
    vertices : (n, 3) float
        m
    faces : (m, 3) int

    """
    triangles = np.ascontiguousarray(faces, dtype='<u4')
    points = np.ascontiguousarray(vertices, dtype='<f8')
    head = CdrWriter().sequence(len(triangles), 4).take()
    middle = CdrWriter(len(head) + triangles.nbytes).sequence(len(points), 8).take()
    return b''.join([ENCAPSULATION, head, _raw(triangles), middle, _raw(points)])


def odometry(stamp: int, frame_id: str, body: str, fit: RigidFit) -> Odometry:
    """Return the pose in `frame_id` and the twist in the body's own axes (REP-105)."""
    message = Odometry(child_frame_id=body)
    message.header.stamp = time_message(stamp)
    message.header.frame_id = frame_id
    quaternion = Rotation.from_matrix(fit.rotation).as_quat()
    _fill(message.pose.pose.position, 'xyz', fit.position)
    _fill(message.pose.pose.orientation, 'xyzw', quaternion)
    _fill(message.twist.twist.linear, 'xyz', fit.linear_velocity @ fit.rotation)
    _fill(message.twist.twist.angular, 'xyz', fit.angular_velocity @ fit.rotation)
    return message


def wrench(stamp: int, frame_id: str, force: np.ndarray, torque: np.ndarray) -> WrenchStamped:
    """Return a force (3,), N, and a torque (3,), N m."""
    message = WrenchStamped()
    message.header.stamp = time_message(stamp)
    message.header.frame_id = frame_id
    _fill(message.wrench.force, 'xyz', force)
    _fill(message.wrench.torque, 'xyz', torque)
    return message


def fill_entity_state(message: Any, stamp: int, frame_id: str, fit: RigidFit) -> None:
    """Fill a simulation_interfaces/EntityState: pose and twist, both in `frame_id`."""
    message.header.stamp = time_message(stamp)
    message.header.frame_id = frame_id
    quaternion = Rotation.from_matrix(fit.rotation).as_quat()
    _fill(message.pose.position, 'xyz', fit.position)
    _fill(message.pose.orientation, 'xyzw', quaternion)
    _fill(message.twist.linear, 'xyz', fit.linear_velocity)
    _fill(message.twist.angular, 'xyz', fit.angular_velocity)


def _fill(target: object, names: str, values: np.ndarray) -> None:
    for name, value in zip(names, values, strict=True):
        # a NumPy scalar would arrive as garbage
        setattr(target, name, float(value))


def diagnostics(
    stamp: int, name: str, level: bytes, summary: str, values: Mapping[str, str]
) -> DiagnosticArray:
    """Return one status as a DiagnosticArray."""
    status = DiagnosticStatus(level=level, name=name, message=summary, hardware_id='')
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    message = DiagnosticArray(status=[status])
    message.header.stamp = time_message(stamp)
    return message


def descriptor(facts: Setting) -> ParameterDescriptor:
    """Return the descriptor of a parameter: tools make sliders and tooltips of it."""
    result = ParameterDescriptor(
        description=facts.description + (f' [{facts.unit}]' if facts.unit else ''),
        additional_constraints=facts.range_text,
        read_only=facts.read_only,
    )
    if facts.minimum is None or facts.maximum is None or isinstance(facts.default, tuple):
        return result
    if isinstance(facts.default, int):
        result.integer_range = [
            IntegerRange(from_value=int(facts.minimum), to_value=int(facts.maximum))
        ]
    else:
        result.floating_point_range = [
            FloatingPointRange(from_value=float(facts.minimum), to_value=float(facts.maximum))
        ]
    return result
