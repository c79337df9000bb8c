# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts for the terminal: `sim_node --help`, and the message after the start."""

from __future__ import annotations

from collections.abc import Mapping
import importlib.util
from pathlib import Path
import shutil
import sys
import textwrap

from softbody_ros.installed_files import share_directory
from softbody_ros.ros import interfaces
from softbody_ros.scene.groups import GROUPS

PACKAGE, NODE = 'softbody_ros', '/softbody_sim'
WIDTH = 99
"""Columns of lists in `--help`."""
MOST_BODIES = 4
"""Bodies named in the message at the start; of more only the number is given."""

HELP = """\
usage: sim_node [--viewer [--host IP] [--port N]] [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] ...]

Simulates soft bodies and publishes them, live: without arguments a ball that drops on a plane.
With --viewer also runs `viewer`, a web page that shows and steers them. Stop it with Ctrl-C.

scenes, as .yaml in {config}:
{scenes}

try:
  sim_node --ros-args --params-file {example}
  sim_node --ros-args -p ball.mesh:=/path/to/part.stl -p ball.size:=0.3
  ros2 param set {node} ball.stiffness 0.1
  ros2 service call {node}/reset std_srvs/srv/Trigger

topics that it publishes (~ is {node}):
{published}
{received}
{services}

parameters; range and unit of each: ros2 param describe {node} ball.stiffness
{parameters}"""


def help_text() -> str:
    """Return what `sim_node --help` prints."""
    config = config_folder()
    scenes = sorted(path.stem for path in config.glob('*.yaml'))
    received = [topic.name for topic in interfaces.RECEIVED]
    services = [service.name for service in interfaces.SERVICES]
    services.append('those of simulation_interfaces')
    return HELP.format(
        config=config,
        scenes=_wrapped('  ' + ', '.join(scenes)),
        example=config / 'contact.yaml',
        node=NODE,
        published='\n'.join(_topic_line(topic) for topic in interfaces.PUBLISHED),
        received=_wrapped(f'topics that it subscribes to: {", ".join(received)}'),
        services=_wrapped(f'services: {", ".join(services)}'),
        parameters='\n'.join(_parameters()),
    )


def _topic_line(topic: interfaces.Topic) -> str:
    """Return name, type and content of a topic in one line."""
    latched = 'latched: ' if topic.latched else ''
    each = ''.join(f'; of one: {name}' for name in topic.names[1:])
    return f'  {topic.name:<19} {topic.short_type:<15} {latched}{topic.summary}{each}'


def _parameters() -> list[str]:
    """Return the names of the parameters by groups: as many groups in a line as fit."""
    lines: list[str] = []
    for group in GROUPS:
        # the owner stands before the first name
        others = [f'.{name}' if group.owner else name for name in group.names[1:]]
        names = ', '.join([group.full_names[0], *others])
        text = f'  {group.title.removeprefix("Body: ").lower()}: {names}'
        if lines and len(lines[-1]) + len(text) < WIDTH:
            lines[-1] += f';{text[1:]}'
        else:
            lines += _wrapped(text).splitlines()
    return lines


def _wrapped(text: str) -> str:
    """Return text in lines, all but the first one indented."""
    return textwrap.fill(
        text, WIDTH, subsequent_indent='  ', break_long_words=False, break_on_hyphens=False
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
