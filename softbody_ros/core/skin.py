# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a rest shape needs so that bodies which have it can be touched: computed once per shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from softbody_ros.core.face_table import FaceTable, make_face_table
from softbody_ros.core.regions import Regions
from softbody_ros.core.rest_shape import RestShape

NEIGHBOURS = 2.0
"""Edges between a particle and a face of the same body within which they cannot touch."""


@dataclass(frozen=True, eq=False)
class Skin:
    """
    The surface of a shape, in the P pieces whose posture is known: its regions, or the whole.

    Each particle and each face belongs to one piece.

    Attributes
    ----------
    rest : RestShape
    order : (n,) int
        the particles, piece by piece
    first : (P + 1,) int
        where in `order` each piece begins
    corners : (m, 3) int
        of the faces, as places in `order`
    piece_of_face : (m,) int
    covered, covered_first : (c,), (P,) int
        particles of each piece and at corners of its faces, and where each piece begins
    normals : (n, 3) float
        of the surface at the particles in `order`, in the rest shape; zero for one without faces
    strangers : (P, P) bool
        pieces of one body that may touch each other: no particle belongs to both, nor has a face
        of both

    """

    rest: RestShape
    order: np.ndarray
    first: np.ndarray
    corners: np.ndarray
    piece_of_face: np.ndarray
    covered: np.ndarray
    covered_first: np.ndarray
    normals: np.ndarray
    strangers: np.ndarray

    @property
    def pieces(self) -> int:
        """Number of pieces, P."""
        return len(self.strangers)

    @property
    def closed(self) -> bool:
        """Whether it has an inside, which others can be kept out of."""
        return self.rest.surface.closed

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


def make_skin(rest: RestShape, regions: Regions | None) -> Skin:
    """Return the skin of a shape that is matched as a whole, or in regions."""
    faces, count = rest.surface.faces, rest.particle_count
    pieces = 1 if regions is None else regions.count
    home = np.zeros(count, dtype=np.int64) if regions is None else regions.home
    order = np.argsort(home, kind='stable')
    place = np.empty(count, dtype=np.int64)
    place[order] = np.arange(count)
    piece_of_face = home[faces[:, 0]]
    of_piece = np.concatenate([home, np.repeat(piece_of_face, 3)]) * count
    piece, covered = np.divmod(
        np.unique(of_piece + np.concatenate([np.arange(count), faces.ravel()])), count
    )
    strangers = np.zeros((1, 1), dtype=bool)
    if regions is not None:
        covers = csr_array((np.ones(len(piece)), (covered, piece)), shape=(count, pieces))
        belongs = covers + regions.belongs
        strangers = (belongs.T @ belongs).toarray() == 0.0
    return Skin(
        rest=rest,
        order=order,
        first=np.searchsorted(home[order], np.arange(pieces + 1)),
        corners=place[faces],
        piece_of_face=piece_of_face,
        covered=covered,
        covered_first=np.searchsorted(piece, np.arange(pieces)),
        normals=_normals(rest)[order],
        strangers=strangers,
    )


def _normals(rest: RestShape) -> np.ndarray:
    """Return the normals (n, 3) of the surface at the particles: means of those of the faces."""
    vertices, faces = rest.surface.vertices, rest.surface.faces
    a, b, c = vertices[faces.T]
    double_area = np.cross(b - a, c - a)
    total = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(axis, 3), rest.particle_count)
            for axis in double_area.T
        ],
        axis=1,
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0.0, length, 1.0)
