# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Points that are in the way: what a depth camera or a laser scanner sees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softbody_ros.core.geometry.bounding_boxes import inside_boxes

MOST_POINTS = 20_000
"""What is left of a larger cloud: more cost time and push no better."""


@dataclass(frozen=True, eq=False)
class PointObstacles:
    """
    Points that push like small spheres.

    Attributes
    ----------
    points : (k, 3) float64
        never changed in place, m
    radius : float
        m

    """

    points: np.ndarray
    radius: float

    def __len__(self) -> int:
        return len(self.points)

    def within(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the points (j, 3) whose spheres come into a box."""
        inside = (self.points >= low - self.radius) & (self.points <= high + self.radius)
        return self.points[inside.all(axis=1)]

    def inside(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return boxes (j,) and points (j,) whose spheres come into them; corners (b, 3) in m."""
        if not len(self):
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        low, high = low - self.radius, high + self.radius
        along = self._sorted[:, 0]
        start, stop = np.searchsorted(along, low[:, 0]), np.searchsorted(along, high[:, 0])
        second = np.ones(len(low), np.int64)
        box, place = inside_boxes(self._sorted, start, stop - start, low, high, second)
        return box, self._order[place]

    def some(self, chosen: np.ndarray) -> PointObstacles:
        """Return some of the points, given as indices."""
        return PointObstacles(self.points[chosen], self.radius)

    @cached_property
    def _order(self) -> np.ndarray:
        return np.argsort(self.points[:, 0], kind='stable')

    @cached_property
    def _sorted(self) -> np.ndarray:
        return self.points[self._order]


NO_POINTS = PointObstacles(np.zeros((0, 3)), 0.0)


def thinned(points: np.ndarray, cell: float, most: int = MOST_POINTS) -> np.ndarray:
    """
    Return at most so many of the points (k, 3), always the same ones of the same points.

    Of too many, the first in each cube of a grid is kept, which loses nothing that is farther from
    its neighbours than a few cells; of what is still too many, evenly many in the given order.

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
    """Return the indices, in order, of the points that are the first in their cell."""
    x, y, z = np.floor(points / cell).astype(np.int64).astype(np.uint64).T
    # one number for each cell, however far apart they are. Among a million cells two have the same
    # number in one cloud of twenty, and a point too many goes
    code = x * np.uint64(0x9E3779B97F4A7C15)
    code = (code ^ (code >> np.uint64(29)) ^ y) * np.uint64(0xBF58476D1CE4E5B9)
    code = (code ^ (code >> np.uint64(32)) ^ z) * np.uint64(0x94D049BB133111EB)
    # number and index in one: sorting numbers is ten times faster than sorting indices by them
    bits = np.uint64(len(points).bit_length())
    code = (code >> bits) << bits | np.arange(len(points), dtype=np.uint64)
    code.sort()
    cells = code >> bits
    first = np.concatenate([[True], cells[1:] != cells[:-1]])
    index = code[first] & ((np.uint64(1) << bits) - np.uint64(1))
    return np.sort(index.astype(np.int64))
