# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The table of all topics and services of the node.

The node makes its publishers, subscriptions and services from it; `sim_node --help`, README and
the reference pages list it. Nothing is imported for it, so that `--help` is immediate.
"""

from __future__ import annotations

from dataclasses import dataclass
import importlib
from typing import Any

EXAMPLES = {'body': 'ball', 'obstacle': 'ground'}
"""Names in the default scene, by what a topic may exist for each of."""


@dataclass(frozen=True)
class Interface:
    """
    A topic or a service.

    Attributes
    ----------
    name : str
        `~` is the name of the node
    type : str
        as ROS writes it: package/msg/Type or package/srv/Type
    summary : str
        a short noun phrase
    description : str
        full sentences that stand alone; names of parameters, topics and fields are in backticks
    requires : str
        the parameter that must be set, or the package that must be installed, for it to exist

    """

    name: str
    type: str
    summary: str
    description: str
    requires: str = ''

    @property
    def kind(self) -> Any:
        """The class of its messages, or of the service; ImportError if it is not installed."""
        package, folder, name = self.type.split('/')
        return getattr(importlib.import_module(f'{package}.{folder}'), name)

    @property
    def short_type(self) -> str:
        """The type without its package."""
        return self.type.rpartition('/')[2]


@dataclass(frozen=True)
class Topic(Interface):
    """
    A topic with its quality of service.

    Attributes
    ----------
    depth : int
        of the queue; of outputs with a message for each body or obstacle, the least one
    reliable : bool
    latched : bool
        whether the last message is kept for later subscribers (transient local durability); of a
        subscription, whether it also receives what publishers keep
    each : str
        'body' or 'obstacle' if there are topics for each, too, such as ~/contacts/ball

    """

    depth: int = 10
    reliable: bool = True
    latched: bool = False
    each: str = ''

    @property
    def names(self) -> tuple[str, ...]:
        """Its name, and that of one body or obstacle, as in the default scene."""
        return (self.name, f'{self.name}/{EXAMPLES[self.each]}') if self.each else (self.name,)


WRENCH = 'geometry_msgs/msg/WrenchStamped'
MARKERS = 'visualization_msgs/msg/MarkerArray'
FRAMES = 'tf2_msgs/msg/TFMessage'
MEAN = (
    'The values are means over the time since the previous message, so that no impact is missed '
    'at any rate; one message of zeros follows when the forces end.'
)

# ------------------------------------------------------------------------------------- published
POINTS = Topic(
    '~/points', 'sensor_msgs/msg/PointCloud2', 'vertices of all bodies',
    'Positions and further fields of all simulated vertices, at `points_rate`. Bodies are in '
    'order, and a vertex keeps its row until a body is added or removed.',
)  # fmt: skip
MESH = Topic(
    '~/mesh', 'visualization_msgs/msg/Marker', 'surfaces of the bodies',
    'Surface of one body as a TRIANGLE_LIST whose `ns` is its name, one message for each body at '
    '`mesh_rate`. A body with `visual_mesh` or `simplify_to` has its fine surface here. A DELETE '
    'follows when a body is removed.',
)  # fmt: skip
REST_MESH = Topic(
    '~/rest_mesh', 'shape_msgs/msg/Mesh', 'triangles between the vertices of ~/points',
    'Triangles of all bodies with the vertex indices of `~/points`, and the vertices at their '
    'start poses. It is published at the start, and before the next `~/points` when bodies have '
    'been added or removed.',
    depth=1, latched=True,
)  # fmt: skip
VISUAL_MESH = Topic(
    '~/visual_mesh', MARKERS, 'fine surfaces of bodies, at their start poses',
    'A DELETEALL, then the fine surfaces of bodies with `visual_mesh` or `simplify_to` at their '
    'start poses: TRIANGLE_LISTs whose `ns` is the name and whose `id` is the number of the body '
    'in `~/points`. It is published just before `~/rest_mesh`.',
    depth=1, latched=True,
)  # fmt: skip
OBSTACLE_MARKERS = Topic(
    '~/obstacle_markers', MARKERS, 'all obstacles',
    'A DELETEALL, then all obstacles: those of the scene, links of the robot and those received. '
    'It is published when one changes, and at `mesh_rate` while one moves.',
    depth=1, latched=True,
)  # fmt: skip
ODOMETRY = Topic(
    '~/odometry', 'nav_msgs/msg/Odometry', 'pose and twist of each body',
    'Best-fit rigid pose of one body, whose name is `child_frame_id`, and its twist in its own '
    'axes; one message for each body at `points_rate`.',
)  # fmt: skip
BODY_FRAMES = Topic(
    '/tf', FRAMES, 'pose of each body as a TF frame',
    'Best-fit rigid pose of each body as a frame of its name, at `points_rate`, if `publish_tf` '
    'is true.',
    depth=100, requires='tf2_ros',
)  # fmt: skip
CONTACTS = Topic(
    '~/contacts', WRENCH, 'wrench of contacts on each body',
    'Force and torque of all contacts of a body, about its centre of mass in world axes, for '
    f'each body in contact, in order, at `points_rate`. {MEAN}',
    each='body',
)  # fmt: skip
PINS = Topic(
    '~/pins', WRENCH, 'wrench of pins on each body',
    'Force and torque by which pins, or the obstacle that it is attached to, hold a body, about '
    f'its centre of mass in world axes, for each body that is held, in order, at `points_rate`. '
    f'{MEAN}',
    each='body',
)  # fmt: skip
OBSTACLE_CONTACTS = Topic(
    '~/obstacle_contacts', WRENCH, 'wrench on each obstacle',
    'Force and torque that all bodies exert on an obstacle or a robot link, about its origin and '
    f'in its axes, for each one in contact, at `points_rate`; `frame_id` is its name. {MEAN}',
    each='obstacle',
)  # fmt: skip
DIAGNOSTICS = Topic(
    '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 'once a second: speed, state, bodies',
    'State of the node, once a second: real-time factor, time of steps and of publishing, '
    'dropped time, work of the contact solver, gravity and its source, received inputs; of each '
    'body its number in `~/points`, frequency, material, damping ratio, permanent strain and '
    'whether it sleeps.',
)  # fmt: skip
PUBLISHED = (
    POINTS,
    MESH,
    REST_MESH,
    VISUAL_MESH,
    OBSTACLE_MARKERS,
    ODOMETRY,
    BODY_FRAMES,
    CONTACTS,
    PINS,
    OBSTACLE_CONTACTS,
    DIAGNOSTICS,
)

# -------------------------------------------------------------------------------------- received
OBSTACLES = Topic(
    '~/obstacles', MARKERS, 'external obstacles: boxes, spheres, cylinders',
    'External obstacles as CUBE, SPHERE and CYLINDER markers, each identified by `ns` and `id`; '
    'ADD, DELETE, DELETEALL and `lifetime` are supported.',
)  # fmt: skip
OBSTACLE_POINTS = Topic(
    '~/obstacle_points', 'sensor_msgs/msg/PointCloud2', 'points that are obstacles',
    'Points that act as obstacles, such as those of a depth camera, in place of those of the '
    'previous message; float32 or float64 `x y z` in any layout.',
    # only the newest cloud matters; best effort also hears reliable publishers
    depth=2, reliable=False,
)  # fmt: skip
APPLIED_WRENCH = Topic(
    '~/wrench', WRENCH, 'force and torque on a body',
    'Force and torque on the body that `frame_id` names, at its centre of mass in its own axes; '
    'with `frame_id` of the world, on every body in world axes. It ends after `input_timeout`.',
)  # fmt: skip
POKE = Topic(
    '~/poke', 'geometry_msgs/msg/PointStamped', 'impulse on the surface at a point',
    'Point at which the nearest surface is pushed inwards by `poke.impulse`, such as the '
    '`/clicked_point` of RViz.',
)  # fmt: skip
GRAVITY = Topic(
    '~/gravity', 'geometry_msgs/msg/Vector3Stamped', 'gravity, in place of the parameters',
    'Gravitational acceleration in m/s², in place of `gravity.magnitude` and '
    '`gravity.direction`. It ends after `input_timeout`.',
)  # fmt: skip
ROBOT_DESCRIPTION = Topic(
    '/robot_description', 'std_msgs/msg/String', 'URDF of a robot',
    'URDF of the robot whose links `robot.links` selects as obstacles.',
    latched=True, requires='robot.links',
)  # fmt: skip
JOINT_STATES = Topic(
    '/joint_states', 'sensor_msgs/msg/JointState', 'joint positions of the robot',
    'Positions and, if sent, velocities of the joints of the robot.',
    requires='robot.links',
)  # fmt: skip
CLOCK = Topic(
    '/clock', 'rosgraph_msgs/msg/Clock', 'time that drives the simulation',
    'Time that the simulation follows, forwards and backwards.',
    depth=1, reliable=False, requires='use_sim_time',
)  # fmt: skip
TRANSFORMS = Topic(
    '/tf', FRAMES, 'frames of received messages',
    'Frames of received messages that are not in the world frame, and of the root of the robot.',
    depth=100, requires='tf2_ros',
)  # fmt: skip
STATIC_TRANSFORMS = Topic(
    '/tf_static', FRAMES, 'fixed frames of received messages',
    'Fixed frames, used like those of `/tf`.',
    depth=100, latched=True, requires='tf2_ros',
)  # fmt: skip
RECEIVED = (
    OBSTACLES,
    OBSTACLE_POINTS,
    APPLIED_WRENCH,
    POKE,
    GRAVITY,
    ROBOT_DESCRIPTION,
    JOINT_STATES,
    CLOCK,
    TRANSFORMS,
    STATIC_TRANSFORMS,
)

# -------------------------------------------------------------------------------------- services
RESET = Interface(
    '~/reset', 'std_srvs/srv/Trigger', 'everything back to its start',
    'Returns the bodies to their start poses, rest shapes and initial velocities, without '
    'permanent deformation: bit by bit as after a fresh start.',
)  # fmt: skip
APPLY_INITIAL_VELOCITY = Interface(
    '~/apply_initial_velocity', 'std_srvs/srv/Trigger', 'velocities set, shapes kept',
    'Sets the velocities of all bodies to `initial_velocity.linear` and '
    '`initial_velocity.angular`; their shapes and poses stay.',
)  # fmt: skip
PAUSE = Interface(
    '~/pause', 'std_srvs/srv/SetBool', 'pause or resume',
    'Pauses the simulation with `data` true, resumes it with `data` false.',
)  # fmt: skip
STEP = Interface(
    '~/step', 'std_srvs/srv/Trigger', '`step_count` ticks while paused',
    'Simulates `step_count` ticks while the simulation is paused, and answers when they are done.',
)  # fmt: skip
SERVICES = (RESET, APPLY_INITIAL_VELOCITY, PAUSE, STEP)


def _standard(name: str, kind: str, summary: str, description: str) -> Interface:
    package = 'simulation_interfaces'
    return Interface(f'~/{name}', f'{package}/srv/{kind}', summary, description, package)


STANDARD_SERVICES = (
    _standard(
        'get_simulator_features', 'GetSimulatorFeatures', 'supported features',
        'Returns the features of the standard, and the file formats, that the node supports.',
    ),
    _standard(
        'get_entities', 'GetEntities', 'names of the bodies',
        'Returns the names of all bodies, or of those that match a regular expression or lie in a '
        'sphere.',
    ),
    _standard(
        'get_entity_state', 'GetEntityState', 'pose and twist of a body',
        'Returns the best-fit rigid pose of a body and its twist, both in the world frame.',
    ),
    _standard(
        'set_entity_state', 'SetEntityState', 'pose or twist of a body set',
        'Moves a body to a pose as it is, deformed or not, or sets its velocity.',
    ),
    _standard(
        'spawn_entity', 'SpawnEntity', 'body or scene added',
        'Adds a primitive, a mesh file or a scene file, given by URI or as text, at a pose.',
    ),
    _standard(
        'spawn_entities', 'SpawnEntities', 'several bodies or scenes added',
        'Adds several entities, each as `~/spawn_entity` does; requires version 1.6 or 2.1 of the '
        'package.',
    ),
    _standard(
        'delete_entity', 'DeleteEntity', 'body, obstacle or scene removed',
        'Removes a body or an obstacle, or all bodies and obstacles that one scene file added.',
    ),
    _standard(
        'reset_simulation', 'ResetSimulation', 'reset of state, spawned entities or all',
        'Resets the state, removes what has been added since the start, or does both and restores '
        'what has been removed, as its `scope` says.',
    ),
    _standard(
        'get_simulation_state', 'GetSimulationState', 'playing, paused or stopped',
        'Returns whether the simulation is playing, paused or stopped.',
    ),
    _standard(
        'set_simulation_state', 'SetSimulationState', 'play, pause or stop',
        'Plays, pauses or stops the simulation; to stop it is to pause it at its start.',
    ),
    _standard(
        'step_simulation', 'StepSimulation', 'ticks while paused',
        'Simulates a number of ticks while the simulation is paused, and answers when they are '
        'done.',
    ),
)  # fmt: skip
