# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Surfaces of bodies: primitives, and mesh files, which are loaded, welded and validated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
import os
import re

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
import trimesh

PRIMITIVES = ('icosphere', 'box', 'cylinder', 'capsule', 'torus')
FILE_TYPES = ('stl', 'obj', 'ply', 'off', 'glb')
LARGEST_FILE = 1 << 30
COLLADA_HEAD = 1 << 16
"""Characters of a COLLADA file in which its unit stands."""
LARGEST_MESH = 4_000_000
"""Largest number of vertices: beyond it a step takes longer than a frame on any machine."""
WELD_DISTANCE = 1e-7
"""Vertices closer than this, relative to the half extent, are merged: seams of UVs, normals."""


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

    """

    vertices: np.ndarray
    faces: np.ndarray

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces)
        if not faces.size:
            faces = faces.reshape(0, 3)
        _check(vertices, faces, 'the surface')
        for name, array in (('vertices', vertices), ('faces', faces.astype(np.int32))):
            array = array.copy()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @cached_property
    def closed(self) -> bool:
        """Whether it is watertight: every edge has two faces of consistent winding."""
        mesh = trimesh.Trimesh(self.vertices, self.faces, process=False, validate=False)
        return bool(len(self.faces) and mesh.is_watertight and mesh.is_winding_consistent)


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


def make_surface(mesh: str, size: float, subdivisions: int) -> Surface:
    """
    Return a primitive, or the mesh in a file, centred at the origin.

    Parameters
    ----------
    mesh : str
        one of `PRIMITIVES`, or the path of an STL, OBJ, PLY, OFF or GLB file
    size : float
        half the longest side of the bounding box, m
    subdivisions : int
        fineness of a primitive; not used for files

    Raises
    ------
    MeshError
        if the file cannot be read or does not hold a usable triangle mesh.

    """
    if mesh in PRIMITIVES:
        shape = _primitive(mesh, subdivisions)
    else:
        shape = _read_file(mesh)
    vertices = np.asarray(shape.vertices, dtype=np.float64)
    faces = np.asarray(shape.faces, dtype=np.int64)
    if not len(faces):
        raise MeshError(f'mesh {mesh} holds no triangles: give a surface, not points or lines')
    _check(vertices, faces, f'mesh {mesh}')
    vertices, faces = _welded(_fitted(vertices, faces, mesh), faces)
    if not len(faces):
        raise MeshError(f'mesh {mesh} holds only triangles without area: export it again')
    return _facing_outwards(Surface(size * vertices, faces))


def read_surface(path: str, scale: Sequence[float]) -> Surface:
    """
    Return the mesh in a file where it is, scaled along each axis, closed or not.

    Parameters
    ----------
    path : str
        of an STL, OBJ, PLY, OFF, GLB or DAE file; the last with its own unit
    scale : (3,) float
        negative to mirror it

    Raises
    ------
    MeshError
        if the file cannot be read or does not hold a usable triangle mesh.

    """
    shape = _read_file(path, (*FILE_TYPES, 'dae'))
    vertices = (
        _unit_of(path) * np.asarray(scale, dtype=float) * np.asarray(shape.vertices, np.float64)
    )
    faces = np.asarray(shape.faces, dtype=np.int64)
    if not len(faces):
        raise MeshError(f'mesh {path} holds no triangles: give a surface, not points or lines')
    _check(vertices, faces, f'mesh {path}')
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, size = (low + high) / 2, float((high - low).max()) / 2
    if not 0.0 < size < np.inf:
        raise MeshError(f'mesh {path} measures {2.0 * size:g} m across: export it again')
    fitted, faces = _welded((vertices - middle) / size, faces)
    if not len(faces):
        raise MeshError(f'mesh {path} holds only triangles without area: export it again')
    return _facing_outwards(Surface(middle + size * fitted, faces))


def _unit_of(path: str) -> float:
    """Return the unit of a file, m: of COLLADA what it says, as RViz reads it, else 1."""
    if not path.lower().endswith('.dae'):
        return 1.0
    with open(path, encoding='utf-8', errors='replace') as file:
        head = file.read(COLLADA_HEAD)
    said = re.search(r'<unit\b[^>]*?\bmeter\s*=\s*["\']\s*([0-9.eE+-]+)', head)
    try:
        unit = float(said[1]) if said else 1.0
    except ValueError:
        unit = 1.0
    return unit if 0.0 < unit < np.inf else 1.0


def _primitive(kind: str, subdivisions: int) -> trimesh.Trimesh:
    """Return a primitive in a cube of half extent 1; each level doubles its fineness."""
    sections = 8 * 2**subdivisions
    if kind == 'icosphere':
        return trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    if kind == 'torus':
        return trimesh.creation.torus(2 / 3, 1 / 3, sections, sections // 2)
    if kind == 'box':
        box = trimesh.creation.box((2.0, 2.0, 2.0))
        for _ in range(subdivisions):
            box = box.subdivide()
        return box
    quarter = sections // 4 + 1
    if kind == 'capsule':
        angle = np.linspace(0.0, np.pi / 2, quarter)
        lid = np.stack([0.5 * np.sin(angle), 0.5 + 0.5 * np.cos(angle)], axis=1)
    else:
        lid = np.stack([np.linspace(0.0, 1.0, quarter), np.ones(quarter)], axis=1)
    lid[0, 0] = 0.0
    side = np.linspace(lid[-1], lid[-1] * (1, -1), quarter)[1:-1]
    profile = np.vstack([lid, side, lid[::-1] * (1, -1)])
    return trimesh.creation.revolve(profile[::-1], sections=sections)


def _read_file(path: str, types: Sequence[str] = FILE_TYPES) -> trimesh.Trimesh:
    extension = os.path.splitext(path)[1].lower().lstrip('.')
    if extension not in types:
        raise MeshError(
            f'mesh {path[:200]!r} is neither a primitive ({", ".join(PRIMITIVES)}) '
            f'nor a file that ends in .{", .".join(types)}'
        )
    if not os.path.isfile(path):
        raise MeshError(f'mesh file {path[:200]} does not exist: check the path')
    if os.path.getsize(path) > LARGEST_FILE:
        raise MeshError(f'mesh file {path} is larger than 1 GiB: simplify the mesh first')
    try:
        shape = trimesh.load(path, file_type=extension, force='mesh', process=False)
    except Exception as error:  # the parsers raise all kinds of exceptions
        reason = ' '.join(str(error).split()) or type(error).__name__
        raise MeshError(
            f'mesh file {path} cannot be read as {extension.upper()} ({reason}): export it again'
        ) from None
    if not isinstance(shape, trimesh.Trimesh):
        raise MeshError(
            f'mesh file {path} holds no triangles: give a surface, not points or lines'
        )
    return shape


def _check(vertices: np.ndarray, faces: np.ndarray, what: str) -> None:
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


def _fitted(vertices: np.ndarray, faces: np.ndarray, mesh: str) -> np.ndarray:
    """Return the vertices, translated and scaled to fit the faces into a cube of half extent 1."""
    used = vertices[np.unique(faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    with np.errstate(over='ignore'):
        half_extent = (high - low).max() / 2
    if not 0 < half_extent < np.inf:
        raise MeshError(f'mesh {mesh} measures {2 * half_extent:g} across: export it again')
    return (vertices - (low + high) / 2) / half_extent


def _welded(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces with equal positions merged, in the order of the file."""
    first, same = trimesh.grouping.unique_rows(vertices, digits=15)
    pairs = cKDTree(vertices[first]).query_pairs(WELD_DISTANCE, output_type='ndarray')
    count = len(first)
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    groups = connected_components(links, directed=False)[1]
    faces = _first_of_each(groups[same])[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    kept = np.unique(faces)
    return vertices[kept], np.searchsorted(kept, faces)


def _first_of_each(groups: np.ndarray) -> np.ndarray:
    """Return for each vertex the first one of its group."""
    _, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    return first[inverse]


def _facing_outwards(surface: Surface) -> Surface:
    """Return the surface with outward winding if closed; some exporters invert all triangles."""
    a, b, c = surface.vertices[surface.faces.T]
    if surface.closed and np.einsum('ij,ij->', a, np.cross(b, c)) < 0:
        return Surface(surface.vertices, surface.faces[:, ::-1])
    return surface
