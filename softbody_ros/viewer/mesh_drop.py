# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of meshes that were dropped on the page, in a folder that a node beside can read."""

from __future__ import annotations

import os
import pathlib
import re
import tempfile

from softbody_ros.scene.resources import Problem, ResourceError

MOST_BYTES = 1_000_000_000
"""Of all files together."""


class DroppedMeshes:
    """
    A temporary folder, which is there until `close`.

    A node has read a mesh once it has the body: it goes back in time without the file.
    """

    def __init__(self) -> None:
        self._directory = tempfile.TemporaryDirectory(prefix='softbody_viewer_')
        self.folder = pathlib.Path(self._directory.name)
        self._count = self._bytes = 0

    def keep(self, name: str, content: bytes) -> pathlib.Path:
        """
        Write a file, under its own name as far as that is one; return its path.

        Raises
        ------
        ResourceError
            if there are too many.

        """
        if self._bytes + len(content) > MOST_BYTES:
            raise ResourceError(
                Problem.CONTENT,
                f'the files that were dropped have more than {MOST_BYTES / 1e9:g} GB: start the '
                'viewer anew, or set mesh to the path of a file',
            )
        self._bytes += len(content)
        self._count += 1
        stem, ending = os.path.splitext(os.path.basename(name.replace('\\', '/')))
        folder = self.folder / str(self._count)
        folder.mkdir()
        path = folder / (re.sub(r'\W', '_', stem)[:64] + re.sub(r'[^.\w]', '_', ending)[:16])
        path.write_bytes(content)
        return path

    def close(self) -> None:
        """Remove all files."""
        self._directory.cleanup()
