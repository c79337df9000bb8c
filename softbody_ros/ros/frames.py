# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Poses of other frames, from tf2 where it is importable; received messages in them, transformed.

Without tf2_ros nothing is known of other frames: what comes in them is refused as before.
"""

from __future__ import annotations

from collections.abc import Callable
import importlib
from typing import Any, NamedTuple, TypeVar

from geometry_msgs.msg import PointStamped, Vector3Stamped, WrenchStamped
import numpy as np
from rclpy.node import Node
from rclpy.time import Time
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.ros.message_parsing import InputError


class Pose(NamedTuple):
    """
    Where a frame is in that of the world.

    Attributes
    ----------
    position, orientation : (3,) float, (4,) float
        m, and a quaternion x y z w
    stamp : int
        when, ns; 0: always

    """

    position: tuple[float, ...]
    orientation: tuple[float, ...]
    stamp: int


T = TypeVar('T')
Lookup = Callable[[str, int], Pose | None]
"""Returns where a frame is at a time, ns, or the last time that is known; None: not known."""


def made_of_tf2(node: Node, make: Callable[[Any], T], without: str) -> T | None:
    """
    Return what `make` makes of the module tf2_ros; None, and say so, if that cannot be used.

    It is part of ROS, but not on PyPI.

    Parameters
    ----------
    node : Node
    make : callable
    without : str
        what is without it

    """
    try:
        return make(importlib.import_module('tf2_ros'))
    except ImportError:
        node.get_logger().debug(f'tf2_ros is not installed: {without}')
    except Exception as error:  # a broken installation raises what it likes
        node.get_logger().warning(f'tf2_ros cannot be used, {without}: {error}')
    return None


def tf_lookup(node: Node, frame_id: str) -> Lookup | None:
    """Return the lookup of tf2 in a frame, None if tf2_ros cannot be used."""
    return made_of_tf2(
        node, lambda tf2_ros: _lookup_in(frame_id, node, tf2_ros), 'nothing is transformed'
    )


def _lookup_in(frame_id: str, node: Node, tf2_ros: Any) -> Lookup:
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer, node)

    def lookup(frame: str, stamp: int) -> Pose | None:
        assert listener is not None  # who holds the buffer holds it
        for time in dict.fromkeys((stamp, 0)):  # 0: the last one
            try:
                found = buffer.lookup_transform(frame_id, frame, Time(nanoseconds=time))
            except tf2_ros.TransformException:
                continue
            move, turn, at = found.transform.translation, found.transform.rotation, found.header
            return Pose(
                (move.x, move.y, move.z),
                (turn.x, turn.y, turn.z, turn.w),
                at.stamp.sec * 1_000_000_000 + at.stamp.nanosec,
            )
        return None

    return lookup


class Frames:
    """
    Transforms messages into the frame of the world.

    Parameters
    ----------
    frame_id : str
        that frame
    make_lookup : callable
        returns a Lookup, or None without tf2; called when one is needed first

    """

    def __init__(self, frame_id: str, make_lookup: Callable[[], Lookup | None]) -> None:
        self._frame_id, self._make = frame_id, make_lookup
        self._lookup: Lookup | None = None
        self._asked = False

    def lookup(self, frame: str, stamp: int = 0) -> Pose | None:
        """Return where a frame is at a time, ns, or when last known; None: nobody knows."""
        if not self._asked:
            self._asked, self._lookup = True, self._make()
        return None if self._lookup is None else self._lookup(frame, stamp)

    def pose_of(self, header: Any) -> Pose | None:
        """
        Return where the frame of a header is; None if it is the world's, or there is no tf2.

        Raises
        ------
        InputError
            if tf2 does not know it.

        """
        frame = header.frame_id
        if frame == self._frame_id or not frame:
            return None
        # times before 0, which tf2 does not take, are of no clock: the last pose, as for 0
        stamp = max(header.stamp.sec * 1_000_000_000 + header.stamp.nanosec, 0)
        pose = self.lookup(frame, stamp)
        if pose is None and self._lookup is not None:
            raise InputError(
                f'frame_id is {frame[:60]!r}: /tf does not say where that is in {self._frame_id!r}'
            )
        return pose

    def transform(self, message: Any, names: tuple[str, ...] = ()) -> None:
        """
        Transform a message into the frame of the world, in place; clouds have `pose_of`.

        Parameters
        ----------
        message : Any
        names : tuple of str
            of bodies, which are frames of wrenches

        """
        if isinstance(message, MarkerArray):
            for marker in message.markers:
                if marker.action == Marker.ADD:
                    self._transform_marker(marker)
            return
        if not isinstance(message, (PointStamped, Vector3Stamped, WrenchStamped)):
            return
        if isinstance(message, WrenchStamped) and message.header.frame_id in names:
            return
        pose = self.pose_of(message.header)
        if pose is None:
            return
        turn = Rotation.from_quat(pose.orientation)
        if isinstance(message, PointStamped):
            _put(message.point, turn.apply(_vector(message.point)) + pose.position)
        elif isinstance(message, Vector3Stamped):
            _put(message.vector, turn.apply(_vector(message.vector)))
        else:
            for part in (message.wrench.force, message.wrench.torque):
                _put(part, turn.apply(_vector(part)))
        message.header.frame_id = self._frame_id

    def _transform_marker(self, marker: Marker) -> None:
        try:
            pose = self.pose_of(marker.header)
        except InputError:
            return  # it is refused for its frame, others of the array are not
        place, q = marker.pose.position, marker.pose.orientation
        given = np.array((q.x, q.y, q.z, q.w))
        if pose is None or not 1e-6 < np.linalg.norm(given) < np.inf:
            return
        turn = Rotation.from_quat(pose.orientation)
        _put(place, turn.apply(_vector(place)) + pose.position)
        q.x, q.y, q.z, q.w = (float(part) for part in (turn * Rotation.from_quat(given)).as_quat())
        marker.header.frame_id = self._frame_id


def _vector(message: Any) -> np.ndarray:
    return np.array((message.x, message.y, message.z))


def _put(message: Any, vector: np.ndarray) -> None:
    message.x, message.y, message.z = (float(part) for part in vector)
