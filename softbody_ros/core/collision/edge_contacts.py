# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contacts of edges of a body with edges of another one.

Two planks that cross touch with no vertex. Two edges are a contact if a plane through both has the
faces of one body on its one side, and those of the other one on the other: then it parts the
bodies there (the test of the Gauss map: Gregorius, The Separating Axis Test between Convex
Polyhedra, GDC 2013, for what is near, so that bodies need not be convex).
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.body import RIGID
from softbody_ros.core.collision.colliders import Bounds, Colliders
from softbody_ros.core.collision.narrow_phase import CONTACT, particle_at
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    Vector,
    along,
    cross,
    dot,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
)

PARALLEL = 0.05
"""Sine of the angle between edges up to which there is none: vertices near their ends touch."""
SUPPORT = 0.1
"""Sine of the angle by which a face may be beyond the plane through both edges: flush faces are in
that plane."""
WARPED = 0.2
"""The same of deformable bodies, whose faces are not flat."""
DEEPEST = 1.5
"""Overlap before the tick, in half thicknesses of the thinner body, up to which edges get out the
way they came: for bodies that are equally thick the other way is as short from twice that on."""
BENT = 0.1
"""Sine of the bend of a long edge between triangles that are coplanar at rest, from which it is a
ridge: where flush faces bend less, their other edges carry all the same."""
AT_END = 1e-3
"""Distance of a contact from the ends of its edges, in RMS radii, at least: vertices touch there,
and where a body slides from one to the next of equal height, its edges must not catch."""


@helper
def find_edge_contacts(colliders: Colliders, codes: np.ndarray, bounds: Bounds) -> np.ndarray:
    """
    Find the contacts of edges with each other.

    Parameters
    ----------
    colliders : Colliders
    codes : (p,) int
        pairs of bodies, as `overlapping_codes`
    bounds : Bounds

    Returns
    -------
    (c,) CONTACT
        those of a pair one after the other, in the order of `codes`

    """
    bodies, chosen, shapes = colliders.bodies, colliders.chosen, colliders.shapes
    surfaces, edges, x = colliders.surfaces.surfaces, colliders.surfaces.edges, colliders.x
    low, high, _ = bounds
    contacts, found, most = np.empty(0, CONTACT), 0, 0
    for index in chosen:
        most = max(most, surfaces[bodies[index]['shape']]['edges'])
    if most == 0:
        return contacts
    near_one, near_two = np.empty(most, np.int64), np.empty(most, np.int64)
    for code in codes:
        first, second = code // len(chosen), code % len(chosen)
        one, two = bodies[chosen[first]], bodies[chosen[second]]
        of_one, of_two = surfaces[one['shape']], surfaces[two['shape']]
        if first == second or of_one['edges'] == 0 or of_two['edges'] == 0:
            continue
        # boxes include the reach of their own bodies only
        least, largest = enlarged_box(low[first], high[first], two['reach'])
        count_two = edges_in_box(two, of_two, edges, x, least, largest, near_two)
        if count_two == 0:
            continue
        least, largest = enlarged_box(low[second], high[second], one['reach'])
        count_one = edges_in_box(one, of_one, edges, x, least, largest, near_one)
        scale = min(shapes[one['shape']]['scale'], shapes[two['shape']]['scale'])
        deepest = DEEPEST * min(of_one['thinness'], of_two['thinness'])
        reach = one['reach'] + two['reach']
        for place in near_one[:count_one]:
            edge, number = edges[place], place - of_one['first_edge']
            for place_two in near_two[:count_two]:
                other = edges[place_two]
                inside, s, t, normal, gap = closest_points(one, edge, two, other, x)
                if inside < AT_END * scale or gap >= reach:
                    continue
                before = gap_before(one, edge, s, two, other, t, normal, x)
                # what overlaps by more than the ends of the edges do gets out past these
                if before < -deepest or (gap < -inside and before < 0.0):
                    continue
                if found == len(contacts):
                    contacts = with_room(contacts)
                contact = contacts[found]
                contact['body'], contact['other'] = first, second
                contact['edges'] = number * of_two['edges'] + place_two - of_two['first_edge']
                for end in range(2):
                    contact['particles'][end] = one['first'] + edge[end]
                    contact['particles'][2 + end] = two['first'] + other[end]
                contact['coefficients'][0], contact['coefficients'][1] = 1.0 - s, s
                contact['coefficients'][2], contact['coefficients'][3] = t - 1.0, -t
                point = point_on(x, 1 - one['now'], one, edge, s)
                put_vector(contact['point'], along(point, -0.5 * gap, normal))
                put_vector(contact['normal'], normal)
                contact['depth'] = reach - gap
                found += 1
    return contacts[:found]


@helper
def with_room(contacts: np.ndarray) -> np.ndarray:
    """Return the same contacts, with room for as many more."""
    result = np.empty(max(2 * len(contacts), 8), CONTACT)
    result[: len(contacts)] = contacts
    return result


@helper
def enlarged_box(low: np.ndarray, high: np.ndarray, reach: float) -> tuple[Vector, Vector]:
    """Return the corners of a box that is wider by `reach` on all sides, m."""
    return (
        (low[0] - reach, low[1] - reach, low[2] - reach),
        (high[0] + reach, high[1] + reach, high[2] + reach),
    )


@helper
def edges_in_box(body, surface, edges, x, low, high, near):  # type: ignore[no-untyped-def]
    """Write the indices of edges of a body in a box, and return their number."""
    count, first = 0, surface['first_edge']
    number = surface['sharp_edges'] if body['mode'] == RIGID else surface['edges']
    for place in range(first, first + number):
        if not is_in_box(body, edges[place], x, low, high):
            continue
        if place - first < surface['sharp_edges'] or is_ridge(body, edges[place], x):
            near[count] = place
            count += 1
    return count


@helper
def is_ridge(body: np.void, edge: np.ndarray, x: np.ndarray) -> bool:
    """Return whether deformation has bent an edge to be sharp that is not at rest."""
    half = 1 - body['now']
    start = corner_at(x, half, body, edge, 0)
    way = minus(corner_at(x, half, body, edge, 1), start)
    normal = cross(way, minus(corner_at(x, half, body, edge, 2), start))
    offset = minus(corner_at(x, half, body, edge, 3), start)
    height, distance = dot(normal, offset), norm(cross(way, offset)) / max(norm(way), 1e-300)
    return height < -BENT * distance * norm(normal)


@helper
def is_in_box(body: np.void, edge: np.ndarray, x: np.ndarray, low: Vector, high: Vector) -> bool:
    """Return whether the box around an edge overlaps another box."""
    half, first, last = 1 - body['now'], body['first'] + edge[0], body['first'] + edge[1]
    for axis in range(3):
        one, two = x[half, axis, first], x[half, axis, last]
        if max(one, two) < low[axis] or min(one, two) > high[axis]:
            return False
    return True


@helper
def closest_points(
    one: np.void,
    edge: np.ndarray,
    two: np.void,
    other: np.ndarray,
    x: np.ndarray,
) -> tuple[float, float, float, Vector, float]:
    """
    Return where two edges are nearest to each other.

    Parameters
    ----------
    one, two : BODY
    edge, other : (4,) int
        see `CollisionSurface.edges`
    x : (2, 3, N) float
        m

    Returns
    -------
    inside : float
        distance from there to the nearest end, m; negative if it is beyond, or if there is no
        plane through both that parts the faces at them
    s, t : float
        where on the edges, from 0 to 1
    normal : vector
        of that plane, from the second body to the first
    gap : float
        along it, m; negative where the bodies overlap

    """
    half, other_half = 1 - one['now'], 1 - two['now']
    start, begin = corner_at(x, half, one, edge, 0), corner_at(x, other_half, two, other, 0)
    way = minus(corner_at(x, half, one, edge, 1), start)
    other_way = minus(corner_at(x, other_half, two, other, 1), begin)
    normal, offset = cross(way, other_way), minus(begin, start)
    square, length, other_length = dot(normal, normal), norm(way), norm(other_way)
    if not square > (PARALLEL * length * other_length) ** 2:
        return -1.0, 0.0, 0.0, normal, 0.0
    s = dot(cross(offset, other_way), normal) / square
    t = dot(cross(offset, way), normal) / square
    inside = min(min(s, 1.0 - s) * length, min(t, 1.0 - t) * other_length)
    if inside < 0.0:
        return inside, s, t, normal, 0.0
    outwards = outward_normal(two, other, x)
    sign = 1.0 if dot(normal, outwards) > 0.0 else -1.0
    normal = scaled(sign / np.sqrt(square), normal)
    lower = height_of_faces(normal, two, other, begin, other_way, x)
    upper = height_of_faces(scaled(-1.0, normal), one, edge, start, way, x)
    is_beyond = lower > support_of(two) or upper > support_of(one)
    if is_beyond or dot(normal, outward_normal(one, edge, x)) > 0.0:
        return -1.0, s, t, normal, 0.0
    gap = dot(normal, minus(along(start, s, way), along(begin, t, other_way)))
    return inside, s, t, normal, gap


@helper
def support_of(body: np.void) -> float:
    """Return the sine of the angle by which faces of a body may be beyond a plane."""
    return SUPPORT if body['mode'] == RIGID else WARPED


@helper
def corner_at(x: np.ndarray, half: int, body: np.void, edge: np.ndarray, corner: int) -> Vector:
    """Return the position of an end of an edge, or of a third corner of its triangles, m."""
    return particle_at(x, half, body['first'] + edge[corner])


@helper
def outward_normal(body: np.void, edge: np.ndarray, x: np.ndarray) -> Vector:
    """Return the sum of the normals of the triangles at an edge, times twice their areas, m²."""
    half = 1 - body['now']
    start, end = corner_at(x, half, body, edge, 0), corner_at(x, half, body, edge, 1)
    third, fourth = corner_at(x, half, body, edge, 2), corner_at(x, half, body, edge, 3)
    return cross(minus(end, start), minus(third, fourth))


@helper
def height_of_faces(
    normal: Vector, body: np.void, edge: np.ndarray, start: Vector, way: Vector, x: np.ndarray
) -> float:
    """Return how far the faces at an edge rise over a plane through it: the larger sine."""
    largest, length = -1.0, norm(way)
    for corner in range(2, 4):
        offset = minus(corner_at(x, 1 - body['now'], body, edge, corner), start)
        distance = norm(cross(offset, way)) / length
        largest = max(largest, dot(normal, offset) / max(distance, 1e-300))
    return largest


@helper
def point_on(x: np.ndarray, half: int, body: np.void, edge: np.ndarray, share: float) -> Vector:
    """Return a point of an edge, m."""
    start = scaled(1.0 - share, corner_at(x, half, body, edge, 0))
    return plus(start, scaled(share, corner_at(x, half, body, edge, 1)))


@helper
def gap_before(
    one: np.void,
    edge: np.ndarray,
    s: float,
    two: np.void,
    other: np.ndarray,
    t: float,
    normal: Vector,
    x: np.ndarray,
) -> float:
    """Return the distance along the normal, m, of the same points before the tick."""
    apart = minus(point_on(x, one['now'], one, edge, s), point_on(x, two['now'], two, other, t))
    return dot(normal, apart)
