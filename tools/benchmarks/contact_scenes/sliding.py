# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies that stick, slide, spin and roll on obstacles."""

from __future__ import annotations

import math

import numpy as np
import trimesh

from contact_scenes.analytic import (
    GRAVITY,
    angle_of_friction,
    friction_radius,
    rolling_acceleration,
    sliding_acceleration,
    stopping_time,
)
from contact_scenes.base import NO, Measured, at_most, near, scene
from contact_scenes.observing import (
    GROUND,
    about_y,
    centre,
    driven,
    kinetic_energy,
    run,
    stepped,
    tilt,
    velocity,
    weights,
)
from softbody_ros.core import ObstacleConfig, Surface, make_surface

EDGE = 0.2
"""Of the cubes, m."""
RADIUS = 0.2
"""Of the discs and balls, m."""
BELT_SPEED, BELT_FRICTION = 1.0, 0.3
"""m/s"""
TABLE_SPEED = 2.0
"""rad/s"""


class Slope:
    """A plane that descends along x by an angle, in degrees."""

    def __init__(self, degrees):
        self.orientation = about_y(degrees)
        angle = math.radians(degrees)
        self.normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
        self.downhill = np.array([math.cos(angle), 0.0, -math.sin(angle)])

    @property
    def ground(self):
        """The plane, through the origin."""
        return ObstacleConfig(name='ground', orientation=self.orientation)


@scene(frequencies=(20, 90), friction=(0.2, 0.5, 0.8))
def incline(case, friction):
    """
    A cube sticks or slides on a slope within 3° of the angle of friction.

    Edge 20 cm, on slopes of atan μ ± 1°, 2°, 3°. Below it should stick: creep is the change of
    its place from the second to the third second, the worst of three slopes; on so many of them
    it is less than 1 µm/s. Above it should slide with a = g (sin θ − μ cos θ), measured by the
    places after 1, 2 and 3 s: the worst error of three. It must not tumble: it has if it is tilted
    by more than 10°.
    """
    limit, creeps, errors, tilts = angle_of_friction(friction), [], [], []
    for above in (-3, 3) if case.quick else (-3, -2, -1, 1, 2, 3):
        slope = Slope(limit + above)
        place = tuple(EDGE / 2 * slope.normal)
        cube = case.body(mesh='box', size=EDGE / 2, friction=friction, position=place,
                         orientation=slope.orientation)  # fmt: skip
        world = case.world([cube], [slope.ground])
        places, second = [], case.seconds(1.0)
        for _ in range(3):
            run(stepped(world, second))
            places.append(centre(world) @ slope.downhill)
        tilts.append(tilt(world, normal=slope.normal))
        if above < 0:
            creeps.append(abs(places[2] - places[1]) / second)
        else:
            expected = sliding_acceleration(friction, limit + above)
            measured = (places[2] - 2 * places[1] + places[0]) / second**2
            errors.append(abs(measured / expected - 1))
    return {
        'creep, µm/s': Measured(1e6 * max(creeps), at_most(1.0)),
        'sticks on': Measured(sum(creep < 1e-6 for creep in creeps)),
        'error of a, %': Measured(100 * max(errors), at_most(1.0)),
        'tilt, °': Measured(max(tilts)),
        'tumbles': Measured(max(tilts) > 10.0, NO),
    }


@scene(frequencies=(None, 90))
def conveyor(case):
    """
    A cube at rest is taken along by a belt that starts to move at 1 m/s.

    Edge 40 cm, μ 0.3: it accelerates by μ g up to the speed of the belt.
    """
    belt = ObstacleConfig(name='belt', type='box', size=(20.0, 5.0, 0.5),
                          position=(0.0, 0.0, -0.5))  # fmt: skip
    cube = case.body(mesh='box', size=0.2, friction=BELT_FRICTION, position=(0.0, 0.0, 0.2))
    world = case.world([cube], [belt])
    run(stepped(world, case.seconds(1.0)))
    world.move_obstacle('belt', belt.position, linear=(BELT_SPEED, 0.0, 0.0))
    start, expected = centre(world)[0], BELT_FRICTION * GRAVITY
    times = np.array([], dtype=float)
    places = np.array([], dtype=float)
    for time in stepped(world, case.seconds(2.0, 0.4)):
        times, places = np.append(times, time), np.append(places, centre(world)[0] - start)
    early = times < 0.9 * BELT_SPEED / expected
    late = times > 0.9 * times[-1]
    return {
        'a, m/s²': Measured(2 * np.polyfit(times[early], places[early], 2)[0],
                            near(expected, 0.01)),
        'end speed, m/s': Measured(np.polyfit(times[late], places[late], 1)[0],
                                   near(BELT_SPEED, 0.01)),
    }  # fmt: skip


@scene(frequencies=(None, 90))
def turntable(case):
    """
    A cube lies 50 cm off the axis of a table that rotates at 2 rad/s.

    Edge 20 cm, μ 0.5 > ω² r / g = 0.2. Drift in the frame of the table, from 1 s to 11 s.
    """
    half = EDGE / 2
    table = ObstacleConfig(name='table', type='cylinder', size=(1.0, 1.0, 0.1),
                           position=(0.0, 0.0, -0.1),
                           velocity_angular=(0.0, 0.0, TABLE_SPEED))  # fmt: skip
    cube = case.body(mesh='box', size=half, position=(0.5, 0.0, half),
                     initial_velocity_linear=(0.0, 0.5 * TABLE_SPEED, 0.0),
                     initial_velocity_angular=(0.0, 0.0, TABLE_SPEED))  # fmt: skip
    world = case.world([cube], [table])

    def place():
        angle = -TABLE_SPEED * world.time
        x, y, _ = centre(world)
        return np.array([x * math.cos(angle) - y * math.sin(angle),
                         x * math.sin(angle) + y * math.cos(angle)])  # fmt: skip

    run(stepped(world, case.seconds(1.0)))
    start = place()
    run(stepped(world, case.seconds(10.0, 0.2)))
    return {'drift, mm': Measured(1e3 * float(np.linalg.norm(place() - start)), at_most(2.0))}


@scene(frequencies=(None, 90))
def elevator(case):
    """
    A cube stands on a floor that accelerates upwards by 2 m/s² for 1 s.

    It presses with m (g + a); on average from 0.5 s to 1 s.
    """
    floor = ObstacleConfig(name='ground', type='box', size=(1.0, 1.0, 0.1),
                           position=(0.0, 0.0, -0.1))  # fmt: skip
    cube = case.body(mesh='box', size=EDGE / 2, position=(0.0, 0.0, EDGE / 2))
    world = case.world([cube], [floor])
    run(stepped(world, case.seconds(1.0)))
    rising = driven(world, {'ground': lambda time: np.array([0.0, 0.0, time**2 - 0.1])}, 1.0)
    forces = [world.contact_wrench('body')[0][2] for time in rising if time > 0.5]
    return {'N / m (g + a)': Measured(float(np.mean(forces)) / (GRAVITY + 2.0), near(1.0, 0.01))}


RINGS = {'disc': 0.0, 'ring': 0.18}
"""Inner radii, m: of the narrow ring it is known where the pressure is."""


@scene(frequencies=(90,), shape=tuple(RINGS))
def disc(case, shape):
    """
    A disc, and a narrow ring, rotate on their flat face until friction stops them.

    R = 20 cm, 4 cm high, μ 0.3, 20 rad/s: t = I ω / (μ m g r), r = (2/3) (R³ − r³)/(R² − r²)
    under even pressure (2/3 of the time of the disc if its rim carried it). Moved: how far the
    centre has gone meanwhile.
    """
    inner, speed, friction = RINGS[shape], 20.0, 0.3
    if inner:
        ring = trimesh.creation.annulus(inner, RADIUS, 0.04, sections=64)
        surface = Surface(ring.vertices, ring.faces)
    else:
        cylinder = make_surface('cylinder', RADIUS, 2)
        surface = Surface(cylinder.vertices * (1.0, 1.0, 0.1), cylinder.faces)
    body = case.body(mesh=surface, friction=friction, position=(0.0, 0.0, 0.02),
                     initial_velocity_angular=(0.0, 0.0, speed))  # fmt: skip
    world = case.world([body], [GROUND])
    inertia = weights(world, 'body') @ np.sum(surface.vertices[:, :2] ** 2, axis=1)
    expected = stopping_time(inertia, speed, friction, friction_radius(RADIUS, inner))
    taken, angular_speed = math.nan, speed
    for time in stepped(world, case.seconds(3 * expected)):
        angular_speed = world.rigid_fit('body').angular_velocity[2]
        if angular_speed < 0.01 * speed:
            taken = time
            break
    moved = 1e3 * np.linalg.norm(centre(world)[:2])
    return {
        'time / analytic': Measured(taken / expected, near(1.0, 0.1)),
        'analytic, s': Measured(expected),
        'moved, mm': Measured(float(moved), at_most(5.0)),
    }


@scene(frequencies=(90, 300), degrees=(10, 0), subdivisions=(3, 5))
def rolling(case, degrees, subdivisions):
    """
    A ball rolls down a slope, or at 1 m/s on flat ground.

    R = 20 cm, μ 0.8, 642 or 10 242 vertices. Down a slope with a = g sin θ / (1 + 2/3), measured
    by the places after 0, 0.5 and 1 s. On the flat it must never gain energy, kinetic and of
    height, in % of the kinetic energy at the start; its speed varies with the height of the centre
    of a polyhedron. Heading: angle between what it has covered and downhill or its first
    direction.
    """
    slope = Slope(degrees)
    speed = 0.0 if degrees else 1.0
    ball = case.body(size=RADIUS, subdivisions=subdivisions, friction=0.8,
                     position=tuple(RADIUS * slope.normal), orientation=slope.orientation,
                     initial_velocity_linear=(speed, 0.0, 0.0),
                     initial_velocity_angular=(0.0, speed / RADIUS, 0.0))  # fmt: skip
    world = case.world([ball], [slope.ground])
    kinetic = kinetic_energy(world)
    places, energies = [centre(world)], [_energy(world)]
    for _ in range(2):
        for _ in stepped(world, case.seconds(0.5)):
            energies.append(_energy(world))
        places.append(centre(world))
    covered = places[2] - places[0]
    heading = math.degrees(math.atan2(abs(covered[1]), covered @ slope.downhill))
    measured = {}
    if degrees:
        time = round(case.seconds(0.5) / case.step) * case.step
        acceleration = (places[2] - 2 * places[1] + places[0]) @ slope.downhill / time**2
        target = near(rolling_acceleration(degrees), 0.01)
        measured['a, m/s²'] = Measured(acceleration, target if subdivisions == 5 else None)
    else:
        gain = (max(energies) - energies[0]) / kinetic
        measured['energy gained, %'] = Measured(100 * gain, at_most(1e-6))
        measured['end speed, m/s'] = Measured(float(np.linalg.norm(velocity(world))))
    return measured | {'heading, °': Measured(heading, at_most(1.0))}


def _energy(world):
    """Return the energy of a body, kinetic and of height, J."""
    return kinetic_energy(world) + world.body_config('body').mass * GRAVITY * centre(world)[2]
