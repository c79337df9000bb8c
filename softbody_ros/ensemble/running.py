# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
One run of many: a scene with other parameter values, as a film, and as arrays.

>>> film = run({'ball.subdivisions': 1}, {'ball.stiffness': 0.2}, seconds=0.5, fps=10)
>>> record(film).bodies['ball'].positions.shape
(6, 42, 3)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core import MeanWrenches
from softbody_ros.ensemble.film import Film
from softbody_ros.scene.parameters import make_scene


@dataclass(frozen=True)
class BodyRecord:
    """
    A body in all frames of a run.

    Attributes
    ----------
    faces : (m, 3) int
        triangles of the simulated surface
    positions : (frames, n, 3) float
        of its vertices, m
    pressure : (frames, n) float
        of contacts at the tick of each frame, Pa
    wrenches : (frames, 6) float
        force, N, and torque, N m, of all contacts at its centre of mass, world axes: the mean
        since the frame before
    poses : (frames, 7) float
        of the best rigid fit: position, m, and quaternion x y z w
    dents : (frames,) float
        RMS displacement from the best rigid fit, m
    asleep : (frames,) bool

    """

    faces: np.ndarray
    positions: np.ndarray
    pressure: np.ndarray
    wrenches: np.ndarray
    poses: np.ndarray
    dents: np.ndarray
    asleep: np.ndarray


@dataclass(frozen=True)
class Recording:
    """
    A run as arrays.

    Attributes
    ----------
    times : (frames,) float
        s
    ticks : (frames,) int
    bodies : dict of BodyRecord
    obstacle_wrenches : dict of (frames, 6) float
        force, N, and torque, N m, of all bodies on each obstacle, at its origin, in its axes: the
        mean since the frame before

    """

    times: np.ndarray
    ticks: np.ndarray
    bodies: dict[str, BodyRecord]
    obstacle_wrenches: dict[str, np.ndarray]


def run(
    scene: Mapping[str, Any], parameters: Mapping[str, Any], seconds: float, fps: float
) -> Film:
    """
    Return the film of a scene with other parameter values; it is simulated when it is iterated.

    Parameters
    ----------
    scene : mapping
        parameter values by their names, as `read_scene` returns them; missing ones are defaults
    parameters : mapping
        values that replace them
    seconds, fps : float
        length in simulated time, s, and frames in a simulated second

    Raises
    ------
    ConfigError, MeshError
        if a name is unknown, a value invalid, or a mesh cannot be used; with one sentence.

    """
    return Film(make_scene({**scene, **parameters}), seconds, fps)


def record(film: Film) -> Recording:
    """
    Simulate a film, and return it as arrays.

    Raises
    ------
    SimulationError
        if a number would not be finite.

    """
    world, count = film.world, len(film.times)
    means = MeanWrenches(world)
    obstacles = [obstacle.config.name for obstacle in world.obstacles]
    bodies = {
        name: BodyRecord(
            faces=(surface := film.surface(name)).faces,
            positions=np.empty((count, len(surface.vertices), 3)),
            pressure=np.empty((count, len(surface.vertices))),
            wrenches=np.empty((count, 6)),
            poses=np.empty((count, 7)),
            dents=np.empty(count),
            asleep=np.empty(count, dtype=bool),
        )
        for name in world.names
    }
    wrenches = {name: np.empty((count, 6)) for name in obstacles}
    for frame in film.frames():
        k = frame.index
        for name, body in bodies.items():
            fit = world.rigid_fit(name)
            body.positions[k] = frame.positions[name]
            body.pressure[k] = world.pressure(name)
            body.wrenches[k] = np.concatenate(means.contact_wrench(name))
            body.poses[k] = *fit.position, *Rotation.from_matrix(fit.rotation).as_quat()
            body.dents[k] = np.sqrt(np.mean(fit.displacement**2))
            body.asleep[k] = world.is_asleep(name)
        for name in obstacles:
            wrenches[name][k] = np.concatenate(means.obstacle_wrench(name))
    return Recording(film.times, film.ticks, bodies, wrenches)
