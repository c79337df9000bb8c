# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import tempfile


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Yield a temporary path that is moved to `path` at the end, or removed after an error.

    It lies in a hidden folder beside `path`: on the same file system, with the same file name.
    """
    with tempfile.TemporaryDirectory(prefix='.unfinished-', dir=path.parent) as folder:
        unfinished = Path(folder) / path.name
        yield unfinished
        os.replace(unfinished, path)
