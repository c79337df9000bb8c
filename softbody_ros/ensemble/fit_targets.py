# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What of an observation is fitted: bodies, times, points, and whether vertices are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softbody_ros.core import World
from softbody_ros.core.config import unknown_name
from softbody_ros.ensemble.film import LONGEST
from softbody_ros.ensemble.fit_parameters import Unknown
from softbody_ros.ensemble.fit_problem import Problem, Target
from softbody_ros.ensemble.observation import ANY_BODY, Observation, ObservationError
from softbody_ros.scene.parameters import make_scene

MOST_POINTS = 6000
MOST_FRAMES = 1000
NOISE = {True: 0.001, False: 0.003}
"""Default standard deviation, m: of points with known vertices, and of a camera."""


@dataclass(frozen=True)
class Choice:
    """
    What of an observation is fitted.

    Attributes
    ----------
    body : str, optional
        the only one that is compared
    correspondence : bool, optional
        whether points are the vertices of bodies, in order; None: if their number is that
    begin, end : float
        times in the scene, s
    offset : float
        of the times of the observation, s
    noise : float, optional
        standard deviation, m; None: `NOISE`
    seed : int
        of the choice of points, where there are too many

    """

    body: str | None = None
    correspondence: bool | None = None
    begin: float = 0.0
    end: float = LONGEST
    offset: float = 0.0
    noise: float | None = None
    seed: int = 0


def make_problem(
    scene: Mapping[str, Any], unknowns: Sequence[Unknown], observation: Observation, choice: Choice
) -> Problem:
    """
    Return what is to be fitted.

    Raises
    ------
    ObservationError
        if the observation does not fit the scene, or nothing of it is chosen.
    ConfigError, MeshError
        if the scene is impossible.

    """
    world = World(make_scene(dict(scene)).world)
    frames = _chosen_frames(observation.times, choice)
    parts = _parts(world.names, observation, choice)
    clouds = {name: [observation.clouds[name][k] for k in frames] for name in parts}
    total = sum(len(_finite(cloud)) for each in clouds.values() for cloud in each)
    if not total:
        raise ObservationError('the observation has no points in the chosen time')
    share, random = min(1.0, MOST_POINTS / total), np.random.default_rng(choice.seed)
    targets = []
    for name, bodies in parts.items():
        rows = [_sample(cloud, share, random) for cloud in clouds[name]]
        points = [cloud[each] for cloud, each in zip(clouds[name], rows, strict=True)]
        targets.append(
            Target(
                bodies,
                np.repeat(np.arange(len(frames)), [len(each) for each in rows]),
                np.concatenate(points),
                np.concatenate(rows)
                if _corresponds(world, bodies, clouds[name], choice)
                else None,
            )
        )
    noise = choice.noise or NOISE[all(target.vertices is not None for target in targets)]
    times = observation.times[frames] + choice.offset
    return Problem(dict(scene), tuple(unknowns), times, tuple(targets), noise)


def _chosen_frames(times: np.ndarray, choice: Choice) -> np.ndarray:
    """Return the indices of the frames in the chosen time, thinned evenly if they are many."""
    own = times + choice.offset
    begin, end = max(choice.begin, 0.0), min(choice.end, LONGEST)
    frames = np.flatnonzero((own >= begin - 1e-9) & (own <= end + 1e-9))
    if not len(frames):
        raise ObservationError(
            f'the observation lasts from {own[0]:g} to {own[-1]:g} s of the scene, and none of it '
            f'is from {begin:g} to {end:g} s: choose with --from, --to and --time-offset'
        )
    if len(frames) > MOST_FRAMES:
        frames = frames[np.linspace(0, len(frames) - 1, MOST_FRAMES).round().astype(int)]
    return frames


def _parts(
    names: Sequence[str], observation: Observation, choice: Choice
) -> dict[str, tuple[str, ...]]:
    """Return the keys of the clouds that are compared, and with which bodies each."""
    body = choice.body
    if body is not None and body not in names:
        raise ObservationError(f'--body {body} is not in the scene: {unknown_name(body, names)}')
    seen = [name for name in observation.clouds if name != ANY_BODY]
    parts: dict[str, tuple[str, ...]] = {
        name: (name,) for name in seen if name in names and body in (None, name)
    }
    if ANY_BODY in observation.clouds:
        parts[ANY_BODY] = tuple(names) if body is None else (body,)
    if not parts:
        wanted = body if body is not None else ', '.join(names) or 'no body'
        raise ObservationError(
            f'the observation is of {", ".join(seen)}, and the scene or --body says {wanted}: '
            'give a scene with bodies of the same names'
        )
    return parts


def _corresponds(
    world: World, bodies: Sequence[str], clouds: Sequence[np.ndarray], choice: Choice
) -> bool:
    """Whether the points are the vertices of the bodies."""
    if choice.correspondence is False:
        return _unknown(world, bodies)
    count = sum(len(world.positions(name)) for name in bodies)
    other = next((len(cloud) for cloud in clouds if len(cloud) not in (0, count)), None)
    if other is None:
        return True
    if choice.correspondence:
        raise ObservationError(
            f'a cloud has {other} points, but {", ".join(bodies)} has {count} vertices: make '
            'the mesh of the scene that of the observation, or take --correspondence no'
        )
    return _unknown(world, bodies)


def _unknown(world: World, bodies: Sequence[str]) -> bool:
    """Return False; raise ObservationError if a body has no surface to compare with."""
    for name in bodies:
        if not len(world.visual_surface(name).faces):
            raise ObservationError(
                f'{name} has no triangles: its points can only be compared as vertices, and their '
                'number is another'
            )
    return False


def _finite(cloud: np.ndarray) -> np.ndarray:
    """Return the indices of the points of a cloud that are numbers."""
    return np.flatnonzero(np.isfinite(cloud).all(axis=1))


def _sample(cloud: np.ndarray, share: float, random: np.random.Generator) -> np.ndarray:
    """Return ascending indices of a share of the points of a cloud that are numbers."""
    rows = _finite(cloud)
    if share == 1.0 or not len(rows):
        return rows
    return np.sort(random.choice(rows, max(1, int(share * len(rows))), replace=False))
