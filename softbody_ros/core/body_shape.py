# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What follows from the meshes of a body, which takes long: bodies of equal ones share it."""

from __future__ import annotations

import os
from typing import NamedTuple
from weakref import WeakValueDictionary

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.config import BodyConfig, ConfigError
from softbody_ros.core.embedding import Embedding
from softbody_ros.core.geometry.mesh import PRIMITIVES, make_surface
from softbody_ros.core.geometry.simplification import simplified
from softbody_ros.core.geometry.surface import MeshError, Surface
from softbody_ros.core.shape_matching.material import require_volume
from softbody_ros.core.shape_matching.pins import make_pins, pinned_particles
from softbody_ros.core.shape_matching.regions import Regions, make_regions
from softbody_ros.core.shape_matching.rest_shape import (
    RestShape,
    make_rest_shape,
    make_solid_rest_shape,
)
from softbody_ros.core.state import Body

BYTES_OF_PARTICLE = 200
"""Approximate memory of a rest shape, for each of its particles."""


class BodyShape(NamedTuple):
    """What follows from the meshes of a body: bodies of equal ones share it."""

    rest: RestShape
    regions: Regions | None
    embedding: Embedding | None


def make_body_shape(body: BodyConfig) -> BodyShape:
    """
    Return what follows from the meshes of a body.

    Raises
    ------
    ConfigError, MeshError
        with one sentence that says what to change.

    """
    try:
        surface = fine = _surface_of(body, body.mesh)
        if body.simplify_to:
            surface = simplified(fine, body.simplify_to)
        is_solid = body.mass_distribution == 'volume'
        rest = make_solid_rest_shape(surface) if is_solid else make_rest_shape(surface)
    except MeshError as error:
        raise MeshError(f'{body.prefix}{error}') from None
    regions = _regions_of(body, rest)
    try:
        if body.visual_mesh != '':
            fine = _surface_of(body, body.visual_mesh)
        embedding = None if fine is surface else Embedding(surface, fine)
    except MeshError as error:
        raise MeshError(f'{body.prefix}visual_{error}') from None
    return BodyShape(rest, regions, embedding)


def _surface_of(body: BodyConfig, mesh: str | Surface) -> Surface:
    """Return a surface of a body: all of them are loaded alike."""
    if isinstance(mesh, Surface):
        return mesh
    return make_surface(mesh, body.size, body.subdivisions, body.mesh_frame)


def _regions_of(body: BodyConfig, rest: RestShape) -> Regions | None:
    if body.regions_count > rest.surface_count:
        raise ConfigError(
            f'{body.prefix}regions.count is {body.regions_count}: the mesh has only '
            f'{rest.surface_count} vertices'
        )
    if not body.regions_count:
        return None
    return make_regions(rest, body.regions_count, body.regions_overlap)


def body_of(config: BodyConfig, shape: BodyShape) -> Body:
    """Return a body with its pins."""
    pins = make_pins(config, shape.rest)
    return Body(config, shape.rest, shape.regions, pins, shape.embedding)


def shape_of(body: Body) -> BodyShape:
    """Return what a body shares with others."""
    return BodyShape(body.rest, body.regions, body.embedding)


def bytes_of(shape: BodyShape) -> int:
    """Return the approximate memory of a shape."""
    fine = 0 if shape.embedding is None else len(shape.embedding.visual.vertices)
    return BYTES_OF_PARTICLE * (shape.rest.particle_count + fine)


def require_possible(body: BodyConfig, rest: RestShape) -> None:
    """Raise ConfigError if the settings of a body ask for what its mesh has not."""
    pinned_particles(body, rest)
    require_volume(body, rest)


def start_positions(body: BodyConfig, rest: RestShape) -> np.ndarray:
    """Return (3, N) float: all particles of the rest shape at the start pose, m."""
    return placed_at_start(body, rest.particles)


def start_surface(body: BodyConfig, rest: RestShape) -> np.ndarray:
    """Return (n, 3) float: the surface at the start pose, m."""
    return start_positions(body, rest)[:, : rest.surface_count].T


def placed_at_start(body: BodyConfig, points: np.ndarray) -> np.ndarray:
    """Return (3, n) float: points (n, 3) of the body's own frame at the start pose, m."""
    rotation = Rotation.from_quat(body.orientation).as_matrix()
    return rotation @ points.T + np.array(body.position)[:, None]


# ------------------------------------------------------------------------------------------- cache
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

    def get(self, config: BodyConfig) -> BodyShape | None:
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
        return BodyShape(rest, regions, embedding)

    def put(self, config: BodyConfig, shape: BodyShape) -> None:
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
