# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Vertex normals for smooth shading: without them viewers shade each triangle flat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from softbody_ros.core import Surface
from softbody_ros.core.geometry.mesh import vertex_normals

CREASE = np.radians(50.0)
"""Dihedral angle at rest above which an edge stays sharp: of a box, not of a ball."""


@dataclass(frozen=True, eq=False)
class Shading:
    """
    Assignment of normals to the corners of triangles.

    Attributes
    ----------
    origin : (k,) int
        the vertex of each normal, ascending; a vertex on a crease has several
    faces : (m, 3) int
        of each corner the index of its normal

    """

    origin: np.ndarray
    faces: np.ndarray

    def normals(self, positions: np.ndarray) -> np.ndarray:
        """Return the normals (k, 3), float32, of length 1, at vertex positions (n, 3)."""
        sums = vertex_normals(positions[self.origin], self.faces)
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        # without area it is invisible, but the formats require a unit normal
        normals = np.where(lengths > 0.0, sums / np.maximum(lengths, 1e-300), (0.0, 0.0, 1.0))
        return normals.astype(np.float32)


def shading(surface: Surface) -> Shading:
    """Return the normals of a surface: corners at a vertex share one across smooth edges."""
    faces = surface.faces
    corners = faces.ravel()
    labels = connected_components(_joined_corners(surface), directed=False)[1]
    _, first, group = np.unique(labels, return_index=True, return_inverse=True)
    order = np.argsort(corners[first], kind='stable')
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return Shading(corners[first][order], rank[group].reshape(-1, 3))


def _joined_corners(surface: Surface) -> coo_array:
    """Return the graph (3 m, 3 m) of corners adjacent across smooth edges."""
    faces = surface.faces
    a, b, c = surface.vertices[faces.T]
    across = np.cross(b - a, c - a)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    # the two corners of each edge, that of the lower vertex first
    ends = np.arange(faces.size).reshape(-1, 3)
    ends = np.stack([ends, np.roll(ends, -1, axis=1)], axis=-1).reshape(-1, 2)
    vertices = faces.ravel()[ends]
    ends = np.where((vertices[:, 0] < vertices[:, 1])[:, None], ends, ends[:, ::-1])
    low, high = faces.ravel()[ends].T
    order = np.lexsort((high, low))
    same = (np.diff(low[order]) == 0) & (np.diff(high[order]) == 0)
    one, other = order[:-1][same], order[1:][same]
    smooth = np.einsum('ij,ij->i', across[one // 3], across[other // 3]) > np.cos(CREASE)
    joined = ends[one[smooth]].ravel(), ends[other[smooth]].ravel()
    return coo_array((np.ones(len(joined[0]), bool), joined), shape=(faces.size, faces.size))
