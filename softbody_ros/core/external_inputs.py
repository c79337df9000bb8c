# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
External inputs received at run time: obstacles, points, wrenches, a gravity override.

All of them are one immutable value, so a snapshot is a reference. Times are ticks, except for the
stamps of poses on the sender's clock, from which the velocities of obstacles are computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.collision import obstacles
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import NO_POINTS, PointObstacles
from softbody_ros.core.config import FASTEST, ObstacleConfig

MOST_DYNAMIC_OBSTACLES = 1000
"""Largest number of obstacles added at run time."""
EVERY_BODY = ''
"""Key of wrenches on all bodies, in place of a name."""
ROBOT = 'robot:'
"""What namespaces of links of a robot begin with: only removed by name."""
NEVER = 2**62

Key = tuple[str, int]
Twist = tuple[tuple[float, ...], tuple[float, ...]]
_STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class ObstacleUpdate:
    """
    A received pose of a new or known obstacle.

    Attributes
    ----------
    key : (str, int)
        identifies it from one update to the next
    config : ObstacleConfig
        its own velocity is not used
    stamp : int
        time of the pose, ns of the sender's clock; 0 is unknown
    pace : float
        simulated seconds per second of that clock
    lifetime : int
        ticks after which it is removed; 0 is never
    twist : ((3,) float, (3,) float) or None
        velocity of its origin, m/s, and angular velocity, rad/s, world axes, in simulated time;
        None: computed from the previous update

    """

    key: Key
    config: ObstacleConfig
    stamp: int = 0
    pace: float = 1.0
    lifetime: int = 0
    twist: Twist | None = None


@dataclass(frozen=True)
class ObstacleRemoval:
    """
    Removes one obstacle; with id None those of a namespace, or all if that is empty.

    Not the links of a robot, which are no markers: of those a namespace must be named.
    """

    namespace: str = ''
    id: int | None = None

    def removes(self, key: Key) -> bool:
        """Whether it removes the obstacle of a key."""
        if self.id is None:
            return self.namespace == key[0] or not (self.namespace or is_link(key))
        return key == (self.namespace, self.id)


def is_link(key: object) -> bool:
    """Return whether a key is that of a shape of a link of a robot."""
    return isinstance(key, tuple) and key[0].startswith(ROBOT)


@dataclass(frozen=True, eq=False)
class DynamicObstacle:
    """
    An obstacle received at run time.

    Attributes
    ----------
    obstacle : Obstacle
        its config has the last received pose
    stamp : int
        of that pose, ns
    stops_at, expires_at : int
        ticks at which it stops moving, and at which it is removed
    arrives_at : int
        tick from which on it moves with `twist`
    twist : ((3,) float, (3,) float)
        m/s, rad/s

    """

    obstacle: Obstacle
    stamp: int
    stops_at: int = NEVER
    expires_at: int = NEVER
    arrives_at: int = NEVER
    twist: Twist = _STILL

    def at(self, tick: int) -> DynamicObstacle:
        """Return it at the beginning of a tick: arrived, or without velocity after `stops_at`."""
        if tick < min(self.arrives_at, self.stops_at):
            return self
        if tick < self.stops_at:
            arrived = obstacles.with_twist(self.obstacle, *self.twist)
            return dataclasses.replace(self, obstacle=arrived, arrives_at=NEVER)
        config = _moving(self.obstacle.config, *_STILL)
        still = dataclasses.replace(self.obstacle, config=config, before=None)
        return dataclasses.replace(self, obstacle=still, stops_at=NEVER, arrives_at=NEVER)

    def moved(self, h: float) -> DynamicObstacle:
        """Return it after h seconds."""
        if self.obstacle.is_still:
            return self
        return self.with_obstacle(obstacles.moved(self.obstacle, h))

    def with_obstacle(self, obstacle: Obstacle) -> DynamicObstacle:
        """Return it with its obstacle elsewhere."""
        return DynamicObstacle(
            obstacle, self.stamp, self.stops_at, self.expires_at, self.arrives_at, self.twist
        )

    def equals(self, other: DynamicObstacle) -> bool:
        """Whether shape, pose and velocity are equal."""
        return obstacles.is_same(self.obstacle, other.obstacle)

    def continues(self, other: DynamicObstacle) -> bool:
        """Whether it differs from another one at most by its velocity: as far as is seen fast."""
        mine, others = self.obstacle, other.obstacle
        return (
            mine.position is others.position
            and mine.rotation is others.rotation
            and mine.shape is others.shape
            and mine.config.friction == others.config.friction
        )


@dataclass(frozen=True, eq=False)
class ObstaclePlacement:
    """An obstacle with its motion, made by who adds or moves it, and its key; see `links`."""

    key: Key
    item: DynamicObstacle


@dataclass(frozen=True, eq=False)
class Wrench:
    """
    A wrench applied to a body at its centre of mass.

    Attributes
    ----------
    force, torque : (3,) float
        N, N m
    in_body_axes : bool
        whether they rotate with the body, or are in world axes
    ends_at : int
        tick from which on it does not act

    """

    force: np.ndarray
    torque: np.ndarray
    in_body_axes: bool
    ends_at: int


@dataclass(frozen=True, eq=False)
class ExternalInputs:
    """
    All external inputs that act at one tick.

    Attributes
    ----------
    dynamic_obstacles : mapping of (str, int) to DynamicObstacle
    points : PointObstacles
    wrenches : mapping of str to Wrench
        by the name of the body, or `EVERY_BODY`
    gravity : (3,) float or None
        overrides that of the config, m/s²
    gravity_ends_at : int
        tick from which on the config's holds again

    """

    dynamic_obstacles: Mapping[Key, DynamicObstacle] = field(default_factory=dict)
    points: PointObstacles = NO_POINTS
    wrenches: Mapping[str, Wrench] = field(default_factory=dict)
    gravity: np.ndarray | None = None
    gravity_ends_at: int = NEVER

    @cached_property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles, in the order of their arrival."""
        return tuple(item.obstacle for item in self.dynamic_obstacles.values())

    @cached_property
    def _next_change(self) -> int:
        ends = [wrench.ends_at for wrench in self.wrenches.values()]
        for item in self.dynamic_obstacles.values():
            ends += [item.stops_at, item.expires_at, item.arrives_at]
        return min([*ends, self.gravity_ends_at])

    @cached_property
    def _moves(self) -> bool:
        return not all(obstacle.is_still for obstacle in self.obstacles)

    @property
    def nbytes(self) -> int:
        """Approximate bytes of memory."""
        return (
            self.points.points.nbytes
            + 1000 * len(self.dynamic_obstacles)
            + 200 * len(self.wrenches)
        )

    def moved(self, h: float) -> ExternalInputs:
        """Return the inputs after h seconds: obstacles move with their velocities."""
        if not self._moves:
            return self
        dynamic_obstacles = dict(self.dynamic_obstacles)
        links = []
        for key, item in self.dynamic_obstacles.items():
            if is_link(key) and item.obstacle.moves:
                links.append(key)
            else:
                dynamic_obstacles[key] = item.moved(h)
        if not links:
            return dataclasses.replace(self, dynamic_obstacles=dynamic_obstacles)
        moving = [dynamic_obstacles[key].obstacle for key in links]
        for key, obstacle in zip(links, obstacles.moved_together(moving, h), strict=True):
            dynamic_obstacles[key] = dynamic_obstacles[key].with_obstacle(obstacle)
        return dataclasses.replace(self, dynamic_obstacles=dynamic_obstacles)

    def at(self, tick: int) -> ExternalInputs:
        """Return the inputs at the beginning of a tick, without what has expired."""
        if tick < self._next_change:
            return self
        dynamic_obstacles = {
            key: item.at(tick)
            for key, item in self.dynamic_obstacles.items()
            if tick < item.expires_at
        }
        wrenches = {name: item for name, item in self.wrenches.items() if tick < item.ends_at}
        result = dataclasses.replace(self, dynamic_obstacles=dynamic_obstacles, wrenches=wrenches)
        return result if tick < self.gravity_ends_at else result.with_gravity(None, NEVER)

    def reset(self, tick: int) -> ExternalInputs:
        """Return the inputs after a reset: deadlines count from tick 0, forces end."""
        dynamic_obstacles = {
            key: dataclasses.replace(
                item,
                stops_at=_earlier(item.stops_at, tick),
                expires_at=_earlier(item.expires_at, tick),
                arrives_at=_earlier(item.arrives_at, tick),
            )
            for key, item in self.dynamic_obstacles.items()
        }
        return ExternalInputs(dynamic_obstacles, self.points)

    def changed(
        self,
        changes: Iterable[ObstacleChange],
        tick: int,
        longest_gap: float,
        h: float,
    ) -> ExternalInputs:
        """
        Return the inputs with obstacles added, moved or removed.

        From two poses whose stamps are at most `longest_gap` apart a velocity is computed, with
        which the obstacle moves on for that time. Beyond `MOST_DYNAMIC_OBSTACLES` none is added.

        Parameters
        ----------
        changes : iterable of ObstacleUpdate, ObstaclePlacement and ObstacleRemoval
            in order
        tick : int
            the present one
        longest_gap : float
            largest difference of stamps for a velocity, s
        h : float
            s

        """
        dynamic_obstacles = dict(self.dynamic_obstacles)
        stops_at = tick + ticks_of(longest_gap, h)
        for change in changes:
            if isinstance(change, ObstacleRemoval):
                dynamic_obstacles = {
                    key: item for key, item in dynamic_obstacles.items() if not change.removes(key)
                }
            elif (
                change.key in dynamic_obstacles or len(dynamic_obstacles) < MOST_DYNAMIC_OBSTACLES
            ):
                before = dynamic_obstacles.get(change.key)
                dynamic_obstacles[change.key] = (
                    change.item
                    if isinstance(change, ObstaclePlacement)
                    else _placed(change, before, tick, stops_at, longest_gap)
                )
        return dataclasses.replace(self, dynamic_obstacles=dynamic_obstacles)

    def with_points(self, points: PointObstacles) -> ExternalInputs:
        """Return the inputs with other points."""
        return dataclasses.replace(self, points=points)

    def with_wrench(self, name: str, wrench: Wrench) -> ExternalInputs:
        """Return the inputs with another wrench on a body, or without if that is zero."""
        wrenches = {key: item for key, item in self.wrenches.items() if key != name}
        if wrench.force.any() or wrench.torque.any():
            wrenches[name] = wrench
        return dataclasses.replace(self, wrenches=wrenches)

    def with_gravity(self, gravity: np.ndarray | None, ends_at: int) -> ExternalInputs:
        """Return the inputs with a gravity override until a tick, or none."""
        return dataclasses.replace(self, gravity=gravity, gravity_ends_at=ends_at)

    def obstacles_changed_since(self, before: ExternalInputs) -> list[Obstacle]:
        """Return old and new versions of the obstacles that differ from earlier inputs."""
        mine, others = self.dynamic_obstacles, before.dynamic_obstacles
        if mine is others:
            return []
        changed = []
        for key in mine.keys() | others.keys():
            new, old = mine.get(key), others.get(key)
            if is_link(key) and new is not None and old is not None and new.continues(old):
                continue  # what it touches is awake as long as it moves
            if new is None or old is None or not new.equals(old):
                changed += [item.obstacle for item in (new, old) if item is not None]
        return changed


ObstacleChange: TypeAlias = ObstacleUpdate | ObstaclePlacement | ObstacleRemoval


def ticks_of(seconds: float, h: float) -> int:
    """Return a duration rounded to ticks of h seconds, at least one."""
    return max(round(seconds / h), 1)


def _placed(
    item: ObstacleUpdate,
    before: DynamicObstacle | None,
    tick: int,
    stops_at: int,
    longest_gap: float,
) -> DynamicObstacle:
    velocity = item.twist or _STILL
    if item.twist is None and before is not None:
        velocity = _velocity(before, item, longest_gap)
    obstacle = obstacles.placed(_moving(item.config, *velocity))
    if before is not None:
        obstacle = obstacles.continued(obstacle, before.obstacle)
    return DynamicObstacle(
        obstacle,
        item.stamp,
        stops_at if obstacle.moves else NEVER,
        tick + item.lifetime if item.lifetime else NEVER,
    )


def _twist_of(config: ObstacleConfig) -> Twist:
    return config.velocity_linear, config.velocity_angular


def _earlier(end: int, tick: int) -> int:
    return end if end == NEVER else end - tick


def _moving(
    config: ObstacleConfig, linear: tuple[float, ...], angular: tuple[float, ...]
) -> ObstacleConfig:
    if _twist_of(config) == (linear, angular):
        return config
    return dataclasses.replace(config, velocity_linear=linear, velocity_angular=angular)


def _velocity(
    before: DynamicObstacle, item: ObstacleUpdate, longest_gap: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the linear and angular velocity between two received poses, or zeros."""
    gap = 1e-9 * (item.stamp - before.stamp) * item.pace
    if not (before.stamp > 0 and 0.0 < gap <= longest_gap):
        return _STILL
    old, new = before.obstacle.config, item.config
    if (old.position, old.orientation) == (new.position, new.orientation):
        return _STILL
    linear = (np.array(new.position) - old.position) / gap
    change = Rotation.from_quat(new.orientation) * Rotation.from_quat(old.orientation).inv()
    angular = change.as_rotvec() / gap
    if max(np.abs(linear).max(), np.abs(angular).max()) > FASTEST:
        return _STILL  # not a motion: it was placed elsewhere
    return tuple(linear.tolist()), tuple(angular.tolist())
