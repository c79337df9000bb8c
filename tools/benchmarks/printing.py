# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Numbers and tables as the benchmarks print them."""

from __future__ import annotations


def shown(value):
    """Return a number with three digits."""
    return f'{value:.3g}' if abs(value) < 1000 else f'{value:.0f}'


def print_table(caption, header, rows):
    """Print a table in Markdown."""
    print(caption, end=':\n\n')
    print('| ' + ' | '.join(header) + ' |')
    print('|' + '---|' * len(header))
    for row in rows:
        print('| ' + ' | '.join(row) + ' |')
    print()
