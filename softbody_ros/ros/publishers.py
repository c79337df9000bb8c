# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Publishers of topics in the table, of which some are made and destroyed while a node runs."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.publisher import Publisher

from softbody_ros.ros.interfaces import Topic
from softbody_ros.ros.qos import qos_of


def create_publisher(
    node: Node,
    topic: Topic,
    on_match: Callable[[QoSPublisherMatchedInfo], None] | None = None,
    of: str = '',
    depth: int | None = None,
) -> Publisher:
    """
    Create the publisher of a topic on a node.

    Parameters
    ----------
    node : Node
    topic : Topic
    on_match : callable, optional
        called when a subscriber of it comes or goes
    of : str
        the body or obstacle, if it is not the topic of all
    depth : int, optional
        of its queue, by default that of the topic

    """
    name = f'{topic.name}/{of}' if of else topic.name
    events = PublisherEventCallbacks(matched=on_match)
    return node.create_publisher(topic.kind, name, qos_of(topic, depth), event_callbacks=events)


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

    def make(self, topic: Topic, of: str = '', depth: int | None = None) -> Publisher:
        """Return a publisher of a topic, as `create_publisher`."""
        return create_publisher(self._node, topic, self._on_match, of, depth)

    def for_each(self, topic: Topic, count: int) -> Publisher:
        """Return a publisher of one message for each of `count` things at a time."""
        # a shallower queue would drop some of them
        return self.make(topic, depth=max(topic.depth, 2 * count))

    def deepened(self, publisher: Publisher, topic: Topic, count: int) -> Publisher:
        """Return a publisher as `for_each`: the given one if its queue is deep enough."""
        if publisher.qos_profile.depth >= 2 * count:
            return publisher
        self.destroy(publisher)
        return self.for_each(topic, 2 * count)  # not for each that is added

    def destroy(self, publisher: Publisher) -> None:
        """Destroy a publisher."""
        self._node.destroy_publisher(publisher)
