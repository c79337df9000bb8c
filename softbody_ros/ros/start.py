# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Start of ROS for the commands: without a log file where none can be written."""

from __future__ import annotations

from collections.abc import Sequence
import os
import re

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from softbody_ros.core.config import ConfigError
from softbody_ros.scene.scene_file import SceneFile

NO_LOG_FILE = '--disable-external-lib-logs'
FORMS = {
    '-p': 'NAME:=VALUE, such as ball.stiffness:=0.1',
    '--param': 'NAME:=VALUE, such as ball.stiffness:=0.1',
    '-r': 'FROM:=TO, such as __ns:=/left',
    '--remap': 'FROM:=TO, such as __ns:=/left',
    '--params-file': 'the path of a parameter file',
}
"""What must follow an argument for ROS."""


def start_ros(arguments: Sequence[str]) -> str:
    """
    Initialise rclpy with the arguments of a command; return a warning, or ''.

    Without a folder for log files rclpy would not start.

    Raises
    ------
    RuntimeError
        if ROS cannot use them.

    """
    problem = '' if NO_LOG_FILE in arguments else _log_problem()
    before = ('--ros-args', NO_LOG_FILE, '--') if problem else ()
    # rclpy's own handlers would shut the context down during a callback
    try:
        rclpy.init(args=[*before, *arguments], signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:  # its text is a list
        raise RuntimeError(
            f'ROS does not know {str(error).strip("[]")} after --ros-args: leave it out, or see '
            '--help'
        ) from None
    except RuntimeError as error:
        raise RuntimeError(_what_is_wrong(arguments) or str(error)) from None
    return problem


def _what_is_wrong(arguments: Sequence[str]) -> str:
    """Return a sentence about what ROS cannot use, or '': its own name the lines of its code."""
    for flag, value in zip(arguments, [*arguments[1:], ''], strict=False):
        if flag in FORMS and not value:
            return f'nothing follows {flag}: give {FORMS[flag]}'
        try:
            if flag == '--params-file':
                SceneFile.read(value).values()
            elif flag in ('-p', '--param'):
                SceneFile('', {}).values([value])
        except ConfigError as error:
            return str(error)
        if flag not in ('-r', '--remap'):
            continue
        old, sign, new = value.partition(':=')
        if not (old and sign and new):
            return f'{flag} {value} is not {FORMS[flag]}'
        if old.endswith('__node') and not re.fullmatch(r'[A-Za-z_]\w*', new, re.ASCII):
            return (
                f'{flag} {value} gives no name that a node can have: letters, digits and '
                'underscores, and no digit first'
            )
        if old.endswith('__ns') and not re.fullmatch(r'(/[A-Za-z_]\w*)+|/', new, re.ASCII):
            return f'{flag} {value} gives no namespace: one is such as /left'
    return ''


def _log_problem() -> str:
    """Return why there can be no log file, or '': by the rules of rcl_logging."""
    home, folder = os.environ.get('HOME'), os.environ.get('ROS_LOG_DIR')
    if not folder:
        folder = os.path.join(os.environ.get('ROS_HOME') or '~/.ros', 'log')
    reason = ''
    if folder.startswith('~'):
        if not home:
            reason = 'HOME is not set'
        folder = (home or '~') + folder[1:]
    if not reason:
        try:
            os.makedirs(folder, exist_ok=True)
        except OSError as error:
            reason = error.strerror or type(error).__name__
        else:
            if not os.access(folder, os.W_OK | os.X_OK):
                reason = 'it cannot be written to'
    if not reason:
        return ''
    return (
        f'no log file is written, the folder {folder} cannot be used ({reason}): set ROS_LOG_DIR '
        'to one that can be written to'
    )
