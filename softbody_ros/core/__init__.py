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
consists of arrays of the particles of all bodies, and a record of each body (body.py). Particles
are the vertices of a surface; bodies with mass inside (shape_matching/solid.py) have a few more,
which are matched only. A tick is a sequence of stages (step.py), each one or several kernels
(compiled.py) over all awake bodies:

1. shape_matching/modal_flight.py, motion without contacts: sum up moments (moments, four particles
   at a time: lanes.py), match the rest shape (eq. 7: polar_decomposition; fit and volume:
   matching; plasticity), move each kind of deformation as the oscillator that it is (gains), and
   the body as a rigid one (rigid_motion, free_rotation). Bodies with regions or pins:
   goal_flight.py, each particle as an oscillator about its goal (goals.py, eq. 9, 10; regions;
   pins). The result is a linear map of all particles (flight_map).
2. contact/detection.py, all contacts of bodies with obstacles, points and each other, as rows
   (rows.py): found by collision/obstacle_contacts.py (shapes in collision/shapes.py, meshes in
   geometry/bvh.py) and collision/body_contacts.py (broad_phase, narrow_phase, edge_contacts). Of
   bodies that are inside each other, those that lead out (overlaps.py).
3. contact/resolution.py: one problem for each island (island.py, problem.py, working_set.py), of
   bodies that yield by their modes (members.py), solved (solver.py, newton.py) once for positions
   (positions.py) and once for velocities (velocities.py). The equations are in
   docs/explanation/contact.md.
4. sleeping.py: islands at rest fall asleep, and are not simulated until something wakes them.

What contacts exert in a tick, each stage adds to the results of contact/exchange.py, which are
integrated over time (contact_forces.py); mean_wrenches.py has the means for readers.

config.py has all settings; external_inputs.py the inputs at run time: obstacles, points, wrenches,
gravity; poke.py localised impulses; attachments.py what of a body moves with an obstacle;
kinematic_tree.py and links.py links of robots as obstacles; structure.py, body_shape.py and
prepared_config.py other bodies and obstacles, loaded beforehand. embedding.py carries fine
surfaces by simulated ones, for pictures.
"""

from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.config import BodyConfig, ConfigError, ObstacleConfig, WorldConfig
from softbody_ros.core.contact_forces import ContactImpulse, Departure
from softbody_ros.core.embedding import Embedding
from softbody_ros.core.external_inputs import ObstacleRemoval, ObstacleUpdate
from softbody_ros.core.geometry.mesh import MeshFrame, make_surface
from softbody_ros.core.geometry.surface import MeshError, Surface
from softbody_ros.core.mean_wrenches import MeanWrenches
from softbody_ros.core.prepared_config import PreparedConfig
from softbody_ros.core.rigid_fit import RigidFit
from softbody_ros.core.step import SimulationError, SolverWork
from softbody_ros.core.world import Snapshot, World

__all__ = [
    'BodyConfig',
    'ConfigError',
    'ContactImpulse',
    'Departure',
    'Embedding',
    'MeanWrenches',
    'MeshError',
    'MeshFrame',
    'ObstacleConfig',
    'ObstacleRemoval',
    'ObstacleUpdate',
    'PointObstacles',
    'PreparedConfig',
    'RigidFit',
    'SimulationError',
    'Snapshot',
    'SolverWork',
    'Surface',
    'World',
    'WorldConfig',
    'make_surface',
]
