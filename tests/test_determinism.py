# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The same scene in two processes gives the same bits, with any number of BLAS threads."""

import os
import pathlib
import subprocess
import sys

import pytest

SCENE = """
import hashlib
from softbody_ros.core import BodyConfig, World, WorldConfig
bodies = [
    BodyConfig(name='small', subdivisions=2, position=(3.0, 0.0, 0.6), plasticity_creep=20.0),
    BodyConfig(name='regions', subdivisions={level}, mode='linear', regions_count=12,
               position=(6.0, 0.0, 0.6)),
    BodyConfig(name='large', subdivisions={level}, position=(0.0, 0.0, 0.6)),
    BodyConfig(name='rigid', subdivisions={level}, mode='rigid', position=(9.0, 0.0, 0.6),
               initial_velocity_angular=(1.0, 2.0, 3.0)),
]
world = World(WorldConfig(bodies=tuple(bodies)))
for _ in range({ticks}):
    world.step()
    total = hashlib.sha256()
    for name in world.names:
        total.update(world.positions(name).tobytes() + world.velocities(name).tobytes())
    print(total.hexdigest())
"""


def hashes(threads, level, ticks):
    """Return one hash per tick, computed in a process of its own."""
    environment = os.environ | {
        name: str(threads)
        for name in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
    }
    root = str(pathlib.Path(__file__).parent.parent)
    environment['PYTHONPATH'] = os.pathsep.join([root, environment.get('PYTHONPATH', '')])
    run = subprocess.run(
        [sys.executable, '-c', SCENE.format(level=level, ticks=ticks)],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return run.stdout.split()


@pytest.mark.parametrize(('level', 'ticks'), [(3, 120), (5, 60)])
def test_two_processes_with_one_and_two_threads_agree_in_every_tick(level, ticks):
    """10 242 vertices are more than BLAS sums in one thread when it has two."""
    one, again, two = (hashes(threads, level, ticks) for threads in (1, 1, 2))
    assert len(one) == ticks
    assert one == again
    assert one == two
