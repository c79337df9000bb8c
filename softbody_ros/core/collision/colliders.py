# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the detection of contacts between bodies reads: bodies with their surfaces, and boxes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.collision.collision_surface import SurfaceArrays


class Colliders(NamedTuple):
    """
    Bodies that may be in contact with each other.

    Attributes
    ----------
    bodies : (B,) BODY
        with their `reach`
    chosen : (c,) int
        which of them
    shapes : (R,) SHAPE
    q : (3, M) float
        rest positions of the particles of all rest shapes
    x : (2, 3, N) float
        m
    match_centre, match_posture : (S, 3), (S, 3, 3) float
        centres, m, and linear maps of the pieces of bodies
    surfaces : SurfaceArrays

    """

    bodies: np.ndarray
    chosen: np.ndarray
    shapes: np.ndarray
    q: np.ndarray
    x: np.ndarray
    match_centre: np.ndarray
    match_posture: np.ndarray
    surfaces: SurfaceArrays


class Bounds(NamedTuple):
    """Boxes around c bodies with their reach."""

    low: np.ndarray
    """(c, 3) float, m"""
    high: np.ndarray
    """(c, 3) float, m"""
    margin: np.ndarray
    """(c,) float: the reach, m"""


class PieceBounds(NamedTuple):
    """Boxes around the pieces of c bodies with the reach of these."""

    first: np.ndarray
    """(c + 1,) int: index of the first box of each body"""
    low: np.ndarray
    """(Q, 3) float, m"""
    high: np.ndarray
    """(Q, 3) float, m"""
