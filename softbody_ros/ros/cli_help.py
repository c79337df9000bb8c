# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts for the terminal: `sim_node --help`, and the message after the start."""

from __future__ import annotations

from collections.abc import Mapping
import importlib.util
from pathlib import Path
import shutil
import sys

from softbody_ros.installed_files import share_directory

PACKAGE, NODE = 'softbody_ros', '/softbody_sim'
MOST_BODIES = 4
"""Bodies named in the message at the start; of more only the number is given."""

HELP = """\
usage: sim_node [--viewer [--host IP] [--port N]] [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] ...]

Simulates soft bodies and publishes them, live: without arguments a ball that drops on a plane.
With --viewer also runs `viewer`, a web page that shows and steers them. Stop it with Ctrl-C.

scenes, in {config}:
  {scenes}

try:
  sim_node --ros-args --params-file {example}
  sim_node --ros-args -p ball.mesh:=/path/to/part.stl -p ball.size:=0.3
  ros2 param set {node} ball.stiffness 0.1
  ros2 service call {node}/reset std_srvs/srv/Trigger

topics that it publishes (~ is {node}):
  ~/points            PointCloud2      the deformed vertices of all bodies
  ~/mesh              Marker           their surfaces, for RViz
  ~/rest_mesh         Mesh             latched: the triangles, with indices as in ~/points
  ~/visual_mesh       MarkerArray      latched: fine surfaces that bodies carry, at the start
  ~/obstacle_markers  MarkerArray      latched: what is in the way
  ~/odometry          Odometry         pose and twist of each body
  ~/contacts          WrenchStamped    what bodies feel; of one body: ~/contacts/ball
  ~/pins              WrenchStamped    what pins carry; of one body: ~/pins/ball
  ~/obstacle_contacts WrenchStamped    what obstacles feel; of one: ~/obstacle_contacts/ground
  /diagnostics        DiagnosticArray  once a second: speed, frequencies, state
topics that act on it: ~/obstacles, ~/obstacle_points, ~/wrench, ~/poke, ~/gravity;
  with robot.links also /robot_description and /joint_states
services: ~/reset, ~/apply_initial_velocity, ~/pause, ~/step

parameters, most of which change while it runs ('ball' and 'ground' are names):
  bodies, obstacles    the names of what is in the scene: set them to add and remove
  ball.mesh            .size, .subdivisions, .mesh_scale, .mesh_origin, .mesh_up: its shape;
                       .visual_mesh, .simplify_to, .color: how it is shown
  ball.position        and .orientation, .initial_velocity: how it starts
  ball.mode            rigid, linear or quadratic; .stiffness, or .natural_frequency, or
                       .young_modulus; .bounciness, .deformation, .volume_conservation, .damping
  ball.mass            or .density, and .mass_distribution: what it weighs, and where
  ball.elasticity      how it bounces; .friction, .friction_model, .thickness: how it touches
  ball.regions         local bending; .plasticity: dents that stay; .pins, .attach: held vertices
  ground.type          and .mesh, .size, .position, .orientation, .velocity of an obstacle;
                       .surface_velocity, .friction, .elasticity: of its surface
  gravity, time_scale  slow motion; time_step, reference_step, step_count, history: time
  points_rate          and mesh_rate: how often it publishes; frame_id, publish_tf: frames
  input_timeout        and poke, obstacle_points, robot: what others send, and links of a robot
Each with range and unit: ros2 param describe {node} ball.stiffness, or the README."""


def help_text() -> str:
    """Return what `sim_node --help` prints."""
    config = config_folder()
    scenes = sorted(path.name for path in config.glob('*.yaml'))
    return HELP.format(
        config=config, scenes=', '.join(scenes), example=config / 'contact.yaml', node=NODE
    )


def where_to_look(
    node: str, clock: str, vertices: Mapping[str, int], topics: tuple[str, str]
) -> str:
    """
    Return the message of the node at its start: what it simulates, how to see and control it.

    Parameters
    ----------
    node : str
        its name with its namespace
    clock : str
    vertices : mapping of str to int
        of each body
    topics : (str, str)
        the names of the cloud and of the surfaces

    """
    example = f'{next(iter(vertices))}.stiffness 0.1' if vertices else "bodies '[ball]'"
    bodies = ', '.join(f'{name} ({count} vertices)' for name, count in vertices.items())
    if len(vertices) > MOST_BODIES:
        bodies = f'{len(vertices)} bodies ({sum(vertices.values())} vertices)'
    return '\n'.join(
        [
            f'simulating {bodies or "no bodies"} on {clock}',
            f'  see it    {_ways_to_see(node)}',
            f'  use it    {topics[0]} (PointCloud2), {topics[1]} (Marker)',
            f'  steer it  ros2 param set {node} {example}',
            f'  learn     {_command("sim_node")} --help',
        ]
    )


def _ways_to_see(node: str) -> str:
    command = _command('viewer')
    if '--viewer' in sys.argv[1:]:
        return 'in a browser, where the viewer says'
    if importlib.util.find_spec('viser') is None:
        web = f"`{command}` in a browser, after {_command('pip')} install '.[viewer]'"
    else:
        web = f'`{command}`, then http://127.0.0.1:8080 in a browser'
    if node != NODE:
        # the RViz layout has the topics of the default node name
        return web.replace(command, f'{command} --node {node}')
    return f'{web}; or rviz2 -d {config_folder() / "softbody.rviz"}'


def _command(name: str) -> str:
    """Return how to call a command installed in the same way as this one."""
    own = Path(sys.argv[0])
    if own.name != 'sim_node':
        return name
    if own.parent.name == PACKAGE:  # in a workspace
        return name if name == 'pip' else f'ros2 run {PACKAGE} {name}'
    found = shutil.which(own.name)
    return name if found and own.samefile(found) else str(own.with_name(name))


def config_folder() -> Path:
    """Return the folder of the scenes and the RViz layout, installed or in the clone."""
    try:
        return Path(share_directory(PACKAGE)) / 'config'
    except (LookupError, ValueError, OSError, ImportError):
        # an unusual pip target: nothing of the folder is needed to run
        return Path(__file__).parents[2] / 'config'
