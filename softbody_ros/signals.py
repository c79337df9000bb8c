# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The signals that end a command, listened to before its imports, which take a while."""

from __future__ import annotations

import signal
import threading


def stop_at_signal() -> threading.Event:
    """Return what SIGINT and SIGTERM set from now on; a second one ends the process at once."""
    stop = threading.Event()

    def handle(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle)
    return stop
