# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A run of a sweep, as a worker makes it: from an order to the files of a group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from softbody_ros.core import ConfigError, MeshError, SimulationError
from softbody_ros.ensemble.encoding import encoded
from softbody_ros.ensemble.mesh_transfer import paths_on_worker
from softbody_ros.ensemble.outcomes import outcomes
from softbody_ros.ensemble.running import record, run


@dataclass(frozen=True)
class Order:
    """A run to be made: its number, all values, which of them vary, and the names of meshes."""

    number: int
    scene: Mapping[str, Any]
    values: Mapping[str, Any]
    seconds: float
    fps: float
    meshes: Mapping[str, str]
    key: str


def simulate(order: Order) -> dict[str, bytes]:
    """Make a run on a worker; return the files of its group, also if it fails."""
    paths = paths_on_worker(order.meshes, order.key)
    return files_of(order, paths)


def files_of(order: Order, paths: Mapping[str, str]) -> dict[str, bytes]:
    """Return the files of the group of a run; `paths` are those of mesh values here."""

    def local(values: Mapping[str, Any]) -> dict[str, Any]:
        return {
            name: paths.get(value, value) if isinstance(value, str) else value
            for name, value in values.items()
        }

    try:
        film = run(local(order.scene), local(order.values), order.seconds, order.fps)
        recording = record(film)
        return encoded(recording, _attributes(order, 'done', '', outcomes(recording)))
    except (ConfigError, MeshError, SimulationError) as error:
        reason = str(error)
    except MemoryError:
        reason = 'the run does not fit into memory: take fewer frames or coarser meshes'
    except Exception as error:
        # a fault of this program; the other runs may still be good
        reason = f'unexpected {type(error).__name__}: {error}'
    for value, path in paths.items():
        reason = reason.replace(path, value)
    return failed(order, reason)


def failed(order: Order, reason: str) -> dict[str, bytes]:
    """Return the files of a run that failed."""
    return encoded(None, _attributes(order, 'failed', reason, {}))


def _attributes(order: Order, status: str, error: str, came: Mapping[str, Any]) -> dict[str, Any]:
    return {
        'run': order.number,
        'status': status,
        'error': error,
        'parameters': dict(order.values),
        'outcomes': dict(came),
    }
