# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts between bodies, and of points with bodies: broad phase, then narrow phase."""

from __future__ import annotations

from typing import Any

import numpy as np

from softbody_ros.core.collision.broad_phase import (
    CANDIDATE,
    SLACK,
    bound_pieces,
    find_particles,
    find_points,
)
from softbody_ros.core.collision.collision_surface import CollisionSurfaces
from softbody_ros.core.collision.narrow_phase import CONTACT, find_contacts
from softbody_ros.core.geometry.bounding_boxes import bound_bodies, overlapping_codes

CANDIDATES = 1024
"""Initial capacity; it grows on demand."""
NO_PAIRS = np.zeros(0, np.int64)


def find_candidates(
    state: Any,
    chosen: np.ndarray,
    surfaces: CollisionSurfaces,
    points: np.ndarray,
    sets: np.ndarray,
    any_regions: bool,
) -> np.ndarray | None:
    """
    Return particles and points that may be near faces of bodies, (q,) CANDIDATE; None if none.

    Parameters
    ----------
    state : State
        with positions after the flight
    chosen : (c,) int
    surfaces : CollisionSurfaces
    points, sets : (k, 3) float, (s,) POINT_SET
        points that no force moves, see `broad_phase.find_points`
    any_regions : bool
        whether there are bodies with regions, which may touch themselves

    """
    bodies, count = state.bodies, len(chosen)
    if count < 2 and not len(sets) and not any_regions:
        return None
    margin = bodies['thickness'][chosen] + SLACK * state.scales[chosen]
    low, high, codes = np.empty((count, 3)), np.empty((count, 3)), NO_PAIRS
    bound_bodies(bodies, chosen, state.x, 1, margin, low, high)
    if count > 1:
        codes = overlapping_codes(low, high)
    if any_regions:
        self_pairs = np.flatnonzero(bodies['regions'][chosen] > 1) * (count + 1)
        codes = np.sort(np.concatenate([codes, self_pairs]))
    if not len(codes) and not len(sets):
        return None
    arrays = surfaces.arrays
    boxes = bound_pieces(
        bodies, chosen, arrays.surfaces, arrays.pieces, arrays.covered, state.x, margin, low, high,
    )  # fmt: skip
    candidates, found = surfaces.buffer(CANDIDATE, CANDIDATES), 0
    while True:
        if len(codes):
            found = find_particles(
                bodies, chosen, arrays.surfaces, arrays.pieces, arrays.particles,
                arrays.may_collide, state.x, codes, low, high, *boxes, candidates,
            )  # fmt: skip
        if len(sets):
            found = find_points(
                bodies, chosen, state.shapes, state.x, points, sets, low, high, *boxes, found,
                candidates,
            )  # fmt: skip
        if found <= len(candidates):
            return candidates[:found] if found else None
        candidates, found = surfaces.buffer(CANDIDATE, found), 0


def find_body_contacts(
    state: Any,
    chosen: np.ndarray,
    surfaces: CollisionSurfaces,
    candidates: np.ndarray,
    numbers: np.ndarray,
    first: np.ndarray,
) -> np.ndarray:
    """
    Return the contacts (k,) CONTACT of candidates.

    Parameters
    ----------
    numbers, first
        see `narrow_phase.find_contacts`
    state, chosen, surfaces, candidates
        see `find_candidates`

    """
    arrays, contacts = surfaces.arrays, surfaces.buffer(CONTACT, len(candidates))
    found = find_contacts(
        state.bodies, chosen, state.shapes, state.q, arrays.surfaces, arrays.faces,
        arrays.piece_of_face, arrays.normals, arrays.origins, arrays.trees, state.x,
        state.match_centre, state.match_posture, candidates, numbers, first, contacts,
    )  # fmt: skip
    return contacts[:found]
