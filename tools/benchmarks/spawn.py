# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A body is added to a node that runs and removed again, a thousand times: time, memory, bits.

python3 tools/benchmarks/spawn.py [--quick]

Prints Markdown. The node and its client are in one process, so the memory is that of both. The
client sets `bodies` and the parameters of the body in one request, then `bodies` again. Between
them the node takes a tick, and publishes it.
"""

from __future__ import annotations

import argparse
import gc
import os
from pathlib import Path
import sys
import time
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool, Trigger

from softbody_ros.core import World
from softbody_ros.ros.node import SimNode

SIM = '/softbody_sim'
WORKLOADS = {
    'one name and mesh': lambda index: ('guest', 0.3),
    'ten names and sizes': lambda index: (f'guest_{index % 10}', 0.2 + 0.01 * (index % 10)),
    'another name and size each time': lambda index: (f'guest_{index}', 0.2 + 1e-4 * index),
}


class Client:
    """A node that runs, and one that calls its services."""

    def __init__(self) -> None:
        rclpy.init()
        scene = {'bodies': ['ball', 'box'], 'ball.subdivisions': 3, 'box.mesh': 'box'}
        scene |= {'box.position': [2.0, 0.0, 0.6], 'history.memory': 16.0}
        overrides = [Parameter(name, value=value) for name, value in scene.items()]
        self.sim = SimNode(parameter_overrides=overrides)
        self.node = Node('client')
        self.executor = SingleThreadedExecutor()
        for node in (self.sim, self.node):
            self.executor.add_node(node)
        self.clouds = 0
        self.node.create_subscription(PointCloud2, f'{SIM}/points', self._count, 10)
        self._clients: dict[str, Any] = {
            name: self.node.create_client(kind, f'{SIM}/{name}')
            for name, kind in (
                ('set_parameters_atomically', SetParametersAtomically),
                ('pause', SetBool),
                ('step', Trigger),
            )
        }
        for client in self._clients.values():
            while not client.service_is_ready():
                self.executor.spin_once(timeout_sec=0.01)

    def _count(self, _: PointCloud2) -> None:
        self.clouds += 1

    def call(self, name: str, request: Any) -> Any:
        future = self._clients[name].call_async(request)
        while not future.done():
            self.executor.spin_once(timeout_sec=0.1)
        return future.result()

    def set(self, **values: Any) -> None:
        messages = [
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=messages)
        result = self.call('set_parameters_atomically', request).result
        assert result.successful, result.reason

    def visit(self, name: str, size: float) -> tuple[float, float]:
        """Add a body, take a tick, and remove it; return the s that adding and removing took."""
        begin = time.perf_counter()
        values = {f'{name}__size': size, f'{name}__subdivisions': 2}
        values |= {f'{name}__position': [-4.0, 0.0, 2.0], f'{name}__mode': 'linear'}
        self.set(bodies=['ball', 'box', name], **values)
        added = time.perf_counter() - begin
        assert self.sim._world.names == ('ball', 'box', name)
        self.call('step', Trigger.Request())
        begin = time.perf_counter()
        self.set(bodies=['ball', 'box'])
        return added, time.perf_counter() - begin


def resident() -> float:
    """Return the resident memory of this process, MiB."""
    gc.collect()
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='a fiftieth of the visits')
    visits = 20 if parser.parse_args().quick else 1000
    client = Client()
    client.call('pause', SetBool.Request(data=True))
    start, ticks = client.sim._world.snapshot(), 0
    print('| visits | visit | add, ms | remove, ms | resident, MiB | history, MiB |')
    print('|---|---|---|---|---|---|')
    for what, guest in WORKLOADS.items():
        took: list[tuple[float, float]] = []
        for index in range(visits):
            took.append(client.visit(*guest(index)))
            ticks += 1
            if (index + 1) % (visits // 5) == 0:
                add, remove = 1e3 * np.median(took, axis=0)
                history = client.sim._stepper.history.nbytes / 2**20
                print(
                    f'| {what} | {index + 1} | {add:.1f} | {remove:.1f} | {resident():.1f} '
                    f'| {history:.1f} |'
                )
    world = client.sim._world
    alone = World(client.sim._scene.world)
    alone.restore(start)
    alone.step(ticks)
    same = all(
        np.array_equal(getattr(world, kind)(name), getattr(alone, kind)(name))
        for name in alone.names
        for kind in ('positions', 'velocities')
    )
    said = 'equal those' if same else 'DIFFER from those'
    print(f'\nAfter {ticks} ticks all bits {said} of a world that nobody has visited.')
    rclpy.shutdown()
    sys.exit(0 if same else 1)


if __name__ == '__main__':
    main()
