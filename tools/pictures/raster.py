# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small renderer for pictures: a depth buffer, smooth shading and soft shadows, all in NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

CHUNK = 1_000_000
"""Pairs of a triangle and a pixel that are looked at together."""
LARGE = 10_000
"""Pixels around a triangle, beyond which it is looked at by itself."""
LIGHT = np.array([-0.34, -0.42, 0.84])
LIGHT = LIGHT / np.linalg.norm(LIGHT)
SKY = 0.66
"""Light from everywhere, for what faces up; 0.8 of it for what faces the horizon."""
SUN = 0.44
SHADOW = 0.75
"""Share of the sunlight that a shadow takes."""
SUN_WIDTH = 0.12
"""How much a shadow blurs for each metre between what casts it and what it falls on."""
WIDEST = 0.12
"""m that it blurs at most."""
CREASE = np.cos(np.radians(40.0))
"""Edges between faces that differ by more in direction stay sharp."""
SAMPLES = 32


@dataclass(frozen=True)
class Thing:
    """
    Triangles of one material.

    Attributes
    ----------
    vertices : (n, 3) float
    faces : (m, 3) int
    color : (3,) float, or function of points (k, 3) of the rest shape to their colors (k, 3)
    casts : bool
        whether it can throw a shadow
    rest : (n, 3) float, optional
        vertices of the rest shape: what a painted pattern sticks to
    shine : float
        strength of the sun's reflection

    """

    vertices: np.ndarray
    faces: np.ndarray
    color: np.ndarray | Callable[[np.ndarray], np.ndarray]
    casts: bool = True
    rest: np.ndarray | None = None
    shine: float = 0.0


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
    Return what each pixel shows: depths, m, infinite where nothing is, and indices of triangles.

    Parameters
    ----------
    corners : (k, 3, 3) float
        of the triangles, m
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

    def draw(triangle: np.ndarray, column: np.ndarray, row: np.ndarray) -> None:
        """Look at pairs of a triangle and a pixel."""
        a, b, c = np.moveaxis(seen[triangle], -2, 0)
        x, y = column + 0.5 - a[..., 0], row + 0.5 - a[..., 1]
        (u, v, p), (r, t, q) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
        with np.errstate(divide='ignore', invalid='ignore'):
            area = 1.0 / (u * t - v * r)
            second, third = (x * t - y * r) * area, (u * y - v * x) * area
        inside = (second >= -1e-9) & (third >= -1e-9) & (second + third <= 1 + 1e-9)
        at = (a[..., 2] + second * p + third * q)[inside]
        pixel = (row * columns + column)[inside]
        np.minimum.at(depth, pixel, at)
        first = at == depth[pixel]
        shown[pixel[first]] = np.broadcast_to(triangle, inside.shape)[inside][first]

    for triangle in np.flatnonzero(counts > LARGE):
        row, column = np.mgrid[tuple(map(slice, low[triangle, ::-1], high[triangle, ::-1]))]
        draw(triangle, column, row)
    small = np.flatnonzero(counts <= LARGE)
    for part in np.split(small, np.flatnonzero(np.diff(counts[small].cumsum() // CHUNK)) + 1):
        triangle = np.repeat(part, counts[part])
        place = np.arange(len(triangle)) - np.repeat(
            counts[part].cumsum() - counts[part], counts[part]
        )
        column = low[triangle, 0] + place % wide[triangle]
        row = low[triangle, 1] + place // wide[triangle]
        draw(triangle, column, row)
    return depth.reshape(camera.shape), shown.reshape(camera.shape)


def shaded(things: Sequence[Thing], camera: View) -> np.ndarray:
    """
    Return a picture (rows, columns, 3) of things in the sun, first row on top.

    Parameters
    ----------
    things : sequence of Thing
        which are to cover the picture
    camera : View

    """
    corners = np.concatenate([each.vertices[each.faces] for each in things])
    depth, shown = nearest(corners, camera)
    points = camera.positions(depth)
    shares = _shares(corners[shown], points)
    directions = np.concatenate([_corner_normals(each) for each in things])[shown]
    normals = _unit(np.einsum('rci,rcij->rcj', shares, directions))
    sun = np.clip(normals @ LIGHT, 0.0, 1.0)
    sun *= 1.0 - SHADOW * _shadow(things, points, camera.scale)
    light = SKY * (0.8 + 0.2 * normals[..., 2]) + SUN * sun
    half = _unit(LIGHT - camera.axes[2])
    gloss = sun * np.clip(normals @ half, 0.0, 1.0) ** 40
    picture = np.zeros((*camera.shape, 3))
    first = 0
    for each in things:
        there = (first <= shown) & (shown < first + len(each.faces))
        color = each.color
        if callable(color):
            rest = each.vertices if each.rest is None else each.rest
            at = rest[each.faces][shown[there] - first]
            color = color(np.einsum('ki,kij->kj', shares[there], at))
        picture[there] = color * light[there, None] + each.shine * gloss[there, None]
        first += len(each.faces)
    return picture.clip(0.0, 1.0)[::-1]


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _shares(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the barycentric coordinates (..., 3) of points (..., 3) in triangles (..., 3, 3)."""
    a, b, c = np.moveaxis(corners, -2, 0)
    normal = np.cross(b - a, c - a)
    square = np.maximum(np.sum(normal**2, axis=-1), 1e-30)
    second = np.sum(np.cross(points - a, c - a) * normal, axis=-1) / square
    third = np.sum(np.cross(b - a, points - a) * normal, axis=-1) / square
    return np.stack([1.0 - second - third, second, third], axis=-1)


def _corner_normals(thing: Thing) -> np.ndarray:
    """Return the normals (m, 3, 3) at the corners of faces: those of faces around, but creases."""
    a, b, c = np.moveaxis(thing.vertices[thing.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    units = _unit(normals)
    vertex = thing.faces.ravel()
    order = np.argsort(vertex, kind='stable')
    counts = np.bincount(vertex, minlength=len(thing.vertices))
    valence, start = counts[vertex], (counts.cumsum() - counts)[vertex]
    corner = np.repeat(np.arange(len(vertex)), valence)
    nth = np.arange(len(corner)) - np.repeat(valence.cumsum() - valence, valence)
    other = order[start[corner] + nth] // 3
    smooth = np.sum(units[corner // 3] * units[other], axis=-1) > CREASE
    result = np.zeros((len(vertex), 3))
    np.add.at(result, corner[smooth], normals[other[smooth]])
    return _unit(result).reshape(-1, 3, 3)


def _shadow(things: Sequence[Thing], points: np.ndarray, scale: float) -> np.ndarray:
    """Return how much of the sun is hidden at points (rows, columns, 3), from 0 to 1."""
    corners = np.concatenate([each.vertices[each.faces] for each in things if each.casts])
    everything = view(-LIGHT, [0.0, 0.0], [1.0, 1.0], 1.0)
    across = everything.onto(corners)[..., :2].reshape(-1, 2)
    low, high = across.min(axis=0) - WIDEST, across.max(axis=0) + WIDEST
    sun = view(-LIGHT, low, high, scale)
    rows, columns = sun.shape
    lit, _ = nearest(corners, sun)
    seen = sun.onto(points)
    near = ((seen[..., :2] > 0.0) & (seen[..., :2] < [columns, rows])).all(axis=-1)
    place, depth = seen[near, :2], seen[near, 2]

    def blockers(radius: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Return how many samples around are hidden, and how far above the points on average."""
        count, distance = np.zeros(depth.shape), np.zeros(depth.shape)
        for i in range(SAMPLES):
            # evenly over a disk, in a spiral of the golden angle
            angle, length = 2.4 * i, np.sqrt((i + 0.5) / SAMPLES)
            column = (place[:, 0] + length * np.cos(angle) * radius).astype(int)
            row = (place[:, 1] + length * np.sin(angle) * radius).astype(int)
            gap = depth - lit[row.clip(0, rows - 1), column.clip(0, columns - 1)]
            hidden = gap > 4.0 / scale
            count += hidden
            distance += np.where(hidden, gap, 0.0)
        return count, distance / np.maximum(count, 1.0)

    _, distance = blockers(WIDEST * scale)
    count, _ = blockers(np.clip(SUN_WIDTH * distance, 1.5 / scale, WIDEST) * scale)
    shadow = np.zeros(points.shape[:2])
    shadow[near] = count / SAMPLES
    return shadow


def smaller(picture: np.ndarray, factor: int) -> np.ndarray:
    """Return a picture with each square of `factor` by `factor` pixels averaged to one."""
    rows, columns = (length // factor for length in picture.shape[:2])
    picture = picture[: rows * factor, : columns * factor]
    return picture.reshape(rows, factor, columns, factor, 3).mean(axis=(1, 3))
