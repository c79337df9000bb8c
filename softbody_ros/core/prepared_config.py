# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A config whose bodies and obstacles may be others than those of a world, with their meshes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import os
from typing import NamedTuple, TypeVar
from weakref import WeakValueDictionary

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.config import BodyConfig, ObstacleConfig, WorldConfig, settings
from softbody_ros.core.embedding import Embedding
from softbody_ros.core.geometry.mesh import PRIMITIVES
from softbody_ros.core.geometry.surface import Surface
from softbody_ros.core.shape_matching.regions import Regions
from softbody_ros.core.shape_matching.rest_shape import RestShape

BYTES = 1000
"""Approximate memory of a config besides its items, and of one of these without its lists."""
BYTES_OF_INDEX = 40
"""Of a Python integer in a tuple."""

Item = TypeVar('Item', BodyConfig, ObstacleConfig)


class Shape(NamedTuple):
    """What follows from the meshes of a body: bodies of equal ones share it."""

    rest: RestShape
    regions: Regions | None
    embedding: Embedding | None


@dataclass(frozen=True, eq=False)
class PreparedConfig:
    """
    All that `World.adopt` needs to use a config: immutable, so an action of a history.

    Attributes
    ----------
    config : WorldConfig
    shapes : mapping of str to Shape
        of the bodies that are new in it
    obstacles : mapping of str to Obstacle
        that are new in it
    nbytes : int
        approximate bytes of memory that only this takes

    """

    config: WorldConfig
    shapes: Mapping[str, Shape]
    obstacles: Mapping[str, Obstacle]
    nbytes: int


class ShapeCache:
    """
    Shapes that somebody, or a snapshot, still has: equal ones are shared.

    So what comes and goes many times is loaded once, as long as the history remembers it. A mesh
    file that has changed is another mesh.
    """

    def __init__(self) -> None:
        self._rests: WeakValueDictionary[tuple, RestShape] = WeakValueDictionary()
        self._regions: WeakValueDictionary[tuple, Regions] = WeakValueDictionary()
        self._embeddings: WeakValueDictionary[tuple, Embedding] = WeakValueDictionary()

    def get(self, config: BodyConfig) -> Shape | None:
        """Return the shape of a body, if there is one."""
        key = _mesh_key(config)
        rest, regions, embedding = self._rests.get(key), None, None
        if rest is None:
            return None
        if config.regions_count:
            regions = self._regions.get((*key, *_division(config)))
            if regions is None:
                return None
        if config.has_visual:
            embedding = self._embeddings.get((*key, _source(config.visual_mesh)))
            if embedding is None:
                return None
        return Shape(rest, regions, embedding)

    def put(self, config: BodyConfig, shape: Shape) -> None:
        """Remember the shape of a body."""
        if isinstance(config.mesh, Surface) and shape.rest.surface is not config.mesh:
            return  # simplified: nothing of the shape keeps its number from being another's
        key = _mesh_key(config)
        self._rests[key] = shape.rest
        if shape.regions is not None:
            self._regions[*key, *_division(config)] = shape.regions
        if shape.embedding is not None:
            self._embeddings[*key, _source(config.visual_mesh)] = shape.embedding


def _mesh_key(config: BodyConfig) -> tuple:
    size = (config.size, config.mesh_frame, config.subdivisions)
    return _source(config.mesh), config.simplify_to, config.mass_distribution, size


def _source(mesh: str | Surface) -> tuple:
    """Return what tells whether a mesh is the same: of a file its name and when it changed."""
    # the number of a Surface is its own as long as there is a shape that has it
    if isinstance(mesh, Surface):
        return (id(mesh),)
    stamp = None
    if mesh and mesh not in PRIMITIVES:
        try:
            file = os.stat(mesh)
            stamp = file.st_mtime_ns, file.st_size
        except (OSError, ValueError):
            pass  # whoever loads it says so
    return mesh, stamp


def _division(config: BodyConfig) -> tuple[int, int]:
    return config.regions_count, config.regions_overlap


def list_bytes(config: BodyConfig | ObstacleConfig) -> int:
    """Return the approximate memory of the lists of indices in a config."""
    lists = (getattr(config, field) for field, _, facts in settings(config) if facts.items)
    return BYTES_OF_INDEX * sum(map(len, lists))


def in_order(items: Iterable[Item], before: Iterable[Item]) -> tuple[Item, ...]:
    """Return configs in the order of those of the same names before; new ones at the end."""
    place = {item.name: index for index, item in enumerate(before)}
    return tuple(sorted(items, key=lambda item: place.get(item.name, len(place))))


def shared(items: Iterable[Item], before: Iterable[Item]) -> tuple[Item, ...]:
    """Return configs with those that equal one before replaced by that: they share its memory."""
    known = {item.name: item for item in before}
    return tuple(known[item.name] if known.get(item.name) == item else item for item in items)
