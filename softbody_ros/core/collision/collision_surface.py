# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Collision surfaces: precomputed data per rest shape for contact detection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from softbody_ros.core.geometry.bvh import SurfaceTree, Trees, make_tree, pack
from softbody_ros.core.geometry.mesh_edges import edges_of
from softbody_ros.core.geometry.surface import vertex_normals
from softbody_ros.core.shape_matching.regions import Regions
from softbody_ros.core.shape_matching.rest_shape import RestShape

NEIGHBOURS = 2.0
"""Distance, in edge lengths, within which a particle and a face of one body are neighbours."""
SHARP = 0.1
"""Length of an edge times the sine of half its bend, in RMS radii, from which it touches others:
about a quarter of that two edges could cross before a vertex of one meets a face of the other."""
LONG = 1.0
"""Length of other edges, in RMS radii, from which these may touch others where they are bent."""

SURFACE = np.dtype(
    [
        ('closed', np.bool_),  # whether it has an inside
        ('neighbours', np.float64),  # distance of neighbours, in RMS radii
        ('thinness', np.float64),  # enclosed volume over area, m: half of a plate's thickness
        # indices into the arrays of `SurfaceArrays`
        ('first_particle', np.int64),
        ('first_face', np.int64),
        ('first_edge', np.int64),
        ('sharp_edges', np.int64),  # number of these, which come first
        ('edges', np.int64),  # number of all
        ('first_piece', np.int64),
        ('pieces', np.int64),
        ('first_origin', np.int64),
        ('first_may_collide', np.int64),
        ('tree', np.int64),  # of its faces, if it is closed
    ],
    align=True,
)
"""The collision surface of one rest shape, as kernels read it."""

PIECE = np.dtype(
    [
        ('first', np.int64),  # index of its particles in `particles`
        ('count', np.int64),
        ('first_covered', np.int64),  # index in `covered` of these and the corners of its faces
        ('covered', np.int64),
    ],
    align=True,
)
"""One piece of a collision surface."""


@dataclass(frozen=True, eq=False)
class CollisionSurface:
    """
    The surface of a shape in P pieces, one per region, or one without regions.

    Each particle and each face belongs to one piece.

    Attributes
    ----------
    rest : RestShape
    regions : Regions or None
    collidable : bool
        false for shapes that are used in the match of pinned bodies only, see `pins`

    """

    rest: RestShape
    regions: Regions | None
    collidable: bool = True

    @property
    def pieces(self) -> int:
        """Number of pieces, P."""
        return self.regions.count if self.regions else 1

    @cached_property
    def closed(self) -> bool:
        """Whether it has an inside, so that penetration is defined."""
        return self.rest.surface.closed

    @property
    def origins(self) -> np.ndarray:
        """(P, 3) float: centres of mass of the pieces in the body's own frame, m."""
        if self.regions is None:
            return self.rest.centre[None]
        return self.rest.centre + self.rest.scale * self.regions.centre

    @property
    def piece_of_particle(self) -> np.ndarray:
        """(n,) int: piece of each particle."""
        if self.regions is None:
            return np.zeros(self.rest.surface_count, dtype=np.int64)
        return self.regions.main_region[: self.rest.surface_count]

    @property
    def piece_of_face(self) -> np.ndarray:
        """(m,) int: piece of each face."""
        return self.piece_of_particle[self.rest.surface.faces[:, 0]]

    @cached_property
    def covered(self) -> tuple[np.ndarray, np.ndarray]:
        """(c,) int: particles of pieces and of their faces; (P + 1,) int: first of each piece."""
        faces, count = self.rest.surface.faces, self.rest.surface_count
        piece = np.concatenate([self.piece_of_particle, np.repeat(self.piece_of_face, 3)])
        particle = np.concatenate([np.arange(count), faces.ravel()])
        piece, particle = np.divmod(np.unique(piece * count + particle), count)
        return particle, np.searchsorted(piece, np.arange(self.pieces + 1))

    @cached_property
    def may_collide(self) -> np.ndarray:
        """
        (P, P) bool: pairs of pieces of one body that may collide.

        Those without common particles, including the corners of their faces.
        """
        if self.regions is None:
            return np.zeros((1, 1), dtype=bool)
        particle, first = self.covered
        count = self.rest.surface_count
        covers = csr_array((np.ones(len(particle)), particle, first), (self.pieces, count)).T
        belongs = covers + self.regions.membership[:count]
        return np.asarray((belongs.T @ belongs).toarray() == 0.0)

    @cached_property
    def normals(self) -> np.ndarray:
        """(n, 3) float: vertex normals; zero for particles without faces."""
        total = vertex_normals(self.rest.surface.vertices, self.rest.surface.faces)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return total / np.where(length > 0.0, length, 1.0)

    @cached_property
    def neighbours(self) -> float:
        """Distance, in RMS radii, of a particle and a face of one body that cannot collide."""
        if self.regions is None or not len(self.rest.surface.faces):
            return 0.0
        a, b, c = self.rest.surface.vertices[self.rest.surface.faces.T]
        edge = float(np.linalg.norm([a - b, b - c, c - a], axis=2).mean())
        return NEIGHBOURS * edge / self.rest.scale

    @cached_property
    def edges(self) -> tuple[np.ndarray, int]:
        """
        (e, 4) int: edges that may touch others, none of open ones; int: how many are sharp.

        Their two ends, and the third corners of the two triangles there: the first one is that of
        the triangle which has the edge in this direction. Sharp ones, see `SHARP`, come first,
        then those that are `LONG`.
        """
        vertices, faces = self.rest.surface.vertices, self.rest.surface.faces
        if not self.closed:
            return np.zeros((0, 4), np.int32), 0
        edges = edges_of(faces)
        triangles, edge = edges.pairs()
        ends = edges.ends[edge]
        third = faces[triangles].sum(axis=2) - ends.sum(axis=1, keepdims=True)
        # the triangle in which the edge goes from its lower end to the other one comes first
        goes_back = ~edges.forward[triangles[:, 0]][edges.edge[triangles[:, 0]] == edge[:, None]]
        third[goes_back] = third[goes_back, ::-1]
        start, end, one, other = vertices[np.concatenate([ends, third], axis=1)].transpose(1, 0, 2)
        normals = np.cross(end - start, one - start), np.cross(other - start, end - start)
        first, second = (
            normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
            for normal in normals
        )
        bend = np.sqrt(0.5 * np.maximum(1.0 - (first * second).sum(axis=1), 0.0))
        bend[(first * (other - start)).sum(axis=1) > 0.0] = 0.0  # not convex
        length = np.linalg.norm(end - start, axis=1) / self.rest.scale
        is_sharp = length * bend >= SHARP
        order = np.argsort(~is_sharp, kind='stable')
        order = order[(is_sharp | (length >= LONG))[order]]
        corners = np.concatenate([ends, third], axis=1)[order].astype(np.int32)
        return corners, int(is_sharp.sum())

    @property
    def thinness(self) -> float:
        """Enclosed volume of a closed surface over its area, m: half of a plate's thickness."""
        return self.rest.volume / float(self.rest.areas.sum()) if self.closed else 0.0

    @cached_property
    def tree(self) -> SurfaceTree:
        """Bounding-volume hierarchy of its faces."""
        return make_tree(self.rest.surface)


class SurfaceArrays(NamedTuple):
    """
    The collision surfaces of all rest shapes of a world, as kernels read them.

    Attributes
    ----------
    surfaces : (R,) SURFACE
    pieces : (P,) PIECE
    particles, covered : (n,), (c,) int
        particles of the pieces, and these with the corners of their faces, as indices in the body
    faces : (m, 3) int
        indices of particles in the body
    piece_of_face : (m,) int
    edges : (e, 4) int
        see `CollisionSurface.edges`: indices of particles in the body
    may_collide : (s,) bool
        the matrices P × P of all surfaces, row by row
    normals : (n, 3) float
    origins : (o, 3) float
        m
    trees : Trees
        of the faces of closed surfaces

    """

    surfaces: np.ndarray
    pieces: np.ndarray
    particles: np.ndarray
    covered: np.ndarray
    faces: np.ndarray
    piece_of_face: np.ndarray
    edges: np.ndarray
    may_collide: np.ndarray
    normals: np.ndarray
    origins: np.ndarray
    trees: Trees


class CollisionSurfaces:
    """
    The collision surfaces of a world, one for each of its rest shapes.

    Computed when there is something to meet them.

    Parameters
    ----------
    surfaces : sequence of CollisionSurface

    """

    def __init__(self, surfaces: Sequence[CollisionSurface]) -> None:
        self.surfaces = list(surfaces)

    @cached_property
    def arrays(self) -> tuple[Any, ...]:
        """All surfaces for kernels: SurfaceArrays as a plain tuple, see `contact.workspace`."""
        surfaces = np.zeros(len(self.surfaces), SURFACE)
        columns: dict[str, list[np.ndarray]] = {
            'pieces': [np.zeros(0, PIECE)],
            'particles': [np.zeros(0, np.int64)],
            'covered': [np.zeros(0, np.int64)],
            'faces': [np.zeros((0, 3), np.int32)],
            'piece_of_face': [np.zeros(0, np.int32)],
            'edges': [np.zeros((0, 4), np.int32)],
            'may_collide': [np.zeros(0, bool)],
            'normals': [np.zeros((0, 3))],
            'origins': [np.zeros((0, 3))],
        }
        counts = dict.fromkeys(columns, 0)
        trees: list[SurfaceTree] = []

        def put(name: str, values: np.ndarray) -> None:
            columns[name].append(values)
            counts[name] += len(values)

        for record, surface in zip(surfaces, self.surfaces, strict=True):
            record['pieces'], record['first_origin'] = surface.pieces, counts['origins']
            put('origins', surface.origins)
            if not surface.collidable:
                continue
            record['closed'], record['neighbours'] = surface.closed, surface.neighbours
            record['first_particle'] = counts['particles']
            edges, record['sharp_edges'] = surface.edges
            record['thinness'], record['edges'] = surface.thinness, len(edges)
            record['first_face'], record['first_edge'] = counts['faces'], counts['edges']
            record['first_piece'] = counts['pieces']
            record['first_may_collide'] = counts['may_collide']
            covered, begin = surface.covered
            pieces = np.zeros(surface.pieces, PIECE)
            sizes = np.bincount(surface.piece_of_particle, minlength=surface.pieces)
            pieces['first'] = counts['particles'] + np.cumsum(sizes) - sizes
            pieces['count'] = sizes
            pieces['first_covered'] = counts['covered'] + begin[:-1]
            pieces['covered'] = np.diff(begin)
            put('pieces', pieces)
            put('particles', np.argsort(surface.piece_of_particle, kind='stable'))
            put('covered', covered)
            put('faces', surface.rest.surface.faces)
            put('piece_of_face', surface.piece_of_face.astype(np.int32))
            put('edges', edges)
            put('may_collide', surface.may_collide.ravel())
            put('normals', surface.normals)
            if surface.closed:
                record['tree'] = len(trees)
                trees.append(surface.tree)
        joined = {
            name: np.concatenate(arrays, dtype=arrays[0].dtype) for name, arrays in columns.items()
        }
        return tuple(SurfaceArrays(surfaces, trees=pack(trees), **joined))


NO_SURFACES = CollisionSurfaces(()).arrays
"""Where there is nothing that could meet them."""
