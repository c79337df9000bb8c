# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edges and parts of triangle meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True)
class Edges:
    """
    The edges of m triangles.

    Attributes
    ----------
    ends : (e, 2) int
        vertices, the lower one first
    edge : (m, 3) int
        that from each corner of each triangle to the next one
    forward : (m, 3) bool
        whether that goes from the lower vertex to the other one
    count : (e,) int
        of triangles at each edge
    balance : (e,) int
        how many more of these go forward along it than back

    """

    ends: np.ndarray
    edge: np.ndarray
    forward: np.ndarray
    count: np.ndarray
    balance: np.ndarray

    @property
    def closed(self) -> np.ndarray:
        """(e,) bool: whether two triangles meet at it, of the same winding."""
        return (self.count == 2) & (self.balance == 0)

    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """(p, 2) int: the two triangles of edges that have two; (p,) int: that edge."""
        order = np.argsort(self.edge, axis=None, kind='stable')
        of = self.edge.ravel()[order]
        begins = np.flatnonzero((self.count[of] == 2) & (np.diff(of, prepend=-1) != 0))
        return np.stack([order[begins], order[begins + 1]], axis=1) // 3, of[begins]

    def defects(self) -> list[str]:
        """Return what keeps the triangles from enclosing a volume."""
        opened = int((self.count == 1).sum())
        crowded = int((self.count > 2).sum())
        against = int(((self.count == 2) & (self.balance != 0)).sum())
        return [
            f'{counted(number, "edge")} {what}'
            for number, what in (
                (opened, 'with one triangle only'),
                (crowded, 'with more than two triangles'),
                (against, 'between triangles of opposite winding'),
            )
            if number
        ]

    def remedy(self) -> str:
        """Return what to do about the defects."""
        remedies = []
        if (self.count == 1).any():
            remedies.append('fill its holes')
        if (self.count > 2).any():
            remedies.append('remove its inner walls and part what touches along edges')
        if not remedies:
            remedies.append('let all its triangles be seen anticlockwise from outside')
        return ' and '.join(remedies)


def edges_of(faces: np.ndarray) -> Edges:
    """Return the edges of triangles (m, 3) int."""
    begin, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    width = int(faces.max(initial=0)) + 1
    code = np.minimum(begin, end) * width + np.maximum(begin, end)
    distinct, edge, count = np.unique(code, return_inverse=True, return_counts=True)
    edge, forward = edge.reshape(-1, 3), begin < end
    balance = 2 * np.bincount(edge[forward], minlength=len(distinct)) - count
    return Edges(np.stack(np.divmod(distinct, width), axis=1), edge, forward, count, balance)


def groups_of(pairs: np.ndarray, count: int) -> np.ndarray:
    """Return the group (count,) int of each of so many things, of which pairs (p, 2) belong."""
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])


def parts_of(faces: np.ndarray) -> np.ndarray:
    """Return the part (m,) int that each triangle belongs to: parts share no edges."""
    edges = edges_of(faces)
    number = np.repeat(np.arange(len(faces)), 3)
    pairs = np.stack([number, len(faces) + edges.edge.ravel()], axis=1)
    part = groups_of(pairs, len(faces) + len(edges.ends))[: len(faces)]
    return np.unique(part, return_inverse=True)[1].ravel()


def counted(number: int, what: str, plural: str = '') -> str:
    """Return a number of things for a sentence."""
    return f'{number} {what}' if number == 1 else f'{number} {plural or what + "s"}'
