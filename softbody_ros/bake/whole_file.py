# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that are there when they are whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import tempfile


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Give the path of a file to write, which becomes `path` at the end; after an error it is gone.

    It is in a hidden folder beside `path`: on the same file system, and with the same name.
    """
    with tempfile.TemporaryDirectory(prefix='.bake-', dir=path.parent) as folder:
        unfinished = Path(folder) / path.name
        yield unfinished
        os.replace(unfinished, path)
