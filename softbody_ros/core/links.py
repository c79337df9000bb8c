# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Links of a robot as obstacles: from the motions of their shapes to obstacles that follow them.

States of joints come late, early, or seldom. If a link were put where each says, contacts would
not see that it has moved there: fingers that lift would slip by all that they accelerate between
two states. So it makes the difference up by its velocity, until the next state is due.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np

from softbody_ros.core.collision.obstacles import Obstacle, with_twist
from softbody_ros.core.collision.shapes import Shape
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.config import LARGEST, ObstacleConfig
from softbody_ros.core.external_inputs import (
    NEVER,
    DynamicObstacle,
    Key,
    ObstaclePlacement,
    Twist,
    ticks_of,
)
from softbody_ros.core.geometry.vectors import (
    Matrix,
    Vector,
    along,
    dot,
    matrix_of,
    minus,
    norm,
    product,
    put_vector,
    scaled,
    transposed,
    vector_of,
)
from softbody_ros.core.shape_matching.free_rotation import rotation_by

FASTEST = 1e4
"""Speed, m/s, and in rad/s, above which it is none: the link stands still where it is put."""
FASTEST_CORRECTION = 20.0
"""Speed, m/s, and in rad/s, above which a difference is not made up for: it was put elsewhere."""
ARRIVED = 1e-9
"""Distance, m, and angle, rad, that are no difference."""
HALVINGS = 4
ARCSINE = (143 / 10240, 231 / 13312, 63 / 2816, 35 / 1152, 5 / 112, 3 / 40, 1 / 6, 1.0)
"""Coefficients of the power series of the arcsine, from the last one on."""

FOLLOWED = np.dtype(
    [
        ('linear', np.float64, (3,)),  # velocity until it arrives, m/s
        ('angular', np.float64, (3,)),  # rad/s
        ('orientation', np.float64, (4,)),  # of the given pose, a quaternion x y z w
        ('difference', np.float64),  # of the given pose from the present one, m or rad
    ],
    align=True,
)


@dataclass(frozen=True, eq=False)
class LinkShape:
    """
    A collision shape of a link.

    Attributes
    ----------
    key : (str, int)
        `ROBOT` and the name of the obstacle, and the number of the shape
    link : str
    config : ObstacleConfig
        without its pose; all shapes of a link have one name
    shape : Shape
    row : int
        of its frame

    """

    key: Key
    link: str
    config: ObstacleConfig
    shape: Shape
    row: int


def placements(
    shapes: Sequence[LinkShape],
    motions: np.ndarray,
    present: Mapping[Key, DynamicObstacle],
    tick: int,
    h: float,
    approach: float,
    seconds: float,
) -> list[ObstaclePlacement]:
    """
    Return the shapes of links that are to move otherwise than now.

    Parameters
    ----------
    shapes : sequence of s LinkShape
    motions : (s,) MOTION
        of the shapes, now
    present : mapping of key to DynamicObstacle
        the obstacles as they are
    tick, h : int, float
        the present one, and its length, s
    approach : float
        time in which they make up the difference between where they are and where they should be,
        s; 0: they are put there
    seconds : float
        time for which they move on without another call

    """
    ticks = ticks_of(approach, h) if approach > 0.0 else 0
    now = motions.copy()
    before = [present.get(shape.key) for shape in shapes]
    for row, item in enumerate(before):
        if item is not None:
            now['position'][row] = item.obstacle.position
            now['rotation'][row] = item.obstacle.rotation
    followed = np.zeros(len(shapes), FOLLOWED)
    _put_followed(motions, now, max(ticks, 1) * h, followed)
    stops_at = tick + ticks_of(seconds, h)
    positions = np.clip(motions['position'], -LARGEST, LARGEST)
    orientations = followed['orientation'].tolist()
    poses = [
        {'position': tuple(position), 'orientation': tuple(orientation)}
        for position, orientation in zip(positions.tolist(), orientations, strict=True)
    ]
    twists = _twists(motions)
    corrected = _twists(followed)
    result = []
    for row, (shape, item, pose) in enumerate(zip(shapes, before, poses, strict=True)):
        difference, arrives_at = followed['difference'][row], NEVER
        if item is not None and _is_of(item.obstacle, shape) and difference <= ARRIVED:
            if item.twist == twists[row] == _twist_of(item.obstacle) and not item.obstacle.moves:
                continue  # it stands still, and goes on to
            obstacle = with_twist(item.obstacle, *twists[row], **pose)
        elif (
            item is not None
            and _is_of(item.obstacle, shape)
            and ticks
            and difference <= FASTEST_CORRECTION * ticks * h
        ):
            obstacle = with_twist(item.obstacle, *corrected[row], **pose)
            arrives_at = tick + ticks
        else:
            linear, angular = twists[row]
            config = shape.config.with_values(
                velocity_linear=linear, velocity_angular=angular, **pose
            )
            obstacle = Obstacle(config, positions[row], motions['rotation'][row], shape.shape)
        moves_until = stops_at if obstacle.moves else NEVER
        result.append(
            ObstaclePlacement(
                shape.key,
                DynamicObstacle(obstacle, 0, moves_until, NEVER, arrives_at, twists[row]),
            )
        )
    return result


def _is_of(obstacle: Obstacle, shape: LinkShape) -> bool:
    return obstacle.shape is shape.shape and obstacle.config.friction == shape.config.friction


def _twist_of(obstacle: Obstacle) -> Twist:
    return obstacle.config.velocity_linear, obstacle.config.velocity_angular


def _twists(motions: np.ndarray) -> list[Twist]:
    """Return the twists of motions; of those that are too fast, zero."""
    both = np.concatenate([motions['linear'], motions['angular']], axis=1)
    both[np.abs(both).max(axis=1) > FASTEST] = 0.0
    return [(tuple(row[:3]), tuple(row[3:])) for row in both.tolist()]


@kernel
def _put_followed(
    target: np.ndarray, now: np.ndarray, seconds: float, followed: np.ndarray
) -> None:
    """Write how obstacles at the poses `now` get to targets (s,) MOTION, which move on."""
    for row in range(len(target)):
        linear, angular = vector_of(target[row]['linear']), vector_of(target[row]['angular'])
        turn = matrix_of(target[row]['rotation'])
        offset = minus(vector_of(target[row]['position']), vector_of(now[row]['position']))
        turned = product(rotation_by(scaled(seconds, angular)), turn)
        turned = product(turned, transposed(matrix_of(now[row]['rotation'])))
        needed = scaled(1.0 / seconds, rotation_vector(quaternion_of(turned)))
        record = followed[row]
        put_vector(record['linear'], along(linear, 1.0 / seconds, offset))
        put_vector(record['angular'], needed)
        missing = scaled(seconds, minus(needed, angular))
        record['difference'] = max(norm(offset), norm(missing))
        quaternion = quaternion_of(turn)
        for axis in range(4):
            record['orientation'][axis] = min(max(quaternion[axis], -1.0), 1.0)


@helper
def quaternion_of(m: Matrix) -> tuple[float, float, float, float]:
    """Return the quaternion x y z w, w ≥ 0, of a rotation: by its largest part (Shepperd 1978)."""
    (a, b, c), (d, e, f), (g, h, i) = m
    trace = a + e + i
    if trace >= a and trace >= e and trace >= i:
        w = math.sqrt(max(1.0 + trace, 0.0))
        x, y, z = (h - f) / w, (c - g) / w, (d - b) / w
    elif a >= e and a >= i:
        x = math.sqrt(max(1.0 + a - e - i, 0.0))
        y, z, w = (b + d) / x, (c + g) / x, (h - f) / x
    elif e >= i:
        y = math.sqrt(max(1.0 - a + e - i, 0.0))
        x, z, w = (b + d) / y, (f + h) / y, (c - g) / y
    else:
        z = math.sqrt(max(1.0 - a - e + i, 0.0))
        x, y, w = (c + g) / z, (f + h) / z, (d - b) / z
    half = -0.5 if w < 0.0 else 0.5
    return half * x, half * y, half * z, half * w


@helper
def rotation_vector(q: tuple[float, float, float, float]) -> Vector:
    """Return the rotation vector, rad, of a quaternion x y z w of length 1, w ≥ 0."""
    part, w, factor = (q[0], q[1], q[2]), q[3], 2.0
    for _ in range(HALVINGS):
        # of half the angle
        half = math.sqrt(0.5 * (1.0 + w))
        part, w, factor = scaled(0.5 / half, part), half, 2.0 * factor
    square, series = dot(part, part), 0.0
    for k in range(len(ARCSINE)):
        series = series * square + ARCSINE[k]
    return scaled(factor * series, part)
