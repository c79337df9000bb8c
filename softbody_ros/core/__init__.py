# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The simulator: NumPy, SciPy and trimesh only, no ROS."""

from softbody_ros.core.config import BodyConfig, ConfigError, ObstacleConfig, WorldConfig
from softbody_ros.core.mesh import MeshError, Surface, make_surface
from softbody_ros.core.outside import Placement, Removal
from softbody_ros.core.point_obstacles import PointObstacles
from softbody_ros.core.tick import SimulationError
from softbody_ros.core.world import RigidFit, Snapshot, World

__all__ = [
    'BodyConfig',
    'ConfigError',
    'MeshError',
    'ObstacleConfig',
    'Placement',
    'PointObstacles',
    'Removal',
    'RigidFit',
    'SimulationError',
    'Snapshot',
    'Surface',
    'World',
    'WorldConfig',
    'make_surface',
]
