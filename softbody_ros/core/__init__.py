# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The simulator: NumPy, SciPy and trimesh only, no ROS.

>>> from softbody_ros.core import BodyConfig, World, WorldConfig
>>> world = World(WorldConfig(bodies=(BodyConfig(name='ball', stiffness=0.3),)))
>>> world.step(240)
>>> world.positions('ball').shape
(642, 3)

`World` holds the state and takes the ticks. A tick of a body, in the order of `dynamics.fly` and
`dynamics.land`, and where to read about each stage:

config, mesh, rest_shape
    what there is: settings, surfaces, and what a match needs of a shape, computed once.
gains
    what stiffness, bounciness and damping mean for one tick.
basis, matching, goals
    predicted particles → rotation and fit → goals; with regions, plasticity and pins.
dynamics, rigid_motion
    the pull towards the goals, and the momentum that it must not change.
body_contact
    bodies meet each other and points; touch, meeting, crowd, stops and grip are its parts.
obstacles, contact, rigid_contact
    bodies meet what is in the way.
outside, poke
    what others do to a world: obstacles, wrenches, gravity, pokes.
sleep
    bodies that lie still stop moving and cost nothing.

columns, sums, particles, boxes, grid and the like are tools of these.
"""

from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.config import BodyConfig, ConfigError, ObstacleConfig, WorldConfig
from softbody_ros.core.external_inputs import Placement, Removal
from softbody_ros.core.geometry.mesh import MeshError, Surface, make_surface
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
