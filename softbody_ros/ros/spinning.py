# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Executor loop of the commands, which survives failing callbacks."""

from __future__ import annotations

import threading

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node


def spin(node: Node, stop: threading.Event) -> None:
    """Spin a node until `stop` is set; a callback that fails is logged and ignored."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        try:
            executor.spin_once(timeout_sec=1.0)
        except ExternalShutdownException:
            return
        except Exception as error:
            # rclpy's own services raise on a malformed request, which must not end the node
            node.get_logger().error(
                f'a callback failed and is ignored: {type(error).__name__}: {error}',
                throttle_duration_sec=1.0,
            )
