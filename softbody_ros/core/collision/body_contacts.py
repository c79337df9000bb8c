# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contacts between bodies, and of points with bodies.

Broad phase, then narrow phase: particles and points with faces; and edges with edges.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.collision.broad_phase import (
    CANDIDATE,
    SLACK,
    bound_pieces,
    find_particles,
    find_points,
)
from softbody_ros.core.collision.collision_surface import SurfaceArrays
from softbody_ros.core.collision.edge_contacts import find_edge_contacts
from softbody_ros.core.collision.narrow_phase import CONTACT, find_contacts
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.bounding_boxes import bound_body, overlapping_codes


@helper
def find_body_contacts(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    surfaces: SurfaceArrays,
    points: np.ndarray,
    sets: np.ndarray,
    capacity: int,
) -> tuple[np.ndarray, int]:
    """
    Find the contacts of bodies with each other, with themselves and with points.

    Parameters
    ----------
    bodies : (B,) BODY
        with their `reach`
    chosen : (c,) int
        which of them
    shapes : (R,) SHAPE
    q : (3, M) float
    x : (2, 3, N) float
        m
    match_centre, match_posture
        see `narrow_phase.find_contacts`
    surfaces : SurfaceArrays
    points, sets : (k, 3) float, (s,) POINT_SET
        points that no force moves, see `broad_phase.find_points`
    capacity : int
        number of candidates for which there is room at first

    Returns
    -------
    contacts : (j,) CONTACT
        those of a pair one after the other, see `code_of_pair`
    candidates : int
        number of these

    """
    low, high, margin = bound_all(bodies, chosen, shapes, x)
    codes = pairs_to_search(bodies, chosen, low, high)
    return find_contacts_of_pairs(
        bodies, chosen, shapes, q, x, match_centre, match_posture, surfaces, codes, points, sets,
        low, high, margin, capacity,
    )  # fmt: skip


@helper
def bound_all(
    bodies: np.ndarray, chosen: np.ndarray, shapes: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the boxes of bodies with their reach: corners (c, 3), m, and that margin (c,), m."""
    count = len(chosen)
    low, high, margin = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    for place in range(count):
        body = bodies[chosen[place]]
        margin[place] = body['reach'] + SLACK * shapes[body['shape']]['scale']
        bound_body(body, x[1 - body['now']], margin[place], low[place], high[place])
    return low, high, margin


@helper
def find_contacts_of_pairs(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    q: np.ndarray,
    x: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    surfaces: SurfaceArrays,
    codes: np.ndarray,
    points: np.ndarray,
    sets: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    margin: np.ndarray,
    capacity: int,
) -> tuple[np.ndarray, int]:
    """
    Find the contacts of pairs of bodies, and of points.

    Parameters
    ----------
    codes : (p,) int
        pairs, see `broad_phase.find_particles`
    low, high, margin
        see `bound_all`
    bodies, chosen, shapes, q, x, match_centre, match_posture, surfaces, points, sets, capacity
        see `find_body_contacts`

    Returns
    -------
    contacts : (j,) CONTACT
        those of a pair one after the other, see `code_of_pair`
    candidates : int
        number of these

    """
    if len(codes) == 0 and len(sets) == 0:
        return np.empty(0, CONTACT), 0
    first, piece_low, piece_high = bound_pieces(
        bodies, chosen, surfaces.surfaces, surfaces.pieces, surfaces.covered, x, margin, low, high
    )
    candidates, number = np.empty(capacity, CANDIDATE), 0
    while True:
        number = find_particles(
            bodies, chosen, surfaces.surfaces, surfaces.pieces, surfaces.particles,
            surfaces.may_collide, x, codes, low, high, first, piece_low, piece_high, candidates,
        )  # fmt: skip
        number = find_points(
            bodies, chosen, shapes, x, points, sets, low, high, first, piece_low, piece_high,
            number, candidates,
        )  # fmt: skip
        if number <= len(candidates):
            break
        candidates = np.empty(number, CANDIDATE)
    contacts = np.empty(number, CONTACT)
    found = find_contacts(
        bodies, chosen, shapes, q, surfaces.surfaces, surfaces.faces, surfaces.piece_of_face,
        surfaces.normals, surfaces.origins, surfaces.trees, x, match_centre, match_posture,
        candidates[:number], contacts,
    )  # fmt: skip
    of_edges = find_edge_contacts(bodies, chosen, shapes, surfaces, x, codes, low, high)
    return merged(contacts[:found], of_edges, len(chosen)), number


@helper
def merged(of_faces: np.ndarray, of_edges: np.ndarray, count: int) -> np.ndarray:
    """Return contacts of both kinds, those of a pair of bodies one after the other."""
    if len(of_edges) == 0:
        return of_faces
    contacts, k = np.empty(len(of_faces) + len(of_edges), CONTACT), 0
    for place in range(len(contacts)):
        j = place - k
        is_of_face = j == len(of_edges) or (
            k < len(of_faces)
            and code_of_pair(of_faces[k], count) <= code_of_pair(of_edges[j], count)
        )
        contacts[place] = of_faces[k] if is_of_face else of_edges[j]
        k += is_of_face
    return contacts


@helper
def code_of_pair(contact: np.void, count: int) -> int:
    """Return the code of the pair of a contact, as `overlapping_codes`; of points the largest."""
    one, two = contact['body'], contact['other']
    return count * min(one, two) + max(one, two) if one < count else count * count


@helper
def pairs_to_search(
    bodies: np.ndarray, chosen: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the pairs of bodies whose boxes overlap, and those that may touch themselves."""
    count, own = len(chosen), 0
    for index in chosen:
        own += bodies[index]['regions'] > 1
    others = overlapping_codes(low, high) if count > 1 else np.empty(0, np.int64)
    if own == 0:
        return others
    codes = np.empty(len(others) + own, np.int64)
    codes[: len(others)] = others
    own = len(others)
    for place in range(count):
        if bodies[chosen[place]]['regions'] > 1:
            codes[own] = place * (count + 1)
            own += 1
    codes.sort()
    return codes
