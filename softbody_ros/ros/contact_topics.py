# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Topics of the forces of contacts on bodies and obstacles: means since the last message."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.publisher import Publisher

from softbody_ros.core import MeanWrenches, World
from softbody_ros.core.contact_forces import ContactWrench, ObstacleKey
from softbody_ros.core.external_inputs import DynamicObstacle, Key, is_link
from softbody_ros.ros import messages
from softbody_ros.scene.robot import Link

IDENTITY = np.eye(3)


class ContactTopics:
    """
    Publishes the wrenches of contacts, of those that somebody listens to.

    `~/contacts/<body>` is about the centre of mass, in the axes of the world;
    `~/obstacle_contacts/<obstacle>` about the origin of the obstacle, in its axes, as a sensor
    between a hand and its finger measures it. `~/contacts` and `~/obstacle_contacts` have all,
    the latter also links of a robot, each as a whole in its own frame, and markers and points of
    others. Each output has one message, the mean since the one before; none without contact, but
    one of zeros when it has ended. The first one to a new listener is of the last tick.

    Parameters
    ----------
    world : World
    publisher : callable
        returns a publisher of messages of a type on a topic, with a queue of some depth

    """

    def __init__(self, world: World, publisher: Callable[[type, str, int], Publisher]) -> None:
        self._world, self._means = world, MeanWrenches(world)
        self._publisher = publisher
        self._links: tuple[Link, ...] = ()
        self._link: dict[str, Publisher] = {}
        # no name is that of a body and of an obstacle
        self._was_in_contact: dict[ObstacleKey, bool] = {}
        names = [obstacle.config.name for obstacle in world.obstacles]

        def all_and_own(topic: str, names: list[str]) -> tuple[Publisher, dict[str, Publisher]]:
            # one message for each of them, and for links: a shallower queue would drop some
            every = publisher(WrenchStamped, topic, max(100, 2 * len(names)))
            return every, {name: publisher(WrenchStamped, f'{topic}/{name}', 10) for name in names}

        self._bodies, self._body = all_and_own('~/contacts', list(world.names))
        self._obstacles, self._obstacle = all_and_own('~/obstacle_contacts', names)

    def use_links(self, links: Sequence[Link], destroy: Callable[[Publisher], object]) -> None:
        """Publish the wrenches on other links of a robot; `destroy` ends a publisher."""
        kept = {link.name for link in links}
        for name in self._link.keys() - kept:
            destroy(self._link.pop(name))
        for link in links:
            if link.name not in self._link:
                topic = f'~/obstacle_contacts/{link.name}'
                self._link[link.name] = self._publisher(WrenchStamped, topic, 10)
        self._links = tuple(links)

    def _publish_links(self, stamp: int) -> None:
        """Publish, for each link, the sum over its shapes, in the frame of the link."""
        world, means, every = self._world, self._means, _heard(self._obstacles)
        present = world.external_inputs.dynamic_obstacles
        for link in self._links:
            if not all(key in present for key in link.keys):
                continue  # it is not there yet, or time went back
            _, rotation = link.pose(present[link.keys[0]].obstacle)
            listeners = every + _heard(self._link[link.name])
            wrench = self._due(
                (link.keys[0][0], -1),
                listeners,
                partial(_link_wrench, link, present, means.obstacle_wrench),
                partial(_link_wrench, link, present, world.obstacle_wrench),
            )
            _send(listeners, stamp, link.link, rotation, wrench)

    def publish(self, stamp: int, frame_id: str) -> None:
        """Publish what is listened to; `frame_id` is that of the world, `stamp` in ns."""
        world, means, every = self._world, self._means, _heard(self._bodies)
        for name, own in self._body.items():
            listeners = every + _heard(own)
            wrench = self._due(name, listeners, means.contact_wrench, world.contact_wrench)
            _send(listeners, stamp, frame_id, IDENTITY, wrench)
        every = _heard(self._obstacles)
        for key, obstacle in zip(world.obstacle_keys, (*world.obstacles, None), strict=True):
            if is_link(key):
                continue
            # points, the last of all, are in the frame of the world
            frame = key if isinstance(key, str) else frame_id
            if isinstance(key, tuple):
                frame = f'{key[0]}/{key[1]}'
            rotation = IDENTITY if obstacle is None else obstacle.rotation
            listeners = every + (_heard(self._obstacle[key]) if key in self._obstacle else [])
            wrench = self._due(key, listeners, means.obstacle_wrench, world.obstacle_wrench)
            _send(listeners, stamp, frame, rotation, wrench)
        self._publish_links(stamp)

    def _due(
        self,
        key: ObstacleKey,
        listeners: list[Publisher],
        mean: Callable[[Any], ContactWrench],
        last: Callable[[Any], ContactWrench],
    ) -> ContactWrench | None:
        """Return the wrench of a body or an obstacle that is to be published, if there is one."""
        if not listeners:
            self._was_in_contact.pop(key, None)
            return None
        since_last = mean(key)
        force, torque = since_last if key in self._was_in_contact else last(key)
        was_in_contact = self._was_in_contact.get(key, False)
        self._was_in_contact[key] = bool(force.any() or torque.any())
        return (force, torque) if was_in_contact or self._was_in_contact[key] else None


def _link_wrench(
    link: Link,
    present: Mapping[Key, DynamicObstacle],
    wrench_of: Callable[[Key], ContactWrench],
    _: object,
) -> ContactWrench:
    return link.wrench(present, wrench_of)


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
