# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of the topics in the table, as rclpy takes it."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from softbody_ros.ros.interfaces import Topic


def qos_of(topic: Topic, depth: int | None = None, latched: bool | None = None) -> QoSProfile:
    """Return the quality of service of a topic, with another depth or durability if given."""
    latched = topic.latched if latched is None else latched
    return QoSProfile(
        depth=topic.depth if depth is None else depth,
        reliability=(
            ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
