# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sleeping of islands: supported bodies at rest are deactivated until something wakes them.

The criterion is displacement between samples: the velocity of a particle that a contact keeps away
from its goal is not zero at rest. Bodies in contact form islands, which fall asleep and wake
together.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math

import numpy as np

from softbody_ros.core.collision.obstacle_contacts import CONTACT, find_contacts
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.compiled import kernel
from softbody_ros.core.geometry.bounding_boxes import bound_bodies, overlapping
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.union_find import unite
from softbody_ros.core.state import SAMPLES_TO_SLEEP, State

SAMPLE_INTERVAL = 0.1
"""Seconds between two samples of the displacement of bodies."""
AT_REST = 2e-4
"""Displacement between two samples, in RMS radii, below which a body is at rest."""
AT_REST_IN_ISLAND = 2e-3
"""The same for a body in contact with others, whose motion adds to its own."""
GROWING, STEADY = 1.05, 0.95
"""Displacement, relative to that four samples before, of what begins to fall over, however slowly,
and of what creeps: neither falls asleep, but that coulomb friction holds what merely creeps, by
rounding. Jitter is less sooner or later."""
STILL = 1e-7
"""Displacement between two samples, in RMS radii, of what does not move at all."""

NEAR = 0.02
"""Distance, in RMS radii, within which a change of an obstacle wakes a body."""

Boxes = tuple[np.ndarray, np.ndarray]


def is_awake(state: State) -> np.ndarray:
    """Return which bodies are awake, (B,) bool."""
    return state.still_samples < SAMPLES_TO_SLEEP


def begin_watching(state: State, indices: Iterable[int]) -> None:
    """Wake bodies, and measure their displacements from the present positions."""
    for index in indices:
        state.anchor[:, state.columns(index)] = state.positions(index)
        state.still_samples[index], state.moved[index] = 0, 0.0


class BodyBoxes:
    """
    Bounding boxes of all bodies, with their thickness; those of bodies asleep are kept.

    So many bodies asleep cost nothing while things move elsewhere.

    Parameters
    ----------
    state : State

    """

    def __init__(self, state: State) -> None:
        self._state = state
        count = len(state.bodies)
        self._low, self._high = np.empty((count, 3)), np.empty((count, 3))
        self._is_kept = np.zeros(count, dtype=bool)

    def forget(self, indices: np.ndarray | slice | int) -> None:
        """Measure bodies anew, which have moved since they fell asleep."""
        self._is_kept[indices] = False

    def measured(self) -> Boxes:
        """Return corners (B, 3) of the present boxes, m."""
        state = self._state
        chosen = np.flatnonzero(~self._is_kept)
        if len(chosen):
            margin = (state.bodies['thickness'] + AT_REST * state.scales)[chosen]
            low, high = np.empty((2, len(chosen), 3))
            bound_bodies(state.bodies, chosen, state.x, margin, low, high)
            self._low[chosen], self._high[chosen] = low, high
            self._is_kept[chosen] = ~is_awake(state)[chosen]
        return self._low.copy(), self._high.copy()


def update_sleep(
    state: State,
    obstacles: Sequence[Obstacle],
    records: np.ndarray,
    trees: Trees,
    points: PointObstacles,
    pinned: tuple[np.ndarray, np.ndarray],
    fall: float,
    body_boxes: BodyBoxes,
) -> None:
    """
    Sample the displacements of bodies since the last sample, and put islands at rest to sleep.

    Parameters
    ----------
    state : State
        `anchor` and `still_samples` are changed
    obstacles : sequence of Obstacle
    records, trees
        the obstacles for kernels
    points : PointObstacles
    pinned : (B,) bool, (B,) bool
        bodies with fixed pins, and with moving pins
    fall : float
        displacement by gravity in a tick, m: a resting body may be that far above the ground
    body_boxes : BodyBoxes
        of the state

    """
    bodies, count = state.bodies, len(state.bodies)
    displacement = np.empty(count)
    displacements(bodies, state.x, state.anchor, displacement)
    displacement /= state.scales
    if not (displacement < AT_REST_IN_ISLAND).any():
        state.still_samples[:] = 0
        return  # displacements are compared among samples at rest
    reach = bodies['thickness'] + AT_REST * state.scales + fall
    fixed, driven = pinned
    supported = fixed.copy()
    find_supported(bodies, state.x, reach, records, trees, supported)
    supported &= ~driven
    island, is_disturbed = np.zeros(count, np.int64), np.zeros(count, dtype=bool)
    if count > 1 or len(points) or any(obstacle.drives for obstacle in obstacles):
        boxes = body_boxes.measured()
        is_disturbed = disturbed(boxes, obstacles)
        supported |= points.touched(boxes[0] - fall, boxes[1] + fall)
        island = islands(count, *overlapping(*boxes))
    count_still_samples(
        island,
        displacement,
        state.moved,
        ~bodies['coulomb'],
        is_disturbed,
        supported,
        state.still_samples,
    )


@kernel
def count_still_samples(
    island: np.ndarray,
    displacement: np.ndarray,
    moved: np.ndarray,
    may_creep: np.ndarray,
    disturbed: np.ndarray,
    supported: np.ndarray,
    still_samples: np.ndarray,
) -> None:
    """
    Count consecutive samples at which islands were at rest and supported.

    The count of an island is that of its newest member. It stays below that of what falls asleep
    until the largest displacement becomes less.

    Parameters
    ----------
    island : (B,) int
        index of the island of each body
    displacement : (B,) float
        since the last sample, RMS radii
    moved : (B, SAMPLES_TO_SLEEP - 1) float
        the same of the samples before, the newest first; changed
    may_creep : (B,) bool
        whether friction lets them creep
    disturbed, supported : (B,) bool
        by moving obstacles; by pins, obstacles or points at rest
    still_samples : (B,) int
        changed

    """
    size, least = np.zeros(len(island), np.int64), np.full(len(island), SAMPLES_TO_SLEEP)
    is_at_rest, has_support = np.ones(len(island), np.bool_), np.zeros(len(island), np.bool_)
    now, before = np.zeros(len(island)), np.zeros(len(island))
    most = np.full(len(island), GROWING)
    for k in range(len(island)):
        size[island[k]] += 1
    for k in range(len(island)):
        number = island[k]
        limit = AT_REST_IN_ISLAND if size[number] > 1 else AT_REST
        is_at_rest[number] = is_at_rest[number] and displacement[k] < limit and not disturbed[k]
        has_support[number] = has_support[number] or supported[k]
        least[number] = min(least[number], still_samples[k])
        now[number] = max(now[number], displacement[k])
        before[number] = max(before[number], moved[k, SAMPLES_TO_SLEEP - 2])
        if may_creep[k]:
            most[number] = STEADY
        for sample in range(SAMPLES_TO_SLEEP - 2, 0, -1):
            moved[k, sample] = moved[k, sample - 1]
        moved[k, 0] = displacement[k]
    for k in range(len(island)):
        number = island[k]
        still_samples[k] = least[number] + 1 if is_at_rest[number] and has_support[number] else 0
        if now[number] > max(most[number] * before[number], STILL):
            still_samples[k] = min(still_samples[k], SAMPLES_TO_SLEEP - 1)


def wake_touching(state: State, boxes: Boxes, obstacles: Sequence[Obstacle]) -> None:
    """Wake islands with a body that is awake, or disturbed by a moving obstacle."""
    awake = is_awake(state)
    wake = awake | disturbed(boxes, obstacles)
    if not wake.any():
        return
    island = islands(len(awake), *overlapping(*boxes))
    wakes = np.zeros(island.max() + 1, dtype=bool)
    wakes[island[wake]] = True
    state.still_samples[wakes[island] & ~awake] = 0


def disturbed(boxes: Boxes, obstacles: Sequence[Obstacle]) -> np.ndarray:
    """Return which boxes obstacles that drive them reach before the next sample, (B,) bool."""
    result = np.zeros(len(boxes[0]), dtype=bool)
    for obstacle in obstacles:
        if obstacle.drives:
            result |= reached(boxes, obstacle, SAMPLE_INTERVAL)
    return result


def reached(boxes: Boxes, obstacle: Obstacle, seconds: float) -> np.ndarray:
    """Return which boxes (B,) bool a moving obstacle may reach within some time."""
    config = obstacle.config
    travel = seconds * float(np.linalg.norm(config.velocity_linear))
    turn = seconds * float(np.linalg.norm(config.velocity_angular))
    if turn == 0.0:
        return near_obstacle(boxes, obstacle, travel)
    low, high = boxes
    if math.isinf(obstacle.radius):  # a plane that turns
        return np.ones(len(low), dtype=bool)
    # what turns stays within its bounding ball
    nearest = np.clip(obstacle.position, low, high)
    distance = np.linalg.norm(nearest - obstacle.position, axis=1)
    is_in_ball = distance <= obstacle.radius + travel
    return is_in_ball & near_obstacle(boxes, obstacle, travel + turn * obstacle.radius)


def near_obstacle(boxes: Boxes, obstacle: Obstacle, reach: float | np.ndarray) -> np.ndarray:
    """Return which boxes (B,) bool are within a reach, m, or reaches (B,), of an obstacle."""
    low, high = boxes
    if obstacle.config.type == 'plane':
        normal = obstacle.rotation[:, 2]
        lowest = np.where(normal > 0.0, low, high) @ normal
        return lowest <= obstacle.position @ normal + reach
    half = np.abs(obstacle.rotation) @ np.array(obstacle.shape.half_extents)
    half = half + np.asarray(reach)[..., None]
    gap = np.maximum(low - obstacle.position - half, obstacle.position - half - high)
    return (gap <= 0.0).all(axis=1)


def touching(boxes: Boxes, index: int) -> np.ndarray:
    """Return which boxes (B,) bool touch one of them; it does so itself."""
    low, high = boxes
    return ((low <= high[index]) & (low[index] <= high)).all(axis=1)


def islands(count: int, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """
    Return the index (count,) of the island of each body: connected components of contact.

    Parameters
    ----------
    count : int
    one, two : (p,) int
        pairs of bodies in contact

    """
    parent = np.arange(count)
    join(parent, one, two)
    return np.unique(parent, return_inverse=True)[1] if len(one) else parent


@kernel
def join(parent: np.ndarray, one: np.ndarray, two: np.ndarray) -> None:
    """Write the first body of the island of each."""
    for k in range(len(one)):
        unite(parent, one[k], two[k])
    # a parent comes before its children
    for k in range(len(parent)):
        parent[k] = parent[parent[k]]


@kernel
def displacements(
    bodies: np.ndarray, x: np.ndarray, anchor: np.ndarray, result: np.ndarray
) -> None:
    """Write the largest displacements since the last sample, m, and take a new sample."""
    for index in range(len(bodies)):
        body = bodies[index]
        largest = 0.0
        for axis in range(3):
            row = x[body['now'], axis, body['first'] : body['first'] + body['count']]
            last = anchor[axis, body['first'] : body['first'] + body['count']]
            for i in range(len(row)):
                largest = max(largest, abs(row[i] - last[i]))
                last[i] = row[i]
        result[index] = largest


@kernel
def find_supported(
    bodies: np.ndarray,
    x: np.ndarray,
    reach: np.ndarray,
    obstacles: np.ndarray,
    trees: Trees,
    result: np.ndarray,
) -> None:
    """Set which bodies (B,) bool are within a distance (B,), m, of an obstacle at rest."""
    nothing = np.empty(0, CONTACT)
    for index in range(len(bodies)):
        body = bodies[index]
        state = x[body['now']]
        for number in range(len(obstacles)):
            if result[index]:
                break
            if not obstacles[number]['moves']:
                found = find_contacts(
                    obstacles[number], trees, state, state, body['first'],
                    body['surface'], reach[index], False, nothing, 0,
                )  # fmt: skip
                result[index] = found > 0
