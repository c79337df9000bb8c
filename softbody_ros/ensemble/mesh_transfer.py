# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The mesh files of a sweep, for workers that do not have them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
import hashlib
import os
from pathlib import Path
import shutil
from typing import Any
import uuid

from distributed import Worker, get_worker
from distributed.diagnostics.plugin import WorkerPlugin

from softbody_ros.core.geometry.mesh import PRIMITIVES
from softbody_ros.core.geometry.mesh_files import read_mesh_file
from softbody_ros.scene.parameters import mesh_path

FIELDS = ('mesh', 'visual_mesh')


@dataclass(frozen=True)
class Meshes:
    """
    Mesh files, by the values of parameters.

    Attributes
    ----------
    names : dict of str to str
        a file name, which has the digest of the content, for each value
    contents : dict of str to bytes
        by file name
    key : str
        a name of these files, and of nobody else's: who ends first leaves those of others alone

    """

    names: dict[str, str] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)
    key: str = field(default_factory=lambda: f'softbody_ros-meshes-{uuid.uuid4().hex}')


def read_meshes(values: Iterable[tuple[str, Any]]) -> Meshes:
    """
    Read the mesh files among names and values of parameters.

    Raises
    ------
    ConfigError, MeshError
        if one cannot be found or read.

    """
    meshes = Meshes()
    for name, value in values:
        is_file = isinstance(value, str) and value and value not in PRIMITIVES
        if name.rpartition('.')[2] not in FIELDS or not is_file or value in meshes.names:
            continue
        path = mesh_path(value)
        read_mesh_file(path, PRIMITIVES)
        content = Path(path).read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        meshes.names[value] = f'{digest[:32]}{os.path.splitext(path)[1]}'
        meshes.contents[meshes.names[value]] = content
    return meshes


class MeshFiles(WorkerPlugin):
    """Gives each worker, also one that joins later, the files; they go when it ends."""

    idempotent = True

    def __init__(self, meshes: Meshes) -> None:
        self.name, self._contents = meshes.key, meshes.contents

    def setup(self, worker: Worker) -> None:
        """Write the files."""
        folder = _folder(worker, self.name)
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self._contents.items():
            (folder / name).write_bytes(content)

    def teardown(self, worker: Worker) -> None:
        """Remove the files."""
        shutil.rmtree(_folder(worker, self.name), ignore_errors=True)


def paths_on_worker(names: Mapping[str, str], key: str) -> dict[str, str]:
    """Return the path of each mesh on the worker that calls this, by value of parameters."""
    if not names:
        return {}
    folder = _folder(get_worker(), key)
    return {value: str(folder / name) for value, name in names.items()}


def _folder(worker: Worker, key: str) -> Path:
    return Path(worker.local_directory) / key
