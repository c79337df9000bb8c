# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Narrow phase: vertex-face contacts between bodies.

A particle is transformed into the rest shape of the other body by the inverse of its match, where
a static tree finds the nearest face; depth and normal are those of the deformed face. So contact
is with the deformed surface, at the cost of queries in a rigid one. If a particle is so fast that
it may have passed through, the face is that where its path enters.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from softbody_ros.core.collision.colliders import Colliders
from softbody_ros.core.collision.collision_surface import SurfaceArrays
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.bvh import Trees, closest_face, signed_distance_from_mesh
from softbody_ros.core.geometry.vectors import (
    NO_MATRIX,
    ZERO,
    Matrix,
    Vector,
    along,
    applied,
    cross,
    dot,
    inverse,
    matrix_of,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
    vector_of,
)

LOOKUP_INSET = 0.02
"""Offset of the query point towards the centre of the own body, as a share of the distance."""
EDGE_ALLOWANCE = 0.015
"""Tolerated depth of edge points, in RMS radii: contact with the obstacle comes first."""
PASSING_DEPTH, PASSING_COSINE, PASSING_INSET = 0.01, 0.3, 0.9
"""Depth, in RMS radii, and cosine between the surface normals of both bodies above which a
particle is passing through; then this offset selects the face towards its own body's centre."""
ENTRY, ENTRY_STEPS = 0.01, 64
"""Tolerance of the distance where a fast particle gets in, relative to its path, and most steps to
get there."""

CONTACT = np.dtype(
    [
        ('body', np.int64),  # see `broad_phase.CANDIDATE`
        ('other', np.int64),  # index of the body of the face
        ('edges', np.int64),  # number of its pair of edges, see `edge_contacts`, or −1
        # columns of `x` of the particle and of the corners of the face, for points the number in
        # their set; and the coefficients of their difference: 1, minus barycentric coordinates.
        # Or of the ends of both edges
        ('particles', np.int64, (4,)),
        ('coefficients', np.float64, (4,)),
        ('point', np.float64, (3,)),  # of the particle; midpoint of edges, m
        ('normal', np.float64, (3,)),  # outward normal of the face, or of the second edge
        ('depth', np.float64),  # by which the distance is less than both reaches, m
    ],
    align=True,
)
"""A contact of a particle with a face of another body, or of its own; or of two edges."""


class RestFrame(NamedTuple):
    """How positions become such in the rest shape of a piece of a body: by the inverse match."""

    map: Matrix
    place: Vector
    """m"""
    origin: Vector
    """m"""


@helper
def find_contacts(colliders: Colliders, candidates: np.ndarray, contacts: np.ndarray) -> int:
    """
    Write the candidates in reach of faces, and return their number.

    Parameters
    ----------
    colliders : Colliders
    candidates : (q,) CANDIDATE
    contacts : (q,) CONTACT
        written

    """
    bodies, chosen = colliders.bodies, colliders.chosen
    found, last_other, last_piece = 0, -1, -1
    frame = RestFrame(NO_MATRIX, ZERO, ZERO)
    for candidate in candidates:
        owner, other, piece = candidate['body'], candidate['other'], candidate['piece']
        body = bodies[chosen[other]]
        surface = colliders.surfaces.surfaces[body['shape']]
        if not surface['closed']:
            continue
        if other != last_other or piece != last_piece:
            last_other, last_piece = other, piece
            frame = rest_frame(colliders, body, piece)
        touches, face, depth, normal, barycentric = touched_face(colliders, candidate, body, frame)
        if not touches:
            continue
        contact = contacts[found]
        contact['body'], contact['other'], contact['edges'] = owner, other, -1
        contact['particles'][0] = candidate['particle']
        if owner < len(chosen):
            contact['particles'][0] += bodies[chosen[owner]]['first']
        contact['coefficients'][0] = 1.0
        corners = colliders.surfaces.faces[face]
        for corner in range(3):
            contact['particles'][1 + corner] = body['first'] + corners[corner]
            contact['coefficients'][1 + corner] = -barycentric[corner]
        put_vector(contact['point'], vector_of(candidate['point']))
        put_vector(contact['normal'], normal)
        contact['depth'] = depth
        found += 1
    return found


@helper
def rest_frame(colliders: Colliders, body: np.void, piece: int) -> RestFrame:
    """Return the frame of the rest shape of a piece."""
    match = body['first_match'] + (1 + piece if body['regions'] > 0 else 0)
    first_origin = colliders.surfaces.surfaces[body['matched']]['first_origin']
    return RestFrame(
        inverse(matrix_of(colliders.match_posture[match])),
        vector_of(colliders.match_centre[match]),
        vector_of(colliders.surfaces.origins[first_origin + piece]),
    )


@helper
def in_rest_shape(frame: RestFrame, point: Vector) -> Vector:
    """Return a position in the frame of a rest shape, m."""
    return plus(applied(frame.map, minus(point, frame.place)), frame.origin)


@helper
def nearest_face(surfaces: SurfaceArrays, surface: np.void, point: Vector) -> int:
    """Return the face of a rest shape nearest to a point of it; −1 if that is not a number."""
    row, _, _, _ = closest_face(surfaces.trees, surface['tree'], point, np.inf)
    return surface['first_face'] + surfaces.trees[2][row]['index'] if row >= 0 else -1


@helper
def touched_face(
    colliders: Colliders, candidate: np.void, body: np.void, frame: RestFrame
) -> tuple[bool, int, float, Vector, Vector]:
    """
    Return whether a candidate touches a body, and where.

    The query point is offset inwards: corners of equal stacked boxes lie exactly on edges.

    Parameters
    ----------
    colliders : Colliders
    candidate : CANDIDATE
    body : BODY
        with a closed surface
    frame : RestFrame
        of the piece of that

    Returns
    -------
    touches : bool
    face : int
        of all faces
    depth : float
        by which the distance is less than both reaches, m
    normal, barycentric : vector
        of the face, and where on it

    """
    x, surfaces, surface = (
        colliders.x, colliders.surfaces, colliders.surfaces.surfaces[body['shape']]
    )  # fmt: skip
    owner, particle, half = candidate['body'], candidate['particle'], 1 - body['now']
    scale, point = colliders.shapes[body['shape']]['scale'], vector_of(candidate['point'])
    reach = candidate['reach'] + body['reach'] - candidate['allowance'] * scale
    inwards = outwards = ZERO
    may_pass = owner < len(colliders.chosen) and surface['pieces'] == 1
    if owner < len(colliders.chosen):
        own = colliders.bodies[colliders.chosen[owner]]
        inwards = minus(vector_of(own['centre']), point)
        if may_pass:
            outwards = outward_normal(colliders, own, particle)

    touches, inset = False, LOOKUP_INSET
    face, height, normal, barycentric = -1, 0.0, ZERO, ZERO
    for attempt in range(2):
        near = nearest_face(surfaces, surface, in_rest_shape(frame, along(point, inset, inwards)))
        if near < 0:
            break
        face, corners = near, surfaces.faces[near]
        if attempt == 0 and surface['pieces'] > 1:
            if surfaces.piece_of_face[face] != candidate['piece']:
                break
            if owner == candidate['other'] and are_neighbours(colliders, body, corners, particle):
                break
        height, normal, barycentric = height_over_face(point, x, half, body, corners)
        touches = is_within(reach, height, normal)
        passing = (
            touches and height < -PASSING_DEPTH * scale and dot(outwards, normal) > PASSING_COSINE
        )
        if not passing:
            break
        inset = PASSING_INSET
    if touches and may_pass:
        own = colliders.bodies[colliders.chosen[owner]]
        way = way_past(x, own, particle, body, point)
        entered = face_of_entry(surfaces, surface, frame, point, way, normal)
        if entered >= 0:
            face, corners = entered, surfaces.faces[entered]
            height, normal, barycentric = height_over_face(point, x, half, body, corners)
            touches = is_within(reach, height, normal)
    return touches, face, reach - height, normal, barycentric


@helper
def is_within(reach: float, height: float, normal: Vector) -> bool:
    """Return whether a face is touched: one that has collapsed to a line has no normal."""
    return height < reach and dot(normal, normal) > 0.5


@helper
def face_of_entry(
    surfaces: SurfaceArrays,
    surface: np.void,
    frame: RestFrame,
    point: Vector,
    way: Vector,
    normal: Vector,
) -> int:
    """
    Return the face where a particle may have entered that is so fast that it may have passed.

    Parameters
    ----------
    surfaces, surface : SurfaceArrays, SURFACE
    frame : RestFrame
    point, way : vector
        position of the particle, and its displacement in the tick relative to the body, m
    normal : vector
        of the nearest face

    Returns
    -------
    int
        −1 if it has not entered elsewhere

    """
    thinness = surface['thinness']
    if not dot(way, way) > thinness * thinness or not dot(way, normal) > 0.0:
        return -1
    # it leaves here, so it may have come in elsewhere
    end = in_rest_shape(frame, point)
    start = minus(end, applied(frame.map, way))
    enters, entry = entry_of(surfaces.trees, surface['tree'], start, end, thinness)
    return nearest_face(surfaces, surface, entry) if enters else -1


@helper
def way_past(x: np.ndarray, owner: np.void, particle: int, body: np.void, point: Vector) -> Vector:
    """Return the displacement of a particle in the tick relative to another body, m."""
    before = particle_at(x, owner['now'], owner['first'] + particle)
    turned = applied(matrix_of(body['turn']), minus(before, vector_of(body['start_centre'])))
    return minus(point, plus(vector_of(body['centre']), turned))


@helper
def entry_of(
    trees: Trees, tree: int, start: Vector, end: Vector, thinness: float
) -> tuple[bool, Vector]:
    """
    Return whether a path enters a closed surface from outside, and where.

    The distance is a safe step, as in `swept_contact.first_touch`. Along the surface steps are at
    least half of `thinness`, m.
    """
    path = minus(end, start)
    length, covered = norm(path), 0.0
    tolerance, least = ENTRY * length, max(0.5 * thinness, length / ENTRY_STEPS)
    for step in range(ENTRY_STEPS):
        place = along(start, covered / length, path)
        distance, normal = signed_distance_from_mesh(trees, tree, place)
        if distance <= tolerance:
            return (step > 0 or distance > -tolerance) and dot(normal, path) < 0.0, place
        covered += max(distance, least) if dot(normal, path) > 0.0 else distance
        if not covered < length:
            break
    return False, end


@helper
def particle_at(x: np.ndarray, half: int, column: int) -> Vector:
    """Return the position of a particle, m."""
    return (x[half, 0, column], x[half, 1, column], x[half, 2, column])


@helper
def outward_normal(colliders: Colliders, body: np.void, particle: int) -> Vector:
    """Return an approximate surface normal of a body at a particle; zero if unknown."""
    surface = colliders.surfaces.surfaces[body['shape']]
    if surface['pieces'] > 1:
        return ZERO
    match = body['first_match'] + (1 if body['regions'] > 0 else 0)
    posture = matrix_of(colliders.match_posture[match])
    normal = colliders.surfaces.normals[surface['first_particle'] + particle]
    return applied(posture, vector_of(normal))


@helper
def are_neighbours(
    colliders: Colliders, body: np.void, corners: np.ndarray, particle: int
) -> bool:
    """Return whether a particle is a neighbour of a face of its own body at rest."""
    first, square = colliders.shapes[body['shape']]['first'], 0.0
    for axis in range(3):
        row = colliders.q[axis]
        a, b, c = row[first + corners[0]], row[first + corners[1]], row[first + corners[2]]
        gap = row[first + particle] - (a + b + c) / 3.0
        square += gap * gap
    return not math.sqrt(square) > colliders.surfaces.surfaces[body['shape']]['neighbours']


@helper
def height_over_face(
    point: Vector, x: np.ndarray, half: int, body: np.void, corners: np.ndarray
) -> tuple[float, Vector, Vector]:
    """Return what `project_on_triangle` does, for a face of a body with these corners."""
    first = body['first']
    return project_on_triangle(
        point,
        particle_at(x, half, first + corners[0]),
        particle_at(x, half, first + corners[1]),
        particle_at(x, half, first + corners[2]),
    )


@helper
def project_on_triangle(
    point: Vector, a: Vector, b: Vector, c: Vector
) -> tuple[float, Vector, Vector]:
    """
    Return the height of a point over the plane of a triangle, m, the normal, and its projection.

    The projection in barycentric coordinates, clamped to the triangle.
    """
    ab, ac, offset = minus(b, a), minus(c, a), minus(point, a)
    normal = cross(ab, ac)
    double_area = max(norm(normal), 1e-300)
    normal = scaled(1.0 / double_area, normal)
    second = dot(cross(offset, ac), normal) / double_area
    third = dot(cross(ab, offset), normal) / double_area
    barycentric = (max(1.0 - second - third, 0.0), max(second, 0.0), max(third, 0.0))
    total = barycentric[0] + barycentric[1] + barycentric[2]
    return dot(offset, normal), normal, scaled(1.0 / total, barycentric)
