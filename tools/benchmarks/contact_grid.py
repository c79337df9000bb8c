# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The worst that happens to balls dropped by 1 m, over a grid of parameters, as a table.

python3 tools/benchmarks/contact_grid.py [--resolution] [--steps]
"""

import argparse
from pathlib import Path
import sys

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

from drops import HEIGHT, drop_config, fall, grid, residual_speed, without_gravity  # noqa: E402
import numpy as np  # noqa: E402

from softbody_ros.core import World  # noqa: E402

MODES = ('linear', 'quadratic', 'rigid')
SECONDS, AFTERWARDS = 10.0, 5.0
IMPACT = 1.0
"""When the first impact is over, s."""


def measured(bodies):
    """Return measurements by name, each with one value for each body."""
    world = World(drop_config(bodies))
    drop, finite = fall(world, SECONDS)
    speed = residual_speed(world)
    without_gravity(world)
    free, finite_too = fall(world, AFTERWARDS)
    ticks = round(1.0 / world.config.time_step)
    early = round(IMPACT * ticks)
    apex = (drop.height + drop.climb)[round(0.44 * ticks) :].max(axis=0)
    return {
        'rebound above the start, % of the drop': 100 * (apex - drop.height[0]) / HEIGHT,
        'energy gain, % of the drop': 100 * (drop.energy.max(axis=0) - drop.energy[0]) / HEIGHT,
        'stopped by a non-finite number': np.full(len(bodies), float(not (finite and finite_too))),
        'RMS at impact, %': 100 * drop.rms[:early].max(axis=0),
        'RMS after 10 s, %': 100 * drop.rms[-1],
        'speed after 10 s, mm/s': 1e3 * speed,
        'RMS 5 s without gravity, %': 100 * free.rms[-1],
        'oscillation without gravity, last s / first s': free.rms[-ticks:].max(axis=0)
        / np.maximum(free.rms[:ticks].max(axis=0), 1e-9),
        'deepest particle ever, mm': 1e3 * drop.depth.max(axis=0),
        'centre lower than the radius at the end, mm': 1e3 * (0.5 - drop.height[-1]),
    }


def print_grid():
    """Print the worst case for each mode, without and with undamped bodies."""
    rows = {}
    for mode in MODES:
        bodies = grid(modes=(mode,))
        values = measured(bodies)
        undamped = np.array([body.get('bounciness') == 1.0 for body in bodies])
        elastic = np.array([body['elasticity'] == 1.0 for body in bodies])
        groups = {
            f'{mode}, b < 1, ε < 1': ~undamped & ~elastic,
            f'{mode}, b < 1, ε = 1': ~undamped & elastic,
            f'{mode}, b = 1': undamped,
        }
        for group, members in groups.items():
            if members.any():
                rows[group] = {
                    name: worst(value[members], [bodies[i] for i in np.flatnonzero(members)])
                    for name, value in values.items()
                }
    print('worst of | ' + ' | '.join(rows))
    print('---|' + '---|' * len(rows))
    for name in next(iter(rows.values())):
        print(name + ' | ' + ' | '.join(row[name] for row in rows.values()))


def worst(values, bodies):
    """Return the largest value and the numbers of its body, as text."""
    index = int(np.argmax(values))
    numbers = [value for value in bodies[index].values() if not isinstance(value, str)]
    return f'{values[index]:.3g} ({" ".join(f"{number:g}" for number in numbers)})'


def height_over_time(mode, hertz=240, subdivisions=3, seconds=2.0):
    """Return the heights of the centre of a default body, 60 a second."""
    config = drop_config([{'mode': mode}], h=1 / hertz, subdivisions=subdivisions)
    return fall(World(config), seconds, every=hertz // 60)[0].height[:, 0]


def print_differences(title, cases):
    """Print the largest difference of height of the first case from the others, for each mode."""
    print(f'\n{title}, mode | largest difference of height, % of the drop')
    print('---|---')
    for mode in MODES:
        first, *others = (height_over_time(mode, **case) for case in cases)
        differences = [100 * np.abs(first - other).max() / HEIGHT for other in others]
        print(f'{mode} | ' + ', '.join(f'{difference:.2f}' for difference in differences))


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--resolution', action='store_true', help='642 against 10242 vertices')
    parser.add_argument('--steps', action='store_true', help='960 against 240 and 60 Hz')
    arguments = parser.parse_args()
    print_grid()
    if arguments.resolution:
        print_differences('10242 − 642 vertices', [{'subdivisions': 5}, {'subdivisions': 3}])
    if arguments.steps:
        print_differences('960 Hz − 240, 60 Hz', [{'hertz': hertz} for hertz in (960, 240, 60)])
