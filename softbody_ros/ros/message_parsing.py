# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Parsing of received messages into the types of the core, or into a sentence why not.

Pure functions. Whatever a message contains, they raise nothing but `InputError`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import functools
import itertools
import math
from typing import Any

from geometry_msgs.msg import PointStamped, Vector3Stamped, WrenchStamped
import numpy as np
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState, PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.core.collision.point_obstacles import NO_POINTS, PointObstacles, thinned
from softbody_ros.core.config import (
    LARGEST,
    ObstacleConfig,
    WorldConfig,
    in_brackets,
    settings,
    unknown_name,
)
from softbody_ros.core.external_inputs import (
    MOST_DYNAMIC_OBSTACLES,
    ROBOT,
    ObstacleRemoval,
    ObstacleUpdate,
)

SHAPES = {
    Marker.CUBE: 'box',
    Marker.SPHERE: 'sphere',
    Marker.CYLINDER: 'cylinder',
}
"""Marker types that are accepted as obstacles, and their obstacle types."""
ROUND = {Marker.SPHERE: 'x y z', Marker.CYLINDER: 'x y'}
"""Which diameters of a round shape must be equal."""
UNEQUAL = 1e-3
"""Relative difference up to which diameters count as equal."""
MOST_MARKERS = 2 * MOST_DYNAMIC_OBSTACLES
"""Markers of one array that are parsed: enough to remove and replace all obstacles."""
LARGEST_WRENCH = 1e9
FLOATS = {PointField.FLOAT32: 'f4', PointField.FLOAT64: 'f8'}

_SIZE = next(facts for name, _, facts in settings(ObstacleConfig) if name == 'size')
_GRAVITY = next(facts for name, _, facts in settings(WorldConfig) if name == 'gravity_magnitude')


class InputError(ValueError):
    """A message that cannot be used: one sentence with value, allowed range and remedy."""


# ------------------------------------------------------------------------------------- obstacles
def obstacle_changes(
    message: MarkerArray, frame_id: str, time_step: float, pace: float = 1.0
) -> tuple[list[ObstacleUpdate | ObstacleRemoval], list[str]]:
    """
    Return the changes in a MarkerArray, and a sentence for each of its markers that is ignored.

    Parameters
    ----------
    message : visualization_msgs/MarkerArray
    frame_id : str
        the frame in which obstacles must be
    time_step : float
        s per tick
    pace : float
        simulated seconds per second of the clock of the stamps

    """
    changes: list[ObstacleUpdate | ObstacleRemoval] = []
    problems = []
    for marker in message.markers[:MOST_MARKERS]:
        try:
            changes.append(_change(marker, frame_id, time_step, pace))
        except InputError as error:
            name = f'{_quoted(marker.ns)}/{marker.id}'
            problems.append(f'marker {name} is ignored: {error}')
    beyond = len(message.markers) - MOST_MARKERS
    if beyond > 0:
        problems.append(
            f'the array has {len(message.markers)} markers: only the first {MOST_MARKERS} are used'
        )
    return changes, problems


def _change(
    marker: Marker, frame_id: str, time_step: float, pace: float
) -> ObstacleUpdate | ObstacleRemoval:
    if marker.ns.startswith(ROBOT):
        raise InputError(f'its ns begins with {ROBOT}, as of the links of a robot: choose another')
    if marker.action == Marker.DELETE:
        return ObstacleRemoval(marker.ns, marker.id)
    if marker.action == Marker.DELETEALL:
        return ObstacleRemoval(marker.ns)
    if marker.action != Marker.ADD:
        raise InputError(f'action is {marker.action}: use ADD (0), DELETE (2) or DELETEALL (3)')
    require_frame(marker.header.frame_id, frame_id)
    if marker.type not in SHAPES:
        raise InputError(
            f'type is {marker.type}: obstacles are CUBE (1), SPHERE (2) or CYLINDER (3)'
        )
    pose, scale = marker.pose, marker.scale
    config = _obstacle(
        marker.type,
        (pose.position.x, pose.position.y, pose.position.z),
        (pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w),
        (scale.x, scale.y, scale.z),
    )
    stamp = marker.header.stamp.sec * 1_000_000_000 + marker.header.stamp.nanosec
    seconds = marker.lifetime.sec + 1e-9 * marker.lifetime.nanosec
    lifetime = max(math.ceil(seconds / time_step), 0)
    return ObstacleUpdate((marker.ns, marker.id), config, stamp, pace, lifetime)


@functools.lru_cache(maxsize=4 * MOST_DYNAMIC_OBSTACLES)
def _obstacle(
    kind: int,
    position: tuple[float, ...],
    orientation: tuple[float, ...],
    scale: tuple[float, ...],
) -> ObstacleConfig:
    """Return an obstacle; cached, as the same ones are sent repeatedly."""
    if not all(abs(value) <= LARGEST for value in position):
        raise InputError(f'position is {in_brackets(position)}: it must be within ±{LARGEST:g} m')
    length = math.hypot(*orientation)
    if not 1e-6 < length < math.inf:
        raise InputError(
            f'orientation is {in_brackets(orientation)}: give a quaternion x y z w of length 1, '
            'for example [0, 0, 0, 1]'
        )
    low, high = 2.0 * (_SIZE.minimum or 0.0), 2.0 * (_SIZE.maximum or math.inf)
    if not all(low <= value <= high for value in scale):
        raise InputError(
            f'scale is {in_brackets(scale)}: these are full lengths, each must be from {low:g} to '
            f'{high:g} m'
        )
    if kind in ROUND:
        diameters = scale[: len(ROUND[kind].split())]
        if max(diameters) - min(diameters) > UNEQUAL * max(diameters):
            raise InputError(
                f'scale is {in_brackets(scale)}: its {ROUND[kind]} are diameters and must be '
                'equal, nothing elliptic is supported'
            )
    return ObstacleConfig(
        name='marker',
        type=SHAPES[kind],
        position=position,
        orientation=tuple(max(-1.0, min(value / length, 1.0)) for value in orientation),
        size=tuple(0.5 * value for value in scale),
    )


# ---------------------------------------------------------------------------------------- points
def point_obstacles(
    message: PointCloud2,
    frame_id: str,
    radius: float,
    pose: tuple[Sequence[float], Sequence[float]] | None = None,
) -> tuple[PointObstacles, int]:
    """
    Return the thinned points of a cloud, and the number of usable ones before thinning.

    Any layout with x, y and z as floats is accepted. Points that are not finite are dropped.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
    frame_id : str
        the frame in which points must be
    radius : float
        of the spheres about them, m
    pose : ((3,) float, (4,) float), optional
        of the frame of the message in that of the world, if that is another: m, and a quaternion

    Raises
    ------
    InputError
        if the cloud cannot be read.

    """
    if pose is None:
        require_frame(message.header.frame_id, frame_id)
    if not message.width * message.height:
        return NO_POINTS, 0
    points = _coordinates(message)
    if pose is not None:
        with np.errstate(invalid='ignore', over='ignore'):
            points = points @ Rotation.from_quat(pose[1]).as_matrix().T + pose[0]
    points = points[(np.abs(points) <= LARGEST).all(axis=1)]
    if not len(points):
        return NO_POINTS, 0
    return PointObstacles(thinned(points, radius), radius), len(points)


def _coordinates(message: PointCloud2) -> np.ndarray:
    """Return (k, 3) float64: the coordinates in the cloud, finite or not."""
    width, height, step = message.width, message.height, message.point_step
    row_step = message.row_step if height > 1 else width * step
    layout = _layout(message)
    if row_step < width * step:
        raise InputError(
            f'row_step is {row_step}: a row of {width} points of {step} bytes needs {width * step}'
        )
    needed = (height - 1) * row_step + width * step
    if len(message.data) < needed:
        raise InputError(
            f'data has {len(message.data)} bytes: {height} × {width} points of {step} bytes need '
            f'{needed}'
        )
    records: np.ndarray = np.ndarray(
        (height, width), layout, np.frombuffer(message.data, np.uint8).data, 0, (row_step, step)
    )
    points = np.empty((height, width, 3))
    with np.errstate(invalid='ignore'):
        for axis, name in enumerate('xyz'):
            points[..., axis] = records[name]
    return points.reshape(-1, 3)


def _layout(message: PointCloud2) -> np.dtype:
    """Return the layout of x, y and z in each point."""
    order = '>' if message.is_bigendian else '<'
    names = [item.name for item in message.fields]
    formats, offsets = [], []
    for name in 'xyz':
        if names.count(name) != 1:
            shown = ', '.join(_quoted(item) for item in names[:20]) or 'nothing'
            raise InputError(f'fields are {shown}: there must be one {name!r}, of FLOAT32 (7)')
        item = message.fields[names.index(name)]
        if item.datatype not in FLOATS:
            raise InputError(
                f'datatype of {name!r} is {item.datatype}: it must be FLOAT32 (7) or FLOAT64 (8)'
            )
        if item.count != 1:
            raise InputError(f'count of {name!r} is {item.count}: it must be 1')
        formats.append(order + FLOATS[item.datatype])
        offsets.append(item.offset)
    spans = sorted((at, at + int(kind[-1])) for at, kind in zip(offsets, formats, strict=True))
    if any(before[1] > after[0] for before, after in itertools.pairwise(spans)):
        raise InputError(f'the offsets of x, y, z are {offsets}: they overlap')
    end = spans[-1][1]
    if not end <= message.point_step <= len(message.data):
        raise InputError(
            f'point_step is {message.point_step}: x, y and z reach to byte {end} of a point, and '
            f'data has {len(message.data)} bytes'
        )
    return np.dtype(
        {'names': list('xyz'), 'formats': formats, 'offsets': offsets,
         'itemsize': message.point_step}
    )  # fmt: skip


# ---------------------------------------------------------------------------------------- forces
@dataclass(frozen=True)
class WrenchInput:
    """
    A parsed wrench.

    Attributes
    ----------
    name : str or None
        of the body, in whose axes it is given; None: on every body, in world axes
    force, torque : tuple of three floats
        N, N m

    """

    name: str | None
    force: tuple[float, ...]
    torque: tuple[float, ...]


def wrench(message: WrenchStamped, frame_id: str, names: Sequence[str]) -> WrenchInput:
    """
    Return a wrench on the body that `frame_id` names, or on all in the frame of the world.

    Raises
    ------
    InputError
        if the frame is neither, or a number is not finite or too large.

    """
    frame = message.header.frame_id
    if frame != frame_id and frame not in names:
        hint = unknown_name(frame, [*names, frame_id])
        raise InputError(
            f'frame_id is {_quoted(frame)}: give the name of a body, or {frame_id!r} for all; '
            f'{hint}'
        )
    force = _vector('force', message.wrench.force, LARGEST_WRENCH, 'N')
    torque = _vector('torque', message.wrench.torque, LARGEST_WRENCH, 'N m')
    return WrenchInput(None if frame == frame_id else frame, force, torque)


def poked_point(message: PointStamped, frame_id: str) -> tuple[float, ...]:
    """Return the point that is poked, m; or raise InputError."""
    require_frame(message.header.frame_id, frame_id)
    return _vector('point', message.point, LARGEST, 'm')


def gravity(message: Vector3Stamped, frame_id: str) -> tuple[float, ...]:
    """Return a gravity, m/s²; or raise InputError."""
    require_frame(message.header.frame_id, frame_id)
    largest = _GRAVITY.maximum or math.inf
    vector = _vector('vector', message.vector, largest, 'm/s²')
    if math.hypot(*vector) > largest:
        raise InputError(
            f'vector is {in_brackets(vector)}: its length must be at most {largest:g} m/s²'
        )
    return vector


# ---------------------------------------------------------------------------------------- joints
def joint_readings(
    message: JointState,
) -> tuple[int, list[tuple[str, float, float | None]], str]:
    """
    Return stamp, ns, and name, position and velocity of the joints in a message, and a warning.

    A velocity that is not sent, or no number, is None. The warning is about joints that are left
    out, or ''.

    Raises
    ------
    InputError
        if it says nothing of positions.

    """
    names, positions, velocities = message.name, message.position, message.velocity
    if len(positions) != len(names):
        raise InputError(f'it has {len(names)} names and {len(positions)} positions: send as many')
    if len(velocities) not in (0, len(names)):
        raise InputError(
            f'it has {len(names)} names and {len(velocities)} velocities: or send none'
        )
    readings: list[tuple[str, float, float | None]] = []
    bad = []
    for name, position, velocity in zip(
        names, positions, velocities or [None] * len(names), strict=True
    ):
        if not abs(position) <= LARGEST:
            bad.append(f'position of {_quoted(name)} is {position:g}')
            continue
        if velocity is not None and not abs(velocity) <= LARGEST:
            velocity = None
        readings.append((name, position, velocity))
    stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    if not bad:
        return stamp, readings, ''
    more = f' (and {len(bad) - 1} more like this)' if len(bad) > 1 else ''
    return stamp, readings, f'{bad[0]}{more}, and is ignored: it must be within ±{LARGEST:g}'


# ---------------------------------------------------------------------------------------- common
def require_frame(given: str, frame_id: str) -> None:
    """Raise InputError unless a frame is that of the world; `frames` has put what it can there."""
    if given != frame_id:
        publish = f', or publish {_quoted(given)} on /tf, with tf2_ros installed' if given else ''
        raise InputError(
            f'frame_id is {_quoted(given)}: it must be {frame_id!r}; transform the message '
            f'first{publish}'
        )


def _vector(name: str, vector: Any, largest: float, unit: str) -> tuple[float, ...]:
    values = (float(vector.x), float(vector.y), float(vector.z))
    if not all(abs(value) <= largest for value in values):
        raise InputError(
            f'{name} is {in_brackets(values)}: each must be within ±{largest:g} {unit}'
        )
    return values


def _quoted(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:60] + '…')
