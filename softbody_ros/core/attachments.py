# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Attachments: what of a body an obstacle takes hold of, and how the body moves with it.

A suction cup, a glued pad, a soft finger tip on a rigid link: the particles keep their offsets in
the frame of the obstacle, as pins that it moves, see `shape_matching.pins`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softbody_ros.core.collision.obstacles import Obstacle, is_same
from softbody_ros.core.config import BodyConfig, ConfigError, shown, unknown_name
from softbody_ros.core.contact_forces import ObstacleKey, name_of_obstacle
from softbody_ros.core.shape_matching.pins import Pins, attached_pins, particles_of
from softbody_ros.core.shape_matching.rest_shape import RestShape, weighted_mean
from softbody_ros.core.state import Body, State

FAR = 0.5
"""Displacement of what is held by an obstacle that is placed elsewhere, in RMS radii, beyond which
that is no motion: then the body is placed with it, as it is."""


def attach(
    config: BodyConfig,
    rest: RestShape,
    positions: np.ndarray,
    obstacles: Sequence[Obstacle],
    keys: Sequence[ObstacleKey],
) -> Pins:
    """
    Return the pins by which an obstacle holds a body from now on.

    Parameters
    ----------
    config : BodyConfig
    rest : RestShape
    positions : (n, 3) float
        of the surface, m
    obstacles : sequence of Obstacle
    keys : sequence
        of these, see `World.obstacle_keys`

    Raises
    ------
    ConfigError
        if there is no such obstacle, or nothing is in its reach.

    """
    prefix = f'{config.prefix}attach'
    holding = _rows_of(config, obstacles, keys)
    chosen = np.zeros(rest.surface_count, dtype=bool)
    chosen[particles_of(prefix, config.attach_indices, config.attach_box, rest)] = True
    if config.attach_radius:
        distance = np.min([obstacles[row].closest(positions)[0] for row in holding], axis=0)
        chosen |= distance <= config.attach_radius
        if not chosen.any():
            raise ConfigError(
                f'{prefix}.radius is {config.attach_radius:g}: no vertex is so near to '
                f'{config.attach_to}, the nearest one is {distance.min():.3g} m away'
            )
    holder, particle = obstacles[holding[0]], np.flatnonzero(chosen)
    offset = (positions[particle] - holder.position) @ holder.rotation
    return attached_pins(particle, keys[holding[0]], offset, config, rest)


def _rows_of(
    config: BodyConfig, obstacles: Sequence[Obstacle], keys: Sequence[ObstacleKey]
) -> list[int]:
    """
    Return which obstacles have the name that a body is to be attached to.

    That of the config; else, of those received, what `namespace/id` names; else all of a link.
    """
    names = [name_of_obstacle(key) for key in keys[: len(obstacles)]]  # the last one is of points
    wanted = config.attach_to
    links = [obstacle.config.name for obstacle in obstacles]
    rows = [row for row, name in enumerate(names) if name == wanted]
    rows = rows or [row for row, name in enumerate(links) if name == wanted]
    if not rows:
        raise ConfigError(
            f'{config.prefix}attach.to is {shown(wanted)}, but there is no such obstacle: '
            f'{unknown_name(wanted, names)}'
        )
    return rows


class Holders:
    """
    The obstacles that hold bodies of a world at present, and how these follow them.

    Parameters
    ----------
    bodies : sequence of Body
    state : State
        of these bodies; `holder` of their records and, when one is placed elsewhere with its
        obstacle, positions and velocities are changed

    """

    def __init__(self, bodies: Sequence[Body], state: State) -> None:
        self._bodies, self._state = bodies, state
        self._present: dict[int, Obstacle | None] = {
            index: None
            for index, body in enumerate(bodies)
            if body.pins is not None and body.pins.offset is not None
        }

    def __bool__(self) -> bool:
        return bool(self._present)

    def follow(
        self, obstacles: Sequence[Obstacle], keys: Sequence[ObstacleKey], placed: bool
    ) -> tuple[list[int], list[int]]:
        """
        Find the obstacles as they are now; bodies lose the pins of those that are there no more.

        Parameters
        ----------
        obstacles : sequence of Obstacle
        keys : sequence
            of these, see `World.obstacle_keys`
        placed : bool
            whether they have been placed elsewhere, and did not move there in a tick

        Returns
        -------
        moved : list of int
            bodies whose obstacle has another pose or velocity
        lost : list of int
            bodies whose pins are gone

        """
        moved, lost = [], []
        for index, before in self._present.items():
            pins = self._bodies[index].pins
            if pins is None or pins.holder not in keys:
                self._bodies[index].pins = None
                lost.append(index)
                continue
            row = keys.index(pins.holder)
            self._state.bodies['holder'][index] = row
            self._present[index] = obstacle = obstacles[row]
            if before is not None and before is not obstacle and not is_same(before, obstacle):
                moved.append(index)
                if placed:
                    self._carry(index, pins, before, obstacle)
        return moved, lost

    def _carry(self, index: int, pins: Pins, before: Obstacle, after: Obstacle) -> None:
        """Place a body with the obstacle that holds it, if that has not just moved a little."""
        body, distance = self._bodies[index], _displacement(pins, before, after)
        if distance > (0.0 if body.config.mode == 'rigid' else FAR * body.rest.scale):
            x, v = self._state.positions(index), self._state.velocities(index)
            rotation = after.rotation @ before.rotation.T
            arms = rotation @ (x - before.position[:, None])
            x[:], v[:] = arms + after.position[:, None], rotation @ v

    def fixed_and_driven(self) -> tuple[np.ndarray, np.ndarray]:
        """Return which bodies have pins at rest, and which moving ones, (B,) bool."""
        fixed, driven = np.zeros((2, len(self._bodies)), dtype=bool)
        for index, body in enumerate(self._bodies):
            if body.pins is not None:
                holder = self._present.get(index)
                driven[index] = body.pins.moves or (
                    holder is not None and (holder.moves or holder.before is not None)
                )
                fixed[index] = not driven[index]
        return fixed, driven

    def load(self, index: int, h: float) -> None:
        """Let a body that falls asleep go on to weigh on the obstacle that holds it; h in s."""
        holder = self._present.get(index)
        if holder is not None:
            body = self._bodies[index]
            centre = weighted_mean(self._state.positions(index).T, body.rest.weights)
            force, torque = self._state.holding[index]
            moment = torque + np.cross(centre - holder.position, force)
            mass = self._state.bodies['mass'][index]
            self._state.holder_impulse[index] = -h * mass * np.stack([force, moment])


def _displacement(pins: Pins, before: Obstacle, after: Obstacle) -> float:
    """Return how far an obstacle has been moved, m, at what it holds."""
    if pins.offset is None:
        return 0.0
    change = pins.offset @ (after.rotation - before.rotation).T + after.position - before.position
    return float(np.linalg.norm(change, axis=1).max())
