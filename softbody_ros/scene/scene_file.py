# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Reader of parameter files and `-p` arguments with the rules of rcl, without ROS.

PyYAML splits the text into nodes; the meaning of scalars is that of rcl, not of YAML: `1e-3` is a
number, `~` a string, `010` is eight.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
import re
from typing import Any, Self

import yaml

from softbody_ros.core.config import ConfigError, shown

NODE, EVERY_NODE = '/softbody_sim', '/**'
PARAMETERS = 'ros__parameters'
YES = frozenset(['Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'])
NO = frozenset(['N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'])
OCTAL = re.compile('[+-]?0[0-7]*')
WHOLE = re.compile(f'{OCTAL.pattern}|[+-]?(0[xX][0-9a-fA-F]+|[1-9][0-9]*)')
LONGEST_WHOLE = 200
"""Characters; longer ones are no 64-bit integers, and may overflow a float."""
DECIMAL = re.compile(
    r'[+-]?(([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|\.?(nan|NaN|NAN|inf|Inf|INF))'
)


@dataclass(frozen=True)
class SceneFile:
    """
    A parameter file that has been read.

    Attributes
    ----------
    path : str
        for messages only
    sections : mapping of str to dict
        values by their dotted names, by the name of the node, which may have wildcards

    """

    path: str
    sections: Mapping[str, Mapping[str, Any]]

    @classmethod
    def read(cls, path: str) -> Self:
        """
        Read a file.

        Raises
        ------
        ConfigError
            if there is no such file, or rcl would reject it; with one sentence.

        """
        try:
            with open(path, encoding='utf-8') as file:
                text = file.read()
        except (OSError, UnicodeError) as error:
            reason = getattr(error, 'strerror', None) or 'it is not UTF-8 text'
            raise ConfigError(f'scene {path or repr("")} cannot be read: {reason}') from None
        return cls.of(text, path)

    @classmethod
    def of(cls, text: str, path: str) -> Self:
        """Return what the text of a file says, see `read`."""
        sections: dict[str, dict[str, Any]] = {}
        root = composed(text, f'scene {path}')
        if root is not None:
            for section, parameters in _sections(root, (), path):
                sections.setdefault(section, {}).update(_flattened(parameters, '', path))
        return cls(path, sections)

    def values(self, assignments: Sequence[str] = ()) -> dict[str, Any]:
        """Return the values that the node gets, see `read_scene`."""
        assigned = dict(_assigned(each) for each in assignments)
        # as in rcl: a later section with the name of the node overrides the command line
        sections = dict(self.sections)
        sections[EVERY_NODE] = {**sections.get(EVERY_NODE, {}), **assigned}
        values: dict[str, Any] = {}
        for section, parameters in sections.items():
            if _means_the_node(section, self.path):
                values |= parameters
        return values


def read_scene(path: str, assignments: Sequence[str] = ()) -> dict[str, Any]:
    """
    Return the values that a node gets from `--params-file path -p assignment ...`.

    Parameters
    ----------
    path : str
        of a YAML file
    assignments : sequence of str
        each `name:=value`, as if at the end of the section /** of the file

    Returns
    -------
    dict
        dotted names to bool, int, float, str or lists of them; None for an empty list

    Raises
    ------
    ConfigError
        if there is no such file, or rcl would reject it; with one sentence.

    """
    return SceneFile.read(path).values(assignments)


def scene_of(text: str, path: str, assignments: Sequence[str] = ()) -> dict[str, Any]:
    """Return the values in the text of a file, see `read_scene`; `path` is for messages only."""
    return SceneFile.of(text, path).values(assignments)


def composed(text: str, what: str) -> yaml.Node | None:
    """Return the root of a YAML text, None if there is nothing; `what` is for messages."""
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text)):
            raise ConfigError(f'{what} has an alias (*), which ROS does not take: write it out')
        return yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        at = error.problem_mark or error.context_mark
        line = '' if at is None else f'line {at.line + 1}: '
        context = f' {error.context}' if error.context else ''
        raise ConfigError(f'{what} is not YAML: {line}{error.problem}{context}') from None
    except yaml.YAMLError as error:
        raise ConfigError(f'{what} is not YAML: {" ".join(str(error).split())}') from None
    except RecursionError:
        raise ConfigError(
            f'{what} is nested too deeply: parameters are a few levels deep'
        ) from None


def _sections(
    node: yaml.Node, names: tuple[str, ...], path: str
) -> Iterator[tuple[str, yaml.MappingNode]]:
    """Yield the node name of each section, which may have wildcards, and its parameters."""
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(
            f'scene {path}, line {line_of(node)}: parameters stand below the name of a node and '
            f'{PARAMETERS}, for example /**: {{{PARAMETERS}: {{bodies: [ball]}}}}'
        )
    for name, value in _entries(node, path):
        if name != PARAMETERS:
            yield from _sections(value, (*names, name), path)
        elif isinstance(value, yaml.MappingNode):
            yield '/'.join(names), value
        else:
            raise ConfigError(f'scene {path}, line {line_of(node)}: {PARAMETERS} is not a map')


def _means_the_node(section: str, path: str) -> bool:
    """Return whether a section name, with * for one token and ** for any, matches the node."""
    wild = {'/**': r'(/\w+)*', '/*': r'/\w+'}
    pattern = re.sub(r'/\*\*?', lambda found: wild[found[0]], '/' + section.lstrip('/'))
    try:
        return re.fullmatch(pattern, NODE) is not None
    except (re.error, OverflowError, RecursionError) as error:  # in rcl, too, it is a pattern
        raise ConfigError(
            f'scene {path}: {shown(section)} is no name of a node, nor a pattern of names '
            f'({error}): use {NODE}, or /** for every node'
        ) from None


def _flattened(parameters: yaml.MappingNode, prefix: str, path: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, value in _entries(parameters, path):
        if isinstance(value, yaml.MappingNode):
            values |= _flattened(value, f'{prefix}{name}.', path)
        else:
            what = f'scene {path}, line {line_of(value)}: {prefix}{name}'
            values[prefix + name] = _value(value, what)
    return values


def _entries(node: yaml.MappingNode, path: str) -> Iterator[tuple[str, yaml.Node]]:
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise ConfigError(f'scene {path}, line {line_of(key)}: a name must be a text')
        yield key.value, value


def _assigned(assignment: str) -> tuple[str, Any]:
    name, sign, text = assignment.partition(':=')
    if not (name and sign):
        raise ConfigError(f'-p {assignment} is not NAME:=VALUE, such as ball.stiffness:=0.1')
    node = composed(text, f'-p {assignment}')
    if node is None or isinstance(node, yaml.MappingNode):
        raise ConfigError(f'-p {assignment} has no value: give a number, a text or a list')
    return name, _value(node, f'-p {assignment}: {name}')


def _value(node: yaml.Node, what: str) -> Any:
    if isinstance(node, yaml.ScalarNode):
        return scalar(node, what)
    items = [
        scalar(item, what) if isinstance(item, yaml.ScalarNode) else None for item in node.value
    ]
    if len({type(item) for item in items}) > 1 or None in items:
        raise ConfigError(
            f'{what} must be a list of one type, as ROS wants it: such as 0.0, not 0, beside 1.5'
        )
    return items or None


def scalar(node: yaml.ScalarNode, what: str) -> bool | int | float | str:
    """Return the value of a scalar in rcl: get_value in rcl_yaml_param_parser/src/parse.c."""
    text = str(node.value)
    if node.style in ('"', "'"):
        return text
    if not text:
        raise ConfigError(f'{what} has no value')
    if text in YES | NO:
        return text in YES
    if len(text) <= LONGEST_WHOLE and WHOLE.fullmatch(text):
        whole = int(text, 8 if OCTAL.fullmatch(text) else 0)
        return whole if abs(whole) < 2**63 else float(whole)
    if DECIMAL.fullmatch(text):
        number = float(re.sub(r'\.(?=[a-zA-Z])', '', text))
        said = text.lstrip('+-.')[0].isalpha()  # inf or nan
        return number if said or math.isfinite(number) else text
    return text


def line_of(node: yaml.Node) -> int:
    """Return the line on which a node begins, from 1."""
    return int(node.start_mark.line) + 1
