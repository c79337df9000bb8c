# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A poke: an impulse at one place of a surface, inwards.

The few particles there are light: the whole impulse would make them a hundred times as fast as
the body becomes, and tear the shape. So only so much of it stays with them that the dent is not
deeper than wide; the rest goes to the body as a whole, with the momentum and angular momentum
that the particles would have had.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.geometry.mesh import vertex_normals
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.shape_matching.rest_shape import RestShape
from softbody_ros.core.sums import weighted


def velocity_change(
    x: np.ndarray,
    rest: RestShape,
    point: np.ndarray,
    radius: float,
    impulse: float,
    frequency: float,
) -> np.ndarray:
    """
    Return what a poke adds to the velocities of a body's particles, (3, n), m/s.

    Momentum and angular momentum are those of impulses along the inward normal on the particles
    within the radius, with a smooth weight times their masses, that sum up to the whole impulse.

    Parameters
    ----------
    x : (3, n) float
        positions, m
    rest : RestShape
    point : (3,) float
        m
    radius : float
        m
    impulse : float
        per mass of the body, m/s
    frequency : float
        at which the body swings, rad/s; 0 is a rigid one

    """
    share = 1.0 - ((x - point[:, None]) ** 2).sum(axis=0) / radius**2
    share = np.maximum(share, 0.0) ** 2
    total = weighted(share[None], rest.weights)[0]
    if not total > 0.0:
        return np.zeros_like(x)
    direction = -outwards(x, rest.surface.faces, rest.weights, share)
    local = (impulse * direction[:, None] * (share / total))[None]
    centre = weighted(x, rest.weights)[None]
    motion = rigid_motion.rigid_motion(x[None], local, centre, rest)
    whole = rigid_motion.field(x[None], centre, motion.velocity, motion.angular_velocity)
    dent = local - whole
    fastest = np.sqrt((dent**2).sum(axis=1).max())
    largest = 0.5 * radius * frequency
    dent *= min(1.0, largest / fastest) if fastest > 0.0 else 0.0
    return (whole + dent)[0]


def outwards(
    x: np.ndarray, faces: np.ndarray, weights: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """Return the mean normal (3,) of particles by share that face as the first of them does."""
    nearest = int(share.argmax())
    normals = vertex_normals(x.T, faces).T
    # a thin plate has its other side within the radius too
    facing = normals[:, nearest] @ normals > 0.0
    normal = normals @ (share * facing)
    length = np.linalg.norm(normal)
    if length == 0.0:  # no surface there: away from the middle
        normal = x[:, nearest] - weighted(x, weights)
        length = np.linalg.norm(normal)
    return normal / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
