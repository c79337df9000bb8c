# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which bodies and obstacles a config has: what is the same one under other parameters.

Two of the same structure can exchange their states.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import dataclasses
from typing import Any, TypeVar

from softbody_ros.core.config import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    WorldConfig,
    settings,
    shown,
)
from softbody_ros.core.geometry.surface import Surface

START_STATE = (
    'position',
    'orientation',
    'initial_velocity_linear',
    'initial_velocity_angular',
)
"""Settings of a body that take effect on `reset` and `apply_initial_velocity`."""

Item = TypeVar('Item', BodyConfig, ObstacleConfig)


def structure_of(config: BodyConfig | ObstacleConfig) -> tuple:
    """Return the key by which bodies, or obstacles, can exchange their states."""
    if isinstance(config, BodyConfig):
        return config.name, *shape_key(config)
    mesh = id(config.mesh) if isinstance(config.mesh, Surface) else config.mesh
    return config.name, config.type, mesh, config.mesh_frame, config.subdivisions


def shape_key(config: BodyConfig) -> tuple:
    """Return the key by which bodies share rest shape, regions and embedding."""
    mesh, visual = (
        id(mesh) if isinstance(mesh, Surface) else mesh
        for mesh in (config.mesh, config.visual_mesh)
    )
    is_loaded = isinstance(mesh, str) or (isinstance(visual, str) and visual != '')
    size = (config.size, config.mesh_frame, config.subdivisions) if is_loaded else None
    regions = (config.regions_count, config.regions_overlap)
    return mesh, visual, config.simplify_to, config.mass_distribution, size, *regions


def with_structure(config: WorldConfig, structure: WorldConfig) -> WorldConfig:
    """Return a config with the bodies and obstacles of another one, with its own parameters."""
    known: dict[tuple, Any] = {structure_of(item): item for item in config.items}
    return dataclasses.replace(
        config,
        bodies=tuple(known.get(structure_of(body), body) for body in structure.bodies),
        obstacles=tuple(known.get(structure_of(item), item) for item in structure.obstacles),
    )


def same_structure(one: WorldConfig, other: WorldConfig) -> bool:
    """Whether two configs have the same bodies and obstacles, in the same order."""
    return list(map(structure_of, one.items)) == list(map(structure_of, other.items))


def in_order(items: Iterable[Item], before: Iterable[Item]) -> tuple[Item, ...]:
    """Return configs in the order of those of the same names before; new ones at the end."""
    place = {item.name: index for index, item in enumerate(before)}
    return tuple(sorted(items, key=lambda item: place.get(item.name, len(place))))


def shared(items: Iterable[Item], before: Iterable[Item]) -> tuple[Item, ...]:
    """Return configs with those that equal one before replaced by that: they share its memory."""
    known = {item.name: item for item in before}
    return tuple(known[item.name] if known.get(item.name) == item else item for item in items)


def moves_alike(one: BodyConfig, other: BodyConfig) -> bool:
    """Return whether configs of a body differ at most in what takes effect on `reset`."""
    if one is other:
        return True
    start = {field: getattr(other, field) for field in START_STATE}
    return one.with_values(**start) == other


def require_same_structure(old: WorldConfig, new: WorldConfig) -> None:
    """Raise ConfigError unless bodies and obstacles are the same ones."""

    def names(config: WorldConfig) -> list[list[str]]:
        return [[item.name for item in items] for items in (config.bodies, config.obstacles)]

    if names(old) != names(new):
        raise ConfigError(
            'bodies and obstacles are added and removed by World.add and World.remove, not here'
        )
    require_same_settings(old, new)


def require_same_settings(old: WorldConfig, new: WorldConfig) -> None:
    """Raise ConfigError if a read-only setting of something that stays differs."""

    def read_only(config: WorldConfig) -> Mapping[tuple[type, str], object]:
        values: dict[tuple[type, str], object] = {}
        for item in (config, *config.items):
            for field, dotted, facts in settings(item):
                if facts.read_only:
                    values[type(item), item.prefix + dotted] = getattr(item, field)
        return values

    before = read_only(old)
    for key, value in read_only(new).items():
        if key in before and value is not before[key] and value != before[key]:
            raise ConfigError(
                f'{key[1]} is {shown(before[key])} and cannot change: make a new World'
            )
