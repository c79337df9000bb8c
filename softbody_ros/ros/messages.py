# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Conversion of NumPy arrays to messages: pure functions.

Bulk messages are returned as serialized bytes, which `Publisher.publish` accepts: conversion to
lists of message objects is a thousand times slower. Small ones are returned as objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
import math
import struct
from typing import Any, NamedTuple

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointField
from visualization_msgs.msg import Marker

from softbody_ros.core import RigidFit
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.config import Setting
from softbody_ros.core.shape_matching.material import Material, stiffness_at
from softbody_ros.ros.cdr import ENCAPSULATION, CdrWriter

POINT_FIELDS = (
    ('x', PointField.FLOAT32),
    ('y', PointField.FLOAT32),
    ('z', PointField.FLOAT32),
    ('displacement', PointField.FLOAT32),
    ('body', PointField.UINT32),
    ('pressure', PointField.FLOAT32),
    ('permanent_strain', PointField.FLOAT32),
)
NUMBER_IN_POINTS = ' number in ~/points'
"""After the name of a body, in the diagnostics: its number in the field `body`."""
PREFIXES = {9: 'G', 6: 'M', 3: 'k'}
"""Of units, by powers of ten."""
POINT_TYPE = np.dtype([(name, '<f4' if kind == PointField.FLOAT32 else '<u4')
                       for name, kind in POINT_FIELDS])  # fmt: skip

_SHAPES = {
    'box': (Marker.CUBE, (0, 1, 2)),
    'sphere': (Marker.SPHERE, (0, 0, 0)),
    'cylinder': (Marker.CYLINDER, (0, 0, 2)),
}
"""Obstacle types that are marker types, and which half extents give their scale x y z."""


def time_message(nanoseconds: int) -> Time:
    """Return a time as a message."""
    seconds, rest = divmod(int(nanoseconds), 1_000_000_000)
    return Time(sec=seconds, nanosec=rest)


def _stamped(stamp: int, rest: bytes) -> bytes:
    """Return the beginning of a message with a header: the stamp, then `rest`."""
    return ENCAPSULATION + _stamp_bytes(stamp) + rest


def _stamp_bytes(stamp: int) -> bytes:
    return struct.pack('<iI', *divmod(stamp, 1_000_000_000))


def _raw(array: np.ndarray) -> memoryview:
    """Return the bytes of a contiguous array without a copy."""
    return array.reshape(-1).view(np.uint8).data


def points_array(
    bodies: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
    numbers: Iterable[int] | None = None,
) -> np.ndarray:
    """
    Return the particles of all bodies, in order, as records of `POINT_TYPE`.

    Parameters
    ----------
    bodies : sequence of ((n, 3) float, (n,) float, (n,) float, (n,) float)
        positions and displacements, m, pressures, Pa, and permanent strains
    numbers : iterable of int, optional
        of each body, by default from 0 on

    """
    records = np.empty(sum(len(positions) for positions, *_ in bodies), POINT_TYPE)
    start = 0
    numbers = range(len(bodies)) if numbers is None else numbers
    for number, (positions, displacement, pressure, strain) in zip(numbers, bodies, strict=True):
        rows = records[start : start + len(positions)]
        rows['x'], rows['y'], rows['z'] = positions.T
        rows['displacement'], rows['body'], rows['pressure'] = displacement, number, pressure
        rows['permanent_strain'] = strain
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
    head = _marker_head(8, frame_id, namespace, 0, Marker.TRIANGLE_LIST, Marker.ADD)
    shape = _marker_shape((1.0, 1.0, 1.0), tuple(color), len(corners))
    points = np.ascontiguousarray(corners, dtype='<f8')
    begin = _stamped(stamp, head)
    return b''.join([begin, _IDENTITY_POSE, shape, _raw(points), _marker_end()])


def deletion(stamp: int, frame_id: str, namespace: str) -> Marker:
    """Return a visualization_msgs/Marker that removes that of `serialized_marker`."""
    marker = Marker(ns=namespace, action=Marker.DELETE)
    marker.header.stamp, marker.header.frame_id = time_message(stamp), frame_id
    marker.pose.orientation.w = 1.0
    return marker


# A marker consists, after its stamp, of head, pose, shape, corners, end. Only the padding of the
# head depends on its offset in the message: the pose always begins at a multiple of 8.
_IDENTITY_POSE = struct.pack('<7d', 0, 0, 0, 0, 0, 0, 1)


@lru_cache(maxsize=4096)
def _marker_head(
    offset: int, frame_id: str, namespace: str, number: int, kind: int, action: int
) -> bytes:
    writer = CdrWriter(offset).string(frame_id).string(namespace)
    return writer.primitives('iii', number, kind, action).pad(8).take()


@lru_cache(maxsize=4096)
def _marker_shape(scale: tuple[float, ...], color: tuple[float, ...], corners: int) -> bytes:
    writer = CdrWriter().primitives('ddd', *scale).primitives('ffff', *color)
    writer.primitives('iI?', 0, 0, False)  # lifetime, frame_locked
    return writer.sequence(corners, 8).take()


@lru_cache
def _marker_end(text: str = '') -> bytes:
    writer = CdrWriter().sequence(0, 4).string('')  # colors, texture_resource
    writer.primitives('iI', 0, 0).string('').string('').sequence(0, 1)  # texture
    writer.sequence(0, 4).string(text).string('')  # uv_coordinates, text, mesh_resource
    return writer.string('').sequence(0, 1).primitives('?', False).take()  # mesh_file, materials


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


class ShownObstacle(NamedTuple):
    """An obstacle with the namespace, id and colour of its marker."""

    namespace: str
    number: int
    color: tuple[float, ...]
    obstacle: Obstacle


def serialized_obstacles(stamp: int, frame_id: str, shown: Sequence[ShownObstacle]) -> bytes:
    """
    Return a serialized visualization_msgs/MarkerArray with the complete state.

    It begins with a DELETEALL. Boxes, spheres and cylinders are markers of these types; capsules,
    meshes and planes are TRIANGLE_LISTs in their own frames. A plane, with the text 'plane', is a
    square about its origin.

    Parameters
    ----------
    stamp : int
        ns
    frame_id : str
    shown : sequence of ShownObstacle

    """
    markers = []
    for item, pose in zip(shown, _poses([item.obstacle for item in shown]), strict=True):
        config = item.obstacle.config
        kind, axes = _SHAPES.get(config.type, (Marker.TRIANGLE_LIST, ()))
        scale = tuple(2.0 * config.size[axis] for axis in axes) or (1.0, 1.0, 1.0)
        corners = b'' if axes else _raw(item.obstacle.triangles)
        text = 'plane' if config.type == 'plane' else ''
        markers.append(
            _PackedMarker(
                item.namespace, item.number, kind, pose, scale, item.color, corners, text
            )
        )
    return _serialized_array(stamp, frame_id, markers)


class ShownSurface(NamedTuple):
    """A surface with the namespace, id and colour of its marker; its triangles (m, 3, 3), m."""

    namespace: str
    number: int
    color: tuple[float, ...]
    triangles: np.ndarray


def serialized_surfaces(stamp: int, frame_id: str, shown: Sequence[ShownSurface]) -> bytes:
    """Return a serialized visualization_msgs/MarkerArray: a DELETEALL, then TRIANGLE_LISTs."""
    unit = (1.0, 1.0, 1.0)
    markers = []
    for namespace, number, color, triangles in shown:
        corners = _raw(np.ascontiguousarray(triangles, dtype='<f8'))
        markers.append(
            _PackedMarker(
                namespace, number, Marker.TRIANGLE_LIST, _IDENTITY_POSE, unit, color, corners
            )
        )
    return _serialized_array(stamp, frame_id, markers)


class _PackedMarker(NamedTuple):
    """A marker; its pose and its corners are bytes."""

    namespace: str
    number: int
    kind: int
    pose: bytes
    scale: tuple[float, ...]
    color: tuple[float, ...]
    corners: bytes | memoryview
    text: str = ''


def _serialized_array(stamp: int, frame_id: str, markers: Sequence[_PackedMarker]) -> bytes:
    """Return a serialized visualization_msgs/MarkerArray: a DELETEALL, then the markers."""
    time = _stamp_bytes(stamp)
    parts: list[bytes | memoryview] = [struct.pack('<I', len(markers) + 1), time]
    parts.append(_marker_head(12, frame_id, '', 0, 0, Marker.DELETEALL))
    parts += [_IDENTITY_POSE, _marker_shape((0.0,) * 3, (0.0,) * 4, 0), _marker_end()]
    offset = sum(map(len, parts))
    for item in markers:
        padding = bytes(-offset % 4)
        at = (offset + len(padding) + len(time)) % 8
        marker: list[bytes | memoryview] = [
            padding + time,
            _marker_head(at, frame_id, item.namespace, item.number, item.kind, Marker.ADD),
            item.pose,
            _marker_shape(item.scale, item.color, len(item.corners) // 24),
            item.corners,
            _marker_end(item.text),
        ]
        offset += sum(map(len, marker))
        parts += marker
    return b''.join([ENCAPSULATION, *parts])


def _poses(obstacles: Sequence[Obstacle]) -> list[bytes]:
    """Return the serialized pose of each."""
    if not obstacles:
        return []
    positions = [obstacle.position for obstacle in obstacles]
    quaternions = Rotation.from_matrix([obstacle.rotation for obstacle in obstacles]).as_quat()
    return [row.tobytes() for row in np.hstack([positions, quaternions])]


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


def transform(stamp: int, frame_id: str, body: str, fit: RigidFit) -> TransformStamped:
    """Return the pose of a body as that of a frame of its name."""
    message = TransformStamped(child_frame_id=body)
    message.header.stamp = time_message(stamp)
    message.header.frame_id = frame_id
    quaternion = Rotation.from_matrix(fit.rotation).as_quat()
    _fill(message.transform.translation, 'xyz', fit.position)
    _fill(message.transform.rotation, 'xyzw', quaternion)
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
        # rclpy serializes NumPy scalars wrongly
        setattr(target, name, float(value))


def material_text(material: Material, mode: str, reference_step: float) -> str:
    """
    Return how stiff and heavy a body is, by each of the settings that can say it.

    Such as '13.8 Hz, as 1.2 kPa, as stiffness 0.5; 1 kg, 1.9 kg/m³'.
    """
    stiffness = [f'{material.frequency / (2 * math.pi):.3g} Hz']
    if material.young_modulus > 0.0:
        stiffness.append(_with_prefix(material.young_modulus, 'Pa'))
    equivalent = stiffness_at(material.frequency, reference_step)
    if equivalent is not None:
        stiffness.append(f'stiffness {equivalent:.3g}')
    mass = [f'{material.mass:.4g} kg']
    if material.density > 0.0:
        mass.append(f'{material.density:.4g} kg/m³')
    return f'{"rigid" if mode == "rigid" else ", as ".join(stiffness)}; {", ".join(mass)}'


def _with_prefix(value: float, unit: str) -> str:
    power = next((power for power in PREFIXES if value >= 10.0**power), 0)
    return f'{value / 10.0**power:.3g} {PREFIXES.get(power, "")}{unit}'


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
    """Return the descriptor of a parameter, from which tools make sliders and tooltips."""
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
