# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs for processes of their own, that compile and step worlds in which much happens."""

TICKS = 60
EVERYTHING = f"""
from softbody_ros.core import warm_up
world, ticks = warm_up.everything(), {TICKS}
"""
LARGE = f"""
from softbody_ros.core import BodyConfig, World, WorldConfig
bodies = [
    BodyConfig(name='small', subdivisions=2, position=(3.0, 0.0, 0.6), plasticity_creep=20.0),
    BodyConfig(name='regions', subdivisions=5, mode='linear', regions_count=12,
               position=(6.0, 0.0, 0.6)),
    BodyConfig(name='large', subdivisions=5, position=(0.0, 0.0, 0.6)),
    BodyConfig(name='rigid', subdivisions=5, mode='rigid', position=(9.0, 0.0, 0.6),
               initial_velocity_angular=(1.0, 2.0, 3.0)),
]
world, ticks = World(WorldConfig(bodies=tuple(bodies))), {TICKS}
"""
HASHES = """
import hashlib
import numpy
total = hashlib.sha256()
for value in vars(world._integrator._state).values():
    if isinstance(value, numpy.ndarray):
        total.update(value.tobytes())
print('start', total.hexdigest())
for _ in range(ticks):
    world.step()
    total = hashlib.sha256()
    for name in world.names:
        total.update(world.positions(name).tobytes() + world.velocities(name).tobytes())
        total.update(b''.join(array.tobytes() for array in world.contact_wrench(name)))
    print('hash', total.hexdigest())
"""
AHEAD = """
import time
from softbody_ros.core import compiled, warm_up
begin = time.perf_counter()
warm_up.compile_ahead(print, print)
print('ahead', time.perf_counter() - begin)
for name, made in compiled.kernels.items():
    print('kernel', name, len(made.signatures))
"""
FOR_ANY_PROCESSOR = {'NUMBA_CPU_NAME': 'generic', 'NUMBA_CPU_FEATURES': ''}
"""Without features the name alone would still mean those of this processor."""


def start(lines):
    """Return the hash of what NumPy and SciPy have computed before the first tick."""
    (line,) = [line for line in lines if line.startswith('start ')]
    return line


def hashes(lines):
    """Return the hashes, one for each tick, from what a program has printed."""
    return [line for line in lines if line.startswith('hash ')]


if __name__ == '__main__':  # what `test_compiled_anew` looks at
    exec(AHEAD + EVERYTHING + HASHES)
