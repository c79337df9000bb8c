# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Walls inside a solid: sheets of triangles that end at its surface, where three meet."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from softbody_ros.core.geometry.bvh import make_tree
from softbody_ros.core.geometry.mesh_edges import counted, edges_of, groups_of
from softbody_ros.core.geometry.mesh_winding import TOUCHING, enclosed_volume, wound_alike
from softbody_ros.core.geometry.surface import Surface

MOST_SHEETS = 12
"""Number of sheets that meet each other, above which walls are not looked for among them."""


def without_walls(vertices: np.ndarray, faces: np.ndarray, said: list[str]) -> np.ndarray:
    """
    Return triangles without walls: what the others enclose, wall by wall, is one solid.

    The edges at which more than two triangles meet divide a surface into sheets. Walls are those
    without which all edges have two triangles, and that are inside what is left.
    """
    edges = edges_of(faces)
    if not (edges.count % 2 == 1)[edges.count > 2].any():
        return faces
    sheet = groups_of(edges.pairs()[0], len(faces))
    is_wall = np.zeros(len(faces), dtype=bool)
    for sheets, incidence in _clusters(edges.edge, edges.count, sheet):
        for chosen in _removable(incidence):
            removed = np.isin(sheet, sheets[chosen])
            rest = faces[np.isin(sheet, np.delete(sheets, chosen))]
            if _are_inside(vertices, faces[removed], rest):
                is_wall |= removed
                break
    if not is_wall.any():
        return faces
    said.append(f'has {counted(int(is_wall.sum()), "triangle")} of walls inside it, left out')
    return wound_alike(faces[~is_wall], said)


def _clusters(
    edge: np.ndarray, count: np.ndarray, sheet: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield sheets (k,) int that meet each other, and how often each has each edge, (e, k)."""
    crowded = count[edge] > 2
    number = np.repeat(np.arange(len(edge)), 3).reshape(-1, 3)[crowded]
    pairs = np.stack([sheet[number], edge[crowded] + sheet.max() + 1], axis=1)
    cluster = groups_of(pairs, int(sheet.max()) + 1 + len(count))
    opened = sheet[(count[edge] == 1).any(axis=1)]
    for each in np.unique(cluster[pairs[:, 0]]):
        own = pairs[cluster[pairs[:, 0]] == each]
        sheets, column = np.unique(own[:, 0], return_inverse=True)
        if len(sheets) > MOST_SHEETS or np.isin(sheets, opened).any():
            continue
        ends, row = np.unique(own[:, 1], return_inverse=True)
        incidence = np.zeros((len(ends), len(sheets)), int)
        np.add.at(incidence, (row.ravel(), column.ravel()), 1)
        yield sheets, np.unique(incidence, axis=0)


def _removable(incidence: np.ndarray) -> Iterator[list[int]]:
    """Yield the sets of sheets without which each edge has two triangles or none, fewest first."""
    odd = incidence.sum(axis=1) % 2 == 1
    candidates = np.flatnonzero((incidence[odd] > 0).any(axis=0)).tolist()
    for number in range(1, len(candidates)):
        for chosen in combinations(candidates, number):
            left = np.delete(incidence, chosen, axis=1).sum(axis=1)
            if np.isin(left, (0, 2)).all():
                yield list(chosen)


def _are_inside(vertices: np.ndarray, walls: np.ndarray, rest: np.ndarray) -> bool:
    """Return whether triangles are inside what others enclose."""
    rest = wound_alike(rest, [])
    volume = enclosed_volume(vertices, rest)
    if not volume or not edges_of(rest).closed.all():
        return False
    middles = vertices[walls].mean(axis=1)
    distance = make_tree(Surface(vertices, rest)).distance(middles)[0]
    return bool((distance * np.sign(volume) < -TOUCHING).all())
