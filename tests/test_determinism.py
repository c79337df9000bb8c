# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The same scene in two processes gives the same bits, with any number of threads.

Compiled there or before, for this processor or for any: see test_compiled_anew.
"""

from kernel_worlds import EVERYTHING, HASHES, LARGE, TICKS, hashes
import pytest
from python_processes import printed

THREADS = ('NUMBA_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


@pytest.mark.parametrize(
    'scene',
    [
        # one thread computes it anyhow: processes are compared by test_compiled_anew, too
        pytest.param(EVERYTHING, marks=pytest.mark.slow),
        pytest.param(LARGE, marks=pytest.mark.oldest),
    ],
    ids=['everything', 'large'],
)
def test_processes_with_one_and_two_threads_agree_in_every_tick(scene):
    """10 242 vertices are more than is summed in one thread when there are two."""
    one, two = (
        hashes(printed(scene + HASHES, **dict.fromkeys(THREADS, threads)).splitlines())
        for threads in (1, 2)
    )
    assert len(set(one)) == TICKS
    assert one == two
