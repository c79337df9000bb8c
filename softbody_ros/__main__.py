# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The command `sim_node`, also `python3 -m softbody_ros`.

Listens to SIGINT and SIGTERM before anything else: the imports take half a second, and some
libraries swallow the KeyboardInterrupt of a signal that comes meanwhile.
"""

from __future__ import annotations

import signal
import sys
import threading


def main() -> int:
    """Run the node until SIGINT or SIGTERM; a second one ends it at once."""
    stop = threading.Event()

    def handle(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle)

    from softbody_ros.sim_node import run

    return run(stop)


if __name__ == '__main__':
    sys.exit(main())
