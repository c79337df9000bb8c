# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Forces of contacts for readers of any rate: integrals over time.

The force in one tick misses what happens between two questions, and an impact lasts a few ticks.
So the world integrates the wrenches over time; a mean is the difference of two integrals over the
time between them. The integrals belong to the state, what was asked last belongs to the reader:
any number of readers can ask, without a trace in the state.

Torques refer to points that move: the centre of mass of a body, the origin of an obstacle. Their
integral is the sum over ticks of moments about the point where it is at the end of each. For a
body it is the change of its angular momentum about its centre of mass by contacts; for an obstacle
the mean is what a sensor would measure that is fixed to its origin but does not turn. Moments
about a fixed point add up as well, but those of a body far from it say little but its force.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from softbody_ros.core.collision.obstacles import Obstacle

ContactWrench: TypeAlias = tuple[np.ndarray, np.ndarray]
"""Force (3,), N, and torque (3,), N m, in world axes."""
ObstacleKey: TypeAlias = str | tuple[str, int] | None
"""
An obstacle of the config by its name, one received at run time by the key of its updates, None for
all point obstacles together.
"""


def name_of_obstacle(key: ObstacleKey) -> str:
    """Return the name by which an obstacle is asked for: `namespace/id` if it was received."""
    return f'{key[0]}/{key[1]}' if isinstance(key, tuple) else key or ''


@dataclass(frozen=True, eq=False)
class ContactImpulse:
    """
    Integral over time of the wrench of all contacts of a body or an obstacle.

    Attributes
    ----------
    impulse : (3,) float
        N s
    angular_impulse : (3,) float
        N m s, see the module for its point of reference
    start, end : float
        of the time of integration, s: the start is that of the simulation, or when the body or
        obstacle was added

    """

    impulse: np.ndarray
    angular_impulse: np.ndarray
    start: float
    end: float

    def mean_since(self, before: ContactImpulse) -> ContactWrench:
        """Return the mean wrench since an earlier integral for the same body or obstacle."""
        seconds = self.end - before.end
        return (
            (self.impulse - before.impulse) / seconds,
            (self.angular_impulse - before.angular_impulse) / seconds,
        )


@dataclass(frozen=True, eq=False)
class Departure:
    """
    What an obstacle had felt when it went.

    Attributes
    ----------
    key : str or (str, int)
    obstacle : Obstacle
        at its last pose
    impulse : ContactImpulse
        of all the time for which it was there

    """

    key: ObstacleKey
    obstacle: Obstacle
    impulse: ContactImpulse
