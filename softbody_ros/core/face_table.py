# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A table of the face that is about nearest to any place around a surface: one look-up a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from softbody_ros.core.mesh import Surface
from softbody_ros.core.nearest_faces import Samples

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
    origin : (3,) float
        corner of the table, m
    cell : float
        edge length of a cell, m
    shape : (3,) int
        cells per axis
    face : (N,) int

    """

    origin: np.ndarray
    cell: float
    shape: np.ndarray
    face: np.ndarray

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Return (k,) int: the face of the cell that each point (k, 3), m, is in, or next to."""
        scaled = (points.T - self.origin[:, None]) * (1.0 / self.cell)
        _, rows, columns = self.shape
        # unlike clip, these make a number of what is none
        x, y, z = np.fmax(np.fmin(scaled, (self.shape - 1)[:, None]), 0.0).astype(np.int64)
        return self.face[(x * rows + y) * columns + z]


def make_face_table(surface: Surface) -> FaceTable:
    """Return the table of a surface that has faces."""
    corners = surface.vertices[surface.faces]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    cell = (high - low).max() / CELLS
    inner = np.ceil((high - low) / cell).astype(np.int64) + 2 * MARGIN
    origin = (low + high - inner * cell) / 2
    axes = [origin[axis] + cell * (0.5 + np.arange(inner[axis])) for axis in range(3)]
    centres = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)
    samples = Samples(corners, cell)
    places = samples.tree.data
    # of small faces one in every half cell will do
    half_cells = np.floor((places - origin) / (0.5 * cell)).astype(np.int64)
    _, chosen = np.unique(np.ravel_multi_index(half_cells.T, 2 * inner), return_index=True)
    # in the middle of a ball all faces are equally far: the search must not look at all of them
    nearest = cKDTree(places[chosen]).query(centres, eps=NEARLY)[1]
    face = samples.parent[chosen[nearest]]
    return FaceTable(origin, float(cell), inner, face)
