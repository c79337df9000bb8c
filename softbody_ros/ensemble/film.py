# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A film: the world of a scene, sampled at a frame rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from softbody_ros.core import ConfigError, ObstacleConfig, Surface, World
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.scene.parameters import Scene

LONGEST = 86400.0
"""Longest film, s."""


@dataclass(frozen=True)
class Frame:
    """
    The world at one tick.

    Attributes
    ----------
    index : int
        from 0
    positions : dict of (n, 3) float
        of the particles of each body, m
    pictures : dict of (k, 3) float
        of the vertices of the surface by which each body is shown, m
    obstacles : dict of Obstacle

    """

    index: int
    positions: dict[str, np.ndarray]
    pictures: dict[str, np.ndarray]
    obstacles: dict[str, Obstacle]


@dataclass(frozen=True)
class Film:
    """
    Frame k shows the tick nearest to the time k / fps: nothing is interpolated.

    The first frame is the start, the last one is that nearest to `seconds`.

    Raises
    ------
    ConfigError
        if the frame rate exceeds that of the ticks, or the film is too long.
    MeshError
        if a mesh of the scene cannot be used.

    """

    scene: Scene
    seconds: float
    fps: float
    world: World = field(init=False)

    def __post_init__(self) -> None:
        require_rate(self.seconds, self.fps, self.scene.world.time_step)
        object.__setattr__(self, 'world', World(self.scene.world))

    @property
    def times(self) -> np.ndarray:
        """(frames,) float: s."""
        return np.arange(round(self.seconds * self.fps) + 1) / self.fps

    @property
    def ticks(self) -> np.ndarray:
        """(frames,) int: the tick that each frame shows."""
        return np.rint(self.times / self.scene.world.time_step).astype(np.int64)

    def surface(self, body: str) -> Surface:
        """Return the simulated surface of a body; its faces are those of every frame."""
        return self.world.rest_shape(body).surface

    def picture(self, body: str) -> Surface:
        """Return the surface by which a body is shown; its faces are those of every frame."""
        return self.world.visual_surface(body)

    def color(self, body: str) -> tuple[float, ...]:
        """Return red, green, blue and alpha as in the scene, sRGB."""
        return self.scene.appearances[body].color

    def frames(self) -> Iterator[Frame]:
        """
        Yield the frames in order while the world is stepped.

        Raises
        ------
        SimulationError
            if a number would not be finite.

        """
        world = self.world
        for index, tick in enumerate(self.ticks.tolist()):
            world.step(tick - world.tick)
            positions = {name: world.positions(name) for name in world.names}
            pictures = {
                name: world.visual_positions(name, each) for name, each in positions.items()
            }
            standing = {item.config.name: item for item in world.obstacles}
            yield Frame(index, positions, pictures, standing)

    def plane_reach(self, plane: ObstacleConfig) -> float:
        """Return half the side of the square that represents an infinite plane, m."""
        reach = 0.0
        for body in self.scene.world.bodies:
            away = np.abs(np.subtract(body.position, plane.position)).max()
            reach = max(reach, float(away + 10.0 * np.abs(self.picture(body.name).vertices).max()))
        return reach


def require_rate(seconds: float, fps: float, time_step: float) -> None:
    """
    Check the length of a film, s, and its frame rate, 1/s, for ticks of a length, s.

    Raises
    ------
    ConfigError
        if the frame rate exceeds that of the ticks, or the film is too long.

    """
    if not 0.0 <= seconds <= LONGEST:
        raise ConfigError(f'seconds is {seconds:g}: it must be from 0 to {LONGEST:g}')
    # 1 / (1/240) is slightly below 240 in floating point
    ticks = round(1.0 / time_step, 6)
    if not 0.0 < fps <= ticks:
        raise ConfigError(
            f'fps is {fps:g}: it must be above 0 and at most {ticks:g}, the ticks of the scene in '
            'a second; for more give a smaller time_step'
        )
