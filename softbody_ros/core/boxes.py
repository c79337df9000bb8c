# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Axis-aligned boxes: which overlap, and which points are in them (the broad phase)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.columns import ranges


@dataclass(frozen=True)
class Boxes:
    """
    Axis-aligned boxes around the pieces of bodies.

    Attributes
    ----------
    low, high : (N, 3) float
        m
    body, piece : (N,) int
        numbers of the body among all, and of the piece in it

    """

    low: np.ndarray
    high: np.ndarray
    body: np.ndarray
    piece: np.ndarray


def overlapping(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the pairs of boxes that overlap: (p,) int and (p,) int, the first before the second.

    Sort and sweep along the axis in which the boxes are spread the most.
    """
    axis = int(np.argmax((low + high).std(axis=0)))
    order = np.argsort(low[:, axis], kind='stable')
    low, high = low[order], high[order]
    behind = np.arange(len(low)) + 1
    count = np.maximum(np.searchsorted(low[:, axis], high[:, axis]) - behind, 0)
    first = np.repeat(behind - 1, count)
    second = ranges(behind, count)
    meet = np.ones(len(first), dtype=bool)
    for other in {0, 1, 2} - {axis}:
        meet &= low[first, other] < high[second, other]
        meet &= low[second, other] < high[first, other]
    first, second = order[first[meet]], order[second[meet]]
    first, second = np.minimum(first, second), np.maximum(first, second)
    sorted_pairs = np.lexsort((second, first))
    return first[sorted_pairs], second[sorted_pairs]


def distances(low: np.ndarray, high: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return how far points (…, 3) are outside of boxes with corners (…, 3), (…), m."""
    gap = np.maximum(low - point, point - high)
    return np.linalg.norm(np.maximum(gap, 0.0), axis=-1)


def inside_boxes(
    x: np.ndarray,
    start: np.ndarray,
    count: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    axis: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return which points of ranges of a list are in which boxes.

    Parameters
    ----------
    x : (N, 3) float
    start, count : (D,) int
        ranges
    low, high : (D, 3) float
        a box for each
    axis : (D,) int
        along which it is expected to leave out the most points: that makes it fast

    Returns
    -------
    range : (k,) int
    point : (k,) int

    """
    number = np.arange(len(count))
    values = x.ravel()[np.repeat(axis, count) + 3 * ranges(start, count)]
    kept = values > np.repeat(low[number, axis], count)
    kept &= values < np.repeat(high[number, axis], count)
    kept = np.flatnonzero(kept)
    owner = np.repeat(number, count)[kept]
    begin = np.cumsum(count) - count
    point = kept + (start - begin)[owner]
    inside = ((x[point] > low[owner]) & (x[point] < high[owner])).all(axis=1)
    return owner[inside], point[inside]
