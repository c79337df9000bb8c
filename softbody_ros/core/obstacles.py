# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Obstacles: where they are, and how far points are from their surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.config import ConfigError, ObstacleConfig


@dataclass(frozen=True)
class Obstacle:
    """
    Where an obstacle is now.

    Attributes
    ----------
    config : ObstacleConfig
    position : (3,) float
        m
    rotation : (3, 3) float
        its axes in world coordinates, as columns

    """

    config: ObstacleConfig
    position: np.ndarray
    rotation: np.ndarray

    @property
    def moves(self) -> bool:
        """Whether it has a velocity."""
        return any(self.config.velocity_linear) or any(self.config.velocity_angular)

    def surface_velocity(self, points: np.ndarray) -> np.ndarray:
        """Return (k, 3): its velocity at points (k, 3), m/s."""
        if not self.moves:
            return np.zeros(points.shape)
        spin = np.cross(self.config.velocity_angular, points - self.position)
        return np.array(self.config.velocity_linear) + spin


def placed(config: ObstacleConfig) -> Obstacle:
    """
    Return an obstacle at the pose of its config.

    Raises
    ------
    ConfigError
        if the type is not available yet.

    """
    if config.type not in SIGNED_DISTANCE:
        raise ConfigError(
            f'{config.prefix}type is {config.type!r}: that shape is not available yet, '
            f'choose one of {", ".join(SIGNED_DISTANCE)}'
        )
    rotation = Rotation.from_quat(config.orientation).as_matrix()
    return Obstacle(config, np.array(config.position), rotation)


def moved(obstacle: Obstacle, h: float) -> Obstacle:
    """Return an obstacle after h seconds at its own velocity."""
    config = obstacle.config
    if not obstacle.moves:
        return obstacle
    turn = Rotation.from_rotvec(h * np.array(config.velocity_angular)).as_matrix()
    position = obstacle.position + h * np.array(config.velocity_linear)
    return Obstacle(config, position, turn @ obstacle.rotation)


# ------------------------------------------------------------------------------- signed distances
# Each takes points in the obstacle's frame, (k, 3), and half extents, (3,); it returns the
# distances, (k,), negative inside, and the outward normals, (k, 3).
def plane_distance(points: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half space below z = 0."""
    normals = np.zeros_like(points)
    normals[:, 2] = 1.0
    return points[:, 2], normals


def sphere_distance(points: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ball of radius size[0]."""
    radii = np.linalg.norm(points, axis=1)
    return radii - size[0], _unit(points, radii)


def capsule_distance(points: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Capsule along z of radius size[0] and half length size[2], caps included."""
    half = max(size[2] - size[0], 0.0)
    offsets = points.copy()
    offsets[:, 2] -= np.clip(points[:, 2], -half, half)
    return sphere_distance(offsets, size)


def box_distance(points: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Box of half extents size."""
    excess = np.abs(points) - size
    outside = np.maximum(excess, 0.0)
    gap = np.linalg.norm(outside, axis=1)
    depth = excess.max(axis=1)
    nearest_face = np.eye(3)[excess.argmax(axis=1)]
    normals = np.where((depth > 0.0)[:, None], _unit(outside, gap), nearest_face)
    return np.where(depth > 0.0, gap, depth), np.copysign(normals, points)


def _unit(vectors: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    sideways = np.array([1.0, 0.0, 0.0])  # the way out from the axis of a capsule
    safe = np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return np.where((lengths > 0.0)[:, None], vectors / safe, sideways)


SIGNED_DISTANCE = {
    'plane': plane_distance,
    'box': box_distance,
    'sphere': sphere_distance,
    'capsule': capsule_distance,
}
