# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The command `sim_node`, also `python3 -m softbody_ros`.

Listens to SIGINT and SIGTERM before anything else: the imports take half a second, and some
libraries swallow the KeyboardInterrupt of a signal that comes meanwhile.
"""

from __future__ import annotations

import sys

from softbody_ros.signals import stop_at_signal


def main() -> int:
    """Run the node until SIGINT or SIGTERM; a second one ends it at once."""
    stop = stop_at_signal()

    from softbody_ros.ros.node import run

    return run(stop)


if __name__ == '__main__':
    sys.exit(main())
