# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The same scene in two processes gives the same bits, with any number of threads.

Compiled there or before, for this processor or for any: see test_compiled_anew.
"""

import json

from kernel_worlds import EVERYTHING, HASHES, LARGE, TICKS, hashes
import numpy as np
import pytest
from python_processes import printed

from softbody_ros.core import compiled

THREADS = ('NUMBA_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


@pytest.mark.parametrize('scene', [EVERYTHING, LARGE], ids=['everything', 'large'])
def test_processes_with_one_and_two_threads_agree_in_every_tick(scene):
    """10 242 vertices are more than is summed in one thread when there are two."""
    one, again, two = (
        hashes(printed(scene + HASHES, **dict.fromkeys(THREADS, threads)).splitlines())
        for threads in (1, 1, 2)
    )
    assert len(set(one)) == TICKS
    assert one == again
    assert one == two


@pytest.mark.skipif(not compiled.is_compiled(), reason='kernels are plain Python')
def test_plain_python_computes_the_same():
    """Not to the last bit: powers and functions of the C library may differ by it."""
    code = """
import json
from softbody_ros.core import warm_up
world = warm_up.everything(subdivisions=0)
world.step(3)
print(json.dumps([world.positions(name).tolist() for name in world.names]))
"""
    machine, plain = (json.loads(printed(code, NUMBA_DISABLE_JIT=jit)) for jit in (None, '1'))
    for one, other in zip(machine, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-10)
