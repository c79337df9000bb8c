# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Workers that take runs, by Dask: processes of this machine, or an existing cluster.

Clusters of Kubernetes, SLURM or SSH are Dask's business: what is needed here is the address of the
scheduler, and an installation of this package on the workers.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os

import dask
import distributed

ALLOWED_FAILURES = 3
"""So many workers may die of one run before it counts as failed."""


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
    OSError
        if the scheduler cannot be reached.

    """
    settings = {
        'distributed.scheduler.allowed-failures': ALLOWED_FAILURES,
        'distributed.worker.daemon': False,
    }
    with dask.config.set(settings):
        if scheduler is not None:
            with distributed.Client(scheduler) as client:
                yield client
            return
        count = workers or len(os.sched_getaffinity(0))
        with (
            distributed.LocalCluster(
                n_workers=count, threads_per_worker=1, dashboard_address=None
            ) as local,
            distributed.Client(local) as client,
        ):
            yield client
