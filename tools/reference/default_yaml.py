# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The file config/default.yaml: every parameter with its default, described in a comment."""

import textwrap
from typing import Any

from reference.parameters_page import FIXED, PARAMETERS, default_text

from softbody_ros.core.config import Setting
from softbody_ros.scene.groups import GROUPS

WIDTH, COMMENT = 99, 38
"""Columns of the file, and the column in which comments begin where they can."""

HEADER = f"""\
# The scene that sim_node runs without any file: a ball that drops one metre onto a plane.
#   ros2 run softbody_ros sim_node --ros-args --params-file default.yaml
# Every parameter is listed with its default. Those marked {FIXED} are fixed once the node, body or
# obstacle exists; the others can change:  ros2 param set /softbody_sim ball.stiffness 0.2
# Written by tools/write_reference.py from the table of parameters: edit that, not this file.
/**:
  ros__parameters:"""


def default_yaml() -> str:
    """Return the content of the file."""
    lines, present = [HEADER], []
    for group in GROUPS:
        if group.owner and group.owner not in present:
            lines += ['', f'    {group.owner}:']
            present.append(group.owner)
        else:
            lines += [''] if present else []
            present.append('')
        lines.append(f'{"      " if group.owner else "    "}# {group.title}')
        above: list[str] = [group.owner] if group.owner else []
        for name in group.members(PARAMETERS):
            *path, last = name.split('.')
            for depth in range(len(path)):
                if path[: depth + 1] != above[: depth + 1]:
                    lines.append(f'{_indent(depth)}{path[depth]}:')
            above = path
            lines += _entry(f'{_indent(len(path))}{last}: ', PARAMETERS[name])
    return '\n'.join(lines) + '\n'


def _indent(depth: int) -> str:
    return ' ' * (4 + 2 * depth)


def _entry(key: str, facts: Setting) -> list[str]:
    """Return the lines of a parameter: its value, and a comment."""
    text = f'{key}{_yaml(facts.default)}'
    begin = f'{text:<{COMMENT - 2}}  # '
    return textwrap.wrap(
        _comment(facts), WIDTH, initial_indent=begin, subsequent_indent=' ' * COMMENT + '# ',
        break_on_hyphens=False, break_long_words=False,
    )  # fmt: skip


def _comment(facts: Setting) -> str:
    fixed = f'{FIXED} ' if facts.read_only else ''
    unit = f' [{facts.unit}]' if facts.unit else ''
    text = f'{fixed}{facts.description}{unit}'
    if isinstance(facts.default, float) and '/' in default_text(facts.default):
        text += f', {default_text(facts.default)}'
    is_fraction = (facts.minimum, facts.maximum) == (0.0, 1.0) and not facts.length
    return f'{text} ({facts.range_text})' if facts.choices or is_fraction else text


def _yaml(value: Any) -> str:
    if isinstance(value, tuple):
        return '[' + ', '.join(map(_yaml, value)) + ']'
    if isinstance(value, bool):
        return str(value).lower()
    return "''" if value == '' else str(value)
