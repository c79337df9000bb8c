# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Start of a command: its imports take most of the time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import gc


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """
    Do not look for garbage meanwhile, nor later among what is there then.

    Imports make none, and all that they make stays: to look at it is a tenth of the time of a
    start, and again of each full collection, while a node simulates.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()
