# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pages of topics and services, and the table of both in README."""

from collections.abc import Sequence

from reference.markdown import code, page, table

from softbody_ros.ros.interfaces import (
    POINTS,
    PUBLISHED,
    RECEIVED,
    SERVICES,
    STANDARD_SERVICES,
    Interface,
    Topic,
)
from softbody_ros.ros.messages import POINT_TYPE

PACKAGES = ('tf2_ros', 'simulation_interfaces')
TYPES = {'f4': 'float32', 'u4': 'uint32'}
POINT_FIELDS = {
    'x': ('m', 'position in the world frame'),
    'y': ('m', 'position in the world frame'),
    'z': ('m', 'position in the world frame'),
    'displacement': ('m', 'distance from the rest shape in its best-fit rigid pose'),
    'body': (
        '',
        'number of the body: names in `bodies` are counted from 0 at the start, those added later '
        'follow; a name keeps its number',
    ),
    'pressure': (
        'Pa',
        'normal force of all contacts on the vertex in the last tick, over a third of the area of '
        'its triangles at rest',
    ),
    'permanent_strain': ('', 'largest principal strain that plastic flow has left'),
}
"""Unit and content of each field of ~/points."""

TOPICS_BEGIN = """\
`~` is the name of the node, `/softbody_sim` by default. What the messages contain, and what is
accepted, is described in [Messages](messages.md)."""

PUBLISHED_BEGIN = """\
Topics at `points_rate` and `mesh_rate` are packed only while somebody subscribes (`/tf`: always).
Subscribe to a topic that is *transient local* with transient local durability to receive its last
message at any time."""
DEPTHS = """\
Where a topic has a message for each body, or for each obstacle and link, its queue has room for at
least twice their number, and at least the depth given here: let that of a subscriber have as
much."""

RECEIVED_BEGIN = """\
A message that cannot be used is ignored, with a warning at most every 5 s for each topic.
Publishers are heard whether they are reliable or best effort, and what they have sent as
transient local before the node started is received within a second."""

STANDARD_BEGIN = """\
These are offered where the package
[simulation_interfaces](https://github.com/ros-simulation/simulation_interfaces) is installed.
Types are those of its folder `srv`. Entities are the bodies."""


def topics_page() -> str:
    """Return the page of topics."""
    head = ('topic', 'type', 'quality of service')
    return page(
        'Topics',
        TOPICS_BEGIN,
        '## Published',
        PUBLISHED_BEGIN,
        table(head, map(_topic_row, PUBLISHED)),
        DEPTHS,
        _descriptions(PUBLISHED),
        f'## Fields of {POINTS.name}',
        f'A point has {POINT_TYPE.itemsize} bytes, little endian.',
        _fields(),
        '## Subscribed',
        RECEIVED_BEGIN,
        table(head, map(_topic_row, RECEIVED)),
        _descriptions(RECEIVED),
    )


def services_page() -> str:
    """Return the page of services."""
    head = ('service', 'type', 'effect')
    return page(
        'Services',
        '`~` is the name of the node, `/softbody_sim` by default. Parameters are set and read by '
        'the services that\nevery node has, see [Parameters](parameters.md).',
        '## Of the node',
        table(head, map(_service_row, SERVICES)),
        '## Of simulation_interfaces',
        STANDARD_BEGIN,
        table(head, map(_service_row, STANDARD_SERVICES)),
    )


def _descriptions(topics: Sequence[Topic]) -> str:
    # not in the table: beside long names of types it would be a column of a few words
    return '\n'.join(f'* {_names(topic)}: {_description(topic)}' for topic in topics)


def short_table() -> str:
    """Return the table of topics and services in README."""
    rows: list[tuple[str, ...]] = []
    for direction, interfaces in (
        ('published', PUBLISHED),
        ('subscribed', RECEIVED),
        ('service', SERVICES),
    ):
        rows += [_short_row(direction, each) for each in interfaces]
    names = ', '.join(code(service.name) for service in STANDARD_SERVICES)
    rows.append(('service', names, 'simulation_interfaces', 'where that package is installed'))
    return table(('', 'name', 'type', 'content'), rows)


def _short_row(direction: str, interface: Interface) -> tuple[str, ...]:
    content = interface.summary
    if isinstance(interface, Topic) and interface.latched and direction == 'published':
        content += ', latched'
    if interface.requires:
        content += f' (with `{interface.requires}`)'
    names = _names(interface) if isinstance(interface, Topic) else code(interface.name)
    return direction, names, interface.type, content


def _topic_row(topic: Topic) -> Sequence[str]:
    return _names(topic), topic.type, _quality(topic)


def _names(topic: Topic) -> str:
    return ', '.join(map(code, topic.names))


def _service_row(service: Interface) -> Sequence[str]:
    kind = service.type if service in SERVICES else service.short_type
    return code(service.name), kind, service.description


def _quality(topic: Topic) -> str:
    reliability = 'reliable' if topic.reliable else 'best effort'
    durability = ', transient local' if topic.latched else ''
    return f'{reliability}{durability}, depth {topic.depth}'


def _description(interface: Interface) -> str:
    if not interface.requires:
        return interface.description
    state = 'installed' if interface.requires in PACKAGES else 'set'
    return f'{interface.description} Only with `{interface.requires}` {state}.'


def _fields() -> str:
    rows = []
    for name in POINT_TYPE.names or ():
        kind, offset = POINT_TYPE.fields[name][:2]
        unit, content = POINT_FIELDS[name]
        rows.append((code(name), TYPES[kind.str[1:]], str(offset), unit, content))
    return table(('field', 'type', 'offset', 'unit', 'content'), rows)
