# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Forces of contacts on bodies and obstacles: what is heard of them, and where they act."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
import time
from typing import Any, NamedTuple

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker

from softbody_ros.ros.obstacle_markers import LINKS, OTHERS
from softbody_ros.ros.polling import subscribe, taken
from softbody_ros.viewer.decoding import Frame

MOST_BODIES = 100
"""Bodies whose forces are heard: each has a topic of its own."""
MOST_OBSTACLES = 500
"""Messages of all obstacles between two calls of `take`, at most."""
ALIKE = 0.05
"""Difference, relative to the larger one, up to which two forces are each other's reaction."""
HALF_LIFE = 0.7
"""Seconds in which the force that has the longest arrow is half forgotten."""
LEAST_SCALE = 0.02
"""The smallest force that may have the longest arrow, as a share of the largest one so far."""

Wrench = tuple[np.ndarray, np.ndarray]
"""Force (3,), N, and torque (3,), N m."""
Pose = tuple[np.ndarray, np.ndarray]
"""Position (3,), m, and rotation (3, 3)."""


class Force(NamedTuple):
    """A force (3,), N, that acts at a point (3,), m, on a body or on an obstacle."""

    point: np.ndarray
    force: np.ndarray
    on_body: bool


class ContactForces:
    """
    Listens to the forces of contacts, of those bodies that are asked for.

    Parameters
    ----------
    node : Node
    target : str
        name of the node that is observed

    """

    def __init__(self, node: Node, target: str) -> None:
        self._node, self._target = node, target
        self._bodies: dict[str, Subscription] = {}
        self._obstacles: Subscription | None = None
        self._on_body: dict[str, Wrench] = {}
        self._on_obstacle: dict[str, Wrench] = {}

    def listen(self, names: Iterable[str]) -> None:
        """Listen to the forces on these bodies, the first `MOST_BODIES`, and on obstacles."""
        wanted = list(names)[:MOST_BODIES]
        for name in self._bodies.keys() - set(wanted):
            self._node.destroy_subscription(self._bodies.pop(name))
            self._on_body.pop(name, None)
        for name in wanted:
            if name not in self._bodies:
                topic = f'{self._target}/contacts/{name}'
                self._bodies[name] = subscribe(self._node, WrenchStamped, topic, 10)
        if self._obstacles is None:
            topic = f'{self._target}/obstacle_contacts'
            self._obstacles = subscribe(self._node, WrenchStamped, topic, MOST_OBSTACLES)

    def stop(self) -> None:
        """Listen to nothing, and forget what has been heard."""
        for subscription in [*self._bodies.values(), self._obstacles]:
            if subscription is not None:
                self._node.destroy_subscription(subscription)
        self._bodies, self._obstacles = {}, None
        self._on_body, self._on_obstacle = {}, {}

    def take(self) -> bool:
        """Take what has come; return whether there was anything."""
        heard = False
        for name, subscription in self._bodies.items():
            wrenches = [wrench_of(message) for message, _ in taken(subscription)]
            if wrenches:
                self._on_body[name] = mean_of(wrenches)
                heard = True
        if self._obstacles is not None:
            of: dict[str, list[Wrench]] = {}
            for message, _ in taken(self._obstacles, MOST_OBSTACLES):
                of.setdefault(message.header.frame_id, []).append(wrench_of(message))
            for name, wrenches in of.items():
                self._on_obstacle[name] = mean_of(wrenches)
                heard = True
        return heard

    def present(
        self, frame: Frame, numbers: Mapping[str, int], poses: Mapping[str, Pose]
    ) -> list[Force]:
        """
        Return the forces that act.

        Parameters
        ----------
        frame : Frame
            of the particles
        numbers : mapping of str to int
            the numbers of bodies in it, by their names
        poses : mapping of str to Pose
            of obstacles, by the frames in which their wrenches are

        """
        acting = {
            name: force
            for name, (force, _) in self._on_body.items()
            if force.any() and name in numbers
        }
        forces = list(acting.values())
        points = centres_of_pressure(frame, [numbers[name] for name in acting])
        result = [Force(point, force, True) for point, force in zip(points, forces, strict=True)]
        pressed = frame.positions[frame.pressure > 0.0]
        for name, wrench in self._on_obstacle.items():
            if name not in poses or not wrench[0].any():
                continue  # it may have gone
            position, rotation = poses[name]
            force, torque = (rotation @ each for each in wrench)
            if not is_reaction(force, forces):
                point = where_it_arrives(position, force, torque, pressed)
                result.append(Force(point, force, False))
        return result


def wrench_of(message: WrenchStamped) -> Wrench:
    """Return the force and the torque of a message."""
    force, torque = message.wrench.force, message.wrench.torque
    return np.array([force.x, force.y, force.z]), np.array([torque.x, torque.y, torque.z])


def mean_of(wrenches: list[Wrench]) -> Wrench:
    """Return the mean of wrenches, each of which is one over as long a time."""
    # what is not finite is of nobody's use
    force, torque = np.nan_to_num(np.mean(wrenches, axis=0), posinf=0.0, neginf=0.0)
    return force, torque


def poses_of(markers: Iterable[Marker], world: str) -> dict[str, Pose]:
    """
    Return the poses of obstacles by the frames of their wrenches; of points that of the world.

    Those of the links of a robot are not in markers, which are of the shapes of links. Planes are
    left out: what many bodies do to the ground together has no place that says anything.
    """
    poses: dict[str, Pose] = {world: (np.zeros(3), np.eye(3))}
    for marker in markers:
        if marker.action != Marker.ADD or marker.ns.startswith(LINKS) or marker.text == 'plane':
            continue
        is_received = marker.ns.startswith(OTHERS)
        name = f'{marker.ns.removeprefix(OTHERS)}/{marker.id}' if is_received else marker.ns
        place, turn = marker.pose.position, marker.pose.orientation
        quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
        if quaternion.any():
            rotation = Rotation.from_quat(quaternion).as_matrix()
            poses[name] = np.array([place.x, place.y, place.z]), rotation
    return poses


def centres_of_pressure(frame: Frame, numbers: list[int]) -> list[np.ndarray]:
    """Return for each body the mean of its vertices weighted by pressure; without any, of all."""
    pressed = np.flatnonzero(frame.pressure > 0.0)
    body, pressure, places = frame.body[pressed], frame.pressure[pressed], frame.positions[pressed]
    points = []
    for number in numbers:
        mine = body == number
        if mine.any():
            points.append(np.average(places[mine], axis=0, weights=pressure[mine]))
        else:
            points.append(frame.positions[frame.body == number].mean(axis=0))
    return points


def is_reaction(force: np.ndarray, on_bodies: list[np.ndarray]) -> bool:
    """Whether a force on an obstacle mirrors the one on a body, or those on all together."""
    for other in [*on_bodies, *([np.sum(on_bodies, axis=0)] if on_bodies else [])]:
        largest = max(float(np.linalg.norm(force)), float(np.linalg.norm(other)))
        if np.linalg.norm(force + other) <= ALIKE * largest:
            return True
    return False


def where_it_arrives(
    origin: np.ndarray, force: np.ndarray, torque: np.ndarray, pressed: np.ndarray
) -> np.ndarray:
    """
    Return the point (3,) of the line of action that is next to a pressed vertex, if there is one.

    Parameters
    ----------
    origin : (3,) float
        about which the torque is, m
    force, torque : (3,) float
        N, N m
    pressed : (n, 3) float
        vertices under pressure, m

    """
    along = force / np.linalg.norm(force)
    point = origin + np.cross(force, torque) / (force @ force)
    if len(pressed):
        away = pressed - point
        beside = away - np.outer(away @ along, along)
        nearest = away[np.einsum('ij,ij->i', beside, beside).argmin()]
        point = point + (nearest @ along) * along
    return point


class Scale:
    """
    The force that has the longest arrow: the largest of the last moments.

    After an impact it returns to what rests, but never so far that rounding errors had arrows.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._reference = self._peak = 0.0
        self._last = clock()

    def longest(self, forces: Iterable[Any]) -> float:
        """Return the force of the longest arrow, N, when these forces (3,) act."""
        now = self._clock()
        largest = max((float(np.linalg.norm(force)) for force in forces), default=0.0)
        self._peak = max(self._peak, largest)
        faded = self._reference * 0.5 ** ((now - self._last) / HALF_LIFE)
        self._reference, self._last = max(largest, faded, LEAST_SCALE * self._peak), now
        return self._reference
