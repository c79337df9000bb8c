# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is added to a scene as one entity: a mesh, or the bodies and obstacles of a scene file."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
import itertools
import os
import re
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core import BodyConfig, ConfigError, ObstacleConfig, WorldConfig
from softbody_ros.core.config import (
    LARGEST,
    LONGEST_NAME,
    NAME_PATTERN,
    in_brackets,
    settings,
    shown,
)
from softbody_ros.core.geometry.mesh import PRIMITIVES
from softbody_ros.core.geometry.mesh_files import FILE_TYPES
from softbody_ros.scene import parameters
from softbody_ros.scene.scene_file import read_scene, scene_of

SCENE_TYPES = ('yaml', 'yml')
FORMATS = (*SCENE_TYPES, *FILE_TYPES)
"""Endings of files that are resources."""
TURNING = tuple(
    f'{group}.{kind}'
    for group in ('initial_velocity', 'pins.velocity', 'velocity')
    for kind in ('linear', 'angular')
)
"""Parameters along the axes of the world."""

Pose = tuple[Sequence[float], Sequence[float]]
"""Position, m, and orientation x y z w."""


class Problem(Enum):
    """What is wrong with a resource or the name for it."""

    NOTHING_GIVEN = auto()
    FORMAT = auto()  # which is not known
    CONTENT = auto()  # cannot be used
    MISSING_MESH = auto()
    MESH = auto()  # of a scene, of an unknown format
    NAME = auto()  # not usable
    NAME_TAKEN = auto()
    POSE = auto()


class ResourceError(ValueError):
    """A resource that cannot be added; with the problem, and the reason in one sentence."""

    def __init__(self, problem: Problem, reason: str) -> None:
        super().__init__(reason)
        self.problem = problem


@dataclass(frozen=True)
class Resource:
    """
    Bodies and obstacles by their own names, in the frame of the resource.

    Attributes
    ----------
    stem : str
        what to call it without another name
    bodies, obstacles : tuple of str
    values : dict
        parameter values of these

    """

    stem: str
    bodies: tuple[str, ...]
    obstacles: tuple[str, ...]
    values: dict[str, Any]
    is_mesh: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies and obstacles."""
        return (*self.bodies, *self.obstacles)


@dataclass(frozen=True)
class Entity:
    """
    What a resource adds to a scene, as a request.

    Attributes
    ----------
    name : str
    bodies, obstacles : tuple of str
    values : dict
        parameter values, in the frame of the world

    """

    name: str
    bodies: tuple[str, ...]
    obstacles: tuple[str, ...]
    values: dict[str, Any]


def read_resource(uri: str, text: str = '') -> Resource:
    """
    Return a resource.

    Parameters
    ----------
    uri : str
        the name of a primitive, or a path, file:// or package:// URI of a mesh or a scene file
    text : str
        of a scene file, if there is no URI

    Raises
    ------
    ResourceError

    """
    if uri in PRIMITIVES:
        return _mesh(uri, uri)
    if uri:
        path = _path(uri)
        ending = os.path.splitext(path)[1].lower().lstrip('.')
        if ending not in FORMATS:
            raise ResourceError(
                Problem.FORMAT,
                f'the resource {shown(uri)} is {_neither_nor(FORMATS)}',
            )
        if not os.path.isfile(path):
            raise ResourceError(Problem.MISSING_MESH, f'the file {path} does not exist')
        if ending in FILE_TYPES:
            return _mesh(uri, os.path.basename(path))
    if not uri and not text.strip():
        raise ResourceError(Problem.NOTHING_GIVEN, 'neither a URI nor a text is given')
    if not uri and text.lstrip().startswith('<'):
        raise ResourceError(
            Problem.FORMAT, 'the text is XML: give that of a scene file, which is YAML'
        )
    try:
        values = read_scene(path) if uri else scene_of(text, 'resource_string')
        return _scene(values, os.path.basename(path) if uri else 'scene')
    except ConfigError as error:
        raise ResourceError(Problem.CONTENT, str(error)) from None


def _path(uri: str) -> str:
    try:
        return parameters.mesh_path(uri)
    except ConfigError as error:
        reason = str(error).removeprefix(f'mesh {uri}: ')
        raise ResourceError(Problem.MISSING_MESH, f'the resource {shown(uri)}: {reason}') from None


def _mesh(uri: str, file_name: str) -> Resource:
    origin = {'body.mesh': uri, 'body.position': [0.0] * 3}
    return Resource(_stem(file_name), ('body',), (), origin, is_mesh=True)


def _stem(file_name: str) -> str:
    name = re.sub(r'\W', '_', os.path.splitext(file_name)[0], flags=re.ASCII)
    name = name[: LONGEST_NAME // 2]  # a number, or the names of several bodies, may follow
    is_possible = NAME_PATTERN.fullmatch(name) and name not in parameters.RESERVED_NAMES
    return name if is_possible else f'thing_{name}'


def _scene(given: dict[str, Any], file_name: str) -> Resource:
    """Return the bodies and obstacles that a scene file names itself; without any, its ball."""
    known, unknown = parameters.known_values(given)
    for name, hint in unknown.items():
        raise ConfigError(f'unknown parameter {name}: {hint}')
    lists = parameters.scene_lists(known)
    bodies = lists.bodies if 'bodies' in known or 'obstacles' not in known else ()
    obstacles = lists.obstacles if 'obstacles' in known else ()
    if not bodies and not obstacles:
        raise ConfigError('there is no body and no obstacle in it')
    names = {*bodies, *obstacles}
    values = {name: value for name, value in known.items() if name.split('.')[0] in names}
    parameters.make_scene(values | {'bodies': list(bodies), 'obstacles': list(obstacles)})
    return Resource(_stem(file_name), bodies, obstacles, values)


def make_entity(
    resource: Resource, name: str, may_rename: bool, pose: Pose, taken: Collection[str]
) -> Entity:
    """
    Return what a resource adds to a scene.

    Parameters
    ----------
    resource : Resource
    name : str
        of its only body, or what the names of several bodies and obstacles begin with; if empty
        they have their own names
    may_rename : bool
        whether another name is chosen if it is taken, or there is none
    pose : Pose
        of the frame of the resource
    taken : collection of str
        names that are not free

    Raises
    ------
    ResourceError

    """
    if name:
        _require_free(name)
    if resource.is_mesh and not name and not may_rename:
        raise ResourceError(Problem.NAME, 'a mesh has no name: give one, or allow renaming')
    for candidate in _candidates(resource, name, may_rename):
        new = _names(resource, candidate)
        clash = [each for each in new.values() if each in taken]
        if not clash:
            break
    else:
        raise ResourceError(
            Problem.NAME_TAKEN,
            f'the name {clash[0]} is that of something else: give another, or allow renaming',
        )
    for each in new.values():
        _require_free(each)
    values = _placed(resource, new, pose)
    return Entity(
        candidate or next(iter(new.values())),
        tuple(new[each] for each in resource.bodies),
        tuple(new[each] for each in resource.obstacles),
        values,
    )


def _require_free(name: str) -> None:
    try:
        parameters.require_free_name(name)
    except ConfigError as error:
        raise ResourceError(Problem.NAME, str(error)) from None


def _candidates(resource: Resource, name: str, may_rename: bool) -> Iterator[str]:
    if name or not resource.is_mesh:
        yield name
    if may_rename:
        base = name or resource.stem
        yield base
        for number in itertools.count(2):
            yield f'{base}_{number}'


def _names(resource: Resource, name: str) -> dict[str, str]:
    """Return the names in the scene by those in the resource."""
    new = {each: f'{name}_{each}' if name else each for each in resource.names}
    if name and len(resource.bodies or resource.obstacles) == 1:
        new[(resource.bodies or resource.obstacles)[0]] = name
    return new


def _placed(resource: Resource, new: dict[str, str], pose: Pose) -> dict[str, Any]:
    """Return the values of a resource with other names at a pose."""
    lists = {'bodies': list(resource.bodies), 'obstacles': list(resource.obstacles)}
    world = parameters.make_scene(resource.values | lists).world
    _require_meshes(world)
    position, turn = np.array(pose[0], float), _rotation(pose[1])
    values = dict(resource.values)
    for item in world.items:
        values |= _moved(item, position, turn, values)
    renamed = {}
    for name, value in values.items():
        owner, dotted = name.split('.', 1)
        # what holds it may be of the same resource
        value = new.get(value, value) if dotted == 'attach.to' else value
        renamed[f'{new[owner]}.{dotted}'] = value
    return renamed


def _rotation(quaternion: Sequence[float]) -> Rotation:
    length = float(np.linalg.norm(quaternion))
    if not 1e-6 < length < np.inf:
        raise ResourceError(Problem.POSE, f'orientation {list(quaternion)} has no direction')
    return Rotation.from_quat(np.array(quaternion) / length)


def _moved(
    item: BodyConfig | ObstacleConfig,
    position: np.ndarray,
    turn: Rotation,
    given: Collection[str],
) -> dict[str, Any]:
    """Return the pose of a body or an obstacle that is moved, and what turns with it."""
    moved: dict[str, Any] = {
        'position': position + turn.apply(item.position),
        'orientation': np.clip((turn * Rotation.from_quat(item.orientation)).as_quat(), -1.0, 1.0),
    }
    for field, dotted, _ in settings(item):
        if dotted in TURNING and item.prefix + dotted in given:
            moved[dotted] = turn.apply(getattr(item, field))
    values = {item.prefix + dotted: value.tolist() for dotted, value in moved.items()}
    if not (np.abs(moved['position']) <= LARGEST).all():
        shown = in_brackets(moved['position'])
        raise ResourceError(Problem.POSE, f'position {shown} is not within {LARGEST:g} m')
    return values


def _require_meshes(world: WorldConfig) -> None:
    for item in world.items:
        if isinstance(item, ObstacleConfig) and item.type != 'mesh':
            continue
        for field in parameters.mesh_fields(item):
            mesh = str(getattr(item, field))
            if mesh in PRIMITIVES or (field != 'mesh' and not mesh):
                continue
            if os.path.splitext(mesh)[1].lower().lstrip('.') not in FILE_TYPES:
                raise ResourceError(
                    Problem.MESH,
                    f'{item.prefix}{field} {mesh!r} is {_neither_nor(FILE_TYPES)}',
                )
            if not os.path.isfile(mesh):
                raise ResourceError(
                    Problem.MISSING_MESH,
                    f'{item.prefix}{field}: the file {mesh} does not exist',
                )


def _neither_nor(endings: Sequence[str]) -> str:
    return (
        f'neither a primitive ({", ".join(PRIMITIVES)}) nor a file that ends in '
        f'.{", .".join(endings)}'
    )
