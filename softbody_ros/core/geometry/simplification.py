# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Simplification of surfaces by quadric decimation.

M. Garland, P. S. Heckbert: Surface simplification using quadric error metrics, SIGGRAPH 1997; by
the package fast-simplification, through trimesh.
"""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import trimesh

from softbody_ros.core.geometry.mesh_edges import edges_of
from softbody_ros.core.geometry.mesh_winding import enclosed_volume
from softbody_ros.core.geometry.surface import MeshError, Surface

FEWEST = 8
"""Vertices below which hardly anything keeps its shape."""
AGGRESSIONS = (7, 5, 9)
"""Of the decimation, tried in this order: where one leaves edges of four faces another may not."""
COUNT_TOLERANCE = 0.1
"""Relative deviation of the number of vertices from that asked for."""
VOLUME_TOLERANCE = 0.25
"""Relative change of the enclosed volume beyond which the shape is lost."""


def simplified(surface: Surface, count: int) -> Surface:
    """
    Return a surface with about `count` vertices: within a tenth, usually exactly.

    It is closed if the given one is, and the same bits each time. A surface that has no more
    vertices is returned as it is.

    Parameters
    ----------
    surface : Surface
    count : int

    Raises
    ------
    MeshError
        if it would not be closed any more or lose its shape, or fast-simplification is not
        installed.

    """
    if len(surface.vertices) <= count:
        return surface
    if not len(surface.faces):
        raise MeshError(
            f'simplify_to is {count}, but the mesh has no triangles that could be fewer: 0 is off'
        )
    if importlib.util.find_spec('fast_simplification') is None:
        raise MeshError(
            f'simplify_to is {count}, which needs fast-simplification, which is not installed: '
            'pip install fast-simplification'
        )
    reasons = []
    for aggression in AGGRESSIONS:
        result, reason = _decimated(surface, count, aggression)
        if not reason:
            return result
        reasons.append(reason)
    raise MeshError(
        f'simplify_to is {count}, to which this mesh of {len(surface.vertices)} vertices cannot '
        f'be simplified ({reasons[0]}): give more, or a coarse mesh and this one as visual_mesh'
    )


def _decimated(surface: Surface, count: int, aggression: int) -> tuple[Surface, str]:
    """Return a surface with fewer vertices, and what is wrong with it."""
    # Euler's formula: to collapse an edge takes away a vertex and its two faces; at a boundary,
    # which becomes shorter as lengths do, one
    before = len(np.unique(surface.faces))
    boundary = (edges_of(surface.faces).count == 1).sum() * (1.0 - math.sqrt(count / before))
    wanted = len(surface.faces) - 2 * (before - count) + round(boundary)
    # it does not take arrays that cannot be written to
    mesh = trimesh.Trimesh(surface.vertices.copy(), surface.faces.copy(), process=False)
    try:
        made = mesh.simplify_quadric_decimation(face_count=max(wanted, 4), aggression=aggression)
    except TypeError:  # before trimesh 4.5 it was another library's
        raise MeshError(
            f'simplify_to is {count}, which needs trimesh 4.5: pip install --upgrade trimesh'
        ) from None
    # vertices have been put together where they coincide
    faces = np.asarray(made.faces)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    kept = np.unique(faces)
    if not len(kept):
        return surface, 'nothing is left'
    result = Surface(
        np.asarray(made.vertices)[kept],
        np.searchsorted(kept, faces),
        surface.source,
        surface.notes,
    )
    if abs(len(kept) - count) > COUNT_TOLERANCE * count:
        return result, f'{len(kept)} are left'
    if surface.closed:
        if not result.closed:
            return result, 'it would not be closed any more'
        share = enclosed_volume(result.vertices, result.faces) / enclosed_volume(
            surface.vertices, surface.faces
        )
        if not abs(share - 1.0) <= VOLUME_TOLERANCE:
            return result, f'{share:.0%} of the volume are left'
    return result, ''
