# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Repair of triangle meshes as files have them; each thing that is done is said.

Of a mesh without faults nothing changes. Meshes are in a cube of half extent 1.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
import trimesh

from softbody_ros.core.geometry.mesh_edges import counted, edges_of, groups_of, parts_of
from softbody_ros.core.geometry.mesh_walls import without_walls
from softbody_ros.core.geometry.mesh_winding import facing_outwards, parted, wound_alike

WELD_DISTANCE = 1e-7
"""Vertices closer than this, relative to the half extent, are merged: seams of UVs, normals."""
FLAT = 1e-9
"""Height of a triangle, relative to that, below which it has no area."""

CORNERS = ((0, 1), (1, 2), (2, 0))
"""Of the edges of a triangle."""


def repaired(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """
    Return a mesh without what can be repaired, and what was done, as ends of sentences.

    Parameters
    ----------
    vertices : (n, 3) float
        in a cube of half extent 1
    faces : (m, 3) int

    """
    said: list[str] = []
    vertices, faces = welded(vertices, faces, said)
    if not len(faces):
        return vertices, faces, said
    faces = _without_doubles(_with_like_diagonals(vertices, faces), said)
    faces = _without_slivers(vertices, faces, said)
    faces = wound_alike(faces, said)
    faces = without_walls(vertices, faces, said)
    vertices, faces = parted(vertices, faces, said)
    faces = facing_outwards(vertices, faces, said)
    kept = np.unique(faces)
    if len(kept) < len(vertices):
        vertices, faces = vertices[kept], np.searchsorted(kept, faces)
    return vertices, faces, said


def used_vertices(
    vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return a mesh without the vertices that no triangle has, and what was done."""
    kept = np.unique(faces)
    lost = len(vertices) - len(kept)
    if not lost:
        return vertices, faces, []
    said = f'has {counted(lost, "vertex", "vertices")} that no triangle uses'
    others = np.delete(vertices, kept, axis=0)
    unreal = int((~np.isfinite(others)).any(axis=1).sum())
    said += f', {unreal} of them not finite' if unreal else ''
    said += ': it is left out' if lost == 1 else ': they are left out'
    return vertices[kept], np.searchsorted(kept, faces), [said]


def welded(
    vertices: np.ndarray, faces: np.ndarray, said: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces with equal positions merged, in the order of the file."""
    first, same = trimesh.grouping.unique_rows(vertices, digits=15)
    pairs = cKDTree(vertices[first]).query_pairs(WELD_DISTANCE, output_type='ndarray')
    count = len(first)
    groups = groups_of(pairs, count)
    faces = _first_of_each(groups[same])[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) < len(a):
        lost = len(a) - len(faces)
        said.append(
            f'has {counted(lost, "triangle")} without area: '
            f'{"it is" if lost == 1 else "they are"} left out'
        )
    kept = np.unique(faces)
    return vertices[kept], np.searchsorted(kept, faces)


def _first_of_each(groups: np.ndarray) -> np.ndarray:
    """Return for each vertex the first one of its group."""
    _, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    return first[inverse]


def _with_like_diagonals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return triangles in which flat quadrilaterals of the same corners have the same diagonal."""
    edges = edges_of(faces)
    pairs, edge = edges.pairs()
    ends = edges.ends[edge]
    tips = faces[pairs].sum(axis=2) - ends.sum(axis=1)[:, None]
    corners = np.sort(np.concatenate([ends, tips], axis=1), axis=1)
    _, first, group, count = np.unique(
        corners, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    group = group.ravel()
    a, b, c, d = vertices[corners[first]].swapaxes(0, 1)
    height = np.abs(np.einsum('ij,ij->i', np.cross(b - a, c - a), d - a))
    chosen = np.flatnonzero(((count > 1) & (height < FLAT))[group])
    if not len(chosen):
        return faces
    faces = faces.copy()
    used: set[int] = set(pairs[first[group[chosen]]].ravel().tolist())
    for i in chosen.tolist():
        model = first[group[i]]
        one, two = pairs[i].tolist()
        if (ends[i] == ends[model]).all() or used & {one, two}:
            continue
        used |= {one, two}
        face = faces[one].tolist()
        tip = face.index(tips[i, 0])
        x, begin, end = face[tip], face[(tip + 1) % 3], face[(tip + 2) % 3]
        y = tips[i, 1]
        if sorted((x, y)) == ends[model].tolist():
            faces[one], faces[two] = (x, begin, y), (y, end, x)
    return faces


def _without_doubles(faces: np.ndarray, said: list[str]) -> np.ndarray:
    """
    Return triangles of which no two have the same corners.

    Two back to back bound no volume. Of a part, both are removed if that closes it, as between
    cells that share a wall; else one of them, as of a sheet that is seen from both sides.
    """
    _, first, group, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    if (count == 1).all():
        return faces
    group = group.ravel()
    single = np.zeros(len(faces), dtype=bool)
    single[first] = True
    turned = _even(faces) != _even(faces[first])[group]
    backs = np.bincount(group, turned, len(count)).astype(int)
    between = (2 * backs == count)[group]  # as many this way as that way
    kept = single.copy()
    if between.any():
        part = parts_of(faces[single])
        part_of_group = np.zeros(len(count), int)
        part_of_group[group[single]] = part
        part = part_of_group[group]
        with_one, with_none = (_defects_of(faces, each, part) for each in (single, ~between))
        emptied = np.bincount(part[~between], minlength=len(with_one)) == 0
        kept[between & ((with_none < with_one) & ~emptied)[part]] = False
    is_wall = single & ~kept
    walls = int(is_wall.sum())
    doubles = int((~single & ~np.isin(group, group[is_wall])).sum())
    if walls:
        said.append(
            f'has {counted(walls, "triangle")} of walls inside it, back to back with others: '
            'both sides are left out'
        )
    if doubles:
        said.append(f'has {counted(doubles, "triangle")} twice: one of each is left out')
    return faces[kept]


def _even(faces: np.ndarray) -> np.ndarray:
    """Return (m,) bool: whether corners are an even permutation of sorted ones."""
    a, b, c = faces.T
    return np.asarray(((a < b).astype(int) + (b < c) + (a < c)) % 2 == 1)


def _defects_of(faces: np.ndarray, chosen: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return how many edges of the chosen triangles of each part do not have two."""
    edges = edges_of(faces[chosen])
    wrong = (edges.count != 2)[edges.edge].any(axis=1)
    return np.bincount(part[chosen], wrong, minlength=part.max() + 1)


def _without_slivers(vertices: np.ndarray, faces: np.ndarray, said: list[str]) -> np.ndarray:
    """
    Return triangles of which none has its corners on a line, as far as possible.

    The longest edge of such a sliver is exchanged for the other diagonal of it and its neighbour:
    the surface stays as it is, and closed.
    """
    slivers = _slivers(vertices, faces)
    found = len(slivers)
    if not found:
        return faces
    faces = faces.copy()
    at: dict[tuple[int, int], list[int]] = {}
    for number, face in enumerate(faces.tolist()):
        for one, two in CORNERS:
            at.setdefault((face[one], face[two]), []).append(number)
    todo, budget = slivers.tolist(), 20 * found
    while todo and budget:
        budget -= 1
        number = todo.pop()
        a, b, c = _from_longest(vertices, faces[number].tolist())
        others = at.get((a, c), [])
        if len(others) != 1 or len(at.get((c, a), [])) != 1:
            continue
        other = others[0]
        d = next(each for each in faces[other].tolist() if each not in (a, c))
        if d == b or at.get((b, d)) or at.get((d, b)):
            continue
        for each in (number, other):
            corners = faces[each].tolist()
            for one, two in CORNERS:
                at[corners[one], corners[two]].remove(each)
        for each, corners in ((number, (a, b, d)), (other, (b, c, d))):
            faces[each] = corners
            for one, two in CORNERS:
                at.setdefault((corners[one], corners[two]), []).append(each)
            if _height(vertices, faces[each : each + 1])[0] < FLAT:
                todo.append(each)
    left = len(_slivers(vertices, faces))
    if left < found:
        said.append(
            f'has {counted(found - left, "triangle")} whose corners are on a line: what is next '
            'to them takes their place'
        )
    if left:
        said.append(f'keeps {counted(left, "triangle")} without area, which would leave a gap')
    return faces


def _height(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the height (m,) of triangles over their longest edges."""
    a, b, c = vertices[faces.T]
    longest = np.linalg.norm([b - a, c - b, a - c], axis=2).max(axis=0)
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.asarray(doubled / np.where(longest > 0.0, longest, 1.0))


def _slivers(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return np.flatnonzero(_height(vertices, faces) < FLAT)


def _from_longest(vertices: np.ndarray, face: list[int]) -> list[int]:
    """Return the corners of a triangle in an order in which the longest edge is the last one."""
    lengths = [np.linalg.norm(vertices[face[two]] - vertices[face[one]]) for one, two in CORNERS]
    start = (int(np.argmax(lengths)) + 1) % 3
    return face[start:] + face[:start]
