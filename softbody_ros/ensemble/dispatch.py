# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The runs of a sweep on the workers of a cluster, a bounded number at a time."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import CancelledError, Future
from contextlib import suppress
import itertools
import queue
import time
import uuid

import distributed
from distributed.scheduler import KilledWorker

from softbody_ros.core.config import shown
from softbody_ros.ensemble.mesh_transfer import Meshes, MeshFiles
from softbody_ros.ensemble.work import Order, failed, simulate

AHEAD = 2
"""Runs that each thread of the workers has, one of them waiting: none waits for the client."""
PATIENCE = 0.2
"""Seconds after which it is looked whether to stop."""
WORKERS_SEEN = 2.0
"""Seconds after which it is looked how many workers there are."""
DESERTED = 120.0
"""Seconds without any worker after which nobody is expected any more."""
GONE = 'the scheduler is gone'
GIVEN_UP = (
    'several workers ended while they made this run, and it was given up: perhaps they have too '
    'little memory for it'
)


class LostCluster(ConnectionError):  # noqa: N818
    """The scheduler is gone, or its workers cannot do the work; with a sentence."""


def completed(
    client: distributed.Client,
    orders: Iterable[Order],
    meshes: Meshes,
    stop_if_asked: Callable[[], None],
) -> Generator[tuple[Order, dict[str, bytes]]]:
    """
    Yield orders with the files of their runs, as they are done.

    Parameters
    ----------
    client : Client
    orders : iterable of Order
    meshes : Meshes
        the files that they need
    stop_if_asked : callable
        called several times a second; what it raises ends this

    Raises
    ------
    LostCluster
        if there is no more cluster that can do it.

    """
    if meshes.contents:
        client.register_plugin(MeshFiles(meshes))
    flight = _InFlight(client)
    try:
        yield from _completed(client, orders, flight, stop_if_asked)
    finally:
        if client.status == 'running':
            flight.cancel()
            if meshes.contents:
                with suppress(Exception):  # the scheduler may go now; what was made counts
                    client.unregister_worker_plugin(meshes.key)


def threads(client: distributed.Client) -> int:
    """Return how many runs the workers of a cluster make at a time."""
    return sum(client.nthreads().values())


def _completed(
    client: distributed.Client,
    orders: Iterable[Order],
    flight: _InFlight,
    stop_if_asked: Callable[[], None],
) -> Generator[tuple[Order, dict[str, bytes]]]:
    # runs whose workers ended several times. One that only waited there is blamed, too: so each
    # of these is made once more at the end, alone
    suspects: deque[Order] = deque()
    orders, limit, seen, busy = iter(orders), 0, -WORKERS_SEEN, time.monotonic()
    while True:
        stop_if_asked()
        if client.status != 'running':
            raise LostCluster(GONE)
        if time.monotonic() - seen > WORKERS_SEEN:
            count, seen = threads(client), time.monotonic()
            limit, busy = max(AHEAD * count, 1), seen if count else busy
            if seen - busy > DESERTED:
                raise LostCluster(f'the cluster has had no worker for {DESERTED:.0f} s')
        for order in itertools.islice(orders, max(limit - len(flight), 0)):
            flight.submit(order)
        is_last = not len(flight)
        if is_last and not suspects:
            return
        if is_last:
            flight.submit(suspects.popleft(), is_alone=True)
        landed = flight.landed()
        if landed is None:
            continue
        order, files, was_alone = landed
        if files is not None:
            yield order, files
        elif was_alone:
            yield order, failed(order, GIVEN_UP)
        else:
            suspects.append(order)


class _InFlight:
    """Orders that were submitted, and are not done."""

    def __init__(self, client: distributed.Client) -> None:
        self._client = client
        self._orders: dict[distributed.Future, tuple[Order, bool]] = {}
        self._done: queue.SimpleQueue[tuple[distributed.Future, Future]] = queue.SimpleQueue()
        # of its own: another sweep on the same scheduler must not get the runs of this one
        self._prefix = f'run-{uuid.uuid4().hex[:8]}'

    def __len__(self) -> int:
        return len(self._orders)

    def submit(self, order: Order, is_alone: bool = False) -> None:
        """Let a worker make a run."""
        key = f'{self._prefix}-{order.number}' + '-alone' * is_alone
        future = self._client.submit(simulate, order, key=key, pure=False)
        self._orders[future] = order, is_alone
        # the event loop fetches it, once more if its worker ends meanwhile: who waits for the
        # next one that is done waits for no single one, and sees signals
        fetching = self._client.gather(future, asynchronous=True)
        loop = self._client.loop.asyncio_loop  # type: ignore[union-attr]
        fetched = asyncio.run_coroutine_threadsafe(fetching, loop)
        fetched.add_done_callback(lambda each: self._done.put((future, each)))

    def landed(self) -> tuple[Order, dict[str, bytes] | None, bool] | None:
        """
        Return an order that is done, its files, and whether it was alone; None if there is none.

        There are no files if workers ended again and again while they had it.
        """
        try:
            future, fetched = self._done.get(timeout=PATIENCE)
        except queue.Empty:
            return None
        order, was_alone = self._orders.pop(future)
        try:
            return order, fetched.result(), was_alone
        except KilledWorker:
            return order, None, was_alone
        except (Exception, CancelledError) as error:
            if future.status != 'error':
                raise LostCluster(GONE) from None
            raise LostCluster(
                f'the workers cannot make runs ({type(error).__name__}: {shown(str(error))}): '
                'install the same softbody_ros there, with its extra sweep'
            ) from None

    def cancel(self) -> None:
        """Let nobody make what is not done."""
        self._client.cancel(list(self._orders), force=True)
