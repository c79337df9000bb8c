# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Best rigid fit to a deformed body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.compiled import kernel
from softbody_ros.core.geometry.vectors import (
    NO_MATRIX,
    added,
    along,
    applied,
    column_of,
    cross,
    minus,
    norm,
    outer,
    plus,
    put_matrix,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.shape_matching.polar_decomposition import rotation_of
from softbody_ros.core.shape_matching.rest_shape import RestShape
from softbody_ros.core.shape_matching.rigid_motion import inverse_inertia_of, measure


@dataclass(frozen=True)
class RigidFit:
    """
    The rigid motion that fits a deformed body best.

    Attributes
    ----------
    position : (3,) float
        of the origin of the body's own frame, m
    rotation : (3, 3) float
        from the body's own frame to the world
    linear_velocity : (3,) float
        of that origin, m/s, world axes
    angular_velocity : (3,) float
        rad/s, world axes
    displacement : (n,) float
        distance of each particle at the surface from the rest shape at this pose, m

    """

    position: np.ndarray
    rotation: np.ndarray
    linear_velocity: np.ndarray
    angular_velocity: np.ndarray
    displacement: np.ndarray


def fit_rigid_motion(x: np.ndarray, v: np.ndarray, rest: RestShape) -> RigidFit:
    """
    Return the best rigid fit: rotation of Müller et al. 2005, eq. 7; velocities from momentum.

    Parameters
    ----------
    x, v : (3, N) float
        m, m/s
    rest : RestShape

    """
    pose, displacement = np.empty((6, 3)), np.empty(x.shape[1])
    x, v = np.ascontiguousarray(x), np.ascontiguousarray(v)
    fit(x, v, rest.weights, rest.q, rest.centre, rest.scale, pose, displacement)
    displacement = displacement[: rest.surface_count]
    return RigidFit(pose[0], pose[1:4], pose[4], pose[5], displacement)


@kernel
def fit(
    x: np.ndarray,
    v: np.ndarray,
    weights: np.ndarray,
    q: np.ndarray,
    rest_centre: np.ndarray,
    scale: float,
    pose: np.ndarray,
    displacement: np.ndarray,
) -> None:
    """
    Write a rigid fit, see `RigidFit`.

    Parameters
    ----------
    x, v : (3, n) float
        m, m/s
    weights, q, rest_centre, scale
        of the rest shape
    pose : (6, 3) float
        position, rotation (3 rows), linear velocity, angular velocity
    displacement : (n,) float
        m

    """
    centre, velocity, angular_momentum, gram = measure(x, v, 0, weights)
    angular = applied(inverse_inertia_of(gram, scale), angular_momentum)
    moment = NO_MATRIX
    for i in range(len(weights)):
        arm = scaled(weights[i], minus(column_of(x, i), centre))
        moment = added(moment, outer(arm, column_of(q, i)))
    rotation = rotation_of(moment)
    for i in range(len(weights)):
        place = along(centre, scale, applied(rotation, column_of(q, i)))
        displacement[i] = norm(minus(column_of(x, i), place))
    to_origin = scaled(-1.0, applied(rotation, vector_of(rest_centre)))
    put_vector(pose[0], plus(centre, to_origin))
    put_matrix(pose[1:4], rotation)
    put_vector(pose[4], plus(velocity, cross(angular, to_origin)))
    put_vector(pose[5], angular)


def rigid_field(linear: np.ndarray, angular: np.ndarray, arms: np.ndarray) -> np.ndarray:
    """Return the velocities (3, n) of a twist at arms (3, n) from its point of reference."""
    return linear[:, None] + np.cross(angular, arms, axisb=0, axisc=0)
