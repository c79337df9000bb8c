# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A filter over time for the points of cameras: what merely trembles stays where it is.

Each image of a camera has noise, by which a body that lies on its points would be shaken off. So a
point of the last cloud stays where it is, as long as a point of the next one is near enough to be
the same with other noise. What has moved by less than that has done so together: where the mean of
many points shows it, the new ones are taken as they are. Only points near bodies are filtered.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from softbody_ros.core.collision.point_obstacles import PointObstacles

GATE = 8.0
"""Distance, in standard deviations of the noise, up to which points are taken for the same: two
images of one go beyond it once in a million."""
CELL = 6.0
"""Edge of the cubes in which points move together, in their radii."""
SIGNIFICANT = 5.0
"""Mean change in a cube, in standard deviations of that, from which on it is no noise."""


def steadied(
    new: PointObstacles,
    before: PointObstacles,
    noise: float,
    low: np.ndarray,
    high: np.ndarray,
) -> PointObstacles:
    """
    Return the points of a new cloud, those that have been seen before where they were.

    Parameters
    ----------
    new, before : PointObstacles
    noise : float
        standard deviation of the noise along each axis, m
    low, high : (b, 3) float
        corners of boxes about which points are filtered, m

    """
    if not len(new) or not len(before) or new.radius != before.radius:
        return new
    gate = GATE * noise
    chosen = _in_boxes(new.points, low - gate, high + gate)
    seen, place = new.points[chosen], before.points[_in_boxes(before.points, low, high)]
    if not len(seen) or not len(place):
        return new
    distance, nearest = cKDTree(seen).query(place, distance_upper_bound=gate)
    is_seen = np.isfinite(distance)
    place, change = place[is_seen], seen[nearest[is_seen]] - place[is_seen]
    if _is_significant(change, np.zeros(len(change), np.int64), noise, 0.0).any():
        return new
    # cubes that both have, by their numbers
    cells = np.floor(np.concatenate([place, seen]) / (CELL * new.radius))
    _, number = np.unique(cells, axis=0, return_inverse=True)
    moves = _is_significant(change, number.reshape(-1), noise, 1.0)
    stays, is_new = ~moves[: len(place)], moves[len(place) :]
    place = place[stays]
    if len(place):
        is_new |= np.isinf(cKDTree(place).query(seen, distance_upper_bound=gate)[0])
    else:
        is_new[:] = True
    points = np.concatenate([place, new.points[~chosen], seen[is_new]])
    return PointObstacles(points, new.radius, new.ignored)


def _is_significant(change: np.ndarray, cell: np.ndarray, noise: float, bias: float) -> np.ndarray:
    """
    Return which points are in cubes whose points have moved together.

    Parameters
    ----------
    change : (k, 3) float
        of the first k points, m
    cell : (n,) int
        number of the cube of each point
    noise : float
        m
    bias : float
        mean change, in standard deviations, by having put points on the side of a cube

    """
    count = np.bincount(cell[: len(change)], minlength=cell.max(initial=-1) + 1)
    total = np.zeros((len(count), 3))
    np.add.at(total, cell[: len(change)], change)
    # both images have the noise
    limit = noise * (SIGNIFICANT * np.sqrt(2.0 * count) + bias * count)
    return np.asarray((np.linalg.norm(total, axis=1) > limit)[cell])


def _in_boxes(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return which points (k, 3) are in some box."""
    result = np.zeros(len(points), dtype=bool)
    for corners in zip(low, high, strict=True):
        result |= ((points >= corners[0]) & (points <= corners[1])).all(axis=1)
    return result
