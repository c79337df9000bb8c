# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Points that no force moves: of a cloud, and along the edges of obstacles."""

from __future__ import annotations

from collections.abc import Sequence
import operator

import numpy as np

from softbody_ros.core.collision.narrow_phase import EDGE_ALLOWANCE
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.collision.shapes import PLANE
from softbody_ros.core.compiled import kernel
from softbody_ros.core.geometry.bounding_boxes import sort_indices
from softbody_ros.core.geometry.vectors import (
    applied,
    dot,
    matrix_of,
    plus,
    put_matrix,
    put_vector,
    vector_of,
)

POINT_SET = np.dtype(
    [
        ('first', np.int64),  # of its points among those of all sets
        ('count', np.int64),
        ('radius', np.float64),  # of spheres about them, m
        ('allowance', np.float64),  # see `broad_phase.CANDIDATE`
        ('obstacle', np.int64),  # that the points belong to; of a cloud the number of obstacles
        ('centre', np.float64, (3,)),  # m
        ('linear', np.float64, (3,)),  # velocity of the centre, m/s
        ('angular', np.float64, (3,)),  # rad/s
        ('rotation', np.float64, (3, 3)),  # with which its points were sorted
        # of the obstacle that they belong to
        ('surface_velocity', np.float64, (3,)),  # in axes of the world, m/s
        ('friction', np.float64),  # negative: that of the body
        ('elasticity', np.float64),
        ('is_placed', np.bool_),  # see `OBSTACLE`; of a cloud always
    ],
    align=True,
)
"""Points of a cloud, or on the edges of an obstacle."""


class FixedPoints:
    """All such points of a world, updated incrementally from tick to tick."""

    def __init__(self) -> None:
        self._parts: tuple[object, ...] = ()
        self._local = self._points = np.zeros((0, 3))
        self._order = np.zeros(0, np.int64)
        self._sets = np.zeros(0, POINT_SET)

    def refresh(
        self, cloud: PointObstacles, obstacles: Sequence[Obstacle], records: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the points, of each set sorted along x, and the sets, valid until the next call.

        Parameters
        ----------
        cloud : PointObstacles
        obstacles : sequence of Obstacle
        records : (O,) OBSTACLE

        Returns
        -------
        points : (k, 3) float
            m
        sets : (s,) POINT_SET
            of the cloud, if it has points, then of the obstacles with edges

        """
        parts = (cloud, *(each.shape for each in obstacles))
        if len(parts) != len(self._parts) or not all(map(operator.is_, parts, self._parts)):
            self._parts = parts
            self._gather(cloud, obstacles)
        place_edges(records, self._local, self._sets, self._order, self._points)
        return self._points, self._sets

    def _gather(self, cloud: PointObstacles, obstacles: Sequence[Obstacle]) -> None:
        """Gather the points of all, edges in the frames of their obstacles."""
        numbers = [row for row, each in enumerate(obstacles) if each.shape.kind != PLANE]
        edges = [obstacles[row].shape.edge_points for row in numbers]
        points = [cloud.points_along_x, *(local for local, _ in edges)]
        sets = np.zeros(len(points), POINT_SET)
        sets['count'] = [len(each) for each in points]
        sets['first'] = np.cumsum(sets['count']) - sets['count']
        sets['radius'] = [cloud.radius, *(radius for _, radius in edges)]
        sets['obstacle'] = [len(obstacles), *numbers]
        sets['allowance'][1:] = EDGE_ALLOWANCE
        sets['friction'] = sets['elasticity'] = -1.0
        sets['is_placed'] = True
        self._local, self._sets = np.concatenate(points), sets[0 if len(cloud) else 1 :]
        self._points, self._order = self._local.copy(), np.zeros(len(self._local), np.int64)


@kernel
def place_edges(
    obstacles: np.ndarray,
    local: np.ndarray,
    sets: np.ndarray,
    order: np.ndarray,
    points: np.ndarray,
) -> None:
    """
    Write the points of sets of obstacles from those in the frames of these.

    Their order along x is that of the rotated obstacle, wherever it is, so that it depends on
    nothing that rounding changes from tick to tick.

    Parameters
    ----------
    obstacles : (O,) OBSTACLE
    local, points : (k, 3) float
        m
    sets : (s,) POINT_SET
        what moves with the obstacles is written
    order : (k,) int
        written: which of the points in the frame of its set each point is

    """
    for number in range(len(sets)):
        point_set = sets[number]
        if point_set['obstacle'] == len(obstacles):
            continue
        record = obstacles[point_set['obstacle']]
        position, rotation = vector_of(record['position']), matrix_of(record['rotation'])
        put_vector(point_set['centre'], position)
        put_vector(point_set['linear'], vector_of(record['linear']))
        put_vector(point_set['angular'], vector_of(record['angular']))
        surface_velocity = applied(rotation, vector_of(record['surface_velocity']))
        put_vector(point_set['surface_velocity'], surface_velocity)
        point_set['friction'] = record['friction']
        point_set['elasticity'] = record['elasticity']
        point_set['is_placed'] = record['is_placed']
        first, count = point_set['first'], point_set['count']
        if matrix_of(point_set['rotation']) != rotation:
            put_matrix(point_set['rotation'], rotation)
            along_x = np.empty(count)
            for k in range(first, first + count):
                along_x[k - first] = dot(rotation[0], (local[k, 0], local[k, 1], local[k, 2]))
            sort_indices(along_x, order[first : first + count])
        for k in range(first, first + count):
            j = first + order[k]
            here = (local[j, 0], local[j, 1], local[j, 2])
            there = plus(position, applied(rotation, here))
            for axis in range(3):
                points[k, axis] = there[axis]
