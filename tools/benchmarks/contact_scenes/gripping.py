# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies between obstacles that close on them."""

from __future__ import annotations

import itertools
import math

import numpy as np

from contact_scenes.analytic import GRAVITY, grip_ratio
from contact_scenes.base import (
    NO,
    SOFT_MODES,
    YES,
    Measured,
    at_least,
    at_most,
    compare_growth,
    compare_steps,
    near,
    scene,
)
from contact_scenes.observing import (
    GROUND,
    about_y,
    centre,
    driven,
    fastest,
    mean_forces,
    rms_deformation,
    run,
    stepped,
    volume,
)
from softbody_ros.core import MeanWrenches, ObstacleConfig

RADIUS, MASS = 0.05, 0.2
"""Of the ball, m, kg."""
GAP = 0.002
"""Between the ball and what closes on it, m."""
FINGER = (0.01, 0.02, 0.03)
PLATE = (0.01, 0.2, 0.2)
"""Half extents, m."""
CLOSING = 0.05
"""Speed of each finger, m/s."""
LIFT, LIFT_TIME = 0.1, 2.0
"""m, s: with a cosine, so that at most 1.3 % of the weight is added."""
SAG = 0.75
"""Share of the lift by which a ball has risen at least that is held: at 20 Hz its centre sags by
1 to 2 cm when the ground does not support it any more."""
SHAKE, SHAKE_FREQUENCY = 0.5, 2.0
"""Acceleration over g, Hz."""
SIDES = {'left': -1.0, 'right': 1.0}


class Gripper:
    """
    Two boxes on either side of a ball along x.

    Parameters
    ----------
    half_extents : (3,) float
        of each, m
    height : float
        of their centres, m

    """

    def __init__(self, half_extents, height=0.0):
        self.half_extents, self.height = half_extents, height
        self.gap, self.offset = GAP, np.zeros(3)

    def _place(self, side, gap, offset):
        return offset + (side * (RADIUS + gap + self.half_extents[0]), 0.0, self.height)

    @property
    def obstacles(self):
        """The obstacles where they are before they move."""
        return [
            ObstacleConfig(
                name=name,
                type='box',
                size=self.half_extents,
                position=tuple(self._place(side, self.gap, self.offset)),
            )
            for name, side in SIDES.items()
        ]

    def brought(self, world, gap, speed):
        """Step while both are brought to a gap from the undeformed ball, < 0 if they squeeze."""
        start, self.gap = self.gap, gap
        seconds = abs(gap - start) / speed

        def path(side):
            return lambda time: self._place(
                side, start + (gap - start) * min(time / seconds, 1.0), self.offset
            )

        return driven(world, {name: path(side) for name, side in SIDES.items()}, seconds)

    def moved(self, world, motion, seconds):
        """Step while both are displaced by what a function of the time, s, returns, (3,), m."""
        start, self.offset = self.offset, self.offset + motion(seconds)

        def path(side):
            return lambda time: self._place(side, self.gap, start + motion(min(time, seconds)))

        return driven(world, {name: path(side) for name, side in SIDES.items()}, seconds)


def lifting(time):
    """Return how far fingers have risen, (3,), m."""
    return np.array([0.0, 0.0, 0.5 * LIFT * (1 - math.cos(math.pi * time / LIFT_TIME))])


def shaking(time):
    """Return how far fingers have gone sideways, along their faces, (3,), m."""
    rate = 2 * math.pi * SHAKE_FREQUENCY
    return np.array([0.0, SHAKE * GRAVITY / rate**2 * (1 - math.cos(rate * time)), 0.0])


def compare_grips(rows):
    """Compare the forces of the grips of different steps and different squeezes."""
    compare_steps(rows, 'N closed, N', 0.02)
    compare_growth(rows, 'N closed, N', 'squeeze')


@scene(
    frequencies=(20, 90, 300),
    compare=compare_grips,
    friction=(0.8, 0.3),
    squeeze=(0.02, 0.04, 0.1, 0.2, 0.4),
)
def gripper(case, friction, squeeze):
    """
    Two fingers squeeze a ball, lift it, hold it and shake it.

    A ball of R = 5 cm and 0.2 kg on the ground; the fingers, 2 x 4 x 6 cm, come to squeeze R on
    each side. N is the mean of the normal forces of both, after they have closed and while they
    hold the lifted ball. A load 2 μ N / (m g) with the N when the ground carries least, or first
    nothing, decides whether the ball must be lifted (> 1.05) or must not (< 0.95): on the ground a
    soft ball is wider than between the fingers. It is lifted if it goes most of the way, as where
    it hangs in its own shape it sags, softer ones more. Then: slip relative to the fingers in 20 s
    and after 2 s of shaking along their faces by 0.5 g, which 2 μ N > m g √(1 + 0.5²) survives.
    A rigid ball cannot be squeezed: only the smallest squeezes are tried.
    """
    if case.mode == 'rigid' and squeeze > 0.04:
        return None
    gripper = Gripper(FINGER, RADIUS)
    ball = case.body(size=RADIUS, mass=MASS, friction=friction, position=(0.0, 0.0, RADIUS))
    world = case.world([ball], [GROUND, *gripper.obstacles])
    run(gripper.brought(world, -squeeze * RADIUS, CLOSING))
    run(stepped(world, case.seconds(0.3)))
    left, right = mean_forces(world, SIDES, stepped(world, case.seconds(0.2)))
    closed = 0.5 * (right[0] - left[0])
    measured = {
        'N closed, N': Measured(closed),
        'left / right': Measured(-left[0] / right[0] if right[0] else math.nan, near(1.0, 0.01)),
    }
    height = centre(world)[2]
    lift = gripper.moved(world, lifting, case.seconds(LIFT_TIME, 0.5))
    run(itertools.islice(lift, case.hertz // 5))
    load = _least_load(world, lift, friction, case.hertz // 20)
    rise = (centre(world)[2] - height) / LIFT
    held = rise > SAG
    must = YES if load > 1.05 else NO if load < 0.95 else None
    measured |= {
        '2 μ N / (m g)': Measured(load),
        'rise / lift': Measured(rise),
        'lifted': Measured(bool(held), must),
    }
    if not held:
        return measured
    run(stepped(world, case.seconds(0.2)))
    height = centre(world)[2]
    run(stepped(world, case.seconds(20.0, 0.1)))
    slip = 1e3 * abs(centre(world)[2] - height)
    asleep = world.is_asleep('body')
    left, right = mean_forces(world, SIDES, stepped(world, case.seconds(0.2)))
    held_force = 0.5 * (right[0] - left[0])
    measured |= {
        'slip in 20 s, mm': Measured(slip, at_most(0.1)),
        'asleep': Measured(asleep, YES),
        'N held, N': Measured(held_force),
    }
    before = centre(world)
    run(gripper.moved(world, shaking, case.seconds(2.0)))
    run(stepped(world, case.seconds(0.5)))
    shift = 1e3 * np.linalg.norm(centre(world) - before)
    enough = grip_ratio(friction, held_force, MASS, GRAVITY * math.hypot(1.0, SHAKE)) > 1.05
    measured['shaken off, mm'] = Measured(float(shift), at_most(0.5) if enough else None)
    return measured


def _least_load(world, lift, friction, ticks):
    """Take a lift, and return 2 μ N / (m g), for N in the ticks when the ground carries least."""
    load, least, none = math.nan, math.inf, 0.01 * MASS * GRAVITY
    while True:
        means, taken = MeanWrenches(world), 0
        for _ in itertools.islice(lift, max(ticks, 2)):
            taken += 1
        if taken == 0:
            return load
        left, right, ground = (means.obstacle_wrench(name)[0] for name in (*SIDES, 'ground'))
        if least > none and -ground[2] < least:
            least = -ground[2]
            load = grip_ratio(friction, 0.5 * (right[0] - left[0]), MASS)


SIX_SIDES = {
    'xl': ((-1.0, 0.0, 0.0), (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))),
    'xr': ((1.0, 0.0, 0.0), (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5))),
    'yl': ((0.0, -1.0, 0.0), (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))),
    'yr': ((0.0, 1.0, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))),
    'zl': ((0.0, 0.0, -1.0), (0.0, 0.0, 0.0, 1.0)),
    'zr': ((0.0, 0.0, 1.0), about_y(180.0)),
}
"""Planes around the origin by name: where each is, and how +z is put to point inwards."""


@scene(
    frequencies=(90,),
    squeezed=('fingers 2 %', 'fingers 20 %', 'plates 99 %', 'planes 10 %'),
)
def infeasible(case, squeezed):
    """
    What cannot yield is squeezed.

    Without gravity, a ball of R = 5 cm between two fingers, two plates or six planes that close by
    a share of R at 5 cm/s, stay for 0.5 s and open again. Thrown sideways: the largest distance of
    the centre from the axis on which they close, of six planes from where it was; that along the
    axis is of shapes that bulge more at one plate than at the other. Speed: 0.5 s after. The force
    of the first obstacle is taken each tick while they stay; left / right compares its mean with
    that of the opposite one.
    """
    kind, share = squeezed.split()[0], float(squeezed.split()[1]) / 100
    ball = case.body(size=RADIUS, mass=MASS)
    if kind == 'planes':
        world, squeeze, names = _six_planes(case, ball)
    else:
        gripper = Gripper(FINGER if kind == 'fingers' else PLATE)
        world = case.world([ball], gripper.obstacles, gravity=0.0)
        names = list(SIDES)

        def squeeze(gap):
            return gripper.brought(world, gap, CLOSING)

    centres, forces = [], []
    for _ in squeeze(-share * RADIUS):
        centres.append(centre(world))
    for _ in range(max(round(case.seconds(0.5) / case.step), 2)):
        forces.append(mean_forces(world, names[:2], stepped(world, case.step)))
        centres.append(centre(world))
    left, right = np.abs(np.array(forces)[:, :, 0]).T
    for _ in squeeze(0.01):
        centres.append(centre(world))
    run(stepped(world, case.seconds(0.5)))
    thrown = np.array([*centres, centre(world)])
    sideways = thrown if kind == 'planes' else thrown[:, 1:]
    return {
        'thrown sideways, mm': Measured(_longest(sideways), at_most(1.0)),
        'along the axis, mm': Measured(_longest(thrown[:, :1])),
        'N, N': Measured(float(left.mean())),
        'left / right': Measured(_ratio(left.mean(), right.mean()), near(1.0, 1e-6)),
        'N, deviation / mean': Measured(_ratio(left.std(), left.mean()), at_most(0.01)),
        'speed afterwards, mm/s': Measured(1e3 * fastest(world), at_most(1.0)),
        'RMS afterwards, %': Measured(rms_deformation(world), at_most(0.1)),
    }


def _longest(ways):
    """Return the largest length of ways (n, k), m, in mm."""
    return 1e3 * float(np.linalg.norm(ways, axis=1).max())


def _ratio(value, other):
    return float(value / other) if other else math.nan


def _six_planes(case, ball):
    """Return a world of a ball in six planes, what brings these to a gap, and their names."""
    gap = GAP

    def place(side, gap):
        return (RADIUS + gap) * np.array(side)

    planes = [
        ObstacleConfig(name=name, position=tuple(place(side, gap)), orientation=orientation)
        for name, (side, orientation) in SIX_SIDES.items()
    ]
    world = case.world([ball], planes, gravity=0.0)

    def squeeze(end):
        nonlocal gap
        start, gap = gap, end
        seconds = abs(end - start) / CLOSING

        def path(side):
            return lambda time: place(side, start + (end - start) * min(time / seconds, 1.0))

        paths = {name: path(side) for name, (side, _) in SIX_SIDES.items()}
        return driven(world, paths, seconds)

    return world, squeeze, list(SIX_SIDES)


def compare_plates(rows):
    """Compare the forces of plates at different squeezes and steps."""
    compare_steps(rows, 'N, N', 0.02)
    compare_growth(rows, 'N, N', 'squeeze')


@scene(modes=SOFT_MODES, compare=compare_plates, squeeze=(0.1, 0.3, 0.5, 0.7))
def plates(case, squeeze):
    """
    Two plates squeeze a ball of default stiffness and let it go.

    Without gravity, R = 5 cm, 0.2 kg; each plate comes to squeeze R at 2 cm/s and stays for 1 s.
    Volume and width across, both relative to those at rest; the speed of the fastest particle
    while the plates stay; the RMS distance from the rest shape, in % of R, 2 s after they begin to
    open.
    """
    gripper = Gripper(PLATE)
    ball = case.body(size=RADIUS, mass=MASS)
    world = case.world([ball], gripper.obstacles, gravity=0.0)
    run(gripper.brought(world, -squeeze * RADIUS, 0.5 if case.quick else 0.02))
    run(stepped(world, case.seconds(0.8)))
    left, right = mean_forces(world, SIDES, stepped(world, case.seconds(0.2)))
    across = np.ptp(world.positions('body')[:, 1:], axis=0).min() / (2 * RADIUS)
    bulge = at_least(1.2) if squeeze == 0.5 else None
    measured = {
        'volume': Measured(volume(world), near(1.0, 0.01)),
        'bulge': Measured(float(across), bulge),
        'N, N': Measured(0.5 * (right[0] - left[0])),
        'left / right': Measured(-_ratio(left[0], right[0]), near(1.0, 0.01)),
        'fastest, mm/s': Measured(1e3 * fastest(world), at_most(1.0)),
    }
    opening = (squeeze * RADIUS + GAP) / 0.1
    run(gripper.brought(world, GAP, 0.1))
    run(stepped(world, max(case.seconds(2.0) - opening, case.step)))
    measured['RMS released, %'] = Measured(rms_deformation(world), at_most(0.1))
    return measured
