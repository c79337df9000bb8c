# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Workers that take runs, by Dask: processes of this machine, or an existing cluster.

Clusters of Kubernetes, SLURM or SSH are Dask's business: what is needed here is the address of the
scheduler, and an installation of this package on the workers.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, suppress
import logging
from multiprocessing import resource_tracker
import os
import signal
import warnings

import dask
import distributed

ALLOWED_FAILURES = 3
"""So many workers may die of one run before it counts as failed."""
THREADS = ('OMP_NUM_THREADS', 'MKL_NUM_THREADS', 'OPENBLAS_NUM_THREADS')
"""Of libraries that would use all cores in each worker."""
PATIENCE = 10
"""Seconds for a scheduler to answer."""
PARTING = 1.0
"""Seconds for workers to end by themselves, about."""


@contextmanager
def cluster(
    scheduler: str | None = None, workers: int | None = None
) -> Iterator[distributed.Client]:
    """
    Yield a client of a scheduler; without an address, of a local cluster that ends with it.

    Parameters
    ----------
    scheduler : str, optional
        such as tcp://10.0.0.1:8786
    workers : int, optional
        processes of a local cluster, with one thread each; one for each core by default

    Raises
    ------
    ConnectionError
        if the scheduler cannot be reached.

    """
    settings = {
        # or a worker that is down at this time after a failure, while it starts after the next
        # one, is given up
        'distributed.deploy.lost-worker-timeout': '1 day',
        'distributed.scheduler.allowed-failures': ALLOWED_FAILURES,
        'distributed.worker.daemon': False,
        # without Dask's MALLOC_TRIM_THRESHOLD_, with which memory is given back and taken again
        # for each array
        'distributed.nanny.pre-spawn-environ': dict.fromkeys(THREADS, 1),
        'distributed.worker.profile.enabled': False,  # it takes a tenth of short runs
    }
    with dask.config.set(settings), _quiet():
        if scheduler is not None:
            with _client(scheduler) as client:
                yield client
            return
        count = workers or len(os.sched_getaffinity(0))
        # Ctrl-C reaches all processes of a terminal. Threads and processes inherit what is
        # blocked: so it is left to the main thread of this one, which ends the others
        _start_tracker()
        unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            # it serves no dashboard, but HTTP all the same
            warnings.filterwarnings('ignore', 'Port .* is already in use', UserWarning)
            local = distributed.LocalCluster(
                n_workers=count, threads_per_worker=1, dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )  # fmt: skip
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
        with local:
            try:
                # else all results pass through the scheduler, a second time through this process
                with distributed.Client(local, direct_to_workers=True) as client:
                    yield client
            finally:
                local.sync(_part_with, local)


def _start_tracker() -> None:
    """Start Python's process that cleans up after workers that are killed, but not its warning."""
    before = os.environ.get('PYTHONWARNINGS')
    os.environ['PYTHONWARNINGS'] = 'ignore:resource_tracker:UserWarning'
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ['PYTHONWARNINGS']
        else:
            os.environ['PYTHONWARNINGS'] = before


def _client(scheduler: str) -> distributed.Client:
    try:
        return distributed.Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise ConnectionError(
            f'the scheduler {scheduler} cannot be reached ({error}): give the address that '
            '`dask scheduler` printed, such as tcp://10.0.0.1:8786'
        ) from None


async def _part_with(local: distributed.LocalCluster) -> None:
    """End the workers; one that does not end soon, as in the midst of a run, is killed."""
    closing = (nanny.close(timeout=PARTING) for nanny in local.workers.values())
    with suppress(asyncio.TimeoutError):
        await asyncio.gather(*closing)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from logging what users are told in a sentence, such as a lost worker."""
    loggers = [logging.getLogger(name) for name in ('distributed', 'distributed.client')]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
