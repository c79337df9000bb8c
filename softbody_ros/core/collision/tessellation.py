# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Triangles that look like an obstacle, in its own frame."""

from __future__ import annotations

import numpy as np
import trimesh

from softbody_ros.core.config import ObstacleConfig
from softbody_ros.core.geometry.mesh import Surface, make_surface

SECTIONS = 48
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


def obstacle_surface(config: ObstacleConfig, reach: float) -> Surface:
    """
    Return the surface of an obstacle.

    Parameters
    ----------
    config : ObstacleConfig
    reach : float
        half the side of the square that stands for a plane, m

    """
    if config.type == 'mesh':
        if isinstance(config.mesh, Surface):
            return config.mesh
        return make_surface(config.mesh, config.size[0], config.subdivisions)
    if config.type == 'plane':
        return Surface(reach * SQUARE, np.array([[0, 1, 2], [0, 2, 3]]))
    shape = _round_or_box(config)
    return Surface(shape.vertices, shape.faces)


def _round_or_box(config: ObstacleConfig) -> trimesh.Trimesh:
    radius, _, half = config.size
    if config.type == 'sphere':
        return trimesh.creation.icosphere(4, radius)
    if config.type == 'cylinder':
        return trimesh.creation.cylinder(radius, 2.0 * half, 2 * SECTIONS)
    if config.type == 'capsule':
        straight = 2.0 * max(half - radius, 0.0)
        shape = trimesh.creation.capsule(straight, radius, [SECTIONS, SECTIONS])
        shape.apply_translation(-shape.bounds.mean(axis=0))
        return shape
    return trimesh.creation.box(2.0 * np.array(config.size))
