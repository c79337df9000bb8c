# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frames of bodies in TF, if tf2_ros can be used."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rclpy.node import Node

from softbody_ros.core import RigidFit
from softbody_ros.ros import messages
from softbody_ros.ros.frames import made_of_tf2


class BodyFrames:
    """
    Broadcasts the best-fit pose of each body as a frame of its name.

    Parameters
    ----------
    node : Node

    """

    def __init__(self, node: Node) -> None:
        self._broadcaster = made_of_tf2(
            node,
            lambda tf2_ros: tf2_ros.TransformBroadcaster(node),
            'bodies have no frames in TF',
        )

    def publish(
        self, stamp: int, frame_id: str, names: Iterable[str], fit: Callable[[str], RigidFit]
    ) -> None:
        """Broadcast the frames of bodies in `frame_id`; `stamp` in ns, `fit` of a body."""
        if self._broadcaster is None:
            return
        frames = [messages.transform(stamp, frame_id, name, fit(name)) for name in names]
        if frames:
            self._broadcaster.sendTransform(frames)
