# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The comparison of a run with an observation: a pure function of the parameters.

A point of known vertex is compared with the position of that vertex. Any other point is compared
with the nearest point of the surfaces of the bodies that it may belong to: a camera sees a part of
them, so there is no distance from the surface to the points. That distance is signed, negative
inside, so that it is smooth where a point crosses the surface. Between ticks, positions are
interpolated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softbody_ros.core import ConfigError, MeshError, SimulationError, Surface, World
from softbody_ros.core.geometry.bvh import make_tree
from softbody_ros.ensemble.fit_parameters import Unknown, fitted_values, offset_of
from softbody_ros.scene.parameters import make_scene

ON_TICK = 1e-6
"""Times nearer to a tick than this share of it are those of the tick."""


@dataclass(frozen=True)
class Target:
    """
    Points of some bodies.

    Attributes
    ----------
    bodies : tuple of str
        to which they may belong
    frames : (n,) int
        of each point, ascending
    points : (n, 3) float
        m
    vertices : (n,) int, optional
        of each point, in the vertices of all these bodies in this order

    """

    bodies: tuple[str, ...]
    frames: np.ndarray
    points: np.ndarray
    vertices: np.ndarray | None = None


@dataclass(frozen=True)
class Problem:
    """
    What is to be reproduced, and by what.

    Attributes
    ----------
    scene : dict
        parameter values
    unknowns : tuple of Unknown
    times : (frames,) float
        of the frames, ascending, s
    targets : tuple of Target
    noise : float
        standard deviation of a coordinate of a point, m

    """

    scene: dict[str, Any]
    unknowns: tuple[Unknown, ...]
    times: np.ndarray
    targets: tuple[Target, ...]
    noise: float


@dataclass(frozen=True)
class Match:
    """
    The points of a target beside the simulation.

    Attributes
    ----------
    nearest : (n, 3) float
        for each point of the target that of the simulation, m
    residuals : (k,) float
        signed distances, or differences of each coordinate, m

    """

    nearest: np.ndarray
    residuals: np.ndarray


@dataclass(frozen=True)
class Outcome:
    """
    What came of a run: residuals (n,) in units of the noise, or None and why there are none.

    The sentence is the exception's.
    """

    residuals: np.ndarray | None
    failure: str = field(default='', compare=False)


def evaluate(problem: Problem, coordinates: np.ndarray) -> Outcome:
    """Run the scene at coordinates (p,) of the unknowns; what fails is an outcome, too."""
    try:
        parts = [match.residuals for match in matches(problem, coordinates)]
    except (ConfigError, MeshError, SimulationError) as error:
        return Outcome(None, str(error))
    residuals = np.concatenate(parts) / problem.noise
    if not np.isfinite(residuals).all():
        return Outcome(None, 'the simulation is not finite')
    return Outcome(residuals)


def matches(problem: Problem, coordinates: np.ndarray) -> list[Match]:
    """
    Run the scene at coordinates (p,) of the unknowns, and return the match of each target.

    Raises
    ------
    ConfigError, MeshError, SimulationError
        if the scene is impossible.

    """
    scene = make_scene(fitted_values(problem.scene, problem.unknowns, coordinates))
    world = World(scene.world)
    times = problem.times + offset_of(problem.unknowns, coordinates)
    nearest = [np.empty_like(target.points) for target in problem.targets]
    distance = [np.empty(len(target.points)) for target in problem.targets]
    faces = [_faces(world, target.bodies) for target in problem.targets]
    for frame, positions in enumerate(_states(world, times)):
        for k, target in enumerate(problem.targets):
            begin, end = np.searchsorted(target.frames, [frame, frame + 1])
            rows = slice(begin, end)
            if begin == end:
                continue
            if target.vertices is not None:
                every = np.concatenate([positions[name] for name in target.bodies])
                nearest[k][rows] = every[target.vertices[rows]]
                continue
            shown = np.concatenate(
                [world.visual_positions(name, positions[name]) for name in target.bodies]
            )
            away, normal = make_tree(Surface(shown, faces[k])).distance(target.points[rows])
            nearest[k][rows] = target.points[rows] - away[:, None] * normal
            distance[k][rows] = away
    return [
        Match(near, (target.points - near).ravel() if target.vertices is not None else away)
        for target, near, away in zip(problem.targets, nearest, distance, strict=True)
    ]


def _states(world: World, times: np.ndarray) -> Iterator[dict[str, np.ndarray]]:
    """Yield the positions of the particles of all bodies at times, s, those before 0 at 0."""
    clock = np.maximum(times / world.config.time_step, 0.0)
    before = np.floor(clock + ON_TICK).astype(np.int64)
    share = np.where(clock - before > ON_TICK, clock - before, 0.0)
    states: dict[int, dict[str, np.ndarray]] = {}

    def at(tick: int) -> dict[str, np.ndarray]:
        if tick not in states:
            world.step(tick - world.tick)
            states[tick] = {name: world.positions(name) for name in world.names}
        return states[tick]

    for tick, part in zip(before.tolist(), share.tolist(), strict=True):
        states = {each: state for each, state in states.items() if each >= tick}
        here = at(tick)
        if part:
            there = at(tick + 1)
            yield {name: x + part * (there[name] - x) for name, x in here.items()}
        else:
            yield here


def _faces(world: World, bodies: tuple[str, ...]) -> np.ndarray:
    """Return the faces (m, 3) of the surfaces by which bodies are shown, in common vertices."""
    parts, start = [], 0
    for name in bodies:
        surface = world.visual_surface(name)
        parts.append(surface.faces + start)
        start += len(surface.vertices)
    return np.concatenate(parts)
