# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Subscribers: received messages become actions on the stepper, parsed by `message_parsing`.

All actions are recorded in the history: after /clock went back they repeat at the same ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
import time
from typing import Any

from geometry_msgs.msg import PointStamped, Vector3Stamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from softbody_ros.core import World
from softbody_ros.core.external_inputs import (
    MOST_DYNAMIC_OBSTACLES,
    DynamicObstacle,
    Key,
    ObstacleRemoval,
    ObstacleUpdate,
)
from softbody_ros.ros import message_parsing
from softbody_ros.ros.message_parsing import InputError
from softbody_ros.scene.parameters import NodeConfig
from softbody_ros.timeline.stepper import Stepper

WARNING_PERIOD = 5.0
"""Seconds between two warnings about the same topic."""
BYTES_PER_ACTION = 1000
BYTES_PER_MARKER, BYTES_PER_POSE = 400, 1000
"""Approximate memory of an action in the history; an unchanged marker shares its pose."""
# best effort also receives from reliable publishers; of clouds only the last one matters
NEWEST_CLOUDS = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)


class InputTopics:
    """
    Subscribes to the input topics, and applies the messages to the world.

    Parameters
    ----------
    node : Node
    stepper : Stepper
    settings : callable
        returns the present NodeConfig

    """

    def __init__(self, node: Node, stepper: Stepper, settings: Callable[[], NodeConfig]) -> None:
        self._node = node
        self._stepper = stepper
        self._settings = settings
        self._warned: dict[str, float] = {}
        for kind, topic, use, qos in (
            (MarkerArray, '~/obstacles', self._obstacles, 10),
            (PointCloud2, '~/obstacle_points', self._points, NEWEST_CLOUDS),
            (WrenchStamped, '~/wrench', self._wrench, 10),
            (PointStamped, '~/poke', self._poke, 10),
            (Vector3Stamped, '~/gravity', self._gravity, 10),
        ):
            node.create_subscription(kind, topic, partial(self._received, topic, use), qos)

    @property
    def _world(self) -> World:
        return self._stepper.world

    def _received(self, topic: str, use: Callable[[Any, NodeConfig], str], message: Any) -> None:
        try:
            problem = use(message, self._settings())
        except InputError as error:
            problem = f'it is ignored: {error}'
        now = time.monotonic()
        if problem and now - self._warned.get(topic, -WARNING_PERIOD) >= WARNING_PERIOD:
            self._warned[topic] = now
            self._node.get_logger().warning(f'{topic}: {problem}')

    def _act(self, action: Callable[..., Any], nbytes: int, **arguments: Any) -> None:
        self._stepper.act(partial(action, **arguments), nbytes)

    # ---------------------------------------------------------------------- one for each topic
    # Each returns a warning, or ''.
    def _obstacles(self, message: MarkerArray, settings: NodeConfig) -> str:
        changes, problems = message_parsing.obstacle_changes(
            message,
            settings.frame_id,
            self._world.config.time_step,
            self._stepper.time_scale,
        )
        if changes:
            before = self._world.external_inputs.dynamic_obstacles
            poses = sum(_is_new(change, before) for change in changes)
            self._act(
                World.change_obstacles,
                BYTES_PER_MARKER * len(changes) + BYTES_PER_POSE * poses,
                changes=tuple(changes),
                longest_gap=settings.input_timeout,
            )
        present = self._world.external_inputs.dynamic_obstacles
        full = len(present) >= MOST_DYNAMIC_OBSTACLES and not self._stepper.replaying
        if full and any(isinstance(c, ObstacleUpdate) and c.key not in present for c in changes):
            problems.append(
                f'there are {MOST_DYNAMIC_OBSTACLES} obstacles already, which is the most: '
                'DELETE some'
            )
        more = f' (and {len(problems) - 1} more like this)' if len(problems) > 1 else ''
        return problems[0] + more if problems else ''

    def _points(self, message: PointCloud2, settings: NodeConfig) -> str:
        radius = settings.obstacle_points_radius
        points, seen = message_parsing.point_obstacles(message, settings.frame_id, radius)
        self._act(World.set_points, BYTES_PER_ACTION + points.points.nbytes, points=points)
        if len(points) == seen:
            return ''
        return (
            f'{seen} points are thinned to {len(points)}: send fewer, or a larger '
            f'obstacle_points.radius (now {radius:g} m) keeps fewer'
        )

    def _wrench(self, message: WrenchStamped, settings: NodeConfig) -> str:
        wrench = message_parsing.wrench(message, settings.frame_id, self._world.names)
        self._act(
            World.apply_wrench,
            BYTES_PER_ACTION,
            name=wrench.name,
            force=wrench.force,
            torque=wrench.torque,
            seconds=settings.input_timeout,
            in_body_axes=wrench.name is not None,
        )
        return ''

    def _poke(self, message: PointStamped, settings: NodeConfig) -> str:
        point = message_parsing.poked_point(message, settings.frame_id)
        if not self._stepper.replaying:
            name, distance = self._world.nearest(point)
            if distance >= settings.poke_radius:
                return (
                    f'nothing is within {settings.poke_radius:g} m: the nearest vertex is '
                    f'{distance:.3g} m away, on {name}; poke there or raise poke.radius'
                )
        self._act(
            World.poke,
            BYTES_PER_ACTION,
            point=point,
            impulse=settings.poke_impulse,
            radius=settings.poke_radius,
        )
        return ''

    def _gravity(self, message: Vector3Stamped, settings: NodeConfig) -> str:
        gravity = message_parsing.gravity(message, settings.frame_id)
        self._act(
            World.override_gravity,
            BYTES_PER_ACTION,
            gravity=gravity,
            seconds=settings.input_timeout,
        )
        return ''

    # ------------------------------------------------------------------------------ diagnostics
    @property
    def gravity_source(self) -> str:
        """Source of the present gravity."""
        return 'parameters' if self._world.external_inputs.gravity is None else '~/gravity'

    def report(self) -> dict[str, str]:
        """Return the external inputs in force, for the diagnostics."""
        inputs, source = self._world.external_inputs, self.gravity_source
        if inputs.gravity is not None:
            ticks = inputs.gravity_ends_at - self._world.tick
            source += f', {ticks * self._world.config.time_step:.2f} s left'
        vector = ', '.join(f'{value:.4g}' for value in self._world.gravity + 0.0)
        return {
            'gravity (m/s²)': f'[{vector}]',
            'gravity source': source,
            'received obstacles': str(len(inputs.dynamic_obstacles)),
            'received obstacle points': str(len(inputs.points)),
            'received wrenches': str(len(inputs.wrenches)),
        }


def _is_new(
    change: ObstacleUpdate | ObstacleRemoval, present: Mapping[Key, DynamicObstacle]
) -> bool:
    """Whether a change adds an obstacle or gives one another pose."""
    if isinstance(change, ObstacleRemoval):
        return False
    before = present.get(change.key)
    return before is None or before.obstacle.config is not change.config
