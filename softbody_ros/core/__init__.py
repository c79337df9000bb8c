# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The simulator, a library on NumPy, SciPy, Numba and trimesh; no ROS.

>>> from softbody_ros.core import BodyConfig, World, WorldConfig
>>> world = World(WorldConfig(bodies=(BodyConfig(name='ball', stiffness=0.3),)))
>>> world.step(240)
>>> world.positions('ball').shape
(642, 3)

`World` (world.py) holds bodies and obstacles and advances them tick by tick. The state (state.py)
consists of arrays of the particles of all bodies, and a record of each body (body.py). A tick is a
sequence of stages (step.py), each one or several kernels (compiled.py) over all awake bodies:

1. shape_matching/flight.py, motion without contacts: predict positions and sum up moments
   (moments, four particles at a time: lanes.py), match the rest shape (goals; eq. 7:
   polar_decomposition; fit and volume: matching; regions; plasticity), pull towards the goal (eq.
   9, 10: gains), restore momentum and angular momentum (rigid_motion).
2. contact/body_body.py, contacts between bodies, and with points and edges of obstacles:
   candidates by collision/broad_phase.py, contacts by collision/narrow_phase.py; then the loads of
   piles (manifold), constraints between whole bodies (body_constraints), and impulses, friction
   and position correction at each contact (particle_solver).
3. contact/soft_obstacle.py, contact/rigid_obstacle.py, contacts with obstacles: found by
   collision/obstacle_contacts.py, shapes in collision/shapes.py, meshes in geometry/bvh.py.
4. shape_matching/pins.py: prescribed motion of pinned particles.
5. sleeping.py: islands at rest fall asleep, and are not simulated until something wakes them.

config.py has all settings; external_inputs.py the inputs at run time: obstacles, points, wrenches,
gravity; poke.py localised impulses.
"""

from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.config import BodyConfig, ConfigError, ObstacleConfig, WorldConfig
from softbody_ros.core.external_inputs import ObstacleRemoval, ObstacleUpdate
from softbody_ros.core.geometry.mesh import MeshError, Surface, make_surface
from softbody_ros.core.rigid_fit import RigidFit
from softbody_ros.core.step import SimulationError
from softbody_ros.core.world import Snapshot, World

__all__ = [
    'BodyConfig',
    'ConfigError',
    'MeshError',
    'ObstacleConfig',
    'ObstacleRemoval',
    'ObstacleUpdate',
    'PointObstacles',
    'RigidFit',
    'SimulationError',
    'Snapshot',
    'Surface',
    'World',
    'WorldConfig',
    'make_surface',
]
