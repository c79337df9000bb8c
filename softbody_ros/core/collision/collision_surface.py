# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a rest shape needs so that bodies which have it can be touched: computed once per shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from softbody_ros.core.geometry.face_table import FaceTable, make_face_table
from softbody_ros.core.geometry.mesh import vertex_normals
from softbody_ros.core.shape_matching.regions import Regions
from softbody_ros.core.shape_matching.rest_shape import RestShape

NEIGHBOURS = 2.0
"""Edges between a particle and a face of the same body within which they cannot touch."""


@dataclass(frozen=True, eq=False)
class Skin:
    """
    The surface of a shape, in the P pieces whose posture is known: its regions, or the whole.

    Each particle and each face belongs to one piece. What is derived is made when it is needed.

    Attributes
    ----------
    rest : RestShape
    regions : Regions or None

    """

    rest: RestShape
    regions: Regions | None

    @property
    def pieces(self) -> int:
        """Number of pieces, P."""
        return self.regions.count if self.regions else 1

    @property
    def closed(self) -> bool:
        """Whether it has an inside, which others can be kept out of."""
        return self.rest.surface.closed

    @cached_property
    def _home(self) -> np.ndarray:
        if self.regions is None:
            return np.zeros(self.rest.particle_count, dtype=np.int64)
        return self.regions.home

    @cached_property
    def order(self) -> np.ndarray:
        """(n,) int: the particles, piece by piece."""
        return np.argsort(self._home, kind='stable')

    @cached_property
    def first(self) -> np.ndarray:
        """(P + 1,) int: where in `order` each piece begins."""
        return np.searchsorted(self._home[self.order], np.arange(self.pieces + 1))

    @cached_property
    def corners(self) -> np.ndarray:
        """(m, 3) int: of the faces, as places in `order`."""
        place = np.empty(self.rest.particle_count, dtype=np.int64)
        place[self.order] = np.arange(len(place))
        return place[self.rest.surface.faces]

    @cached_property
    def piece_of_face(self) -> np.ndarray:
        """(m,) int."""
        return self._home[self.rest.surface.faces[:, 0]]

    @cached_property
    def covered(self) -> tuple[np.ndarray, np.ndarray]:
        """(c,) int: particles of pieces and of corners of their faces; (P,) int: their begins."""
        faces, count = self.rest.surface.faces, self.rest.particle_count
        piece = np.concatenate([self._home, np.repeat(self.piece_of_face, 3)])
        particle = np.concatenate([np.arange(count), faces.ravel()])
        piece, particle = np.divmod(np.unique(piece * count + particle), count)
        return particle, np.searchsorted(piece, np.arange(self.pieces))

    @cached_property
    def strangers(self) -> np.ndarray:
        """
        (P, P) bool: pieces of one body that may touch each other.

        No particle belongs to both, nor has a face of both.
        """
        if self.regions is None:
            return np.zeros((1, 1), dtype=bool)
        particle, first = self.covered
        count = self.rest.particle_count
        ends = np.append(first, len(particle))
        covers = csr_array((np.ones(len(particle)), particle, ends), (self.pieces, count)).T
        belongs = covers + self.regions.belongs
        return (belongs.T @ belongs).toarray() == 0.0

    @cached_property
    def normals(self) -> np.ndarray:
        """(n, 3) float: of the surface at the particles in `order`; zero where there is none."""
        total = vertex_normals(self.rest.surface.vertices, self.rest.surface.faces)[self.order]
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return total / np.where(length > 0.0, length, 1.0)

    @cached_property
    def table(self) -> FaceTable:
        """Which face of the rest shape is nearest, for closed ones."""
        return make_face_table(self.rest.surface)

    def apart(self, particle: np.ndarray, face: np.ndarray) -> np.ndarray:
        """Return whether particles (k,), places in `order`, are no neighbours of faces (k,)."""
        vertices = self.rest.surface.vertices[self.order]
        middle = vertices[self.corners[face]].mean(axis=1)
        distance = np.linalg.norm(vertices[particle] - middle, axis=1)
        return distance > NEIGHBOURS * self._edge

    @cached_property
    def _edge(self) -> float:
        a, b, c = self.rest.surface.vertices[self.rest.surface.faces.T]
        return float(np.linalg.norm([a - b, b - c, c - a], axis=2).mean())

    def prepare(self) -> None:
        """Make the table now, not when something first comes near: it takes a while."""
        if self.closed:
            _ = self.table
