# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Arguments of `sim_node`: its own, and what follows `--ros-args`. Without ROS."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

from softbody_ros.web_address import add_address

VIEWER = '--viewer'
FOR_ROS = frozenset(['-p', '--param', '--params-file', '-r', '--remap'])
"""What people give without `--ros-args`, most often."""


class UsageError(ValueError):
    """Arguments that cannot be used: the message is one sentence."""


@dataclass(frozen=True)
class CommandLine:
    """
    What the command is to do.

    Attributes
    ----------
    for_ros : tuple of str
        what ROS is to read
    for_viewer : tuple of str or None
        arguments of the viewer to run beside the node; None for no viewer

    """

    for_ros: tuple[str, ...]
    for_viewer: tuple[str, ...] | None


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f'{message}; see --help')


def _as_meant(unknown: Sequence[str]) -> str:
    """Return how to write arguments that are for ROS, as a clause, or ''."""
    if unknown[0] in FOR_ROS:
        return f', as in sim_node --ros-args {" ".join(unknown[:2])}'
    if unknown[0].endswith(('.yaml', '.yml')):
        return f', as in sim_node --ros-args --params-file {unknown[0]}'
    return ''


def read(arguments: Sequence[str]) -> CommandLine:
    """
    Read the arguments after the name of the command.

    Raises
    ------
    UsageError

    """
    split = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    parser = _Parser(add_help=False, allow_abbrev=False)
    parser.add_argument(VIEWER, action='store_true')
    add_address(parser)
    parser.set_defaults(host=None, port=None)
    options, unknown = parser.parse_known_args(list(arguments[:split]))
    if unknown:
        raise UsageError(
            f'the argument {unknown[0]} is unknown: give {VIEWER}, or --ros-args and what ROS is '
            f'to read{_as_meant(unknown)}; see --help'
        )
    has_viewer = VIEWER in arguments
    address = [
        argument
        for name, value in (('--host', options.host), ('--port', options.port))
        if value is not None
        for argument in (name, str(value))
    ]
    if address and not has_viewer:
        raise UsageError(f'{address[0]} is of the viewer: give {VIEWER}, too, or leave it out')
    return CommandLine(
        tuple(argument for argument in arguments[split:] if argument != VIEWER),
        tuple(address) if has_viewer else None,
    )
