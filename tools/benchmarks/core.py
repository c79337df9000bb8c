# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Time a step of 1/60 s of this simulator and of its peers, on the same work, as Markdown tables.

pip install '.[bench]' && python3 tools/benchmarks/core.py [--workload] [--peer] [--rounds]

Each run is a process of its own with one thread. Rounds go through all workloads and simulators
in turn, so that a slow spell of the machine hits all of them; ratios are formed within a round.
What is printed stands in docs/benchmarks.md.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
from pathlib import Path
import platform
import statistics
import sys

sys.path.insert(0, str(Path(__file__).parents[2]))

from measuring import measured_apart
from printing import print_table, shown
from simulators import SIMULATORS, Ours, is_installed, takes_part
from workloads import WORKLOADS

MODES = [name for name, kind in SIMULATORS.items() if issubclass(kind, Ours)]
NOTHING = '–'
BANDWIDTHS = """\
In free fall: ns a particle / what cannot but be moved, in % of what `numpy.copyto` moves in that
time in arrays as large as the state (small ones stay in the cache) / in arrays of 200 MB.
Positions and velocities have to be read and written: 96 B a particle"""


def run_rounds(rounds, workloads, names):
    """Return the measurements of all runs, in the order in which they were made."""
    runs = []
    for number in range(rounds):
        for workload in workloads:
            for name in names:
                if not takes_part(name, WORKLOADS[workload]):
                    continue
                run = measured_apart(name, WORKLOADS[workload])
                runs.append({'round': number, 'workload': workload, 'simulator': name} | run)
                times = f'{shown(run["falling"])} / {shown(run["resting"])} ms'
                print(f'round {number + 1}: {workload}, {name}: {times}', file=sys.stderr)
    return runs


def values(runs, what, **where):
    """Return one measurement of those runs that agree with `where`, round by round."""
    return [run[what] for run in runs if all(run[key] == where[key] for key in where)]


def names_in(runs, key):
    """Return the different values of a key, in their order."""
    return list(dict.fromkeys(run[key] for run in runs))


def ratios(runs, workload, name, other):
    """Return the times at rest relative to those of another simulator in the same round."""
    times, others = (
        values(runs, 'resting', workload=workload, simulator=simulator)
        for simulator in (name, other)
    )
    return [time / reference for time, reference in zip(times, others, strict=False)]


def median(values):
    """Return the median of values, if there are any, as text."""
    return shown(statistics.median(values)) if values else NOTHING


def with_spread(values):
    """Return the median of values and their range, as text."""
    if not values:
        return NOTHING
    return f'{median(values)} ({shown(min(values))}–{shown(max(values))})'


def span(values):
    """Return the range of values with two decimals, as text."""
    low, high = (f'{round(value, 2) + 0.0:.2f}' for value in (min(values), max(values)))
    return low if low == high else f'{low} … {high}'


def print_workloads(caption, runs, columns, cell):
    """Print a table with a row for each workload of which anything is known."""
    rows = []
    for workload in names_in(runs, 'workload'):
        cells = [cell(workload, column) for column in columns]
        if set(cells) != {NOTHING}:
            rows.append([workload, *cells])
    print_table(caption, ['', *columns], rows)


def print_times(runs):
    """Print how long a step takes."""

    def cell(workload, name):
        where = {'workload': workload, 'simulator': name}
        falling, resting = values(runs, 'falling', **where), values(runs, 'resting', **where)
        return f'{median(falling)} / {with_spread(resting)}' if falling else NOTHING

    caption = 'ms for a step, falling / at rest: medians (and ranges) of the rounds'
    print_workloads(caption, runs, names_in(runs, 'simulator'), cell)


def print_ratios(runs):
    """Print how the times of a step at rest compare with those of the peers."""
    names = names_in(runs, 'simulator')
    modes = [name for name in names if name in MODES]
    pairs = [(mode, 'pypbd') for mode in modes] + [('rapier3d', mode) for mode in modes]
    columns = {' / '.join(pair): pair for pair in pairs if set(pair) <= set(names)}
    if columns:
        print_workloads(
            'Ratios of the times at rest, formed within each round',
            runs,
            columns,
            lambda workload, column: with_spread(ratios(runs, workload, *columns[column])),
        )


def print_checks(runs):
    """Print what shows that the work was done: the range over all workloads and rounds."""
    columns = {
        'acceleration of the fall, m/s²': 'acceleration',
        'lowest vertex at rest, mm': 'lowest',
        'RMS deformation at rest, % of the radius': 'deformation',
    }
    rows = [
        [name, *(span(values(runs, what, simulator=name)) for what in columns.values())]
        for name in names_in(runs, 'simulator')
    ]
    caption = 'That the work was done, as ranges over all workloads and rounds'
    print_table(caption, ['', *columns], rows)


def print_bandwidths(runs):
    """Print how near to a copy of its state a step in free flight comes, see `bandwidths`."""
    runs = [
        run
        for run in runs
        if WORKLOADS[run['workload']].bodies == 1 and not WORKLOADS[run['workload']].clusters
    ]
    shares = ('particle time', 'share of copy', 'share of large copy')
    columns = {'copies, GB/s': (('copy', 'large copy'), {})} | {
        name: (shares, {'simulator': name}) for name in names_in(runs, 'simulator')
    }

    def cell(workload, column):
        keys, where = columns[column]
        each = [values(runs, key, workload=workload, **where) for key in keys]
        return ' / '.join(median(found) for found in each) if each[0] else NOTHING

    if runs:
        print_workloads(BANDWIDTHS, runs, columns, cell)


def print_versions(names):
    """Print what was measured with."""
    packages = ['numpy', *(SIMULATORS[name].package for name in names if name not in MODES)]
    versions = [f'{package} {importlib.metadata.version(package)}' for package in packages]
    print(f'Python {platform.python_version()}, {", ".join(versions)}, {os.cpu_count()} cores.')


def report(runs):
    """Print all tables."""
    print_times(runs)
    print_ratios(runs)
    print_checks(runs)
    print_bandwidths(runs)
    print_versions(names_in(runs, 'simulator'))


def parsed_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--workload', nargs='+', choices=WORKLOADS, help='all by default')
    parser.add_argument('--peer', nargs='+', choices=SIMULATORS, default=list(SIMULATORS))
    parser.add_argument('--rounds', type=int, help='5 by default')
    parser.add_argument('--json', type=Path, help='file for the measurements of all runs')
    parser.add_argument('--quick', action='store_true', help='by default one round of W1-642')
    return parser.parse_args()


def main():
    """Run the rounds and print the tables."""
    arguments = parsed_arguments()
    workloads = arguments.workload or (['W1-642'] if arguments.quick else list(WORKLOADS))
    rounds = arguments.rounds or (1 if arguments.quick else 5)
    names = [name for name in arguments.peer if is_installed(name)]
    for name in arguments.peer:
        if name not in names:
            print(f"{name} is not installed and is left out: pip install '.[bench]'\n")
    if not names:
        return
    runs = run_rounds(rounds, workloads, names)
    if arguments.json:
        arguments.json.write_text(json.dumps(runs, indent=1))
    report(runs)


if __name__ == '__main__':
    main()
