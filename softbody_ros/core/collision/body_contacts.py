# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts between bodies, and of points with bodies: broad phase, then narrow phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from softbody_ros.core.collision.broad_phase import (
    CANDIDATE,
    SLACK,
    bound_pieces,
    discard_distant,
    find_particles,
    find_points,
)
from softbody_ros.core.collision.collision_surface import CollisionSurfaces
from softbody_ros.core.collision.narrow_phase import CONTACT, EDGE_ALLOWANCE, find_contacts
from softbody_ros.core.geometry.bounding_boxes import bound_bodies, overlapping_codes

CANDIDATES = 1024
"""Initial capacity; it grows on demand."""


def find_candidates(
    state: Any,
    chosen: np.ndarray,
    surfaces: CollisionSurfaces,
    fixed: Sequence[Any],
) -> np.ndarray | None:
    """
    Return particles and points that may be near faces of bodies, (q,) CANDIDATE; None if none.

    Parameters
    ----------
    state : State
        with positions after the flight
    chosen : (c,) int
    surfaces : CollisionSurfaces
    fixed : sequence of FixedPoints

    """
    bodies, shapes, count = state.bodies, state.shapes, len(chosen)
    pieced = bodies['regions'][chosen] > 1
    if count < 2 and not fixed and not pieced.any():
        return None
    margin = bodies['thickness'][chosen] + SLACK * shapes['scale'][bodies['shape'][chosen]]
    low, high = np.empty((count, 3)), np.empty((count, 3))
    bound_bodies(bodies, chosen, state.x, 1, margin, low, high)
    codes = overlapping_codes(low, high)
    if pieced.any():
        self_pairs = np.flatnonzero(pieced) * (count + 1)
        codes = np.sort(np.concatenate([codes, self_pairs]))
    if not len(codes) and not fixed:
        return None
    arrays = surfaces.arrays
    boxes = int(arrays.surfaces['pieces'][bodies['shape'][chosen]].sum())
    first = np.empty(count + 1, np.int64)
    piece_low, piece_high = np.empty((boxes, 3)), np.empty((boxes, 3))
    bound_pieces(
        bodies, chosen, arrays.surfaces, arrays.pieces, arrays.covered, state.x, margin, low, high,
        first, piece_low, piece_high,
    )  # fmt: skip
    candidates = surfaces.buffer(CANDIDATE, CANDIDATES)
    while True:
        found = find_particles(
            bodies, chosen, arrays.surfaces, arrays.pieces, arrays.particles, arrays.may_collide,
            state.x, codes, low, high, first, piece_low, piece_high, candidates,
        )  # fmt: skip
        first_point = found
        for number, each in enumerate(fixed, count):
            found = find_points(
                each.points, each.radius, EDGE_ALLOWANCE if each.is_edge else 0.0, number, low,
                high, first, piece_low, piece_high, found, candidates,
            )  # fmt: skip
        if found <= len(candidates):
            break
        candidates = surfaces.buffer(CANDIDATE, found)
    if first_point < found:
        found = discard_distant(bodies, chosen, shapes, state.x, first_point, found, candidates)
    return candidates[:found] if found else None


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
