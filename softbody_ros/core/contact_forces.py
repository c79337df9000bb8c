# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Forces of contacts for readers of any rate: integrals over time, and means.

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
    from softbody_ros.core.world import World

ContactWrench: TypeAlias = tuple[np.ndarray, np.ndarray]
"""Force (3,), N, and torque (3,), N m, in world axes."""
ObstacleKey: TypeAlias = str | tuple[str, int] | None
"""
An obstacle of the config by its name, one received at run time by the key of its updates, None for
all point obstacles together.
"""


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


class MeanWrenches:
    """
    A reader of a world that gets mean wrenches since it last asked for the same body or obstacle.

    >>> from softbody_ros.core import World, WorldConfig
    >>> world = World(WorldConfig())
    >>> means = MeanWrenches(world)
    >>> world.step(240)
    >>> force, torque = means.obstacle_wrench('ground')

    At the first time it is the mean since the reader was made, or since the body or obstacle was
    added. If there was no tick since then, it is the wrench of the last tick; so it is, once for
    each, after `World.reset` and `World.restore`, where the means begin anew.

    Parameters
    ----------
    world : World

    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._begin()

    def contact_wrench(self, name: str) -> ContactWrench:
        """Return the mean of `World.contact_wrench`."""
        now = self._world.contact_impulse(name)
        return self._mean(self._bodies, name, now) or self._world.contact_wrench(name)

    def obstacle_wrench(self, name: ObstacleKey) -> ContactWrench:
        """Return the mean of `World.obstacle_wrench`."""
        key, now = self._world.obstacle_key(name), self._world.obstacle_impulse(name)
        return self._mean(self._obstacles, key, now) or self._world.obstacle_wrench(name)

    def _begin(self) -> None:
        """Begin all means at the present tick."""
        world = self._world
        self._time_jumps = world.time_jumps
        self._bodies = {name: world.contact_impulse(name) for name in world.names}
        self._obstacles = {key: world.obstacle_impulse(key) for key in world.obstacle_keys}

    def _mean(self, last: dict, key: ObstacleKey, now: ContactImpulse) -> ContactWrench | None:
        """Return a mean, and begin the next one; None without ticks."""
        if self._time_jumps != self._world.time_jumps:
            self._begin()
            return None
        before = last.get(key)
        if before is None or before.start != now.start:
            # it has been added since
            before = ContactImpulse(np.zeros(3), np.zeros(3), now.start, now.start)
        last[key] = now
        return now.mean_since(before) if now.end > before.end else None
