# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Obstacles: where they are, and how far points are from their surfaces."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.collision.tessellation import obstacle_surface
from softbody_ros.core.config import ConfigError, ObstacleConfig
from softbody_ros.core.geometry.mesh import PRIMITIVES, MeshError, Surface, make_surface
from softbody_ros.core.geometry.nearest_faces import NearestFaces, nearest_faces
from softbody_ros.core.shape_matching import rigid_motion

EDGE_POINTS, MOST_SPIKES = 16, 2000
"""Points along an edge of an obstacle, and of a mesh, that bodies' faces are kept out of."""
KEPT = 256
SHOWN_PLANE = 10.0
"""Half extent of the part of a plane that is shown, m."""


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
    faces : NearestFaces or None
        of a mesh, of half extent 1 unless the config has a `Surface`
    before : (position, rotation) or None
        at the tick before, if it has moved since

    """

    config: ObstacleConfig
    position: np.ndarray
    rotation: np.ndarray
    faces: NearestFaces | None = None
    before: tuple[np.ndarray, np.ndarray] | None = None

    @cached_property
    def moves(self) -> bool:
        """Whether it has a velocity."""
        return any(self.config.velocity_linear) or any(self.config.velocity_angular)

    def surface_velocity(self, points: np.ndarray) -> np.ndarray:
        """Return (k, 3): its velocity at points (k, 3), m/s."""
        if not self.moves:
            return np.zeros((3, len(points))).T
        velocity, angular = self.config.velocity_linear, self.config.velocity_angular
        pose = (self.position, np.array(velocity), np.array(angular))
        return rigid_motion.field(points.T[None], *(each[None] for each in pose))[0].T

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return signed distances (k,) and outward normals (k, 3) of world points (k, 3)."""
        if self.config.type == 'plane':
            normal, offset = self.half_space
            return points @ normal - offset, np.repeat(normal, len(points)).reshape(3, -1).T
        distance, normals = self.distance(self.local(points))
        return distance, self.to_world(normals)

    def local(self, points: np.ndarray) -> np.ndarray:
        """Return points (k, 3) in its frame."""
        return (points - self.position) @ self.rotation

    def to_world(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (k, 3) of its frame in world coordinates."""
        return np.matmul(self.rotation, vectors.T).T

    @cached_property
    def half_space(self) -> tuple[np.ndarray, float]:
        """The normal (3,) of a plane, and how far along it its surface lies, m."""
        normal = self.rotation[:, 2].copy()
        return normal, float(self.position @ normal)

    # --------------------------------------------------------------------------- in its own frame
    @cached_property
    def half_extents(self) -> np.ndarray:
        """(3,) float: of a box in its frame, centred at its origin, that it is in, m."""
        if self.faces is not None:
            return self._scale * np.maximum(np.abs(self.faces.low), np.abs(self.faces.high))
        radius, _, half_length = size = self.config.size
        if self.config.type == 'sphere':
            return np.full(3, radius)
        if self.config.type == 'capsule':
            return np.array([radius, radius, max(radius, half_length)])
        if self.config.type == 'cylinder':
            return np.array([radius, radius, half_length])
        return np.array(size if self.config.type == 'box' else (np.inf,) * 3)

    @cached_property
    def radius(self) -> float:
        """Of a ball about its origin that it is in, m; infinite for a plane."""
        if self.config.type == 'sphere':
            return self.config.size[0]
        return float(np.linalg.norm(self.half_extents))

    @cached_property
    def slow(self) -> float:
        """
        Displacement in a tick that cannot lead a particle to the wrong side, m.

        A particle that starts at the surface and goes no further than half of the way to the
        middle is still nearest to the side on which it was.
        """
        if self.faces is not None:
            return 0.5 * self._scale * self.faces.half_thickness
        return 0.5 * float(self.half_extents.min())

    @cached_property
    def spikes(self) -> PointObstacles:
        """Points of it that may get in between the particles of a body: corners, edges, tips."""
        local, radius = _spikes(self.config.type, self.config.size)
        if self.faces is not None:
            corners = self._scale * self.faces.sharp_vertices
            local = corners[:: max(len(corners) // MOST_SPIKES, 1)]
        return PointObstacles(self.position + local @ self.rotation.T, radius)

    @property
    def triangles(self) -> np.ndarray:
        """(3 m, 3) float: three corners per triangle that show it, in its own frame, m."""
        if self.faces is None:
            return _corners(self.config)
        triangles = self.faces.triangles
        corners = triangles.corner + np.stack([0.0 * triangles.ab, triangles.ab, triangles.ac])
        return self._scale * corners.transpose(2, 0, 1).reshape(-1, 3)

    def distance(self, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return signed distances (k,) and outward normals (k, 3) of points (k, 3)."""
        if self.faces is None:
            return SIGNED_DISTANCE[self.config.type](local, np.array(self.config.size))
        distance, normal = self.faces.distance(local / self._scale)
        return self._scale * distance, normal

    def at_least(self, distance: np.ndarray) -> np.ndarray:
        """Return lower bounds (k,) of the true distances, from those of `distance`."""
        if self.faces is None:
            return distance
        return self._scale * self.faces.at_least(distance / self._scale)

    def is_clear(self, local: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return (k,) bool: points (k, 3) surely not nearer than distances (k,); a quick test."""
        if self.faces is None:
            return np.zeros(len(local), dtype=bool)
        return self.faces.is_clear(local / self._scale, distance / self._scale)

    @property
    def _scale(self) -> float:
        return 1.0 if isinstance(self.config.mesh, Surface) else self.config.size[0]


def made(config: ObstacleConfig) -> Obstacle:
    """
    Return an obstacle at the pose of its config.

    Raises
    ------
    ConfigError, MeshError
        if it has no mesh and needs one, or it cannot be read or is not closed.

    """
    if config.type != 'mesh':
        return placed(config)
    if config.mesh == '':
        raise ConfigError(
            f"{config.prefix}mesh is '': type mesh needs a primitive "
            f'({", ".join(PRIMITIVES)}) or a file'
        )
    try:
        surface = config.mesh
        if not isinstance(surface, Surface):
            surface = make_surface(surface, 1.0, config.subdivisions)
        return placed(config, nearest_faces(surface))
    except MeshError as error:
        raise MeshError(f'{config.prefix}{error}') from None


def placed(config: ObstacleConfig, faces: NearestFaces | None = None) -> Obstacle:
    """Return an obstacle at the pose of its config, if a mesh then with these faces."""
    rotation = Rotation.from_quat(config.orientation).as_matrix()
    return Obstacle(config, np.array(config.position), rotation, faces)


def moved(obstacle: Obstacle, h: float) -> Obstacle:
    """Return an obstacle after h seconds at its own velocity."""
    config = obstacle.config
    if not obstacle.moves:
        return obstacle if obstacle.before is None else dataclasses.replace(obstacle, before=None)
    turn = Rotation.from_rotvec(h * np.array(config.velocity_angular)).as_matrix()
    return dataclasses.replace(
        obstacle,
        position=obstacle.position + h * np.array(config.velocity_linear),
        rotation=turn @ obstacle.rotation,
        before=(obstacle.position, obstacle.rotation),
    )


# ----------------------------------------------------------------------------------------- spikes
@lru_cache(maxsize=KEPT)
def _spikes(kind: str, size: tuple[float, ...]) -> tuple[np.ndarray, float]:
    """Return points (k, 3) in the frame of an obstacle, m, and the radius of balls about them."""
    radius, _, half_length = size
    if kind == 'sphere':
        return np.zeros((1, 3)), radius
    if kind == 'capsule':
        straight = max(half_length - radius, 0.0)
        count = min(2 + int(2.0 * straight / radius), EDGE_POINTS)
        return np.linspace(-straight, straight, count)[:, None] * np.eye(3)[2], radius
    if kind == 'cylinder':
        angles = np.linspace(0.0, 2.0 * np.pi, EDGE_POINTS, endpoint=False)
        rim = radius * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
        rim = np.concatenate([rim, np.zeros((1, 3))])
        end = half_length * np.eye(3)[2]
        return np.concatenate([rim - end, rim + end]), 0.0
    if kind == 'box':
        steps = np.linspace(-1.0, 1.0, EDGE_POINTS)
        ends = np.array([(y, z) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        edges = np.array([(x, y, z) for x in steps for y, z in ends])
        return np.concatenate([np.roll(edges, axis, axis=1) for axis in range(3)]) * size, 0.0
    return np.zeros((0, 3)), 0.0


@lru_cache(maxsize=KEPT)
def _corners(config: ObstacleConfig) -> np.ndarray:
    """Return three corners (3 m, 3) per triangle of an obstacle that is no mesh."""
    surface = obstacle_surface(config, SHOWN_PLANE)
    return surface.vertices[surface.faces.reshape(-1)]


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


def cylinder_distance(points: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cylinder along z of radius size[0] and half length size[2]."""
    radial = points * (1.0, 1.0, 0.0)
    radii = np.linalg.norm(radial, axis=1)
    # a box in the half plane of the axis and the point
    flat = np.stack([radii, np.zeros(len(points)), points[:, 2]], axis=1)
    distance, normal = box_distance(flat, np.array([size[0], np.inf, size[2]]))
    normals = normal[:, :1] * _unit(radial, radii)
    normals[:, 2] = normal[:, 2]
    return distance, normals


def _unit(vectors: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    sideways = np.array([1.0, 0.0, 0.0])  # the way out from the axis of a capsule
    safe = np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return np.where((lengths > 0.0)[:, None], vectors / safe, sideways)


SIGNED_DISTANCE = {
    'plane': plane_distance,
    'box': box_distance,
    'sphere': sphere_distance,
    'capsule': capsule_distance,
    'cylinder': cylinder_distance,
}
