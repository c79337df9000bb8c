# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A config whose bodies and obstacles may be others than those of a world, with their meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softbody_ros.core.body_shape import BodyShape
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.config import BodyConfig, ObstacleConfig, WorldConfig, settings

BYTES = 1000
"""Approximate memory of a config besides its items, and of one of these without its lists."""
BYTES_OF_INDEX = 40
"""Of a Python integer in a tuple."""


@dataclass(frozen=True, eq=False)
class PreparedConfig:
    """
    All that `World.adopt` needs to use a config: immutable, so an action of a history.

    Attributes
    ----------
    config : WorldConfig
    shapes : mapping of str to BodyShape
        of the bodies that are new in it
    obstacles : mapping of str to Obstacle
        that are new in it
    nbytes : int
        approximate bytes of memory that only this takes

    """

    config: WorldConfig
    shapes: Mapping[str, BodyShape]
    obstacles: Mapping[str, Obstacle]
    nbytes: int


def list_bytes(config: BodyConfig | ObstacleConfig) -> int:
    """Return the approximate memory of the lists of indices in a config."""
    lists = (getattr(config, field) for field, _, facts in settings(config) if facts.items)
    return BYTES_OF_INDEX * sum(map(len, lists))
