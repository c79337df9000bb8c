# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the writers of films share: their interface, colours and orientations."""

from __future__ import annotations

from typing import Protocol

from scipy.spatial.transform import Rotation

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.ensemble.film import Frame

OBSTACLE_COLOR = (0.8, 0.82, 0.86, 1.0)


class Writer(Protocol):
    """Writer of one film: takes the frames in order, then completes its file."""

    def add(self, frame: Frame) -> None:
        """Take a frame."""

    def finish(self) -> None:
        """Complete the file."""


def linear(color: tuple[float, ...]) -> tuple[float, ...]:
    """
    Return red, green and blue, linear in light, and the same alpha.

    Colours in ROS are sRGB, those of USD and glTF linear. IEC 61966-2-1.
    """
    rgb = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in color[:3]]
    return (*rgb, color[3])


def quaternion(obstacle: Obstacle) -> tuple[float, ...]:
    """Return the orientation of an obstacle, x y z w."""
    return tuple(Rotation.from_matrix(obstacle.rotation).as_quat().tolist())
