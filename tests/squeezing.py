# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Things of 10 cm that plates squeeze, and what plates feel of elastic ones."""

import numpy as np

from softbody_ros.core import BodyConfig, ObstacleConfig, World, WorldConfig

RADIUS = 0.05


def plate(name, z):
    sizes = (4 * RADIUS, 4 * RADIUS, RADIUS)
    return ObstacleConfig(name=name, type='box', size=sizes, position=(0, 0, z))


def forces_of_plates(strains, h, seconds=0.5, **values):
    """
    Return the forces on a lower and an upper plate that squeeze without friction, N, (n, 2).

    Parameters
    ----------
    strains : (n,) float
        by which, one after the other
    h : float
        time step, s
    seconds : float
        at each of them
    values
        of the body

    """
    values = {'friction': 0.0, 'bounciness': 0.0, 'density': 1000.0, 'subdivisions': 2} | values
    thing = BodyConfig(name='thing', size=RADIUS, position=(0, 0, 0), **values)
    plates = plate('lower', -2 * RADIUS), plate('upper', 2 * RADIUS)
    world = World(
        WorldConfig(time_step=h, gravity_magnitude=0.0, bodies=(thing,), obstacles=plates)
    )
    found, before = [], 0.0
    for strain in strains:
        for depth in RADIUS * np.linspace(before, strain, 10):
            world.move_obstacle('lower', (0, 0, depth - 2 * RADIUS))
            world.move_obstacle('upper', (0, 0, 2 * RADIUS - depth))
            world.step(max(1, round(0.004 / h)))
        world.step(round(seconds / h))
        before = strain
        lower, upper = (world.obstacle_wrench(name)[0][2] for name in ('lower', 'upper'))
        found.append([-lower, upper])
    return np.array(found)


def hertz(modulus, strain):
    """Return the force on a plate that dents a ball of Poisson's ratio 1/2 by a strain, N."""
    return 4 / 3 * modulus / 0.75 * RADIUS**2 * strain**1.5  # 4/3 E / (1 − ν²) √R δ^(3/2)


def cube(modulus, strain):
    """Return the force on plates that squeeze a cube by a strain, N: E A ε."""
    return modulus * (2 * RADIUS) ** 2 * strain
