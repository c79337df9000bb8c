# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact of particles with obstacles: signed distances, and impulses with restitution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.config import ConfigError, ObstacleConfig

if TYPE_CHECKING:
    from softbody_ros.core.dynamics import Gains


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
    if not any(config.velocity_linear) and not any(config.velocity_angular):
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


# ---------------------------------------------------------------------------------------- impulse
def collide(
    x: np.ndarray,
    v: np.ndarray,
    approach: np.ndarray,
    start: np.ndarray,
    obstacle: Obstacle,
    gains: Gains,
    gravity: float,
    h: float,
) -> None:
    """
    Project particles out of an obstacle and change their velocities, in place.

    The normal impulse is computed from the velocity before matching: after it, the velocity holds
    the pull towards a goal that may lie inside the obstacle, and resting contacts would chatter.

    Parameters
    ----------
    x, v : (B, 3, n) float
        m, m/s
    approach : (B, 3, n) float
        velocities before matching, m/s
    start : (B, 3, n) float
        positions at the last tick, m: what does not slide returns there
    obstacle : Obstacle
    gains : Gains
    gravity : float
        magnitude, m/s²; speeds below 2 |g| h do not bounce
    h : float
        s

    """
    body, particle = _candidates(x, obstacle, gains.thickness)
    if not len(body):
        return
    config, rotation = obstacle.config, obstacle.rotation
    points = x[body, :, particle].astype(np.float64)
    offsets = points - obstacle.position
    distance, normal = SIGNED_DISTANCE[config.type](offsets @ rotation, np.array(config.size))
    depth = gains.thickness[body] - distance
    touching = depth > 0.0
    if not touching.any():
        return
    body, particle, offsets = body[touching], particle[touching], offsets[touching]
    normal, depth = normal[touching] @ rotation.T, depth[touching]

    surface_velocity = np.array(config.velocity_linear) + np.cross(
        config.velocity_angular, offsets
    )
    relative = v[body, :, particle] - surface_velocity
    normal_speed = np.einsum('ij,ij->i', relative, normal)
    approach_speed = np.einsum('ij,ij->i', approach[body, :, particle] - surface_velocity, normal)
    bounce = np.where(
        approach_speed < -2.0 * gravity * h, -gains.elasticity[body] * approach_speed, 0.0
    )
    push = np.maximum(bounce - normal_speed, 0.0)

    tangential = relative - normal_speed[:, None] * normal
    sliding_speed = np.linalg.norm(tangential, axis=1)
    friction = gains.friction[body]
    coulomb_kept = 1.0 - np.minimum(
        friction * push / np.where(sliding_speed > 0.0, sliding_speed, 1.0), 1.0
    )
    kept = np.where(gains.coulomb[body], coulomb_kept, 1.0 - friction)

    slid = points[touching] - start[body, :, particle] - h * surface_velocity
    slid -= np.einsum('ij,ij->i', slid, normal)[:, None] * normal
    x[body, :, particle] = (
        points[touching] + depth[:, None] * normal - (1.0 - kept)[:, None] * slid
    )
    v[body, :, particle] = (
        surface_velocity + (normal_speed + push)[:, None] * normal + kept[:, None] * tangential
    )


def _candidates(
    x: np.ndarray, obstacle: Obstacle, thickness: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return body and particle indices of those that may touch: inside the bounding half space."""
    if obstacle.config.type == 'plane':
        normal = obstacle.rotation[:, 2]
        height = np.matmul(normal.astype(x.dtype), x)
        limit = obstacle.position @ normal + thickness
        body, particle = np.nonzero(height < limit.astype(x.dtype)[:, None])
        return body, particle
    reach = np.linalg.norm(obstacle.config.size)
    offsets = x - obstacle.position.astype(x.dtype)[:, None]
    square = np.einsum('bij,bij->bj', offsets, offsets)
    body, particle = np.nonzero(square < ((reach + thickness) ** 2)[:, None])
    return body, particle
