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
from dataclasses import dataclass

import numpy as np

from softbody_ros.core.collision.collision_surface import Skin
from softbody_ros.core.columns import joined
from softbody_ros.core.contact.contact_state import Crowd, Source
from softbody_ros.core.geometry.bounding_boxes import Boxes, bounds, inside_boxes, overlapping
from softbody_ros.core.shape_matching import rigid_motion

SLACK = 1e-6
"""Width around boxes, in RMS radii: what lies flush with another touches it."""
INTO_ITSELF = 0.02
"""Share of the way to its own body's centre by which a particle is looked up inwards."""
BLUNT = 0.015
"""Depth, in RMS radii, that spikes may have: the surface of their obstacle is met before."""
DEEP, SAME_WAY, TO_CENTRE = 0.01, 0.3, 0.9
"""A particle this deep, in RMS radii, whose own surface looks the same way as the face (cosine),
is on its way through: it has to leave on the side of its own body's centre."""


def boxes(x: np.ndarray, skin: Skin, margin: np.ndarray, number: int) -> Boxes:
    """
    Return the boxes around the pieces of bodies that share a skin.

    Parameters
    ----------
    x : (B, 3, n) float
        m
    skin : Skin
    margin : (B,) float
        m
    number : int
        of the first of the bodies among all

    """
    if skin.pieces == 1:
        low, high = (corner[:, None] for corner in bounds(x))
    else:
        particle, first = skin.covered
        covered = x.take(particle, axis=2)
        low = np.minimum.reduceat(covered, first, axis=2).swapaxes(1, 2)
        high = np.maximum.reduceat(covered, first, axis=2).swapaxes(1, 2)
    wide = (margin + SLACK * skin.rest.scale)[:, None, None]
    body, piece = np.divmod(np.arange(len(x) * skin.pieces), skin.pieces)
    return Boxes(
        (low - wide).reshape(-1, 3).astype(np.float64),
        (high + wide).reshape(-1, 3).astype(np.float64),
        number + body,
        piece,
    )


def pairs(
    found: Boxes, skins: Sequence[Skin], sizes: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the pairs of boxes whose contents may touch: of two bodies, or of one with itself.

    Parameters
    ----------
    found : Boxes
    skins : sequence of Skin
    sizes : sequence of int
        numbers of bodies that have them, one after the other

    """
    one, two = overlapping(found.low, found.high)
    kept = found.body[one] != found.body[two]
    own = np.flatnonzero(~kept)
    if len(own):
        skin_of = np.repeat(np.arange(len(skins)), sizes)[found.body[one[own]]]
        for index in set(skin_of.tolist()):
            mine = own[skin_of == index]
            kept[mine] = skins[index].strangers[found.piece[one[mine]], found.piece[two[mine]]]
    return one[kept], two[kept]


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
    thickness, depth : (k,) float
        distance that is to be kept, and what is missing of it, m
    body, other : (k,) int
        of the particle, and of the face

    """

    particle: np.ndarray
    corners: np.ndarray
    share: np.ndarray
    normal: np.ndarray
    thickness: np.ndarray
    depth: np.ndarray
    body: np.ndarray
    other: np.ndarray

    def __len__(self) -> int:
        return len(self.particle)


NONE = Touches(
    np.zeros(0, np.int64),
    np.zeros((0, 3), np.int64),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
)


def find(
    crowd: Crowd,
    found: Boxes,
    one: np.ndarray,
    two: np.ndarray,
    particle: np.ndarray,
    box: np.ndarray,
) -> Touches:
    """
    Return which particles in one box of a pair are inside faces of the other.

    Parameters
    ----------
    crowd : Crowd
    found : Boxes
        with the numbers of the bodies in the crowd
    one, two : (p,) int
        pairs of boxes
    particle, box : (q,) int
        more particles that may be inside what is in boxes

    """
    of, to = np.concatenate([one, two]), np.concatenate([two, one])
    start, count = _ranges(crowd, found, of)
    common = np.minimum(found.high[of], found.high[to]) - np.maximum(found.low[of], found.low[to])
    thin = np.argmin(common / (found.high[of] - found.low[of]), axis=1)
    # boxes have room for the thickness of their own bodies
    low, high = found.low[to], found.high[to]
    reach = crowd.thickness[found.body[of], None]
    pair, inside = inside_boxes(crowd.x, start, count, low - reach, high + reach, thin)
    particle, box = np.concatenate([inside, particle]), np.concatenate([to[pair], box])
    source_of = crowd.source[found.body[box]]
    parts = []
    for index, source in enumerate(crowd.sources):
        mine = np.flatnonzero(source_of == index)
        if len(mine) and source.skin.closed:
            parts.append(_inside_faces(crowd, source, found, particle[mine], box[mine]))
    return joined(parts) if parts else NONE


def _ranges(crowd: Crowd, found: Boxes, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where in the crowd the particles of boxes begin, and how many they are."""
    start, count = np.empty(len(box), np.int64), np.empty(len(box), np.int64)
    source_of = crowd.source[found.body[box]]
    for index, source in enumerate(crowd.sources):
        mine = source_of == index
        body, piece = found.body[box[mine]], found.piece[box[mine]]
        first = source.skin.first
        start[mine], count[mine] = crowd.first[body] + first[piece], np.diff(first)[piece]
    return start, count


def _inside_faces(
    crowd: Crowd, source: Source, found: Boxes, particle: np.ndarray, box: np.ndarray
) -> Touches:
    """
    Return which particles of the crowd are inside faces of pieces of one source's bodies.

    The nearest face is looked up a little inwards: corners of equal boxes on each other lie on the
    edge between two faces.
    """
    skin = source.skin
    body, other, piece = crowd.body[particle], found.body[box], found.piece[box]
    points = crowd.x[particle]
    gives_way = np.isfinite(crowd.mass[body])[:, None]
    inwards = np.where(gives_way, crowd.centre[body] - points, 0.0)
    face = _nearest_face(points + INTO_ITSELF * inwards, source, other, piece)
    touches = face >= 0
    if skin.pieces > 1:
        own = np.flatnonzero(touches & (body == other))
        touches[own] = skin.apart(particle[own] - crowd.first[body[own]], face[own])
    kept = np.flatnonzero(touches)
    particle, body, other, piece, points, inwards, face = (
        each[kept] for each in (particle, body, other, piece, points, inwards, face)
    )
    thickness = crowd.thickness[body] + crowd.thickness[other]
    thickness -= np.where(crowd.spiky[body], BLUNT * skin.rest.scale, 0.0)
    corners = skin.corners[face] + crowd.first[other][:, None]
    height, normal, share = over_triangles(points, crowd.x[corners.T])

    if skin.pieces == 1:
        outwards = _normals(crowd, particle, body)
        through = np.einsum('ij,ij->i', outwards, normal) > SAME_WAY
        through &= (height < thickness) & (height < -DEEP * skin.rest.scale)
        through = np.flatnonzero(through)
        aim = points[through] + TO_CENTRE * inwards[through]
        face = _nearest_face(aim, source, other[through], piece[through])
        corners[through] = skin.corners[face] + crowd.first[other[through]][:, None]
        height[through], normal[through], share[through] = over_triangles(
            points[through], crowd.x[corners[through].T]
        )

    touching = np.flatnonzero(height < thickness)
    depth = thickness - height
    return Touches(
        *(
            each[touching]
            for each in (particle, corners, share, normal, thickness, depth, body, other)
        )
    )


def _normals(crowd: Crowd, particle: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Return the normals (k, 3) of their own bodies at particles, about; zero if not known."""
    result = np.zeros((len(particle), 3))
    for index, source in enumerate(crowd.sources):
        mine = np.flatnonzero(crowd.source[body] == index)
        if source.skin.pieces == 1 and len(mine):
            row = source.rows[body[mine] - source.first]
            rest_normal = source.skin.normals[particle[mine] - crowd.first[body[mine]]]
            posture = source.flight.match.posture[row, 0]
            result[mine] = rigid_motion.applied(posture, rest_normal)
    return result


def _nearest_face(
    points: np.ndarray, source: Source, body: np.ndarray, piece: np.ndarray
) -> np.ndarray:
    """Return the face (k,) of pieces of a source's bodies that is about nearest, −1 if none is."""
    skin, row = source.skin, body - source.first
    face = skin.table.nearest(_in_rest_shape(points, source, row, piece))
    if skin.pieces > 1:
        face = np.where(skin.piece_of_face[face] == piece, face, -1)
    return face


def _in_rest_shape(
    points: np.ndarray, source: Source, body: np.ndarray, piece: np.ndarray
) -> np.ndarray:
    """Return where points (k, 3) are in the rest shape that pieces of a source's bodies have."""
    match, rows = source.flight.match, source.rows
    inverse = np.linalg.inv(match.posture[rows])
    shift = match.origin[rows] - rigid_motion.applied(inverse, match.place[rows])
    return rigid_motion.applied(inverse[body, piece], points) + shift[body, piece]


def over_triangles(
    points: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return how high points are over the planes of triangles, and over which place.

    Parameters
    ----------
    points : (k, 3) float
        m
    corners : (3, k, 3) float
        m

    Returns
    -------
    height : (k,) float
        m
    normal : (k, 3) float
    share : (k, 3) float
        barycentric coordinates, those of a place beyond the edges brought back to them

    """
    origin = corners[0]
    along, across, offset = corners[1] - origin, corners[2] - origin, points - origin
    normal = rigid_motion.cross(along, across)
    double_area = np.maximum(np.sqrt(np.einsum('ij,ij->i', normal, normal)), 1e-300)
    normal /= double_area[:, None]
    second = np.einsum('ij,ij->i', rigid_motion.cross(offset, across), normal) / double_area
    third = np.einsum('ij,ij->i', rigid_motion.cross(along, offset), normal) / double_area
    share = np.maximum(np.column_stack([1.0 - second - third, second, third]), 0.0)
    share /= share.sum(axis=1, keepdims=True)
    return np.einsum('ij,ij->i', offset, normal), normal, share
