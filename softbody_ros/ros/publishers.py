# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Publishers that are made and destroyed while a node runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.publisher import Publisher


class Publishers:
    """
    Makes the publishers of a node.

    Parameters
    ----------
    node : Node
    on_match : callable
        called when a subscriber of one of them comes or goes

    """

    def __init__(self, node: Node, on_match: Callable[[QoSPublisherMatchedInfo], None]) -> None:
        self._node, self._on_match = node, on_match

    def make(self, kind: type, topic: str, depth: int = 10) -> Publisher:
        """Return a publisher of messages of a type on a topic, with a queue of some depth."""
        events = PublisherEventCallbacks(matched=self._on_match)
        return self._node.create_publisher(kind, topic, depth, event_callbacks=events)

    def for_each(self, kind: type, topic: str, count: int) -> Publisher:
        """Return a publisher of one message for each of `count` things at a time."""
        # a shallower queue would drop some of them
        return self.make(kind, topic, max(10, 2 * count))

    def deepened(self, publisher: Publisher, count: int) -> Publisher:
        """Return a publisher as `for_each`: the given one if its queue is deep enough."""
        if publisher.qos_profile.depth >= 2 * count:
            return publisher
        kind: Any = publisher.msg_type
        topic = publisher.topic_name
        self.destroy(publisher)
        return self.for_each(kind, topic, 2 * count)  # not for each that is added

    def destroy(self, publisher: Publisher) -> None:
        """Destroy a publisher."""
        self._node.destroy_publisher(publisher)
