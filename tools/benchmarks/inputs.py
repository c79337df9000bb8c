# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How long it takes to read what others send, and to let it act.

python3 tools/benchmarks/message_parsing.py
"""

from pathlib import Path
import sys
import time

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.core import World, WorldConfig
from softbody_ros.ros import message_parsing

ROUNDS = 5


def cloud(count):
    """Return a cloud of random points in a room, some of them missing, as a camera sends it."""
    layout = np.dtype(
        {'names': list('xyz'), 'formats': ['<f4'] * 3, 'offsets': [0, 4, 8], 'itemsize': 16}
    )
    records = np.zeros(count, layout)
    for axis in 'xyz':
        records[axis] = np.random.default_rng(0).uniform(-5, 5, count)
    records['x'][::7] = np.nan
    message = PointCloud2(height=1, width=count, point_step=16, row_step=16 * count)
    message.header.frame_id = 'world'
    message.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate('xyz')
    ]
    message.data.frombytes(records.tobytes())
    return message


def markers(count, moves):
    """Return what yields arrays of boxes, far below, that move or do not."""
    step = 0
    while True:
        array = MarkerArray()
        for index in range(count):
            marker = Marker(ns='box', id=index, type=Marker.CUBE)
            marker.header.frame_id = 'world'
            marker.header.stamp.sec, marker.header.stamp.nanosec = 1, step * 30_000_000
            marker.pose.position.x, marker.pose.position.z = float(index), -9.0
            marker.pose.position.y = 0.01 * step * moves
            marker.pose.orientation.w = 1.0
            marker.scale.x = marker.scale.y = marker.scale.z = 1.0
            array.markers.append(marker)
        yield array
        step += 1


def report(what, world, kind, messages, read, act):
    """Print the median times, ms."""
    rows = []
    for _ in range(ROUNDS):
        data = serialize_message(next(messages))
        times = [time.perf_counter()]
        message = deserialize_message(data, kind)
        times.append(time.perf_counter())
        result = read(message)[0]
        times.append(time.perf_counter())
        act(result)
        times.append(time.perf_counter())
        world.step()
        times.append(time.perf_counter())
        rows.append(np.diff(times))
    shown = ''.join(f'{1e3 * value:10.1f}' for value in np.median(rows, axis=0))
    print(f'{what:28}{shown}')


def main():
    """Print the table."""
    print(f'{"ms":28}{"rclpy":>10}{"read":>10}{"act":>10}{"step":>10}')
    for count in (100_000, 1_000_000):
        world = World(WorldConfig())
        message = cloud(count)
        report(
            f'{count} points', world, PointCloud2, iter([message] * ROUNDS),
            lambda message: message_parsing.point_obstacles(message, 'world', 0.02),
            world.set_points,
        )  # fmt: skip
    for count in (10, 100, 1000):
        for moves in (False, True):
            world = World(WorldConfig())
            report(
                f'{count} markers that {"move" if moves else "do not move"}', world, MarkerArray,
                markers(count, moves),
                lambda message: message_parsing.obstacle_changes(message, 'world', 1 / 240),
                world.change_obstacles,
            )  # fmt: skip


if __name__ == '__main__':
    main()
