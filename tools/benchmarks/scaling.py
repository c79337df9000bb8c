# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Time a step over the number of vertices and of bodies, and draw it: resource/scaling.png.

pip install '.[bench]' && python3 tools/benchmarks/scaling.py

The bodies lie on the ground, one thread.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).parents[2]))

from measuring import measured_apart
from workloads import MILLION, Workload

PICTURE = Path(__file__).parents[2] / 'resource' / 'scaling.png'
FREQUENCIES = (3, 6, 10, 18, 32, 56, 100, 178, MILLION)
"""Of spheres of 92, 362, 1002, … 998 562 vertices."""
BODIES = (1, 3, 10, 30, 100, 300, 1000)
MODES = {'rigid': ('#0072B2', 's'), 'linear': ('#D55E00', 'o'), 'quadratic': ('#009E73', '^')}
"""Colour and marker: colours that the colour-blind can tell apart."""


def lying(frequency, bodies):
    """Return the workload of balls that start on the ground."""
    return Workload(f'{bodies} x {frequency}', frequency, bodies, steps=90, drop=0.0)


def measured_steps(workloads, modes):
    """Return the ms of a step by mode, for each workload; print them as a table."""
    times = {mode: [] for mode in modes}
    print('| particles | ' + ' | '.join(f'{mode}, ms' for mode in modes) + ' |')
    print('|' + '---|' * (1 + len(times)))
    for workload in workloads:
        for mode, row in times.items():
            row.append(measured_apart(mode, workload)['resting'])
        shown = ' | '.join(f'{row[-1]:.3g}' for row in times.values())
        print(f'| {workload.particles} | {shown} |', flush=True)
    print()
    return times


def draw(panels, path):
    """Draw panels of (label of the axis, numbers, ms by mode)."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    plt.rcParams.update({'font.size': 11, 'axes.spines.top': False, 'axes.spines.right': False})
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.4), dpi=110, sharey=True)
    for panel, (label, numbers, times) in zip(axes, panels, strict=True):
        for mode, (color, marker) in MODES.items():
            panel.loglog(numbers, times[mode], color=color, marker=marker, label=mode)
        end = times['linear'][-1]
        ends = [numbers[-1] / 100, numbers[-1]]
        panel.loglog(ends, [end / 200, end / 2], '--', color='#555', label='slope 1')
        panel.set_xlabel(label)
        panel.grid(color='#ddd', linewidth=0.8)
        panel.set_axisbelow(True)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_formatter(_label)
    axes[0].set_ylabel('ms per step')
    axes[0].legend(frameon=False)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def _label(number, _):
    return f'{number:,.0f}'.replace(',', ' ') if number >= 1 else f'{number:g}'


def main():
    """Measure and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--quick', action='store_true', help='the smallest only, no picture')
    parser.add_argument('--picture', type=Path, default=PICTURE)
    arguments = parser.parse_args()
    frequencies, bodies, modes = FREQUENCIES, BODIES, tuple(MODES)
    if arguments.quick:
        frequencies, bodies, modes = FREQUENCIES[:1], BODIES[:1], ('linear',)
    of_vertices = [lying(frequency, 1) for frequency in frequencies]
    of_bodies = [lying(4, count) for count in bodies]
    vertices = [workload.particles for workload in of_vertices]
    panels = [
        ('vertices of one body', vertices, measured_steps(of_vertices, modes)),
        ('bodies of 162 vertices', bodies, measured_steps(of_bodies, modes)),
    ]
    if not arguments.quick:
        draw(panels, arguments.picture)


if __name__ == '__main__':
    main()
