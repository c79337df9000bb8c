# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Publisher of ~/obstacle_markers: `World.obstacles` as markers."""

from __future__ import annotations

from collections.abc import Mapping
import operator

import numpy as np
from rclpy.event_handler import QoSPublisherMatchedInfo
from rclpy.node import Node

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.external_inputs import ROBOT
from softbody_ros.ros import interfaces, messages
from softbody_ros.ros.messages import ShownObstacle
from softbody_ros.ros.publishers import create_publisher
from softbody_ros.timeline.stepper import Stepper

PLANE_COLOR, COLOR, RECEIVED_COLOR = (
    (0.78, 0.78, 0.76, 1.0),
    (0.58, 0.60, 0.62, 1.0),
    (0.45, 0.58, 0.70, 1.0),
)

LINKS, OTHERS = 'robot/', 'others/'
"""What namespaces of links and of received obstacles begin with: names have no slash."""

Shown = Mapping[tuple[str, int], Obstacle]
"""Obstacles by the `ns` and `id` of their markers."""


class ObstacleMarkers:
    """
    Publishes the obstacles of the scene and those received, in one latched message.

    Changes are published at once, motion at the rate of the outputs. Without subscribers nothing
    is packed; a new subscriber gets the present state.

    Parameters
    ----------
    node : Node
    stepper : Stepper
    frame_id : str

    """

    def __init__(self, node: Node, stepper: Stepper, frame_id: str) -> None:
        self._stepper = stepper
        self._frame_id = frame_id
        self._shown: Shown = {}
        self._new_subscriber = False
        self._publisher = create_publisher(node, interfaces.OBSTACLE_MARKERS, self._on_match)
        self._publish(self._present())

    def update(self, due: bool) -> None:
        """
        Publish the obstacles if they differ from those published last.

        Parameters
        ----------
        due : bool
            whether mere motion is to be published too

        """
        if self._stepper.replaying or not self._publisher.get_subscription_count():
            return
        due, self._new_subscriber = due or self._new_subscriber, False
        obstacles, shown = self._stepper.world.obstacles, self._shown
        if len(obstacles) == len(shown) and all(map(operator.is_, obstacles, shown.values())):
            return
        present = self._present()
        if present.keys() != shown.keys():
            self._publish(present)
            return
        pairs = [(obstacle, shown[key]) for key, obstacle in present.items()]
        if due or any(_has_changed(key, now, shown[key]) for key, now in present.items()):
            if not all(_alike(now, before) for now, before in pairs):
                self._publish(present)
            self._shown = present

    def _present(self) -> Shown:
        world = self._stepper.world
        scene = world.obstacles[: len(world.config.obstacles)]
        shown = {(obstacle.config.name, 0): obstacle for obstacle in scene}
        # names of the scene contain no slash
        for (namespace, number), received in world.external_inputs.dynamic_obstacles.items():
            link = namespace.removeprefix(ROBOT)
            of = f'{OTHERS}{namespace}' if link == namespace else f'{LINKS}{link}'
            shown[of, number] = received.obstacle
        return shown

    def _publish(self, shown: Shown) -> None:
        world = self._stepper.world
        names = {config.name for config in world.config.obstacles}
        self._shown = shown
        self._publisher.publish(
            messages.serialized_obstacles(
                self._stepper.time_of(world.tick),
                self._frame_id,
                [
                    ShownObstacle(*key, _color(obstacle, key[0] in names), obstacle)
                    for key, obstacle in shown.items()
                ],
            )
        )

    def _on_match(self, info: QoSPublisherMatchedInfo) -> None:
        """Let the next update publish the motion since the last message to a new subscriber."""
        if info.current_count_change > 0:
            self._new_subscriber = True


def _has_changed(key: tuple[str, int], now: Obstacle, before: Obstacle) -> bool:
    """Whether an obstacle is shown at once; the velocities of links change all the time."""
    if key[0].startswith(LINKS):
        return now.shape is not before.shape
    return now.config != before.config


def _alike(one: Obstacle, other: Obstacle) -> bool:
    """Whether two obstacles look the same; usually they are one object."""
    return one is other or (
        (one.config.type, one.config.size) == (other.config.type, other.config.size)
        and one.tree is other.tree
        and np.array_equal(one.position, other.position)
        and np.array_equal(one.rotation, other.rotation)
    )


def _color(obstacle: Obstacle, of_scene: bool) -> tuple[float, ...]:
    if not of_scene:
        return RECEIVED_COLOR
    return PLANE_COLOR if obstacle.config.type == 'plane' else COLOR
