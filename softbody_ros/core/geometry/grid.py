# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A uniform grid of cubes around something: which cell a point is in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Grid:
    """
    N cubes side by side, numbered with the last axis first.

    Attributes
    ----------
    origin : (3,) float
        corner, m
    cell : float
        edge length of a cell, m
    shape : (3,) int
        cells per axis

    """

    origin: np.ndarray
    cell: float
    shape: np.ndarray

    def cells(self, points: np.ndarray) -> np.ndarray:
        """Return the number of the cell (k,) that each point (k, 3), m, is in, or next to."""
        scaled = (points.T - self.origin[:, None]) * (1.0 / self.cell)
        _, rows, columns = self.shape
        # unlike clip, these make a number of what is none
        x, y, z = np.fmax(np.fmin(scaled, (self.shape - 1)[:, None]), 0.0).astype(np.int64)
        return (x * rows + y) * columns + z

    def centres(self) -> np.ndarray:
        """Return the centres (N, 3) of all cells, m."""
        axes = [self.origin[axis] + self.cell * (0.5 + np.arange(self.shape[axis]))
                for axis in range(3)]  # fmt: skip
        return np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)

    def with_border(self) -> Grid:
        """Return the grid with one more cell on each side."""
        return Grid(self.origin - self.cell, self.cell, self.shape + 2)


def grid_around(low: np.ndarray, high: np.ndarray, cell: float, margin: int) -> Grid:
    """Return a grid that reaches so many cells beyond a box."""
    shape = np.ceil((high - low) / cell).astype(np.int64) + 2 * margin
    return Grid((low + high - shape * cell) / 2, cell, shape)
