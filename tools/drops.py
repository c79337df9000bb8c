# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many bodies of one shape dropped side by side, stepped as one batch and observed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
import itertools
import math

import kernels as matching
import numpy as np

from softbody_ros.core import BodyConfig, SimulationError, WorldConfig
from softbody_ros.core.shape_matching.gains import damping_ratio
from softbody_ros.core.shape_matching.material import natural_frequency
from softbody_ros.core.shape_matching.polar_decomposition import rotation

GRAVITY = 9.81
RADIUS = 0.5
HEIGHT = 1.0
"""How far the balls fall, m."""
STIFFNESS = (0.05, 0.2, 0.5, 1.0)
BOUNCINESS = (0.0, 0.5, 0.9, 1.0)
DEFORMATION = (0.0, 0.5, 0.9)
ELASTICITY = (0.0, 0.5, 1.0)
SOFT_MODES = ('linear', 'quadratic')
TILT = (0.1, 0.2, 0.3, 0.9274)
"""An orientation in which no symmetry of the mesh meets the ground."""


def grid(
    modes=SOFT_MODES,
    stiffness=STIFFNESS,
    bounciness=BOUNCINESS,
    deformation=DEFORMATION,
    elasticity=ELASTICITY,
):
    """Return the parameters of each body of the grid, as dicts; to a rigid one few matter."""
    names = ('mode', 'stiffness', 'bounciness', 'deformation', 'elasticity')
    soft = itertools.product(
        [mode for mode in modes if mode != 'rigid'],
        stiffness,
        bounciness,
        deformation,
        elasticity,
    )
    bodies = [dict(zip(names, values, strict=True)) for values in soft]
    if 'rigid' in modes:
        bodies += [{'mode': 'rigid', 'elasticity': value} for value in elasticity]
    return bodies


def drop_config(bodies, height=HEIGHT, h=1 / 240, subdivisions=3, **common):
    """Return the config of balls that fall by `height` on the ground, far from each other."""
    common = {'size': RADIUS, 'subdivisions': subdivisions, 'orientation': TILT} | common
    across = math.ceil(math.sqrt(len(bodies)))
    balls = tuple(
        BodyConfig(
            name=f'ball{i}',
            position=(10.0 * (i % across), 10.0 * (i // across), RADIUS + height),
            **common,
            **parameters,
        )
        for i, parameters in enumerate(bodies)
    )
    return WorldConfig(time_step=h, gravity_magnitude=GRAVITY, bodies=balls)


def decay_rate(config, reference_step):
    """Return ζω of the slowest deformation that a body can have, 1/s: 0 without damping."""
    softest = natural_frequency((1.0 - config.deformation) * config.stiffness, reference_step)
    return damping_ratio(config.bounciness) * softest


@dataclass(frozen=True)
class Observation:
    """
    What is measured on B bodies at one moment.

    Attributes
    ----------
    height : (B,) float
        of the centre of mass, m
    climb : (B,) float
        how much higher than now the centre of mass gets if nothing touches the body, m
    energy : (B,) float
        kinetic and potential, per weight, m; without the elastic energy, which is not negative
    rms : (B,) float
        RMS distance from the rest shape at its best pose, relative to the RMS radius
    depth : (B,) float
        how deep the lowest particle is under the ground, m

    """

    height: np.ndarray
    climb: np.ndarray
    energy: np.ndarray
    rms: np.ndarray
    depth: np.ndarray


def positions(world):
    """Return the positions (B, 3, n) of bodies that share one shape."""
    return np.stack([world.positions(name).T for name in world.names])


def velocities(world):
    """Return the velocities (B, 3, n) of bodies that share one shape."""
    return np.stack([world.velocities(name).T for name in world.names])


def observe(world):
    """Return the Observation of a world whose bodies share one shape."""
    rest = world.rest_shape(world.names[0])
    x, v = positions(world), velocities(world)
    centre, moment = matching.moments(x, rest, 3)
    goal = matching.goals(centre, rotation(moment), rest)
    drift = v @ rest.weights
    return Observation(
        height=centre[:, 2],
        climb=np.maximum(drift[:, 2], 0.0) ** 2 / (2.0 * GRAVITY),
        energy=centre[:, 2] + np.sum(v**2, axis=1) @ rest.weights / (2.0 * GRAVITY),
        rms=np.sqrt(np.sum((x - goal) ** 2, axis=1) @ rest.weights) / rest.scale,
        depth=np.maximum(-x[:, 2].min(axis=1), 0.0),
    )


def fall(world, seconds, every=1):
    """
    Step a world and observe it, `every` ticks.

    Returns
    -------
    Observation
        each of its arrays with the time as first axis, the state before the first tick included
    bool
        whether the world could be stepped to the end: a number that is not finite stops it

    """
    observations = [observe(world)]
    finite = True
    for _ in range(round(seconds / world.config.time_step / every)):
        try:
            world.step(every)
        except SimulationError:
            finite = False
            break
        observations.append(observe(world))
    columns = zip(*(dataclasses.astuple(each) for each in observations), strict=True)
    return Observation(*(np.stack(column) for column in columns)), finite


def residual_speed(world):
    """Return (B,): how fast the fastest particle of each body gets on in one tick, m/s."""
    before = positions(world)
    world.step()
    after = positions(world)
    return np.linalg.norm(after - before, axis=1).max(axis=1) / world.config.time_step


def without_gravity(world):
    """Turn gravity off in a running world."""
    world.configure(dataclasses.replace(world.config, gravity_magnitude=0.0))
