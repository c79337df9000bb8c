# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where surfaces come from: primitives, and mesh files, which are loaded, welded and validated."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass

import numpy as np
import trimesh

from softbody_ros.core.geometry.mesh_files import TO_Z_UP, MeshFile, read_mesh_file
from softbody_ros.core.geometry.mesh_repair import repaired, used_vertices, welded
from softbody_ros.core.geometry.mesh_winding import facing_outwards
from softbody_ros.core.geometry.solid_moments import solid_moments
from softbody_ros.core.geometry.surface import MeshError, Surface, check_surface

PRIMITIVES = ('icosphere', 'box', 'cylinder', 'capsule', 'torus')
SMALLEST, LARGEST = 1e-4, 1e4
"""Of half the longest side, m, as of `size`."""
FARTHEST = 1e6
"""Largest distance of the origin of a file from its mesh, in half extents."""
SMALLER = 1e-5
"""Difference of extents, in half extents, that welding cannot have made."""


ORIGINS = ('box_centre', 'file', 'centre_of_mass')
UPS = ('auto', 'z', 'y')


@dataclass(frozen=True)
class MeshFrame:
    """
    How the coordinates of a mesh file become those of the frame of a body or obstacle.

    Attributes
    ----------
    scale : float
        metres that one unit of the file is, of a file in millimetres 0.001; of COLLADA, which
        says its unit itself, on top of that. 0: it is made to fit
    origin : str
        the point of the mesh that becomes the origin: the centre of its bounding box
        ('box_centre'), where the file has its own ('file'), or the centre of mass of the solid
        that it encloses, of its area if it is open ('centre_of_mass')
    up : str
        the axis of the file that points up, 'z' or 'y'; 'auto': y of GLB, by its specification,
        what COLLADA says itself, z of other formats

    """

    scale: float = 0.0
    origin: str = 'box_centre'
    up: str = 'auto'


def make_surface(
    mesh: str, size: float, subdivisions: int, frame: MeshFrame = MeshFrame()
) -> Surface:
    """
    Return a primitive, or the mesh in a file, repaired.

    It is centred at the origin and as large as `size`, or as the frame says.

    Parameters
    ----------
    mesh : str
        one of `PRIMITIVES`, or the path of an STL, OBJ, PLY, OFF, GLB or DAE file
    size : float
        half the longest side of the bounding box, m; not used if the frame has a scale
    subdivisions : int
        fineness of a primitive; not used for files
    frame : MeshFrame
        not used for primitives

    Raises
    ------
    MeshError
        if the file cannot be read or does not hold a usable triangle mesh.

    """
    if mesh in PRIMITIVES:
        shape = _primitive(mesh, subdivisions)
        faces = np.asarray(shape.faces, dtype=np.int64)
        vertices, _, _ = _fitted(np.asarray(shape.vertices, dtype=np.float64), faces, mesh)
        vertices, faces = welded(vertices, faces, [])
        return Surface(size * vertices, facing_outwards(vertices, faces, []))
    file = read_mesh_file(mesh, PRIMITIVES)
    up = file.up if frame.up == 'auto' else frame.up
    vertices, faces, notes = _usable(mesh, file)
    if up != 'z':
        vertices = vertices @ TO_Z_UP[up].T
    surface, middle, half_extent = _without_faults(mesh, vertices, faces, notes)
    if frame.scale:
        size = _checked_size(frame.scale * file.unit * half_extent, mesh, frame)
    vertices = _with_origin(surface, frame.origin, -middle / half_extent)
    return dataclasses.replace(surface, vertices=size * vertices)


def _usable(path: str, file: MeshFile) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return vertices that are finite, faces and notes of a file."""
    what = f'mesh {path}'
    check_surface(np.nan_to_num(file.vertices, posinf=0.0, neginf=0.0), file.faces, what)
    vertices, faces, unused = used_vertices(file.vertices, file.faces)
    check_surface(vertices, faces, what)
    return vertices, faces, (*file.notes, *(f'{what} {each}' for each in unused))


def _without_faults(
    path: str, vertices: np.ndarray, faces: np.ndarray, notes: tuple[str, ...]
) -> tuple[Surface, np.ndarray, float]:
    """
    Return a mesh, repaired, in a cube of half extent 1, where the centre was, and its half extent.

    Its notes are those of the file, and what has been repaired.
    """
    what = f'mesh {path}'
    vertices, middle, half_extent = _fitted(vertices, faces, path)
    vertices, faces, said = repaired(vertices, faces)
    if not len(faces):
        raise MeshError(f'{what} holds only triangles without area: export it again')
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if (high - low).max() < 2.0 - SMALLER or np.abs(low + high).max() > SMALLER:
        # what was outermost is left out
        vertices, offset, factor = _fitted(vertices, faces, path)
        middle, half_extent = middle + half_extent * offset, half_extent * factor
    notes += tuple(f'{what} {each}' for each in said)
    return Surface(vertices, faces, path, notes), middle, half_extent


def _checked_size(size: float, mesh: str, frame: MeshFrame) -> float:
    """Return half the longest side of a mesh with a scale of its own, m, if it is usable."""
    if not SMALLEST <= size <= LARGEST:
        raise MeshError(
            f'mesh {mesh} measures {2.0 * size:g} m across with mesh_scale {frame.scale:g}: it '
            f'must be from {2.0 * SMALLEST:g} to {2.0 * LARGEST:g} m'
        )
    return size


def _with_origin(surface: Surface, origin: str, of_file: np.ndarray) -> np.ndarray:
    """Return the vertices (n, 3) of a fitted surface about another origin."""
    if origin == 'file':
        if np.abs(of_file).max() > FARTHEST:
            raise MeshError(
                f'mesh {surface.source} is {0.5 * np.abs(of_file).max():g} times its size away '
                'from its origin: move it there, or set mesh_origin to box_centre'
            )
        return surface.vertices - of_file
    if origin == 'centre_of_mass':
        return surface.vertices - centre_of_mass(surface)
    return surface.vertices


def centre_of_mass(surface: Surface) -> np.ndarray:
    """Return (3,) float: the centre of the enclosed volume, of an open surface of its area, m."""
    if surface.closed:
        solid = solid_moments(surface.vertices, surface.faces)
        if solid.volume > 0.0:
            return solid.centre
    a, b, c = surface.vertices[surface.faces.T]
    middle = a.mean(axis=0)  # about which little is lost to rounding
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if not areas.any():  # as a line has none
        return surface.vertices.mean(axis=0)
    return middle + areas @ ((a + b + c) / 3.0 - middle) / areas.sum()


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
    file = read_mesh_file(path, PRIMITIVES)
    vertices, faces, notes = _usable(path, file)
    vertices = file.unit * np.asarray(scale, dtype=float) * vertices
    if np.prod(np.sign(scale)) < 0.0:
        faces = faces[:, ::-1]  # mirrored, it would be inside out
    surface, middle, half_extent = _without_faults(path, vertices, faces, notes)
    return dataclasses.replace(surface, vertices=middle + half_extent * surface.vertices)


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


def _fitted(
    vertices: np.ndarray, faces: np.ndarray, mesh: str
) -> tuple[np.ndarray, np.ndarray, float]:
    """
    Return vertices for which the faces just fit into a cube of half extent 1.

    And where its centre was, (3,), and its half extent.
    """
    used = vertices[np.unique(faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    with np.errstate(over='ignore'):
        half_extent = (high - low).max() / 2
    if not 0 < half_extent < np.inf:
        raise MeshError(f'mesh {mesh} measures {2 * half_extent:g} across: export it again')
    middle = (low + high) / 2
    return (vertices - middle) / half_extent, middle, float(half_extent)
