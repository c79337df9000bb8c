# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How bodies that are inside each other come apart.

The nearest faces of particles deep inside another body point anywhere, and change from tick to
tick. All of them together would rather deform both bodies than part them, as much as they overlap,
and when the bodies are apart at last, that would throw them. So such a pair has one way out, the
mean of the normals of its contacts, and each contact gets out as fast as a translation along that
at a bounded speed gets it out. Then nothing is deformed by more than an impact at that speed does.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.rows import (
    RECOVERY,
    copy_record,
    is_of_pair,
    key_of_pair,
    place_of_key,
)
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    along,
    dot,
    minus,
    norm,
    put_vector,
    scaled,
    vector_of,
)

INSIDE, OUT = 0.2, 1e-3
"""Depths of a contact before the tick, in RMS radii of the smaller body: above the first one its
bodies are inside each other, since what meets in any other way is not that deep, and they are
until all are below the second one."""
LEAST_COSINE = 0.1
"""Of the normal of a contact with the way out, below which it does not lead out."""


@helper
def part_overlaps(
    bodies: np.ndarray, members: np.ndarray, rows: np.ndarray, memory: np.ndarray, h: float
) -> int:
    """
    Let bodies that are inside each other get out, without friction.

    Contacts that do not lead out are left out: the way out makes them deeper.

    Parameters
    ----------
    bodies, members : (B,) BODY, (m,) MEMBER
    rows : (k,) ROW
        complete, those of a pair of bodies one after the other; written: those that are left
        come first
    memory : (r,) MEMORY
        of the tick before
    h : float
        s

    Returns
    -------
    int
        number of contacts that are left

    """
    left, first = 0, 0
    while first < len(rows):
        last, overlaps, way, most = first + 1, False, ZERO, 0.0
        if is_of_pair(rows[first]):
            while last < len(rows) and is_same_pair(rows[first], rows[last]):
                last += 1
            one, two = members[rows[first]['one']], members[rows[first]['two']]
            scale = min(one['scale'], two['scale'])
            key = key_of_pair(bodies[one['body']]['id'], bodies[two['body']]['id'])
            least = (INSIDE if place_of_key(key, memory) < 0 else OUT) * scale
            for k in range(first, last):
                overlaps = overlaps or depth_of(rows[k]) > least
            if overlaps:
                way, most = way_out(rows, first, last), RECOVERY * scale * h
        for k in range(first, last):
            row = rows[k]
            row['overlaps'] = overlaps
            if overlaps:
                row['friction'], row['viscosity'] = 0.0, -1.0
            if overlaps and depth_of(row) > 0.0:
                cosine = dot(way, outwards(row))
                if cosine < LEAST_COSINE:
                    continue
                get_out(row, most * cosine)
            if left != k:
                copy_record(rows, left, rows, k)
            left += 1
        first = last
    return left


@helper
def remember_overlaps(
    bodies: np.ndarray, members: np.ndarray, rows: np.ndarray, remembered: np.ndarray
) -> int:
    """Write pairs of bodies that are inside each other as MEMORYs; return the number of these."""
    kept = 0
    for k in range(len(rows)):
        row = rows[k]
        if row['overlaps'] and (k == 0 or not is_same_pair(rows[k - 1], row)):
            one, two = members[row['one']]['body'], members[row['two']]['body']
            remembered[kept]['key'] = key_of_pair(bodies[one]['id'], bodies[two]['id'])
            put_vector(remembered[kept]['force'], ZERO)
            remembered[kept]['tolerated'] = remembered[kept]['gap'] = 0.0
            remembered[kept]['depth'] = 0.0
            kept += 1
    return kept


@helper
def is_same_pair(one: np.void, two: np.void) -> bool:
    """Return whether two contacts are of the same pair of bodies, in any order."""
    if one['one'] == two['one']:
        return one['two'] == two['two']
    return one['one'] == two['two'] and one['two'] == two['one']


@helper
def depth_of(row: np.void) -> float:
    """Return how deep inside a contact is before the tick, m."""
    motion = minus(vector_of(row['motion']), vector_of(row['other_motion']))
    return dot(vector_of(row['normal']), motion) - (row['gap'] - row['tolerated'])


@helper
def outwards(row: np.void) -> Vector:
    """Return the normal of a contact of a pair, towards the second one of its bodies."""
    return scaled(1.0 if row['one'] > row['two'] else -1.0, vector_of(row['normal']))


@helper
def way_out(rows: np.ndarray, first: int, last: int) -> Vector:
    """Return the direction in which the second body of a pair gets out of the first one."""
    way = ZERO
    for k in range(first, last):
        depth = depth_of(rows[k])
        if depth > 0.0:
            way = along(way, depth, outwards(rows[k]))
    size = norm(way)
    return scaled(1.0 / size, way) if size > 0.0 else ZERO


@helper
def get_out(row: np.void, most: float) -> None:
    """Let a contact get out by no more than a distance, m."""
    depth = depth_of(row)
    change = max(depth - most, 0.0) - row['tolerated']
    row['tolerated'] += change
    row['gap'] += change
    row['coasting'] += change
