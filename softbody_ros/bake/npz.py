# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Films as NumPy archives with the exact float64 state; `np.load` reads them.

Of bodies that are shown by another surface they have the simulated one: `Embedding` gives that of
any frame, exactly.

| array | type and shape | |
|---|---|---|
| fps | float | frames in a simulated second |
| times | float (frames,) | of the frames, s |
| ticks | int (frames,) | of the frames |
| time_step | float | one tick, s |
| bodies, obstacles | str (any,) | their names |
| NAME.positions | float (frames, vertices, 3) | of the vertices of a body, m, z up |
| NAME.faces | int (triangles, 3) | vertex indices, anticlockwise seen from outside |
| NAME.color | float (4,) | red green blue alpha, for the screen (sRGB) |
| NAME.type, NAME.size | str, float (3,) | of an obstacle, as in the scene |
| NAME.position | float (frames, 3) | of an obstacle, m |
| NAME.rotation | float (frames, 3, 3) | of an obstacle: its axes as columns |
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softbody_ros.ensemble.film import Film, Frame


class NpzWriter:
    """Collects all frames, float64, and writes them at the end."""

    def __init__(self, path: Path, film: Film) -> None:
        self._path = path
        world, count = film.world, len(film.times)
        self._arrays: dict[str, Any] = {
            'fps': film.fps,
            'times': film.times,
            'ticks': film.ticks,
            'time_step': world.config.time_step,
            'bodies': np.array(world.names, dtype=str),
            'obstacles': np.array([item.config.name for item in world.obstacles], dtype=str),
        }
        for name in world.names:
            surface = film.surface(name)
            self._arrays[f'{name}.positions'] = np.empty((count, *surface.vertices.shape))
            self._arrays[f'{name}.faces'] = surface.faces
            self._arrays[f'{name}.color'] = np.array(film.color(name))
        for item in world.obstacles:
            name = item.config.name
            self._arrays[f'{name}.type'] = item.config.type
            self._arrays[f'{name}.size'] = np.array(item.config.size)
            self._arrays[f'{name}.position'] = np.empty((count, 3))
            self._arrays[f'{name}.rotation'] = np.empty((count, 3, 3))

    def add(self, frame: Frame) -> None:
        """Take a frame."""
        for name, positions in frame.positions.items():
            self._arrays[f'{name}.positions'][frame.index] = positions
        for name, obstacle in frame.obstacles.items():
            self._arrays[f'{name}.position'][frame.index] = obstacle.position
            self._arrays[f'{name}.rotation'][frame.index] = obstacle.rotation

    def finish(self) -> None:
        """Write the file."""
        np.savez(self._path, **self._arrays)
