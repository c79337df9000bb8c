# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Obstacle shapes: a class for each, and signed distance functions for kernels.

To add a shape: a name in `config.OBSTACLE_TYPES`, a class here in `SHAPES`, and a case in
`obstacles.distance_in_frame`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from typing import ClassVar

import numpy as np
import trimesh

from softbody_ros.core.compiled import helper
from softbody_ros.core.config import ObstacleConfig
from softbody_ros.core.geometry.bvh import SurfaceTree
from softbody_ros.core.geometry.mesh import make_surface
from softbody_ros.core.geometry.surface import Surface
from softbody_ros.core.geometry.vectors import Vector, norm, scaled

PLANE, BOX, SPHERE, CAPSULE, CYLINDER, MESH = range(6)
"""Values of `kind`."""
SECTIONS = 48
"""Sections of the tessellation of round shapes."""
SHOWN_PLANE = 10.0
"""Half extent of the displayed square of a plane, m."""
EDGE_POINTS, MOST_EDGE_POINTS = 16, 2000
"""Points along an edge of a shape, and most points of a mesh."""
KEPT = 256
SIDEWAYS = (1.0, 0.0, 0.0)
"""The normal on the axis of a round shape, where it is not unique."""


# ------------------------------------------------------------------------------- signed distances
# Each takes half extents, m, and a point in the frame of the shape, m. It returns the distance, m,
# negative inside, and the outward normal.
@helper
def plane_distance(size: Vector, point: Vector) -> tuple[float, Vector]:
    """Half space below z = 0."""
    return point[2], (0.0, 0.0, 1.0)


@helper
def sphere_distance(size: Vector, point: Vector) -> tuple[float, Vector]:
    """Ball of radius size[0]."""
    length = norm(point)
    normal = scaled(1.0 / length, point) if length > 0.0 else SIDEWAYS
    return length - size[0], normal


@helper
def capsule_distance(size: Vector, point: Vector) -> tuple[float, Vector]:
    """Capsule along z of radius size[0] and half length size[2], caps included."""
    half = max(size[2] - size[0], 0.0)
    on_axis = min(max(point[2], -half), half)
    return sphere_distance(size, (point[0], point[1], point[2] - on_axis))


@helper
def box_distance(size: Vector, point: Vector) -> tuple[float, Vector]:
    """Box of half extents size."""
    x, y, z = abs(point[0]) - size[0], abs(point[1]) - size[1], abs(point[2]) - size[2]
    distance = max(x, y, z)
    if distance > 0.0:
        x, y, z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
        distance = norm((x, y, z))
        x, y, z = x / distance, y / distance, z / distance
    elif x >= y and x >= z:
        x, y, z = 1.0, 0.0, 0.0
    elif y >= z:
        x, y, z = 0.0, 1.0, 0.0
    else:
        x, y, z = 0.0, 0.0, 1.0
    normal = (math.copysign(x, point[0]), math.copysign(y, point[1]), math.copysign(z, point[2]))
    return distance, normal


@helper
def cylinder_distance(size: Vector, point: Vector) -> tuple[float, Vector]:
    """Cylinder along z of radius size[0] and half length size[2]."""
    radial = math.sqrt(point[0] * point[0] + point[1] * point[1])
    # a box in the half plane of the axis and the point
    distance, flat = box_distance((size[0], np.inf, size[2]), (radial, 0.0, point[2]))
    if radial > 0.0:
        across = flat[0] / radial
        return distance, (across * point[0], across * point[1], flat[2])
    return distance, (flat[0], 0.0, flat[2])


# ------------------------------------------------------------------------------------------ shapes
@dataclass(frozen=True, eq=False)
class Shape(ABC):
    """
    A shape in its own frame, centred at its origin.

    Attributes
    ----------
    size : (float, float, float)
        half extents of a box; of the round ones radius, unused, half length, m
    tree : SurfaceTree or None
        of a mesh

    """

    kind: ClassVar[int]
    size: tuple[float, ...]
    tree: SurfaceTree | None = None

    @property
    @abstractmethod
    def half_extents(self) -> tuple[float, ...]:
        """Half extents of a bounding box, m."""

    @property
    @abstractmethod
    def edge_points(self) -> tuple[np.ndarray, float]:
        """
        Points (k, 3) on edges and corners, which could pass between the particles of a body, and
        the radius of spheres about them, m.
        """  # noqa: D205

    @property
    @abstractmethod
    def surface(self) -> Surface:
        """Tessellation, m."""

    @property
    def bounding_radius(self) -> float:
        """Radius of a bounding sphere about the origin, m; infinite for a plane."""
        return float(np.linalg.norm(self.half_extents))

    @property
    def ccd_threshold(self) -> float:
        """
        Displacement in a tick above which continuous collision detection is needed, m.

        Up to half the distance from the surface to the middle, the closest point is still on the
        original side.
        """
        return 0.5 * min(self.half_extents)


class Plane(Shape):
    """The half space z < 0."""

    kind = PLANE

    @property
    def half_extents(self) -> tuple[float, ...]:
        """Infinite."""
        return math.inf, math.inf, math.inf

    @cached_property
    def edge_points(self) -> tuple[np.ndarray, float]:
        """None."""
        return np.zeros((0, 3)), 0.0

    @cached_property
    def surface(self) -> Surface:
        """A square."""
        return plane_surface(SHOWN_PLANE)


class Box(Shape):
    """An axis-aligned box."""

    kind = BOX

    @property
    def half_extents(self) -> tuple[float, ...]:
        """Its size."""
        return self.size

    @cached_property
    def edge_points(self) -> tuple[np.ndarray, float]:
        """Points along its edges."""
        steps = np.linspace(-1.0, 1.0, EDGE_POINTS)
        ends = np.array([(y, z) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        edges = np.array([(x, y, z) for x in steps for y, z in ends])
        every = np.concatenate([np.roll(edges, axis, axis=1) for axis in range(3)])
        return every * self.size, 0.0

    @cached_property
    def surface(self) -> Surface:
        """Twelve triangles."""
        return _surface(trimesh.creation.box(2.0 * np.array(self.size)))


class Sphere(Shape):
    """A ball."""

    kind = SPHERE

    @property
    def half_extents(self) -> tuple[float, ...]:
        """The radius along each axis."""
        return self.size[:1] * 3

    @property
    def bounding_radius(self) -> float:
        """Its radius."""
        return self.size[0]

    @cached_property
    def edge_points(self) -> tuple[np.ndarray, float]:
        """The centre, and its radius."""
        return np.zeros((1, 3)), self.size[0]

    @cached_property
    def surface(self) -> Surface:
        """An icosphere."""
        return _surface(trimesh.creation.icosphere(4, self.size[0]))


class Capsule(Shape):
    """A capsule along z; its length includes the caps."""

    kind = CAPSULE

    @property
    def half_extents(self) -> tuple[float, ...]:
        """Radius, radius, half length."""
        radius, _, half_length = self.size
        return radius, radius, max(radius, half_length)

    @cached_property
    def edge_points(self) -> tuple[np.ndarray, float]:
        """Points along its axis, and its radius."""
        radius, _, half_length = self.size
        straight = max(half_length - radius, 0.0)
        count = min(2 + int(2.0 * straight / radius), EDGE_POINTS)
        return np.linspace(-straight, straight, count)[:, None] * np.eye(3)[2], radius

    @cached_property
    def surface(self) -> Surface:
        """Of so many sections."""
        radius, _, half_length = self.size
        straight = 2.0 * max(half_length - radius, 0.0)
        shape = trimesh.creation.capsule(straight, radius, [SECTIONS, SECTIONS])
        shape.apply_translation(-shape.bounds.mean(axis=0))
        return _surface(shape)


class Cylinder(Shape):
    """A cylinder along z."""

    kind = CYLINDER

    @property
    def half_extents(self) -> tuple[float, ...]:
        """Radius, radius, half length."""
        radius, _, half_length = self.size
        return radius, radius, half_length

    @cached_property
    def edge_points(self) -> tuple[np.ndarray, float]:
        """Points around both rims, and the centres of both ends."""
        radius, _, half_length = self.size
        angles = np.linspace(0.0, 2.0 * np.pi, EDGE_POINTS, endpoint=False)
        rim = radius * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
        rim = np.concatenate([rim, np.zeros((1, 3))])
        end = half_length * np.eye(3)[2]
        return np.concatenate([rim - end, rim + end]), 0.0

    @cached_property
    def surface(self) -> Surface:
        """Of so many sections."""
        radius, _, half_length = self.size
        return _surface(trimesh.creation.cylinder(radius, 2.0 * half_length, 2 * SECTIONS))


class Mesh(Shape):
    """A closed surface, scaled by the first of the sizes."""

    kind = MESH

    @cached_property
    def _tree(self) -> SurfaceTree:
        if self.tree is None:
            raise ValueError('a mesh has a tree')
        return self.tree

    @property
    def half_extents(self) -> tuple[float, ...]:
        """Half extents of a bounding box centred at the origin of the mesh, m."""
        extents = np.maximum(np.abs(self._tree.low), np.abs(self._tree.high))
        return tuple((self.size[0] * extents).tolist())

    @cached_property
    def ccd_threshold(self) -> float:
        """A quarter of the thickness of its thinnest wall, m."""
        return 0.5 * self.size[0] * self._tree.half_thickness

    @cached_property
    def edge_points(self) -> tuple[np.ndarray, float]:
        """Vertices on edges and corners."""
        points = self.size[0] * self._tree.sharp_vertices
        return points[:: max(len(points) // MOST_EDGE_POINTS, 1)], 0.0

    @cached_property
    def surface(self) -> Surface:
        """The scaled surface."""
        surface = self._tree.surface
        return Surface(self.size[0] * surface.vertices, surface.faces)


SHAPES: dict[str, type[Shape]] = {
    'plane': Plane,
    'box': Box,
    'sphere': Sphere,
    'capsule': Capsule,
    'cylinder': Cylinder,
    'mesh': Mesh,
}
"""Classes by the names in `config.OBSTACLE_TYPES`."""


def make_shape(config: ObstacleConfig, tree: SurfaceTree | None = None) -> Shape:
    """
    Return the shape of an obstacle, with the tree of its mesh if it is one.

    A mesh with a scale of its own is not scaled; others are given for half extent 1, and scaled to
    their size.
    """
    if config.type == 'mesh':
        unit = 1.0 if config.has_own_scale else config.size[0]
        return Mesh((unit, unit, unit), tree)
    return _made(config.type, config.size)


@lru_cache(maxsize=KEPT)
def _made(name: str, size: tuple[float, ...]) -> Shape:
    return SHAPES[name](size)


# ----------------------------------------------------------------------------------- tessellation
def obstacle_surface(config: ObstacleConfig, reach: float) -> Surface:
    """
    Return the tessellation of an obstacle, in its own frame.

    Parameters
    ----------
    config : ObstacleConfig
    reach : float
        half the side of the square that represents a plane, m

    """
    if config.type == 'plane':
        return plane_surface(reach)
    if config.type != 'mesh':
        return make_shape(config).surface
    if isinstance(config.mesh, Surface):
        return config.mesh
    return make_surface(config.mesh, config.size[0], config.subdivisions, config.mesh_frame)


def plane_surface(reach: float) -> Surface:
    """Return a square in the plane z = 0; `reach` is half its side, m."""
    corners = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])
    return Surface(reach * corners, np.array([(0, 1, 2), (0, 2, 3)]))


def _surface(shape: trimesh.Trimesh) -> Surface:
    return Surface(shape.vertices, shape.faces)
