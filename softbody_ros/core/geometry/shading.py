# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Vertex normals of smooth surfaces with sharp edges, for films and for the page of the viewer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.geometry.mesh_edges import edges_of, groups_of
from softbody_ros.core.geometry.surface import vertex_normals

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
        lengths = np.sqrt(np.einsum('ij,ij->i', sums, sums))
        normals = (sums / np.maximum(lengths, 1e-300)[:, None]).astype(np.float32)
        # without area it is invisible, but the formats require a unit normal
        normals[lengths == 0.0] = (0.0, 0.0, 1.0)
        return normals


def shading(vertices: np.ndarray, faces: np.ndarray) -> Shading:
    """
    Return the normals of a surface: corners at a vertex share one across smooth edges.

    Parameters
    ----------
    vertices : (n, 3) float
        at rest
    faces : (m, 3) int

    """
    edges, corners = edges_of(faces), faces.ravel()
    pairs, edge = edges.pairs()
    a, b, c = vertices[faces.T]
    across = np.cross(b - a, c - a)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    smooth = np.einsum('ij,ij->i', *across[pairs.T]) > np.cos(CREASE)
    is_sharp = np.ones(len(edges.ends), bool)
    is_sharp[edge[smooth]] = False
    # most vertices are on no crease, and have one normal
    is_creased = np.zeros(len(vertices), bool)
    is_creased[edges.ends[is_sharp]] = True
    creased = np.flatnonzero(is_creased[corners])
    group = _groups(faces, creased, is_creased, pairs[smooth], edges.ends[edge[smooth]])

    is_plain = np.zeros(len(vertices), bool)
    is_plain[corners] = True
    plain = np.flatnonzero(is_plain & ~is_creased)
    of_group = np.empty(group.max(initial=-1) + 1, np.int64)
    of_group[group] = corners[creased]
    origin = np.concatenate([plain, of_group])
    order = np.argsort(origin, kind='stable')
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    number = np.zeros(len(vertices), np.int64)
    number[plain] = rank[: len(plain)]
    index = number[corners]
    index[creased] = rank[len(plain) :][group]
    return Shading(origin[order], index.reshape(-1, 3))


def _groups(
    faces: np.ndarray,
    creased: np.ndarray,
    is_creased: np.ndarray,
    pairs: np.ndarray,
    ends: np.ndarray,
) -> np.ndarray:
    """
    Return the group (k,) int of each corner on a crease: of those joined across smooth edges.

    Parameters
    ----------
    faces : (m, 3) int
    creased : (k,) int
        the corners, counted through the faces
    is_creased : (n,) bool
        whether a vertex is on a crease
    pairs : (p, 2) int
        triangles that meet at a smooth edge
    ends : (p, 2) int
        its vertices

    """
    number = np.zeros(faces.size, np.int64)
    number[creased] = np.arange(len(creased))
    links = []
    for end in ends.T:
        at = is_creased[end]
        triangles = pairs[at]
        place = (faces[triangles] == end[at, None, None]).argmax(axis=-1)
        links.append(number[3 * triangles + place])
    return groups_of(np.concatenate(links), len(creased))
