# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sleep: bodies that lie still on something stop moving, and stop costing time.

Judged on displacement: the velocity of a particle that a contact holds away from its goal is not
zero at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softbody_ros.core import contact
from softbody_ros.core.gains import Gains
from softbody_ros.core.obstacles import Obstacle
from softbody_ros.core.pins import Pins
from softbody_ros.core.rest_shape import RestShape

WATCH = 0.1
"""Seconds between two looks."""
QUIET = 2e-4
"""Displacement between two looks, in RMS radii, below which a body lies still."""
QUIET_LOOKS = 5
"""Looks in a row after which a body that lies still falls asleep."""


@dataclass
class Stillness:
    """
    How still B bodies have been.

    Attributes
    ----------
    anchor : (B, 3, n) float
        positions at the last look, m
    quiet_looks : (B,) int
        looks in a row without displacement

    """

    anchor: np.ndarray
    quiet_looks: np.ndarray

    @property
    def awake(self) -> np.ndarray:
        """(B,) bool."""
        return self.quiet_looks < QUIET_LOOKS

    def copy(self) -> Stillness:
        """Return a copy that does not share memory."""
        return Stillness(self.anchor.copy(), self.quiet_looks.copy())


def stillness(x: np.ndarray) -> Stillness:
    """Return the stillness of bodies that begin to be watched at positions x (B, 3, n)."""
    return Stillness(x.copy(), np.zeros(len(x), dtype=np.int64))


def watch(
    watched: Stillness,
    x: np.ndarray,
    v: np.ndarray,
    rest: RestShape,
    gains: Gains,
    obstacles: Sequence[Obstacle],
    pinned: Mapping[int, Pins],
) -> None:
    """
    Look at the bodies: those that lie still for long enough get zero velocities, in place.

    Parameters
    ----------
    watched : Stillness
    x, v : (B, 3, n) float
        m, m/s
    rest : RestShape
    gains : Gains
    obstacles : sequence of Obstacle
        bodies fall asleep on these only: what floats or lies on a moving one stays awake
    pinned : mapping of int to Pins
        or on these, by row

    """
    if not watched.awake.any() or any(obstacle.moves for obstacle in obstacles):
        return
    quiet = QUIET * rest.scale
    lies_on = np.zeros(len(x), dtype=bool)
    for obstacle in obstacles:
        lies_on[contact.find(x, obstacle, gains.thickness + quiet).body] = True
    for row, pins in pinned.items():
        lies_on[row] = not pins.moves
    still = lies_on & (np.abs(x - watched.anchor).max(axis=(1, 2)) < quiet)
    watched.quiet_looks = np.where(still, watched.quiet_looks + 1, 0)
    watched.anchor[:] = x
    v[~watched.awake] = 0.0
