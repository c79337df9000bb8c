# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Topics of the forces of contacts on bodies and obstacles: means since the last message."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from rclpy.publisher import Publisher

from softbody_ros.core import MeanWrenches, World
from softbody_ros.core.contact_forces import (
    ContactWrench,
    Departure,
    ObstacleKey,
    name_of_obstacle,
)
from softbody_ros.core.external_inputs import (
    MOST_DYNAMIC_OBSTACLES,
    DynamicObstacle,
    Key,
    is_link,
)
from softbody_ros.ros import interfaces, messages
from softbody_ros.ros.interfaces import Topic
from softbody_ros.ros.publishers import Publishers
from softbody_ros.scene.robot import Link

IDENTITY = np.eye(3)
NOTHING = np.zeros(3), np.zeros(3)


class ContactTopics:
    """
    Publishes the wrenches of contacts, of those that somebody listens to.

    `~/contacts/<body>` is about the centre of mass, in the axes of the world; so is
    `~/pins/<body>`, by which pins, or an obstacle that it is attached to, hold a body;
    `~/obstacle_contacts/<obstacle>` is about the origin of the obstacle, in its axes, as a sensor
    between a hand and its finger measures it. `~/contacts`, `~/pins` and `~/obstacle_contacts`
    have all, the last one also links of a robot, each as a whole in its own frame, and markers and
    points of others. Each output has one message, the mean since the one before; none without
    force, but one of zeros when it has ended. What has come since is no exception: before, it felt
    nothing; nor what has gone, which has one before that of zeros. The first message of what
    nobody listened to at the output before is of the last tick.

    Parameters
    ----------
    world : World
    publishers : Publishers

    """

    def __init__(self, world: World, publishers: Publishers) -> None:
        self._world, self._publishers, self._means = world, publishers, MeanWrenches(world)
        # no name is that of a body and of an obstacle; of pins: with their topic
        self._was_in_contact: dict[ObstacleKey | tuple[str, str], bool] = {}
        # of those that were there at the last output: nobody listened
        self._unheard: set[ObstacleKey | tuple[str, str]] = set()
        # of the obstacles and links at the last output
        self._frame_ids: dict[ObstacleKey, str] = {}
        self._body: dict[str, Publisher] = {}
        self._pin: dict[str, Publisher] = {}
        self._obstacle: dict[str, Publisher] = {}
        self._link: dict[str, Publisher] = {}
        self._links: tuple[Link, ...] = ()
        self._bodies = publishers.for_each(interfaces.CONTACTS, len(world.names))
        self._pins = publishers.for_each(interfaces.PINS, len(world.names))
        # twice: not to be made anew for each that is added
        most = 2 * self._most_obstacles
        self._obstacles = publishers.for_each(interfaces.OBSTACLE_CONTACTS, most)
        self.update()

    @property
    def _most_obstacles(self) -> int:
        """How many obstacles there can be, with those of others, links and points."""
        return len(self._world.config.obstacles) + MOST_DYNAMIC_OBSTACLES + 1

    def update(self) -> None:
        """Have topics for the bodies and obstacles that there are now."""
        names = self._world.names
        if len(names) != len(self._body) or any(name not in self._body for name in names):
            self._bodies = self._publishers.deepened(self._bodies, interfaces.CONTACTS, len(names))
            self._pins = self._publishers.deepened(self._pins, interfaces.PINS, len(names))
            self._renew(self._body, interfaces.CONTACTS, names)
            self._renew(self._pin, interfaces.PINS, names)
        obstacles = self._world.config.obstacles
        if len(obstacles) != len(self._obstacle) or any(
            obstacle.name not in self._obstacle for obstacle in obstacles
        ):
            self._obstacles = self._publishers.deepened(
                self._obstacles, interfaces.OBSTACLE_CONTACTS, self._most_obstacles
            )
            self._renew(
                self._obstacle,
                interfaces.OBSTACLE_CONTACTS,
                [obstacle.name for obstacle in obstacles],
            )

    def _renew(self, own: dict[str, Publisher], topic: Topic, names: Sequence[str]) -> None:
        for name in own.keys() - set(names):
            self._publishers.destroy(own.pop(name))
            if topic is not interfaces.OBSTACLE_CONTACTS:  # of these see _end_gone
                for key in (name, ('pins', name)):
                    self._was_in_contact.pop(key, None)
                    self._unheard.discard(key)
                self._means.forget(name)
        for name in names:
            if name not in own:
                own[name] = self._publishers.make(topic, of=name)

    def use_links(self, links: Sequence[Link]) -> None:
        """Have topics for other links of a robot."""
        self._renew(self._link, interfaces.OBSTACLE_CONTACTS, [link.name for link in links])
        kept = {key for link in links for key in link.keys}
        for key in {key for link in self._links for key in link.keys} - kept:
            self._means.forget(key)
        self._links = tuple(links)

    def _publish_links(self, stamp: int, frame_ids: dict[ObstacleKey, str]) -> None:
        """Publish, for each link, the sum over its shapes, in the frame of the link."""
        world, means, every = self._world, self._means, _heard(self._obstacles)
        present = world.external_inputs.dynamic_obstacles
        for link in self._links:
            if not all(key in present for key in link.keys):
                continue  # it is not there yet, or time went back
            _, rotation = link.pose(present[link.keys[0]].obstacle)
            listeners = every + _heard(self._link[link.name])
            key = link.keys[0][0], -1
            frame_ids[key] = link.link
            wrench = self._due(
                key,
                key,
                listeners,
                partial(_link_wrench, link, present, means.obstacle_wrench),
                partial(_link_wrench, link, present, world.obstacle_wrench),
            )
            _send(listeners, stamp, link.link, rotation, wrench)

    def publish(self, stamp: int, frame_id: str) -> None:
        """Publish what is listened to; `frame_id` is that of the world, `stamp` in ns."""
        self.update()
        world, means = self._world, self._means
        departed = means.departed()
        every, every_pin = _heard(self._bodies), _heard(self._pins)
        for name in world.names:
            listeners = every + _heard(self._body[name])
            wrench = self._due(name, name, listeners, means.contact_wrench, world.contact_wrench)
            _send(listeners, stamp, frame_id, IDENTITY, wrench)
            listeners = every_pin + _heard(self._pin[name])
            pins = 'pins', name
            wrench = self._due(pins, name, listeners, means.pin_wrench, world.pin_wrench)
            _send(listeners, stamp, frame_id, IDENTITY, wrench)
        every = _heard(self._obstacles)
        frame_ids: dict[ObstacleKey, str] = {}
        for key, obstacle in zip(world.obstacle_keys, (*world.obstacles, None), strict=True):
            if is_link(key):
                continue
            # points, the last of all, are in the frame of the world
            frame = frame_id if key is None else name_of_obstacle(key)
            frame_ids[key] = frame
            rotation = IDENTITY if obstacle is None else obstacle.rotation
            listeners = every + (_heard(self._obstacle[key]) if key in self._obstacle else [])
            wrench = self._due(key, key, listeners, means.obstacle_wrench, world.obstacle_wrench)
            _send(listeners, stamp, frame, rotation, wrench)
        self._publish_links(stamp, frame_ids)
        self._end_gone(stamp, every, frame_ids, departed)
        means.begin_period()

    def _end_gone(
        self,
        stamp: int,
        listeners: list[Publisher],
        frame_ids: dict[ObstacleKey, str],
        departed: Sequence[tuple[Departure, ContactWrench]],
    ) -> None:
        """
        Publish what obstacles felt until they went, then that they feel nothing, and forget them.

        Not of links: these go with their robot.
        """
        before, self._frame_ids = self._frame_ids, frame_ids
        for gone, (force, torque) in departed:
            key = gone.key
            if is_link(key) or key in self._unheard or not (force.any() or torque.any()):
                continue
            frame = before.get(key, name_of_obstacle(key))
            _send(listeners, stamp, frame, gone.obstacle.rotation, (force, torque))
            if key not in frame_ids and listeners:  # that it has ended is said at the next output
                frame_ids[key], self._was_in_contact[key] = frame, True
        for key, frame_id in before.items():
            if key not in frame_ids:
                self._means.forget(key)
                self._unheard.discard(key)
                if self._was_in_contact.pop(key, False):
                    _send(listeners, stamp, frame_id, IDENTITY, NOTHING)

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
            self._unheard.add(key)
            return None
        since_last = mean(name)
        force, torque = last(name) if key in self._unheard else since_last
        self._unheard.discard(key)
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
