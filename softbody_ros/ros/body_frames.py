# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Frames of bodies in TF, if tf2_ros can be imported.

It is part of ROS, but not on PyPI: without it there are no such frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import importlib
from typing import Any

from rclpy.node import Node

from softbody_ros.core import RigidFit
from softbody_ros.ros import messages

PACKAGE = 'tf2_ros'


class BodyFrames:
    """
    Broadcasts the best-fit pose of each body as a frame of its name.

    Parameters
    ----------
    node : Node

    """

    def __init__(self, node: Node) -> None:
        self._broadcaster = _broadcaster(node)

    def publish(
        self, stamp: int, frame_id: str, names: Iterable[str], fit: Callable[[str], RigidFit]
    ) -> None:
        """Broadcast the frames of bodies in `frame_id`; `stamp` in ns, `fit` of a body."""
        if self._broadcaster is None:
            return
        frames = [messages.transform(stamp, frame_id, name, fit(name)) for name in names]
        if frames:
            self._broadcaster.sendTransform(frames)


def _broadcaster(node: Node) -> Any:
    """Return a tf2_ros.TransformBroadcaster, or None."""
    try:
        return importlib.import_module(PACKAGE).TransformBroadcaster(node)
    except ImportError:
        node.get_logger().debug('tf2_ros is not installed: bodies have no frames in TF')
    except Exception as error:  # a broken installation raises what it likes
        node.get_logger().warning(f'tf2_ros cannot be used, bodies have no frames in TF: {error}')
    return None
