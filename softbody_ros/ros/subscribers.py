# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Subscribers: received messages become actions on the stepper, parsed by `message_parsing`.

All actions are recorded in the history: after /clock went back they repeat at the same ticks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
import time
from typing import Any

from geometry_msgs.msg import PointStamped, Vector3Stamped, WrenchStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from softbody_ros.core import World
from softbody_ros.core.external_inputs import (
    MOST_DYNAMIC_OBSTACLES,
    DynamicObstacle,
    Key,
    ObstacleRemoval,
    ObstacleUpdate,
    is_link,
)
from softbody_ros.ros import interfaces, message_parsing
from softbody_ros.ros.frames import Frames
from softbody_ros.ros.interfaces import Topic
from softbody_ros.ros.message_parsing import InputError
from softbody_ros.ros.polling import NeverReady, taken
from softbody_ros.ros.qos import qos_of
from softbody_ros.scene.parameters import NodeConfig
from softbody_ros.timeline.stepper import Stepper

WARNING_PERIOD = 5.0
"""Seconds between two warnings about the same topic."""
BYTES_PER_ACTION = 1000
BYTES_PER_MARKER, BYTES_PER_POSE = 400, 1000
"""Approximate memory of an action in the history; an unchanged marker shares its pose."""
# it also receives from reliable publishers
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
REMEMBERED = 100
"""Messages of a topic that are recognised when another subscription receives them, too."""


class InputTopics:
    """
    Subscribes to the input topics, and applies the messages to the world.

    A subscription hears publishers of some qualities of service only. So topics that have a best
    effort publisher, or one that keeps its messages for later subscribers, get further
    subscriptions when it is found, see `hear_everyone`. What two of them receive acts once.

    Parameters
    ----------
    node : Node
    stepper : Stepper
    settings : callable
        returns the present NodeConfig
    frames : Frames
        where other frames are

    """

    def __init__(
        self,
        node: Node,
        stepper: Stepper,
        settings: Callable[[], NodeConfig],
        frames: Frames,
    ) -> None:
        self._frames = frames
        self._node = node
        self._stepper = stepper
        self._settings = settings
        self._warned: dict[str, float] = {}
        self._polled: list[tuple[_Topic, Subscription]] = []
        self._topics: list[_Topic] = []
        self.listen(interfaces.OBSTACLES, self._obstacles)
        self.listen(interfaces.OBSTACLE_POINTS, self._points)
        self.listen(interfaces.APPLIED_WRENCH, self._wrench)
        self.listen(interfaces.POKE, self._poke)
        self.listen(interfaces.GRAVITY, self._gravity)

    def listen(
        self, interface: Topic, use: Callable[[Any, NodeConfig], str], polled: bool = False
    ) -> None:
        """
        Listen to a topic.

        Parameters
        ----------
        interface : Topic
        use : callable
            uses a message, with the present NodeConfig, and returns a warning or ''
        polled : bool
            whether they are taken by `poll` only, and wake nobody

        """
        topic = _Topic(interface, use, group=NeverReady() if polled else None)
        self._topics.append(topic)
        self._subscribe(topic, qos_of(interface, latched=False))
        if interface.latched:
            self._subscribe(topic, LATCHED)

    def _subscribe(self, topic: _Topic, qos: QoSProfile) -> None:
        received = partial(self._received, topic)
        subscription = self._node.create_subscription(
            topic.interface.kind, topic.name, received, qos, callback_group=topic.group
        )
        if topic.group is not None:
            self._polled.append((topic, subscription))
        topic.full_name = subscription.topic_name
        topic.heard.append(qos)

    def poll(self) -> None:
        """Use what has come to the topics that wake nobody."""
        for topic, subscription in self._polled:
            for message, info in taken(subscription):
                self._received(topic, message, info)

    def hear_everyone(self) -> None:
        """Subscribe as the publishers that are there now need it, and say what cannot be heard."""
        for topic in self._topics:
            for publisher in self._node.get_publishers_info_by_topic(topic.full_name):
                wanted = topic.interface.type
                if publisher.topic_type != wanted:
                    self._warn(
                        topic.name,
                        f'{publisher.node_name} publishes {publisher.topic_type} there, which '
                        f'is not heard: send {wanted}',
                    )
                    continue
                qos, needed = publisher.qos_profile, topic.heard[0]
                if qos.reliability == ReliabilityPolicy.BEST_EFFORT:
                    needed = BEST_EFFORT if topic.interface.reliable else needed
                elif qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                    needed = LATCHED
                if needed not in topic.heard:
                    self._subscribe(topic, needed)

    @property
    def _world(self) -> World:
        return self._stepper.world

    def _received(self, topic: _Topic, message: Any, info: Mapping[str, int]) -> None:
        if topic.is_known(info):
            return
        try:
            self._frames.transform(message, self._world.names)
            problem = topic.use(message, self._settings())
        except InputError as error:
            problem = f'it is ignored: {error}'
        if problem:
            self._warn(topic.name, problem)

    def warn(self, topic: str, problem: str) -> None:
        """Say something about a topic, however soon after something else."""
        self._node.get_logger().warning(f'{topic}: {problem}')

    def _warn(self, topic: str, problem: str) -> None:
        now = time.monotonic()
        if now - self._warned.get(topic, -WARNING_PERIOD) >= WARNING_PERIOD:
            self._warned[topic] = now
            self.warn(topic, problem)

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
        pose = self._frames.pose_of(message.header)
        points, seen = message_parsing.point_obstacles(
            message, settings.frame_id, radius, pose and pose[:2]
        )
        self._act(
            World.set_points,
            BYTES_PER_ACTION + points.points.nbytes,
            points=points,
            self_filter=settings.self_filter,
            noise=settings.obstacle_points_noise,
        )
        if len(points) == seen:
            return ''
        return (
            f'{seen} points are thinned to {len(points)}: send fewer, or a larger '
            f'obstacle_points.radius (now {radius:g} m) keeps fewer'
        )

    def _wrench(self, message: WrenchStamped, settings: NodeConfig) -> str:
        names = [body.name for body in self._stepper.config.bodies]
        wrench = message_parsing.wrench(message, settings.frame_id, names)
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
            if not name:
                return 'there is no body'
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
            'received obstacles': str(sum(not is_link(key) for key in inputs.dynamic_obstacles)),
            'received obstacle points': str(len(inputs.points)),
            'ignored obstacle points, on bodies': str(inputs.points.ignored),
            'received wrenches': str(len(inputs.wrenches)),
        }


@dataclass
class _Topic:
    """A topic, what uses its messages, and how it is subscribed to."""

    interface: Topic
    use: Callable[[Any, NodeConfig], str]
    full_name: str = ''
    heard: list[QoSProfile] = field(default_factory=list)
    group: CallbackGroup | None = None
    known: deque[tuple[int, int]] = field(default_factory=partial(deque, maxlen=REMEMBERED))

    @property
    def name(self) -> str:
        """Its name in sentences."""
        return self.interface.name

    def is_known(self, info: Mapping[str, int]) -> bool:
        """Return whether another subscription has received a message already."""
        key = info['source_timestamp'], info['publication_sequence_number'] or 0
        if key in self.known:
            return True
        if key[0] > 0:  # else the middleware does not say
            self.known.append(key)
        return False


def _is_new(
    change: ObstacleUpdate | ObstacleRemoval, present: Mapping[Key, DynamicObstacle]
) -> bool:
    """Whether a change adds an obstacle or gives one another pose."""
    if isinstance(change, ObstacleRemoval):
        return False
    before = present.get(change.key)
    return before is None or before.obstacle.config is not change.config
