# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Forward kinematics of a tree of links: poses and twists, from joint positions and velocities.

Featherstone, Rigid Body Dynamics Algorithms (2008), section 4.2, with velocities in world axes, of
the origins of the links: with J for the frame of a joint, in its parent P,

    R = R_P R_J exp(q a),    p = p_P + R_P p_J,             ω = ω_P + q̇ R a   (a joint that turns)
    R = R_P R_J,             p = p_P + R_P p_J + q R a,     ω = ω_P           (a joint that slides)
    v = v_P + ω_P × (p − p_P), and + q̇ R a of a joint that slides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.vectors import (
    Vector,
    along,
    applied,
    cross,
    matrix_of,
    plus,
    product,
    put_matrix,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.shape_matching.free_rotation import rotation_by

FIXED, TURNS, SLIDES = range(3)
"""Values of `kind`."""

FRAME = np.dtype(
    [
        ('parent', np.int64),  # row of the link that it is fixed to; −1: the root
        ('kind', np.int64),  # of the joint between
        ('position', np.float64, (3,)),  # of the joint, in the parent, m
        ('rotation', np.float64, (3, 3)),  # axes of the joint in those of the parent, as columns
        ('axis', np.float64, (3,)),  # of the joint, of length 1, in the axes of the joint
    ],
    align=True,
)
"""A link, or anything that is fixed to one."""
MOTION = np.dtype(
    [
        ('position', np.float64, (3,)),  # of the origin, m
        ('rotation', np.float64, (3, 3)),  # its axes in world coordinates, as columns
        ('linear', np.float64, (3,)),  # velocity of the origin, m/s
        ('angular', np.float64, (3,)),  # rad/s, world axes
    ],
    align=True,
)
"""A pose and its velocity."""


def motions(frames: np.ndarray, joints: np.ndarray, root: np.ndarray) -> np.ndarray:
    """
    Return the motions (k,) MOTION of frames, of which each comes after its parent.

    Parameters
    ----------
    frames : (k,) FRAME
    joints : (k, 2) float
        position, rad or m, and velocity of the joint of each
    root : (1,) MOTION
        of the root in the world

    """
    result = np.zeros(len(frames), MOTION)
    _put_motions(frames, np.ascontiguousarray(joints, dtype=np.float64), root, result)
    return result


def motion_of(
    position: Sequence[float],
    rotation: np.ndarray,
    linear: Sequence[float] = (0.0, 0.0, 0.0),
    angular: Sequence[float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Return a motion (1,) MOTION."""
    result = np.zeros(1, MOTION)
    result['position'], result['rotation'] = position, rotation
    result['linear'], result['angular'] = linear, angular
    return result


@kernel
def _put_motions(
    frames: np.ndarray, joints: np.ndarray, root: np.ndarray, result: np.ndarray
) -> None:
    for row in range(len(frames)):
        frame = frames[row]
        if frame['parent'] < 0:
            _put_motion(frame, joints[row, 0], joints[row, 1], root[0], result[row])
        else:
            parent = result[frame['parent']]
            _put_motion(frame, joints[row, 0], joints[row, 1], parent, result[row])


@helper
def _put_motion(
    frame: np.void, value: float, rate: float, parent: np.void, result: np.void
) -> None:
    """Write the motion of a frame, from that of its parent and of the joint between."""
    turn, angular = matrix_of(parent['rotation']), vector_of(parent['angular'])
    offset = applied(turn, vector_of(frame['position']))
    turn = product(turn, matrix_of(frame['rotation']))
    axis = applied(turn, vector_of(frame['axis']))
    slide: Vector = (0.0, 0.0, 0.0)
    if frame['kind'] == SLIDES:
        offset, slide = along(offset, value, axis), scaled(rate, axis)
    linear = plus(plus(vector_of(parent['linear']), cross(angular, offset)), slide)
    if frame['kind'] == TURNS:
        turn = product(turn, rotation_by(scaled(value, vector_of(frame['axis']))))
        angular = along(angular, rate, axis)
    put_vector(result['position'], plus(vector_of(parent['position']), offset))
    put_matrix(result['rotation'], turn)
    put_vector(result['linear'], linear)
    put_vector(result['angular'], angular)
