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
from softbody_ros.core.collision.colliders import Bounds, Colliders
from softbody_ros.core.collision.edge_contacts import find_edge_contacts
from softbody_ros.core.collision.narrow_phase import CONTACT, find_contacts
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.bounding_boxes import bound_body, overlapping_codes


@helper
def find_body_contacts(
    colliders: Colliders, points: np.ndarray, sets: np.ndarray, capacity: int
) -> tuple[np.ndarray, int]:
    """
    Find the contacts of bodies with each other, with themselves and with points.

    Parameters
    ----------
    colliders : Colliders
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
    bodies, chosen = colliders.bodies, colliders.chosen
    bounds = bound_all(bodies, chosen, colliders.shapes, colliders.x)
    codes = pairs_to_search(bodies, chosen, bounds.low, bounds.high)
    return find_contacts_of_pairs(colliders, codes, bounds, points, sets, capacity)


@helper
def bound_all(bodies: np.ndarray, chosen: np.ndarray, shapes: np.ndarray, x: np.ndarray) -> Bounds:
    """Return the boxes of bodies, see `Colliders`, with their reach."""
    count = len(chosen)
    low, high, margin = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    for place in range(count):
        body = bodies[chosen[place]]
        margin[place] = body['reach'] + SLACK * shapes[body['shape']]['scale']
        bound_body(body, x[1 - body['now']], margin[place], low[place], high[place])
    return Bounds(low, high, margin)


@helper
def find_contacts_of_pairs(
    colliders: Colliders,
    codes: np.ndarray,
    bounds: Bounds,
    points: np.ndarray,
    sets: np.ndarray,
    capacity: int,
) -> tuple[np.ndarray, int]:
    """
    Find the contacts of pairs of bodies, and of points.

    Parameters
    ----------
    codes : (p,) int
        pairs, see `broad_phase.find_particles`
    bounds : Bounds
    colliders, points, sets, capacity
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
    of_pieces = bound_pieces(colliders, bounds)
    candidates, number = np.empty(capacity, CANDIDATE), 0
    while True:
        number = find_particles(colliders, codes, bounds, of_pieces, candidates)
        number = find_points(colliders, points, sets, bounds, of_pieces, number, candidates)
        if number <= len(candidates):
            break
        candidates = np.empty(number, CANDIDATE)
    contacts = np.empty(number, CONTACT)
    found = find_contacts(colliders, candidates[:number], contacts)
    of_edges = find_edge_contacts(colliders, codes, bounds)
    return merged(contacts[:found], of_edges, len(colliders.chosen)), number


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
