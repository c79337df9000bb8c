# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Winding of triangle meshes: triangles like their neighbours, parts for themselves, and outwards.

Each thing that is done is said, as the end of a sentence.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.geometry.bvh import make_tree
from softbody_ros.core.geometry.mesh_edges import counted, edges_of, groups_of, parts_of
from softbody_ros.core.geometry.surface import Surface

SAMPLES = 64
"""Most vertices of a part by which it is decided whether it is inside another one."""
ALIKE = 1e-8
"""Angle between triangles at an edge, rad, that are one on the other."""
TOUCHING = 1e-6
"""Distance within which a vertex of a part is on another one rather than inside."""


def wound_alike(faces: np.ndarray, said: list[str]) -> np.ndarray:
    """Return triangles that are wound like their neighbours; of each part the fewer are turned."""
    edges = edges_of(faces)
    if not ((edges.count == 2) & (edges.balance != 0)).any():
        return faces
    pairs, edge = edges.pairs()
    # a graph with each triangle once as it is, and once turned
    m, against = len(faces), edges.balance[edge] != 0
    one, two = pairs.T
    side = np.where(against, m, 0)
    links = np.concatenate(
        [np.stack([one, two + side], 1), np.stack([one + m, two + m - side], 1)]
    )
    groups = groups_of(links, 2 * m)
    as_is, turned = groups[:m], groups[m:]
    part, turn = np.minimum(as_is, turned), as_is > turned
    most = np.bincount(part, turn, 2 * m) > 0.5 * np.bincount(part, minlength=2 * m)
    turn = (turn != most[part]) & (as_is != turned)
    if turn.any():
        said.append(
            f'has {counted(int(turn.sum()), "triangle")} wound against the others: '
            f'{"it is" if turn.sum() == 1 else "they are"} turned'
        )
    return np.where(turn[:, None], faces[:, ::-1], faces)


def parted(
    vertices: np.ndarray, faces: np.ndarray, said: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return a mesh in which solids that touch along edges have these each for itself.

    Guéziec, Taubin, Lazarus, Horn: Cutting and stitching, 2001: corners of triangles that no
    sequence of neighbours connects become different vertices.
    """
    edges = edges_of(faces)
    shared = np.flatnonzero((edges.count > 2) & (edges.balance == 0))
    if not len(shared):
        return vertices, faces
    pairs, _ = edges.pairs()
    m = len(faces)
    sheet = groups_of(pairs, m)
    inverted = enclosed_volume(vertices, faces) < 0.0
    joined = [pairs]
    order = np.argsort(edges.edge, axis=None, kind='stable')
    begin = np.searchsorted(edges.edge.ravel()[order], np.arange(len(edges.ends)))
    for index in np.flatnonzero(edges.count > 2):
        sides = order[begin[index] :][: edges.count[index]]
        around = None
        if edges.balance[index] == 0:
            forward = edges.forward.ravel()[sides]
            around = _by_sheet(sides // 3, forward, sheet) or _by_angle(
                vertices, faces, sides, forward, edges.ends[index], inverted
            )
        if around is None:
            around = [(sides[0] // 3, each // 3) for each in sides[1:]]
        joined.append(np.array(around).reshape(-1, 2))
    near = np.zeros(len(vertices), dtype=bool)
    near[edges.ends[shared]] = True
    links = _corner_links(faces, np.concatenate(joined), near)
    corner = groups_of(links, 3 * m)
    code = faces.ravel().astype(np.int64) * (3 * m + 1) + np.where(near[faces.ravel()], corner, 0)
    distinct, number = np.unique(code, return_inverse=True)
    # the first of each vertex keeps its place, others follow
    vertex = distinct // (3 * m + 1)
    is_new = np.concatenate([[False], vertex[1:] == vertex[:-1]])
    if not is_new.any():
        return vertices, faces
    place = np.where(is_new, len(vertices) - 1 + np.cumsum(is_new), vertex)
    cut = place[number].reshape(-1, 3)
    parted = len(shared) - int((edges_of(cut).count > 2).sum())
    if parted > 0:
        said.append(
            f'touches itself along {counted(parted, "edge")}: its parts are separate there'
        )
    return np.concatenate([vertices, vertices[vertex[is_new]]]), cut


def _by_sheet(
    around: np.ndarray, forward: np.ndarray, sheet: np.ndarray
) -> list[tuple[int, int]] | None:
    """Return pairs of the triangles around an edge that are of the same sheet, if all are."""
    pairs = []
    for each in np.unique(sheet[around]):
        own = sheet[around] == each
        if own.sum() != 2 or forward[own].sum() != 1:
            return None
        one, two = around[own].tolist()
        pairs.append((one, two))
    return pairs


def _by_angle(
    vertices: np.ndarray,
    faces: np.ndarray,
    sides: np.ndarray,
    forward: np.ndarray,
    ends: np.ndarray,
    inverted: bool,
) -> list[tuple[int, int]] | None:
    """Return pairs of the triangles around an edge with solid between them, if they alternate."""
    axis = vertices[ends[1]] - vertices[ends[0]]
    axis = axis / np.linalg.norm(axis)
    third = faces[sides // 3, (sides % 3 + 2) % 3]
    arms = vertices[third] - vertices[ends[0]]
    arms = arms - np.outer(arms @ axis, axis)
    angle = np.arctan2(arms @ np.cross(axis, arms[0]), arms @ arms[0])
    angle = np.where(np.abs(angle) > np.pi - ALIKE, np.pi, np.round(angle / ALIKE) * ALIKE)
    begins = forward if inverted else ~forward
    order = np.lexsort([begins, angle])  # where two solids meet, one ends before the other begins
    starts = begins[order]
    if (starts == np.roll(starts, 1)).any():
        return None
    ring = (sides // 3)[order]
    return [
        (int(ring[i]), int(ring[(i + 1) % len(ring)])) for i in np.flatnonzero(starts).tolist()
    ]


def _corner_links(faces: np.ndarray, pairs: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return pairs of corners, as 3 · triangle + corner, at common vertices of triangle pairs."""
    links = []
    chosen = pairs[near[faces[pairs[:, 0]]].any(axis=1)]
    one, two = chosen.T
    for i in range(3):
        for j in range(3):
            same = faces[one, i] == faces[two, j]
            links.append(np.stack([3 * one[same] + i, 3 * two[same] + j], axis=1))
    return np.concatenate(links)


def facing_outwards(vertices: np.ndarray, faces: np.ndarray, said: list[str]) -> np.ndarray:
    """
    Return a mesh whose closed parts have their normals outwards, cavities inwards.

    A cavity is a part in an odd number of others.
    """
    part, edges = parts_of(faces), edges_of(faces)
    count = int(part.max(initial=-1)) + 1
    is_closed = np.ones(count, dtype=bool)
    is_closed[part[~edges.closed[edges.edge].all(axis=1)]] = False
    order = np.argsort(part, kind='stable')
    begin = np.searchsorted(part[order], np.arange(count + 1))
    numbers = [order[begin[i] : begin[i + 1]] for i in range(count) if is_closed[i]]
    volumes = np.array([enclosed_volume(vertices, faces[own]) for own in numbers])
    depth = _depths(vertices, faces, numbers, volumes)
    wanted = np.where(depth % 2 == 1, -1.0, 1.0)
    wrong = np.flatnonzero(volumes * wanted < 0.0)
    if not len(wrong):
        return faces
    faces = faces.copy()
    for i in wrong:
        faces[numbers[i]] = faces[numbers[i], ::-1]
    outwards = int((wanted[wrong] > 0.0).sum())
    cavities = len(wrong) - outwards
    if outwards:
        what = f'has {outwards} of its {count} parts inside out' if count > 1 else 'is inside out'
        said.append(f'{what}: {"they are" if outwards > 1 else "it is"} turned')
    if cavities:
        said.append(
            f'has {counted(cavities, "closed part")} inside others: '
            f'{"they are" if cavities > 1 else "it is"} taken as hollow'
        )
    return faces


def enclosed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the enclosed volume, negative if the triangles face inwards."""
    corners = vertices[faces]
    a, b, c = (corners - corners[0, 0]).swapaxes(0, 1)
    return float(np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0)


def _depths(
    vertices: np.ndarray, faces: np.ndarray, numbers: list[np.ndarray], volumes: np.ndarray
) -> np.ndarray:
    """Return in how many other closed parts each one is, (p,) int."""
    depth = np.zeros(len(numbers), dtype=int)
    if len(numbers) < 2:
        return depth
    boxes = [vertices[faces[own]].reshape(-1, 3) for own in numbers]
    low = np.array([box.min(axis=0) for box in boxes])
    high = np.array([box.max(axis=0) for box in boxes])
    for outer, own in enumerate(numbers):
        inside = ((low[outer] <= low) & (high <= high[outer])).all(axis=1)
        inside[outer] = False
        candidates = np.flatnonzero(inside)
        if not len(candidates) or not volumes[outer]:
            continue
        samples = [_spread(boxes[each]) for each in candidates]
        tree = make_tree(Surface(vertices, faces[own]))
        distance = tree.distance(np.concatenate(samples))[0] * np.sign(volumes[outer])
        owner = np.repeat(candidates, [len(each) for each in samples])
        # what is only partly inside overlaps it, as convex parts of a decomposition do
        within = np.bincount(owner[distance < -TOUCHING], minlength=len(numbers)) > 0
        beyond = np.bincount(owner[distance > TOUCHING], minlength=len(numbers)) > 0
        depth += within & ~beyond
    return depth


def _spread(points: np.ndarray) -> np.ndarray:
    """Return some of the points (k, 3), spread over their order."""
    return points[np.linspace(0, len(points) - 1, min(SAMPLES, len(points))).astype(int)]
