# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Measure contact in scenes with known outcomes, as a Markdown table for each.

python3 tools/benchmarks/contact_battery.py [scene ...] [--quick] [--mode ...] [--step ...]

Beside each measurement stands what it should be, in the head of its column if that is the same in
all rows; what misses it is marked by ✗. A step is given in ticks a second, f is the natural
frequency of the bodies, by reference_step; of the defaults if there is none.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
import sys
import time

sys.path.insert(0, str(Path(__file__).parents[2]))

from contact_scenes import MODES, SCENES, STEPS
from printing import print_table, shown

NOTHING, MISSED = '–', ' ✗'
BOOLEANS = {False: 'no', True: 'yes'}


def names_in(rows, attribute):
    """Return the keys of the dicts of all rows, in their order."""
    return list(dict.fromkeys(name for row in rows for name in getattr(row, attribute)))


def shared_target(rows, name):
    """Return the target of all measurements of that name if it is the same, else None."""
    targets = {row.measured[name].target for row in rows if name in row.measured}
    return targets.pop() if len(targets) == 1 else None


def cell(measured, shared):
    """Return a measurement as text, with its target unless that is shared by its column."""
    if measured is None:
        return NOTHING
    value, target = measured.value, measured.target
    text = BOOLEANS[value] if isinstance(value, bool) else shown(value)
    if math.isnan(value):
        return NOTHING
    if target and not shared:
        text += f' ({target})'
    return text if measured.is_met else text + MISSED


def print_scene(scene, rows, seconds):
    """Print the table of a scene."""
    parameters, names = names_in(rows, 'parameters'), names_in(rows, 'measured')
    shared = {name: shared_target(rows, name) for name in names}
    header = ['mode', 'step', 'f, Hz', *parameters]
    header += [f'{name} ({shared[name]})' if shared[name] else name for name in names]
    table = []
    for row in rows:
        case = row.case
        line = [case.mode, f'1/{case.hertz}', shown(case.frequency) if case.frequency else NOTHING]
        line += [f'{value:g}' if isinstance(value, float) else str(value)
                 for value in row.parameters.values()]  # fmt: skip
        if row.error:
            line.append(f'**{row.error.split(":")[0]}**')
        line += [cell(row.measured.get(name), shared[name]) for name in names]
        table.append(line[: len(header)])
    judged = [
        measured
        for row in rows
        for measured in row.measured.values()
        if measured.target and not math.isnan(measured.value)
    ]
    met = sum(measured.is_met for measured in judged)
    failed = sum(bool(row.error) for row in rows)
    stopped = f', {failed} stopped by an error' if failed else ''
    caption = f'{met} of {len(judged)} targets met{stopped}, {seconds:.1f} s'
    print_table(f'### {scene.name}\n\n{scene.title}. {caption}', header, table)


def as_dict(row, name):
    """Return a row as what JSON can hold."""
    measured = {
        what: {
            'value': each.value,
            'target': each.target and str(each.target),
            'met': each.is_met,
        }
        for what, each in row.measured.items()
    }
    return {
        'scene': name,
        'mode': row.case.mode,
        'hertz': row.case.hertz,
        'frequency': row.case.frequency,
        'parameters': row.parameters,
        'error': row.error,
        'measured': measured,
    }


def progress(row):
    """Print a row on stderr."""
    case = row.case
    values = [f'{name} {each.value:.4g}' for name, each in row.measured.items()]
    where = [case.mode, f'1/{case.hertz}', case.frequency, *row.parameters.values()]
    print(', '.join(map(str, where)) + ': ' + (row.error or '; '.join(values)), file=sys.stderr)


def parsed_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('scene', nargs='*', help=f'all by default: {", ".join(SCENES)}')
    parser.add_argument('--mode', nargs='+', choices=MODES, default=MODES)
    parser.add_argument('--step', nargs='+', type=int, choices=STEPS, help='ticks a second')
    parser.add_argument('--quick', action='store_true', help='try one short case of each scene')
    parser.add_argument('--json', type=Path, help='file for all measurements')
    parser.add_argument('--verbose', action='store_true', help='print each row when it is ready')
    arguments = parser.parse_args()
    for name in arguments.scene:
        if name not in SCENES:
            parser.error(f'there is no scene {name}: choose of {", ".join(SCENES)}')
    return arguments


def main():
    """Measure the scenes and print their tables."""
    arguments = parsed_arguments()
    steps = arguments.step or [240] if arguments.quick else arguments.step
    records = []
    for name in arguments.scene or SCENES:
        scene, begin = SCENES[name], time.perf_counter()
        rows = scene.rows(
            arguments.mode,
            steps or scene.steps,
            arguments.quick,
            progress if arguments.verbose else lambda row: None,
        )
        if rows:
            print_scene(scene, rows, time.perf_counter() - begin)
            sys.stdout.flush()
        records += [as_dict(row, name) for row in rows]
    if arguments.json:
        arguments.json.write_text(json.dumps(records, indent=1, default=float))


if __name__ == '__main__':
    main()
