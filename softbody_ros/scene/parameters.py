# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The table of all parameters.

`table` lists every parameter with its `Setting`, from which declaration, descriptors, validation,
the config of the core and the reference pages (`python3 tools/write_reference.py`) follow.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
import difflib
import math
import numbers
import os
from typing import Any, TypeVar

from softbody_ros.core.config import (
    BodyConfig,
    Checked,
    ConfigError,
    ObstacleConfig,
    Setting,
    WorldConfig,
    checked,
    require_distinct,
    require_usable_name,
    setting,
    settings,
    shown,
    unknown_name,
)
from softbody_ros.installed_files import share_directory

FOREIGN_PREFIXES = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
"""Prefixes of parameters that every node has, which are not part of the scene."""

MOST_PARTS = 3
"""Of a group of parameters, that are named in a sentence."""
MISSPELT = 0.8
"""Similarity of names (difflib) from which on one is taken for a misspelt other one."""

_HasMesh = TypeVar('_HasMesh', BodyConfig, ObstacleConfig)


@dataclass(frozen=True)
class NodeConfig(Checked):
    """Settings of the node."""

    frame_id: str = setting(
        'world', 'Name of the world frame, in which bodies and obstacles are placed and published',
        read_only=True,
    )  # fmt: skip
    points_rate: float = setting(
        60.0, 'Rate of ~/points, ~/odometry, TF and the topics of forces, in clock time; 0 is off',
        unit='Hz', minimum=0.0, maximum=1e4,
    )  # fmt: skip
    mesh_rate: float = setting(
        30.0, 'Rate of ~/mesh, and of ~/obstacle_markers while obstacles move, in clock time; 0 '
        'is off', unit='Hz', minimum=0.0, maximum=1e4,
    )  # fmt: skip
    time_scale: float = setting(
        1.0, 'Simulated seconds per second of clock time; 0 freezes the simulation', minimum=0.0,
        maximum=10.0,
    )  # fmt: skip
    history_memory: float = setting(
        128.0, 'Memory for the snapshots from which the simulation goes back in time with '
        '/clock; 0 simulates again from the start', unit='MiB', minimum=0.0, maximum=1e6,
        group='history',
    )  # fmt: skip
    publish_tf: bool = setting(
        True, 'Whether the pose of each body is broadcast as a TF frame of its name, at '
        'points_rate; requires tf2_ros',
    )  # fmt: skip
    step_count: int = setting(
        1, 'Number of ticks that one call of ~/step simulates', minimum=1, maximum=1_000_000
    )

    input_timeout: float = setting(
        0.5, 'Simulated time for which the last message of ~/wrench and ~/gravity, and the last '
        'velocities of ~/obstacles and /joint_states, stay in effect', unit='s', minimum=1e-3,
        maximum=1e4,
    )  # fmt: skip
    obstacle_points_radius: float = setting(
        0.02, 'Radius of the sphere that stands for each point of ~/obstacle_points', unit='m',
        minimum=1e-4, maximum=1e3, group='obstacle_points',
    )  # fmt: skip
    obstacle_points_self_filter: float = setting(
        -1.0, 'Distance from the surface of a body within which points of ~/obstacle_points are '
        'ignored, because a camera sees the bodies as well; less than obstacle_points.radius; 0 '
        'is off, negative is half of that radius', unit='m', minimum=-1.0, maximum=1e3,
        group='obstacle_points',
    )  # fmt: skip
    obstacle_points_noise: float = setting(
        0.002, 'Standard deviation of the noise in ~/obstacle_points: points near bodies that '
        'move by no more than noise are held still; 0 uses all points as received', unit='m',
        minimum=0.0, maximum=1e3, group='obstacle_points',
    )  # fmt: skip
    poke_radius: float = setting(
        0.15, 'Radius of the part of the surface that a message on ~/poke pushes inwards',
        unit='m', minimum=1e-4, maximum=1e3, group='poke',
    )  # fmt: skip
    poke_impulse: float = setting(
        1.5, 'Impulse, directed inwards, of a message on ~/poke', unit='N s', minimum=0.0,
        maximum=1e6, group='poke',
    )  # fmt: skip
    robot_links: tuple[str, ...] = setting(
        (), 'Links of the robot in /robot_description that are obstacles and follow '
        "/joint_states: names, or patterns such as '*finger*'; empty for none", items=str,
        group='robot',
    )  # fmt: skip
    robot_pose: tuple[float, ...] = setting(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), 'Pose of the root link of the robot in frame_id: '
        'position x y z, orientation as a quaternion x y z w; the default takes the pose from '
        'TF where tf2_ros is installed', unit='m', minimum=-1e6, maximum=1e6, group='robot',
    )  # fmt: skip
    robot_friction: float = setting(
        -1.0, 'Friction coefficient of the links of the robot, combined with that of a body by '
        'the geometric mean; negative uses that of the body alone', minimum=-1.0, maximum=10.0,
        group='robot',
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.frame_id:
            raise ConfigError("frame_id is '': give the name of a frame, for example world")
        if self.obstacle_points_self_filter >= self.obstacle_points_radius:
            raise ConfigError(
                f'obstacle_points.self_filter is {self.obstacle_points_self_filter:g}: it must be '
                f'less than obstacle_points.radius, {self.obstacle_points_radius:g} m, or bodies '
                'sink into the points that they lie on'
            )
        # rclpy cannot tell the type of an empty list
        links = tuple(name for name in self.robot_links if name)
        object.__setattr__(self, 'robot_links', links)
        if math.hypot(*self.robot_pose[3:]) < 1e-6:
            raise ConfigError(
                f'robot.pose is {list(self.robot_pose)}: its last four numbers must be a '
                'quaternion x y z w, 0 0 0 1 is no rotation'
            )

    @property
    def self_filter(self) -> float:
        """Distance from a body, m, up to which points of `~/obstacle_points` are ignored."""
        own = self.obstacle_points_self_filter
        return 0.5 * self.obstacle_points_radius if own < 0.0 else own


@dataclass(frozen=True)
class Appearance(Checked):
    """Appearance of a body."""

    name: str = 'body'
    color: tuple[float, ...] = setting(
        (0.9, 0.45, 0.2, 1.0), 'Colour of the displayed surface: red, green, blue, alpha',
        minimum=0.0, maximum=1.0,
    )  # fmt: skip


@dataclass(frozen=True)
class SceneLists(Checked):
    """Names of the bodies and obstacles, which prefix their parameters."""

    bodies: tuple[str, ...] = setting(
        ('ball',), 'Names of the bodies: a name that is new adds a body, a name that is left out '
        'removes it; empty for none', items=str,
    )  # fmt: skip
    obstacles: tuple[str, ...] = setting(
        ('ground',), 'Names of the obstacles: a name that is new adds an obstacle, a name that is '
        'left out removes it; empty for none', items=str,
    )  # fmt: skip


BODY_TABLE = {
    dotted: facts for config in (BodyConfig, Appearance) for _, dotted, facts in settings(config)
}
OBSTACLE_TABLE = {dotted: facts for _, dotted, facts in settings(ObstacleConfig)}
"""`Setting` of each parameter of a body, and of an obstacle, without the name of it."""


RESERVED_NAMES = frozenset(FOREIGN_PREFIXES) | {
    dotted.split('.')[0]
    for config in (NodeConfig, WorldConfig, SceneLists)
    for _, dotted, _ in settings(config)
}
"""Names of parameters, and of groups of these, that no body and no obstacle may have."""


@dataclass(frozen=True)
class Scene:
    """All parameter values, by config."""

    node: NodeConfig
    world: WorldConfig
    appearances: Mapping[str, Appearance]


def table(lists: SceneLists) -> dict[str, Setting]:
    """Return name and `Setting` of each parameter, in the order of the documentation."""
    configs = (NodeConfig, WorldConfig, SceneLists)
    result = {dotted: facts for config in configs for _, dotted, facts in settings(config)}
    for name in lists.bodies:
        result |= {f'{name}.{dotted}': facts for dotted, facts in BODY_TABLE.items()}
    for name in lists.obstacles:
        result |= {f'{name}.{dotted}': facts for dotted, facts in OBSTACLE_TABLE.items()}
    return result


def scene_lists(values: Mapping[str, Any]) -> SceneLists:
    """Return the names of bodies and obstacles; an empty YAML list arrives as None."""
    names = {}
    for field, dotted, facts in settings(SceneLists):
        value = values.get(dotted, facts.default)
        items = checked(dotted, () if value is None else value, facts)
        names[field] = tuple(name for name in items if name)
    every = [name for items in names.values() for name in items]
    for name in every:
        require_free_name(name)
    require_distinct(every)
    return SceneLists(**names)


def require_free_name(name: str) -> None:
    """Raise ConfigError if a body or an obstacle cannot have a name."""
    require_usable_name(name)
    if name in RESERVED_NAMES:
        raise ConfigError(
            f'the name {shown(name)} is that of parameters of the node: choose another, for '
            f'example {name}_1'
        )


def known_values(given: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """
    Separate given parameter values into known and unknown ones.

    Returns
    -------
    values : dict
        of the scene, integers promoted to floats; `make_scene` rejects unknown names among them
    unknown : dict
        a hint for each name that belongs to nothing in the scene

    Raises
    ------
    ConfigError
        if `bodies` or `obstacles` is not a list of possible names, or one is used twice.

    """
    lists = scene_lists(given)
    known = table(lists)
    own_prefixes = {'gravity', *lists.bodies, *lists.obstacles}
    values, unknown = {}, {}
    for name, value in given.items():
        first = name.split('.')[0]
        if name in known or first in own_prefixes:
            values[name] = promoted(value, known[name]) if name in known else value
        elif first not in FOREIGN_PREFIXES:
            unknown[name] = unknown_parameter(name, known)
    return values, unknown


def make_scene(values: Mapping[str, Any]) -> Scene:
    """
    Return the scene that parameter values describe; missing ones are defaults.

    Raises
    ------
    ConfigError
        if a name is unknown or not possible, a value invalid, or values contradict each other.

    """
    lists = scene_lists(values)
    known = table(lists)
    for name in values:
        if name not in known:
            raise ConfigError(_unknown(name, unknown_parameter(name, known)))

    def fields(config: type, prefix: str = '') -> dict[str, Any]:
        return {
            field: promoted(values[prefix + dotted], facts)
            for field, dotted, facts in settings(config)
            if prefix + dotted in values
        }

    bodies = [
        _with_mesh_path(BodyConfig(name=name, **fields(BodyConfig, f'{name}.')))
        for name in lists.bodies
    ]
    obstacles = [
        _with_mesh_path(ObstacleConfig(name=name, **fields(ObstacleConfig, f'{name}.')))
        for name in lists.obstacles
    ]
    node = NodeConfig(**fields(NodeConfig))
    frame = node.frame_id.lstrip('/')  # as tf2 reads it
    if frame in lists.bodies + lists.obstacles:
        raise ConfigError(
            f'the name {frame} is that of the frame of everything, frame_id: choose another for '
            'the body or obstacle, or for the frame'
        )
    return Scene(
        node=node,
        world=WorldConfig(bodies=tuple(bodies), obstacles=tuple(obstacles), **fields(WorldConfig)),
        appearances={
            name: Appearance(name=name, **fields(Appearance, f'{name}.')) for name in lists.bodies
        },
    )


def _with_mesh_path(config: _HasMesh) -> _HasMesh:
    paths: dict[str, Any] = {
        field: mesh_path(str(getattr(config, field))) for field in mesh_fields(config)
    }
    return config.with_values(**paths)


def mesh_fields(config: BodyConfig | ObstacleConfig) -> tuple[str, ...]:
    """Return the settings that are the paths of meshes."""
    return ('mesh', 'visual_mesh') if isinstance(config, BodyConfig) else ('mesh',)


def mesh_path(mesh: str) -> str:
    """
    Resolve the path of a `mesh` parameter; names of primitives are returned unchanged.

    Raises
    ------
    ConfigError
        if a package:// URI names a package that is not installed.

    """
    if mesh.startswith('file://'):
        return mesh.removeprefix('file://')
    if not mesh.startswith('package://'):
        return os.path.expanduser(mesh)
    package, _, path = mesh.removeprefix('package://').partition('/')
    try:
        return os.path.join(share_directory(package), path)
    except (LookupError, ValueError, OSError, ImportError):
        raise ConfigError(
            f'mesh {mesh[:200]}: package {shown(package)} is not installed, or its workspace is '
            'not sourced'
        ) from None


def values_of(config: BodyConfig | ObstacleConfig) -> dict[str, Any]:
    """Return the parameter values of a body or an obstacle, by name; `make_scene` undoes it."""
    return {
        config.prefix + dotted: as_parameter(getattr(config, field), facts)
        for field, dotted, facts in settings(config)
    }


def start_value(name: str, value: Any, known: Collection[str]) -> Any:
    """
    Check a value that is set before its body or obstacle is there.

    Parameters
    ----------
    name : str
        of the parameter, which is none of those that are known
    value : Any
    known : collection of str
        the names of all parameters

    Returns
    -------
    Any
        the value, integers promoted to floats

    Raises
    ------
    ConfigError
        if it cannot be that of a body or an obstacle, or its name looks misspelt.

    """
    dotted = name.partition('.')[2]
    tables = [table[dotted] for table in (BODY_TABLE, OBSTACLE_TABLE) if dotted in table]
    hint = _what_is_wrong(name, known)
    if hint:
        raise ConfigError(_unknown(name, hint))
    refusals = []
    for facts in tables:
        try:
            return as_parameter(checked(name, promoted(value, facts), facts), facts)
        except ConfigError as refusal:
            refusals.append(refusal)
    raise refusals[0]


def unknown_parameter(name: str, known: Iterable[str]) -> str:
    """Return the clause of an error message that helps with a name that no parameter has."""
    names = list(known)
    parts = [each for each in names if each.startswith(f'{name}.')]
    if parts:
        more = f' and {len(parts) - MOST_PARTS} more' if len(parts) > MOST_PARTS else ''
        return f'it is a group, set one of {", ".join(parts[:MOST_PARTS])}{more}'
    return unknown_name(name, names)


def _unknown(name: str, hint: str) -> str:
    return f'unknown parameter {shown(name)[1:-1]}: {hint}'


def _what_is_wrong(name: str, known: Collection[str]) -> str:
    """Return why a name is not that of a parameter of a body that is not there, or ''."""
    owner, _, dotted = name.partition('.')
    owners = {each.split('.')[0] for each in known}
    if not dotted:
        return unknown_parameter(name, known)
    if owner in owners:
        return unknown_name(name, [each for each in known if each.startswith(f'{owner}.')])
    try:
        require_free_name(owner)
    except ConfigError:
        return f'{shown(owner)} cannot be the name of a body or an obstacle'
    # ball_2 beside ball is no slip of the hand
    others = [each for each in owners if _stem(each) != _stem(owner)]
    if difflib.get_close_matches(owner, others, n=1, cutoff=MISSPELT):
        return unknown_parameter(name, known)
    possible = {**BODY_TABLE, **OBSTACLE_TABLE}
    if dotted in possible:
        return ''
    close = difflib.get_close_matches(dotted, possible, n=1)
    return f'did you mean {owner}.{close[0]}?' if close else 'no body and no obstacle has that'


def _stem(name: str) -> str:
    return name.rstrip('0123456789').rstrip('_')


def promoted(value: Any, facts: Setting) -> Any:
    """Return a value with integers as floats if the parameter is a float, no list as []."""
    if value is None and facts.items is not None:
        return []
    if isinstance(facts.default, float) and _is_integer(value):
        return _as_float(value)
    if facts.length is not None and isinstance(value, Iterable) and not isinstance(value, str):
        items = list(value)
        if all(_is_integer(item) for item in items):
            return [_as_float(item) for item in items]
    return value


def _as_float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _is_integer(value: Any) -> bool:
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def as_parameter(value: Any, facts: Setting) -> Any:
    """Return a value as a ROS parameter: rclpy cannot infer the type of an empty list."""
    if isinstance(value, (tuple, list)):
        return list(value) or ([''] if facts.items is str else [-1])
    return value


def normal(value: Any, facts: Setting) -> Any:
    """Return a value as it is declared: floats where they are meant, no empty lists."""
    return as_parameter(promoted(value, facts), facts)


def type_name(facts: Setting) -> str:
    """Return the name of the type in ROS tools."""
    names = {bool: 'bool', int: 'integer', float: 'double', str: 'string'}
    if isinstance(facts.default, tuple):
        return names[facts.items or float] + ' array'
    return names[type(facts.default)]
