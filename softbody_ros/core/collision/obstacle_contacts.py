# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Detection of contacts between the particles of bodies and obstacles.

The normal of a contact is that at the closest point. For fast particles, where that may be on the
far side of the obstacle, it is that at the point of entry, see `swept_contact`.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.collision.obstacles import (
    distance_in_frame,
    in_frame,
    in_frame_before,
    to_world,
)
from softbody_ros.core.collision.shapes import PLANE
from softbody_ros.core.collision.swept_contact import first_touch
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    ZERO,
    Vector,
    applied,
    column_of,
    dot,
    matrix_of,
    minus,
    norm,
    plus,
    product,
    put_vector,
    transposed,
    vector_of,
)

TILE = 512
"""Particles per block, which is tested as a whole first."""
SAME_SIDE, NEARLY_AS_DEEP = 0.5, 0.5
"""Cosine between the normals at entry and at the closest point, and ratio of their depths, above
which the closest point is on the side of entry."""

ROOT_OF_3 = 3.0**0.5

CONTACT = np.dtype(
    [
        ('body', np.int64),  # in the bodies of the world
        ('obstacle', np.int64),  # in the records of obstacles
        ('particle', np.int64),  # within the body
        ('point', np.float64, (3,)),  # position of the particle, m
        ('normal', np.float64, (3,)),  # outward normal of the obstacle
        ('depth', np.float64),  # with the thickness of the body, m
        ('swept', np.bool_),  # whether found by continuous collision detection
    ],
    align=True,
)
"""A contact of a particle with an obstacle."""


# ------------------------------------------------------------------------------------- broad phase
@helper
def may_touch(
    obstacle: np.void,
    low: Vector,
    high: Vector,
    low_before: Vector,
    high_before: Vector,
    thickness: float,
) -> bool:
    """
    Return whether a body may have touched an obstacle during a tick.

    Parameters
    ----------
    obstacle : OBSTACLE
    low, high : Vector
        corners of the bounding box of the body, m
    low_before, high_before : Vector
        the same at the tick before, m
    thickness : float
        m

    """
    position = vector_of(obstacle['position'])
    before = vector_of(obstacle['position_before'])
    gap_square, far_square = 0.0, 0.0
    for row in range(3):
        least, largest = min(low[row], low_before[row]), max(high[row], high_before[row])
        gap = max(least - position[row], position[row] - largest, 0.0)
        gap_square += gap * gap
        away = max(abs(least - before[row]), abs(largest - before[row]))
        far_square += away * away
    reach = obstacle['bounding_radius'] + thickness
    if obstacle['moved']:
        # relative to a rotating obstacle, distant particles are fast
        reach += norm(minus(position, before)) + obstacle['rotation_change'] * math.sqrt(
            far_square
        )
    return math.sqrt(gap_square) <= reach


# ------------------------------------------------------------------------------------ narrow phase
@helper
def find_contacts(
    obstacle: np.void,
    trees: Trees,
    x: np.ndarray,
    start: np.ndarray,
    first: int,
    count: int,
    thickness: float,
    sweep: bool,
    contacts: np.ndarray,
    found: int,
) -> int:
    """
    Append the contacts of one body with one obstacle, in the order of its particles.

    Parameters
    ----------
    obstacle : OBSTACLE
    trees : Trees
        of the meshes of obstacles
    x, start : (3, N) float
        positions of all particles, and at the tick before, m
    first, count : int
        columns of the body
    thickness : float
        m
    sweep : bool
        whether to follow the paths of fast particles; if not, `start` is not read
    contacts : (C,) CONTACT
        appended to, without `body` and `obstacle`; beyond its capacity they are only counted
    found : int
        number before

    Returns
    -------
    int
        number after

    """
    if obstacle['kind'] == PLANE:
        return _below_plane(obstacle, x, first, count, thickness, contacts, found)
    return _near_shape(obstacle, trees, x, start, first, count, thickness, sweep, contacts, found)


@helper
def _put(
    contacts: np.ndarray,
    found: int,
    particle: int,
    point: Vector,
    normal: Vector,
    depth: float,
    swept: bool,
) -> int:
    if found < len(contacts):
        contact = contacts[found]
        contact['particle'] = particle
        put_vector(contact['point'], point)
        put_vector(contact['normal'], normal)
        contact['depth'] = depth
        contact['swept'] = swept
    return found + 1


@helper
def _below_plane(
    obstacle: np.void,
    x: np.ndarray,
    first: int,
    count: int,
    thickness: float,
    contacts: np.ndarray,
    found: int,
) -> int:
    """Append the contacts with a plane: all particles below it."""
    rotation = matrix_of(obstacle['rotation'])
    normal = (rotation[0][2], rotation[1][2], rotation[2][2])
    nx, ny, nz = normal
    offset = dot(vector_of(obstacle['position']), normal)
    for begin in range(first, first + count, TILE):
        end = min(begin + TILE, first + count)
        x0, x1, x2 = x[0, begin:end], x[1, begin:end], x[2, begin:end]
        # whether there are any: a vectorised loop
        below = 0
        for i in range(end - begin):
            below += thickness - (nx * x0[i] + ny * x1[i] + nz * x2[i] - offset) > 0.0
        if below == 0:
            continue
        for i in range(end - begin):
            depth = thickness - (nx * x0[i] + ny * x1[i] + nz * x2[i] - offset)
            if depth > 0.0:
                point = (x0[i], x1[i], x2[i])
                particle = begin - first + i
                found = _put(contacts, found, particle, point, normal, depth, False)
    return found


@helper
def _near_shape(
    obstacle: np.void,
    trees: Trees,
    x: np.ndarray,
    start: np.ndarray,
    first: int,
    count: int,
    thickness: float,
    sweep: bool,
    contacts: np.ndarray,
    found: int,
) -> int:
    """Append the contacts with any other shape, of particles in its bounding box."""
    displacement = (0.0, 0.0, 0.0)
    if sweep:
        displacement = _largest_displacement(obstacle, x, start, first, count)
    fast = max(displacement[0], displacement[1], displacement[2]) > 0.0
    position = vector_of(obstacle['position'])
    half = plus(vector_of(obstacle['half_box']), displacement)
    half = (half[0] + thickness, half[1] + thickness, half[2] + thickness)
    low, high = minus(position, half), plus(position, half)
    for begin in range(first, first + count, TILE):
        end = min(begin + TILE, first + count)
        x0, x1, x2 = x[0, begin:end], x[1, begin:end], x[2, begin:end]
        inside = 0
        for i in range(end - begin):
            inside += (
                (x0[i] > low[0])
                & (x0[i] < high[0])
                & (x1[i] > low[1])
                & (x1[i] < high[1])
                & (x2[i] > low[2])
                & (x2[i] < high[2])
            )
        if inside == 0:
            continue
        for i in range(end - begin):
            point = (x0[i], x1[i], x2[i])
            if not (
                low[0] < point[0] < high[0]
                and low[1] < point[1] < high[1]
                and low[2] < point[2] < high[2]
            ):
                continue
            local = in_frame(obstacle, point)
            distance, normal = distance_in_frame(obstacle, trees, local)
            depth, swept = thickness - distance, False
            if fast:
                before = in_frame_before(obstacle, column_of(start, begin + i))
                depth, normal, swept = _swept(
                    obstacle, trees, before, local, thickness, depth, normal
                )
            if depth > 0.0:
                outwards = to_world(obstacle, normal)
                particle = begin - first + i
                found = _put(contacts, found, particle, point, outwards, depth, swept)
    return found


@helper
def distance_on_side_of_entry(
    obstacle: np.void, trees: Trees, start: Vector, point: Vector, thickness: float
) -> tuple[float, Vector]:
    """
    Return the signed distance of a point from an obstacle, m, and the normal, in world axes.

    That of the side where a fast particle has entered, as in `find_contacts`.

    Parameters
    ----------
    obstacle : OBSTACLE
    trees : Trees
    start, point : vector
        positions at the tick before, and now, m
    thickness : float
        m

    """
    local = in_frame(obstacle, point)
    distance, normal = distance_in_frame(obstacle, trees, local)
    before, depth = in_frame_before(obstacle, start), thickness - distance
    depth, normal, _ = _swept(obstacle, trees, before, local, thickness, depth, normal)
    return thickness - depth, to_world(obstacle, normal)


@helper
def _swept(
    obstacle: np.void,
    trees: Trees,
    start: Vector,
    end: Vector,
    thickness: float,
    depth: float,
    normal: Vector,
) -> tuple[float, Vector, bool]:
    """
    Return depth and normal on the side of entry of a particle, and whether they are swept.

    That is whether they differ from those of the closest point, `depth` and `normal`.

    Parameters
    ----------
    obstacle : OBSTACLE
    trees : Trees
    start, end : Vector
        of its path, in the frame of the obstacle, m
    thickness, depth : float
        m
    normal : Vector
        in the frame of the obstacle

    """
    if not norm(minus(end, start)) > obstacle['ccd_threshold']:
        return depth, normal, False
    touched, distance, entry = first_touch(obstacle, trees, start, end, thickness)
    entered = thickness - distance
    if not touched or not entered > 0.0:
        return depth, normal, False
    if dot(entry, normal) > SAME_SIDE and depth > NEARLY_AS_DEEP * entered:
        return depth, normal, False
    return entered, entry, True


@helper
def _largest_displacement(
    obstacle: np.void, x: np.ndarray, start: np.ndarray, first: int, count: int
) -> Vector:
    """Return the largest displacements per axis relative to an obstacle, m; 0 if slow."""
    rotation_change, shift = IDENTITY, ZERO
    if obstacle['moved']:
        before = matrix_of(obstacle['rotation_before'])
        rotation_change = product(matrix_of(obstacle['rotation']), transposed(before))
        moved_origin = applied(rotation_change, vector_of(obstacle['position_before']))
        shift = minus(vector_of(obstacle['position']), moved_origin)
    limit = obstacle['ccd_threshold'] / ROOT_OF_3
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation_change
    sx, sy, sz = shift
    # whether there are fast ones: a vectorised loop
    fast = 0
    for begin in range(first, first + count, TILE):
        end = min(begin + TILE, first + count)
        x0, x1, x2 = x[0, begin:end], x[1, begin:end], x[2, begin:end]
        s0, s1, s2 = start[0, begin:end], start[1, begin:end], start[2, begin:end]
        for i in range(end - begin):
            fast += (
                (abs(x0[i] - (xx * s0[i] + xy * s1[i] + xz * s2[i]) - sx) > limit)
                | (abs(x1[i] - (yx * s0[i] + yy * s1[i] + yz * s2[i]) - sy) > limit)
                | (abs(x2[i] - (zx * s0[i] + zy * s1[i] + zz * s2[i]) - sz) > limit)
            )
    if fast == 0:
        return ZERO
    most_x, most_y, most_z = ZERO
    for i in range(first, first + count):
        displacement = minus(
            minus(column_of(x, i), applied(rotation_change, column_of(start, i))), shift
        )
        most_x, most_y = max(most_x, abs(displacement[0])), max(most_y, abs(displacement[1]))
        most_z = max(most_z, abs(displacement[2]))
    return (most_x, most_y, most_z)
