# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Clouds of a bag, by rosbags, without ROS.

Times are those of the headers, or of receipt where a header has none, from the first cloud on.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from softbody_ros.ensemble.observation import ANY_BODY, Observation, ObservationError, in_order

CLOUD = 'sensor_msgs/msg/PointCloud2'
TYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
"""NumPy types of sensor_msgs/PointField."""


def read_bag(path: Path, bodies: Sequence[str], topic: str | None) -> Observation:
    """
    Return the clouds of a topic of a bag.

    Clouds with the field `body`, as of `~/points`, are separated by it; others are of any body.

    Raises
    ------
    ObservationError
        if there is no such topic, none that is the only one, or a cloud is malformed.

    """
    # a file of a bag without its metadata.yaml lies in the folder that is the bag
    whole = path.parent if path.suffix in ('.mcap', '.db3') and path.is_file() else path
    try:
        typestore = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([whole], default_typestore=typestore) as reader:
            return _clouds(reader, path, bodies, topic)
    except (AnyReaderError, OSError) as error:
        reason = ' '.join(str(error).split())
        raise ObservationError(f'the bag {path} cannot be read: {reason}') from None


def _clouds(
    reader: AnyReader, path: Path, bodies: Sequence[str], topic: str | None
) -> Observation:
    topics = sorted({each.topic for each in reader.connections if each.msgtype == CLOUD})
    chosen = _chosen(topics, topic, path)
    connections = [each for each in reader.connections if each.topic == chosen]
    times: list[float] = []
    frames: list[dict[str, np.ndarray]] = []
    first = None
    for connection, received, data in reader.messages(connections):
        message: Any = reader.deserialize(data, connection.msgtype)
        stamp = message.header.stamp
        time = (stamp.sec * 1_000_000_000 + stamp.nanosec) or received
        first = time if first is None else first
        times.append((time - first) * 1e-9)
        frames.append(_separated(_records(message, chosen), bodies, chosen))
    if not frames:
        raise ObservationError(f'the topic {chosen} of the bag {path} has no messages')
    names = sorted({name for frame in frames for name in frame})
    nothing = np.zeros((0, 3))
    clouds = {name: [frame.get(name, nothing) for frame in frames] for name in names}
    return in_order(times, clouds, path)


def _chosen(topics: Sequence[str], topic: str | None, path: Path) -> str:
    if not topics:
        raise ObservationError(f'the bag {path} has no topic of type {CLOUD}')
    if topic is not None:
        if topic not in topics:
            raise ObservationError(
                f'the bag {path} has no clouds on {topic}: its clouds are on {", ".join(topics)}'
            )
        return topic
    if len(topics) > 1:
        raise ObservationError(
            f'the bag {path} has clouds on {", ".join(topics)}: choose one with --topic'
        )
    return topics[0]


def _records(message: Any, topic: str) -> np.ndarray:
    """Return the points of a sensor_msgs/PointCloud2 as records."""
    order = '>' if message.is_bigendian else '<'
    wanted = [each for each in message.fields if each.name in ('x', 'y', 'z', 'body')]
    missing = [axis for axis in 'xyz' if axis not in [each.name for each in wanted]]
    if missing:
        raise ObservationError(f'the clouds of {topic} lack the fields {", ".join(missing)}')
    try:
        layout = np.dtype(
            {
                'names': [each.name for each in wanted],
                'formats': [order + TYPES[each.datatype] for each in wanted],
                'offsets': [each.offset for each in wanted],
                'itemsize': message.point_step,
            }
        )
        size = message.width * layout.itemsize
        # rows may be padded
        rows = [
            np.frombuffer(message.data[k * message.row_step :][:size], layout)
            for k in range(message.height)
        ]
        records = np.concatenate([np.zeros(0, layout), *rows])
    except (KeyError, ValueError):
        records = np.zeros(0, [('x', 'f4')])
    if len(records) != message.width * message.height or 'z' not in (records.dtype.names or ()):
        raise ObservationError(
            f'a cloud of {topic} is malformed: its data does not fit its fields'
        )
    return records


def _separated(records: np.ndarray, bodies: Sequence[str], topic: str) -> dict[str, np.ndarray]:
    points = np.stack([records[axis] for axis in 'xyz'], axis=-1).astype(float)
    if 'body' not in (records.dtype.names or ()):
        return {ANY_BODY: points}
    numbers = np.unique(records['body']).tolist()
    if numbers and not 0 <= numbers[-1] < len(bodies):
        raise ObservationError(
            f'a cloud of {topic} has the body {numbers[-1]}, counted from 0, but the scene has '
            f'{len(bodies)}: {", ".join(bodies)}'
        )
    return {bodies[number]: points[records['body'] == number] for number in numbers}
