# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The runs of a sweep on the workers of a cluster, a bounded number at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass
import itertools
import queue
import time
from typing import Any
import uuid

import distributed
from distributed.scheduler import KilledWorker

from softbody_ros.core import ConfigError, MeshError, SimulationError
from softbody_ros.core.config import shown
from softbody_ros.ensemble.encoding import encoded
from softbody_ros.ensemble.mesh_transfer import Meshes, MeshFiles, paths_on_worker
from softbody_ros.ensemble.outcomes import outcomes
from softbody_ros.ensemble.running import record, run

AHEAD = 2
"""Runs that each thread of the workers has, one of them waiting: none waits for the client."""
PATIENCE = 0.2
"""Seconds after which it is looked whether to stop."""
WORKERS_SEEN = 2.0
"""Seconds after which it is looked how many workers there are."""

GONE = 'the scheduler is gone'


class LostCluster(ConnectionError):  # noqa: N818
    """The scheduler is gone, or its workers cannot do the work; with a sentence."""


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


def completed(
    client: distributed.Client,
    orders: Iterable[Order],
    meshes: Meshes,
    stop_if_asked: Callable[[], None],
) -> Generator[tuple[Order, dict[str, bytes]]]:
    """
    Yield orders with the files of their runs, as they are done.

    Raises
    ------
    LostCluster
        if there is no more cluster that can do it.

    """
    if meshes.contents:
        client.register_plugin(MeshFiles(meshes))
    waiting: dict[distributed.Future, Order] = {}
    try:
        yield from _completed(client, iter(orders), waiting, stop_if_asked)
    finally:
        if client.status == 'running':
            client.cancel(list(waiting), force=True)
            if meshes.contents:
                client.unregister_worker_plugin(meshes.key)


def _completed(
    client: distributed.Client,
    orders: Iterator[Order],
    waiting: dict[distributed.Future, Order],
    stop_if_asked: Callable[[], None],
) -> Iterator[tuple[Order, dict[str, bytes]]]:
    done: queue.SimpleQueue[distributed.Future] = queue.SimpleQueue()
    # of its own: another sweep on the same scheduler must not get the runs of this one
    prefix, limit, seen = f'run-{uuid.uuid4().hex[:8]}', 0, -WORKERS_SEEN
    while True:
        stop_if_asked()
        if client.status != 'running':
            raise LostCluster(GONE)
        if time.monotonic() - seen > WORKERS_SEEN:
            limit, seen = max(AHEAD * threads(client), 1), time.monotonic()
        for order in itertools.islice(orders, max(limit - len(waiting), 0)):
            key = f'{prefix}-{order.number}'
            future = client.submit(simulate, order, key=key, pure=False)
            waiting[future] = order
            future.add_done_callback(done.put)
        if not waiting:
            return
        try:
            future = done.get(timeout=PATIENCE)
        except queue.Empty:
            continue
        order = waiting.pop(future)
        yield order, _files(future, order)


def threads(client: distributed.Client) -> int:
    """Return how many runs the workers of a cluster make at a time."""
    return sum(client.nthreads().values())


def _files(future: distributed.Future, order: Order) -> dict[str, bytes]:
    error = future.exception() if future.status == 'error' else None
    if isinstance(error, KilledWorker):
        return failed(
            order,
            'several workers ended while they made this run, and it was given up: perhaps they '
            'have too little memory for it',
        )
    if error is not None:
        raise LostCluster(
            f'the workers cannot make runs ({type(error).__name__}: {shown(str(error))}): install '
            'the same softbody_ros there, with its extra sweep'
        )
    if future.status != 'finished':
        raise LostCluster(GONE)
    return future.result()
