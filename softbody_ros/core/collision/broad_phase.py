# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Broad phase: particles and points in the bounding boxes of pieces of other bodies.

Of many points in the box of a body, only those are kept that are within a polytope around it.

References
----------
J. T. Klosowski, M. Held, J. S. B. Mitchell, H. Sowizral and K. Zikan, Efficient Collision
Detection Using Bounding Volume Hierarchies of k-DOPs, IEEE Transactions on Visualization and
Computer Graphics 4 (1), 1998.

"""

from __future__ import annotations

import itertools

import numpy as np

from softbody_ros.core.collision.colliders import Bounds, Colliders, PieceBounds
from softbody_ros.core.collision.point_obstacles import first_beyond
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.bounding_boxes import extremes, overlap
from softbody_ros.core.geometry.vectors import (
    Vector,
    column_of,
    dot,
    minus,
    norm,
    plus,
    vector_of,
)
from softbody_ros.core.lanes import LANES, higher, lanes_of, lower, vectors_at

SLACK = 1e-6
"""Margin of boxes, in RMS radii, so that flush surfaces are found."""

PARTICLES_PER_POINT = 40
"""Particles of a body that the polytope reads in the time in which a point's nearest face is
found."""


def _normals() -> np.ndarray:
    """Return unit vectors (3, k): one of each pair of opposite normals of the polytope."""
    lattice = np.array([
        each for each in itertools.product(range(-2, 3), repeat=3)
        if each > (0, 0, 0) and np.gcd.reduce(each) == 1
    ], float)  # fmt: skip
    return np.ascontiguousarray((lattice / np.linalg.norm(lattice, axis=1)[:, None]).T)


NORMALS = _normals()
"""Of the polytope: 98 normals, at most 18° from any direction; around a ball it is up to 5 %
larger, on average 1.2 %."""

CANDIDATE = np.dtype(
    [
        ('body', np.int64),  # index into the awake bodies, followed by the sets of points
        ('particle', np.int64),  # of the body, or point of the set
        ('other', np.int64),  # index of the body whose faces it may penetrate
        ('piece', np.int64),  # of that body
        ('point', np.float64, (3,)),  # position of the particle, m
        ('reach', np.float64),  # of its body, or radius of the point, m
        ('allowance', np.float64),  # tolerated depth, in RMS radii of the other body
    ],
    align=True,
)
"""A particle or point in the bounding box of a piece of a body."""


@helper
def bound_pieces(colliders: Colliders, bounds: Bounds) -> PieceBounds:
    """Return the bounding boxes of the pieces of bodies: those of the bodies if these have one."""
    bodies, chosen, surfaces = colliders.bodies, colliders.chosen, colliders.surfaces.surfaces
    pieces, covered, x = colliders.surfaces.pieces, colliders.surfaces.covered, colliders.x
    low, high, margin = bounds
    first, box = np.empty(len(chosen) + 1, np.int64), 0
    for place in range(len(chosen)):
        first[place] = box
        box += surfaces[bodies[chosen[place]]['shape']]['pieces']
    first[len(chosen)] = box
    piece_low, piece_high, box = np.empty((box, 3)), np.empty((box, 3)), 0
    for place in range(len(chosen)):
        body = bodies[chosen[place]]
        surface = surfaces[body['shape']]
        half, begin = 1 - body['now'], body['first']
        for number in range(surface['pieces']):
            piece = pieces[surface['first_piece'] + number]
            for axis in range(3):
                least, largest = low[place, axis], high[place, axis]
                if surface['pieces'] > 1:
                    row = x[half, axis]
                    least, largest = np.inf, -np.inf
                    start = piece['first_covered']
                    for index in range(start, start + piece['covered']):
                        value = row[begin + covered[index]]
                        least = value if value < least else least
                        largest = value if value > largest else largest
                    least, largest = least - margin[place], largest + margin[place]
                piece_low[box, axis], piece_high[box, axis] = least, largest
            box += 1
    return PieceBounds(first, piece_low, piece_high)


@helper
def find_particles(
    colliders: Colliders,
    codes: np.ndarray,
    bounds: Bounds,
    of_pieces: PieceBounds,
    candidates: np.ndarray,
) -> int:
    """
    Write the particles in boxes of pieces of other bodies, or of distant pieces of their own.

    Parameters
    ----------
    colliders : Colliders
    codes : (p,) int
        pairs of c bodies whose boxes overlap, c times the first plus the second, in order
    bounds, of_pieces : Bounds, PieceBounds
    candidates : (q,) CANDIDATE
        written, up to its capacity

    Returns
    -------
    int
        number of candidates, even beyond the capacity

    """
    bodies, chosen, surfaces = colliders.bodies, colliders.chosen, colliders.surfaces.surfaces
    pieces, particles, x = colliders.surfaces.pieces, colliders.surfaces.particles, colliders.x
    first, piece_low, piece_high = of_pieces
    may_collide, found = colliders.surfaces.may_collide, 0
    for code in codes:
        one, two = code // len(chosen), code % len(chosen)
        surface = surfaces[bodies[chosen[one]]['shape']]
        for a in range(first[one], first[one + 1]):
            if not overlap(piece_low[a], piece_high[a], bounds.low[two], bounds.high[two]):
                continue
            for b in range(first[two], first[two + 1]):
                if one == two:
                    row, column = a - first[one], b - first[one]
                    start = surface['first_may_collide']
                    if b <= a or not may_collide[start + surface['pieces'] * row + column]:
                        continue
                if not overlap(piece_low[a], piece_high[a], piece_low[b], piece_high[b]):
                    continue
                for side in range(2):
                    owner, own, other, box = one, a, two, b
                    if side == 1:
                        owner, own, other, box = two, b, one, a
                    body = bodies[chosen[owner]]
                    first_piece = surfaces[body['shape']]['first_piece']
                    piece = pieces[first_piece + own - first[owner]]
                    # boxes include the reach of their own bodies only
                    reach = body['reach']
                    half, begin = 1 - body['now'], body['first']
                    direction = minus(
                        plus(vector_of(piece_low[own]), vector_of(piece_high[own])),
                        plus(vector_of(piece_low[box]), vector_of(piece_high[box])),
                    )
                    limit, target = np.inf, bodies[chosen[other]]
                    if surfaces[target['shape']]['pieces'] == 1:
                        # beyond the convex hull nothing is inside
                        limit = extent_along(direction, target, x)
                        limit += norm(direction) * (reach + target['reach'])
                    for index in range(piece['first'], piece['first'] + piece['count']):
                        i = particles[index]
                        column = begin + i
                        point = (x[half, 0, column], x[half, 1, column], x[half, 2, column])
                        if dot(direction, point) > limit:
                            continue
                        if not is_inside(point, piece_low[box], piece_high[box], reach):
                            continue
                        if found < len(candidates):
                            candidate = candidates[found]
                            candidate['body'], candidate['particle'] = owner, i
                            candidate['other'], candidate['piece'] = other, box - first[other]
                            for axis in range(3):
                                candidate['point'][axis] = point[axis]
                            candidate['reach'], candidate['allowance'] = reach, 0.0
                        found += 1
    return found


@helper
def find_points(
    colliders: Colliders,
    points: np.ndarray,
    sets: np.ndarray,
    bounds: Bounds,
    of_pieces: PieceBounds,
    found: int,
    candidates: np.ndarray,
) -> int:
    """
    Append points in boxes of pieces of bodies to `found` candidates, without distant ones.

    Parameters
    ----------
    points : (k, 3) float
        of all sets, of each sorted along x, m
    sets : (s,) POINT_SET
    colliders, bounds, of_pieces, candidates
        see `find_particles`

    Returns
    -------
    int
        number of candidates, even beyond the capacity

    """
    first_point = found
    for number in range(len(sets)):
        found = append_points(
            colliders, points, sets[number], len(colliders.chosen) + number, bounds, of_pieces,
            found, candidates,
        )  # fmt: skip
    if first_point < found <= len(candidates):
        return discard_distant(
            colliders.bodies, colliders.chosen, colliders.shapes, colliders.x, first_point, found,
            candidates,
        )  # fmt: skip
    return found


@helper
def append_points(
    colliders: Colliders,
    points: np.ndarray,
    point_set: np.void,
    number: int,
    bounds: Bounds,
    of_pieces: PieceBounds,
    found: int,
    candidates: np.ndarray,
) -> int:
    """Append the points of a set, with a number among bodies and sets, in boxes of pieces."""
    begin, radius = point_set['first'], point_set['radius']
    end, allowance = begin + point_set['count'], point_set['allowance']
    own, (first, piece_low, piece_high) = points[begin:end], of_pieces
    low, high, _ = bounds
    for other in range(len(low)):
        # what is only as deep as is tolerated, such as the edge of a finger that presses, is none
        body = colliders.bodies[colliders.chosen[other]]
        reach = radius - allowance * colliders.shapes[body['shape']]['scale']
        for i in range(begin + first_beyond(own, low[other, 0] - reach), end):
            point = (points[i, 0], points[i, 1], points[i, 2])
            if not point[0] < high[other, 0] + reach:
                break
            if not is_inside(point, low[other], high[other], reach):
                continue
            for box in range(first[other], first[other + 1]):
                if not is_inside(point, piece_low[box], piece_high[box], reach):
                    continue
                if found < len(candidates):
                    candidate = candidates[found]
                    candidate['body'], candidate['particle'] = number, i - begin
                    candidate['other'], candidate['piece'] = other, box - first[other]
                    for axis in range(3):
                        candidate['point'][axis] = point[axis]
                    candidate['reach'], candidate['allowance'] = radius, allowance
                found += 1
    return found


@helper
def discard_distant(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    x: np.ndarray,
    first_point: int,
    found: int,
    candidates: np.ndarray,
) -> int:
    """
    Discard points beyond the polytopes around bodies, where that is faster than to find faces.

    The polytope contains the deformed surface, so that nothing beyond it touches.

    Parameters
    ----------
    bodies : (B,) BODY
    chosen : (c,) int
        which of them
    shapes : (R,) SHAPE
    x : (2, 3, N) float
        m
    first_point : int
        candidates before are particles, and kept
    found : int
        number of candidates
    candidates : (q,) CANDIDATE
        changed

    Returns
    -------
    int
        number of those that are left

    """
    near = np.zeros(len(chosen), np.int64)
    for k in range(first_point, found):
        near[candidates[k]['other']] += 1
    number = NORMALS.shape[1]
    low, high = np.empty((len(chosen), number)), np.empty((len(chosen), number))
    for other in range(len(chosen)):
        body = bodies[chosen[other]]
        if near[other] * PARTICLES_PER_POINT > body['surface']:
            first, flown = body['first'], x[1 - body['now']]
            put_extents(flown, first, first + body['surface'], low[other], high[other])
        else:
            near[other] = 0
    left = first_point
    for k in range(first_point, found):
        candidate = candidates[k]
        other = candidate['other']
        body = bodies[chosen[other]]
        reach = candidate['reach'] + body['reach']
        reach -= candidate['allowance'] * shapes[body['shape']]['scale']
        point = vector_of(candidate['point'])
        if near[other] > 0 and is_beyond(point, low[other], high[other], reach):
            continue
        if left < k:
            candidates[left] = candidate
        left += 1
    return left


@helper
def put_extents(x: np.ndarray, first: int, end: int, low: np.ndarray, high: np.ndarray) -> None:
    """Write the least and largest heights (k,) of particles in x (3, N) along the normals, m."""
    whole = end - (end - first) % LANES
    for k in range(len(low)):
        normal = NORMALS[0, k], NORMALS[1, k], NORMALS[2, k]
        lows, highs = lanes_of(np.inf), lanes_of(-np.inf)
        for i in range(first, whole, LANES):
            heights = dot(vectors_at(x, i, LANES), normal)
            lows, highs = lower(heights, lows), higher(heights, highs)
        least, largest = extremes(lows, highs)
        for i in range(whole, end):
            height = dot(column_of(x, i), normal)
            least, largest = min(least, height), max(largest, height)
        low[k], high[k] = least, largest


@helper
def is_beyond(point: Vector, low: np.ndarray, high: np.ndarray, reach: float) -> bool:
    """Return whether a point is farther than a reach, m, from a polytope with heights (k,)."""
    for k in range(len(low)):
        height = dot(point, (NORMALS[0, k], NORMALS[1, k], NORMALS[2, k]))
        if height > high[k] + reach or height < low[k] - reach:
            return True
    return False


@helper
def is_inside(point, low, high, reach):  # type: ignore[no-untyped-def]
    """Return whether a point is in a box with corners (3,) enlarged by a reach, m."""
    for axis in range(3):
        if not low[axis] - reach < point[axis] < high[axis] + reach:
            return False
    return True


@helper
def extent_along(direction: Vector, body: np.void, x: np.ndarray) -> float:
    """Return the support of a body: the largest product of a direction with its positions, m²."""
    half, first = 1 - body['now'], body['first']
    end = first + body['surface']
    row, y, z = x[half, 0, first:end], x[half, 1, first:end], x[half, 2, first:end]
    largest = -np.inf
    for i in range(len(row)):
        value = dot(direction, (row[i], y[i], z[i]))
        largest = value if value > largest else largest
    return largest
