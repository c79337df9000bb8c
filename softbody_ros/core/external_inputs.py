# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What others do to a world while it runs: things they put in the way, wrenches, another gravity.

All of it is one immutable value, so a snapshot of it is a reference. Times are ticks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
import math

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.collision import obstacles
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import NO_POINTS, PointObstacles
from softbody_ros.core.config import ObstacleConfig, settings

MOST_GUESTS = 1000
"""Obstacles that others may put in the way."""
EVERY_BODY = ''
"""Stands for all bodies where the name of one is meant."""
NEVER = 2**62

Key = tuple[str, int]
_STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
_FACTS = {name: facts for name, _, facts in settings(ObstacleConfig)}


@dataclass(frozen=True)
class Placement:
    """
    Where somebody puts an obstacle.

    Attributes
    ----------
    key : (str, int)
        what identifies it from one placement to the next
    config : ObstacleConfig
        without velocity: that follows from the placement before
    stamp : int
        when it was there, ns of its clock; 0 is unknown
    pace : float
        simulated seconds per second of that clock
    lifetime : int
        ticks after which it goes; 0 is never

    """

    key: Key
    config: ObstacleConfig
    stamp: int = 0
    pace: float = 1.0
    lifetime: int = 0


@dataclass(frozen=True)
class Removal:
    """Takes away one obstacle; with id None those of a namespace, or all if that is empty."""

    namespace: str = ''
    id: int | None = None

    def takes(self, key: Key) -> bool:
        """Whether it takes away the obstacle of a key."""
        if self.id is None:
            return self.namespace in ('', key[0])
        return key == (self.namespace, self.id)


@dataclass(frozen=True, eq=False)
class Guest:
    """
    An obstacle that somebody has put in the way.

    Attributes
    ----------
    obstacle : Obstacle
        its config has the pose that was said last
    stamp : int
        of that pose, ns
    stands_at, goes_at : int
        ticks at which it stops where it is then, and at which it is taken away

    """

    obstacle: Obstacle
    stamp: int
    stands_at: int = NEVER
    goes_at: int = NEVER

    def at(self, tick: int) -> Guest:
        """Return it as it begins a tick: it stands still when its time to move is over."""
        if tick < self.stands_at:
            return self
        still = dataclasses.replace(self.obstacle, config=_moving(self.obstacle.config, *_STILL))
        return dataclasses.replace(self, obstacle=still, stands_at=NEVER)

    def moved(self, h: float) -> Guest:
        """Return it after h seconds."""
        if not self.obstacle.moves:
            return self
        return dataclasses.replace(self, obstacle=obstacles.moved(self.obstacle, h))

    def looks_like(self, other: Guest) -> bool:
        """Whether bodies notice no difference."""
        mine, others = self.obstacle, other.obstacle
        return (
            mine.config == others.config
            and np.array_equal(mine.position, others.position)
            and np.array_equal(mine.rotation, others.rotation)
        )


@dataclass(frozen=True, eq=False)
class Wrench:
    """
    What pushes and turns a body at its centre of mass.

    Attributes
    ----------
    force, torque : (3,) float
        N, N m
    in_body_axes : bool
        whether they turn with the body
    ends_at : int
        the tick from which on it acts no more

    """

    force: np.ndarray
    torque: np.ndarray
    in_body_axes: bool
    ends_at: int


@dataclass(frozen=True, eq=False)
class Outside:
    """
    Everything that others do to a world at one tick.

    Attributes
    ----------
    guests : mapping of (str, int) to Guest
    points : PointObstacles
    wrenches : mapping of str to Wrench
        by the name of the body, or `EVERY_BODY`
    gravity : (3,) float or None
        instead of that of the config, m/s²
    gravity_ends_at : int
        the tick from which on the config's holds again

    """

    guests: Mapping[Key, Guest] = field(default_factory=dict)
    points: PointObstacles = NO_POINTS
    wrenches: Mapping[str, Wrench] = field(default_factory=dict)
    gravity: np.ndarray | None = None
    gravity_ends_at: int = NEVER

    @cached_property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles, in the order in which they came."""
        return tuple(guest.obstacle for guest in self.guests.values())

    @cached_property
    def _next_change(self) -> int:
        ends = [wrench.ends_at for wrench in self.wrenches.values()]
        for guest in self.guests.values():
            ends += [guest.stands_at, guest.goes_at]
        return min([*ends, self.gravity_ends_at])

    @cached_property
    def _moves(self) -> bool:
        return any(obstacle.moves for obstacle in self.obstacles)

    @property
    def nbytes(self) -> int:
        """Memory that it takes, about."""
        return self.points.points.nbytes + 1000 * len(self.guests) + 200 * len(self.wrenches)

    def moved(self, h: float) -> Outside:
        """Return it after h seconds: obstacles move on with their velocities."""
        if not self._moves:
            return self
        guests = {key: guest.moved(h) for key, guest in self.guests.items()}
        return dataclasses.replace(self, guests=guests)

    def at(self, tick: int) -> Outside:
        """Return it as it begins a tick: without what is over."""
        if tick < self._next_change:
            return self
        guests = {
            key: guest.at(tick) for key, guest in self.guests.items() if tick < guest.goes_at
        }
        wrenches = {name: item for name, item in self.wrenches.items() if tick < item.ends_at}
        result = dataclasses.replace(self, guests=guests, wrenches=wrenches)
        return result if tick < self.gravity_ends_at else result.with_gravity(None, NEVER)

    def begun_anew(self, tick: int) -> Outside:
        """Return it at tick 0 of a new beginning: what is in the way stays, forces end."""
        guests = {
            key: dataclasses.replace(
                guest,
                stands_at=_earlier(guest.stands_at, tick),
                goes_at=_earlier(guest.goes_at, tick),
            )
            for key, guest in self.guests.items()
        }
        return Outside(guests, self.points)

    def changed(
        self, changes: Iterable[Placement | Removal], tick: int, longest_gap: float, h: float
    ) -> Outside:
        """
        Return it with obstacles put somewhere, as new ones or from where they were, or taken away.

        Two poses whose stamps are not too far apart make a velocity, with which an obstacle moves
        on for as long as stamps may be apart. Beyond `MOST_GUESTS` nothing new comes in.

        Parameters
        ----------
        changes : iterable of Placement and Removal
            in their order
        tick : int
            now
        longest_gap : float
            between two stamps that make a velocity, s
        h : float
            s

        """
        guests = dict(self.guests)
        stands_at = tick + ticks_of(longest_gap, h)
        for change in changes:
            if isinstance(change, Removal):
                guests = {key: guest for key, guest in guests.items() if not change.takes(key)}
            elif change.key in guests or len(guests) < MOST_GUESTS:
                before = guests.get(change.key)
                guests[change.key] = _placed(change, before, tick, stands_at, longest_gap)
        return dataclasses.replace(self, guests=guests)

    def with_points(self, points: PointObstacles) -> Outside:
        """Return it with other points in the way."""
        return dataclasses.replace(self, points=points)

    def with_wrench(self, name: str, wrench: Wrench) -> Outside:
        """Return it with another wrench on a body, or without if that is zero."""
        wrenches = {key: item for key, item in self.wrenches.items() if key != name}
        if wrench.force.any() or wrench.torque.any():
            wrenches[name] = wrench
        return dataclasses.replace(self, wrenches=wrenches)

    def with_gravity(self, gravity: np.ndarray | None, ends_at: int) -> Outside:
        """Return it with a gravity of its own until a tick, or none."""
        return dataclasses.replace(self, gravity=gravity, gravity_ends_at=ends_at)

    def same_guests(self, other: Outside) -> bool:
        """Whether bodies notice no difference between the obstacles."""
        if self.guests is other.guests:
            return True
        return self.guests.keys() == other.guests.keys() and all(
            guest.looks_like(other.guests[key]) for key, guest in self.guests.items()
        )


def ticks_of(seconds: float, h: float) -> int:
    """Return the ticks of h seconds that come nearest to a duration, at least one."""
    return max(round(seconds / h), 1)


def _placed(
    item: Placement, before: Guest | None, tick: int, stands_at: int, longest_gap: float
) -> Guest:
    velocity = _STILL if before is None else _velocity(before, item, longest_gap)
    obstacle = obstacles.placed(_moving(item.config, *velocity))
    return Guest(
        obstacle,
        item.stamp,
        stands_at if obstacle.moves else NEVER,
        tick + item.lifetime if item.lifetime else NEVER,
    )


def _earlier(end: int, tick: int) -> int:
    return end if end == NEVER else end - tick


def _moving(
    config: ObstacleConfig, linear: tuple[float, ...], angular: tuple[float, ...]
) -> ObstacleConfig:
    if (config.velocity_linear, config.velocity_angular) == (linear, angular):
        return config
    return dataclasses.replace(config, velocity_linear=linear, velocity_angular=angular)


def _velocity(
    before: Guest, item: Placement, longest_gap: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the linear and angular velocity between two poses that were said, or zeros."""
    gap = 1e-9 * (item.stamp - before.stamp) * item.pace
    if not (before.stamp > 0 and 0.0 < gap <= longest_gap):
        return _STILL
    old, new = before.obstacle.config, item.config
    if (old.position, old.orientation) == (new.position, new.orientation):
        return _STILL
    linear = (np.array(new.position) - old.position) / gap
    turn = Rotation.from_quat(new.orientation) * Rotation.from_quat(old.orientation).inv()
    angular = turn.as_rotvec() / gap
    fastest = _FACTS['velocity_linear'].maximum or math.inf
    if max(np.abs(linear).max(), np.abs(angular).max()) > fastest:
        return _STILL  # it has not moved: it has been put somewhere else
    return tuple(linear.tolist()), tuple(angular.tolist())
