# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is simulated by `core.py` and `scaling.py`: balls that fall onto the ground, z = 0."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np
from scipy.spatial import cKDTree
import trimesh

from softbody_ros.core.shape_matching.regions import farthest_points

RADIUS = 0.5
"""m"""
GRAVITY = 9.81
"""m/s², downwards"""
STEP = 1 / 60
"""s"""
PITCH = 1.5
"""Between the centres of neighbours, m: three radii, so that they never touch."""
OVERLAP = 3
"""Clusters that each vertex belongs to."""
MILLION = 316
"""Frequency of the sphere of 998 562 vertices."""


@dataclass(frozen=True)
class Workload:
    """
    Balls with equal surfaces of 10 frequency² + 2 vertices.

    Attributes
    ----------
    name : str
    frequency : int
        parts that each edge of an icosahedron is divided into
    bodies : int
    clusters : int
        that are matched by themselves; 0 for the whole body
    steps : int
        that are enough to come to rest, and 60 more
    drop : float
        height of the lowest vertices at the start, m

    """

    name: str
    frequency: int
    bodies: int = 1
    clusters: int = 0
    steps: int = 180
    drop: float = 1.0

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """The surface of each ball, centred."""
        if self.frequency.bit_count() == 1:
            halvings = self.frequency.bit_length() - 1
            return trimesh.creation.icosphere(subdivisions=halvings, radius=RADIUS)
        return geodesic_sphere(self.frequency)

    @property
    def particles(self) -> int:
        """Number of vertices of all bodies."""
        return self.bodies * (10 * self.frequency**2 + 2)

    @property
    def centres(self) -> np.ndarray:
        """(bodies, 3) float: where they start, side by side in a square, m."""
        side = math.ceil(math.sqrt(self.bodies))
        row, column = np.divmod(np.arange(self.bodies), side)
        plane = PITCH * (np.stack([column, row], axis=1) - (side - 1) / 2)
        return np.column_stack([plane, np.full(self.bodies, self.drop + RADIUS)])

    @property
    def members(self) -> list[np.ndarray]:
        """Vertices of each cluster: each vertex belongs to those of its nearest seeds."""
        vertices = self.mesh.vertices
        seeds = farthest_points(vertices, self.clusters)
        nearest = cKDTree(vertices[seeds]).query(vertices, OVERLAP)[1]
        return [np.flatnonzero((nearest == k).any(axis=1)) for k in range(self.clusters)]


def geodesic_sphere(frequency):
    """Return a sphere: the faces of an icosahedron as grids of frequency² triangles each."""
    row, column = np.tril_indices(frequency + 1)
    weights = np.stack([frequency - row, row - column, column], axis=1) / frequency
    solid = trimesh.creation.icosahedron()
    points = np.einsum('pc,fcx->fpx', weights, solid.vertices[solid.faces]).reshape(-1, 3)
    first = len(row) * np.arange(len(solid.faces))
    faces = (first[:, None, None] + _triangles(frequency)).reshape(-1, 3)
    mesh = trimesh.Trimesh(points, faces, process=False)
    mesh.merge_vertices(digits_vertex=8)  # the edges that faces of the icosahedron share
    mesh.vertices *= RADIUS / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    return mesh


def _triangles(frequency):
    """Return the triangles (frequency², 3) of a triangle of points, numbered row by row."""

    def corner(down, right):
        return (row + down) * (row + down + 1) // 2 + column + right

    row, column = np.tril_indices(frequency)
    upright = np.stack([corner(0, 0), corner(1, 0), corner(1, 1)], axis=1)
    row, column = np.tril_indices(frequency - 1)
    inverted = np.stack([corner(1, 0), corner(2, 1), corner(1, 1)], axis=1)
    return np.vstack([upright, inverted])


WORKLOADS = {
    workload.name: workload
    for workload in (
        Workload('W1-642', 8, steps=300),
        Workload('W1-2562', 16, steps=300),
        Workload('W1-10242', 32),
        Workload('W1-40962', 64),
        Workload('W2', 4, bodies=100),
        Workload('W3-8', 32, clusters=8),
        Workload('W3-64', 32, clusters=64),
        Workload('1M', MILLION, steps=120),
    )
}
