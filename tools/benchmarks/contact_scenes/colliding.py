# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies that meet an obstacle or each other fast, and bodies in flight."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from contact_scenes.analytic import GRAVITY, flip_period
from contact_scenes.base import (
    SOFT_MODES,
    YES,
    Measured,
    at_most,
    compare_growth,
    near,
    scene,
)
from contact_scenes.observing import (
    GROUND,
    centre,
    cuboid,
    kinetic_energy,
    momentum,
    run,
    stepped,
    velocity,
    weights,
)
from softbody_ros.core import ObstacleConfig

SIZE = 0.2
"""Radius or half edge, m."""
DROP = 1.0
"""m"""
LITTLE = 1e-9
"""What rounding may add to an energy, relative to it."""


def compare_rebounds(rows):
    """Compare the heights of the rebounds with different elasticities."""
    compare_growth(rows, 'rebound / drop', 'elasticity')


@scene(
    compare=compare_rebounds,
    mesh=('icosphere', 'box'),
    elasticity=(0.0, 0.5, 0.8, 1.0),
)
def bounce(case, mesh, elasticity):
    """
    A ball on a vertex, or a box on a face, falls by 1 m and rebounds.

    R or half an edge 20 cm. The apex by height and velocity, max(z + ż²/2g), over the drop: ε² of
    rigid bodies, and never more than 1.
    """
    body = case.body(mesh=mesh, size=SIZE, elasticity=elasticity,
                     position=(0.0, 0.0, DROP + SIZE))  # fmt: skip
    world = case.world([body], [GROUND])
    apex, fallen = 0.0, False
    for _ in stepped(world, 0.6 if case.quick else 1.2):
        speed = velocity(world)[2]
        fallen = fallen or centre(world)[2] < SIZE + 0.1 * DROP
        if fallen and speed > 0.0:
            apex = max(apex, centre(world)[2] - SIZE + speed**2 / (2 * GRAVITY))
    rebound = float(apex) / DROP
    target = at_most(1.0 + LITTLE)
    if case.mode == 'rigid':
        expected = elasticity**2
        target = near(expected, 0.005) if expected else at_most(0.005)
    return {'rebound / drop': Measured(rebound, target)}


def conserved(world, seconds):
    """
    Step a world without gravity and compare its momenta and energy with those at the start.

    The energy is the kinetic one: that of deformation is not negative, so that no more than at
    the start is necessary.
    """
    (linear, angular), energy = momentum(world), kinetic_energy(world)
    change, angular_change, most = 0.0, 0.0, 0.0
    for _ in stepped(world, seconds):
        now = momentum(world)
        change = max(change, np.abs(now[0] - linear).max())
        angular_change = max(angular_change, np.abs(now[1] - angular).max())
        most = max(most, kinetic_energy(world) / energy)
    return {
        'Δ momentum, kg m/s': Measured(float(change), at_most(1e-12)),
        'Δ angular momentum, N m s': Measured(float(angular_change), at_most(1e-9)),
        'energy gained, %': Measured(100 * float(most - 1.0), at_most(100 * LITTLE)),
        'energy at the end, %': Measured(100 * kinetic_energy(world) / energy),
    }


@scene(elasticity=(1.0, 0.5))
def cradle(case, elasticity):
    """
    A ball hits the first of four in a row, without gravity.

    R = 20 cm, 1 kg, ε = 1 or less, 1 m/s, the four 1 mm apart. With ε = 1 a rigid last one leaves
    with all of the velocity and the others stay, as far as polyhedra are balls: to 5 %.
    """
    places = [-0.1 - SIZE, *(SIZE + (2 * SIZE + 0.001) * i for i in range(4))]
    balls = [
        case.body(name=f'ball{i}', size=SIZE, elasticity=elasticity, friction=0.0,
                  position=(place, 0.0, 0.0),
                  initial_velocity_linear=(float(not i), 0.0, 0.0))
        for i, place in enumerate(places)
    ]  # fmt: skip
    world = case.world(balls, gravity=0.0)
    measured = conserved(world, case.seconds(1.5, 0.3))
    speeds = [velocity(world, name)[0] for name in world.names]
    exact = case.mode == 'rigid' and elasticity == 1.0
    return {
        'speed of the last, m/s': Measured(speeds[-1], near(1.0, 0.05) if exact else None),
        'fastest other, m/s': Measured(
            max(abs(speed) for speed in speeds[:-1]), at_most(0.05) if exact else None
        ),
    } | measured


OFFSETS = {'faces': (0.0, 0.0), 'head-on': (0.0, 0.0), 'oblique': (0.12, 0.05)}
"""Of the first body from the line on which the second one comes, m."""


@scene(impact=tuple(OFFSETS), elasticity=(0.0, 0.5, 1.0))
def collision(case, impact, elasticity):
    """
    Two cubes meet with their faces, or two balls, at 3 m/s, without gravity.

    R or half edges of 20 and 15 cm, 1 and 0.7 kg, μ 0.3; the first one rotates at 3 rad/s if they
    meet off the middle. Separation: the speed with which the centres part over that with which
    they came: ε of rigid cubes, and of balls, as far as polyhedra are, to 5 %.
    """
    mesh = 'box' if impact == 'faces' else 'icosphere'
    y, z = OFFSETS[impact]
    rotation = 3.0 if impact == 'oblique' else 0.0
    balls = [
        case.body(name='first', mesh=mesh, size=0.2, elasticity=elasticity, friction=0.3,
                  position=(-0.3, y, z), initial_velocity_linear=(2.0, 0.0, 0.0),
                  initial_velocity_angular=(0.0, rotation, rotation)),
        case.body(name='second', mesh=mesh, size=0.15, mass=0.7, elasticity=elasticity,
                  friction=0.3, position=(0.3, 0.0, 0.0),
                  initial_velocity_linear=(-1.0, 0.0, 0.0)),
    ]  # fmt: skip
    world = case.world(balls, gravity=0.0)
    measured = conserved(world, case.seconds(1.0, 0.2))
    separation = (velocity(world, 'second') - velocity(world, 'first'))[0] / 3.0
    target = None
    if case.mode == 'rigid' and impact != 'oblique':
        share = 0.005 if impact == 'faces' else 0.05
        target = near(elasticity, share) if elasticity else at_most(share)
    return {'separation': Measured(separation, target)} | measured


@scene(speed=(20.0, 5.0))
def bullet(case, speed):
    """
    A ball flies against a wall of 2 cm.

    R = 5 cm, without gravity. Behind: how far the foremost particle has ever been behind the face
    that it meets, in % of R; it must not get through.
    """
    wall = ObstacleConfig(name='wall', type='box', size=(0.01, 1.0, 1.0),
                          position=(0.01, 0.0, 0.0))  # fmt: skip
    ball = case.body(size=0.05, position=(-0.3, 0.013, 0.007),
                     initial_velocity_linear=(speed, 0.0, 0.0))  # fmt: skip
    world = case.world([ball], [wall], gravity=0.0)
    foremost = max(world.positions('body')[:, 0].max() for _ in stepped(world, 0.6 / speed + 0.1))
    return {
        'behind the face, %': Measured(max(100 * float(foremost) / 0.05, 0.0), at_most(0.01)),
        'comes back': Measured(bool(velocity(world)[0] <= 1e-3 * speed), YES),
    }


@scene(frequencies=(300,))
def tumbling(case):
    """
    A near-rigid box tumbles about its middle axis at 50 rad/s, in flight.

    Half edges 0.2, 0.12, 0.06 m. The time between reversals of the rotation about that axis, over
    that of Euler's equations; the change of the angular momentum.
    """
    surface = cuboid((0.06, 0.12, 0.2), 2)  # the moments decrease from x to z
    angular = np.array([0.5, 50.0, 0.5])
    box = case.body(mesh=surface, bounciness=1.0, initial_velocity_angular=tuple(angular))
    world = case.world([box], gravity=0.0)
    squares = weights(world, 'body') @ surface.vertices**2
    inertia = squares.sum() - squares
    expected = flip_period(inertia[::-1], angular[::-1])
    before, (_, start) = angular[1], momentum(world)
    reversals = []
    for time in stepped(world, (1.6 if case.quick else 4.6) * expected):
        fit = world.rigid_fit('body')
        now = fit.rotation[:, 1] @ fit.angular_velocity
        if now * before < 0.0:
            reversals.append(time - case.step * now / (now - before))
        before = now
    period = float(np.mean(np.diff(reversals))) if len(reversals) > 1 else math.nan
    change = np.abs(momentum(world)[1] - start).max() / np.linalg.norm(start)
    return {
        'period / Euler': Measured(period / expected, near(1.0, 0.02)),
        'Euler, s': Measured(expected),
        'Δ angular momentum, relative': Measured(float(change), at_most(1e-9)),
    }


@scene(modes=SOFT_MODES, frequencies=(None, 90), motion=('linear', 'angular'))
def release(case, motion):
    """
    A ball whose one half is held and moved is let go.

    R = 20 cm, without gravity; the held vertices move at 1 m/s, or besides rotate at 2 rad/s about
    their centre, for 2 s. Just after they are free the centre moves as if all were rigid.
    """
    linear = np.array([1.0, 0.0, 0.5])
    angular = np.array([0.0, 0.0, 2.0 if motion == 'angular' else 0.0])
    ball = case.body(size=SIZE, pins_box=(-SIZE, -SIZE, -SIZE, SIZE, SIZE, 0.0),
                     pins_velocity_linear=tuple(linear),
                     pins_velocity_angular=tuple(angular))  # fmt: skip
    world = case.world([ball], gravity=0.0)
    held = world.positions('body')[:, 2] <= 1e-9
    run(stepped(world, case.seconds(2.0, 0.2)))
    arm = centre(world) - world.positions('body')[held].mean(axis=0)
    expected = linear + np.cross(angular, arm)
    free = dataclasses.replace(ball, pins_box=(0.0,) * 6)
    world.configure(dataclasses.replace(world.config, bodies=(free,)))
    velocities = [velocity(world) for _ in stepped(world, case.seconds(0.5))]
    first, last = velocities[0], velocities[-1]
    speed = np.linalg.norm(expected)
    measured = {
        'error of the velocity, %': Measured(
            100 * float(np.linalg.norm(first - expected) / speed), at_most(1.0)
        ),
        'change in flight, %': Measured(
            100 * float(np.linalg.norm(last - first) / speed), at_most(1e-9)
        ),
    }
    if angular.any():
        ratio = world.rigid_fit('body').angular_velocity[2] / angular[2]
        measured['angular velocity / held'] = Measured(float(ratio), near(1.0, 0.01))
    return measured
