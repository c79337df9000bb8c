# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS graph of its own: context, executor, domain id, nodes and processes."""

from __future__ import annotations

from collections.abc import Callable
import os
import signal
import subprocess
import sys
import time
from typing import Any

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

from domain_ids import Domain
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

TIMEOUT = 120.0


class Graph:
    """Nodes and processes of one test or tool, spun by it."""

    def __init__(self) -> None:
        self._domain = Domain()
        self.domain = self._domain.id
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self._nodes: list[Node] = []
        self._processes: list[subprocess.Popen] = []
        self.node = self.add(Node('tester', context=self.context))

    def add(self, node: Node) -> Node:
        self.executor.add_node(node)
        self._nodes.append(node)
        return node

    def sim_node(self, namespace: str | None = None, **overrides: Any) -> Any:
        """Start the node in this process; `ball__mass=2.0` stands for ball.mass."""
        from softbody_ros.ros.node import SimNode

        return self.add(
            SimNode(
                context=self.context,
                namespace=namespace,
                parameter_overrides=[
                    Parameter(name.replace('__', '.'), value=value)
                    for name, value in overrides.items()
                ],
            )
        )

    def process(
        self, *arguments: str, environment: dict | None = None, module: str = 'softbody_ros'
    ) -> subprocess.Popen:
        """Start `sim_node`, or another command, as a process of its own in this graph's domain."""
        process = subprocess.Popen(
            [sys.executable, '-m', module, *arguments],
            env=os.environ | {'ROS_DOMAIN_ID': str(self.domain)} | (environment or {}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._processes.append(process)
        return process

    def spin_until(self, condition: Callable[[], Any], what: str = 'the condition') -> Any:
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            result = condition()
            if result:
                return result
            self.executor.spin_once(timeout_sec=0.05)
        raise AssertionError(f'{what} did not come true within {TIMEOUT:g} s')

    def collect(self, kind: type, topic: str, qos: Any = 50) -> list:
        """Return a list that grows with each message received."""
        received: list = []
        self.node.create_subscription(kind, topic, received.append, qos)
        return received

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        client = self.node.create_client(kind, name)
        self.spin_until(client.service_is_ready, f'service {name}')
        future = client.call_async(kind.Request(**fields))
        self.spin_until(future.done, f'the answer of {name}')
        self.node.destroy_client(client)
        return future.result()

    def set_parameter(self, node: str, name: str, value: Any) -> Any:
        """Set as `ros2 param set` does; returns the SetParametersResult."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        answer = self.call(SetParameters, f'{node}/set_parameters', parameters=[parameter])
        return answer.results[0]

    def get_parameters(self, node: str, names: list[str]) -> list[Any]:
        answer = self.call(GetParameters, f'{node}/get_parameters', names=names)
        return [parameter_value_to_python(value) for value in answer.values]

    def list_parameters(self, node: str) -> list[str]:
        return list(self.call(ListParameters, f'{node}/list_parameters').result.names)

    def describe_parameters(self, node: str, names: list[str]) -> list:
        answer = self.call(DescribeParameters, f'{node}/describe_parameters', names=names)
        return list(answer.descriptors)

    def close(self) -> None:
        # as a user ends it: nodes of a process that was killed in the middle of a large message
        # once took the subscriber down with them, in the middleware
        for process in self._processes:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._processes:
            try:
                process.communicate(timeout=TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)
        self._domain.give_back()
