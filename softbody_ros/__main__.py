# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The command `sim_node`, also `python3 -m softbody_ros`.

SIGINT and SIGTERM are handled before anything else: the imports take a second, and some libraries
swallow a KeyboardInterrupt meanwhile.
"""

from __future__ import annotations

import sys

from softbody_ros.signals import stop_at_signal
from softbody_ros.startup import without_garbage_collection


def main() -> int:
    """Run the node until SIGINT or SIGTERM; a second one ends it at once."""
    stop = stop_at_signal()
    if {'-h', '--help'} & set(sys.argv[1:]):
        # fast: without importing ROS or the simulator
        from softbody_ros.ros.cli_help import help_text

        print(help_text())
        return 0

    from softbody_ros.ros.command_line import UsageError, read

    try:
        command = read(sys.argv[1:])
    except UsageError as error:
        print('softbody_sim:', error, file=sys.stderr)
        return 1

    with without_garbage_collection():
        from softbody_ros.ros.node import run

    return run(command, stop)


if __name__ == '__main__':
    sys.exit(main())
