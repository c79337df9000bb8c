# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small renderer for pictures: triangles, a depth buffer and a shadow map, all in NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CHUNK = 4_000_000
"""Pairs of a triangle and a pixel that are looked at together."""
LIGHT = np.array([-0.42, -0.5, 0.76])
LIGHT = LIGHT / np.linalg.norm(LIGHT)
AMBIENT = 0.45
SHADOW = 0.6
"""Share of the sunlight that a shadow takes."""


@dataclass(frozen=True)
class View:
    """
    Parallel rays through a picture.

    Attributes
    ----------
    axes : (3, 3) float
        to the right, up and forward, as rows
    low : (2,) float
        lower left corner of the picture, m
    scale : float
        pixels per metre
    shape : (2,) int
        rows and columns

    """

    axes: np.ndarray
    low: np.ndarray
    scale: float
    shape: tuple[int, int]

    def onto(self, points: np.ndarray) -> np.ndarray:
        """Return columns, rows from below (pixels) and depths (m) of points (..., 3)."""
        seen = points @ self.axes.T
        seen[..., :2] = (seen[..., :2] - self.low) * self.scale
        return seen

    def positions(self, depth: np.ndarray) -> np.ndarray:
        """Return the points (rows, columns, 3) that the pixels show at their depths."""
        rows, columns = np.indices(self.shape)
        across = (np.stack([columns, rows], axis=-1) + 0.5) / self.scale + self.low
        return across @ self.axes[:2] + depth[..., None] * self.axes[2]


def view(forward: np.ndarray, low: np.ndarray, high: np.ndarray, scale: float) -> View:
    """Return the view in a direction of what lies between two corners, m, of the picture."""
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    columns, rows = np.ceil((np.asarray(high) - low) * scale).astype(int)
    return View(
        np.stack([right, np.cross(right, forward), forward]),
        np.asarray(low),
        scale,
        (rows, columns),
    )


def nearest(corners: np.ndarray, camera: View) -> tuple[np.ndarray, np.ndarray]:
    """
    Return what each pixel shows: depths, m, and indices of triangles.

    Parameters
    ----------
    corners : (k, 3, 3) float
        of the triangles, which are to cover the picture, m
    camera : View

    """
    seen = camera.onto(corners)
    rows, columns = camera.shape
    low = np.ceil(seen[..., :2].min(axis=1) - 0.5).astype(int).clip(0, [columns, rows])
    high = np.ceil(seen[..., :2].max(axis=1) - 0.5).astype(int).clip(0, [columns, rows])
    wide, tall = (high - low).T
    counts = wide * tall
    depth = np.full(rows * columns, np.inf)
    shown = np.zeros(rows * columns, dtype=int)
    for part in np.split(
        np.arange(len(corners)), np.flatnonzero(np.diff(counts.cumsum() // CHUNK)) + 1
    ):
        triangle = np.repeat(part, counts[part])
        place = np.arange(len(triangle)) - np.repeat(
            counts[part].cumsum() - counts[part], counts[part]
        )
        column = low[triangle, 0] + place % wide[triangle]
        row = low[triangle, 1] + place // wide[triangle]
        a, b, c = np.moveaxis(seen[triangle], 1, 0)
        point = np.stack([column, row], axis=-1) + 0.5
        area = _cross(b - a, c - a)
        with np.errstate(divide='ignore', invalid='ignore'):
            second = _cross(point - a[:, :2], c - a) / area
            third = _cross(b - a, point - a[:, :2]) / area
        inside = (second >= -1e-9) & (third >= -1e-9) & (second + third <= 1 + 1e-9)
        at = a[:, 2] + second * (b - a)[:, 2] + third * (c - a)[:, 2]
        pixel, at, triangle = (row * columns + column)[inside], at[inside], triangle[inside]
        np.minimum.at(depth, pixel, at)
        first = at == depth[pixel]
        shown[pixel[first]] = triangle[first]
    return depth.reshape(camera.shape), shown.reshape(camera.shape)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def shaded(corners: np.ndarray, colors: np.ndarray, camera: View) -> np.ndarray:
    """
    Return a picture (rows, columns, 3) of triangles in the sun, first row on top.

    Parameters
    ----------
    corners : (k, 3, 3) float
        of the triangles, which are to cover the picture, m
    colors : (k, 3) float
    camera : View

    """
    depth, shown = nearest(corners, camera)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    sun = np.clip(normals @ LIGHT, 0.0, 1.0)[shown]
    sun *= 1.0 - SHADOW * _in_shadow(corners, camera.positions(depth), camera.scale)
    picture = colors[shown] * (AMBIENT + (1.0 - AMBIENT) * sun)[..., None]
    return picture.clip(0.0, 1.0)[::-1]


def _in_shadow(corners: np.ndarray, points: np.ndarray, scale: float) -> np.ndarray:
    """Return which points (rows, columns, 3) have something between them and the sun."""
    everything = view(-LIGHT, [0.0, 0.0], [1.0, 1.0], scale)
    across = everything.onto(points)[..., :2].reshape(-1, 2) / scale
    sun = view(-LIGHT, across.min(axis=0) - 0.1, across.max(axis=0) + 0.1, scale)
    lit, _ = nearest(corners, sun)
    seen = sun.onto(points)
    column, row = np.moveaxis(seen[..., :2].astype(int), -1, 0)
    slack = 4.0 / scale
    return seen[..., 2] > lit[row, column] + slack


def smaller(picture: np.ndarray, factor: int) -> np.ndarray:
    """Return a picture with each square of `factor` by `factor` pixels averaged to one."""
    rows, columns = (length // factor for length in picture.shape[:2])
    picture = picture[: rows * factor, : columns * factor]
    return picture.reshape(rows, factor, columns, factor, 3).mean(axis=(1, 3))
