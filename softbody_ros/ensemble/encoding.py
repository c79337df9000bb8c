# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A run as a group of Zarr (version 3), in memory: the bytes of its files by their paths.

| array | type and shape | |
|---|---|---|
| times | float64 (frames,) | s |
| ticks | int64 (frames,) | |
| bodies/NAME/positions | float64 (frames, vertices, 3) | of the vertices, m, z up |
| bodies/NAME/faces | int32 (triangles, 3) | vertex indices, anticlockwise seen from outside |
| bodies/NAME/pressure | float64 (frames, vertices) | of contacts at the tick of the frame, Pa |
| bodies/NAME/wrenches | float64 (frames, 6) | of all contacts, N and N m, since the frame before |
| bodies/NAME/poses | float64 (frames, 7) | best rigid fit: m, and quaternion x y z w |
| bodies/NAME/dents | float64 (frames,) | RMS displacement from it, m |
| bodies/NAME/asleep | bool (frames,) | |
| obstacles/NAME/wrenches | float64 (frames, 6) | of all bodies on it, at its origin, in its axes |

Attributes of the group are run, status ('done' or 'failed'), error, parameters and outcomes. A
run that failed has no arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec
from zarr.storage import MemoryStore

from softbody_ros.ensemble.running import Recording

CHUNK = 4_000_000
"""Bytes of a chunk, about: as many whole frames as fit."""


def encoded(recording: Recording | None, attributes: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the files of a group: the same arguments give the same bytes."""
    store: dict[str, Any] = {}
    group = zarr.create_group(MemoryStore(store), attributes=dict(attributes))
    for path, array in _arrays(recording).items() if recording is not None else ():
        _add(group, path, array)
    return {path: store[path].to_bytes() for path in sorted(store)}


def _arrays(recording: Recording) -> dict[str, np.ndarray]:
    arrays = {'times': recording.times, 'ticks': recording.ticks}
    for name, body in recording.bodies.items():
        for field in dataclasses.fields(body):
            arrays[f'bodies/{name}/{field.name}'] = getattr(body, field.name)
    for name, wrenches in recording.obstacle_wrenches.items():
        arrays[f'obstacles/{name}/wrenches'] = wrenches
    return arrays


def _add(group: zarr.Group, path: str, array: np.ndarray) -> None:
    of_frame = array[0].nbytes if len(array) else 1
    frames = min(max(CHUNK // max(of_frame, 1), 1), max(len(array), 1))
    # bytes of the same weight lie side by side: of numbers that change slowly, these are alike
    codec = BloscCodec(cname='zstd', clevel=3, shuffle='shuffle', typesize=array.itemsize)
    made = group.create_array(
        path, shape=array.shape, dtype=array.dtype, compressors=codec,
        chunks=(frames, *(max(length, 1) for length in array.shape[1:])),
    )  # fmt: skip
    made[...] = array
