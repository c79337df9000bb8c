# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Mean forces of contacts since a reader last asked, from the integrals of `contact_forces`."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from softbody_ros.core.contact_forces import (
    ContactImpulse,
    ContactWrench,
    Departure,
    ObstacleKey,
)
from softbody_ros.core.world import World

_Integrals = dict[ObstacleKey, ContactImpulse]


class MeanWrenches:
    """
    A reader of a world that gets mean wrenches since it last asked for the same body or obstacle.

    >>> from softbody_ros.core import World, WorldConfig
    >>> world = World(WorldConfig())
    >>> means = MeanWrenches(world)
    >>> world.step(240)
    >>> force, torque = means.obstacle_wrench('ground')

    At the first time it is the mean since the reader was made, or since the body or obstacle was
    added, see `begin_period`. If there was no tick since then, it is the wrench of the last tick;
    so it is, once for each, after `World.reset` and `World.restore`, where the means begin anew.

    Parameters
    ----------
    world : World

    """

    _departures: int

    def __init__(self, world: World) -> None:
        self._world = world
        self._begin()

    def contact_wrench(self, name: str) -> ContactWrench:
        """Return the mean of `World.contact_wrench`."""
        now = self._world.contact_impulse(name)
        return self._mean(self._bodies, name, now) or self._world.contact_wrench(name)

    def pin_wrench(self, name: str) -> ContactWrench:
        """Return the mean of `World.pin_wrench`."""
        now = self._world.pin_impulse(name)
        return self._mean(self._pins, name, now) or self._world.pin_wrench(name)

    def obstacle_wrench(self, name: ObstacleKey) -> ContactWrench:
        """Return the mean of `World.obstacle_wrench`."""
        key, now = self._world.obstacle_key(name), self._world.obstacle_impulse(name)
        return self._mean(self._obstacles, key, now) or self._world.obstacle_wrench(name)

    def departed(self) -> list[tuple[Departure, ContactWrench]]:
        """
        Return the means, until now, of obstacles that have gone since this was last asked.

        To be asked before `obstacle_wrench`, as there may be another of the same key.
        """
        world = self._world
        if self._time_jumps != world.time_jumps:
            self._begin()
        gone = world.departed_since(self._departures)
        self._departures = world.departures
        result = []
        for each in gone:
            mean = self._mean(
                self._obstacles, each.key, dataclasses.replace(each.impulse, end=world.time)
            )
            self._obstacles.pop(each.key, None)
            if mean is not None:
                result.append((each, mean))
        return result

    def begin_period(self) -> None:
        """
        Begin a period: what is added during it has felt nothing in it before.

        Its first mean is over the whole period, as those of all others: times the length of the
        periods, means sum up to what was exchanged. It is for readers who ask for all at once.
        """
        if self._time_jumps != self._world.time_jumps:
            self._begin()
        self._period_begins = self._world.time

    def forget(self, name: ObstacleKey) -> None:
        """Forget a body or an obstacle that has been removed."""
        self._bodies.pop(name, None)
        self._pins.pop(name, None)
        self._obstacles.pop(name, None)

    def _begin(self) -> None:
        """Begin all means at the present tick."""
        world = self._world
        self._time_jumps, self._departures = world.time_jumps, world.departures
        self._period_begins = math.inf
        self._bodies: _Integrals = {name: world.contact_impulse(name) for name in world.names}
        self._pins: _Integrals = {name: world.pin_impulse(name) for name in world.names}
        self._obstacles: _Integrals = {
            key: world.obstacle_impulse(key) for key in world.obstacle_keys
        }

    def _mean(
        self, last: _Integrals, key: ObstacleKey, now: ContactImpulse
    ) -> ContactWrench | None:
        """Return a mean, and begin the next one; None without ticks."""
        if self._time_jumps != self._world.time_jumps:
            self._begin()
            return None
        before = last.get(key)
        if before is None or before.start != now.start:
            # it has been added since
            begin = min(now.start, self._period_begins)
            before = ContactImpulse(np.zeros(3), np.zeros(3), now.start, begin)
        last[key] = now
        return now.mean_since(before) if now.end > before.end else None
