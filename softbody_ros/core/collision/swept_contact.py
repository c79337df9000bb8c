# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Continuous collision detection: entry points of fast particles, by sphere tracing."""

from __future__ import annotations

import numpy as np

from softbody_ros.core.collision.obstacles import distance_in_frame
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.vectors import Vector, along, dot, minus, norm

STEPS = 64
"""Most steps along a path."""
TOUCHING = 0.01
"""Tolerance of the distance at contact, relative to the length of the path."""
BEHIND = 1e-6
"""Depth, relative to the path, above which its end is behind the plane, not on it."""


@helper
def first_touch(
    obstacle: np.void, trees: Trees, start: Vector, end: Vector, thickness: float
) -> tuple[bool, float, Vector]:
    """
    Follow a straight path to its first contact with an obstacle, and return the tangent plane.

    The distance is a safe step (sphere tracing: J. C. Hart, The Visual Computer 12, 1996). A path
    that begins at or inside the obstacle and ends deeper has its contact at the start, so that
    particles stay on their side. Along the surface, the steps are at least the thickness of walls.

    Parameters
    ----------
    obstacle : OBSTACLE
    trees : Trees
    start, end : Vector
        in the frame of the obstacle, which may have moved between them; not the same, m
    thickness : float
        distance of contact, m

    Returns
    -------
    touched : bool
    distance : float
        of the end from the plane at the contact, m
    normal : Vector
        of that plane, in the frame of the obstacle

    """
    path = minus(end, start)
    length = norm(path)
    least = max(2.0 * obstacle['ccd_threshold'], length / STEPS)
    covered, plane_distance, normal = 0.0, 0.0, (0.0, 0.0, 0.0)
    for _ in range(STEPS):
        place = along(start, covered / length, path)
        distance, normal = distance_in_frame(obstacle, trees, place)
        plane_distance = distance + dot(minus(end, place), normal)
        gap = distance - thickness
        behind = thickness - plane_distance > BEHIND * length
        if behind and gap <= TOUCHING * length:
            return True, plane_distance, normal
        covered += gap if behind else max(gap, least)
        if not covered < length:
            return False, plane_distance, normal
    # slow convergence towards the surface: the last plane is that of the contact
    return True, plane_distance, normal
