# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Start of ROS for the commands: without a log file where none can be written."""

from __future__ import annotations

from collections.abc import Sequence
import os

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

NO_LOG_FILE = '--disable-external-lib-logs'


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
    return problem


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
