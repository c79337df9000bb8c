# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A poke: a localised impulse on a surface, inwards.

Applied to the few light particles there, the whole impulse would make them a hundred times as fast
as the body, and tear the shape. So their velocities are limited such that the dent is not deeper
than wide; the rest becomes rigid motion of the body, with the same total momentum and angular
momentum.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.geometry.surface import vertex_normals
from softbody_ros.core.rigid_fit import rigid_field
from softbody_ros.core.shape_matching.rest_shape import RestShape, weighted_mean
from softbody_ros.core.shape_matching.rigid_motion import motion_of


def velocity_change(
    x: np.ndarray,
    rest: RestShape,
    point: np.ndarray,
    radius: float,
    impulse: float,
    frequency: float,
) -> np.ndarray:
    """
    Return the changes of the velocities of a body's particles by a poke, (3, N), m/s.

    Momentum and angular momentum are those of impulses along the inward normal on the particles
    within the radius, distributed by a smooth falloff times their masses. It is the surface that
    is poked; inner particles move with the body.

    Parameters
    ----------
    x : (3, N) float
        positions, m
    rest : RestShape
    point : (3,) float
        m
    radius : float
        m
    impulse : float
        per mass of the body, m/s
    frequency : float
        of the oscillations of single particles, rad/s; 0 for a rigid body

    """
    falloff = 1.0 - ((x - point[:, None]) ** 2).sum(axis=0) / radius**2
    falloff = np.maximum(falloff, 0.0) ** 2
    falloff[rest.surface_count :] = 0.0
    total = float((falloff * rest.weights).sum())
    if not total > 0.0:
        return np.zeros_like(x)
    direction = -surface_normal(x, rest.surface.faces, rest.weights, falloff)
    local_field = impulse * direction[:, None] * (falloff / total)
    motion = np.empty((6, 3))
    motion_of(np.ascontiguousarray(x), local_field, rest.weights, rest.scale, motion)
    centre, velocity, angular_momentum, inverse_inertia = np.split(motion, [1, 2, 3])
    angular_velocity = inverse_inertia @ angular_momentum[0]
    rigid = rigid_field(velocity[0], angular_velocity, x - centre[0][:, None])
    deformation = local_field - rigid
    largest_speed = np.sqrt((deformation**2).sum(axis=0).max())
    limit = 0.5 * radius * frequency
    deformation *= min(1.0, limit / largest_speed) if largest_speed > 0.0 else 0.0
    return rigid + deformation


def surface_normal(
    x: np.ndarray, faces: np.ndarray, weights: np.ndarray, falloff: np.ndarray
) -> np.ndarray:
    """Return the mean normal (3,), weighted by falloff, on the side of the nearest particle."""
    nearest = int(falloff.argmax())
    normals = vertex_normals(x.T, faces).T
    # the other side of a thin plate is within the radius too
    facing = normals[:, nearest] @ normals > 0.0
    normal = normals @ (falloff * facing)
    length = np.linalg.norm(normal)
    if length == 0.0:  # no surface: away from the centre
        normal = x[:, nearest] - weighted_mean(x.T, weights)
        length = np.linalg.norm(normal)
    return normal / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
