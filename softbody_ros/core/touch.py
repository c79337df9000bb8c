# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which particles of bodies are inside which faces of others: broad phase, then narrow phase.

A particle is carried into the rest shape of the other body with the inverse of how that one lies;
there a table tells the nearest face; what counts then is where the corners of this face are now.
So the surface that is met is the deformed one, at the cost of looking up a rigid one.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass

import numpy as np

from softbody_ros.core import rigid_motion
from softbody_ros.core.crowd import Crowd, Source
from softbody_ros.core.skin import Skin

INTO_ITSELF = 0.02
LEAST_SHARE = -1e-9
"""Barycentric coordinate below which a point is not over a face."""


@dataclass(frozen=True)
class Boxes:
    """
    Axis-aligned boxes around the pieces of bodies.

    Attributes
    ----------
    low, high : (N, 3) float
        m
    body, piece : (N,) int
        numbers of the body among all, and of the piece in it

    """

    low: np.ndarray
    high: np.ndarray
    body: np.ndarray
    piece: np.ndarray


def boxes(x: np.ndarray, skin: Skin, margin: np.ndarray, first_body: int) -> Boxes:
    """
    Return the boxes around the pieces of bodies that share a skin.

    Parameters
    ----------
    x : (B, 3, n) float
        m
    skin : Skin
    margin : (B,) float
        m
    first_body : int
        number of the first of them

    """
    if skin.pieces == 1:
        low, high = x.min(axis=2)[:, None], x.max(axis=2)[:, None]
    else:
        covered = x[..., skin.covered]
        low = np.minimum.reduceat(covered, skin.covered_first, axis=2).swapaxes(1, 2)
        high = np.maximum.reduceat(covered, skin.covered_first, axis=2).swapaxes(1, 2)
    body = np.arange(first_body, first_body + len(x))
    wide = margin[:, None, None]
    return Boxes(
        (low - wide - 1e-6 * skin.rest.scale).reshape(-1, 3).astype(np.float64),
        (high + wide + 1e-6 * skin.rest.scale).reshape(-1, 3).astype(np.float64),
        np.repeat(body, skin.pieces),
        np.tile(np.arange(skin.pieces), len(x)),
    )


def joined(parts: Sequence[Boxes]) -> Boxes:
    """Return the boxes of several batches as one."""
    return Boxes(
        np.concatenate([part.low for part in parts]),
        np.concatenate([part.high for part in parts]),
        np.concatenate([part.body for part in parts]),
        np.concatenate([part.piece for part in parts]),
    )


def overlapping(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the pairs of boxes that overlap: (p,) int and (p,) int, the first before the second.

    Sort and sweep along the axis in which the boxes are spread the most.
    """
    axis = int(np.argmax((low + high).std(axis=0)))
    order = np.argsort(low[:, axis], kind='stable')
    low, high = low[order], high[order]
    behind = np.arange(len(low)) + 1
    count = np.maximum(np.searchsorted(low[:, axis], high[:, axis]) - behind, 0)
    first = np.repeat(behind - 1, count)
    second = ragged(behind, count)
    meet = np.ones(len(first), dtype=bool)
    for other in {0, 1, 2} - {axis}:
        meet &= low[first, other] < high[second, other]
        meet &= low[second, other] < high[first, other]
    first, second = order[first[meet]], order[second[meet]]
    first, second = np.minimum(first, second), np.maximum(first, second)
    sorted_pairs = np.lexsort((second, first))
    return first[sorted_pairs], second[sorted_pairs]


def ragged(start: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return start[0] … start[0] + count[0] − 1, start[1] … one after the other."""
    begin = np.cumsum(count) - count
    return np.arange(count.sum()) + np.repeat(start - begin, count)


def pairs(found: Boxes, strangers: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the pairs of boxes whose contents may touch: of two bodies, or of one with itself.

    Parameters
    ----------
    found : Boxes
    strangers : sequence of (P, P) bool
        of each body, see `Skin`

    """
    first, second = overlapping(found.low, found.high)
    same = np.flatnonzero(found.body[first] == found.body[second])
    kept = np.ones(len(first), dtype=bool)
    for index in same:
        a, b = first[index], second[index]
        kept[index] = strangers[found.body[a]][found.piece[a], found.piece[b]]
    return first[kept], second[kept]


@dataclass(frozen=True)
class Touches:
    """
    The k particles of a crowd that are inside faces of it.

    Attributes
    ----------
    particle : (k,) int
    corners : (k, 3) int
        particles at the corners of the face
    share : (k, 3) float
        barycentric coordinates of the point of the face that is nearest
    normal : (k, 3) float
        out of the face
    depth : (k,) float
        m, with the thickness of both bodies
    body, other : (k,) int
        of the particle, and of the face

    """

    particle: np.ndarray
    corners: np.ndarray
    share: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    body: np.ndarray
    other: np.ndarray

    def __len__(self) -> int:
        return len(self.particle)

    def where(self, selected: np.ndarray) -> Touches:
        """Return some of them, given as a mask or as indices."""
        columns = (getattr(self, item.name) for item in dataclasses.fields(self))
        return Touches(*(column[selected] for column in columns))


NONE = Touches(
    np.zeros(0, np.int64),
    np.zeros((0, 3), np.int64),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
)


def find(crowd: Crowd, found: Boxes, first: np.ndarray, second: np.ndarray) -> Touches:
    """
    Return which particles in one box of a pair are inside faces of the other.

    Parameters
    ----------
    crowd : Crowd
    found : Boxes
        with the numbers of the bodies in the crowd
    first, second : (p,) int
        pairs of boxes

    """
    of, to = np.concatenate([first, second]), np.concatenate([second, first])
    start, stop = _ranges(crowd, found)
    pair, point = inside_boxes(
        crowd.x, start[of], (stop - start)[of], found.low[to], found.high[to]
    )
    body, box = found.body[of[pair]], to[pair]
    source_of = crowd.source[found.body[box]]
    parts = []
    for index, source in enumerate(crowd.sources):
        mine = np.flatnonzero(source_of == index)
        if len(mine) and source.skin.closed:
            parts.append(_inside_faces(crowd, source, found, body[mine], point[mine], box[mine]))
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return NONE
    names = [item.name for item in dataclasses.fields(Touches)]
    return Touches(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _ranges(crowd: Crowd, found: Boxes) -> tuple[np.ndarray, np.ndarray]:
    """Return where in the crowd the particles of each box begin and end."""
    begin, end = np.empty(len(found.body), np.int64), np.empty(len(found.body), np.int64)
    for index, source in enumerate(crowd.sources):
        mine = crowd.source[found.body] == index
        body, piece = crowd.first[found.body[mine]], found.piece[mine]
        begin[mine], end[mine] = (
            body + source.skin.first[piece],
            body + source.skin.first[piece + 1],
        )
    return begin, end


def _inside_faces(
    crowd: Crowd,
    source: Source,
    found: Boxes,
    body: np.ndarray,
    point: np.ndarray,
    box: np.ndarray,
) -> Touches:
    """Return which points of the crowd are inside faces of pieces of one source."""
    skin, match = source.skin, source.flight.match
    other, piece = found.body[box], found.piece[box]
    row = source.rows[other - source.first]
    points = crowd.x[point]
    inverse = np.linalg.inv(match.posture[source.rows])
    # a little into its own body, so that the corners of equal boxes on each other find the face
    looked_up = points + INTO_ITSELF * (crowd.centre[body] - points)
    offsets = np.matmul(
        inverse[other - source.first, piece], (looked_up - match.place[row, piece])[..., None]
    )
    places = match.origin[row, piece] + offsets[..., 0]
    face = skin.nearest.nearest(places)
    over = face >= 0
    if skin.pieces > 1:
        over &= skin.piece_of_face[face] == piece
    kept = np.flatnonzero(over)
    body, other, point, points, face = (each[kept] for each in (body, other, point, points, face))

    corners = skin.corners[face] + crowd.first[other][:, None]
    a, b, c = crowd.x[corners.T]
    along, across, offset = b - a, c - a, points - a
    normal = rigid_motion.cross(along, across)
    double_area = np.sqrt(np.einsum('ij,ij->i', normal, normal))
    normal /= np.maximum(double_area, 1e-300)[:, None]
    height = np.einsum('ij,ij->i', offset, normal)
    depth = crowd.thickness[body] + crowd.thickness[other] - height
    inside = np.flatnonzero(depth > 0.0)
    along, across, offset, normal = (each[inside] for each in (along, across, offset, normal))
    # areas of the triangles that the point makes with two corners
    second = np.einsum('ij,ij->i', rigid_motion.cross(offset, across), normal)
    third = np.einsum('ij,ij->i', rigid_motion.cross(along, offset), normal)
    share = np.stack([double_area[inside] - second - third, second, third], axis=1)
    share /= np.maximum(double_area[inside], 1e-300)[:, None]
    beyond = share.min(axis=1) < LEAST_SHARE
    share = np.maximum(share, 0.0)
    share /= share.sum(axis=1, keepdims=True)
    return Touches(
        point[inside], corners[inside], share, normal, depth[inside], body[inside], other[inside]
    )


def inside_boxes(
    x: np.ndarray, start: np.ndarray, count: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return which points of ranges of a list are in which boxes.

    Parameters
    ----------
    x : (N, 3) float
    start, count : (D,) int
        ranges
    low, high : (D, 3) float
        a box for each

    Returns
    -------
    range : (k,) int
    point : (k,) int

    """
    owner = np.repeat(np.arange(len(count)), count)
    point = ragged(start, count)
    for axis in range(3):
        values = x[point, axis]
        kept = (values > low[owner, axis]) & (values < high[owner, axis])
        owner, point = owner[kept], point[kept]
    return owner, point
