# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Topics of the forces of contacts on bodies and obstacles: means since the last message."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from functools import partial
from typing import NamedTuple

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.publisher import Publisher

from softbody_ros.core import MeanWrenches, World
from softbody_ros.core.contact_forces import ContactWrench
from softbody_ros.ros import messages

IDENTITY = np.eye(3)


class ContactTopics:
    """
    Publishes the wrenches of contacts, of those that somebody listens to.

    `~/contacts/<body>` is about the centre of mass, in the axes of the world;
    `~/obstacle_contacts/<obstacle>` about the origin of the obstacle, in its axes, as a sensor
    between a hand and its finger measures it. `~/contacts` and `~/obstacle_contacts` have all,
    the latter also markers and points of others. Each output has one message, the mean since the
    one before; none without contact, but one of zeros when it has ended. The first one to a new
    listener is of the last tick.

    Parameters
    ----------
    world : World
    publisher : callable
        returns a publisher of messages of a type on a topic, with a queue of some depth

    """

    def __init__(self, world: World, publisher: Callable[[type, str, int], Publisher]) -> None:
        self._world, self._means = world, MeanWrenches(world)
        self._was_in_contact: dict[Hashable, bool] = {}
        names = [obstacle.config.name for obstacle in world.obstacles]

        def all_and_own(topic: str, names: list[str]) -> tuple[Publisher, dict[str, Publisher]]:
            # one message for each of them: a shallower queue would drop some
            every = publisher(WrenchStamped, topic, max(10, 2 * len(names)))
            return every, {name: publisher(WrenchStamped, f'{topic}/{name}', 10) for name in names}

        self._bodies, self._body = all_and_own('~/contacts', list(world.names))
        self._obstacles, self._obstacle = all_and_own('~/obstacle_contacts', names)

    def publish(self, stamp: int, frame_id: str) -> None:
        """Publish what is listened to; `frame_id` is that of the world, `stamp` in ns."""
        world, means = self._world, self._means
        own: Publisher | None
        for name, own in self._body.items():
            wrenches = partial(means.contact_wrench, name), partial(world.contact_wrench, name)
            for wrench in self._heard(('body', name), (self._bodies, own), *wrenches):
                wrench.send(stamp, frame_id, IDENTITY)
        for key, obstacle in zip(world.obstacle_keys, (*world.obstacles, None), strict=True):
            own, frame = None, frame_id
            if isinstance(key, str):
                own, frame = self._obstacle.get(key), key
            elif key is not None:
                frame = f'{key[0]}/{key[1]}'
            wrenches = partial(means.obstacle_wrench, key), partial(world.obstacle_wrench, key)
            for wrench in self._heard(('obstacle', key), (self._obstacles, own), *wrenches):
                # points, the last of all, are in the frame of the world
                wrench.send(stamp, frame, IDENTITY if obstacle is None else obstacle.rotation)

    def _heard(
        self,
        key: Hashable,
        publishers: tuple[Publisher, Publisher | None],
        mean: Callable[[], ContactWrench],
        last: Callable[[], ContactWrench],
    ) -> Iterator[_Wrench]:
        """Yield the wrench of a body or an obstacle, if there is one to publish."""
        listened = [one for one in publishers if one is not None and one.get_subscription_count()]
        if not listened:
            self._was_in_contact.pop(key, None)
            return
        since_last = mean()
        force, torque = since_last if key in self._was_in_contact else last()
        was_in_contact = self._was_in_contact.get(key, False)
        self._was_in_contact[key] = bool(force.any() or torque.any())
        if was_in_contact or self._was_in_contact[key]:
            yield _Wrench(listened, force, torque)


class _Wrench(NamedTuple):
    """A force, N, and a torque, N m, in axes of the world, and where to publish them."""

    publishers: list[Publisher]
    force: np.ndarray
    torque: np.ndarray

    def send(self, stamp: int, frame_id: str, rotation: np.ndarray) -> None:
        """Publish it in a frame that is turned by a rotation."""
        message = messages.wrench(stamp, frame_id, self.force @ rotation, self.torque @ rotation)
        for publisher in self.publishers:
            publisher.publish(message)
