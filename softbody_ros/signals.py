# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Handlers of the signals that end a command, installed before its slow imports."""

from __future__ import annotations

import signal
import threading


def stop_at_signal() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set; a second signal ends the process at once."""
    stop = threading.Event()

    def handle(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle)
    return stop


def noted_signals() -> list[int]:
    """Return a list that gets the number of SIGINT or SIGTERM; a second one raises SystemExit."""
    numbers: list[int] = []

    def note(number: int, _: object) -> None:
        if numbers:
            raise SystemExit(128 + number)
        numbers.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, note)
    return numbers
