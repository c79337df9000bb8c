# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes and meshes as requests to a running node, and its parameters as YAML: pure functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import pathlib
from typing import Any

import numpy as np
import yaml

from softbody_ros.core.config import shown
from softbody_ros.installed_files import share_directory
from softbody_ros.scene import parameters
from softbody_ros.scene.resources import make_entity, read_resource
from softbody_ros.scene.scene_file import EVERY_NODE, PARAMETERS

NOTHING: Mapping[str, Any] = {'bodies': [''], 'obstacles': ['']}
"""Values that remove all bodies and obstacles; rclpy cannot tell the type of an empty list."""
NOT_DRAGGED = (0.0, 0.0, 0.0, 1.0)
GAP = 0.2
"""Free height below a new body, in units of its size."""
USUAL_SIZE = 0.5
"""Size of a new body where there is no other, m."""


def shipped_scenes() -> dict[str, pathlib.Path]:
    """Return the scene files of this package by their names."""
    folder = pathlib.Path(share_directory('softbody_ros')) / 'config'
    return {path.stem: path for path in sorted(folder.glob('*.yaml'))}


@dataclass(frozen=True)
class SceneRequest:
    """
    What to ask a node for so that it simulates a scene.

    Attributes
    ----------
    values : dict
        of all parameters that can be set
    from_nothing : bool
        whether bodies and obstacles have to be removed first: one of the same name is something
        else, or has other read-only values
    notes : tuple of str
        one sentence for each thing that the node does not take from the scene

    """

    values: dict[str, Any]
    from_nothing: bool
    notes: tuple[str, ...]


def scene_request(given: Mapping[str, Any], present: Mapping[str, Any]) -> SceneRequest:
    """
    Return the request that replaces what a node simulates by a scene.

    Parameters
    ----------
    given : dict
        parameter values of the scene; those that it does not give become defaults
    present : dict
        parameter values of the node

    Raises
    ------
    ConfigError
        if it is no scene.

    """
    known, unknown = parameters.known_values(given)
    scene = parameters.make_scene(known)
    lists = parameters.scene_lists(known)
    table = parameters.table(lists)
    wanted = {
        name: parameters.normal(known.get(name, facts.default), facts)
        for name, facts in table.items()
    }
    wanted |= {name: list(getattr(lists, name)) or [''] for name in NOTHING}
    owners = {*lists.bodies, *lists.obstacles}
    fixed = {name for name, facts in table.items() if facts.read_only and name in present}
    changed = {name for name in fixed if present[name] != wanted[name]}
    from_nothing = any(_owner(name) in owners for name in changed)
    # a body is no obstacle of the same name
    from_nothing |= not {*lists.bodies}.isdisjoint(present.get('obstacles', ()))
    from_nothing |= not {*lists.obstacles}.isdisjoint(present.get('bodies', ()))
    if from_nothing:
        fixed = {name for name in fixed if _owner(name) not in owners}
    notes = [
        f'{name} stays {_short(present[name])}: the scene has {_short(wanted[name])}, which a '
        'node takes at its start only'
        for name in table
        if name in changed & fixed
    ]
    notes += [f'{name} is unknown and ignored: {hint}' for name, hint in unknown.items()]
    if scene.node.robot_links:
        notes.append(
            'the links of its robot are there once /robot_description and /joint_states are '
            'published'
        )
    values = {name: value for name, value in wanted.items() if name not in fixed}
    return SceneRequest(values, from_nothing, tuple(notes))


def _short(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else shown(value)


def _owner(name: str) -> str:
    return name.split('.')[0]


def mesh_request(
    path: str, size: float, color: Iterable[int], above: np.ndarray, present: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """
    Return the name of a new body and the values that add it, as heavy as the others.

    Parameters
    ----------
    path : str
        of a mesh file
    size : float
        half of its longest side, m
    color : iterable of int
        red green blue, 0 … 255
    above : (3,) float
        point below which everything else is, m
    present : dict
        parameter values of the node

    Raises
    ------
    ResourceError
        if it is no mesh file.

    """
    position = [*map(float, above[:2]), float(above[2]) + (1.0 + GAP) * size]
    taken = {_owner(name) for name in present}
    entity = make_entity(read_resource(path), '', True, (position, NOT_DRAGGED), taken)
    bodies = [name for name in present.get('bodies', ()) if name]
    values = {'bodies': [*bodies, entity.name]} | entity.values
    values[f'{entity.name}.size'] = float(size)
    masses = [present[f'{name}.mass'] for name in bodies if f'{name}.mass' in present]
    if masses:
        values[f'{entity.name}.mass'] = float(np.median(masses))
    values[f'{entity.name}.color'] = [*(item / 255.0 for item in color), 1.0]
    return entity.name, values


def fitted(positions: np.ndarray, body: np.ndarray) -> tuple[float, np.ndarray]:
    """
    Return a size for a new body, like that of the others, and the point above their middle.

    Parameters
    ----------
    positions : (n, 3) float
        of all particles, m
    body : (n,) int
        the body of each

    """
    if not len(positions):
        return USUAL_SIZE, np.zeros(3)
    halves = [np.ptp(positions[body == number], axis=0).max() / 2.0 for number in np.unique(body)]
    low, high = positions.min(axis=0), positions.max(axis=0)
    size = float(f'{max(np.median(halves), 1e-3):.2g}')
    return size, np.array([*(low + high)[:2] / 2.0, max(high[2], 0.0)])


class _Text(str):
    """A text that is written in quotes: rcl takes more words for numbers than YAML does."""


class _Dumper(yaml.SafeDumper):
    pass


_Dumper.add_representer(
    _Text,
    lambda dumper, text: dumper.represent_scalar('tag:yaml.org,2002:str', str(text), style="'"),
)


def scene_yaml(values: Mapping[str, Any], comments: Iterable[str] = ()) -> str:
    """Return parameter values as a file for `--params-file`, for a node of any name."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        if value is None:
            continue
        place, *path = tree, *name.split('.')
        for step in path[:-1]:
            place = place.setdefault(step, {})
        place[path[-1]] = _quoted(value)
    text = yaml.dump(
        {EVERY_NODE: {PARAMETERS: tree}}, Dumper=_Dumper, sort_keys=False, width=100,
        default_flow_style=None,
    )  # fmt: skip
    return ''.join(f'# {comment}\n' for comment in comments) + text


def _quoted(value: Any) -> Any:
    if isinstance(value, str):
        return _Text(value)
    return [_quoted(item) for item in value] if isinstance(value, (list, tuple)) else value


def meshes_in(values: Mapping[str, Any], folder: pathlib.Path) -> list[str]:
    """Return the names of the parameters whose mesh file lies in a folder."""
    return [
        name
        for name, value in values.items()
        if name.endswith(('.mesh', '.visual_mesh')) and pathlib.Path(value).is_relative_to(folder)
    ]
