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

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.config import BodyConfig, ConfigError, unknown_name
from softbody_ros.core.contact_forces import ObstacleKey
from softbody_ros.core.shape_matching.pins import Pins, attached_pins, particles_of
from softbody_ros.core.shape_matching.rest_shape import RestShape

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
        m
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
    chosen = np.zeros(rest.particle_count, dtype=bool)
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
    names: list[str] = []
    for key, obstacle in zip(keys, obstacles, strict=False):  # the last key is that of points
        names.append(f'{key[0]}/{key[1]}' if isinstance(key, tuple) else obstacle.config.name)
    wanted = config.attach_to
    links = [obstacle.config.name for obstacle in obstacles]
    rows = [row for row, name in enumerate(names) if name == wanted]
    rows = rows or [row for row, name in enumerate(links) if name == wanted]
    if not rows:
        raise ConfigError(
            f'{config.prefix}attach.to is {wanted!r}, but there is no such obstacle: '
            f'{unknown_name(wanted, names)}'
        )
    return rows


def carried(
    positions: np.ndarray, velocities: np.ndarray, before: Obstacle, after: Obstacle
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities (3, n) that are placed elsewhere with an obstacle."""
    rotation = after.rotation @ before.rotation.T
    arms = rotation @ (positions - before.position[:, None])
    return arms + after.position[:, None], rotation @ velocities


def displacement(pins: Pins, before: Obstacle, after: Obstacle) -> float:
    """Return how far an obstacle has been moved, m, at what it holds."""
    if pins.offset is None:
        return 0.0
    change = pins.offset @ (after.rotation - before.rotation).T + after.position - before.position
    return float(np.linalg.norm(change, axis=1).max())
