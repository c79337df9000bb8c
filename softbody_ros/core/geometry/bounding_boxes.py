# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Axis-aligned boxes: which overlap, and which points are in them (the broad phase)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.columns import ranges

FEW = 64
"""Boxes up to which it is faster to compare each with each than to sort them."""


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


def bounds(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the least and the largest values (…) in rows of numbers (…, n).

    Row by row in one list: `min` along an axis begins anew with each row, which takes longer than
    the numbers of a short row do.
    """
    first = np.arange(0, x.size, x.shape[-1])
    numbers = x.reshape(-1)
    low, high = np.minimum.reduceat(numbers, first), np.maximum.reduceat(numbers, first)
    return low.reshape(x.shape[:-1]), high.reshape(x.shape[:-1])


def overlapping(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the pairs of boxes that overlap: (p,) int and (p,) int, the first before the second.

    In order: by the first, then by the second.
    """
    rows = np.ascontiguousarray(low.T), np.ascontiguousarray(high.T)
    return _compared(*rows) if len(low) <= FEW else _swept(*rows)


def _compared(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compare each box with each; corners (3, N)."""
    below = low[:, :, None] < high[:, None]
    meet = below[0] & below[1] & below[2]
    meet &= meet.T
    first, second = np.divmod(np.flatnonzero(meet), len(meet))
    once = first < second
    return first[once], second[once]


def _swept(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort and sweep along the axis in which the boxes, corners (3, N), are spread the most."""
    centre = low + high
    axis = int(np.argmax(centre.max(axis=1) - centre.min(axis=1)))
    order = np.argsort(low[axis], kind='stable')
    begin, end = low[axis, order], high[axis, order]
    behind = np.arange(len(order)) + 1
    count = np.maximum(np.searchsorted(begin, end) - behind, 0)
    first, second = order[np.repeat(behind - 1, count)], order[ranges(behind, count)]
    for other in {0, 1, 2} - {axis}:
        begin, end = low[other], high[other]
        meet = (begin[first] < end[second]) & (begin[second] < end[first])
        first, second = first[meet], second[meet]
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
