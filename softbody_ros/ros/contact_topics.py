# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Topics of the forces of contacts on bodies and obstacles: means since the last message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.publisher import Publisher

from softbody_ros.core import MeanWrenches, World
from softbody_ros.core.contact_forces import ContactWrench, ObstacleKey
from softbody_ros.ros import messages

IDENTITY = np.eye(3)


class ContactTopics:
    """
    Publishes the wrenches of contacts, of those that somebody listens to.

    `~/contacts/<body>` is about the centre of mass, in the axes of the world; so is
    `~/pins/<body>`, by which pins, or an obstacle that it is attached to, hold a body;
    `~/obstacle_contacts/<obstacle>` is about the origin of the obstacle, in its axes, as a sensor
    between a hand and its finger measures it. `~/contacts`, `~/pins` and `~/obstacle_contacts`
    have all, the last one also markers and points of others. Each output has one message, the mean
    since the one before; none without force, but one of zeros when it has ended. The first one to
    a new listener is of the last tick.

    Parameters
    ----------
    world : World
    publisher : callable
        returns a publisher of messages of a type on a topic, with a queue of some depth

    """

    def __init__(self, world: World, publisher: Callable[[type, str, int], Publisher]) -> None:
        self._world, self._means = world, MeanWrenches(world)
        # no name is that of a body and of an obstacle; of pins: with their topic
        self._was_in_contact: dict[ObstacleKey | tuple[str, str], bool] = {}
        names = [obstacle.config.name for obstacle in world.obstacles]

        def all_and_own(topic: str, names: list[str]) -> tuple[Publisher, dict[str, Publisher]]:
            # one message for each of them: a shallower queue would drop some
            every = publisher(WrenchStamped, topic, max(10, 2 * len(names)))
            return every, {name: publisher(WrenchStamped, f'{topic}/{name}', 10) for name in names}

        self._bodies, self._body = all_and_own('~/contacts', list(world.names))
        self._pins, self._pin = all_and_own('~/pins', list(world.names))
        self._obstacles, self._obstacle = all_and_own('~/obstacle_contacts', names)

    def publish(self, stamp: int, frame_id: str) -> None:
        """Publish what is listened to; `frame_id` is that of the world, `stamp` in ns."""
        world, means = self._world, self._means
        every, every_pin = _heard(self._bodies), _heard(self._pins)
        for name, own in self._body.items():
            listeners = every + _heard(own)
            wrench = self._due(name, name, listeners, means.contact_wrench, world.contact_wrench)
            _send(listeners, stamp, frame_id, IDENTITY, wrench)
            listeners = every_pin + _heard(self._pin[name])
            pins = 'pins', name
            wrench = self._due(pins, name, listeners, means.pin_wrench, world.pin_wrench)
            _send(listeners, stamp, frame_id, IDENTITY, wrench)
        every = _heard(self._obstacles)
        for key, obstacle in zip(world.obstacle_keys, (*world.obstacles, None), strict=True):
            # points, the last of all, are in the frame of the world
            frame = key if isinstance(key, str) else frame_id
            if isinstance(key, tuple):
                frame = f'{key[0]}/{key[1]}'
            rotation = IDENTITY if obstacle is None else obstacle.rotation
            listeners = every + (_heard(self._obstacle[key]) if key in self._obstacle else [])
            wrench = self._due(key, key, listeners, means.obstacle_wrench, world.obstacle_wrench)
            _send(listeners, stamp, frame, rotation, wrench)

    def _due(
        self,
        key: ObstacleKey | tuple[str, str],
        name: ObstacleKey,
        listeners: list[Publisher],
        mean: Callable[[Any], ContactWrench],
        last: Callable[[Any], ContactWrench],
    ) -> ContactWrench | None:
        """Return the wrench of a body or an obstacle that is to be published, if there is one."""
        if not listeners:
            self._was_in_contact.pop(key, None)
            return None
        since_last = mean(name)
        force, torque = since_last if key in self._was_in_contact else last(name)
        was_in_contact = self._was_in_contact.get(key, False)
        self._was_in_contact[key] = bool(force.any() or torque.any())
        return (force, torque) if was_in_contact or self._was_in_contact[key] else None


def _heard(publisher: Publisher) -> list[Publisher]:
    """Return a list of a publisher if somebody listens to it, else an empty one."""
    return [publisher] if publisher.get_subscription_count() else []


def _send(
    publishers: list[Publisher],
    stamp: int,
    frame_id: str,
    rotation: np.ndarray,
    wrench: ContactWrench | None,
) -> None:
    """Publish a wrench in axes of the world, if there is one, in a frame that is turned."""
    if wrench is None:
        return
    force, torque = wrench
    message = messages.wrench(stamp, frame_id, force @ rotation, torque @ rotation)
    for publisher in publishers:
        publisher.publish(message)
