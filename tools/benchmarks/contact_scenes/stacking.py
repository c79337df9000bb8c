# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Boxes on boxes."""

from __future__ import annotations

import itertools
import math

import numpy as np

from contact_scenes.analytic import GRAVITY
from contact_scenes.base import YES, Measured, at_most, near, scene
from contact_scenes.observing import (
    GROUND,
    about_y,
    about_z,
    carried_by_ground,
    centre,
    cuboid,
    mean_contact_force,
    overlap,
    run,
    stepped,
    tilt,
)

HALF = 0.2
"""Half the edge of a box, m."""
GAP = 0.001
"""Between boxes at the start, m."""
CARD = (0.005, 0.1, 0.15)
"""Half extents of a card, m."""
BAR = (0.5, 0.1, 0.1)
"""Half extents of a bar, m."""
UPPER_EDGES, LOWER_EDGES = ((1, 5), (3, 7)), ((0, 4), (2, 6))
"""Vertices of the long edges of a bar."""
LEAN = 20.0
"""Of a card from the vertical, degrees: two stand while tan LEAN < 2 μ."""


@scene(frequencies=(90, 300), ratio=(1, 5, 10, 30, 100), offset=(0.0, 0.05))
def stack(case, ratio, offset):
    """
    A box lies on one of 1 kg that is `ratio` times lighter.

    Edges of 40 cm, μ 0.5, the upper one `offset` m off the middle; after 5 s. Overlap: how deep
    the deepest vertex of one is inside the other, or under the ground, in % of half an edge.
    Forces are relative to weights: of all contacts of the upper one, of the lower one, and what
    the ground carries. Whoever is upright has not moved sideways by more than 1 cm.
    """
    lower = case.body(name='lower', mesh='box', size=HALF, position=(0.0, 0.0, HALF))
    upper = case.body(name='upper', mesh='box', size=HALF, mass=ratio,
                      position=(offset, 0.0, 3 * HALF + GAP))  # fmt: skip
    world = case.world([lower, upper], [GROUND])
    run(stepped(world, case.seconds(4.5, 0.1)))
    seconds = case.seconds(0.25)
    forces = [mean_contact_force(world, name, seconds)[2] for name in world.names]
    ground = carried_by_ground(world, seconds)
    apart = centre(world, 'upper') - centre(world, 'lower') - (offset, 0.0, 2 * HALF)
    sunk = max(0.0, -min(world.positions(name)[:, 2].min() for name in world.names))
    deepest = max(overlap(world, 'upper', 'lower'), sunk)
    tilted = max(tilt(world, name) for name in world.names)
    upright = tilted < 45.0 and abs(apart[0]) < 0.01 and apart[2] > -HALF
    return {
        'upright': Measured(bool(upright), YES),
        'tilt, °': Measured(tilted, at_most(0.5)),
        'overlap, %': Measured(100 * deepest / HALF, at_most(1.0)),
        'on the upper / m g': Measured(forces[1] / (ratio * GRAVITY), near(1.0, 0.01)),
        'on the lower / m g': Measured(forces[0] / GRAVITY, near(1.0, 0.01)),
        'on the ground / m g': Measured(ground / ((1 + ratio) * GRAVITY), near(1.0, 0.01)),
        'asleep': Measured(world.is_asleep('upper'), YES),
    }


@scene(frequencies=(90, 300), count=(5, 10))
def tower(case, count):
    """
    Equal cubes stand on each other.

    Edges of 40 cm, 1 kg, μ 0.5, 5 s. Overlap as in `stack`, of neighbours; aside: the farthest
    that any has moved sideways.
    """
    cubes = [
        case.body(name=f'cube{i}', mesh='box', size=HALF, subdivisions=2,
                  position=(0.0, 0.0, (2 * i + 1) * HALF + i * GAP))
        for i in range(count)
    ]  # fmt: skip
    world = case.world(cubes, [GROUND])
    run(stepped(world, case.seconds(5.0)))
    names = world.names
    deepest = max(overlap(world, *pair) for pair in itertools.pairwise(names))
    aside = max(np.linalg.norm(centre(world, name)[:2]) for name in names)
    return {
        'tilt, °': Measured(max(tilt(world, name) for name in names), at_most(0.5)),
        'aside, mm': Measured(1e3 * float(aside), at_most(1.0)),
        'overlap, %': Measured(100 * deepest / HALF, at_most(1.0)),
        'asleep': Measured(all(world.is_asleep(name) for name in names), YES),
    }


@scene(frequencies=(90, 300), angle=(90, 45, 10))
def crossed(case, angle):
    """
    A bar lies across another one, of 8 vertices each.

    Bars of 100 x 20 x 20 cm, 1 kg each, μ 0.5, at an angle of so many degrees, after 5 s: no
    vertex of one is near the other, they touch with their edges. Overlap: of these where they
    cross, in % of half a width. Forces are relative to the weight.
    """
    bar, width = cuboid(BAR, 0), 2 * BAR[2]
    lower = case.body(name='lower', mesh=bar, position=(0.0, 0.0, width / 2))
    upper = case.body(name='upper', mesh=bar, orientation=about_z(angle),
                      position=(0.0, 0.0, 1.5 * width + GAP))  # fmt: skip
    world = case.world([lower, upper], [GROUND])
    run(stepped(world, case.seconds(4.5, 0.1)))
    force = mean_contact_force(world, 'upper', case.seconds(0.25))[2]
    lower, upper = world.positions('lower'), world.positions('upper')
    deepest = max(
        _height_over(lower[list(one)], upper[list(other)])
        for one, other in itertools.product(UPPER_EDGES, LOWER_EDGES)
    )
    aside = np.linalg.norm(centre(world, 'upper')[:2])
    return {
        'overlap, %': Measured(100 * deepest / BAR[2], at_most(1.0)),
        'aside, mm': Measured(1e3 * aside, at_most(1.0)),
        'tilt, °': Measured(tilt(world, 'upper'), at_most(0.5)),
        'on the upper / m g': Measured(force / GRAVITY, near(1.0, 0.01)),
        'asleep': Measured(world.is_asleep('upper'), YES),
    }


def _height_over(edge, other):
    """Return how far an edge (2, 3) is above another one where they cross, seen from above, m."""
    (start, end), (begin, stop) = edge, other
    ways = np.stack([end - start, begin - stop], axis=1)
    share, of_other = np.linalg.solve(ways[:2], (begin - start)[:2])
    return float(start[2] + share * ways[2, 0] - begin[2] + of_other * ways[2, 1])


@scene(modes=('rigid',), storeys=(1, 2))
def card_house(case, storeys):
    """
    Rigid cards lean against each other.

    Cards of 1 x 20 x 30 cm that lean by 20° in pairs, μ 0.5: a pair stands while tan 20° < 2 μ,
    as each card needs m g tan(20°)/2 of friction at its foot. Two storeys: two pairs, a card on
    top of them, and a pair on that. After 5 s, by how much the highest point has moved.
    """
    cards, half_width, height = [], *_pair_size()
    if storeys == 1:
        cards += _pair(case, 0, 0.0, 0.0)
    else:
        thickness = CARD[0]
        cards += _pair(case, 0, -half_width, 0.0) + _pair(case, 2, half_width, 0.0)
        roof = cuboid((2 * half_width, CARD[1], thickness), 3)
        cards.append(case.body(name='roof', mesh=roof, mass=0.1,
                               position=(0.0, 0.0, height + thickness)))  # fmt: skip
        cards += _pair(case, 4, 0.0, height + 2 * thickness)
    world = case.world(cards, [GROUND])

    def top():
        return max(world.positions(name)[:, 2].max() for name in world.names)

    start = top()
    run(stepped(world, case.seconds(5.0)))
    moved = 1e3 * abs(top() - start)
    asleep = all(world.is_asleep(name) for name in world.names)
    return {'top moved, mm': Measured(moved, at_most(2.0)), 'asleep': Measured(asleep, YES)}


def _pair_size():
    """Return how far the foot of a leaning card is from its upper edge, and its height, m."""
    thickness, _, length = CARD
    sine, cosine = math.sin(math.radians(LEAN)), math.cos(math.radians(LEAN))
    foot = 2 * thickness * cosine + 2 * length * sine
    return foot, 2 * thickness * sine + 2 * length * cosine


def _pair(case, number, x, z):
    """Return two cards with their feet at a height, whose upper edges meet above x."""
    width, height = _pair_size()
    card = cuboid(CARD, 3)
    return [
        case.body(
            name=f'card{number + (side > 0)}',
            mesh=card,
            mass=0.1,
            position=(x + side * width / 2, 0.0, z + height / 2),
            orientation=about_y(-side * LEAN),
        )
        for side in (-1, 1)
    ]
