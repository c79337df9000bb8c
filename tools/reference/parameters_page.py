# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of parameters."""

from typing import Any

from reference.markdown import code, page, table

from softbody_ros.core.config import Setting
from softbody_ros.scene import parameters
from softbody_ros.scene.groups import GROUPS, Group
from softbody_ros.scene.parameters import SceneLists, type_name

PARAMETERS = parameters.table(SceneLists())
HEAD = ('parameter', 'type', 'default', 'range', 'unit', 'description')
FIXED = '†'

BEGIN = f"""\
`ball` stands for the name of each body, `ground` for the name of each obstacle. Parameters marked
{FIXED} are fixed from the start of the node, or from when their body or obstacle is added; all
others can change while the node runs, and a change moves nothing by itself. An invalid value is
refused with the reason. Integers are accepted for doubles. An empty list is `[]`; it is reported
as `[-1]` if its elements are integers and as `['']` if they are strings, which are accepted, too.

`ros2 param describe /softbody_sim ball.stiffness` prints the description of a parameter, and
[default.yaml](../../config/default.yaml) lists all of them with their defaults."""


def parameters_page() -> str:
    """Return the page: a table for each group."""
    links = ' · '.join(f'[{group.title}](#{_anchor(group.title)})' for group in GROUPS)
    parts = [f'## {group.title}\n\n{_table(group)}' for group in GROUPS]
    return page('Parameters', BEGIN, links, *parts)


def _anchor(title: str) -> str:
    """Return the anchor that code hosts and Sphinx give to a heading."""
    return title.lower().replace(':', '').replace(' ', '-')


def _table(group: Group) -> str:
    return table(HEAD, [_row(name, PARAMETERS[name]) for name in group.members(PARAMETERS)])


def _row(name: str, facts: Setting) -> tuple[str, ...]:
    fixed = FIXED if facts.read_only else ''
    default = default_text(facts.default)
    return (
        f'`{name}`{fixed}',
        type_name(facts),
        code(default) if default else "`''`",
        facts.range_text,
        facts.unit,
        facts.description,
    )


def default_text(default: Any) -> str:
    """Return a default for people: 1/240 for what has many digits."""
    if isinstance(default, tuple):
        return '[' + ', '.join(default_text(item) for item in default) + ']'
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, float):
        return f'1/{1 / default:g}' if len(repr(default)) > 8 else f'{default:g}'
    return str(default)
