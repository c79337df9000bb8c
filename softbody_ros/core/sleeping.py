# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sleep: bodies that lie still on something stop moving, and stop costing time.

Judged on displacement: the velocity of a particle that a contact holds away from its goal is not
zero at rest. Bodies that lie on each other fall asleep together, and wake each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.contact import soft_obstacle
from softbody_ros.core.geometry import bounding_boxes
from softbody_ros.core.shape_matching.gains import Gains
from softbody_ros.core.shape_matching.pins import Pins
from softbody_ros.core.shape_matching.rest_shape import RestShape

WATCH = 0.1
"""Seconds between two looks."""
QUIET = 2e-4
"""Displacement between two looks, in RMS radii, below which a body lies still."""
QUIET_IN_HEAP = 2e-3
"""The same for a body that touches others, whose unrest adds to its own."""
QUIET_LOOKS = 5
"""Looks in a row after which a body that lies still falls asleep."""


@dataclass
class Stillness:
    """
    How still B bodies have been.

    Attributes
    ----------
    anchor : (B, 3, n) float
        positions at the last look, m
    quiet_looks : (B,) int
        looks in a row without displacement

    """

    anchor: np.ndarray
    quiet_looks: np.ndarray

    @property
    def awake(self) -> np.ndarray:
        """(B,) bool."""
        return self.quiet_looks < QUIET_LOOKS

    def copy(self) -> Stillness:
        """Return a copy that does not share memory."""
        return Stillness(self.anchor.copy(), self.quiet_looks.copy())


def stillness(x: np.ndarray) -> Stillness:
    """Return the stillness of bodies that begin to be watched at positions x (B, 3, n)."""
    return Stillness(x.copy(), np.zeros(len(x), dtype=np.int64))


def look(watched: Stillness, x: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return how far bodies have moved since the last look, (B,), in RMS radii; look again."""
    way = np.abs(x - watched.anchor).max(axis=(1, 2)) / rest.scale
    watched.anchor[:] = x
    return way


def lying(
    x: np.ndarray,
    rest: RestShape,
    gains: Gains,
    obstacles: Sequence[Obstacle],
    points: PointObstacles,
    pinned: Mapping[int, Pins],
    fall: float,
) -> np.ndarray:
    """
    Return which bodies lie on something that does not move, (B,) bool.

    Parameters
    ----------
    x : (B, 3, n) float
        m
    rest : RestShape
    gains : Gains
    obstacles : sequence of Obstacle
    points : PointObstacles
    pinned : mapping of int to Pins
        by row
    fall : float
        way that gravity leads to in a tick, m: so high above the ground a body may be held

    """
    reach = gains.thickness + QUIET * rest.scale + fall
    on_something = np.zeros(len(x), dtype=bool)
    for obstacle in obstacles:
        on_something[soft_obstacle.find(x, obstacle, reach).body] = True
    for row, pins in pinned.items():
        on_something[row] = not pins.moves
    if len(points):
        low, high = x.min(axis=2), x.max(axis=2)
        on_something[points.inside(low - reach[:, None], high + reach[:, None])[0]] = True
    return on_something


def stirred(low: np.ndarray, high: np.ndarray, obstacles: Sequence[Obstacle]) -> np.ndarray:
    """
    Return which bodies moving obstacles are at or come to soon, (C,) bool.

    Parameters
    ----------
    low, high : (C, 3) float
        corners of boxes around the bodies, m
    obstacles : sequence of Obstacle

    """
    result = np.zeros(len(low), dtype=bool)
    for obstacle in obstacles:
        if obstacle.moves:
            distance = bounding_boxes.distances(low, high, obstacle.position)
            speed = np.linalg.norm(obstacle.config.velocity_linear)
            result |= distance <= obstacle.radius + speed * WATCH
    return result


def fall_asleep(
    watched: Sequence[Stillness],
    way: np.ndarray,
    lies: np.ndarray,
    stirs: np.ndarray,
    neighbours: tuple[np.ndarray, np.ndarray],
) -> None:
    """
    Count the looks of bodies that lie still, in place; a heap falls asleep as a whole.

    Parameters
    ----------
    watched : sequence of Stillness
    way : (C,) float
        of all bodies of all of them, see `look`
    lies, stirs : (C,) bool
        see `lying` and `stirred`
    neighbours : (p,) int, (p,) int
        bodies that may touch each other

    """
    heap = heaps(len(way), *neighbours)
    size = np.bincount(heap)
    moves, held = np.zeros(len(size), dtype=bool), np.zeros(len(size), dtype=bool)
    moves[heap[stirs | (way >= np.where(size[heap] > 1, QUIET_IN_HEAP, QUIET))]] = True
    held[heap[lies]] = True
    # who has just come to the others has to be still for as long as they
    least = np.full(len(size), QUIET_LOOKS)
    np.minimum.at(least, heap, np.concatenate([each.quiet_looks for each in watched]))
    looks = np.where(held & ~moves, least + 1, 0)[heap]
    for each, part in zip(watched, _parted(looks, watched), strict=True):
        each.quiet_looks = part


def wake_neighbours(
    watched: Sequence[Stillness], stirs: np.ndarray, neighbours: tuple[np.ndarray, np.ndarray]
) -> None:
    """Wake the bodies of heaps in which one is awake, or stirred (C,) bool, in place."""
    awake = np.concatenate([each.awake for each in watched])
    heap = heaps(len(awake), *neighbours)
    wakes = np.zeros(heap.max() + 1, dtype=bool)
    wakes[heap[awake | stirs]] = True
    for each, part in zip(watched, _parted(wakes[heap] & ~awake, watched), strict=True):
        each.quiet_looks[part] = 0


def _parted(values: np.ndarray, watched: Sequence[Stillness]) -> list[np.ndarray]:
    """Return values (C,) of all bodies as those of each batch."""
    return np.split(values, np.cumsum([len(each.quiet_looks) for each in watched])[:-1])


def heaps(bodies: int, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Return the number (C,) of the heap of each body: those that touch belong together."""
    if not len(one):
        return np.arange(bodies)
    graph = csr_array((np.ones(len(one)), (one, two)), shape=(bodies, bodies))
    return connected_components(graph, directed=False)[1]
