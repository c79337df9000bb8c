# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A table of the face that is about nearest to any place around a surface: one look-up a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from softbody_ros.core.geometry.grid import Grid, grid_around
from softbody_ros.core.geometry.mesh import Surface
from softbody_ros.core.geometry.nearest_faces import Samples

CELLS = 32
"""Cells along the longest side of a surface."""
NEARLY = 0.2
"""Share by which another face may be nearer."""
MARGIN = 2
"""Cells between a surface's bounding box and the border of the table."""


@dataclass(frozen=True, eq=False)
class FaceTable:
    """
    For each of N cells the face that is nearest to its centre: nearly, to less than a cell.

    Attributes
    ----------
    grid : Grid
    face : (N,) int

    """

    grid: Grid
    face: np.ndarray

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Return (k,) int: the face of the cell that each point (k, 3), m, is in, or next to."""
        return self.face[self.grid.cells(points)]


def make_face_table(surface: Surface) -> FaceTable:
    """Return the table of a surface that has faces."""
    corners = surface.vertices[surface.faces]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    grid = grid_around(low, high, float((high - low).max() / CELLS), MARGIN)
    samples = Samples(corners, grid.cell)
    places = samples.tree.data
    # of small faces one in every half cell will do
    half_cells = Grid(grid.origin, 0.5 * grid.cell, 2 * grid.shape).cells(places)
    _, chosen = np.unique(half_cells, return_index=True)
    # in the middle of a ball all faces are equally far: the search must not look at all of them
    nearest = cKDTree(places[chosen]).query(grid.centres(), eps=NEARLY)[1]
    return FaceTable(grid, samples.parent[chosen[nearest]])
