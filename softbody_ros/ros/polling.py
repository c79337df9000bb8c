# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Subscriptions that wake nobody: their messages are taken when it suits.

rclpy's executor takes half a millisecond for each message that it wakes for, so 1 kHz would cost
half a core.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

MOST_TAKEN = 100
"""Messages that are taken at a time, by default."""


class NeverReady(CallbackGroup):
    """Keeps what it contains out of the executor."""

    def can_execute(self, entity: Any) -> bool:  # noqa: D102
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: D102
        return False

    def ending_execution(self, entity: Any) -> None:  # noqa: D102
        pass


def subscribe(node: Node, kind: type, topic: str, depth: int, raw: bool = False) -> Subscription:
    """Return a subscription whose messages are `taken`, at most `depth` at a time; raw: bytes."""
    return node.create_subscription(
        kind, topic, _unused, QoSProfile(depth=depth), callback_group=NeverReady(), raw=raw
    )


def _unused(message: Any) -> None:
    """Never called."""


def taken(
    subscription: Subscription, most: int = MOST_TAKEN
) -> Iterator[tuple[Any, Mapping[str, int]]]:
    """Take messages that have come, each with what the middleware says of it, oldest first."""
    with subscription.handle:
        for _ in range(most):
            # as rclpy's executors take it
            found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if found is None:
                return
            yield found
