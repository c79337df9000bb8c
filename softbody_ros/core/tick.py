# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the stages of a tick share: the particles on their way, and what stays the same."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from softbody_ros.core.gains import Gains
from softbody_ros.core.regions import Regions
from softbody_ros.core.rest_shape import RestShape

SLOW_TICKS = 2.0
"""What gravity adds in so many ticks is too slow to bounce, so that bodies come to rest."""


class SimulationError(ArithmeticError):
    """A step that would leave the finite numbers; the state before it is kept."""


@dataclass(frozen=True)
class Particles:
    """
    The particles of B bodies in the middle of a tick.

    Attributes
    ----------
    x, v : (B, 3, n) float
        positions, m, and velocities, m/s: the stages change them in place
    start : (B, 3, n) float
        positions at the tick before, m
    received : (B, 2, 3) float
        impulse, m/s, and turning impulse about the centre of mass, m²/s, that contacts have given
        in this tick, per mass: the stages change them in place
    pressed : (B, 3) float
        what others that lie on a body add to its weight, m/s²: the same

    """

    x: np.ndarray
    v: np.ndarray
    start: np.ndarray
    received: np.ndarray = field(init=False)
    pressed: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'received', np.zeros((len(self.x), 2, 3)))
        object.__setattr__(self, 'pressed', np.zeros((len(self.x), 3)))


@dataclass(frozen=True)
class Tick:
    """
    What a tick of a batch is computed with.

    Attributes
    ----------
    rest : RestShape
    regions : Regions or None
    gains : Gains
    gravity : (3,) float
        m/s²
    h : float
        s

    """

    rest: RestShape
    regions: Regions | None
    gains: Gains
    gravity: np.ndarray
    h: float

    def slow(self, acceleration: np.ndarray) -> np.ndarray:
        """Return the speeds (…), m/s, up to which nothing bounces under accelerations (…, 3)."""
        return SLOW_TICKS * self.h * np.linalg.norm(acceleration, axis=-1)
