# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Point obstacles, such as the point clouds of depth cameras and laser scanners."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softbody_ros.core.compiled import helper, kernel

MOST_POINTS = 20_000
"""Size to which larger clouds are thinned: more points cost time without any benefit."""
BITS = 21
"""Bits of a cell index along an axis, so that three of them fit into one integer."""


@dataclass(frozen=True, eq=False)
class PointObstacles:
    """
    Points that act as small spheres.

    Attributes
    ----------
    points : (k, 3) float64
        immutable, m
    radius : float
        m
    ignored : int
        number of points that were left out, since they lay on a body

    """

    points: np.ndarray
    radius: float
    ignored: int = 0

    def __len__(self) -> int:
        return len(self.points)

    def within(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the points (j, 3) whose spheres overlap a box."""
        inside = (self.points >= low - self.radius) & (self.points <= high + self.radius)
        return self.points[inside.all(axis=1)]

    def touched(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return which boxes with corners (b, 3), m, overlap spheres, (b,) bool."""
        result = np.zeros(len(low), dtype=bool)
        find_touched(self.points_along_x, self.radius, low, high, result)
        return result

    @cached_property
    def points_along_x(self) -> np.ndarray:
        """(k, 3) float: the points, sorted along x."""
        return self.points[np.argsort(self.points[:, 0], kind='stable')]


@kernel
def find_touched(
    points: np.ndarray, radius: float, low: np.ndarray, high: np.ndarray, result: np.ndarray
) -> None:
    """Set which boxes with corners (b, 3) overlap spheres about points (k, 3) sorted along x."""
    for box in range(len(low)):
        for i in range(first_beyond(points, low[box, 0] - radius), len(points)):
            if points[i, 0] > high[box, 0] + radius:
                break
            inside = True
            for axis in range(1, 3):
                inside = inside and low[box, axis] - radius <= points[i, axis]
                inside = inside and points[i, axis] <= high[box, axis] + radius
            if inside:
                result[box] = True
                break


@helper
def first_beyond(points: np.ndarray, x: float) -> int:
    """Return the index of the first of points (k, 3), sorted along x, with at least x."""
    start, stop = 0, len(points)
    while start < stop:
        middle = (start + stop) // 2
        if points[middle, 0] < x:
            start = middle + 1
        else:
            stop = middle
    return start


NO_POINTS = PointObstacles(np.zeros((0, 3)), 0.0)


def thinned(points: np.ndarray, cell: float, most: int = MOST_POINTS) -> np.ndarray:
    """
    Return at most `most` of the points (k, 3), deterministically.

    Voxel filter: the first point in each cube of a grid is kept; if these are still too many, they
    are sampled evenly in the given order.

    Parameters
    ----------
    points : (k, 3) float64
        m
    cell : float
        edge of the cubes, m
    most : int

    """
    if len(points) <= most:
        return points
    points = points[_first_in_each_cell(points, cell)]
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).astype(np.int64)]


def _first_in_each_cell(points: np.ndarray, cell: float) -> np.ndarray:
    """Return the indices, in order, of the first point in each cell."""
    cells = np.floor(points / cell).astype(np.int64)
    cells -= cells.min(axis=0)
    if cells.max() >> BITS:  # too far apart to pack into integers: exact, but several times slower
        first = np.unique(cells, axis=0, return_index=True)[1]
    else:
        x, y, z = cells.T
        first = np.unique(x << 2 * BITS | y << BITS | z, return_index=True)[1]
    return np.sort(first)
