# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Axis-aligned bounding boxes, and pairs that overlap by sweep and prune."""

from __future__ import annotations

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.vectors import Vector
from softbody_ros.core.lanes import LANES, Lanes, higher, lane, lanes_of, lower, weights_at


def overlapping(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the pairs of boxes that overlap: (p,) int and (p,) int, the first before the second.

    In order: by the first, then by the second. Boxes that only touch do not overlap.

    Parameters
    ----------
    low, high : (N, 3) float
        corners, m

    """
    codes = overlapping_codes(low, high)
    return codes // len(low), codes % len(low) if len(low) else codes


@kernel
def overlapping_codes(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the pairs of `overlapping` as increasing codes: N times the first plus the second."""
    codes = np.empty(4 * len(low), np.int64)
    count = sweep(low, high, codes)
    if count > len(codes):
        codes = np.empty(count, np.int64)
        sweep(low, high, codes)
    codes = codes[:count]
    codes.sort()
    return codes


@helper
def sweep(low: np.ndarray, high: np.ndarray, codes: np.ndarray) -> int:
    """
    Write the codes of pairs that overlap; return their number, even beyond the capacity.

    The boxes are sorted along the axis of their largest spread; each is then compared with those
    that begin before it ends.
    """
    count = len(low)
    axis = widest_axis(low, high)
    keys, order = np.empty(count), np.empty(count, np.int64)
    for index in range(count):
        keys[index] = low[index, axis]
    sort_indices(keys, order)
    found = 0
    for place in range(count):
        one = order[place]
        end = high[one, axis]
        for later in range(place + 1, count):
            two = order[later]
            if not keys[two] < end:
                break
            if overlap(low[one], high[one], low[two], high[two]):
                if found < len(codes):
                    codes[found] = min(one, two) * count + max(one, two)
                found += 1
    return found


@helper
def widest_axis(low: np.ndarray, high: np.ndarray) -> int:
    """Return the axis of the largest spread of the centres of boxes."""
    axis, widest = 0, -1.0
    for candidate in range(3):
        least, largest = np.inf, -np.inf
        for index in range(len(low)):
            centre = low[index, candidate] + high[index, candidate]
            least, largest = min(least, centre), max(largest, centre)
        if largest - least > widest:
            axis, widest = candidate, largest - least
    return axis


@helper
def sort_indices(keys: np.ndarray, order: np.ndarray) -> None:
    """Write the indices of keys (n,) in increasing order, stable for equal keys (Shell sort)."""
    gap = 1
    while gap < len(keys) // 3:
        gap = 3 * gap + 1
    for index in range(len(keys)):
        order[index] = index
    while gap > 0:
        for start in range(gap, len(keys)):
            index, place = order[start], start
            while place >= gap:
                other = order[place - gap]
                ahead = keys[other] == keys[index] and other < index
                if keys[other] < keys[index] or ahead:
                    break
                order[place] = other
                place -= gap
            order[place] = index
        gap //= 3


@helper
def overlap(
    low: np.ndarray, high: np.ndarray, other_low: np.ndarray, other_high: np.ndarray
) -> bool:
    """Return whether the interiors of boxes with corners (3,) intersect."""
    for axis in range(3):
        if not (low[axis] < other_high[axis] and other_low[axis] < high[axis]):
            return False
    return True


@kernel
def bound_bodies(
    bodies: np.ndarray,
    indices: np.ndarray,
    x: np.ndarray,
    margin: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> None:
    """
    Write the boxes around the surfaces of bodies.

    Parameters
    ----------
    bodies : (B,) BODY
    indices : (b,) int
        which of them
    x : (2, 3, N) float
        m
    margin : (b,) float
        around the particles, m
    low, high : (b, 3) float
        corners, written, m

    """
    for place in range(len(indices)):
        body = bodies[indices[place]]
        bound_body(body, x[body['now']], margin[place], low[place], high[place])


@helper
def bound_body(
    body: np.void, x: np.ndarray, margin: float, low: np.ndarray, high: np.ndarray
) -> None:
    """Write the box with corners (3,), m, around the surface of a body in positions x (3, N)."""
    first = body['first']
    end = first + body['surface']
    for axis in range(3):
        least, largest = bounds_of(x[axis, first:end])
        low[axis], high[axis] = least - margin, largest + margin


@helper
def box_around(x: np.ndarray, first: int, count: int) -> tuple[Vector, Vector]:
    """Return the corners, m, of the box around particles in x (3, N)."""
    end = first + count
    x_low, x_high = bounds_of(x[0, first:end])
    y_low, y_high = bounds_of(x[1, first:end])
    z_low, z_high = bounds_of(x[2, first:end])
    return (x_low, y_low, z_low), (x_high, y_high, z_high)


@helper
def bounds_of(row: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest of numbers (n,)."""
    low = other_low = lanes_of(np.inf)
    high = other_high = lanes_of(-np.inf)
    whole = len(row) - len(row) % (2 * LANES)
    for start in range(0, whole, 2 * LANES):
        one, two = weights_at(row, start, LANES), weights_at(row, start + LANES, LANES)
        low, other_low = lower(one, low), lower(two, other_low)
        high, other_high = higher(one, high), higher(two, other_high)
    least, largest = extremes(lower(low, other_low), higher(high, other_high))
    for index in range(whole, len(row)):
        least, largest = min(least, row[index]), max(largest, row[index])
    return least, largest


@helper
def extremes(low: Lanes, high: Lanes) -> tuple[float, float]:
    """Return the least of some lanes and the largest of others."""
    least, largest = lane(low, 0), lane(high, 0)
    for k in range(1, LANES):
        least, largest = min(least, lane(low, k)), max(largest, lane(high, k))
    return least, largest
