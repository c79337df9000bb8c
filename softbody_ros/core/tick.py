# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the stages of a tick share, and what goes wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.shape_matching.gains import Gains
from softbody_ros.core.shape_matching.regions import Regions
from softbody_ros.core.shape_matching.rest_shape import RestShape

SLOW_TICKS = 2.0
"""What gravity adds in so many ticks is too slow to bounce, so that bodies come to rest."""


class SimulationError(ArithmeticError):
    """A step that would leave the finite numbers; the state before it is kept."""


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
