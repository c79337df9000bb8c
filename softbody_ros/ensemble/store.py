# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The folder of a sweep: `runs.zarr`, with a group for each run, and `index.csv`.

A group appears when it is whole, by a rename within the folder. So whatever ends a sweep, what is
there is valid, and the next one does what is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import csv
import fcntl
import json
import os
from pathlib import Path
import shutil
from typing import IO, Any

import zarr
from zarr.storage import LocalStore

from softbody_ros.core.config import ConfigError

FORMAT = 'softbody_ros sweep, version 1'
RUNS, INDEX, UNFINISHED, LOCK = 'runs.zarr', 'index.csv', '.unfinished', '.lock'
METADATA = 'zarr.json'
ROW = {'run', 'status', 'error', 'parameters', 'outcomes'}
"""Attributes that each run has."""


class Store:
    """
    The runs of a spec, in a folder; use it as a context, which keeps other sweeps out of it.

    Attributes
    ----------
    rows : dict of int to mapping
        what is there: the attributes of the group of each run

    Raises
    ------
    ConfigError
        if the folder holds something else, or another sweep writes to it.
    OSError
        if it cannot be written.

    """

    def __init__(self, path: Path, described: Mapping[str, Any], outcomes: Sequence[str]) -> None:
        self._path, self._described, self._outcomes = path, described, outcomes
        self.rows: dict[int, Mapping[str, Any]] = {}

    def __enter__(self) -> Store:
        require_free(self._path, self._described)
        self._path.mkdir(parents=True, exist_ok=True)
        self._lock: IO = (self._path / LOCK).open('w')
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._lock.close()
            raise ConfigError(f'another sweep writes to {self._path}: wait, or end it') from None
        shutil.rmtree(self._path / UNFINISHED, ignore_errors=True)
        (self._path / UNFINISHED).mkdir()
        if not (self._path / RUNS).exists():
            attributes = {'format': FORMAT, 'spec': dict(self._described)}
            zarr.create_group(LocalStore(self._path / UNFINISHED / RUNS), attributes=attributes)
            os.rename(self._path / UNFINISHED / RUNS, self._path / RUNS)
        self.rows = stored(self._path)
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._path / UNFINISHED, ignore_errors=True)
        self._lock.close()

    def add(self, run: int, files: Mapping[str, bytes]) -> None:
        """Write the group of a run; it is there whole, or not at all."""
        name = f'{run:06}'
        unfinished, place = self._path / UNFINISHED / name, self._path / RUNS / name
        try:
            for path, content in files.items():
                file = unfinished / path
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
        except OSError:
            shutil.rmtree(unfinished, ignore_errors=True)  # the room is needed for the index
            raise
        if place.exists():  # a failed or damaged run that is done again
            shutil.rmtree(place)
        os.rename(unfinished, place)
        self.rows[run] = attributes_of(files)

    def write_index(self) -> None:
        """Write `index.csv`, a line for each run that is there."""
        names = [name for name, _ in self._described['vary']]
        unfinished = self._path / UNFINISHED / INDEX
        with unfinished.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(['run', 'status', 'error', *names, *self._outcomes])
            for run, row in sorted(self.rows.items()):
                given = [row['parameters'][name] for name in names]
                came = [row['outcomes'].get(name) for name in self._outcomes]
                cells = [_cell(each) for each in (*given, *came)]
                writer.writerow([run, row['status'], row['error'], *cells])
        os.replace(unfinished, self._path / INDEX)


def require_free(path: Path, described: Mapping[str, Any]) -> None:
    """Raise ConfigError unless a folder is missing, empty, or has runs of this spec."""
    try:
        found = set(os.listdir(path)) - {UNFINISHED, LOCK}
    except FileNotFoundError:
        return
    except NotADirectoryError:
        raise ConfigError(f'{path} is a file: give the name of a folder') from None
    if not found:
        return
    try:
        attributes = _attributes(path / RUNS)
        of_store = attributes['spec'] if attributes['format'] == FORMAT else None
    except (OSError, ValueError, KeyError, TypeError):
        of_store = None
    if of_store is None:
        raise ConfigError(f'{path} is not empty and no store of a sweep: give another folder')
    # as it was written: numbers and lists, no tuples
    wanted = json.loads(json.dumps(described))
    differs = [name for name in wanted if of_store.get(name) != wanted[name]]
    if differs:
        raise ConfigError(
            f'{path} has runs of another spec ({" and ".join(differs)} differ'
            f'{"s" if len(differs) == 1 else ""}): give another folder'
        )


def attributes_of(files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the attributes of an encoded group."""
    return json.loads(files[METADATA])['attributes']


def stored(path: Path) -> dict[int, Mapping[str, Any]]:
    """
    Return the attributes of the runs in a folder, by their numbers; nothing if it is none.

    Damaged groups are missing: `Store.add` replaces them.
    """
    rows = {run: _row(place) for run, place in sorted(_places(path))}
    return {run: row for run, row in rows.items() if row is not None}


def _places(path: Path) -> Iterator[tuple[int, Path]]:
    if (path / RUNS).is_dir():
        for entry in os.scandir(path / RUNS):
            if entry.name.isdecimal():
                yield int(entry.name), Path(entry.path)


def _row(group: Path) -> Mapping[str, Any] | None:
    """Return the attributes of a run, None if they are damaged, as by a machine that went off."""
    try:
        attributes = _attributes(group)
        return attributes if attributes.keys() >= ROW else None
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _attributes(group: Path) -> dict[str, Any]:
    return json.loads((group / METADATA).read_bytes())['attributes']


def _cell(value: Any) -> Any:
    """Return a value for a table: as JSON, but texts without quotes and None as nothing."""
    if value is None or isinstance(value, str):
        return value
    return json.dumps(value)
