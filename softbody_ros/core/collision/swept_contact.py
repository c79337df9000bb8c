# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where particles that are too fast for the closest point have entered an obstacle."""

from __future__ import annotations

import numpy as np

from softbody_ros.core.collision.obstacles import Obstacle

STEPS = 64
"""Most steps along a path."""
TOUCHING = 0.01
"""Distance from the surface, in lengths of the path, at which a particle touches it."""
BEHIND = 1e-6
"""How far behind a plane a path ends, in its lengths, if it has not just been put onto it."""


def first_touch(
    obstacle: Obstacle, start: np.ndarray, end: np.ndarray, thickness: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Follow straight paths until they come to touch an obstacle: there it is a half space for them.

    The distance says how far one may go without a touch (sphere tracing: J. C. Hart, The Visual
    Computer 12, 1996). A path that begins at or in the obstacle and ends deeper touches it there,
    so that a particle stays on the side on which it was. One that leads along the surface goes on
    in steps that no wall is thinner than.

    Parameters
    ----------
    obstacle : Obstacle
    start, end : (k, 3) float
        in the frame of the obstacle, which may have moved between them, m
    thickness : (k,) float
        distance at which paths touch, m

    Returns
    -------
    touched : (k,) bool
    distance : (k,) float
        of the end from the plane at the touch, m
    normal : (k, 3) float
        of that plane, in the frame of the obstacle

    """
    path = end - start
    length = np.linalg.norm(path, axis=1)
    touched = np.zeros(len(path), dtype=bool)
    plane_distance, normal = np.zeros(len(path)), np.zeros((len(path), 3))
    gone = np.zeros(len(path))
    going = np.arange(len(path))
    least = np.maximum(2.0 * obstacle.slow, length / STEPS)
    for _ in range(STEPS):
        place = start[going] + (gone[going] / length[going])[:, None] * path[going]
        distance, normal[going] = obstacle.distance(place)
        rest = np.einsum('ij,ij->i', end[going] - place, normal[going])
        plane_distance[going] = distance + rest
        gap = obstacle.at_least(distance) - thickness[going]
        behind = thickness[going] - plane_distance[going] > BEHIND * length[going]
        touched[going] = behind & (gap <= TOUCHING * length[going])
        gone[going] += np.where(behind, gap, np.maximum(gap, least[going]))
        going = going[~touched[going] & (gone[going] < length[going])]
        if not len(going):
            break
    # those still on their way creep towards the surface: its plane is that of the touch
    touched[going] = True
    return touched, plane_distance, normal
