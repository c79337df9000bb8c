# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Surfaces: vertices and triangles, which are checked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from softbody_ros.core.geometry.mesh_edges import edges_of

LARGEST_MESH = 4_000_000
"""Largest number of vertices: beyond it a step takes longer than a frame on any machine."""


class MeshError(ValueError):
    """An unusable mesh: the message is one sentence with the reason."""


@dataclass(frozen=True, eq=False)
class Surface:
    """
    An indexed triangle mesh, or a point cloud without faces.

    Attributes
    ----------
    vertices : (n, 3) float
        positions in the body's own frame, m
    faces : (m, 3) int
        vertex indices, anticlockwise seen from outside
    source : str
        the path of its file, if it is of one
    notes : tuple of str
        a sentence for each thing that is not as in the file

    """

    vertices: np.ndarray
    faces: np.ndarray
    source: str = ''
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces)
        if not faces.size:
            faces = faces.reshape(0, 3)
        check_surface(vertices, faces, 'the surface')
        for name, array in (('vertices', vertices), ('faces', faces.astype(np.int32))):
            array = array.copy()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @cached_property
    def closed(self) -> bool:
        """Whether it is watertight: every edge has two faces of consistent winding."""
        mesh = trimesh.Trimesh(self.vertices, self.faces, process=False, validate=False)
        return bool(len(self.faces) and mesh.is_watertight and mesh.is_winding_consistent)

    @cached_property
    def openness(self) -> tuple[str, str]:
        """What keeps it from having an inside, and what to do about that; '' if it is closed."""
        if self.closed:
            return '', ''
        if not len(self.faces):
            return 'no triangles', 'give a surface'
        edges = edges_of(self.faces)
        return ' and '.join(edges.defects()), edges.remedy()


def check_surface(vertices: np.ndarray, faces: np.ndarray, what: str) -> None:
    """Raise MeshError if vertices or faces are not those of a surface."""
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not len(vertices):
        raise MeshError(f'{what} has vertices of shape {vertices.shape}: it must be (n, 3), n > 0')
    if len(vertices) > LARGEST_MESH:
        raise MeshError(
            f'{what} has {len(vertices)} vertices, more than {LARGEST_MESH}: simplify it first'
        )
    if not np.isfinite(vertices).all():
        raise MeshError(f'{what} has vertices that are not finite: export it again')
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f'{what} has faces of shape {faces.shape}: they must be triangles, (m, 3)')
    if len(faces) and faces.dtype.kind not in 'iu':
        raise MeshError(f'{what} has faces of type {faces.dtype}: they must be vertex indices')
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise MeshError(f'{what} has faces that refer to vertices outside 0 … {len(vertices) - 1}')


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """
    Return vertex normals (n, 3): sums over adjacent faces of twice their area vectors.

    Parameters
    ----------
    vertices : (n, 3) float
    faces : (m, 3) int

    """
    a, b, c = vertices[faces.T]
    normals = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    sums = [np.bincount(faces.ravel(), along, len(vertices)) for along in normals.T]
    return np.stack(sums, axis=1)
