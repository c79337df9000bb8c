# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts between bodies, and of points with bodies: broad phase, then narrow phase."""

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
    candidates : int
        number of these

    """
    candidates = find_candidates(bodies, chosen, shapes, x, surfaces, points, sets, capacity)
    contacts = np.empty(len(candidates), CONTACT)
    found = find_contacts(
        bodies, chosen, shapes, q, surfaces.surfaces, surfaces.faces, surfaces.piece_of_face,
        surfaces.normals, surfaces.origins, surfaces.trees, x, match_centre, match_posture,
        candidates, contacts,
    )  # fmt: skip
    return contacts[:found], len(candidates)


@helper
def find_candidates(
    bodies: np.ndarray,
    chosen: np.ndarray,
    shapes: np.ndarray,
    x: np.ndarray,
    surfaces: SurfaceArrays,
    points: np.ndarray,
    sets: np.ndarray,
    capacity: int,
) -> np.ndarray:
    """Return particles and points that may be near faces of bodies, (q,) CANDIDATE."""
    count = len(chosen)
    margin, low, high = np.empty(count), np.empty((count, 3)), np.empty((count, 3))
    for place in range(count):
        body = bodies[chosen[place]]
        margin[place] = body['reach'] + SLACK * shapes[body['shape']]['scale']
        bound_body(body, x[1 - body['now']], margin[place], low[place], high[place])
    codes = pairs_to_search(bodies, chosen, low, high)
    if len(codes) == 0 and len(sets) == 0:
        return np.empty(0, CANDIDATE)
    first, piece_low, piece_high = bound_pieces(
        bodies, chosen, surfaces.surfaces, surfaces.pieces, surfaces.covered, x, margin, low, high
    )
    while True:
        candidates = np.empty(capacity, CANDIDATE)
        found = find_particles(
            bodies, chosen, surfaces.surfaces, surfaces.pieces, surfaces.particles,
            surfaces.may_collide, x, codes, low, high, first, piece_low, piece_high, candidates,
        )  # fmt: skip
        found = find_points(
            bodies, chosen, shapes, x, points, sets, low, high, first, piece_low, piece_high,
            found, candidates,
        )  # fmt: skip
        if found <= capacity:
            return candidates[:found]
        capacity = found


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
