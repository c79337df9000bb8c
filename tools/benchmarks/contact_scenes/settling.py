# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies that come to rest: on points, in heaps, on the ground."""

from __future__ import annotations

import math
import time as clock

import numpy as np
from scipy.spatial import cKDTree

from contact_scenes.analytic import GRAVITY
from contact_scenes.base import Measured, at_least, at_most, near, scene
from contact_scenes.observing import (
    GROUND,
    carried_by_ground,
    centre,
    fastest,
    rms_deformation,
    stepped,
    volume,
)
from softbody_ros.core import BodyConfig, ObstacleConfig, PointObstacles

CLOUD_POINTS, CLOUD_SIDE, POINT_RADIUS = 2600, 1.5, 0.02
"""Points at random in a square of that side, m, that push like spheres of that radius, m."""
CAMERA = 30
"""Clouds a second."""


def cloud(roughness=0.0):
    """Return points of a floor at random, (k, 3), m, with a standard deviation of height."""
    random = np.random.default_rng(0)
    plane = CLOUD_SIDE * (random.random((CLOUD_POINTS, 2)) - 0.5)
    return np.column_stack([plane, roughness * random.standard_normal(CLOUD_POINTS)])


@scene(frequencies=(None, 90), roughness=(0.0, 0.003))
def cloud_floor(case, roughness):
    """
    A cube lies on a still cloud of points.

    Edge 40 cm, μ 0.8, 2600 points at random in 1.5 m x 1.5 m, each a sphere of 2 cm; on a level
    floor, or with heights of a standard deviation of 3 mm. Creep: the change of its place from 3 s
    to 5 s; shoved: the farthest sideways that it has been.
    """
    height = 0.2 + POINT_RADIUS + 3 * roughness
    cube = case.body(mesh='box', size=0.2, friction=0.8, position=(0.0, 0.0, height))
    world = case.world([cube])
    world.set_points(PointObstacles(cloud(roughness), POINT_RADIUS))
    shoved, slept, early = 0.0, math.inf, None
    for time in stepped(world, case.seconds(5.0, 0.2)):
        shoved = max(shoved, np.linalg.norm(centre(world)[:2]))
        if time >= 3.0 and early is None:
            early = centre(world)
        if world.is_asleep('body'):
            slept = min(slept, time)
    creep = math.nan if early is None else np.linalg.norm(centre(world) - early) / 2
    return {
        'creep, mm/s': Measured(1e3 * float(creep), at_most(0.1)),
        'shoved, mm': Measured(1e3 * float(shoved), None if roughness else at_most(1.0)),
        'asleep after, s': Measured(slept, at_most(3.0)),
    }


@scene(frequencies=(None, 90))
def noisy_cloud(case):
    """
    A ball lies on what a noisy camera sees of a floor.

    R = 20 cm, μ 0.8; 30 times a second each of the 2600 points is put elsewhere, with a deviation
    of 2 mm along each axis. Drift: the distance covered in a minute, after 20 s, in which a
    soft ball rolls to and fro in its hollow and comes to rest.
    """
    ball = case.body(size=0.2, friction=0.8, position=(0.0, 0.0, 0.2 + POINT_RADIUS))
    world = case.world([ball])
    random, still = np.random.default_rng(1), cloud()
    every = max(case.hertz // CAMERA, 1)
    places = []
    for seconds in (20.0, 60.0):
        for _ in range(round(case.seconds(seconds, 0.5) * CAMERA)):
            noise = 0.002 * random.standard_normal(still.shape)
            world.set_points(PointObstacles(still + noise, POINT_RADIUS), noise=0.002)
            world.step(every)
        places.append(centre(world))
    drift = 100 * np.linalg.norm(places[1][:2] - places[0][:2])
    return {
        'drift, cm/min': Measured(float(drift), at_most(1.0)),
        'fastest, mm/s': Measured(1e3 * fastest(world)),
    }


@scene()
def drop(case):
    """
    The default ball falls by 1 m: an egg at impact, round at rest.

    RMS distance from the rest shape in % of R. Rebound: the highest that its lowest point gets.
    Weight: what the ground carries at rest.
    """
    default = BodyConfig(name='body', mode=case.mode)
    world = case.world([default], [GROUND])
    size = default.size
    impact, deepest, rebound, slept, fallen = 0.0, 0.0, 0.0, math.inf, False
    for time in stepped(world, case.seconds(10.0, 1.0)):
        low = world.positions('body')[:, 2].min()
        fallen = fallen or low < 1e-3 * size
        deepest = max(deepest, -low)
        if fallen and time < 2.0:
            impact = max(impact, rms_deformation(world))
            rebound = max(rebound, low)
        if world.is_asleep('body'):
            slept = time
            break
    soft = case.mode != 'rigid'
    weight = carried_by_ground(world, case.seconds(0.2)) / GRAVITY
    return {
        'RMS at impact, %': Measured(impact, at_least(10.0) if soft else at_most(1e-6)),
        'RMS at rest, %': Measured(rms_deformation(world), at_most(1.5)),
        'deepest, % of R': Measured(100 * deepest / size, at_most(0.01)),
        'rebound, m': Measured(float(rebound)),
        'volume at rest': Measured(volume(world)),
        'carried / m g': Measured(weight, near(1.0, 0.001)),
        'asleep after, s': Measured(slept, at_most(10.0)),
    }


@scene(floor=('open', 'walled'))
def pile(case, floor):
    """
    100 balls fall on each other, on an open floor or between walls.

    5 x 5 x 4 balls of 162 vertices, R = 50 cm, 1 kg, default settings, at a pitch of 1.02
    diameters and 1 m above the ground; walls leave 6 cm at each side. A tick in ms: the median
    from 1.5 s to 2.5 s. On the open floor that is the end, as balls roll away for ever; walled
    they come to rest, for which they have 15 s. Closest: of the centres, over a diameter, ever and
    at the end.
    """
    radius, layers = 0.5, (2, 2, 1) if case.quick else (5, 5, 4)
    pitch, middle = 1.02 * 2 * radius, (np.array(layers) - 1) / 2
    middle[2] = -(radius + 1.0) / pitch
    balls = [
        BodyConfig(name=f'ball{number}', size=radius, subdivisions=2, mode=case.mode,
                   position=tuple(pitch * (place - middle)))
        for number, place in enumerate(np.ndindex(layers))
    ]  # fmt: skip
    half_width = pitch * middle[0] + radius + 0.06
    world = case.world(balls, [GROUND, *(walls(half_width) if floor == 'walled' else ())])
    closest, times, slept = math.inf, [], math.inf
    for _ in range(round(60 * case.seconds(15.0 if floor == 'walled' else 2.5, 0.8))):
        begin = clock.perf_counter()
        ticks = max(case.hertz // 60, 1)
        world.step(ticks)
        if world.time > 1.5 or case.quick:
            times.append((clock.perf_counter() - begin) / ticks)
        closest = min(closest, _closest(world) / (2 * radius))
        if all(world.is_asleep(name) for name in world.names):
            slept = world.time
            break
    deepest = max(0.0, *(-world.positions(name)[:, 2].min() for name in world.names))
    measured = {
        'tick, ms': Measured(1e3 * float(np.median(times[:60]))),
        'closest ever': Measured(closest, at_least(0.85)),
        'closest at the end': Measured(_closest(world) / (2 * radius), at_least(0.9)),
        'deepest, % of R': Measured(100 * float(deepest) / radius, at_most(0.01)),
    }
    if floor == 'walled':
        quickest = max(fastest(world, name) for name in world.names)
        measured['fastest, mm/s'] = Measured(1e3 * quickest)
        measured['asleep after, s'] = Measured(slept, at_most(15.0))
    return measured


def walls(half_width):
    """Return four boxes around the z axis, 4 m high."""
    thickness = 0.1
    place, along = half_width + thickness, half_width + 2 * thickness
    return [
        ObstacleConfig(name=name, type='box', position=position, size=size)
        for name, position, size in (
            ('left', (-place, 0.0, 2.0), (thickness, along, 2.0)),
            ('right', (place, 0.0, 2.0), (thickness, along, 2.0)),
            ('front', (0.0, -place, 2.0), (along, thickness, 2.0)),
            ('back', (0.0, place, 2.0), (along, thickness, 2.0)),
        )
    ]


def _closest(world):
    centres = np.array([centre(world, name) for name in world.names])
    return cKDTree(centres).query(centres, 2)[0][:, 1].min()


@scene(steps=(60,))
def full_bin(case):
    """
    200 balls fill a bin, at 60 ticks a second.

    R = 10 cm, 162 vertices, 0.2 kg, μ 0.3, hardly above each other at the start; the bin is
    1 m x 1 m. A tick in ms: the median from 1 s
    to 3 s, and the largest of all.
    """
    radius, layers = 0.1, (4, 4, 1) if case.quick else (4, 4, 13)
    pitch, lowest = (0.24, 0.24, 0.22), (1.5, 1.5, -0.5)
    random = np.random.default_rng(2)
    balls = [
        case.body(name=f'ball{number}', size=radius, subdivisions=2, mass=0.2, friction=0.3,
                  position=tuple(np.subtract(place, lowest) * pitch + 0.01 * random.random(3)))
        for number, place in enumerate(list(np.ndindex(layers))[:200])
    ]  # fmt: skip
    world = case.world(balls, [GROUND, *walls(0.5)])
    times = []
    for _ in range(round(60 * case.seconds(3.0, 0.3))):
        begin = clock.perf_counter()
        world.step()
        times.append(1e3 * (clock.perf_counter() - begin))
    lost = sum(
        bool(np.abs(centre(world, name)[:2]).max() > 0.5 or centre(world, name)[2] < 0.0)
        for name in world.names
    )
    return {
        'tick from 1 s to 3 s, ms': Measured(float(np.median(times[60:180] or times)),
                                             at_most(1000 / 60)),
        'longest tick, ms': Measured(max(times)),
        'closest over 2 R': Measured(_closest(world) / (2 * radius), at_least(0.85)),
        'fastest, mm/s': Measured(1e3 * max(fastest(world, name) for name in world.names)),
        'lost': Measured(lost, at_most(0)),
    }  # fmt: skip
